"""The report of a diagnosis: the answer, each log's causes as bars, the orders, what stays open."""

from __future__ import annotations

import math
from pathlib import Path

from cogless.files import replacing
from cogless.identify.diagnosis import LINE_SHARE_LEAST, Diagnosis, answer, cause_text, sizes
from cogless.report.markup import COLOUR_COUNT, bars, legend, note, sentences, still_page, text_table
from cogless.units import TURN


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
    return still_page("diagnose", diagnosis.title, sections)


def _bars(diagnosis: Diagnosis) -> str:
    """A bar for each log; the parts of the bar are the shares of the log's causes."""
    causes = {log: diagnosis.causes(log) for log in diagnosis.whole}
    names = dict.fromkeys(name for shares in causes.values() for name in shares)
    colour = {name: f"--c{n % COLOUR_COUNT}" for n, name in enumerate(names)}
    rows = []
    for log, shares in causes.items():
        positive = {name: share for name, share in shares.items() if share > 0}
        whole = sum(positive.values())
        rows.append((log, [(f"var({colour[name]})", share / whole) for name, share in positive.items()], ""))
    return legend(colour) + bars("Shares of the causes", rows)


def _logs(diagnosis: Diagnosis) -> str:
    """The ripple of each log and the part of the ripple that is measurement; or the log's other use."""
    ripples = [f"{log}: {sizes(diagnosis, log)}" for log in diagnosis.whole]
    return sentences([*ripples, *(f"{log}: {use}" for log, use in diagnosis.uses.items())])


def _orders(diagnosis: Diagnosis) -> str:
    rows = [
        [
            order.log,
            f"{order.order}",
            f"{order.speed / TURN:.3g} rev/s",
            "" if math.isnan(order.load) else f"{order.load:.3g} A",
            f"{order.ripple:.3g} rad/s",
            f"{100 * order.share:.0f} %",
            ", ".join(cause_text(cause) for cause in order.causes if abs(cause.share) > 0.05),
            order.confidence,
        ]
        for order in diagnosis.orders
        if order.share >= LINE_SHARE_LEAST
    ]
    names = ("Log", "order", "speed", "load", "ripple, rms", "share of the square", "causes", "confidence")
    return text_table("numbers", "Orders", names, rows)
