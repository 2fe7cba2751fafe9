"""The memory of the learning laws in the C library: a map over the angle, and delay lines."""

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import pytest
from control_library import ControlLibrary, control_library
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reference.memory import WHOLE, AngleMemory, DelayLine
from reference.motion import motion, rounded

TS = 1e-3
LINES = ["time", "ode", "inversion"]
PERIODS = [(1, 1), (1, 4), (4, 1), (2, 3), (12, 1), (7, 50)]  # turns, parts
Reference = AngleMemory | DelayLine


def memory_config(library: ControlLibrary, memory: Reference) -> dict[str, Any]:
    names = ("cells", "turns", "parts", "q_half_width", "lead", "forgetting", "limit")
    config = {name: getattr(memory, name) for name in names} | {"channels": len(memory.limit)}
    if isinstance(memory, AngleMemory):
        return config | {"kind": library.lib.CGL_MEMORY_ANGLE}
    kind = library.lib.CGL_MEMORY_TIME if memory.kind == "time" else library.lib.CGL_MEMORY_DELAY
    method = library.lib.CGL_DELAY_INVERSION if memory.kind == "inversion" else library.lib.CGL_DELAY_ODE
    return config | {"kind": kind, "method": method, "k_pp": memory.k_pp}


def cells_needed(memory: Reference) -> int:
    rows = len(memory.limit) + (isinstance(memory, DelayLine) and memory.kind != "time")
    return rows * (memory.cells + memory.q_half_width + 1)


class CMemory:
    """The C memory, configured as its reference is."""

    def __init__(self, library: ControlLibrary, reference: Reference):
        self.library, self.channels, self.cells = library, len(reference.limit), reference.cells
        self.config = library.new("cgl_memory_config", **memory_config(library, reference))
        self.state, length = library.new("cgl_memory"), cells_needed(reference)
        self.cell, pointer = library.array(np.full(length, 7.0))
        ts = getattr(reference, "ts", TS)
        arguments = (self.state, self.config, ts, reference.ratio, pointer, length)
        assert library.lib.cgl_memory_init(*arguments) == library.lib.CGL_OK
        assert not self.cell.any()
        self.row = reference.cells + reference.q_half_width + 1
        self.correction, self.value = (library.ffi.new("cgl_real[3]") for _ in range(2))

    def step(self, theta, speed=1.0, learn=True, correction=(0.0,)) -> tuple[list[float], bool]:
        for c, x in enumerate(correction):
            self.correction[c] = x
        arguments = (self.state, theta, speed, learn, self.correction, self.value)
        learned = self.library.lib.cgl_memory_step(*arguments)
        return list(self.value)[: self.channels], learned

    def recall(self, theta, speed=1.0, learn=True) -> tuple[float, bool]:
        """What channel 1 would learn on from, or repeat; leaves no trace."""
        state, cell = bytes(self.library.ffi.buffer(self.state)), self.cell.copy()
        values, learned = self.step(theta, speed, learn)
        self.library.ffi.buffer(self.state)[:] = state
        self.cell[:] = cell
        return values[0], learned

    def store(self, theta, value, speed=1.0) -> float:
        """Makes channel 1 act with a value, by the correction that does so; what it had recalled."""
        recalled, _ = self.recall(theta, speed)
        self.step(theta, speed, True, [value - recalled])
        return recalled

    def acted(self) -> list[float]:
        """In the last step, within the limits."""
        return [self.state.channel[c].value for c in range(self.channels)]

    def map(self, channel: int = 0) -> np.ndarray:
        return self.cell[channel * self.row :][: self.cells]


# ---- agreement with the reference


