"""Pieces of HTML, colours and packed numbers that the page's sections share.

All of the user's text in the HTML is escaped. Each controller has a colour, and a place in the page's data.
Waveforms are thinned without losing their peaks, and packed as 16-bit integers.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from cogless.files import versions
from cogless.results import AnyResults, Run
from cogless.results.trace import Array

COLOUR_COUNT = 8  # --c0 (the baseline's) to --c7 of report.css


def colours(results: AnyResults) -> dict[str, int]:
    """The colour index of each controller that has a run, in the study's order; the baseline's is 0."""
    ran = {run.controller for run in results.runs}
    names = [name for name in results.study.controller if name in ran]
    others = [name for name in names if name != results.study.baseline]
    return {n: 0 if n == results.study.baseline else 1 + others.index(n) % (COLOUR_COUNT - 1) for n in names}


def place(results: AnyResults, run: Run) -> int:
    """The index of a run's controller in the page's list of controllers."""
    return list(colours(results)).index(run.controller)


DASH = "–"  # noqa: RUF001


@cache
def asset(name: str) -> str:
    """The text of a file in the package's folder assets/."""
    return (files("cogless.report") / "assets" / name).read_text(encoding="utf-8")


def frame(command: str, title: str, main: str, footer: str, **more: str) -> str:
    """A command's whole page from its parts as HTML. `more`: `head`, `warning`, `styles` and `scripts`."""
    parts = dict.fromkeys(("head", "warning", "styles", "scripts"), "") | more
    parts |= {"command": command, "title": escape(title), "main": main, "footer": footer}
    css, version = asset("report.css"), escape(versions()["cogless"])
    return Template(asset("page.html")).substitute(parts, css=css, version=version)


def still_page(command: str, title: str, sections: Sequence[tuple[str, str]]) -> str:
    """A page without scripts. `sections`: pairs of a heading and HTML; a section without HTML is left out."""
    main = "".join(f"<section><h2>{escape(name)}</h2>{text}</section>\n" for name, text in sections if text)
    footer = f"Made by cogless {escape(versions()['cogless'])}. Errors are at 95 % confidence."
    return frame(command, title, main, footer)


def note(text: str) -> str:
    """A remark as HTML."""
    return f'<p class="note">{escape(text)}</p>'


def reservations(sentences: Sequence[str]) -> str:
    """Notes on values that a table or plot leaves out, or shows with a reservation."""
    return "".join(f'<p class="note missed">{escape(sentence)}</p>' for sentence in sentences if sentence)


def sentences(remarks: Sequence[str]) -> str:
    """The remarks as an HTML list, a sentence each."""
    if not remarks:
        return note("Nothing is left out.")
    return '<ul class="verdicts">' + "".join(f"<li>{escape(line)}</li>" for line in remarks) + "</ul>"


def legend(colour_of: Mapping[str, str]) -> str:
    """A picture's legend as HTML. `colour_of`: for each label the name of a colour of report.css."""
    keys = (
        f'<span class="key" style="--colour:var({colour})">{escape(name)}</span>'
        for name, colour in colour_of.items()
    )
    return f'<p class="note">{" ".join(keys)}</p>'


def tint(results: AnyResults, controller: str) -> str:
    """The HTML attribute that gives an element a controller's colour."""
    return f'style="--colour:var(--c{colours(results)[controller]})"'


def key(results: AnyResults, controller: str, tag: str = "span") -> str:
    """A controller's label, marked with its colour, as HTML."""
    label = escape(results.study.label(controller))
    return f'<{tag} class="key" {tint(results, controller)}>{label}</{tag}>'


def headings(results: AnyResults, controllers: Iterable[str]) -> str:
    """The column headings of a table: one per controller."""
    marks = {results.study.baseline: ' <span class="base">(baseline)</span>'}
    return "".join(f"<th>{escape(results.study.label(c))}{marks.get(c, '')}</th>" for c in controllers)


def table_rows(lines: Iterable[tuple[str, str]]) -> str:
    """HTML rows of a table from pairs: a heading as text, and the row's cells as HTML."""
    return "".join(f"<tr><th>{escape(heading)}</th>{cells}</tr>" for heading, cells in lines)


