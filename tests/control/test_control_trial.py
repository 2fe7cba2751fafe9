"""The trial law of the C library against its transcription, and how it behaves."""

import math
import re
import subprocess
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from control_library import SOURCE, ControlLibrary, control_library
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.trial import Trial, feedforward
from scipy.signal import butter
from test_control_zero_phase import l1
from test_control_zero_phase import rounding as filter_rounding

SAME = (
    "samples",
    "k_2",
    "n",
    "through_integrator",
    "k_3",
    "shift",
    "limit",
    "learned_limit",
    "filter_signal",
)
TERMS = ("feedback", "integral", "feedforward", "learned")


@pytest.fixture(params=["float", "double"])
def library(request) -> ControlLibrary:
    return control_library(request.param)


class CTrial:
    """The C law with the config of a reference, called alike."""

    def __init__(self, library: ControlLibrary, law: Trial):
        self.library, self.lib, self.samples = library, library.lib, law.samples
        self.order = len(law.b) - 1
        matrix = law.learning_matrix
        fields: dict[str, Any] = {name: getattr(law, name) for name in SAME}
        fields |= {
            "states": len(law.k_1),
            "k_1": list(law.k_1),
            "c": list(law.c),
            "feedforward": {
                "numerator": len(law.num),
                "denominator": len(law.den),
                "preview": law.preview,
                "num": list(law.num),
                "den": list(law.den),
            },
            "observer": {"response": law.response, "pole": law.pole},
            "q_filter": {"order": self.order, "b": list(law.b), "a": list(law.a), "odd": law.odd},
        }
        if matrix is not None:
            fields["learning_matrix"] = library.array([*matrix.ravel(), math.nan])[1]  # nor is more read
        self.config = library.new("cgl_trial_config", **fields)
        self.state = library.new("cgl_trial")
        self.memory, pointer = library.array(np.full((3 if self.order else 2) * law.samples, 7.0))
        error = self.lib.cgl_trial_init(self.state, self.config, pointer, len(self.memory))
        assert error == self.lib.CGL_OK
        self.input, self.output = library.new("cgl_trial_input"), library.new("cgl_trial_output")

    def begin(self, y_ref) -> None:
        self.lib.cgl_trial_begin(self.state, self.library.array(y_ref)[1])

    def step(self, x, learn: bool = True) -> float:
        rest = [0.0] * (self.config.states - len(x)) + [math.nan] * (8 - self.config.states)
        self.input.x = [*x, *rest]
        self.input.learn = learn
        self.lib.cgl_trial_step(self.state, self.input, self.output)
        return float(self.output.u)

    def end(self) -> bool:
        return bool(self.lib.cgl_trial_end(self.state))

    def reset(self) -> None:
        self.lib.cgl_trial_reset(self.state)

    @property
    def v(self) -> np.ndarray:
        return self.memory[: self.samples].copy()

    @property
    def terms(self) -> dict[str, float]:
        return {name: getattr(self.state.terms, name) for name in TERMS}

    @property
    def status(self) -> int:
        return int(self.output.status)


def rounded(values, real):
    return np.asarray(values).astype(real).astype(float).tolist()


def random_law(rng, real, matrix: bool = False) -> Trial:
    def draw(size, low, high):
        return rounded(rng.uniform(low, high, size), real)

    states, samples = int(rng.integers(1, 9)), int(rng.integers(40, 120))
    order = int(rng.integers(0, 5))
    # where a narrow filter of a high order loses digits, so does the oracle
    b, a = butter(order, rng.uniform([0, 0.05, 0.1, 0.12, 0.15][order], 0.8)) if order else ([1.0], [1.0])
    odd = bool(rng.integers(2))
    numerator, denominator = int(rng.integers(0, 5)), int(rng.integers(1, 4))
    den = np.atleast_1d(np.poly(rng.uniform(-0.8, 0.8, denominator - 1)))
    scalar = draw(5, [-0.3, -2, 0.2, 5, 0.3], [0.3, 2, 0.9, 12, 2])
    return Trial(
        samples,
        draw(states, -1, 1),
        scalar[0] if rng.random() < 0.7 else 0.0,
        scalar[1],
        draw(states, -1, 1),
        bool(rng.integers(2)),
        scalar[2],
        int(rng.integers(1, 5)),
        scalar[3],
        scalar[4],
        draw(numerator, -2, 2),
        rounded(den, real),
        int(rng.integers(0, 6)),
        rounded(b, real),
        rounded(a, real),
        odd,
        bool(rng.integers(2)),
        np.array(draw((samples, samples), -0.05, 0.05)) if matrix else None,
    )


