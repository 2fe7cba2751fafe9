"""A study for pages: a motor that cogs, under a PI, a learning law and a table, short enough for a test."""

from __future__ import annotations

from pathlib import Path

import studies
from cogless.live.keys import AdjustableKeys, adjustable
from cogless.study import AnyStudy, Study

TEXT = """
title = "A <b>small</b> drive </script><script>alert(1)</script>"
description = "5 > 4 & so on, ${js} $title"
seed = 18446744073709551615
[motor]
pole_pairs = 4
R_s = "1 ohm"
L_d = "3 mH"
L_q = "3 mH"
psi_f = "20 mWb"
cogging = [ {order = 8, torque = "4 mN*m"} ]
[mechanics]
inertia = "2.5e-4 kg*m^2"
viscous_friction = "1e-4 N*m*s/rad"
[trace]
rate = "1 kHz"
[drive]
rates = { current_loop = "4 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "300 Hz", current_limit = "3 A" }
inverter = { bus_voltage = "48 V" }
position_sensor = { kind = "encoder", lines = 2500 }
current_sensors = { noise = "2 mA", bits = 12, range = "10 A" }
[scenario]
low = { duration = "2 s", reference = "120 rpm", initial_speed = "120 rpm" }
[scenario.step]
duration = "1 s"
reference = { speed = "180 rpm", ramp = "600 rpm/s" }
initial_speed = "180 rpm"
events = [ {time = "0.4 s", load = "10 mN*m"} ]
[controller]
pi = { law = "pi", label = "<i>PI</i>", tuning = { rule = "phase-margin", phase_margin = "60 deg" } }
[controller.pi-ilc]
law = "pi-ilc"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
gain = 0.02
lead = "3 ms"
cells = 256
q_half_width = 1
[controller.table]
law = "anti-cogging"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
cells = 128
calibration = { speed = "2 rev/s", revolutions = 1, position_gain = "20 1/s" }
[[metric]]
name = "speed_ripple"
kind = "ripple-rms"
signal = "omega_m"
last = "0.5 s"
unit = "rpm"
[[metric]]
name = "speed_order"
kind = "order"
signal = "omega_m"
order = [8, 16]
last = "1 s"
[[metric]]
name = "loss"
kind = "copper-loss"
last = "0.5 s"
[[metric]]
name = "chatter"
kind = "chattering"
[[metric]]
name = "recovery"
kind = "settling"
event = "0.4 s"
band = "5 rpm"
[[metric]]
name = "dip"
kind = "dip"
event = "0.4 s"
unit = "rpm"
"""


_FOUND: dict[str, AdjustableKeys] = {}


def study(folder: Path) -> Study:
    return studies.study(folder, None, TEXT)


def found(study: AnyStudy, for_own_motor: bool = False) -> AdjustableKeys:
    """The keys that a page can change: found once for all studies of the same text, as it takes seconds."""
    which = repr((study._source.tables, for_own_motor))
    if which not in _FOUND:
        _FOUND[which] = adjustable(study, for_own_motor)
    return _FOUND[which]
