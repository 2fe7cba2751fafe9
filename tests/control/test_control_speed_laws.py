"""PI-ILC and robust ILC of the C library: agreement with the reference, and what the laws do."""

import dataclasses
import math

import numpy as np
import pytest
from control_library import control_library
from reference.memory import AngleMemory, DelayLine
from reference.motion import motion, rounded
from reference.pi import Pi
from reference.pi_ilc import PiIlc
from reference.robust_ilc import RobustIlc
from test_control_memory import TS, cells_needed, memory_config

STEPS = 1500
TERMS = ("surface", "switching", "linear", "learned", "adapted")
pytestmark = pytest.mark.filterwarnings("ignore:invalid value encountered")


class CLaw:
    """A C law, configured as its reference is."""

    def __init__(self, library, reference: PiIlc | RobustIlc):
        self.library, lib = library, library.lib
        memory = memory_config(library, reference.memory)
        if isinstance(reference, PiIlc):
            pi = {name: getattr(reference.pi, name) for name in ("kp", "ki", "limit")}
            self.config = library.new("cgl_pi_ilc_config", pi=pi, gain=reference.gain, memory=memory)
            self.state, init, ts = library.new("cgl_pi_ilc"), lib.cgl_pi_ilc_init, reference.pi.ts
            self.c_step = lib.cgl_pi_ilc_step
        else:
            gains = {f.name: getattr(reference, f.name) for f in dataclasses.fields(reference)[:12]}
            ts = gains.pop("ts")
            self.config = library.new("cgl_robust_ilc_config", memory=memory, **gains)
            self.state, init = library.new("cgl_robust_ilc"), lib.cgl_robust_ilc_init
            self.c_step = lib.cgl_robust_ilc_step
        length = cells_needed(reference.memory)
        self.cell, pointer = library.array(np.zeros(length))
        assert init(self.state, self.config, library.loop(ts), pointer, length) == lib.CGL_OK
        self.input, self.output = library.new("cgl_law_input"), library.new("cgl_law_output")

    def step(self, omega_ref: float, omega_m: float, theta_m: float, learn: bool = True) -> float:
        i = self.input
        i.omega_ref, i.omega_m, i.theta_m, i.learn = omega_ref, omega_m, theta_m, learn
        self.c_step(self.state, i, self.output)
        return self.output.i_q_ref

    @property
    def terms(self) -> dict[str, float]:
        return {name: getattr(self.state.terms, name) for name in TERMS}


def random_memory(rng, kind, limit, real):
    forgetting, limit = rounded([rng.choice([1.0, 0.85]), limit], real).tolist()
    sizes = {
        "parts": int(rng.choice([1, 4])), "q_half_width": int(rng.choice([0, 2, 7])),
        "forgetting": forgetting,
        "limit": [limit], "lead": int(rng.choice([0, 3])), "real": float if real is np.float64 else real,
    }  # fmt: skip
    if kind == "angle":
        return AngleMemory(cells=int(rng.choice([16, 60, 256])), **sizes)
    return DelayLine(kind="time", ts=float(real(TS)), cells=int(rng.choice([400, 1500])), **sizes)


def random_law(rng, law, kind, real) -> PiIlc | RobustIlc:
    def draw(*ranges):
        return rounded([rng.uniform(*r) for r in ranges], real)

    if law == "pi-ilc":
        kp, ki, limit, gain, learned = draw((0.05, 0.4), (0.1, 3), (1, 4), (0.01, 0.1), (0.3, 2))
        return PiIlc(Pi(kp, ki, float(real(TS)), limit), gain, random_memory(rng, kind, learned, real))
    gains = draw((200, 600), (1, 10), (0, 60), (50, 300), (0, 0.5), (0, 5), (0, 5), (0, 500), (0, 5), (0, 50))
    limit, learned = draw((1, 4), (50, 300))
    return RobustIlc(*gains, float(real(TS)), limit, random_memory(rng, kind, learned, real))