def random_reference(rng, samples, real):
    return np.array(rounded(np.cumsum(rng.normal(0, 0.2, samples)) + rng.uniform(-1, 1), real))


def expected_status(lib, law: Trial) -> int:
    frozen = not law.within or law.spoilt or law.saturated or law.fault
    return (
        lib.CGL_STATUS_SATURATED * law.saturated
        | lib.CGL_STATUS_FAULT * law.fault
        | lib.CGL_STATUS_FROZEN * frozen
    )


def with_observer(rng, real) -> Trial:
    """Inputs of a few units move y by the size of the limits' errors."""
    law = random_law(rng, real)
    law.k_2, law.shift = 0.0, 2
    law.response, law.pole = rounded([rng.uniform(0.05, 0.5), rng.uniform(0.0, 0.9)], real)
    law.limit *= 5
    return law


@pytest.mark.parametrize("kind", ["gain", "matrix", "observer"])
@pytest.mark.parametrize("seed", range(15))
def test_double_equals_the_reference(seed, kind):
    """Several trials, each with a reference of its own: whole ones, and ones that are cut short, held beyond
    the end, hit by a fault, or with learning off."""
    rng = np.random.default_rng([seed, kind == "matrix"])
    library = control_library("double")
    observes = kind == "observer"
    law = with_observer(rng, np.float64) if observes else random_law(rng, np.float64, kind == "matrix")
    c = CTrial(library, law)
    for trial in range(6):
        y_ref = random_reference(rng, law.samples, np.float64)
        law.begin(y_ref)
        c.begin(y_ref)
        how = ["whole", "short", "long", "fault", "frozen"][trial % 5 if trial < 5 else 0]
        steps = law.samples + {"short": -1 - trial, "long": 30}.get(how, 0)
        odd = int(rng.integers(law.samples))
        x = np.cumsum(rng.normal(0, 0.2, (steps, len(law.k_1))), axis=0)
        x[rng.random(steps) < 0.02] *= 20  # into saturation
        psi = 0.0
        for p in range(steps):
            if how == "fault" and p == odd:
                x[p, int(rng.integers(len(law.k_1)))] = rng.choice([math.nan, math.inf, -math.inf])
            learn = not (how == "frozen" and p == odd)
            got, expected = c.step(x[p], learn), law.step(x[p], learn)
            psi = max(psi, abs(law.psi))
            scale = law.limit + sum(map(abs, law.terms.values())) + abs(law.k_2) * psi
            scale += 100 / law.response if observes else 0.0
            assert abs(got - expected) <= 1e-12 * scale, (trial, p)
            assert c.status == expected_status(library.lib, law), (trial, p)
            for name in TERMS:
                assert abs(c.terms[name] - law.terms[name]) <= 1e-12 * scale, (trial, p, name)
        assert c.end() == law.end() == (how in ("whole", "long"))
        assert abs(c.v - law.v).max() <= 1e-12 * (law.learned_limit + abs(law.e).max())


def double_integrator(c: CTrial, y_ref, strength: float, load, trials: int) -> list[float]:
    """The RMS of the error of each trial, on y'' = strength (u - load) held over a sample."""
    found = []
    for _ in range(trials):
        y = speed = float(0)
        errors = []
        c.begin(y_ref)
        for p, wanted in enumerate(y_ref):
            errors.append(wanted - y)
            push = strength * (c.step([y]) - load[p])
            y, speed = y + speed + push / 2, speed + push
        assert c.end()
        found.append(float(np.sqrt(np.mean(np.square(errors)))))
    return found


def observed(samples: int, **changes: Any) -> Trial:
    """The law as the design sets it up: it learns the missing input, without a filter unless changed."""
    fields = {"n": 1.0, "k_3": 1.0, "shift": 2, "limit": 1e3, "learned_limit": 1e3, "filter_signal": True}
    return plain(samples, **(fields | {"response": 0.1, "pole": 0.4} | changes))


