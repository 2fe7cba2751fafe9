"""The report of a sweep: how each controller fares over all variants, the worst variant, what explains it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from cogless import units
from cogless.ensemble import judge
from cogless.ensemble.judge import SOBOL_VARIANTS_LEAST, Influence, Spread, influences, positions
from cogless.ensemble.sweep_table import Column, Sweep
from cogless.files import replacing
from cogless.report import page
from cogless.report.charts import OverVariants, Series, SweepCharts
from cogless.report.comparison import pretty
from cogless.report.markup import DASH, key, note, number, place, reservations, table, table_rows
from cogless.report.page import Runs, Sections
from cogless.report.verdicts import Answer, Paragraph, ScenarioVerdict, listed
from cogless.results import AnyResults, Run
from cogless.results.trace import Array, Trace
from cogless.study.metric import LAST_TRIAL

Repeat = Callable[[list[str], tuple[str, str]], str]  # from settings and run, the command that repeats it
PLOT_POINTS = 600  # largest number of points of a plot
METRICS_PLOTTED = 3  # largest number of metrics with plots
KEYS_PLOTTED = 4  # largest number of scatter plots of a metric, one for each key that explains most


@dataclass(frozen=True, eq=False)
class SweepResults(AnyResults):
    """A sweep in the form of results, for the page: an empty run for each controller in each scenario."""

    sweep: Sweep | None = None
    repeat: Repeat = lambda settings, pair: ""

    @property
    def finished_sweep(self) -> Sweep:
        assert self.sweep is not None
        return self.sweep


def write(sweep: Sweep, path: Path, repeat: Repeat) -> list[str]:
    """Write the report; returns the answer as lines of text for a terminal."""
    empty = Trace(("time",), ("s",), np.empty((0, 1)))
    runs = [Run(scenario, controller, empty) for scenario, controller in sweep.pairs]
    results = SweepResults(sweep.study, runs, sweep=sweep, repeat=repeat)
    with replacing(path) as temporary:
        temporary.write_text(page.render(results, SWEEP), encoding="utf-8")
    return _verdict_lines(results)


def _verdict_lines(results: SweepResults) -> list[str]:
    texts: list[str] = []
    for verdict in page.verdicts(results, SWEEP):
        texts.append(f"{verdict.scenario}: {verdict.headline}")
        for part in verdict.paragraphs:
            texts.append(f"  {part.heading}")
            texts += [f"    {results.study.label(name)}: {text}" for name, text in part.sentences]
        texts += [f"  {line}" for line in verdict.details]
    return texts


# --- the answer


def _verdict(results: SweepResults, runs: Runs) -> ScenarioVerdict | None:
    sweep, scenario = results.finished_sweep, runs[0].scenario
    groups = [
        group for group in judge.spreads(sweep, scenario) if group[0].column.metric.better_direction != "none"
    ]
    limited = [group for group in groups if group[0].within is not None]
    parts = [
        Paragraph(_heading(group[0].column), [(s.pair[1], _sentence(s)) for s in group])
        for group in limited or groups
    ]
    if not parts:
        return None
    failed = sum(1 for _, at in sweep.errors if sweep.pairs[at][0] == scenario)
    details = [f"{failed} runs failed; sweep.parquet has their errors."] if failed else []
    if not limited:
        details.append(
            "No metric has a limit. With limit = ... in a metric's table, this page shows the share of "
            "variants that keep it."
        )
    return ScenarioVerdict(
        scenario, _tone(results, limited), _headline(results, runs, limited), details, parts
    )


def _headline(results: SweepResults, runs: Runs, limited: Sequence[Sequence[Spread]]) -> str:
    sweep = results.finished_sweep
    count = sweep.ensemble.count
    if not limited:
        return f"How {count} variants spread, by controller."
    shares = _shares(results, limited)
    parts = [f"{results.study.label(name)} {_percent(share)}" for name, share in shares.items()]
    what = (
        f"{_name(limited[0][0].column).capitalize()} keeps its limit"
        if len(limited) == 1
        else "All limits are kept"
    )
    return f"{what} in this share of {count} variants: {listed(parts)}."


def _shares(results: SweepResults, limited: Sequence[Sequence[Spread]]) -> dict[str, float]:
    """The share of variants that keep all limits of a scenario, the best controller first."""
    sweep = results.finished_sweep
    shares = {}
    for one in limited[0]:
        at = list(sweep.pairs).index(one.pair)
        keeping = [judge.keeps(sweep, at, list(sweep.columns).index(group[0].column)) for group in limited]
        shares[one.pair[1]] = float(np.mean(np.logical_and.reduce([k for k in keeping if k is not None])))
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def _tone(results: SweepResults, limited: Sequence[Sequence[Spread]]) -> str:
    if not limited:
        return "even"
    shares = _shares(results, limited)
    best = max(shares.values())
    if best < 0.5:  # most variants break a limit, whatever the controller
        return "worse"
    winners = [name for name, share in shares.items() if share == best]
    if results.study.baseline in winners:
        return "worse" if len(winners) == 1 and len(shares) > 1 else "even"
    return "better"


def _heading(column: Column) -> str:
    limit, bound = column.metric.limit, ""
    if limit is not None:
        side = "at least" if column.metric.better_direction == "higher" else "at most"
        bound = f", {side} {_value_text(column, limit)}"
    return f"{_name(column)}{bound}"


def _sentence(spread: Spread) -> str:
    parts = []
    if spread.within is not None and spread.interval is not None:
        low, high = spread.interval
        parts.append(
            f"{_percent(spread.within)} keep the limit (95 % confidence: {_percent(low)} to {_percent(high)})"
        )
    column = spread.column
    parts.append(
        f"half are at {_value_text(column, spread.median)} or better, 95 % at "
        f"{_value_text(column, spread.edge)}"
    )
    parts.append(f"worst {_value_text(column, spread.worst_value)} (variant {spread.worst})")
    return "; ".join(parts)


def _answer(results: SweepResults, runs: Runs) -> Answer | None:
    """Of baseline and best: the share of variants that keep all limits, or without limits the median."""
    sweep, base = results.finished_sweep, results.study.baseline
    groups = [
        group
        for group in judge.spreads(sweep, runs[0].scenario)
        if group[0].column.metric.better_direction != "none"
    ]
    limited = [group for group in groups if group[0].within is not None]
    if limited:
        values = _shares(results, limited)
        best = next((name for name in values if name != base), base)
        names = [name for name in (base, best) if name in values]
        quantity = (
            f"of {sweep.ensemble.count} variants keep {'all limits' if len(limited) > 1 else 'the limit'}"
        )
        return Answer([(name, "", _percent(values[name])) for name in dict.fromkeys(names)], "", quantity)
    if not groups:
        return None
    column, higher = groups[0][0].column, groups[0][0].column.metric.better_direction == "higher"
    ranked = sorted(groups[0], key=lambda s: -s.median if higher else s.median)
    best_other = [s for s in ranked if s.pair[1] != base][:1]
    pair = [*(s for s in ranked if s.pair[1] == base), *best_other]
    figures = [(s.pair[1], "", _value_text(column, s.median)) for s in pair]
    return Answer(
        figures, "", f"{_name(column)}: half of {sweep.ensemble.count} variants are at this or better"
    )


# --- tables


def _parts(results: SweepResults, runs: Runs) -> dict[str, str]:
    scenario = runs[0].scenario
    groups = judge.spreads(results.finished_sweep, scenario)
    return {
        "tables": _spread_table(results, runs, groups),
        "worst": _worst_table(results, groups),
        "influence": "".join(_influence_table(results, runs, group[0].column) for group in _plotted(groups)),
        "influence_note": _influence_note(results.finished_sweep),
    }


def _spread_table(results: SweepResults, runs: Runs, groups: Sequence[Sequence[Spread]]) -> str:
    bodies = []
    for group in groups:
        column = group[0].column
        lines = [
            ("median", [_value_text(column, s.median) for s in group]),
            ("95 % of variants", [_value_text(column, s.edge) for s in group]),
            ("worst", [_value_text(column, s.worst_value) for s in group]),
        ]
        if column.metric.limit is not None:
            lines.insert(0, ("share that keeps the limit", [_percent(s.within or 0.0) for s in group]))
        if any(s.failed for s in group):
            lines.append(("without a value", [str(s.failed) for s in group]))
        cells = "".join("<td></td>" for _ in group)
        heading = f"<tr><th><strong>{escape(_heading(column))}</strong></th>{cells}</tr>"
        bodies.append(
            heading
            + table_rows((name, "".join(f"<td>{escape(v)}</td>" for v in values)) for name, values in lines)
        )
    head = "<th></th>" + "".join(f"<th>{key(results, run.controller)}</th>" for run in runs)
    return table("numbers", f"Spread in {runs[0].scenario}", head, *bodies)


def _worst_table(results: SweepResults, groups: Sequence[Sequence[Spread]]) -> str:
    body = ""
    for group in _plotted(groups):
        for s in group:
            command = results.repeat(judge.settings(results.finished_sweep, s.worst, s.pair[0]), s.pair)
            body += (
                f"<tr><th>{escape(_name(s.column))}</th><td>{key(results, s.pair[1])}</td>"
                f"<td>{escape(_value_text(s.column, s.worst_value))}</td>"
                f"<td><code>{escape(command)}</code></td></tr>"
            )
    head = "<th>Metric</th><th>Controller</th><th>Worst</th><th>Command that repeats it</th>"
    return table("worst", "Worst variants", head, body)


def _influence_table(results: SweepResults, runs: Runs, column: Column) -> str:
    columns = _influences(results.finished_sweep, runs, column)
    if not columns or not columns[0]:
        return ""
    body = table_rows(
        (one[0].key, "".join(f"<td>{_figure(i.rank)}</td><td>{_figure(i.first)}</td>" for i in one))
        for one in zip(*columns, strict=True)
    )
    head = f"<th>{escape(_name(column))}</th>"
    head += "".join(f"<th>{key(results, run.controller)} rank</th><th>alone</th>" for run in runs)
    return table("numbers", f"Influence on {_name(column)}", head, body)


def _influences(sweep: Sweep, runs: Runs, column: Column) -> list[list[Influence]]:
    index = list(sweep.columns).index(column)
    return [influences(sweep, list(sweep.pairs).index((r.scenario, r.controller)), index) for r in runs]


def _influence_note(sweep: Sweep) -> str:
    sentences = [
        "Rank: Spearman's correlation of the key with the metric, -1 to 1. Alone: the share of the metric's "
        "variance that the key explains by itself (first-order Sobol index, RBD-FAST); the rest to 1 "
        "comes from keys acting together, and from noise."
    ]
    count, least = sweep.ensemble.count, SOBOL_VARIANTS_LEAST
    few = f"{count} variants are too few for Sobol indices: expected {least} or more."
    if sweep.study.vary is not None and sweep.study.vary.together:
        sentences.append("Keys that vary together share the variance that they explain.")
    return note(" ".join(sentences)) + reservations(
        [few] if sweep.ensemble.count < SOBOL_VARIANTS_LEAST else []
    )


# --- plots


def _plotted(groups: Sequence[Sequence[Spread]]) -> list[Sequence[Spread]]:
    """The metrics that have plots: the first with a limit, or else the first that can be judged."""
    judged = [group for group in groups if group[0].column.metric.better_direction != "none"]
    limited = [group for group in judged if group[0].within is not None]
    return (limited or judged)[:METRICS_PLOTTED]


def _charts(results: SweepResults, runs: Runs) -> SweepCharts:
    sweep = results.finished_sweep
    columns = [group[0].column for group in _plotted(judge.spreads(sweep, runs[0].scenario))]
    return SweepCharts(
        spreads=[_spread_chart(results, runs, c) for c in columns],
        scatter=[c for column in columns for c in _scatter(results, runs, column)],
    )


def _values_in_unit(sweep: Sweep, run: Run, column: Column) -> Array:
    """A metric of each variant, in the unit that the study shows it in."""
    index, at = list(sweep.columns).index(column), list(sweep.pairs).index((run.scenario, run.controller))
    return np.asarray(sweep.values[:, at, index] / _factor(column))


def _spread_chart(results: SweepResults, runs: Runs, column: Column) -> OverVariants:
    shares = np.linspace(0, 100, min(PLOT_POINTS, results.finished_sweep.ensemble.count))
    series = []
    for run in runs:
        values = _values_in_unit(results.finished_sweep, run, column)
        values = np.sort(values)[
            :: -1 if column.metric.better_direction == "higher" else 1
        ]  # NaN is sorted last, or first
        values = np.concatenate((values[~np.isnan(values)], values[np.isnan(values)]))
        at = np.rint(shares / 100 * (len(values) - 1)).astype(int)
        series.append(Series(controller=place(results, run), values=values[at]))
    title, x = f"{_name(column)}: share of variants", "share of variants that are no worse (%)"
    return _over_variants(column, title, x, shares, series)


def _scatter(results: SweepResults, runs: Runs, column: Column) -> list[OverVariants]:
    sweep = results.finished_sweep
    strength: dict[str, float] = {}
    for of_run in _influences(sweep, runs, column):
        for one in of_run:
            strength[one.key] = max(strength.get(one.key, 0.0), abs(one.rank or 0.0), one.first or 0.0)
    charts = []
    for name in sorted(strength, key=lambda k: -strength[k])[:KEYS_PLOTTED]:
        axis = next(axis for axis in sweep.ensemble.axes if axis.key == name)
        x = positions(sweep, name)[:PLOT_POINTS] / axis.factor
        order = np.argsort(x, kind="stable")
        series = [
            Series(
                controller=place(results, run),
                values=_values_in_unit(sweep, run, column)[:PLOT_POINTS][order],
            )
            for run in runs
        ]
        label = f"{name} ({pretty(axis.unit)})" if axis.unit else name
        charts.append(_over_variants(column, f"{_name(column)} over {name}", label, x[order], series))
    return charts


def _over_variants(column: Column, title: str, x: str, xs: Array, series: Sequence[Series]) -> OverVariants:
    limit = column.metric.limit
    return OverVariants(
        title=title,
        x=x,
        quantity=_name(column),
        unit=pretty(_unit(column)),
        xs=xs,
        limit=None if limit is None else limit / _factor(column),
        series=series,
    )


# --- texts


def _name(column: Column) -> str:
    """The column in words, such as "speed order: order 72"."""
    name = column.metric.name.replace("_", " ")
    if not column.part:
        return name
    last = column.part == LAST_TRIAL
    kind = "order" if column.metric.kind == "order" else "trial" if last else "phase"
    return f"{name}: {column.part} {kind}" if last else f"{name}: {kind} {column.part}"


def _unit(column: Column) -> str:
    return column.metric.unit or column.metric.dimension.unit


def _factor(column: Column) -> float:
    return units.factor(_unit(column), column.metric.dimension) if _unit(column) else 1.0


def _value_text(column: Column, value: float) -> str:
    if not math.isfinite(value):
        return "never"
    return f"{number(value / _factor(column))} {pretty(_unit(column))}".rstrip()


def _percent(share: float) -> str:
    """A share in percent; it is 0 or 100 % only if it is exactly that."""
    if share in (0.0, 1.0):
        return f"{100 * share:.0f} %"
    return f"{min(99.9, max(0.1, 100 * share)):.1f} %"


def _figure(value: float | None) -> str:
    return DASH if value is None else f"{value:.2f}"


SWEEP = Sections(
    kind="sweep",
    lines=lambda results, scenario: [],
    verdict=_verdict,
    charts=_charts,
    parts=_parts,
    pictures={},
    answer=_answer,
)
