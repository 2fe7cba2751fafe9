"""The report's tables of numbers: metrics by controller, and the RMS of each term of a law.

Another table has ripple and jitter late in a run, true and measured, whether or not the study has metrics
for them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from html import escape
from math import isfinite

import numpy as np

from cogless.report.comparison import (
    Line,
    compare,
    factor_text,
    pretty,
    remarks,
    speed_unit,
    unjudged,
)
from cogless.report.markup import headings, key, note, number, reservations, rms, table, table_rows, tint
from cogless.report.panels import LEARNED_SIGNALS
from cogless.results import AnyResults, Results, Run
from cogless.results.metrics import evaluate
from cogless.results.windows import in_torque_mode, late
from cogless.study.base import spoken_unit
from cogless.study.metric import SIGNAL_DIMENSIONS, Metric
from cogless.units import ANGLE, factor


def line_table(results: AnyResults, runs: Sequence[Run], lines: Sequence[Line]) -> str:
    """HTML table: a row per line, a column per controller, marks of the best, ratios to the baseline."""
    scenario, controllers = runs[0].scenario, [run.controller for run in runs]
    head = f"<th>{escape(scenario)}</th>{headings(results, controllers)}"
    body = table_rows((line.title, _cells(line, controllers, results.study.baseline)) for line in lines)
    html = table("numbers", f"Numbers of {scenario}", head, body)
    html = html or note(f"No metric is taken in {scenario}.")
    return html + reservations(remarks(results.study, scenario, lines))


def _cells(line: Line, controllers: Sequence[str], baseline: str) -> str:
    cells = []
    for controller in controllers:
        ratio = line.ratio(controller, baseline) if controller != baseline else None
        factor = f' <span class="ratio">{factor_text(ratio)}</span>' if ratio is not None else ""
        sort = "best" if controller in line.best else "missed" if controller in line.missed else ""
        value = escape(line.value_text(controller))
        cells.append(f'<td class="{sort}"><span class="value">{value}</span>{factor}</td>')
    return "".join(cells)


def term_tables(results: Results, runs: Sequence[Run]) -> str:
    """Tables of the RMS of each law's terms late in the run, and of their varying parts; "" without terms."""
    tables = "".join(_terms(results, run) for run in runs)
    heading = note(
        f"RMS of each term of the current reference late in scenario {runs[0].scenario}. The varying part is "
        "the RMS about the term's mean, without the constant current that carries the load."
    )
    return heading + tables if tables else ""


def _terms(results: Results, run: Run) -> str:
    part, controller = late(results, run), run.controller
    out = () if results.study.controller[controller].learned else LEARNED_SIGNALS
    names = [name for name in run.trace.names if name.startswith("term_") and name not in out]
    terms = [run.trace.part(name, part) for name in names]
    if not terms or not len(terms[0]):
        return ""
    totals = [float(rms(x)) for x in terms]
    varying = [float(np.std(x)) for x in terms]
    body = table_rows(
        (name.removeprefix("term_").replace("_", " "), total + changes)
        for name, total, changes in zip(names, _meters(totals), _meters(varying), strict=True)
    )
    head = '<th>term</th><th class="figure">RMS</th><th></th><th class="figure">varying part</th><th></th>'
    caption = f"Terms of {results.study.label(controller)}"
    html = table("terms", caption, head, body, attributes=f" {tint(results, controller)}")
    return key(results, controller, "h3") + html


def _meters(figures: Sequence[float]) -> list[str]:
    """Table cells for values in A, each with a bar of proportional length."""
    top = max(filter(math.isfinite, figures), default=0.0) or 1.0
    shares = [figure / top if math.isfinite(figure) else 0.0 for figure in figures]
    return [
        f'<td class="figure">{number(figure)} A</td>'
        f'<td class="wide"><div class="meter" style="width:{100 * share:.1f}%"></div></td>'
        for figure, share in zip(figures, shares, strict=True)
    ]


REST_SPEED_MOST = 1e-9  # rad/s; below this reference the drive holds its position

DELAY_NOTE = (
    "Over the last part of the run, from {:.4g} to {:.4g} s. Jitter is the deviation from the mean. Torque "
    "ripple is "
    "(max \u2212 min) / (max + min). The law sees the measured values, the load the true ones."
)


def late_table(results: Results, runs: Sequence[Run]) -> str:
    """The table of ripple and jitter late in the runs, as HTML; "" if no run has rows."""
    drawn = [run for run in runs if len(run.trace) > 1 and late(results, run).stop > late(results, run).start]
    lines = list(_compared_lines(results, drawn)) if drawn else []
    if not lines:
        return ""
    span = drawn[0].trace.time[late(results, drawn[0])][[0, -1]]
    return note(DELAY_NOTE.format(*span)) + line_table(results, drawn, lines)


def _compared_lines(results: Results, runs: Sequence[Run]) -> Iterator[Line]:
    study, scenario = results.study, runs[0].scenario
    # a controller that did not hold the speed, or learned nothing, isn't the best here either
    compared = compare(results, scenario)
    missed = {c: how for line in compared for c, how in line.missed.items()}
    idle = {c: why for line in compared for c, why in line.unlearned.items()}
    conditions = study.conditions(scenario)
    for name, signal, kind, unit in _signal_rows(results, runs):
        scale = factor(unit, SIGNAL_DIMENSIONS[signal]) if unit else 1.0
        values: dict[str, float | None] = {}
        for run in runs:
            begin, end = run.trace.time[late(results, run)][[0, -1]]
            metric = Metric.model_construct(name=name, kind=kind, signal=signal, window=(begin, end))
            value = evaluate(metric, run.trace, conditions)
            values[run.controller] = value / scale if isinstance(value, float) and isfinite(value) else None
        line = Line(
            name=name,
            kind=kind,
            signal=signal,
            order=None,
            frame="mechanical",
            better="lower",
            unit=pretty(unit),
            values=values,
            missed=missed,
            unlearned=idle,
        )
        rows = late(results, run)
        yield replace(line, unjudged=unjudged(metric, run, rows, in_torque_mode(study, run, rows)))


def _signal_rows(results: Results, runs: Sequence[Run]) -> Iterator[tuple[str, str, str, str]]:
    """Name, signal, kind and unit of each row; a signal that some run lacks has no row."""
    trace, part = runs[0].trace, late(results, runs[0])
    still = not np.any(np.abs(trace.part("omega_ref", part)) > REST_SPEED_MOST)
    speed, angle = speed_unit(results), spoken_unit(results.study, ANGLE)
    rows = [
        ("speed ripple, rms", "omega_error", "ripple-rms", speed),
        ("speed ripple as measured, rms", "omega_error_measured", "ripple-rms", speed),
    ]
    if not still:
        rows.append(("torque ripple, (max \u2212 min) / (max + min)", "tau_motor", "ripple-ratio", ""))
    if still or any(results.study.controller[run.controller].holds_position for run in runs):
        signal = "theta_m" if still else "theta_error"
        measured = "theta_measured" if still else "theta_error_measured"
        for word, kind in (("rms", "ripple-rms"), ("3 sigma", "three-sigma")):
            rows += [
                (f"position jitter, {word}", signal, kind, angle),
                (f"position jitter as measured, {word}", measured, kind, angle),
            ]
    return (row for row in rows if all(row[1] in run.trace for run in runs))
