"""The delay of a current is that of the least residual, wherever the search begins."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cogless.identify.balance import Model
from cogless.identify.estimate import Logs


class Moment(dict):
    """A fit that knows the delay to 10 us."""

    def interval(self, key):
        return 1e-5


@pytest.mark.parametrize("true", [-1.7e-3, -3e-4, 5e-5, 1e-3, 3.2e-3])
@pytest.mark.parametrize("begin", [0.0, 1e-3, -1e-3, 2e-3])
@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_the_delay_of_the_least_residual_is_the_true_one(true, begin, power):
    """The residual's logarithm bends the other way on its flanks, which rows of 2 ms reach."""
    dt = 2e-3

    def equations(model):
        cost = 1e4 * np.log(1e-2 + abs((model.delay - true) / dt) ** (2 * power))
        return SimpleNamespace(cost=lambda instrument: cost)

    drive = SimpleNamespace(
        moving=[SimpleNamespace(dt=dt)],
        period=3e-5,
        equations=equations,
        solve=lambda model, instrument: SimpleNamespace(fit=Moment({("delay",): true - model.delay})),
    )
    model, error = Logs.delayed(drive, Model(delay=begin), 0)
    assert model.delay == pytest.approx(true, abs=1e-4)
    assert error < 1.5e-4