def table(kind: str, caption: str, head: str, *bodies: str, attributes: str = "") -> str:
    """A table that scrolls sideways, by keyboard too, if it is wider than the page; "" without rows.

    `kind`: its CSS class; `caption`: its name for screen readers; `bodies`: groups of rows.
    """
    if not any(bodies):
        return ""
    groups = "".join(f"<tbody>{body}</tbody>" for body in bodies)
    head = f"<thead><tr>{head}</tr></thead>" if head else ""
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}">'
        f'<table class="{kind}"{attributes}>{head}{groups}</table></div>'
    )


def text_table(kind: str, caption: str, names: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of texts: its columns' names, and in each row a heading and cells."""
    lines = ((first, "".join(f"<td>{escape(cell)}</td>" for cell in cells)) for first, *cells in rows)
    return table(kind, caption, "".join(f"<th>{escape(name)}</th>" for name in names), table_rows(lines))


def bars(caption: str, rows: Iterable[tuple[str, Iterable[tuple[str, float]], str]]) -> str:
    """A table of bars. A row has a heading, the colour and length (1 is full) of each part, and a text."""
    lines = []
    for heading, parts, text in rows:
        bar = "".join(
            f'<div class="meter" style="--colour:{colour};width:{100 * share:.2f}%"></div>'
            for colour, share in parts
        )
        lines.append((heading, f'<td class="wide"><div>{bar}</div></td><td>{escape(text)}</td>'))
    return table("bars", caption, "", table_rows(lines))


def thin(x: Array, points: int) -> tuple[Array, float]:
    """Return at most `points` values of x that keep its peaks, and how many rows of x each stands for.

    Each bucket of rows gives its smallest and largest value, in their order in time, so the result is evenly
    spaced. A bucket with nothing but NaN gives NaN.
    """
    size = bucket(len(x), points)
    return (peaks(x, size), size / 2) if size else (x, 1.0)


def bucket(count: int, points: int) -> int:
    """Rows in a bucket, to thin `count` rows to at most `points` values; 0 if they are that few already."""
    return -(-count // (points // 2)) if count > points else 0


def peaks(x: Array, size: int) -> Array:
    """Smallest and largest value of each `size` rows of x, in their order in time."""
    x = np.concatenate((x, np.full(-len(x) % size, x[-1])))
    parts = x.reshape(-1, size)
    rows = np.arange(len(parts))
    gaps = np.isnan(parts)
    low, high = np.where(gaps, np.inf, parts).argmin(axis=1), np.where(gaps, -np.inf, parts).argmax(axis=1)
    pairs = np.column_stack((parts[rows, np.minimum(low, high)], parts[rows, np.maximum(low, high)]))
    return pairs.ravel()


def pack(x: Array) -> dict[str, Any]:
    """x as 16-bit integers in base64: x = offset + scale * integer; the lowest integer means not finite.

    Half the size of single precision, and finer than a screen can show: 1/65534 of the range.
    """
    finite = np.isfinite(x)
    low, high = (float(x[finite].min()), float(x[finite].max())) if finite.any() else (0.0, 0.0)
    scale = (high - low) / 65534 or 1.0
    offset = (high + low) / 2
    integers = np.where(finite, np.rint((np.where(finite, x, offset) - offset) / scale), -32768)
    return {
        "offset": offset,
        "scale": scale,
        "data": base64.b64encode(integers.astype("<i2").tobytes()).decode(),
    }


def unpack(packed: dict[str, Any]) -> Array:
    """The values of a packed array; NaN where they weren't finite."""
    integers = np.frombuffer(base64.b64decode(packed["data"]), dtype="<i2").astype(float)
    return np.asarray(packed["offset"] + packed["scale"] * np.where(integers == -32768, np.nan, integers))


def rms(x: Array) -> Array:
    """Root of the mean square along the last axis; infinite if a square overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(np.mean(np.square(x), axis=-1)))


def plain(values: Array) -> list[float | None]:
    """Values for JSON, to five digits; null if not finite. For short arrays: `pack` is smaller."""
    return [float(f"{v:.5g}") if math.isfinite(v) else None for v in values.tolist()]


def number(value: float) -> str:
    """The value to three significant digits, without an exponent if 1e-4 <= |value| < 1e6."""
    if value == 0 or not 1e-4 <= abs(value) < 1e6:
        return f"{value:.3g}"
    digits = max(0, 2 - math.floor(math.log10(abs(value)) + 1e-9))
    return f"{value:.{digits}f}"
