"""The verdict on a speed scenario, by the remaining ripple or error of the speed.

The module also computes the share of a true error that comes from the position sensor's own error, which no
law can see.

A law follows its sensor's signal. The true error E is the measured error M, which the law sees, plus the
sensor's own error S: E = M + S. The share 1 - M^2 / E^2 of E's square is attributed to S. It is nearly one if
a law follows S. If no law can follow S, as with an encoder's steps, M is larger than E, and nothing is
attributed to S.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from cogless.design.answers import doubt, other_seeds
from cogless.report.angle_charts import sentences as growing
from cogless.report.angle_charts import worsened
from cogless.report.comparison import (
    SPEEDS,
    VARIES,
    Line,
    compare,
    error_metric,
    held_back,
    misses,
    pretty,
    remarks,
    runs_in,
    shown_in,
    speed_unit,
)
from cogless.report.faults import account
from cogless.report.limit_sentences import remark
from cogless.report.panels import varies_in
from cogless.report.verdicts import (
    EQUAL_DIFFERENCE,
    REPORTED_RATIO,
    Contest,
    LearningHelps,
    ScenarioVerdict,
    change_words,
    listed,
    ratio,
    times,
    worst,
)
from cogless.results import Results, Run
from cogless.results.metrics import evaluate, result_name
from cogless.results.runs import LearningOff
from cogless.study import Study
from cogless.study.metric import Conditions, Metric
from cogless.study.reading import Remark
from cogless.units import ANGULAR_SPEED, convert, factor

DOMINANT_SHARE = 0.5  # share of the square above which the sensor's error dominates
# For each true signal, the measured signal that a law sees.
MEASURED_SIGNALS = {
    "omega_m": "omega_measured",
    "omega_error": "omega_error_measured",
    "theta_m": "theta_measured",
    "theta_error": "theta_error_measured",
}
# For each kind of metric, the kind from which the sensor's share is computed: its squares add up.
SQUARES = {
    "rms": "rms",
    "maximum": "rms",
    "ripple-rms": "ripple-rms",
    "three-sigma": "ripple-rms",
    "peak-to-peak": "ripple-rms",
    "order": "order",
}


@dataclass(frozen=True)
class Sensor:
    """A comparison line of measured values, and the sensor's share of each true value's square."""

    seen: Line
    shares: Mapping[str, float]

    def dominates(self, controller: str) -> bool:
        """Whether most of a controller's remaining error is the sensor's own error."""
        return self.shares[controller] > DOMINANT_SHARE

    def percent(self, controller: str) -> str:
        """The sensor's share of a controller's squared value, such as "99 %"."""
        return f"{100 * self.shares[controller]:.0f} %"


def sensor(results: Results, scenario: str, line: Line) -> Sensor | None:
    """The sensor's part of a scenario's line; None if the metric has none, or a value or trace is missing."""
    metric = next((m for m in results.study.metrics_in(scenario) if m.name == line.name), None)
    if metric is None or metric.signal not in MEASURED_SIGNALS or metric.kind not in SQUARES:
        return None
    conditions, measured = results.study.conditions(scenario), MEASURED_SIGNALS[metric.signal]
    seen, shares = {}, {}
    for run in runs_in(results, scenario):
        if line.values.get(run.controller) is None:
            continue
        if not len(run.trace) or measured not in run.trace:
            return None
        true, measured_rms = (
            _value(run, metric, line, signal, SQUARES[metric.kind], conditions)
            for signal in (metric.signal, measured)
        )
        if not (true > 0 and math.isfinite(true + measured_rms)):
            return None
        shares[run.controller] = 1 - (measured_rms / true) ** 2
        value = _value(run, metric, line, measured, metric.kind, conditions)
        seen[run.controller] = value / factor(line.unit, metric.dimension)
    if not shares:
        return None
    return Sensor(replace(line, signal=measured, values=seen), shares)


def _value(run: Run, metric: Metric, line: Line, signal: str, kind: str, conditions: Conditions) -> float:
    """The metric's value, SI, with another signal and kind; for an order metric, at the line's order."""
    value = evaluate(metric.model_copy(update={"signal": signal, "kind": kind}), run.trace, conditions)
    if isinstance(value, list):
        return value[list(metric.order or ()).index(line.order or 0.0)]
    return math.nan if value is None else value


COST_LEAST = 0.01  # relative; a metric that gets worse by less is not reported as a cost
METRICS_MOST = 3  # largest number of metrics in a sentence about another controller

TOTALS = ("ripple-rms", "peak-to-peak")


@dataclass(frozen=True)
class _Case(Contest):
    """A scenario's lines of metrics that are better when lower, and the line by which it is judged."""

    study: Study
    where: str
    lines: Sequence[Line]
    line: Line
    worsened: Mapping[str, float]  # s, since when a controller's error stays above the baseline's
    off: LearningOff | None = None  # what the best law leaves with its learning off

    @property
    def unlearned(self) -> list[str]:
        """Controllers that held the speed and whose law learned nothing, without the baseline."""
        return [c for c in self.holding if c in self.line.unlearned and c != self.baseline]

    @cached_property
    def ranked(self) -> list[str]:
        """Controllers that held the speed, learned if they should, and didn't end worse than the baseline."""
        return [c for c in self.holding if c not in self.worsened and c not in self.unlearned]

    @cached_property
    def holding(self) -> list[str]:
        """Controllers that held the speed and have a value, the best first."""
        numbers = {c: v for c, v in self.line.values.items() if v is not None and c not in self.line.missed}
        return sorted(numbers, key=lambda c: (numbers[c], c))

    @cached_property
    def jerking(self) -> list[str]:
        """Controllers that held the mean speed only, the best first."""
        numbers = {c: v for c, v in self.line.values.items() if v is not None}
        return sorted(self.line.jerking & numbers.keys(), key=lambda c: (numbers[c], c))

    @cached_property
    def winners(self) -> list[str]:
        """The best controller, and those whose values are equal to its value within `EQUAL_DIFFERENCE`."""
        return [c for c in self.ranked if self.against(c, self.ranked[0]) <= 1 + EQUAL_DIFFERENCE]

    @property
    def ranks(self) -> bool:
        """Whether controllers can be compared.

        Several must have a value, and the baseline must have one or have lost the speed.
        """
        compared = self.baseline in self.ranked or self.baseline in self.line.missed
        return bool(self.ranked) and len(self.line.values) > 1 and compared

    def against(self, controller: str, other: str) -> float:
        """A controller's value divided by another's; infinite if only the other's is zero."""
        return ratio(self.line.values[controller] or 0.0, self.line.values[other] or 0.0)

    def learns(self, controller: str) -> bool:
        return super().learns(controller) and controller not in self.line.unlearned

    def values_in_words(self, controllers: Sequence[str], line: Line | None = None) -> str:
        """Controllers with their values, listed in words; `line`: another line than the one judged by."""
        return listed([f"{self.label(c)} {(line or self.line).value_text(c)}" for c in controllers])


