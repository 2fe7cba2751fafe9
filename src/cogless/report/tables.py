"""The report's tables of numbers: metrics by controller, and the RMS of each term of a law."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from cogless.report.comparison import Line, factor_text, remarks
from cogless.report.markup import headings, key, note, reservations, rows, table, tint
from cogless.report.packing import number, rms
from cogless.report.paths import LEARNED
from cogless.report.speed_tracking import late
from cogless.results import AnyResults, Results, Run


def line_table(results: AnyResults, runs: Sequence[Run], lines: Sequence[Line]) -> str:
    """HTML table with a row per line and a column per controller; best marked, ratio to the baseline."""
    scenario, controllers = runs[0].scenario, [run.controller for run in runs]
    head = f"<th>{escape(scenario)}</th>{headings(results, controllers)}"
    body = rows((line.title, _cells(line, controllers, results.study.baseline)) for line in lines)
    found = table("numbers", f"Numbers of {scenario}", head, body)
    found = found or note(f"No metric is taken in {scenario}.")
    return found + reservations(remarks(results.study, lines))


def _cells(line: Line, controllers: Sequence[str], baseline: str) -> str:
    cells = []
    for controller in controllers:
        ratio = line.ratio(controller, baseline) if controller != baseline else None
        factor = f' <span class="ratio">{factor_text(ratio)}</span>' if ratio is not None else ""
        sort = "best" if controller in line.best else "missed" if controller in line.missed else ""
        value = escape(line.text(controller))
        cells.append(f'<td class="{sort}"><span class="value">{value}</span>{factor}</td>')
    return "".join(cells)


def term_tables(results: Results, runs: Sequence[Run]) -> str:
    """Tables of the RMS of each law's terms late in the run, and of their varying parts; "" without terms."""
    tables = "".join(_terms(results, run) for run in runs)
    about = note(
        f"RMS of each term of the current reference late in {runs[0].scenario}; the varying part is about "
        "its mean, so it leaves out what only carries the load."
    )
    return about + tables if tables else ""


def _terms(results: Results, run: Run) -> str:
    part, controller = late(results, run), run.controller
    out = () if results.study.controller[controller].learned else LEARNED
    names = [name for name in run.trace.names if name.startswith("term_") and name not in out]
    terms = [run.trace.part(name, part) for name in names]
    if not terms or not len(terms[0]):
        return ""
    totals = [float(rms(x)) for x in terms]
    varying = [float(np.std(x)) for x in terms]
    body = rows(
        (name.removeprefix("term_").replace("_", " "), total + changes)
        for name, total, changes in zip(names, _meters(totals), _meters(varying), strict=True)
    )
    head = '<th>term</th><th class="figure">RMS</th><th></th><th class="figure">varying part</th><th></th>'
    about = f"Terms of {results.study.label(controller)}"
    found = table("terms", about, head, body, attributes=f" {tint(results, controller)}")
    return key(results, controller, "h3") + found


def _meters(figures: Sequence[float]) -> list[str]:
    """Table cells for values in A, each with a bar of proportional length."""
    top = max(filter(math.isfinite, figures), default=0.0) or 1.0
    shares = [figure / top if math.isfinite(figure) else 0.0 for figure in figures]
    return [
        f'<td class="figure">{number(figure)} A</td>'
        f'<td class="wide"><div class="meter" style="width:{100 * share:.1f}%"></div></td>'
        for figure, share in zip(figures, shares, strict=True)
    ]
