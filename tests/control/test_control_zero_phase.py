"""The zero-phase filter of the C library against scipy.signal, and the stability test behind it."""

import math

import numpy as np
import pytest
from control_library import ControlLibrary, control_library
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.fft import dct, idct
from scipy.signal import butter, filtfilt, lfilter

FOREVER = 3000  # samples in which the filters here forget


@pytest.fixture(params=["float", "double"])
def library(request) -> ControlLibrary:
    return control_library(request.param)


def init(library, b, a, samples, order=None, odd=True):
    order = len(b) - 1 if order is None else order
    config = library.new("cgl_zero_phase_config", order=order, b=list(b), a=list(a), odd=odd)
    return config, library.lib.cgl_zero_phase_init(config, samples)


def run(library, b, a, x, odd=True):
    config, error = init(library, b, a, len(x), odd=odd)
    assert error == library.lib.CGL_OK
    signal, pointer = library.array(x)
    _, tail = library.array(np.zeros(len(x) if len(b) > 1 else 0))
    library.lib.cgl_zero_phase(config, pointer, len(x), tail)
    return signal.astype(float)


def l1(b, a) -> float:
    """What a filter does to the largest value at most."""
    return float(abs(lfilter(b, a, np.eye(1, FOREVER)[0])).sum())


def rounding(b, a, x, eps) -> float:
    """A bound on what rounding does to filtfilt. In each pass every sample rounds products b_i x, a_i y and
    the sums z_i of them: at most 2 (n + 1) eps (sum |b| X + sum |a| Y) a sample, acting through 1 / A. The
    start z = steady state of x(0) is off by the rounding of sum b / sum a, once, over n samples. The second
    pass gets the first one's error through b / A."""
    n = len(b) - 1
    sum_b, sum_a = abs(b).sum(), abs(a).sum()
    gain, noise = l1(b, a), l1([1.0], a)
    steady = (n + 1) * (sum_b + sum_a * abs(b.sum() / a.sum())) / abs(a.sum())  # of y, in eps x
    start = n * (sum_a * steady + (n + 1) * (sum_b + sum_a * abs(b.sum() / a.sum())))
    largest = 3 * abs(x).max()  # with the extension
    error = 0.0
    for _ in range(2):
        reached = gain * largest + abs(b.sum() / a.sum()) * largest
        local = 2 * (n + 1) * (sum_b * largest + sum_a * reached)
        error = gain * error + eps * noise * (local + start * largest) + 4 * eps * largest
        largest = reached
    return error


def even(b, a, x):
    """The filter on the signal and its reflections on both sides, by scipy."""
    whole = np.concatenate([x[::-1], x, x[::-1]])
    return filtfilt(b, a, whole, padlen=0)[len(x) : 2 * len(x)]


def rounded(values, real):
    return np.asarray(values).astype(real).astype(float)


@pytest.mark.parametrize(("odd", "oracle"), [(True, filtfilt), (False, even)])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("cutoff", [0.12, 0.15, 0.3, 0.7])
@pytest.mark.parametrize("extra", [1, 2, 40, 1000])
def test_equals_filtfilt(library, order, cutoff, extra, odd, oracle):
    rng = np.random.default_rng(order)
    b, a = (rounded(c, library.real) for c in butter(order, cutoff))
    x = rounded(np.cumsum(rng.normal(size=3 * (order + 1) + extra)), library.real)
    error = abs(run(library, b, a, x, odd) - oracle(b, a, x)).max()
    assert error <= rounding(b, a, x, library.eps)
    if library.real is np.float64:
        assert error <= 1e-12 * abs(x).max()


@st.composite
def filters(draw):
    """Any zeros, and poles within 0.95: real ones and pairs."""
    order = draw(st.integers(1, 4))
    a = np.ones(1)
    while len(a) <= order:
        radius, angle = draw(st.floats(-0.95, 0.95)), draw(st.floats(0, math.pi))
        pair = len(a) < order and draw(st.booleans())
        factor = [1.0, -2 * radius * math.cos(angle), radius**2] if pair else [1.0, -radius]
        a = np.convolve(a, factor)
    b = draw(st.lists(st.floats(-2, 2), min_size=order + 1, max_size=order + 1))
    return np.array(b), a


@settings(deadline=None, max_examples=60)
@given(filters(), st.integers(1, 60), st.integers(0, 2**32 - 1), st.sampled_from(["float", "double"]))
def test_equals_filtfilt_whatever_the_filter(ba, extra, seed, precision):
    library = control_library(precision)
    b, a = (rounded(c, library.real) for c in ba)
    x = rounded(np.random.default_rng(seed).normal(size=3 * len(b) + extra), library.real)
    accepted = init(library, b, a, len(x))[1] == library.lib.CGL_OK
    if not accepted:  # four poles at 0.95 need not stay inside in float
        assert abs(np.roots(a)).max() > 0.9
        return
    assert abs(run(library, b, a, x) - filtfilt(b, a, x)).max() <= rounding(b, a, x, 2 * library.eps)
    assert abs(run(library, b, a, x, odd=False) - even(b, a, x)).max() <= rounding(b, a, x, 2 * library.eps)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("cutoff", [0.02, 0.15, 0.7])
