"""Edges and counts that come too rarely at slow speeds."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

import studies
from cogless.catalogue import edge_timers
from cogless.design import warnings
from cogless.design.gentler import timed_edges
from cogless.design.margins import UNSTABLE, Margins
from cogless.design.ripple import Sampled
from cogless.study.drive import Make
from cogless.study.position_sensor import Encoder

FIRM = Margins(True, 100.0, 1.0, 3.0, 300.0)


COUNT = 0.02  # rad


@pytest.mark.parametrize(
    ("omega", "timed", "margins", "said"),
    [
        (2.0, False, FIRM, None),  # 100 rad/s times 10 ms are a radian
        (1.0, False, FIRM,
            "at 1 rad/s a sensor edge comes every 20 ms; the loop's crossover is 15.9 Hz: the "
            "rotor coasts from count to count"),
        (4.0, True, FIRM, None),  # 4.5 ms late, 0.45 of the margin
        (2.5, True, FIRM,
            "at 2.5 rad/s a sensor edge comes every 8 ms; the loop's crossover is 15.9 Hz: the "
            "measured speed is 7.5 ms late, which is 43 deg of lag at the crossover; the phase margin "
            "without this lag is 57 deg"),
        (1.0, True, FIRM,
            "at 1 rad/s a sensor edge comes every 20 ms; the loop's crossover is 15.9 Hz: the "
            "measured speed is 20 ms late, which is 112 deg of lag at the crossover; the phase margin "
            "without this lag is 57 deg; when the rotor "
            "stops and goes, the measured speed is too high: by 10 % if every second interval between "
            "edges is twice as long"),
        (1.0, False, UNSTABLE, None),
        (1.0, False, Margins(True, math.nan, math.nan, 3.0, 300.0), None),
        (0.0, False, FIRM, None),
    ],
)  # fmt: skip
@pytest.mark.parametrize("helps", [True, False])
def test_edges_that_come_too_rarely_for_the_loop(
    monkeypatch: pytest.MonkeyPatch,
    omega: float,
    timed: bool,
    margins: Margins,
    said: str | None,
    helps: bool,
) -> None:
    """The advised counts are the necessary ones and a fifth more."""
    needed = 1.2 * {1.0: 20 / (0.5 / 0.1 + 0.5), 2.5: 8 / (0.5 / 0.1 + 0.5)}.get(omega, 1.0) if timed else 2.4
    tried: list[Any] = []

    def helping(study: Any, changes: Any, cured: Any) -> Any:
        tried.extend(changes)
        return ({"drive.position_sensor.lines": 7},) if helps else ()

    of_part: dict[str, Any] = {
        "slowest_held_speed": lambda study, scenario: omega,
        "speed_loop": lambda study, scenario: SimpleNamespace(period=1e-3),
        "sampled": lambda study, scenario: Sampled(COUNT, 1e-3, timed),
        "feedback_of": lambda study, name, speed: "feedback",
        "position_margins": lambda loop, feedback: margins,
        "swing": lambda *_: None,
        "_late": lambda loop, source, omega: loop,
        "younger_speeds": lambda study: [],
        "finer_sensor": lambda study, factor: factor,
        "slower_feedback": lambda study, name, factor: factor,
        "slower_proportional": lambda study, name, factor, crossover: [],
        "starts_after": lambda study, scenario, feedback, omega: 0.0,
        "helping": helping,
        "first": lambda study, changes, cured: helping(study, changes, cured)[:0],
        "speed_text": lambda study, speed: f"{speed:g} rad/s",
    }
    for name, part in of_part.items():
        monkeypatch.setattr(warnings, name, part)
    law = SimpleNamespace(learned=False, learns=False, begins_with=None)
    scenario = dict.fromkeys(("a", "b"), SimpleNamespace(duration=1.0))
    study: Any = SimpleNamespace(
        scenarios_of=lambda name: [*scenario], scenario=scenario, controller={"x": law}
    )
    found = warnings.slow_warning(study, "x")
    lines = "drive.position_sensor.lines = 7 (another sensor)"
    ways = f"; {lines} would be enough by calculation" if helps else ""
    assert (None if found is None else str(found)) == (
        None if said is None else f"in scenario a: {said}{ways}"
    )
    assert said is None or sorted(tried) == pytest.approx([needed, needed])
    for name in ("sampled", "feedback_of"):
        with monkeypatch.context() as without:
            without.setattr(warnings, name, lambda *_: None)
            assert warnings.slow_warning(study, "x") is None


@pytest.mark.parametrize(
    ("method", "counts", "told"), [("M", 0.5, False), ("average", 0.49, True), ("MT", 0.4, False)]
)
def test_a_counted_speed_of_less_than_half_a_count_reads_zero(
    monkeypatch: pytest.MonkeyPatch, method: str, counts: float, told: bool
) -> None:
    sensor = Encoder.model_construct(kind="encoder", speed_method=method)
    here = SimpleNamespace(drive=SimpleNamespace(position_sensor=sensor))
    monkeypatch.setattr(warnings, "slowest_held_speed", lambda *_: counts * 20.0)
    monkeypatch.setattr(warnings, "sampled", lambda *_: Sampled(COUNT, 1e-3, False))
    monkeypatch.setattr(warnings, "for_scenario", lambda *_: here)
    monkeypatch.setattr(warnings, "_edges", lambda *_: None)
    monkeypatch.setattr(warnings, "speed_text", lambda study, speed: f"{speed:g} rad/s")
    study: Any = SimpleNamespace(controllers_in=lambda scenario: ["x"])
    monkeypatch.setattr(warnings, "timed_edges", lambda study: None)
    monkeypatch.setattr(warnings, "helping", lambda *_: ())
    found = warnings.reads_zero(study, "s")
    line = (
        "at 9.8 rad/s the position sensor gives 0.49 counts per speed sample: most speed samples are 0, "
        "the others 20 rad/s"
    )
    assert (None if found is None else str(found)) == (line if told else None)


def test_the_slowest_speed_is_held_for_a_twentieth_of_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    study: Any = SimpleNamespace(scenario={"s": None})
    ways = [np.array([0.0, *-np.arange(1.0, 102.0)]), np.zeros(5)]
    monkeypatch.setattr(warnings, "sampled", lambda *_: None)
    monkeypatch.setattr(warnings, "course", lambda scenario: SimpleNamespace(omega=ways.pop(0), step=0.1))
    assert [warnings.slowest_held_speed(study, "s"), warnings.slowest_held_speed(study, "s")] == [
        pytest.approx(6.0),
        0.0,
    ]


@pytest.mark.parametrize(
    ("omega", "slowest"),
    [
        ([0, 1, 9, 9, 1, 0, 0, 1, 9, 1, 0], 9),  # on the way to and from a rest
        ([1, 9, 9, 1], 1),  # it never rests
        ([-9, -1, 1, 9], 9),  # it turns back
        ([0, 1, 1, 1, 1, 0], 1),  # slow, but for longer than a count
    ],
)
def test_within_a_count_of_a_rest_there_is_no_motion_to_see(
    monkeypatch: pytest.MonkeyPatch, omega: list[int], slowest: int
) -> None:
    study: Any = SimpleNamespace(scenario={"s": None})
    sampling = SimpleNamespace(omega=np.array(omega, float), step=COUNT / 2)
    monkeypatch.setattr(warnings, "sampled", lambda *_: Sampled(COUNT, 1e-3, False))
    monkeypatch.setattr(warnings, "course", lambda scenario: sampling)
    assert warnings.slowest_held_speed(study, "s") == pytest.approx(slowest)


@pytest.mark.parametrize(("make", "times"), [(None, True), ("generic", True), ("odrive", False)])
def test_edges_are_timed_unless_the_drive_is_known_to_have_no_clock_for_it(
    tmp_path: Path, make: str | None, times: bool
) -> None:
    sensor = {"drive.position_sensor": {"kind": "encoder", "lines": 500}}
    study = studies.study(tmp_path, sensor if make is None else {**sensor, "drive.make": make})
    assert (timed_edges(study) is not None) is times


def test_the_makes_of_drives_are_those_of_new() -> None:
    assert get_args(Make) == tuple(edge_timers())
