"""Metrics of trials against numbers worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cogless.results.metrics import Value, evaluate
from cogless.results.trace import Trace
from cogless.study.metric import Conditions, Metric

ROWS = np.array([[3.0, -3, 3, -3], [1, 1, -1, -1], [0, 0, 0, 0.5], [8, 0, 0, 0], [2, 2, 2, 2], [0.1] * 4])


def value(kind: str, starts: tuple[int, ...] = (1, 4), floor: str | None = None) -> Value:
    metric = Metric.model_validate(
        {"name": "m", "kind": kind, "signal": "theta_error", **({"floor": floor} if floor else {})}
    )
    ref = ROWS.ravel()
    columns = np.column_stack([np.arange(ref.size), ref, 0 * ref])
    trace = Trace(("time", "theta_ref", "theta_m"), ("s", "rad", "rad"), columns)
    return evaluate(metric, trace, Conditions(trials=len(ROWS), starts=starts))


def test_each_trial_has_its_own_number() -> None:
    assert value("rms") == pytest.approx([3, 1, 0.25, 4, 2, 0.1])
    assert value("maximum") == pytest.approx([3, 1, 0.5, 8, 2, 0.1])
    assert value("mean") == pytest.approx([0, 0, 0.125, 2, 2, 0.1])
    assert value("ripple-rms") == pytest.approx([3, 1, 0.2165, 3.4641, 0, 0], abs=1e-4)
    assert value("peak-to-peak") == pytest.approx([6, 2, 0.5, 8, 0, 0])


def test_phases_begin_with_the_first_trial_and_with_each_change() -> None:
    assert value("first-rms") == pytest.approx([3, 4])
    # the second half of three trials is two of them
    assert value("final-rms") == pytest.approx([math.sqrt((1 + 0.0625) / 2), math.sqrt((4 + 0.01) / 2)])
    assert value("final-rms", (1,)) == pytest.approx([math.sqrt((16 + 4 + 0.01) / 3)])


def test_trials_to_the_floor_counts_from_the_change() -> None:
    assert value("trials-to-floor", floor="1 rad") == [2, 3]
    assert value("trials-to-floor", (1, 2, 4), "1 rad") == [math.inf, 1, 3]
    assert value("trials-to-floor", floor="50 mrad") == [math.inf, math.inf]


def test_a_floor_has_a_unit_and_is_above_zero() -> None:
    for floor in ("0 rad", "1 A", 1.0):
        with pytest.raises(ValueError, match=r"expected an angle|expected a text with a unit"):
            Metric.model_validate(
                {"name": "m", "kind": "trials-to-floor", "signal": "theta_error", "floor": floor}
            )
