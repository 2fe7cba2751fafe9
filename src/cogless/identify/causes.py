"""Causes of the waves of the speed: cogging, K_t ripple, dead time, currents' errors, encoder, mechanics.

Every torque of an order n acts on the same rotor and the same controller. So a torque's share of the speed's
wave is the torque's share of the disturbance D, in A:

    D = j (jnw) W + b W - I = cogging + i ripple(n) - j (nw)^2 encoder(n) ...

W is the complex wave of the speed by the measured angle, I is the wave of i_q. An encoder's error E counts as
the torque that would cause the motion which E shows. E is the same at every speed, so this torque grows with
the speed squared, and other torques do not. Two speeds tell E from a torque, one speed does not.

Where D is much smaller than I, no torque has caused I: the bridge's voltages or the reference did, and I
moves the rotor.

The rotor itself moves by V = W - jnw E. The controller answers the speed's wave with I = -C W. d are torques:

    (j jnw + b + C) V = d - C jnw E

So the motion has the part I jnw E by E, and the part d W by a torque d, up to a common factor. The wave
jnw E of E itself is measurement, not motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cogless.identify.cogging_orders import ORDER_CHANCE
from cogless.identify.estimate import CURES
from cogless.identify.result import Estimate
from cogless.identify.steady import Steady
from cogless.identify.waves import folded

COGGING, RIPPLE, DEAD_TIME = "cogging", "K_t ripple", "dead time"
OFFSET, GAIN, ENCODER = "current offset", "current gain", "encoder"
MECHANICS, UNEXPLAINED = "mechanics", "not explained"
APPLIED = "applied current"  # of the bridge's voltages, or of a reference that ripples
BEYOND = "too fast for the rows"  # an order too fast for the rows, which show it as another order
OR = " or "
SLOW_ORDERS = 2  # highest order of unbalance and misalignment; magnets and slots have higher orders
REFERENCE_ROWS = 4  # rows in which the current follows its reference
# an order's largest cause is sure, or likely, if the share minus the share's error is above these
SURE_SHARE, LIKELY_SHARE = 0.8, 0.5
GUESS_ERROR = 0.5  # error of a share that is known by the order's number alone; this makes the cause open
SPEED_RATIO_LEAST = 1.5  # least ratio of two speeds that tells a torque from an error of the angle
REMAINDER_RATIO = 4.0  # least ratio of the residuals of two explanations at which the better one counts
UNEXPLAINED_MOST = 0.5  # share of an order that may stay unexplained
# disturbance over the current's wave: below this share only the current moves the rotor
BALANCED_SHARE = 0.25


@dataclass(frozen=True)
class Cause:
    """A cause of an order's wave: the cause's share of the wave, and the share's error at 95 %."""

    name: str
    share: float
    error: float


@dataclass(frozen=True, kw_only=True)
class OrderCauses:
    """An order of the speed in a log, and its causes, the largest first.

    `speed`: rad/s, without sign. `load`: mean i_q, A. `ripple`: ripple of this order by the measured angle,
    rms, rad/s. `share`: share of this order in the square of the whole ripple. `measured`: share of the
    order's square that is the sensor's error, no motion.
    """

    log: str
    speed: float  # rad/s, magnitude
    load: float  # A
    order: int
    ripple: float
    share: float
    causes: tuple[Cause, ...]
    measured: float = 0.0

    @property
    def confidence(self) -> str:
        """How sure the first cause is."""
        if not self.causes or self.causes[0].name == UNEXPLAINED:
            return "open"
        if OR in self.causes[0].name:
            return "cannot be told apart"
        unexplained = sum(abs(cause.share) for cause in self.causes if cause.name == UNEXPLAINED)
        least = self.causes[0].share - self.causes[0].error
        if unexplained > UNEXPLAINED_MOST or least <= LIKELY_SHARE:
            return "open"
        return "sure" if least > SURE_SHARE else "likely"


Phasors = dict[str, tuple[complex, float]]  # by cause: the disturbance, A, and its error at 95 %


