"""Design of the trial law with an observer: feedback from an observed error, learning of the missing input.

docs/theory/trial-design.md#learning-the-missing-input derives it. All gains follow from three numbers: the
pole p of observer and feedback, the response g, and the cut-off of the filter on the learned signal. The rule
finds them without a weight. It uses the exactly sampled plants, at the corners and at random parameters:

    p, g      the fastest p for which some g keeps the sensitivity |S| within SENSITIVITY_MOST at every plant,
              and with which the sensor's steps make at most QUIET_SHARE of the limit at the input, RMS
    cut-off   the highest with which a trial leaves at most REMAINING_SHARE_MOST of what was missing, at
              each frequency
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.design.trials.feedforward import Feedforward
from cogless.design.trials.model import DesignError, Model, Real
from cogless.design.trials.polytope import UncertainPlant
from cogless.design.trials.response import Bundle, Complex, Disturbed, Loop, butterworth, grid

OBSERVER_SHIFT = 2  # samples after which the law knows what was missing
SENSITIVITY_MOST = 3.0
REMAINING_SHARE_MOST = 2 / 3
QUIET_SHARE = (
    1 / 30
)  # of the limit of u: most RMS of the sensor's steps; three times this RMS is a tenth of the limit
NOISE_FREQUENCIES = 200  # frequencies at which the noise of the steps is computed
POLES = np.arange(0.95, 0.045, -0.01)
# responses that are tried at each pole, from half the weakest plant's to twice the strongest's
RESPONSE_COUNT = 25
NEAR_ONE = 0.2  # the plant counts as a double integrator if two poles are at most this far from z = 1
LAW_STATES = 8  # states of the law: predicted e, s, a; e of 1, 2, 3 samples ago; u_fb of 1, 2 samples ago


@dataclass(frozen=True)
class ObserverGains:
    """The law u = u_fb + f + v, whose feedback is that of cgl_trial_observer."""

    response: float  # g, y/u
    pole: float  # p

    def closed(self, model: Model, C: Real) -> Loop:
        """The closed loop from v to -r(p - 2), so that v + r changes v by the factor 1 - z^2 G."""
        A, B, _, missing = self._loop_rows(model, C)
        return Loop(A, B, -missing)

    def position(self, model: Model, C: Real) -> Loop:
        """The closed loop from v to y."""
        A, B, _, _ = self._loop_rows(model, C)
        return Loop(A, B, np.append(model.output(C), np.zeros(LAW_STATES)))

    def disturbed(self, model: Model, C: Real) -> Disturbed:
        """The closed loop from an error of the angle and the speed that the law gets; the speed is unused."""
        A, _, u_fb, missing = self._rows_with_error(model, C)
        acts = np.column_stack([A[:, -1], np.zeros(len(A))])
        position = np.append(model.output(C), np.zeros(LAW_STATES))
        at_once = np.array([u_fb[-1], 0.0])
        return Disturbed(
            A[:, :-1],
            acts,
            lesson=missing[:-1],
            lesson_at_once=float(missing[-1]),
            position=position,
            u=u_fb[:-1],
            u_at_once=at_once,
        )

    def delayed(self, model: Model, C: Real) -> float:
        """Spectral radius of the closed loop with one more sample of delay at the input."""
        n, size = model.order, model.order + LAW_STATES
        A, _, u_fb, _ = self._loop_rows(model, C)
        whole = np.zeros((size + 1, size + 1))
        whole[:size, :size], whole[size, :size] = A, u_fb
        whole[:n, :size] -= model.B @ u_fb[None, :]
        whole[:n, size:] = model.B
        return float(np.abs(np.linalg.eigvals(whole)).max())

    def radius(self, model: Model, C: Real) -> float:
        """Spectral radius of the closed loop."""
        return self.closed(model, C).radius

    def _loop_rows(self, model: Model, C: Real) -> tuple[Real, Real, Real, Real]:
        """The loop's A and B, and as rows over its states u_fb and r(p - 2)."""
        A, B, u_fb, missing = self._rows_with_error(model, C)
        return A[:, :-1], B, u_fb[:-1], missing[:-1]

    def _rows_with_error(self, model: Model, C: Real) -> tuple[Real, Real, Real, Real]:
        """The loop with a last column, for an error of the angle that the law gets."""
        n, g = model.order, self.response
        states = np.eye(n + LAW_STATES, n + LAW_STATES + 1)
        e = np.concatenate([-C @ model.view, np.zeros(LAW_STATES), [-1.0]])
        innovation = e - states[n]
        corrected = states[n : n + 3] + np.outer(_observer(self.pole), innovation)
        u_fb = np.append(_feedback(self.pole), 1.0) @ corrected / g
        before, acted = states[n + 3 : n + 6], states[n + 6 :]
        missing = acted[1] + (e - before[0] - before[1] + before[2]) / (2 * g)
        push = corrected[2] - g * u_fb
        predicted = [corrected[0] + corrected[1] + push / 2, corrected[1] + push, corrected[2]]
        plant = np.hstack([model.A, np.zeros((n, LAW_STATES + 1))]) + model.B @ u_fb[None, :]
        A = np.vstack([plant, *predicted, e, before[0], before[1], u_fb, acted[0]])
        return A, np.vstack([model.B, np.zeros((LAW_STATES, 1))]), u_fb, missing


