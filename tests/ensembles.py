"""A small study that varies, quick to run."""

from pathlib import Path
from typing import Any

import studies
from cogless.study import Study

TEXT = f"""title = "A small ensemble"
seed = 5
{studies.IDEAL}
[scenario.low]
duration = "0.3 s"
reference = "300 rpm"
initial_speed = "300 rpm"
[controller.pi]
law = "pi"
kp = "0.015 A/rpm"
ki = "0.3 A/rpm/s"
[controller.pi-ilc]
law = "pi-ilc"
kp = "0.015 A/rpm"
ki = "0.3 A/rpm/s"
gain = "0.001 A/rpm"
cells = 64
[[metric]]
name = "ripple"
kind = "ripple-rms"
signal = "omega_m"
last = "0.2 s"
unit = "rpm"
limit = "3 rpm"
[[metric]]
name = "speed"
kind = "order"
signal = "omega_m"
order = [24, 48]
last = "0.2 s"
[vary]
mechanics.inertia = {{ uniform = "20 %" }}
mechanics.viscous_friction = {{ log = ["5e-5 N*m*s/rad", "5e-4 N*m*s/rad"] }}
"""
VARY = TEXT[TEXT.index("[vary]") :]


def study(folder: Path, changes: dict[str, Any] | None = None, vary: str | None = None) -> Study:
    """The small study with these changes; `vary`, if given, replaces its [vary]."""
    return studies.study(folder, changes, TEXT if vary is None else TEXT.replace(VARY, vary))
