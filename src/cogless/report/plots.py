"""Still pictures of a study's results, as PNG: waveforms, order spectra, learned maps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cogless.report import charts
from cogless.report.comparison import speed_unit
from cogless.report.packing import Array, unpack
from cogless.report.png import REFERENCE, STYLE, Axes, look, save
from cogless.results import Results


def write_plots(results: Results, directory: Path) -> list[Path]:
    """Write SCENARIO-waveforms.png, -spectra.png and, if something was learned, -map.png; return the paths.

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
    """Each panel twice: the run (after its start-up), and its first fault or else its last revolution."""
    times = data["waveforms"]
    zooms = {zoom["name"]: zoom for zoom in data["zooms"]}
    names = [name for name in ("after start-up", "whole run") if name in zooms][:1]
    fault = next((name for name in zooms if name.startswith("fault at ")), "last revolution")
    names += [name for name in (fault,) if name in zooms]

    def draw(axes: Axes) -> None:
        for row, panel in zip(axes, times["panels"], strict=True):
            for ax, name in zip(row, names, strict=True):
                _panel(ax, panel, times, zooms[name], controllers, data["marks"])
            row[0].set_ylabel(f"{panel['quantity']} ({panel['unit']})")
            row[0].set_title(panel["title"], loc="left", fontsize=9)
        for ax, name in zip(axes[-1], names, strict=True):
            ax.set_xlabel(f"{times['x']}, {name}")

    return save(path, title, (len(times["panels"]), len(names)), 1.7, draw, (2, 1)[: len(names)])


def _panel(
    ax: Any,
    panel: dict[str, Any],
    times: dict[str, Any],
    zoom: dict[str, Any],
    controllers: Sequence[dict[str, Any]],
    marks: Sequence[dict[str, Any]],
) -> None:
    for series in panel["series"]:
        grid, y = _finest(times, series, zoom)
        x = grid["start"] + grid["step"] * np.arange(len(y))
        inside = (x >= zoom["from"]) & (x <= zoom["to"])
        if series.get("dash"):
            ax.plot(x[inside], y[inside], **REFERENCE)
        else:
            ax.plot(x[inside], y[inside], **look(controllers[series["controller"]]))
    for mark in marks:
        if mark["from"] < zoom["to"] and mark["to"] > zoom["from"]:
            ax.axvspan(
                max(mark["from"], zoom["from"]), min(mark["to"], zoom["to"]), color="#b3401f", alpha=0.13
            )
    ax.margins(x=0)


def _finest(
    times: dict[str, Any], series: dict[str, Any], zoom: dict[str, Any]
) -> tuple[dict[str, Any], Array]:
    """Grid and values of the finer points that a zoom lies in, else of the whole run."""
    for grid, packed in zip(times["details"], series["details"], strict=True):
        y = unpack(packed)
        slack = times["step"]
        if (
            grid["start"] - slack <= zoom["from"]
            and zoom["to"] <= grid["start"] + grid["step"] * len(y) + slack
        ):
            return grid, y
    return times, unpack(series["values"])


def _spectra(path: Path, title: str, data: dict[str, Any], controllers: Sequence[dict[str, Any]]) -> bool:
    def draw(axes: Axes) -> None:
        for ax, chart in zip(axes[:, 0], data["spectra"], strict=True):
            width = 0.78 / len(chart["series"])
            for k, series in enumerate(chart["series"]):
                left = [i + (k - len(chart["series"]) / 2 + 0.5) * width for i in range(len(chart["orders"]))]
                heights = [value or 0.0 for value in series["values"]]
                ax.bar(left, heights, 0.92 * width, **look(controllers[series["controller"]]))
            ax.set_xticks(range(len(chart["orders"])), [str(order) for order in chart["orders"]])
            ax.grid(axis="x", visible=False)
            ax.set_title(chart["title"], loc="left", fontsize=9)
            ax.set_xlabel(chart["x"])
            ax.set_ylabel(f"{chart['quantity']} ({chart['unit']})")

    return save(path, title, (len(data["spectra"]), 1), 2.6, draw)


def _maps(path: Path, title: str, data: dict[str, Any], controllers: Sequence[dict[str, Any]]) -> bool:
    def draw(axes: Axes) -> None:
        for ax, chart in zip(axes[:, 0], data["maps"], strict=True):
            for series in chart["series"]:
                ax.plot(chart["angle"], series["values"], **look(controllers[series["controller"]]))
            ax.set_xlabel(chart["x"])
            ax.set_ylabel("current (A)")
            ax.set_xlim(0, chart["angle"][-1])

    return save(path, title, (len(data["maps"]), 1), 2.6, draw)