def _observer(p: float) -> Real:
    """l_1, l_2, l_3: three poles of the observer at p."""
    return np.array([1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p), (1 - p) ** 3])


def _feedback(p: float) -> Real:
    """k_e, k_s: two poles of the feedback at p."""
    return np.array([(1 - p) ** 2, (1 - p) * (3 + p) / 2])


def observer_gains(p: float) -> tuple[Real, Real]:
    """l_1, l_2, l_3 of the observer, and k_e, k_s of the feedback, both with their poles at p."""
    return _observer(p), _feedback(p)


def _controller(p: float) -> tuple[Loop, float]:
    """The observer's feedback, times g, from e to u_fb; and its part without delay."""
    l_123, k = _observer(p), np.append(_feedback(p), 1.0)
    F, push = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]]), np.array([0.5, 1, 0])
    step, at_once = F - np.outer(push, k), float(k @ l_123)
    A = step @ (np.eye(3) - np.outer(l_123, [1, 0, 0]))
    return Loop(A, (step @ l_123)[:, None], k - at_once * np.array([1, 0, 0])), at_once


def design_observer(plant: UncertainPlant, pole: float | None, limit: float | None = None) -> ObserverGains:
    """p and g by the rule, or g alone for a given p. `limit`: of the input; None: the steps don't matter.

    DesignError: the plant doesn't suit, or no p does.
    """
    models = _exact(plant)
    strengths = np.array([_strength(model, plant.C) for model in models])
    if min(strengths) <= 0:
        raise DesignError("nominal: expected an input that raises y at every plant")
    w = grid()[1::3]  # |S| has no narrow peak within its bound
    G = Bundle([Loop(m.A, m.B, plant.C @ m.view) for m in models], 0)(w)
    tried = np.geomspace(min(strengths) / 2, 2 * max(strengths), RESPONSE_COUNT)
    poles = [float(p) for p in POLES] if pole is None else [pole]
    loops, at_once = zip(*(_controller(p) for p in poles), strict=True)
    feedback = Bundle(loops, 0)(w) + np.array(at_once)[:, None]

    def fastest(tries: Sequence[ObserverGains]) -> ObserverGains | None:
        stable = (g for g in reversed(tries) if max(g.radius(model, plant.C) for model in models) < 1)
        return next(stable, None)

    # From pole to pole a loop turns unstable only through an unbounded |S|. So of the poles that keep the
    # bound the fastest is examined first, and another one seldom.
    candidates: list[ObserverGains] = []
    for p, from_error in zip(poles, feedback, strict=True):
        g, sensitivity = _best_response(from_error * G, tried)
        if pole is not None or sensitivity <= SENSITIVITY_MOST:
            candidates.append(ObserverGains(g, p))
        elif fastest(candidates) is not None:
            break
        else:
            candidates = []
    best = fastest(candidates)
    if best is not None and pole is None and limit is not None and plant.sensor.step:
        quiet = [gains for gains in candidates if input_by_steps(plant, gains) <= QUIET_SHARE * limit]
        best = fastest(quiet) or fastest(candidates[:1]) or best
    if best is None:
        expected = "expected ranges within which the observer's feedback is stable everywhere"
        raise DesignError(f"range: {expected}" + ("" if pole is None else f" with pole = {pole:g}"))
    return best


