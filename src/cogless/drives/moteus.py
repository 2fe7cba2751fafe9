"""moteus: logs of tview and of Python, the dump of its configuration, and its cogging table.

Formats and arithmetic were read in its source (mjbots/moteus, db1a762). Positions are turns of the output;
currents are peak amperes. The table's index is the angle of the commutation source, not the logged position.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cogless.drives.adapter import (
    Adapter,
    Certainty,
    DriveLogs,
    Feature,
    Recording,
    TableFrame,
    TableText,
    read_columns,
    text_of,
)
from cogless.drives.encoder_table import write_moteus
from cogless.drives.fault_rows import Faults, faults, numbers
from cogless.drives.firmware_laws import MOTEUS_ENTRIES, MoteusTable
from cogless.drives.holding_current import HoldingCurrent, from_samples, samples
from cogless.drives.moteus_dump import DUMP_HINT, Dump, gains, read_dump, tables
from cogless.drives.moteus_script import write_script
from cogless.drives.moteus_stream import STREAM_SUFFIX, read_stream
from cogless.drives.row_times import overlay, sent_times
from cogless.errors import StudyError
from cogless.identify.log import ended_early
from cogless.identify.log_files import LogColumns, printable, require_bytes
from cogless.identify.read_log import read
from cogless.results.trace import Array

ENTRY_MOST = 127
STATS_CHANNEL, POSITION_CHANNEL = "servo_stats", "motor_position"
STATS_SIGNALS = {"position", "velocity", "q_A", "d_A", "bus_V"}
REGISTERS = {"position": "POSITION", "velocity": "VELOCITY", "q_A": "Q_CURRENT", "d_A": "D_CURRENT"}
MODE, FAULT = "mode", "fault"  # flags of servo_stats; registers have these names in capitals
FAULT_MODE, POSITION_MODE = 1, 10
OVERLAY_SPREAD = 0.2  # rad rms of single rows; beyond it the channels are not of one log
ENDS_APART = 0.5  # s, by which one channel may end before the other; a slow channel has a row each 100 ms
CHANNEL_ROWS_LEAST = 3  # a channel with fewer is no log


@dataclass(frozen=True, eq=False)
class Channels:
    """A log of a controller: the file's name, and the columns of each channel by their name there.

    `stats_name`, `position_name`: of the channels, for messages.
    """

    path: Path
    name: str
    stats: Mapping[str, Array]
    position: Mapping[str, Array]
    stats_name: str
    position_name: str
    remarks: Sequence[str] = ()
    stamped: bool = True  # PC time when a row arrived; False: time of the request


def recognise(first: Sequence[str]) -> str:
    line = first[0] if first else ""
    cells = {cell.strip() for cell in line.split(",")}
    if line.startswith("{") and '"channel"' in line and '"controller"' in line:
        return "a log of tview (JSONL)"
    if "timestamp" in cells and "q_A" in cells:
        return f"a log of tview, channel {STATS_CHANNEL}"
    if "timestamp" in cells and any(cell.startswith("sources.0.") for cell in cells):
        return f"a log of tview, channel {POSITION_CHANNEL}"
    if "time" in cells and {"POSITION", "Q_CURRENT"} <= cells:
        return "a log of its Python library (CSV)"
    return ""


def read_logs(paths: Sequence[Path], configuration: Path | None) -> DriveLogs:
    """All logs with the dump of the drive that made them. StudyError: a file that can't be used."""
    if configuration is None:
        raise StudyError(f"{paths[0]}: a log of moteus: expected --drive-config FILE with {DUMP_HINT}")
    dump = read_dump(configuration)
    logs = list(_channels(paths, dump))
    if not logs:
        raise StudyError(
            f"{paths[0]}: no channel {STATS_CHANNEL}: expected a log of this channel for each log of "
            f"{POSITION_CHANNEL}"
        )
    recordings, remarks, frames = [], [], []
    for log in logs:
        recording, frame, lines = _recording(log, dump)
        recordings.append(recording)
        frames.append(frame)
        remarks += lines
    voltages = [log.stats["bus_V"] for log in logs if "bus_V" in log.stats]
    volts = float(np.median(np.concatenate(voltages))) if voltages else 0.0
    if np.any(dump.table):
        remarks.append(
            f"{dump.path}: the drive has a cogging table, scale {dump.values['motor.cogging_dq_scale']} A: "
            "the logs count as recorded with this table. cogless identifies the whole current, so a new "
            "table replaces the old one."
        )
    directions = {frame.direction for frame in frames if frame.zero}
    if len(directions) > 1:
        raise StudyError(
            f"{paths[0]}: the encoder counts backward in some logs only: expected logs that were recorded "
            "with one configuration of the drive"
        )
    without = next((log for log, frame in zip(logs, frames, strict=True) if not frame.zero), None)
    if without is not None and directions:
        raise StudyError(
            f"{without.path} lacks the angle over which moteus reads its cogging table, which other "
            "logs have: expected the channel motor_position beside each log"
        )
    frame = replace(
        max(frames, key=lambda frame: frame.zero_error),
        gains=gains(dump),
        encoder=dump.source,
        encoder_table_on=dump.encoder_table_on,
    )
    return DriveLogs(recordings, tables(dump, volts if volts > 0 else None), frame, remarks)


