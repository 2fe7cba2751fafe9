"""One's own motor in a page: numbers that several of its keys set together, such as the controller's gains.

The design's rules scale with the motor: a gain of the speed loop is proportional to J / K_t, one of the
current loop to R_s or L. Beyond that the gains depend on R_s / L alone. So each number is its value in the
study, times a power of each key, times a factor for the pole pairs, times a curve over R_s / L. All of these
are found by changing the study as `--set` does, and tested at other values of all keys together.

A change that the study refuses only narrows a range that the page accepts: the pole pairs, R_s / L, or the
key that was changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from cogless.c_layout import MisfitError
from cogless.errors import StudyError
from cogless.live.candidates import Candidate
from cogless.live.description import Number, PackedRuns, Place

RESISTANCE_KEY, INDUCTANCE_KEY = "motor.resistance_line_to_line", "motor.inductance_line_to_line"
POLE_PAIRS = "motor.pole_pairs"
OWN_MOTOR_KEYS = frozenset(
    (
        POLE_PAIRS,
        RESISTANCE_KEY,
        INDUCTANCE_KEY,
        "motor.kv",
        "mechanics.inertia",
        "drive.inverter.bus_voltage",
    )
)
CURVE_NODES = 24  # Chebyshev nodes of the curve over log(R_s / L)
SLOWEST_RATIO, FASTEST_RATIO = 1 / 30, 4.0  # widest ends of the curve: R_s / L as a share of the study's
RETREAT_POWER = 0.8  # a refused share of R_s / L to this power is the next end to try
NO_ROOM = 1e-3  # an end that differs less from 1 becomes 1
CLOSE = {"f": 3e-7, "d": 1e-12}  # relative tolerance by format; other formats are whole
POWER_TOLERANCE = 1e-5  # a power that differs less from a whole number counts as whole
CHECKED_MOTORS = 12  # sets of values of all keys at which the products are tested
# tries of _check: after each refusal it halves the logarithms of all shares, so that 100 ends as 1.04
SHARE_HALVINGS = 8
STEPS = (2.0, 0.5, 1.25, 0.8, 1.02, 0.98)  # factors on a key's value; the first accepted is used

Changed = Callable[[Sequence[tuple[Candidate, float]]], PackedRuns]
Narrow = Callable[[Candidate], Candidate]


@dataclass(frozen=True)
class Product:
    """A number as a product: `start`, each key's value over the study's to the power of `powers`, the factor
    for the pole pairs, and the value of the curve."""

    number: Number
    start: float
    powers: Mapping[str, int]
    factors: tuple[float, ...] = ()  # from the least pole pairs on; for whole numbers, the values; empty: 1
    curve: tuple[float, ...] = ()  # values at `nodes`; empty: 1


@dataclass(frozen=True)
class OwnMotor:
    """The data that a page needs for one's own motor.

    `products`: each number as a product of powers of the keys. `keys`: those of OWN_MOTOR_KEYS, with the
    range that the page accepts. `ends`: the range of R_s / L, as a share of the study's. `turned`: the
    study's descriptions for each number of pole pairs that the page accepts.
    """

    products: Mapping[Place, Sequence[Product]]
    keys: Mapping[str, Candidate]
    ends: tuple[float, float]
    turned: Mapping[int, PackedRuns]

    @property
    def pole_pairs(self) -> Candidate:
        return self.keys[POLE_PAIRS]

    @property
    def numbers(self) -> set[tuple[Place, int]]:
        """All numbers that these keys set, by place and offset."""
        return {(place, one.number.offset) for place, all_of in self.products.items() for one in all_of}

    def together(self, n: int, reach: float) -> dict[str, float]:
        """Irregular values of all keys: the study's times (1/100 to 100) to the power `reach`."""
        slow, fast = self.ends
        values = {}
        for k, (key, candidate) in enumerate(self.keys.items()):
            share = 10 ** (reach * (4 * ((0.6180339887498949 * (n + 1) * (k + 1)) % 1.0) - 2))
            values[key] = min(max(float(f"{candidate.start * share:.6g}"), candidate.least), candidate.most)
        pairs = self.pole_pairs
        drawn = pairs.least + 7 * n % round(pairs.most - pairs.least + 1)
        values[POLE_PAIRS] = float(round(pairs.start + reach * (drawn - pairs.start)))
        ratio = (slow * (fast / slow) ** ((n + 0.5) / CHECKED_MOTORS)) ** reach
        over, under = self.keys[RESISTANCE_KEY], self.keys[INDUCTANCE_KEY]
        values[INDUCTANCE_KEY] = float(f"{under.start * values[RESISTANCE_KEY] / over.start / ratio:.6g}")
        return values