def attributed(estimate: Estimate, parts: Sequence[Steady]) -> list[OrderCauses]:
    """The waves of the speed in these parts, each with the shares of its causes."""
    responses = tracking(estimate, parts)
    pairs = [(part, order) for part in parts for order in part.orders]
    apart = _by_speeds(estimate, pairs)
    return [_attributed(estimate, part, order, responses, apart.get(order)) for part, order in pairs]


def _by_speeds(estimate: Estimate, pairs: Sequence[tuple[Steady, int]]) -> dict[int, Cause]:
    """Causes of the orders that are not in the fit, by the growth of their disturbance with the speed.

    The disturbance of a torque is the same at all speeds. That of an error of the angle grows with the speed
    squared.
    """
    by_order: dict[int, list[Steady]] = {}
    for part, order in pairs:
        several = candidates(order, estimate.identification.motor.pole_pairs) != COGGING + OR + ENCODER
        if not disturbances(estimate, part, order) and (order <= SLOW_ORDERS or not several):
            by_order.setdefault(order, []).append(part)
    causes = {}
    for order, parts in by_order.items():
        speeds = np.array([order * part.speed for part in parts])
        if np.max(np.abs(speeds)) < SPEED_RATIO_LEAST * np.min(np.abs(speeds)):
            continue
        waves, errors = np.transpose([_measured(estimate, part, order) for part in parts])
        weights = 1 / np.maximum(np.abs(errors), 0.05 * np.abs(waves)) ** 2
        rest = []
        for shape in (np.ones(len(speeds)), speeds**2):
            size = np.sum(weights * shape * waves) / np.sum(weights * shape**2)
            rest.append(float(np.sum(weights * np.abs(waves - size * shape) ** 2)))
        whole = float(np.sum(weights * np.abs(waves) ** 2))
        torque, angle = rest
        if max(rest) > REMAINDER_RATIO * min(rest) and min(rest) < whole / REMAINDER_RATIO:
            name = ENCODER if angle < torque else _cogging(estimate, order)
            causes[order] = Cause(name, 1.0, math.sqrt(min(rest) / whole))
    return causes


def _attributed(
    estimate: Estimate,
    part: Steady,
    order: int,
    responses: Mapping[int, tuple[complex, float]],
    by_speeds: Cause | None = None,
) -> OrderCauses:
    poles, phasors = estimate.identification.motor.pole_pairs, disturbances(estimate, part, order)
    measured, blurred = _measured(estimate, part, order)
    current_wave = part.current_wave(order, estimate.model.delay / part.log.dt)
    size = max(abs(current_wave), 1e-9)  # A
    balance = (abs(measured) + blurred) / size
    remainder: complex = measured - sum(phasor for phasor, _ in phasors.values())
    remainder *= max(0.0, 1 - blurred / (abs(remainder) or 1.0))
    in_fit = bool(phasors)
    if id(part) in responses and order == 6 * poles:
        _dead_time(estimate, part, order, responses[id(part)], phasors)
    offsets = estimate.offsets
    if order == poles and offsets is not None:  # The offsets are out of i_q already, as is dead time.
        turned = [o * np.exp(-2j * np.pi / 3 * third) for third, o in enumerate(offsets)]
        phasors[OFFSET] = complex(-1j * 2 / 3 * sum(turned)), 0.0
    inside = sum(abs(phasors[name][0]) for name in (OFFSET, DEAD_TIME) if name in phasors)
    if not in_fit and max(balance, inside / size) < BALANCED_SHARE:
        return order_causes(part, order, [Cause(APPLIED, 1.0, balance)])
    phasors[UNEXPLAINED] = remainder, 0.0
    misread = part.misread(order)
    if misread and ENCODER in phasors:  # The shares are those of the rotor's own motion.
        measured_wave = part.motion(order) + misread
        phasors = {
            name: (phasor * measured_wave, error * abs(measured_wave))
            for name, (phasor, error) in phasors.items()
        }
        relative = phasors[ENCODER][1] / (abs(phasors[ENCODER][0]) or 1.0)
        phasors[ENCODER] = current_wave * misread, relative * abs(current_wave * misread)
        remainder, blurred = remainder * measured_wave, blurred * abs(measured_wave)
    whole = sum(phasor for phasor, _ in phasors.values())
    if not whole or (not in_fit and abs(remainder) > LIKELY_SHARE * abs(whole)):  # the fit does not have it
        return order_causes(part, order, [by_speeds] if by_speeds else guess(part, order, poles))
    causes = [
        Cause(name, float((phasor / whole).real), float(np.hypot(error, blurred) / abs(whole)))
        for name, (phasor, error) in phasors.items()
    ]
    return order_causes(part, order, causes)


