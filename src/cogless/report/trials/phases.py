"""Phases, the trials between two changes: what changed, in words, and which trials to show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from cogless.report.verdict import listed
from cogless.study.trial_scenario import Change, TrialScenario

ZOOM = 30  # trials
BEFORE = 2  # trials of the phase before that a zoom shows too
SHARE = 0.8  # of all trials: there is no zoom on a larger share


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
        words = [what.rpartition(".")[2].replace("_", " ") for what in self.changed]
        if not words:
            return "from the start"
        change = f"{words[0]} change" if len(words) == 1 else f"change of {listed(words)}"
        return f"after the {change} (trial {self.start})"

    @property
    def chosen(self) -> list[int]:
        """The trials to draw: the first, second, fifth and last of the phase, as far as it has them."""
        wanted = (self.start, self.start + 1, self.start + 4, self.stop - 1)
        return sorted({trial for trial in wanted if trial < self.stop})


def phases(scenario: TrialScenario) -> list[Phase]:
    """The phases of a trial scenario, in order."""
    changed = [(), *(_changed(change) for change in scenario.changes)]
    bounds = pairwise((*scenario.starts, scenario.trials + 1))
    return [Phase(start, stop, what) for (start, stop), what in zip(bounds, changed, strict=True)]


def zooms(found: Sequence[Phase]) -> list[dict[str, object]]:
    """Zoom buttons above the plots over trials: all trials, and the first trials of each phase."""
    count = found[-1].stop - 1
    buttons: list[dict[str, object]] = [{"name": "all trials", "from": 1, "to": count}]
    changes = min(count, found[-1].start + ZOOM - 1)
    if len(found) > 1 and changes < SHARE * count:
        buttons.append({"name": "all changes", "from": 1, "to": changes})
    for phase in found:
        first, last = max(1, phase.start - BEFORE), min(count, phase.start + ZOOM - 1)
        if last - first < SHARE * (count - 1):
            buttons.append({"name": phase.name, "from": first, "to": last})
    return buttons


def _changed(change: Change) -> tuple[str, ...]:
    """Names of what a change of the scenario sets."""
    told = []
    if change.reference is not None:
        told.append("reference")
    if change.load is not None or change.load_steps is not None:
        told.append("load")
    told += [key for key in change.override or {}]
    if any(getattr(change, key) is not None for key in ("initial_angle", "initial_speed", "initial_state")):
        told.append("start")
    if change.each_trial is not None:
        told.append("spread of the trials")
    return tuple(told) or ("nothing",)
