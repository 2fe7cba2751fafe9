"""Whether a map over the angle has enough cells for the known orders of motor and load.

A map interpolates linearly between two cells. This has the gain sinc^2(1 / c) for a wave of c cells per
wavelength. With fewer than 2 cells per wavelength the wave is aliased to a slower one. The Q filter is a
moving mean. In each period it keeps 0.83 of a wave that is three times as long as the filter is wide, and
almost nothing of a wave that is as long as the filter.
"""

from __future__ import annotations

import math

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.unlearned import revolutions_learned
from cogless.study import Study
from cogless.study.controller import MOST_CELLS, Learning
from cogless.study.space_controller import SpaceLearning

FEWEST, ENOUGH = 2.0, 10.0  # cells per wavelength of the highest order
FILTERS = 3  # Q filter widths per wavelength of the highest order


def map_warning(study: Study, name: str) -> str | None:
    """Warning that a map has too few cells for the known orders; None if there are enough, or no map."""
    law = study.controller[name]
    orders = {n for key in study.scenarios_of(name) for n in functions_in(study, key).orders}
    revolutions = revolutions_learned(study, name)
    if not isinstance(law, SpaceLearning | Learning) or not law.over_angle:
        return None
    if revolutions is None or not orders:
        return None
    order, width = max(orders), 2 * law.q_half_width + 1
    each, enough = law.cells / (order * float(revolutions)), max(ENOUGH, FILTERS * width)
    if each >= enough:
        return None
    needed = f"cells = {min(MOST_CELLS, math.ceil(enough * order * float(revolutions)))} would do"
    has = f"cells = {law.cells} is {each:.3g} in a wave of order {order} (mechanical)"
    if each < FEWEST:
        return f"{has}, which such a map can't hold: {needed}"
    lost = 100 * (1 - kept(each, law.q_half_width))
    if law.q_half_width == 0:
        return f"{has}, of which straight lines between them lose {lost:.2g} %: {needed}"
    losing = f"straight lines between them and the Q filter over {width} lose {lost:.0f} % in each period"
    return f"{has}, of which {losing}: {needed}, or a smaller q_half_width"


def kept(cells: float, half_width: int) -> float:
    """The share of a wave that a map with a Q filter keeps in a period; the wave is `cells` cells long."""
    width = 2 * half_width + 1
    filtered = np.sinc(width / cells) / np.sinc(1 / cells)
    return float(abs(filtered) * np.sinc(1 / cells) ** 2)
