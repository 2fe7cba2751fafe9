"""Comparison of controllers: one line per metric or order, with each controller's value in display units.

A line also has the best controllers and the ratios to the baseline. The report's table, the verdict and the
terminal's table all use these lines.

The module also finds runs that learned nothing, and why, so that their results aren't credited to learning.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cogless.control_library import Status
from cogless.design.kinds import DESIGNS
from cogless.design.law_rules import rules_of
from cogless.design.ripple import HARMFUL_RATIO
from cogless.design.unlearned import never, revolutions_learned, starts_too_late, too_short
from cogless.report.markup import number
from cogless.report.panels import travelled, varies
from cogless.report.speed_tracking import STATE_TIME_LEAST, miss_words, spans
from cogless.results import AnyResults, Results, Run
from cogless.results.held_speed import JERKS_RATIO, missed_in, unevenness
from cogless.results.metrics import result_name
from cogless.results.trace import BLOCK_ROWS
from cogless.results.windows import in_torque_mode, rows_of, span_of
from cogless.study.base import StudyBase, spoken_unit
from cogless.study.metric import Metric
from cogless.study.reading import Remark
from cogless.units import ANGULAR_SPEED, TURN, factor


def unlearned(results: Results, run: Run) -> str | None:
    """The reason why a run's law learned nothing that could act; None if it did, or if that is unknown.

    This is judged by the angle turned since the status first showed that learning wasn't frozen.
    """
    stop = BLOCK_ROWS
    while (why := _reason_in_rows(results, run, slice(0, stop))) and stop < len(run.trace):
        stop *= 4  # a run that learned enough at its beginning has learned enough
    return why


def _reason_in_rows(results: Results, run: Run, rows: slice) -> str | None:
    """The reason by these rows, which begin with the run."""
    study, name, trace = results.study, run.controller, run.trace
    law, revolutions = rules_of(study, name).memory, revolutions_learned(study, name)
    if revolutions is None or law is None or not study.controller[name].learned:
        return None
    if len(trace) < 2 or "status" not in trace:
        return None
    theta, status, speed = (trace.part(x, rows) for x in (travelled(results, run), "status", "omega_ref"))
    if not np.all(np.isfinite(theta) & np.isfinite(status)):
        return None
    learning = (status.astype(int) & Status.FROZEN) == 0
    cell = TURN * float(revolutions) / law.cells
    if np.sum(np.abs(np.diff(theta))[learning[1:]]) < cell:
        end = float(trace.time[-1])
        why = starts_too_late(law, end) or never(study, run.scenario, name)
        why = why or too_short(law, revolutions, theta, end, speed)
        return why or "its learning was frozen all the time"
    since = int(np.argmax(learning))
    time = float(trace.time[-1] - trace.time[since]) + trace.period
    return too_short(law, revolutions, theta[since:], time, speed[since:])


SPEEDS = ("omega_m", "omega_measured", "omega_error")
SPREADS = ("ripple-rms", "peak-to-peak", "rms", "three-sigma", "ripple-ratio")
RESTS, VARIES = "the reference is at rest", "the reference varies, which would count as ripple"
TORQUE_NOTE = "an outer loop sets the current in this scenario, so no speed is held"
TOO_FEW_TURNS = "less than one turn"  # in place of the value of an order
THROUGHOUT = "throughout"  # when the guard held learning back: in all of a window
WHOLE_WINDOW_SHARE = 0.99  # least time held back / a window's time that counts as throughout
EVENT_KINDS = ("settling", "exceeds", "trials-to-floor")  # no value if the event never happens
COUNT_KINDS = ("trials-to-floor", "trials-at-limit")
QUANTITIES = {
    "omega_m": "speed",
    "omega_error": "speed error",
    "omega_measured": "measured speed",
    "omega_error_measured": "measured speed error",
    "theta_m": "angle",
    "theta_error": "angle error",
    "theta_measured": "measured angle",
    "theta_error_measured": "measured angle error",
    "tau_e": "electric torque",
    "tau_motor": "motor torque",
    "tau_load": "load torque",
    "i_q_ref": "current reference",
    "i_d": "d current",
    "i_q": "q current",
    "i_a": "phase current",
    "i_b": "phase current",
    "i_c": "phase current",
    "i_amplitude": "current",
}


@dataclass(frozen=True)
class Line:
    """One metric's value for each controller in a scenario, in `unit`; None: never happened, or not finite.

    `missed`: the controllers that did not hold the speed in the metric's time window, and what the speed was.
    `jerking`: the controllers in `missed` that held the mean speed.
    `uneven`: the controllers that held the mean speed with an error's rms of half the speed or more, in
    `missed` or not, and the ratio of this rms to the speed.
    `unlearned`: the controllers whose law learned nothing in the scenario, and why.
    `guarded`: the controllers whose learning the guard held back in that window, and when.
    `span`: the metric's time window, s; None if no run has a trace.
    `unjudged`: why the line can't show that a controller is better; "" if it can.
    `short`: the controllers that turned less than an order needs in that window.
    """

    name: str
    kind: str
    signal: str | None
    order: float | None
    frame: str
    better: str
    unit: str
    values: Mapping[str, float | None]
    missed: Mapping[str, str] = field(default_factory=dict)
    jerking: frozenset[str] = frozenset()
    uneven: Mapping[str, float] = field(default_factory=dict)
    unlearned: Mapping[str, str] = field(default_factory=dict)
    guarded: Mapping[str, str] = field(default_factory=dict)
    span: tuple[float, float] | None = None
    unjudged: str = ""
    short: frozenset[str] = frozenset()

    @property
    def title(self) -> str:
        """The line's title, such as "speed ripple" or "speed orders: order 6 (electrical)"."""
        if self.order is None:
            return self.quantity
        return f"{self._plain_name.removesuffix(' order')}: order {self.order:g} ({self.frame})"

    @property
    def quantity(self) -> str:
        """The line's quantity as used within a sentence, such as "speed order 6 (electrical)"."""
        if self.order is None:  # electrical angles and speeds are marked as such
            return self._plain_name + (" (electrical)" if self.frame == "electrical" else "")
        signal = QUANTITIES.get(self.signal or "", self.signal)
        return f"{signal} order {self.order:g} ({self.frame})"

    @property
    def window(self) -> str:
        """The time window of the metric, such as "8 to 10 s"; "" if it isn't known."""
        times = [f"{t:.3g}" if t < 1000 else f"{t:.0f}" for t in self.span or ()]
        return f"{' to '.join(times)} s" if times else ""

    def not_held(self, controller: str) -> str:
        """When and by how much the speed was missed, such as "speed early, 0.5 to 2 s: mean 52 of 56 rpm"."""
        place = ", ".join(part for part in (self._plain_name, self.window) if part)
        return f"{place}: {self.missed[controller]}"

    def uneven_words(self, controller: str) -> str:
        """A controller's error, and the largest that still counts as held; "" if its speed is even."""
        if controller not in self.uneven:
            return ""
        return (
            f"its error is {100 * self.uneven[controller]:.0f} % of the speed; up to "
            f"{100 * JERKS_RATIO:.0f} % counts as held"
        )

    @property
    def _plain_name(self) -> str:
        return spoken(self.name)

    @property
    def best(self) -> set[str]:
        """Controllers with the best value; empty if all are equally good.

        Controllers that did not hold the speed, or whose law learned nothing, are left out.
        """
        out = {*self.missed, *self.unlearned}
        ranks = {name: self._rank(value) for name, value in self.values.items() if name not in out}
        top = min(ranks.values(), default=math.inf)
        if self.better not in ("lower", "higher") or self.unjudged or top == math.inf:
            return set()
        best = {name for name, rank in ranks.items() if math.isclose(rank, top, rel_tol=1e-9)}
        return best if len(best) < len(self.values) else set()

    def _rank(self, value: float | None) -> float:
        """Sort key of a value, lower is better. "Never" is best for leaving a band, and worst otherwise."""
        if value is None:
            return -math.inf if self.kind == "exceeds" else math.inf
        return value if self.better == "lower" else -value

    def ratio(self, controller: str, baseline: str) -> float | None:
        """A controller's value divided by the baseline's; None if that ratio has no meaning."""
        value, base = self.values.get(controller), self.values.get(baseline)
        if self.unjudged or controller in self.missed or baseline in self.missed:
            return None
        if value is None or base is None or base == 0 or self.better == "none" or value / base < 0:
            return None
        return value / base

    def number(self, controller: str) -> str:
        """A controller's value without its unit, "never", or "not finite"; "" if the line has none."""
        if controller not in self.values:
            return ""
        value = self.values[controller]
        if value is None:
            if controller in self.short:
                return TOO_FEW_TURNS
            return "never" if self.kind in EVENT_KINDS else "not finite"
        return f"{value:.0f}" if self.kind in COUNT_KINDS else number(value)

    def value_text(self, controller: str) -> str:
        """A controller's value with its unit, if it has a value."""
        value = self.values.get(controller)
        return self.number(controller) + (f" {self.unit}".rstrip() if value is not None else "")