def candidates(order: int, poles: int) -> str:
    """The causes that may make a wave of this order, joined by OR."""
    if order <= SLOW_ORDERS:
        return ENCODER + OR + MECHANICS
    if order == poles:
        return OR.join((COGGING, OFFSET, ENCODER))
    if order == 2 * poles:
        return OR.join((COGGING, GAIN, ENCODER))
    if order % (6 * poles) == 0:
        return OR.join((COGGING, RIPPLE, DEAD_TIME, ENCODER))
    if order % poles == 0:
        return OR.join((COGGING, DEAD_TIME, ENCODER))
    return COGGING + OR + ENCODER


def guess(part: Steady, order: int, poles: int) -> list[Cause]:
    """Possible causes of an order by its number. A faster order that the rows show as this one is BEYOND."""
    if order > part.waves.half_rate:
        return [Cause(BEYOND, 1.0, GUESS_ERROR)]
    names = candidates(order, poles)
    if any(
        abs(folded(own, part.rows_a_turn) - order) * part.turns < 1
        for own in part.own_orders
        if own > part.waves.half_rate
    ):
        names += OR + BEYOND
    return [Cause(names, 1.0, GUESS_ERROR)]


def order_causes(part: Steady, order: int, causes: Sequence[Cause]) -> OrderCauses:
    """An order of a part's speed, and its causes."""
    motion, misread = abs(part.motion(order)) ** 2 / 2, abs(part.misread(order)) ** 2 / 2
    whole = motion + misread
    measured = misread / whole
    if measured:
        moved = 1 - measured
        causes = [Cause(cause.name, moved * cause.share, moved * cause.error) for cause in causes]
        own = next((cause for cause in causes if cause.name == ENCODER), Cause(ENCODER, 0.0, 0.0))
        causes = [cause for cause in causes if cause is not own]
        causes.append(Cause(ENCODER, own.share + measured, own.error))
    ordered = tuple(sorted(causes, key=lambda cause: -cause.share))
    share = whole / part.ripple**2
    return OrderCauses(
        log=part.log.name,
        speed=abs(part.speed),
        load=part.load,
        order=order,
        ripple=math.sqrt(whole),
        share=share,
        causes=ordered,
        measured=measured,
    )


def _measured(estimate: Estimate, part: Steady, order: int) -> tuple[complex, float]:
    """The disturbance of this order by angle and current, A, and the disturbance's possible error, A.

    The angle's noise makes an error. A current that is held between the law's steps appears up to half a row
    early or late, which makes an error, too.
    """
    omega = part.motion(order) + part.misread(order)
    assert estimate.fit is not None
    j, b = estimate.fit.get("j"), estimate.fit.get("b")
    current = part.current_wave(order, estimate.model.delay / part.log.dt)
    blurred = abs(current) * order * abs(part.speed) * part.log.dt / 2
    by_speed = 1j * order * part.speed * j + b
    noise = abs(by_speed * order * part.speed) * part.waves.error.get(order, 0.0)
    return by_speed * omega - current, math.hypot(blurred, noise)


