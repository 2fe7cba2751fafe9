"""The table that `cogless design` prints."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cogless import units
from cogless.design.summary import Design, Gain, summary
from cogless.study import Study

if TYPE_CHECKING:
    from rich.table import Table

# The paper's and the trade's units, where they aren't SI.
SHOWN = {
    units.SPEED_GAIN.unit: (units.SPEED_GAIN, "A/rpm"),
    units.SPEED_INTEGRAL_GAIN.unit: (units.SPEED_INTEGRAL_GAIN, "A/rpm/s"),
    units.ANGULAR_ACCELERATION.unit: (units.ANGULAR_ACCELERATION, "rpm/s"),
    units.CURRENT_TO_ACCELERATION.unit: (units.CURRENT_TO_ACCELERATION, "rpm/s/A"),
}


def design_table(study: Study) -> Table:
    """One row a controller: its gains in display units and the margins of its speed loop."""
    from rich.table import Table

    table = Table(title=study.title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for heading in ("controller", "law", "rule", "gains"):
        table.add_column(heading, overflow="fold")
    for heading in ("crossover", "phase margin", "gain margin", "learning"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, design in summary(study).items():
        gains = ", ".join(f"{key} {_shown(gain)}" for key, gain in design.gains.items())
        table.add_row(
            study.label(name), design.law, design.rule or "", gains, *_margins(design), _learning(design)
        )
    return table


def _shown(gain: Gain) -> str:
    if gain.unit in SHOWN:
        dimension, unit = SHOWN[gain.unit]
        return units.format(gain.value, unit, dimension, digits=4)
    return f"{gain.value:.4g} {gain.unit}".rstrip()


def _learning(design: Design) -> str:
    worst = design.learning
    if worst is None:
        return ""
    if worst.factor <= 1.0 + 1e-3:
        return "settles"
    return f"grows {worst.factor:.3f}x a period at {worst.frequency:.0f} Hz"


def _margins(design: Design) -> tuple[str, str, str]:
    m = design.margins
    if m is None:
        return "", "", ""
    crossover = "none" if math.isnan(m.crossover) else f"{m.crossover / (2 * math.pi):.1f} Hz"
    phase = "none" if math.isnan(m.phase_margin) else f"{math.degrees(m.phase_margin):.1f} deg"
    return crossover, phase, "none" if math.isnan(m.gain_margin) else f"{m.gain_margin:.2f}"
