"""Phases, the trials between two changes: what changed, in words, and which trials to show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from cogless.report.verdict import listed
from cogless.study.trial_scenario import Change, TrialScenario

ZOOM = 30  # trials
BEFORE = 2  # trials of the phase before that a zoom shows too
SHARE = 0.8  # of all trials: there is no zoom on a larger share
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
        wanted = (self.start, self.start + 1, self.start + 4, self.stop - 1)
        return sorted({trial for trial in wanted if trial < self.stop})


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
        """The changes before its phases, such as "30 start changes"."""
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


def groups(found: Sequence[Phase]) -> list[Group]:
    """The phases, where more than `NAMED_MOST` in a row after changes of the same things are one group."""
    rows = (tuple(row) for _, row in groupby(found, key=lambda phase: phase.changed))
    return [
        Group(part)
        for row in rows
        for part in ((row,) if len(row) > NAMED_MOST else ((phase,) for phase in row))
    ]


def after(found: Sequence[Phase], every: Sequence[Phase]) -> str:
    """Some of a scenario's phases within a sentence, such as "after 22 of 30 start changes"."""
    alike, total = Counter(p.changed for p in found), Counter(p.changed for p in every)
    words = []
    for changed, count in alike.items():
        if count > NAMED_MOST:
            share = "all" if count == total[changed] else f"{count} of"
            words.append(f"after {share} {_changes(changed, total[changed])}")
        else:
            words += [phase.after for phase in found if phase.changed == changed]
    return listed(words)


def phases(scenario: TrialScenario) -> list[Phase]:
    """The phases of a trial scenario, in order."""
    changed = [(), *(_changed(change) for change in scenario.changes)]
    bounds = pairwise((*scenario.starts, scenario.trials + 1))
    return [Phase(start, stop, what) for (start, stop), what in zip(bounds, changed, strict=True)]


def zooms(found: Sequence[Phase]) -> list[dict[str, object]]:
    """Zoom buttons above the plots over trials: all trials, and the first trials of each group of phases."""
    count = found[-1].stop - 1
    buttons: list[dict[str, object]] = [{"name": "all trials", "from": 1, "to": count}]
    changes = min(count, found[-1].start + ZOOM - 1)
    if len(found) > 1 and changes < SHARE * count:
        buttons.append({"name": "all changes", "from": 1, "to": changes})
    for group in groups(found):
        end = group.start + ZOOM - 1 if len(group.phases) == 1 else group.stop - 1
        first, last = max(1, group.start - BEFORE), min(count, end)
        if last - first < SHARE * (count - 1):
            buttons.append({"name": group.name, "from": first, "to": last})
    return buttons


def _changes(changed: Sequence[str], count: int = 1) -> str:
    """Changes of the same things in words, such as "load change" or "30 changes of load and inertia"."""
    words = [what.rpartition(".")[2].replace("_", " ") for what in changed]
    number, noun = ("", "change") if count == 1 else (f"{count} ", "changes")
    return number + (f"{words[0]} {noun}" if len(words) == 1 else f"{noun} of {listed(words)}")


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