def own_motor(base: PackedRuns, changed: Changed, keys: Sequence[Candidate], narrow: Narrow) -> OwnMotor:
    """The numbers that the keys of OWN_MOTOR_KEYS set, as products of powers.

    `changed` gives the descriptions with some values, or raises StudyError or MisfitError if the study
    refuses them. `narrow` gives a key with the range that the study accepts. StudyError: a number is no such
    product.
    """
    by_key = {key.key: key for key in keys}
    over, under = by_key[RESISTANCE_KEY], by_key[INDUCTANCE_KEY]
    by_key[POLE_PAIRS], turned = _turned(base, changed, by_key[POLE_PAIRS])
    ends, bent = _bent(changed, under)
    scaled = {key: _scaled(base, changed, by_key[key]) for key in by_key if key != POLE_PAIRS}
    for key, (share, _) in scaled.items():
        if share != STEPS[0] and key not in (RESISTANCE_KEY, INDUCTANCE_KEY):
            by_key[key] = narrow(by_key[key])
    scaled_pair = _scaled(base, changed, over, under)

    def product_of(number: Number, place: Place) -> Product | None:
        def power(share: float, blobs_now: PackedRuns) -> float:
            return _power(number.read(blobs_now[place].data), start, share)

        start = number.read(base[place].data)
        powers = {key: power(*one) for key, one in scaled.items()}
        factors = tuple(number.read(turned[n][place].data) for n in sorted(turned))
        if not any(powers.values()) and set(factors) == {start}:
            return None
        if number.format not in CLOSE and not any(powers.values()):
            return Product(number, 1.0, {}, factors)
        curve: tuple[float, ...] = ()
        if not all(_is_whole(powers[key]) for key in (RESISTANCE_KEY, INDUCTANCE_KEY)):
            powers |= {RESISTANCE_KEY: 0.0, INDUCTANCE_KEY: power(*scaled_pair)}
            exponent = round(powers[INDUCTANCE_KEY])
            curve = tuple(
                number.read(blobs_now[place].data) / start / share**exponent for share, blobs_now in bent
            )
        if not all(map(_is_whole, powers.values())):
            raise _no_product(number, "")
        whole = {key: round(power) for key, power in powers.items() if round(power)}
        return Product(
            number, start, whole, () if set(factors) == {start} else tuple(x / start for x in factors), curve
        )

    every = {place: [product_of(number, place) for number in blob.numbers] for place, blob in base.items()}
    products = {place: [one for one in all_of if one is not None] for place, all_of in every.items()}
    own = OwnMotor(products, by_key, ends, turned)
    _check(base, changed, own)
    return own


def nodes(ends: tuple[float, float]) -> list[float]:
    """Chebyshev nodes over log(R_s / L), R_s / L as a share of the study's, from the upper end down."""
    low, high = map(math.log, ends)
    angles = ((2 * j + 1) * math.pi / (2 * CURVE_NODES) for j in range(CURVE_NODES))
    return [(low + high) / 2 + (high - low) / 2 * math.cos(angle) for angle in angles]


def _accepted(changed: Changed, values: Sequence[tuple[Candidate, float]]) -> PackedRuns | None:
    """The descriptions with these values; None if the study refuses them."""
    try:
        return changed(values)
    except (StudyError, MisfitError):
        return None


def _turned(base: PackedRuns, changed: Changed, pairs: Candidate) -> tuple[Candidate, dict[int, PackedRuns]]:
    """The key with the pole pairs that the study accepts without a gap, and by number the descriptions."""
    start, turned = round(pairs.start), {round(pairs.start): base}
    for numbers in (range(start - 1, round(pairs.low) - 1, -1), range(start + 1, round(pairs.high) + 1)):
        for n in numbers:
            changed_blobs = _accepted(changed, [(pairs, float(n))])
            if changed_blobs is None:
                break
            turned[n] = changed_blobs
    low, high = float(min(turned)), float(max(turned))
    return replace(pairs, low=low, high=high, least=low, most=high), turned


