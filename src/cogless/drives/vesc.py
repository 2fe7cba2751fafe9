"""VESC: the log of real-time data that VESC Tool writes, and the motor configuration as XML.

Read in its source (vedderb/vesc_tool 426a4f8, vedderb/bldc b9d287b). A row has mean currents since the
row before, but angle and speed of its own moment. So each mean is placed in the middle between two rows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from cogless.drives.adapter import (
    Adapter,
    Certainty,
    DriveLogs,
    Feature,
    Recording,
    TableFrame,
    read_columns,
    text_of,
)
from cogless.drives.encoder_table import write_vesc
from cogless.drives.fault_rows import faults, numbers
from cogless.errors import StudyError
from cogless.identify.log_files import printable
from cogless.results.trace import Array

XML_HINT = "the motor configuration that VESC Tool saves as XML"
DAY_MILLISECONDS = 86_400_000.0
TIME_HEADING, SPEED_HEADING, ENCODER_HEADING = "ms_today", "erpm", "encoder_position"
FAULT_HEADING = "fault_code"
LOG_HEADINGS = (
    TIME_HEADING,
    "q_axis_current",
    "d_axis_current",
    SPEED_HEADING,
    ENCODER_HEADING,
    "input_voltage",
)
LOG_ROWS_LEAST = 3
ANGLE_DIVISION_SLACK = 0.02  # p_pid_ang_div may differ from 1 by this; the firmware takes it as 1
ANGLE_AGREEMENT = (
    0.3  # rad rms by which the encoder's angle may differ from the integrated speed within a row
)


@dataclass(frozen=True)
class MotorXml:
    """The elements of the file, by name."""

    path: Path
    root: ElementTree.Element

    def number(self, names: Sequence[str], expected: str, zero: bool = False) -> float:
        """The number in the first of these elements that there is. StudyError: none, or not above zero."""
        element = next((e for name in names if (e := self.root.find(f".//{name}")) is not None), None)
        if element is None:
            raise StudyError(f"{self.path}: {' or '.join(names)}: missing: expected {expected}")
        text = (element.text or "").strip()
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (value > 0 or (zero and value == 0)) or value == math.inf:
            raise StudyError(f'{self.path}: {element.tag}: "{printable(text)}": expected {expected}')
        return value


def read_xml(path: Path) -> MotorXml:
    """Read a motor configuration. StudyError: the file is none."""
    text = text_of(path, XML_HINT)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise StudyError(f"{path}: it defines entities: expected {XML_HINT}")
    try:
        return MotorXml(path, ElementTree.fromstring(text.encode()))
    except ElementTree.ParseError as error:
        raise StudyError(f"{path}: not readable as XML: {error}: expected {XML_HINT}") from None


def pole_pairs(motor: MotorXml) -> int:
    poles = motor.number(["si_motor_poles"], "the number of poles, such as 14")
    if poles % 2:
        raise StudyError(f"{motor.path}: si_motor_poles: {poles:g}: expected an even number")
    return round(poles) // 2


def tables(motor: MotorXml, bus_voltage: float) -> dict[str, dict[str, Any]]:
    """[motor] and [drive] as the configuration gives them."""
    inductance = motor.number(["foc_motor_l"], "the inductance of a measured motor")
    rate = f"{motor.number(['foc_f_zv', 'foc_f_sw'], 'a rate above zero'):.0f} Hz"
    limit = motor.number(["l_current_max"], "a current above zero")
    loop = {
        "kp": f"{motor.number(['foc_current_kp'], 'a gain above zero'):.9g} V/A",
        "ki": f"{motor.number(['foc_current_ki'], 'a gain above zero'):.9g} V/A/s",
        "current_limit": f"{limit:.9g} A",
    }
    return {
        "motor": {
            "pole_pairs": pole_pairs(motor),
            "R_s": f"{motor.number(['foc_motor_r'], 'the resistance of a measured motor'):.9g} ohm",
            "L_d": f"{inductance:.9g} H",
            "L_q": f"{inductance:.9g} H",
            "psi_f": f"{motor.number(['foc_motor_flux_linkage'], 'the flux of a measured motor'):.9g} Wb",
        },
        "drive": {
            "rates": {"current_loop": rate, "speed_loop": rate},
            "current_loop": loop,
            "inverter": {"bus_voltage": f"{bus_voltage:.4g} V"},
        },
    }


def _number_or(motor: MotorXml, name: str, default: float) -> float:
    """A number of the configuration; `default`, if the file is older and lacks it."""
    try:
        value = float(motor.root.findtext(f".//{name}", ""))
    except ValueError:
        return default
    return value if math.isfinite(value) else default


def table_frame(motor: MotorXml, turns: bool) -> TableFrame:
    """The frame of the encoder's table. `turns`: in the logs the encoder's angle turns.

    The logged position is the encoder's angle, reversed by `m_invert_direction`, less `p_pid_offset`.
    """
    lacking = ""
    if not turns:
        lacking = (
            f"in the logs {ENCODER_HEADING} does not turn with {SPEED_HEADING}: expected logs in "
            "which both turn"
        )
    elif abs(_number_or(motor, "p_pid_ang_div", 1.0) - 1.0) > ANGLE_DIVISION_SLACK:
        lacking = (
            f"{motor.path}: p_pid_ang_div is not 1: expected 1, with which the encoder's own angle is logged"
        )
    elif round(_number_or(motor, "foc_encoder_ratio", pole_pairs(motor))) != pole_pairs(motor):
        lacking = f"{motor.path}: foc_encoder_ratio is not the pole pairs: expected an encoder on the rotor"
    direction = -1 if _number_or(motor, "m_invert_direction", 0.0) else 1
    return TableFrame(
        "vesc",
        zero=not lacking,
        lacking=lacking,
        encoder_direction=direction,
        encoder_shift=direction * math.radians(_number_or(motor, "p_pid_offset", 0.0)),
        pole_pairs=pole_pairs(motor),
    )


def recognise(first: Sequence[str]) -> str:
    cells = {cell.strip() for cell in (first[0] if first else "").split(";")}
    return "a log of real-time data" if {TIME_HEADING, "q_axis_current", SPEED_HEADING} <= cells else ""


def read_logs(paths: Sequence[Path], configuration: Path | None) -> DriveLogs:
    """Logs of real-time data. StudyError: a file that can't be used."""
    if configuration is None:
        raise StudyError(f"{paths[0]}: a log of VESC: expected --drive-config FILE with {XML_HINT}")
    motor = read_xml(configuration)
    pairs = pole_pairs(motor)
    recordings, remarks, volts = [], [], []
    encoder_turns = True
    for path in paths:
        log = read_columns(path, LOG_HEADINGS, (TIME_HEADING, "q_axis_current", SPEED_HEADING), "VESC Tool")
        t = 1e-3 * np.unwrap(log.columns[TIME_HEADING], period=DAY_MILLISECONDS)
        fault = faults(path, t - t[0], numbers(path, [FAULT_HEADING], TIME_HEADING))
        good = {name: values[: fault.rows] for name, values in log.columns.items()}
        columns, losses = _whole_rows(path, good)
        if len(columns[TIME_HEADING]) < LOG_ROWS_LEAST:
            raise StudyError(f"{path}: {len(columns[TIME_HEADING])} rows: expected {LOG_ROWS_LEAST} or more")
        signals, turns, lines = _signals(path, columns, pairs)
        encoder_turns = encoder_turns and turns
        recordings.append(Recording(path, "", signals, remarks=(*log.remarks, *losses)))
        remarks += [*fault.remarks, *lines]
        volts.append(float(np.median(columns["input_voltage"])) if "input_voltage" in columns else 0.0)
    if max(volts) <= 0:
        raise StudyError(f"{paths[0]}: input_voltage: {max(volts):g}: expected the supply's voltage")
    frame = table_frame(motor, encoder_turns)
    return DriveLogs(recordings, tables(motor, float(np.median(volts))), frame, remarks)