@pytest.mark.parametrize("beta", [0.6, 1.0, 1.3])
def test_what_was_missing_is_learned_in_a_trial(beta):
    """A slow load: the next trial leaves |1 - beta| of it at most, less what the feedback took already."""
    library, samples = control_library("double"), 200
    load = np.sin(2 * math.pi * np.arange(samples) / samples)
    c = CTrial(library, observed(samples))
    first, second, third = double_integrator(c, np.zeros(samples), 0.1 * beta, load, 3)
    assert second < (abs(1 - beta) + 0.05) * first and third < 0.3 * first


def test_the_missing_input_is_what_the_plant_took():
    """With the right response r is the load, but that load - u is smoothed by cos^2 of half a sample."""
    library, samples = control_library("double"), 120
    c = CTrial(library, observed(samples))
    load = 2 + np.cos(2 * math.pi * np.arange(samples) / 40)
    y = speed = 0.0
    u = np.zeros(samples)
    c.begin(np.zeros(samples))
    for p in range(samples):
        u[p] = c.step([y])
        push = 0.1 * (u[p] - load[p])
        y, speed = y + speed + push / 2, speed + push
    assert c.end()
    smooth = np.convolve(load - u, [0.25, 0.5, 0.25], mode="same")
    assert c.v[1:-2] == pytest.approx((u + smooth)[1:-2], abs=1e-9)


@pytest.mark.parametrize("p", [0.0, 0.3, 0.7])
def test_the_loop_has_the_poles_of_the_config(p):
    """The error after a step of the load obeys the polynomial of two poles of the feedback, three of the
    observer; a constant load leaves nothing."""
    library, samples = control_library("double"), 90
    c = CTrial(library, observed(samples, pole=p, k_3=0.0))
    errors, y, speed = [], 0.0, 0.0
    c.begin(np.zeros(samples))
    for k in range(samples):
        errors.append(-y)
        push = 0.1 * (c.step([y]) - (1.0 if k >= 10 else 0.0))
        y, speed = y + speed + push / 2, speed + push
    assert max(map(abs, errors)) > 1e-2
    residue = np.convolve(errors, np.poly([p] * 5))[10 + 7 : samples]
    assert residue == pytest.approx(0, abs=1e-12)


def test_a_fault_does_not_lose_the_load(library):
    """Through a sample without a measurement the observer goes on; one beyond all numbers starts it anew."""
    c = CTrial(library, observed(60, k_3=0.0))
    c.begin(np.zeros(60))
    y = speed = 0.0
    for k in range(40):
        push = 0.1 * (c.step([math.nan if k == 30 else y]) - 1.0)
        assert (c.status & library.lib.CGL_STATUS_FAULT != 0) == (k == 30)
        y, speed = y + speed + push / 2, speed + push
    assert c.terms["integral"] == pytest.approx(1.0, abs=0.01)
    biggest = float(np.finfo(c.memory.dtype).max)
    c.step([-biggest])
    assert c.status & library.lib.CGL_STATUS_FAULT
    assert math.isfinite(c.step([0.0]))