def _channels(paths: Sequence[Path], dump: Dump) -> Iterator[Channels]:
    """The logs in these files. A log of tview as CSV is two files, whatever their names are."""
    stats: dict[Path, LogColumns] = {}
    positions: dict[Path, LogColumns] = {}
    for path in paths:
        if ".jsonl" in path.name.lower():
            yield from _jsonl(path, dump)
            continue
        if path.suffix.lower() == STREAM_SUFFIX:
            yield _stream(path, dump)
            continue
        headings = set(read(path, [])[0].headings)
        if {"timestamp", "q_A"} <= headings:
            names = ["timestamp", *sorted(STATS_SIGNALS)]
            log = read_columns(path, names, ["timestamp", "position", "q_A"], "moteus")
            stats[path] = _before_faults(path, log, "timestamp", [MODE, FAULT])
        elif "timestamp" in headings and any(name.startswith("sources.") for name in headings):
            names = ["timestamp", _filtered(dump)]
            positions[path] = read_columns(path, names, names, "moteus")
        else:
            yield _registers(path, dump)
    partners = {_partner(path, log, stats): path for path, log in positions.items()}
    for path, log in stats.items():
        place = partners.get(path)
        position = {} if place is None else positions[place].columns
        place_remarks = () if place is None else positions[place].remarks
        yield Channels(
            path,
            path.name,
            log.columns,
            position,
            stats_name=path.name,
            position_name="" if place is None else place.name,
            remarks=(*log.remarks, *place_remarks),
        )


def _partner(path: Path, position: LogColumns, stats: Mapping[Path, LogColumns]) -> Path:
    """The log of servo_stats from the same time as a log of motor_position; of several, by the file's name.

    StudyError: there is none.
    """
    first, last = position.columns["timestamp"][[0, -1]]
    overlapping = [
        other
        for other, log in stats.items()
        if log.columns["timestamp"][0] < last and log.columns["timestamp"][-1] > first
    ]
    named = Path(str(path).replace(POSITION_CHANNEL, STATS_CHANNEL))
    if named in overlapping or len(overlapping) == 1:
        return named if named in overlapping else overlapping[0]
    those = ", ".join(other.name for other in overlapping) or "none"
    raise StudyError(
        f"{path}: expected one log of channel {STATS_CHANNEL} from the same time (found: {those}), or two "
        f"files with the same name, except for {POSITION_CHANNEL} and {STATS_CHANNEL}"
    )


def _filtered(dump: Dump) -> str:
    return f"sources.{dump.source}.filtered_value"


def _registers(path: Path, dump: Dump) -> Channels:
    """A log of the Python library: one row has all registers, at one time."""
    encoder = f"ENCODER_{dump.source}_POSITION"
    names = ["time", "VOLTAGE", encoder, *REGISTERS.values()]
    log = read_columns(path, names, ["time", "POSITION", "Q_CURRENT"], "moteus")
    log = _before_faults(path, log, "time", [MODE.upper(), FAULT.upper()])
    columns = log.columns
    stats = {name: columns[register] for name, register in REGISTERS.items() if register in columns}
    stats["timestamp"] = columns["time"]
    if "VOLTAGE" in columns:
        stats["bus_V"] = columns["VOLTAGE"]
    if not np.any(stats["q_A"]):
        raise StudyError(f"{path}: Q_CURRENT: zero in each row: expected a log with this register")
    position = {}
    if np.any(columns.get(encoder, 0.0)):  # The library writes 0 for a register that was not asked for.
        cpr = dump.number(f"motor_position.sources.{dump.source}.cpr", "counts of a turn", 16384.0)
        position = {"timestamp": columns["time"], _filtered(dump): cpr * columns[encoder]}
    return _unstamped(path, stats, position, log.remarks)


