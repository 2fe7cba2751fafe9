"""The memory of the learning laws in the C library, by angle and by time."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from control_library import control_library
from reference.memory import AngleMemory, Recalled, TimeMemory
from reference.motion import motion, rounded

TS = 1e-3


def memory_config(library, memory: AngleMemory | TimeMemory) -> dict[str, Any]:
    by_angle = isinstance(memory, AngleMemory)
    kind = library.lib.CGL_MEMORY_ANGLE if by_angle else library.lib.CGL_MEMORY_TIME
    names = ("cells", "periods_per_rev", "q_half_width", "lead", "forgetting", "limit")
    return {"kind": kind} | {name: getattr(memory, name) for name in names}


class CMemory:
    def __init__(self, library, reference: AngleMemory | TimeMemory):
        self.library = library
        self.config = library.new("cgl_memory_config", **memory_config(library, reference))
        length = reference.cells + reference.q_half_width + 1
        self.cell, pointer = library.array(np.full(length, 7.0))
        self.state = library.new("cgl_memory")
        self.out = library.ffi.new("cgl_real *")
        assert library.lib.cgl_memory_init(self.state, self.config, ts, pointer, length) == library.lib.CGL_OK
        assert not self.cell.any()

    def recall(self, theta_m: float, omega_ref: float = 0.0) -> Recalled:
        def recall(learn: bool) -> tuple[float, bool]:
            known = self.library.lib.cgl_memory_recall(self.state, theta_m, omega_ref, learn, self.out)
            return self.out[0], known

        return Recalled(recall(True)[0], *recall(False))

    def update(self, value: float, correction: float = 0.0, learn: bool = True) -> float:
        return self.library.lib.cgl_memory_update(self.state, value, correction, learn)


def random_memory(rng, kind, real):
    cells = int(rng.choice([4, 5, 16, 63, 128, 500]))
    width = min(40, int(rng.choice([0, 1, (cells - 1) // 4, (cells - 1) // 2])))
    forgetting, limit = rounded([rng.choice([1.0, rng.uniform(0.5, 1)]), rng.uniform(0.5, 3)], real)
    ppr, lead = int(rng.choice([1, 2, 4])), int(rng.choice([0, min(cells // 4, rng.integers(1, 9))]))
    if kind == "angle":
        return AngleMemory(cells, ppr, width, forgetting, limit, lead)
    return TimeMemory(max(cells, 100), ppr, width, forgetting, limit, float(real(TS)), lead)


def drive(memory, inputs, gain, real=float):
    """The law u = filtered + gain error of one memory; yields what it recalls and stores."""
    for omega_ref, theta, error, learn in inputs:
        got = memory.recall(theta, omega_ref)
        frozen = not (got.known and learn)
        correction = float(real(gain) * real(error))
        value = memory.update(got.held if frozen else got.filtered, correction, not frozen)
        yield got.filtered, got.held, value


def random_inputs(rng, steps, real, faults):
    m = motion(rng, steps, TS, faults)
    error = np.sin(12 * m.theta_m) + rng.normal(0, 0.05, steps)
    theta, omega, error = rounded(m.theta_m, real), rounded(m.omega_ref, real), rounded(error, real)
    return list(zip(omega.tolist(), theta.tolist(), error.tolist(), m.learn.tolist(), strict=True))


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("kind", ["angle", "time"])
@pytest.mark.parametrize("seed", range(12))
def test_double_equals_the_reference(kind, seed):
    """Standstill, reversal, jumps, freezing, angles that are no numbers; the C's map equals the record's
    last values."""
    rng = np.random.default_rng(seed)
    reference = random_memory(rng, kind, np.float64)
    memory = CMemory(control_library("double"), reference)
    inputs = random_inputs(rng, 3000, np.float64, faults=0.004)
    gain = 0.2
    both = zip(drive(memory, inputs, gain), drive(reference, inputs, gain), strict=True)
    for n, (got, expected) in enumerate(both):
        assert max(abs(np.subtract(got, expected))) <= 1e-12 * reference.limit, n
    if kind == "angle":
        expected_map = [reference.now(n) for n in range(reference.cells)]
        assert max(abs(memory.cell[: reference.cells] - expected_map)) <= 1e-12 * reference.limit
        assert max(map(abs, expected_map)) > 1e-3


@pytest.mark.parametrize("seed", range(6))
def test_corrections_up_to_a_quarter_of_the_period_ago(seed):
    """A fast rotor that speeds up and slows down: its lead passes many cells at once, or turns back."""
    rng, library = np.random.default_rng(seed), control_library("double")
    cells, lead = int(rng.choice([9, 16, 61])), int(rng.choice([1, 2]))
    reference = AngleMemory(cells, 1, int(rng.choice([0, 2])), 0.9, 1.0, lead)
    memory = CMemory(library, reference)
    theta, speed, learn = rng.uniform(0, 6), 0.0, library.ffi.new("bool *")
    for n in range(400):
        if n % 5 == 0:
            speed = 0.25 / lead * rng.choice([1.02, 0.98, rng.uniform(0.1, 0.95)]) * 2 * math.pi
        theta = (theta + speed) % (2 * math.pi)
        correction = rng.uniform(-0.3, 0.3) if rng.random() < 0.97 else 1.5
        learn[0] = True
        got = library.lib.cgl_memory_step(memory.state, theta, 0.0, correction, learn)
        expected = reference.update(reference.recall(theta, 0.0).filtered, correction)
        assert abs(got - expected) <= 1e-12, n


@pytest.mark.parametrize("kind", ["angle", "time"])
@pytest.mark.parametrize("seed", range(8))
def test_single_stays_within_rounding(kind, seed):
    """Rounding moves a place in the memory by delta = 2 eps times the place counted from the period's start
    (by angle: cells in a revolution; by time: samples), which costs delta times the step between neighbours
    (at most 2 limit) once at reading and once at writing; each value rounds by eps limit. What is recalled
    has been through that once per period and the parts are independent: sqrt(periods) times as much. Steps
    are those of the smooth error here, not noise."""
    rng = np.random.default_rng(seed)
    library = control_library("float")
    reference = random_memory(rng, kind, np.float32)
    memory = CMemory(library, reference)
    m = motion(rng, 3000, TS)
    error = rounded(np.sin(4 * m.theta_m), np.float32)
    theta, omega = rounded(m.theta_m, np.float32), rounded(m.omega_ref, np.float32)
    inputs = list(zip(omega.tolist(), theta.tolist(), error.tolist(), m.learn.tolist(), strict=True))
    places = reference.cells * (reference.periods_per_rev if kind == "angle" else 1)
    periods = 1 + np.abs(m.omega_ref).sum() * TS / (2 * math.pi) * reference.periods_per_rev
    bound = library.eps * reference.limit * (4 + 2 * 2 * places) * math.sqrt(periods)
    both = zip(drive(memory, inputs, 0.2, np.float32), drive(reference, inputs, 0.2), strict=True)
    for n, (got, expected) in enumerate(both):
        assert max(abs(np.subtract(got, expected))) <= bound, n


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("width", [0, 3, 31])
def test_one_period_ago_is_literal_in_one_direction(precision, direction, width):
    """The shortest oracle of all: a rotor that never turns back writes an endless strip; recall reads it
    `cells` earlier."""
    library = control_library(precision)
    cells, step = 64, 0.3 * direction
    memory = CMemory(library, AngleMemory(cells, 1, width, 1.0, 10.0))
    strip: dict[int, float] = {}
    rng = np.random.default_rng(3)
    previous = None
    for k in range(2000):
        x = 20.05 + step * k
        got = memory.recall(float(library.real(x / cells * 2 * math.pi)))

        def ago(x):
            n = math.floor(x)
            earlier = [strip.get(j - direction * cells, 0.0) for j in (n, n + 1)]
            return earlier[0] + (x - n) * (earlier[1] - earlier[0])

        expected = np.mean([ago(x + j) for j in range(-width, width + 1)])
        # in single, angles up to 60 rad are known to 4e-5 cells; values differ by up to 2 in 0.3 of a cell
        tolerance = 1e-11 if precision == "double" else 5e-3
        assert abs(got.filtered - expected) <= tolerance
        value = float(library.real(rng.uniform(-1, 1)))
        memory.update(value)
        if previous is not None:
            a, b = sorted([(x - step, previous), (x, value)])
            for n in range(math.floor(a[0]) + 1, math.floor(b[0]) + 1):
                strip[n] = float(np.interp(n, [a[0], b[0]], [a[1], b[1]]))
        previous = value


@pytest.mark.parametrize("samples", [32.0, 33.37, 50.5, 99.99])
@pytest.mark.parametrize("kind", ["angle", "time"])
def test_a_periodic_signal_comes_back_one_period_later(kind, samples):
    """At any constant speed, with a fraction of a sample in the period: linear interpolation errs by h^2 /
    8 times the second derivative, once at writing and once at reading (by angle), with h the larger of
    sample and cell."""
    library = control_library("double")
    omega = 2 * math.pi / (samples * TS)
    cells = 40 if kind == "angle" else 101
    memory = CMemory(
        library,
        AngleMemory(cells, 1, 0, 1.0, 10.0) if kind == "angle" else TimeMemory(101, 1, 0, 1.0, 10.0, TS),
    )
    worst = 0.0
    for k in range(1000):
        theta = omega * TS * k
        if k > 2 * samples + 2:
            worst = max(worst, abs(memory.recall(theta, omega).held - math.sin(theta)))
        else:
            memory.recall(theta, omega)
        memory.update(math.sin(theta))
    sample, cell = 2 * math.pi / samples, 2 * math.pi / cells
    bound = (sample**2 + cell**2) / 8 if kind == "angle" else sample**2 / 8
    assert worst <= 1.001 * bound + 1e-12
    if kind == "time" and samples == 32.0:
        assert worst < 1e-12  # a whole number of samples is exact


def test_interpolation_error_falls_with_the_square_of_the_sampling():
    errors = []
    for samples in (20.5, 41.5, 82.5, 164.5):
        memory = CMemory(control_library("double"), TimeMemory(200, 1, 0, 1.0, 10.0, TS))
        omega = 2 * math.pi / (samples * TS)
        worst = 0.0
        for k in range(800):
            got = memory.recall(0.0, omega).held
            worst = max(worst, abs(got - math.sin(omega * TS * k)) if k > samples + 2 else 0.0)
            memory.update(math.sin(omega * TS * k))
        errors.append(worst)
    rates = np.log(np.divide(errors[:-1], errors[1:])) / np.log(
        np.divide([41.5, 82.5, 164.5], [20.5, 41.5, 82.5])
    )
    assert np.all(abs(rates - 2) < 0.05)


@pytest.mark.parametrize("kind", ["angle", "time"])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("harmonic", [1, 3, 7])
def test_q_filter_has_zero_phase(kind, direction, harmonic):
    """A harmonic comes out of the filter smaller by the mean's own gain, and not shifted: the quadrature
    part is zero."""
    width, samples = 5, 60
    library = control_library("double")
    reference = (
        AngleMemory(samples, 1, width, 1.0, 10.0)
        if kind == "angle"
        else TimeMemory(70, 1, width, 1.0, 10.0, TS)
    )
    memory = CMemory(library, reference)
    omega = direction * 2 * math.pi / (samples * TS)
    got, theta = np.zeros((2, samples))
    for k in range(4 * samples):
        theta[k % samples] = 1e-9 + omega * TS * k
        got[k % samples] = memory.recall(theta[k % samples], omega).filtered
        memory.update(math.cos(harmonic * theta[k % samples]))
    part = np.mean(got * np.exp(-1j * harmonic * theta)) * 2
    x = math.pi * harmonic / samples
    gain = math.sin((2 * width + 1) * x) / ((2 * width + 1) * math.sin(x))
    assert abs(part - gain) < 1e-7


@pytest.mark.parametrize("width", [0, 2, 20])
def test_a_frozen_map_repeats_itself_unchanged(width):
    """Learn half a revolution, freeze, turn several times either way: what is held is the map, at every
    place."""
    memory = CMemory(control_library("double"), AngleMemory(50, 1, width, 1.0, 10.0))
    for k in range(75):
        memory.recall(0.06 + 0.063 * k)
        memory.update(1.0 + k)
    before = memory.cell.copy()
    assert before[1:25].all()
    for step in (0.071, -0.053):
        for k in range(300):
            theta = 4.8 + step * k
            held = memory.recall(theta).held
            x = theta / (2 * math.pi) % 1 * 50
            assert abs(held - np.interp(x, np.arange(51), [*before[:50], before[0]])) < 1e-9
            memory.update(held, learn=False)
    assert np.array_equal(memory.cell, before)


def test_standstill_and_small_movement_write_nothing():
    memory = CMemory(control_library("double"), AngleMemory(50, 1, 2, 1.0, 10.0))
    for theta in [1.0] * 100 + [1.0 + 1e-4 * math.sin(k) for k in range(100)]:
        memory.recall(theta)
        memory.update(5.0)
    assert not memory.cell.any()


def test_a_jump_writes_nothing_and_an_entry_keeps_the_limit():
    memory = CMemory(control_library("double"), AngleMemory(100, 1, 2, 1.0, 2.0))
    for theta in (0.01, 0.01 + 0.26 * 2 * math.pi, 0.02):
        memory.recall(theta)
        memory.update(1.0)
    assert not memory.cell.any()
    for k, value in enumerate([math.inf, -math.inf, math.nan, 1e300, -7.0] * 40):
        memory.recall(0.06 * k)
        memory.update(value)
    assert 1.9 < np.max(abs(memory.cell)) <= 2.0


@pytest.mark.parametrize("precision", ["float", "double"])
def test_no_entry_of_the_period_is_left_out_at_any_speed(precision):
    """Marching round with every step size, landing on cells or beside them: each pass writes each entry
    anew."""
    library = control_library(precision)
    for cells, ppr in ((64, 1), (100, 3), (7, 4)):
        for per_step in (0.25, 1.0, 0.999, 1.7, 1e-2 * cells, 0.2499 * cells):
            memory = CMemory(library, AngleMemory(cells, ppr, min(3, (cells - 1) // 2), 1.0, 1e6))
            per_cell = 2 * math.pi / (cells * ppr)
            steps = int(2.2 * cells / per_step) + 2
            for k in range(3 * steps):
                if k in (steps, 2 * steps):
                    memory.cell[:cells] = 0
                memory.recall(float(library.real(k * per_step * per_cell % (2 * math.pi))))
                memory.update(1.0)
            assert np.all(memory.cell[:cells] == 1.0), (cells, ppr, per_step)


@pytest.mark.parametrize("precision", ["float", "double"])
def test_by_time_a_period_has_more_samples_than_16_bit_count(precision):
    library = control_library(precision)
    reference = TimeMemory(70_000, 1, 2, 1.0, 10.0, TS)
    memory = CMemory(library, reference)
    reference.values = rounded(np.linspace(0.0, 9.0, 80_000), library.real).tolist()
    for value in reference.values:
        memory.update(value)
    for period in (69_990.0, 65_536.5, 66_000.25):
        omega = 2 * math.pi / (period * TS)
        got, expected = memory.recall(0.0, omega), reference.recall(0.0, omega)
        assert got.known and expected.known
        # a period is known to some eps of itself, and a sample is 9 / 80000
        tolerance = 4 * library.eps * (10.0 + period * 9 / 80_000)
        assert got.held == pytest.approx(expected.held, abs=tolerance)
        assert got.filtered == pytest.approx(expected.filtered, abs=tolerance)


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("omega", [0.0, 0.5, 1e4, math.nan, math.inf, 1e-40, -0.5])
def test_by_time_a_period_outside_the_memory_is_unknown(precision, omega):
    memory = CMemory(control_library(precision), TimeMemory(100, 1, 10, 1.0, 10.0, TS))
    for _ in range(50):
        memory.update(1.0)
    assert memory.recall(0.0, omega) == Recalled(0.0, 0.0, False)
    assert memory.recall(0.0, 2 * math.pi / (0.05)).known


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("theta", [math.nan, math.inf, -math.inf, 1e5, -1e30])
def test_by_angle_no_angle_is_unknown(precision, theta):
    memory = CMemory(control_library(precision), AngleMemory(100, 1, 10, 1.0, 10.0))
    assert memory.recall(theta) == Recalled(0.0, 0.0, False)


@pytest.mark.parametrize("kind", ["angle", "time"])
@pytest.mark.parametrize("lead", [1, 5])
@pytest.mark.parametrize("direction", [1, -1])
def test_a_correction_acts_one_period_and_its_lead_later(kind, lead, direction):
    """Of a pulse in the error at sample n of a period, the next period shows the answer at n - lead."""
    samples, pulse = 50, 20
    memory = AngleMemory(samples, 1, 0, 1.0, 9.0, lead)
    if kind == "time":
        memory = TimeMemory(samples + 1, 1, 0, 1.0, 9.0, TS, lead)
    memory = CMemory(control_library("double"), memory)
    recalled = []
    for n in range(2 * samples + lead + 2):
        got = memory.recall(2 * math.pi * direction * (n + 0.001) / samples, 2 * math.pi / (samples * TS))
        recalled.append(got.filtered)
        acting = memory.update(got.filtered, 1.0 if n == pulse else 0.0)
        assert acting == pytest.approx(got.filtered)  # with a lead, nothing acts at once
    peak = samples + pulse - lead
    assert int(np.argmax(recalled)) == peak
    assert recalled[peak] == pytest.approx(1.0, abs=0.01)
    assert sum(recalled[samples:]) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("width", [1, 5])
def test_the_filters_sum_sheds_its_rounding(width):
    """A map that is only recalled falls by the forgetting, far below the rounding of what it was."""
    library = control_library("float")
    memory = CMemory(library, AngleMemory(64, 1, width, 0.5, 1e4))
    learns = library.ffi.new("bool *", True)
    for n in range(50 * 100):
        theta = float(library.real(2 * math.pi * (n % 100 + 0.3) / 100))
        correction = 1000.0 * (1.1 + math.cos(3 * theta)) if n < 300 else 0.0
        library.lib.cgl_memory_step(memory.state, theta, 0.0, correction, learns)
        if n == 300:
            assert abs(memory.cell[:64]).max() > 1000
    assert memory.state.steady
    assert abs(memory.cell[:64]).max() < 4000 * 0.5**45


def test_reset_forgets():
    memory = CMemory(control_library("double"), AngleMemory(20, 1, 2, 1.0, 10.0))
    for k in range(100):
        memory.recall(0.1 * k)
        memory.update(1.0)
    memory.library.lib.cgl_memory_reset(memory.state)
    assert not memory.cell.any()
    assert dataclasses.astuple(memory.recall(1.0)) == (0.0, 0.0, True)


@pytest.mark.parametrize("lead", [0, 1, 3])
@pytest.mark.parametrize("width", [0, 1, 4])
@pytest.mark.parametrize("speed", [0.3, 0.9, 2.4])
def test_a_step_is_a_recall_and_an_update(speed, width, lead):
    """The short way of a step, forward over the map's ends, past standstill and a coarse encoder, is the long
    one to rounding; limits and reversals too."""
    library = control_library("double")
    reference = AngleMemory(64, 1, width, 0.95, 0.8, lead)
    stepped, plain = CMemory(library, reference), CMemory(library, reference)
    rng = np.random.default_rng(5)
    learns = library.ffi.new("bool *")
    place = 0.0
    for n in range(4000):
        back = n % 700 > 690
        place += speed * (-1 if back else 1) * rng.uniform(0.6, 1.4) * (n % 50 > 3)
        theta = (round(place * 8) / 8 if n % 300 > 250 else place) / 64 * 2 * math.pi % (2 * math.pi)
        correction = float(0.1 * np.sin(3 * theta) + 0.02 * rng.normal() + (0.5 if n % 900 > 895 else 0.0))
        learn = n % 400 != 0
        learns[0] = learn
        acting = library.lib.cgl_memory_step(stepped.state, theta, 0.0, correction, learns)
        assert learns[0] == learn
        library.lib.cgl_memory_recall(plain.state, theta, 0.0, learn, plain.out)
        assert abs(acting - plain.update(plain.out[0], correction, learn)) <= 1e-11, n
    assert abs(stepped.cell[:64] - plain.cell[:64]).max() <= 1e-11
    assert abs(plain.cell[:64]).max() > 0.1
