"""Bounds for the plausibility checks of a drive's measurements; those left out of the study get defaults.

The defaults depend only on the parameters that the controller assumes and on the sensors' data, never on
scenarios: firmware must set them before it knows which motions will be asked for. docs/laws/monitor.md gives
the reasons.
"""

from __future__ import annotations

import math

from cogless.study.drive import Drive, IdealCurrentLoop, StarBelief
from cogless.study.motor import StarMotor
from cogless.study.numerics import no_load_speed
from cogless.study.position_sensor import Counted, Hall

SPEED_MARGIN = 1.5  # of the no-load speed
CURRENT_MARGIN = 2.0  # of the current limit
SUM_SHARE = 0.5  # of the current limit
STUCK_ANGLE = 0.5  # rad
STUCK_TIME = 0.1  # s
BRIDGE = 5e-3  # s
SETTLED = 10.0  # time constants after which an observer has forgotten a jump to a part in a thousand
HOLD = 10e-3  # s


def monitor_config(drive: Drive, motor: StarMotor, belief: StarBelief) -> dict[str, float]:
    """Members of the C struct cgl_monitor_config.

    Only pole pairs and phases are taken from `motor`; its other parameters are those in `belief`.
    """
    sensor, loop = drive.position_sensor, drive.current_loop
    period = 1 / drive.rates.current_loop
    step, window = 0.0, 0.0
    if isinstance(sensor, Counted):
        # an angle jump is in the counts of one law period, and the speed from them is used in the next period
        held = 1 if sensor.speed_method == "average" else 2
        step, window = sensor.step, held * sensor.periods(drive.rates.divider) * period
        if sensor.bandwidth:
            window = SETTLED / sensor.bandwidth
    elif isinstance(sensor, Hall):
        # an edge may be placed half a sector late, and the angle jumps there
        step, window = 1.5 * sensor.step(motor.pole_pairs), 2 * drive.rates.divider * period
    if drive.speed_filter:
        window += SETTLED / (2 * math.pi * drive.speed_filter)
    derived = {
        "omega_max": 0.0,
        "angle_step": step,
        "speed_window": window,
        "stuck_angle": STUCK_ANGLE + 2 * step,
        "stuck_time": STUCK_TIME,
        "current_max": 0.0,
        "current_sum": 0.0,
        "bridge": BRIDGE,
        "hold": HOLD,
        "phases": 0 if drive.ideal else motor.phases,
    }
    if drive.inverter is not None and not isinstance(loop, IdealCurrentLoop):
        derived["omega_max"] = SPEED_MARGIN * no_load_speed(drive.inverter.bus_voltage, motor, belief.psi_f)
        derived["current_max"] = CURRENT_MARGIN * loop.current_limit
        if motor.phases == 3 and drive.current_sensors.sensors == 3:
            derived["current_sum"] = SUM_SHARE * loop.current_limit
    given = {key: value for key, value in drive.monitor.model_dump().items() if value is not None}
    return derived | given


def quality_config(drive: Drive) -> dict[str, float]:
    """Members of the C struct cgl_quality_config. By default the ripple's window is one revolution."""
    quality = drive.quality
    span = 2 * math.pi if quality.span is None else quality.span
    return {**quality.model_dump(), "span": span}
