"""How uneven a speed is that has its mean, by sines whose rms is known."""

import math

import numpy as np
import pytest

from cogless.results.held_speed import JERKS_RATIO, miss, unevenness

TURNS = np.linspace(0, math.tau * 40, 40_000, endpoint=False)
REFERENCE = np.full(len(TURNS), 3.0)


def sine(ratio: float, mean: float = 1.0) -> np.ndarray:
    """A speed whose error has this rms, as a share of the reference, about a share of the reference."""
    return REFERENCE * (mean + math.sqrt(2) * ratio * np.sin(TURNS))


@pytest.mark.parametrize("ratio", [0.51, 0.65, 0.70, 0.72, 0.9, 3.0])
def test_below_and_above_the_limit_the_same_number_is_told(ratio: float) -> None:
    assert unevenness(REFERENCE, sine(ratio)) == pytest.approx(ratio, rel=1e-6)
    assert (miss(REFERENCE, sine(ratio)) is not None) == (ratio > JERKS_RATIO)


def test_an_even_speed_and_one_with_another_mean_are_not_uneven() -> None:
    assert unevenness(REFERENCE, sine(0.49)) is None
    assert unevenness(REFERENCE, sine(0.6, mean=1.2)) is None
    assert unevenness(REFERENCE, np.where(math.tau > TURNS, np.nan, REFERENCE)) is None
    assert unevenness(REFERENCE * np.sign(np.sin(TURNS)), REFERENCE) is None
    assert unevenness(np.zeros(0), np.zeros(0)) is None


def test_a_start_at_rest_is_not_uneven() -> None:
    """Only the first half of the rows is."""
    start = np.where(np.arange(len(TURNS)) < len(TURNS) // 2, sine(2.0), REFERENCE)
    assert unevenness(REFERENCE, start) is None


@pytest.mark.parametrize(
    ("first", "second", "ratio"),
    [(3.0, 1.0, math.sqrt(5.0)), (0.6, 0.69, math.sqrt((0.6**2 + 0.69**2) / 2)), (1.0, 0.65, 0.65)],
)
def test_the_ratio_is_that_of_the_error_that_is_reported_with_it(
    first: float, second: float, ratio: float
) -> None:
    """All rows count as in the error of `miss`. A speed that only the second half holds has this half's."""
    early = np.arange(len(TURNS)) < len(TURNS) // 2
    speed = np.where(early, sine(first), sine(second))
    assert unevenness(REFERENCE, speed) == pytest.approx(ratio, rel=1e-6)
    missed = miss(REFERENCE, speed)
    assert (missed is not None) == (second > JERKS_RATIO)
    assert missed is None or missed.error == pytest.approx(ratio, rel=1e-6)
