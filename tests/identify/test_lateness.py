"""The delay of i_q follows from how the described law answers the angle; another law tells none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from identify.commissioned import METRIC, MOTORS, PI

from cogless.identify import lateness as room
from cogless.identify.config import LogRule
from cogless.identify.lateness import (
    NO_VALUE,
    Profile,
    _changes,
    _filters,
    _motion,
    _part,
    _profile,
    lateness,
    trace_filters,
)
from cogless.identify.log import Log
from cogless.identify.result import Value
from cogless.results.trace import Trace
from cogless.run.simulate import rollout
from cogless.study import Study
from cogless.study.base import Source
from cogless.study.reading import checked

BANDWIDTH = 2 * np.pi * 500  # rad/s, of the gimbal's current loop
SWEEPS = [["0 s", "0 rad/s"], ["0.5 s", "30 rad/s"], ["1.25 s", "-30 rad/s"], ["2 s", "30 rad/s"]]
SOFTER = {"pi": {"law": "pi", "kp": "0.05 A*s/rad", "ki": "1 A/rad"}}


@cache
def trace(inertia: str, law: str = "pi", dead_time: int = 0) -> Trace:
    """Two seconds of the gimbal with rows of 0.1 ms. `dead_time`: of its inverter, ns."""
    gimbal = MOTORS["gimbal"]
    inverter = {"bus_voltage": "24 V", "dead_time": f"{dead_time} ns"}
    study = {
        "title": "late",
        **gimbal,
        "drive": {**gimbal["drive"], "inverter": inverter},
        "mechanics": {**gimbal["mechanics"], "inertia": inertia},
        "trace": {"rate": "10 kHz"},
        "scenario": {"one": {"duration": "2 s", "reference": {"profile": SWEEPS}}},
        "controller": PI if law == "pi" else SOFTER,
        "metric": [METRIC],
    }
    loaded = checked(Source(Path("late.toml"), study))
    assert isinstance(loaded, Study)
    return rollout([loaded], jobs=1)[0].runs[0].trace


def more_dead_time(logs: list[Log]) -> dict[str, np.ndarray]:
    """The filters of these logs with 200 ns of dead time."""
    simulated = trace("8e-5 kg*m^2", dead_time=200)
    return {of.name: trace_filters(of, simulated, 1e-3) for of in logs}


def log(of: Trace, late: int) -> Log:
    """Its rows each millisecond, with the current so many tenths of it before."""
    rows = slice(20, None, 10)
    current = of["i_q"][20 - late : len(of) - late : 10]
    signals = {"theta": np.unwrap(of["theta_measured"])[rows], "i_q": current}
    return Log("one", LogRule(file="*"), 1e-3, signals, (slice(0, len(current)),))


@pytest.mark.parametrize("late", [3, 7, 12])
def test_the_delay_is_found_within_the_law_s_period(late):
    """Simulated with an inertia that is 0.5 % off, as an estimate may be."""
    made = lateness([log(trace("8e-5 kg*m^2"), late)], {"one": trace("8.04e-5 kg*m^2")}, BANDWIDTH, 1e-3)
    found = made.delay
    assert found is not None and not made.remark
    assert found.value == pytest.approx(late * 1e-4, abs=max(5e-5, found.error))
    assert found.error < 5e-4  # half a period, which is all that torques tell


@pytest.mark.parametrize("late", [3, 4])
def test_a_gain_that_is_off_is_no_delay(late):
    """A law that is tuned by a rule follows the inertia that is found, which is not exact."""
    of = log(trace("8e-5 kg*m^2"), late)
    of.signals["i_q"] = 1.02 * of["i_q"]  # twice its standard error
    found = lateness([of], {"one": trace("8e-5 kg*m^2")}, BANDWIDTH, 1e-3).delay
    assert found is not None
    assert found.value == pytest.approx(late * 1e-4, abs=found.error) and found.error < 6e-5


def test_a_dead_time_that_nobody_typed_in_leaves_the_delay_as_it_is():
    """Where the current has settled, a dead time moves it as much as a delay does."""
    late, simulated = 2, {"one": trace("8e-5 kg*m^2")}
    of = [log(trace("8e-5 kg*m^2", dead_time=300), late)]
    misled = lateness(of, simulated, BANDWIDTH, 1e-3).delay
    assert misled is not None and abs(misled.value - late * 1e-4) > 3e-5
    made = lateness(of, simulated, BANDWIDTH, 1e-3, more_dead_time(of))
    found = made.delay
    assert found is not None and not made.remark
    assert found.value == pytest.approx(late * 1e-4, abs=min(3e-5, found.error))
    assert 200 * made.part.value == pytest.approx(300, rel=0.1)  # ns: it is told, too


def test_no_dead_time_is_told_where_there_is_none():
    of, simulated = [log(trace("8e-5 kg*m^2"), 3)], {"one": trace("8e-5 kg*m^2")}
    part = lateness(of, simulated, BANDWIDTH, 1e-3, more_dead_time(of)).part
    assert abs(part.value) < max(part.error, 0.05)


def test_rows_between_the_law_s_samples_change_nothing():
    """Ten rows for each of the law's."""
    of, simulated = trace("8e-5 kg*m^2"), {"one": trace("8e-5 kg*m^2")}
    signals = {"theta": np.unwrap(of["theta_measured"])[20:], "i_q": of["i_q"][17:-3]}
    fine = Log("one", LogRule(file="*"), 1e-4, signals, (slice(0, len(signals["theta"])),))
    found, coarse = (lateness([one], simulated, BANDWIDTH, 1e-3).delay for one in (fine, log(of, 3)))
    assert found is not None and coarse is not None
    assert found.value == pytest.approx(coarse.value, abs=1e-5)


