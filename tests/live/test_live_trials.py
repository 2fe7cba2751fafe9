"""The live page of a study of trials: each trial's rows, each key, and the picture over the trials."""

import base64
import time

import live_studies
import pytest
import trial_studies
from browser import MISSING
from node import NO_ENGINE, NO_NODE, module_file, run_node
from test_live_engine import RUN, each_met, native
from test_live_keys import same_bytes
from test_live_page import same, sets_of, settle, show, text, type_into

from cogless.design.trials.from_study import design_study, retuned
from cogless.errors import StudyError
from cogless.live import left_out, write
from cogless.live.candidates import pinned, trial_candidates
from cogless.live.description import blobs, page_runs
from cogless.live.keys import AdjustableKeys
from cogless.live.live_page import data
from cogless.run.run_plan import plan
from cogless.run.simulate import simulate
from cogless.study import load
from cogless.study.reading import changed, changes_from
from cogless.study.toml import toml

NORM_OPTIMAL = '[controller.matrix]\nlaw = "norm-optimal"\n'
LONG = 60  # s, for all trials of all controllers
NEVER = 1e300  # infinity, which JSON hasn't
STUDIES = {"drive": trial_studies.DRIVE, "linear": trial_studies.LINEAR}

needs_engine = pytest.mark.skipif(bool(NO_NODE or NO_ENGINE), reason=NO_NODE or NO_ENGINE)
needs_browser = pytest.mark.skipif(bool(MISSING or NO_ENGINE), reason=MISSING or NO_ENGINE)


@pytest.fixture(scope="module", params=STUDIES)
def study(request, tmp_path_factory):
    return trial_studies.loaded(tmp_path_factory.mktemp(request.param), text=STUDIES[request.param])


@pytest.fixture
def adjusted(tmp_path_factory):
    """Of each kind a study, and the keys that a page of it can change."""

    def made(kind):
        study = trial_studies.loaded(tmp_path_factory.mktemp(kind), text=STUDIES[kind])
        return study, live_studies.found(study)

    return made


def same_rows(folder, study, trials):
    """Each signal over so many trials, in the page's engine and in the native one; what is learned, too."""
    pairs = list(each_met(page_runs(study)))
    designs = design_study(study, pairs)
    plans = [plan(study, *pair, design=designs[pair]) for pair in pairs]
    ticks = [trials * study.samples(p.scenario) * p.divider for p in plans]
    jobs = [
        {
            "description": base64.b64encode(blobs(study, p.scenario, p.controller)["run"].data).decode(),
            "decimation": p.decimation,
            "ticks": count,
        }
        for p, count in zip(plans, ticks, strict=True)
    ]
    given = {"module": module_file(folder, study.precision), "jobs": jobs}
    for each, count, made in zip(plans, ticks, run_node(folder, ("engine.js",), RUN, given), strict=True):
        assert "error" not in made, made
        assert (made["hash"], made["stored"]) == native(each, count), each.names[1:]
        assert made["names"] == [signal for signal, _ in each.drive.signals]


@needs_engine
def test_each_row_of_all_trials_has_the_native_bits(tmp_path, study):
    (scenario,) = study.scenario.values()
    same_rows(tmp_path, study, scenario.trials)


@needs_engine
@pytest.mark.parametrize(("name", "trials"), [("mandra2019", 3)])
def test_the_shipped_study_has_the_native_bits(tmp_path, name, trials):
    same_rows(tmp_path, load(name), trials)


@pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)
@pytest.mark.parametrize("kind", STUDIES)
def test_changed_values_give_the_bytes_of_set(tmp_path, adjusted, kind):
    same_bytes(tmp_path, *adjusted(kind), seed=3, count=4)


def test_the_gain_the_filter_the_loads_and_the_plant_can_be_changed(adjusted):
    names = {key.candidate.key: key for key in adjusted("drive")[1].keys}
    assert names["controller.ilc.K_3"].stops == ()
    assert len(names["controller.ilc.q_filter.cutoff"].stops) > 15
    assert names["scenario.move.trials"].candidate.low == 9  # the last change
    assert "scenario.move.changes.0.load_steps.0.1" in names
    assert 'scenario.move.changes.1.override."mechanics.inertia"' in names
    assert 'scenario.move.override."mechanics.inertia"' in names
    assert "drive.position_sensor.bits" in names
    assert not any("R_s" in name or "feedback" in name for name in names)  # they make no difference


