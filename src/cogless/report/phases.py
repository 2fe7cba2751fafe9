"""The phases of a trial scenario, between two changes: what changed, in words, and which trials to show.

The module also finds the error by which a trial study is judged: its signal, its display unit, and its RMS
over each trial.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np

from cogless.report.charts import Zoom
from cogless.report.comparison import pretty
from cogless.report.markup import number, rms
from cogless.report.verdicts import listed
from cogless.results import Run
from cogless.results.metrics import SETTLED_SHARE, result_name
from cogless.results.trace import Array
from cogless.study import TrialStudy
from cogless.study.metric import SIGNAL_DIMENSIONS, Metric
from cogless.study.trial_study import Change, TrialScenario
from cogless.units import factor

ZOOM_TRIALS = 30  # trials of a phase that a zoom shows
ZOOM_TRIALS_BEFORE = 2  # trials before the phase that a zoom shows too
ZOOM_SHARE_MOST = 0.8  # there is no zoom on a larger share of all trials
NAMED_MOST = 3  # changes of the same things are named one by one up to this number, and counted above it


@dataclass(frozen=True)
class Phase:
    """Trials `start` to `stop` - 1, counted from 1; `changed`: what changed before it, empty in the first."""

    start: int
    stop: int
    changed: tuple[str, ...]

    @property
    def name(self) -> str:
        """The phase's name on a mark or a button, such as "trial 31: load"."""
        return f"trial {self.start}: {', '.join(self.changed)}" if self.changed else "start"

    @property
    def after(self) -> str:
        """The phase within a sentence, such as "after the load change (trial 31)"."""
        return (
            f"after the {_changes(self.changed)} (trial {self.start})" if self.changed else "from the start"
        )

    @property
    def chosen(self) -> list[int]:
        """The trials to draw: the first, second, fifth and last of the phase, as far as it has them."""
        candidates = (self.start, self.start + 1, self.start + 4, self.stop - 1)
        return sorted({trial for trial in candidates if trial < self.stop})


@dataclass(frozen=True)
class Group:
    """Phases in a row that are shown as one: a single phase, or many after changes of the same things."""

    phases: tuple[Phase, ...]

    @property
    def start(self) -> int:
        return self.phases[0].start

    @property
    def stop(self) -> int:
        return self.phases[-1].stop

    @property
    def changes(self) -> str:
        """The changes before the group's phases, such as "30 start changes"."""
        return _changes(self.phases[0].changed, len(self.phases))

    @property
    def name(self) -> str:
        """The group's name on a mark or a button, such as "trial 2: 30 start changes"."""
        return self.phases[0].name if len(self.phases) == 1 else f"trial {self.start}: {self.changes}"

    @property
    def row(self) -> str:
        """The group in the title of a row of numbers, such as "worst of 30 start changes from trial 2"."""
        if len(self.phases) == 1:
            return f"from trial {self.start}"
        return f"worst of {self.changes} from trial {self.start}"

    @property
    def drawn(self) -> list[Phase]:
        """The phases whose trials are drawn: the first and the last."""
        return list(dict.fromkeys((self.phases[0], self.phases[-1])))


def groups(all_phases: Sequence[Phase]) -> list[Group]:
    """Groups of phases: more than `NAMED_MOST` in a row after changes of the same things are one group."""
    rows = (tuple(row) for _, row in groupby(all_phases, key=lambda phase: phase.changed))
    return [
        Group(part)
        for row in rows
        for part in ((row,) if len(row) > NAMED_MOST else ((phase,) for phase in row))
    ]


def after(all_phases: Sequence[Phase], every: Sequence[Phase]) -> str:
    """Some of a scenario's phases within a sentence, such as "after 22 of 30 start changes"."""
    alike, total = Counter(p.changed for p in all_phases), Counter(p.changed for p in every)
    words = []
    for changed, count in alike.items():
        if count > NAMED_MOST:
            share = "all" if count == total[changed] else f"{count} of"
            words.append(f"after {share} {_changes(changed, total[changed])}")
        else:
            words += [phase.after for phase in all_phases if phase.changed == changed]
    return listed(words)


def phases(scenario: TrialScenario) -> list[Phase]:
    """The phases of a trial scenario, in order."""
    changed = [(), *(_changed(change) for change in scenario.changes)]
    bounds = pairwise((*scenario.starts, scenario.trials + 1))
    return [Phase(start, stop, what) for (start, stop), what in zip(bounds, changed, strict=True)]


