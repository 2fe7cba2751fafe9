"""Still pictures of a trial scenario: RMS over trials, chosen trials, certificates."""

from __future__ import annotations

from textwrap import fill
from typing import Any

import numpy as np

from cogless.report.packing import unpack
from cogless.report.png import REFERENCE, Data, Looks, Picture, Plot, plot, stack, times

MOST_COLUMNS = 4  # phases whose first trial is drawn
FAINT = "#5c6570"


def _rms(data: Data, looks: Looks) -> list[list[Plot]]:
    over = data["over_trials"]
    return stack(over["charts"], _over_trials, over["marks"], looks)


def _over_trials(chart: Data, marks: list[Data], looks: Looks, ax: Any) -> None:
    for series in chart["series"]:
        y = 10 ** unpack(series["values"])
        ax.plot(np.arange(1, len(y) + 1), y, **looks[series["controller"]])
    ax.set_yscale("log")
    if "floor" in chart:
        ax.axhline(chart["floor"], color=FAINT, linestyle="--", linewidth=0.8)
        where = {"xycoords": ("axes fraction", "data"), "va": "bottom", "ha": "right"}
        ax.annotate(chart["floor_name"], (0.995, chart["floor"]), fontsize=8, **where)
    for row, mark in enumerate(marks):
        ax.axvline(mark["trial"], color=FAINT, linestyle=":", linewidth=0.8)
        where = {"xycoords": ("data", "axes fraction"), "va": "top", "textcoords": "offset points"}
        ax.annotate(mark["name"], (mark["trial"], 1 - 0.06 * (row % 4)), (3, 0), fontsize=8, **where)


def _trials(data: Data, looks: Looks) -> list[list[Plot]]:
    """A column of plots for the first trial of each phase, with all controllers in each plot."""
    waves = data["waveforms"]
    return [
        [
            plot(panel, fill(f"{waves['x']}; {phase['name']}", 32), _trial, waves, column, looks)
            for column, phase in enumerate(waves["phases"][:MOST_COLUMNS])
        ]
        for panel in waves["panels"]
    ]


def _trial(panel: Data, waves: Data, column: int, looks: Looks, ax: Any) -> None:
    first = str(waves["phases"][column]["trials"][0])
    curves = [(series["trials"][first], looks[series["controller"]]) for series in panel["series"]]
    curves += [(packed, REFERENCE) for packed in panel["references"][column : column + 1]]
    for packed, look in curves:
        y = unpack(packed)
        ax.plot(times(waves, y), y, **look)


def _factors(chart: Data, looks: Looks, ax: Any) -> None:
    for series in chart["series"]:
        dashed = {"linestyle": "--", "label": None} if series.get("dash") else {}
        ax.plot(chart["frequency"], unpack(series["values"]), **(looks[series["controller"]] | dashed))
    ax.axhline(1, color=FAINT, linewidth=1)
    ax.set_xscale("log")
    ax.set_ylim(bottom=0)


PICTURES = {
    "rms": Picture(_rms, 3.4),
    "trials": Picture(_trials, 1.7),
    "certificate": Picture(lambda data, looks: stack(data["certificate"], _factors, looks), 2.6),
}
