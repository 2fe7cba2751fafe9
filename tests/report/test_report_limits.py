"""Sentences on what limits the best run, in verdict, report, results.json and on the terminal."""

import json
from dataclasses import replace

import pytest
from commands import cogless

import studies
from cogless.cli.studies import sentences
from cogless.report import best_runs, limit, render, verdicts, with_limits
from cogless.report.limit_sentences import setting
from cogless.results import results_json
from cogless.results.limits import Cause, Cost, Cure, Learner, Limits
from cogless.run.simulate import run_study
from cogless.study import load
from cogless.study.reading import changed, changes_from

TEXT = f"""title = "Two laws"
{studies.IDEAL}
position_sensor = {{ kind = "absolute", bits = 10, window = 4 }}
[scenario]
turn = {{ duration = "2 s", reference = "60 rpm", initial_speed = "60 rpm" }}
[controller]
pi = {{ law = "pi", baseline = true, kp = "0.01 A/rpm", ki = "0.1 A/rpm/s" }}
high = {{ law = "pi", label = "PI, high", kp = "0.02 A/rpm", ki = "0.4 A/rpm/s" }}
[[metric]]
name = "speed_ripple"
kind = "ripple-rms"
signal = "omega_m"
last = "1 s"
unit = "rpm"
"""
RPM = 0.10471975511965977  # rad/s
WINDOW = {"kind": "absolute", "bits": 10, "speed_method": "observer", "observer_bandwidth": "50 Hz"}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return studies.write(tmp_path_factory.mktemp("study"), TEXT)


@pytest.fixture(scope="module")
def results(path):
    return run_study(load(path))


def limits(causes, cures=(), value=10.0):
    """Limits of the run turn/high; causes (name, r/min without it), cures (changes, r/min, setting)."""
    return Limits(
        scenario="turn",
        controller="high",
        metric="speed_ripple_rad_s",
        order=None,
        value=value * RPM,
        causes=[Cause(name, x * RPM, 1 - (x / value) ** 2) for name, x in causes],
        cures=[Cure("sensor-steps", changes, x * RPM, own) for changes, x, own in cures],
    )


def told(results, *arguments, **keys):
    return str(limit(replace(results, limits={"turn": limits(*arguments, **keys)}), "turn") or "")


def test_it_is_the_second_sentence_of_the_verdict_and_below_the_headline(results):
    with_them = replace(results, limits={"turn": limits([("sensor-steps", 1.0)])})
    (verdict,) = verdicts(with_them)
    left = "simulated again, it left 1.00 rpm without the position sensor's steps"
    sentence = f"What limits “PI, high”, which leaves 10.0 rpm: {left}."
    assert verdict.details[0] == sentence and sentence not in verdicts(results)[0].details
    page = render(with_them)
    assert page.index(verdict.headline.split(",")[0]) < page.index("What limits") < page.index("<h2>Numbers")
    assert sentences(with_them) == {"turn": sentence} and sentences(results) == {}


@pytest.mark.parametrize(
    ("causes", "words"),
    [
        ([("delay", 9.8), ("friction", 11.0)], ""),  # 4 % and less than nothing
        ([("dead-time", 7.0), ("current-noise", 8.0)], "left 7.00 rpm without dead time and 8.00 rpm"),
        ([("sensor-steps", 3.0), ("sensor-error", 3.0)], "without the position sensor's steps and 3.00 rpm"),
        (
            [("disturbance", 1.0), ("learning-time", 1.5)],
            "What limits “PI, high”, which leaves 10.0 rpm: simulated again, it left 1.50 rpm in a longer "
            "run.",
        ),
        ([("disturbance", 1.0), ("delay", 8.0)], "1.00 rpm without any torque ripple"),
    ],
)
def test_causes_with_a_clear_share_are_named(results, causes, words):
    sentence = told(results, causes)
    assert words in sentence if words else not sentence


def test_two_causes_of_which_each_covers_the_other_are_named_as_a_pair(results):
    pair = [("sensor-steps + disturbance", 2.0), ("delay", 9.4), ("sensor-steps + delay", 9.0)]
    assert told(results, pair) == (
        "What limits “PI, high”, which leaves 10.0 rpm: simulated again, it left 2.00 rpm both without the "
        "position "
        "sensor's steps and without any torque ripple."
    )


