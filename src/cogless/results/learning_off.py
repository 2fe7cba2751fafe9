"""What the best learning law of a scenario leaves with its learning off: what its feedback alone does."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LearningOff:
    """A run with the same gains that never learns, by the metric that judges the scenario.

    `signal`: the metric's, or what the sensor shows of it where that judges. `value`: SI; None: it did not
    hold the speed.
    """

    scenario: str
    controller: str
    metric: str  # its name in results.json
    order: float | None
    signal: str | None
    value: float | None
