"""PI-ILC and robust ILC at one speed: u_k = Q u_{k-1} + Gamma e_k (docs/theory/learning.md derives it).

If the memory can't learn at a speed (control/src/cogless/memory.c), `frozen` gives the reason. The analysis
leaves out friction and the switching terms of robust ILC.
"""

from __future__ import annotations

import numpy as np

from cogless.design.fastest import fewest_samples
from cogless.design.learning_loop import SETTLED, LearningLoop
from cogless.study.controller import Learning
from cogless.study.spoken import speed_text

LONGEST_LEAD = 30  # samples that are tried


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

    def settling_leads(self) -> set[int]:
        """The leads, in samples, with which learning would settle."""
        f = self.frequencies
        q, longest = self.q(f), int(min(1 / self.periods_per_second / self.plant.period, self.law.cells) / 4)
        leads = range(1, min(longest, LONGEST_LEAD) + 1)
        return {n for n in leads if np.max(q * self.unfiltered(f, n)) <= SETTLED}
