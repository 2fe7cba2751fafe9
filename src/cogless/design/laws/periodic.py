"""PI-ILC and robust ILC at one speed: u_k = Q u_{k-1} + Gamma e_k (docs/theory/learning.md derives it).

If the memory can't learn at a speed (control/src/cogless/memory.c), `frozen` gives the reason. The analysis
leaves out friction and the switching term of robust ILC. beta_1 sgn S, which it learns from besides beta_2 S,
is a doubt where an oscillation would live on it.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from cogless.design.learning_loop import FACTOR_MOST, LearningLoop, fewest_samples
from cogless.design.ripple import WORSE, ripple
from cogless.study.base import speed_text
from cogless.study.laws.law import Learning
from cogless.study.laws.periodic import RobustIlc

LONGEST_LEAD = 30  # samples that are tried
SMALLER = 6  # gains of beta_1 that are tried, each half of the one before


class PeriodicLoop(LearningLoop):
    """PI-ILC or robust ILC at a constant speed."""

    @property
    def law(self) -> Learning:
        law = self.study.controller[self.controller]
        if not isinstance(law, Learning):
            raise TypeError(f"controller {self.controller}: expected pi-ilc or robust-ilc")
        return law

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
        samples = 1 / self.plant.period / self.periods_per_second  # in a period
        cells, wide, fewest = self.law.cells, self.law.q_half_width, fewest_samples(self.law, self.lead)
        speed = speed_text(self.study, self.omega_m)
        found = f"a period at {speed} has {round(samples, 1):.10g} samples, "
        if self.law.memory == "time" and samples > cells:
            return f"{found}cells {cells}"
        if samples >= fewest:
            return None
        if samples < 4:
            return f"{found}at least 4 are needed"
        if self.lead > samples / 4:
            return f"{found}lead {self.lead} is over a quarter"
        return f"{found}the Q filter needs {wide + 1}"

    @property
    def learns_more(self) -> bool:
        return self.law.learns_by_switching

    @property
    def doubt(self) -> str | None:
        """Whether beta_1 sgn S keeps an oscillation alive that is worse than the feedback's ripple.

        To an oscillation of amplitude A, sgn S is a gain of 4 / (pi A), its describing function. So the
        smaller the oscillation, the more beta_1 learns from it. A is the one that makes the ripple `WORSE`,
        as a speed: S is little more than the speed error, but at frequencies around c and below.
        """
        law = self.law
        if not isinstance(law, RobustIlc) or not law.beta_1 or not self.settled:
            return None
        found = ripple(self, 0.0)
        amplitude = math.sqrt(2 * max((WORSE * found.without) ** 2 - found.learned**2, 0.0))
        if not amplitude:
            return None
        for n in reversed(range(SMALLER)):
            gain = 4 * law.beta_1 / (math.pi * amplitude * 2**n)
            tried = law.model_copy(update={"beta_2": law.beta_2 + gain})
            study = self.study.model_copy(update={"controller": {self.controller: tried}})
            loop = dataclasses.replace(self, study=study)
            if not loop.settled:
                swings = loop.oscillation()
                frequency = loop.worst().frequency if swings is None else swings.frequency
                least = speed_text(self.study, amplitude * 2**n / math.sqrt(2), digits=2)
                return f"beta_1 sgn S keeps {least} rms of ripple or more alive, at {frequency:.0f} Hz"
        return None

    def settling_leads(self) -> set[int]:
        """The leads, in samples, with which learning would settle."""
        f = self.frequencies
        q, longest = self.q(f), int(min(1 / self.periods_per_second / self.plant.period, self.law.cells) / 4)
        leads = range(1, min(longest, LONGEST_LEAD) + 1)
        return {n for n in leads if np.max(q * self.unfiltered(f, n)) <= FACTOR_MOST}
