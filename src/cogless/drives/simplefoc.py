"""SimpleFOC: the lines of its monitor, and a header with a cogging table for its feed-forward.

Read in its source (simplefoc/Arduino-FOC, 7f9c45f). The monitor has no heading and no time, and its currents
are in mA. So a small file says which columns the monitor prints, and the time between its lines. The table's
index is `motor.shaft_angle`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cogless import units
from cogless.drives.adapter import (
    Adapter,
    Certainty,
    DriveLogs,
    Feature,
    Recording,
    TableFrame,
    TableText,
    text_of,
)
from cogless.drives.c_table import header
from cogless.drives.encoder_table import write_simplefoc
from cogless.drives.holding_current import HoldingCurrent
from cogless.drives.simplefoc_sketch import write_script
from cogless.errors import StudyError
from cogless.identify.log_files import require_bytes
from cogless.results.trace import Array
from cogless.study.reading import read

MONITOR_HINT = (
    'a TOML file: monitor = ["target", "Iq", "velocity", "angle"], the columns in the order of '
    'monitor_variables; row_period = "2 ms", or a column "time_us" in monitor; and the tables [motor] and '
    "[drive], as in a study"
)
# Columns of the monitor: the signal of each, and the factor to SI.
MONITOR_SIGNALS: dict[str, tuple[str, float]] = {
    "target": ("", 1.0),
    "Uq": ("u_q", 1.0),
    "Ud": ("", 1.0),
    "Iq": ("i_q", 1e-3),
    "Id": ("i_d", 1e-3),
    "velocity": ("omega", 1.0),
    "angle": ("theta", 1.0),
    "time_us": ("t", 1e-6),
    "part": ("part", 1.0),
}
SENSOR_HINT = 'sensor_direction = 1 or -1 (CW or CCW) and sensor_offset, such as "0 rad", of the motor'
# Numbers of the sketch's speed loop, by the library's names. Units: A s/rad, A/rad, A s^2/rad, A/s; s.
LOOP_NAMES = {"PID_velocity": ("P", "I", "D", "output_ramp"), "LPF_velocity": ("Tf",)}
NUMBER_PATTERN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf", re.IGNORECASE)
MONITOR_LINE = re.compile(r"\D{0,3}[-+\d.]+(\t[-+\d.]+)+\t?\D{0,3}")
START_LINE = re.compile(r"[A-Z]{3}:")  # what the library prints at its start, such as "MOT: Ready."
RECOGNISED_LINES = 10
CURRENT_LEAST = 0.01  # A, largest current of a log, at least: less is a voltage, or has another unit
SPOILT_SHARE_MOST = 0.05  # lines of another form that a log may have
MICROS_WRAP = 2**32  # microseconds after which the processor's counter begins anew

INTRODUCTION_TEXT = """\
// Cogging feed-forward for SimpleFOC, by cogless. Angles are those of motor.shaft_angle.
//
// In loop(), before motor.loopFOC(), with torque control by a current:
//     motor.feed_forward_current.q = cogging_feed_forward(motor.shaft_angle);
// with torque control by a voltage:
//     motor.feed_forward_voltage.q = motor.phase_resistance * cogging_feed_forward(motor.shaft_angle);
// The angle needs the same zero after each start: an absolute sensor, or the search of an index."""


def recognise(first: Sequence[str]) -> str:
    printed = [line for line in first if line.strip() and not START_LINE.match(line)]
    lines = printed[:RECOGNISED_LINES]
    if len(lines) > 1 and all(MONITOR_LINE.fullmatch(line.strip()) for line in lines):
        return "the output of its monitor (numbers between tabs, no heading)"
    return ""


def read_logs(paths: Sequence[Path], configuration: Path | None) -> DriveLogs:
    """The lines of the monitor. StudyError: what they mean isn't said, or a file that can't be used."""
    if configuration is None:
        raise StudyError(
            f"{paths[0]}: SimpleFOC's monitor has no heading and no time: "
            f"expected --drive-config FILE, {MONITOR_HINT}"
        )
    tables = read(configuration)
    monitor, period = _monitor(configuration, tables), _period(configuration, tables)
    recordings, remarks = [], []
    for path in paths:
        values, spoilt = _read_monitor(path, monitor)
        signals = {}
        for name, column in zip(monitor, values.T, strict=True):
            signal, factor = MONITOR_SIGNALS[name]
            if name == "time_us":
                column = np.unwrap(column, period=MICROS_WRAP)
            if signal:
                signals[signal] = factor * column
        most = float(np.nanmax(np.abs(signals["i_q"])))
        if most < CURRENT_LEAST:
            raise StudyError(
                f"{path}: Iq never exceeds {1e3 * most:.2g} mA: expected {1e3 * CURRENT_LEAST:g} mA or more. "
                "Perhaps it is no current: without motor.monitor_variables the monitor prints target, Uq "
                "(V), velocity, angle"
            )
        if period is not None:
            signals["t"] = period * np.arange(len(values))
            remarks.append(f"{path.name}: rows are taken as {1e3 * period:g} ms apart, as row_period says.")
        if spoilt:
            remarks.append(f"{path.name}: {spoilt} lines that do not fit are left out.")
        recordings.append(Recording(path, "", signals))
    own = {"motor": tables.get("motor", {}), "drive": tables.get("drive", {})}
    direction, shift = _sensor(configuration, tables)
    frame = TableFrame(
        "simplefoc",
        zero=True,
        gains=_gains(configuration, tables),
        encoder_direction=direction,
        encoder_shift=shift,
        encoder_lacking="" if direction else f"expected {SENSOR_HINT} in the file of --drive-config",
    )
    return DriveLogs(recordings, own, frame, remarks)


