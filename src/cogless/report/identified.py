"""The report of an identification: values with errors, measured over simulated, what to record next."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from cogless.files import replacing
from cogless.identify import described
from cogless.identify.command import Identified, value_lines
from cogless.identify.log import Log
from cogless.identify.result import Estimate, Value, Wave
from cogless.identify.sessions import SESSION_KEYS, sessions
from cogless.identify.write import value_text
from cogless.report import svg
from cogless.report.markup import asset, bars, legend, note, sentences, still_page, text_table
from cogless.report.pictures import STYLE, Plot, save
from cogless.results.trace import Trace

PICTURE_POINTS = 1000  # least number of points of a curve, if the log has as many
ERROR_COLOUR = "color-mix(in srgb, var(--c1) 35%, transparent)"


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
        ("Measured and simulated", _replays(identified)),
        ("What each log contributed", _logs(estimate)),
        ("Sessions", _sessions(estimate)),
    ]
    return still_page("identify", estimate.identification.title, sections)


def _values(estimate: Estimate) -> str:
    rows = [(line[:30].strip(), line[30:].strip()) for line in value_lines(estimate)]
    return text_table("", "Values", ("Value", "with its error"), rows) or note("Nothing could be identified.")


def write_plot(estimate: Estimate, path: Path) -> None:
    """Write a picture of the orders, as PNG; without orders write nothing."""
    import matplotlib

    palette = re.findall(r"--c\d: (#\w+);", asset("report.css"))

    def draw(waves: Sequence[Wave], factor: float, ax: Any) -> None:
        for n, wave in enumerate(waves):
            size, error = factor * wave.size.value, factor * wave.size.error
            ax.bar([n], [size], 0.6, color=palette[1])
            ax.plot([n, n], [size - error, size + error], color="#1b1f24", linewidth=2)
        ax.set_xticks(range(len(waves)), [str(wave.order) for wave in waves])
        ax.set_xlim(-1, max(3, len(waves)))
        ax.grid(axis="x", visible=False)

    rows = [
        [Plot(partial(draw, waves, factor), "mechanical order", unit, title)]
        for title, waves, factor, unit in _shown_kinds(estimate)
    ]
    if rows:
        with matplotlib.rc_context(STYLE):
            save(path, f"{estimate.identification.title}: orders, with errors at 95 %", rows, 1.7, "")


def _shown_kinds(estimate: Estimate) -> list[tuple[str, tuple[Wave, ...], float, str]]:
    """Each kind of wave that has orders: title, waves, the factor to a display unit, and this unit."""
    return [
        (title[0].upper() + title[1:], estimate.waves(name), factor, unit.replace("*", " "))
        for title, name, factor, unit in estimate.kinds
        if estimate.waves(name)
    ]


def _orders(estimate: Estimate) -> str:
    """A bar for each order; the part within the error of its size is faint."""
    text = ""
    for title, waves, factor, unit in _shown_kinds(estimate):
        rows = []
        top = max(wave.size.value + wave.size.error for wave in waves)
        for wave in waves:
            low, high = max(0.0, wave.size.value - wave.size.error), wave.size.value + wave.size.error
            parts = [("var(--c1)", low / top), (ERROR_COLOUR, (high - low) / top)]
            size = Value(factor * wave.size.value, factor * wave.size.error)
            rows.append((str(wave.order), parts, value_text(size, unit)))
        text += f"<h3>{escape(title)} by mechanical order, with errors</h3>{bars(title, rows)}"
    return text


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
    key = legend({"measured": "--c0", "simulated": "--c2"})
    return f'{key}<div class="panels">{text}</div>' if text else ""


def _overlay(log: Log, trace: Trace, measured: str, simulated: str) -> str:
    """A picture of a log's signal and the simulated one, over a second in the middle."""
    x, y = (
        log[measured][log.stretches[0]],
        np.asarray(trace[simulated])[:: max(1, round(log.dt / trace.period))],
    )
    rows = min(len(x), len(y))
    count = min(rows, round(1.0 / log.dt))
    start = max(0, (rows - count) // 2)
    x, y = x[start : start + count], y[start : start + count]
    every = slice(None, None, max(1, count // PICTURE_POINTS))
    unit = "rad/s" if measured == "omega" else "A"
    values = svg.linear(f"{measured} ({unit})", float(min(x.min(), y.min())), float(max(x.max(), y.max())))
    axes = svg.Axes(svg.linear("time (s)", 0.0, count * log.dt), values, svg.PAGE_WIDTH)
    time = log.dt * np.arange(count)[every]
    drawn = [axes.line(time, v[every], colour) for v, colour in ((x, "--c0"), (y, "--c2"))]
    ratio = float(np.std(y) / np.std(x)) if np.std(x) else float("nan")
    title = f"{log.name}: 1 s of {measured} ({unit}). Standard deviation, simulated / measured: {ratio:.2f}"
    return axes.panel(title, *drawn)


def _logs(estimate: Estimate) -> str:
    """Rows, kind and residual of each log, and how well the other logs predict its current."""
    if estimate.fit is None:
        return ""
    body = []
    for log in estimate.logs:
        rows = [row for row in estimate.rows if row.log.name == log.name and len(row.y)]
        if not rows:
            continue
        y = np.concatenate([row.y for row in rows])
        own = np.concatenate([row.y - estimate.fit.prediction(row) for row in rows])
        others = np.concatenate([row.y - estimate.fit.prediction(row, log.name) for row in rows])
        spread = float(np.std(y)) or 1.0
        cells = [
            log.name,
            log.kind or "not given",
            f"{len(log)}",
            f"{1e3 * float(np.std(own)):.3g} mA",
            f"{100 * float(np.std(others)) / spread:.2g} % of its current",
        ]
        body.append(cells)
    names = ("Log", "kind", "rows", "not explained, rms", "error if predicted from the other logs")
    return text_table("numbers", "Logs", names, body)


def _sessions(estimate: Estimate) -> str:
    """Friction and offset of each session that the file of columns names."""
    rows = []
    for session in sessions(estimate):
        values = [session.values.get(key) for key in SESSION_KEYS]
        texts = ["not known" if value is None else value_text(value, "A") for value in values]
        rows.append([session.name, ", ".join(session.logs), *texts])
    return text_table("", "Sessions", ("Session", "logs", "friction over K_t", "offset of i_q"), rows)
