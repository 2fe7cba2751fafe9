"""The table that `cogless design --long` prints."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from cogless import units
from cogless.design.angle_functions import Bounds
from cogless.design.law_rules import Gain
from cogless.design.margins import Margins
from cogless.design.summary import Design, current_loop_summary, summary
from cogless.design.warnings import beyond_drive, coarse_table, loop_remarks, notes, shaft_notes, told_apart
from cogless.study import Study

if TYPE_CHECKING:
    from rich.console import Group

COLUMN_WIDTH_MOST = 48  # width in characters of the columns for gains and for learning

# Display units that are usual in papers and practice, where they differ from SI.
DISPLAY_UNITS = {
    units.SPEED_GAIN.unit: (units.SPEED_GAIN, "A/rpm"),
    units.SPEED_INTEGRAL_GAIN.unit: (units.SPEED_INTEGRAL_GAIN, "A/rpm/s"),
    units.ANGULAR_ACCELERATION.unit: (units.ANGULAR_ACCELERATION, "rpm/s"),
    units.CURRENT_TO_ACCELERATION.unit: (units.CURRENT_TO_ACCELERATION, "rpm/s/A"),
}


def design_table(study: Study) -> Group:
    """Table of current loop and controllers: gains in display units, margins, learning; notes below it."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(title=study.title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for heading in ("controller", "law", "rule"):
        table.add_column(heading, overflow="fold")
    table.add_column("gains", overflow="fold", max_width=COLUMN_WIDTH_MOST)
    for heading in ("crossover", "phase margin", "gain margin"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("learning", overflow="fold", max_width=COLUMN_WIDTH_MOST)
    loops = current_loop_summary(study)
    for name, loop in told_apart(loops).items():
        table.add_row(name, "pi", "", _gains(loop.gains), *_margins(loop.margins), "")
    designs = summary(study)
    for name, design in designs.items():
        gains, margins = _gains(design.gains), _margins(design.margins)
        table.add_row(study.label(name), design.law, design.rule or "", gains, *margins, design.words())
    below = (*notes_below(study, designs), *_theorems(study, designs))
    return Group(table, *(Text(line) for line in below))


def notes_below(study: Study, designs: Iterable[str]) -> list[str]:
    """What the design warns of, in a sentence each. `designs`: names of controllers."""
    own = [line for name in designs for line in notes(study, name)]
    far = beyond_drive(study, study.scenario)
    return [
        f"{line}." for line in (*coarse_table(study), *far, *shaft_notes(study), *loop_remarks(study), *own)
    ]


def _theorems(study: Study, designs: dict[str, Design]) -> list[str]:
    """Notes on the proofs' conditions for laws that learn in angle, and on the bounds that these use."""
    notes: list[str] = []
    for name, design in designs.items():
        if design.theorem is not None:
            bounds = design.theorem.bounds
            known = "" if bounds is None else f"Known bounds, mechanical: {_bounds(bounds)}."
            notes += [known] if known and known not in notes else []
            notes.append(f"{study.label(name)}: {design.theorem.verdict()}.")
    return notes


def _bounds(bounds: Bounds) -> str:
    h, rest = f"h {bounds.h_m:.3g} to {bounds.h_M:.3g} A*s^2/rad", dataclasses.asdict(bounds)
    named = ("k_h", "k_alpha1", "k_alpha2", "k_beta1", "k_beta2")
    return ", ".join([h, *(f"{key} {rest[key]:.3g}" for key in named), f"delta+ {bounds.delta:.3g}"])


def _gains(gains: dict[str, Gain]) -> str:
    """Gains in one line. Zero gains without a note are left out, because their terms are inactive."""
    return ", ".join(f"{key} {shown_gain(gain)}" for key, gain in gains.items() if gain.value or gain.note)


def shown_gain(gain: Gain) -> str:
    """A gain with its unit, as papers and datasheets write it."""
    if gain.unit in DISPLAY_UNITS:
        dimension, unit = DISPLAY_UNITS[gain.unit]
        return units.format(gain.value, unit, dimension, digits=4)
    note = f" ({gain.note})" if gain.note else ""
    return f"{gain.value:.4g} {gain.unit}".rstrip() + note


def _margins(m: Margins | None) -> tuple[str, str, str]:
    if m is None:
        return "", "", ""
    if not m.stable:
        return "", "unstable", ""
    gain = "none" if math.isnan(m.gain_margin) else f"{m.gain_margin:.2f} at {_hertz(m.phase_crossover)}"
    if math.isnan(m.crossover):
        return "none", "none", gain
    return _hertz(m.crossover), f"{math.degrees(m.phase_margin):.1f} deg", gain


def _hertz(w: float) -> str:
    return f"{w / (2 * math.pi):.4g} Hz"
