"""The table that `cogless design --long` prints."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from cogless import units
from cogless.design.angle_functions import Bounds
from cogless.design.answers import Answer, answer
from cogless.design.law_rules import Gain
from cogless.design.margins import Margins
from cogless.design.summary import Design, current_loop_summary, summary
from cogless.design.warnings import beyond_drive, cogging_notes, loop_remarks, notes, shaft_notes, told_apart
from cogless.study import Study
from cogless.study.base import speed_text
from cogless.units import TURN

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table

TIME_COLUMNS = ("speed", "settles in", "scenario lasts")
RIPPLE_COLUMNS = (
    "feedback alone",
    "with learning",
    "sensor's steps",
    "sensor's error",
    "orders not learned",
    "current noise",
    "counts a sample",
)
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
        table.add_row(study.label(name), design.law, design.rule or "", gains, *margins, design.in_words())
    answers = {name: answer(study, name, design) for name, design in designs.items()}
    words = [f"{study.label(name)}: {one.words}." for name, one in answers.items() if one is not None]
    below = (*words, *notes_below(study, designs), *_theorems(study, designs))
    return Group(table, *_at_speeds(study, answers), *(Text(line) for line in below))


def _at_speeds(study: Study, answers: Mapping[str, Answer | None]) -> Iterator[Table]:
    """At each constant speed: the time in which learning settles, and what is left of the speed's ripple."""
    from rich.table import Table

    has_ripple = any(one is not None and one.remaining for one in answers.values())
    title = f"At constant speeds{' (ripple: rms of the speed)' if has_ripple else ''}"
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    table.add_column("controller", overflow="fold")
    for heading in (*TIME_COLUMNS, *(RIPPLE_COLUMNS if has_ripple else ())):
        table.add_column(heading, justify="right")
    for name, one in answers.items():
        for cells in _speed_rows(study, one) if one is not None else ():
            table.add_row(study.label(name), *(cells if has_ripple else cells[: len(TIME_COLUMNS)]))
    if table.row_count:
        yield table


def _speed_rows(study: Study, one: Answer) -> Iterator[list[str]]:
    times = {at_speed.omega_m: at_speed for at_speed in one.settling}
    ripple = {at_speed.omega_m: at_speed for at_speed in one.remaining}
    for omega in sorted({*times, *ripple}):
        time, rest = times.get(omega), ripple.get(omega)
        lasts = ["", ""] if time is None else [f"{time.time:.3g} s", f"{time.duration:.4g} s"]
        parts = () if rest is None else (rest.steps, rest.error, rest.unlearned, rest.noise)
        sizes = () if rest is None else (rest.alone, rest.learned, *parts)
        counts = "" if rest is None or math.isinf(rest.counts) else f"{rest.counts:.3g}"
        ripples = [speed_text(study, size, 3) for size in sizes] or [""] * len(RIPPLE_COLUMNS[1:])
        yield [speed_text(study, omega), *lasts, *ripples, counts]


def notes_below(study: Study, designs: Iterable[str]) -> list[str]:
    """What the design warns of, in a sentence each. `designs`: names of controllers."""
    own = [line for name in designs for line in notes(study, name)]
    far = beyond_drive(study, study.scenario)
    return [
        f"{line}." for line in (*cogging_notes(study), *far, *shaft_notes(study), *loop_remarks(study), *own)
    ]


def _theorems(study: Study, designs: dict[str, Design]) -> list[str]:
    """Notes on the proofs' conditions for laws that learn in angle, and on the bounds that these use."""
    notes: list[str] = []
    for name, design in designs.items():
        if design.theorem is not None:
            bounds = design.theorem.bounds
            bounds_note = "" if bounds is None else f"Known bounds, mechanical: {_bounds(bounds)}."
            notes += [bounds_note] if bounds_note and bounds_note not in notes else []
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
    return f"{w / TURN:.4g} Hz"
