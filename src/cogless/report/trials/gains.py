"""The gains that each controller ran with, and how they were found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from cogless.design.lmi import Check
from cogless.design.trial import TrialDesign
from cogless.design.trial_summary import labelled_notes, matrix_flash, matrix_size, megabytes
from cogless.report.markup import NONE, headings, note, rows, table
from cogless.report.packing import number
from cogless.results import Run, TrialResults
from cogless.study import TrialStudy


def gain_table(results: TrialResults, runs: Sequence[Run]) -> str:
    """HTML table with a row per gain and a column per controller; empty if no run has a design."""
    designs = {run.controller: run.design for run in runs if run.design is not None}
    columns = [dict(_gains(results.study, design)) for design in designs.values()]
    names = dict.fromkeys(name for column in columns for name in column)
    body = rows(
        (name, "".join(f"<td>{escape(column.get(name, NONE))}</td>" for column in columns)) for name in names
    )
    head = f"<th></th>{headings(results, designs)}"
    notes = "".join(map(note, labelled_notes(results.study, designs)))
    return table("gains", f"Gains in {runs[0].scenario}", head, body) + notes


def _gains(study: TrialStudy, design: TrialDesign) -> Iterator[tuple[str, str]]:
    """Yields the name, with unit, and the value of each gain, as text."""
    drive = study.plant is None
    states = ("theta_m", "omega_m") if study.plant is None else study.plant.names
    units = (" (A/rad)", " (A·s/rad)") if drive else ("",) * len(states)
    angle = units[0] if drive else ""
    for state, unit, gain in zip(states, units, design.K_1, strict=True):
        yield f"K_1, {state}{unit}", _plain(gain)
    yield f"K_2, integrator{angle}", _plain(design.K_2) if design.K_2 else NONE
    yield f"N{angle}", _plain(design.N)
    if design.learning_matrix is not None:
        flash = matrix_flash(study, design)
        needed = f", {megabytes(flash)} of flash" if flash else ""
        yield "learning matrix", f"{matrix_size(design)}{needed}"
    else:
        yield "K_3", _plain(design.K_3) if design.K_3 else NONE
    if design.K_3 or design.learning_matrix is not None:
        yield "learned signal into", "input and integrator" if design.through_integrator else "input"
        yield "shift r (samples)", str(design.shift)
    if design.q_filter is not None:
        yield "Q filter b", _list(design.q_filter.b)
        yield "Q filter a", _list(design.q_filter.a)
        yield "Q filter acts on", f"the {'error' if design.filtered == 'error' else 'learned signal'}"
    ahead = design.feedforward
    yield "feedforward", f"{ahead.method}, {ahead.preview} samples ahead" if ahead else NONE
    if ahead is not None:
        yield f"feedforward num{angle}", _list(ahead.num)
        yield "feedforward den", _list(ahead.den)
    feedback, learning = design.gains.feedback, design.gains.learning
    yield "K_1 and K_2 from", "given" if feedback is None else f"LMIs; {_check(feedback.check)}"
    if design.K_3:
        yield "K_3 from", "given, or by frequency" if learning is None else f"LMIs; {_check(learning.check)}"


def _check(check: Check) -> str:
    passed = "checked" if check.passed else "CHECK FAILED"
    return f"{passed}: cost at the worst vertex {number(check.cost)}, bound {number(check.bound)}"


def _list(values: NDArray[np.float64]) -> str:
    return ", ".join(_plain(value) for value in values.tolist())


def _plain(value: float) -> str:
    return f"{value:.6g}"
