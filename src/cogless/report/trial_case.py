"""The values of a trial scenario in each of its phases, for the verdict.

The module also makes the outcome: each controller's error at the end, the error of its feedback alone, and
the RMS of its input.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cogless.control_library import Status
from cogless.design.trials.certificate import ModelCertificate
from cogless.design.trials.gains import TrialDesign
from cogless.report.comparison import Line
from cogless.report.markup import DASH, number, rms
from cogless.report.page import Outcome
from cogless.report.phases import Judged, Phase, judged, phases, rms_of_trials, settled
from cogless.report.trial_certificate import Model, models
from cogless.report.verdicts import EQUAL_DIFFERENCE, Contest, ratio, times
from cogless.results import Run, TrialResults
from cogless.results.metrics import result_name
from cogless.results.trace import Array
from cogless.study import TrialStudy

ERROR_GROWTH_RATIO = 1.5  # RMS / smallest RMS earlier in the phase; above this learning diverges
TRIALS_LEAST = 8  # smallest number of trials in which growth can be detected
RMS_ROUNDING = 1e-9  # an RMS below this share of a phase's first one does not count as growth
QUARTER_COUNT = 4  # parts of a phase whose median RMS are compared


@dataclass(frozen=True)
class Case(Contest):
    """Controllers with their values in each phase; counts are infinite if the floor is never reached."""

    study: TrialStudy
    scenario: str
    metric: Judged
    phases: Sequence[Phase]
    runs: Mapping[str, Run]
    rms: Mapping[str, Array]  # in each trial, for the controllers for which it is known

    @cached_property
    def counts(self) -> dict[str, list[float]]:
        """Trials until each controller reaches the floor, in each phase; empty without such a metric."""
        floors = [result_name(metric) for metric in self.metric.metrics if metric.kind == "trials-to-floor"]
        by_controller = {c: run.metrics.get(name) for name in floors[:1] for c, run in self.runs.items()}
        return {c: values for c, values in by_controller.items() if isinstance(values, list)}

    @cached_property
    def final(self) -> dict[str, list[float]]:
        """Each controller's RMS over the second half of each phase, in the display unit."""
        return {c: [settled(self.rms_of(c, phase)) for phase in self.phases] for c in self.rms}

    @cached_property
    def feedback(self) -> dict[str, list[float]]:
        """RMS in each phase of each learning controller's feedback alone, in the display unit."""
        by_controller = {}
        for controller, run in self.runs.items():
            trace = run.feedback
            if trace is not None and self.metric.signal in trace:
                rows = trace[self.metric.signal].reshape(-1, self.study.samples(self.scenario))
                of_trials = rms(rows) / self.metric.scale
                if len(of_trials) == len(self.phases):  # one trial of each phase
                    by_controller[controller] = [float(x) for x in of_trials]
                else:
                    by_controller[controller] = [
                        settled(of_trials[p.start - 1 : p.stop - 1]) for p in self.phases
                    ]
        return by_controller

    def above_feedback(self, controller: str) -> tuple[Phase, float, float] | None:
        """The phase that ends furthest above the controller's own feedback, and both RMS; or None."""
        return max(self.all_above_feedback(controller), key=lambda end: ratio(*end[1:]), default=None)

    def all_above_feedback(self, controller: str) -> list[tuple[Phase, float, float]]:
        """The phases that end above the controller's own feedback, and both values.

        An error below the floor doesn't count.
        """
        if controller not in self.final or controller not in self.feedback:
            return []
        ends = zip(self.phases, self.final[controller], self.feedback[controller], strict=True)
        floor = self.metric.floor or 0.0
        return [end for end in ends if not end[1] <= floor and not end[1] <= (1 + EQUAL_DIFFERENCE) * end[2]]

    def longest_above_feedback(self, controller: str) -> tuple[int, tuple[int, float, float]]:
        """The longest row of trials in a phase with more error than the controller's own feedback has.

        Returns the number of trials, and for the worst trial of the row its number, its RMS and the
        feedback's RMS. An error below the floor doesn't count.
        """
        longest, peak = 0, (0, 0.0, 0.0)
        floor = self.metric.floor or 0.0
        if controller not in self.rms or controller not in self.feedback:
            return longest, peak
        for phase, base in zip(self.phases, self.feedback[controller], strict=True):
            row: list[tuple[int, float, float]] = []
            for trial, error in enumerate(self.rms_of(controller, phase), start=phase.start):
                within = error <= max(floor, (1 + EQUAL_DIFFERENCE) * base)
                row = [] if within else [*row, (trial, float(error), base)]
                if len(row) > longest:
                    longest, peak = len(row), max(row, key=lambda pair: pair[1])
        return longest, peak

    def rms_of(self, controller: str, phase: Phase) -> Array:
        """A controller's RMS in the trials of a phase."""
        return self.rms[controller][phase.start - 1 : phase.stop - 1]

    def first(self, controller: str, phase: Phase) -> float:
        """A controller's RMS in a phase's first trial; NaN if it isn't known."""
        return float(self.rms[controller][phase.start - 1]) if controller in self.rms else math.nan

    def never(self, controller: str) -> list[Phase]:
        """Phases in which a controller doesn't reach the floor."""
        counts = self.counts[controller]
        return [phase for phase, n in zip(self.phases, counts, strict=True) if not math.isfinite(n)]

    def worst(self, controller: str) -> float:
        """The largest final RMS of all phases; infinite if one isn't finite or isn't known."""
        return max(
            (x if math.isfinite(x) else math.inf for x in self.final.get(controller, [])), default=math.inf
        )

    @cached_property
    def growing(self) -> dict[str, tuple[Phase, float, float]]:
        """For each diverging controller: the phase, its lowest RMS there, and its RMS at the phase's end.

        The last number is NaN if it isn't finite.
        """
        by_controller: dict[str, tuple[Phase, float, float]] = {}
        for controller in self.rms:
            for phase in self.phases:
                grown = self._grown(self.rms_of(controller, phase))
                if grown is not None:
                    by_controller.setdefault(controller, (phase, *grown))
        return by_controller

    def _grown(self, rms: Array) -> tuple[float, float] | None:
        """The lowest and the last RMS of a phase, as medians over its quarters; None if the RMS doesn't grow.

        It doesn't count as growth if the last RMS is below the floor.
        """
        if not np.all(np.isfinite(rms)):
            return float(rms[0]), math.nan
        if len(rms) < TRIALS_LEAST:
            return None
        medians = [float(np.median(part)) for part in np.array_split(rms, QUARTER_COUNT)]
        low, last = min(medians), medians[-1]
        least = max(RMS_ROUNDING * float(rms[0]), self.metric.floor or 0.0)
        return (low, last) if last > ERROR_GROWTH_RATIO * low and last > least else None

    @property
    def trials(self) -> int:
        """The number of trials of a run."""
        return self.phases[-1].stop - 1

    @cached_property
    def at_limit(self) -> dict[str, int]:
        """The number of trials in which each controller's input was at its limit, where it is known."""
        return self._trials_with(Status.SATURATED)

    @cached_property
    def held_back(self) -> dict[str, int]:
        """The number of trials in which the guard held each controller's learning back, where it is known."""
        return self._trials_with(Status.GUARDED)

    def _trials_with(self, bit: Status) -> dict[str, int]:
        status = {
            c: rows for c, run in self.runs.items() if (rows := self._trials(run, "status")) is not None
        }
        return {c: int(np.any(rows.astype(int) & bit, axis=1).sum()) for c, rows in status.items()}

    @cached_property
    def input_rms(self) -> dict[str, float]:
        """Each controller's largest RMS of the input over the second half of a phase, where it is known.

        In A, or in the unit of a linear plant's input.
        """
        signal = "i_q_ref" if self.study.plant is None else "u"
        by_controller = {
            c: rows for c, run in self.runs.items() if (rows := self._trials(run, signal)) is not None
        }
        ends = {
            c: [settled(rms(rows)[p.start - 1 : p.stop - 1]) for p in self.phases]
            for c, rows in by_controller.items()
        }
        return {c: max(values) if np.all(np.isfinite(values)) else math.inf for c, values in ends.items()}

    def _trials(self, run: Run, signal: str) -> Array | None:
        """A recorded signal, trials by rows; None if the run has no rows of it."""
        recorded = len(run.trace) and len(run.trace) % self.trials == 0 and signal in run.trace
        return run.trace[signal].reshape(self.trials, -1) if recorded else None

    def worst_phase(self, controller: str) -> int:
        """The index of the phase that ends with the largest RMS."""
        ends = [x if math.isfinite(x) else math.inf for x in self.final[controller]]
        return ends.index(max(ends))

    def rms_text(self, value: float) -> str:
        """An RMS as text, with its unit."""
        return self.metric.value_text(value)

    def worst_first(self, controller: str, other: str) -> tuple[float, Phase, str]:
        """After a change, the largest ratio of the first trial's RMS to another's; the phase; both RMS."""
        ratios = [
            (self.first(controller, phase) / self.first(other, phase), phase)
            for phase in self.phases[1:]
            if self.first(other, phase) > 0 and math.isfinite(self.first(controller, phase))
        ]
        ratio, phase = max(ratios, key=lambda pair: pair[0], default=(0.0, self.phases[0]))
        mine, base = (self.rms_text(self.first(name, phase)) for name in (controller, other))
        return ratio, phase, f"{mine} against {base}"

    @cached_property
    def certified(self) -> dict[str, tuple[TrialDesign, Model, ModelCertificate]]:
        """Each design with its certificate: for the exactly sampled plant if known, or the design's model."""
        designs = {name: run.design for name, run in self.runs.items() if run.design is not None}
        return {name: (design, *list(models(design.certificate))[-1]) for name, design in designs.items()}

    def learns(self, controller: str) -> bool:
        return bool(getattr(self.study.controller[controller], "learning", True))


