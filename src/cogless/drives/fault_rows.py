"""Rows of a log in which the drive reports a fault, or has left the mode in which it controls the motor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cogless.errors import StudyError
from cogless.identify.read_log import read
from cogless.results.trace import Array

FAULT_ROWS_LEAST = 3  # rows before a fault; a log with fewer is of no use
LEFT_TIME_LEAST = 0.5  # s in another mode at a log's end; a shorter time is not reported


@dataclass(frozen=True, eq=False)
class Faults:
    """What a log says of faults: the number of rows before the first one, and a sentence on each finding."""

    rows: int
    remarks: Sequence[str]


def numbers(path: Path, headings: Sequence[str], time: str) -> dict[str, Array]:
    """The columns of flags, in the rows that have a time. Columns that hold words are left out."""
    columns: dict[str, Array] = {}
    for heading in headings:
        try:
            (log,) = read(path, [time, heading], with_gaps=True)
        except StudyError:
            continue
        if heading in log.columns:
            columns[heading] = np.nan_to_num(log.columns[heading][~np.isnan(log.columns[time])])
    return columns


def faults(
    path: Path, t: Array, flags: Mapping[str, Array], modes: Array | None = None, controls: int = 0
) -> Faults:
    """The rows before the first fault. StudyError: there are hardly any.

    `t`: s, from the first row. `flags`: by heading, not zero where there is a fault. `modes`: the
    drive's mode in each row, `controls` while it controls the motor.
    """
    rows, remarks = len(t), []
    for heading, flag in flags.items():
        bad = np.flatnonzero(flag[:rows])
        if not len(bad):
            continue
        first = int(bad[0])
        if first < FAULT_ROWS_LEAST:
            raise StudyError(
                f"{path}: {heading}: {flag[first]:g} in row {first + 1}: expected a log that begins without "
                "a fault"
            )
        at = f"{path.name}: {heading} is {flag[first]:g} from {t[first]:.3g} s on, a fault of the drive"
        rows, remarks = first, [f"{at}: the log is used up to this time."]
    if modes is not None:
        remarks += _mode_end(path, t[:rows], modes[:rows], controls)
    return Faults(rows, remarks)


def _mode_end(path: Path, t: Array, modes: Array, controls: int) -> list[str]:
    """A sentence where the drive leaves the mode in which it controls the motor, and does not come back."""
    controlled = np.flatnonzero(modes == controls)
    after = int(controlled[-1]) + 1 if len(controlled) else len(t)
    if after >= len(t) or t[-1] - t[after] < LEFT_TIME_LEAST:
        return []
    return [
        f"{path.name}: from {t[after]:.3g} s on the mode is {modes[after]:g} instead of {controls}: in this "
        "mode the drive does not control the motor."
    ]
