"""A scenario's numbers, phase by phase, for the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cogless.report.trials.errors import Array, Judged, judged, rms_of_trials, settled
from cogless.report.trials.phases import Phase, phases
from cogless.results import Run, TrialResults
from cogless.results.metrics import result_name
from cogless.results.status import Status
from cogless.study import TrialStudy

GROWS = 1.5  # times what the RMS was before in the phase: learning diverges
FEWEST = 8  # trials in which growth can be told
ROUNDING = 1e-9  # of a phase's first RMS
QUARTERS = 4


@dataclass(frozen=True)
class Case:
    """Controllers with their numbers in each phase; counts are infinite where the floor is never reached."""

    study: TrialStudy
    scenario: str
    about: Judged
    phases: Sequence[Phase]
    runs: Mapping[str, Run]
    rms: Mapping[str, Array]  # of those controllers that have it

    @cached_property
    def counts(self) -> dict[str, list[float]]:
        """Trials to the floor; empty where no metric says."""
        for metric in self.about.metrics:
            if metric.kind == "trials-to-floor":
                name = result_name(metric)
                found = {c: run.metrics[name] for c, run in self.runs.items() if name in run.metrics}
                return {c: values for c, values in found.items() if isinstance(values, list)}
        return {}

    @cached_property
    def final(self) -> dict[str, list[float]]:
        """RMS over the second half of each phase, in the display unit."""
        return {c: [settled(self.of(c, phase)) for phase in self.phases] for c in self.rms}

    def of(self, controller: str, phase: Phase) -> Array:
        """A controller's RMS in the trials of a phase."""
        return self.rms[controller][phase.start - 1 : phase.stop - 1]

    def first(self, controller: str, phase: Phase) -> float:
        """RMS of a phase's first trial; NaN where it isn't known."""
        return float(self.rms[controller][phase.start - 1]) if controller in self.rms else math.nan

    def never(self, controller: str) -> list[Phase]:
        """Phases in which the floor isn't reached."""
        counts = self.counts[controller]
        return [phase for phase, n in zip(self.phases, counts, strict=True) if not math.isfinite(n)]

    def slowest(self, controller: str) -> float:
        """The most trials to the floor in any phase."""
        return max(self.counts[controller])

    def worst(self, controller: str) -> float:
        """The largest final RMS of all phases; infinite where one isn't finite or known."""
        return max(
            (x if math.isfinite(x) else math.inf for x in self.final.get(controller, [])), default=math.inf
        )

    @cached_property
    def growing(self) -> dict[str, tuple[Phase, float, float]]:
        """Phase in which each diverging controller diverges, and its RMS, from and to (not finite: NaN)."""
        found = {}
        for controller in self.rms:
            for phase in self.phases:
                grown = self._grown(self.of(controller, phase))
                if grown is not None and controller not in found:
                    found[controller] = (phase, *grown)
        return found

    def _grown(self, rms: Array) -> tuple[float, float] | None:
        """Growth of the RMS, from and to, by the medians of the phase's quarters; None below the floor."""
        if not np.all(np.isfinite(rms)):
            return float(rms[0]), math.nan
        if len(rms) < FEWEST:
            return None
        medians = [float(np.median(part)) for part in np.array_split(rms, QUARTERS)]
        low, last = min(medians), medians[-1]
        least = max(ROUNDING * float(rms[0]), self.about.floor or 0.0)
        return (low, last) if last > GROWS * low and last > least else None

    def limited(self, controller: str) -> int:
        """Trials in which the input was at its limit."""
        trace = self.runs[controller].trace
        if "status" not in trace.names:
            return 0
        status = trace["status"].reshape(self.study.scenario[self.scenario].trials, -1).astype(int)
        return int(np.any(status & Status.SATURATED, axis=1).sum())

    def label(self, controller: str) -> str:
        """A controller's label, in quotation marks if it has a comma, since sentences list labels."""
        label = self.study.label(controller)
        return f"“{label}”" if "," in label else label

    def listed(self, controllers: Sequence[str]) -> str:
        """Labels of controllers, for a sentence."""
        return listed([self.label(name) for name in controllers])

    def text(self, value: float) -> str:
        """An RMS with its unit."""
        return self.about.text(value) if math.isfinite(value) else "not finite"

    def learns(self, controller: str) -> bool:
        return bool(getattr(self.study.controller[controller], "learning", True))


def listed(parts: Sequence[str]) -> str:
    """ "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def case(results: TrialResults, scenario: str) -> Case | None:
    """The case to judge, or None."""
    study = results.study
    about = judged(study, scenario)
    runs = {run.controller: run for run in results.runs if run.scenario == scenario}
    trials = study.scenario[scenario].trials
    rms = {c: rms_of_trials(about, run, trials) for c, run in runs.items()}
    found = Case(
        study,
        scenario,
        about,
        phases(study.scenario[scenario]),
        runs,
        {c: values for c, values in rms.items() if values is not None},
    )
    return found if found.counts or found.rms else None
