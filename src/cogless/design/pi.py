"""Tuning of the speed PI for a phase margin, as a fair baseline for learning laws: see docs/laws/pi.md.

The open speed loop, from speed error to measured speed, sampled with period T = N T_c, is

    L = (kp + ki T z / (z - 1)) P(jw),    z = exp(jwT)

P is the response from current reference to measured speed. It consists of N exact steps x' = A x + B i_ref,
each of one current-loop period T_c. From one speed sample to the next this gives X(z) = (z - A^N)^-1 B_N.
With an ideal sensor the measured speed is omega, with an observer its response to theta. Otherwise it is
(theta now - theta W steps ago) / (W T_c).
With W = m N - r (0 <= r < N), theta W steps ago was that of z^-m (A^r X + B_r). An encoder has W = N, so a
delay of T / 2. If it is timed from edge to edge (method T), this is its largest delay while two edges or more
come in a period.

The rule puts the crossover w_c at the frequency of the largest phase. With K = kp + ki T / 2, T_i = K / ki,
w' = tan(wT / 2) / (T / 2), T_e = -arg(jw P(jw)) / w and x = w' T_i

    T_e = T_i / (1 + x^2),    PM = atan x - x / (1 + x^2)

The wanted phase margin PM gives x, and x gives w_c = x / ((1 + x^2) T_e) and T_i = x / w_c'. |L(w_c)| = 1
gives the gain. Where T_e depends only weakly on w_c, a few rounds of substitution converge. Where it doesn't,
as behind a slow observer, whose lag grows with the cube of w, w_c is found by bisection.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cogless.design.current_loop import CurrentLoop, IdealLoop, NoMarginError, current_loops, tuned
from cogless.design.margins import POINTS, UNSTABLE, Complex, Margins, Real, margins_of, root
from cogless.design.model import exponential
from cogless.design.observer import observed
from cogless.design.soft_shaft import SoftShaft, soft_shaft
from cogless.study import Study, for_scenario
from cogless.study.controller import Feedback, Tuning
from cogless.study.position_sensor import Counted, Hall

CURRENT, INTEGRAL, WAITING, OMEGA, THETA = range(5)  # indices of the state x; a soft shaft adds two


def pi_response(w: Real, T: float, k: float, k_i: float) -> Complex:
    """Response of a PI controller, k + k_i T z / (z - 1), at w in rad/s."""
    if not k_i:
        return np.full(np.shape(w), k, dtype=complex)
    z = np.exp(1j * w * T)
    return np.asarray(k + k_i * T * z / (z - 1))


@dataclass(frozen=True, kw_only=True)
class SpeedLoop:
    """The speed controller's plant: current loop, mechanics and speed measurement."""

    b: float  # rad/s^2/A, acceleration per current
    steps: int  # current-loop periods per speed-loop period
    window: int  # current-loop periods over which the speed is averaged; 0: speed at the sample
    current: CurrentLoop | IdealLoop  # of the q axis
    bandwidth: float = 0.0  # rad/s, of an observer of the angle that gives the speed; 0: none
    delay: float = 0.0  # s, by which angle and speed are older, and the current reference acts later
    low_pass: float = 0.0  # rad/s, of a filter behind the speed; 0: none
    held: bool = False  # the speed that enters it is computed once per speed-loop period
    shaft: SoftShaft | None = None  # none: rigid
    edge: float = 0.0  # s between the edges of Hall sensors; 0: they come at once, or there are none
    edges: int = 0  # intervals between them that the speed is taken over

    @property
    def period(self) -> float:
        """Speed-loop period, s."""
        return self.steps * self.current.period

    @property
    def states(self) -> int:
        """Number of states x, and the index of i_ref, which is kept behind them."""
        return 5 if self.shaft is None else 7

    @property
    def sensed(self) -> tuple[int, int]:
        """Indices of the speed and the angle that the position sensor is at."""
        return (5, 6) if self.shaft is not None and self.shaft.on_load else (OMEGA, THETA)

    @property
    def rigid(self) -> SpeedLoop:
        """The same with both masses as one."""
        return dataclasses.replace(self, shaft=None)

    @property
    def near(self) -> Real | None:
        """Frequencies around the resonances of a soft shaft, rad/s; None: it is rigid."""
        return None if self.shaft is None else self.shaft.near(self.period)

    def plant(self, w: Real) -> tuple[Complex, Complex]:
        """P(jw), from current reference to measured speed, and the response to the sampled angle, rad/A."""
        if len(w) == 1:  # a step of a search, which comes once
            return self._plant(w)
        return _on_grid(self, np.asarray(w, dtype=float).tobytes())

    def _plant(self, w: Real) -> tuple[Complex, Complex]:
        speed, theta = self._sampled(w)
        if self.low_pass:
            speed = speed * self._filter(w)
        if self.delay:
            late = np.exp(-1j * w * self.delay)
            speed, theta = speed * late, theta * late
        return np.asarray(speed), np.asarray(theta)

    def _sampled(self, w: Real) -> tuple[Complex, Complex]:
        """Responses to the speed and the angle that the sensor gives."""
        z, whole, states = np.exp(1j * w * self.period), self.step_of(self.steps), self.states
        A, B, (omega, theta) = whole[:states, :states], whole[:states, states:], self.sensed
        x = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B)[:, :, 0]
        if self.edge:
            seen = interpolated(w, self.edge, self.edges)
            return np.asarray(seen[0] * x[:, theta]), np.asarray(seen[1] * x[:, theta])
        if self.bandwidth:
            speed = observed(w, self.bandwidth, self.current.period)
            return np.asarray(speed * x[:, theta]), np.asarray(x[:, theta])
        if self.window == 0:
            return np.asarray(x[:, omega]), np.asarray(x[:, theta])
        samples = -(-self.window // self.steps)
        then = self.step_of(samples * self.steps - self.window)[theta]
        theta_then = (x @ then[:states] + then[states]) / z**samples
        turned = x[:, theta] - theta_then
        return np.asarray(turned / (self.window * self.current.period)), np.asarray(x[:, theta])

    def _filter(self, w: Real) -> Complex:
        """Response of the speed's low-pass, which runs at the current loop's rate.

        A speed that is held for N of its steps enters anew in the step before the law's.
        """
        p, N = math.exp(-self.low_pass * self.current.period), self.steps
        if not self.held:
            return np.asarray((1 - p) / (1 - p * np.exp(-1j * w * self.current.period)))
        back = np.exp(-1j * w * self.period)
        return np.asarray((1 - p + (p - p**N) * back) / (1 - p**N * back))

    def response(self, w: Real, kp: float, ki: float) -> Complex:
        """L(jw), the open loop with gains kp and ki."""
        return np.asarray(pi_response(w, self.period, kp, ki) * self.plant(w)[0])

    def step_of(self, periods: int) -> Real:
        """The matrix that takes (x, i_ref) to their values `periods` current-loop periods later."""
        return _steps(self.b, self.current, self.shaft, self.states, periods)


def interpolated(w: Real, T_e: float, edges: int) -> tuple[Complex, Complex]:
    """Responses of the speed and the angle that Hall sensors give to the true angle, T_e s from edge to edge.

    An edge shows the angle as it passes. From there on it is interpolated by the speed over the last `edges`
    intervals. What this makes of frequencies beyond half of the edges' rate isn't in it.
    """
    s = 1j * w
    held = (1 - np.exp(-s * T_e)) / (s * T_e)
    speed = (1 - np.exp(-s * edges * T_e)) / (edges * T_e)
    ramp = (held - np.exp(-s * T_e)) / s
    return np.asarray(speed * held), np.asarray(held + speed * ramp)


@lru_cache(maxsize=16)  # the same for all gains that are tried
def _on_grid(loop: SpeedLoop, frequencies: bytes) -> tuple[Complex, Complex]:
    """The plant at frequencies in rad/s, as bytes of an array so that they can be a cache key."""
    speed, theta = loop._plant(np.frombuffer(frequencies))
    speed.flags.writeable = theta.flags.writeable = False
    return speed, theta


@lru_cache(maxsize=32)  # the same for all speeds of a reference, also where a sensor's edges come otherwise
def _steps(
    b: float, loop: CurrentLoop | IdealLoop, shaft: SoftShaft | None, states: int, periods: int
) -> Real:
    """The matrix that takes (x, i_ref) to their values so many current-loop periods later."""
    found = np.asarray(np.linalg.matrix_power(_step(b, loop, shaft, states), periods))
    found.flags.writeable = False
    return found


def _step(b: float, loop: CurrentLoop | IdealLoop, shaft: SoftShaft | None, states: int) -> Real:
    """The matrix that takes (x, i_ref) to their values one current-loop period later."""
    T, reference, size = loop.period, states, states + 1
    moving = [CURRENT, *range(OMEGA, reference)]
    count = len(moving)
    rates = np.zeros((count + 1, count + 1))  # of change of what moves, under a constant voltage
    if shaft is None:
        rates[1, 0], rates[2, 1] = b, 1.0
    else:
        rates[:] = shaft.rates(b)
    if isinstance(loop, IdealLoop):
        step = np.diag([0.0] * OMEGA + [1.0] * (size - OMEGA))
        step[CURRENT, reference] = 1.0
        if shaft is None:
            step[OMEGA, reference] = b * T
            step[THETA, [OMEGA, reference]] = T, b * T**2 / 2
        else:
            held = exponential(rates[:count, :count] * T)
            step[np.ix_(moving[1:], moving[1:])] = held[1:, 1:]
            step[moving[1:], reference] = held[1:, 0]
        return step
    rates[0, 0], rates[0, count] = -loop.R / loop.L, 1 / loop.L
    motor = exponential(rates * loop.period)
    voltage = np.zeros(size)  # the current controller's output, kp (i_ref - i) + integral
    voltage[[CURRENT, INTEGRAL, reference]] = -loop.kp, 1.0, loop.kp
    step = np.eye(size)
    step[INTEGRAL, [CURRENT, reference]] = -loop.ki * loop.period, loop.ki * loop.period
    step[WAITING] = voltage
    step[np.ix_(moving, moving)] = motor[:count, :count]
    acting = np.eye(size)[WAITING] if loop.delay else voltage
    step[moving] += np.outer(motor[:count, count], acting)
    return step


@dataclass(frozen=True)
class PiDesign:
    """Gains of a speed PI and the margins of its loop."""

    kp: float  # A*s/rad
    ki: float  # A/rad
    margins: Margins


def speed_loop(study: Study, scenario: str | None = None) -> SpeedLoop:
    """The speed loop as the controller assumes it, or with the true values and overrides of a scenario.

    The torque per current is the motor's mean in a scenario. Otherwise it follows from the flux that the
    controller assumes.
    """
    return study.once(_speed_loop, scenario)


def _speed_loop(study: Study, scenario: str | None) -> SpeedLoop:
    study_here = study if scenario is None else for_scenario(study, scenario)
    rates, sensor, motor = study_here.drive.rates, study_here.drive.position_sensor, study_here.motor.star()
    K_t = motor.K_t if scenario is not None else study.K_t
    bus = study_here.drive.bus
    window = sensor.periods(rates.divider) if isinstance(sensor, Counted) else 0
    if isinstance(sensor, Hall):
        window = rates.divider  # at least: slow_running.py tells where edges come more rarely
    delay = sensor.latency if isinstance(sensor, Counted) else 0.0
    return SpeedLoop(
        b=K_t / study_here.mechanics.stiff.inertia,
        steps=rates.divider,
        window=window,
        current=current_loops(study, scenario).get("q") or IdealLoop(1 / rates.current_loop),
        bandwidth=sensor.bandwidth if isinstance(sensor, Counted) else 0.0,
        delay=delay + (bus.mean_delay if bus is not None else 0.0),
        low_pass=math.tau * (study_here.drive.speed_filter or 0.0),
        held=isinstance(sensor, Counted) and sensor.each_law_period,
        shaft=soft_shaft(study_here),
    )


def gains(study: Study, name: str) -> tuple[float, float]:
    """kp and ki of a controller of the study: as given there, or from its tuning rule."""
    controller = study.controller[name]
    assert isinstance(controller, Feedback)
    if controller.kp is not None or controller.tuning is None:
        return controller.kp or 0.0, controller.ki or 0.0
    design = tuned(
        study, name, lambda study: phase_margin_pi(speed_loop(study).rigid, tuning_of(study, name))
    )
    return design.kp, design.ki


def tuning_of(study: Study, name: str) -> Tuning:
    """The tuning rule of a controller, which must have one."""
    tuning = getattr(study.controller[name], "tuning", None)
    assert isinstance(tuning, Tuning)
    return tuning


@lru_cache(maxsize=32)
def phase_margin_pi(loop: SpeedLoop, tuning: Tuning) -> PiDesign:
    """Gains for a phase margin; NoMarginError if no crossover below half the sampling rate has it."""
    x = root(lambda x: math.atan(x) - x / (1 + x * x) - tuning.phase_margin, 1e-3, 1e3)
    half = loop.period / 2
    for w in (_substituted(loop, x), _bisected(loop, x)):
        if w is None:
            continue
        ki = math.tan(w * half) / (half * x)  # for K = 1
        K = 1 / float(abs(loop.response(np.array([w]), 1 - ki * half, ki)[0]))
        design = PiDesign(K * (1 - ki * half), K * ki, margins(loop, K * (1 - ki * half), K * ki))
        # A resonant current loop may let |L| cross one again at a higher frequency, with less margin.
        if math.isclose(design.margins.phase_margin, tuning.phase_margin, rel_tol=1e-6):
            return design
    raise NoMarginError


def _lag(loop: SpeedLoop, w: Real) -> Real:
    """The plant's lag behind an integrator, w T_e, rad, at w, rad/s. It is wrapped into (-pi, pi]."""
    return np.asarray(-np.angle(1j * loop.plant(w)[0]))


def _substituted(loop: SpeedLoop, x: float) -> float | None:
    """The crossover by substitution; None if it diverges, as it does where T_e grows faster than w."""
    w = 1e-3 * math.pi / loop.period
    for _ in range(100):
        T_e = float(_lag(loop, np.array([w]))[0]) / w
        before, w = w, x / ((1 + x * x) * max(T_e, 1e-300))
        if w >= math.pi / loop.period:
            return None
        if math.isclose(w, before, rel_tol=1e-12):
            return w
    return None


def _bisected(loop: SpeedLoop, x: float) -> float | None:
    """The lowest crossover at which the lag rises to x / (1 + x^2); None if it never does."""
    wanted = x / (1 + x * x)
    w = np.geomspace(1e-3, 1, POINTS) * math.pi / loop.period
    lag = np.unwrap(_lag(loop, w))
    rises = np.flatnonzero((lag[:-1] < wanted) & (lag[1:] >= wanted))
    if not len(rises):
        return None
    k = int(rises[0])
    return root(lambda w: float(_lag(loop, np.array([w]))[0]) - wanted, float(w[k]), float(w[k + 1]))


def margins(loop: SpeedLoop, kp: float, ki: float) -> Margins:
    """Margins of a speed loop with given gains; unstable if its current loop is."""
    if isinstance(loop.current, CurrentLoop) and not loop.current.margins().stable:
        return UNSTABLE
    integrators = 1 + (ki > 0) if kp or ki else 0
    return margins_of(lambda w: loop.response(w, kp, ki), loop.period, integrators, loop.near)
