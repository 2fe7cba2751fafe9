"""Still pictures as PNG files: plots in rows and columns, from the page's data."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from cogless.files import replacing
from cogless.report.markup import asset
from cogless.report.packing import Array
from cogless.results import AnyResults
from cogless.results.results_json import run_id

Data = dict[str, Any]  # the page's data of a scenario, or of a chart in it
Looks = Sequence[dict[str, Any]]  # colour and label of each controller, for matplotlib

REFERENCE: dict[str, Any] = {"color": "#1b1f24", "linestyle": "--", "linewidth": 0.9, "zorder": 5}  # on top
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.xmargin": 0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e9ecf0",
    "lines.linewidth": 0.9,
    "legend.frameon": False,
    "figure.dpi": 130,
    "path.simplify": True,
}


@dataclass(frozen=True)
class Plot:
    """One plot; `draw` draws into its matplotlib axes."""

    draw: Callable[[Any], None]
    x: str = ""
    y: str = ""
    title: str = ""


@dataclass(frozen=True)
class Picture:
    """A kind of picture: its rows of plots, a row's height in inches, and the columns' relative widths."""

    rows: Callable[[Data, Looks], list[list[Plot]]]
    height: float
    widths: tuple[int, ...] = ()  # default: the same


def name(scenario: str, kind: str) -> str:
    """The file of a kind of picture."""
    return f"{scenario}-{kind}.png"


def write_plots(
    results: AnyResults, drawn: Data, pictures: Mapping[str, Picture], directory: Path
) -> list[Path]:
    """Write SCENARIO-KIND.png of each kind of picture that has a plot; return the paths.

    `drawn`: the page's data. matplotlib is imported only here, because the import takes longer than drawing.
    """
    import matplotlib

    palette = re.findall(r"--c\d: (#\w+);", asset("report.css"))  # the light theme's colours come first
    looks = [{"color": palette[c["colour"]], "label": c["label"]} for c in drawn["controllers"]]
    written, run = [], run_id(results)
    with matplotlib.rc_context(STYLE):
        for scenario, data in zip(results.scenarios, drawn["scenarios"], strict=True):
            for kind, picture in pictures.items():
                rows = picture.rows(data, looks)
                if rows and rows[0]:
                    written.append(directory / name(scenario, kind))
                    save(
                        written[-1],
                        f"{results.study.title}: {scenario}",
                        rows,
                        picture.height,
                        run,
                        picture.widths,
                    )
    return written


def save(
    path: Path,
    title: str,
    rows: Sequence[Sequence[Plot]],
    height: float,
    run: str,
    widths: Sequence[int] = (),
) -> None:
    """Write plots in rows of this height, inches, and columns of these relative widths (default: equal)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = len(rows[0])
    width = 9 if columns == 1 else 12
    figure = Figure(figsize=(width, 0.9 + height * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), columns, squeeze=False, width_ratios=widths[:columns] or None)
    handles: dict[str, Any] = {}
    for (row, column), ax in np.ndenumerate(axes):
        plot = rows[row][column]
        plot.draw(ax)
        # no label twice: an x label only if the plot below has another, title and y label only at the left
        if row + 1 == len(rows) or rows[row + 1][column].x != plot.x:
            ax.set_xlabel(plot.x)
        if not column:
            ax.set(ylabel=plot.y, title=plot.title)
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.suptitle(fill(title, 8 * width), x=0.01, ha="left", fontweight="bold")
    abreast = min(len(handles), 12 * width // (6 + max(map(len, handles), default=0)))
    figure.legend(handles.values(), handles.keys(), loc="outside lower left", ncols=max(1, abreast))
    with replacing(path) as temporary:
        # savefig would draw it twice: once for the layout
        about = {"Run": run, "Series": json.dumps(_series(axes))}
        FigureCanvasAgg(figure).print_png(temporary, metadata=about)  # type: ignore[no-untyped-call]


def _series(axes: Any) -> list[list[float]]:
    """Least and largest value of each curve or bar: two pictures that differ here show different numbers."""
    drawn = [np.asarray(line.get_ydata(), float) for ax in axes.flat for line in ax.lines]
    drawn += [np.array([bar.get_height() for bar in group]) for ax in axes.flat for group in ax.containers]
    finite = (y[np.isfinite(y)] for y in drawn)
    return [[float(f"{end:.4g}") for end in (np.min(y), np.max(y))] for y in finite if y.size]


def times(grid: Mapping[str, Any], values: Array) -> Array:
    """Times, s, of values on a grid of constant step."""
    return np.asarray(grid["start"] + grid["step"] * np.arange(len(values)))


def plot(chart: Data, x: str, draw: Callable[..., None], *arguments: Any) -> Plot:
    """The plot of one of the page's charts or panels, drawn by draw(chart, *arguments, axes)."""
    y = f"{chart['quantity']} ({chart['unit']})" if chart["unit"] else chart["quantity"]
    return Plot(partial(draw, chart, *arguments), x, y, chart["title"])


def stack(charts: Sequence[Data], draw: Callable[..., None], *arguments: Any) -> list[list[Plot]]:
    """Rows with one plot each, for charts of the page."""
    return [[plot(chart, chart["x"], draw, *arguments)] for chart in charts]
