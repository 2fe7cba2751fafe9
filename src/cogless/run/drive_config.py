"""Describe a run for the engine: a nested dict of SI numbers for one controller in one scenario.

The controller's configuration in it is the C struct of the control library, as bytes (cogless.c_layout).

The drive's monitor checks measurements against bounds. A bound that the study leaves out gets a default.

The defaults depend only on the parameters that the controller assumes and on the sensors' data, never on
scenarios: firmware must set them before it knows which motions will be asked for. A load may drive the motor
above its no-load speed (omega_max). A measured step can be too large by one count (angle_step). No working
current loop overshoots by 100 % (current_max). One or two disturbed messages of the sensor take less than
`bridge`, and the current decays in less than `hold`.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any, Literal

from cogless.c_layout import control_layout
from cogless.design.auto import missing
from cogless.design.law_rules import rules_of
from cogless.errors import StudyError
from cogless.run.own_law import known_drive
from cogless.study import AnyStudy, Study, for_scenario
from cogless.study.drive import Drive, StarBelief
from cogless.study.laws.law import Base, LawLoop
from cogless.study.mechanics import Mechanics
from cogless.study.motor import StarMotor
from cogless.study.numerics import no_load_speed
from cogless.study.position_sensor import Counted, Hall, sensor_fields
from cogless.study.reference import Reference
from cogless.study.scenario import TorqueMode
from cogless.units import TURN

SPEED_MARGIN = 1.5  # largest plausible speed / no-load speed
STUCK_ANGLE = 0.5  # rad, stuck_angle with an ideal sensor
STUCK_STEPS = 4.0  # least stuck_angle in sensor steps: a quarter, from which an angle is doubted, is a step
STUCK_TIME = 0.1  # s, least stuck_time
STUCK_TORQUE = 0.1  # share of the largest torque: a load that leaves less counts as blocking the rotor
OBSERVER_PEAK = (
    0.80  # observer's speed after an angle step / (bandwidth times step): the largest (3x - x^2) e^-x
)
BRIDGE_TIME = 5e-3  # s, default of monitor.bridge
FORGET_TIMES = 10.0  # time constants after which an observer has forgotten a jump to a part in a thousand
HOLD_TIME = 10e-3  # s, default of monitor.hold


def sensor_ratio(drive: Drive, mechanics: Mechanics) -> float:
    """Ratio of motor angle to position sensor angle: the gear's ratio with a sensor on the load, else 1."""
    return 1.0 if drive.position_sensor.side == "motor" else mechanics.ratio


def monitor_config(
    drive: Drive, motor: StarMotor, belief: StarBelief, mechanics: Mechanics
) -> dict[str, float]:
    """Members of the C struct cgl_monitor_config.

    Only pole pairs and phases are taken from `motor`; its other parameters are those in `belief`.
    """
    sensor = drive.position_sensor
    period = 1 / drive.rates.current_loop
    step, window, resolution = 0.0, 0.0, 0.0
    if isinstance(sensor, Counted):
        # a jump of the angle shows in the counts of one law period; the next period uses their speed
        step, periods = sensor.step * sensor_ratio(drive, mechanics), sensor.periods(drive.rates.divider)
        samples = 1 if sensor.speed_method == "average" else 2
        window = samples * periods * period
        if sensor.bandwidth:
            window = FORGET_TIMES / sensor.bandwidth
            resolution = OBSERVER_PEAK * sensor.bandwidth * step
        elif not sensor.timed:
            resolution = step / (periods * period)
    elif isinstance(sensor, Hall):
        # an edge may be placed half a sector late, and the angle jumps there
        step, window = 1.5 * sensor.step(motor.pole_pairs), 2 * drive.rates.divider * period
    if drive.speed_filter:
        window += FORGET_TIMES / (TURN * drive.speed_filter)
    derived = {
        "omega_max": 0.0,
        "angle_step": step,
        "speed_window": window,
        "stuck_angle": max(STUCK_ANGLE + 2 * step, STUCK_STEPS * step),
        "stuck_time": max(STUCK_TIME, _step_time(drive, motor, belief, mechanics, step)),
        **drive.plausible_currents(motor.phases),
        "bridge": BRIDGE_TIME,
        "hold": HOLD_TIME,
        "phases": 0 if drive.ideal else motor.phases,
    }
    if drive.inverter is not None and not drive.ideal:
        no_load = no_load_speed(drive.inverter.bus_voltage, motor, belief.psi_f)
        fastest = SPEED_MARGIN * no_load * drive.weakening(belief.psi_f, belief.L_d)
        derived["omega_max"] = max(fastest, no_load + resolution) if math.isfinite(fastest) else 0.0
    own_keys = {key: value for key, value in drive.monitor.model_dump().items() if value is not None}
    return derived | own_keys


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
    span = TURN if quality.span is None else quality.span
    return {**quality.model_dump(), "span": span}


Mode = Literal["run", "learn"]


