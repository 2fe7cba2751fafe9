"""Certificate of a trial controller: what is certain along the trial, and from trial to trial.

Plants: the polytope's vertices, random plants in the uncertainty and random mixtures of the vertices for the
design's model; the corners and the same random plants, sampled exactly, for the drive. With an Euler model
the two differ where it matters most, near half the sampling rate: a certificate says of which of them it
speaks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cogless.design.finite import growth
from cogless.design.learning_gain import Vertex
from cogless.design.model import Discretisation, Model, Real
from cogless.design.polytope import UncertainPlant
from cogless.design.response import (
    MONOTONE,
    Bundle,
    Complex,
    Filter,
    Filtered,
    Loop,
    factor,
    gain_limits,
    peak,
)

Structure = Literal["input-and-integrator", "input"]
ENDS = 1e-4  # growth a trial that is as good as none: it is an estimate, from tried trials
AT_ONE = 1e-6  # of Phi's largest pole: a double one at z = 1 is this inexact


@dataclass(frozen=True)
class Gains:
    """u(p) = K_1 x(p) + K_2 psi(p-1) + f(p) + N v(p); v also into psi where through_integrator."""

    K_1: Real
    K_2: float
    N: float
    through_integrator: bool
    integral: bool

    def closed(self, model: Model, C: Real) -> Loop:
        """The loop from v to y: (14), (15)."""
        n = model.order
        A, B = model.A + model.B @ self.K_1[None, :], model.B * self.N
        if not self.integral:
            return Loop(A, B, C)
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n:], whole[n, :n], whole[n, n] = A, model.B * self.K_2, -C, 1.0
        return Loop(whole, np.vstack([B, [[float(self.through_integrator)]]]), np.append(C, 0.0))

    def delayed(self, model: Model, C: Real) -> float:
        """Spectral radius with one more sample of delay at the input."""
        n = model.order
        size = n + self.integral
        A = np.zeros((size + 1, size + 1))
        A[:n, :n], A[:n, size:] = model.A, model.B
        A[size, :n] = self.K_1
        if self.integral:
            A[n, :n], A[n, n], A[size, n] = -C, 1.0, self.K_2
        return float(np.abs(np.linalg.eigvals(A)).max())


@dataclass(frozen=True)
class Learning:
    """|F| of (20) over frequency, the largest of all plants; see response.py. Frequencies in Hz.

    Without a filter, and where the shift is the model's own relative degree, no trial's error is larger than
    the last one's times `norm`. Otherwise no frequency's is, but for the trial's ends, which `growth` tries:
    exactly sampled plants have relative degree 1, and a shift that is often 2.
    """

    norm: float  # the largest |F|
    frequency: float  # where
    worst: str  # the plant that has it
    nominal: float  # the same for the nominal plant alone
    monotone: bool  # no frequency's error grows from trial to trial, nor from the ends, nor is Phi unstable
    contracting: bool  # and every frequency's shrinks by a factor below one
    K_3_limit: float | None  # the gain up to which no frequency's grows, with the sign of K_3; None: no K_3
    curve: tuple[Real, Real]  # frequency and |F|


@dataclass(frozen=True)
class ModelCertificate:
    """Certificate over one kind of models: "design" or "exact"."""

    radius: float  # spectral radius of A_cl over all plants: along the trial
    worst: str  # the plant that has it
    stable: bool
    delayed_radius: float  # with one more sample of delay at the input
    delayed_stable: bool
    phi_radius: float | None  # of Phi (27) over the vertices; None where K_3 doesn't act or the shift isn't r
    without_filter: Learning | None  # None where nothing learns, or where it is unstable along the trial
    with_filter: Learning | None  # None without a filter, too
    growth: float | None  # factor a trial in the end, with the filter if any and the trial's ends: finite.py

    @property
    def learning(self) -> Learning | None:
        """Learning as it is done: with the filter, if there is one."""
        return self.with_filter or self.without_filter


@dataclass(frozen=True)
class Certificate:
    """Certificate of a trial controller; `exact` is None where the continuous plant isn't known."""

    design: ModelCertificate
    exact: ModelCertificate | None
    discretisation: Discretisation | None  # of the design's models
    samples: int  # random plants


@dataclass(frozen=True)
class Update:
    """Effect of the error on learning: K_3 z^shift, or norm-optimal learning on the nominal loop."""

    shift: int
    K_3: float
    ratio: float | None = None  # norm-optimal: of the weights of v's change and of the error, instead of K_3
    nominal: Loop | None = None  # norm-optimal: the loop that L is made for

    def on(self, G: Complex, w: Real) -> Complex:
        """G, or what takes its place where K isn't a number."""
        if self.ratio is None or self.nominal is None:
            return G
        known = Bundle([self.nominal], self.shift)(w)[0]
        return np.asarray(np.conj(known) / (np.abs(known) ** 2 + self.ratio) * G)

    @property
    def gain(self) -> float:
        """K of F = 1 - K G."""
        return self.K_3 if self.ratio is None else 1.0