def input_by_steps(plant: UncertainPlant, gains: ObserverGains) -> float:
    """RMS of the input that the sensor's steps make at the nominal plant; see quantisation.py."""
    assert plant.exact_nominal is not None
    w = (np.arange(NOISE_FREQUENCIES) + 0.5) * np.pi / NOISE_FREQUENCIES
    _, _, u = plant.sensor.powers(gains.disturbed(plant.exact_nominal, plant.C), w, plant.period)
    return plant.sensor.step * float(np.sqrt(np.mean(u) / 12))


def _best_response(L: Complex, tried: Real) -> tuple[float, float]:
    """The tried g with the smallest max |S| = g / |g + L| over plants and frequencies, and this maximum."""
    real, imag = np.ascontiguousarray(L.real), L.imag**2
    nearest = [float(np.min((real + g) ** 2 + imag)) for g in tried]
    worst = tried / np.sqrt(nearest)
    k = int(np.argmin(worst))
    return float(tried[k]), float(worst[k])


def highest_cutoff(plant: UncertainPlant, gains: ObserverGains, order: int) -> float:
    """The highest cut-off, Hz, with which a trial leaves at most REMAINING_SHARE_MOST at every frequency."""
    loops = [gains.closed(model, plant.C) for model in _exact(plant)]
    w = grid()
    keeps = np.abs(1 - Bundle(loops, OBSERVER_SHIFT)(w)).max(axis=0)
    low, high = 1e-3 / plant.period, 0.45 / plant.period
    for _ in range(40):
        middle = 0.5 * (low + high)
        shares = keeps * butterworth(middle, order, plant.period).gain(w)
        low, high = (middle, high) if np.max(shares) <= REMAINING_SHARE_MOST else (low, middle)
    return low


def inverse(plant: UncertainPlant) -> Feedforward:
    """The input that the nominal plant needs, from the reference's second difference and its damping.

    Centred in the sample over which the input acts, like r.
    """
    assert plant.exact_nominal is not None
    model = plant.exact_nominal.plant
    poles = np.linalg.eigvals(model.A)
    slow = poles[np.argsort(np.abs(poles - 1))[:2]]
    damping = -float(np.log(np.abs(np.prod(slow))))
    second, first = np.array([0.5, -0.5, -0.5, 0.5]), np.array([0.0, 1.0, -1.0, 0.0])
    num = (second + damping * first) / _strength(model, plant.C)
    return Feedforward(num, np.ones(1), OBSERVER_SHIFT, "inverse", ())


def _exact(plant: UncertainPlant) -> Sequence[Model]:
    """The exactly sampled plants; DesignError if they aren't double integrators."""
    random = plant.random[1]
    if plant.exact_vertices is None or plant.exact_nominal is None or random is None:
        raise DesignError("model: expected a continuous plant, which this law is designed for")
    models = [*plant.exact_vertices, *random, plant.exact_nominal]
    for model in models:
        distance = np.sort(np.abs(np.linalg.eigvals(model.plant.A) - 1))
        if model.plant.order < 2 or distance[1] > NEAR_ONE:
            raise DesignError(
                "nominal: expected a plant that integrates its input twice, such as a motor's angle"
            )
    return models


def _strength(model: Model, C: Real) -> float:
    """g: how much one unit of input, held for a sample, changes the change of y per sample."""
    A, b = model.plant.A, model.plant.B[:, 0]
    return float(C @ b + C @ A @ b) / 2
