"""The speed loop: the current loop inside it, its PI's tuning, a soft shaft, the speed observer.

Tuning of the speed PI for a phase margin, as a fair baseline for learning laws: see docs/laws/pi.md.

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

The current loop of one axis, sampled with period T_c, as the drive runs it.

G is the open loop of the winding R, L and the PI controller of control/src/cogless/foc.c, whose integral is
forward Euler. The voltage acts `delay` periods after the current was sampled. G is exact for the averaged
inverter at standstill:

    G = (kp + ki T_c / (z - 1)) z^-delay (1 - a) / (R (z - a)),    a = exp(-R T_c / L),    z = exp(jw T_c)

A load behind a soft shaft, as the design sees it: linear, and from the motor's side.

Response of the speed observer, control/src/cogless/angle_observer.c, at the current loop's rate.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from cogless.design.changes import cure_words, first, helps, unit_text
from cogless.design.margins import FREQUENCY_POINTS, UNSTABLE, Complex, Margins, Real, margins_of, root
from cogless.design.trials.model import exponential
from cogless.errors import StudyError
from cogless.study import Study, for_scenario
from cogless.study.drive import IdealCurrentLoop
from cogless.study.laws.law import Tuning
from cogless.study.messages import dotted, toml_text
from cogless.study.position_sensor import Counted, Hall
from cogless.study.reading import Changes
from cogless.units import TURN, unit_of

FASTER_FACTORS = (2.0, 4.0, 8.0)  # tried factors of gains and bandwidths
SLOWER_FACTORS = (*FASTER_FACTORS, 16.0, 32.0, 64.0)  # by which the gains of the current loop are divided
LEAST_MARGIN = 20  # deg, least phase margin that the design advises for a rule
RATE_SHARE = 0.05  # advised bandwidth / current loop's rate: a delay of 1.5 periods costs 27 deg
PHASE_MARGIN_LEAST = math.radians(30)  # rad, of a current loop or a feedback that is good enough
# True value / the law's value: of K_t, and of the inertia on the motor's side of a soft shaft
BELIEF_FACTORS = (0.5, 1.0, 1.5)
Tuned = TypeVar("Tuned")


class NoMarginError(ValueError):
    """No gains give a loop the phase margin that a tuning rule asks for."""

    def __init__(self) -> None:
        super().__init__("expected a loop that reaches this phase margin with some gains")


@dataclass(frozen=True, kw_only=True)
class CurrentLoop:
    """Winding and current controller of one axis."""

    kp: float  # V/A
    ki: float  # V/A/s
    R: float  # ohm
    L: float  # H
    period: float  # s
    delay: int  # periods, from sampling the current to the voltage

    def response(self, w: Real) -> Complex:
        """The open loop G(jw), w in rad/s."""
        z = np.exp(1j * w * self.period)
        x = self.R * self.period / self.L
        gain = self.period / self.L * (-math.expm1(-x) / x if x > 0 else 1.0)
        pi = self.kp + self.ki * self.period / (z - 1)
        return np.asarray(pi * gain / (z - math.exp(-x)) / z**self.delay)

    def margins(self) -> Margins:
        """Margins of the open loop G."""
        return _margins(self)


@lru_cache(maxsize=16)  # called for every controller, at every speed
def _margins(loop: CurrentLoop) -> Margins:
    integrators = (loop.ki > 0) + (loop.R == 0 and loop.kp + loop.ki > 0)
    return margins_of(loop.response, loop.period, integrators)


@dataclass(frozen=True)
class IdealLoop:
    """An ideal current loop: the current equals its reference. Only the loop's period is needed."""

    period: float  # s


def current_loops(study: Study, scenario: str | None = None) -> dict[str, CurrentLoop]:
    """Loops of the q and d axes, with the motor that the controller assumes or with a scenario's true motor.

    The result is empty if the current loop is ideal.
    """
    study_here = study if scenario is None else for_scenario(study, scenario)
    drive = study_here.drive
    loop, inverter, T = drive.current_loop, drive.inverter, 1 / drive.rates.current_loop
    if isinstance(loop, IdealCurrentLoop) or inverter is None:
        return {}
    belief = drive.belief.resolved(study.motor.star())
    motor = belief if scenario is None else study_here.motor.star()
    gains, delay = loop.gains(belief), inverter.computation_delay
    return {
        "q": CurrentLoop(kp=gains["kp_q"], ki=gains["ki_q"], R=motor.R_s, L=motor.L_q, period=T, delay=delay),
        "d": CurrentLoop(kp=gains["kp_d"], ki=gains["ki_d"], R=motor.R_s, L=motor.L_d, period=T, delay=delay),
    }


