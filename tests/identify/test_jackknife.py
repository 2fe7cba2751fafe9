"""Instruments take noise out of an inertia, and intervals hold the truth as often as they say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cogless.errors import StudyError
from cogless.identify.balance import LADDER, Rows
from cogless.identify.config import LogRule
from cogless.identify.jackknife import Equations, Fit, fit
from cogless.identify.log import Log

NAMES = (("j",), ("c",), ("cogging", 6, "c"), ("cogging", 6, "s"))
TRUE = np.array([2.0, 0.5, 0.1, -0.2])


def rows(
    name: str,
    random: np.random.Generator,
    noise: float,
    coulomb: float = TRUE[1],
    wrong: float = 0.0,
    count: int = 600,
) -> Rows:
    """A log with slow accelerations that are measured with noise of its own, `wrong`."""
    slow = np.convolve(random.standard_normal(count + 40), np.hanning(41), "valid")[:count]
    theta = np.linspace(0, 60, count)
    way = np.sign(np.sin(theta / 9) + 1e-9)
    true = np.column_stack([slow, way, -np.cos(6 * theta), -np.sin(6 * theta)])
    y = true @ np.array([TRUE[0], coulomb, *TRUE[2:]]) + noise * random.standard_normal(count)
    seen = true.copy()
    seen[:, 0] += wrong * random.standard_normal(count)
    smooth = np.convolve(seen[:, 0], np.hanning(41) / 20, "same")
    log = Log(name, LogRule(file="*"), 1e-3, {"theta": theta}, (slice(0, count),))
    return Rows(
        log, NAMES, seen, y, {}, theta, way, np.arange(count) * 1.0, np.tile(smooth, (len(LADDER), 1)), 1e-2
    )


def test_an_inertia_is_right_where_the_acceleration_is_noisy() -> None:
    """Plain least squares have it a fifth too small."""
    random = np.random.default_rng(1)
    logs = [rows("a", random, 0.1, wrong=2.0), rows("b", random, 0.1, wrong=2.0)]
    fitted = fit(logs)
    columns, y = np.concatenate([each.columns for each in logs]), np.concatenate([each.y for each in logs])
    plain = np.linalg.lstsq(columns, y, rcond=None)[0]
    assert plain[0] < 0.85 * TRUE[0]
    assert (
        fitted["j",] == pytest.approx(TRUE[0], abs=fitted.interval(("j",))) and fitted.interval(("j",)) < 0.4
    )


def test_intervals_hold_the_truth_in_nineteen_of_twenty() -> None:
    """Of 300 drawn pairs of logs, one of which is ten times as noisy; that weighs less."""
    inside, ratios = np.zeros(4), []
    for seed in range(300):
        random = np.random.default_rng(seed)
        fitted = Equations([rows("a", random, 0.05), rows("b", random, 0.5)]).fit(exact=True)
        inside += np.abs(fitted.values - TRUE) <= fitted.intervals
        ratios.append(fitted.noise["b"] / fitted.noise["a"])
    assert np.all(inside > 0.92 * 300) and np.all(inside < 300)
    assert np.median(ratios) == pytest.approx(10, rel=0.1)


def test_an_exact_jackknife_is_as_wide_as_the_linear_one() -> None:
    """States of the motion add a tenth where nothing repeats."""
    ratios = []
    for seed in range(40):
        random = np.random.default_rng(seed)
        equations = Equations([rows("a", random, 0.2), rows("b", random, 0.2)])
        ratios.append(equations.fit(exact=True).intervals / equations.fit().intervals)
    assert np.median(ratios) == pytest.approx(1.1, abs=0.1)


def test_an_interval_holds_the_values_of_logs_that_contradict_each_other() -> None:
    random = np.random.default_rng(2)
    alike = fit([rows("a", random, 0.05), rows("b", random, 0.05), rows("c", random, 0.05)])
    apart = fit([rows(name, random, 0.05, coulomb) for name, coulomb in (("a", 0.4), ("b", 0.5), ("c", 0.6))])
    assert apart.interval(("c",)) > 0.05 > 5 * alike.interval(("c",))
    assert apart.interval(("cogging", 6, "s")) < 3 * alike.interval(("cogging", 6, "s"))


def test_an_interval_holds_an_inertia_that_is_off_by_the_same_in_each_ramp() -> None:
    """What repeats with the ramps is the same in each block of time: from these alone a sixth is inside."""
    inside, way = 0, np.sign(np.sin(np.arange(960) * math.pi / 30))
    speed = np.cumsum(way) / 15 - 1
    for seed in range(200):
        random = np.random.default_rng(seed)
        one = rows("a", random, 0.02, count=len(way))
        columns = np.column_stack([way, np.sign(speed + 1e-9), one.columns[:, 2:]])
        repeated = np.tile(0.1 * random.standard_normal(60), 16)
        y = one.y + (columns - one.columns) @ TRUE + repeated
        instruments = np.tile(way, (len(LADDER), 1))
        repeating = replace(one, columns=columns, y=y, omega=speed, instruments=instruments)
        fitted = Equations([repeating]).fit(exact=True)
        inside += int(abs(fitted["j",] - TRUE[0]) <= fitted.interval(("j",)))
    assert 0.88 * 200 < inside < 200


def test_the_chance_of_a_wave_is_small_only_where_there_is_one() -> None:
    chances = []
    for seed in range(200):
        random = np.random.default_rng(seed)
        made = rows("a", random, 0.1)
        none = made.y - made.columns[:, 2:] @ TRUE[2:]
        without = Rows(**{**made.__dict__, "y": none})
        chances.append(fit([without]).chance("cogging", 6))
    assert 0.02 < np.mean(np.array(chances) < 0.05) < 0.09
    assert fit([made]).chance("cogging", 6) < 1e-8


def test_a_wave_is_as_clear_as_its_size_over_its_error() -> None:
    """Its error is along the wave: that of its cosine part where it is all cosine."""
    fitted = fit([rows("a", np.random.default_rng(3), 0.1)])
    size = math.hypot(*fitted.values[2:])
    error = math.hypot(*(fitted.values[2:] * fitted.intervals[2:])) / size
    assert fitted.clearness("cogging", 6) == pytest.approx(size / error)
    cosine = replace(fitted, values=np.array([1.0, 1.0, 0.5, 0.0]), intervals=np.array([1.0, 1.0, 0.1, 9.0]))
    assert cosine.clearness("cogging", 6) == pytest.approx(5.0)


def test_a_prediction_without_a_log_is_from_the_others() -> None:
    random = np.random.default_rng(3)
    odd, other = rows("odd", random, 0.01, coulomb=5.0), rows("other", random, 0.01)
    both = fit([odd, other])
    assert both.prediction(other, "odd") == pytest.approx(other.columns @ TRUE, abs=0.02)
    alone: Fit = fit([other])
    assert np.all(alone.prediction(other, "other") == 0)


def test_logs_without_rows_are_refused() -> None:
    with pytest.raises(StudyError, match="expected longer logs"):
        Equations([])


def test_equations_without_an_order_are_those_built_without_it() -> None:
    """Also without the waves that are a log's own, which are of the cogging."""
    one = rows("a", np.random.default_rng(3), 0.1)
    own = (("own", 6, "c", "a"), ("own", 6, "s", "a"))
    more = replace(
        one,
        names=(*one.names, *own),
        columns=np.column_stack([one.columns, one.columns[:, 2:] ** 2]),
    )
    short = replace(one, names=one.names[:2], columns=one.columns[:, :2])
    fewer = Equations([more]).without(("cogging", 6)).fit()
    assert fewer.names == one.names[:2]
    assert fewer.values == pytest.approx(Equations([short]).fit().values)
    assert Equations([more]).without(("ripple", 6)).names == more.names