def case(results: TrialResults, runs: Sequence[Run]) -> Case | None:
    """The values of a trial scenario to judge by; None if there are none."""
    study, scenario = results.study, runs[0].scenario
    metric, described = judged(study, scenario), study.scenario[scenario]
    rms = {run.controller: rms_of_trials(metric, run, described.trials) for run in runs}
    rms_values = {c: values for c, values in rms.items() if values is not None}
    by_name = {run.controller: run for run in runs}
    candidate = Case(
        study=study, scenario=scenario, metric=metric, phases=phases(described), runs=by_name, rms=rms_values
    )
    return candidate if candidate.counts or candidate.rms else None


def outcome(results: TrialResults, runs: Sequence[Run]) -> Outcome | None:
    """A row for each controller; None if its scenario has no error to judge by."""
    c = case(results, runs)
    if c is None or not c.final:
        return None
    unit = f" ({c.metric.unit})" if c.metric.unit else ""
    where = " of the worst phase" if len(c.phases) > 1 else ""
    drive = c.study.plant is None
    quantity, heading = ("current", "current\n(A)") if drive else ("input", "input\n")
    note = (
        f"RMS of the {c.metric.quantity}{unit} and of the {quantity}. End: the second half of the "
        f"trials{where}. Feedback alone: the same controller in the same trials, without learning."
    )
    columns = ("trial 1", "end", "feedback\nalone", "learning\nleaves", heading, "trials at\nthe limit")
    return Outcome(note, columns, [(name, _cells(c, name)) for name in c.runs if name in c.final])


