"""The certificates for the page: a table, and the trial-to-trial operator's |F| over frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import Any

import numpy as np

from cogless.design.certificate import ENDS, Certificate, Learning, ModelCertificate
from cogless.report.markup import scrolled
from cogless.report.packing import number, pack, plain
from cogless.report.palette import colours, place
from cogless.results import Run, TrialResults

NOTE = (
    "Known before any run, from the models alone; the largest value over the corners of the uncertain "
    "parameters and over random plants within them (the pointer tells which). Along the trial: the largest "
    "pole of the loop, stable below 1. From trial to trial: |F|, the largest factor by which any frequency "
    "of the error is multiplied from one trial to the next; with the ends: growth a trial in tried trials, "
    "which begin and end. Neither above 1, the error doesn't grow (monotone); and |F| below 1 everywhere, "
    "it shrinks at every frequency (contracting)."
)
ROUNDING = 1e-4  # of K_3
MINUS = "−"  # noqa: RUF001
NONE = "–"  # noqa: RUF001
HEADINGS = (
    "Controller",
    "Model",
    "Along the trial",
    "One more sample of delay",
    "Radius of Φ",
    "|F| without Q filter",
    "|F| with Q filter",
    "Growth with the ends",
    "Monotone up to K_3",
)


def models(certificate: Certificate) -> Iterator[tuple[str, ModelCertificate]]:
    """Models that it speaks of: the design's, and the plant sampled exactly unless that is the same."""
    names = {"euler": "Euler", "exact": "exactly sampled", None: "as given"}
    yield names[certificate.discretisation], certificate.design
    if certificate.exact is not None and certificate.discretisation != "exact":
        yield names["exact"], certificate.exact


def certificate_table(results: TrialResults, scenario: str) -> str:
    """A row for each controller and kind of model; empty where no run has a certificate."""
    runs = [run for run in results.runs if run.scenario == scenario and run.design is not None]
    rows = "".join(_rows(results, run) for run in runs)
    head = "".join(f"<th>{heading}</th>" for heading in HEADINGS)
    table = f'<table class="proof"><thead><tr>{head}</tr></thead>{rows}</table>'
    return scrolled(table, f"Certificates in {scenario}") if rows else ""


def curves(results: TrialResults, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """A chart for each kind of model: |F| over frequency of each controller that learns."""
    charts: dict[str, list[tuple[Run, Learning, bool]]] = {}
    for run in runs:
        for name, model in models(run.design.certificate) if run.design is not None else ():
            unfiltered, filtered = model.without_filter, model.with_filter
            for learning, dash in ((filtered or unfiltered, False), (unfiltered if filtered else None, True)):
                if learning is not None:
                    charts.setdefault(name, []).append((run, learning, dash))
    return [_chart(results, name, found) for name, found in charts.items()]


def _chart(results: TrialResults, name: str, found: Sequence[tuple[Run, Learning, bool]]) -> dict[str, Any]:
    """All curves on the frequencies of any; without zero, since the axis is logarithmic."""
    frequency = np.unique(np.concatenate([learning.curve[0] for _, learning, _ in found]))
    frequency = frequency[frequency > 0]
    series = [
        {"controller": place(results, run), "values": pack(np.interp(frequency, *learning.curve))}
        | ({"dash": True} if dash else {})
        for run, learning, dash in found
    ]
    return {"title": _title(name), "frequency": plain(frequency), "series": series}


def close_to_one(value: float) -> str:
    """A factor; what differs from one by little is told by how much."""
    off = value - 1
    if abs(off) < 1e-9:
        return "1"
    if abs(off) < 5e-3:
        return f"1 {'+' if off > 0 else MINUS} {abs(off):.1e}"
    return number(value)


def _title(name: str) -> str:
    return {"Euler": "Design model (Euler)", "as given": "Models as given"}.get(
        name, "Plant, exactly sampled"
    )


def _rows(results: TrialResults, run: Run) -> str:
    assert run.design is not None
    found, K_3 = list(models(run.design.certificate)), run.design.K_3
    colour = colours(results)[run.controller]
    label = escape(results.study.label(run.controller))
    body = []
    for index, (name, model) in enumerate(found):
        key = f'<span class="key" style="--colour:var(--c{colour})">{label}</span>'
        first = f'<th rowspan="{len(found)}">{key}</th>'
        cells = [
            f"<td>{name}</td>",
            _cell(
                close_to_one(model.radius),
                model.stable,
                "stable" if model.stable else "unstable",
                model.worst,
            ),
            _cell(
                close_to_one(model.delayed_radius),
                model.delayed_stable,
                "stable" if model.delayed_stable else "unstable",
            ),
            f"<td>{NONE if model.phi_radius is None else _value(close_to_one(model.phi_radius))}</td>",
            _learning(model.without_filter),
            _learning(model.with_filter),
            _growth(model.growth),
            f"<td>{_limit(model.without_filter, K_3)}{_limit(model.with_filter, K_3, ' with Q filter')}</td>",
        ]
        body.append(f"<tr>{first if index == 0 else ''}{''.join(cells)}</tr>")
    return f"<tbody>{''.join(body)}</tbody>"


def _learning(learning: Learning | None) -> str:
    if learning is None:
        return f"<td>{NONE}</td>"
    word = "contracting" if learning.contracting else "monotone" if learning.monotone else "may grow"
    at = f"at {number(learning.frequency)} Hz"
    return _cell(close_to_one(learning.norm), learning.monotone, word, learning.worst, at)


def _growth(growth: float | None) -> str:
    if growth is None:
        return f"<td>{NONE}</td>"
    grows = growth > 1 + ENDS
    return _cell(close_to_one(growth), not grows, "may grow" if grows else "doesn't grow")


def _limit(learning: Learning | None, K_3: float, where: str = "") -> str:
    """The largest K_3 that keeps the certificate; none where it is rounding beside the K_3 in use."""
    if learning is None or learning.K_3_limit is None:
        return "" if where else NONE
    limit = f"{learning.K_3_limit:.4g}" if abs(learning.K_3_limit) > ROUNDING * abs(K_3) else "none"
    return f'<span class="small"><br>{limit}{where}</span>' if where else limit


def _value(text: str) -> str:
    return f'<span class="value">{text}</span>'


def _cell(value: str, good: bool, word: str, plant: str = "", detail: str = "") -> str:
    """A number and what it means; the plant that has it is told under the pointer."""
    title = f' title="{escape(plant)}"' if plant else ""
    small = f'<br><span class="small">{escape(detail)}</span>' if detail else ""
    return (
        f'<td{title}>{_value(value)} <span class="tag {"good" if good else "bad"}">{word}</span>{small}</td>'
    )
