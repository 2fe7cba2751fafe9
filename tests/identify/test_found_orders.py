"""Which orders a fit has left in its rows."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.fits import fit_of

from cogless.identify.orders import found_orders, gains, residual
from cogless.identify.regression import Fit
from cogless.identify.weak_form import Rows


def left_over(turns: int, *waves: tuple[int, float], noise: float = 0.0, name: str = "a") -> Rows:
    """1000 rows, 6 ms apart, of a 6 ms kernel: what it leaves of waves of these orders in `turns`."""
    theta = 2 * math.pi * turns / 1000 * np.arange(1000)
    speed = theta[1] / 6e-3
    y = noise * np.random.default_rng(7).normal(size=1000)
    for order, size in waves:
        y = y + size * math.exp(-0.5 * (order * speed * 6e-3) ** 2) * np.cos(order * theta + 0.3)
    log: Any = SimpleNamespace(name=name, dt=1e-3)
    none = np.zeros((1000, 0))
    return Rows(log, (), none, y, none, theta, np.full(1000, speed), np.arange(1000.0))


def empty(**noise: float) -> Fit:
    return replace(fit_of({}), noise=noise)


def test_an_order_explains_its_wave_as_the_kernel_leaves_it_at_each_speed() -> None:
    """All of what is of it, none of what it is not; nothing where the kernel leaves a thirtieth at most."""
    both = [left_over(2, (7, 0.3)), left_over(10, (7, 0.3), name="b")]
    share, counts = gains(both, empty(a=0.1, b=0.02), 6e-3)
    assert share[6] == pytest.approx(1.0, rel=1e-6) and share[[5, 7, 13]] == pytest.approx(0.0, abs=1e-6)
    assert counts == pytest.approx(np.full(400, 2 * 1000 / (2 * math.sqrt(math.pi))))
    two, _ = gains([left_over(2, (7, 0.3), (11, 0.1))], empty(a=1.0), 6e-3, 100)
    sizes = np.array([0.3, 0.1]) * np.exp(-0.5 * (np.array([7, 11]) * 2 * math.pi * 2 / 1000) ** 2)
    assert len(two) == 100 and two[[6, 10]] == pytest.approx(sizes**2 / np.sum(sizes**2), rel=1e-5)
    fast, _ = gains([left_over(10, (40, 0.1), (44, 10.0))], empty(a=1.0), 6e-3)
    assert fast[39] > 0 and not fast[43:].any()


def test_held_angles_show_each_order_whole() -> None:
    """No kernel filters them; four rows beside each other are one value. What is fitted is not left over."""
    held = left_over(10)
    held.log.dt = 0.0
    cosine = np.cos(44 * held.theta)
    rows = replace(held, names=(("c",),), columns=np.ones((1000, 1)), y=2.0 + 0.1 * cosine)
    fit = replace(fit_of({("c",): 2.0}), noise={"a": 1.0})
    assert residual(rows, fit) == pytest.approx(0.1 * cosine)
    share, counts = gains([rows], fit, 6e-3)
    assert share[43] == pytest.approx(1.0, rel=1e-6) and counts[0] == 250


def test_orders_are_found_the_strongest_first_from_a_tenth_of_it_on() -> None:
    fit = empty(a=1.0)
    rows = [left_over(2, (7, 0.3), (11, 0.4), noise=0.1)]
    assert found_orders(rows, fit, 6e-3, ()) == [11, 7]
    assert found_orders(rows, fit, 6e-3, (11,)) == [7] and found_orders(rows, fit, 6e-3, (), 1) == [11]
    assert found_orders([left_over(2, (11, 0.4), (7, 0.14))], fit, 6e-3, ()) == [11, 7]
    assert found_orders([left_over(2, (11, 0.4), (7, 0.12))], fit, 6e-3, ()) == [11]
    assert found_orders([left_over(2, (20, 0.09), noise=0.1)], fit, 6e-3, ()) == [20]
    assert found_orders([left_over(2, noise=0.1)], fit, 6e-3, ()) == []
    eight = [(order, 0.1 * order) for order in range(11, 19)]  # the six strongest at once
    assert found_orders([left_over(2, *eight)], fit, 6e-3, ()) == [18, 17, 16, 15, 14, 13]


@pytest.mark.parametrize(("beyond", "found"), [(1.001, [7]), (0.999, [])])
def test_an_order_is_found_where_chance_would_find_one_of_400_in_a_hundred_logs(
    beyond: float, found: list[int]
) -> None:
    """Two of v + 2 independent values explain a share s of all by chance with (1 - s)^(v / 2)."""
    v = 1000 / (2 * math.sqrt(math.pi)) - 2
    share = beyond * (1 - (0.01 / 400) ** (2 / v))
    widths = np.exp(-0.5 * (np.array([7, 11]) * 2 * math.pi * 2 / 1000) ** 2)
    small, large = np.sqrt([share, 1 - share]) / widths
    rows = [left_over(2, (7, small), (11, large))]
    assert found_orders(rows, empty(a=1.0), 6e-3, (11,)) == found