def engine_config(study: Study, scenario: str, controller: str, mode: Mode = "run") -> dict[str, Any]:
    """The engine's description of one run.

    `mode` "learn" is the commissioning run of an anti-cogging table. It starts at standstill, with the load
    in [mechanics], without the scenario's load and events. Gains and assumed motor parameters, also those of
    the current loop, are computed from the study without overrides: the controller doesn't know what changes
    in a scenario.
    """
    study_here = for_scenario(study, scenario)
    experiment = study_here.scenario[scenario]
    run = mode == "run"
    motor, rows = study_here.motor.star(), study_here.rows_per_period
    load = experiment.load if run and experiment.load is not None else study_here.mechanics.load
    return {
        "motor": motor_config(motor),
        "mechanics": mechanics_config(study_here.mechanics),
        "load": load.model_dump(),
        "events": [event.model_dump() for event in experiment.events] if run else [],
        "faults": [fault.model_dump() for fault in experiment.faults] if run else [],
        "torque_mode": _torque_mode(experiment.torque_mode) if run else None,
        "reference": _reference(experiment.reference if run else Reference.model_validate("0 rpm")),
        "initial_speed": experiment.initial_speed if run else 0.0,
        "initial_angle": experiment.initial_angle if run else 0.0,
        "seed": study_here.seed,
        "energy": study_here.trace.energy,
        **({"rows_per_period": rows} if run and rows > 1 else {}),
        "drive": drive_config(
            study_here.drive,
            study.motor.star(),
            motor,
            study.mechanics,
            study.controller[controller].learns,
        ),
        "controller": _controller(study, study_here, controller, mode),
    }


def motor_config(motor: StarMotor) -> dict[str, Any]:
    numbers = {key: getattr(motor, key) for key in ("pole_pairs", "R_s", "L_d", "L_q", "psi_f")}
    ripple = [{"order": r.order, "share": r.share, "phase": r.phase} for r in motor.torque_ripple]
    return {
        **numbers,
        **({"torque_ripple": ripple} if ripple else {}),
        **({} if motor.saturation is None else {"saturation": motor.saturation.engine_config()}),
        **({} if motor.temperature is None else {"temperature": motor.temperature.engine_config()}),
        "phases": motor.phases,
        "flux_harmonics": [harmonic.model_dump() for harmonic in motor.flux_harmonics],
        "cogging": [harmonic._asdict() for harmonic in motor.cogging],
    }


def mechanics_config(mechanics: Mechanics) -> dict[str, Any]:
    numbers = mechanics.model_dump(exclude={"load", "belt"}) | {"breakaway_friction": mechanics.breakaway}
    if mechanics.load_side is not None:
        numbers["load_side"]["breakaway_friction"] = mechanics.load_side.breakaway
    return numbers


def _reference(reference: Reference) -> dict[str, Any]:
    numbers = reference.model_dump(exclude={"profile", "moves", "file"})
    moves = reference.kind == "moves"
    return {
        "kind": "profile" if reference.kind == "file" else reference.kind,
        **numbers,
        "times": [time for time, _ in (reference.moves if moves else reference.points)],
        "speeds": [speed for _, speed in reference.points],
        "angles": [angle for _, angle in reference.moves],
    }


def _torque_mode(mode: TorqueMode | None) -> dict[str, Any] | None:
    if mode is None:
        return None
    time, value = map(list, zip(*mode.points, strict=True))
    return {"from": mode.time, "until": min(mode.end, 1e300), "current": {"time": time, "value": value}}


def drive_config(
    drive: Drive, motor: StarMotor, driven: StarMotor, mechanics: Mechanics, learns: bool
) -> dict[str, Any]:
    """The engine's description of a drive.

    `motor`: the study's motor, whose parameters replace those that the belief leaves out. `driven`: the motor
    in this run, with overrides. `mechanics`: as the controller assumes them. `learns`: whether the law learns
    while it runs and so needs a guard.
    """
    values = control_config(drive, motor, driven, mechanics, learns)
    config = {
        "current_rate": round(drive.rates.current_loop),
        "integration_steps": drive.rates.integration_steps,
        "control": control_layout(drive.precision).pack("cgl_drive_config", values),
        "position_sensor": sensor_fields(drive.position_sensor, driven.pole_pairs),
        "current_sensors": drive.current_sensors.model_dump(),
    }
    table = encoder_table_config(drive, motor, mechanics)
    if table is not None:
        config["encoder_table"] = control_layout(drive.precision).pack("cgl_encoder_table_config", table)
    if drive.speed_filter is not None:
        config["speed_filter"] = math.tau * drive.speed_filter
    if drive.bus is not None:
        config["bus"] = drive.bus.model_dump()
    if drive.inverter is None:
        return config
    reference = current_reference_config(drive, motor)
    if reference is not None:
        config["current_reference"] = control_layout(drive.precision).pack(
            "cgl_current_reference_config", reference
        )
    compensation = dead_time_config(drive, motor, driven)
    if compensation is not None:
        config["dead_time"] = control_layout(drive.precision).pack("cgl_dead_time_config", compensation)
    return config | {"inverter": drive.inverter.model_dump()}


