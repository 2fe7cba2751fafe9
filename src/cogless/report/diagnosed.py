"""The report of a diagnosis: the answer, each log's causes as bars, the orders, what stays open."""

from __future__ import annotations

import math
from html import escape
from pathlib import Path

from cogless.files import replacing
from cogless.identify.diagnosis import LINE_SHARE_LEAST, Diagnosis, answer, cause_text, sizes
from cogless.report.identified import page_of, sentences
from cogless.report.markup import note, table
from cogless.units import TURN

DIAGNOSIS_COLOURS = 6  # colours of the palette


def write_report(diagnosis: Diagnosis, path: Path) -> None:
    """Write the report; if this fails, no incomplete file is left."""
    with replacing(path) as temporary:
        temporary.write_text(render(diagnosis), encoding="utf-8")


def render(diagnosis: Diagnosis) -> str:
    """The report as one HTML text that needs nothing else. All of the user's text is escaped."""
    sections = [
        ("Where the ripple comes from", note(answer(diagnosis)) + _bars(diagnosis) + _logs(diagnosis)),
        ("Orders", _orders(diagnosis)),
        ("What stays open, and what to record next", sentences(diagnosis.remarks)),
    ]
    return page_of("diagnose", diagnosis.title, sections)


def _bars(diagnosis: Diagnosis) -> str:
    """A bar for each log, its parts the shares of its causes."""
    names = list(dict.fromkeys(name for log in diagnosis.whole for name in diagnosis.causes(log)))
    colour = {name: f"var(--c{n % DIAGNOSIS_COLOURS})" for n, name in enumerate(names)}
    rows, high = "", 34
    for n, log in enumerate(diagnosis.whole):
        shares = {name: max(0.0, share) for name, share in diagnosis.causes(log).items()}
        whole, x, y = sum(shares.values()) or 1.0, 170.0, high * n
        rows += f'<text x="0" y="{y + 20}">{escape(log[:24])}</text>'
        for name, share in shares.items():
            width = 540 * share / whole
            rows += f'<rect x="{x:.1f}" y="{y + 6}" width="{width:.1f}" height="22" fill="{colour[name]}"/>'
            x += width
    key = " ".join(
        f'<span class="key" style="--colour:{colour[name]}">{escape(name)}</span>' for name in names
    )
    box = f'viewBox="0 0 720 {high * len(diagnosis.whole)}" role="img" aria-label="Shares of the causes"'
    return f'<p class="note">{key}</p><svg class="picture" {box}>{rows}</svg>'


def _logs(diagnosis: Diagnosis) -> str:
    """The ripple of each log with the part of it that is measurement, or the log's other use."""
    ripples = [f"{log}: {sizes(diagnosis, log)}" for log in diagnosis.whole]
    return sentences([*ripples, *(f"{log}: {use}" for log, use in diagnosis.uses.items())])


def _orders(diagnosis: Diagnosis) -> str:
    body = ""
    for order in diagnosis.orders:
        if order.share < LINE_SHARE_LEAST:
            continue
        cells = [
            f"{order.order}",
            f"{order.speed / TURN:.3g} rev/s",
            "" if math.isnan(order.load) else f"{order.load:.3g} A",
            f"{order.ripple:.3g} rad/s",
            f"{100 * order.share:.0f} %",
            ", ".join(cause_text(cause) for cause in order.causes if abs(cause.share) > 0.05),
            order.confidence,
        ]
        body += (
            f"<tr><th>{escape(order.log)}</th>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
        )
    names = ("Log", "order", "speed", "load", "ripple, rms", "of the square", "causes", "confidence")
    return table("numbers", "Orders", "".join(f"<th>{name}</th>" for name in names), body)
