"""The highest speed at which a law learns: above it the memory is frozen, and what is learned acts on."""

from __future__ import annotations

import math

from cogless.study import Study
from cogless.study.controller import Learning
from cogless.study.pi_afc import PiAfc
from cogless.study.space_controller import SpaceLearning


def fewest_samples(law: Learning | SpaceLearning, lead: int) -> int:
    """Fewest samples in a period with which a law learns.

    A sample, and the lead (samples), are at most a quarter of the period. A delay line's Q filter is within
    the period.
    """
    within_quarter = 4 * max(1, lead)
    return within_quarter if law.over_angle else max(within_quarter, law.q_half_width + 1)


def fastest(study: Study, name: str) -> float | None:
    """The highest mechanical speed at which a controller learns, rad/s; None if it doesn't learn.

    PI-AFC learns its lowest order up to there: two samples in a cycle.
    """
    law, rate = study.controller[name], study.drive.rates.outer_loop
    if isinstance(law, PiAfc):
        return math.pi * rate / law.orders[0]
    if not isinstance(law, Learning | SpaceLearning) or not law.learns:
        return None
    lead = round(law.lead * rate) if isinstance(law, Learning) else 0
    return 2 * math.pi * float(law.revolutions(study.motor.pole_pairs)) * rate / fewest_samples(law, lead)
