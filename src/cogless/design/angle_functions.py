"""The functions h, alpha and beta of model (1) in Verrelli 2016, and the bounds of its assumption A.3.

They are computed from the values of a motor and its load. With i_d = 0 the motor's torque is
K(theta) i_q + cogging(theta). In mechanical quantities,

    h = J / K        alpha = (T_L - cogging) / K        beta = D / K

Coulomb friction is a constant part of the load torque T_L, because the paper's speeds are above zero.

Each bound is the extreme on a grid over one revolution plus a margin. The margin is the most by which the
function can exceed the grid point next to its extreme, f'' / 2 (grid / 2)^2, where f'' is bounded by a sum of
amplitudes. So the bounds hold, and are tight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cogless.design.margins import Real
from cogless.study import Study, for_scenario
from cogless.study.mechanics import AngleTable, Load, Mechanics
from cogless.study.motor import StarMotor
from cogless.units import TURN

PERIOD_POINTS = 256  # grid points per period of the highest order
MOST_POINTS = 2**20  # grid points per revolution

Rises = list[float]  # bounds of |f|, |f'|, |f''| and |f'''| of a function f


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Bounds of assumption A.3 in mechanical quantities, and those that the paper's printed list lacks."""

    h_m: float  # A*s^2/rad, the least of h
    h_M: float  # A*s^2/rad, the largest
    k_h: float  # A*s^2/rad^2, of |h'|; the paper's g_d, which bounds the derivative of 1 / g
    k_alpha1: float  # A, of |alpha|
    k_alpha2: float  # A/rad, of |alpha'|
    k_beta1: float  # A*s/rad, of |beta|
    k_beta2: float  # A*s/rad^2, of |beta'|

    @property
    def delta(self) -> float:
        """delta+: bound of the norm of [alpha, beta, h], whose entries are numbers in SI units."""
        return math.hypot(self.k_alpha1, self.k_beta1, self.h_M)

    @property
    def g(self) -> tuple[float, float]:
        """g- and g+: the smallest and the largest value of g = 1 / h."""
        return 1 / self.h_M, 1 / self.h_m


@dataclass(frozen=True)
class Series:
    """A function of the mechanical angle: constant + sum of Re(c e^{j n theta}) + an angle table, if any."""

    constant: float
    orders: tuple[int, ...]
    c: tuple[complex, ...]
    table: AngleTable | None = None

    def values_at(self, theta: Real, derivative: int = 0, above: bool = True) -> Real:
        """The value or a derivative at theta.

        At a point of the angle table the slope is the one above that point, or below it without `above`.
        """
        sum_ = np.full(theta.shape, self.constant if derivative == 0 else 0.0)
        for n, c in zip(self.orders, self.c, strict=True):
            sum_ += np.real(c * (1j * n) ** derivative * np.exp(1j * n * theta))
        if self.table is not None and derivative < 2:
            sum_ += self._of_table(theta, derivative, above)
        return sum_

    @property
    def rises(self) -> Rises:
        """Bounds of the function and of its derivatives: the sums of their terms' amplitudes."""
        sums = [sum(abs(c) * n**k for n, c in zip(self.orders, self.c, strict=True)) for k in range(4)]
        sums[0] += abs(self.constant)
        if self.table is not None:
            _, torque, slopes = self._pieces
            sums[0] += float(np.max(np.abs(torque)))
            sums[1] += float(np.max(np.abs(slopes)))
        return sums

    @cached_property
    def _pieces(self) -> tuple[Real, Real, Real]:
        """The table over one revolution from its first point: angles, torques, and slopes between points."""
        assert self.table is not None
        angle = np.array([*self.table.angle, self.table.angle[0] + TURN])
        torque = np.array([*self.table.torque, self.table.torque[0]])
        return angle, torque, np.diff(torque) / np.diff(angle)

    def _of_table(self, theta: Real, derivative: int, above: bool) -> Real:
        angle, torque, slopes = self._pieces
        place = angle[0] + (theta - angle[0]) % TURN
        if derivative == 0:
            return np.asarray(np.interp(place, angle, torque))
        n = np.searchsorted(angle, place, side="right" if above else "left") - 1
        return np.asarray(slopes[n % len(slopes)])


