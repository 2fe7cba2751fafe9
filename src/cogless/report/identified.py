"""The report of an identification: values with errors, measured over simulated, what to record next."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from cogless.files import replacing, versions
from cogless.identify import described
from cogless.identify.command import Identified, lines
from cogless.identify.log import Log
from cogless.identify.result import Estimate, Wave
from cogless.identify.sessions import SESSION_KEYS, sessions
from cogless.identify.write import value_text
from cogless.report.charts import STYLE, Plot, save
from cogless.report.markup import asset, note, table
from cogless.results.trace import Array, Trace

PICTURE_WIDTH, PICTURE_HEIGHT, PICTURE_EDGE = 720, 200, 46  # px
PICTURE_POINTS = 700


def write_report(identified: Identified, path: Path) -> None:
    """Write the report; if this fails, no incomplete file is left."""
    with replacing(path) as temporary:
        temporary.write_text(render(identified), encoding="utf-8")


def render(identified: Identified) -> str:
    """The report as one HTML text that needs nothing else. All of the user's text is escaped."""
    estimate = identified.estimate
    sections = [
        ("Orders", _orders(estimate)),
        ("What was found", _values(estimate)),
        ("What is left out, and what to record next", sentences([*estimate.left_out, *estimate.remarks])),
        ("Measured over simulated", _replays(identified)),
        ("What each log contributed", _logs(estimate)),
        ("Sessions", _sessions(estimate)),
    ]
    return page_of("identify", estimate.identification.title, sections)


def page_of(command: str, title: str, sections: Sequence[tuple[str, str]]) -> str:
    """A page of these sections, heading and HTML each; empty ones are left out."""
    body = "".join(f"<section><h2>{escape(name)}</h2>{text}</section>" for name, text in sections if text)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{asset('report.css')}"
        ".picture{width:100%;height:auto}.picture text{font-size:12px;fill:var(--soft)}</style></head>"
        "<body>"
        f'<header><p class="brand">cogless {command}</p><h1>{escape(title)}</h1></header>'
        f"<main>{body}</main><footer><p>Made by cogless {escape(versions()['cogless'])}. "
        "Errors are at 95 % confidence.</p></footer></body></html>\n"
    )


def _values(estimate: Estimate) -> str:
    rows = "".join(
        f"<tr><th>{escape(line[:30].strip())}</th><td>{escape(line[30:].strip())}</td></tr>"
        for line in lines(estimate)
    )
    return table("", "Values", "<th>Value</th><th>with its error</th>", rows) or note(
        "Nothing could be told."
    )


def sentences(remarks: Sequence[str]) -> str:
    """Sentences as a list."""
    if not remarks:
        return note("Nothing is left out.")
    return '<ul class="verdicts">' + "".join(f"<li>{escape(line)}</li>" for line in remarks) + "</ul>"


def write_plot(estimate: Estimate, path: Path) -> None:
    """Write a picture of the orders, as PNG; none where there are no orders."""
    import matplotlib

    palette = re.findall(r"--c\d: (#\w+);", asset("report.css"))

    def bars(waves: Sequence[Wave], factor: float, ax: Any) -> None:
        for n, wave in enumerate(waves):
            size, error = factor * wave.size.value, factor * wave.size.error
            ax.bar([n], [size], 0.6, color=palette[1])
            ax.plot([n, n], [size - error, size + error], color="#1b1f24", linewidth=2)
        ax.set_xticks(range(len(waves)), [str(wave.order) for wave in waves])
        ax.set_xlim(-1, max(3, len(waves)))
        ax.grid(axis="x", visible=False)

    rows = [
        [Plot(partial(bars, waves, factor), "mechanical order", unit, title)]
        for title, waves, factor, unit in _kinds(estimate)
    ]
    if rows:
        with matplotlib.rc_context(STYLE):
            save(path, f"{estimate.identification.title}: orders, with errors at 95 %", rows, 1.7, "")


def _kinds(estimate: Estimate) -> list[tuple[str, tuple[Wave, ...], float, str]]:
    """What has orders: its title, waves, and the factor to a unit."""
    kinds = (
        ("Cogging", estimate.cogging, 1e3 * estimate.K_t, "mN m"),
        ("Ripple of K_t", estimate.ripple, 100.0, "%"),
        ("Encoder's error", estimate.encoder, math.degrees(1), "deg"),
    )
    return [kind for kind in kinds if kind[1]]


def _orders(estimate: Estimate) -> str:
    return "".join(_bars(title, waves, factor, unit) for title, waves, factor, unit in _kinds(estimate))