def test_with_the_even_reflection_the_filter_is_symmetric_and_enlarges_no_signal(order, cutoff):
    """It is diagonal in the cosine transform, with the gain |H|^2 of both passes."""
    library, samples = control_library("double"), 120
    b, a = butter(order, cutoff)
    Q = np.array([run(library, b, a, column, odd=False) for column in np.eye(samples)]).T
    w = np.pi * np.arange(samples) / samples
    gain = abs(np.polyval(b[::-1], np.exp(-1j * w)) / np.polyval(a[::-1], np.exp(-1j * w))) ** 2
    # the start far outside is as if it had always been so: what of that is left after a whole trial
    left = abs(np.roots(a)).max() ** samples * samples
    assert np.linalg.norm(Q, 2) <= 1 + 1e-9 + left
    modes = dct(Q @ idct(np.eye(samples), axis=0), axis=0)
    np.testing.assert_allclose(modes, np.diag(gain), atol=1e-9 + 3 * left)
    outward = np.array([run(library, b, a, column) for column in np.eye(samples)]).T
    assert np.linalg.norm(outward, 2) > 1.005  # with the odd one it does enlarge some


def test_no_filter_changes_nothing(library):
    x = np.random.default_rng(0).normal(size=5).astype(library.real)
    assert np.array_equal(run(library, [1.0], [1.0], x), x.astype(float))


@pytest.mark.parametrize("odd", [False, True])
def test_the_phase_is_zero_and_the_magnitude_acts_twice(library, odd):
    b, a = butter(2, 0.15)
    p = np.arange(4000)
    x = np.cos(0.15 * np.pi * p)
    y = run(library, b, a, x, odd)[1000:3000]
    assert abs(y - 0.5 * x[1000:3000]).max() < 0.15 * np.pi * 4000 * library.eps  # (1/sqrt 2)^2, and x itself


def test_a_constant_and_a_line_pass_unchanged(library):
    """The odd extension continues a line, and each pass starts as if its first sample had always been."""
    b, a = (rounded(c, library.real) for c in butter(2, 0.15))
    b = rounded(b * (a.sum() / b.sum()), library.real)
    constant, line = np.full(100, 3.0), np.linspace(-1, 2, 400)
    bound = 200 * library.eps
    assert abs(run(library, b, a, constant) - 3).max() < bound
    assert abs(run(library, b, a, constant, odd=False) - 3).max() < bound
    # the start forgets the slope; within, the delays of both passes cancel
    assert abs(run(library, b, a, line) - line)[150:-150].max() < bound


@pytest.mark.parametrize("odd", [False, True])
@pytest.mark.parametrize("size", [1e30, 3e38, 1e308])
def test_what_overflows_stays_finite(library, size, odd):
    size = min(size, float(np.finfo(library.real).max))
    b, a = butter(4, 0.15)
    y = run(library, 1e30 * b, a, size * np.random.default_rng(0).choice([-1.0, 1.0], 100), odd)
    assert np.isfinite(y).all()


def test_a_sample_that_overflows_does_not_silence_the_rest(library):
    b, a = butter(2, 0.15)
    x = np.ones(6001)
    x[3000] = np.finfo(library.real).max
    y = run(library, 8 * b, a, x)
    assert abs(y[:200] - 64).max() < 0.01 and abs(y[-200:] - 64).max() < 0.01


def test_init_refuses(library):
    b, a = butter(2, 0.15)
    good, lib = (b, a, 100), library.lib
    assert init(library, *good)[1] == lib.CGL_OK
    assert init(library, b, a, 10)[1] == lib.CGL_OK
    for samples in (0, 1, 9):  # the extension needs more than 3 (order + 1)
        assert init(library, b, a, samples)[1] == lib.CGL_ERROR_CONFIG
    for order in (5, 6, 0x7FFFFFFF, 0xFFFFFFFF):
        assert init(library, b, a, 100, order)[1] == lib.CGL_ERROR_CONFIG
    for value in (math.nan, math.inf, -math.inf):
        for i in range(3):
            changed = [x if i != j else value for j, x in enumerate(b)]
            assert init(library, changed, a, 100)[1] == lib.CGL_ERROR_CONFIG
            changed = [x if i != j else value for j, x in enumerate(a)]
            assert init(library, b, changed, 100)[1] == lib.CGL_ERROR_CONFIG
    unstable = [[1.0, -2.0, 1.0], [1.0, -1.0, 0.0], [1.0, 0.0, 1.0], [1.0, -2.5, 1.2]]
    for bad in ([2.0, *a[1:]], [0.0, *a[1:]], *unstable):
        assert init(library, b, bad, 100)[1] == lib.CGL_ERROR_CONFIG


@settings(deadline=None, max_examples=150)
@given(st.lists(st.floats(-3, 3), min_size=0, max_size=15))
def test_stability_equals_that_of_the_roots(tail):
    library = control_library("double")
    a = [1.0, *tail]
    got = library.lib.cgl_is_stable(library.array(a)[1], len(tail))
    largest = max(abs(np.roots(a)), default=0.0)
    if abs(largest - 1) > 1e-3:  # nearer, the roots of np.roots are off by more
        assert got == (largest < 1)


@pytest.mark.parametrize("radius", [0.5, 0.9, 0.999, 1.0, 1.001, 1.5])
def test_stability_at_every_order(library, radius):
    for order in range(1, 16):
        a = np.zeros(order + 1)
        a[0], a[-1] = 1.0, -(radius**order)
        assert library.lib.cgl_is_stable(library.array(a)[1], order) == (radius < 1)
    assert not library.lib.cgl_is_stable(library.array(np.eye(1, 17)[0])[1], 16)
    assert library.lib.cgl_is_stable(library.array([1.0])[1], 0)