def _before_faults(path: Path, log: LogColumns, time: str, headings: Sequence[str]) -> LogColumns:
    """The rows before a fault, with remarks on the fault."""
    t = log.columns[time] - log.columns[time][0]
    fault = _faults(path, t, numbers(path, headings, time), *headings)
    columns = {name: values[: fault.rows] for name, values in log.columns.items()}
    return replace(log, columns=columns, remarks=(*log.remarks, *fault.remarks))


def _faults(path: Path, t: Array, flags: Mapping[str, Array], mode: str, fault: str) -> Faults:
    """The rows before a fault. `fault` is a fault's code in fault mode; else it may be a limit that acts."""
    modes = flags.get(mode)
    if modes is None:
        return faults(path, t, {})
    heading, codes = (fault, flags[fault]) if fault in flags else (mode, modes)
    bad = np.where(modes == FAULT_MODE, np.maximum(codes, 1.0), 0.0)
    return faults(path, t, {heading: bad}, modes, POSITION_MODE)


def _unstamped(
    path: Path, stats: Mapping[str, Array], position: Mapping[str, Array], remarks: Sequence[str] = ()
) -> Channels:
    """A log whose rows have all channels, at one time."""
    name = path.name
    return Channels(
        path, name, stats, position, stats_name=name, position_name=name, remarks=remarks, stamped=False
    )


def _stream(path: Path, dump: Dump) -> Channels:
    """A high-rate stream: all values of a row are from one control cycle."""
    stats, index = read_stream(path, dump)
    position = {} if index is None else {"timestamp": stats["timestamp"], _filtered(dump): index}
    return _unstamped(path, stats, position)