def test_logs_that_contradict_each_other_widen_the_error():
    simulated = {"one": trace("8e-5 kg*m^2"), "two": trace("8e-5 kg*m^2")}
    logs = [log(trace("8e-5 kg*m^2"), 3), replace(log(trace("8e-5 kg*m^2"), 5), name="two")]
    alone, together = (lateness(of, simulated, BANDWIDTH, 1e-3).delay for of in (logs[:1], logs))
    assert alone is not None and together is not None
    assert together.error > 5 * alone.error
    assert abs(together.value - 4e-4) <= together.error + 1e-4


def test_another_law_tells_no_delay_and_is_told():
    made = lateness(
        [log(trace("8e-5 kg*m^2"), 3)], {"one": trace("8e-5 kg*m^2", law="softer")}, BANDWIDTH, 1e-3
    )
    assert made.delay is None
    assert made.remark.startswith("one: i_q does not follow the angle as the described controller")


def of_parts(*told: tuple[list[float], float]) -> Value:
    """Of logs that tell a part at delays of 0 and 1 ms, and its information, where 0.4 ± 0.1 ms is likely."""
    delays = np.array([0.0, 1e-3])
    profiles = [Profile(delays, 0 * delays, np.array(p), np.full(2, info), 0.0) for p, info in told]
    return _part(profiles, Value(4e-4, 1e-4))


def test_a_part_of_the_dead_time_is_known_to_two_standard_errors():
    """It is wider if the logs scatter more than their own errors, or if the delay is unsure."""
    alone, alike = of_parts(([0.5, 0.5], 100)), of_parts(([0.45, 0.45], 100), ([0.55, 0.55], 300))
    assert (alone.value, alone.error) == pytest.approx((0.5, 2 / 10))
    assert (alike.value, alike.error) == pytest.approx((0.525, 2 / 20))
    spread = of_parts(*(([part, part], 100) for part in (0.2, 0.5, 0.8)))  # its own standard deviation is 0.3
    assert (spread.value, spread.error) == pytest.approx((0.5, 2 * 0.3 / np.sqrt(3)))
    delayed = of_parts(([0.0, 1.0], 100))
    assert (delayed.value, delayed.error) == pytest.approx((0.4, np.hypot(0.2, 0.1)))
    assert of_parts(([0.5, 0.5], 0.25)).value == pytest.approx(0.5)
    assert of_parts(([0.0, 1.0], 0)) == NO_VALUE == Value(0.0, 0.0)


# Delays that are likely, from profiles by hand: parabolas around a delay, 0.1 ms wide


class Rows(dict[str, np.ndarray]):
    """As much of a trace as a filter is fitted to, with rows of 0.1 ms."""

    period = 1e-4