def zooms(all_phases: Sequence[Phase]) -> list[Zoom]:
    """Zoom buttons above the plots over trials: all trials, and the first trials of each group of phases."""
    count = all_phases[-1].stop - 1
    buttons = [Zoom("all trials", 1, count)]
    changes = min(count, all_phases[-1].start + ZOOM_TRIALS - 1)
    if len(all_phases) > 1 and changes < ZOOM_SHARE_MOST * count:
        buttons.append(Zoom("all changes", 1, changes))
    for group in groups(all_phases):
        end = group.start + ZOOM_TRIALS - 1 if len(group.phases) == 1 else group.stop - 1
        first, last = max(1, group.start - ZOOM_TRIALS_BEFORE), min(count, end)
        if last - first < ZOOM_SHARE_MOST * (count - 1):
            buttons.append(Zoom(group.name, first, last))
    return buttons


def _changes(changed: Sequence[str], count: int = 1) -> str:
    """Changes of the same things in words, such as "load change" or "30 changes of load and inertia"."""
    words = [what.rpartition(".")[2].replace("_", " ") for what in changed]
    number, noun = ("", "change") if count == 1 else (f"{count} ", "changes")
    return number + (f"{words[0]} {noun}" if len(words) == 1 else f"{noun} of {listed(words)}")


def _changed(change: Change) -> tuple[str, ...]:
    """Names of what a change of the scenario sets."""
    names = []
    if change.reference is not None:
        names.append("reference")
    if change.load is not None or change.load_steps is not None:
        names.append("load")
    names += [key for key in change.override or {}]
    if any(getattr(change, key) is not None for key in ("initial_angle", "initial_speed", "initial_state")):
        names.append("start")
    if change.each_trial is not None:
        names.append("spread of the trials")
    return tuple(names) or ("nothing",)


ERROR_NAMES = {"theta_error": "error", "theta_error_measured": "measured error", "y_error": "error"}


@dataclass(frozen=True)
class Judged:
    """A signal whose RMS over each trial is judged, and the floor, in `unit`, that the RMS should reach."""

    signal: str
    unit: str  # as it is printed; empty if it has none
    scale: float  # SI value of a unit
    floor: float | None
    metrics: Sequence[Metric]  # those of this signal

    @property
    def quantity(self) -> str:
        """The signal's name in sentences, such as "measured error" or "tau_e"."""
        return ERROR_NAMES.get(self.signal, self.signal)

    def value_text(self, value: float) -> str:
        """A value in `unit`, as text with the unit."""
        return f"{number(value)} {self.unit}".rstrip() if math.isfinite(value) else "not finite"


def judged(study: TrialStudy, scenario: str) -> Judged:
    """The signal to judge by: that of the first metric with a floor, else of the first RMS, else an error."""
    metrics = [m for m in study.metrics_in(scenario) if m.better == "lower"]
    floors = [m for m in metrics if m.kind == "trials-to-floor"]
    chosen = [*floors, *(m for m in metrics if m.kind != "maximum")]
    signal = (chosen and chosen[0].signal) or ("theta_error" if study.plant is None else "y_error")
    unit, scale = display_unit(study, signal)
    floor = floors[0].floor / scale if floors and floors[0].floor else None
    return Judged(signal, unit, scale, floor, [m for m in metrics if m.signal == signal])


def display_unit(study: TrialStudy, signal: str) -> tuple[str, float]:
    """The unit in which the study's metrics show a signal, and its SI value; the SI unit if they show none.

    An error signal without a metric of its own has the unit of another error signal.
    """
    dimension = SIGNAL_DIMENSIONS.get(signal) if study.plant is None else None
    if dimension is None or not dimension.unit:
        return "", 1.0
    units_of = {m.signal: m.unit for m in reversed(study.metric) if m.unit and m.kind != "trials-to-floor"}
    alike = [units_of[name] for name in ERROR_NAMES if name in units_of and signal in ERROR_NAMES]
    unit = units_of.get(signal) or next(iter(alike), dimension.unit)
    return pretty(unit), factor(unit, dimension)


def rms_of_trials(judged: Judged, run: Run, trials: int) -> Array | None:
    """RMS over each trial, in the signal's display unit; None if neither a metric nor the trace has it."""
    for metric in judged.metrics:
        if metric.kind == "rms" and result_name(metric) in run.metrics:
            return np.asarray(run.metrics[result_name(metric)], dtype=float) / judged.scale
    if not len(run.trace) or len(run.trace) % trials or judged.signal not in run.trace:
        return None
    return rms(run.trace[judged.signal].reshape(trials, -1)) / judged.scale


def settled(of_trials: Array) -> float:
    """RMS over the second half of a phase's trials, like the metric final-rms."""
    return float(rms(of_trials[-max(1, round(SETTLED_SHARE * len(of_trials))) :]))
