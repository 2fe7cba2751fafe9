"""Make logs with one clock: rows at equal times, in stretches without gaps, with remarks on oddities."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from glob import escape
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.identify.advice import Advice, AdvisedError, Cure
from cogless.identify.config import COUNT, Identification, LogRule
from cogless.identify.log_files import Columns, LogColumns, printable
from cogless.identify.read_log import read
from cogless.results.trace import Array
from cogless.units import DEGREE, RPM, TURN

GAP_PERIODS = 2.5  # a longer time without a row is a gap
ROW_LOST = 1.5  # periods: a longer time is a gap if a row there was left out, since a number was missing
BURSTS_LEAST = 20  # least bursts in a log whose stamps are those of packets
BURST_TIME = 0.1  # largest share of the time that passes within bursts
BURST_ROWS = 2.0  # least mean count of rows in a burst
BURST_MOVE = 2.0  # largest angle moved between bursts over the angle between rows in a burst; packets have 1
BURSTS_BESIDE = 5  # bursts on each side of a burst whose median delays show whether a packet was lost
UNEVEN_SHARE = 0.25  # largest random lateness of packets, rms, over a burst's time
LOST_SHARE = 0.5  # lasting lateness over a burst's time above which a packet was lost
TIMED_ROWS_LEAST = 100  # rows of a log with a clock, or of a stretch of one
CURRENTS = ("i_q", "i_d", "i_a", "i_b", "i_c")
CURRENT_RATIO_MOST = 3.0  # a current over the drive's limit
MOTION_LEAST = 0.2  # rad rms: with less motion, speed and angle are not compared
IN_PROPORTION = 0.98  # least cosine between two currents' amplitudes for their ratio, known to 2 %, to count
SPEED_RATIO_MOST = 1.5  # omega over the angle's own speed: a filter's lag or lost counts give less
UNIT_MISTAKES: tuple[tuple[float, str, Cure], ...] = (
    (1 / RPM, 'the speed looks like rpm: unit = "rpm"', {"columns.omega.unit": "rpm"}),
    (1 / DEGREE, 'the speed looks like deg/s: unit = "deg/s"', {"columns.omega.unit": "deg/s"}),
    (DEGREE, 'the angle looks like degrees: unit = "deg"', {"columns.theta.unit": "deg"}),
    (1 / TURN, 'the speed looks like revolutions: unit = "rev/s"', {"columns.omega.unit": "rev/s"}),
    (TURN, 'the angle looks like revolutions: unit = "rev"', {"columns.theta.unit": "rev"}),
    (1e3, 'the time looks like milliseconds: unit = "ms"', {"columns.t.unit": "ms"}),
    (1e6, 'the time looks like microseconds: unit = "us"', {"columns.t.unit": "us"}),
    (-1.0, "one of them counts backwards: sign = -1", {"columns.omega.sign": -1}),
)
DAY_SECONDS, COUNTER_SECONDS = 86_400.0, 2**32 * 1e-6  # s, a day and 32 bits of microseconds
CLOCK_ROWS_MOST = 20  # rows that may be missing where a clock begins anew
FILE_LOGS_MOST = 1000  # logs in a file
HEADINGS_COMPARED = 1000  # headings of a file that are compared with a missing heading
HEADINGS_SHOWN = 12  # headings that a message shows if none is like the missing heading
NEAR_LIKENESS = 0.6  # share of letters in the same order, above which a heading is named
SPREAD_LEAST = 0.07  # rms spread of the time between rows, in periods, above which a remark reports it
OWN_TIMES = "each row is used at its own time"
EVEN_ROWS = "the times are taken as rounded, and the rows as evenly spaced"
REPEATED_SHARE = 0.2  # share of rows that repeat the row before, above which a remark reports it


@dataclass(frozen=True, eq=False)
class Log:
    """A log in SI units.

    `dt`: time between rows, s; 0 for a hold map. `stretches`: rows without a gap between them. `remarks`:
    sentences on what was odd in the log. `mean_current`: a row of i_q is the mean since the row before.
    """

    name: str
    rule: LogRule
    dt: float
    signals: Columns
    stretches: tuple[slice, ...]
    remarks: list[str] = field(default_factory=list)
    mean_current: bool = False

    def __len__(self) -> int:
        return len(next(iter(self.signals.values())))

    def __contains__(self, name: object) -> bool:
        return name in self.signals

    def __getitem__(self, name: str) -> Array:
        return self.signals[name]

    @property
    def kind(self) -> str:
        return self.rule.kind or ""

    @property
    def duration(self) -> float:
        """Time that the log covers, s."""
        return self.dt * len(self)


def load_logs(paths: list[Path], identification: Identification) -> list[Log]:
    """Read all logs. StudyError: a file, a column or a row that can't be used."""
    headings = [column.name for column in identification.columns.values()]
    columns: list[tuple[Path, LogColumns]] = []
    for path in paths:
        true = ["theta_m"] if path.suffix == ".nc" else []
        columns += [(path, log) for log in read(path, headings + true, with_gaps=True)]
    return logs_of_columns(columns, identification)