def told(monkeypatch, *profiles, dt=1e-3, period=1e-3, rows=300, periods=(), by_balance=None):
    """What logs with these profiles tell, and after how many rows the law has its samples.

    `periods`: those of the traces, one for each log and then of further traces.
    """
    canned, every = list(profiles), []

    def next_one(log, step, trace, with_dead_time):
        every.append(step)
        return canned.pop(0)

    monkeypatch.setattr(room, "_profile", next_one)
    signals = {"theta": np.zeros(rows), "i_q": np.zeros(rows)}
    names = [f"log {n}" for n in range(len(profiles))]
    logs = [Log(name, LogRule(file="*"), dt, signals, (slice(0, rows),)) for name in names]
    traces = {name: Rows() for name in [*names, *map(str, periods)]}
    for trace, own in zip(traces.values(), periods, strict=False):
        trace.period = own
    return lateness(logs, traces, BANDWIDTH, period, by_balance=by_balance), every


def around(delay, step=1e-5, misfit=0.0):
    delays = step * np.arange(round(1e-3 / step))
    return Profile(delays, ((delays - delay) / 1e-4) ** 2, 0 * delays, 0 * delays, misfit)


BETWEEN = 1e-4**2 * BANDWIDTH / 8  # what the current moves between two rows of the trace, in time


def test_delays_within_two_standard_errors_are_likely(monkeypatch):
    found = told(monkeypatch, around(4.05e-4))[0].delay
    assert found.value == pytest.approx(4.05e-4)  # 0.21 to 0.60 ms, and half a step on each side
    assert found.error == pytest.approx((3.9e-4 + 1e-5) / 2 + BETWEEN)
    coarse = told(monkeypatch, around(4.05e-4), periods=(2e-4, 1e-4))[0].delay
    assert coarse.error == pytest.approx((3.9e-4 + 1e-5) / 2 + 4 * BETWEEN)
    alike = told(monkeypatch, around(4.05e-4), around(4.05e-4, 5e-6))[0].delay  # by the finer steps
    assert alike.error == pytest.approx((2.8e-4 + 5e-6) / 2 + BETWEEN) and alike.value == pytest.approx(
        4.05e-4
    )


def test_logs_whose_delays_differ_weigh_by_how_far_they_do(monkeypatch):
    """Two logs, each one standard error from their mean: twice as much misfit is likely."""
    found = told(monkeypatch, around(3.05e-4), around(5.05e-4))[0].delay
    assert found.value == pytest.approx(4.05e-4)
    assert found.error == pytest.approx((3.9e-4 + 1e-5) / 2 + BETWEEN)


def test_the_balance_counts_as_one_more_log_where_the_law_does_not_contradict_it(monkeypatch):
    """As sure as the law: the middle of both, with an error of 1/sqrt(2)."""
    law = around(4.05e-4, 1e-6)
    alone, both = (told(monkeypatch, law, by_balance=one)[0].delay for one in (None, Value(5.05e-4, 2e-4)))
    assert both.value == pytest.approx(4.55e-4)
    assert both.error == pytest.approx(alone.error / np.sqrt(2), rel=0.02)
    assert told(monkeypatch, law, by_balance=Value(9e-4, 1e-4))[0].delay == alone


def test_a_log_of_another_law_is_left_out_and_told_where_no_other_is(monkeypatch):
    like, unlike, worse = around(4.05e-4, misfit=0.1), around(0.0, misfit=0.114), around(0.0, misfit=0.5)
    assert told(monkeypatch, worse, like, unlike)[0] == told(monkeypatch, like)[0]
    none = told(monkeypatch, worse, unlike)[0]
    assert none.delay is None and none.remark == (
        "log 1: i_q does not follow the angle as the described controller would make it (11 % differs): its "
        "gains, or the drive's rates, filter or bandwidth, are not as described. So the delay is known only "
        "to half a period of the law."
    )
    faint = told(monkeypatch, replace(like, away=like.away / 100))[0].delay  # it tells that all are likely
    assert faint is not None and faint.error == pytest.approx((9.9e-4 + 1e-5) / 2 + BETWEEN)
    flat = replace(like, away=np.ones(100))  # it tells nothing
    assert told(monkeypatch, flat)[0] == told(monkeypatch)[0] == room.Lateness(None)