def inputs(rng, real, faults):
    m = motion(rng, STEPS, TS, faults)
    shocks = np.repeat(rng.choice([0.0, 0.0, 15.0, -15.0], STEPS // 100), 100)  # into saturation and back
    columns = [rounded(x, real).tolist() for x in (m.omega_ref, m.omega_m - shocks, m.theta_m)]
    return list(zip(*columns, m.learn.tolist(), strict=True))


def status(library, reference, omega_ref, omega_m, theta_m, learn):
    lib = library.lib
    saturated = reference.pi.saturated if isinstance(reference, PiIlc) else reference.saturated
    fault = not (math.isfinite(omega_ref - omega_m) and abs(theta_m) < 1e5)
    return (
        lib.CGL_STATUS_SATURATED * saturated
        | lib.CGL_STATUS_FROZEN * (not reference.learning)
        | lib.CGL_STATUS_FAULT * fault
    )


@pytest.mark.parametrize("law", ["pi-ilc", "robust-ilc"])
@pytest.mark.parametrize("kind", ["angle", "time"])
@pytest.mark.parametrize("seed", range(4))
def test_double_equals_the_reference(law, kind, seed):
    rng = np.random.default_rng(seed)
    library = control_library("double")
    reference = random_law(rng, law, kind, np.float64)
    c = CLaw(library, reference)
    limit = reference.pi.limit if law == "pi-ilc" else reference.limit
    seen = set()
    for n, one in enumerate(inputs(rng, np.float64, 0.003)):
        got, expected = c.step(*one), reference.step(*one)
        assert abs(got - expected) <= 1e-12 * limit, n
        assert c.output.status == status(library, reference, *one), n
        seen.add(c.output.status)
        if law == "robust-ilc":
            for name, value in c.terms.items():
                bound = 1e-12 * max(limit, abs(reference.terms[name]))
                assert abs(value - reference.terms[name]) <= bound, (n, name)
    assert {0, 1, 4} <= {s & 5 for s in seen}


@pytest.mark.parametrize("law", ["pi-ilc", "robust-ilc"])
@pytest.mark.parametrize("kind", ["angle", "time"])
@pytest.mark.parametrize("seed", range(4))
def test_single_stays_within_rounding(law, kind, seed):
    """The walks of the PI's test (integrals: eps per step, at random) and of the memory's test (place, once
    a period) together. A law also decides: it freezes at its limit, and switches with the sign of S. Where
    the values lie within rounding of a decision, the two part for a reason; there the comparison ends, and
    that has to come late."""
    rng = np.random.default_rng(200 + seed)
    library = control_library("float")
    reference = random_law(rng, law, kind, np.float32)
    c = CLaw(library, reference)
    m = reference.memory
    places = 4 + 2 * m.q_half_width if kind == "angle" else m.cells
    if law == "pi-ilc":
        scale = reference.pi.limit + 20 * reference.pi.kp
        learned = m.limit[0]
    else:
        scale = reference.limit + (20 * (reference.c + reference.eta) + 40 / TS) / reference.b
        learned = m.limit[0] / reference.b
    compared = 0
    for n, one in enumerate(inputs(rng, np.float32, 0.0)):
        bound = library.eps * (scale * (8 + 2 * math.sqrt(n)) + learned * 4 * places * math.sqrt(1 + n / 30))
        got, expected = c.step(*one), reference.step(*one)
        if law == "robust-ilc" and (c.terms["switching"] > 0) != (reference.terms["switching"] > 0):
            assert abs(reference.terms["linear"]) <= bound
            break
        assert abs(got - expected) <= bound, n
        if c.output.status != status(library, reference, *one):
            assert abs(abs(expected) - (reference.pi.limit if law == "pi-ilc" else reference.limit)) <= bound
            break
        compared += 1
    assert compared > STEPS / 2


@pytest.mark.parametrize("precision", ["float", "double"])
def test_terms_sum_to_the_output(precision):
    rng = np.random.default_rng(5)
    library = control_library(precision)
    c = CLaw(library, random_law(rng, "robust-ilc", "angle", library.real))
    limit = c.config.limit
    free = 0
    for one in inputs(rng, library.real, 0.003):
        got = c.step(*one)
        total = sum(c.terms.values())
        scale = limit + sum(map(abs, c.terms.values()))
        assert abs(got - min(max(total, -limit), limit)) <= 4 * library.eps * scale
        free += abs(total) < limit
    assert free > STEPS / 3


def test_a_gap_in_the_measurement_leaves_no_spike_of_acceleration():
    """A reference that ramps on behind 50 lost samples is not a jump of one sample."""
    law = RobustIlc(400, 5, 0, 0, 0, 0, 0, 0, 0, 0, TS, 100.0, AngleMemory(cells=64, limit=[1.0]))
    c = CLaw(control_library("double"), law)
    outputs = [c.step(0.1 * n, math.nan if 100 <= n < 150 else 0.1 * n, 0.0) for n in range(300)]
    assert max(map(abs, outputs)) < 0.1 / TS / 400 * 1.000001


def test_adaptation_does_not_wind_up_at_the_limit():
    """(20) at the limit: S still pushes while the error already leads back; r must hold."""
    law = RobustIlc(400, 5, 0, 180, 0, 0, 0, 50.0, 0, 0, TS, 1.0, AngleMemory(cells=64, limit=[1.0]))
    c = CLaw(control_library("double"), law)
    c.step(0.0, 0.0, 0.0)
    c.state.error_integral = 10.0
    for _ in range(100):
        assert c.step(0.0, 0.001, 0.0) == 1.0
    assert c.state.adapted == 0.0
    assert c.state.error_integral < 10.0


def closed_loop(law, periods: int, samples: int, a: float, b: float, disturbance: np.ndarray) -> np.ndarray:
    """Speed errors (period, sample) of the sampled first-order plant omega+ = a omega + b (u - d) at a
    constant reference."""
    omega_ref = 2 * math.pi / (samples * TS)
    omega, errors = omega_ref, np.zeros(periods * samples)
    for n in range(periods * samples):
        errors[n] = omega_ref - omega
        u = law.step(omega_ref, omega, 0.0)
        omega = a * (omega - omega_ref) + b * (u - disturbance[n % samples]) + omega_ref
    return errors.reshape(periods, samples)


A, B, KP, KI, GAIN, SAMPLES = 0.98, 0.4, 0.5, 5.0, 1.2, 50


def loop() -> np.ndarray:
    """G = P / (1 + P C), u to omega with the PI closed, at each harmonic."""
    z = np.exp(2j * np.pi * np.arange(1, SAMPLES // 2 + 1) / SAMPLES)
    plant = B / (z - A)
    return plant / (1 + plant * (KP + KI * TS * z / (z - 1)))


def contraction(forgetting: float) -> np.ndarray:
    """|E_{k+1} / E_k| of each harmonic under (29): E = E_pi - G u and u_{k+1} = forgetting u_k + gain
    E_{k+1} give E_{k+1} = forgetting E_k / (1 + gain G) and a part that does not change with k."""
    return forgetting / abs(1 + GAIN * loop())


def ilc(precision: str, forgetting: float) -> CLaw:
    memory = DelayLine(kind="time", ts=TS, cells=SAMPLES + 10, forgetting=forgetting, limit=[1e6])
    return CLaw(control_library(precision), PiIlc(Pi(KP, KI, TS, 1e6), GAIN, memory))


def test_law_29_as_printed_diverges_at_the_rate_that_theory_gives():
    """Above some frequency the sampled plant turns by more than a right angle, 1 + gain G is shorter than
    one, and what little there is of that harmonic grows in every period, while the ripple at low orders
    already vanishes."""
    rate = contraction(1.0)
    assert rate[0] < 0.6 and rate.max() > 1.1
    disturbance = np.cos(2 * np.pi * np.arange(SAMPLES) / SAMPLES)
    errors = closed_loop(ilc("double", 1.0), 32, SAMPLES, A, B, disturbance)
    spectrum = abs(np.fft.rfft(errors, axis=1))
    worst = 1 + int(np.argmax(rate))
    assert spectrum[12, 1] < 1e-4 * spectrum[0, 1]  # learning seems to work
    growth = (spectrum[31, worst] / spectrum[16, worst]) ** (1 / 15)
    assert abs(growth - rate.max()) < 1e-3
    assert abs(errors[31]).max() > 100 * abs(errors[8]).max()


@pytest.mark.parametrize("precision", ["float", "double"])
def test_law_29_with_forgetting_converges(precision):
    """forgetting / |1 + gain G| is below one at every harmonic: the ripple settles, and the fundamental's
    share of that with the same PI alone is 1 / |1 + gain G / (1 - forgetting)|."""
    forgetting = 0.6
    assert contraction(forgetting).max() < 1
    disturbance = np.cos(2 * np.pi * np.arange(SAMPLES) / SAMPLES)
    errors = closed_loop(ilc(precision, forgetting), 150, SAMPLES, A, B, disturbance)
    pi = PiIlc(Pi(KP, KI, TS, 1e6), 0.0, DelayLine(kind="time", ts=TS, cells=60, limit=[1.0]))
    without = closed_loop(CLaw(control_library(precision), pi), 50, SAMPLES, A, B, disturbance)
    settled = 1e-9 if precision == "double" else 1e-4
    assert abs(errors[149] - errors[148]).max() < settled
    left = abs(np.fft.rfft(errors[149])[1] / np.fft.rfft(without[49])[1])
    assert abs(left - 1 / abs(1 + GAIN * loop()[0] / (1 - forgetting))) < 1e-3
    assert left < 0.5


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("memory", ["map", "line", "lead"])
def test_a_mean_goes_over_to_the_integral_unfelt(memory: str, precision: str) -> None:
    """Each period leaves 15/16 of the memory's mean, with any gains, and the speed does not change."""
    periods, load = 64, 0.5
    if memory == "line":
        learned: AngleMemory | DelayLine = DelayLine(kind="time", ts=TS, cells=SAMPLES + 10, limit=[2.0])
    else:
        learned = AngleMemory(cells=40, limit=[2.0], lead=2 * (memory == "lead"))
    for ki in (0.5, 50.0):
        law = CLaw(control_library(precision), PiIlc(Pi(KP, ki, TS, 9.0), 0.05, learned))
        law.cell[:] = load
        law.state.memory.line.known = SAMPLES + 11  # a line that is full of it
        omega_ref = 2 * math.pi / (SAMPLES * TS)
        omega, means, deviation = omega_ref, [], 0.0
        for n in range(periods * SAMPLES):
            u = law.step(omega_ref, omega, 2 * math.pi * (n % SAMPLES) / SAMPLES)
            omega += B * (u - load) / 10
            deviation = max(deviation, abs(omega - omega_ref))
            if n % SAMPLES == SAMPLES - 1:
                means.append(load - law.state.pi.integral)
        rate = (means[-1] / means[15]) ** (1 / (periods - 16))
        assert rate == pytest.approx(15 / 16, abs=0.01)
        assert means[-1] < 0.04 * load
        assert deviation < load / 16 / KP  # what a period takes away, at most


def test_without_an_integral_the_map_keeps_its_mean() -> None:
    memory = AngleMemory(cells=40, limit=[2.0])
    law = CLaw(control_library("double"), PiIlc(Pi(KP, 0.0, TS, 9.0), 0.05, memory))
    law.cell[:] = 0.5
    for n in range(64 * SAMPLES):
        assert law.step(9.0, 9.0, 2 * math.pi * (n % SAMPLES) / SAMPLES) == pytest.approx(0.5)


def test_learning_waits_for_its_permission_and_repeats_when_it_ends():
    library = control_library("double")
    c = CLaw(library, PiIlc(Pi(0.0, 0.0, TS, 10.0), 0.5, AngleMemory(cells=32, limit=[5.0])))
    for n in range(200):
        assert c.step(10.0, 9.0 + math.sin(0.05 * n), 0.05 * n, learn=False) == 0.0
        assert c.output.status == library.lib.CGL_STATUS_FROZEN
    for n in range(200, 500):
        c.step(10.0, 9.0 + math.sin(0.05 * n), 0.05 * n)
        assert c.output.status == 0
    before = c.cell.copy()
    once = [c.step(10.0, 0.0, 0.05 * n, learn=False) for n in range(500, 626)]
    assert np.array_equal(c.cell[:32], before[:32])  # the ring behind the map goes on
    assert np.ptp(once) > 0.5


def test_adaptation_adds_up_small_terms_beside_a_large_one():
    """gamma ts S is less than half of what a float tells apart at r = 5 rad/s^2."""
    library, steps = control_library("float"), 200_000
    memory = AngleMemory(cells=16, limit=[1.0])
    gains = dict.fromkeys(("c", "g", "eta", "q", "beta_1", "beta_2", "viscous", "coulomb"), 0.0)
    law = CLaw(library, RobustIlc(b=10.0, gamma=0.2, ts=TS, limit=20.0, memory=memory, **gains))
    law.state.adapted = 5.0
    assert library.real(5.0) + library.real(0.2 * TS * 0.001) == 5.0
    for _ in range(steps):
        law.step(0.001, 0.0, 0.0)
    assert law.state.adapted - 5.0 == pytest.approx(steps * 0.2 * TS * 0.001, rel=0.01)