def weakness(margins: Margins) -> str | None:
    """The reason, in words, why a current loop isn't good enough for a speed loop; None if it is."""
    if not margins.stable:
        return "is unstable"
    if margins.phase_margin < PHASE_MARGIN_LEAST:
        return f"has only {math.degrees(margins.phase_margin):.1f} deg"
    return None


def tuned(study: Study, name: str, rule: Callable[[Study], Tuned]) -> Tuned:
    """The gains that a controller's tuning rule gives.

    StudyError: the current loop is too weak for the rule, or the rule raises NoMarginError. The error
    advises the least change of loop or margin with which the rule gives gains.
    """
    for axis, loop in current_loops(study).items():
        wrong = weakness(loop.margins())
        if wrong:
            raise _too_weak(study, f"for tuning controller.{name}; the current loop's {axis} axis {wrong}")
    try:
        return rule(study)
    except NoMarginError as error:
        raise _no_margin(study, name, rule, str(error)) from None


def _too_weak(study: Study, what: str) -> StudyError:
    table, key = study.source.tables["drive"]["current_loop"], "drive.current_loop"
    wrong = " and ".join(f"{key}.{gain}: {toml_text(table[gain])}" for gain in _present(study))
    expected = f"expected {math.degrees(PHASE_MARGIN_LEAST):.0f} deg of phase margin or more {what}"
    cures = gentler_loop(study)
    return StudyError(f"{study.source.path}: {wrong}: {expected}{cure_words(cures, key)}").advising(*cures)


def gentler_loop(study: Study) -> tuple[Changes, ...]:
    """The least change that makes the current loop good enough for a speed loop, as one or none.

    It divides the gains, or puts a bandwidth in their place.
    """
    bandwidth = unit_text(RATE_SHARE * study.drive.rates.current_loop, "Hz")
    others = [f"drive.current_loop.{key}" for key in _present(study) if key != "bandwidth"]
    slower = [*slower_loop(study), {"drive.current_loop.bandwidth": bandwidth, **dict.fromkeys(others)}]
    return first(study, slower, lambda other: not _weak(other))


def slower_loop(study: Study) -> list[Changes]:
    """Smaller gains of the current loop, or a smaller bandwidth, the least change first."""
    table, present = study.source.tables["drive"]["current_loop"], _present(study)
    return [
        {f"drive.current_loop.{gain}": _divided(table[gain], factor) for gain in keys}
        for keys in (present, [gain for gain in present if gain == "ki"])
        for factor in SLOWER_FACTORS
        if keys
    ]


def _present(study: Study) -> list[str]:
    """The keys that give the current loop its gains."""
    table = study.source.tables["drive"]["current_loop"]
    return [gain for gain in ("kp", "ki", "bandwidth") if gain in table]


def _no_margin(study: Study, name: str, rule: Callable[[Study], object], why: str) -> StudyError:
    """The error for a rule that finds no gains, with changes with which the rule finds some."""

    def cured(other: Study) -> bool:
        if _weak(other):
            return False
        try:
            rule(other)
        except NoMarginError:
            return False
        return True

    key = dotted(("controller", name, "tuning"))
    ways = [first(study, tried, cured) for tried in faster_loop(study)]
    softer = _softer(study, name, cured)
    cures = (*(cure for way in ways for cure in way), *([softer] if softer is not None else []))
    return StudyError(f"{study.source.path}: {key}: {why}{cure_words(cures)}").advising(*cures)


def faster_loop(study: Study) -> Iterator[list[Changes]]:
    """Lists of changes that take lag out of the loop; each list begins with the smallest change."""
    drive, tables = study.drive, study.source.tables["drive"]
    sensor = drive.position_sensor
    loop_table = tables["current_loop"]
    if "bandwidth" in loop_table:
        yield [
            {"drive.current_loop.bandwidth": _divided(loop_table["bandwidth"], 1 / up)}
            for up in FASTER_FACTORS
        ]
    if isinstance(sensor, Counted) and sensor.observer_bandwidth:
        key, value = "drive.position_sensor.observer_bandwidth", sensor.observer_bandwidth
        yield [{key: unit_text(value * up, "Hz")} for up in FASTER_FACTORS]
    if drive.speed_filter:
        yield [{"drive.speed_filter": unit_text(drive.speed_filter * up, "Hz")} for up in FASTER_FACTORS]
    if isinstance(sensor, Counted) and sensor.speed_method == "average":
        key, window = "drive.position_sensor.window", sensor.window
        yield [{key: max(1, int(window / up))} for up in FASTER_FACTORS if window > 1]


