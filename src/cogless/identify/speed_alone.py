"""Diagnose logs by the speed alone: orders, possible causes, change with speed, fixed frequencies."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

from cogless.identify.advice import Advice, logs_of_kind, recording
from cogless.identify.causes import MECHANICS, SPEED_RATIO_LEAST, OrderCauses, guess, order_causes
from cogless.identify.steady import Steady
from cogless.units import TURN

SPEED_EXPONENT = 0.5  # least magnitude of the exponent of the speed at which a ripple falls or grows
FREQUENCY_DIFFERENCE = 0.03  # relative: frequencies that differ by less are one
LARGE_SHARE = 0.05  # share of a ripple's square: smaller orders are in no sentence


def by_order(parts: Sequence[Steady], poles: int) -> list[OrderCauses]:
    """The orders of the speed in these parts, with their possible causes."""
    return [order_causes(part, order, guess(part, order, poles)) for part in parts for order in part.orders]


def sentences(orders: Sequence[OrderCauses]) -> list[str]:
    """Sentences on orders that fall or grow with speed, and on frequencies that stay the same."""
    sizes_by_order: dict[int, dict[float, float]] = defaultdict(dict)
    for entry in orders:
        if entry.share > LARGE_SHARE:
            sizes_by_order[entry.order][entry.speed] = entry.ripple
    remarks = []
    for order, sizes in sorted(sizes_by_order.items()):
        slow, fast = min(sizes), max(sizes)
        if fast < SPEED_RATIO_LEAST * slow:
            continue
        power = math.log(sizes[fast] / sizes[slow]) / math.log(fast / slow)
        at = f"The ripple of order {order} {{0}} between {slow / TURN:.3g} and {fast / TURN:.3g} rev/s"
        if power < -SPEED_EXPONENT:
            remarks.append(at.format("falls") + ": a torque causes it, not the encoder.")
        elif power > SPEED_EXPONENT:
            remarks.append(
                Advice(
                    at.format("grows")
                    + ": the encoder's error causes it, or a torque, whose ripple the controller reduces "
                    "more at low speed; record i_q.",
                    recording(signal="i_q"),
                )
            )
    return remarks + _fixed(orders)


def _fixed(orders: Sequence[OrderCauses]) -> list[str]:
    """A sentence on a frequency at which different orders are large at different speeds.

    Something swings at this frequency, or the orders have it by chance. At two speeds any two orders may have
    the same frequency by chance; at a third speed they would not.
    """
    large = sorted((entry for entry in orders if entry.share > LARGE_SHARE), key=lambda entry: entry.speed)
    best: list[OrderCauses] = []
    for first in large:
        meet = [first]
        for entry in large:
            apart = entry.speed > SPEED_RATIO_LEAST * meet[-1].speed and entry.order != meet[-1].order
            if apart and abs(_hertz(entry) / _hertz(first) - 1) < FREQUENCY_DIFFERENCE:
                meet.append(entry)
        best = max(best, meet, key=len)
    if len(best) < 2:
        return []
    at = [f"order {entry.order} in {entry.log}" for entry in best]
    says = f"{_hertz(best[0]):.3g} Hz is the frequency of {', '.join(at[:-1])} and of {at[-1]}: "
    if len(best) == 2:
        return [
            Advice(
                f"{says}this is chance, or something swings at this frequency, which two speeds do not tell; "
                "record a third speed.",
                logs_of_kind("constant-speed"),
            )
        ]
    return [f"{says}{MECHANICS}, which swing at this frequency, or the supply."]


def _hertz(entry: OrderCauses) -> float:
    """Frequency of an order at its speed, Hz."""
    return entry.order * entry.speed / TURN