OF_TRIALS = {  # what the page calls a key, its group, and its slider's ends as shares of the study's value
    "drive": {
        "controller.ilc.K_3": ("K_3", "ilc", 0.0, 2.0),
        "controller.ilc.q_filter.cutoff": ("q_filter.cutoff", "ilc", 0.3, 2.0),
        "scenario.move.trials": ("trials", "Trials", 9 / 12, 2.0),
        "scenario.move.changes.0.load_steps.0.1": ("load, from trial 5", "Trials", 0.0, 2.0),
        'scenario.move.changes.1.override."mechanics.inertia"': (
            "mechanics.inertia, from trial 9", "Trials", 0.5, 2.0
        ),
        'scenario.move.override."mechanics.inertia"': ("mechanics.inertia", "Load and motion", 0.3, 3.0),
        'scenario.move.override."mechanics.viscous_friction"': (
            "mechanics.viscous_friction", "Load and motion", 0.0, 3.0
        ),
        'scenario.move.override."motor.K_t"': ("motor.K_t", "Motor", 0.7, 1.3),
        "drive.position_sensor.bits": ("drive.position_sensor.bits", "Sensors", 8 / 14, 20 / 14),
    },
    "linear": {  # its update is chosen as a whole
        "scenario.cycle.trials": ("trials", "Trials", 4 / 6, 2.0),
        "scenario.cycle.load_steps.0.1": ("load", "Trials", 0.0, 2.0),
        "scenario.cycle.changes.0.override.a": ("a, from trial 4", "Trials", 0.5, 2.0),
        "scenario.cycle.override.a": ("a", "Plant", 0.5, 2.0),
        "scenario.cycle.override.k": ("k", "Plant", 0.5, 2.0),
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", STUDIES)
def test_sliders_of_trials_are_about_the_studys_values(tmp_path, kind):
    found = list(trial_candidates(trial_studies.loaded(tmp_path, text=STUDIES[kind])))
    assert {one.key: (one.label, one.group) for one in found} == {
        key: told[:2] for key, told in OF_TRIALS[kind].items()
    }
    for one in found:
        ends = OF_TRIALS[kind][one.key][2:]
        assert (one.low / one.start, one.high / one.start) == pytest.approx(ends, rel=1e-3), one.key
        first, name = one.key.split(".")[:2]
        assert (one.scenario, one.controller) == (
            name if first == "scenario" else None,
            name if first == "controller" else None,
        )


def test_a_law_with_a_matrix_is_left_out_and_named(tmp_path):
    study = trial_studies.loaded(tmp_path, text=trial_studies.DRIVE + NORM_OPTIMAL)
    assert [controller for _, controller in page_runs(study)] == ["ilc", "feedback"]
    assert left_out(study) == [
        "matrix: its learning matrix, with one number for each pair of samples, is too large for a page."
    ]


def test_a_study_that_has_nothing_else_is_refused(tmp_path):
    begin, _, rest = trial_studies.DRIVE.partition("[controller.ilc]")
    only = begin + NORM_OPTIMAL + rest[rest.index("[[metric]]") :]
    study = trial_studies.loaded(tmp_path, text=only)
    with pytest.raises(
        StudyError, match="live: expected a controller that can run in a page: matrix: its learning"
    ):
        write(study, tmp_path / "page.html", "cogless run x")


LEARNERS = """
[controller.signal]
law = "trial-ilc"
K_s = [-99.4, -0.927, 1.39]
q_filter = { cutoff = "12 Hz", acts_on = "signal" }
[controller.observer]
law = "observer-ilc"
"""


@pytest.fixture(scope="module")
def learners(tmp_path_factory):
    """A study with a law of each kind that a page tunes, and what its designs chose."""
    text = trial_studies.DRIVE.replace("[[metric]]", LEARNERS + "[[metric]]", 1)
    study = trial_studies.loaded(tmp_path_factory.mktemp("learners"), text=text)
    return study, *pinned(study)


@pytest.fixture(scope="module")
def knobs(learners):
    return live_studies.found(learners[1])


def test_what_the_designs_chose_is_written_out_and_changes_no_bit(learners):
    study, held_still, pins = learners
    chosen = {"ilc.K_3", "ilc.shift", "signal.K_3", "signal.shift", "observer.pole", "observer.cutoff"}
    assert set(pins) == {f"controller.{key}" for key in chosen}
    designs = design_study(study, list(page_runs(study)))
    assert pins["controller.signal.K_3"] == designs["move", "signal"].K_3
    for pair in page_runs(study):
        assert blobs(held_still, *pair)["run"].data == blobs(study, *pair)["run"].data


def test_what_auto_chose_has_knobs_too(tmp_path):
    """A controller of which nothing is said: the page holds the filter and the shift that were chosen."""
    silent = trial_studies.DRIVE.replace('q_filter = { cutoff = "30 Hz" }', "")
    study = trial_studies.loaded(tmp_path, text=silent)
    run = ("move", "ilc")
    design, (held_still, pins) = design_study(study, [run])[run], pinned(study)
    chosen = held_still.controller["ilc"]
    assert (chosen.K_3, chosen.shift, chosen.q_filter.cutoff) == (
        design.K_3, design.shift, design.gains.cutoff
    )  # fmt: skip
    assert blobs(held_still, *run)["run"].data == blobs(study, *run)["run"].data
    keys = {one.key for one in trial_candidates(held_still) if one.controller == "ilc"}
    assert keys == {f"controller.ilc.{key}" for key in ("K_3", "shift", "q_filter.cutoff")}
    by_command = [f"{key}={toml(value)}" for key, value in pins.items()]
    other = changed(study, changes_from([*by_command, 'controller.ilc.q_filter.cutoff="20 Hz"']))
    assert other.controller["ilc"].q_filter.cutoff == 20
    assert (other.controller["ilc"].K_3, other.controller["ilc"].shift) == (chosen.K_3, chosen.shift)


def test_filter_shift_and_weight_have_knobs(knobs):
    keys = {key.candidate.key: key for key in knobs.keys}
    for name in (
        "controller.signal.q_filter.cutoff",
        "controller.ilc.q_filter.cutoff",
        "controller.observer.cutoff",
    ):
        assert len(keys[name].stops) > 15  # fmt: skip
    assert keys["controller.signal.q_filter.cutoff"].candidate.label == "q_filter.cutoff (K_3 stays)"
    shift = keys["controller.ilc.shift"]
    assert (shift.candidate.low, shift.candidate.high, shift.stops) == (2, 16, ())
    assert "controller.observer.pole" in keys
    weight = keys["design.input_weight"]
    assert weight.stops == (0.09, 0.18, 0.45, 0.9, 1.8, 4.5, 9.0)
    assert {place[1] for place, lands in weight.lands.items() if lands} == {"ilc", "feedback"}
    assert knobs.left_out == []


@pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)
def test_changed_filters_shifts_and_weights_give_the_bytes_of_set(tmp_path, learners, knobs):
    same_bytes(tmp_path, learners[1], knobs, seed=5, count=4)


@pytest.mark.parametrize("weight", [0.18, 4.5])
def test_a_weight_of_the_page_gives_the_gains_of_a_whole_design(learners, weight):
    _, held_still, _ = learners
    other = changed(held_still, {"design.input_weight": weight})
    for run in page_runs(held_still):
        quick, whole = retuned(other, run, held_still), design_study(other, [run])[run]
        assert (quick.K_1.tolist(), quick.K_2, quick.N) == (whole.K_1.tolist(), whole.K_2, whole.N)
        assert (quick.K_3, quick.shift) == (whole.K_3, whole.shift)


def test_gains_of_a_filter_are_found_anew_where_nothing_is_given(learners):
    """Without a given K_3 a filter on the signal changes it, where it is found by frequency."""
    study = changed(learners[0], {"controller.signal.shift": 3})
    run, other = ("move", "signal"), changed(study, {"controller.signal.q_filter.cutoff": "8 Hz"})
    quick, whole = retuned(other, run, study), design_study(other, [run])[run]
    assert quick.K_3 == whole.K_3 != design_study(study, [run])[run].K_3


def test_thirty_changes_are_one_row_and_no_thirty_sliders(tmp_path):
    text = trial_studies.DRIVE
    begin, end = text.index("changes = ["), text.index("[controller.ilc]")
    loads = ",".join(f'{{ trial = {n + 2}, load_steps = [[40, "{0.01 * n:.2f} N*m"]] }}' for n in range(30))
    text = (text[:begin] + f"changes = [{loads}]\n" + text[end:]).replace("trials = 12", "trials = 40")
    study = trial_studies.loaded(tmp_path, text=text)
    assert not any("load_steps" in one.key for one in trial_candidates(study))
    (scenario,) = data(study, AdjustableKeys(), "")["scenarios"]
    floor = next(metric for metric in scenario["metrics"] if metric["name"] == "to_floor")
    assert floor["titles"] == ["to floor, from trial 1", "to floor, worst of 30 load changes from trial 2"]
    assert floor["groups"] == [(0, 1), (1, 31)]
    assert [phase["name"] for phase in scenario["phases"]] == ["start", "trial 2: load", "trial 31: load"]


@pytest.fixture
def page(window, path):
    show(window, path, LONG)
    yield window
    assert [entry["message"] for entry in window._post("/se/log", {"type": "browser"})] == []


def numbers(shown, controller, off=False):
    of = f"cogless.result('{controller}', {str(off).lower()}).result.values"
    return shown.run(f"return {of}.map((of) => of.map((x) => Math.min(x, {NEVER})))")


def flat(values):
    return [min(x, NEVER) for value in values for x in value]


@needs_browser
def test_the_page_has_the_numbers_of_set(page, study):
    (scenario,) = study.scenario
    wanted = list(simulate(study, scenario, "ilc").metrics.values())
    same(flat(numbers(page, "ilc")), flat(wanted))
    assert "with learning off" in text(page, "#verdicts")
    unlearned = simulate(changed(study, {"controller.ilc.learning": False}), scenario, "ilc")
    same(flat(numbers(page, "ilc", True)), flat(unlearned.metrics.values()))
    type_into(page, "controller.ilc.K_3", 0.3)
    settle(page, LONG)
    assert sets_of(page) == {**pinned(study)[1], "controller.ilc.K_3": 0.3}
    other = changed(study, sets_of(page))
    same(flat(numbers(page, "ilc")), flat(simulate(other, scenario, "ilc").metrics.values()))
    assert numbers(page, "ilc") != wanted
    assert "Before the change" in text(page, "#verdicts")
    titles = page.run("return [...document.querySelectorAll('.panel strong')].map((s) => s.textContent)")
    assert titles[0].startswith("Error over one trial of ilc: 1 against ")
    assert titles[1] == "RMS of the error in each trial"
    assert {"Learned signal", "Position error" if study.plant is None else "Error"} <= set(titles)
    assert "Orders" not in text(page, "#shown")
    assert page.run("return document.documentElement.scrollWidth") <= 1300


@needs_browser
def test_the_page_has_the_numbers_of_set_with_another_shift_and_weight(page, study):
    """With the learning gain and the filter that the design chose before: the page's command gives them."""
    (scenario,) = study.scenario
    type_into(page, "controller.ilc.shift", 4)
    page.run(f"cogless.set('design.input_weight', {2 * study.design.input_weight})")
    settle(page, LONG)
    sets = sets_of(page)
    assert sets == {
        **pinned(study)[1],
        "controller.ilc.shift": 4,
        "design.input_weight": 2 * study.design.input_weight,
    }
    other = changed(study, sets)
    same(flat(numbers(page, "ilc")), flat(simulate(other, scenario, "ilc").metrics.values()))
    again = simulate(study, scenario, "ilc").metrics.values()
    assert flat(numbers(page, "ilc")) != pytest.approx(flat(again))


@needs_browser
def test_a_trial_is_chosen_and_its_curves_shown(page, study):
    (scenario,) = study.scenario.values()
    labels = page.run("return [...document.querySelectorAll('#trial button')].map((b) => b.textContent)")
    assert labels[:2] == ["1", "2"] and labels[-1] == str(scenario.trials)
    drawing = "return [...document.querySelectorAll('#within canvas')].map((c) => c.toDataURL()).join()"
    page.run("document.querySelector('#within').scrollIntoView()")
    time.sleep(0.2)  # a plot is painted when it comes into sight
    before = page.run(drawing)
    page.run("document.querySelector('#trial button').click()")
    time.sleep(0.2)
    assert page.run("return cogless.state.trial") == 1
    assert "trial=1&" in page.run("return location.hash") + "&"
    assert page.run(drawing) != before


@needs_browser
def test_the_changed_study_as_a_file_gives_the_same_run(page, study, tmp_path):
    """A value within an array of the study is replaced where it stands."""
    (scenario,) = study.scenario
    steps = f"scenario.{scenario}.{'changes.0.' if study.plant is None else ''}load_steps.0.1"
    type_into(page, steps, 0.2)
    settle(page, LONG)
    (tmp_path / "changed.toml").write_text(page.run("return cogless.toml()"), encoding="utf-8")
    again = load(tmp_path / "changed.toml")
    same(flat(numbers(page, "ilc")), flat(simulate(again, scenario, "ilc").metrics.values()))


@needs_browser
def test_runs_that_nobody_wants_any_more_are_stopped(page, study):
    (scenario,) = study.scenario
    for n in range(8):
        page.run(f"cogless.set('controller.ilc.K_3', {0.1 + 0.05 * n})")
    settle(page, LONG)
    other = changed(study, sets_of(page))
    same(flat(numbers(page, "ilc")), flat(simulate(other, scenario, "ilc").metrics.values()))
