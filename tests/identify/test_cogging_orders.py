"""Orders are told in noise of any colour at a stated rate of false alarms, and neighbours apart."""

from __future__ import annotations

import numpy as np
import pytest

from cogless.identify.balance import LADDER, Model, Rows, Sensor
from cogless.identify.cogging_orders import found_orders
from cogless.identify.config import LogRule
from cogless.identify.jackknife import fit
from cogless.identify.log import Log

SENSOR = Sensor(0.0, 7)


def rows(
    seed: int, waves: dict[int, float], colour: float = 0.8, speed: float = 4.0, count: int = 4000
) -> Rows:
    """Rows 5 ms apart at a speed that wanders, with noise whose neighbours resemble each other."""
    random = np.random.default_rng(seed)
    omega = speed * (1 + 0.05 * np.sin(np.arange(count) * 3e-3))
    theta = np.cumsum(omega) * 5e-3
    noise, left = random.standard_normal(count), np.zeros(count)
    for k in range(1, count):
        left[k] = colour * left[k - 1] + noise[k]
    y = left + sum((size * np.sin(n * theta + 0.3) for n, size in waves.items()), np.zeros(count))
    log = Log("a", LogRule(file="*"), 1e-3, {"theta": theta}, (slice(0, count),))
    return Rows(
        log,
        (("c",),),
        np.ones((count, 1)),
        y,
        {},
        theta,
        omega,
        np.arange(count) * 1.0,
        np.zeros((len(LADDER), count)),
        5e-3,
    )


def search(made: Rows, model: Model | None = None) -> list[int]:
    fitted = fit([made])
    return found_orders([(made, made.y - fitted.prediction(made))], fitted, model or Model(), SENSOR)


@pytest.mark.parametrize("colour", [0.0, 0.8])
def test_noise_has_an_order_in_one_search_of_a_hundred(colour: float) -> None:
    assert sum(bool(search(rows(seed, {}, colour))) for seed in range(150)) <= 4


def test_the_strongest_orders_come_first_and_known_ones_not_again() -> None:
    made = rows(1, {12: 1.5, 42: 1.0, 7: 0.05})
    assert search(made) == [12, 42]
    assert search(made, Model(cogging=(12,))) == [42]


def test_an_order_that_the_kernel_blurs_is_not_sought() -> None:
    """At 4 rad/s a kernel of 6 ms blurs order 125 to a hundredth."""
    assert search(rows(1, {120: 3.0}, speed=4.0)) == [120]
    assert search(rows(1, {140: 3.0}, speed=4.0)) == []