def random_reference(rng, kind: str, real: type) -> Reference:
    cells = int(rng.choice([4, 5, 16, 63, 128, 500]))
    width = min(40, int(rng.choice([0, 1, (cells - 1) // 4, cells // 2 - 1])))
    turns, parts = PERIODS[rng.integers(len(PERIODS))]
    limit = rounded(rng.uniform(0.5, 3, int(rng.integers(1, 4))), real).tolist()
    sizes = {
        "turns": turns, "parts": parts, "limit": limit, "ratio": int(rng.choice([1, 1, 4, 50])),
        "forgetting": float(rounded(rng.choice([1.0, rng.uniform(0.5, 1)]), real)),
        "lead": int(rng.choice([0, min(cells // 4, rng.integers(1, 9))])),
        "real": float if real is np.float64 else real,
    }  # fmt: skip
    if kind == "angle":
        return AngleMemory(cells=cells, q_half_width=width, **sizes)
    ts, k_pp = rounded([TS, rng.uniform(1, 50)], real).tolist()
    cells = int(rng.choice([120, 600, 3000]))
    return DelayLine(kind=kind, ts=ts, k_pp=k_pp, cells=cells, q_half_width=min(width, 7), **sizes)


def random_inputs(rng, reference: Reference, steps: int, faults: float):
    """Standstill, reversal, jumps, freezing, noise below a cell, numbers that are none; speeds at which the
    period fits."""
    real = np.float64 if reference.real is float else reference.real
    m = motion(rng, steps, TS, faults)
    scale = reference.turns / (reference.parts * reference.ratio)
    if isinstance(reference, DelayLine):
        scale *= 1000 / reference.cells
    if (
        isinstance(reference, DelayLine) and reference.kind != "time"
    ):  # before a line, a rotor hardly turns back
        speed = np.where(m.omega_ref > -25, abs(m.omega_ref), -2.0)
        theta = np.nancumsum(np.where(abs(speed) < 1e3, speed, 0.0)) * TS * scale
        theta = np.where(np.isfinite(m.theta_m), theta, m.theta_m) % (2 * math.pi)
    else:
        speed, theta = m.omega_ref, m.theta_m
        if scale < 0.1:  # else the rotor jumps at every step
            theta = theta * scale
    theta = theta + np.where(rng.random(steps) < 0.3, rng.normal(0, 1e-4 * scale, steps), 0.0)
    speed = speed * scale
    waves = [np.sin((12 + c) * m.theta_m) + rng.normal(0, 0.05, steps) for c in range(3)]
    corrections = 0.2 * np.transpose(waves)[:, : len(reference.limit)]
    columns = [rounded(x, real).tolist() for x in (theta, speed)]
    return list(zip(*columns, m.learn.tolist(), rounded(corrections, real).tolist(), strict=True))


def apart(rows: list[tuple[list[float], ...]], a: int, b: int) -> np.ndarray:
    """How far apart columns a and b are in each step, by channel."""
    return np.abs(np.array([row[a] for row in rows]) - np.array([row[b] for row in rows]))


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("kind", ["angle", *LINES])
@pytest.mark.parametrize("seed", range(10))
def test_double_equals_the_reference(kind, seed):
    """What acts, what is kept of it, whether it learned, P_t, and the whole map after any step."""
    rng = np.random.default_rng(seed)
    reference = random_reference(rng, kind, np.float64)
    memory = CMemory(control_library("double"), reference)
    tolerance = 2e-11 * max(reference.limit)
    learned, largest, rows = 0, 0.0, []
    for n, (theta, speed, learn, correction) in enumerate(random_inputs(rng, reference, 1500, 0.005)):
        got, got_learned = memory.step(theta, speed, learn, correction)
        expected, learns = reference.step(theta, speed, learn, correction)
        assert got_learned == learns, n
        rows.append((got, expected, memory.acted(), reference.value))
        learned += learns
        largest = max(largest, *map(abs, expected))
        if kind != "angle" and kind != "time":
            assert abs(memory.state.line.p_t - reference.p_t) <= 1e-12, n
        if kind == "angle" and (n % 61 == 0 or n > 1480):
            for c in range(memory.channels):
                held = [cell[c] for cell in reference.map]
                assert abs(memory.map(c) - held).max() <= tolerance, (n, c)
    assert apart(rows, 0, 1).max() <= tolerance
    assert apart(rows, 2, 3).max() <= tolerance
    assert learned > 100
    assert largest > 0.1 or kind != "angle"


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 2**32 - 1), cells=st.integers(4, 80), share=st.floats(0, 1),
    fastest=st.floats(0.001, 0.3),
    lead=st.integers(0, 3), way=st.integers(0, len(PERIODS) - 1),
)  # fmt: skip
def test_fast_rotors_equal_the_reference(seed, cells, share, fastest, lead, way):
    """Up to more than a quarter of the period a step, filters up to the whole period, reversals; leads that
    turn back."""
    rng = np.random.default_rng(seed)
    turns, parts = PERIODS[way]
    width = int(share * (cells // 2 - 1))
    reference = AngleMemory(
        cells=cells,
        turns=turns,
        parts=parts,
        q_half_width=width,
        lead=min(lead, cells // 4),
        limit=[1.0],
        forgetting=0.9,
    )
    memory = CMemory(control_library("double"), reference)
    theta, speed = rng.uniform(0, 6), 0.0
    for n in range(200):
        if n % 20 == 0:  # of the period, a step
            speed = fastest * rng.uniform(-0.2, 1.0) ** 2 * rng.choice([-1, 1, 1, 1])
        most = 0.4 * parts / turns  # the shorter way round has to be the true one
        theta = (theta + min(speed, most) * 2 * math.pi * turns / parts) % (2 * math.pi)
        learn, correction = rng.random() > 0.01, [rng.uniform(-0.3, 0.3)]
        got, learned = memory.step(theta, 0.0, learn, correction)
        expected, learns = reference.step(theta, 0.0, learn, correction)
        assert learned == learns
        assert abs(got[0] - expected[0]) < 1e-11
        assert abs(memory.map() - [cell[0] for cell in reference.map]).max() < 1e-11


def test_where_a_lead_stands_still_the_correction_before_goes_on_from_there():
    """A rotor that speeds up as a place three samples ago does: two units a step, then three of them."""
    reference = AngleMemory(cells=50, lead=3, limit=[9.0])
    memory = CMemory(control_library("double"), reference)
    unit, place = WHOLE // 500, WHOLE // 5
    for correction, units in [(0.0, 0), (0.0, 2), (1.0, 2), (5.0, 3), (2.0, 3), (2.0, 3)]:
        place += units * unit
        theta = (place + 0.5) / WHOLE * 2 * math.pi
        got, _ = memory.step(theta, 0.0, True, [correction])
        expected, _ = reference.step(theta, 0.0, True, [correction])
        assert got == pytest.approx(expected, abs=1e-11)
        assert memory.map() == pytest.approx([cell[0] for cell in reference.map], abs=1e-9)
    assert 1.0 < max(abs(memory.map())) <= 2.0  # the 5 of the place that stood still is never written


@pytest.mark.parametrize("seed", range(8))
def test_single_stays_within_rounding(seed):
    """A place is the same integer in both. What is recalled is a sum of 2 m + 1 entries, gathered anew after
    as many cells, and so off by (2 m + 1) eps of the limit at most, once a period, at random."""
    rng = np.random.default_rng(seed)
    reference = random_reference(rng, "angle", np.float32)
    memory = CMemory(library := control_library("float"), reference)
    inputs = random_inputs(rng, reference, 2000, 0.0)
    way = (
        sum(abs(speed) * TS for _, speed, *_ in inputs) * reference.ratio * reference.parts / reference.turns
    )
    entries = 2 * reference.q_half_width + 1
    bound = library.eps * max(reference.limit) * (16 + 2 * entries) * math.sqrt(1 + way / (2 * math.pi))
    learned, rows = 0, []
    for n, (theta, speed, learn, correction) in enumerate(inputs):
        got, known = memory.step(theta, speed, learn, correction)
        expected, learns = reference.step(theta, speed, learn, correction)
        assert known == learns, n
        rows.append((got, expected))
        learned += learns
    assert apart(rows, 0, 1).max() <= bound
    assert learned > 300


def test_single_by_time_stays_within_rounding():
    """The place of one period ago rounds by 2 eps of the period [samples]; neighbours differ by 0.005."""
    reference = DelayLine(
        kind="time", ts=float(np.float32(TS)), cells=900, q_half_width=2, limit=[2.0], forgetting=0.5
    )
    memory = CMemory(library := control_library("float"), reference)
    for n in range(5000):
        speed = float(np.float32(12 + 4 * math.sin(0.002 * n)))
        correction = [float(np.float32(0.5 * math.sin(0.01 * n)))]
        got, _ = memory.step(0.0, speed, True, correction)
        expected, _ = reference.step(0.0, speed, True, correction)
        assert abs(got[0] - expected[0]) <= 2 * library.eps * (2 * 16 + 2 * 800 * 0.01), n
    assert abs(expected[0]) > 0.01


@pytest.mark.parametrize("precision", ["float", "double"])
def test_the_running_sum_does_not_drift(precision):
    """After 1.2 million cells passed, all at the limit, it is what its entries say, to 20 eps for each."""
    reference = AngleMemory(cells=300, q_half_width=20, limit=[1.0])
    memory = CMemory(library := control_library(precision), reference)
    step, theta, count = memory.library.lib.cgl_memory_step, 0.0, 0
    rng = np.random.default_rng(1)
    steps = rng.choice([0.03, 0.04], 1000)
    waves = rng.uniform(-0.1, 0.1, 1000)
    for _ in range(100):
        for way, wave in zip(steps.tolist(), waves.tolist(), strict=True):
            theta = theta + way if theta < 6.28 else theta + way - 6.283185307179586
            memory.correction[0] = wave
            count += step(memory.state, theta, 0.0, True, memory.correction, memory.value)
    state, at = memory.state, memory.state.map.at
    assert count > 99_900
    ring = memory.cell[memory.cells :]  # the last 21 cells passed
    entries = [*ring, *(memory.map()[(at + k) % 300] for k in range(1, 21))]
    assert abs(state.channel[0].sum - sum(map(float, entries))) < 41 * 20 * library.eps
    assert abs(memory.map()).max() > 0.9


# ---- what is new: faults that the tests before did not see


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize(("turns", "parts"), [(3, 1), (12, 1), (4, 3), (5, 2)])
@pytest.mark.parametrize("direction", [1, -1])
def test_more_turns_than_one_fill_the_whole_map_with_a_wrapped_angle(precision, turns, parts, direction):
    """Each cell gets what acted there, whichever revolution it lies in."""
    library, cells = control_library(precision), 256
    memory = CMemory(library, AngleMemory(cells=cells, turns=turns, parts=parts, limit=[9.0]))
    per_cell = 2 * math.pi * turns / parts / cells
    place = 1.0  # near the start of the first turn, as the first angle says
    for n in range(round(2.2 * cells / 0.4 * max(1, parts))):
        place = 1.0 + 0.4 * n * direction * per_cell
        x = place / (2 * math.pi * turns / parts) % 1.0
        memory.store(float(library.real(place % (2 * math.pi))), 2 + math.cos(2 * math.pi * x))
    x = np.arange(cells) / cells
    assert np.abs(memory.map() - 2 - np.cos(2 * np.pi * x)).max() < 2e-3


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("method", ["ode", "inversion"])
def test_a_delay_line_counts_more_turns_than_one(precision, method):
    """A period of two turns, of which each has its own values."""
    line = DelayLine(kind=method, ts=TS, cells=1500, turns=2, limit=[9.0])
    memory = CMemory(control_library(precision), line)
    step = 2 * math.pi / 500
    for n in range(3000):
        theta = n * step
        recalled = memory.store(float(np.float32(theta % (2 * math.pi))), math.sin(theta / 2))
        if n > 1010:
            assert memory.state.line.p_t == pytest.approx(1.0, abs=1e-4)
            assert abs(recalled - math.sin(theta / 2)) < 1e-3


def test_by_time_a_number_that_is_none_is_not_stored_and_a_rest_forgets_nothing():
    memory = CMemory(control_library("double"), DelayLine(kind="time", ts=TS, cells=150, limit=[9.0]))
    speed = 2 * math.pi / 0.1  # a period of 100 samples
    values = [2 + math.sin(2 * math.pi * n / 100) for n in range(400)]
    for value in values:
        memory.store(0.0, value, speed)
    before = memory.cell.copy()
    for theta, at in [(math.nan, speed), (0.0, math.nan), (math.inf, speed), *[(0.0, 0.0)] * 1000]:
        got, learned = memory.step(theta, at)
        assert got == [pytest.approx(values[-1])] and not learned
        assert np.array_equal(memory.cell, before)
    held, learned = memory.step(0.0, speed, True, [math.nan])  # goes on, with what it holds
    assert held == [pytest.approx(values[0])] and not learned
    for n in range(1, 100):
        assert memory.recall(0.0, speed)[0] == pytest.approx(values[n])
        memory.step(0.0, speed)


def test_by_time_any_correction_but_a_number_stores_what_is_held():
    """The line goes on with what it recalls, not with 0."""
    memory = CMemory(control_library("double"), DelayLine(kind="time", ts=TS, cells=150, limit=[9.0]))
    speed = 2 * math.pi / 0.1
    for _ in range(100):
        memory.store(0.0, 5.0, speed)
    for n in range(300):
        memory.step(0.0, speed, True, [math.inf if n % 3 else math.nan])
    assert memory.recall(0.0, speed)[0] == pytest.approx(5.0)
    assert (memory.cell[:101] == 5.0).sum() >= 100


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("start", [1999.0, 2001.0, -2001.0, 60_000.0])
def test_with_a_ratio_the_angle_has_the_same_range(precision, start):
    """50 theta was compared with 1e5 rad, which 2,001 rad pass."""
    library = control_library(precision)
    memory = CMemory(library, AngleMemory(cells=64, ratio=50, limit=[9.0]))
    coarse = 0.004 if abs(start) > 1e4 and precision == "float" else 0.0  # neighbouring numbers
    for n in range(400):
        assert memory.step(float(library.real(start + max(0.001, coarse) * n)), 1.0, True, [0.01])[1]
    assert np.count_nonzero(memory.map()) == 64


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("cells", [256, 32_768, 65_535])
def test_maps_up_to_the_largest(precision, cells):
    """A sweep over the whole period, in steps of cells and of fractions, over the wrap and back: every cell
    holds what acted there, and is recalled there."""
    library = control_library(precision)
    step = library.lib.cgl_memory_step
    memory = CMemory(library, AngleMemory(cells=cells, q_half_width=1, limit=[9.0], forgetting=1e-30))
    correction, value = memory.correction, memory.value
    for per_step in (7.3, -7.3):
        count = int(1.2 * cells / 7.3)
        for n in range(count):
            x = (0.5 + n * per_step / cells) % 1.0
            correction[0] = 2 + math.cos(2 * math.pi * x)
            assert step(memory.state, x * 2 * math.pi, 0.0, True, correction, value) or n < 2
        expected = 2 + np.cos(2 * np.pi * np.arange(cells) / cells)
        assert np.abs(memory.map() - expected).max() < 2 * (2 * math.pi * 7.3 / cells) ** 2 + 1e-5
    for n in range(2000):  # slowly over the wrap, a tenth of a cell a step
        x = ((n - 1000) / 10 / cells) % 1.0
        correction[0] = 5.0 if x > 0.5 else 7.0
        step(memory.state, x * 2 * math.pi, 0.0, True, correction, value)
    near = min(90, cells // 4)
    assert np.all(memory.map()[-near:-1] == 5.0) and np.all(memory.map()[1:near] == 7.0)


@pytest.mark.parametrize("precision", ["float", "double"])
def test_the_longest_line_is_accepted_with_the_memory_it_needs(precision):
    library = control_library(precision)
    lib, longest = library.lib, 16_777_216
    needed = longest + 5 + 1
    for kind, rows in ((lib.CGL_MEMORY_TIME, 1), (lib.CGL_MEMORY_DELAY, 2)):
        fields = {"kind": kind, "channels": 1, "cells": longest, "turns": 1, "parts": 1, "q_half_width": 5,
                  "forgetting": 1.0, "limit": [1.0] * 3, "k_pp": 1.0}  # fmt: skip
        config, state = library.new("cgl_memory_config", **fields), library.new("cgl_memory")
        cell = library.ffi.new("cgl_real[1]")
        init = lib.cgl_memory_init
        assert init(state, config, TS, 1, cell, rows * needed - 1) == lib.CGL_ERROR_MEMORY
        assert init(state, config, TS, 1, library.ffi.NULL, rows * needed) == lib.CGL_ERROR_MEMORY
        config.cells = longest + 1
        assert init(state, config, TS, 1, cell, rows * (needed + 1)) == lib.CGL_ERROR_CONFIG
    if precision == "float":  # 67 MB
        config.kind, config.cells = lib.CGL_MEMORY_TIME, longest
        whole = np.full(needed, 3.0, np.float32)
        assert (
            init(state, config, 1e-6, 1, library.ffi.from_buffer("cgl_real[]", whole), needed) == lib.CGL_OK
        )
        assert not whole.any()


@pytest.mark.parametrize(("precision", "cells"), [("float", 300_000), ("double", 70_000)])
def test_by_time_a_period_has_more_samples_than_16_bit_count(precision, cells):
    """Of a line whose first period is still empty, what acts is the correction; then it comes back."""
    library = control_library(precision)
    memory = CMemory(library, DelayLine(kind="time", ts=TS, cells=cells, limit=[10.0]))
    period = cells - 10.0 + 0.25
    speed = 2 * math.pi / (period * TS)
    step, values = library.lib.cgl_memory_step, np.linspace(1.0, 9.0, cells).tolist()
    correction, value = memory.correction, memory.value
    for n in range(cells + 1000):
        correction[0] = values[n] if n < cells - 10 else 0.0
        step(memory.state, 0.0, speed, True, correction, value)
        if n >= cells - 9 and n % 7 == 0:
            expected = values[n - cells + 10] - 0.25 * 8 / (cells - 1) if n > cells - 10 else 1.0
            assert value[0] == pytest.approx(expected, abs=4 * library.eps * (10 + period * 9 / cells)), n


@settings(max_examples=40, deadline=None)
@given(
    cells=st.integers(4, 2000), lead=st.integers(0, 20), channels=st.integers(1, 3),
    way=st.lists(st.floats(-0.6, 0.6), min_size=5, max_size=60),
)  # fmt: skip
def test_a_step_writes_no_more_cells_than_the_last_two_allow(cells, lead, channels, way):
    """Work is bounded: 16 cells and twice those passed in the step before, and as many again of its own with
    a lead."""
    reference = AngleMemory(cells=cells, lead=min(lead, cells // 4), limit=[9.0] * channels)
    memory = CMemory(control_library("double"), reference)
    theta = 0.0
    for share in way:
        for move in [share**3] * 3:
            theta = (theta + move * 2 * math.pi) % (2 * math.pi)
            before, passed = memory.cell.copy(), memory.state.map.passed
            memory.step(theta, 0.0, True, [0.01, 0.02, 0.03][:channels])
            now = memory.state.map.passed
            for c in range(channels):
                written = np.count_nonzero(before[c * memory.row :][:cells] != memory.map(c))
                most = min(now, 16 + 2 * passed)
                assert written <= most + (16 + 2 * now if reference.lead else 0)


def test_a_jump_is_more_cells_than_16_and_twice_the_last():
    """The rule at its edge: 16 cells from rest, 16 + 2 n after n; one more starts anew."""
    cells = 1000

    def moves(*counts):
        memory = CMemory(control_library("double"), AngleMemory(cells=cells, limit=[9.0]))
        x = 0.5
        memory.step(x / cells * 2 * math.pi, 0.0, True, [1.0])
        for count in counts:
            x += count
            memory.step(x / cells * 2 * math.pi, 0.0, True, [1.0])
        return np.count_nonzero(memory.map())

    assert moves(16) == 16
    assert moves(17) == 0
    assert moves(5, 26) == 31
    assert moves(5, 27) == 5
    assert moves(17, 50) == 50  # the rotor goes on as it jumped: it is one that is fast
    assert moves(17, 51) == 0
    assert moves(17, 50, 116, 240) == 406
    assert moves(17, 50, 116, 251) == 166  # more than a quarter of the period


# ---- learning: limits, standstill, reversal, freezing


@pytest.mark.parametrize("width", [0, 3, 31])
@pytest.mark.parametrize("direction", [1, -1])
def test_learning_waits_a_cell_a_step_after_a_jump_and_a_reversal(width, direction):
    """As many steps as the filter looks cells to one side, wherever the rotor is meanwhile."""
    memory = CMemory(control_library("double"), AngleMemory(cells=64, q_half_width=width, limit=[9.0]))
    theta = 1.0

    def goes(way, first):
        """Steps without learning on a new way, which then goes on."""
        nonlocal theta
        learned = []
        for n in range(80):
            theta += first if n == 0 else 0.13 * way
            learned.append(memory.step(theta % (2 * math.pi), 0.0, True, [0.1])[1])
        return learned.count(False)

    goes(direction, 0.0)  # forward first, whatever it does
    assert goes(direction, 0.13 * direction) == 0
    assert goes(direction, 2.0 * direction) == max(width, 1)  # a jump of more than a quarter
    assert goes(-direction, -0.2 * direction) == width  # back by two cells
    assert goes(-direction, -2.9 * direction) == max(width, 1)
    assert goes(direction, 0.05 * direction) == width  # stands at first, and learns


@pytest.mark.parametrize("direction", [1, -1])
def test_back_by_less_than_a_cell_is_standing_still(direction):
    """Noise of an encoder costs neither a wait nor a place; what passes a cell, in either direction, does."""
    cell = 2 * math.pi / 50
    memory = CMemory(control_library("double"), AngleMemory(cells=50, q_half_width=4, limit=[9.0]))
    theta = 3.0
    for _ in range(60):
        theta += 0.3 * cell * direction
        memory.step(theta, 0.0, True, [0.1])
    place = memory.state.map.x
    for back in (0.1, 0.9, 0.5, 0.999):
        assert memory.step(theta - back * cell * direction, 0.0, True, [0.1])[1]
        assert memory.state.map.x == place
    assert not memory.step(theta - 1.01 * cell * direction, 0.0, True, [0.1])[1]


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("width", [0, 3, 31])
def test_one_period_ago_is_literal_in_one_direction(precision, direction, width):
    """The shortest oracle of all: a rotor that never turns back writes an endless strip, and is told what the
    strip held `cells` earlier."""
    library, cells, step = control_library(precision), 64, 0.3 * direction
    memory = CMemory(library, AngleMemory(cells=cells, q_half_width=width, limit=[10.0]))
    strip: dict[int, float] = {}
    rng = np.random.default_rng(3)
    previous = None
    for k in range(900):  # four periods
        x = 20.05 + step * k

        def ago(x):
            n = math.floor(x)
            here, there = (strip.get(j - direction * cells, 0.0) for j in (n, n + 1))
            return here + (x - n) * (there - here)

        theta = float(library.real(x / cells * 2 * math.pi))
        if k < 40:  # until it knows the way
            memory.step(theta, learn=False)
            continue
        value = float(library.real(rng.uniform(-1, 1)))
        got = memory.store(theta, value)
        expected = sum(ago(x + j) for j in range(-width, width + 1)) / (2 * width + 1)
        # in single, angles up to 60 rad are known to 4e-5 cells; values differ by up to 2 in 0.3 of a cell
        assert abs(got - expected) <= (1e-6 if precision == "double" else 5e-3), k
        if previous is not None:
            a, b = sorted([(x - step, previous), (x, value)])
            for n in range(math.floor(a[0]) + 1, math.floor(b[0]) + 1):
                strip[n] = a[1] + (n - a[0]) / (b[0] - a[0]) * (b[1] - a[1])
        previous = value


@pytest.mark.parametrize("width", [0, 2, 20])
def test_a_frozen_map_repeats_itself_unchanged(width):
    """Learn half a revolution, freeze, turn several times either way: what is held is the map, at every
    place."""
    memory = CMemory(control_library("double"), AngleMemory(cells=50, q_half_width=width, limit=[10.0]))
    for k in range(75):
        memory.store(0.06 + 0.063 * k, 1.0 + 0.1 * k)
    before = memory.map().copy()
    assert np.count_nonzero(before) > 30 - width
    for step in (0.071, -0.153):
        for k in range(300):
            theta = 4.8 + step * k
            held, learned = memory.step(theta, learn=False, correction=[1.0])
            x = theta / (2 * math.pi) % 1 * 50
            assert not learned
            assert abs(held[0] - np.interp(x, np.arange(51), [*before, before[0]])) < 1e-7
    assert np.array_equal(memory.map(), before)


@pytest.mark.parametrize("kind", ["angle", *LINES])
@pytest.mark.parametrize("theta", [math.nan, math.inf, -math.inf, 1e5, -1e30])
def test_no_angle_is_no_step(kind, theta):
    """What acted last goes on, nothing is stored."""
    sizes: dict[str, Any] = {"cells": 100, "q_half_width": 2, "limit": [10.0]}
    memory = CMemory(
        control_library("double"),
        AngleMemory(**sizes) if kind == "angle" else DelayLine(kind=kind, ts=TS, **sizes),
    )
    for n in range(250):
        last = memory.step(0.1 * n % (2 * math.pi), 100.0, True, [0.02 * math.sin(n)])[0]
    before = memory.cell.copy()
    assert memory.step(theta, 100.0, True, [1.0]) == (last, False)
    assert np.array_equal(memory.cell, before)
    assert abs(last[0]) > 1e-3


def test_an_entry_keeps_the_limit_and_what_acts_may_pass_it():
    memory = CMemory(control_library("double"), AngleMemory(cells=100, q_half_width=2, limit=[2.0]))
    for k, correction in enumerate([1e300, -1e300, -7.0, math.inf, math.nan] * 40):
        (value,), learned = memory.step(0.06 * k, 0.0, True, [correction])
        assert learned == (math.isfinite(correction) and learned)
        if learned:
            assert abs(value - correction) <= 2.0 * (1 + 1e-9) + abs(correction) * 1e-15
        assert np.max(abs(memory.map())) <= 2.0


def test_what_is_learned_grows_to_the_limit_and_stays_there():
    memory = CMemory(control_library("double"), AngleMemory(cells=32, limit=[0.7]))
    for n in range(4000):
        memory.step(0.005 * n % (2 * math.pi), 0.0, True, [0.5])
    assert np.all(memory.map() == 0.7)
    assert memory.value[0] == pytest.approx(1.2)


@pytest.mark.parametrize("precision", ["float", "double"])
def test_no_entry_of_the_period_is_left_out_at_any_speed(precision):
    """Marching round with every step size, landing on cells or beside them: each pass writes each entry
    anew."""
    library = control_library(precision)
    for cells, parts in ((64, 1), (100, 3), (7, 4)):
        for per_step in (0.25, 1.0, 0.999, 1.7, 1e-2 * cells, 0.2499 * cells):
            width = min(3, cells // 2 - 1)
            memory = CMemory(library, AngleMemory(cells=cells, parts=parts, q_half_width=width, limit=[1.0]))
            per_cell = 2 * math.pi / (cells * parts)
            steps = int(2.2 * cells / per_step) + 8
            for k in range(3 * steps):
                if k in (steps, 2 * steps):
                    memory.map()[:] = 0
                memory.step(float(library.real(k * per_step * per_cell % (2 * math.pi))), 0.0, True, [5.0])
            assert np.all(memory.map() == 1.0), (cells, parts, per_step)


@pytest.mark.parametrize("width", [1, 5])
def test_the_filters_sum_sheds_its_rounding(width):
    """A map that is only recalled falls by the forgetting, far below the rounding of what it was."""
    library = control_library("float")
    memory = CMemory(library, AngleMemory(cells=64, q_half_width=width, forgetting=0.5, limit=[1e4]))
    for n in range(50 * 100):
        theta = float(library.real(2 * math.pi * (n % 100 + 0.3) / 100))
        memory.step(theta, 0.0, True, [1000.0 * (1.1 + math.cos(3 * theta)) if n < 300 else 0.0])
        if n == 300:
            assert abs(memory.map()).max() > 1000
    assert abs(memory.map()).max() < 4000 * 0.5**45


@pytest.mark.parametrize("kind", ["angle", "time"])
@pytest.mark.parametrize("lead", [1, 5])
@pytest.mark.parametrize("direction", [1, -1])
def test_a_correction_acts_one_period_and_its_lead_later(kind, lead, direction):
    """Of a pulse in the error at sample n of a period, the next period shows the answer at n - lead."""
    samples, pulse = 50, 20
    sizes: dict[str, Any] = {"lead": lead, "limit": [9.0]}
    memory = CMemory(
        control_library("double"),
        AngleMemory(cells=samples, **sizes)
        if kind == "angle"
        else DelayLine(kind="time", ts=TS, cells=samples + 1, **sizes),
    )
    acted = []
    for n in range(2 * samples + lead + 2):
        theta = 2 * math.pi * (direction * (n + 0.001) / samples % 1.0)
        values, _ = memory.step(theta, 2 * math.pi / (samples * TS), True, [float(n == pulse)])
        acted += values
    peak = samples + pulse - lead
    assert int(np.argmax(acted)) == peak
    assert acted[peak] == pytest.approx(1.0, abs=0.01)
    assert sum(acted) == pytest.approx(1.0, abs=0.05)  # with a lead, nothing acts at once


def test_reset_forgets_and_retune_does_not():
    library = control_library("double")
    lib = library.lib
    memory = CMemory(library, AngleMemory(cells=20, q_half_width=2, limit=[10.0]))
    for k in range(150):
        memory.step(0.1 * k, 0.0, True, [1.0])
    before = memory.map().copy()
    other = library.new(
        "cgl_memory_config", **memory_config(library, AngleMemory(cells=20, q_half_width=2, limit=[1.5]))
    )
    other.forgetting, other.lead = 0.5, 3
    assert before.max() > 1.5
    assert lib.cgl_memory_retune(memory.state, other) == lib.CGL_OK
    assert np.array_equal(memory.map(), np.minimum(before, 1.5))
    assert memory.state.gain == 0.1
    for field in ("cells", "turns", "parts", "q_half_width", "channels"):
        config = library.ffi.new("cgl_memory_config *", other[0])
        setattr(config, field, getattr(config, field) + 1)
        assert lib.cgl_memory_retune(memory.state, config) == lib.CGL_ERROR_CONFIG, field
    lib.cgl_memory_reset(memory.state)
    assert not memory.cell.any()
    assert memory.step(1.0, learn=False) == ([0.0], False)


@pytest.mark.parametrize("lead", [0, 1, 5])
@pytest.mark.parametrize("direction", [1, -1])
def test_above_its_fastest_speed_a_map_stays_and_acts(lead, direction):
    """There a sample, and the lead, are a quarter of the period. Forgetting would have cleared it."""
    library = control_library("double")
    reference = AngleMemory(cells=64, parts=2, ratio=3, lead=lead, forgetting=0.5, limit=[1.0])
    memory = CMemory(library, reference)
    fastest = library.lib.cgl_memory_fastest(memory.state)
    assert fastest == pytest.approx(2 * math.pi / 6 / (4 * max(1, lead) * TS))
    taught = np.cos(np.arange(64))
    memory.map()[:] = taught
    theta, seen = 1.0, []
    for n in range(300):
        theta += direction * 1.01 * fastest * TS
        values, learned = memory.step(theta % (2 * math.pi), 0.0, True, [0.1])
        assert not learned or n <= 1  # until it is on its way
        seen += values
    assert np.array_equal(memory.map(), taught)
    assert np.ptp(seen) > 1.5
    for _ in range(300):
        theta += direction * 0.99 * fastest * TS
        _, learned = memory.step(theta % (2 * math.pi), 0.0, True, [0.0])
    assert learned and abs(memory.map()).max() < 1e-3


@pytest.mark.parametrize("kind", LINES)
@pytest.mark.parametrize("lead, width, samples", [(0, 0, 4), (5, 0, 20), (0, 40, 41), (3, 40, 41)])
def test_above_its_fastest_speed_a_line_learns_nothing(kind, lead, width, samples):
    library = control_library("double")
    line = DelayLine(kind=kind, ts=TS, cells=100, q_half_width=width, lead=lead, limit=[1.0])
    fastest = library.lib.cgl_memory_fastest(CMemory(library, line).state)
    assert fastest == pytest.approx(2 * math.pi / (samples * TS))
    for share, learns in ((0.98, True), (1.03, False)):
        memory, theta = CMemory(library, line), 0.0
        for _ in range(400):
            theta += share * fastest * TS
            _, learned = memory.step(theta % (2 * math.pi), share * fastest, True, [0.1])
        assert learned == learns


# ---- interpolation and filter


@pytest.mark.parametrize("samples", [32.0, 33.37, 50.5, 99.99])
@pytest.mark.parametrize("kind", ["angle", "time"])
def test_a_periodic_signal_comes_back_one_period_later(kind, samples):
    """At any constant speed, with a fraction of a sample in the period: linear interpolation errs by h^2 / 8
    times the second derivative, once at writing and once at reading (by angle), with h the larger of sample
    and cell."""
    omega = 2 * math.pi / (samples * TS)
    cells = 40 if kind == "angle" else 101
    memory = CMemory(
        control_library("double"),
        AngleMemory(cells=cells, limit=[10.0])
        if kind == "angle"
        else DelayLine(kind="time", ts=TS, cells=cells, limit=[10.0]),
    )
    worst = 0.0
    for k in range(700):
        theta = omega * TS * k
        recalled = memory.store(theta, math.sin(theta), omega)
        if k > 2 * samples + 2:
            worst = max(worst, abs(recalled - math.sin(theta)))
    sample, cell = 2 * math.pi / samples, 2 * math.pi / cells
    bound = (sample**2 + cell**2) / 8 if kind == "angle" else sample**2 / 8
    assert worst <= 1.001 * bound + 1e-7 * (kind == "angle")
    if kind == "time" and samples == 32.0:
        assert worst < 1e-12  # a whole number of samples is exact


@pytest.mark.parametrize("kind", ["angle", "time"])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("harmonic", [1, 3, 7])
def test_q_filter_has_zero_phase(kind, direction, harmonic):
    """A harmonic comes out of the filter smaller by the mean's own gain, and not shifted: the quadrature part
    is zero."""
    width, samples = 5, 60
    sizes: dict[str, Any] = {"q_half_width": width, "limit": [10.0]}
    memory = CMemory(
        control_library("double"),
        AngleMemory(cells=samples, **sizes)
        if kind == "angle"
        else DelayLine(kind="time", ts=TS, cells=70, **sizes),
    )
    omega = direction * 2 * math.pi / (samples * TS)
    got, theta = np.zeros((2, samples))
    for k in range(4 * samples):
        theta[k % samples] = 1e-7 + omega * TS * k
        value = math.cos(harmonic * theta[k % samples])
        got[k % samples] = memory.store(theta[k % samples], value, omega)
    part = np.mean(got * np.exp(-1j * harmonic * theta)) * 2
    x = math.pi * harmonic / samples
    gain = math.sin((2 * width + 1) * x) / ((2 * width + 1) * math.sin(x))
    assert abs(part - gain) < 2e-6


def test_interpolation_error_falls_with_the_square_of_the_sampling():
    errors = []
    for samples in (20.5, 41.5, 82.5, 164.5):
        memory = CMemory(control_library("double"), DelayLine(kind="time", ts=TS, cells=200, limit=[10.0]))
        omega = 2 * math.pi / (samples * TS)
        worst = 0.0
        for k in range(600):
            got = memory.store(0.0, math.sin(omega * TS * k), omega)
            worst = max(worst, abs(got - math.sin(omega * TS * k)) if k > samples + 2 else 0.0)
        errors.append(worst)
    sampling = np.log(np.divide([41.5, 82.5, 164.5], [20.5, 41.5, 82.5]))
    assert np.all(abs(np.log(np.divide(errors[:-1], errors[1:])) / sampling - 2) < 0.05)


# ---- lines


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("omega", [0.0, 0.5, 1e4, math.nan, math.inf, 1e-40, -0.5])
def test_by_time_a_period_outside_the_memory_waits(precision, omega):
    memory = CMemory(
        control_library(precision), DelayLine(kind="time", ts=TS, cells=100, q_half_width=10, limit=[9.0])
    )
    for _ in range(50):
        last, learned = memory.step(0.0, 2 * math.pi / 0.05, True, [1.0])
        assert learned
    assert memory.step(0.0, omega, True, [1.0]) == (last, False)
    assert memory.step(0.0, -2 * math.pi / 0.05, True, [1.0])[1]  # by its size


def test_a_line_waits_while_the_angle_does_not_rise():
    """The values stay, and it goes on when the angle passes the place where it waited."""
    line = DelayLine(kind="inversion", ts=TS, cells=800, limit=[10.0])
    memory = CMemory(control_library("double"), line)

    def go(angles, speed=1.0):
        for theta in angles:
            recalled, learns = memory.recall(float(theta % (2 * np.pi)), speed)
            memory.store(float(theta % (2 * np.pi)), math.sin(theta), speed)
            yield recalled, learns

    list(go(np.arange(0, 14, 0.0123)))
    last, known, p_t = memory.acted()[0], memory.state.line.known, memory.state.line.p_t
    for value, learns in [
        *go(np.full(50, 14.0), 0.0),
        *go(np.linspace(13.99, 13.5, 60)),
        *go(np.linspace(13.5, 13.98, 50)),
    ]:
        assert not learns
        assert value == last
    assert (memory.state.line.known, memory.state.line.p_t) == (known, p_t)
    again = np.arange(14.0001, 24, 0.0123)
    for theta, (value, learns) in zip(again, go(again), strict=True):
        assert learns
        assert abs(value - math.sin(theta)) < 0.02


@functools.cache
def varying(ts: float, seconds: float) -> np.ndarray:
    """Angle [rad] of Section 5's electrical reference, 15 + 5 sin(2 pi t + sin(pi t)), by Gauss
    integration."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    start = ts * np.arange(round(seconds / ts))

    def omega(t):
        return 15.0 + 5.0 * np.sin(2 * np.pi * t + np.sin(np.pi * t))

    steps = sum(w * omega(start + ts * (1 + x) / 2) for x, w in zip(nodes, weights, strict=True)) * ts / 2
    return np.concatenate([[0.0], np.cumsum(steps)[:-1]])


@functools.cache
def inverse(ts: float, seconds: float) -> np.ndarray:
    """P_t of each 97th sample [s] by a cubic spline through the reference; NaN within the first period."""
    from scipy.interpolate import CubicSpline
    from scipy.optimize import brentq

    theta = varying(ts, seconds)
    t = ts * np.arange(len(theta))
    curve = CubicSpline(t, theta)
    p_t = np.full(len(t), np.nan)
    for n in range(0, len(t), 97):
        if theta[n] > 2 * np.pi:
            p_t[n] = t[n] - brentq(lambda s, n=n: curve(s) - theta[n] + 2 * np.pi, 0.0, t[n], xtol=1e-15)
    return p_t


def run_p_t(library, method: str, theta: np.ndarray, ts: float) -> np.ndarray:
    memory = CMemory(library, DelayLine(kind=method, ts=ts, cells=8000, limit=[1.0]))
    p_t = np.zeros(len(theta))
    for n, x in enumerate((theta % (2 * np.pi)).tolist()):
        memory.step(x)
        p_t[n] = memory.state.line.p_t
    return p_t


@pytest.mark.parametrize("method", ["ode", "inversion"])
def test_p_t_by_both_methods_is_the_inverse_of_the_reference(method):
    """Inversion by straight lines errs by (dx/dt)' ts^2 / 8 of angle at most: 47 rad/s^2 (2 pi 5 (1 + 1/2))
    and 100 us give 6e-8 rad, or 6e-9 s at 10 rad/s; and an angle is known to 2^-32 of a revolution, 1.5e-10 s
    there. By the differential equation Euler's error of a step comes on top, held by k_pp."""
    ts = 1e-4
    theta, exact = varying(ts, 2.6), inverse(ts, 2.6)
    known = np.flatnonzero(~np.isnan(exact))
    got = run_p_t(control_library("double"), method, theta, ts)
    error = abs(got - exact)[known].max()
    assert error < (1e-8 if method == "inversion" else 4e-5)
    steps = np.diff(got[known[1] :])
    assert abs(np.diff(steps)).max() < 1e-6  # smooth


@pytest.mark.parametrize("method", ["ode", "inversion"])
def test_p_t_in_single_precision_does_not_drift(method):
    """An angle is known to some eps 2 pi, the reference has 10 rad/s at least: P_t is within a microsecond or
    so, and stays so for 60 periods, at which sums would have drifted."""
    theta = varying(TS, 30.0)
    exact = run_p_t(control_library("double"), method, theta, TS)
    got = run_p_t(control_library("float"), method, theta, TS)
    both = (exact > 0) & (got > 0)
    assert both.sum() > 0.97 * len(theta)
    assert abs(got - exact)[both].max() < 3e-6


def test_p_t_by_its_equation_recovers_from_a_wrong_value():
    """The error in angle falls by exp(-k_pp t)."""
    ts = 1e-4
    theta = varying(ts, 2.5)
    library = control_library("double")
    memory = CMemory(library, DelayLine(kind="ode", ts=ts, cells=8000, limit=[1.0]))
    true = run_p_t(library, "ode", theta, ts)
    errors = []
    for n, x in enumerate((theta % (2 * np.pi)).tolist()):
        if n == 12000:
            memory.state.line.part += 7.0  # as many samples as its place moves in a step
        memory.step(x)
        errors.append(memory.state.line.p_t - true[n])
    assert 6e-4 < errors[12000] < 8e-4
    assert abs(errors[22000]) < 2 * math.exp(-10) * 7e-4  # the speed back then has at most doubled


@pytest.mark.parametrize("method", ["ode", "inversion"])
def test_a_line_of_more_samples_than_16_bit_count_finds_the_angle(method):
    """The longest period of the line has 65,600 samples, and what was stored then is what comes back."""
    slow = 65_600
    memory = CMemory(control_library("double"), DelayLine(kind=method, ts=TS, cells=70_000, limit=[1.0]))
    step, correction, value = memory.library.lib.cgl_memory_step, memory.correction, memory.value
    for n in range(slow - 10):  # nothing is recalled yet: what acts is the correction
        theta = n / slow * 2 * math.pi
        correction[0] = math.sin(theta)
        assert step(memory.state, theta, 1.0, True, correction, value)
    correction[0] = 0.0
    for n in range(slow + 10, slow + 3000):
        theta = n % slow / slow * 2 * math.pi
        step(memory.state, theta, 1.0, True, correction, value)
        if n > slow + 30:
            assert memory.state.line.p_t == pytest.approx((slow - 20) * TS, abs=2 * TS)
            assert abs(value[0] - math.sin(theta)) < 1e-3


@pytest.mark.parametrize("method", ["ode", "inversion"])
def test_a_line_that_rises_with_time_is_read_exactly(method):
    """A channel that holds the time of its sample: what is recalled is t - P_t, whatever the speed; and the
    mean over any width is the same, as the filter is symmetric."""
    ts = 5e-4
    theta = varying(ts, 2.0) % (2 * np.pi)
    for width in (0, 9):
        line = DelayLine(kind=method, ts=ts, cells=1600, q_half_width=width, limit=[1e3])
        memory = CMemory(control_library("double"), line)
        checked = 0
        for n, x in enumerate(theta.tolist()):
            recalled = memory.store(x, n * ts)
            p_t = memory.state.line.p_t
            if p_t > 0 and n * ts - p_t > (width + 1) * ts:
                assert abs(recalled - (n * ts - p_t)) < 1e-12
                checked += 1
        assert checked > 2000


def test_a_line_too_short_for_the_period_says_so():
    """A period of 500 samples: a line of 400 learns at first from what it takes for nothing, then freezes."""
    memory = CMemory(control_library("double"), DelayLine(kind="inversion", ts=TS, cells=400, limit=[3.0]))
    learned = [memory.step(n * 2 * np.pi / 500 % (2 * np.pi), 1.0, True, [0.1])[1] for n in range(1500)]
    assert all(learned[:400])
    assert not any(learned[402:])
    assert memory.state.line.p_t == 0.0


def test_positions_are_whole_parts_of_the_period():
    """2^32 of them: the reference's place is the C's, in float and double, with turns and parts and a
    ratio."""
    rng = np.random.default_rng(4)
    for precision, real in (("float", np.float32), ("double", float)):
        for turns, parts in PERIODS:
            reference = AngleMemory(cells=1000, turns=turns, parts=parts, ratio=7, limit=[1.0], real=real)
            memory = CMemory(control_library(precision), reference)
            for theta in np.concatenate([rng.uniform(-9, 9, 100), rng.uniform(-1e5, 1e5, 40)]):
                place = float(memory.library.real(theta))
                reference.step(place, 0.0, True, [0.0])
                memory.step(place)
                assert memory.state.map.x == reference.x < WHOLE


def test_config_fields_are_those_of_the_reference():
    """A new field of the config has a place in the reference, or is a count of channels."""
    library = control_library("float")
    fields = {name for name, _ in library.ffi.typeof("cgl_memory_config").fields}
    known = {f.name for kind in (AngleMemory, DelayLine) for f in dataclasses.fields(kind)}
    assert fields - known == {"channels", "method"}