def spoken(name: str) -> str:
    """A metric's name as it is printed, such as "speed ripple"."""
    return name.replace("_", " ").replace("-", " ")


def runs_in(results: AnyResults, scenario: str) -> list[Run]:
    """The runs of a scenario."""
    return [run for run in results.runs if run.scenario == scenario]


def compare(results: Results, scenario: str) -> list[Line]:
    """A speed scenario's lines, in the study's order: one per metric, or one per order of an order metric."""
    runs = runs_in(results, scenario)
    lines, idle = [], {run.controller: why for run in runs if (why := unlearned(results, run))}
    for metric in results.study.metrics_in(scenario):
        taken = [run for run in runs if result_name(metric) in run.metrics]
        if taken:
            named = [(metric.name, order) for order in metric.order or (None,)]
            rows = {run.controller: rows_of(results, metric, run) for run in taken}
            first_rows = rows[taken[0].controller]
            torque = in_torque_mode(results.study, taken[0], first_rows)
            misses_of_runs = [
                (run, speed) for run in taken if (speed := missed_in(results, metric, run)) is not None
            ]
            not_held = {
                run.controller: pretty(miss_words(speed, run, rows[run.controller], speed_unit(results)))
                for run, speed in misses_of_runs
            }
            guarded_times = {run.controller: guarded(results, run, rows[run.controller]) for run in taken}
            own = lines_of(results.study, metric, taken, named)
            lines += [
                replace(
                    line,
                    missed=not_held,
                    jerking=frozenset(
                        run.controller for run, speed in misses_of_runs if speed.kind == "error"
                    ),
                    uneven={} if torque else _uneven(taken, rows),
                    unlearned=idle,
                    guarded={controller: when for controller, when in guarded_times.items() if when},
                    span=span_of(results, metric, taken[0]),
                    unjudged=unjudged(metric, taken[0], first_rows, torque),
                    short=frozenset(
                        run.controller for run in taken if too_few_turns(metric, run, rows[run.controller])
                    ),
                )
                for line in own
            ]
    return lines


