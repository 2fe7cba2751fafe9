"""The dump of a moteus's configuration, and the motor and drive that it describes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cogless.drives.adapter import text_of
from cogless.drives.firmware_laws import MOTEUS_ENTRIES
from cogless.errors import StudyError
from cogless.identify.log_files import printable
from cogless.results.trace import Array

DUMP_HINT = "the dump of moteus_tool -t 1 --dump-config"


@dataclass(frozen=True)
class Dump:
    """The lines `name value` of a configuration dump."""

    path: Path
    values: Mapping[str, str]

    def number(self, key: str, expected: str, default: float | None = None) -> float:
        """The value of a key. StudyError: it is missing, without a default, or no number."""
        text = self.values.get(key)
        if text is None:
            if default is not None:
                return default
            raise StudyError(f"{self.path}: {key}: missing: expected {expected}")
        try:
            number = float(text)
        except ValueError:
            raise StudyError(f'{self.path}: {key}: "{printable(text)}": expected {expected}') from None
        if not math.isfinite(number):
            raise StudyError(f"{self.path}: {key}: {number}: expected {expected}")
        return number

    def above_zero(self, key: str, expected: str) -> float:
        number = self.number(key, expected)
        if number <= 0:
            raise StudyError(f"{self.path}: {key}: {number:g}: expected {expected}")
        return number

    @property
    def source(self) -> int:
        """Number of the encoder that commutation and the cogging table use."""
        return int(self.number("motor_position.commutation_source", "0, 1 or 2", 0.0))

    @property
    def encoder_table_on(self) -> bool:
        """Whether the angles of that encoder are corrected by a table."""
        return self.number(f"motor_position.sources.{self.source}.compensation_scale", "a number", 0.0) != 0

    @property
    def ratio(self) -> float:
        """Turns of the output for one of the rotor."""
        return self.number("motor_position.rotor_to_output_ratio", "a number above zero", 1.0)

    @property
    def takes_table(self) -> bool:
        return "motor.cogging_dq_scale" in self.values

    @property
    def table(self) -> Array:
        """The stored cogging table, A; zeros if there is none."""
        scale = self.number("motor.cogging_dq_scale", "a number", 0.0)
        keys = (f"motor.cogging_dq_comp.{n}" for n in range(MOTEUS_ENTRIES))
        return np.array([scale * self.number(key, "-128 to 127", 0.0) for key in keys])


def read_dump(path: Path) -> Dump:
    """Read a dump. StudyError: it is no such file, or the commutation source is behind a gear."""
    values = {}
    for line in text_of(path, DUMP_HINT).splitlines():
        name, _, value = line.partition("#")[0].strip().partition(" ")
        if value and "." in name:
            values[name] = value.strip()
    dump = Dump(path, values)
    if "motor.poles" not in values:
        raise StudyError(f"{path}: motor.poles: missing: expected {DUMP_HINT}")
    prefix = f"motor_position.sources.{dump.source}"
    if dump.ratio <= 0:
        key = "motor_position.rotor_to_output_ratio"
        raise StudyError(f"{path}: {key}: {dump.ratio:g}: expected a number above zero")
    if dump.number(f"{prefix}.reference", "0 or 1", 0.0) == 1 and dump.ratio != 1:
        raise StudyError(
            f"{path}: {prefix}.reference: 1: expected 0, a commutation source on the rotor: an encoder "
            "behind the gear gives one rotor angle several places in the cogging table"
        )
    return dump


def gains(dump: Dump) -> dict[str, float]:
    """The gains of position mode, as `firmware_laws.Moteus` takes them; empty: the dump lacks them."""
    names = {"kp": "kp", "kd": "kd", "ki": "ki", "ilimit": "ilimit"}
    keys = {name: f"servo.pid_position.{key}" for name, key in names.items()}
    keys["filter_hz"] = f"motor_position.sources.{dump.source}.pll_filter_hz"
    if keys["kp"] not in dump.values or keys["kd"] not in dump.values:
        return {}
    numbers = {name: dump.number(key, "a number") for name, key in keys.items() if key in dump.values}
    return {**numbers, "ratio": dump.ratio}


def tables(dump: Dump, bus_voltage: float | None) -> dict[str, dict[str, Any]]:
    """[motor] and [drive] as the dump gives them."""
    poles = dump.above_zero("motor.poles", "poles of a calibrated motor, such as 14")
    if poles % 2:
        raise StudyError(f"{dump.path}: motor.poles: {poles:g}: expected an even number")
    resistance = dump.above_zero("motor.resistance_ohm", "the resistance of a calibrated motor")
    magnet = {}
    if "motor.Kv" in dump.values or "motor.v_per_hz" not in dump.values:
        kv = dump.above_zero("motor.Kv", "the Kv of a calibrated motor, r/min per volt")
        magnet["kv"] = f"{kv:.9g} rpm/V"
    kp = dump.above_zero("servo.pid_dq.kp", "a gain above zero")
    ki = dump.above_zero("servo.pid_dq.ki", "a gain above zero")
    # Older firmware stores no inductance. Calibration sets kp = w L and ki = w R, so L = R kp / ki.
    inductance = dump.number("motor.inductance_d_H", "an inductance", 0.0) or resistance * kp / ki
    inductance_q = dump.number("motor.inductance_q_H", "an inductance", 0.0) or inductance
    limit = dump.above_zero("servo.max_current_A", "a current above zero")
    rate = f"{dump.number('servo.pwm_rate_hz', 'a rate', 30_000.0):.0f} Hz"
    loop: dict[str, Any] = {"current_limit": f"{limit:.9g} A"}
    drive: dict[str, Any] = {"rates": {"current_loop": rate, "speed_loop": rate}, "current_loop": loop}
    counts = round(dump.above_zero(f"motor_position.sources.{dump.source}.cpr", "counts of a turn"))
    if counts.bit_count() == 1 and counts > 1:
        drive["position_sensor"] = {"kind": "absolute", "bits": counts.bit_length() - 1}
    if bus_voltage is None:
        loop["kind"] = "ideal"
    else:
        loop |= {"kp": f"{kp:.9g} V/A", "ki": f"{ki:.9g} V/A/s"}
        drive["inverter"] = {"bus_voltage": f"{bus_voltage:.4g} V"}
    return {
        "motor": {
            "pole_pairs": round(poles) // 2,
            "R_s": f"{resistance:.9g} ohm",
            "L_d": f"{inductance:.9g} H",
            "L_q": f"{inductance_q:.9g} H",
            **magnet,  # Older firmware has v_per_hz in place of Kv; then --config gives kv or K_t.
        },
        "drive": drive,
    }
