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
from cogless.design.cures import either, helping
from cogless.design.unlearned import revolutions_learned
from cogless.design.verdict import judgement
from cogless.study import Study
from cogless.study.controller import Learning
from cogless.study.error_messages import dotted
from cogless.study.reading import Changes
from cogless.study.remark import Remark
from cogless.study.space_controller import SpaceLearning

FEWEST, ENOUGH = 2.0, 10.0  # cells per wavelength of the highest order
ROUNDING = 1e-9
FILTERS = 3  # Q filter widths per wavelength of the highest order


def map_warning(study: Study, name: str) -> Remark | None:
    """Warning that a map has too few cells for the known orders; None if there are enough, or no map."""
    found = _wave(study, name)
    if found is None or found[0] >= found[1]:
        return None
    (each, enough, order), law = found, study.controller[name]
    assert isinstance(law, SpaceLearning | Learning)
    has = f"cells = {law.cells} is {each:.3g} in a wave of order {order} (mechanical)"
    width = 2 * law.q_half_width + 1
    lost = 100 * (1 - kept(each, law.q_half_width))
    if each < FEWEST:
        does = "which such a map can't hold"
    elif law.q_half_width == 0:
        does = f"of which straight lines between them lose {lost:.2g} %"
    else:
        losing = f"straight lines between them and the Q filter over {width}"
        does = f"of which {losing} lose {lost:.0f} % in each period"
    key = dotted(("controller", name))
    more: Changes = {f"{key}.cells": math.ceil(law.cells * enough / each * (1 - ROUNDING))}
    narrower: Changes = {f"{key}.q_half_width": max(0, int(each / FILTERS - 1) // 2)}
    now = _settles(study, name)

    def cured(other: Study) -> bool:
        after = _wave(other, name)
        return after is not None and after[0] >= after[1] and _settles(other, name) >= now

    cures = helping(study, (more, narrower), cured)
    return Remark(f"{has}, {does}: {either(cures, key)} would do" if cures else f"{has}, {does}", cures)


def _wave(study: Study, name: str) -> tuple[float, float, int] | None:
    """The map's cells per wave of the highest known order, the number that is enough, and that order.

    None: the law has no map over the angle, or no order is known.
    """
    law = study.controller[name]
    known = {n for key in study.scenarios_of(name) for n in functions_in(study, key).orders}
    revolutions = revolutions_learned(study, name)
    if not isinstance(law, SpaceLearning | Learning) or not law.over_angle:
        return None
    if revolutions is None or not known:
        return None
    order, enough = max(known), max(ENOUGH, FILTERS * (2 * law.q_half_width + 1))
    return law.cells / (order * float(revolutions)), enough, order


def _settles(study: Study, name: str) -> bool:
    """Whether a controller's learning settles, by its design."""
    found = judgement(study, name)
    return found is not None and found.kind == "settles"


def kept(cells: float, half_width: int) -> float:
    """The share of a wave that a map with a Q filter keeps in a period; the wave is `cells` cells long."""
    width = 2 * half_width + 1
    filtered = np.sinc(width / cells) / np.sinc(1 / cells)
    return float(abs(filtered) * np.sinc(1 / cells) ** 2)