def _uneven(runs: Sequence[Run], rows: Mapping[str, slice]) -> dict[str, float]:
    """The runs that are uneven in their rows, and how much, by controller."""
    uneven = {}
    for run in runs:
        reference, speed = (run.trace.part(name, rows[run.controller]) for name in ("omega_ref", "omega_m"))
        ratio = unevenness(reference, speed)
        if ratio is not None:
            uneven[run.controller] = ratio
    return uneven


def too_few_turns(metric: Metric, run: Run, rows: slice) -> bool:
    """Whether a run has no value of an order because its rotor turned less than one revolution there."""
    if metric.kind != "order" or "theta_m" not in run.trace:
        return False
    theta = run.trace.part("theta_m", rows)
    return len(theta) > 0 and bool(np.all(np.isfinite(theta)) and np.ptp(theta) < TURN)


def unjudged(metric: Metric, run: Run, rows: slice, torque: bool = False) -> str:
    """Why a metric of the speed says nothing of a controller in these rows; "" otherwise.

    The spread of a speed whose reference varies is that of the reference; at rest there is no ripple.
    `torque`: whether these are rows in torque mode, where the speed is not the law's.
    """
    of_speed = metric.signal in ("omega_m", "omega_measured")
    if not (of_speed or (metric.signal or "").startswith("omega_error")):
        return ""
    if torque:
        return TORQUE_NOTE
    reference = run.trace.part("omega_ref", rows)
    if not len(reference):
        return ""
    if not np.any(reference) and metric.kind in (*SPREADS, "order"):
        return RESTS
    return VARIES if of_speed and metric.kind in SPREADS and varies(reference) else ""


