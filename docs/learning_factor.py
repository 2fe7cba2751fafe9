"""The factor by which PI-ILC or robust ILC changes what it learned in each period, and the remaining error.

    python docs/learning_factor.py STUDY CONTROLLER SPEED ORDER... [KEY=VALUE...]

such as: liu2018 pi-ilc "60 rpm" 1 2 6 controller.pi-ilc.gain=0.05. Orders are relative to the memory's
period.

cogless.design.laws.periodic computes the factor, docs/theory/learning.md derives it.
"""

from __future__ import annotations

import math
import sys

import numpy as np

import cogless
from cogless import units
from cogless.design.laws.periodic import PeriodicLoop
from cogless.study.reading import changes_from


def table(learning: PeriodicLoop, orders: list[float]) -> list[str]:
    """A Markdown table of the factor and the residual at each order, with the worst factor below it."""
    frequencies = np.array(orders) * learning.periods_per_second
    x = learning.x(frequencies)
    lines = [
        "| order | frequency [Hz] | $\\lvert\\Gamma S P\\rvert$ | arg [deg] | factor a period | residual |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for order, f, value, factor, left in zip(
        orders, frequencies, x, learning.factor(frequencies), learning.residual(frequencies), strict=True
    ):
        angle = math.degrees(float(np.angle(value)))
        lines.append(f"| {order:g} | {f:.4g} | {abs(value):.3f} | {angle:.0f} | {factor:.3f} | {left:.3f} |")
    if learning.frozen is not None:
        return [*lines, "", f"Frozen: {learning.frozen}."]
    worst = learning.worst()
    kind = "grows" if worst.factor > 1 else "shrinks"
    period = 1e3 / learning.periods_per_second
    return [
        *lines,
        "",
        f"Worst: {worst.frequency:.4g} Hz {kind} by {worst.factor:.4f} a period of {period:.4g} ms.",
    ]


def from_arguments(arguments: list[str]) -> list[str]:
    """The table for the given command-line arguments."""
    study, controller, speed, *rest = arguments
    changes = changes_from([text for text in rest if "=" in text])
    omega_m = units.parse(speed, units.ANGULAR_SPEED)
    learning = PeriodicLoop(cogless.load(study, changes), controller, omega_m)
    return table(learning, [float(text) for text in rest if "=" not in text])


if __name__ == "__main__":
    print("\n".join(from_arguments(sys.argv[1:])))