def _softer(study: Study, name: str, cured: Callable[[Study], bool]) -> Changes | None:
    """The change to the largest phase margin, in whole degrees, that the rule can reach; None if none."""
    tuning = getattr(study.controller[name], "tuning", None)
    if tuning is None:
        return None
    key = dotted(("controller", name, "tuning", "phase_margin"))

    def change(degrees: int) -> Changes:
        return {key: f"{degrees} deg"}

    low, high = LEAST_MARGIN, math.ceil(math.degrees(tuning.phase_margin))
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if helps(study, change(middle), cured) else (low, middle)
    return change(low) if low > LEAST_MARGIN else None


def _weak(study: Study) -> bool:
    """Whether the current loop of one axis is too weak for a speed loop around it."""
    return any(weakness(loop.margins()) for loop in current_loops(study).values())


def _divided(value: Any, factor: float) -> Any:
    """A value divided by a factor; the value is a number, or a text of number and unit."""
    if isinstance(value, str):
        unit = unit_of(value)
        return unit_text(float(value.removesuffix(unit)) / factor, unit)
    return float(f"{value / factor:.3g}")


LEAST_DAMPING = 1e-6  # least damping ratio that the design assumes for a soft shaft
RESONANCE_DISTANCES = np.geomspace(0.01, 1e3, 300)  # distances from a resonance, in widths of the resonance


@dataclass(frozen=True)
class SoftShaft:
    """A soft shaft between motor and load, seen from the motor; a gap in it counts as closed."""

    inertia: float  # kg*m^2, of the motor's side
    load_inertia: float  # kg*m^2
    stiffness: float  # N*m/rad
    damping: float  # N*m*s/rad
    on_load: bool = False  # the position sensor is on the load's side

    @property
    def antiresonance(self) -> float:
        """Undamped frequency at which the load holds the motor, rad/s."""
        return math.sqrt(self.stiffness / self.load_inertia)

    @property
    def resonance(self) -> float:
        """Undamped frequency of both masses, rad/s."""
        return math.sqrt(self.stiffness * (1 / self.inertia + 1 / self.load_inertia))

    @property
    def damping_in_design(self) -> float:
        """The damping, N m s/rad, but at least so much that no pole is on the unit circle."""
        parallel = 1 / (1 / self.inertia + 1 / self.load_inertia)
        return max(self.damping, 2 * LEAST_DAMPING * math.sqrt(self.stiffness * parallel))

    def near(self, period: float) -> Real:
        """Frequencies around resonance and antiresonance, rad/s, below half the sampling rate."""
        frequencies = []
        for w, inertia in (
            (self.antiresonance, self.load_inertia),
            (self.resonance, 1 / (1 / self.inertia + 1 / self.load_inertia)),
        ):
            width = self.damping_in_design / (2 * inertia)
            folded = abs((w + math.pi / period) % (TURN / period) - math.pi / period)
            frequencies.append(
                folded + width * np.concatenate([-RESONANCE_DISTANCES, [0.0], RESONANCE_DISTANCES])
            )
        return np.concatenate(frequencies)

    def rates(self, b: float) -> Real:
        """Rates of change of i, omega, theta, load's speed and angle, from these and the voltage.

        `b`: acceleration per current of both masses together, rad/s^2/A.
        """
        d, k = self.damping_in_design, self.stiffness
        torque = np.array([0, -d, -k, d, k, 0.0])
        matrix = np.zeros((6, 6))
        matrix[1], matrix[3] = torque / self.inertia, -torque / self.load_inertia
        matrix[1, 0] = b * (self.inertia + self.load_inertia) / self.inertia
        matrix[2, 1] = matrix[4, 3] = 1.0
        return matrix


def soft_shaft(study: Study) -> SoftShaft | None:
    """The shaft to a study's load side, with the load seen from the motor; None if there is none."""
    side, inertia = study.mechanics.load_side, study.mechanics.inertia
    if side is None:
        return None
    seen = 1 / side.ratio**2
    on_load = study.drive.position_sensor.side == "load"
    return SoftShaft(inertia, side.inertia * seen, side.stiffness * seen, side.damping * seen, on_load)


def observer_step(bandwidth: float, period: float) -> tuple[Real, Real]:
    """M and l of x' = M x + l theta_m', a step of the observer of x = (theta, T omega, T^2 alpha).

    `bandwidth`: of the three poles, rad/s. `period`: of the observer, T in s.
    """
    p = math.exp(-bandwidth * period)
    gains = np.array([1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p), (1 - p) ** 3])
    predict = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]])
    return predict - np.outer(gains, predict[0]), gains