def encoder_table_config(drive: Drive, motor: StarMotor, mechanics: Mechanics) -> dict[str, Any] | None:
    """Members of the C struct cgl_encoder_table_config, for angles and speeds of the sensor's own shaft.

    None: the study corrects no error of the sensor.
    """
    table = drive.encoder_table
    if table is None:
        return None
    K_t = motor.power_factor * motor.pole_pairs * drive.belief.resolved(motor).psi_f
    ratio = sensor_ratio(drive, mechanics)
    return {
        "orders": len(table.orders),
        "order": list(table.orders),
        "gain": 1 / table.time_constant,
        "omega_min": table.omega_min / ratio,
        "bandwidth": table.bandwidth / ratio,
        "b": K_t / mechanics.stiff.inertia / ratio,
        "limit": table.limit,
    }


def current_reference_config(drive: Drive, motor: StarMotor) -> dict[str, Any] | None:
    """Members of the C struct cgl_current_reference_config; None: the law's output is i_q."""
    reference, belief = drive.current_reference, drive.belief.resolved(motor)
    if reference is None:
        return None
    return {
        "mtpa": reference.rule == "mtpa",
        "field_weakening": reference.field_weakening,
        "L_d": belief.L_d,
        "L_q": belief.L_q,
        "psi_f": belief.psi_f,
        "R_s": belief.R_s,
        "voltage_share": reference.voltage_share,
    }


def dead_time_config(drive: Drive, motor: StarMotor, driven: StarMotor) -> dict[str, Any] | None:
    """Members of the C struct cgl_dead_time_config; None: not compensated."""
    compensation, inverter = drive.dead_time_compensation, drive.inverter
    if compensation is None or inverter is None:
        return None
    belief = drive.belief.resolved(motor)
    kp_q = drive.current_loop.gains(belief)["kp_q"]
    dead_time = inverter.dead_time if compensation.time is None else compensation.time
    return {
        "time": inverter.edge_share * dead_time,
        "drop": inverter.device_drop if compensation.drop is None else compensation.drop,
        "band": compensation.band,
        "lag": belief.L_q / kp_q if kp_q > 0 else 0.0,
        "advance": drive.advance,
        "phases": driven.phases,
    }


def control_config(
    drive: Drive, motor: StarMotor, driven: StarMotor, mechanics: Mechanics, learns: bool
) -> dict[str, Any]:
    """Members of the C struct cgl_drive_config. With an ideal current loop, only the limit in `foc` is
    used."""
    loop, belief = drive.current_loop, drive.belief.resolved(motor)
    return {
        "pole_pairs": driven.pole_pairs,
        "divider": drive.rates.divider,
        "foreign": drive.ideal,
        "feed_forward": False,
        "learn_saturated": drive.rates.position_loop is not None,
        "unguarded": not (drive.guard and learns) or drive.rates.position_loop is not None,
        "foc": {
            **loop.gains(belief),
            "current_limit": loop.current_limit,
            "advance": drive.advance,
            "decoupling": loop.decoupling,
            "L_d": belief.L_d,
            "L_q": belief.L_q,
            "psi_f": belief.psi_f,
            "phases": driven.phases,
        },
        "monitor": monitor_config(drive, motor, belief, mechanics),
        "quality": quality_config(drive),
    }


def _controller(study: Study, study_here: Study, name: str, mode: Mode) -> dict[str, Any]:
    law = _filled(study, study_here, name)
    if law.code is not None:
        return own_law_config(study, name)
    drive = study_here.drive
    loop = LawLoop(
        current_rate=round(drive.rates.current_loop),
        divider=drive.rates.divider,
        current_limit=drive.largest_torque_current(study_here.motor.star()),
        pole_pairs=study_here.motor.pole_pairs,
    )
    values = rules_of(study, name).c_config(law, loop)
    config = control_layout(study.drive.precision).pack(law.c_struct, values)
    return {"config": config, "calibrate": mode == "learn", **_any_law(law)}


def own_law_config(study: AnyStudy, name: str) -> dict[str, Any]:
    """The engine's description of a user's law. The engine gets a Python object separately."""
    law = study.controller[name]
    return {**law.own_code(study.source.folder, asdict(known_drive(study))), **_any_law(law)}


def _any_law(law: Base) -> dict[str, Any]:
    return {"law": law.law, "learning_start": law.learns_from, "holds_position": law.holds_position}


def _filled(study: Study, study_here: Study, name: str) -> Base:
    """A copy of a controller with the gains of its tuning rule, and with default limits from the drive."""
    if name in missing(study):
        where = f"{study.source.path}: controller.{name}.tuning"
        raise StudyError(f"{where}: expected a study from cogless.load, which applies the rule auto")
    return study.controller[name].model_copy(update=rules_of(study, name).fill(study_here))
