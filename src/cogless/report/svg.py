"""Small still pictures of lines on axes, as SVG in the page's colours."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from cogless.results.trace import Array

PANEL_WIDTH, PAGE_WIDTH, PICTURE_HEIGHT = 360, 1040, 230  # px
LEFT_EDGE, RIGHT_MARGIN, TOP_EDGE, LOW_EDGE = 52, 16, 24, 188  # px, place of the axes in a picture
AXIS_PARTS_MOST = 5  # largest number of parts between the ticks of an axis


@dataclass(frozen=True)
class Scale:
    """An axis from `low` to `high` with its label; `ticks`: values on it and their names."""

    label: str
    low: float
    high: float
    ticks: Mapping[float, str]
    log: bool = False

    def shares(self, values: ArrayLike) -> Array:
        """How far along the axis values are: 0 at its beginning, 1 at its end; values before it are at 0."""
        at = np.maximum(values, self.low)
        if self.log:
            return np.asarray(np.log(at / self.low) / math.log(self.high / self.low))
        return np.asarray((at - self.low) / (self.high - self.low))


def linear(label: str, low: float, high: float) -> Scale:
    """An axis with ticks at round values; its length is 1 if `high` is not above `low`."""
    high = high if high > low else low + 1.0
    apart = (high - low) / AXIS_PARTS_MOST
    decade = 10.0 ** math.floor(math.log10(apart))
    step = next(n * decade for n in (1, 2, 5, 10) if n * decade >= apart)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return Scale(label, low, high, {n * step: f"{n * step:g}" for n in range(first, last + 1)})


@dataclass(frozen=True)
class Axes:
    """The axes of a picture. A picture that is wider than its card scrolls within the card."""

    x: Scale
    y: Scale
    width: int = PANEL_WIDTH

    def across(self, xs: ArrayLike) -> Array:
        return LEFT_EDGE + (self.width - RIGHT_MARGIN - LEFT_EDGE) * self.x.shares(xs)

    def down(self, ys: ArrayLike) -> Array:
        return LOW_EDGE - (LOW_EDGE - TOP_EDGE) * self.y.shares(ys)

    def line(self, xs: ArrayLike, ys: Array, colour: str, dots: bool = False) -> str:
        """A line through the values, with a gap where two successive values are both below the axis."""
        points = [f"{x:.1f} {y:.1f}" for x, y in zip(self.across(xs), self.down(ys), strict=True)]
        moves = ["M", *("L" if max(pair) >= self.y.low else "M" for pair in pairwise(ys))]
        path = "".join(map("".join, zip(moves, points, strict=True)))
        dash = ' stroke-dasharray="2 4"' if dots else ""
        return f'<path d="{path}" fill="none" stroke="var({colour})" stroke-width="1.6"{dash}/>'

    def panel(self, title: str, *lines: str) -> str:
        """The card of a picture: its title, axes and lines."""
        right = self.width - RIGHT_MARGIN
        xs = [*zip(self.across([*self.x.ticks]), self.x.ticks.values(), strict=True)]
        ys = [*zip(self.down([*self.y.ticks]), self.y.ticks.values(), strict=True)]
        texts = [
            (right, LOW_EDGE + 36, "end", self.x.label),
            (LEFT_EDGE, TOP_EDGE - 10, "start", self.y.label),
            *((x, LOW_EDGE + 18, "middle", name) for x, name in xs),
            *((LEFT_EDGE - 6, y + 4, "end", name) for y, name in ys),
        ]
        grid = [f"M{x:.1f} {TOP_EDGE}V{LOW_EDGE}" for x, _ in xs] + [
            f"M{LEFT_EDGE} {y:.1f}H{right}" for y, _ in ys
        ]
        written = [
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{end}">{escape(t)}</text>' for x, y, end, t in texts
        ]
        wide = f' style="min-width:{self.width}px"' if self.width > PANEL_WIDTH else ""
        return (
            f'<div class="panel"><header>{escape(title)}</header><div class="plot"><svg class="picture" '
            f'viewBox="0 0 {self.width} {PICTURE_HEIGHT}" role="img" aria-label="{escape(title)}"{wide}>'
            f'<path d="{"".join(grid)}" stroke="var(--grid)"/>{"".join([*written, *lines])}</svg></div></div>'
        )