def certify(
    plant: UncertainPlant,
    gains: Gains,
    update: Update | None,
    q_filter: Filter | None,
    filtered: Filtered,
    samples: int,
) -> Certificate:
    """The certificate of a plant with these gains; update None: no learning."""
    random, random_exact = plant.random

    def of(
        corners: Sequence[Model], labels: Sequence[str], drawn: list[Model], nominal: Model
    ) -> ModelCertificate:
        loops = [gains.closed(m, plant.C) for m in [*corners, *drawn, nominal]]
        radii = np.array([loop.radius for loop in loops])
        k = int(np.argmax(radii))
        delayed = max(gains.delayed(m, plant.C) for m in corners)
        stable = bool(radii[k] < 1)
        phi = None
        if update is not None and update.ratio is None and update.shift == plant.relative_degree:
            phis = [Vertex.of(loop, update.shift).phi(update.K_3) for loop in loops[: len(corners)]]
            phi = max(float(np.abs(np.linalg.eigvals(p)).max()) for p in phis)
        names = [*labels, *["a random plant"] * len(drawn), "the nominal plant"]
        plain = filters = ends = None
        if stable and update is not None:
            sweep = _Sweep(loops, names, update, plant.period)
            if update.ratio is None:
                few = [*loops[: len(corners)], loops[-1]]
                ends = float(growth(few, update.K_3, update.shift, q_filter, filtered, samples).max())
            plain = sweep.learning(None, filtered, (ends or 0.0) if q_filter is None else 0.0, phi or 0.0)
            if q_filter is not None:
                filters = sweep.learning(q_filter, filtered, ends or 0.0)
        return ModelCertificate(
            float(radii[k]), names[k], stable, delayed, delayed < 1, phi, plain, filters, ends
        )

    design = of(plant.vertices, plant.labels, random, plant.nominal)
    exact = None
    if plant.exact_vertices is not None and plant.exact_nominal is not None and random_exact is not None:
        corners = plant.exact_vertices
        names = plant.labels if plant.exact_hull else [f"corner {k + 1}" for k in range(len(corners))]
        exact = of(corners, names, random_exact, plant.exact_nominal)
    return Certificate(design, exact, plant.discretisation, len(random))


class _Sweep:
    """K and G of plants over frequency; on the grid once for all filters."""

    def __init__(self, loops: Sequence[Loop], names: Sequence[str], update: Update, period: float) -> None:
        self._bundle, self._names = Bundle(loops, update.shift), names
        self._update, self._hertz = update, 1 / (2 * np.pi * period)
        self._w = self._bundle.grid
        self._G = update.on(self._bundle(self._w), self._w)

    def learning(
        self, q_filter: Filter | None, filtered: Filtered, ends: float, phi: float = 0.0
    ) -> Learning:
        """Learning with this filter or none; judged by the trial's ends and Phi's radius too; 0: not."""
        w, K = self._w, self._update.gain
        sign = float(np.sign(K))

        def H(w: Real) -> Real:
            return np.ones(len(w)) if q_filter is None else q_filter.gain(w)

        def G(w: Real, which: Sequence[int]) -> Complex:
            return self._update.on(self._bundle(w, which), w)

        def F(w: Real, which: Sequence[int]) -> Real:
            return factor(G(w, which), K, H(w), filtered)

        def limit(w: Real, which: Sequence[int]) -> Real:
            return -gain_limits(sign * G(w, which), H(w), filtered)

        on_grid = factor(self._G, K, H(w), filtered)
        norm, at, which = peak(F, w, on_grid)
        last = len(self._names) - 1
        nominal, _, _ = peak(lambda w, _: F(w, [last]), w, on_grid[last:])
        K_3_limit = None
        if self._update.ratio is None:
            K_3_limit = -sign * peak(limit, w, -gain_limits(sign * self._G, H(w), filtered))[0]
        order = np.argsort(np.append(w, at))
        curve = np.append(w, at)[order] * self._hertz, np.append(on_grid.max(axis=0), norm)[order]
        shrinks_at_ends = ends <= 1 + ENDS
        return Learning(
            norm,
            at * self._hertz,
            self._names[which],
            nominal,
            norm <= 1 + MONOTONE and shrinks_at_ends and phi <= 1 + AT_ONE,
            norm < 1 - MONOTONE and shrinks_at_ends and phi < 1,
            K_3_limit,
            curve,
        )
