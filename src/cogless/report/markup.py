"""Pieces of HTML that the page's sections share. All of the user's text is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from html import escape
from importlib.resources import files

from cogless.report.palette import colours
from cogless.results import AnyResults

NONE = "–"  # noqa: RUF001


@cache
def asset(name: str) -> str:
    """The text of a file in the package's folder assets/."""
    return (files("cogless.report") / "assets" / name).read_text(encoding="utf-8")


def note(text: str) -> str:
    """A remark as HTML."""
    return f'<p class="note">{escape(text)}</p>'


def reservations(sentences: Sequence[str]) -> str:
    """Notes on values that a table or plot leaves out, or shows with a reservation."""
    return "".join(f'<p class="note missed">{escape(sentence)}</p>' for sentence in sentences if sentence)


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


def rows(lines: Iterable[tuple[str, str]]) -> str:
    """HTML rows of a table from pairs: a heading as text, and the row's cells as HTML."""
    return "".join(f"<tr><th>{escape(heading)}</th>{cells}</tr>" for heading, cells in lines)


def table(kind: str, about: str, head: str, *bodies: str, attributes: str = "") -> str:
    """A table that scrolls sideways, by keyboard too, if it is wider than the page; "" without rows.

    `kind`: its CSS class; `about`: its name for screen readers; `bodies`: groups of rows.
    """
    if not any(bodies):
        return ""
    groups = "".join(f"<tbody>{body}</tbody>" for body in bodies)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(about)}">'
        f'<table class="{kind}"{attributes}><thead><tr>{head}</tr></thead>{groups}</table></div>'
    )
