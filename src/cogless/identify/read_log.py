"""Read a log file of any kind: its columns as numbers, of one length, without gaps."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.files import no_device
from cogless.identify.binary_log import read_mat, read_npz, read_parquet, read_trace
from cogless.identify.csv_log import read_csv
from cogless.identify.log_files import Columns, LogColumns, no_numbers, readable
from cogless.identify.mdf_log import read_mdf
from cogless.results.trace import Array

NUMBER_BELOW = 1e30  # limit in any unit: the universe is 4e26 ns old; the square of a number is still finite

READERS: dict[str, Callable[[Path, list[str]], list[LogColumns]]] = {
    ".csv": read_csv,
    ".txt": read_csv,
    ".tsv": read_csv,
    ".npz": read_npz,
    ".parquet": read_parquet,
    ".mat": read_mat,
    ".mf4": read_mdf,
    ".nc": read_trace,
}


def read(path: Path, headings: list[str], *, with_gaps: bool = False) -> list[LogColumns]:
    """The columns with these headings of each log in a file. A trace file has several logs, others have one.

    A column that isn't there is left out. `with_gaps`: cells without a number are allowed, as NaN.
    StudyError names file, column and row.
    """
    name = path.name.lower()
    suffix = Path(name.removesuffix(".gz") if name.endswith(".csv.gz") else name).suffix
    reader = READERS.get(suffix)
    if reader is None:
        raise StudyError(f"{path}: unknown kind of file: expected one of {', '.join(READERS)}, .csv.gz")
    with readable(path, suffix):
        no_device(path)
        os.stat(path)
    logs = reader(path, headings)
    if not logs:
        raise StudyError(f"{path}: no runs: expected a log")
    return [replace(log, columns=_numbers(path, log, with_gaps)) for log in logs]


def _numbers(path: Path, log: LogColumns, with_gaps: bool) -> Columns:
    columns = {name: _as_numbers(path, name, values) for name, values in log.columns.items()}
    lengths = {len(values) for values in columns.values()}
    if lengths == {0}:
        raise StudyError(f"{path}: no rows: expected a log")
    if len(lengths) > 1:
        raise StudyError(
            f"{path}: columns of {min(lengths)} and {max(lengths)} rows: expected columns of equal length"
        )
    for name, values in columns.items():
        wrong = np.flatnonzero(~(np.abs(values) < NUMBER_BELOW) & ~(with_gaps & np.isnan(values)))
        if len(wrong):
            value = values[wrong[0]]
            expected = f"a number below {NUMBER_BELOW:g}" if np.isfinite(value) else "a finite number"
            raise StudyError(
                f"{path}: {name}: row {wrong[0] + 1}: {value}: expected {expected} "
                f"({len(wrong)} rows lack one)"
            )
    return columns


def _as_numbers(path: Path, name: str, values: NDArray[Any]) -> Array:
    if np.iscomplexobj(values):  # NumPy would take the real part.
        raise no_numbers(path, name)
    try:
        return np.asarray(values, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise no_numbers(path, name) from None