def verdict(results: Results, runs: Sequence[Run]) -> ScenarioVerdict | None:
    """The verdict on a speed scenario; None if it has neither metrics nor faults."""
    compared, broken = _compared(results, runs), account(results, runs)
    if broken is None:
        return compared
    if compared is None:
        return replace(broken, tone=worst(broken.tone, "even"))
    details = [compared.headline, *compared.details]
    tone = worst(broken.tone, compared.tone)
    return replace(
        broken, tone=tone, details=details, cost=compared.cost, doubts=compared.doubts, best=compared.best
    )


@dataclass(frozen=True)
class Judged:
    """The best run of a scenario, and the metric and its line, with the order, by which it is best."""

    run: Run
    metric: Metric
    line: Line


def judged(results: Results, scenario: str) -> Judged | None:
    """The best run of a scenario; None if there is none.

    If no run holds its speed, the best of the runs that hold the mean speed is taken.
    """
    runs = runs_in(results, scenario)
    case = _judged_case(results, runs)
    best = next(iter(case.ranked or case.holding or case.jerking), None) if case is not None else None
    if case is None or best is None:
        return None
    metric = _metric_of(results, scenario, case.line)
    return Judged(next(run for run in runs if run.controller == best), metric, case.line)


def unheld(results: Results, scenario: str) -> Judged | None:
    """The run to hold the speed of a scenario in which none does, of a law that learns if there is one.

    None: a run holds the speed, or nothing judges the scenario.
    """
    runs = runs_in(results, scenario)
    case = _judged_case(results, runs)
    if case is None or case.holding or not case.line.missed:
        return None

    def rank(run: Run) -> tuple[bool, float]:
        value = case.line.values.get(run.controller)
        return not results.study.controller[run.controller].learns, math.inf if value is None else value

    lost = [run for run in runs if run.controller in case.line.missed]
    return Judged(min(lost, key=rank), _metric_of(results, scenario, case.line), case.line)


