"""The report page: one self-contained HTML file. Its templates, style and scripts are in assets/.

The page has the study as readable tables, with the texts and units of its file, and its assumptions with
reasons. `Sections` makes the sections and pictures for one kind of scenario; the rest is common to all kinds.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from string import Template
from typing import Any

from cogless.files import versions
from cogless.report.charts import to_page
from cogless.report.comparison import Line, runs_in
from cogless.report.markup import asset, colours, frame, key, note, place, table_rows, tint
from cogless.report.pictures import Picture
from cogless.report.verdicts import Answer, LearningHelps, Paragraph, ScenarioVerdict
from cogless.results import AnyResults, Run
from cogless.results.results_json import run_id
from cogless.study.base import StudyBase

SHOWN_ELSEWHERE = ("title", "description", "assumption", "seed")


def settings(study: StudyBase) -> str:
    """One small HTML table for each table of the study, with values as in its file and datasheet."""
    groups = []
    for name, table in _groups(study.source.tables):
        body = table_rows((key, f"<td>{escape(text)}</td>") for key, text in _texts(table))
        if body:
            groups.append(
                f'<div class="group"><h3><code>[{escape(name)}]</code></h3>'
                f'<div class="boxed"><table>{body}</table></div></div>'
            )
    return f'<div class="settings">{"".join(groups)}</div>'


def assumptions(study: StudyBase) -> str:
    """The HTML table of the study's assumptions with their reasons; "" without assumptions."""
    if not study.assumption:
        return ""
    body = "".join(
        f"<tr><th><code>{escape(a.about)}</code></th><td>{escape(a.reason)}</td></tr>"
        for a in study.assumption
    )
    head = "<thead><tr><th>Assumption about</th><th>because</th></tr></thead>"
    return f'<h3>Assumptions</h3><div class="boxed"><table>{head}<tbody>{body}</tbody></table></div>'


