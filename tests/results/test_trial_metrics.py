"""Metrics of trials against numbers worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cogless.results.trace import Trace
from cogless.results.trial_metrics import Values, evaluate
from cogless.study.trial_metric import TrialMetric

ROWS = np.array([[3.0, -3, 3, -3], [1, 1, -1, -1], [0, 0, 0, 0.5], [8, 0, 0, 0], [2, 2, 2, 2], [0.1] * 4])


def value(kind: str, starts: tuple[int, ...] = (1, 4), floor: str | None = None) -> Values:
    metric = TrialMetric.model_validate(
        {"name": "m", "kind": kind, "signal": "theta_error", **({"floor": floor} if floor else {})}
    )
    ref = ROWS.ravel()
    trace = Trace(("time", "theta_ref", "theta_m"), ("s", "rad", "rad"), np.column_stack([ref, ref, 0 * ref]))
    return evaluate(metric, trace, len(ROWS), starts)


def test_each_trial_has_its_own_number() -> None:
    assert value("rms") == pytest.approx([3, 1, 0.25, 4, 2, 0.1])
    assert value("maximum") == pytest.approx([3, 1, 0.5, 8, 2, 0.1])


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
            TrialMetric.model_validate(
                {"name": "m", "kind": "trials-to-floor", "signal": "theta_error", "floor": floor}
            )
