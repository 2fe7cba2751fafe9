"""Still pictures of a study's results, as PNG: waveforms, order spectra, learnt maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless.files import replacing
from cogless.report import charts
from cogless.report.comparison import speed_unit
from cogless.report.packing import unpack
from cogless.results import Results

Axes = NDArray[Any]  # of matplotlib, rows x columns

# As in report.css, where --c0 is the baseline's.
PALETTE = ("#6a7380", "#0b6bcb", "#d9630c", "#13865a", "#9a3fb5", "#b58a00", "#c2255c", "#0c8599")
STYLE: dict[Any, Any] = {
    "font.size": 9,
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


def write_plots(results: Results, directory: Path) -> list[Path]:
    """Write SCENARIO-waveforms.png, -spectra.png and, if something was learnt, -map.png; return the paths.

    matplotlib is imported here: it takes longer than the pictures.
    """
    import matplotlib

    written = []
    with matplotlib.rc_context(STYLE):
        drawn = charts.data(charts.drawable(results), speed_unit(results))
        for scenario, data in zip(results.scenarios, drawn["scenarios"], strict=True):
            for kind, figure in (("waveforms", _waveforms), ("spectra", _spectra), ("map", _maps)):
                path = directory / f"{scenario}-{kind}.png"
                if figure(path, f"{results.study.title}: {scenario}", data, drawn["controllers"]):
                    written.append(path)
    return written


def _waveforms(path: Path, title: str, data: dict[str, Any], controllers: Sequence[dict[str, Any]]) -> bool:
    """Each panel twice: the run (after its start-up), and its last revolution."""
    times = data["waveforms"]
    zooms = {zoom["name"]: zoom for zoom in data["zooms"]}
    names = [name for name in ("after start-up", "whole run") if name in zooms][:1]
    names += [name for name in ("last revolution",) if name in zooms]

    def draw(axes: Axes) -> None:
        for row, panel in zip(axes, times["panels"], strict=True):
            for ax, name in zip(row, names, strict=True):
                _panel(ax, panel, times, zooms[name], controllers)
            row[0].set_ylabel(f"{panel['quantity']} ({panel['unit']})")
            row[0].set_title(panel["title"], loc="left", fontsize=9)
        for ax, name in zip(axes[-1], names, strict=True):
            ax.set_xlabel(f"{times['x']}, {name}")

    return _save(path, title, (len(times["panels"]), len(names)), 1.7, draw)


def _panel(
    ax: Any,
    panel: dict[str, Any],
    times: dict[str, Any],
    zoom: dict[str, Any],
    controllers: Sequence[dict[str, Any]],
) -> None:
    for series in panel["series"]:
        fine = "detail" in times and zoom["from"] >= times["detail"]["start"] - times["step"]
        grid = times["detail"] if fine else times
        y = unpack(series["detail" if fine else "values"])
        x = grid["start"] + grid["step"] * np.arange(len(y))
        inside = (x >= zoom["from"]) & (x <= zoom["to"])
        if series.get("dash"):
            ax.plot(x[inside], y[inside], "--", color="#5c6570", linewidth=0.8, zorder=5)
        else:
            ax.plot(x[inside], y[inside], **_look(controllers[series["controller"]]))
    ax.margins(x=0)


def _spectra(path: Path, title: str, data: dict[str, Any], controllers: Sequence[dict[str, Any]]) -> bool:
    def draw(axes: Axes) -> None:
        for ax, chart in zip(axes[:, 0], data["spectra"], strict=True):
            width = 0.78 / len(chart["series"])
            for k, series in enumerate(chart["series"]):
                left = [i + (k - len(chart["series"]) / 2 + 0.5) * width for i in range(len(chart["orders"]))]
                heights = [value or 0.0 for value in series["values"]]
                ax.bar(left, heights, 0.92 * width, **_look(controllers[series["controller"]]))
            ax.set_xticks(range(len(chart["orders"])), [str(order) for order in chart["orders"]])
            ax.grid(axis="x", visible=False)
            ax.set_title(chart["title"], loc="left", fontsize=9)
            ax.set_xlabel(chart["x"])
            ax.set_ylabel(f"{chart['quantity']} ({chart['unit']})")

    return _save(path, title, (len(data["spectra"]), 1), 2.6, draw)


def _maps(path: Path, title: str, data: dict[str, Any], controllers: Sequence[dict[str, Any]]) -> bool:
    def draw(axes: Axes) -> None:
        for ax, chart in zip(axes[:, 0], data["maps"], strict=True):
            for series in chart["series"]:
                ax.plot(chart["angle"], series["values"], **_look(controllers[series["controller"]]))
            ax.set_xlabel(chart["x"])
            ax.set_ylabel("current (A)")
            ax.set_xlim(0, 360)

    return _save(path, title, (len(data["maps"]), 1), 2.6, draw)


def _look(controller: dict[str, Any]) -> dict[str, Any]:
    return {"color": PALETTE[controller["colour"]], "label": controller["label"]}


def _save(
    path: Path, title: str, shape: tuple[int, int], height: float, draw: Callable[[Axes], None]
) -> bool:
    """Make a figure of rows and columns of axes, let `draw` fill them, write it. False: nothing to draw."""
    from matplotlib.figure import Figure

    rows, columns = shape
    if not rows:
        return False
    figure = Figure(figsize=(9 if columns == 1 else 12, 0.9 + height * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, width_ratios=(2, 1)[:columns])
    draw(axes)
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    handles: dict[str, Any] = {}
    for ax in axes.flat:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(handles.values(), handles.keys(), loc="outside lower left", ncols=len(handles))
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png")
    return True