@dataclass(frozen=True)
class AngleFunctions:
    """Torque per current K, opposing torque, inertia and viscous friction of a motor with its load."""

    K: Series  # N*m/A
    torque: Series  # N*m, load torque plus Coulomb friction minus cogging torque
    J: float  # kg*m^2
    D: float  # N*m*s/rad

    def h(self, theta: Real) -> Real:
        """h = J / K at the mechanical angle theta, A*s^2/rad."""
        return np.asarray(self.J / self.K.values_at(theta))

    def alpha(self, theta: Real) -> Real:
        """alpha = (T_L - cogging) / K at the mechanical angle theta, A."""
        return np.asarray(self.torque.values_at(theta) / self.K.values_at(theta))

    def current(self, theta: Real, omega_m: float) -> Real:
        """Current that a constant mechanical speed omega_m, rad/s, needs: alpha + omega_m beta, A."""
        return self.alpha(theta) + omega_m * self.beta(theta)

    def beta(self, theta: Real) -> Real:
        """beta = D / K at the mechanical angle theta, A*s/rad."""
        return np.asarray(self.D / self.K.values_at(theta))

    def waves(self, omega_m: float) -> Real:
        """Amplitudes, A, of orders 0, 1, .. of `current` at omega_m, rad/s. Order 0 has twice the mean."""
        points = 4 * max([*self.orders, 16])
        current = self.current(np.arange(points) / points * TURN, omega_m)
        return np.asarray(2 * np.abs(np.fft.rfft(current)) / points, dtype=float)

    @property
    def orders(self) -> set[int]:
        """The mechanical orders of K and of the torque; an angle table counts as order 1."""
        return {*self.K.orders, *self.torque.orders, *([1] if self.torque.table else [])}

    def bounds(self) -> Bounds | None:
        """Bounds of assumption A.3; None if K reaches zero, which the paper excludes too (a_h > 0)."""
        theta, margin = self._grid()
        K, slope = self.K.values_at(theta), self.K.values_at(theta, 1)
        rises = self.K.rises
        least, most = (float(np.min(K)) - margin * rises[2], float(np.max(K)) + margin * rises[2])
        if least <= 0:
            return None
        u = _reciprocal(rises, least)  # bounds of 1 / K
        steepest = float(np.max(np.abs(slope / K**2))) + margin * u[3]
        torque, alpha = self.torque.values_at(theta), _product(self.torque.rises, u)
        alpha_slopes = [
            (self.torque.values_at(theta, 1, above) - torque * slope / K) / K for above in (True, False)
        ]
        return Bounds(
            h_m=self.J / most,
            h_M=self.J / least,
            k_h=self.J * steepest,
            k_alpha1=float(np.max(np.abs(torque / K))) + margin * alpha[2],
            k_alpha2=float(np.max(np.abs(alpha_slopes))) + margin * alpha[3],
            k_beta1=self.D / least,
            k_beta2=self.D * steepest,
        )

    def _grid(self) -> tuple[Real, float]:
        """Angles of a grid over a revolution, rad, and (grid step / 2)^2 / 2, rad^2.

        The grid includes the angles of the torque's table. A function exceeds its values on the grid by at
        most the second number times a bound of its second derivative.
        """
        points = min(PERIOD_POINTS * max([*self.orders, 4]), MOST_POINTS)
        theta = np.linspace(0, TURN, points, endpoint=False)
        if self.torque.table is not None:
            theta = np.sort(np.concatenate([theta, np.array(self.torque.table.angle) % TURN]))
        return theta, (TURN / points) ** 2 / 8


def functions_in(study: Study, scenario: str) -> AngleFunctions:
    """Angle functions of a study's motor and load, with the overrides of a scenario."""
    study_here = for_scenario(study, scenario)
    load = study_here.scenario[scenario].load or study_here.mechanics.load
    return angle_functions(study_here.motor.star(), study_here.mechanics, load)


def angle_functions(
    motor: StarMotor, mechanics: Mechanics, load: Load, constant: float | None = None
) -> AngleFunctions:
    """Angle functions of a motor with a load; `constant`, N*m, replaces the load's constant torque.

    A load behind a gear is seen from the motor. What doesn't repeat over the motor's revolution is left out.
    """
    ratio, mechanics = mechanics.ratio, mechanics.stiff
    factor = motor.power_factor * motor.pole_pairs
    flux = [(h.order * motor.pole_pairs, h.order * h.q, h.q_phase) for h in motor.flux_harmonics]
    flux += [(h.order * motor.pole_pairs, h.d, h.d_phase) for h in motor.flux_harmonics]
    flux += [(r.order, r.share * motor.psi_f, r.phase - math.pi / 2) for r in motor.torque_ripple]
    of_load = [(h.order / ratio, h.torque / ratio, h.phase) for h in load.harmonics]
    torques = [(int(order), torque, phase) for order, torque, phase in of_load if not order % 1]
    torques += [(c.order, -c.torque, c.phase) for c in motor.cogging]
    level = load.torque if constant is None else constant
    return AngleFunctions(
        K=_series(factor * motor.psi_f, [(n, factor * c, phase) for n, c, phase in flux]),
        torque=_series(
            level / ratio + mechanics.coulomb_friction,
            [(n, c, p - math.pi / 2) for n, c, p in torques],
            load.angle_table if ratio == 1 else None,
        ),
        J=mechanics.inertia,
        D=mechanics.viscous_friction,
    )


def _series(
    constant: float, cosines: Sequence[tuple[int, float, float]], table: AngleTable | None = None
) -> Series:
    """The series of terms c cos(n theta + phase), where terms of the same order n are added up."""
    sums: dict[int, complex] = {}
    for n, c, phase in cosines:
        sums[n] = sums.get(n, 0j) + c * complex(math.cos(phase), math.sin(phase))
    nonzero = {n: c for n, c in sums.items() if c}
    return Series(constant, tuple(nonzero), tuple(nonzero.values()), table)


def _product(f: Rises, g: Rises) -> Rises:
    """Bounds of a product f g and its derivatives from those of f and g, by Leibniz' rule."""
    return [sum(math.comb(k, i) * f[i] * g[k - i] for i in range(k + 1)) for k in range(4)]


def _reciprocal(f: Rises, least: float) -> Rises:
    """Bounds of u = 1 / f and its derivatives, by Leibniz' rule on f u = 1, with f >= least > 0."""
    u = [1 / least]
    for k in range(1, 4):
        u.append(sum(math.comb(k, i) * f[i] * u[k - i] for i in range(1, k + 1)) / least)
    return u
