"""Words of datasheets for a motor's magnet, resistance and inductance, and their conversion.

A word's name says what its number is of: of a winding, from line to line or from line to star point (phase),
rms or peak. If a motor has several words for one thing they must agree: the factors between them (2, sqrt 2,
sqrt 3) are those by which datasheets are misread.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from cogless.study.table import invalid

AGREE = 0.05  # relative difference at which two words for one thing still agree; datasheets round
NEAR = 0.03  # relative distance from a factor that still is this factor

# K_t, torque per peak line current, as a factor of each back-EMF constant; phases are sinusoidal. The speed
# constants are the reciprocals.
PER_BACK_EMF = {
    "line_to_line_peak": math.sqrt(3) / 2,
    "line_to_line_rms": math.sqrt(1.5),
    "phase_peak": 1.5,
    "phase_rms": 1.5 * math.sqrt(2),
}
BACK_EMF = {f"K_e_{kind}": factor for kind, factor in PER_BACK_EMF.items()}
SPEED = {"kv": PER_BACK_EMF["line_to_line_peak"]} | {
    f"kv_{kind}": factor for kind, factor in PER_BACK_EMF.items() if kind != "line_to_line_peak"
}
OF_TWO_LINES = ("kv", "K_e_line_to_line_peak")
OF_A_PHASE = [word for word in (*BACK_EMF, *SPEED) if "phase" in word]
MAGNET = ("psi_f", "K_t", "K_t_rms", *SPEED, *BACK_EMF)  # the first that is given counts
RESISTANCE = ("R_s", "resistance_line_to_line")
INDUCTANCE = ("L_d", "L_q", "inductance_line_to_line")

# of datasheets, for what has another key
OTHER_WORDS = {"torque_constant": "K_t", "J": "mechanics.inertia", "inertia": "mechanics.inertia"}

RMS, LINES = "rms and peak", "phase and line to line"
MIXED_UP = (
    (math.sqrt(2), "sqrt(2)", RMS),
    (math.sqrt(3), "sqrt(3)", LINES),
    (math.sqrt(1.5), "sqrt(3/2)", "peak of a phase and rms from line to line"),
    (math.sqrt(6), "sqrt(6)", "rms of a phase and peak from line to line"),
    (2 / math.sqrt(3), "2/sqrt(3)", "K_t and 1/kv, which is 2/sqrt(3) K_t"),
    (1.5, "3/2", "one phase and all three"),
    (3.0, "3", "star and delta"),
    (2.0, "2", f"{LINES}, or poles and pole pairs"),
)


def replaced_by(key: str) -> frozenset[str]:
    """Other keys of [motor] that say the same as this one; a change to it replaces them."""
    for words in (MAGNET, RESISTANCE):
        if key in words:
            return frozenset(words) - {key}
    if key == "inductance_line_to_line":
        return frozenset(INDUCTANCE) - {key}
    return frozenset(INDUCTANCE[2:]) if key in INDUCTANCE else frozenset()


def replaced_by_any(keys: Iterable[str]) -> frozenset[str]:
    """All keys of [motor] that one of these replaces."""
    return frozenset[str]().union(*map(replaced_by, keys))


def torque_constant(word: str, value: float, pole_pairs: int, flux_factor: float) -> float:
    """K_t of the star equivalent, N*m per peak A, from one of the words for the magnet.

    `flux_factor`: flux linkage of the star equivalent over that of a winding.
    """
    if word == "psi_f":
        return 1.5 * pole_pairs * flux_factor * value
    if word == "K_t_rms":
        return value / math.sqrt(2)
    if word in SPEED:
        return SPEED[word] / value
    return BACK_EMF[word] * value if word in BACK_EMF else value


def check_agreement(found: Mapping[str, float]) -> None:
    """Refuse words for one thing that disagree. `found`: what each of them makes of the same quantity."""
    first, *others = found
    for other in others:
        if not math.isclose(found[other], found[first], rel_tol=AGREE):
            why = _block_commutated(found, first, other) or _why(found[other], found[first])
            raise invalid(f"expected {first} and {other} to agree within {AGREE:.0%}{why}", other)


def _block_commutated(found: Mapping[str, float], first: str, other: str) -> str:
    """The words that say which key to delete where K_t is that of block commutation; "" elsewhere.

    Block commutation has current in two phases at a time. Its torque per current is the back-EMF between two
    lines over the speed, 1 / kv. Three sinusoidal currents of the same peak give sqrt(3)/2 of that torque,
    which is K_t here (`PER_BACK_EMF`). So the back-EMF stays, and the datasheet's K_t goes.
    """
    if first != "K_t" or other not in OF_TWO_LINES:
        return ""
    if abs(found["K_t"] / found[other] * PER_BACK_EMF["line_to_line_peak"] - 1) > NEAR:
        return ""
    return (
        "; K_t = 1/kv is of block commutation, with sinusoidal currents it is sqrt(3)/2 of that: delete K_t"
    )


def _why(one: float, other: float) -> str:
    times = max(one, other) / min(one, other) if one and other else math.inf
    return mixed_up(times, NEAR) or f", not to differ by a factor of {times:.3g}"


def mixed_up(times: float, near: float) -> str:
    """What is mixed up where two numbers for one thing differ by about this factor; "" if that is unknown."""
    factor, name, mixed = min(MIXED_UP, key=lambda known: abs(times / known[0] - 1))
    if abs(times / factor - 1) > near:
        return ""
    return f"; they differ by {name}, the factor between {mixed}"