class Rounding:
    """What rounding does to the law at most, step by step along the reference: each sum of m products is off
    by (m + 1) eps of the sum of their sizes, and what enters a sum with an error leaves with it."""

    def __init__(self, law: Trial, eps: float):
        self.law, self.eps, self.v = law, eps, np.zeros(law.samples)
        # the recursion's errors act through 1 / den; its start is off as the ratio of sums is
        self.recursion = l1([1.0], law.den)

    def begin(self) -> None:
        law, eps = self.law, self.eps
        taps = len(law.num) + len(law.den)
        largest, sum_den = abs(law.f).max(), abs(np.array(law.den)).sum()
        drive = abs(np.array(law.num)).sum() * abs(law.y_ref).max()
        start = taps * (drive + sum_den * largest) / abs(sum(law.den))
        self.f = (taps + 1) * eps * self.recursion * (drive + sum_den * (largest + start))
        self.psi, self.e, self.p = 0.0, np.zeros(law.samples), 0

    def step(self, x) -> float:
        """The bound on u, for the state before the step."""
        law, eps = self.law, self.eps
        held = min(self.p, law.samples - 1)
        m, kx, cx = len(x) + 1, np.dot(np.abs(law.k_1), np.abs(x)), np.dot(np.abs(law.c), np.abs(x))
        u = m * eps * kx + abs(law.k_2) * (self.psi + eps * abs(law.psi)) + self.f
        u += abs(law.n) * (self.v[held] + eps * abs(law.v[held]))
        u += 4 * eps * (kx + abs(law.k_2 * law.psi) + abs(law.f[self.p]) + abs(law.n * law.v[held]))
        e = m * eps * cx + eps * (abs(law.y_ref[held]) + cx)
        self.psi += e + self.v[held] + 2 * eps * (abs(law.psi) + cx + abs(law.y_ref[held]) + abs(law.v[held]))
        if self.p < law.samples:
            self.e[self.p] = e
        self.p += 1
        return u

    def end(self, e: np.ndarray, before: np.ndarray) -> None:
        """e: as it is added, before the filter."""
        law, eps = self.law, self.eps
        b, a = np.array(law.b), np.array(law.a)
        if law.learning_matrix is not None:
            size = abs(law.learning_matrix)
            added = size @ self.e + (law.samples + 1) * eps * (size @ abs(e))
        else:
            error = self.e
            if len(b) > 1 and not law.filter_signal:
                error = np.full(law.samples, through_filter(b, a, error) + filter_rounding(b, a, e, 2 * eps))
                e = law.filtered(e)
            late = np.minimum(np.arange(law.samples) + law.shift, law.samples - 1)
            added = law.k_3 * (error + 2 * eps * abs(e))[late]
        self.v = self.v + added + eps * (abs(before) + 2 * law.learned_limit)
        if len(b) > 1 and law.filter_signal:
            own = filter_rounding(b, a, np.full(len(before), law.learned_limit), 2 * eps)
            self.v = np.full(law.samples, through_filter(b, a, self.v) + own)


def through_filter(b, a, error: np.ndarray) -> float:
    """The largest error after both passes of one before them; the extension triples it, and a pass starts in
    the steady state of its first sample."""
    gain = l1(b, a) + abs(b.sum() / a.sum()) * l1([1.0], a) * abs(a).sum()
    return 3 * gain**2 * float(error.max())


@pytest.mark.parametrize("matrix", [False, True])
@pytest.mark.parametrize("seed", range(15))
def test_single_stays_within_rounding(seed, matrix):
    """With no seed here does a decision at the limit lie within rounding."""
    rng = np.random.default_rng([100 + seed, matrix])
    library = control_library("float")
    law = random_law(rng, np.float32, matrix)
    c, bound = CTrial(library, law), Rounding(law, library.eps)
    for _ in range(4):
        y_ref = random_reference(rng, law.samples, np.float32)
        law.begin(y_ref)
        c.begin(y_ref)
        bound.begin()
        x = np.cumsum(rng.normal(0, 0.1, (law.samples, len(law.k_1))), axis=0)
        x[rng.random(law.samples) < 0.01] *= 20
        x = np.array(rounded(x, np.float32))
        for p in range(law.samples):
            u = bound.step(x[p])
            got, expected = c.step(x[p]), law.step(x[p])
            assert abs(got - expected) <= u, p
            assert c.status == expected_status(library.lib, law)
        before = law.v.copy()
        assert c.end() and law.end()
        bound.end(law.e, before)
        assert (abs(c.v - law.v) <= bound.v).all()


# ---- behaviour ----


def plain(samples: int = 20, states: int = 1, **changes: Any) -> Trial:
    """u = v, y = x_1, v <- v + e(p + 1) / 2, unless changed."""
    one = [1.0] + [0.0] * (states - 1)
    fields = {"k_1": [0.0] * states, "k_2": 0.0, "n": 1.0, "c": one, "through_integrator": False}
    fields |= {"k_3": 0.5, "shift": 1, "limit": 100.0, "learned_limit": 50.0}
    return Trial(samples, **(fields | changes))


def one_trial(c: CTrial, y_ref, x, learn: bool = True) -> bool:
    c.begin(y_ref)
    for value in x:
        c.step([value], learn)
    return c.end()


def taught(library, **changes) -> CTrial:
    """A law that has learned something."""
    c = CTrial(library, plain(**changes))
    assert one_trial(c, np.ones(20), np.linspace(0, 1.5, 20))
    assert np.ptp(c.v) > 0.1
    return c


def test_before_begin_the_output_is_zero(library):
    c = CTrial(library, plain(k_1=[2.0]))
    assert c.step([1.0]) == 0.0 and c.status == library.lib.CGL_STATUS_FROZEN
    assert not c.end()
    c.lib.cgl_trial_begin(c.state, library.ffi.NULL)
    assert c.step([1.0]) == 0.0 and c.status == library.lib.CGL_STATUS_FROZEN
    assert not c.end()


