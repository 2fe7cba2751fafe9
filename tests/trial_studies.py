"""Small studies of trials as a user writes them: a drive, and a linear plant."""

from pathlib import Path
from typing import Any

from cogless.study import TrialStudy, load

DRIVE = """
title = "A small drive that repeats a motion"
[motor]
pole_pairs = 3
R_s = "1 ohm"
L_d = "5 mH"
L_q = "5 mH"
K_t = "0.37 N*m/A"
[mechanics]
inertia = "5.9e-4 kg*m^2"
viscous_friction = "1.4e-3 N*m*s/rad"
[drive]
rates = { current_loop = "8 kHz", position_loop = "400 Hz" }
current_loop = { kind = "ideal", current_limit = "10 A" }
position_sensor = { kind = "resolver", bits = 14, window = 16 }
[design]
state_weight = [1.8e4, 0.1, 4]
input_weight = 0.9
initial_state = [0.01, 0, 0]
[design.range]
"mechanics.inertia" = ["5.9e-4 kg*m^2", "10.6e-4 kg*m^2"]
[scenario.move]
duration = "0.5 s"
trials = 12
reference = [["0.05 s", "0 rad"], ["0.4 s", "1 rad"]]
changes = [
  { trial = 5, load_steps = [[40, "0.5 N*m"]] },
  { trial = 9, override = { "mechanics.inertia" = "10.6e-4 kg*m^2" } },
]
[controller.ilc]
law = "trial-ilc"
q_filter = { cutoff = "30 Hz" }
[controller.feedback]
law = "trial-ilc"
learning = false
[[metric]]
name = "error"
kind = "rms"
signal = "theta_error"
[[metric]]
name = "to_floor"
kind = "trials-to-floor"
signal = "theta_error"
floor = "1 mrad"
"""

LINEAR = """
title = "A heated plate"
[plant]
period = "0.1 s"
A = [["-a", 0.0], [1.0, "-2 * a"]]
B = ["k", 0]
C = [0, 1]
[plant.parameter]
a = [0.5, 1.0]
k = { value = 2.0, range = [1.8, 2.2] }
[design]
discretisation = "euler"
state_weight = [1, 1000, 10]
input_weight = 1
initial_state = [0, 1, 0]
[scenario.cycle]
duration = "5 s"
trials = 6
reference = [["0 s", 0], ["2 s", 1], ["3 s", 1], ["5 s", 0]]
load_steps = [[10, 0.1]]
changes = [{ trial = 4, override = { a = 0.8 } }]
[controller.ilc]
law = "trial-ilc"
[[metric]]
name = "error"
kind = "rms"
signal = "y_error"
"""


def write(folder: Path, text: str = DRIVE) -> Path:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def loaded(folder: Path, changes: dict[str, Any] | None = None, text: str = DRIVE) -> TrialStudy:
    study = load(write(folder, text), changes)
    assert isinstance(study, TrialStudy)
    return study
