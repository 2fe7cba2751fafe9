"""The report's tables of numbers: metrics by controller, and the share of each term of a law."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from cogless.report.comparison import Line, compare, factor_text, remarks
from cogless.report.markup import controller_heading, note, reservations, scrolled
from cogless.report.packing import number
from cogless.report.palette import colours
from cogless.report.paths import LEARNED, learns
from cogless.report.speed_tracking import late
from cogless.results import AnyResults, Results, Run


def metric_table(results: Results, scenario: str) -> str:
    """Metrics down, controllers across; best marked, ratio to the baseline."""
    lines = compare(results, scenario)
    return line_table(results, scenario, lines) + reservations(remarks(results.study, lines))


def line_table(results: AnyResults, scenario: str, lines: Sequence[Line]) -> str:
    """A scenario's lines down, its controllers across."""
    if not lines:
        return note(f"No metric is taken in {scenario}.")
    label, baseline = results.study.label, results.study.baseline
    controllers = [run.controller for run in results.runs if run.scenario == scenario]
    head = "".join(controller_heading(label(c), c == baseline) for c in controllers)
    body = "".join(_row(line, controllers, baseline) for line in lines)
    table = f"<thead><tr><th>{escape(scenario)}</th>{head}</tr></thead><tbody>{body}</tbody>"
    return scrolled(f'<table class="numbers">{table}</table>', f"Numbers of {scenario}")


def term_tables(results: Results, scenario: str) -> str:
    """RMS of each term of each law late in the run, and of its varying part; empty where there are none."""
    runs = [run for run in results.runs if run.scenario == scenario]
    tables = "".join(_terms(results, run, results.study.label(run.controller)) for run in runs)
    about = note(
        f"RMS of each term of the current reference late in {scenario}; the varying part is about its mean, "
        "so it leaves out what only carries the load."
    )
    return about + tables if tables else ""


def _row(line: Line, controllers: list[str], baseline: str) -> str:
    cells = []
    for controller in controllers:
        ratio = line.ratio(controller, baseline)
        factor = f' <span class="ratio">{factor_text(ratio)}</span>' if ratio is not None else ""
        if controller == baseline:
            factor = ""
        sort = "best" if controller in line.best else "missed" if controller in line.missed else ""
        value = escape(line.text(controller))
        cells.append(f'<td class="{sort}"><span class="value">{value}</span>{factor}</td>')
    return f"<tr><th>{escape(line.title)}</th>{''.join(cells)}</tr>"


def _terms(results: Results, run: Run, label: str) -> str:
    trace = run.trace
    rows = late(results, run)
    names = [name for name in trace.names if name.startswith("term_")] if rows.stop > rows.start else []
    if not learns(results.study, run.controller):
        names = [name for name in names if name not in LEARNED]
    figures = [(float(np.sqrt(np.mean(trace[n][rows] ** 2))), float(np.std(trace[n][rows]))) for n in names]
    top, most = (_largest(column) for column in zip(*figures, strict=True)) if figures else (1.0, 1.0)
    body = "".join(
        f"<tr><th>{escape(name.removeprefix('term_').replace('_', ' '))}</th>"
        f'<td class="figure">{number(rms)} A</td><td class="wide">{_meter(rms / top)}</td>'
        f'<td class="figure">{number(varying)} A</td><td class="wide">{_meter(varying / most)}</td></tr>'
        for name, (rms, varying) in zip(names, figures, strict=True)
    )
    if not body:
        return ""
    head = '<th>term</th><th class="figure">RMS</th><th></th><th class="figure">varying part</th><th></th>'
    colour = colours(results)[run.controller]
    style = f'style="--colour:var(--c{colour})"'
    table = f'<table class="terms" {style}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
    return f'<h3 class="key" {style}>{escape(label)}</h3>' + scrolled(table, f"Terms of {label}")


def _largest(figures: Sequence[float]) -> float:
    return max(filter(math.isfinite, figures), default=0.0) or 1.0


def _meter(share: float) -> str:
    share = share if math.isfinite(share) else 0.0
    return f'<div class="meter" style="width:{100 * share:.1f}%"></div>'
