"""Torque mode: somebody else's current, to which the map that was learned in speed mode adds."""

import math
from pathlib import Path

import numpy as np
import pytest

import cogless
import studies
from cogless.errors import StudyError
from cogless.results.status import Status
from cogless.run.simulate import simulate

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
[scenario.run]
duration = "16 s"
reference = "6 rad/s"
initial_speed = "6 rad/s"
torque_mode = {{ {mode} }}
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
