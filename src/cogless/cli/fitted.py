"""Fit tables to the terminal without breaking words: a table that is too wide is printed in parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Column, Table

GAP_COLUMNS = 2  # blanks beside a column's text
WIDTH_MOST = 10_000
SHORT_COLUMNS = 14  # columns with lines up to this width get their room before other columns


def fitted(console: Console, part: RenderableType) -> Iterator[RenderableType]:
    """Yield `part`, with each table that is wider than the console split into several tables.

    Each of these tables begins with the first column. Their cells' lines break between words.
    """
    from rich.console import Group
    from rich.table import Table

    if isinstance(part, Group):
        for inner in part.renderables:
            yield from fitted(console, inner)
    elif isinstance(part, Table):
        yield from _tables(console, part)
    else:
        yield part


def _tables(console: Console, whole: Table) -> Iterator[RenderableType]:
    from rich.text import Text

    first, *others = whole.columns
    beside_first = room = console.width - _least(console, first)
    chunks: list[list[Column]] = [[]]
    for column in others:
        least = _least(console, column)
        if chunks[-1] and room < least:
            chunks.append([])
            room = beside_first
        chunks[-1].append(column)
        room -= least
    for place, chunk in enumerate(chunks):
        if place:
            yield Text()
        yield _table(console, whole, [first, *chunk], place == 0, place == len(chunks) - 1)


def _table(console: Console, whole: Table, columns: Sequence[Column], begins: bool, ends: bool) -> Table:
    """A table of these columns, each as wide as its longest line, or as wide as the console allows.

    `begins`: with the title of the whole table. `ends`: with the caption.
    """
    from rich.table import Table

    part = Table(
        title=whole.title if begins else None,
        title_justify="left",
        title_style=whole.title_style,
        caption=whole.caption if ends else None,
        caption_justify="left",
        box=None,
        pad_edge=False,
    )
    widths = [_least(console, column) for column in columns]
    longest = [_most(console, column) for column in columns]
    room = console.width - sum(widths)
    for n in sorted(range(len(columns)), key=lambda n: longest[n] > SHORT_COLUMNS):
        more = min(max(0, room), longest[n] - widths[n])
        widths[n], room = widths[n] + more, room - more
    for column, width in zip(columns, widths, strict=True):
        part.add_column(column.header, justify=column.justify, width=width - GAP_COLUMNS)
    for cells in zip(*(column.cells for column in columns), strict=True):
        part.add_row(*cells)
    return part


def _least(console: Console, column: Column) -> int:
    """A column's least width with gap: its longest word, or its longest cell if cells may not be wrapped."""
    cells = [_width(console, cell, words=not column.no_wrap) for cell in column.cells]
    longest = max(_width(console, part, words=False) for part in (column.header, *column.cells))
    words = _width(console, column.header, words=True)
    return GAP_COLUMNS + max(words, *cells, min(longest, column.min_width or 0))


def _most(console: Console, column: Column) -> int:
    """A column's largest width, gap included: its longest line, or less if the table limits the column."""
    widest = max(_width(console, part, words=False) for part in (column.header, *column.cells))
    return GAP_COLUMNS + max(_least(console, column) - GAP_COLUMNS, min(widest, column.max_width or widest))


def _width(console: Console, part: Any, words: bool) -> int:
    from rich.measure import Measurement

    size = Measurement.get(console, console.options.update(width=WIDTH_MOST), part)
    return size.minimum if words else size.maximum
