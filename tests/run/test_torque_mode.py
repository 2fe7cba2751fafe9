"""Torque mode: somebody else's current, to which the map that was learned in speed mode adds."""

import math
from pathlib import Path

import numpy as np
import pytest

import cogless
import studies
from cogless.control_library import Status
from cogless.errors import StudyError
from cogless.report import verdicts
from cogless.report.comparison import compare
from cogless.run.simulate import run_study, simulate
from cogless.study import changed

TUNING = 'tuning = { rule = "phase-margin", phase_margin = "60 deg" }'
MAP = 'memory = "angle"\nperiod = "electrical"\ncells = 1024'
SPACE = 'period = { of = "electrical" }\ncells = 1024'
LAWS = {
    "pi": TUNING,
    "pi-ilc": f'{TUNING}\n{MAP}\ngain = "0.2 A*s/rad"\nlead = "1 ms"',
    "robust-ilc": f'{MAP}\nb = "480 rad/s^2/A"\nc = "60 1/s"\neta = "60 1/s"\ng = "0 rad/s^2"\n'
    'q = 0.5\nbeta_1 = "0 rad/s^2"\nbeta_2 = "120 1/s"\ngamma = "100 1/s^2"',
    "anti-cogging": f"{TUNING}\ncells = 1024\n"
    'calibration = { speed = "0.1 rev/s", revolutions = 1, position_gain = "50 1/s" }',
    "pi-afc": f'{TUNING}\norders = [24]\ngain = "3 A/rad"\nlead = "1 ms"',
    "space-speed": f'{SPACE}\nk = 0.2\neta_bar = "5 rad/s"\nmu_alpha = 0.8',
    "space-position": f'{SPACE}\n{TUNING}\nframe = "mechanical"\nmu_alpha = 0.8\nhand_over = false',
}


def study(tmp_path: Path, law: str, mode: str = 'time = "12 s", current = "0.005 A"', keys: str = ""):
    file = tmp_path / "study.toml"
    file.write_text(f"""title = "A knob"
{studies.IDEAL}
[scenario]
run = {{ duration = "16 s", reference = "6 rad/s", initial_speed = "6 rad/s", torque_mode = {{ {mode} }} }}
[controller.law]
law = "{law}"
{keys or LAWS[law]}
[[metric]]
name = "ripple"
kind = "rms"
signal = "omega_m"
window = ["8 s", "12 s"]
""")
    return cogless.load(file)


def ripple(trace, first, last):
    """RMS of the torque at the shaft about its mean, N m."""
    torque = (trace["tau_e"] + trace["tau_cogging"])[trace.window(first, last)]
    return float(np.std(torque))


@pytest.mark.parametrize("law", [law for law in LAWS if law != "pi"])
def test_the_map_smooths_the_torque_of_somebody_elses_current(tmp_path, law):
    """Cogging alone is 4 mN m / sqrt 2 at the shaft."""
    trace = simulate(study(tmp_path, law), "run", "law").trace
    assert ripple(trace, 13, 16) < 0.15 * 4e-3 / math.sqrt(2)
    status = trace["status"][trace.window(13, 16)]
    assert np.all(status == Status.FROZEN)


def test_a_pi_passes_the_current_and_leaves_the_cogging(tmp_path):
    mode = 'time = "1 s", profile = [["1 s", "0.02 A"], ["3 s", "-0.02 A"]]'
    trace = simulate(study(tmp_path, "pi", mode), "run", "law").trace
    there = trace.window(1, 3)
    wanted = np.interp(trace["time"][there], [1, 3], [0.02, -0.02])
    assert trace["i_q_ref"][there] == pytest.approx(wanted, abs=1e-6)
    assert ripple(trace, 1, 1.5) == pytest.approx(4e-3 / math.sqrt(2), rel=0.05)


def test_a_law_of_ones_own_has_no_torque_mode(tmp_path):
    (tmp_path / "own.py").write_text("class Law:\n    def step(self, inputs):\n        return 0.0\n")
    keys = 'object = "own.py:Law"'
    with pytest.raises(StudyError, match="torque_mode: expected a law of the control library"):
        simulate(study(tmp_path, "python", keys=keys), "run", "law")


@pytest.mark.parametrize(
    "mode, problem",
    [
        ('time = "1 s"', "torque_mode: .*expected either current or profile"),
        ('time = "16 s", current = "0 A"', "torque_mode.time: .*expected a time within"),
        ('time = "1 s", profile = [["2 s", "0 A"], ["1 s", "1 A"]]', "torque_mode.profile: .*each later"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, mode, problem):
    with pytest.raises(StudyError, match=problem):
        study(tmp_path, "pi", mode)


LOAD = 0.02  # N m
HANDED_OVER = {
    "space-speed": LAWS["space-speed"],
    "robust-ilc": LAWS["robust-ilc"].replace('gamma = "100 1/s^2"', 'gamma = "0 1/s^2"'),
    "space-position": LAWS["space-position"].replace("hand_over = false", "hand_over = true"),
}


@pytest.mark.parametrize("law", [*LAWS])
def test_what_is_learned_of_a_load_acts_where_no_integral_has_it_unless_it_is_learned_without(tmp_path, law):
    """docs/laws/torque-mode.md: learn without load there. K_t is 0.12 N m/A, and what is left is friction."""
    friction = 1e-4 * 6 / 0.12  # A
    for keys, handed in ((LAWS[law], law == "space-speed"), (HANDED_OVER.get(law, ""), True)):
        if not keys:
            continue
        given = study(tmp_path, law, 'time = "12 s", current = "0 A"', keys)
        mean = {}
        for load in (LOAD, 0.0):
            loaded = {
                "mechanics.load": f"{load} N*m",
                "scenario.run.events": [{"time": "12 s", "load": "0 N*m"}],
            }
            trace = simulate(changed(given, loaded), "run", "law").trace
            mean[load] = float(np.mean(trace["i_q_ref"][trace.window(12.0, 12.2)]))
        assert (mean[LOAD] > 0.9 * LOAD / 0.12) is handed, (keys, mean)
        assert abs(mean[0.0]) < (2 * friction if handed else 0.1 * LOAD / 0.12)


@pytest.mark.parametrize(
    ("window", "judged"), [((0.2, 0.9), True), ((0.5, 2.0), False), ((8.0, 12.0), False)]
)
def test_no_speed_is_said_to_be_lost_where_an_outer_loop_s_current_acts(tmp_path, window, judged):
    """The rotor coasts to rest there, as it should; before, the law holds the speed as ever."""
    given = study(tmp_path, "pi", 'time = "1 s", current = "0 A"')
    metric = {"name": "error", "kind": "rms", "signal": "omega_error", "window": [f"{t} s" for t in window]}
    results = run_study(changed(given, {"metric": [metric], "mechanics.coulomb_friction": "5 mN*m"}))
    (line,) = compare(results, "run")
    assert not line.missed
    assert line.unjudged == (
        "" if judged else "an outer loop sets the current in this scenario, so no speed is held"
    )
    (verdict,) = verdicts(results)
    assert (
        "no speed is judged: an outer loop sets the current in this scenario" in verdict.headline
    ) is not judged
