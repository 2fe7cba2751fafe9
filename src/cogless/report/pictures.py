"""Still pictures as PNG files, drawn from the page's charts.

A speed scenario has waveforms, order spectra, learned maps, and a revolution before and after. A trial
scenario has RMS over trials, chosen trials, certificates.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from cogless.files import replacing
from cogless.report.charts import (
    Changed,
    Chart,
    Curve,
    OverAngle,
    OverFrequency,
    OverGrid,
    OverTrials,
    Span,
    Spectrum,
    SpeedCharts,
    TrialCharts,
    TrialPanel,
    TrialWaveforms,
    Waveforms,
    Zoom,
)
from cogless.report.markup import asset, colours
from cogless.results import AnyResults
from cogless.results.results_json import run_id
from cogless.results.trace import Array

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

    rows: Callable[[Any, Looks], list[list[Plot]]]  # from all charts of a scenario
    height: float
    widths: tuple[int, ...] = ()  # default: equal


def name(scenario: str, kind: str) -> str:
    """The file name of a scenario's picture."""
    return f"{scenario}-{kind}.png"


def write_plots(
    results: AnyResults, drawn: Sequence[Any], pictures: Mapping[str, Picture], directory: Path
) -> list[Path]:
    """Write SCENARIO-KIND.png of each kind of picture that has a plot; return the paths.

    `drawn`: each scenario's charts. matplotlib is imported only here, because the import takes longer than
    drawing.
    """
    import matplotlib

    palette = re.findall(r"--c\d: (#\w+);", asset("report.css"))  # the light theme's colours come first
    looks = [{"color": palette[n], "label": results.study.label(c)} for c, n in colours(results).items()]
    written, run = [], run_id(results)
    with matplotlib.rc_context(STYLE):
        for scenario, charts in zip(results.scenarios, drawn, strict=True):
            for kind, picture in pictures.items():
                rows = picture.rows(charts, looks)
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
        # savefig would draw the figure twice: once for the layout
        metadata = {"Run": run, "Series": json.dumps(_series(axes))}
        FigureCanvasAgg(figure).print_png(temporary, metadata=metadata)  # type: ignore[no-untyped-call]


def _series(axes: Any) -> list[list[float]]:
    """Least and largest value of each curve or group of bars; pictures of different numbers differ here."""
    drawn = [np.asarray(line.get_ydata(), float) for ax in axes.flat for line in ax.lines]
    drawn += [np.array([bar.get_height() for bar in group]) for ax in axes.flat for group in ax.containers]
    finite = (y[np.isfinite(y)] for y in drawn)
    return [[float(f"{end:.4g}") for end in (np.min(y), np.max(y))] for y in finite if y.size]


def times(start: float, step: float, values: Array) -> Array:
    """Times, s, of values at a constant step."""
    return np.asarray(start + step * np.arange(len(values)))


def plot(chart: Chart, x: str, draw: Callable[..., None], *arguments: Any) -> Plot:
    """The plot of one of the page's charts or panels, drawn by draw(chart, *arguments, axes)."""
    return Plot(partial(draw, chart, *arguments), x, chart.y, chart.title)


def stack(charts: Sequence[Chart], draw: Callable[..., None], *arguments: Any) -> list[list[Plot]]:
    """Rows with one plot each, for charts of the page."""
    return [[plot(chart, chart.x or "", draw, *arguments)] for chart in charts]


def _waveforms(charts: SpeedCharts, looks: Looks) -> list[list[Plot]]:
    """Each panel twice: over the run after its start-up, and over its first fault or else last revolution."""
    waves = charts.waveforms
    zooms = {zoom.name: zoom for zoom in charts.zooms}
    begun = "after start-up" if "after start-up" in zooms else "whole run"
    fault = next((name for name in zooms if name.startswith("fault at ")), "last revolution")
    names = [name for name in (begun, fault) if name in zooms]
    return [
        [plot(panel, f"{waves.x}, {name}", _panel, waves, zooms[name], charts.marks, looks) for name in names]
        for panel in waves.panels
    ]


def _panel(panel: Chart, waves: Waveforms, zoom: Zoom, marks: Sequence[Span], looks: Looks, ax: Any) -> None:
    begin, end = zoom.begin, zoom.end
    for series in panel.series:
        x, y = _finest(waves, series, zoom)
        inside = (x >= begin) & (x <= end)
        look = REFERENCE if series.dash else looks[series.controller]
        ax.plot(x[inside], y[inside], **look)
    for mark in marks:
        if mark.begin < end and mark.end > begin:
            ax.axvspan(max(mark.begin, begin), min(mark.end, end), color="#b3401f", alpha=0.13)


def _finest(waves: Waveforms, series: Curve, zoom: Zoom) -> tuple[Array, Array]:
    """Times and values of the finer points that cover a zoom, or else those of the whole run."""
    for grid, y in zip(waves.details, series.details or (), strict=True):
        end = grid.start + grid.step * len(y)
        if grid.start - waves.step <= zoom.begin and zoom.end <= end + waves.step:
            return times(grid.start, grid.step, y), y
    return times(waves.start, waves.step, series.values), series.values