def test_init_and_reset_clear_what_is_learned(library):
    c = taught(library)
    c.reset()
    assert not c.memory.any()
    assert c.step([1.0]) == 0.0 and c.status == library.lib.CGL_STATUS_FROZEN


@pytest.mark.parametrize("steps", [0, 1, 19])
def test_a_trial_cut_short_teaches_nothing(library, steps):
    c = taught(library)
    v = c.v
    assert not one_trial(c, np.zeros(20), np.full(steps, 3.0))
    assert c.v.tobytes() == v.tobytes()
    # nor does it leave anything to the next one, ended or not
    c.begin(np.zeros(20))
    c.step([3.0])
    fresh = taught(library)
    for law in (c, fresh):
        assert one_trial(law, np.zeros(20), np.ones(20))
    assert c.v.tobytes() == fresh.v.tobytes()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("p", [0, 7, 19])
@pytest.mark.parametrize("gain", [0.0, -1.0])
def test_a_fault_gives_zero_and_spoils_the_trial(library, bad, p, gain):
    c = taught(library, states=2, k_1=[0.0, gain], k_2=0.1, through_integrator=True)
    v, fault = c.v, library.lib.CGL_STATUS_FAULT | library.lib.CGL_STATUS_FROZEN
    c.begin(np.ones(20))
    for q in range(20):
        psi = c.state.psi
        u = c.step([0.5, bad if q == p else 0.5])
        if q == p:
            assert u == 0.0 and c.status == fault and c.state.psi == psi
        else:
            assert u != 0.0 and c.status == (library.lib.CGL_STATUS_FROZEN if q > p else 0)
    assert not c.end()
    assert c.v.tobytes() == v.tobytes()
    assert one_trial(c, np.ones(20), np.zeros(20))  # the next one is sound again


def test_a_reference_that_is_no_number_is_a_fault(library):
    c = taught(library, num=[1.0, -0.5], den=[1.0, -0.5], preview=3)
    v = c.v
    y_ref = np.ones(20)
    y_ref[10] = math.nan
    c.begin(y_ref)
    fault = library.lib.CGL_STATUS_FAULT | library.lib.CGL_STATUS_FROZEN
    for p in range(20):
        u = c.step([0.0])
        # in the feedforward 3 and 2 samples ahead
        assert (c.status == fault and u == 0.0) if p in (7, 8, 10) else u != 0.0, p
    assert not c.end()
    assert c.v.tobytes() == v.tobytes()


def test_a_state_too_large_for_its_gain_is_a_fault(library):
    c = CTrial(library, plain(states=2, k_1=[10.0, -10.0]))
    c.begin(np.zeros(20))
    huge = float(np.finfo(library.real).max)
    assert c.step([huge, huge]) == 0.0
    assert c.status & library.lib.CGL_STATUS_FAULT


def test_learning_off_anywhere_teaches_nothing(library):
    c = taught(library)
    v = c.v
    for off in (0, 10, 19):
        c.begin(np.zeros(20))
        for p in range(20):
            c.step([1.0], learn=p != off)
            assert bool(c.status & library.lib.CGL_STATUS_FROZEN) == (p >= off)
        assert not c.end()
    assert c.v.tobytes() == v.tobytes()


def test_a_trial_teaches_once(library):
    c = taught(library)
    v = c.v
    assert not c.end()
    assert c.v.tobytes() == v.tobytes()


def test_beyond_the_end_the_last_sample_is_held_and_teaches_nothing(library):
    """Also while end learns, and after it: the law leaves the memory alone."""
    y_ref = np.linspace(0, 1, 20)
    law = plain(k_1=[-2.0], num=[1.0, 1.0], preview=2)
    first, second = CTrial(library, law), CTrial(library, law)
    assert one_trial(first, y_ref, np.zeros(20)) and one_trial(second, y_ref, np.zeros(20))
    for c in (first, second):
        c.begin(y_ref)
        for _ in range(20):
            u = c.step([0.25])
    held = [first.step([0.25]) for _ in range(100)]
    # v(alpha - 1) = (y_ref(alpha - 1) - 0) / 2
    assert held == [u] * 100 == [pytest.approx(-0.5 + 2 + 0.5)] * 100
    assert first.status == library.lib.CGL_STATUS_FROZEN
    first.step([math.nan])  # no fault of the trial any more
    assert first.end() and second.end()
    assert first.v.tobytes() == second.v.tobytes()
    assert first.step([0.25]) == u


