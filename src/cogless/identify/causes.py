"""What makes the waves of the speed: cogging, K_t ripple, dead time, currents' errors, encoder, mechanics.

Every torque of an order n meets the same rotor and the same controller. So its share of the speed's wave is
its share of the disturbance D, in A:

    D = j (jnw) W + b W - I = cogging + i ripple(n) - j (nw)^2 encoder(n) ...

W is the complex wave of the measured speed, I that of i_q. An encoder's error counts as the torque that would
move the rotor as the error seems to.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cogless.identify.estimate import CURES
from cogless.identify.result import Estimate
from cogless.identify.steady import Steady
from cogless.identify.weak_form import shifted

COGGING, RIPPLE, DEAD_TIME = "cogging", "K_t ripple", "dead time"
OFFSET, GAIN, ENCODER = "current offset", "current gain", "encoder"
MECHANICS, UNEXPLAINED = "mechanics", "not explained"
OR = " or "
SLOW_ORDERS = 2  # up to it: unbalance and misalignment; magnets and slots have higher ones
TAPS = 4  # rows in which the current follows its reference
CLEAR, LIKELY = 0.8, 0.5  # of an order: the largest cause less its error
GUESSED = 0.4  # error of a cause by its order alone, so that it is never sure
UNSURE = 0.5  # of an order that may stay unexplained


@dataclass(frozen=True)
class Cause:
    """A cause of an order's wave: its share of it, -+ its error at 95 %."""

    name: str
    share: float
    error: float


@dataclass(frozen=True)
class Found:
    """An order of the speed in a log, and its causes, the largest first.

    `speed`: rad/s, without sign. `load`: mean i_q, A. `ripple`: rms, rad/s; `share`: of the whole ripple's
    square.
    """

    log: str
    speed: float  # rad/s, magnitude
    load: float  # A
    order: int
    ripple: float
    share: float
    causes: tuple[Cause, ...]

    @property
    def confidence(self) -> str:
        """How sure the first cause is."""
        if not self.causes or self.causes[0].name == UNEXPLAINED:
            return "open"
        if OR in self.causes[0].name:
            return "cannot be told apart"
        unexplained = sum(abs(cause.share) for cause in self.causes if cause.name == UNEXPLAINED)
        least = self.causes[0].share - self.causes[0].error
        if unexplained > UNSURE or least <= LIKELY:
            return "open"
        return "sure" if least > CLEAR else "likely"


Phasors = dict[str, tuple[complex, float]]  # by cause: the disturbance, A, and its error at 95 %


def attributed(made: Estimate, parts: Sequence[Steady]) -> list[Found]:
    """The waves of the speed in these parts, each with the shares of its causes."""
    responses = tracking(made, parts)
    return [_attributed(made, part, order, responses) for part in parts for order in part.orders()]


def _attributed(
    made: Estimate, part: Steady, order: int, responses: Mapping[int, tuple[complex, float]]
) -> Found:
    known = disturbances(made, part, order)
    measured, blurred = _measured(made, part, order)
    left: complex = measured - sum(phasor for phasor, _ in known.values())
    left *= max(0.0, 1 - blurred / (abs(left) or 1.0))
    told = bool(known)
    if id(part) in responses and order == 6 * made.known.motor.pole_pairs:
        _dead_time(made, part, order, responses[id(part)], known)
    offsets = made.offsets
    if order == made.known.motor.pole_pairs and offsets is not None:  # out of i_q already, as is dead time
        turned = [o * np.exp(-2j * np.pi / 3 * third) for third, o in enumerate(offsets)]
        known[OFFSET] = complex(-1j * 2 / 3 * sum(turned)), 0.0
    known[UNEXPLAINED] = left, 0.0
    whole = sum(phasor for phasor, _ in known.values())
    if not whole or (not told and abs(left) > LIKELY * abs(whole)):  # left out of the fit, or never found
        return found_in(part, order, guess(order, made.known.motor.pole_pairs))
    causes = [
        Cause(name, float((phasor / whole).real), float(np.hypot(error, blurred) / abs(whole)))
        for name, (phasor, error) in known.items()
    ]
    return found_in(part, order, causes)


def candidates(order: int, poles: int) -> str:
    """What may make a wave of this order."""
    if order <= SLOW_ORDERS:
        return ENCODER + OR + MECHANICS
    if order == poles:
        return COGGING + OR + OFFSET
    if order == 2 * poles:
        return COGGING + OR + GAIN
    if order % (6 * poles) == 0:
        return OR.join((COGGING, RIPPLE, DEAD_TIME))
    if order % poles == 0:
        return COGGING + OR + DEAD_TIME
    return COGGING


def guess(order: int, poles: int) -> list[Cause]:
    """The cause of an order by its number alone."""
    return [Cause(candidates(order, poles), 1.0, GUESSED)]


def found_in(part: Steady, order: int, causes: Sequence[Cause]) -> Found:
    """An order of a part's speed, and its causes."""
    size = float(abs(part.wave(part.omega, [order])[0])) / math.sqrt(2)
    ordered = tuple(sorted(causes, key=lambda cause: -cause.share))
    share = min(1.0, (size / part.ripple) ** 2)
    return Found(part.log.name, abs(part.speed), part.load, order, size, share, ordered)


