"""Columns of a drive's log by heading, and what is said of one that ends long before its others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cogless.errors import StudyError
from cogless.identify.files import LogColumns, printable
from cogless.identify.read_log import read

HEADINGS_SHOWN = 8


def read_columns(path: Path, names: Sequence[str], needed: Sequence[str], title: str) -> LogColumns:
    """The columns with these headings, those that are there. The first of `needed` is the time.

    Rows without a time are left out; other cells may lack their number, and are NaN. StudyError: one that is
    needed is missing, or a cell is no number.
    """
    (log,) = read(path, list(names), with_gaps=True)
    lacking = next((name for name in needed if name not in log.columns), None)
    if lacking is not None:
        others = ", ".join(map(printable, log.headings[:HEADINGS_SHOWN]))
        raise StudyError(f'{path}: no column "{lacking}"; it has {others}: expected a log of {title}')
    timed = ~np.isnan(log.columns[needed[0]])
    return replace(log, columns={name: values[timed] for name, values in log.columns.items()})
