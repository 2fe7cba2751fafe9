"""A study in the engine's words: one plain nested dict of SI numbers, for one controller in one scenario."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

from cogless.design.pi import gains
from cogless.design.position import frame_ratio, position_gains
from cogless.design.space_bounds import learned_limits
from cogless.run.monitor_defaults import monitor_config, quality_config
from cogless.study import AnyStudy, Study, for_scenario
from cogless.study.controller import AntiCogging, Feedback, Learning, LibraryLaw, OwnLaw
from cogless.study.drive import Drive, IdealCurrentLoop, sensor_fields
from cogless.study.mechanics import Load, Mechanics
from cogless.study.motor import StarMotor
from cogless.study.reference import Reference
from cogless.study.space_controller import SpaceLearning, SpacePosition

NEVER = 1e18  # s
Mode = Literal["run", "learn"]


def engine_config(study: Study, scenario: str, controller: str, mode: Mode = "run") -> dict[str, Any]:
    """The engine's description of one run.

    `mode` "learn": the commissioning run of an anti-cogging table, from standstill, with the load that
    belongs to the mechanics and without the scenario's load and events. Gains and beliefs, the current loop's
    too, are those of the study without overrides: what changes in a scenario, the controller isn't told.
    """
    study_here = for_scenario(study, scenario)
    experiment = study_here.scenario[scenario]
    run = mode == "run"
    motor = study_here.motor.star()
    load = experiment.load if run and experiment.load is not None else study_here.mechanics.load
    return {
        "motor": motor_config(motor),
        "mechanics": mechanics_config(study_here.mechanics),
        "load": load_config(load),
        "events": [event.model_dump() for event in experiment.events] if run else [],
        "faults": [fault.model_dump() for fault in experiment.faults] if run else [],
        "reference": _reference(experiment.reference if run else Reference.model_validate("0 rpm")),
        "initial_speed": experiment.initial_speed if run else 0.0,
        "initial_angle": experiment.initial_angle if run else 0.0,
        "seed": study_here.seed,
        "energy": study_here.trace.energy,
        "drive": drive_config(study_here.drive, study.motor.star()),
        "controller": _controller(study, study_here, controller, mode),
    }


def motor_config(motor: StarMotor) -> dict[str, Any]:
    numbers = {key: getattr(motor, key) for key in ("pole_pairs", "R_s", "L_d", "L_q", "psi_f")}
    return {
        **numbers,
        "phases": motor.phases,
        "flux_harmonics": [harmonic.model_dump() for harmonic in motor.flux_harmonics],
        "cogging": [harmonic.model_dump(include={"order", "torque", "phase"}) for harmonic in motor.cogging],
    }


def mechanics_config(mechanics: Mechanics) -> dict[str, Any]:
    numbers = mechanics.model_dump(exclude={"load"})
    if mechanics.breakaway_friction is None:
        numbers["breakaway_friction"] = mechanics.coulomb_friction
    return numbers


def load_config(load: Load) -> dict[str, Any]:
    return lists(load.model_dump())


def _reference(reference: Reference) -> dict[str, Any]:
    numbers = reference.model_dump(exclude={"profile", "moves", "file"})
    moves = reference.kind == "moves"
    return {
        "kind": "profile" if reference.kind == "file" else reference.kind,
        **lists(numbers),
        "times": [time for time, _ in (reference.moves if moves else reference.points)],
        "speeds": [speed for _, speed in reference.points],
        "angles": [angle for _, angle in reference.moves],
    }


def drive_config(drive: Drive, motor: StarMotor) -> dict[str, Any]:
    """A drive. `motor`: the study's, which a belief falls back on."""
    loop, inverter = drive.current_loop, drive.inverter
    belief = drive.belief.resolved(motor)
    config = {
        "current_rate": round(drive.rates.current_loop),
        "speed_divider": drive.rates.divider,
        "integration_steps": drive.rates.integration_steps,
        "current_limit": loop.current_limit,
        "ideal_current": drive.ideal,
        "belief": dataclasses.asdict(belief),
        "position_sensor": sensor_fields(drive.position_sensor),
        "current_sensors": lists(drive.current_sensors.model_dump()),
        "monitor": monitor_config(drive, motor, belief),
        "quality": quality_config(drive),
    }
    if isinstance(loop, IdealCurrentLoop) or inverter is None:
        return config
    return config | {**loop.gains(belief), "decoupling": loop.decoupling, "inverter": inverter.model_dump()}


def _controller(study: Study, study_here: Study, name: str, mode: Mode) -> dict[str, Any]:
    controller = study.controller[name]
    if isinstance(controller, OwnLaw):
        return own_law_config(study, name)
    fields = lists(controller.model_dump(exclude={"label", "baseline", "tuning"}))
    if isinstance(controller, Feedback):
        fields["kp"], fields["ki"] = gains(study, name)
    if isinstance(controller, Learning):
        fields["lead"] = round(controller.lead * study_here.drive.rates.outer_loop)
        if controller.limit is None:
            fields["limit"] = study.drive.current_loop.current_limit
    if isinstance(controller, AntiCogging):
        fields["mode"] = mode
    if isinstance(controller, SpaceLearning):
        fields |= _space(study, study_here, controller)
        if not controller.learning:
            fields["learning_start"] = NEVER
    if isinstance(controller, SpacePosition):
        fields["k_theta"], fields["k_omega"], fields["k_i"] = position_gains(study, name)
    return fields


def own_law_config(study: AnyStudy, name: str) -> dict[str, Any]:
    """A user's law: a Python object comes to the engine by itself."""
    controller = study.controller[name]
    if not isinstance(controller, LibraryLaw):
        return {"law": "python"}
    library = str((study.source.path.parent / controller.library).resolve())
    return {"law": controller.law, "library": library, "params": list(controller.params)}


def _space(study: Study, study_here: Study, controller: SpaceLearning) -> dict[str, Any]:
    """The memory of a law that learns in angle: its period, and limits where the study gives none."""
    ratio = frame_ratio(study, controller)
    revolutions = ratio * controller.period.revolutions(study.motor.pole_pairs)
    limits = learned_limits(study, controller, study_here.scenario.values())
    return {
        "ratio": ratio,
        "turns": revolutions.numerator,
        "parts": revolutions.denominator,
        "method": controller.delay_method,
        "limits": list(limits[: controller.channels]),
        "limit": study.drive.current_loop.current_limit,
    }


def lists(table: dict[str, Any]) -> dict[str, Any]:
    """The table with lists for tuples, all the way down."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return lists(value)
        return [plain(item) for item in value] if isinstance(value, tuple | list) else value

    return {key: plain(value) for key, value in table.items()}
