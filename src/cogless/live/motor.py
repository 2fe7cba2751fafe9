"""One's own motor in a page: numbers that several of its keys set together, such as the controller's gains.

The design's rules scale with the motor: a gain of the speed loop is proportional to J / K_t, one of the
current loop to R_s or L. Beyond that the gains depend on R_s / L alone. So each number is its value in the
study, times a power of each key, times a factor for the pole pairs, times a curve over R_s / L. All of these
are found by changing the study as `--set` does, and tested at other values of all keys together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from cogless.errors import StudyError
from cogless.live.candidates import Candidate
from cogless.live.packed import Number, Packed

RESISTANCE, INDUCTANCE = "motor.resistance_line_to_line", "motor.inductance_line_to_line"
POLE_PAIRS = "motor.pole_pairs"
TOGETHER = frozenset(
    (POLE_PAIRS, RESISTANCE, INDUCTANCE, "motor.kv", "mechanics.inertia", "drive.inverter.bus_voltage")
)
NODES = 24  # of the curve, at Chebyshev's places over log(R_s / L)
SLOW, FAST = 1 / 30, 4.0  # ends of the curve: R_s / L as a share of the study's
CLOSE = {"f": 3e-7, "d": 1e-12}  # relative; other numbers are whole
INTEGER = 1e-5  # how near a power must be
TRIES = 12

Place = tuple[str, str, str]
All = Mapping[Place, Packed]
Changed = Callable[[Sequence[tuple[Candidate, float]]], All]


@dataclass(frozen=True)
class Product:
    """A number: `start` times each key's share of its value in the study to its power, and so on."""

    number: Number
    start: float
    powers: Mapping[str, int]
    factors: tuple[float, ...] = ()  # for 1, 2, ... pole pairs, of a whole number its values; none: 1
    curve: tuple[float, ...] = ()  # at `nodes()`; none: 1


def products(base: All, changed: Changed, keys: Sequence[Candidate]) -> dict[Place, list[Product]]:
    """The numbers that these keys, those of TOGETHER, set. StudyError: one of them is no such product."""
    by_key = {key.key: key for key in keys}
    over, under, pairs = by_key[RESISTANCE], by_key[INDUCTANCE], by_key[POLE_PAIRS]
    doubled = {key.key: changed([(key, 2 * key.start)]) for key in keys if key is not pairs}
    turned = [changed([(pairs, float(n))]) for n in range(1, round(pairs.high) + 1)]
    both = changed([(over, 2 * over.start), (under, 2 * under.start)])
    shares = [float(f"{math.exp(-at):.6g}") for at in nodes()]
    bent = [changed([(under, share * under.start)]) for share in shares]

    def of(number: Number, place: Place) -> Product | None:
        start = number.read(base[place].data)
        powers = {key: _log2(number.read(made[place].data), start) for key, made in doubled.items()}
        factors = tuple(number.read(made[place].data) for made in turned)
        if not any(powers.values()) and set(factors) == {start}:
            return None
        if number.format not in CLOSE and not any(powers.values()):
            return Product(number, 1.0, {}, factors)
        curve: tuple[float, ...] = ()
        if not all(_is_whole(powers[key]) for key in (RESISTANCE, INDUCTANCE)):
            powers |= {RESISTANCE: 0.0, INDUCTANCE: _log2(number.read(both[place].data), start)}
            power = round(powers[INDUCTANCE])
            seen = (number.read(made[place].data) / start for made in bent)
            curve = tuple(x / share**power for x, share in zip(seen, shares, strict=True))
        if not all(map(_is_whole, powers.values())):
            raise StudyError(f"live: {number.path}: expected a product of powers of the motor's keys")
        found = {key: round(power) for key, power in powers.items() if round(power)}
        return Product(
            number, start, found, () if set(factors) == {start} else tuple(x / start for x in factors), curve
        )

    made = {place: [of(number, place) for number in blob.numbers] for place, blob in base.items()}
    found = {place: [one for one in all_of if one is not None] for place, all_of in made.items()}
    _check(base, changed, by_key, found)
    return found


def nodes() -> list[float]:
    """Chebyshev's places over log(R_s / L), as a share of the study's."""
    low, high = math.log(SLOW), math.log(FAST)
    angles = ((2 * j + 1) * math.pi / (2 * NODES) for j in range(NODES))
    return [(low + high) / 2 + (high - low) / 2 * math.cos(angle) for angle in angles]


def computed(one: Product, by_key: Mapping[str, Candidate], values: Mapping[str, float]) -> float:
    """A product at these values, as a page computes it."""
    shares = {key: values.get(key, about.start) / about.start for key, about in by_key.items()}
    result = one.start
    for key, power in one.powers.items():
        result *= shares[key] ** power
    if one.factors:
        result *= one.factors[round(values.get(POLE_PAIRS, by_key[POLE_PAIRS].start)) - 1]
    if one.curve:
        result *= _between(one.curve, math.log(shares[RESISTANCE] / shares[INDUCTANCE]))
    return result


def _between(curve: Sequence[float], at: float) -> float:
    """The curve's value, by Lagrange's polynomial through the nodes in its barycentric form."""
    above = below = 0.0
    for j, (node, value) in enumerate(zip(nodes(), curve, strict=True)):
        if at == node:
            return value
        weight = (-1) ** j * math.sin((2 * j + 1) * math.pi / (2 * NODES)) / (at - node)
        above, below = above + weight * value, below + weight
    return above / below


def _log2(x: float, start: float) -> float:
    return math.log2(x / start) if x and start else 0.0 if x == start else math.nan


def _is_whole(x: float) -> bool:
    return abs(x - round(x)) < INTEGER if math.isfinite(x) else False


def _check(
    base: All, changed: Changed, by_key: Mapping[str, Candidate], found: Mapping[Place, list[Product]]
) -> None:
    """StudyError: a number is not what its product says, or one moves that has none."""
    shares = {key: _samples(n) for n, key in enumerate(by_key)}
    for n in range(TRIES):
        values = {key: float(f"{about.start * shares[key][n]:.6g}") for key, about in by_key.items()}
        values[POLE_PAIRS] = float(1 + 7 * n % round(by_key[POLE_PAIRS].high))
        values[INDUCTANCE] = by_key[INDUCTANCE].start * values[RESISTANCE] / by_key[RESISTANCE].start
        values[INDUCTANCE] *= float(f"{SLOW * (FAST / SLOW) ** ((n + 0.5) / TRIES):.4g}") ** -1
        made = changed([(by_key[key], x) for key, x in values.items()])
        for place, blob in made.items():
            wanted = {one.number: computed(one, by_key, values) for one in found[place]}
            for number in blob.numbers:
                x = number.read(blob.data)
                mine = wanted.get(number, number.read(base[place].data))
                mine = mine if number.format in CLOSE else round(mine)
                if abs(mine - x) > CLOSE.get(number.format, 0.0) * abs(x):
                    raise StudyError(f"live: {number.path}: {mine!r} as a product, {x!r} by the design")


def _samples(n: int) -> list[float]:
    """Shares from 1/100 to 100, irregular."""
    return [10 ** (4 * ((0.6180339887498949 * (k + 1) * (n + 1)) % 1.0) - 2) for k in range(TRIES)]
