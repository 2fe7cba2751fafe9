"""Static and dynamic feedforward around the nominal closed loop: (40), (41) of Mandra 2019 and Tomizuka 1987.

docs/theory/trial-design.md#feedforward derives both. G is the response from w to y with u = K_1 x + w,
without the integrator. Its polynomials A, B_a and B_u begin with one. B_u, of degree s, has the zeros that
can't be cancelled:

    G = b z^-r B_a(z^-1) B_u(z^-1) / A(z^-1)
    f(p) = A(z^-1) z^-s B_u(z) / (b B_a(z^-1) B_u(1)^2)  y_ref(p + r + s)

A zero is cancelled if it is stable and its ringing dies out fast enough: see `cancellable`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from cogless.design.trials.model import DesignError, Model, Real, markov, relative_degree

CREEPING_POLE_LEAST = 1 - 1e-6  # |z|; a positive real zero above this isn't cancelled
SWINGING_POLE_LEAST = 0.99  # |z|; a complex zero above this isn't cancelled
RINGING_POLE_LEAST = 0.9  # |z|; a zero with a negative real part above this isn't cancelled
AMPLIFICATION_MOST = 1e3  # largest amplification that is accepted from uncancelled zeros next to z = 1


@dataclass(frozen=True)
class Feedforward:
    """Feedforward f(p) = num(z^-1) / den(z^-1) y_ref(p + preview)."""

    num: Real
    den: Real  # den[0] = 1
    preview: int  # samples
    method: Literal["perfect tracking", "zero-phase error tracking", "inverse"]
    kept_zeros: tuple[complex, ...]  # zeros that are not cancelled


def loop(model: Model, K_1: Real) -> Model:
    """The model with state feedback K_1: A + B K_1 and B."""
    return Model(model.A + model.B @ K_1.reshape(1, -1), model.B)


def static_gain(model: Model, C: Real, K_1: Real) -> float:
    """N = 1 / DC gain of the nominal closed loop; DesignError if that gain is zero or not finite."""
    closed = loop(model, K_1)
    to_rest = np.eye(model.order) - closed.A
    if np.linalg.cond(to_rest) > 1e14:
        raise DesignError(
            "static_gain: expected a closed loop without a pole at z = 1 when the integrator is off; its "
            "gain at zero frequency isn't finite"
        )
    x = np.linalg.solve(to_rest, closed.B[:, 0])
    gain = float(C @ x)
    if abs(gain) <= 1e-9 * float(np.abs(C) @ np.abs(x)):
        raise DesignError(
            "static_gain: expected a plant with a gain at zero frequency; its zero at z = 1 leaves none"
        )
    return 1 / gain


def polynomials(model: Model, C: Real) -> tuple[Real, Real]:
    """Coefficients a and b of C (zI - A)^-1 B = b(z^-1) / a(z^-1), n + 1 each; the first r of b are zero."""
    a = np.real(np.poly(model.A))
    response = np.append(0.0, markov(model.A, model.B, C, model.order))
    b = np.convolve(a, response)[: model.order + 1]
    b[: relative_degree(model, C)] = 0.0
    return a, b


def zeros(model: Model, C: Real) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """Finite zeros in z of the transfer function from input to output."""
    b = polynomials(model, C)[1][relative_degree(model, C) :]
    # coefficients that are only rounding become zero, so that the zeros at z = 0, which are delays, are exact
    b = np.where(np.abs(b) > 1e-13 * np.abs(b).max(), b, 0.0)
    return np.asarray(np.roots(b), dtype=complex)


def cancellable(zero: complex) -> bool:
    """Whether a zero is stable and its ringing dies out fast enough, so that it may be cancelled."""
    if zero.real < 0:
        return abs(zero) <= RINGING_POLE_LEAST
    return abs(zero) <= (CREEPING_POLE_LEAST if abs(zero.imag) < 1e-9 else SWINGING_POLE_LEAST)


def dynamic(model: Model, C: Real, K_1: Real) -> Feedforward:
    """Feedforward of the nominal closed loop: perfect tracking, or zero-phase-error tracking.

    Zero-phase-error tracking is used if some zeros can't be cancelled.
    """
    closed = loop(model, K_1)
    r = relative_degree(closed, C)
    a, b = polynomials(closed, C)
    all_zeros = zeros(closed, C)
    uncancellable = [zero for zero in all_zeros if not cancellable(zero)]
    if not uncancellable:
        # directly from the polynomials: computing them from the roots would add rounding
        return Feedforward(_trim(a / b[r]), _trim(b[r:] / b[r]), r, "perfect tracking", ())
    cancelled = np.atleast_1d(np.real(np.poly([zero for zero in all_zeros if cancellable(zero)])))
    uncancelled = np.real(np.poly(uncancellable))
    at_rest = float(uncancelled.sum())
    if abs(at_rest) < 1e-9 * float(np.abs(uncancelled).sum()):
        raise DesignError("feedforward: expected a plant without a zero at z = 1")
    loudest = float(np.abs(uncancelled).sum()) ** 2 / at_rest**2
    if loudest > AMPLIFICATION_MOST:
        worst = min(uncancellable, key=lambda zero: abs(zero - 1))
        where = worst if worst.imag else worst.real
        raise DesignError(
            f"feedforward: expected false: the zero at z = {where:.4g} can't be cancelled, and an "
            f"uncancelled zero makes the feedforward amplify up to {loudest:.3g} times"
        ).advising({"feedforward": False})
    num = np.convolve(a, uncancelled[::-1]) / (b[r] * at_rest**2)
    zeros_left, preview = tuple(complex(zero) for zero in uncancellable), r + len(uncancellable)
    return Feedforward(_trim(num), _trim(cancelled), preview, "zero-phase error tracking", zeros_left)


def _trim(polynomial: Real) -> Real:
    """The polynomial without the coefficients at its end that are zero."""
    size = np.abs(polynomial).max()
    return np.asarray(polynomial[: 1 + int(np.flatnonzero(np.abs(polynomial) > 1e-14 * size)[-1])])