def disturbances(estimate: Estimate, part: Steady, order: int) -> Phasors:
    """The torque waves of this order in the fit, divided by K_t, by cause."""
    assert estimate.fit is not None
    fit, poles = estimate.fit, estimate.identification.motor.pole_pairs
    waves: Phasors = {}

    def add(cause: str, kind: str, factor: float) -> None:
        c, s = (fit[kind, order, part] for part in "cs")
        error = 2 * float(np.hypot(fit.error((kind, order, "c")), fit.error((kind, order, "s"))))
        before = waves.get(cause, (0j, 0.0))
        waves[cause] = before[0] + factor * complex(c, -s), float(np.hypot(before[1], abs(factor) * error))

    stands_out = order != poles or fit.chance("cogging", order) < ORDER_CHANCE  # Every fit has the order p.
    if order in estimate.model.cogging and stands_out:
        add(_cogging(estimate, order), "cogging", 1.0)
    if order in estimate.model.ripple:
        add(GAIN if order == 2 * poles else RIPPLE, "ripple", part.current)
    if order in estimate.model.encoder:
        j = fit.get("j")
        c, s = estimate.model.error.get(order, (0.0, 0.0))
        factor = -((order * part.speed) ** 2)
        add(ENCODER, "encoder", factor)
        phasor, error = waves[ENCODER]
        waves[ENCODER] = phasor + factor * j * complex(c, -s), error
    return waves


def _cogging(estimate: Estimate, order: int) -> str:
    """The possible causes of a torque of this order that depends on neither speed nor load."""
    poles = estimate.identification.motor.pole_pairs
    if order == poles and estimate.offsets is None:
        return COGGING + OR + OFFSET
    if CURES["ripple"].format(order) in estimate.left_out:  # The angle's error has its own column in the fit.
        return candidates(order, poles).removesuffix(OR + ENCODER)
    return MECHANICS if order <= SLOW_ORDERS else COGGING


def tracking(estimate: Estimate, parts: Sequence[Steady]) -> dict[int, tuple[complex, float]]:
    """Waves of order 6 p in the difference of i_q from its reference, A, with errors, by id of the part.

    The current follows its reference within a few rows, in the same way in all parts. The inverter and the
    magnets make the difference that is left at 6 p. Empty where no reference was recorded.
    """
    order = 6 * estimate.identification.motor.pole_pairs
    parts = [part for part in parts if "i_q_ref" in part.log and part.visible(order)]
    if not parts:
        return {}
    blocks, targets = [], []
    for k, part in enumerate(parts):
        reference = part.log["i_q_ref"]
        rows = part.rows[REFERENCE_ROWS:]
        own = np.zeros((len(rows), 3 * len(parts)))
        turned = order * part.log["theta"][rows]
        own[:, 3 * k : 3 * k + 3] = np.column_stack((np.cos(turned), np.sin(turned), np.ones(len(rows))))
        blocks.append(np.hstack([np.column_stack([reference[rows - m] for m in range(REFERENCE_ROWS)]), own]))
        targets.append(part.log["i_q"][rows])
    columns, target = np.vstack(blocks), np.concatenate(targets)
    values, *_ = np.linalg.lstsq(columns, target, rcond=None)
    noise = float(np.std(target - columns @ values))
    spread = noise * np.sqrt(np.diag(np.linalg.pinv(columns.T @ columns)))
    tracking_waves = {}
    for k, part in enumerate(parts):
        c, s = REFERENCE_ROWS + 3 * k, REFERENCE_ROWS + 3 * k + 1
        tracking_waves[id(part)] = (complex(values[c], -values[s]), 2 * float(np.hypot(spread[c], spread[s])))
    return tracking_waves


def _dead_time(
    estimate: Estimate, part: Steady, order: int, off: tuple[complex, float], phasors: Phasors
) -> None:
    """Split the current's disturbance `off` into dead time and back-EMF ripple; both go into `phasors`.

    The back-EMF ripples as K_t does.
    """
    wave, error = off
    if abs(wave) < error:
        return
    emf = 0j
    if RIPPLE in phasors and part.load:
        star, drive = estimate.identification.motor.star(), estimate.identification.drive
        gains = drive.current_loop.gains(drive.belief.resolved(star))
        s = 1j * order * part.speed
        share = phasors[RIPPLE][0] / part.current
        voltage = star.pole_pairs * part.speed * star.psi_f * share
        emf = -voltage * s / (star.L_q * s**2 + (star.R_s + gains["kp_q"]) * s + gains["ki_q"])
        phasors[RIPPLE] = phasors[RIPPLE][0] + emf, phasors[RIPPLE][1]
    phasors[DEAD_TIME] = wave - emf, error
