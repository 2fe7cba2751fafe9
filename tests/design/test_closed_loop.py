"""How a loop grows by its largest pole, and the response of a resonator."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogless.design import closed_loop
from cogless.design.closed_loop import Linear, Oscillation, Resonator

T = 1e-3


@pytest.mark.parametrize(
    ("poles", "grows"),
    [
        ([0.5, 1 + 0.9e-6], None),  # integrators, as rounding leaves them
        ([0.5, 1.5, -1.1], Oscillation(0.0, math.log(1.5) / T)),
        ([0.5, -1.2], Oscillation(500.0, math.log(1.2) / T)),
        ([1.1 * np.exp(0.3j), 1.1 * np.exp(-0.3j), 1.0], Oscillation(0.3 / math.tau / T, math.log(1.1) / T)),
    ],
)
def test_the_largest_pole_tells_how_a_loop_grows(
    monkeypatch: pytest.MonkeyPatch, poles: list[complex], grows: Oscillation | None
) -> None:
    monkeypatch.setattr(closed_loop, "poles", lambda loop, feedback: np.array(poles, complex))
    loop: Any = SimpleNamespace(period=T)
    found = closed_loop.oscillation.__wrapped__(loop, Linear(ratio=1, k=1.0))
    assert (found is None) == (grows is None)
    if found is not None and grows is not None:
        assert (found.frequency, found.rate) == pytest.approx((grows.frequency, grows.rate))


def test_a_resonator_is_an_integrator_that_turns_with_its_order() -> None:
    """At dw from its order it is gain / (2 j dw), turned by the lead; at the order large, but finite."""
    one = Resonator(3.0, 200.0, 2e-3)
    beside = one.response(np.array([200.0 + 1e-4]), T)[0]
    assert beside * 1e-4j * 2 / 3.0 == pytest.approx(np.exp(0.4j), rel=2e-5)
    assert np.isfinite(one.response(np.array([200.0]), T)[0])
    assert abs(one.response(np.array([200.0]), T)[0]) > 1e8
