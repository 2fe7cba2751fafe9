"""Still pictures, as PNG: what the reports' pictures have in common."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from numpy.typing import NDArray

from cogless.files import replacing

Axes = NDArray[Any]  # of matplotlib, rows x columns

# Colours of report.css, where --c0 is the baseline's.
PALETTE = ("#6a7380", "#0b6bcb", "#d9630c", "#13865a", "#9a3fb5", "#b58a00", "#c2255c", "#0c8599")
REFERENCE: dict[str, Any] = {"color": "#1b1f24", "linestyle": "--", "linewidth": 0.9, "zorder": 5}  # on top
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


def look(controller: dict[str, Any]) -> dict[str, Any]:
    """A controller's colour and label, for matplotlib."""
    return {"color": PALETTE[controller["colour"]], "label": controller["label"]}


def save(
    path: Path,
    title: str,
    shape: tuple[int, int],
    height: float,
    draw: Callable[[Axes], None],
    widths: Sequence[float] | None = None,
) -> bool:
    """Make a figure of rows and columns of axes, let `draw` fill them, write it. False: nothing to draw.

    `height`: of a row, inches; `widths`: of the columns to each other.
    """
    from matplotlib.figure import Figure

    rows, columns = shape
    if not rows or not columns:
        return False
    figure = Figure(figsize=(9 if columns == 1 else 12, 0.9 + height * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, width_ratios=widths)
    draw(axes)
    wide = 8 * int(figure.get_figwidth())  # characters
    figure.suptitle(fill(title, wide), x=0.01, ha="left", fontweight="bold")
    handles: dict[str, Any] = {}
    for ax in axes.flat:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    columns = max(
        1, min(len(handles), 12 * int(figure.get_figwidth()) // (6 + max(map(len, handles), default=0)))
    )
    figure.legend(handles.values(), handles.keys(), loc="outside lower left", ncols=columns)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png")
    return True