def _bars(title: str, waves: Sequence[Wave], factor: float, unit: str) -> str:
    top = max(wave.size.value + wave.size.error for wave in waves) * factor
    place = (PICTURE_WIDTH - PICTURE_EDGE) / len(waves)
    parts = []
    for n, wave in enumerate(waves):
        x, low = PICTURE_EDGE + (n + 0.5) * place, PICTURE_HEIGHT - 24
        height = (PICTURE_HEIGHT - 40) * factor / top
        y, e = low - height * wave.size.value, height * wave.size.error
        half = min(20.0, 0.3 * place)
        parts.append(
            f'<rect x="{x - half:.1f}" y="{y:.1f}" width="{2 * half:.1f}" height="{low - y:.1f}" '
            'fill="var(--c1)"/>'
            f'<path d="M{x:.1f} {y - e:.1f}V{y + e:.1f}" stroke="var(--ink)" stroke-width="2"/>'
            f'<text x="{x:.1f}" y="{PICTURE_HEIGHT - 8}" text-anchor="middle">{wave.order}</text>'
        )
    parts.append(f'<text x="0" y="16">{top:.3g}</text><text x="0" y="{PICTURE_HEIGHT - 24}">0</text>')
    return f"<h3>{escape(title)} ({escape(unit)}) by mechanical order, with errors</h3>" + _picture(
        title, "".join(parts)
    )


def _picture(title: str, inner: str) -> str:
    box = f'viewBox="0 0 {PICTURE_WIDTH} {PICTURE_HEIGHT}" role="img"'
    return f'<svg class="picture" {box} aria-label="{escape(title)}">{inner}</svg>'


def _replays(identified: Identified) -> str:
    estimate = identified.estimate
    logs = [log for log in described.replayable(estimate) if log.name in identified.traces]
    text = "".join(
        _overlay(log, trace, measured, simulated)
        for log in logs
        for trace in [identified.traces[log.name]]
        for measured, simulated in (("omega", "omega_measured"), ("i_q", "i_q"))
        if measured in log
    )
    key = (
        '<p class="note"><span class="key" style="--colour:var(--c0)">measured</span> '
        '<span class="key" style="--colour:var(--c2)">simulated</span></p>'
    )
    return key + text if text else ""


def _overlay(log: Log, trace: Trace, measured: str, simulated: str) -> str:
    """One log's signal over the simulated one, in a second from its middle."""
    x, y = (
        log[measured][log.stretches[0]],
        np.asarray(trace[simulated])[:: max(1, round(log.dt / trace.period))],
    )
    count = min(len(x), len(y), round(1.0 / log.dt))
    start = max(0, (min(len(x), len(y)) - count) // 2)
    x, y = x[start : start + count], y[start : start + count]
    low, high = float(min(x.min(), y.min())), float(max(x.max(), y.max()))
    span = (high - low) or 1.0
    every = max(1, count // PICTURE_POINTS)

    width, height = PICTURE_WIDTH - PICTURE_EDGE, PICTURE_HEIGHT - 40

    def line(values: Array, colour: str) -> str:
        points = " ".join(
            f"{PICTURE_EDGE + width * n / count:.1f},{PICTURE_HEIGHT - 20 - height * (v - low) / span:.1f}"
            for n, v in zip(range(0, count, every), values[::every], strict=True)
        )
        return f'<polyline points="{points}" fill="none" stroke="var({colour})" stroke-width="1.3"/>'

    axis = f'<text x="0" y="24">{high:.3g}</text><text x="0" y="{PICTURE_HEIGHT - 20}">{low:.3g}</text>'
    unit = "rad/s" if measured == "omega" else "A"
    ratio = float(np.std(y) / np.std(x)) if np.std(x) else float("nan")
    title = f"{log.name}: {measured} ({unit}), 1 s; standard deviation simulated over measured {ratio:.2f}"
    return f"<h3>{escape(title)}</h3>" + _picture(title, line(x, "--c0") + line(y, "--c2") + axis)


def _logs(estimate: Estimate) -> str:
    """Rows, kind and residual of each log, and how well the others predict its current."""
    if estimate.fit is None:
        return ""
    body = ""
    for log in estimate.logs:
        rows = [row for row in estimate.rows if row.log.name == log.name and len(row.y)]
        if not rows:
            continue
        y = np.concatenate([row.y for row in rows])
        own = np.concatenate([row.y - estimate.fit.prediction(row) for row in rows])
        others = np.concatenate([row.y - estimate.fit.prediction(row, log.name) for row in rows])
        spread = float(np.std(y)) or 1.0
        cells = [
            log.kind or "not said",
            f"{len(log)}",
            f"{1e3 * float(np.std(own)):.3g} mA",
            f"{100 * float(np.std(others)) / spread:.2g} % of its current",
        ]
        body += f"<tr><th>{escape(log.name)}</th>{''.join(f'<td>{escape(c)}</td>' for c in cells)}</tr>"
    names = ("Log", "kind", "rows", "not explained, rms", "error when predicted by the others")
    head = "".join(f"<th>{name}</th>" for name in names)
    return table("numbers", "Logs", head, body)


def _sessions(estimate: Estimate) -> str:
    """Friction and offset of each session that the file of columns names."""
    body = ""
    for session in sessions(estimate):
        cells = [", ".join(session.logs)]
        values = [session.values.get(key) for key in SESSION_KEYS]
        cells += ["not told" if value is None else value_text(value, "A") for value in values]
        body += f"<tr><th>{escape(session.name)}</th>{''.join(f'<td>{escape(c)}</td>' for c in cells)}</tr>"
    head = "".join(f"<th>{name}</th>" for name in ("Session", "logs", "friction over K_t", "offset of i_q"))
    return table("", "Sessions", head, body) if body else ""