@pytest.mark.parametrize("shift", [1, 2, 5, 19])
def test_the_ends_are_as_in_the_paper(library, shift):
    """v(p) gets K_3 e(p + r); beyond the end e(alpha - 1); the first r samples of e are not used."""
    x = np.random.default_rng(shift).normal(size=20)
    c = CTrial(library, plain(shift=shift))
    one_trial(c, np.zeros(20), x)
    e = -x.astype(library.real)
    expected = [0.5 * e[min(p + shift, 19)] for p in range(20)]
    assert c.v.tolist() == expected
    # with a matrix, what comes before sample r is not used either
    c = CTrial(library, plain(shift=shift, learning_matrix=np.eye(20)))
    one_trial(c, np.zeros(20), x)
    assert c.v.tolist() == [0.0] * shift + e[shift:].tolist()


@pytest.mark.parametrize("shift", [1, 3, 32, 47])
def test_a_saturated_sample_teaches_nothing(library, shift):
    """u(p) at its limit: e(p + r) says nothing about v(p)."""
    samples, limited = 50, {0, 4, 5, 17, 49 - shift}
    c = CTrial(library, plain(samples, k_1=[1.0], k_3=1.0, limit=1.0, shift=shift))
    x = np.full(samples, 0.5)
    x[list(limited)] = 2.0
    c.begin(np.full(samples, 3.0))
    for p in range(samples):
        u = c.step([x[p]])
        both = library.lib.CGL_STATUS_SATURATED | library.lib.CGL_STATUS_FROZEN
        assert (u, c.status) == ((1.0, both) if p in limited else (0.5, 0))
    assert c.end()
    for p in range(samples):
        q = min(p + shift, samples - 1)
        assert c.v[p] == (0.0 if q - shift in limited else 3.0 - x[q]), p


@pytest.mark.parametrize("k_2", [2.0, -2.0])
def test_the_integral_does_not_wind_up(library, k_2):
    """At the limit psi holds where it would push further, and moves where it leads back."""
    c = CTrial(library, plain(1000, k_2=k_2, limit=1.0))
    c.begin(np.zeros(1000))
    u = [c.step([-0.1 * np.sign(k_2)]) for _ in range(500)]
    assert u[-1] == 1.0 and c.terms["integral"] <= 1.2 + 1e-6
    u = [c.step([0.1 * np.sign(k_2)]) for _ in range(4)]
    assert u[-1] < 1.0


def test_v_stays_within_its_limit(library):
    c = CTrial(library, plain(learned_limit=0.75))
    for sign in (1, -1, -1):
        assert one_trial(c, np.full(20, sign * 10.0), np.zeros(20))
        assert abs(c.v).max() <= 0.75
    assert c.v.min() == -0.75
    b, a = butter(2, 0.3)
    wide = CTrial(library, plain(40, learned_limit=0.75, b=list(b), a=list(a), filter_signal=True))
    for _ in range(5):  # the filter overshoots at an edge
        assert one_trial(wide, np.sign(np.arange(40) - 20.5) * 10, np.zeros(40))
        assert abs(wide.v).max() <= 0.75


@pytest.mark.parametrize("filter_signal", [False, True])
def test_no_learning_gain_learns_nothing(library, filter_signal):
    b, a = butter(2, 0.3)
    c = CTrial(library, plain(k_3=0.0, b=list(b), a=list(a), filter_signal=filter_signal))
    assert one_trial(c, np.ones(20), np.zeros(20))
    assert not c.v.any()


def test_filtering_the_signal_forgets_what_is_above_the_cut_off(library):
    """Q on e leaves what v has above the cut-off for ever; Q on v takes it away."""
    b, a = butter(2, 0.3)
    left = {}
    for filter_signal in (False, True):
        c = CTrial(library, plain(60, b=list(b), a=list(a), filter_signal=filter_signal))
        c.memory[:60] = (-1.0) ** np.arange(60)
        for _ in range(3):
            assert one_trial(c, np.zeros(60), np.zeros(60))
        left[filter_signal] = abs(c.v[20:40]).max()
    assert left[False] == 1.0 and left[True] < 1e-3


# ---- with a plant ----


