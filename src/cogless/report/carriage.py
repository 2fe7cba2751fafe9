"""The report of a printer's axis: the carriage's ripple by order over the speed, and the correction."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from cogless.files import replacing
from cogless.printer.corrections import Correction, OrderRipple
from cogless.printer.records import Direction
from cogless.report import svg
from cogless.report.markup import legend, note, number, sentences, still_page, text_table

RIPPLE_LEAST = 1e-8  # m, amplitude; a smaller ripple shows on no print
SPEED_TICKS = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)  # m/s
# a curve, its colour, and whether it is dotted
RIPPLE_CURVES = {
    "before": ("without a correction", "--c0", False),
    "after": ("with the correction", "--c1", False),
    "doubt": ("hidden below", "--c1", True),
}


def write_report(correction: Correction, lines: Sequence[str], path: Path) -> None:
    """Write the report; if this fails, no incomplete file is left. `lines`: the correction in words."""
    with replacing(path) as temporary:
        temporary.write_text(render(correction, lines), encoding="utf-8")


def render(correction: Correction, lines: Sequence[str]) -> str:
    """The report as one HTML text that needs nothing else."""
    sections = [("Ripple over speed", _ripple(correction)), ("Correction", sentences(lines))]
    return still_page("identify", f"Motor {correction.motor}: ripple of the carriage", sections)


def _ripple(correction: Correction) -> str:
    """A grid of panels with the same axes: a row of orders for each direction, then the numbers."""
    ripples = {
        f"Order {n} {direction}, a stripe every {1e3 * correction.wavelength / n:.3g} mm": one
        for direction, orders in correction.ripple.items()
        for n, one in orders.items()
        if len(one.speeds)
    }
    if not ripples:
        return ""
    axes = _axes([*ripples.values()])
    panels = "".join(axes.panel(title, *_curves(axes, one)) for title, one in ripples.items())
    solid = {name: colour for name, colour, dots in RIPPLE_CURVES.values() if not dots}
    return (
        f'{note(correction.ripple_note)}{legend(solid)}<div class="panels still">{panels}</div>'
        f'<details class="fold"><summary>Numbers</summary>{_numbers(correction.ripple)}</details>'
    )


def _axes(ripples: Sequence[OrderRipple]) -> svg.Axes:
    """Axes that all panels share, both logarithmic: else one resonance hides all other speeds."""
    ways = [float(x) for one in ripples for x in (*one.before, *one.after) if x >= RIPPLE_LEAST]
    low = math.floor(math.log10(min(ways, default=RIPPLE_LEAST)))
    high = max(math.ceil(math.log10(max(ways, default=RIPPLE_LEAST))), low + 1)
    decades = {10.0**n: f"{10.0 ** (n + 6):g}" for n in range(low, high + 1)}
    speeds = [float(v) for one in ripples for v in one.speeds]
    slow, fast = 0.95 * min(speeds), 1.05 * max(speeds)
    ticks = {v: f"{1e3 * v:g}" for v in SPEED_TICKS if slow <= v <= fast}
    return svg.Axes(
        svg.Scale("speed (mm/s)", slow, fast, ticks, log=True),
        svg.Scale("amplitude (µm)", 10.0**low, 10.0**high, decades, log=True),
    )


def _curves(axes: svg.Axes, one: OrderRipple) -> list[str]:
    return [
        axes.line(one.speeds, getattr(one, curve), colour, dots)
        for curve, (_, colour, dots) in RIPPLE_CURVES.items()
    ]


def _numbers(ripple: Mapping[Direction, Mapping[int, OrderRipple]]) -> str:
    rows = [
        [
            f"order {n} {direction}",
            f"{1e3 * speed:.0f}",
            *(number(1e6 * float(getattr(one, curve)[k])) for curve in RIPPLE_CURVES),
        ]
        for direction, orders in ripple.items()
        for n, one in orders.items()
        for k, speed in enumerate(one.speeds)
    ]
    names = ("Order", "speed (mm/s)", *(f"{name} (µm)" for name, *_ in RIPPLE_CURVES.values()))
    return text_table("numbers", "Ripple", names, rows)
