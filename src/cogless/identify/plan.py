"""Plan the commissioning of a motor: a study that simulates the sequence, and the file of columns."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from scipy.optimize import brentq

from cogless import units
from cogless.design.detent import overrun
from cogless.errors import StudyError
from cogless.identify.balance import KERNEL_WIDTH, WAVE_RATE_SHARE
from cogless.identify.described import metrics, with_steps
from cogless.study import AnyStudy, Study
from cogless.study.messages import toml
from cogless.study.numerics import voltage_reach
from cogless.study.position_sensor import Hall
from cogless.study.reading import speed_study
from cogless.units import RPM, TURN

LOG_RATE = 1000.0  # rows of a log a second; fewer for a rotor that sticks
REVERSAL_TIME = 0.8  # s, from one speed to its opposite; longer for a rotor that sticks
AT_LIMIT = 0.999  # share of the speed that the voltage allows; a higher top speed was lowered to the limit
SCENARIO_KINDS = {
    "slow": "slow-sweep",
    "one-speed": "constant-speed",
    "fast": "constant-speed",
    "acceleration": "acceleration",
    "load-forwards": "load",
    "load-backwards": "load",
}


def reach(study: Study, torque: Callable[[float], float]) -> float:
    """Highest speed, rad/s, at which the bus voltage drives the current of a torque.

    `torque`: torque at a speed, N m, on top of friction and cogging. u = R i + p omega (psi_f + j L_q i).
    StudyError: the voltage is too low even at rest.
    """
    star, mechanics, most = study.motor.star(), study.mechanics, voltage_reach(study)
    if not math.isfinite(most):
        return math.inf
    cogging = sum(abs(one.torque or 0.0) for one in star.cogging)
    available = star.pole_pairs * most * star.psi_f

    def missing(speed: float) -> float:
        rubbing = mechanics.breakaway + mechanics.viscous_friction * speed
        i = min((rubbing + cogging + torque(speed)) / star.K_t, study.drive.current_loop.current_limit)
        omega_e = star.pole_pairs * speed
        return math.hypot(star.R_s * i + omega_e * star.psi_f, omega_e * star.L_q * i) - available

    if missing(0.0) >= 0:
        raise StudyError(
            f"{_voltage(study)}: expected more: the plan's currents take "
            f"{(missing(0.0) + available) / available:.3g} times this voltage at standstill"
        )
    return float(brentq(missing, 0.0, most))


def _voltage(study: Study) -> str:
    """The key of the bus voltage, and its value."""
    assert study.drive.inverter is not None
    return f"{study.source.path}: drive.inverter.bus_voltage: {study.drive.inverter.bus_voltage:.4g} V"


def highest(study: Study, law: str) -> float:
    """Highest speed of a plan, rad/s, at which the voltage can drive the current that reverses the rotor."""
    hills = sum(size for _, size in overrun(study, law))
    return reach(study, lambda speed: max(hills, 2 * study.mechanics.inertia * speed / REVERSAL_TIME))


def scenarios(study: Study, law: str) -> tuple[dict[str, Any], float]:
    """Scenarios of the sequence, and the rate of the logs' rows, Hz.

    Speeds follow from the speed of the study's first scenario. K_t ripple has order 6 p. The slow and the
    loaded runs are so slow that the regression's kernel passes this order. The fast run is, where possible,
    so slow that the rows show this order: currents of order 6 p brake as viscous friction does, by an amount
    that depends on an unknown dead time.

    If cogging would stop the rotor, all speeds are higher: the rotor then has at least twice the energy of
    the cogging's hills, 2 T / n each. The rotor reverses as fast as the cogging's torque could reverse it,
    and the log has more rows to show the orders.

    No speed is above what the bus voltage allows. StudyError: this limit is too low for the plan.
    """
    first = next(iter(study.scenario.values()))
    sixth = 6 * study.motor.pole_pairs
    inertia, hills = study.mechanics.inertia, overrun(study, law)
    load = 0.2 * study.drive.current_loop.current_limit * study.motor.star().K_t
    with_load = reach(study, lambda speed: load)
    most = highest(study, law)
    v = min(first.top_reference or TURN, most / 3)
    passed = 1 / (sixth * KERNEL_WIDTH) / v
    slow, loaded = min(0.25, 0.5 * passed), min(1.0, passed, with_load / v)
    visible = 0.9 * WAVE_RATE_SHARE * LOG_RATE * TURN / sixth / v
    fast, rate = min(6.0, max(3.0, visible), most / v), LOG_RATE
    least = math.sqrt(2 * 2 * sum(2 * size / n for n, size in hills) / inertia)
    sweeps = [(0.5 + REVERSAL_TIME * n, 5 / 6 * fast * (-1) ** n) for n in range(9)]
    if least > slow * v:
        turning = sum(size for _, size in hills)
        if least > min(most / 3, with_load):
            raise StudyError(
                f"{_voltage(study)}: expected more: cogging stops this rotor below {least / RPM:.3g} rpm, so "
                f"the plan needs {3 * least / RPM:.3g} rpm, but the voltage reaches only {most / RPM:.3g} rpm"
            )
        v = max(v, 1.5 * least)  # at most half of what the voltage reaches
        slow = loaded = least / v
        fast, rate = 2.0, _rate(study.drive.rates.current_loop, sixth * 2.0 * v)
        sweeps = [
            (0.4 * n + late, fast * (-1) ** n)
            for n in range(16)
            for late in (2 * fast * v * inertia / turning, 0.4)
        ]

    def profile(*points: tuple[float, float]) -> dict[str, Any]:
        return {
            "duration": f"{points[-1][0]:.6g} s",
            "reference": {"profile": [[f"{t:.6g} s", f"{v * x:.6g} rad/s"] for t, x in points]},
        }

    def both_ways(speed: float, turns: float) -> dict[str, Any]:
        time = max(2.0, turns * TURN / (v * speed))
        course = profile((0, speed), (time, speed), (time + 0.4, -speed), (2 * time + 0.4, -speed))
        return {**course, "initial_speed": f"{v * speed:.6g} rad/s"}

    played = {
        "slow": both_ways(slow, 2),
        "one-speed": both_ways(1.0, 4),
        "fast": both_ways(fast, 12),
        "acceleration": profile((0, 0), *sweeps),
        "load-forwards": {**both_ways(loaded, 3), "load": f"{load:.4g} N*m"},
        "load-backwards": {**both_ways(loaded, 3), "load": f"{-load:.4g} N*m"},
    }
    return played, rate


def _rate(loop: float, wave: float) -> float:
    """The lowest rate of rows, Hz, that divides the current loop's rate and shows a wave of `wave`, rad/s.

    If no lower rate shows the wave, the rate is the loop's.
    """
    needed = wave / (TURN * 0.9 * WAVE_RATE_SHARE)
    return loop / max(
        (n for n in range(1, round(loop / LOG_RATE) + 1) if not loop % n and loop / n > needed), default=1
    )


def tables(study: AnyStudy) -> tuple[dict[str, Any], dict[str, Any]]:
    """The tables of the study that simulates the sequence, and of the file of columns for its logs."""
    refusal = f"{study.source.path}: expected a study of speed with a synchronous motor"
    study = speed_study(study, refusal)
    if study.motor.kind != "pmsm":
        raise StudyError(refusal)
    if isinstance(study.drive.position_sensor, Hall):
        raise StudyError(
            f"{study.source.path}: drive.position_sensor: Hall sensors show six angles of an electrical "
            "revolution, too few for cogging and friction: expected an encoder while the logs are recorded"
        )
    feedback = _feedback(study)
    source = study.source.tables
    played, rate = scenarios(study, feedback)
    top = _top(played)
    motor = {key: value for key, value in source["motor"].items() if key != "datasheet"}
    motor_without_waves = {
        key: value for key, value in motor.items() if key not in ("cogging", "flux_harmonics")
    }
    controller = {feedback: source["controller"][feedback]}
    play = {
        "title": f"Commissioning: {study.title}",
        "motor": motor,
        "mechanics": source["mechanics"],
        "drive": with_steps(source["drive"], study.drive, study.motor.star(), study.mechanics, top),
        "trace": {"rate": f"{rate:.9g} Hz"},
        "scenario": played,
        "controller": controller,
        "metric": metrics(played),
    }
    logs = [
        {"file": name, "kind": SCENARIO_KINDS[name], "controller": feedback, "reference": keys["reference"]}
        for name, keys in play["scenario"].items()
    ]
    identify = {
        "title": study.title,
        "columns": {
            "t": "time",
            "theta": "theta_measured",
            "omega": "omega_measured",
            "i_q": "i_q",
            "i_q_ref": "i_q_ref",
            **({} if study.drive.ideal else {"i_d": "i_d", "u_q": "u_q"}),  # An ideal loop lacks these.
        },
        "motor": motor_without_waves,
        "drive": source["drive"],
        "controller": controller,
        "log": logs,
    }
    return play, identify


def _feedback(study: Study) -> str:
    """The first controller without learning. StudyError: there is none."""
    for name, law in study.controller.items():
        if law.has_pi and not law.learned:
            return name
    raise StudyError(f'{study.source.path}: controller: expected one without learning, such as law = "pi"')


def lowered(study: AnyStudy) -> str:
    """A sentence on the bus voltage if it limits the speeds of the plan, else ""."""
    study = speed_study(study)
    law = _feedback(study)
    most, (played, _) = highest(study, law), scenarios(study, law)
    if study.drive.inverter is None or _top(played) < AT_LIMIT * most:
        return ""
    return (
        f"The plan's speeds end at {most / RPM:.4g} rpm: above this speed a bus voltage of "
        f"{study.drive.inverter.bus_voltage:.4g} V is too low for the current that friction, cogging and "
        "reversals need."
    )


def write(study: AnyStudy, folder: Path) -> None:
    """Write study.toml and id.toml to a folder."""
    play, identify = tables(study)
    for name, table in (("study", play), ("id", identify)):
        (folder / f"{name}.toml").write_text(to_toml(table), encoding="utf-8")


def _top(played: dict[str, Any]) -> float:
    """The highest speed of these scenarios, rad/s."""
    speeds = (speed for keys in played.values() for _, speed in keys["reference"]["profile"])
    return max(abs(units.parse(speed, units.ANGULAR_SPEED)) for speed in speeds)


def to_toml(tables: dict[str, Any]) -> str:
    """Tables as TOML, a line for each key of the first two levels."""
    lines: list[str] = []
    for key, value in tables.items():
        if not isinstance(value, dict) and not _are_tables(value):
            lines.append(f"{key} = {toml(value)}")
    for key, value in tables.items():
        if isinstance(value, dict):
            if all(isinstance(item, dict) for item in value.values()) and key in ("scenario", "controller"):
                for name, item in value.items():
                    lines += ["", f"[{key}.{name}]", *(f"{k} = {toml(v)}" for k, v in item.items())]
            else:
                lines += ["", f"[{key}]", *(f"{k} = {toml(v)}" for k, v in value.items())]
        elif _are_tables(value):
            for item in value:
                lines += ["", f"[[{key}]]", *(f"{k} = {toml(v)}" for k, v in item.items())]
    return "\n".join(lines) + "\n"


def _are_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)
