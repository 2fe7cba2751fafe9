"""The delay of i_q follows from how the described law answers the angle; another law tells none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from identify.commissioned import METRIC, MOTORS, PI

from cogless.identify.config import LogRule
from cogless.identify.lateness import NOTHING, Profile, _part, lateness
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
    assert found is not None and not made.said
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
    made = lateness(of, simulated, BANDWIDTH, 1e-3, {"one": trace("8e-5 kg*m^2", dead_time=200)})
    found = made.delay
    assert found is not None and not made.said
    assert found.value == pytest.approx(late * 1e-4, abs=min(3e-5, found.error))
    assert 200 * made.part.value == pytest.approx(300, rel=0.1)  # ns: it is told, too


def test_no_dead_time_is_told_where_there_is_none():
    of, simulated = [log(trace("8e-5 kg*m^2"), 3)], {"one": trace("8e-5 kg*m^2")}
    part = lateness(of, simulated, BANDWIDTH, 1e-3, {"one": trace("8e-5 kg*m^2", dead_time=200)}).part
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
    assert made.said.startswith("one: i_q does not follow the angle as under the described controller")


def of_parts(*told: tuple[list[float], float]) -> Value:
    """Of logs that tell a part at delays of 0 and 1 ms, and its information, where 0.4 ± 0.1 ms is likely."""
    delays = np.array([0.0, 1e-3])
    profiles = [Profile(delays, 0 * delays, np.array(p), np.full(2, info), 0.0) for p, info in told]
    return _part(profiles, Value(4e-4, 1e-4))


def test_a_part_of_the_dead_time_is_known_to_two_standard_errors():
    """Which the spread of logs widens, if it is larger than their own errors, and an unsure delay, too."""
    alone, alike = of_parts(([0.5, 0.5], 100)), of_parts(([0.45, 0.45], 100), ([0.55, 0.55], 300))
    assert (alone.value, alone.error) == pytest.approx((0.5, 2 / 10))
    assert (alike.value, alike.error) == pytest.approx((0.525, 2 / 20))
    spread = of_parts(*(([part, part], 100) for part in (0.2, 0.5, 0.8)))  # its own standard deviation is 0.3
    assert (spread.value, spread.error) == pytest.approx((0.5, 2 * 0.3 / np.sqrt(3)))
    delayed = of_parts(([0.0, 1.0], 100))
    assert (delayed.value, delayed.error) == pytest.approx((0.4, np.hypot(0.2, 0.1)))
    assert of_parts(([0.0, 1.0], 0)) == NOTHING