def guarded(results: Results, run: Run, rows: slice) -> str:
    """When in these rows the guard held a run's learning back, such as "from 3.5 to 5.1 s"; "" if not.

    THROUGHOUT if the guard did so in at least WHOLE_WINDOW_SHARE of the time.
    """
    if not results.study.controller[run.controller].learns:
        return ""
    guard_spans = spans(run, Status.GUARDED, rows)
    held_time = sum(to - since for since, to in guard_spans)
    if held_time < STATE_TIME_LEAST:
        return ""
    time = run.trace.time[rows]
    if held_time >= WHOLE_WINDOW_SHARE * (time[-1] - time[0]):
        return THROUGHOUT
    return f"from {guard_spans[0][0]:.3g} to {guard_spans[-1][1]:.3g} s"


def remarks(study: StudyBase, scenario: str, lines: Sequence[Line]) -> list[str]:
    """Remarks on a scenario's controllers that missed the speed or learned nothing, without full stop."""
    idle = {c: why for line in lines for c, why in line.unlearned.items()}
    return [
        *(f"{study.label(c)} did not hold the speed in {how}" for c, how in misses(lines).items()),
        *(f"{study.label(c)} learned nothing: {why}" for c, why in idle.items()),
        *held_back(study, scenario, lines),
        *not_judged(lines),
    ]


def not_judged(lines: Sequence[Line]) -> list[str]:
    """Remarks on lines that aren't judged, one for each reason."""
    by_reason: dict[str, list[str]] = {}
    for line in lines:
        if line.unjudged and line.better != "none":
            by_reason.setdefault(line.unjudged, []).append(line.quantity)
    return [
        f"{quantities[0]}{f' and {len(quantities) - 1} more' if len(quantities) > 1 else ''}: "
        f"not judged, since {why}{'; judge the signal omega_error instead' if why == VARIES else ''}"
        for why, quantities in by_reason.items()
    ]


def error_metric(study: StudyBase) -> Remark:
    """The advice to add a metric that judges the speed where its reference varies."""
    metric = {"name": "speed_error", "kind": "rms", "signal": "omega_error"}
    own = study.source.tables.get("metric", [])
    return Remark(
        'add a [[metric]] with kind = "rms" and signal = "omega_error"', ({"metric": [*own, metric]},)
    )


def held_back(study: StudyBase, scenario: str, lines: Sequence[Line]) -> list[str]:
    """Remarks on controllers whose learning the guard held back in the window of a metric, one for each."""
    by_controller: dict[str, tuple[str, list[Line]]] = {}
    for line in lines:
        for controller, when in line.guarded.items():
            by_controller.setdefault(controller, (when, []))[1].append(line)
    return [
        f"the guard held back the learning of {study.label(c)} {when} (frozen, gentler or without effect): "
        f"{_harm(study, scenario, c, within) or _affected(when, within[0])}"
        for c, (when, within) in by_controller.items()
    ]


def _affected(when: str, line: Line) -> str:
    """How much of a metric's value is from a time with less learning, as a clause."""
    return f"{'all' if when == THROUGHOUT else 'a part'} of its {line.quantity} is from this time"