def learner(results: Results, best: Judged) -> Run | None:
    """The best run of a law that learns; None if no law learns, or if the scenario's best law does."""
    study, values = results.study, best.line.values
    learning = [run for run in runs_in(results, best.run.scenario) if study.controller[run.controller].learns]
    if not learning or study.controller[best.run.controller].learns:
        return None

    def rank(run: Run) -> tuple[bool, float]:
        value = values.get(run.controller)
        return run.controller in best.line.missed, math.inf if value is None else value

    return min(learning, key=rank)


def value_in(results: Results, run: Run, metric: Metric, line: Line) -> float | None:
    """Another run's value, SI, by the line that judges a scenario; None if it did not hold the speed."""
    own = next(other for other in compare(results, run.scenario) if other.name == metric.name)
    if run.controller in own.missed:
        return None
    conditions = results.study.conditions(run.scenario)
    value = _value(run, metric, line, line.signal or "", metric.kind, conditions)
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class Contrast:
    """The baseline and the best other controller, in this order, and the line that judges them.

    `runs` is only one run if no other controller holds the speed. `off`: the best other controller compared
    with itself with learning off, if that was tried.
    """

    runs: Sequence[Run]
    metric: Metric
    line: Line
    off: LearningHelps | None = None


def contrast(results: Results, runs: Sequence[Run]) -> Contrast | None:
    """What a scenario's answer shows, before and after; None if no metric judges it."""
    case = _judged_case(results, runs)
    if case is None:
        return None
    line, base = case.line, case.baseline
    others = [c for c in (*case.ranked, *case.holding) if c != base]
    names = [name for name in (base, *others[:1]) if name in line.values] or list(line.values)[:1]
    pair = [next(run for run in runs if run.controller == name) for name in names]
    off = learning_helps(case) if case.ranked else None
    off = off if off is not None and off.controller == pair[-1].controller else None
    return Contrast(pair, _metric_of(results, runs[0].scenario, line), line, off)


def learning_off(results: Results, runs: Sequence[Run]) -> LearningHelps | None:
    """A scenario's best law compared with itself with learning off; None if no run shows this."""
    case = _judged_case(results, runs)
    return learning_helps(case) if case is not None and case.ranked else None


def changed_by(pair: Contrast) -> str:
    """The second value against the first in words, such as "72.4 times less"; "" if they have no ratio.

    If learning does not help, the words compare the value with the one with learning off.
    """
    if pair.off is not None and pair.off.tone != "better":
        return pair.off.remark
    if len(pair.runs) < 2:
        return ""
    before, after = (run.controller for run in pair.runs)
    values = [pair.line.values[name] for name in (before, after)]
    if before in pair.line.missed or any(value is None for value in values):
        return ""
    return change_words(ratio(abs(values[1] or 0.0), abs(values[0] or 0.0)))