def own_lines(c: Case) -> list[Line]:
    """The lines that every study of trials has.

    They are the error's RMS without learning, the input's RMS, and the number of trials at the input's limit.
    """
    quantity, unit = ("current", "A") if c.study.plant is None else ("input", "")
    end = f"at the end{', worst phase' if len(c.phases) > 1 else ''}"
    alone = {name: c.feedback[name][c.worst_phase(name)] for name in c.final if name in c.feedback}
    limited = {name: float(count) for name, count in c.at_limit.items()}
    named = (
        (f"{c.metric.quantity} rms without learning {end}", "rms", c.metric.unit, alone),
        (f"{quantity} rms {end}", "rms", unit, c.input_rms),
        (f"trials at the {quantity} limit, of {c.trials}", "trials-at-limit", "", limited),
    )
    return [
        Line(
            name=name,
            kind=kind,
            signal=None,
            order=None,
            frame="mechanical",
            better="none",
            unit=unit_words,
            values=_finite(values),
        )
        for name, kind, unit_words, values in named
        if values
    ]


def _finite(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def _cells(c: Case, name: str) -> list[str]:
    phase = c.worst_phase(name)
    end, alone = c.final[name][phase], c.feedback[name][phase] if name in c.feedback else math.nan
    return [
        _figure(c.first(name, c.phases[0])),
        _figure(end),
        _figure(alone) if name in c.feedback else DASH,
        than(end, alone) if name in c.feedback else DASH,
        _figure(c.input_rms[name]) if name in c.input_rms else DASH,
        f"{c.at_limit[name]} of {c.trials}" if name in c.at_limit else DASH,
    ]


def _figure(value: float) -> str:
    return number(value) if math.isfinite(value) else "not finite"


def than(value: float, other: float) -> str:
    """A value against another in words, such as "46 times less"; "as much" if they differ by little."""
    if not math.isfinite(value) or not math.isfinite(other):
        return DASH
    if same_size(value, other):
        return "as much"
    return f"{times(ratio(value, other))} more" if value > other else f"{times(ratio(other, value))} less"


def same_size(value: float, other: float) -> bool:
    """Whether two values differ by little."""
    return value <= (1 + EQUAL_DIFFERENCE) * other and other <= (1 + EQUAL_DIFFERENCE) * value
