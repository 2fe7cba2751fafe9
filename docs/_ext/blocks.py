"""Block diagrams of the docs: text becomes SVG in the page, in the page's own colours.

A line `name: column row what` places a node on a grid: a block with this text (`|` breaks a line), `sum`,
`dot` for a branch, `bend` for a corner, or `= text` for a signal. A line `a > b > c` draws arrows, sideways
first and then up or down; with `^` in place of `>` up or down first. `-` at the end is the sign with which
the last arrow enters its sum. `x_y` writes y low.

    ```{blocks} A PI: the speed error becomes a current.
    ref: 0 0 = ω_ref
    e: 1 0 sum
    pi: 2 0 PI
    ref > e > pi
    ```
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from html import escape
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive

COLUMN, ROW = 120, 74  # px
WIDE, HIGH = 104, 42  # of a block
RADIUS = 11  # of a sum
MARGIN = 14
NODE = re.compile(r"(\w+): (\S+) (\S+) (.+)")
STEP = re.compile(r" ([>^]) ")


@dataclass(frozen=True)
class Node:
    x: float
    y: float
    what: str

    @property
    def half(self) -> tuple[float, float]:
        """Half of its width and height: where arrows begin and end."""
        if self.what in ("dot", "bend"):
            return 0, 0
        if self.what == "sum":
            return RADIUS, RADIUS
        if self.what.startswith("="):
            return 6 + 4.2 * len(self.what.removeprefix("= ").replace("_", "")), 12
        return WIDE / 2, HIGH / 2

    def svg(self) -> str:
        if self.what == "dot":
            return f'<circle cx="{self.x}" cy="{self.y}" r="3" fill="currentColor"/>'
        if self.what == "bend":
            return ""
        if self.what == "sum":
            return f'<circle cx="{self.x}" cy="{self.y}" r="{RADIUS}"/>'
        if self.what.startswith("="):
            return text(self.x, self.y, self.what.removeprefix("= "))
        left, top = self.x - WIDE / 2, self.y - HIGH / 2
        lines = self.what.split("|")
        box = f'<rect x="{left}" y="{top}" width="{WIDE}" height="{HIGH}" rx="4"/>'
        first = self.y - 7.5 * (len(lines) - 1)
        return box + "".join(text(self.x, first + 15 * i, line) for i, line in enumerate(lines))


def text(x: float, y: float, words: str) -> str:
    """Text about a point; what follows an underscore stands low."""
    low = '<tspan dy="4" font-size="9">{}</tspan><tspan dy="-4">&#8203;</tspan>'
    shown = re.sub(r"_(\w+)", lambda m: low.format(m[1]), escape(words))
    return (
        f'<text x="{x}" y="{y + 4.5}" text-anchor="middle" fill="currentColor" stroke="none">{shown}</text>'
    )


def arrow(a: Node, b: Node, upright_first: bool, sign: str) -> str:
    """An arrow with at most one corner, and its sign beside its head."""
    corner = (a.x, b.y) if upright_first else (b.x, a.y)
    begin, end = _edge(a, corner, b), _edge(b, corner, a)
    straight = corner in ((a.x, a.y), (b.x, b.y))
    points = [begin, end] if straight else [begin, corner, end]
    head = "" if b.what in ("dot", "bend") else ' marker-end="url(#head)"'
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    found = f'<polyline points="{line}"{head}/>'
    if sign:
        aside = (end[0] + 9, end[1] + (9 if end[1] > b.y else -9))
        if end[1] == b.y:
            aside = (end[0] + (-8 if end[0] < b.x else 8), end[1] - 9)
        found += text(*aside, "\u2212" if sign == "-" else sign)
    return found


def _edge(node: Node, corner: tuple[float, float], other: Node) -> tuple[float, float]:
    """Where a line from a node towards a corner, or else to the other node, leaves it."""
    x, y = corner if corner != (node.x, node.y) else (other.x, other.y)
    wide, high = node.half
    if abs(x - node.x) > abs(y - node.y):
        return node.x + (wide if x > node.x else -wide), node.y
    return node.x, node.y + (high if y > node.y else -high)


def drawn(lines: list[str], caption: str) -> str:
    """The diagram as SVG. ValueError names a line that is none."""
    placed: dict[str, Node] = {}
    arrows: list[str] = []
    for line in filter(str.strip, lines):
        found = NODE.fullmatch(line.strip())
        if found:
            name, column, row, what = found.groups()
            placed[name] = Node(float(column) * COLUMN, float(row) * ROW, what)
            continue
        way, sign = line.strip(), ""
        if way[-2:] in (" -", " +"):
            way, sign = way[:-2], way[-1]
        parts = STEP.split(way)
        if len(parts) < 3 or any(name not in placed for name in parts[::2]):
            raise ValueError(f"blocks: {line}: expected a node or arrows between nodes")
        last = len(parts) - 3
        arrows += [
            arrow(placed[parts[i]], placed[parts[i + 2]], parts[i + 1] == "^", sign if i == last else "")
            for i in range(0, len(parts) - 2, 2)
        ]
    left = min(n.x - n.half[0] for n in placed.values()) - MARGIN
    top = min(n.y - n.half[1] for n in placed.values()) - MARGIN
    width = max(n.x + n.half[0] for n in placed.values()) + MARGIN - left
    height = max(n.y + n.half[1] for n in placed.values()) + MARGIN - top
    head = '<path d="M0 0 8 4 0 8z" fill="currentColor" stroke="none"/>'
    size = 'viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7"'
    marker = f'<marker id="head" {size} orient="auto">{head}</marker>'
    return (
        '<div class="blocks" tabindex="0" role="region" aria-label="Block diagram">'
        f'<svg role="img" aria-label="{escape(caption)}" '
        f'viewBox="{left:.0f} {top:.0f} {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}" '
        f'fill="none" stroke="currentColor" stroke-width="1.3"><defs>{marker}</defs>'
        + "".join(arrows)
        + "".join(node.svg() for node in placed.values())
        + "</svg></div>"
    )


class Blocks(Directive):
    required_arguments = 1
    final_argument_whitespace = True
    has_content = True

    def run(self) -> list[nodes.Node]:
        caption = " ".join(self.arguments[0].split())
        try:
            picture = drawn(list(self.content), caption)
        except ValueError as error:
            raise self.error(str(error)) from None
        return [
            nodes.raw("", picture, format="html"),
            nodes.paragraph("", caption, classes=["blocks-caption"]),
        ]


def setup(app: Any) -> dict[str, Any]:
    app.add_directive("blocks", Blocks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