def _jsonl(path: Path, dump: Dump) -> Iterator[Channels]:
    """The controllers in a log of tview, each with its channels."""
    flags = {MODE, FAULT}
    wanted_columns = {STATS_CHANNEL: STATS_SIGNALS | flags, POSITION_CHANNEL: {_filtered(dump)}}
    rows: dict[tuple[str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    lines = text_of(path, "a log of tview").splitlines()
    require_bytes(path, sum(map(len, lines)))
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            record = json.loads(line)
            channel = record["channel"]
            if channel not in wanted_columns:
                continue
            values = {"timestamp": float(record["timestamp"])}
            for name in wanted_columns[channel]:
                value = _nested(record["data"], name)
                lacks = value is None or (name in flags and isinstance(value, str))
                values[name] = math.nan if lacks else float(value)
            columns = rows[str(record["controller"]), channel]
        except (KeyError, TypeError, ValueError):
            if number == len(lines):
                continue  # The log was cut while it was written.
            expected = 'expected {"controller": ..., "timestamp": ..., "channel": ..., "data": ...}'
            raise StudyError(f"{path}: line {number}: {expected}") from None
        for name, value in values.items():
            columns[name].append(value)
    controllers = dict.fromkeys(controller for controller, _ in rows)
    for controller in controllers:
        stats = _whole(rows.get((controller, STATS_CHANNEL), {}))
        if not {"position", "q_A"} <= stats.keys():
            raise StudyError(
                f"{path}: controller {printable(controller)}: no channel {STATS_CHANNEL} with position and "
                "q_A: expected this channel"
            )
        name = path.name if len(controllers) == 1 else f"{path.name}-{printable(controller)}"
        t = stats["timestamp"] - stats["timestamp"][:1]
        own_flags = {flag: np.nan_to_num(stats[flag]) for flag in flags & stats.keys()}
        fault = _faults(path, t, own_flags, MODE, FAULT)
        stats = {signal: values[: fault.rows] for signal, values in stats.items()}
        yield Channels(
            path,
            name,
            stats,
            _whole(rows.get((controller, POSITION_CHANNEL), {})),
            stats_name=f"{name}: {STATS_CHANNEL}",
            position_name=f"{name}: {POSITION_CHANNEL}",
            remarks=fault.remarks,
        )


def _nested(data: Any, name: str) -> Any:
    """The value at a dotted name; None if there is none."""
    for part in name.split("."):
        if isinstance(data, list):
            data = data[int(part)] if int(part) < len(data) else None
        else:
            data = data.get(part)
        if data is None:
            return None
    return data


def _whole(columns: Mapping[str, list[float]]) -> dict[str, Array]:
    """The columns that have a number, in the rows that have a time."""
    arrays = {name: np.array(values) for name, values in columns.items()}
    timed = ~np.isnan(arrays.get("timestamp", np.zeros(0)))
    return {name: values[timed] for name, values in arrays.items() if not np.all(np.isnan(values))}


def _recording(log: Channels, dump: Dump) -> tuple[Recording, TableFrame, list[str]]:
    """A log in SI units, with the angle of the table's index if a channel has it."""
    stats = log.stats
    if len(stats["timestamp"]) < CHANNEL_ROWS_LEAST:
        raise StudyError(f"{log.path}: {len(stats['timestamp'])} rows: expected {CHANNEL_ROWS_LEAST} or more")
    t = sent_times(stats["timestamp"]) if log.stamped else stats["timestamp"]
    start = t[0]
    theta = math.tau / dump.ratio * stats["position"]
    signals = {"t": t - start, "theta": theta, "i_q": stats["q_A"]}
    if "velocity" in stats:
        signals["omega"] = math.tau / dump.ratio * stats["velocity"]
    if "d_A" in stats:
        signals["i_d"] = stats["d_A"]
    recording = Recording(
        log.path, log.name, signals, "table-on" if np.any(dump.table) else "", list(log.remarks)
    )
    if not dump.takes_table:
        lacking = (
            f"{dump.path} has no motor.cogging_dq_scale: expected firmware with it, of ABI 0x0105 or later"
        )
        return recording, TableFrame("moteus", lacking=lacking), []
    name, filtered = _filtered(dump), log.position.get(_filtered(dump))
    if filtered is None:
        lacking = (
            f"{log.path} lacks the angle over which moteus reads its cogging table. The output's position "
            f"does not replace it, since its zero may change: expected channel {POSITION_CHANNEL} ({name}), "
            f"or the register ENCODER_{dump.source}_POSITION"
        )
        return recording, TableFrame("moteus", lacking=lacking), []
    cpr = dump.above_zero(f"motor_position.sources.{dump.source}.cpr", "counts of a turn")
    stamps = log.position["timestamp"]
    t_other = sent_times(stamps) if log.stamped else stamps
    remarks = [*log.remarks, *_ended_early(log, t - start, t_other - start)]
    rows, others = ~np.isnan(theta), ~np.isnan(filtered)
    laid = overlay(t[rows], theta[rows], t_other[others], math.tau / cpr * filtered[others])
    if laid is None or laid.spread > OVERLAY_SPREAD:
        raise StudyError(
            f"{log.path}: {name} and position do not move alike: expected both channels from the same "
            f"log of the same drive, and the dump of this drive, {dump.path}"
        )
    signals["theta"] = theta + laid.offset
    remark = (
        f"{log.name}: the angle over which moteus reads its cogging table is the logged position plus "
        f"{math.degrees(laid.offset):.2f} deg (+-{math.degrees(laid.error):.2g})."
    )
    frame = TableFrame("moteus", laid.direction, zero=True, zero_error=laid.error)
    return replace(recording, remarks=remarks), frame, [remark]


def _ended_early(log: Channels, t: Array, t_other: Array) -> list[str]:
    """A remark if one of the two channels ends long before the other."""
    ends = sorted([(float(t[-1]), log.stats_name), (float(t_other[-1]), log.position_name)])
    (end, name), (last, other) = ends
    return [ended_early(name, end, other, last)] if last - end > ENDS_APART else []


def write(current: HoldingCurrent, frame: TableFrame) -> TableText:
    """The table as lines for `moteus_tool --restore-config`. Its current has the sign of the logged q_A."""
    values = samples(current, MOTEUS_ENTRIES, frame.direction, "linear")
    largest = float(np.max(np.abs(values)))
    scale = float(np.float32(largest / ENTRY_MOST)) or 1.0
    entries = [round(entry) for entry in np.clip(values / scale, -ENTRY_MOST, ENTRY_MOST)]
    table = MoteusTable(scale, entries)
    lines = [
        "# Cogging table of moteus, by cogless. Install: moteus_tool -t 1 --restore-config THIS_FILE",
        f"motor.cogging_dq_scale {scale:.9g}",
        *(f"motor.cogging_dq_comp.{n} {entry}" for n, entry in enumerate(entries)),
    ]
    return TableText(
        "\n".join(lines) + "\n",
        MOTEUS_ENTRIES,
        f"each a whole number from -127 to 127, in steps of {scale:.4g} A",
        lambda angle: np.array([table.current(frame.direction * a) for a in angle.tolist()]),
        install="moteus_tool -t 1 --restore-config FILE",
        remove='in tview: "conf set motor.cogging_dq_scale 0", then "conf write"',
        sign_check=f'in tview: "conf set motor.cogging_dq_scale {0.3 * scale:.4g}", then "{-0.3 * scale:.4g}"'
        ", each at a slow speed: the ripple falls with the first value and grows with the second; "
        f'then "{scale:.4g}" is the whole table again',
        notes=(
            "moteus adds the table's current only in position mode, after the torque limit.",
            "A calibration or an encoder compensation shifts the angle over which moteus reads this table: "
            "afterwards record new logs and write a new table.",
        ),
        table_params={"scale": scale, "entries": entries, "direction": frame.direction},
    )


def read_table(path: Path, configuration: Path | None) -> HoldingCurrent:
    """The table in a dump, or the two means that moteus's own compensate_cogging.py measures (JSON).

    The mean of both directions is free of friction. A mean of a bin belongs to the bin's middle.
    """
    del configuration  # Both kinds of table are over the index itself.
    text = text_of(path, f"{DUMP_HINT}, or the JSON of compensate_cogging.py")
    if not text.lstrip().startswith("{"):
        dump = read_dump(path)
        if not np.any(dump.table):
            raise StudyError(f"{path}: motor.cogging_dq_comp: all zero or missing: expected a stored table")
        return from_samples(dump.table, 0.0, str(path), "linear")
    try:
        contents = json.loads(text)
        means = [np.array(contents[key], dtype=np.float64) for key in ("forward", "reverse")]
    except (KeyError, TypeError, ValueError):
        raise StudyError(f'{path}: expected {{"reverse": [...], "forward": [...]}}') from None
    if means[0].ndim != 1 or means[0].shape != means[1].shape or len(means[0]) < CHANNEL_ROWS_LEAST:
        raise StudyError(f"{path}: forward, reverse: expected two lists of equal length")
    if not np.all(np.isfinite(means)):
        raise StudyError(f"{path}: forward, reverse: expected finite numbers")
    return from_samples((means[0] + means[1]) / 2, 0.0, str(path), "means")


MOTEUS = Adapter(
    name="moteus",
    title="moteus",
    reads=(
        Feature("tview CSV: servo_stats, and motor_position for the table's zero", Certainty.SOURCE),
        Feature("tview JSONL", Certainty.SOURCE),
        Feature("Python library's CSV; ENCODER_0_POSITION for the table's zero", Certainty.SOURCE),
        Feature("high-rate stream (.bin), with servo.emit_debug in the dump", Certainty.SOURCE),
        Feature("compensate_cogging.py's JSON, as a table", Certainty.SOURCE),
        Feature("moteus_tool --dump-config: motor, drive, its table", Certainty.SOURCE),
    ),
    writes=(
        Feature("cogging table: lines for moteus_tool --restore-config", Certainty.SOURCE),
        Feature("encoder table (table --encoder): lines for moteus_tool, too", Certainty.SOURCE),
        Feature(
            "identify --plan: a script that records the logs with moteus' Python package",
            Certainty.DRIVE,
        ),
    ),
    recognise=recognise,
    read_logs=read_logs,
    write=write,
    read_table=read_table,
    write_script=write_script,
    law="Moteus",
    gains=lambda path: gains(read_dump(path)),
    write_encoder=write_moteus,
)