def _whole_rows(path: Path, columns: Mapping[str, Array]) -> tuple[dict[str, Array], list[str]]:
    """The rows that have all numbers, and a remark if others are left out."""
    whole = ~np.any(np.isnan(np.stack(list(columns.values()))), axis=0)
    lost = int(np.sum(~whole))
    lines = [f"{path.name}: {lost} rows lack a number and are left out."] if lost else []
    return {name: values[whole] for name, values in columns.items()}, lines


def _signals(path: Path, columns: dict[str, Array], pairs: int) -> tuple[dict[str, Array], bool, list[str]]:
    """Signals at the middles between the rows, where the mean currents belong.

    It also returns whether the angle is the encoder's, and remarks.
    """
    t = 1e-3 * np.unwrap(columns[TIME_HEADING], period=DAY_MILLISECONDS)
    steps = np.diff(t)
    if np.any(steps < 0):
        row = int(np.flatnonzero(steps < 0)[0]) + 2
        back = f"{path}: {TIME_HEADING}: row {row}: the time goes back"
        raise StudyError(f"{back}: expected a log of one recording")
    omega = math.tau / 60 / pairs * columns[SPEED_HEADING]
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * steps)])
    encoder = np.radians(columns.get(ENCODER_HEADING, 0 * t))
    theta, lines = turned, []
    apart = np.angle(np.exp(1j * (np.diff(encoder) - np.diff(turned))))
    turns = not np.all(encoder == encoder[0]) and float(np.std(apart)) <= ANGLE_AGREEMENT
    if not turns:
        lines.append(
            f"{path.name}: no {ENCODER_HEADING} that turns with {SPEED_HEADING}: the angle is the speed's "
            "integral, so the phase of an order on the rotor is unknown."
        )
    else:  # Between two rows the rotor may make more than half a turn; the speed says how many.
        theta = turned + np.unwrap(encoder - turned)
    rate = 1 / float(np.median(steps))
    speed = float(np.median(np.abs(omega))) / math.tau
    lines.append(
        f"{path.name}: {rate:.0f} rows a second of mean currents, at {speed:.2g} r/s, show orders below "
        f"{rate / 2 / max(speed, 1e-3):.0f}."
    )
    middle = {"t": t, "theta": theta, "omega": omega}
    signals = {name: 0.5 * (values[1:] + values[:-1]) for name, values in middle.items()}
    signals["i_q"] = columns["q_axis_current"][1:]
    if "d_axis_current" in columns:
        signals["i_d"] = columns["d_axis_current"][1:]
    signals["t"] = signals["t"] - signals["t"][0]
    return signals, turns, lines


VESC = Adapter(
    name="vesc",
    title="VESC",
    reads=(
        Feature(
            "VESC Tool's log of real-time data (CSV): its 50 rows a second show inertia and friction, "
            "but hardly cogging",
            Certainty.SOURCE,
        ),
        Feature("the motor configuration as XML: motor and drive", Certainty.DRIVE),
    ),
    writes=(
        Feature(
            "table --encoder: its encoder correction in whole electrical degrees, as Lisp", Certainty.DRIVE
        ),
    ),
    recognise=recognise,
    read_logs=read_logs,
    write_encoder=write_vesc,
    mean_currents=True,
    refusal="VESC has no cogging table; its encoder correction corrects the angle",
)
