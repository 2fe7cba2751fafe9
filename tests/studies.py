"""A small study as a user writes it, and a way to change it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cogless.errors import StudyError
from cogless.study import Study, load

# A motor on an ideal current loop, for what needs a run of seconds at once; ends within [drive].
IDEAL = """[motor]
pole_pairs = 4
R_s = "1 ohm"
L_d = "3 mH"
L_q = "3 mH"
psi_f = "20 mWb"
cogging = [ {order = 24, torque = "4 mN*m"} ]
[mechanics]
inertia = "2.5e-4 kg*m^2"
viscous_friction = "1e-4 N*m*s/rad"
[trace]
rate = "1 kHz"
[drive]
rates = { current_loop = "2 kHz", speed_loop = "1 kHz" }
current_loop = { kind = "ideal", current_limit = "3 A" }
"""
# Changes that add a law with an observer to `liu2018`.
ADRC: dict[str, Any] = {
    "controller.adrc": {"law": "adrc", "b": 1367.0, "omega_c": 100.0, "omega_o": 400.0},
    "scenario.60-rpm.controllers": ["pi", "adrc"],
}
# Changes that add a law of chosen orders to `uomodri`, whose ripple these are.
AFC: dict[str, Any] = {
    "controller.pi-afc": {
        "law": "pi-afc",
        "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"},
        "orders": [12, 18, 24, 36, 54, 72, 90, 144],
        "gain": "3 A/rad",
        "lead": "0.6 ms",
    }
}
HARMONIC: dict[str, Any] = {"controller.harmonic": {"law": "harmonic", "tuning": {"rule": "auto"}}}
# A salient motor above its base speed, with field weakening.
TRACTION = """
title = "A traction motor on 800 V"
[motor]
pole_pairs = 4
R_s = "20 mohm"
L_d = "0.6 mH"
L_q = "1.5 mH"
psi_f = "0.3 Wb"
cogging = [ {order = 12, torque = "5 N*m"} ]
[mechanics]
inertia = "0.05 kg*m^2"
viscous_friction = "0.05 N*m*s/rad"
[drive]
rates = { current_loop = "16 kHz", speed_loop = "8 kHz" }
current_loop = { bandwidth = "800 Hz", current_limit = "250 A" }
inverter = { bus_voltage = "800 V" }
current_reference = { field_weakening = true }
[scenario]
fast = { duration = "2 s", reference = "4500 rpm", initial_speed = "3000 rpm" }
[controller]
pi = { law = "pi", tuning = { rule = "phase-margin", phase_margin = "60 deg" } }
harmonic = { law = "harmonic", base = 12, tuning = { rule = "auto" } }
[[metric]]
name = "speed_ripple"
kind = "ripple-rms"
signal = "omega_m"
last = "0.3 s"
unit = "rpm"
"""
BASE = """
title = "A small drive"
[motor]
pole_pairs = 4
R_s = "15.42 ohm"
L_d = "30 mH"
L_q = "30 mH"
psi_f = "68 mWb"
cogging = [ {order = 24, torque = "4 mN*m"} ]
[mechanics]
inertia = "2.5e-4 kg*m^2"
[drive]
rates = { current_loop = "15 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "800 Hz", current_limit = "3 A" }
inverter = { bus_voltage = "310 V" }
[scenario.low]
duration = "0.4 s"
reference = "60 rpm"
initial_speed = "60 rpm"
[scenario.step]
duration = "0.3 s"
reference = "60 rpm"
initial_speed = "60 rpm"
events = [ {time = "0.1 s", load = "0.2 N*m"}, {time = "0.2 s", load = "0 N*m"} ]
override = { "drive.current_sensors.offset" = ["0.05 A", "0 A", "0 A"] }
controllers = ["pi", "fair"]
[controller.pi]
law = "pi"
kp = "0.015 A/rpm"
ki = "0.3 A/rpm/s"
[controller.fair]
law = "pi"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
[[metric]]
name = "speed_ripple"
kind = "peak-to-peak"
signal = "omega_m"
window = ["0.1 s", "0.3 s"]
unit = "rpm"
[[metric]]
name = "speed"
kind = "order"
signal = "omega_m"
order = [1, 2, 6]
frame = "electrical"
scenarios = ["low"]
[[metric]]
name = "recovery"
kind = "settling"
event = "0.1 s"
band = "2 rpm"
"""


def write(folder: Path, text: str = BASE) -> Path:
    """Write the text to folder/study.toml; returns the path."""
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def study(folder: Path, changes: dict[str, Any] | None = None, text: str = BASE) -> Study:
    """The study of the text with changes."""
    return load(write(folder, text), changes)


def refusal(call: Callable[..., Any], *arguments: Any, **named: Any) -> str:
    """The one line by which a call is refused, without the folder of the file that the line names first."""
    with pytest.raises(StudyError) as error:
        call(*arguments, **named)
    (line,) = str(error.value).splitlines()
    folder = line.partition(": ")[0].rpartition("/")[0]
    return line.replace(f"{folder}/", "") if folder else line
