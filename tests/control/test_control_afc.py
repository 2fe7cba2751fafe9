"""PI with adaptive feedforward cancellation: agreement with the reference, and what the law does."""

import math

import numpy as np
import pytest
from control_library import SOURCE, control_library
from reference.motion import motion, rounded
from reference.pi import Pi
from reference.pi_afc import PiAfc

from cogless.study.laws.pi_afc import PI_AFC_ORDER_MAX, PI_AFC_ORDERS

TS, STEPS = 1e-3, 1500
pytestmark = pytest.mark.filterwarnings("ignore:invalid value encountered")


class CPiAfc:
    """The C law, configured as its reference is."""

    def __init__(self, library, r: PiAfc):
        self.library, lib = library, library.lib
        gains = {name: getattr(r, name) for name in ("gain", "lead", "omega_min", "limit")}
        orders = [int(h) for h in r.orders]
        pi = {name: getattr(r.pi, name) for name in ("kp", "ki", "limit")}
        self.config = library.new("cgl_pi_afc_config", pi=pi, orders=len(orders), order=orders, **gains)
        self.state = library.new("cgl_pi_afc")
        self.memory, pointer = library.array(np.ones(3 * len(orders)))
        assert (
            lib.cgl_pi_afc_init(self.state, self.config, library.loop(r.pi.ts), pointer, 3 * len(orders))
            == lib.CGL_OK
        )
        self.input, self.output = library.new("cgl_law_input"), library.new("cgl_law_output")

    def step(self, omega_ref: float, omega_m: float, theta_m: float, learn: bool = True) -> float:
        i = self.input
        i.omega_ref, i.omega_m, i.theta_m, i.learn = omega_ref, omega_m, theta_m, learn
        self.library.lib.cgl_pi_afc_step(self.state, i, self.output)
        return self.output.i_q_ref


def law(orders, gain=4.0, lead=4e-3, limit=1.0, pi=(0.1, 1.0, 2.0), real=np.float64) -> PiAfc:
    kp, ki, most, ts, gain, lead, omega_min, limit = rounded([*pi, TS, gain, lead, 0.5, limit], real)
    return PiAfc(Pi(kp, ki, ts, most), np.array(orders, dtype=float), gain, lead, omega_min, limit)


def random_law(rng, real) -> PiAfc:
    orders = np.sort(rng.choice(np.arange(1, 200), int(rng.integers(1, 17)), replace=False))
    lead = float(rng.choice([0.0, rng.uniform(1e-4, 5e-3)]))
    pi = (rng.uniform(0.05, 0.4), rng.uniform(0.1, 3), rng.uniform(1, 4))
    return law(orders, rng.uniform(0.1, 5), lead, rng.uniform(0.3, 2), pi, real)