def _groups(tables: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields each table with its dotted name: one per scenario and controller; a list has a line per item."""
    for name, table in tables.items():
        if name in SHOWN_ELSEWHERE:
            continue
        if name in ("scenario", "controller"):
            yield from ((f"{name}.{key}", inner) for key, inner in table.items())
        elif isinstance(table, list):
            yield name, {str(row.get("name", i)): _summary(row) for i, row in enumerate(table)}
        elif isinstance(table, dict):
            yield name, table


def _summary(row: dict[str, Any]) -> str:
    return "; ".join(f"{key} {_value_text(value)}" for key, value in row.items() if key != "name")


def _texts(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in table.items():
        if isinstance(value, dict) and value:
            yield from _texts(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", _value_text(value)


def _value_text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_value_text(inner)}" for key, inner in value.items())
    if isinstance(value, list):
        tables = any(isinstance(item, dict) for item in value)
        return ("; " if tables else ", ").join(_value_text(item) for item in value)
    return str(value)


Runs = Sequence[Run]  # all are of one scenario


@dataclass(frozen=True)
class Outcome:
    """How each controller's runs ended, as a table of words for the terminal.

    `rows`: a controller and its cells, one for each of `columns`.
    """

    note: str  # explains the columns
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]


def no_outcome(results: Any, runs: Runs) -> Outcome | None:
    """None: the lines of metrics say how the runs ended."""
    return None


def no_answer(results: Any, runs: Runs) -> Answer | None:
    """None: the scenario has no figures of its own."""
    return None


def no_learning_off(results: Any, runs: Runs) -> LearningHelps | None:
    """None: a run of trials already has a trace of its feedback alone."""
    return None


def no_judged_line(results: Any, runs: Runs) -> Line | None:
    """None: the outcome says how the runs ended."""
    return None


@dataclass(frozen=True)
class Sections:
    """Functions that take the results, of the kind's own type, and the scenario or its runs."""

    kind: str  # "speed" or "trials", as in the names of template and script in assets/
    lines: Callable[[Any, str], list[Line]]
    verdict: Callable[[Any, Runs], ScenarioVerdict | None]
    charts: Callable[[Any, Runs], Any]  # a scenario's charts; the script uses the same field names
    parts: Callable[[Any, Runs], dict[str, str]]  # tables and notes as HTML, for the template
    pictures: Mapping[str, Picture]
    outcome: Callable[[Any, Runs], Outcome | None] = no_outcome
    # adds a run of each scenario's best law with its learning off; None: the runs need no such addition
    with_learning_off: Callable[..., AnyResults] | None = None
    # adds what limits each scenario's best run, from further runs; None: there is no such search
    with_limits: Callable[..., AnyResults] | None = None
    # compares the best law with itself with learning off
    learning_off: Callable[[Any, Runs], LearningHelps | None] = no_learning_off
    answer: Callable[[Any, Runs], Answer | None] = no_answer
    judged_line: Callable[[Any, Runs], Line | None] = no_judged_line  # the line by which the verdict compares


UNJUDGED = "No controller can be judged: no run has a metric of which a lower value is better."
NUMBER_MOST = 1e30  # SI; a larger value, far beyond any drive, is not drawn


def render(results: AnyResults, sections: Sections) -> str:
    """The page as one HTML text. All text from the study is escaped."""
    results, study = drawable(results), results.study
    all_verdicts = verdicts(results, sections)
    makers = escape(", ".join(f"{name} {version}" for name, version in versions().items()))
    text = json.dumps(data(results, sections), separators=(",", ":"), allow_nan=False)
    return frame(
        "report",
        study.title,
        Template(asset("report.html")).substitute(
            scenarios="".join(_scenario(results, sections, all_verdicts, name) for name in results.scenarios)
            or note(UNJUDGED),
            description=_description(study),
            tabs="".join(_tab(results, sections, name) for name in results.scenarios),
            chips="".join(
                f'<button type="button" aria-pressed="true" {tint(results, name)}>'
                f"{escape(study.label(name))}</button>"
                for name in colours(results)
            ),
            assumptions=assumptions(study),
            settings=settings(study),
        ),
        f"Made by {makers}; seed {study.seed}. Plots: uPlot (MIT).",
        head=f'<meta name="run" content="{run_id(results)}">\n',
        warning='<p class="warning">Interrupted: not all runs are here.</p>' if results.interrupted else "",
        styles=f"<style>{asset('uplot.min.css')}</style>\n",
        scripts=Template(asset("scripts.html")).substitute(
            data=text.replace("<", "\\u003c"),  # so that no text of the user ends the script element
            js="".join(map(asset, ("speed.js", "trials.js", "sweep.js", "page.js"))),
            uplot_js=asset("uplot.min.js"),
        ),
    )


def verdicts(results: AnyResults, sections: Sections) -> list[ScenarioVerdict]:
    """The verdict on each scenario that can be judged."""
    of_scenarios = (sections.verdict(results, runs_in(results, scenario)) for scenario in results.scenarios)
    return [verdict for verdict in of_scenarios if verdict is not None]


def charts(results: AnyResults, sections: Sections) -> list[Any]:
    """The charts of each scenario; `results` from `drawable`."""
    return [sections.charts(results, runs_in(results, scenario)) for scenario in results.scenarios]


def data(results: AnyResults, sections: Sections) -> dict[str, Any]:
    """All data that the page's scripts draw, as plain values; `results` from `drawable`."""
    scenarios = [
        {"kind": sections.kind, "controllers": [place(results, run) for run in runs_in(results, scenario)]}
        | to_page(drawn)
        for scenario, drawn in zip(results.scenarios, charts(results, sections), strict=True)
    ]
    controllers = [{"label": results.study.label(c), "colour": n} for c, n in colours(results).items()]
    return {"controllers": controllers, "scenarios": scenarios}


def drawable(results: AnyResults) -> AnyResults:
    """The results with NaN in place of values that aren't finite or are too large to draw."""
    runs = [replace(run, trace=replace(run.trace, largest=NUMBER_MOST)) for run in results.runs]
    return replace(results, runs=runs)


def _description(study: StudyBase) -> str:
    if not study.description:
        return ""
    text = escape(study.description)
    return f'<section id="about"><h2>About this study</h2><p class="description">{text}</p></section>'


def _tab(results: AnyResults, sections: Sections, scenario: str) -> str:
    """A scenario's button, with its figures."""
    answer = sections.answer(results, runs_in(results, scenario))
    values = [value for *_, value in answer.figures] if answer is not None else []
    change = f" <small>{escape(' → '.join(values))}</small>" if len(values) > 1 else ""
    where = results.scenarios.index(scenario)
    return f'<button type="button" data-select="{where}">{escape(scenario)}{change}</button>'


def _scenario(
    results: AnyResults, sections: Sections, all_verdicts: Sequence[ScenarioVerdict], scenario: str
) -> str:
    """A scenario's part of the page, its answer first; in print its name and colour legend are above it."""
    study, where, runs = results.study, results.scenarios.index(scenario), runs_in(results, scenario)
    verdict = next((one for one in all_verdicts if one.scenario == scenario), None)
    ran = {run.controller for run in runs}
    return Template(asset("scenario.html")).substitute(
        parts=Template(asset(f"{sections.kind}-scenario.html")).substitute(
            sections.parts(results, runs),
            baseline=escape(study.label(study.baseline)),
            details=_details(verdict, results),
        ),
        tone=verdict.tone if verdict is not None else "even",
        figures=_figures(results, sections.answer(results, runs)),
        headline=f'<p class="headline">{escape(verdict.headline)}</p>'
        if verdict is not None
        else note(UNJUDGED),
        place=where,
        hidden=" hidden" if where else "",
        name=escape(scenario),
        legend="".join(key(results, name) for name in colours(results) if name in ran),
    )


def _figures(results: AnyResults, answer: Answer | None) -> str:
    """The answer's large figures as HTML, and how the last compares with the first; "" without an answer."""
    if answer is None:
        return ""
    parts = []
    for controller, word, text in answer.figures:
        value, _, unit = text.partition(" ")
        name = f"{escape(results.study.label(controller))}{f', {escape(word)}' if word else ''}"
        parts.append(
            f'<p class="figure" {tint(results, controller)}><span class="key">{name}</span> '
            f"<strong>{escape(value)}</strong> {escape(unit)}</p>"
        )
    change = f"<strong>{escape(answer.change)}</strong>" if answer.change else ""
    quantity = f"<span>{escape(answer.quantity)}</span>"
    return f'<div class="figures">{"".join(parts)}<p class="change">{change}{quantity}</p></div>'


def _details(verdict: ScenarioVerdict | None, results: AnyResults) -> str:
    """The verdict's further sentences as HTML; "" without any."""
    if verdict is None or not (verdict.paragraphs or verdict.details):
        return ""
    faults = "".join(_fault_lines(fault, results) for fault in verdict.paragraphs)
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in verdict.details)
    return (
        '<section data-part="details"><h2>Why, and at what cost</h2>'
        f"{faults}{f'<ul>{items}</ul>' if items else ''}</section>"
    )


def _fault_lines(part: Paragraph, results: AnyResults) -> str:
    """A fault's heading, and a line for each controller."""
    heading = f'<p class="fault">{escape(part.heading)}</p>' if part.heading else ""
    rows = "".join(f"{key(results, c, 'dt')}<dd>{escape(text)}</dd>" for c, text in part.sentences)
    return heading + (f'<dl class="told">{rows}</dl>' if rows else "")