def _gains(path: Path, tables: dict[str, Any]) -> dict[str, float]:
    """The gains of the speed loop, as `firmware_laws.SimpleFoc` takes them; empty: the file lacks them."""
    gains: dict[str, float] = {}
    for table, names in LOOP_NAMES.items():
        numbers = tables.get(table, {})
        for name, value in numbers.items() if isinstance(numbers, dict) else [("", numbers)]:
            if name not in names or isinstance(value, bool) or not isinstance(value, int | float):
                raise StudyError(
                    f"{path}: {table}: {name}: expected numbers {', '.join(names)} of the sketch"
                )
            gains[name] = float(value)
    if gains and not {"P", "I"} <= gains.keys():
        raise StudyError(f"{path}: PID_velocity: expected P and I of the sketch")
    return gains


def _sensor(path: Path, tables: dict[str, Any]) -> tuple[int, float]:
    """The sensor's direction, and its angle where the motor's angle is zero, rad.

    The motor's angle is direction * sensor - offset. 0, 0: the file does not give them.
    """
    direction, text = tables.get("sensor_direction"), tables.get("sensor_offset")
    if direction is None and text is None:
        return 0, 0.0
    if isinstance(direction, bool) or direction not in (1, -1):
        raise StudyError(f"{path}: sensor_direction: {direction}: expected {SENSOR_HINT}")
    try:
        return int(direction), int(direction) * units.parse(str(text), units.ANGLE)
    except units.UnitError as error:
        raise StudyError(f'{path}: sensor_offset: "{text}": {error}: expected {SENSOR_HINT}') from None


def _monitor(path: Path, tables: dict[str, Any]) -> list[str]:
    names = tables.get("monitor")
    if not isinstance(names, list) or not names:
        raise StudyError(f"{path}: monitor: missing: expected {MONITOR_HINT}")
    for name in names:
        if name not in MONITOR_SIGNALS:
            raise StudyError(f'{path}: monitor: "{name}": expected some of {", ".join(MONITOR_SIGNALS)}')
    for name in ("Iq", "angle"):
        if names.count(name) != 1:
            raise StudyError(
                f"{path}: monitor: {name}: expected once in the list; motor.monitor_variables = _MON_CURR_Q "
                "| _MON_VEL | _MON_ANGLE prints Iq, velocity and angle; Iq needs current sense or "
                "estimated_current"
            )
    return names


def _period(path: Path, tables: dict[str, Any]) -> float | None:
    """Time between the monitor's lines, s; None: each line has its time."""
    text = tables.get("row_period")
    if ("time_us" in tables["monitor"]) == (text is not None):
        raise StudyError(
            f'{path}: row_period: expected either row_period, such as "2 ms", or time_us in monitor'
        )
    if text is None:
        return None
    try:
        period = units.parse(str(text), units.TIME)
    except units.UnitError as error:
        raise StudyError(f'{path}: row_period: "{text}": {error}') from None
    if not 0 < period < 1:
        raise StudyError(f'{path}: row_period: "{text}": expected a time above zero and below 1 s')
    return period


def _read_monitor(path: Path, monitor: list[str]) -> tuple[Array, int]:
    """The numbers of each line, and how many lines are of another form."""
    text = text_of(path, "lines of SimpleFOC's monitor")
    require_bytes(path, len(text))
    lines = [line for line in text.splitlines() if line.strip()]
    rows = [numbers for line in lines if len(numbers := NUMBER_PATTERN.findall(line)) == len(monitor)]
    spoilt = len(lines) - len(rows)
    if not rows or spoilt > max(2, SPOILT_SHARE_MOST * len(lines)):
        count = len(NUMBER_PATTERN.findall(lines[len(lines) // 2])) if lines else 0
        raise StudyError(
            f"{path}: {count} numbers in a line: expected {len(monitor)}, as monitor says: "
            f"{', '.join(monitor)}"
        )
    return np.array(rows, dtype=np.float64), spoilt


def write(current: HoldingCurrent, frame: TableFrame) -> TableText:
    """A header with the table and its interpolation."""
    return header(
        current,
        frame,
        introduction=INTRODUCTION_TEXT,
        install="copy FILE into the sketch, #include it, and call it in loop() as its first lines say",
        note="SimpleFOC adds this current after current_limit. The sketch needs feed_forward_current, which "
        "commit 7f9c45f of Arduino-FOC has; older releases do not.",
    )


SIMPLEFOC = Adapter(
    name="simplefoc",
    title="SimpleFOC",
    reads=(
        Feature("the monitor's lines, with a small file that says its columns and times", Certainty.SOURCE),
    ),
    writes=(
        Feature("a header with table and cogging_feed_forward(angle)", Certainty.SOURCE),
        Feature("--encoder: a table for CalibratedSensor of its drivers", Certainty.SOURCE),
        Feature("identify --plan: a header for a sketch that records the logs", Certainty.DRIVE),
    ),
    recognise=recognise,
    read_logs=read_logs,
    write=write,
    write_script=write_script,
    write_encoder=write_simplefoc,
    law="SimpleFoc",
    gains=lambda path: _gains(path, read(path)),
    log_pattern="*#{number}",
)