def lifted(A, B, C, samples: int) -> np.ndarray:
    """Input to output over the trial."""
    markov = [0.0]
    state = B
    for _ in range(samples - 1):
        markov.append(float(C @ state))
        state = A @ state
    return np.array([[markov[p - q] if p > q else 0.0 for q in range(samples)] for p in range(samples)])


def closed(A, B, law: Trial):
    """(14), (15): from v to y with the loop closed."""
    n = len(law.k_1)
    C, k_s = np.append(law.c, 0.0), np.append(law.k_1, law.k_2)
    A_s = np.block([[A, np.zeros((n, 1))], [-np.array(law.c)[None], np.ones((1, 1))]])
    B_s = np.append(B, 0.0)
    return A_s + np.outer(B_s, k_s), np.append(B * law.n, float(law.through_integrator)), C


def simulate(c: CTrial, A, B, C, y_ref, load) -> np.ndarray:
    x, e = np.zeros(len(B)), []
    c.begin(y_ref)
    for p in range(len(y_ref)):
        e.append(y_ref[p] - C @ x)
        x = A @ x + B * (c.step(x) - load[p])
    assert c.end()
    return np.array(e)


A_CHAIN = np.array([[0.9, 0.2, 0.0], [0.0, 0.8, 0.3], [0.0, 0.0, 0.7]])
B_OF = {1: np.array([1.0, 0.2, 0.1]), 2: np.array([0.0, 1.0, 0.2]), 3: np.array([0.0, 0.0, 1.0])}


@pytest.mark.parametrize("through_integrator", [False, True])
@pytest.mark.parametrize("k_2", [0.0, 0.02])
@pytest.mark.parametrize("r", [1, 2, 3])
def test_the_error_follows_its_operator_from_trial_to_trial(r, k_2, through_integrator):
    """On a noise-free plant e_{k+1} = (I - G S K_3) e_k in lifted form, G from v to y with the loop closed
    and S the shift with the paper's ends; with the norm-optimal L, e_{k+1} = (I - G L) e_k contracts."""
    library, samples = control_library("double"), 30
    B, C, zero = B_OF[r], np.eye(3)[0], np.zeros(samples)
    law = plain(samples, 3, k_1=[-0.02, -0.03, -0.05], k_2=k_2, n=0.3, through_integrator=through_integrator)
    law.shift, law.k_3, law.limit, law.learned_limit = r, 0.4, 1e6, 1e6
    G = lifted(*closed(A_CHAIN, B, law), samples)
    assert not G[:r].any() and abs(np.diag(G, -r)).min() > 0
    y_ref, load = np.sin(np.arange(samples) / 5), zero.copy()
    load[10:] = 0.5

    S = np.zeros((samples, samples))
    S[np.arange(samples), np.minimum(np.arange(samples) + r, samples - 1)] = 1
    c = CTrial(library, law)
    errors = [simulate(c, A_CHAIN, B, C, y_ref, load) for _ in range(4)]
    for before, after in pairwise(errors):
        assert abs(after - (before - law.k_3 * G @ S @ before)).max() < 1e-12

    law.learning_matrix = np.linalg.solve(G.T @ G + 0.01 * np.eye(samples), G.T)
    c = CTrial(library, law)
    errors = [simulate(c, A_CHAIN, B, C, y_ref, load) for _ in range(6)]
    for before, after in pairwise(errors):
        assert abs(after - (before - G @ law.learning_matrix @ before)).max() < 1e-12
        assert np.linalg.norm(after) < np.linalg.norm(before)


def test_the_older_law_3_is_a_configuration():
    """u_{k+1} = u_k + K_stab (x_{k+1} - x_k) + K_ILC e_k(p + r) from u_0 = K_stab x_0 keeps every x_k; with
    K_1 = K_stab, K_2 = 0, N = 1 and v at the input only it is the same, without that memory."""
    samples, r = 40, 2
    B, C, y_ref = B_OF[r], np.eye(3)[0], np.sin(np.arange(samples) / 6)
    law = plain(samples, 3, k_1=[-0.05, -0.1, -0.1], n=1.0, k_3=0.2, shift=r, limit=1e6, learned_limit=1e6)
    c = CTrial(control_library("double"), law)
    K = np.array(law.k_1)
    u_old, x_old, e_old = None, None, None
    for trial in range(6):
        x, u, e = np.zeros((samples + 1, 3)), np.zeros(samples), np.zeros(samples)
        for p in range(samples):
            u[p] = K @ x[p]
            if trial > 0:
                u[p] = u_old[p] + K @ (x[p] - x_old[p]) + law.k_3 * e_old[min(p + r, samples - 1)]
            e[p] = y_ref[p] - C @ x[p]
            x[p + 1] = A_CHAIN @ x[p] + B * u[p]
        assert abs(simulate(c, A_CHAIN, B, C, y_ref, np.zeros(samples)) - e).max() < 1e-12
        u_old, x_old, e_old = u, x, e


