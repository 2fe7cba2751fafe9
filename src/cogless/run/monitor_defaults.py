"""Bounds for the plausibility checks of a drive's measurements; those left out of the study get defaults.

The defaults depend only on the parameters that the controller assumes and on the sensors' data, never on
scenarios: firmware must set them before it knows which motions will be asked for. docs/laws/monitor.md gives
the reasons.
"""

from __future__ import annotations

import math

from cogless.study.drive import Drive, IdealCurrentLoop, StarBelief
from cogless.study.mechanics import Mechanics
from cogless.study.motor import StarMotor
from cogless.study.numerics import no_load_speed
from cogless.study.position_sensor import Counted, Hall

SPEED_MARGIN = 1.5  # of the no-load speed
CURRENT_MARGIN = 2.0  # of the current limit
SUM_SHARE = 0.5  # of the current limit
STUCK_ANGLE = 0.5  # rad
STUCK_STEPS = 4.0  # of the sensor: a quarter of it, at which the angle is doubted, is a step
STUCK_TIME = 0.1  # s
STUCK_TORQUE = 0.1  # of the largest torque: a load that leaves less to turn the rotor counts as blocking it
OBSERVER_PEAK = (
    0.80  # of bandwidth times a step of the angle, which shows as a speed: largest (3x - x^2) e^-x
)
BRIDGE = 5e-3  # s
SETTLED = 10.0  # time constants after which an observer has forgotten a jump to a part in a thousand
HOLD = 10e-3  # s


def sensor_ratio(drive: Drive, mechanics: Mechanics) -> float:
    """Motor angle over position sensor's angle: the gear's ratio if the sensor is on the load, else 1."""
    return 1.0 if drive.position_sensor.side == "motor" else mechanics.ratio


def monitor_config(
    drive: Drive, motor: StarMotor, belief: StarBelief, mechanics: Mechanics
) -> dict[str, float]:
    """Members of the C struct cgl_monitor_config.

    Only pole pairs and phases are taken from `motor`; its other parameters are those in `belief`.
    """
    sensor, loop = drive.position_sensor, drive.current_loop
    period = 1 / drive.rates.current_loop
    step, window, resolution = 0.0, 0.0, 0.0
    if isinstance(sensor, Counted):
        # a jump of the angle shows in the counts of one law period; the speed from these acts in the next
        step, periods = sensor.step * sensor_ratio(drive, mechanics), sensor.periods(drive.rates.divider)
        held = 1 if sensor.speed_method == "average" else 2
        window = held * periods * period
        if sensor.bandwidth:
            window = SETTLED / sensor.bandwidth
            resolution = OBSERVER_PEAK * sensor.bandwidth * step
        elif not sensor.timed:
            resolution = step / (periods * period)
    elif isinstance(sensor, Hall):
        # an edge may be placed half a sector late, and the angle jumps there
        step, window = 1.5 * sensor.step(motor.pole_pairs), 2 * drive.rates.divider * period
    if drive.speed_filter:
        window += SETTLED / (2 * math.pi * drive.speed_filter)
    derived = {
        "omega_max": 0.0,
        "angle_step": step,
        "speed_window": window,
        "stuck_angle": max(STUCK_ANGLE + 2 * step, STUCK_STEPS * step),
        "stuck_time": max(STUCK_TIME, _step_time(drive, motor, belief, mechanics, step)),
        "current_max": 0.0,
        "current_sum": 0.0,
        "bridge": BRIDGE,
        "hold": HOLD,
        "phases": 0 if drive.ideal else motor.phases,
    }
    if drive.inverter is not None and not isinstance(loop, IdealCurrentLoop):
        no_load = no_load_speed(drive.inverter.bus_voltage, motor, belief.psi_f)
        derived["omega_max"] = max(SPEED_MARGIN * no_load, no_load + resolution)
        derived["current_max"] = CURRENT_MARGIN * loop.current_limit
        if motor.phases == 3 and drive.current_sensors.sensors == 3:
            derived["current_sum"] = SUM_SHARE * loop.current_limit
    given = {key: value for key, value in drive.monitor.model_dump().items() if value is not None}
    return derived | given


def _step_time(
    drive: Drive, motor: StarMotor, belief: StarBelief, mechanics: Mechanics, step: float
) -> float:
    """Time, s, in which full current turns a rotor from rest by a step of the sensor, rad.

    The load leaves `STUCK_TORQUE` of the motor's torque to accelerate. 0: the magnets give no torque.
    """
    torque = motor.power_factor * motor.pole_pairs * belief.psi_f * drive.current_loop.current_limit
    if torque <= 0:
        return 0.0
    return math.sqrt(2 * step * mechanics.stiff.inertia / (STUCK_TORQUE * torque))


def quality_config(drive: Drive) -> dict[str, float]:
    """Members of the C struct cgl_quality_config. By default the ripple's window is one revolution."""
    quality = drive.quality
    span = 2 * math.pi if quality.span is None else quality.span
    return {**quality.model_dump(), "span": span}