def observed(w: Real, bandwidth: float, period: float) -> Complex:
    """Response from the sampled angle to the observed speed, 1/s, at w in rad/s."""
    step, gains = observer_step(bandwidth, period)
    z = np.exp(1j * np.asarray(w) * period)
    x = np.linalg.solve(
        np.eye(3) - step / z[..., None, None], np.broadcast_to(gains[:, None], (*z.shape, 3, 1))
    )
    return np.asarray(x[..., 1, 0] / period)


def counting_window(bandwidth: float, period: float) -> float:
    """Length, s, of a counting window whose speed is as noisy as the observer's, from the same steps."""
    circle = np.linspace(0, math.pi / period, 4097)
    return math.sqrt(
        2 / float(np.trapezoid(np.abs(observed(circle, bandwidth, period)) ** 2, circle) / circle[-1])
    )


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
    current: CurrentLoop | IdealLoop  # loop of the q axis
    bandwidth: float = 0.0  # rad/s, of an observer of the angle that gives the speed; 0: none
    delay: float = 0.0  # s, by which angle and speed are older, and the current reference acts later
    low_pass: float = 0.0  # rad/s, of a filter behind the speed; 0: none
    is_held: bool = False  # the speed before the filter is computed once per speed-loop period
    shaft: SoftShaft | None = None  # none: rigid
    edge: float = 0.0  # s between the edges of Hall sensors; 0: no time between them is modelled
    edges: int = 0  # intervals between edges that the speed is taken over

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
        """Indices in x of the speed and the angle that the position sensor measures."""
        return (5, 6) if self.shaft is not None and self.shaft.on_load else (OMEGA, THETA)

    @property
    def measures_speed(self) -> bool:
        """Whether the speed is measured itself, not computed from angles."""
        return not (self.window or self.bandwidth or self.edge)

    @property
    def rigid(self) -> SpeedLoop:
        """The speed loop with both masses as one."""
        return dataclasses.replace(self, shaft=None)

    @property
    def near(self) -> Real | None:
        """Frequencies around the resonances of a soft shaft, rad/s; None: it is rigid."""
        return None if self.shaft is None else self.shaft.near(self.period)

    def driven(self, w: Real) -> Complex:
        """Response of the motor's speed to a torque, as the current that makes it, at w in rad/s."""
        if self.shaft is None:
            return np.asarray(self.b / (1j * w))
        rates = self.shaft.rates(self.b)[1:5]  # of the motor's speed and angle, then the load's
        free = 1j * np.asarray(w)[:, None, None] * np.eye(4) - rates[:, 1:5]
        return np.asarray(np.linalg.solve(free, np.broadcast_to(rates[:, :1], (len(w), 4, 1)))[:, 0, 0])

    def plant(self, w: Real) -> tuple[Complex, Complex]:
        """P(jw), from current reference to measured speed, and the response to the sampled angle, rad/A."""
        if len(w) == 1:  # a step of a search: a frequency that comes only once
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
        if self.measures_speed:
            return np.asarray(x[:, omega]), np.asarray(x[:, theta])
        samples = -(-self.window // self.steps)
        then = self.step_of(samples * self.steps - self.window)[theta]
        theta_then = (x @ then[:states] + then[states]) / z**samples
        turned = x[:, theta] - theta_then
        return np.asarray(turned / (self.window * self.current.period)), np.asarray(x[:, theta])

    def _filter(self, w: Real) -> Complex:
        """Response of the speed's low-pass, which runs at the current loop's rate.

        A held speed stays for N steps of the low-pass, and changes in the step before the law's sample.
        """
        p, N = math.exp(-self.low_pass * self.current.period), self.steps
        if not self.is_held:
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
    intervals. The responses leave out the aliases of
    frequencies beyond half of the edges' rate.
    """
    s = 1j * w
    hold = (1 - np.exp(-s * T_e)) / (s * T_e)
    speed = (1 - np.exp(-s * edges * T_e)) / (edges * T_e)
    ramp = (hold - np.exp(-s * T_e)) / s
    return np.asarray(speed * hold), np.asarray(hold + speed * ramp)


@lru_cache(maxsize=16)  # the same for all gains that are tried
def _on_grid(loop: SpeedLoop, frequencies: bytes) -> tuple[Complex, Complex]:
    """The plant at frequencies in rad/s, as bytes of an array so that they can be a cache key."""
    speed, theta = loop._plant(np.frombuffer(frequencies))
    speed.flags.writeable = theta.flags.writeable = False
    return speed, theta


@lru_cache(maxsize=32)  # the same at all speeds of a reference, whatever the sensor's edges
def _steps(
    b: float, loop: CurrentLoop | IdealLoop, shaft: SoftShaft | None, states: int, periods: int
) -> Real:
    """The matrix that takes (x, i_ref) to their values so many current-loop periods later."""
    matrix = np.asarray(np.linalg.matrix_power(_step(b, loop, shaft, states), periods))
    matrix.flags.writeable = False
    return matrix


def _step(b: float, loop: CurrentLoop | IdealLoop, shaft: SoftShaft | None, states: int) -> Real:
    """The matrix that takes (x, i_ref) to their values one current-loop period later."""
    T, reference, size = loop.period, states, states + 1
    moving = [CURRENT, *range(OMEGA, reference)]
    count = len(moving)
    rates = np.zeros((count + 1, count + 1))  # rates of change of the moving states, under a constant voltage
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
            transition = exponential(rates[:count, :count] * T)
            step[np.ix_(moving[1:], moving[1:])] = transition[1:, 1:]
            step[moving[1:], reference] = transition[1:, 0]
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

    With a scenario, the torque per current is the mean of the true motor. Otherwise it follows from the flux
    that the controller assumes.
    """
    return study.once(_speed_loop, scenario)


def _speed_loop(study: Study, scenario: str | None) -> SpeedLoop:
    study_here = study if scenario is None else for_scenario(study, scenario)
    rates, sensor, motor = study_here.drive.rates, study_here.drive.position_sensor, study_here.motor.star()
    K_t = motor.K_t if scenario is not None else study.K_t
    bus = study_here.drive.bus
    window = sensor.periods(rates.divider) if isinstance(sensor, Counted) else 0
    if isinstance(sensor, Hall):
        window = rates.divider  # the least: warnings.py warns where edges come more rarely
    delay = sensor.latency if isinstance(sensor, Counted) else 0.0
    return SpeedLoop(
        b=K_t / study_here.mechanics.stiff.inertia,
        steps=rates.divider,
        window=window,
        current=current_loops(study, scenario).get("q") or IdealLoop(1 / rates.current_loop),
        bandwidth=sensor.bandwidth if isinstance(sensor, Counted) else 0.0,
        delay=delay + (bus.mean_delay if bus is not None else 0.0),
        low_pass=math.tau * (study_here.drive.speed_filter or 0.0),
        is_held=isinstance(sensor, Counted) and sensor.each_law_period,
        shaft=soft_shaft(study_here),
    )


def gains(study: Study, name: str) -> tuple[float, float]:
    """kp and ki of a controller of the study: as given there, or from its tuning rule."""
    own_gains = study.controller[name].given_pi
    if own_gains is not None:
        return own_gains
    design = tuned(
        study, name, lambda study: phase_margin_pi(speed_loop(study).rigid, tuning_of(study, name))
    )
    return design.kp, design.ki


def tuning_of(study: Study, name: str) -> Tuning:
    """The tuning rule of a controller, which must have one."""
    rule = study.controller[name].rule
    assert rule is not None
    return rule


@lru_cache(maxsize=32)
def phase_margin_pi(loop: SpeedLoop, tuning: Tuning) -> PiDesign:
    """PI gains for a phase margin; NoMarginError if no crossover below half the sampling rate has it."""
    x = root(lambda x: math.atan(x) - x / (1 + x * x) - tuning.phase_margin, 1e-3, 1e3)
    half = loop.period / 2
    for w in (_substituted(loop, x), _bisected(loop, x)):
        if w is None:
            continue
        ki = math.tan(w * half) / (half * x)  # k_i where K is 1
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
    crossover_lag = x / (1 + x * x)
    w = np.geomspace(1e-3, 1, FREQUENCY_POINTS) * math.pi / loop.period
    lag = np.unwrap(_lag(loop, w))
    rises = np.flatnonzero((lag[:-1] < crossover_lag) & (lag[1:] >= crossover_lag))
    if not len(rises):
        return None
    k = int(rises[0])
    return root(lambda w: float(_lag(loop, np.array([w]))[0]) - crossover_lag, float(w[k]), float(w[k + 1]))


def margins(loop: SpeedLoop, kp: float, ki: float) -> Margins:
    """Margins of a speed loop with given gains; if its current loop is unstable, `stable` is False."""
    if isinstance(loop.current, CurrentLoop) and not loop.current.margins().stable:
        return UNSTABLE
    integrators = 1 + (ki > 0) if kp or ki else 0
    return margins_of(lambda w: loop.response(w, kp, ki), loop.period, integrators, loop.near)