def test_three_causes_are_named_at_most(results):
    five = [(name, 8.0) for name in ("sensor-steps", "sensor-error", "dead-time", "friction", "switching")]
    assert told(results, five).count(" rpm without ") == 3


def test_the_best_setting_is_told_and_a_part_only_if_it_leaves_clearly_less(results):
    observer, bits = {"drive.position_sensor": WINDOW}, {"drive.position_sensor.bits": 14}
    cause = [("sensor-steps", 1.0)]
    key = "drive.position_sensor"
    observed = f'{key}.speed_method = "observer" and {key}.observer_bandwidth = "50 Hz"'
    table = f"{observed} and {key}.window= (deletes this key)"
    assert told(results, cause, [(bits, 1.0, False), (observer, 4.0, True)]).endswith(
        f"A setting that was tried: {table} left 4.00 rpm. "
        "Other hardware that was tried: drive.position_sensor.bits = 14 (AS5047P, AS5048A, MT6701) "
        "left 1.00 rpm."
    )
    many = told(results, cause, [({"drive.position_sensor.bits": 20}, 1.0, False)])
    assert "bits = 20 (more than any chip that `cogless new` knows) left 1.00 rpm." in many
    assert "bits" not in told(results, cause, [(bits, 3.9, False), (observer, 4.0, True)])
    none = told(results, cause, [(observer, 9.0, True), (bits, 8.5, False)])
    assert none.endswith("steps. No change that was tried leaves clearly less.")


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (10.0, 0.5, "left 4.00 rpm. pi then left 0.500 rpm instead of 10.0 rpm."),
        (None, 0.5, "left 4.00 rpm. pi then left 0.500 rpm instead of not holding the speed."),
        (10.0, None, "left 4.00 rpm. pi then did not hold the speed."),
        (None, None, "left 4.00 rpm."),
    ],
)
def test_the_effect_on_the_law_that_learns_is_told_beside_that_on_the_best(results, before, after, words):
    made = limits([("sensor-steps", 1.0)], [({"drive.position_sensor": WINDOW}, 4.0, True)])
    in_si = [None if x is None else x * RPM for x in (before, after)]
    beside = replace(made, learner=Learner("pi", in_si[0]), cures=[replace(made.cures[0], learner=in_si[1])])
    told_limits = replace(results, limits={"turn": beside})
    assert str(limit(told_limits, "turn")).endswith(words)
    found = results_json.to_dict(told_limits)["limits"][0]
    assert found["learner"] == {"controller": "pi", "value": in_si[0]}
    assert found["tried"][0].get("learner") == in_si[1]
    own = {'controller."high".kp': "0.04 A/rpm"}  # says nothing of another law
    of_law = replace(beside, cures=[replace(beside.cures[0], changes=own, learner=None)])
    assert "pi then" not in str(limit(replace(results, limits={"turn": of_law}), "turn"))


def test_edges_are_timed_only_by_a_drive_that_can(results):
    timed = told(
        results, [("sensor-steps", 1.0)], [({"drive.position_sensor.speed_method": "MT"}, 1.0, True)]
    )
    assert 'speed_method = "MT" (if the drive can time edges) left 1.00 rpm.' in timed
    own_board = replace(results, study=changed(results.study, {"drive.make": "generic"}))
    timed = told(
        own_board, [("sensor-steps", 1.0)], [({"drive.position_sensor.speed_method": "MT"}, 1.0, True)]
    )
    assert 'speed_method = "MT" left 1.00 rpm.' in timed


def test_what_a_change_costs_is_told(results):
    made = limits([("sensor-steps", 1.0)], [({"drive.position_sensor.bits": 14}, 1.0, False)])
    electric = {"name": "electric_ripple", "kind": "ripple-rms", "signal": "tau_e", "unit": "mN*m"}
    torque = {"name": "torque_ripple", "kind": "ripple-rms", "signal": "tau_motor", "unit": "mN*m"}
    study = changed(results.study, {"metric": [*results.study.source.tables["metric"], electric, torque]})
    costs = [Cost("electric_ripple_N_m", before=0.010, value=0.016), Cost("torque_ripple_N_m", 0.001, 0.002)]
    costly = replace(made, cures=[replace(made.cures[0], costs=costs)])
    sentence = str(limit(replace(results, study=study, limits={"turn": costly}), "turn"))
    assert sentence.endswith("left 1.00 rpm, but 2.00 times the torque ripple (2.00 mN·m).")