def _harm(study: StudyBase, scenario: str, controller: str, lines: Sequence[Line]) -> str:
    """How much worse a law is than the same feedback without learning, and why, by design; "" if it isn't.

    Without a run of that feedback the effect of learning is unknown. The sentence then compares the law with
    a baseline that doesn't learn, and says that this has another feedback.
    """
    own = _own_feedback(study, controller, lines)
    base = study.baseline if own is None else own
    if study.controller[base].learns:
        return ""
    # controllers that lost the speed through learning count here, too
    able = [replace(line, missed={}) for line in lines if base not in line.missed and line.kind in SPREADS]
    ratios = {line.quantity: line.ratio(controller, base) or 0.0 for line in able if line.signal in SPEEDS}
    worst = max(ratios, key=lambda quantity: ratios[quantity], default="")
    if not worst or ratios[worst] <= HARMFUL_RATIO:
        return ""
    compared = f"{number(ratios[worst])} times the {worst} of {study.label(base)}"
    if own is None:
        return f"its ripple is then {compared}, which has another feedback"
    why = DESIGNS[study.kind].likely_harm(study, controller, scenario)
    return f"learning does harm here, with {compared}{f' ({why})' if why else ''}"


def _own_feedback(study: StudyBase, controller: str, lines: Sequence[Line]) -> str | None:
    """A controller in these lines that has the same feedback and doesn't learn; None if there is none."""
    feedback = DESIGNS[study.kind].feedback
    mine = feedback(study, controller)
    if mine is None:
        return None
    controllers = dict.fromkeys(name for line in lines for name in line.values)
    first = sorted(controllers, key=lambda name: name != study.baseline)
    alike = (name for name in first if not study.controller[name].learned)
    return next((name for name in alike if feedback(study, name) == mine), None)


def misses(lines: Sequence[Line]) -> dict[str, str]:
    """For each controller that did not hold the speed in a line's time window: the latest case, in words."""
    by_end = sorted(reversed(lines), key=lambda line: line.span[1] if line.span else 0.0)
    return {c: line.not_held(c) for line in by_end for c in line.missed}


def speed_unit(results: Results) -> str:
    """The unit in which the study gives speeds."""
    return spoken_unit(results.study, ANGULAR_SPEED)


def lines_of(
    study: StudyBase,
    metric: Metric,
    runs: Sequence[Run],
    named: Iterable[tuple[str, float | None]],
) -> list[Line]:
    """A metric's lines, one for each (name, order) in `named`."""
    unit, scale = shown_in(study, metric)
    values = {run.controller: run.metrics[result_name(metric)] for run in runs}
    lines = []
    for place, (name, order) in enumerate(named):
        column = {c: v[place] if isinstance(v, list) else v for c, v in values.items()}
        in_unit = {c: v / scale if v is not None and math.isfinite(v) else None for c, v in column.items()}
        line = Line(
            name=name,
            kind=metric.kind,
            signal=metric.signal,
            order=order,
            frame=metric.frame,
            better=metric.better_direction,
            unit=unit,
            values=in_unit,
        )
        lines.append(line)
    return lines


def shown_in(study: StudyBase, metric: Metric) -> tuple[str, float]:
    """The display unit of a metric, as it is printed, and this unit's value in SI."""
    unit, dimension = metric.unit or spoken_unit(study, metric.dimension), metric.dimension
    return pretty(unit), factor(unit, dimension) if dimension.unit else 1.0


def factor_text(ratio: float) -> str:
    """A ratio for a table, such as 0.096, 1.03 or 250, after a multiplication sign."""
    if ratio < 0.1:
        return f"\u00d7\u202f{ratio:.2g}"
    if ratio >= 1e5:
        return f"\u00d7\u202f{ratio:.1e}"
    return f"\u00d7\u202f{ratio:.2f}" if ratio < 100 else f"\u00d7\u202f{ratio:.0f}"


def pretty(unit: str) -> str:
    """A unit as it is printed, such as "N·m" for "N*m"."""
    return unit.replace("*", "·").replace("^2", "²").replace("ohm", "Ω")
