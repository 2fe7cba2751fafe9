"""How runs go on in pieces, and which of them go in step, without an engine."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event
from types import SimpleNamespace
from typing import Any, cast

import pytest

from cogless.design.trials.from_study import Designs
from cogless.run import run_plan as room
from cogless.run import simulate
from cogless.run.run_plan import Stopped, advance


def pieces(
    monkeypatch: pytest.MonkeyPatch, ticks: int, seconds: Callable[[int], float]
) -> tuple[list[int], list[float]]:
    """Ticks of each piece, and the shares told, where so many ticks take so long."""
    now, made, shares = 0.0, list[int](), list[float]()

    def run(count: int) -> None:
        nonlocal now
        made.append(count)
        now += seconds(count)

    monkeypatch.setattr(room.time, "perf_counter", lambda: now)
    advance(run, ticks, shares.append, Event())
    return made, shares


def test_pieces_last_a_tenth_of_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 1000 ticks on; each is at most four times the one before, the last one what is left."""
    made, shares = pieces(monkeypatch, 1250, lambda count: count / 1024)
    assert made == [1000, 102, 102, 46] and shares == [0.8, 0.8816, 0.9632, 1.0]
    assert pieces(monkeypatch, 30_000, lambda count: 0.0)[0] == [1000, 4000, 16_000, 9000]
    assert pieces(monkeypatch, 6000, lambda count: 0.02 * count / 1000)[0] == [1000, 4000, 1000]
    assert pieces(monkeypatch, 1003, lambda count: 1.0 * count)[0] == [1000, 1, 1, 1]
    assert pieces(monkeypatch, 0, lambda count: 1.0) == ([], [])


def test_a_run_that_is_stopped_ends_between_two_pieces() -> None:
    stop, made = Event(), list[int]()

    def run(count: int) -> None:
        made.append(count)
        stop.set()

    with pytest.raises(Stopped):
        advance(run, 5000, lambda share: None, stop)
    assert made == [1000]
    advance(run, 0, lambda share: None, stop)  # it has come to its end


def pending(duration: float, name: str) -> Any:
    study = SimpleNamespace(scenario={name: SimpleNamespace(duration=duration)})
    return SimpleNamespace(study=study, scenario=name, controller="pi")


@pytest.mark.parametrize(
    ("count", "jobs", "sizes"),
    [
        (10, 1, [4, 4, 2]),
        (9, 1, [3, 3, 3]),  # alike rather than full and one alone
        (8, 1, [4, 4]),
        (10, 4, [3, 3, 3, 1]),  # some for each job
        (10, 8, [2] * 5),
        (2, 8, [1, 1]),
    ],
)
def test_groups_are_as_large_as_the_lanes_and_the_jobs_allow(
    monkeypatch: pytest.MonkeyPatch, count: int, jobs: int, sizes: list[int]
) -> None:
    engine = SimpleNamespace(lane_kernels=lambda: [("wide", 4), ("narrow", 2)])
    monkeypatch.setattr(simulate, "import_module", lambda name: engine)
    runs = [pending(1.0, "low") for _ in range(count)]
    groups = simulate._groups(runs, jobs)
    assert [len(group) for group in groups] == sizes
    assert [run for group in groups for run in group] == runs


def test_the_longest_runs_are_first_and_those_of_one_scenario_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    engine = SimpleNamespace(lane_kernels=lambda: [("wide", 2)])
    monkeypatch.setattr(simulate, "import_module", lambda name: engine)
    a, c = pending(1.0, "low"), pending(1.0, "low")
    b, d, long = pending(1.0, "high"), pending(1.0, "high"), pending(2.0, "slow")
    assert simulate._groups([a, long, b, c, d], 1) == [[long], [a, c], [b, d]]


def test_failures_are_counted_and_the_first_is_told() -> None:
    study = cast(Any, (SimpleNamespace(kind="speed"), Designs()))
    ends = (simulate.StudyError("one"), None, simulate.StudyError("two"), Stopped())
    failed: list[Any] = [
        SimpleNamespace(scenario="low", controller=str(number), outcome=end)
        for number, end in enumerate(ends)
    ]
    unfinished: list[Any] = [failed[1]]
    for outcomes, line in (([failed], "one (and 1 more run failed)"), ([[], failed[:2]], "one")):
        with pytest.raises(simulate.RunError) as error:
            simulate._collected([study] * len(outcomes), outcomes, False)
        assert str(error.value) == line and len(error.value.all_results) == len(outcomes)
        assert [result.interrupted for result in error.value.all_results][-1:] == [True]
    done, stopped = (
        simulate._collected([study], [unfinished], False),
        simulate._collected([study], [unfinished], True),
    )
    assert [result.interrupted for result in (*done, *stopped)] == [False, True]
    broken: Any = SimpleNamespace(scenario="low", controller="0", outcome=ZeroDivisionError())
    with pytest.raises(simulate.RunDefect, match="low/0") as defect:
        simulate._collected([study], [[broken]], False)
    assert isinstance(defect.value.__cause__, ZeroDivisionError)
