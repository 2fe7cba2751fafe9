"""What limits a run: the share of each cause in the run's result, and the changes that help most."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

TORQUE_RIPPLE = "disturbance"
CAUSES = {
    "sensor-steps": "the position sensor's steps",
    "sensor-error": "the position sensor's own error",
    "delay": "delay",
    "dead-time": "dead time",
    "switching": "switching",
    "current-noise": "noise of the current sensors",
    "current-error": "offset and gain errors of the current sensors",
    "learning-time": "what is not learned yet",
    TORQUE_RIPPLE: "torque ripple",
    "friction": "friction",
    "limit": "a limit of current or voltage",
    "belief": "wrong motor parameters",
}
LETS_THROUGH = ("learning-time", "delay", "limit", "belief")  # causes that act by torque ripple that is left
AND = " + "
CLEAR_SHARE = 0.1  # least share of a result's square with which a cause is named
NAMED_MOST = 3  # causes that are named, and against which changes are tried
HELPING_SHARE = 0.8  # an advised change leaves at most this share of the present value


@dataclass(frozen=True)
class Cause:
    """A cause that was taken away from a run.

    `value`: the run's metric without the cause, SI. `share`: the cause's share of the metric's square, at
    most 1; negative if the run is worse without the cause.
    """

    name: str  # a key of CAUSES, or two of them with AND between
    value: float
    share: float

    @property
    def names(self) -> list[str]:
        """Keys of CAUSES."""
        return self.name.split(AND)


@dataclass(frozen=True)
class Cost:
    """A metric that a change makes clearly worse in the same run, SI. `metric`: its name in results.json."""

    metric: str
    before: float
    value: float

    @property
    def ratio(self) -> float:
        return self.value / self.before


@dataclass(frozen=True)
class Harm:
    """Another scenario that a change makes clearly worse.

    `before`, `value`: the metric that judges that scenario, of one controller's run, SI. `value` is None if
    the speed is not held with the change.
    """

    scenario: str
    controller: str
    before: float
    value: float | None


@dataclass(frozen=True)
class Cure:
    """A change of the study, values by dotted key, that was tried against a cause.

    `value`: the metric with the change, SI. `setting`: the change needs no other part, only another number.
    `costs`: other metrics that get clearly worse with the change.
    `learner`: the metric of `Limits.learner` with the change, SI; None: that law was not tried, or does not
    hold the speed. `harms`: the other scenarios that get clearly worse; known only of an advised change, and
    of the changes that it replaces. `by_chance`: the change helps with the study's seed, but not with
    another; this, too, is known only of changes that are, or were first, advised.
    """

    cause: str
    changes: Mapping[str, Any]
    value: float
    setting: bool
    costs: Sequence[Cost] = ()
    learner: float | None = None
    harms: Sequence[Harm] = ()
    by_chance: bool = False

    @property
    def of_law(self) -> bool:
        """Whether the change is in one controller, so that it says nothing of another controller."""
        return any(key.startswith("controller.") for key in self.changes)


@dataclass(frozen=True)
class Learner:
    """The best law that learns, where a controller that does not learn is best.

    `value`: its metric, SI; None: it did not hold the speed.
    """

    controller: str
    value: float | None


@dataclass(frozen=True)
class InVain:
    """Kinds of settings, in words, with none of which, alone or two together, a controller held a speed."""

    controller: str
    settings: Sequence[str]


@dataclass(frozen=True)
class Limits:
    """What limits a run, judged by one of its metrics, or by one order of this metric.

    `causes`: the causes of error in the study, the largest share first; their shares need not add up to one.
    `untried`: causes that can't be taken away from the run, so their shares are unknown. `cures`: the changes
    that were tried, the best first. `learner`: another law with which the advised cures were also tried.
    `value`: infinite if no controller holds the speed of the scenario; then there are no causes, and with
    each of the cures the controller holds the speed. `in_vain`: the settings with which
    none holds it.
    """

    scenario: str
    controller: str
    metric: str  # its name in results.json
    order: float | None
    value: float  # SI, of the run as it is
    causes: Sequence[Cause]
    untried: Sequence[str] = ()
    cures: Sequence[Cure] = ()
    learner: Learner | None = None
    in_vain: InVain | None = None

    @property
    def named(self) -> list[Cause]:
        """The causes with a clear share, the largest first.

        Torque ripple is named only if it has clearly more than any cause that lets it through.
        """
        clear = [cause for cause in self.causes if cause.share >= CLEAR_SHARE]
        if any(len(cause.names) > 1 for cause in clear):  # none has most alone
            return clear[:1]
        through = max((cause.share for cause in clear if cause.name in LETS_THROUGH), default=0.0)
        return [c for c in clear if c.name != TORQUE_RIPPLE or c.share - through >= CLEAR_SHARE]

    @property
    def setting(self) -> Cure | None:
        """The best change that needs no other part, if possible without harm to other scenarios.

        None: no such change that was tried helps.
        """
        return self._best(True)

    @property
    def holding(self) -> Cure | None:
        """The best setting with which the controller holds a speed that no controller holds."""
        return self.setting if math.isinf(self.value) else None

    @property
    def part(self) -> Cure | None:
        """The best other part, if it leaves clearly less than the best setting; None if none does."""
        part, setting = self._best(False), self.setting
        return part if part and (not setting or part.value <= HELPING_SHARE * setting.value) else None

    @property
    def advised(self) -> list[Cure]:
        """The setting and the part that help."""
        return [cure for cure in (self.setting, self.part) if cure is not None]

    def _best(self, setting: bool) -> Cure | None:
        able = [
            c
            for c in self.cures
            if c.setting is setting and c.value <= HELPING_SHARE * self.value and not c.by_chance
        ]
        return next((cure for cure in able if not cure.harms), next(iter(able), None))