def _bent(changed: Changed, under: Candidate) -> tuple[tuple[float, float], list[tuple[float, PackedRuns]]]:
    """The ends of R_s / L within which the study accepts every node, and two values for each node.

    These are the node's share of the study's L, and the descriptions with it.
    """
    ends = [SLOWEST_RATIO, FASTEST_RATIO]
    while True:
        bent = []
        for at in nodes((ends[0], ends[1])):
            share = math.exp(-at)
            changed_blobs = _accepted(changed, [(under, share * under.start)])
            if changed_blobs is None:
                end = math.exp(RETREAT_POWER * at)
                ends[at > 0] = end if abs(end - 1) > NO_ROOM else 1.0
                break
            bent.append((share, changed_blobs))
        else:
            return (ends[0], ends[1]), bent


def _scaled(base: PackedRuns, changed: Changed, *keys: Candidate) -> tuple[float, PackedRuns]:
    """The first of STEPS that the study accepts for all these keys, and the descriptions; or 1 and `base`."""
    for share in STEPS:
        changed_blobs = _accepted(changed, [(key, share * key.start) for key in keys])
        if changed_blobs is not None:
            return share, changed_blobs
    return 1.0, base


def computed(one: Product, own: OwnMotor, values: Mapping[str, float]) -> float:
    """A product at these values, as a page computes it."""
    shares = {key: values.get(key, candidate.start) / candidate.start for key, candidate in own.keys.items()}
    pairs = own.pole_pairs
    result = one.start
    for key, power in one.powers.items():
        result *= shares[key] ** power
    if one.factors:
        result *= one.factors[round(values.get(POLE_PAIRS, pairs.start) - pairs.least)]
    if one.curve:
        result *= _between(
            nodes(own.ends), one.curve, math.log(shares[RESISTANCE_KEY] / shares[INDUCTANCE_KEY])
        )
    return result


def _between(nodes: Sequence[float], curve: Sequence[float], at: float) -> float:
    """The curve's value, by Lagrange's polynomial through the nodes in its barycentric form."""
    above = below = 0.0
    for j, (node, value) in enumerate(zip(nodes, curve, strict=True)):
        if at == node:
            return value
        weight = (-1) ** j * math.sin((2 * j + 1) * math.pi / (2 * CURVE_NODES)) / (at - node)
        above, below = above + weight * value, below + weight
    return above / below


def _power(x: float, start: float, share: float) -> float:
    """The p in x = start * share**p, where `share` is the factor on the key.

    0: x did not change, or the study refused all STEPS, so `share` is 1. NaN: x has another sign.
    """
    if x == start or share == 1:
        return 0.0
    return math.log(x / start) / math.log(share) if x and start and x / start > 0 else math.nan


def _is_whole(x: float) -> bool:
    return abs(x - round(x)) < POWER_TOLERANCE if math.isfinite(x) else False


def _check(base: PackedRuns, changed: Changed, own: OwnMotor) -> None:
    """Test the products. StudyError: a number differs from its product, or moves and has no product."""
    for n in range(CHECKED_MOTORS):
        for halvings in range(SHARE_HALVINGS):
            values = own.together(n, 0.5**halvings)
            changed_blobs = _accepted(changed, [(own.keys[key], x) for key, x in values.items()])
            if changed_blobs is not None:
                _compare(base, changed_blobs, own, values)
                break


def _compare(base: PackedRuns, changed_blobs: PackedRuns, own: OwnMotor, values: Mapping[str, float]) -> None:
    for place, blob in changed_blobs.items():
        products = {one.number: computed(one, own, values) for one in own.products[place]}
        for number in blob.numbers:
            x = number.read(blob.data)
            mine = products.get(number, number.read(base[place].data))
            mine = mine if number.format in CLOSE else round(mine)
            if abs(mine - x) > CLOSE.get(number.format, 0.0) * abs(x):
                raise _no_product(number, f" ({mine!r} as a product, {x!r} by the design)")


def _no_product(number: Number, difference: str) -> StudyError:
    return StudyError(
        f"--own-motor: {number.path}: the page cannot compute this number from the motor's values, since it "
        f"is no product of their powers{difference}: expected cogless live without --own-motor"
    )
