"""Files of an estimate: the motor, a study ready to run, an anti-cogging table, a stored map, all values."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cogless.identify import described, plan
from cogless.identify.result import Estimate, Value, Wave
from cogless.identify.sessions import sessions
from cogless.maps import stored_map
from cogless.maps.learned_map import motor_identity
from cogless.maps.stored_map import StoredMap, to_csv
from cogless.study.messages import toml
from cogless.study.motor import Motor
from cogless.units import DEGREE, TURN

TABLE_CELLS_LEAST, CELLS_A_WAVE = 1024, 8  # least cells of a turn, and of a wave of the highest order
VALUE_NAMES = {
    "j": ("inertia over K_t", "A*s^2/rad", "inertia", "kg*m^2"),
    "c": ("Coulomb friction over K_t", "A", "coulomb_friction", "N*m"),
    "c_hold": ("friction at rest over K_t", "A", "", "N*m"),
    "b": ("viscous friction over K_t", "A*s/rad", "viscous_friction", "N*m*s/rad"),
    "delay": ("delay of i_q after the angle", "s", "", ""),
    "stribeck": ("additional friction at rest, over K_t", "A", "", "N*m"),
    "stribeck_speed": ("speed over which this friction falls", "rad/s", "", ""),
    "offset": ("offset of i_q, or a load", "A", "", ""),
}


def write_all(estimate: Estimate, folder: Path) -> None:
    """Write motor.toml and identified.json; with inertia study.toml; with cogging cogging.csv and .bin."""
    (folder / "identified.json").write_text(
        json.dumps(to_dict(estimate), indent=2, ensure_ascii=False) + "\n", "utf-8"
    )
    (folder / "motor.toml").write_text(_motor(estimate), "utf-8")
    if "j" in estimate.values:
        (folder / "study.toml").write_text(_study(estimate), "utf-8")
    if estimate.cogging:
        table = compensation(estimate)
        (folder / "cogging.csv").write_text(to_csv(table), "utf-8")
        stored_map.write(folder / "cogging.bin", bytes(table))


def to_dict(estimate: Estimate) -> dict[str, Any]:
    """All values with their errors at 95 %, SI, and every sentence."""

    def listed(identified: Sequence[Wave], factor: float, unit: str) -> list[dict[str, Any]]:
        return [
            {
                "order": wave.order,
                f"amplitude{unit}": wave.size.value * factor,
                "amplitude_error": wave.size.error * factor,
                "phase_rad": wave.phase.value,
                "phase_error": wave.phase.error,
            }
            for wave in identified
        ]

    return {
        "K_t_N_m_per_A": estimate.K_t,
        "values": {
            key: {
                "about": VALUE_NAMES[key][0],
                "unit": VALUE_NAMES[key][1],
                "value": value.value,
                "error": value.error,
            }
            for key, value in estimate.values.items()
        },
        "cogging": listed(estimate.cogging, estimate.K_t, "_N_m"),
        "cogging_or_current_offset": listed(estimate.of_unknown_cause, estimate.K_t, "_N_m"),
        "torque_constant_ripple": listed(estimate.ripple, 1.0, ""),
        "friction_over_angle": listed(estimate.friction, estimate.K_t, "_N_m"),
        "encoder": listed(estimate.encoder, 1.0, "_rad"),
        "loads_N_m": {
            name: {"value": value.value * estimate.K_t, "error": value.error * estimate.K_t}
            for name, value in estimate.loads.items()
        },
        "logs": [log.name for log in estimate.logs],
        "sessions": {
            session.name: {
                "logs": list(session.logs),
                **{
                    f"{key}_A": {"value": value.value, "error": value.error}
                    for key, value in session.values.items()
                },
            }
            for session in sessions(estimate)
        },
        "remarks": list(estimate.remarks),
        "left_out": list(estimate.left_out),
    }


def compensation(estimate: Estimate) -> StoredMap:
    """The map of the current that cancels the cogging, over the mechanical angle."""
    cells = max(TABLE_CELLS_LEAST, CELLS_A_WAVE * max(wave.order for wave in estimate.cogging))
    angle = TURN / cells * np.arange(cells)
    current = -sum(
        wave.size.value * np.sin(wave.order * angle + wave.phase.value) for wave in estimate.cogging
    )
    limit = float(np.max(np.abs(current)))
    motor = Motor.model_validate(described.motor(estimate))
    return StoredMap(
        values=np.asarray(current, dtype=np.float32),
        units=(stored_map.CURRENT_CODE,),
        limits=(float(np.nextafter(np.float32(limit), np.float32(np.inf))),),
        law=stored_map.LAWS.index("anti-cogging"),
        motor=motor_identity(motor.star()),
    )


def value_text(value: Value, unit: str = "") -> str:
    """A value with its error at 95 %, as text. It ends at the digit at which the error has two digits."""
    if value.error <= 0 or not np.isfinite(value.error):
        return f"{value.value:.4g} {unit}".rstrip()
    digits = max(1, int(np.floor(np.log10(max(abs(value.value), value.error) / value.error))) + 2)
    return f"{value.value:.{digits}g} +- {value.error:.2g} {unit}".rstrip()


def _sentence_lines(estimate: Estimate) -> list[str]:
    return [f"# {line}" for line in (*estimate.left_out, *estimate.remarks)]


def _head(estimate: Estimate) -> list[str]:
    return [
        f"# By cogless identify, from {', '.join(log.name for log in estimate.logs)}.",
        "# +-: error at 95 %. Torques follow from currents by the K_t below, which is taken as exact.",
        *_sentence_lines(estimate),
    ]


def _wave_lines(estimate: Estimate) -> list[str]:
    """A comment for each wave of the motor."""
    torque = (1e3 * estimate.K_t, "mN*m")
    waves = (
        *(("cogging", wave, *torque) for wave in estimate.cogging),
        *(("cogging or an offset of the current", wave, *torque) for wave in estimate.of_unknown_cause),
        *(("K_t ripple", wave, 100.0, "%") for wave in estimate.ripple),
    )
    return [
        f"# {kind}, order {wave.order}: {value_text(wave.size.times(factor), unit)}, "
        f"phase {value_text(wave.phase.times(1 / DEGREE), 'deg')}"
        for kind, wave, factor, unit in waves
    ]


def _motor(estimate: Estimate) -> str:
    table = described.motor(estimate)
    lines = [*_head(estimate), *_wave_lines(estimate)]
    for key, value in table.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            lines += [f"{key} = [", *(f"  {toml(item)}," for item in value), "]"]
        else:
            lines.append(f"{key} = {toml(value)}")
    return "\n".join(lines) + "\n"


def _study(estimate: Estimate) -> str:
    tables = described.study(estimate)
    tables["motor"] = {"datasheet": "motor.toml"}
    notes = [
        f"# {description}: {value_text(estimate.values[key], unit)}"
        + (f"; {name} {value_text(estimate.values[key].times(estimate.K_t), torque)}" if name else "")
        for key, (description, unit, name, torque) in VALUE_NAMES.items()
        if key in estimate.values
    ]
    notes += [
        f"# load of {name}: {value_text(v.times(estimate.K_t), 'N*m')}" for name, v in estimate.loads.items()
    ]
    notes += [
        f"# {title}, order {wave.order}: {value_text(wave.size.times(factor), unit)}"
        for title, name, factor, unit in estimate.kinds
        for wave in estimate.waves(name)
        if name in ("friction", "encoder")
    ]
    return "\n".join([*_head(estimate), *notes, "", plan.to_toml(tables)])
