"""PI-ILC and robust ILC at one speed: u_k = Q u_{k-1} + Gamma e_k (docs/theory/learning.md derives it).

If the memory can't learn at a speed (control/src/cogless/memory.c), `frozen` gives the reason. The analysis
leaves out friction and the switching term of robust ILC. That law learns from beta_1 sgn S besides beta_2 S.
`doubt` gives a reason where beta_1 sgn S would keep an oscillation alive.

The ripple that the relay in robust ILC makes by itself: docs/laws/robust-ilc.md#the-relay.

The law's term g sgn(S) / b is a relay of amplitude M = g / b beside its linear feedback C. From the relay's
current to -S the loop has the response

    W = H P / (1 + C P),    H = 1 + c T z / (z - 1),    z = exp(jwT)

with the plant P of speed_loop.py. The relay switches to and fro where W turns its current by half a turn. A
current that is M for n samples and -M for n samples, with w n T = pi, has the fundamental 2 M / (n sin(pi /
(2 n))).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, TypeVar, cast

import numpy as np

from cogless.design.auto import (
    frequency_grid,
    gain_and_filter,
    loops_in_corners,
    map_cells,
    numbers_by_hand,
    phase_margin_gains,
    settling_reach,
    shared_period,
    with_numbers,
)
from cogless.design.changes import unit_text
from cogless.design.closed_loop import Linear, oscillation
from cogless.design.law_rules import FeedbackRules, Gain, LawRules, Values, feedback_of
from cogless.design.learning_loop import (
    FACTOR_MOST,
    LearningLoop,
    fastest_over_period,
    fewest_samples,
)
from cogless.design.margins import FREQUENCY_POINTS
from cogless.design.ripple import HARMFUL_RATIO, ripple
from cogless.design.speed_loop import pi_response, speed_loop
from cogless.design.verdict import judged
from cogless.study import Study
from cogless.study.base import speed_text
from cogless.study.laws.law import Learning, Memory
from cogless.study.laws.periodic import PiIlc, RobustIlc
from cogless.study.messages import dotted
from cogless.study.reading import Changes, Remark
from cogless.units import TIME, TURN

LONGEST_LEAD = 30  # samples that are tried
TRIED_GAINS = 6  # gains of beta_1 that are tried, each half of the one before


class PeriodicLoop(LearningLoop):
    """PI-ILC or robust ILC at a constant speed."""

    FORGETS: ClassVar[bool] = True

    @property
    def law(self) -> Learning:
        return cast("Learning", self.study.controller[self.controller])

    @property
    def forgetting(self) -> float:
        return self.law.forgetting

    @property
    def lead(self) -> int:
        return round(self.law.lead / self.plant.period)

    @property
    def gamma(self) -> tuple[float, float]:
        return self.law.learning_gain

    @property
    def frozen(self) -> str | None:
        samples = 1 / self.plant.period / self.periods_per_second  # samples/period
        cells, wide, fewest = self.law.cells, self.law.q_half_width, fewest_samples(self.law, self.lead)
        speed = speed_text(self.study, self.omega_m)
        sentence = f"a period at {speed} has {round(samples, 1):.10g} samples, "
        if self.law.memory == "time" and samples > cells:
            return f"{sentence}more than cells = {cells}"
        if samples >= fewest:
            return None
        if samples < 4:
            return f"{sentence}but the law needs at least 4"
        if self.lead > samples / 4:
            return f"{sentence}but the lead has {self.lead}: it may have at most a quarter of a period"
        return f"{sentence}but the Q filter needs {wide + 1}"

    @property
    def learns_more(self) -> bool:
        return self.law.learns_by_switching

    @property
    def doubt(self) -> str | None:
        """The doubt that beta_1 sgn S keeps alive an oscillation which is worse than the feedback's ripple.

        To an oscillation of amplitude A, sgn S is a gain of 4 / (pi A), its describing function. So the
        smaller the oscillation, the more beta_1 learns from it. A, as a speed, makes the ripple
        `HARMFUL_RATIO` times the feedback's: S is about the speed error, except at frequencies up to about c.
        """
        law = self.law
        if not isinstance(law, RobustIlc) or not law.beta_1 or not self.settled:
            return None
        ripples = ripple(self, 0.0)
        amplitude = math.sqrt(2 * max((HARMFUL_RATIO * ripples.without) ** 2 - ripples.learned**2, 0.0))
        if not amplitude:
            return None
        for n in reversed(range(TRIED_GAINS)):
            gain = 4 * law.beta_1 / (math.pi * amplitude * 2**n)
            tried = law.model_copy(update={"beta_2": law.beta_2 + gain})
            study = self.study.model_copy(update={"controller": {self.controller: tried}})
            loop = dataclasses.replace(self, study=study)
            if not loop.settled:
                swings = loop.oscillation()
                frequency = loop.worst().frequency if swings is None else swings.frequency
                least = speed_text(self.study, amplitude * 2**n / math.sqrt(2), digits=2)
                return (
                    f"the law's switching term, of gain beta_1, may keep alive an oscillation at "
                    f"{frequency:.0f} Hz with a ripple of {least} rms or more"
                )
        return None

    def settling_leads(self) -> set[int]:
        """The leads, in samples, with which learning would settle."""
        f = self.frequencies
        q, longest = self.q(f), int(min(1 / self.periods_per_second / self.plant.period, self.law.cells) / 4)
        leads = range(1, min(longest, LONGEST_LEAD) + 1)
        return {n for n in leads if np.max(q * self.unfiltered(f, n)) <= FACTOR_MOST}


@dataclass(frozen=True)
class Switching:
    """The oscillation that a relay keeps up in a loop without noise, ripple or load."""

    frequency: float  # Hz
    ripple: float  # rad/s, of the true speed, rms


def switching(study: Study, scenario: str, name: str) -> Switching | None:
    """How a controller's relay oscillates in a scenario: of several ways the one with the largest ripple.

    None if it has no relay, if the feedback is unstable, or if nothing makes the relay turn back.
    """
    law = study.controller[name]
    if not isinstance(law, RobustIlc) or not law.g:
        return None
    loop, feedback = speed_loop(study, scenario), feedback_of(study, name)
    if feedback is None or oscillation(loop, feedback):
        return None
    w = np.geomspace(1e-4, 1, FREQUENCY_POINTS) * math.pi / loop.period
    P, _ = loop.plant(w)
    closed = 1 / (1 + feedback.response(w, loop.period) * P)
    W = pi_response(w, loop.period, 1.0, law.c) * P * closed
    turned = np.append((W.imag[:-1] < 0) != (W.imag[1:] < 0), True)  # the last: W is real there anyway
    turned = np.flatnonzero(turned & (W.real < 0))
    if not len(turned):
        return None
    true, _ = replace(loop, window=0, bandwidth=0.0, edge=0.0, low_pass=0.0).plant(w)
    n = math.pi / (w * loop.period)
    fundamental = np.sqrt(2) / (n * np.sin(np.pi / (2 * n)))
    fundamental[-1] = 1.0  # rms of a current that changes its sign with each sample
    ripples = law.g / law.b * fundamental * np.abs(true * closed)
    most = turned[np.argmax(ripples[turned])]
    return Switching(float(w[most]) / TURN, float(ripples[most]))


def relay_warning(study: Study, name: str) -> Remark | None:
    """Warning of a relay that makes more ripple than the linear feedback leaves; None if it makes less."""
    for key in study.scenarios_of(name):
        oscillation = switching(study, key, name)
        if oscillation is None:
            continue
        feedback_ripple = max(
            (ripple(loop, 0.0).without for loop in judged(study, key, name)), default=math.inf
        )
        if oscillation.ripple > feedback_ripple:
            alone, learned = (
                f"{speed_text(study, omega, 2)} rms" for omega in (oscillation.ripple, feedback_ripple)
            )
            switches = (
                f"in scenario {key} its relay g switches at {oscillation.frequency:.3g} Hz and causes "
                f"{alone} of speed ripple"
            )
            off: Changes = {f"{dotted(('controller', name))}.g": "0 rad/s^2"}
            return Remark(f"{switches}; with g = 0 the feedback alone leaves {learned}", (off,))
    return None


P = TypeVar("P", bound=Learning)


class LearningRules(LawRules[P], Generic[P]):
    """The rules of a law that learns over a period with a lead and a Q filter."""

    @property
    def memory(self) -> Memory:
        return self.law

    @property
    def loop(self) -> type[PeriodicLoop]:
        return PeriodicLoop

    def fill(self, study_here: Study) -> Values:
        most = self.study.drive.largest_torque_current(self.study.motor.star())
        own = {} if self.law.limit is not None else {"limit": most}
        return {**super().fill(study_here), **own}

    def numbers_used(self) -> dict[str, Gain]:
        """The lead as the law uses it: rounded to whole samples of the speed loop."""
        lead, rate = self.law.lead, self.study.drive.rates.outer_loop
        samples = round(lead * rate)
        used = samples / rate
        if math.isclose(used, lead, rel_tol=1e-9):
            return {"lead": Gain(lead, TIME.unit)}
        return {"lead": Gain(used, TIME.unit, f"{samples} samples; {lead:.4g} s asked for")}

    def fastest(self) -> float:
        lead = round(self.law.lead * self.study.drive.rates.outer_loop)
        return fastest_over_period(self.study, self.law, lead)


class PiIlcRules(FeedbackRules[PiIlc], LearningRules[PiIlc]):
    """The rules of the law `pi-ilc`."""

    def auto(self) -> Values:
        return _map_and_gain(self.study, self.name, lambda gain: {"gain": gain})


class RobustIlcRules(LearningRules[RobustIlc]):
    """The rules of the law `robust-ilc`."""

    def feedback(self, omega_m: float) -> Linear:
        law = self.law
        return Linear(ratio=1, k=law.linear[0], k_i=law.linear[1], k_r=law.gamma / law.b, c=law.c)

    def slower(self, factor: float) -> Changes:
        key = dotted(("controller", self.name))
        return {f"{key}.{rate}": unit_text(getattr(self.law, rate) / factor, "1/s") for rate in ("c", "eta")}

    def auto(self) -> Values:
        return _robust_ilc(self.study, self.name)

    def notes(self) -> Iterator[Remark]:
        remark = relay_warning(self.study, self.name)
        if remark is not None:
            yield remark


def _robust_ilc(study: Study, name: str) -> Values:
    """The linear part is as near to the PI as two real roots come; switching is twice the sensors' noise."""
    b = study.K_t / study.mechanics.stiff.inertia
    pi = phase_margin_gains(study, name)
    half, product = b * pi[0] / 2, b * pi[1]
    apart = math.sqrt(
        max(half**2 - product, 0.0)
    )  # two real roots, or a double one: ki as near as these come
    values = {"b": b, "c": half - apart, "eta": half + apart, "q": 1.0, "beta_1": 0.0, "gamma": 0.0}
    values["g"] = 2 * b * study.drive.current_sensors.noise
    values |= numbers_by_hand(study, name)
    with_it = with_numbers(study, name, values)
    return values | _map_and_gain(with_it, name, lambda gain: {"beta_2": gain * values["b"]})


def _map_and_gain(study: Study, name: str, keys: Callable[[float], Values]) -> Values:
    """Map, lead, gain and Q filter. `keys`: the keys of a learning gain in A*s/rad."""
    by_hand = numbers_by_hand(study, name)
    period = by_hand.get("period", shared_period(study, name))
    T, map_ = speed_loop(study).period, {"cells": map_cells(study, name, period), "period": period}
    unit = list(loops_in_corners(PeriodicLoop, with_numbers(study, name, map_ | keys(1.0)), name))
    slowest_period = min(1 / loop.periods_per_second for loop in unit) / T  # samples
    longest = max(1, min(LONGEST_LEAD, int(slowest_period / 4), map_["cells"] // 4))
    f = frequency_grid(unit)
    gain = 1 / max(float(np.max(np.abs(loop.x(f, 0)))) for loop in unit)
    lead = max(
        range(1, longest + 1), key=lambda n: min(settling_reach(gain * loop.x(f, n), f) for loop in unit)
    )

    def tried(gain: float) -> Values:
        return {**map_, **keys(gain), "lead": lead * T}

    return gain_and_filter(study, name, PeriodicLoop, gain, tried)