@pytest.mark.parametrize(
    "changes",
    [
        {"drive.position_sensor.bits": 14, "drive.rates.speed_loop": "2 kHz"},
        {"drive.bus": {"delay_measured": "1 ms"}},
        {"drive.position_sensor": WINDOW},
        {'controller."high"': {"law": "pi", "kp": "0.1 A*s/rad", "ki": "1 A/rad"}},
        {'scenario."turn".override': {"drive.position_sensor.bits": 14}},
    ],
)
def test_each_part_of_a_change_can_be_set_as_it_stands(results, changes):
    parts = [
        part.removesuffix(" (deletes this key)") for part in setting(results.study, changes).split(" and ")
    ]
    wanted = changed(results.study, changes)
    assert changed(results.study, changes_from(parts)).source.tables == wanted.source.tables


def test_results_json_has_every_share_and_every_try(results):
    made = limits([("sensor-steps", 1.0)], [({"drive.position_sensor.bits": 14}, 2.0, False)])
    found = results_json.to_dict(replace(results, limits={"turn": made}))["limits"]
    assert json.loads(json.dumps(found)) == [
        {
            "scenario": "turn",
            "controller": "high",
            "metric": "speed_ripple_rad_s",
            "value": made.value,
            "causes": [{"cause": "sensor-steps", "without": RPM, "share": 0.99}],
            "untried": [],
            "tried": [
                {
                    "against": "sensor-steps",
                    "set": {"drive.position_sensor.bits": 14},
                    "value": 2 * RPM,
                    "setting": False,
                    "costs": {},
                }
            ],
        }
    ]
    assert "limits" not in results_json.to_dict(results)


@pytest.mark.parametrize(("option", "is_there"), [((), True), (("--no-limits",), False)])
def test_the_command_tells_it_below_its_table(capsys, path, tmp_path, option, is_there):
    code, out, _ = cogless(capsys, "run", path, "--no-traces", "-o", tmp_path / "out", *option)
    written = json.loads((tmp_path / "out" / "results.json").read_text())
    assert code == 0 and ("What limits" in out) is is_there and ("limits" in written) is is_there
    if is_there:
        assert written["limits"][0]["scenario"] == "turn"


def test_long_runs_own_code_and_faults_are_left_alone_unless_they_are_asked_for(results, monkeypatch):
    asked = []
    monkeypatch.setattr(best_runs, "limits", lambda study, run, *rest: asked.append(run.scenario))
    monkeypatch.setattr(best_runs, "TICKS_MOST", 100)
    assert with_limits(results).limits == {} and asked == []
    with_limits(results, long=True)
    assert asked == ["turn"]
    fault = {"scenario.turn.faults": [{"kind": "angle-missing", "time": "1 s", "duration": "0.1 s"}]}
    with_limits(replace(results, study=changed(results.study, fault)), long=True)
    assert asked == ["turn"]


def test_ctrl_c_keeps_what_is_there(results, monkeypatch):
    def pressed(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(best_runs, "limits", pressed)
    ended = with_limits(results)
    assert ended.limits == {} and ended.runs == results.runs


def test_the_sensors_share_is_told_once_where_a_run_has_measured_it(tmp_path):
    """The further runs' share replaces the verdict's own estimate, which is from the signals alone."""
    text = TEXT.replace("bits = 10, window = 4", 'bits = 20, window = 4, eccentricity = "3 deg"')
    eccentric = run_study(load(studies.write(tmp_path, text)), ["*/pi"])
    (alone,), (both,) = verdicts(eccentric), verdicts(with_limits(eccentric))
    said = [any("its share of the mean square" in sentence for sentence in v.details) for v in (alone, both)]
    assert said == [True, False] and "the position sensor's own error" in both.details[0]