def logs_of_columns(columns: Sequence[tuple[Path, LogColumns]], identification: Identification) -> list[Log]:
    """The logs in columns that were read from these files. StudyError: a column or row that can't be used."""
    logs: list[Log] = []
    columns = list(columns)
    _require_columns(columns, identification)
    while columns:
        path, log = columns.pop(0)
        own_logs = [_log(path, part, own, identification) for part, own in _parts(path, log, identification)]
        own_logs[0].remarks.extend(log.remarks)
        logs += own_logs
    names = [log.name for log in logs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise StudyError(f"{twice}: given twice: expected each log once")
    return logs


def _parts(path: Path, log: LogColumns, identification: Identification) -> Iterator[tuple[str, Columns]]:
    """Yield name and columns of the log, or of a log for each value in the column of parts."""
    name, columns = log.name or path.name, dict(log.columns)
    column = identification.columns.get("part")
    values = columns.pop(column.name, None) if column is not None else None
    if values is None:
        yield name, columns
        return
    if np.isnan(values).any():
        row = np.flatnonzero(np.isnan(values))[0] + 1
        raise StudyError(
            f"{path}: {_heading(identification, 'part')}: row {row}: no number: expected the number of "
            "the part that the row belongs to"
        )
    parts = np.unique(values)
    if len(parts) > FILE_LOGS_MOST:
        heading = _heading(identification, "part")
        raise StudyError(f"{path}: {heading}: {len(parts)} parts: expected {FILE_LOGS_MOST} or fewer")
    for value in parts:
        yield f"{name}#{value:g}", {key: of[values == value] for key, of in columns.items()}


def _require_columns(logs: Sequence[tuple[Path, LogColumns]], identification: Identification) -> None:
    """Refuse logs that lack a column which names them, or that have a column which does not name them."""
    lines = list[str]()
    for path, log in logs:
        name = log.name or path.name
        signals = {signal: column for signal, column in identification.columns.items() if column.is_in(name)}
        lacking = [signal for signal, column in signals.items() if column.name not in log.headings]
        where = f"{path}: {name}" if log.name else str(path)
        if lacking:
            lines.append(_lacking(where, lacking, logs, log.headings, identification))
        lines += [
            Advice(
                f'{where}: has the column "{column.name}" ({signal}), but columns.{signal}.files does not '
                "name this file: expected the files that have the column",
                {f"columns.{signal}.files": [*column.files, escape(name)]},
            )
            for signal, column in identification.columns.items()
            if column.name in log.headings and signal not in signals
        ]
        lines += [
            _no_clock(where, signal, identification)
            for signal, column in signals.items()
            if column.name in log.clocks and (signal != "t" or identification.factor("t") != 1.0)
        ]
    if lines:
        raise AdvisedError(*lines)


def _no_clock(where: str, signal: str, identification: Identification) -> str:
    """The mistake of times of day in a column other than the time, or in a time with unit, sign or scale."""
    heading = identification.columns[signal].name
    if signal != "t":
        time = f"if this is the time, columns.t.name = {_quoted([heading])}"
        return f"{where}: {heading}: holds times of day: expected numbers, or {time}"
    return Advice(
        f"{where}: {heading}: cogless converts times of day to seconds: expected columns.t without unit, "
        "sign or scale",
        {"columns.t": heading},
    )


def _lacking(
    where: str,
    signals: Sequence[str],
    logs: Sequence[tuple[Path, LogColumns]],
    headings: Sequence[str],
    identification: Identification,
) -> Advice:
    """Advice on a log that lacks these signals: the nearest headings, and the logs that have the signals."""
    used = {column.name for column in identification.columns.values()}
    lacking = {signal: identification.columns[signal].name for signal in signals}
    nearest = _nearest(lacking, [heading for heading in headings if heading not in used])
    listed = ", ".join(
        f'"{heading}" ({signal}{f"; similar: {_quoted([nearest[signal]])}" if signal in nearest else ""})'
        for signal, heading in lacking.items()
    )
    others = "" if nearest else f"; it has {_quoted(headings[:HEADINGS_SHOWN])}"
    having = {
        signal: [escape(log.name or path.name) for path, log in logs if heading in log.headings]
        for signal, heading in lacking.items()
    }
    renamed = {f"columns.{signal}.name": heading for signal, heading in nearest.items()}
    limited = {f"columns.{signal}.files": files for signal, files in having.items() if files}
    instead = "".join(f", or {key} = [{_quoted(files)}]" for key, files in limited.items())
    return Advice(
        f"{where}: no column {listed}{others}: expected in [columns] a heading that this file has{instead}",
        *(cure for cure in (renamed, limited) if cure),
    )


def _nearest(lacking: Mapping[str, str], headings: Sequence[str]) -> dict[str, str]:
    """The heading most like each lacking one, none twice; units, spaces and capitals don't count."""

    def plain(name: str) -> str:
        return "".join(filter(str.isalnum, re.sub(r"[\[(].*", "", name).casefold()))

    def likeness(name: str, other: str) -> float:
        return SequenceMatcher(None, plain(name), plain(other), autojunk=False).ratio()

    pairs = [
        (likeness(name, heading), signal, heading)
        for signal, name in lacking.items()
        for heading in headings[:HEADINGS_COMPARED]
    ]
    nearest: dict[str, str] = {}
    for like, signal, heading in sorted(pairs, key=lambda pair: -pair[0]):
        if like > NEAR_LIKENESS and signal not in nearest and heading not in nearest.values():
            nearest[signal] = heading
    return nearest


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(f'"{printable(name)}"' for name in names)


def _log(path: Path, name: str, columns: Columns, identification: Identification) -> Log:
    rule = identification.rule(name)
    where = str(path) if name.startswith(path.name) else f"{path}: {name}"
    remarks: list[str] = []
    columns = _before_a_column_ends(name, columns, identification, remarks)
    columns, after_loss = _complete(where, name, columns, remarks)
    signals = {
        signal: identification.factor(signal) * columns[column.name]
        for signal, column in identification.columns.items()
        if column.name in columns
    }
    if "theta_m" in columns and {"theta", "i_q", "i_d"} <= signals.keys():
        _by_measured_angle(signals, columns["theta_m"], identification.motor.pole_pairs)
    for signal in signals:
        still = signal == "t" or (signal == "theta" and rule.kind != "bridge-off")
        if still and not np.any(signals[signal] != signals[signal][0]):
            raise StudyError(
                f"{where}: {identification.columns[signal].name}: never changes: expected changing values of "
                f"{signal}"
            )
    if signals.keys() <= {"t"}:
        raise StudyError(
            f"{where}: no column but the time: expected an angle, a speed or a current in [columns]"
        )
    if rule.kind == "hold" and "t" not in signals:
        return _hold(where, name, rule, signals, identification, remarks)
    if "t" not in signals:
        raise StudyError(f"{where}: {_heading(identification, 't')}: missing: expected the time of each row")
    if len(signals["t"]) < TIMED_ROWS_LEAST:
        raise StudyError(f"{where}: {len(signals['t'])} rows: expected {TIMED_ROWS_LEAST} or more")
    return _timed(where, name, rule, signals, identification, after_loss, remarks)


def _before_a_column_ends(
    name: str, columns: Columns, identification: Identification, remarks: list[str]
) -> Columns:
    """The rows up to the end of the shortest column; a remark names a column that ends before the log."""
    heading_t = _heading(identification, "t")
    ends = {heading: len(of) - int(np.argmax(~np.isnan(of)[::-1])) for heading, of in columns.items()}
    heading, end = min(ends.items(), key=lambda item: item[1])
    if heading_t not in columns or min(end, len(columns[heading_t]) - end) < TIMED_ROWS_LEAST:
        return columns
    time = identification.factor("t") * columns[heading_t]
    first, last, whole = (np.nan_to_num(time[row]) for row in (0, end - 1, -1))
    remarks.append(ended_early(f'{name}: "{printable(heading)}"', last - first, "the log", whole - first))
    return {heading: of[:end] for heading, of in columns.items()}


def ended_early(channel: str, end: float, others: str, other_end: float) -> str:
    """The remark on a channel that ends before others of its log. `end`, `other_end`: s after the start."""
    return (
        f"{channel} ends at {end:.4g} s, {others} at {other_end:.4g} s: rows after {end:.4g} s are left out."
    )


def _complete(
    where: str, name: str, columns: Columns, remarks: list[str]
) -> tuple[Columns, NDArray[np.bool_]]:
    """The rows in which every column has a number, and for each row whether rows just before are left out."""
    lacking = {heading: np.isnan(values) for heading, values in columns.items()}
    whole = ~np.logical_or.reduce(list(lacking.values()))
    counts = {heading: int(np.sum(lacks)) for heading, lacks in lacking.items() if lacks.any()}
    lacking_text = ", ".join(f'{count} in "{printable(heading)}"' for heading, count in counts.items())
    if counts and np.sum(whole) < TIMED_ROWS_LEAST:
        raise StudyError(
            f"{where}: {np.sum(whole)} of {len(whole)} rows have a number in every column (lacking: "
            f"{lacking_text}): expected {TIMED_ROWS_LEAST} or more, so log the columns together or leave one "
            "out of [columns]"
        )
    if counts:
        remarks.append(f"{name}: {np.sum(~whole)} rows lack a number ({lacking_text}) and are left out.")
    rows = np.flatnonzero(whole)
    return {heading: values[whole] for heading, values in columns.items()}, np.diff(rows, prepend=-1) > 1


def _by_measured_angle(signals: Columns, true: Array, pole_pairs: int) -> None:
    """Turn a run's true currents into those of its drive, which computes them by the measured angle."""
    currents = (signals["i_d"] + 1j * signals["i_q"]) * np.exp(-1j * pole_pairs * (signals["theta"] - true))
    signals["i_d"], signals["i_q"] = currents.real, currents.imag


def _heading(identification: Identification, signal: str) -> str:
    return identification.columns[signal].name if signal in identification.columns else f"columns.{signal}"


def _hold(
    where: str, name: str, rule: LogRule, signals: Columns, identification: Identification, remarks: list[str]
) -> Log:
    for signal in ("theta", "i_q", "direction"):
        if signal not in signals:
            expected = "a hold map needs theta, i_q and direction (1 or -1: from which side the rotor came)"
            raise StudyError(f"{where}: {_heading(identification, signal)}: missing: {expected}")
    signals["direction"] = np.sign(signals["direction"])
    stretches = (slice(0, len(signals["theta"])),)
    return Log(name, rule, dt=0.0, signals=signals, stretches=stretches, remarks=remarks)


def _one_clock(name: str, t: Array, identification: Identification, remarks: list[str]) -> Array:
    """The time without the restarts of a counter of 16 or 32 bits, or of a day.

    Each restart must take one period off the time, within some rows; else the time stays as it is.
    """
    steps = np.diff(t)
    back = np.flatnonzero(steps < 0)
    if not len(back):
        return t
    forward = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    tick = identification.factor("t")
    for period in (2**16 * tick, 2**32 * tick, COUNTER_SECONDS, DAY_SECONDS):
        missing = steps[back] + period
        if np.all((missing > 0) & (missing < CLOCK_ROWS_MOST * forward)):
            remarks.append(
                f"{name}: the time begins again {len(back)} times, after {period:.7g} s; the parts are "
                "joined end to end."
            )
            turns = np.zeros(len(t))
            turns[back + 1] = period
            return np.asarray(t + np.cumsum(turns))
    return t


def _without_bursts(name: str, t: Array, signals: Columns, remarks: list[str]) -> Array:
    """Even times, by the number of the row, if rows share the stamps of packets; else the time as it is.

    The rows of packets were evenly sampled: the angle moves as much between two packets as within one. With a
    triggered recorder the angle moves more between bursts. A packet arrives after its last row, with some
    jitter. If the packets that follow stay late by half a packet, one was lost, and the time jumps.
    """
    steps = np.diff(t)
    first = np.concatenate(([0], np.flatnonzero(steps > np.mean(steps)) + 1))
    moved = np.abs(np.angle(np.exp(1j * np.diff(signals["theta"])))) if "theta" in signals else np.zeros(0)
    between = np.zeros(len(steps), dtype=bool)
    between[first[1:] - 1] = True
    if (
        len(first) < BURSTS_LEAST
        or len(t) < BURST_ROWS * len(first)
        or np.sum(steps[~between]) > BURST_TIME * np.sum(steps)
        or not len(moved)
        or not 0 < np.mean(moved[between]) < BURST_MOVE * np.mean(moved[~between])
    ):
        return t
    last = np.concatenate((first[1:] - 1, [len(t) - 1]))
    sizes = np.diff(last)
    arrival = t[first]
    period = float(np.median(np.diff(arrival) / sizes))
    delay, lost_least = arrival - period * last, LOST_SHARE * period * float(np.median(sizes))
    later = np.zeros(len(first))
    late = np.minimum(np.diff(delay), np.diff(arrival - period * first))
    for burst in np.flatnonzero(late > lost_least) + 1:
        before = delay[max(0, burst - BURSTS_BESIDE) : burst]
        step = float(np.median(delay[burst : burst + BURSTS_BESIDE]) - np.median(before))
        if step > lost_least:
            later[burst] = step
    lost = np.cumsum(later)
    slope, start = np.polyfit(last, arrival - lost, 1)
    if np.std(arrival - lost - slope * last) > UNEVEN_SHARE * slope * np.median(sizes):
        return t
    remarks.append(
        f"{name}: rows come in {len(first)} bursts of {len(t) / len(first):.3g}, as when sent in packets; "
        "they "
        f"are taken as evenly spaced, {1e3 * slope:.4g} ms apart."
    )
    return np.asarray(start + slope * np.arange(len(t)) + np.repeat(lost, np.diff(first, append=len(t))))


def _timed(
    where: str,
    name: str,
    rule: LogRule,
    signals: Columns,
    identification: Identification,
    after_loss: NDArray[np.bool_],
    remarks: list[str],
) -> Log:
    t = _one_clock(name, signals.pop("t"), identification, remarks)
    back = np.flatnonzero(np.diff(t) < 0)
    if len(back):
        at = back[0] + 2
        raise StudyError(
            f"{where}: {_heading(identification, 't')}: row {at}: the time goes back: expected one clock, "
            "or a file for each recording"
        )
    t = _without_bursts(name, t, signals, remarks)
    keep = np.concatenate(([True], np.diff(t) > 0))
    if np.mean(keep) < 0.5:
        raise StudyError(
            f"{where}: {_heading(identification, 't')}: {np.sum(~keep)} of {len(t)} rows have "
            "the time of the row before: expected all digits of the time"
        )
    if not keep.all():
        remarks.append(f"{name}: {np.sum(~keep)} rows have the time of the row before and are left out.")
        t, signals = t[keep], {signal: values[keep] for signal, values in signals.items()}
        after_loss = after_loss[keep]
    dt = float(np.median(np.diff(t)))
    ends = np.flatnonzero(np.diff(t) > np.where(after_loss[1:], ROW_LOST, GAP_PERIODS) * dt) + 1
    edges = [0, *ends.tolist(), len(t)]
    if len(ends):
        longest = float(np.max(np.diff(t)))
        remarks.append(f"{name}: {len(ends)} gaps, the longest {longest:.3g} s; the log is cut at each gap.")
    _within_limit(where, signals, identification)
    _amplitudes_agree(where, signals, identification)
    if "theta" in signals:
        _degrees(where, t, signals, identification)
        raw = signals["theta"]
        column, tick = _heading(identification, "theta"), abs(identification.factor("theta"))
        signals["theta"] = _unwrapped(name, f"{where}: {column}", signals["theta"], ends, remarks, tick)
        whole = _slip(name, signals["theta"], identification.step, ends, remarks)
        if whole < TIMED_ROWS_LEAST:
            heading = _heading(identification, "theta")
            jumps = f"{where}: {heading}: row {whole + 1}: the angle jumps after only {whole} rows"
            degrees = np.unwrap(np.radians(raw))
            has_unit = bool(identification.columns["theta"].unit)
            if not has_unit and _slip(name, degrees, identification.step, ends, []) == len(t):
                units = {"theta": "deg", **({"omega": "deg/s"} if "omega" in signals else {})}
                cure = {f"columns.{signal}.unit": unit for signal, unit in units.items()}
                lines = " and ".join(f'{key} = "{unit}"' for key, unit in cure.items())
                raise AdvisedError(
                    Advice(
                        f"{jumps}; with the unit deg it does not jump: expected {lines}",
                        cure,
                    )
                )
            raise StudyError(
                f"{jumps}: expected {TIMED_ROWS_LEAST} or more before a jump, "
                "and an encoder's angle, not one of Hall sensors"
            )
        t, signals = t[:whole], {signal: values[:whole] for signal, values in signals.items()}
        _units_agree(where, t, signals, identification)
        edges = [*(edge for edge in edges if edge < len(t)), len(t)]
        _repeats(name, signals, identification.step, remarks)
    parts: list[Columns] = []
    spreads: dict[str, float] = {}
    for first, last in pairwise(edges):
        if last - first >= TIMED_ROWS_LEAST:
            part, use = _even(t[first:last], {s: v[first:last] for s, v in signals.items()}, dt)
            parts.append(part)
            spreads[use] = max(spreads.get(use, 0.0), float(np.std(np.diff(t[first:last]))))
    if not parts:
        raise StudyError(
            f"{where}: fewer than {TIMED_ROWS_LEAST} rows between its gaps: expected a log with fewer gaps"
        )
    apart = f"rows are {1e3 * _period(t, dt):.3g} ms apart"
    remarks += [
        f"{name}: {apart}, with a spread of {1e3 * spread:.2g} ms rms; {use}."
        for use, spread in spreads.items()
        if spread > SPREAD_LEAST * dt
    ]
    joined = {s: np.concatenate([part[s] for part in parts]) for s in parts[0]}
    if "theta" in joined:
        offset = (
            0.5 * identification.step if identification.angle_offset is None else identification.angle_offset
        )
        joined["theta"] = joined["theta"] + offset
    starts = np.cumsum([0, *(len(next(iter(part.values()))) for part in parts)])
    stretches = tuple(slice(int(a), int(b)) for a, b in pairwise(starts))
    return Log(
        name,
        rule,
        dt=_period(t, dt),
        signals=joined,
        stretches=stretches,
        remarks=remarks,
        mean_current="i_q" in identification.columns and identification.columns["i_q"].mean,
    )


def _within_limit(where: str, signals: Columns, identification: Identification) -> None:
    """Refuse a current far above the drive's limit: its unit must be another."""
    limit = identification.drive.current_loop.current_limit
    for signal in CURRENTS:
        most = float(np.max(np.abs(signals.get(signal, 0.0))))
        if most > CURRENT_RATIO_MOST * limit:
            raise AdvisedError(
                Advice(
                    f"{where}: {_heading(identification, signal)}: "
                    f"row {np.argmax(np.abs(signals[signal])) + 1}: "
                    f"{most:.3g} A, where the drive's limit is {limit:.3g} A: expected the column's "
                    'unit, such as unit = "mA"',
                    {f"columns.{current}.unit": "mA" for current in CURRENTS if current in signals},
                )
            )


def _amplitudes_agree(where: str, signals: Columns, identification: Identification) -> None:
    """Refuse i_q and i_d in rms amperes: they are 1/sqrt(2) of the amplitude of the phase currents."""
    if not {"i_q", "i_a", "i_b"} <= signals.keys():
        return
    i_q, i_a, i_b = (_heading(identification, signal) for signal in ("i_q", "i_a", "i_b"))
    a, b = signals["i_a"], signals["i_b"]
    phases = np.sqrt(2 / 3 * (a**2 + b**2 + signals.get("i_c", -a - b) ** 2))
    seen = np.hypot(signals["i_q"], signals.get("i_d", 0.0))
    square, other = float(phases @ phases), float(seen @ seen)
    ratio = float(seen @ phases) / square if square else 0.0
    alike = ratio * np.sqrt(square / other) if other else 0.0  # 1: in proportion
    if alike > IN_PROPORTION and abs(np.sqrt(2) * ratio - 1) < 1 - IN_PROPORTION:
        raise AdvisedError(
            Advice(
                f"{where}: {i_q} is {ratio:.3g} of the amplitude that {i_a} and {i_b} have, as if it "
                f"were rms: expected peak amperes: {identification.columns['i_q'].name} with scale = 1.41421 "
                f"in {identification.described_in}",
                {
                    "columns.i_q.scale": 1.41421,
                    **({"columns.i_d.scale": 1.41421} if "i_d" in signals else {}),
                },
            )
        )


def _degrees(where: str, t: Array, signals: Columns, identification: Identification) -> None:
    """Refuse an angle in degrees here: later its large changes would look like wraps or a slipped index.

    The median over the faster half of the rows is free of the rows in which the angle wraps.
    """
    if "omega" not in signals:
        return
    turned = 0.5 * (signals["omega"][1:] + signals["omega"][:-1]) * np.diff(t)
    moved = np.diff(signals["theta"])
    rows = (np.abs(turned) >= np.median(np.abs(turned))) & (moved != 0)
    ratio = float(np.median(turned[rows] / moved[rows])) if np.any(rows) else 0.0
    in_degrees = [
        mistake for mistake in (*UNIT_MISTAKES, *_electrical(identification)) if "theta" in str(mistake[2])
    ]
    likely = [
        (says, cure)
        for factor, says, cure in in_degrees
        if factor < 0.5 / TURN and abs(ratio / factor - 1) < 0.05
    ]
    if likely:
        raise _disagreement(where, ratio, likely, identification)


def _disagreement(
    where: str, ratio: float, likely: Sequence[tuple[str, Cure]], identification: Identification
) -> AdvisedError:
    names = [_heading(identification, signal) for signal in ("omega", "theta", "t")]
    cures = f"; {', or '.join(says for says, _ in likely)}" if likely else ""
    return AdvisedError(
        Advice(
            f"{where}: {names[0]} is {ratio:.4g} times the change of {names[1]} over {names[2]}: "
            f"expected units that agree{cures}",
            *(cure for _, cure in likely),
        )
    )


def _units_agree(where: str, t: Array, signals: Columns, identification: Identification) -> None:
    """Refuse a speed that is not the angle's change in time: one of the three has another unit."""
    if "omega" not in signals:
        return
    omega, steps = signals["omega"], np.diff(t)
    whole = steps <= GAP_PERIODS * np.median(steps)  # over a gap the speed is not known
    moved, turned = np.diff(signals["theta"]), 0.5 * (omega[1:] + omega[:-1]) * steps
    way, sped = (x - np.mean(x) for x in (np.cumsum(moved[whole]), np.cumsum(turned[whole])))
    square = float(way @ way)
    if square < len(way) * max(MOTION_LEAST, 20 * identification.step) ** 2:
        return  # it hardly turns
    ratio = float(way @ sped) / square
    if not 1 / SPEED_RATIO_MOST < ratio < SPEED_RATIO_MOST:
        mistaken = (*UNIT_MISTAKES, *_electrical(identification), *_of_bits(identification))
        likely = [(says, cure) for factor, says, cure in mistaken if 0.95 < ratio / factor < 1.05]
        raise _disagreement(where, ratio, likely, identification)


def _electrical(identification: Identification) -> list[tuple[float, str, Cure]]:
    """Ratio, sentence and cure of an electrical angle or speed, pole pairs times the mechanical one."""
    poles, columns = identification.motor.pole_pairs, identification.columns
    if poles == 1:
        return []
    cures = {
        signal: {f"columns.{signal}.scale": float(f"{columns[signal].scale / poles:.10g}")}
        for signal in ("theta", "omega")
    }
    return [
        (1 / poles, f"the angle looks electrical: scale = 1/{poles}", cures["theta"]),
        (
            TURN / 360 / poles,
            f'the angle looks like electrical degrees: unit = "deg" and scale = 1/{poles}',
            {**cures["theta"], "columns.theta.unit": "deg"},
        ),
        (poles, f"the speed looks electrical: scale = 1/{poles}", cures["omega"]),
        (
            poles / RPM,
            f'the speed looks like electrical rpm: unit = "rpm" and scale = 1/{poles}',
            {**cures["omega"], "columns.omega.unit": "rpm"},
        ),
    ]


def _of_bits(identification: Identification) -> list[tuple[float, str, Cure]]:
    """Ratio, sentence and cure of an angle in counts of a sensor with another number of bits."""
    bits = getattr(identification.drive.position_sensor, "bits", None)
    if identification.columns["theta"].unit != COUNT or bits is None:
        return []
    return [
        (
            2.0 ** (bits - other),
            f"the counts look like those of drive.position_sensor.bits = {other}",
            {"drive.position_sensor.bits": other},
        )
        for other in range(1, 33)
        if other != bits
    ]


def _period(t: Array, dt: float) -> float:
    """Mean time between rows where there is no gap, s."""
    steps = np.diff(t)
    return float(np.mean(steps[steps <= GAP_PERIODS * dt]))


def _even(t: Array, signals: Columns, dt: float) -> tuple[Columns, str]:
    """Bring rows to equal times; returns them and how each row's time was used, for a remark.

    If the jitter of the times is no larger than the steps to which they are rounded, they count as even.
    """
    k = np.arange(len(t))
    slope, start = np.polyfit(k, t - t[0], 1)
    off = t - t[0] - (start + slope * k)
    jitter = float(np.std(off))
    grain = float(np.min(np.diff(np.unique(np.round(np.diff(t), 9))), initial=np.inf))
    if jitter < 0.02 * dt or (np.isfinite(grain) and grain > 0.1 * dt and jitter <= grain):
        return signals, EVEN_ROWS
    even = np.arange(t[0], t[-1], slope)
    return {signal: np.interp(even, t, values) for signal, values in signals.items()}, OWN_TIMES


def _moved(theta: Array, ends: NDArray[np.int_]) -> Array:
    """The angle's change from row to row, rad; 0 over a gap, in which a rotor may move by any angle."""
    moved = np.diff(theta)
    moved[ends - 1] = 0.0
    return moved


def _unwrapped(
    name: str, where: str, theta: Array, ends: NDArray[np.int_], remarks: list[str], tick: float
) -> Array:
    """The angle without jumps by a turn or by the size of a counter. `tick`: angle of one count, rad."""
    moved = np.abs(_moved(theta, ends))
    jumps = np.flatnonzero(moved > 0.5 * TURN)
    for size in (2**16, 2**32):
        if len(jumps) and size * tick > TURN and np.all(np.abs(moved[jumps] - size * tick) < 0.5 * TURN):
            remarks.append(f"{name}: the count overflows {len(jumps)} times, at {size}, and is unwrapped.")
            return np.unwrap(theta, period=size * tick)
    alike = len(jumps) > 1 and np.ptp(moved[jumps]) < 0.1 * np.min(moved[jumps])
    if alike and np.min(moved[jumps]) > 1.5 * TURN:
        raise StudyError(
            f"{where}: row {jumps[0] + 2}: the angle jumps by {moved[jumps[0]]:.4g} rad, which is not a "
            "whole turn: "
            'expected its unit, such as unit = "deg", or counts that do not overflow'
        )
    if len(jumps):
        remarks.append(f"{name}: the angle wraps {len(jumps)} times, and is unwrapped.")
    return np.unwrap(theta)


def _repeats(name: str, signals: Columns, step: float, remarks: list[str]) -> None:
    moved = abs(np.diff(signals["theta"]))
    if np.mean(moved) < 2 * step:
        return  # so slow that a count lasts longer than a row
    same = np.logical_and.reduce(
        [np.diff(signals[s]) == 0 for s in signals if s in ("theta", "omega", "i_q")]
    )
    if np.mean(same) > REPEATED_SHARE:
        remarks.append(
            f"{name}: {100 * np.mean(same):.0f} % of the rows repeat the row before: the log has more rows "
            "than the drive has samples."
        )


def _slip(name: str, theta: Array, step: float, ends: NDArray[np.int_], remarks: list[str]) -> int:
    """Count of rows before the angle first moves far more than in the rows around; all rows if it never does.

    `ends`: the first row after each gap.
    """
    moved = _moved(theta, ends)
    around = np.max([np.abs(np.roll(moved, rows)) for rows in (-2, -1, 1, 2)], axis=0)
    jumps = np.flatnonzero(np.abs(moved) > 10 * around + 20 * step + 1e-3)
    if not len(jumps):
        return len(theta)
    at, size = int(jumps[0]) + 1, np.degrees(moved[jumps[0]])
    remarks.append(
        f"{name}: row {at + 1}: the angle jumps by {size:.2g} deg: the encoder's index has slipped, or "
        "counts are lost; the rows after it are left out."
    )
    return at
