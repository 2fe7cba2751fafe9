"""The report: one HTML file that needs nothing else. The template and its style and script are in assets/."""

from __future__ import annotations

import json
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from cogless.files import replacing
from cogless.report import charts, maps, spectra
from cogless.report.comparison import speed_unit
from cogless.report.palette import colours
from cogless.report.settings import assumptions, settings
from cogless.report.tables import metric_tables, term_tables
from cogless.report.verdict import Verdict, verdicts
from cogless.results import Results, versions


def write(results: Results, path: Path) -> None:
    """Write the report, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(render(results), encoding="utf-8")


def render(results: Results) -> str:
    """The report as HTML. All of the user's text is escaped."""
    results = charts.drawable(results)
    study = results.study
    unit = speed_unit(results)
    data = json.dumps(charts.data(results, unit), separators=(",", ":"), allow_nan=False)
    return Template(asset("report.html")).substitute(
        title=escape(study.title),
        description=f'<p class="description">{escape(study.description)}</p>' if study.description else "",
        interrupted='<p class="warning">Interrupted: not all runs are here.</p>'
        if results.interrupted
        else "",
        verdict=_verdict(verdicts(results, unit), results.scenarios),
        tabs="".join(
            f'<button type="button" data-select="{i}">{escape(name)}</button>'
            for i, name in enumerate(results.scenarios)
        ),
        chips="".join(
            f'<button type="button" aria-pressed="true" style="--colour:var(--c{colour})">'
            f"{escape(study.label(name))}</button>"
            for name, colour in colours(results).items()
        ),
        baseline=escape(study.label(study.baseline)),
        tables=metric_tables(results),
        spectra_note=_note(spectra.NOTE),
        map_note=_note(maps.NOTE),
        terms=term_tables(results),
        assumptions=assumptions(study),
        settings=settings(study),
        footer=_footer(results),
        version=escape(versions()["cogless"]),
        data=data.replace("<", "\\u003c"),  # no text of the user's may end the script element
        css=asset("report.css"),
        js=asset("report.js"),
        uplot_css=asset("uplot.min.css"),
        uplot_js=asset("uplot.min.js"),
    )


@cache
def asset(name: str) -> str:
    """A file of assets/ as text."""
    return (files("cogless.report") / "assets" / name).read_text(encoding="utf-8")


def _verdict(found: list[Verdict], scenarios: list[str]) -> str:
    if not found:
        return '<p class="note">Nothing to judge by: no run has a metric that is better when lower.</p>'
    items = []
    for verdict in found:
        details = escape(" ".join(verdict.details))
        items.append(
            f'<li class="{verdict.tone}">'
            f'<button type="button" class="name" data-select="{scenarios.index(verdict.scenario)}">'
            f"{escape(verdict.scenario)}</button>"
            f'<p class="headline">{escape(verdict.headline)}</p><p class="details">{details}</p></li>'
        )
    return f'<ul class="verdicts">{"".join(items)}</ul>'


def _note(text: str) -> str:
    return f'<p class="note">{escape(text)}</p>'


def _footer(results: Results) -> str:
    made = ", ".join(f"{name} {version}" for name, version in versions().items())
    return f"<p>Made by {escape(made)}; seed {results.study.seed}. Plots: uPlot (MIT).</p>"