def _judged_case(results: Results, runs: Sequence[Run]) -> _Case | None:
    """A scenario's case; None if no line judges it."""
    basis = _basis(results, runs)
    return None if basis.line is None or basis.unjudged else _case(results, runs, basis)


def _metric_of(results: Results, scenario: str, line: Line) -> Metric:
    return next(metric for metric in results.study.metrics_in(scenario) if metric.name == line.name)


def judged_line(results: Results, runs: Sequence[Run]) -> Line | None:
    """The line by which a scenario's controllers are judged; None if there is none."""
    case = _judged_case(results, runs)
    return case.line if case is not None else None


@dataclass(frozen=True)
class _Basis:
    """The lines of a scenario's table by which its controllers can be judged.

    `all_lines`: metrics that are better when lower. `lines`: the part of these that distinguishes
    controllers. `line`: the one that judges.
    """

    where: str
    all_lines: Sequence[Line]
    lines: Sequence[Line]
    line: Line | None

    @property
    def unjudged(self) -> bool:
        """Whether lines were dropped, and the line to judge by, if any, doesn't show the rotor's motion."""
        shows = self.line is not None and (self.line.signal or "").startswith(("omega", "theta"))
        return len(self.lines) < len(self.all_lines) and not shows


def _basis(results: Results, runs: Sequence[Run]) -> _Basis:
    scenario, baseline, trace = runs[0].scenario, results.study.baseline, runs[0].trace
    all_lines = [line for line in compare(results, scenario) if line.better == "lower"]
    lines = [line for line in all_lines if not line.unjudged]
    moves = len(trace) > 0 and varies_in(trace, "omega_ref", len(trace) // 4)  # without the start-up
    last = trace.part("omega_ref", slice(-1, None))
    line = _latest(results, scenario, _decisive(lines, baseline, moves), lines)
    where = f"In {scenario}" if moves or not len(trace) else _speed(results, float(last[0]))
    return _Basis(where, all_lines, lines, line)


def _case(results: Results, runs: Sequence[Run], basis: _Basis) -> _Case:
    assert basis.line is not None
    worse = {} if results.study.baseline in basis.line.missed else worsened(results, runs)
    off = results.learning_off.get(runs[0].scenario)
    return _Case(results.study, basis.where, basis.lines, basis.line, worse, off)


def _compared(results: Results, runs: Sequence[Run]) -> ScenarioVerdict | None:
    """The verdict by comparing the controllers' metrics; None if no metric is better when lower."""
    scenario, baseline = runs[0].scenario, results.study.baseline
    basis = _basis(results, runs)
    if basis.unjudged:
        return _nothing_judged(results, scenario, basis.where, basis.all_lines)
    if basis.line is None:
        return None
    line = basis.line
    limited = remark(results.study, results.limits[scenario]) if scenario in results.limits else None
    case = _case(results, runs, basis)
    own = _of_the_sensor(case, sensor(results, scenario, line), limited)
    tone, headline = _headline(case)
    unlearned = [f"{case.label(c)} learned nothing: {why}." for c, why in case.line.unlearned.items()]
    unlearned += [f"{line[0].upper()}{line[1:]}." for line in held_back(results.study, scenario, [case.line])]
    cost = ""
    if len(line.values) < 2 or baseline not in line.values:
        details = ["There is nothing to compare.", own, *unlearned, *_failures(case)]
    else:
        details = [own, *unlearned, *growing(results, runs, case.worsened), _strongest_order(case)]
        if len(case.ranked) > 1:
            cost = _costs(case)
            details += [_without_learning(case), _against_the_next(case), cost]
        details += [_rest(case), *_failures(case)]
    doubts = _doubts(case, scenario)
    details = [str(limited or ""), *doubts, *details]
    sentences = [sentence for sentence in details if sentence]
    return ScenarioVerdict(
        scenario, tone, headline, sentences, cost=cost, doubts=doubts, best=_best(case, tone)
    )


def _doubts(case: _Case, scenario: str) -> list[str]:
    """Sentences on a scenario's winners whose next run may end otherwise, as their design says."""
    another = f"In another run, such as with --set seed={other_seeds(case.study)[0]},"
    return [
        f"{another} {case.label(c)} may leave more: {why}."
        for c in case.winners
        if case.learns(c) and (why := doubt(case.study, c, scenario))
    ]


def _nothing_judged(results: Results, scenario: str, at: str, lines: Sequence[Line]) -> ScenarioVerdict:
    """The verdict if only metrics are left that can judge no controller: why, and what to add."""
    why = next(line.unjudged for line in lines if line.unjudged)
    wants = f"; {error_metric(results.study)}" if why == VARIES else ""
    reasons = remarks(results.study, scenario, [replace(line, unjudged="") for line in lines])
    details = [f"{remark[0].upper()}{remark[1:]}." for remark in reasons]
    return ScenarioVerdict(scenario, "even", f"{at}, no speed is judged: {why}{wants}.", details)


def _of_the_sensor(case: _Case, part: Sensor | None, limited: Remark | None) -> str:
    """A sentence on the controllers whose error is mostly the sensor's own; "" if there are none.

    `limited`: the remark on what limits the best run. A further run measured the sensor's share for it, so
    the sentence doesn't repeat that share.
    """
    blurred = [c for c in case.holding if part is not None and part.dominates(c)]
    if part is None or not blurred:
        return ""
    remainder = f"The measured values show: {case.values_in_words(blurred, part.seen)}."
    if limited:
        return remainder
    values = listed([f"{case.label(c)} {case.line.value_text(c)} ({part.percent(c)})" for c in blurred])
    whose = "the sensor's own error, which no law can see (in brackets: its share of the mean square)"
    return f"Most of the true {case.line.quantity} comes from {whose}: {values}. {remainder}"


def _headline(case: _Case) -> tuple[str, str]:
    """The tone and the first sentence of the verdict."""
    line, base, ranked, label = case.line, case.baseline, case.ranked, case.label
    if line.missed and not case.holding:
        by_speed: dict[str, list[str]] = {}
        for c, speed in line.missed.items():
            by_speed.setdefault(speed, []).append(label(c))
        speeds = ", ".join(f"{listed(labels)} {speed}" for speed, labels in by_speed.items())
        return "worse", f"{case.where}, no controller holds the speed from {line.window}: {speeds}."
    if not case.ranks:
        return "even", f"{case.where}, {line.quantity}: {case.values_in_words([*line.values])}."
    if ranked == [base] and case.holding == [base]:
        return (
            "worse",
            f"{case.where}, only {label(base)} holds the speed: it {_has(line, line.value_text(base))}.",
        )
    if ranked == [base] and {base, *case.unlearned} == set(case.holding):
        return (
            "even",
            f"{case.where}, nothing was learned: {case.values_in_words(case.holding)} of {line.quantity}.",
        )
    if ranked == [base]:
        return (
            "worse",
            f"{case.where}, no controller stays better than {label(base)}: "
            f"it {_has(line, line.value_text(base))}.",
        )
    return _comparison(case)


def _comparison(case: _Case) -> tuple[str, str]:
    """The tone and the first sentence if controllers other than the baseline are ranked."""
    line, base, ranked, winners = case.line, case.baseline, case.ranked, case.winners
    tone, off = case.tone(winners), learning_helps(case)
    if off and tone == "better":
        tone = off.tone
    if base not in ranked:
        learning = f", {off.words}" if off else ""
        end = f"; {case.label(base)} did not hold the speed ({line.missed[base]}, {line.window})."
        return tone, f"{case.where}, {_have(case)}{learning}{end}"
    if winners == ranked == case.holding and not line.missed:
        return tone, f"{case.where}, all are alike: {case.values_in_words(winners)} of {line.quantity}."
    if winners == [base]:
        best = ranked[1]
        return tone, (
            f"{case.where}, no controller beats {case.label(base)}: "
            f"it {_has(line, line.value_text(base))}; the next, {case.label(best)}, "
            f"{line.value_text(best)} ({change_words(case.against(best, base))})."
        )
    if base in winners:
        return tone, f"{case.where}, {_have(case)}."
    roughly = "" if len(winners) == 1 else "about "
    ratio = case.against(winners[0], base)
    less = f"{roughly}{times(1 / ratio)} less than" if ratio else "against"
    less += f" {case.label(base)} ({line.value_text(base)})"
    if not off:
        return tone, f"{case.where}, {_have(case)}, {less}."
    if off.tone == "better":
        return tone, f"{case.where}, {_have(case)}, {less} and {off.words}."
    return tone, f"{case.where}, {_have(case)}, {off.words}: its feedback, not its learning, leaves {less}."


def _best(case: _Case, tone: str) -> str:
    """As `ScenarioVerdict.best`. Among equals, a controller that does not learn comes first."""
    base, winners = case.baseline, case.winners
    if not case.ranks:
        return ""
    if winners == [base]:
        return base if tone == "worse" else ""  # tone "even": no law learned anything
    off = learning_helps(case)
    if base in winners or (base in case.ranked and off is not None and off.tone != "better"):
        return ""
    return next((c for c in winners if not case.learns(c)), winners[0])


def learning_helps(case: _Case) -> LearningHelps | None:
    """The best law compared with itself with learning off; None if no run shows this."""
    line, off = case.line, case.off
    if off is None or off.order != line.order or off.controller not in case.winners:
        return None
    name = off.controller
    whose = "with learning off" if len(case.winners) == 1 else f"{case.label(name)} with learning off"
    if off.value is None:
        words = "with learning off it does not hold the speed"
        return LearningHelps(name, tone="better", words=words, text="not held", value=None)
    metric = next(m for m in case.study.metrics_in(off.scenario) if result_name(m) == off.metric)
    value = off.value / shown_in(case.study, metric)[1]
    text = replace(line, values={name: value}).value_text(name)
    share = ratio(line.values[name] or 0.0, value)
    if share > 1 + EQUAL_DIFFERENCE:
        tone, against = "worse", f"{times(share)} as much as"
    elif share * (1 + EQUAL_DIFFERENCE) >= 1:
        tone, against = "even", "as much as"
    else:
        tone, against = "better", f"{times(1 / share)} less than" if share else "against"
    return LearningHelps(name, tone=tone, words=f"{against} {whose} ({text})", text=text, value=value)


def _has(line: Line, values: str, several: bool = False) -> str:
    """What a controller leaves, in words, such as "leaves 0.46 rpm of speed order 6 (electrical)"."""
    if line.kind == "dip":
        return f"{'deviate' if several else 'deviates'} by up to {values} ({line.quantity})"
    return f"{'leave' if several else 'leaves'} {values} of {line.quantity}"


def _have(case: _Case) -> str:
    """What the winners leave, such as "A and B tie: they leave 0.46 rpm and 0.47 rpm of speed ripple"."""
    several, values = len(case.winners) > 1, listed([case.line.value_text(c) for c in case.winners])
    tie = " tie: they" if several else ""
    return f"{case.labels(case.winners)}{tie} {_has(case.line, values, several)}"


def _decisive(lines: Sequence[Line], baseline: str, moves: bool) -> Line | None:
    """The line to judge by: the ripple of the speed, else the baseline's strongest order, else a dip.

    Lines with a value of the baseline come first. If the reference `moves`, the ripple is that of the speed
    error.
    """
    lines = [line for line in lines if line.kind != "mean"]  # a mean may be negative
    lines = [line for line in lines if baseline in line.values] or lines
    totals = [line for line in lines if _is_total(line) and (line.signal == "omega_error" or not moves)]
    totals.sort(key=lambda line: (line.kind == "rms") != moves)
    orders = _orders(lines, baseline)
    dips = [line for line in lines if line.kind == "dip"]
    ripples = [line for line in lines if line.kind in TOTALS]
    return next(iter([*totals, *orders, *dips, *ripples, *lines]), None)


def _latest(results: Results, scenario: str, line: Line | None, lines: Sequence[Line]) -> Line | None:
    """The line with the latest time window among similar metrics, to judge learning by its final result."""
    if line is None or line.order is not None:
        return line
    alike = {other.name for other in lines if (other.kind, other.signal) == (line.kind, line.signal)}
    duration = results.study.scenario[scenario].duration
    spans = {m.name: m.span(duration) for m in results.study.metrics_in(scenario) if m.name in alike}
    ends = {name: span[1] for name, span in spans.items() if span is not None}
    if len(ends) < 2:
        return line
    last = max(ends, key=lambda name: ends[name])
    return next(other for other in lines if other.name == last)


def _is_total(line: Line) -> bool:
    """Whether a line is the total ripple or the total error of the speed, not a part such as an order."""
    error = (line.kind, line.signal) == ("rms", "omega_error")
    return error or (line.kind in TOTALS and line.signal in SPEEDS)


def _is_part(case: _Case, line: Line) -> bool:
    """Whether a line is an order of the speed, a part of the total that the case is judged by."""
    return _is_total(case.line) and line.kind == "order" and line.signal in SPEEDS


def _is_slight(case: _Case, line: Line, controller: str) -> bool:
    """Whether an order of the speed is so small, against the baseline's total, that it counts as equal."""
    order, total = line.values[controller] or 0.0, case.line.values[case.baseline] or 0.0
    size = order * factor(line.unit, ANGULAR_SPEED)
    return size < EQUAL_DIFFERENCE * total * factor(case.line.unit, ANGULAR_SPEED)


def _orders(lines: Sequence[Line], controller: str) -> list[Line]:
    """The lines of the first order metric, sorted by this controller's amplitude, the largest first."""
    first = next((line.name for line in lines if line.kind == "order"), None)
    orders = [line for line in lines if line.name == first and line.values.get(controller) is not None]
    return sorted(orders, key=lambda line: -(line.values[controller] or 0.0))


def _speed(results: Results, reference: float) -> str:
    """A constant reference in words, such as "At 60 rpm"."""
    unit = speed_unit(results)
    return f"At {convert(reference, unit, ANGULAR_SPEED):.4g} {pretty(unit)}"


def _strongest_order(case: _Case) -> str:
    """A sentence on the strongest order of the speed's ripple, with values of the best and the baseline."""
    if not _is_total(case.line) or len(case.ranked) < 2:
        return ""
    compared = case.baseline if case.baseline in case.ranked else case.ranked[-1]
    orders = _orders([line for line in case.lines if line.signal in SPEEDS], compared)
    if not orders:
        return ""
    names = dict.fromkeys([*case.winners, *case.ranked[:2], compared])
    values = case.values_in_words([c for c in names if c in orders[0].values], orders[0])
    return f"In the strongest order, {orders[0].order:g} ({orders[0].frame}): {values}."


def _without_learning(case: _Case) -> str:
    """A sentence on the winner and the best controller without learning, unless that is the baseline."""
    best, line = case.winners[0], case.line
    plain = [c for c in case.ranked if not case.learns(c)]
    learning = [c for c in case.ranked if case.learns(c)]
    if best == case.baseline or not plain or not learning or {plain[0], learning[0]} <= set(case.winners):
        return ""
    label, rival = case.label, plain[0]
    if best == rival:
        nearest = learning[0]
        return (
            f"{label(best)} doesn't learn; the best controller that learns is {label(nearest)} with "
            f"{line.value_text(nearest)}."
        )
    ratio = line.ratio(rival, best)
    if rival == case.baseline or ratio is None:
        return ""
    plainly = f"the best controller without learning, {label(rival)} ({line.value_text(rival)})"
    return f"{label(best)} has {times(ratio)} less than {plainly}."


def _against_the_next(case: _Case) -> str:
    """Sentences on metrics in which the winner is clearly worse than the next one; both ways if they tie."""
    first, second = case.ranked[:2]
    pairs = [(first, second)] if second not in case.winners else [(first, second), (second, first)]
    sentences = [_worse(case, *pair) for pair in pairs if pair[1] != case.baseline]
    return " ".join(sentence for sentence in sentences if sentence)


def _worse(case: _Case, controller: str, other: str) -> str:
    """A sentence on other metrics in which a controller is clearly worse than another, the worst first."""
    others = [line for line in case.lines if line is not case.line and not _is_part(case, line)]
    ratios = [(line.ratio(controller, other) or 0.0, line) for line in others]
    worst = sorted((pair for pair in ratios if pair[0] >= REPORTED_RATIO), key=lambda pair: -pair[0])
    parts = [
        f"{times(ratio)} the {line.quantity} ({line.value_text(controller)} against {line.value_text(other)})"
        for ratio, line in worst[:METRICS_MOST]
    ]
    return (
        f"Compared with {case.label(other)}, {case.label(controller)} has {listed(parts)}." if parts else ""
    )


def _costs(case: _Case) -> str:
    """A sentence on other metrics that get worse with the winner than with the baseline, and by how much."""
    best = next((c for c in case.winners if c != case.baseline), None)
    if best is None or case.baseline not in case.ranked:
        return ""
    costs, compared = [], False
    for line in case.lines:
        ratio = line.ratio(best, case.baseline)
        if line is case.line or ratio is None or (_is_part(case, line) and _is_slight(case, line, best)):
            continue
        compared = True
        if ratio > 1 + COST_LEAST:
            more = f"{100 * (ratio - 1):.0f} % more" if ratio < 2 else f"{times(ratio)} the"
            costs.append(f"{more} {line.quantity} ({line.value_text(best)})")
    if costs:
        return f"Compared with {case.label(case.baseline)}, {case.label(best)} has {listed(costs)}."
    if not compared:
        return ""
    whose = f"with {case.label(best)} than with {case.label(case.baseline)}"
    return f"Of the other metrics compared, none is clearly worse {whose}."


def _rest(case: _Case) -> str:
    """A sentence on the ranked controllers that the headline doesn't name."""
    base = case.baseline
    named = {base, *case.winners, *(case.ranked[:2] if case.winners == [base] else ())}
    others = [c for c in case.ranked if c not in named]
    if not others:
        return ""
    the_others = f"The other controller{'s' * (len(others) > 1)}"
    if base not in case.ranked:
        return f"{the_others}: {case.values_in_words(others)}."
    parts = [
        f"{case.label(c)} {case.line.value_text(c)} ({change_words(case.against(c, base))})" for c in others
    ]
    return f"{the_others}, compared with {case.label(base)}: {listed(parts)}."


def _failures(case: _Case) -> list[str]:
    """Sentences on controllers that missed the speed, unless the headline has them, or that never settled."""
    in_headline = set(case.line.missed) if not case.ranked else {case.baseline} & set(case.line.missed)
    since = case.line.span[0] if case.line.span else 0.0
    later = misses([line for line in case.lines if line.span and line.span[1] > since])
    how_missed = later | {c: case.line.not_held(c) for c in case.line.missed}
    sentences = [
        f"{case.label(c)} did not hold the speed in {how}."
        for c, how in how_missed.items()
        if c not in in_headline
    ]
    for line in case.lines:
        unsettled = [case.label(c) for c, v in line.values.items() if v is None and c not in line.missed]
        if line.kind == "settling" and unsettled:
            sentences.append(f"{listed(unsettled)} never settled (metric: {line.quantity}).")
    return sentences
