"""Certificate of a trial controller: its stability along the trial, and its learning from trial to trial.

A certificate covers two sets of plants. "design": the polytope's vertices, random plants within the
uncertainty and random mixtures of the vertices. "exact", for the drive: the corners and the same random
plants, sampled exactly. With an Euler model the two sets differ most near half the sampling rate, where it
matters most. So each result says for which set it holds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Literal

import numpy as np

from cogless.design.trials.learning_gain import Vertex
from cogless.design.trials.model import Discretisation, Model, Real
from cogless.design.trials.polytope import UncertainPlant
from cogless.design.trials.response import (
    FACTOR_ROUNDING,
    Bundle,
    Complex,
    Disturbed,
    Filter,
    Filtered,
    FiniteTrial,
    Loop,
    TrialMap,
    factor,
    finite_trial,
    gain_limits,
    growth,
    peak,
)
from cogless.design.trials.trial_observer import ObserverGains
from cogless.units import TURN

Structure = Literal["input-and-integrator", "input"]
GROWTH_ROUNDING = 1e-4  # growth per trial that counts as none: it is only estimated, from simulated trials
GROWTH_MOST = 2.0  # growth per trial from which norms of many trials are no numbers any more
AT_ONE = 1e-6  # tolerance of Phi's spectral radius: a double pole at z = 1 has this rounding error


@dataclass(frozen=True)
class Gains:
    """Law u(p) = K_1 x(p) + K_2 psi(p-1) + f(p) + N v(p); if `through_integrator`, v also drives psi."""

    K_1: Real
    K_2: float
    N: float
    through_integrator: bool
    integral: bool

    def closed(self, model: Model, C: Real) -> Loop:
        """The closed loop from v to the y that the law gets: (14), (15) of Mandra 2019."""
        n, seen = model.order, C @ model.view
        A, B = model.A + model.B @ (self.K_1 @ model.view)[None, :], model.B * self.N
        if not self.integral:
            return Loop(A, B, seen)
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n:], whole[n, :n], whole[n, n] = A, model.B * self.K_2, -seen, 1.0
        return Loop(whole, np.vstack([B, [[float(self.through_integrator)]]]), np.append(seen, 0.0))

    def position(self, model: Model, C: Real) -> Loop:
        """The closed loop from v to the true y."""
        loop = self.closed(model, C)
        return Loop(loop.A, loop.B, np.append(model.output(C), np.zeros(int(self.integral))))

    def disturbed(self, model: Model, C: Real) -> Disturbed:
        """The closed loop from an error of the angle and the speed that the law gets."""
        closed, n = self.closed(model, C), model.order
        acts = np.vstack([model.B, np.zeros((int(self.integral), 1))]) @ self.K_1[None, :2]
        if self.integral:
            acts[n, 0] = -1.0
        row = np.append(self.K_1 @ model.view, [self.K_2] * self.integral)
        return Disturbed(
            closed.A,
            acts,
            lesson=-closed.C,
            lesson_at_once=-1.0,
            position=self.position(model, C).C,
            u=row,
            u_at_once=self.K_1[:2],
        )

    def delayed(self, model: Model, C: Real) -> float:
        """Spectral radius of the closed loop with one more sample of delay at the input."""
        n = model.order
        size = n + self.integral
        A = np.zeros((size + 1, size + 1))
        A[:n, :n], A[:n, size:] = model.A, model.B
        A[size, :n] = self.K_1 @ model.view
        if self.integral:
            A[n, :n], A[n, n], A[size, n] = -C @ model.view, 1.0, self.K_2
        return float(np.abs(np.linalg.eigvals(A)).max())


@dataclass(frozen=True)
class Learning:
    """Largest |F| of (20) over all plants, over frequency in Hz; see response.py.

    If there is no filter and the shift is the model's relative degree, the error's norm grows by at most the
    factor `norm` per trial. Otherwise this bound holds for each frequency only, and the error may grow at the
    trial's ends, which `growth` of response.py tests. Exactly sampled plants are such a case: their relative
    degree is 1, and the shift is often 2.
    """

    norm: float  # the largest |F|
    frequency: float  # where
    worst: str  # the plant with the largest |F|
    nominal: float  # the largest |F| of the nominal plant
    monotone: bool  # the error grows at no frequency and not at the ends, and Phi isn't unstable
    contracting: bool  # monotone, and the error shrinks at every frequency
    K_3_limit: float | None  # largest gain at which no frequency's error grows, signed as K_3; None: no K_3
    curve: tuple[Real, Real]  # frequency and |F|


@dataclass(frozen=True)
class ModelCertificate:
    """Certificate for one of the two sets of models, "design" or "exact"."""

    radius: float  # largest spectral radius of A_cl over all plants: stability along the trial
    worst: str  # the plant with this radius
    stable: bool
    delayed_radius: float  # largest spectral radius with one more sample of delay at the input
    delayed_stable: bool
    phi_radius: float | None  # largest radius of Phi (27) at a vertex; None: no K_3, or shift isn't r
    without_filter: Learning | None  # None without learning, or if unstable along the trial
    with_filter: Learning | None  # None also if there is no filter
    growth: float | None  # factor per trial after many trials, trial ends and filter included: response.py
    norms: Callable[[], FiniteTrial] | None = field(default=None, compare=False, repr=False)

    @cached_property
    def finite(self) -> FiniteTrial | None:
        """Norms of a whole trial at the vertices and the nominal plant. They take most of a design's time.

        None if `growth` is None or above GROWTH_MOST. The design's models decide only if no exactly sampled
        plants are known.
        """
        return self.norms() if self.norms is not None else None

    @property
    def learning(self) -> Learning | None:
        """The learning result with the filter if there is one, otherwise without."""
        return self.with_filter or self.without_filter


@dataclass(frozen=True)
class Certificate:
    """Certificate of a trial controller; `exact` is None if the continuous plant isn't known."""

    design: ModelCertificate
    exact: ModelCertificate | None
    discretisation: Discretisation | None  # sampling of the design's models; None: given as discrete models
    samples: int  # random plants

    @property
    def decides(self) -> Literal["design", "exact"]:
        """Which of the two sets decides: that of the exactly sampled plants, if it is known."""
        return "design" if self.exact is None else "exact"

    @property
    def deciding(self) -> ModelCertificate:
        """The certificate that decides."""
        return self.exact or self.design


