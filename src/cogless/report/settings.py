"""The study as readable tables, with the texts and units of its file, and its assumptions with reasons."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Any

from cogless.report.markup import rows
from cogless.study.base import StudyBase

SHOWN_ELSEWHERE = ("title", "description", "assumption", "seed")


def settings(study: StudyBase) -> str:
    """One small HTML table for each table of the study, with values as in its file and datasheet."""
    groups = []
    for name, table in _groups(study.source.tables):
        body = rows((key, f"<td>{escape(text)}</td>") for key, text in _texts(table))
        if body:
            groups.append(
                f'<div class="group"><h3><code>[{escape(name)}]</code></h3>'
                f'<div class="boxed"><table>{body}</table></div></div>'
            )
    return f'<div class="settings">{"".join(groups)}</div>'


def assumptions(study: StudyBase) -> str:
    """The HTML table of the study's assumptions with their reasons; "" without assumptions."""
    if not study.assumption:
        return ""
    body = "".join(
        f"<tr><th><code>{escape(a.about)}</code></th><td>{escape(a.reason)}</td></tr>"
        for a in study.assumption
    )
    head = "<thead><tr><th>Assumption about</th><th>because</th></tr></thead>"
    return f'<h3>Assumptions</h3><div class="boxed"><table>{head}<tbody>{body}</tbody></table></div>'


def _groups(tables: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields each table with its dotted name: one per scenario and controller; each metric is one line."""
    for name, table in tables.items():
        if name in SHOWN_ELSEWHERE:
            continue
        if name in ("scenario", "controller"):
            yield from ((f"{name}.{key}", inner) for key, inner in table.items())
        elif isinstance(table, list):
            yield name, {str(row.get("name", i)): _summary(row) for i, row in enumerate(table)}
        elif isinstance(table, dict):
            yield name, table


def _summary(row: dict[str, Any]) -> str:
    return "; ".join(f"{key} {_text(value)}" for key, value in row.items() if key != "name")


def _texts(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in table.items():
        if isinstance(value, dict) and value:
            yield from _texts(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", _text(value)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(inner)}" for key, inner in value.items())
    if isinstance(value, list):
        tables = any(isinstance(item, dict) for item in value)
        return ("; " if tables else ", ").join(_text(item) for item in value)
    return str(value)