def inputs(rng, real, faults):
    m = motion(rng, STEPS, TS, faults)
    shocks = np.repeat(rng.choice([0.0, 0.0, 15.0, -15.0], STEPS // 100), 100)  # into saturation and back
    columns = [rounded(x, real).tolist() for x in (m.omega_ref, m.omega_m - shocks, m.theta_m)]
    return list(zip(*columns, m.learn.tolist(), strict=True))


def status(lib, r: PiAfc, omega_ref, omega_m, theta_m, learn):
    fault = not (math.isfinite(omega_ref - omega_m) and abs(theta_m) < 1e5)
    return (
        lib.CGL_STATUS_SATURATED * r.pi.saturated
        | lib.CGL_STATUS_FROZEN * (not r.learning)
        | lib.CGL_STATUS_FAULT * fault
    )


@pytest.mark.parametrize("seed", range(6))
def test_double_equals_the_reference(seed):
    rng, library = np.random.default_rng(seed), control_library("double")
    reference = random_law(rng, np.float64)
    c, n_orders = CPiAfc(library, reference), len(reference.orders)
    bound = 1e-11 * (reference.pi.limit + n_orders * reference.limit)  # sines of angles up to 1300 rad
    seen = set()
    for n, one in enumerate(inputs(rng, np.float64, 0.003)):
        got, expected = c.step(*one), reference.step(*one)
        assert abs(got - expected) <= bound, n
        assert c.output.status == status(library.lib, reference, *one), n
        seen.add(c.output.status)
    learned = np.concatenate([reference.a, reference.b])
    assert np.abs(c.memory[: 2 * n_orders] - learned).max() <= bound
    assert {0, 1, 4} <= {s & 5 for s in seen} and np.abs(learned).max() > 0.01


@pytest.mark.parametrize("seed", range(6))
def test_single_stays_within_rounding(seed):
    """A sine of order h is off by h times the rounding of an angle; coefficients walk by that of what they
    add and of themselves. Where the output lies within rounding of its limit the two may part for a reason;
    there the comparison ends, and that has to come late."""
    rng, library = np.random.default_rng(200 + seed), control_library("float")
    reference = random_law(rng, np.float32)
    c, h = CPiAfc(library, reference), reference.orders
    scale = reference.pi.limit + 20 * reference.pi.kp
    added = reference.gain * TS * 20 * (8 + 7 * h)  # a step, times the error of its sine in eps
    compared = 0
    for n, one in enumerate(inputs(rng, np.float32, 0.0)):
        coefficients = np.sum(reference.limit * (16 + 14 * h) + math.sqrt(n) * (added + reference.limit))
        walk = 20 * reference.pi.ki * TS * math.sqrt(n)
        bound = library.eps * (8 * scale + 2 * walk + coefficients)
        got, expected = c.step(*one), reference.step(*one)
        assert abs(got - expected) <= bound, n
        if c.output.status != status(library.lib, reference, *one):
            assert abs(abs(expected) - reference.pi.limit) <= bound
            break
        compared += 1
    assert compared > STEPS / 2


class Motor:
    """Inertia under a current, with torque ripple at some orders, A, and a measured speed that is late."""

    def __init__(self, speed, ripple, b=400.0, delay=2, theta=0.3):
        self.theta, self.omega, self.ripple, self.b = theta, speed, ripple, b
        self.late = [speed] * (delay + 1)

    def move(self, i):
        i += sum(x * math.cos(h * self.theta + phase) for h, x, phase in self.ripple)
        self.theta += TS * (self.omega + TS * self.b * i / 2)
        self.omega += TS * self.b * i
        self.late = [*self.late[1:], self.omega]


def run(one, motor, speed, seconds):
    """Speeds of the motor under a law."""
    speeds = []
    for _ in range(int(seconds / TS)):
        speeds.append(motor.omega)
        motor.move(one.step(speed, motor.late[0], motor.theta % math.tau))
    return np.array(speeds)


RIPPLE = ((6, 0.3, 0.4), (24, 0.2, -1.0))


@pytest.mark.parametrize(
    "orders",
    [
        [12, 18, 24, 36, 54, 72, 90, 108, 144, 216, 288, 360, 432],
        [27 * k for k in range(1, 17)],
        [1, 2, 4, 8, 16, 32, 64, 128, 256, 420],
        [1, 419, 420],
    ],
)
def test_products_of_phasors_are_as_exact_as_the_angle(orders: list[int]) -> None:
    """angle.h: order h is off by at most h 2.9e-7; the angle itself is rounded twice, to 2^-25 of a turn."""
    c = CPiAfc(control_library("float"), law(orders, gain=0.0, real=np.float32))
    h, size = np.array(orders), 0.03
    c.memory[: 2 * len(h)] = size
    bound = size * float(np.sum(h * (2.9e-7 + 2 * math.tau * 2**-25))) + 1e-6
    for theta in np.random.default_rng(420).uniform(0, math.tau, 300).astype(np.float32).tolist():
        c.step(1.0, 1.0, theta, learn=False)
        exact = np.float32(size) * np.sum(np.cos(h * theta) + np.sin(h * theta))
        assert abs(c.state.learned - exact) < bound


@pytest.mark.parametrize("speed", [10.0, -10.0])
def test_chosen_orders_go_and_others_stay(speed):
    library = control_library("float")
    pi = (0.2, 5.0, 10.0)
    without, alone, both = law([24], 0.0, pi=pi), law([6], pi=pi), law([6, 24], pi=pi)
    each = (run(CPiAfc(library, one), Motor(speed, RIPPLE), speed, 4.0) for one in (without, alone, both))
    left = [np.std(speeds[-700:]) for speeds in each]
    assert left[0] > 0.5
    assert left[2] < 1e-3 * left[0] and 0.2 * left[0] < left[1] < 0.9 * left[0]


def test_coefficients_are_those_of_the_ripple():
    c = CPiAfc(control_library("double"), law([6, 24], pi=(0.2, 5.0, 10.0)))
    run(c, Motor(10.0, RIPPLE), 10.0, 4.0)
    expected = [-x * np.exp(-1j * phase) for _, x, phase in RIPPLE]
    assert c.memory[:2] + 1j * c.memory[2:4] == pytest.approx(np.array(expected), rel=1e-3)
    assert list(c.memory[4:]) == [6.0, 24.0]


def test_a_delay_needs_its_lead():
    """At 40 Hz 6 samples are a quarter turn, and inertia is another: without a lead the ripple grows."""
    library, ripple = control_library("float"), ((24, 0.2, -1.0),)
    left = {}
    for lead in (0.0, 10e-3):
        c = CPiAfc(library, law([24], 2.0, lead, pi=(0.01, 0.0, 10.0)))
        left[lead] = np.std(run(c, Motor(10.5, ripple, delay=6), 10.5, 5.0)[-500:])
    assert left[10e-3] < 0.01 and left[0.0] > 1.0


def test_a_resonator_at_the_order_at_constant_speed():
    """What Messner and Bodson show, sampled: g (cos l - cos(W - l) / z) / (1 - 2 cos W / z + 1 / z^2)."""
    omega, h, gain, lead = 10.0, 24, 2.0, 2e-3
    W, turned = h * omega * TS, h * omega * lead
    c = CPiAfc(control_library("double"), law([h], gain, lead, limit=1e3, pi=(0.0, 0.0, 1e4)))
    rng = np.random.default_rng(1)
    error, u = rng.normal(size=400), np.zeros(402)
    for n in range(400):
        before = error[n - 1] if n else 0.0
        new = gain * TS * (math.cos(turned) * error[n] - math.cos(W - turned) * before)
        u[n] = 2 * math.cos(W) * u[n - 1] - u[n - 2] + new
        got = c.step(omega, omega - error[n], (omega * TS * n + 0.7) % math.tau)
        assert got == pytest.approx(u[n], abs=1e-9)


@pytest.mark.parametrize("precision", ["float", "double"])
def test_what_is_frozen_stays_and_acts_on(precision):
    library = control_library(precision)
    c, lib = CPiAfc(library, law([3, 7])), library.lib
    run(c, Motor(10.0, ((3, 0.3, 0.0),)), 10.0, 1.0)
    kept, frozen = c.memory.copy(), lib.CGL_STATUS_FROZEN
    c.step(10.0, 10.0, 0.3, False)
    acting = c.state.learned
    assert acting != 0.0 and c.output.status == frozen and not c.state.learning
    bad = [(math.nan, 10.0, 0.3), (10.0, math.inf, 0.3), (0.4, 0.0, 0.3)]
    for omega_ref, omega_m, theta_m in bad:
        c.step(omega_ref, omega_m, theta_m)
        assert c.output.status & frozen and c.state.learned == acting
    c.step(10.0, 9.0, math.nan)
    assert c.output.status == frozen | lib.CGL_STATUS_FAULT and c.state.learned == 0.0
    assert np.array_equal(c.memory, kept)


def test_an_order_above_half_the_rate_rests():
    """At 100 rad/s and 1 kHz order 31 has 2.03 samples, order 32 has 1.96."""
    c = CPiAfc(control_library("double"), law([31, 32]))
    for n in range(50):
        c.step(100.0, 99.0 - math.cos(3 * n), 0.1 * n % math.tau)
    assert c.memory[0] != 0.0 and c.memory[2] != 0.0
    assert c.memory[1] == 0.0 and c.memory[3] == 0.0
    c.memory[1] = 0.5  # learned at a lower speed
    c.step(100.0, 100.0, 0.0, False)
    assert c.state.learned == c.memory[0]
    c.step(50.0, 50.0, 0.0, False)
    assert c.state.learned == c.memory[0] + 0.5


def test_a_reset_forgets_all_but_the_orders():
    library = control_library("float")
    c, fresh = CPiAfc(library, law([3, 7])), CPiAfc(library, law([3, 7]))
    run(c, Motor(10.0, ((3, 0.3, 0.0),)), 10.0, 0.5)
    library.lib.cgl_pi_afc_reset(c.state)
    assert list(c.memory) == [0, 0, 0, 0, 3, 7] == list(fresh.memory)
    rng = np.random.default_rng(3)
    for one in inputs(rng, np.float32, 0.003)[:500]:
        assert c.step(*one) == fresh.step(*one)


def test_a_study_takes_as_many_orders_as_the_law() -> None:
    header = (SOURCE / "cogless" / "pi_afc.h").read_text(encoding="utf-8")
    assert (
        f"CGL_PI_AFC_ORDERS {PI_AFC_ORDERS}U\n" in header
        and f"CGL_PI_AFC_ORDER_MAX {PI_AFC_ORDER_MAX}U\n" in header
    )


def test_coefficients_stay_within_their_limit_for_any_error():
    c = CPiAfc(control_library("float"), law([1, 2, 5], gain=1e5, limit=0.25, pi=(0.0, 0.0, 5.0)))
    rng = np.random.default_rng(4)
    for n in range(2000):
        error = rng.choice([1e30, -1e30, 1e38, 1.0])
        assert abs(c.step(10.0, 10.0 - error, 0.01 * n % math.tau)) <= 5.0
        assert abs(c.state.learned) <= 0.25 and np.abs(c.memory[:6]).max() <= 0.25
    assert np.abs(c.memory[:6]).max() == 0.25
