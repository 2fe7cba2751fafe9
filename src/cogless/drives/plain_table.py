"""A cogging table as a CSV over the angle, for any drive, and for the key `start` of a law."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from cogless.drives.adapter import Adapter, Certainty, Feature, TableFrame, TableText
from cogless.drives.holding_current import HoldingCurrent, from_samples, samples
from cogless.errors import StudyError
from cogless.identify.read_log import read
from cogless.results.trace import Array

ANGLE_HEADING, CURRENT_HEADING = "angle [deg]", "current [A]"
TABLE_ROWS_LEAST, WAVE_ROWS = 360, 16  # rows in a table; in a wave of the highest order
SPACING_TOLERANCE = 1e-3  # share of the spacing


def write(current: HoldingCurrent, frame: TableFrame) -> TableText:
    """The holding current itself, at even angles of the identified frame."""
    count = max(TABLE_ROWS_LEAST, WAVE_ROWS * max(current.orders))
    values = samples(current, count, frame.direction, "linear")
    rows = (f"{360 * n / count:.9g},{value:.6g}" for n, value in enumerate(values))

    def applied(angle: Array) -> Array:
        place = np.mod(frame.direction * angle / math.tau, 1.0) * count
        return np.asarray(np.interp(place, np.arange(count + 1), np.append(values, values[0])))

    return TableText(
        "\n".join([f"{ANGLE_HEADING},{CURRENT_HEADING}", *rows]) + "\n",
        count,
        "each the current (peak A) that holds the rotor at a mechanical angle (deg)",
        applied,
        install='start = { table = "FILE", sign = "holding" } in a controller of a study; in firmware, add '
        "this current to i_q_ref",
        remove="delete that line",
        sign_check="add 30 % of the table, then -30 %, each at a slow speed: the ripple falls with the first "
        "and grows with the second",
    )


def read_table(path: Path, configuration: Path | None) -> HoldingCurrent:
    """A CSV that `write` wrote. StudyError: no such columns, or angles that aren't even over a revolution."""
    del configuration
    (log,) = read(path, [ANGLE_HEADING, CURRENT_HEADING])
    lacking = next((name for name in (ANGLE_HEADING, CURRENT_HEADING) if name not in log.columns), None)
    if lacking is not None:
        raise StudyError(f'{path}: no column "{lacking}": expected "{ANGLE_HEADING},{CURRENT_HEADING}"')
    angle, current = (np.asarray(log.columns[name]) for name in (ANGLE_HEADING, CURRENT_HEADING))
    spacing = 360 / len(angle)
    if np.any(np.abs(angle - spacing * np.arange(len(angle))) > SPACING_TOLERANCE * spacing):
        raise StudyError(f"{path}: {ANGLE_HEADING}: expected even angles from 0 to below 360")
    return from_samples(current, 0.0, str(path), "linear")


PLAIN_TABLE = Adapter(
    name="csv",
    title="a table as CSV",
    reads=(Feature("angle [deg], current [A]: a table that cogless wrote", Certainty.OWN),),
    writes=(Feature("angle [deg], current [A] that holds the rotor", Certainty.OWN),),
    write=write,
    read_table=read_table,
    own_angle=True,
)
