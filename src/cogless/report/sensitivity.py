"""The sensitivity of the speed to a torque that repeats, with learning on and off, as a Bode plot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from cogless.design.closed_loop import Linear
from cogless.design.feedback import feedback_of
from cogless.design.learning_loop import LearningLoop, plants, sensitivity
from cogless.design.margins import Complex, Real
from cogless.design.pi import speed_loop
from cogless.design.verdict import judged, loop_type
from cogless.errors import StudyError
from cogless.report.packing import plain
from cogless.report.palette import place
from cogless.report.paths import learned_terms
from cogless.results import Results, Run

POINTS = 400
DECADES = (0.1, 0.45)  # of the slowest revolution, and of the sample rate
LEAST = 1e-4  # of a magnitude: smaller ones are drawn as this

NOTE = (
    "The share of a disturbance that is left in the speed at each frequency, by the linear model of cogless "
    "design at the scenario's fastest speed; above 0 dB a frequency is made worse. Full: with learning, once "
    "it has settled, for what repeats with the angle. Fainter: learning off. Faintest: with learning, for "
    "what lies midway between two repeating frequencies, which learning amplifies."
)


def bode(results: Results, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Charts of magnitude and phase over frequency; empty if no controller has a linear model."""
    turn = results.study.scenario[runs[0].scenario].top_reference / (2 * math.pi)
    plant = speed_loop(results.study, runs[0].scenario)
    low = DECADES[0] * (turn or 1.0)
    f = np.geomspace(low, max(10 * low, DECADES[1] / plant.period), POINTS)
    grid, *responses = plants(plant)
    P_omega, P_theta = (np.interp(f, grid, response) for response in responses)
    curves: list[tuple[int, str, float, Complex]] = []
    for run in runs:
        feedback, where = _feedback(results, run, 2 * math.pi * turn), place(results, run)
        if feedback is not None:
            off = sensitivity(plant, feedback, 2 * math.pi * f, P_omega, P_theta)
            loop, learns = _loop(results, run), bool(learned_terms(results, run))
            curves.append((where, "off" if learns else "", 0.55 if learns else 1.0, off))
            if loop is not None:
                curves.append((where, "on", 1.0, off * _left(loop, f, 0.0)))
                curves.append((where, "between", 0.25, off * _left(loop, f, 0.5)))
    charts = [
        ("Sensitivity, magnitude", "magnitude", "dB", _decibels),
        ("Sensitivity, phase", "phase", "°", _degrees),
    ]
    return [
        {
            "title": title,
            "x": "frequency (Hz)",
            "quantity": quantity,
            "unit": unit,
            "frequency": plain(f),
            "series": [
                {"controller": where, "label": label, "fade": fade, "values": plain(shown(S))}
                for where, label, fade, S in curves
            ],
        }
        for title, quantity, unit, shown in charts
        if curves
    ]


def _feedback(results: Results, run: Run, omega_m: float) -> Linear | None:
    with suppress(StudyError):
        return feedback_of(results.study, run.controller, omega_m)
    return None


def _left(loop: LearningLoop, f: Real, beside: float) -> Complex:
    """What learning leaves at the learned frequencies, or so far `beside` each, as a smooth curve over f.

    `beside` is a share of the distance to the next. NaN where nothing is learned.
    """
    count = int(loop.highest / loop.periods_per_second)
    learned = np.arange(1, count + 1) if loop.orders is None else loop.orders
    at = (learned + beside) * loop.periods_per_second
    if not len(at):
        return np.full(len(f), np.nan + 0j)
    left = np.interp(f, at, loop.left(at))
    return np.where((f >= at[0]) & (f <= at[-1]), left, np.nan)


def _decibels(S: Complex) -> Real:
    return np.asarray(20 * np.log10(np.maximum(np.abs(S), LEAST)))


def _degrees(S: Complex) -> Real:
    return np.asarray(np.rad2deg(np.angle(S)))


def _loop(results: Results, run: Run) -> LearningLoop | None:
    """The run's learning loop at its fastest judged speed; None if its learning has no such model."""
    if loop_type(results.study.controller[run.controller]) is not None:
        with suppress(StudyError):
            found = judged(results.study, run.scenario, run.controller)
            return found[-1] if found else None
    return None
