"""The report of a printer's axis: the carriage's ripple by order over the speed, and the correction."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from itertools import pairwise
from pathlib import Path

from cogless.files import replacing
from cogless.printer.corrections import Correction, OrderRipple
from cogless.printer.records import Direction, Numbers
from cogless.report.identified import page_of, sentences
from cogless.report.markup import note, number, table

RIPPLE_LEAST = 1e-8  # m; less is on no print
PANEL_WIDTH, PANEL_HEIGHT = 360, 240  # px
LEFT_EDGE, RIGHT_EDGE, TOP_EDGE, LOW_EDGE = 44, 344, 10, 202  # px, of the axes in it
SPEED_TICKS = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)  # m/s
# a curve, its colour, and its stroke
RIPPLE_CURVES = {
    "before": ("without a correction", "--c0", ""),
    "after": ("with the correction", "--c1", ""),
    "doubt": ("hidden below", "--c1", ' stroke-dasharray="2 4"'),
}


def write_report(correction: Correction, lines: Sequence[str], path: Path) -> None:
    """Write the report; if this fails, no incomplete file is left. `lines`: the correction in words."""
    with replacing(path) as temporary:
        temporary.write_text(render(correction, lines), encoding="utf-8")


def render(correction: Correction, lines: Sequence[str]) -> str:
    """The report as one HTML text that needs nothing else."""
    sections = [("Ripple over speed", _ripple(correction)), ("Correction", sentences(lines))]
    return page_of("identify", f"Motor {correction.motor}: ripple of the carriage", sections)


def _ripple(correction: Correction) -> str:
    """A grid of panels with the same axes: a row of orders for each direction, then the numbers."""
    panels = [
        (f"Order {n} {direction}, a stripe every {1e3 * correction.wavelength / n:.3g} mm", one)
        for direction, orders in correction.ripple.items()
        for n, one in orders.items()
        if len(one.speeds)
    ]
    if not panels:
        return ""
    axes = _Axes([one for _, one in panels])
    key = " ".join(
        f'<span class="key" style="--colour:var({colour})">{name}</span>'
        for name, colour, stroke in RIPPLE_CURVES.values()
        if not stroke
    )
    pictures = "".join(
        f'<div class="panel"><header>{escape(title)}</header>{axes.picture(title, one)}</div>'
        for title, one in panels
    )
    return (
        f'{note(correction.ripple_note)}<p class="note">{key}</p>'
        f'<div class="panels ripple">{pictures}</div>'
        "<style>.panels.ripple{grid-template-columns:repeat(auto-fit,minmax(min(100%,300px),1fr))}</style>"
        f'<details class="fold"><summary>Numbers</summary>{_numbers(correction.ripple)}</details>'
    )


class _Axes:
    """Axes that all panels share, both logarithmic: else one resonance hides all other speeds."""

    def __init__(self, ripples: Sequence[OrderRipple]) -> None:
        ways = [float(x) for one in ripples for x in (*one.before, *one.after) if x >= RIPPLE_LEAST]
        speeds = [float(v) for one in ripples for v in one.speeds]
        self.low = math.floor(math.log10(min(ways, default=RIPPLE_LEAST)))
        self.high = max(math.ceil(math.log10(max(ways, default=RIPPLE_LEAST))), self.low + 1)
        self.slow, self.fast = math.log(0.95 * min(speeds)), math.log(1.05 * max(speeds))

    def x(self, speed: float) -> float:
        return LEFT_EDGE + (RIGHT_EDGE - LEFT_EDGE) * (math.log(speed) - self.slow) / (self.fast - self.slow)

    def y(self, way: float) -> float:
        return LOW_EDGE - (LOW_EDGE - TOP_EDGE) * (math.log10(way) - self.low) / (self.high - self.low)

    def picture(self, title: str, one: OrderRipple) -> str:
        parts = [
            f'<text x="{RIGHT_EDGE}" y="{PANEL_HEIGHT - 4}" text-anchor="end">speed (mm/s)</text>',
            f'<text x="{LEFT_EDGE + 4}" y="{TOP_EDGE + 12}">amplitude (µm)</text>',
        ]
        for decade in range(self.low, self.high + 1):
            y = self.y(10.0**decade)
            parts.append(
                f'<path d="M{LEFT_EDGE} {y:.1f}H{RIGHT_EDGE}" stroke="var(--grid)"/>'
                f'<text x="{LEFT_EDGE - 6}" y="{y + 4:.1f}" text-anchor="end">{10.0 ** (decade + 6):g}</text>'
            )
        for speed in SPEED_TICKS:
            if self.slow <= math.log(speed) <= self.fast:
                x = self.x(speed)
                parts.append(
                    f'<path d="M{x:.1f} {TOP_EDGE}V{LOW_EDGE}" stroke="var(--grid)"/>'
                    f'<text x="{x:.1f}" y="{LOW_EDGE + 18}" text-anchor="middle">{1e3 * speed:g}</text>'
                )
        for curve, (_, colour, stroke) in RIPPLE_CURVES.items():
            parts.append(
                f'<path d="{self._line(one.speeds, getattr(one, curve))}" fill="none" '
                f'stroke="var({colour})" stroke-width="1.8"{stroke}/>'
            )
        box = f'viewBox="0 0 {PANEL_WIDTH} {PANEL_HEIGHT}" role="img"'
        return f'<svg class="picture" {box} aria-label="{escape(title)}">{"".join(parts)}</svg>'

    def _line(self, speeds: Numbers, ways: Numbers) -> str:
        """A line that follows the values down to the lower edge, and stops there."""
        floor = 10.0**self.low
        points = [f"{self.x(v):.1f} {self.y(max(w, floor)):.1f}" for v, w in zip(speeds, ways, strict=True)]
        drawn = ["L" if max(pair) >= floor else "M" for pair in pairwise(ways)]
        return "".join(map("".join, zip(["M", *drawn], points, strict=True)))


def _numbers(ripple: Mapping[Direction, Mapping[int, OrderRipple]]) -> str:
    body = ""
    for direction, orders in ripple.items():
        for n, one in orders.items():
            for k, speed in enumerate(one.speeds):
                cells = "".join(
                    f"<td>{number(1e6 * float(getattr(one, curve)[k]))}</td>" for curve in RIPPLE_CURVES
                )
                body += f"<tr><th>order {n} {direction}</th><td>{1e3 * speed:.0f}</td>{cells}</tr>"
    names = ("Order", "speed (mm/s)", *(f"{name} (µm)" for name, _, _ in RIPPLE_CURVES.values()))
    return table("numbers", "Ripple", "".join(f"<th>{name}</th>" for name in names), body)
