"""Parts of a page that the reports share. All of the user's text is escaped here."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from cogless.report.faults import Told
from cogless.report.palette import colours
from cogless.report.settings import assumptions, settings
from cogless.report.verdict import ScenarioVerdict
from cogless.results import AnyResults
from cogless.versions import versions


@cache
def asset(name: str) -> str:
    """A file of assets/ as text."""
    return (files("cogless.report") / "assets" / name).read_text(encoding="utf-8")


def page(
    template: str,
    results: AnyResults,
    found: Sequence[ScenarioVerdict],
    data: dict[str, Any],
    parts: Callable[[str], Mapping[str, str]],
) -> str:
    """The whole file: a template of assets/ and its script, filled with what every report has.

    `parts`: a scenario's tables and notes as HTML, for the template of a scenario.
    """
    study = results.study
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Template(asset(f"{template}.html")).substitute(
        scenarios="".join(_scenario(template, results, found, name, parts) for name in results.scenarios),
        title=escape(study.title),
        description=f'<p class="description">{escape(study.description)}</p>' if study.description else "",
        interrupted='<p class="warning">Interrupted: not all runs are here.</p>'
        if results.interrupted
        else "",
        verdict=_verdict(found, results),
        tabs="".join(
            f'<button type="button" data-select="{i}">{escape(name)}</button>'
            for i, name in enumerate(results.scenarios)
        ),
        chips="".join(
            f'<button type="button" aria-pressed="true" style="--colour:var(--c{colour})">'
            f"{escape(study.label(name))}</button>"
            for name, colour in colours(results).items()
        ),
        assumptions=assumptions(study),
        settings=settings(study),
        footer=_footer(results),
        version=escape(versions()["cogless"]),
        data=text.replace("<", "\\u003c"),  # no text of the user's may end the script element
        css=asset("report.css"),
        js=asset("plots.js") + asset(f"{template}.js"),
        uplot_css=asset("uplot.min.css"),
        uplot_js=asset("uplot.min.js"),
    )


def note(text: str) -> str:
    """A remark as HTML."""
    return f'<p class="note">{escape(text)}</p>'


def reservations(sentences: Sequence[str]) -> str:
    """Notes on what a table or plot does not show, or only with a reservation."""
    return "".join(f'<p class="note missed">{escape(sentence)}</p>' for sentence in sentences)


def scrolled(table: str, about: str) -> str:
    """A table that scrolls sideways where it is wider than the page, by keys too; `about`: its name."""
    return f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(about)}">{table}</div>'


def controller_heading(label: str, baseline: bool) -> str:
    """A controller at the head of a table's column."""
    mark = ' <span class="base">(baseline)</span>' if baseline else ""
    return f"<th>{escape(label)}{mark}</th>"


def _scenario(
    template: str,
    results: AnyResults,
    found: Sequence[ScenarioVerdict],
    scenario: str,
    parts: Callable[[str], Mapping[str, str]],
) -> str:
    """A scenario's part of the page; printed, it has its name, verdict and colours above it."""
    study, place = results.study, results.scenarios.index(scenario)
    ran = [run.controller for run in results.runs if run.scenario == scenario]
    return Template(asset("scenario.html")).substitute(
        parts=Template(asset(f"{template}-scenario.html")).substitute(
            parts(scenario), baseline=escape(study.label(study.baseline))
        ),
        place=place,
        hidden=" hidden" if place else "",
        name=escape(scenario),
        headline="".join(
            f'<p class="headline">{escape(verdict.headline)}</p>'
            for verdict in found
            if verdict.scenario == scenario
        ),
        legend="".join(
            f'<span class="key" style="--colour:var(--c{colour})">{escape(study.label(name))}</span>'
            for name, colour in colours(results).items()
            if name in ran
        ),
    )


def _verdict(found: Sequence[ScenarioVerdict], results: AnyResults) -> str:
    if not found:
        return note("Nothing to judge by: no run has a metric that is better when lower.")
    items = []
    for verdict in found:
        details = escape(" ".join(verdict.details))
        told = "".join(_fault_lines(told, results) for told in verdict.told)
        items.append(
            f'<li class="{verdict.tone}">'
            f'<button type="button" class="name" data-select="{results.scenarios.index(verdict.scenario)}">'
            f"{escape(verdict.scenario)}</button>"
            f'<p class="headline">{escape(verdict.headline)}</p>{told}<p class="details">{details}</p></li>'
        )
    return f'<ul class="verdicts">{"".join(items)}</ul>'


def _fault_lines(told: Told, results: AnyResults) -> str:
    """A fault, and a line for each controller."""
    colour = colours(results)
    heading = f'<p class="fault">{escape(told.heading)}</p>' if told.heading else ""
    rows = "".join(
        f'<dt class="key" style="--colour:var(--c{colour[c]})">{escape(results.study.label(c))}</dt>'
        f"<dd>{escape(text)}</dd>"
        for c, text in told.sentences
    )
    return heading + (f'<dl class="told">{rows}</dl>' if rows else "")


def _footer(results: AnyResults) -> str:
    made = ", ".join(f"{name} {version}" for name, version in versions().items())
    return f"<p>Made by {escape(made)}; seed {results.study.seed}. Plots: uPlot (MIT).</p>"
