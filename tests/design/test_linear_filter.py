"""Filters of our own against scipy.signal's, within rounding: its own bits change from release to release."""

import numpy as np
import pytest
from scipy.signal import butter, filtfilt, lfilter

from cogless.design.trials.model import butterworth_polynomials, forward, forward_and_backward
from cogless.design.trials.response import butterworth


@pytest.mark.parametrize("order", range(1, 9))
@pytest.mark.parametrize("cutoff", [1e-3, 0.05, 0.3, 0.9])
def test_butterworth_is_that_of_scipy(order: int, cutoff: float) -> None:
    for ours, theirs in zip(butterworth_polynomials(order, cutoff), butter(order, cutoff), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)


@pytest.mark.parametrize("odd", [False, True])
@pytest.mark.parametrize("order", [1, 2, 5])
def test_signals_come_out_as_of_scipy(order: int, odd: bool) -> None:
    b, a = butter(order, 0.2)
    x = np.random.default_rng(order).normal(size=(3, 200))
    whole = np.hstack([x[:, ::-1], x, x[:, ::-1]])
    theirs = filtfilt(b, a, x) if odd else filtfilt(b, a, whole, padlen=0)[:, 200:400]
    np.testing.assert_allclose(forward_and_backward(b, a, x, odd), theirs, rtol=0, atol=1e-11)
    other, slow = butter(order, 0.05)
    alone = [lfilter(b, a, x[0]), lfilter(other, slow, x[1])]
    ours = forward(np.array([b, other]), np.array([a, slow]), x[:2])
    np.testing.assert_allclose(ours, alone, rtol=0, atol=1e-11)


def test_a_constant_passes_both_ways_unchanged_from_its_first_sample() -> None:
    b, a = butter(3, 0.1)
    np.testing.assert_allclose(forward_and_backward(b, a, np.full((1, 60), 2.5)), 2.5, rtol=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_filter_passes_half_at_its_cutoff(order: int) -> None:
    """Half of the power each way, so half of the amplitude there and back."""
    gain = butterworth(20.0, order, 1e-3).gain(np.array([2 * np.pi * 20.0 * 1e-3]))
    assert gain == pytest.approx(0.5)
