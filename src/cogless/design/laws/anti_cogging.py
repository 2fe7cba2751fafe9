"""Whether the slow run that fills an anti-cogging table records the cogging: docs/laws/anti-cogging.md.

In the run k_theta = position_gain stands before the law's PI, so that its open loop L is that of
closed_loop.py. Against a current of order n the loop gives -T of it, with

    T = L / (1 + L) at w = n omega_cal

In the backward run, T leads by as much as it lags forwards. The table has the mean of both, -Re T, and leaves
1 - Re T.

The run begins to record after 1/8 of a revolution, at t = (pi / 4) / omega_cal. The speed of its reference
jumps by 2 omega_cal where the run turns back. The angle is then 2 omega_cal / w_c behind, and catches up by
the slowest pole, a = k_theta or k_i / k_p. So a current of 2 omega_cal a^2 / (w_c b) e^-at accelerates the
rotor, and is recorded, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.auto import known_orders, map_cells
from cogless.design.changes import cure_words, first, helping, unit_text
from cogless.design.closed_loop import Linear, open_loop, oscillation, poles, position_margins
from cogless.design.detent import snaps, swing
from cogless.design.gentler import slower_feedback
from cogless.design.law_rules import FeedbackRules, Values
from cogless.design.margins import Real
from cogless.design.speed_loop import PHASE_MARGIN_LEAST, SpeedLoop, gains, speed_loop
from cogless.study import Study
from cogless.study.base import speed_text
from cogless.study.laws.anti_cogging import AntiCogging
from cogless.study.laws.law import SETTLING_TURNS, Commissioning
from cogless.study.messages import dotted
from cogless.study.reading import Changes, Remark
from cogless.units import TURN

CROSSOVER_RATIO = 4.0  # the speed loop's crossover / that of the run's position loop
ORDER_SHARE_LEAST = 1e-3  # current of an order / that of the largest order; smaller orders aren't judged
STIFFER_FACTORS = (2.0, 4.0, 8.0, 16.0)  # by which the crossover of a snapping rotor's loop is raised
WORTHWHILE_SHARE = 0.5  # share of the cogging current that a table leaves; more is hardly worth a table


def position_gain(loop: SpeedLoop, pi: tuple[float, float]) -> float:
    """The gain, 1/s, of a position loop that a speed loop with the gains kp and ki can follow."""
    return position_margins(loop, Linear(ratio=1, k=pi[0], k_i=pi[1])).crossover / CROSSOVER_RATIO


def share_left(loop: SpeedLoop, feedback: Linear, w: Real) -> Real:
    """Shares that the table leaves of orders which the run meets at w in rad/s."""
    L = open_loop(loop, feedback, w)
    return np.asarray(np.abs(1 - (L / (1 + L)).real))


def unsettled(loop: SpeedLoop, feedback: Linear, speed: float) -> float:
    """The current, A, that still accelerates the rotor where a run at `speed`, rad/s, begins to record.

    The loop must have a crossover.
    """
    magnitudes = np.abs(poles(loop, feedback))
    a = -math.log(float(np.max(magnitudes[magnitudes < 1 - 1e-9]))) / loop.period
    w_c = position_margins(loop, Linear(ratio=1, k=feedback.k, k_i=feedback.k_i)).crossover
    return 2 * speed * a**2 / (w_c * loop.b) * math.exp(-a * SETTLING_TURNS * math.tau / speed)


def commissioning_warning(study: Study, name: str) -> Remark | None:
    """Warning of a run whose loop is unstable, or that is too fast to record the cogging; None if it does."""
    run = study.controller[name].commissioning
    if run is None:
        return None
    remarks = (_warning(study, name, run, key) for key in study.scenarios_of(name))
    return next((remark for remark in remarks if remark is not None), None)


def _warning(study: Study, name: str, run: Commissioning, scenario: str) -> Remark | None:
    loop, pi = speed_loop(study, scenario), gains(study, name)
    key = f"{dotted(('controller', name))}.calibration"
    if oscillation(loop, Linear(ratio=1, k=pi[0], k_i=pi[1])):
        return None  # unstable even without the run: another warning says so
    wrong = _unrecorded(study, name, run, scenario)
    if wrong is None:
        return None
    follows = position_gain(loop.rigid, pi)
    sentence = f"its calibration run in scenario {scenario} {wrong}"
    wave = functions_in(study, scenario).waves(run.speed)[1:]
    orders = np.flatnonzero(wave > ORDER_SHARE_LEAST * np.max(wave)) + 1
    slow = speed_text(study, follows / int(orders[-1]), 2) if len(orders) else ""

    def cured(other: Study) -> bool:
        run = other.controller[name].commissioning
        assert run is not None
        return _unrecorded(other, name, run, scenario) is None

    def stiff_enough(other: Study) -> bool:
        kp, ki = gains(other, name)
        margins = position_margins(speed_loop(other, scenario), Linear(ratio=1, k=kp, k_i=ki))
        return margins.stable and margins.phase_margin >= PHASE_MARGIN_LEAST and cured(other)

    gain: Changes = {f"{key}.position_gain": unit_text(follows, "1/s")}
    speed: Changes | None = {f"{key}.speed": slow} if slow else None
    gain_and_speed = {**gain, **speed} if speed is not None else None
    cures = helping(study, (gain, speed), cured) or helping(study, (gain_and_speed,), cured)
    if not cures:  # a rotor that snaps needs a loop that is stiffer than its detents
        stiffer = (slower_feedback(study, name, 1 / factor) for factor in STIFFER_FACTORS)
        cures = first(study, (change for change in stiffer if change is not None), stiff_enough)
        key = dotted(("controller", name))
    return Remark(sentence + cure_words(cures, key), cures)


def _unrecorded(study: Study, name: str, run: Commissioning, scenario: str) -> str | None:
    """The reason, in words, why a commissioning run can't record the cogging; None if it can."""
    loop, (kp, ki), speed = speed_loop(study, scenario), gains(study, name), run.speed
    feedback = Linear(ratio=1, k=kp, k_theta=run.position_gain, k_i=ki)
    swings = oscillation(loop, feedback)
    if swings:
        return f"is unstable, at {swings.frequency:.3g} Hz"
    if math.isnan(position_margins(loop, Linear(ratio=1, k=kp, k_i=ki)).crossover):
        return "records nothing: the speed loop has no crossover, so the rotor follows no reference"
    swinging = swing(study, scenario, feedback, speed)
    if swinging is not None and swinging.stops:
        return f"records nothing: {snaps(study, swinging, speed, position_margins(loop, feedback).crossover)}"
    wave = functions_in(study, scenario).waves(speed)[1:]
    orders = np.flatnonzero(wave > ORDER_SHARE_LEAST * np.max(wave)) + 1
    if not len(orders):
        return None
    needed = wave[orders - 1]
    remaining = needed * share_left(loop, feedback, np.asarray(speed * orders, dtype=float))
    added = unsettled(loop, feedback, speed)
    share = math.hypot(*remaining, added) / math.hypot(*needed)
    if share <= WORTHWHILE_SHARE:
        return None
    most = int(orders[np.argmax(remaining)])
    run_does = f"turns too fast to record order {most} ({most * speed / math.tau:.3g} Hz) well"
    if added > np.max(remaining):
        run_does = (
            f"begins to record {1e3 * SETTLING_TURNS * math.tau / speed:.3g} ms after a reversal, when the "
            "rotor has not settled yet"
        )
    return f"{run_does}: with the table the ripple would be {share:.2g} times as large as without it"


class AntiCoggingRules(FeedbackRules[AntiCogging]):
    """The rules of the law `anti-cogging`."""

    def notes(self) -> Iterator[Remark]:
        remark = commissioning_warning(self.study, self.name)
        if remark is not None:
            yield remark

    def auto(self) -> Values:
        """The table is read ahead by the delay to the torque.

        The commissioning run is so slow that its position loop follows the highest order.
        """
        pi = gains(self.study, self.name)
        loop = replace(speed_loop(self.study).rigid, window=0, bandwidth=0.0, delay=0.0, low_pass=0.0)
        w = np.array([1e-3 * math.pi / loop.period])
        lead = max(0.0, -float(np.angle(1j * loop.plant(w)[0][0])) / float(w[0]))
        follows = position_gain(speed_loop(self.study).rigid, pi)
        highest = max([*known_orders(self.study, self.name), 1])
        speed = follows / highest
        turns = 1 + SETTLING_TURNS
        run = {"speed": speed, "revolutions": 1, "position_gain": follows}
        cells = min(map_cells(self.study, self.name), int(TURN * turns / speed / loop.period))
        return {"cells": cells, "lead": lead, "calibration": run}