def _measured(made: Estimate, part: Steady, order: int) -> tuple[complex, float]:
    """The disturbance of this order that speed and current show, A, and how far it may be off.

    It is off because a current that is held between the law's steps looks half a row early or late.
    """
    x = order * part.speed * part.log.dt  # a central difference sees sin(x)/x of a wave
    omega = complex(part.wave(np.gradient(part.theta, part.log.dt), [order])[0]) / np.sinc(x / math.pi)
    assert made.fit is not None
    j, b = made.fit.get("j"), made.fit.get("b")
    late = shifted(part.log["i_q"], made.model.delay / part.log.dt)
    current = complex(part.wave(late[part.rows], [order])[0])
    blurred = abs(current) * order * abs(part.speed) * part.log.dt / 2
    return (1j * order * part.speed * j + b) * omega - current, blurred


def disturbances(made: Estimate, part: Steady, order: int) -> Phasors:
    """Waves of torque that the fit has for this order, over K_t, by cause."""
    assert made.fit is not None
    found, poles = made.fit, made.known.motor.pole_pairs
    waves: Phasors = {}

    def add(cause: str, kind: str, factor: float) -> None:
        c, s = (found[kind, order, part] for part in "cs")
        error = 2 * float(np.hypot(found.error((kind, order, "c")), found.error((kind, order, "s"))))
        before = waves.get(cause, (0j, 0.0))
        waves[cause] = before[0] + factor * complex(c, -s), float(np.hypot(before[1], abs(factor) * error))

    if order in made.model.cogging:
        add(_cogging(made, order), "cogging", 1.0)
    if order in made.model.ripple:
        add(GAIN if order == 2 * poles else RIPPLE, "ripple", part.current)
    if order in made.model.encoder:
        j = found.get("j")
        c, s = made.model.error.get(order, (0.0, 0.0))
        factor = -((order * part.speed) ** 2)
        add(ENCODER, "encoder", factor)
        left, error = waves[ENCODER]
        waves[ENCODER] = left + factor * j * complex(c, -s), error
    return waves


def _cogging(made: Estimate, order: int) -> str:
    """What a torque of this order that depends on neither speed nor load may come from."""
    poles = made.known.motor.pole_pairs
    if order == poles and made.offsets is None:
        return COGGING + OR + OFFSET
    if CURES["ripple"].format(order) in made.left_out:
        return candidates(order, poles)
    return MECHANICS if order <= SLOW_ORDERS else COGGING


def tracking(made: Estimate, parts: Sequence[Steady]) -> dict[int, tuple[complex, float]]:
    """Waves of order 6 p by which i_q leaves its reference, A, with errors, by id of the part.

    The current follows its reference within a few rows, in the same way in all parts. What is left at 6 p is
    of the inverter and the magnets. Empty where no reference was recorded.
    """
    order = 6 * made.known.motor.pole_pairs
    parts = [part for part in parts if "i_q_ref" in part.log and part.visible(order)]
    if not parts:
        return {}
    blocks, targets = [], []
    for k, part in enumerate(parts):
        reference = part.log["i_q_ref"]
        rows = part.rows[TAPS:]
        own = np.zeros((len(rows), 3 * len(parts)))
        turned = order * part.log["theta"][rows]
        own[:, 3 * k : 3 * k + 3] = np.column_stack((np.cos(turned), np.sin(turned), np.ones(len(rows))))
        blocks.append(np.hstack([np.column_stack([reference[rows - m] for m in range(TAPS)]), own]))
        targets.append(part.log["i_q"][rows])
    columns, target = np.vstack(blocks), np.concatenate(targets)
    values, *_ = np.linalg.lstsq(columns, target, rcond=None)
    noise = float(np.std(target - columns @ values))
    spread = noise * np.sqrt(np.diag(np.linalg.pinv(columns.T @ columns)))
    found = {}
    for k, part in enumerate(parts):
        c, s = TAPS + 3 * k, TAPS + 3 * k + 1
        found[id(part)] = (complex(values[c], -values[s]), 2 * float(np.hypot(spread[c], spread[s])))
    return found


def _dead_time(made: Estimate, part: Steady, order: int, off: tuple[complex, float], known: Phasors) -> None:
    """Tell apart what disturbs the current: the inverter, and the back-EMF, which ripples as K_t does."""
    wave, error = off
    if abs(wave) < error:
        return
    emf = 0j
    if RIPPLE in known and part.load:
        star, drive = made.known.motor.star(), made.known.drive
        gains = drive.current_loop.gains(drive.belief.resolved(star))
        s = 1j * order * part.speed
        share = known[RIPPLE][0] / part.current
        voltage = star.pole_pairs * part.speed * star.psi_f * share
        emf = -voltage * s / (star.L_q * s**2 + (star.R_s + gains["kp_q"]) * s + gains["ki_q"])
        known[RIPPLE] = known[RIPPLE][0] + emf, known[RIPPLE][1]
    known[DEAD_TIME] = wave - emf, error