def test_which_rows_of_a_log_are_the_law_s_samples(monkeypatch):
    assert told(monkeypatch, around(0.0), dt=1e-4, period=1.06e-3)[1] == [11]
    assert told(monkeypatch, around(0.0), dt=1e-3, period=1e-4)[1] == [1]
    assert told(monkeypatch, around(0.0), rows=299)[1] == []  # too few to tell


def test_a_filter_is_of_the_speed_s_changes_before_a_row_and_of_the_speed():
    rng = np.random.default_rng(1)
    theta = np.cumsum(rng.normal(size=40))
    columns, changes = _motion(theta, 0.5), _changes(np.arange(40.0) ** 2)
    speed = np.diff(theta) / 0.5
    assert columns.shape == (34, 6)  # of 38 changes the first four are before a whole filter
    for tap in range(5):
        assert columns[:, tap] == pytest.approx(np.diff(speed)[4 - tap : 38 - tap])
    assert columns[:, 5] == pytest.approx(speed[3:37])
    assert changes == pytest.approx(2 * np.arange(5, 39) + 1)


def follows(*taps: float) -> Rows:
    """A white change of speed in each row, and a current that follows it by these taps."""
    changes = np.random.default_rng(2).normal(size=4000)
    theta = np.cumsum(np.cumsum(changes)) * Rows.period
    current = np.cumsum(np.convolve(changes, taps)[: len(changes)])
    return Rows({"theta_measured": theta, "i_q": current})


def test_a_current_that_is_later_has_a_filter_that_is_later():
    """By whole rows of the trace, and straight between them."""
    filters = _filters(follows(1.0, 0.5), 1)
    assert filters.shape == (6, 5 * 20 + 1)
    for place, taps in ((0, [1, 0.5, 0, 0, 0]), (20, [0, 1, 0.5, 0, 0]), (60, [0, 0, 0, 1, 0.5])):
        assert filters[:5, place] == pytest.approx(np.array(taps), abs=0.02)
    assert filters[:5, 25] == pytest.approx(np.array([0, 0.75, 0.625, 0.125, 0]), abs=0.02)
    assert filters[5] == pytest.approx(0, abs=1e-3)


def logged(of: Rows, noise: float = 0.0) -> Log:
    """All rows, with so much noise in each change of the current."""
    current = of["i_q"] + np.cumsum(np.random.default_rng(3).normal(0, noise, 4000))
    signals = {"theta": of["theta_measured"], "i_q": current}
    return Log("one", LogRule(file="*"), 1e-4, signals, (slice(0, 4000),))


def test_what_no_delay_explains_is_a_share_of_the_filter():
    """Half the gain leaves a quarter of its square."""
    made = _profile(logged(follows(1.0)), 1, follows(0.5), None)
    assert made.misfit == pytest.approx(0.25, abs=0.01)
    assert made.delays == pytest.approx(5e-6 * np.arange(101)) and np.argmin(made.away) < 3
    # six taps, of which the delay takes one, and a part of a dead time another
    assert min(made.away) == pytest.approx(5)
    with_part = _profile(logged(follows(1.0)), 1, follows(0.5), _filters(follows(0.5, 0.2), 1))
    assert min(with_part.away) == pytest.approx(4)


def test_how_far_a_delay_is_from_a_log_counts_by_the_noise_of_both():
    """Rows times the square of the filters' difference, over twice the noise's variance; but along the filter
    itself the gain is only known to a hundredth, which here counts for less by 1 + 4000 / 100^2 / 2."""
    made = _profile(logged(follows(1.0), noise=1.0), 1, follows(1.0), None)
    assert made.away[20] == pytest.approx(4000 * (1 + 1 / 1.2) / 2, rel=0.05)
    assert made.away[0] < 10


def test_a_part_of_an_added_dead_time_is_told_by_what_it_does_to_the_filter():
    """Half of the dead time is found; the information is the square of its effect over the noise."""
    made = _profile(logged(follows(1.0, 0.1), noise=1.0), 1, follows(1.0), _filters(follows(1.0, 0.2), 1))
    assert made.part[0] == pytest.approx(0.5, abs=2 / np.sqrt(80))
    assert made.information[0] == pytest.approx(4000 * 0.2**2 / 2, rel=0.05)
    sure = _profile(logged(follows(1.0, 0.1), noise=0.01), 1, follows(1.0), _filters(follows(1.0, 0.2), 1))
    assert sure.part[0] == pytest.approx(0.5, abs=0.02)
