"""Still pictures of a speed scenario: waveforms, order spectra, learned maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cogless.report.packing import Array, unpack
from cogless.report.png import REFERENCE, Data, Looks, Picture, Plot, plot, stack, times


def _waveforms(data: Data, looks: Looks) -> list[list[Plot]]:
    """Each panel twice: over the run after its start-up, and over its first fault or else last revolution."""
    waves = data["waveforms"]
    zooms = {zoom["name"]: zoom for zoom in data["zooms"]}
    names = [name for name in ("after start-up", "whole run") if name in zooms][:1]
    fault = next((name for name in zooms if name.startswith("fault at ")), "last revolution")
    names += [name for name in (fault,) if name in zooms]
    return [
        [
            plot(panel, f"{waves['x']}, {name}", _panel, waves, zooms[name], data["marks"], looks)
            for name in names
        ]
        for panel in waves["panels"]
    ]


def _panel(panel: Data, waves: Data, zoom: Data, marks: Sequence[Data], looks: Looks, ax: Any) -> None:
    begin, end = zoom["from"], zoom["to"]
    for series in panel["series"]:
        grid, y = _finest(waves, series, zoom)
        x = times(grid, y)
        inside = (x >= begin) & (x <= end)
        look = REFERENCE if series.get("dash") else looks[series["controller"]]
        ax.plot(x[inside], y[inside], **look)
    for mark in marks:
        if mark["from"] < end and mark["to"] > begin:
            ax.axvspan(max(mark["from"], begin), min(mark["to"], end), color="#b3401f", alpha=0.13)


def _finest(waves: Data, series: Data, zoom: Data) -> tuple[Data, Array]:
    """Time grid and values of the finer points that cover a zoom, or else those of the whole run."""
    slack = waves["step"]
    for grid, packed in zip(waves["details"], series["details"], strict=True):
        y = unpack(packed)
        end = grid["start"] + grid["step"] * len(y)
        if grid["start"] - slack <= zoom["from"] and zoom["to"] <= end + slack:
            return grid, y
    return waves, unpack(series["values"])


def _bars(chart: Data, looks: Looks, ax: Any) -> None:
    places = range(len(chart["orders"]))
    width = 0.78 / len(chart["series"])
    for k, series in enumerate(chart["series"]):
        middles = [i + (k - len(chart["series"]) / 2 + 0.5) * width for i in places]
        heights = [value or 0.0 for value in series["values"]]
        ax.bar(middles, heights, 0.92 * width, **looks[series["controller"]])
    ax.set_xticks(places, [str(order) for order in chart["orders"]])
    ax.margins(x=0.05)
    ax.grid(axis="x", visible=False)


def _map(chart: Data, looks: Looks, ax: Any) -> None:
    for series in chart["series"]:
        ax.plot(chart["angle"], series["values"], **looks[series["controller"]])


PICTURES = {
    "waveforms": Picture(_waveforms, 1.7, (2, 1)),
    "spectra": Picture(lambda data, looks: stack(data["spectra"], _bars, looks), 2.6),
    "map": Picture(lambda data, looks: stack(data["maps"], _map, looks), 2.6),
}
