"""What the speed alone says: orders, what may make them, how they change, and fixed frequencies."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

from cogless.identify.advice import Advice, logs_of_kind, recording
from cogless.identify.causes import FASTER, MECHANICS, Found, found_in, guess
from cogless.identify.steady import Steady
from cogless.units import TURN

STEEP = 0.5  # exponent of the speed, in magnitude, from which on it is a change
ALIKE = 0.03  # of a frequency
LARGE = 0.05  # of a ripple's square: smaller orders are in no sentence


def by_order(parts: Sequence[Steady], poles: int) -> list[Found]:
    """The orders of the speed in these parts, with what may make them."""
    return [found_in(part, order, guess(part, order, poles)) for part in parts for order in part.orders]


def sentences(found: Sequence[Found]) -> list[str]:
    """How orders change with speed, and frequencies that stay."""
    of: dict[int, dict[float, float]] = defaultdict(dict)
    for each in found:
        if each.share > LARGE:
            of[each.order][each.speed] = each.ripple
    said = []
    for order, sizes in sorted(of.items()):
        slow, fast = min(sizes), max(sizes)
        if fast < FASTER * slow:
            continue
        power = math.log(sizes[fast] / sizes[slow]) / math.log(fast / slow)
        at = f"Order {order} {{0}} from {slow / TURN:.3g} to {fast / TURN:.3g} rev/s"
        if power < -STEEP:
            said.append(at.format("falls") + ": a torque makes it, not the encoder.")
        elif power > STEEP:
            said.append(
                Advice(
                    at.format("grows")
                    + ": the encoder's error, or a torque that the controller holds down where it is slow; "
                    "record i_q.",
                    recording(signal="i_q"),
                )
            )
    return said + _fixed(found)


def _fixed(found: Sequence[Found]) -> list[str]:
    """A frequency at which different orders are large at different speeds: something swings, or orders meet.

    At two speeds any two orders may meet by chance; at a third they would not.
    """
    large = sorted((each for each in found if each.share > LARGE), key=lambda each: each.speed)
    best: list[Found] = []
    for first in large:
        meet = [first]
        for each in large:
            apart = each.speed > FASTER * meet[-1].speed and each.order != meet[-1].order
            if apart and abs(_hertz(each) / _hertz(first) - 1) < ALIKE:
                meet.append(each)
        best = max(best, meet, key=len)
    if len(best) < 2:
        return []
    at = [f"order {each.order} in {each.log}" for each in best]
    says = f"{_hertz(best[0]):.3g} Hz is {', '.join(at[:-1])} and {at[-1]}: "
    if len(best) == 2:
        return [
            Advice(
                f"{says}two orders that meet by chance, or something that swings at this frequency, which "
                "cannot "
                "be told apart at two speeds; record a third speed.",
                logs_of_kind("constant-speed"),
            )
        ]
    return [f"{says}{MECHANICS}, which swing at this frequency, or the supply."]


def _hertz(of: Found) -> float:
    """Frequency of an order at its speed."""
    return of.order * of.speed / TURN