def test_the_motor_of_the_paper_learns_in_both_precisions(library):
    """(36) to (42). What changes slowly contracts by the value of (20) at standstill, 1 - K_3; a new
    reference finds the load already learned, and its own feedforward exact."""
    period, b, a = 2.5e-3, *butter(2, 30, fs=400)
    A = np.array([[1, period], [0, 1 - 1.4e-3 / 8.25e-4 * period]])
    B, C, k_1 = np.array([0, 0.37 / 8.25e-4 * period]), np.eye(2)[0], [-99.4484, -0.9270]
    num = np.poly(A + np.outer(B, k_1)) / (period * B[1])  # (41)
    law = plain(400, 2, k_1=k_1, k_2=1.3916, n=99.4484, through_integrator=True, k_3=0.6942, shift=2)
    law.limit, law.num, law.preview, law.b, law.a = 20.0, list(num), 2, list(b), list(a)
    c = CTrial(library, law)
    t = np.linspace(0, 1, 400)
    smooth = 10 * t**3 - 15 * t**4 + 6 * t**5

    def rms(y_ref):
        return float(np.sqrt(np.mean(simulate(c, A, B, C, y_ref, 3 * smooth) ** 2)))

    errors = [rms(smooth) for _ in range(6)]
    for before, after in pairwise(errors):
        assert abs(after / before - (1 - law.k_3)) < 0.02
    assert rms(-0.5 * smooth) < errors[-1]


@settings(deadline=None, max_examples=80)
@given(
    theta=st.floats(width=32) | st.floats(-1e4, 1e4, width=32),
    last=st.floats(-1e4, 1e4, width=32),
    precision=st.sampled_from(["float", "double"]),
)
def test_unwrapping_adds_whole_turns(theta, last, precision):
    library = control_library(precision)
    got = library.lib.cgl_unwrap(theta, last)
    if not abs(theta) < 6e9:
        assert got == last
        return
    bound = 4 * library.eps * max(abs(theta), abs(last), 1)
    assert abs(got - last) <= math.pi + bound
    turns = (got - theta) / (2 * math.pi)
    assert abs(turns - round(turns)) <= bound


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_feedforward_equals_its_equation(seed):
    """Any numerator and stable denominator, any preview, up to all taps."""
    rng = np.random.default_rng(seed)
    library = control_library("double")
    num = rng.uniform(-1, 1, int(rng.integers(1, 17)))
    den = np.atleast_1d(np.poly(rng.uniform(-0.6, 0.6, int(rng.integers(0, 16)))))
    preview, samples = int(rng.integers(0, 30)), int(rng.integers(1, 40))
    y_ref, pointer = library.array(rng.normal(size=samples))
    config = library.new(
        "cgl_feedforward_config",
        numerator=len(num), denominator=len(den), preview=preview, num=list(num), den=list(den),
    )  # fmt: skip
    state = library.new("cgl_feedforward")
    assert library.lib.cgl_feedforward_init(config, state) == library.lib.CGL_OK
    library.lib.cgl_feedforward_reset(config, state, y_ref[0])
    expected = feedforward(num, den, preview, y_ref, samples + 40)
    got = [library.lib.cgl_feedforward_step(config, state, pointer, samples, p) for p in range(samples + 40)]
    assert abs(np.array(got) - expected).max() <= 1e-12 * (1 + abs(expected).max())


def test_the_example_of_the_docs_compiles():
    page = (SOURCE.parents[1] / "docs" / "laws" / "trial.md").read_text(encoding="utf-8")
    example = re.search(r"```c\n(.*?)```", page, re.DOTALL)
    assert example is not None
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", f"-I{SOURCE}"]
    subprocess.run(["cc", *flags, "-x", "c", "-"], input=example[1], text=True, check=True)