def _revolution(charts: SpeedCharts, looks: Looks) -> list[list[Plot]]:
    """The answer's first chart: before and after, each with its number large above it."""
    return [[replace(row[0], title="")] for row in stack(charts.answer[:1], _before_and_after, looks)]


def _before_and_after(chart: OverGrid, looks: Looks, ax: Any) -> None:
    for k, series in enumerate(chart.series):
        look = looks[series.controller]
        x = times(chart.start, chart.step, series.values)
        ax.plot(x, series.values, **{**look, "linewidth": (0.9, 1.8)[min(k, 1)]})
        where = {"transform": ax.transAxes, "va": "bottom", "color": look["color"]}
        ax.text(0.32 * k, 1.11, look["label"], **where)
        ax.text(0.32 * k, 1.01, series.text, fontsize=17, fontweight="bold", **where)


def _bars(chart: Spectrum, looks: Looks, ax: Any) -> None:
    places = range(len(chart.orders))
    width = 0.78 / len(chart.series)
    for k, series in enumerate(chart.series):
        middles = [i + (k - len(chart.series) / 2 + 0.5) * width for i in places]
        ax.bar(middles, np.nan_to_num(series.values), 0.92 * width, **looks[series.controller])
    ax.set_xticks(places, [str(order) for order in chart.orders])
    ax.margins(x=0.05)
    ax.grid(axis="x", visible=False)


def _map(chart: OverAngle, looks: Looks, ax: Any) -> None:
    for series in chart.series:
        ax.plot(chart.angle, series.values, **looks[series.controller])


SPEED_PICTURES = {
    "waveforms": Picture(_waveforms, 1.7, (2, 1)),
    "spectra": Picture(lambda charts, looks: stack(charts.spectra, _bars, looks), 2.6),
    "map": Picture(lambda charts, looks: stack(charts.maps, _map, looks), 2.6),
    "revolution": Picture(_revolution, 3.4),
}


MOST_COLUMNS = 4  # phases whose first trial is drawn
FAINT = "#5c6570"


def _rms(charts: TrialCharts, looks: Looks) -> list[list[Plot]]:
    return stack(charts.over_trials.charts, _over_trials, charts.over_trials.marks, looks)


def _over_trials(chart: OverTrials, marks: Sequence[Changed], looks: Looks, ax: Any) -> None:
    for series in chart.series:
        y = 10**series.values
        ax.plot(np.arange(1, len(y) + 1), y, **looks[series.controller])
    ax.set_yscale("log")
    if chart.floor is not None:
        ax.axhline(chart.floor, color=FAINT, linestyle="--", linewidth=0.8)
        where = {"xycoords": ("axes fraction", "data"), "va": "bottom", "ha": "right"}
        ax.annotate(chart.floor_name, (0.995, chart.floor), fontsize=8, **where)
    for row, mark in enumerate(marks):
        ax.axvline(mark.trial, color=FAINT, linestyle=":", linewidth=0.8)
        where = {"xycoords": ("data", "axes fraction"), "va": "top", "textcoords": "offset points"}
        ax.annotate(mark.name, (mark.trial, 1 - 0.06 * (row % 4)), (3, 0), fontsize=8, **where)


def _trials(charts: TrialCharts, looks: Looks) -> list[list[Plot]]:
    """A column of plots for the first trial of each phase, with all controllers in each plot."""
    waves = charts.waveforms
    return [
        [
            plot(panel, fill(f"{waves.x}; {phase.name}", 32), _trial, waves, column, looks)
            for column, phase in enumerate(waves.phases[:MOST_COLUMNS])
        ]
        for panel in waves.panels
    ]


def _trial(panel: TrialPanel, waves: TrialWaveforms, column: int, looks: Looks, ax: Any) -> None:
    first = str(waves.phases[column].trials[0])
    curves = [(series.trials[first], looks[series.controller]) for series in panel.series]
    curves += [(y, REFERENCE) for y in panel.references[column : column + 1]]
    for y, look in curves:
        ax.plot(times(waves.start, waves.step, y), y, **look)


def _factors(chart: OverFrequency, looks: Looks, ax: Any) -> None:
    for series in chart.series:
        dashed = {"linestyle": "--", "label": None} if series.dash else {}
        ax.plot(chart.frequency, series.values, **(looks[series.controller] | dashed))
    ax.axhline(1, color=FAINT, linewidth=1)
    ax.set_xscale("log")
    ax.set_ylim(bottom=0)


TRIAL_PICTURES = {
    "rms": Picture(_rms, 3.4),
    "trials": Picture(_trials, 1.7),
    "certificate": Picture(lambda charts, looks: stack(charts.certificate, _factors, looks), 2.6),
}
