"""The certificates for the page: a table, and the trial-to-trial operator's |F| over frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from cogless.design.trials.certificate import GROWTH_ROUNDING, Certificate, Learning, ModelCertificate
from cogless.report.charts import Curve, OverFrequency
from cogless.report.markup import DASH, key, number, place, table
from cogless.results import Run, TrialResults

CERTIFICATE_NOTE = (
    "These values are known before any run, from the models alone. Each is the largest over the corners of "
    "the uncertain parameters and over random plants within them; point at a value to see the plant. Along "
    "the trial: magnitude of the loop's largest pole, stable below 1. Φ: the matrix of trial and learning "
    "together. |F|: the largest factor by which any frequency of the error is multiplied from one trial to "
    "the next. Growth with the ends: this factor in tried trials, which begin and end. If neither |F| nor "
    "this growth is above 1, the error doesn't grow (monotone). If |F| is also below 1 everywhere, the error "
    "shrinks at every frequency (contracting). Largest share: the largest ratio of a trial's error to the "
    "error without learning, for any error (with an observer: of missing inputs instead of errors). Monotone "
    "up to K_3: the largest K_3 with which no error grows."
)
GAIN_ROUNDING = 1e-4  # a limit of K_3 below this share of the K_3 in use counts as none
MINUS = "−"  # noqa: RUF001
STABLE = ("stable", "unstable")
GROWS = ("doesn't grow", "may grow")
HEADINGS = (
    "Controller",
    "Model",
    "Along the trial",
    "One more sample of delay",
    "Radius of Φ",
    "|F| without Q filter",
    "|F| with Q filter",
    "Growth with the ends",
    "Largest share of the error",
    "Monotone up to K_3",
)


@dataclass(frozen=True)
class Model:
    """A kind of certified model, with its names in the table, in a chart's title and in a sentence."""

    name: str
    title: str
    words: str


MODELS = {
    "euler": Model("Euler", "Design model (Euler)", "Euler model"),
    "exact": Model("exactly sampled", "Plant, exactly sampled", "exactly sampled plant"),
    None: Model("as given", "Models as given", "models as given"),
}


def models(certificate: Certificate) -> Iterator[tuple[Model, ModelCertificate]]:
    """Yields the models that a certificate covers: the design's, and exactly sampled ones if they differ."""
    yield MODELS[certificate.discretisation], certificate.design
    if certificate.exact is not None and certificate.discretisation != "exact":
        yield MODELS["exact"], certificate.exact


def certificate_table(results: TrialResults, runs: Sequence[Run]) -> str:
    """HTML table with a row for each controller and kind of model; empty if no run has a certificate."""
    bodies = [_certificate_rows(results, run) for run in runs if run.design is not None]
    head = "".join(f"<th>{heading}</th>" for heading in HEADINGS)
    return table("proof", f"Certificates in {runs[0].scenario}", head, *bodies)


def curves(results: TrialResults, runs: Sequence[Run]) -> list[OverFrequency]:
    """A chart for each kind of model: |F| over frequency of each controller that learns."""
    charts: dict[Model, list[tuple[Run, Learning, bool]]] = {}
    for run in runs:
        for name, model in models(run.design.certificate) if run.design is not None else ():
            curves_of_model = [
                curve for curve in (model.with_filter, model.without_filter) if curve is not None
            ]
            charts.setdefault(name, []).extend(
                (run, curve, curve is not curves_of_model[0]) for curve in curves_of_model
            )
    return [_chart(results, name.title, curve) for name, curve in charts.items() if curve]


def _chart(
    results: TrialResults, title: str, curves_of_runs: Sequence[tuple[Run, Learning, bool]]
) -> OverFrequency:
    """A chart of all curves on the union of their frequencies, without zero: the axis is logarithmic."""
    frequency = np.unique(np.concatenate([learning.curve[0] for _, learning, _ in curves_of_runs]))
    frequency = frequency[frequency > 0]
    series = [
        Curve(controller=place(results, run), values=np.interp(frequency, *learning.curve), dash=dash)
        for run, learning, dash in curves_of_runs
    ]
    dashed = ", without Q filter dashed" if any(dash for _, _, dash in curves_of_runs) else ""
    return OverFrequency(
        title=f"{title}: |F| of the worst plant{dashed}",
        x="frequency (Hz)",
        quantity="|F|, factor a trial",
        unit="",
        frequency=frequency,
        series=series,
    )


def close_to_one(value: float) -> str:
    """A factor as text; if it is close to one, as one plus or minus the difference."""
    off = value - 1
    if abs(off) < 1e-9:
        return "1"
    if abs(off) < 5e-3:
        return f"1 {'+' if off > 0 else MINUS} {abs(off):.1e}"
    return number(value)


def _certificate_rows(results: TrialResults, run: Run) -> str:
    assert run.design is not None
    all_models, K_3 = list(models(run.design.certificate)), run.design.K_3
    first = f'<th rowspan="{len(all_models)}">{key(results, run.controller)}</th>'
    body: list[str] = []
    for name, model in all_models:
        deciding = len(all_models) > 1 and model is run.design.certificate.deciding
        decides = ", decides" if deciding else ""
        limits = _limit(model.without_filter, K_3) + _limit(model.with_filter, K_3, " with Q filter")
        cells = [
            f"<td>{name.name}{', decides' if decides else ''}</td>",
            _cell(model.radius, model.stable, STABLE, model.worst),
            _cell(model.delayed_radius, model.delayed_stable, STABLE),
            _cell(model.phi_radius),
            _learning(model.without_filter),
            _learning(model.with_filter),
            _cell(model.growth, model.growth is not None and model.growth <= 1 + GROWTH_ROUNDING, GROWS),
            _cell(model.finite.share if model.finite is not None else None),
            f"<td>{limits}</td>",
        ]
        body.append(f"<tr>{'' if body else first}{''.join(cells)}</tr>")
    return "".join(body)


def _learning(learning: Learning | None) -> str:
    if learning is None:
        return _cell(None)
    words = ("contracting" if learning.contracting else "monotone", "may grow")
    at = f'<br><span class="small">at {number(learning.frequency)} Hz</span>'
    return _cell(learning.norm, learning.monotone, words, learning.worst, at)


def _limit(learning: Learning | None, K_3: float, where: str = "") -> str:
    """The largest K_3 with which no error grows; "none" if it is only rounding relative to the K_3 in use."""
    if learning is None or learning.K_3_limit is None:
        return "" if where else DASH
    limit = f"{learning.K_3_limit:.4g}" if abs(learning.K_3_limit) > GAIN_ROUNDING * abs(K_3) else "none"
    return f'<span class="small"><br>{limit}{where}</span>' if where else limit


def _cell(
    factor: float | None,
    good: bool = True,
    words: tuple[str, str] | None = None,
    plant: str = "",
    detail: str = "",
) -> str:
    """A table cell with a factor and one of `words`, for good or for bad; a tooltip names the plant."""
    if factor is None:
        return f"<td>{DASH}</td>"
    title = f' title="{escape(plant)}"' if plant else ""
    tag = f' <span class="tag {"good" if good else "bad"}">{words[not good]}</span>' if words else ""
    return f'<td{title}><span class="value">{close_to_one(factor)}</span>{tag}{detail}</td>'