@dataclass(frozen=True)
class Update:
    """Operator from the error to the change of v: K_3 z^shift, or norm-optimal for the nominal loop."""

    shift: int
    K_3: float
    ratio: float | None = None  # norm-optimal, in place of K_3: weight of v's change / weight of the error
    nominal: Loop | None = None  # norm-optimal: the loop that L is made for
    matrix: Real | None = None  # norm-optimal: L

    def on(self, G: Complex, w: Real) -> Complex:
        """The G of F = 1 - K G: the plants' G, for norm-optimal learning times the operator."""
        if self.ratio is None or self.nominal is None:
            return G
        model = Bundle([self.nominal], self.shift)(w)[0]
        return np.asarray(np.conj(model) / (np.abs(model) ** 2 + self.ratio) * G)

    @property
    def gain(self) -> float:
        """The K of F = 1 - K G: K_3, or 1 for norm-optimal learning, whose operator is part of G."""
        return self.K_3 if self.ratio is None else 1.0


def certify(
    plant: UncertainPlant,
    gains: Gains | ObserverGains,
    update: Update | None,
    q_filter: Filter | None,
    filtered: Filtered,
    samples: int,
) -> Certificate:
    """The certificate of a plant with these gains; without learning if `update` is None."""
    random, random_exact = plant.random

    def certificate_of(
        corners: Sequence[Model], labels: Sequence[str], drawn: list[Model], nominal: Model, decides: bool
    ) -> ModelCertificate:
        loops = [gains.closed(m, plant.C) for m in [*corners, *drawn, nominal]]
        radii = Bundle(loops, 0).radii
        k = int(np.argmax(radii))
        delayed = max(gains.delayed(m, plant.C) for m in corners)
        stable = bool(radii[k] < 1)
        phi = None
        if update is not None and update.ratio is None and update.shift == plant.relative_degree:
            phis = [Vertex.of_loop(loop, update.shift).phi(update.K_3) for loop in loops[: len(corners)]]
            phi = max(float(np.abs(np.linalg.eigvals(p)).max()) for p in phis)
        names = [*labels, *["a random plant"] * len(drawn), "the nominal plant"]
        plain = filters = ends = norms = None
        if stable and update is not None:
            sweep = _Sweep(loops, names, update, plant.period)
            few = [*loops[: len(corners)], loops[-1]]
            trial = TrialMap(
                loops=few,
                K_3=update.K_3,
                shift=update.shift,
                q_filter=q_filter,
                filtered=filtered,
                samples=samples,
                matrix=update.matrix,
            )
            ends = float(growth(trial).max())
            norms = partial(finite_trial, trial) if decides and ends < GROWTH_MOST else None
            plain = sweep.learning(None, filtered, (ends or 0.0) if q_filter is None else 0.0, phi or 0.0)
            if q_filter is not None:
                filters = sweep.learning(q_filter, filtered, ends or 0.0)
        return ModelCertificate(
            radius=float(radii[k]),
            worst=names[k],
            stable=stable,
            delayed_radius=delayed,
            delayed_stable=delayed < 1,
            phi_radius=phi,
            without_filter=plain,
            with_filter=filters,
            growth=ends,
            norms=norms,
        )

    zero_order_hold = plant.exact_hull or plant.vertices is plant.exact_vertices
    same = plant.discretisation == "exact" and zero_order_hold
    design = certificate_of(
        plant.vertices, plant.labels, random, plant.nominal, plant.exact_nominal is None or same
    )
    exact = None
    if plant.exact_vertices is not None and plant.exact_nominal is not None and random_exact is not None:
        corners = plant.exact_vertices
        names = plant.labels if plant.exact_hull else [f"corner {k + 1}" for k in range(len(corners))]
        exact = design if same else certificate_of(corners, names, random_exact, plant.exact_nominal, True)
    return Certificate(design, exact, plant.discretisation, len(random))


class _Sweep:
    """F of many plants over frequency; G on the grid is computed once for all filters."""

    def __init__(self, loops: Sequence[Loop], names: Sequence[str], update: Update, period: float) -> None:
        self._bundle, self._names = Bundle(loops, update.shift), names
        self._update, self._hertz = update, 1 / (TURN * period)
        self._w = self._bundle.grid
        self._G = update.on(self._bundle(self._w), self._w)

    def learning(
        self, q_filter: Filter | None, filtered: Filtered, ends: float, phi: float = 0.0
    ) -> Learning:
        """Learning with this filter or none.

        `monotone` and `contracting` also depend on `ends`, the growth at the trial's ends, and on `phi`,
        Phi's spectral radius. 0: that condition is met.
        """
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
        shrinks_at_ends = ends <= 1 + GROWTH_ROUNDING
        return Learning(
            norm=norm,
            frequency=at * self._hertz,
            worst=self._names[which],
            nominal=nominal,
            monotone=norm <= 1 + FACTOR_ROUNDING and shrinks_at_ends and phi <= 1 + AT_ONE,
            contracting=norm < 1 - FACTOR_ROUNDING and shrinks_at_ends and phi < 1,
            K_3_limit=K_3_limit,
            curve=curve,
        )
