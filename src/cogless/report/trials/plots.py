"""Still pictures of a study of trials, as PNG: RMS over trials, chosen trials, certificates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from cogless.report.packing import unpack
from cogless.report.png import REFERENCE, STYLE, Axes, look, save
from cogless.report.trials import charts
from cogless.results import TrialResults

MOST_COLUMNS = 4  # phases whose first trial is drawn


def write_plots(results: TrialResults, directory: Path) -> list[Path]:
    """Write SCENARIO-rms.png, -trials.png and, if there is one, -certificate.png; return the paths.

    matplotlib is imported here: it takes longer than the pictures.
    """
    import matplotlib

    written = []
    with matplotlib.rc_context(STYLE):
        drawn = charts.data(results)
        for scenario, data in zip(results.scenarios, drawn["scenarios"], strict=True):
            for kind, figure in (("rms", _rms), ("trials", _trials), ("certificate", _certificate)):
                path = directory / f"{scenario}-{kind}.png"
                if figure(path, f"{results.study.title}: {scenario}", data, drawn["controllers"]):
                    written.append(path)
    return written


def _rms(path: Path, title: str, data: dict[str, Any], controllers: Sequence[dict[str, Any]]) -> bool:
    over = data["over_trials"]

    def draw(axes: Axes) -> None:
        for ax, chart in zip(axes[:, 0], over["charts"], strict=True):
            for series in chart["series"]:
                y = 10 ** unpack(series["values"])
                ax.plot(np.arange(1, len(y) + 1), y, **look(controllers[series["controller"]]))
            ax.set_yscale("log")
            if "floor" in chart:
                ax.axhline(chart["floor"], color="#5c6570", linestyle="--", linewidth=0.8)
                where = {"xycoords": ("axes fraction", "data"), "va": "bottom", "ha": "right"}
                ax.annotate(chart["floor_name"], (0.995, chart["floor"]), fontsize=8, **where)
            for row, mark in enumerate(over["marks"]):
                ax.axvline(mark["trial"], color="#5c6570", linestyle=":", linewidth=0.8)
                where = {"xycoords": ("data", "axes fraction"), "va": "top", "textcoords": "offset points"}
                text = (mark["trial"], 1 - 0.06 * (row % 4))
                ax.annotate(mark["name"], text, (3, 0), fontsize=8, **where)
            ax.set_title(chart["title"], loc="left", fontsize=9)
            ax.set_xlabel("trial")
            ax.set_ylabel(_with_unit(chart["quantity"], chart["unit"]))
            ax.margins(x=0)

    return save(path, title, (len(over["charts"]), 1), 3.4, draw)


def _trials(path: Path, title: str, data: dict[str, Any], controllers: Sequence[dict[str, Any]]) -> bool:
    """A column for the first trial of each phase, all controllers overlaid."""
    waves = data["waveforms"]
    phases = waves["phases"][:MOST_COLUMNS]

    def draw(axes: Axes) -> None:
        for row, panel in zip(axes, waves["panels"], strict=True):
            for place, (ax, phase) in enumerate(zip(row, phases, strict=True)):
                curves = [(s["trials"][str(phase["trials"][0])], s["controller"]) for s in panel["series"]]
                for packed, controller in curves:
                    y = unpack(packed)
                    ax.plot(
                        waves["start"] + waves["step"] * np.arange(len(y)), y, **look(controllers[controller])
                    )
                if panel["references"]:
                    y = unpack(panel["references"][place])
                    x = waves["start"] + waves["step"] * np.arange(len(y))
                    ax.plot(x, y, **REFERENCE)
                ax.margins(x=0)
            row[0].set_ylabel(_with_unit(panel["quantity"], panel["unit"]))
            row[0].set_title(panel["title"], loc="left", fontsize=9)
        for ax, phase in zip(axes[-1], phases, strict=True):
            ax.set_xlabel(fill(f"{waves['x']}; {phase['name']}", 32))

    return save(path, title, (len(waves["panels"]), len(phases)), 1.7, draw)


def _certificate(path: Path, title: str, data: dict[str, Any], controllers: Sequence[dict[str, Any]]) -> bool:
    found = data["certificate"]

    def draw(axes: Axes) -> None:
        for ax, chart in zip(axes[:, 0], found, strict=True):
            for series in chart["series"]:
                style = look(controllers[series["controller"]])
                dashed = {"linestyle": "--", "label": None}
                x, y = chart["frequency"], unpack(series["values"])
                ax.plot(x, y, **(style | (dashed if series.get("dash") else {})))
            ax.axhline(1, color="#5c6570", linewidth=1)
            ax.set_xscale("log")
            ax.set_ylim(bottom=0)
            ax.margins(x=0)
            about = f"{chart['title']}: worst plant; without Q filter dashed"
            ax.set_title(about, loc="left", fontsize=9)
            ax.set_xlabel("frequency (Hz)")
            ax.set_ylabel("|F|, factor a trial")

    return save(path, title, (len(found), 1), 2.6, draw)


def _with_unit(quantity: str, unit: str) -> str:
    return f"{quantity} ({unit})" if unit else quantity
