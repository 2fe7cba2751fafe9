"""How tasks are handed to workers, and what a journal keeps of them, without any worker."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ensembles
import pytest

from cogless.ensemble import sweep as sweeping
from cogless.ensemble import workers as executing
from cogless.ensemble.workers import Workers, executor_workers, pack, run_all
from cogless.errors import StudyError
from cogless.run import simulate
from cogless.run.carry_out import carried_out_together


class Waits(Executor):
    """Runs a task when it is waited for, in the order of sending. The worker of each in `dying` dies once."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *dying: int) -> None:
        self.sent: dict[Future[Any], tuple[Any, ...]] = {}
        self.dying, self.together = list(dying), list[Sequence[int]]()
        self.closed: list[bool] = []
        monkeypatch.setattr(executing, "wait", self.wait)

    def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.sent[future] = arguments
        return future

    def wait(self, running: dict[Future[Any], int], return_when: str) -> Any:
        self.together.append(list(running.values()))
        future, number = next(iter(running.items()))
        if number in self.dying:
            self.dying.remove(number)
            future.set_exception(BrokenProcessPool("died"))
        else:
            future.set_result(self.sent[future])
        return SimpleNamespace(done={future})

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self.closed.append(wait)


class Arguments:
    """The arguments of each task. `most`: the largest number of unfinished tasks that had theirs."""

    def __init__(self, finished: dict[int, Any]) -> None:
        self.calls, self.most, self.finished = 0, 0, finished

    def __call__(self, number: int) -> tuple[int]:
        self.calls += 1
        self.most = max(self.most, self.calls - len(self.finished))
        return (number,)


def test_two_tasks_are_sent_for_each_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    """One runs while the other waits. A cluster without workers gets as many as if it had one."""
    for count, ahead in ((2, 4), (1, 2), (0, 2)):
        executor, found = Waits(monkeypatch), dict[int, Any]()
        arguments = Arguments(found)
        run_all(Workers(lambda: executor, lambda: count), int, range(6), arguments, found.__setitem__)  # noqa: B023
        assert max(map(len, executor.together)) == arguments.most == ahead
        assert list(found.items()) == [(n, (n,)) for n in range(6)] and executor.closed == []


def test_a_task_whose_worker_died_is_sent_again_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a new executor, once all that ran beside it has ended."""
    executor, found = Waits(monkeypatch, 1), list[int]()
    run_all(
        Workers(lambda: executor, lambda: 1),
        int,
        range(4),
        lambda n: (n,),
        lambda n, result: found.append(n),
    )
    assert executor.together == [[0, 1], [1, 2], [2], [1], [3]]
    assert found == [0, 2, 1, 3] and executor.closed == [False]


def test_an_executor_is_made_when_it_is_needed_and_anew_when_it_is_broken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[Waits] = []

    def make() -> Waits:
        made.append(Waits(monkeypatch))
        return made[-1]

    workers = Workers(make, lambda: 1)
    workers.renew()
    assert made == []
    assert workers.executor is workers.executor is made[0]
    workers.renew()
    assert made[0].closed == [False] and workers.executor is made[1] and made[1].closed == []


def test_a_caller_s_executor_has_as_many_workers_as_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    with ThreadPoolExecutor(3) as threads:
        assert (executor_workers(threads).count(), executor_workers(threads).executor) == (3, threads)
    silent = Waits(monkeypatch)
    assert executor_workers(silent).count() == os.cpu_count()
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert executor_workers(silent).count() == 1


def test_a_worker_leaves_ctrl_c_to_the_process_that_started_it_and_ends_with_it() -> None:
    """Even if that one is killed, which can tell nobody."""
    ours, theirs = os.pipe()
    leader = os.fork()
    if not leader:
        try:
            os.close(ours)
            with executing.processes(2) as workers:
                ignored = workers.executor.submit(signal.getsignal, signal.SIGINT).result() is signal.SIG_IGN
                os.write(theirs, b"ignored" if ignored else b"heard")
                signal.pause()
        finally:
            os._exit(70)
    os.close(theirs)
    assert os.read(ours, 9) == b"ignored"
    os.kill(leader, signal.SIGKILL)
    os.waitpid(leader, 0)
    assert select.select([ours], [], [], 10)[0] and os.read(ours, 9) == b""  # no worker holds it open
    os.close(ours)


def test_a_worker_ends_with_its_leader_while_a_task_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though the task's law may not end it."""
    codes: list[int] = []
    monkeypatch.setattr(executing, "END_PROCESS", codes.append)
    leader = SimpleNamespace(join=lambda: None)
    assert executing._without_exit(executing._end_after, leader) is None and codes == [1]
    with pytest.raises(SystemExit):
        executing._without_exit(_exits)


def _exits() -> None:
    os._exit(0)


def test_a_sweep_that_is_interrupted_kills_its_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is done waits for them."""
    told: list[Any] = []

    class Pool:
        def __init__(self, count: int, context: Any, initializer: Any) -> None:
            told.append((count, initializer))
            self._processes = {1: SimpleNamespace(kill=lambda: told.append("killed"))}

        def shutdown(self, wait: bool = True, cancel_futures: bool = False) -> None:
            told.append((wait, cancel_futures))

    monkeypatch.setattr(executing, "ProcessPool", Pool)
    start = (3, executing._led)
    with executing.processes(3) as workers:
        assert workers.count() == 3 and workers.executor
    assert told == [start, (True, False)]
    told.clear()
    with pytest.raises(KeyboardInterrupt), executing.processes(3) as workers:
        assert workers.executor
        raise KeyboardInterrupt
    assert told == [start, (False, True), "killed"]


# the journal


def test_a_line_is_written_whole_to_a_file_that_takes_it_in_parts(tmp_path: Path) -> None:
    class Slow:
        """Takes five bytes at a time."""

        def __init__(self) -> None:
            self.content = b""

        def write(self, data: Any) -> int:
            self.content += bytes(data[:5])
            return min(5, len(data))

    file: Any = Slow()
    kept = sweeping.Journal(tmp_path / "j", file, {})
    kept.add(3, [[1.5, None]])
    assert file.content == b"462863b4 [3,[[1.5,null]]]\n" and kept.finished == {3: [[1.5, None]]}


def test_a_journal_that_cannot_be_opened_is_told(tmp_path: Path) -> None:
    path = tmp_path / "none" / "j"
    with pytest.raises(StudyError) as error, sweeping.opened(path, {}):
        pass
    assert str(error.value) == f"{path}: no such file or directory: expected a file that can be written"


# the work


def test_a_worker_that_is_interrupted_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parcel = pack(ensembles.study(tmp_path))
    monkeypatch.setattr(sweeping, "rollout", lambda *of, **how: [SimpleNamespace(interrupted=True)])
    with pytest.raises(sweeping.Ended):
        sweeping.variant_rows(parcel, [{}], [("low", "pi")])


def test_a_variant_without_a_design_leaves_the_others_theirs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are still computed together; of the variant, its other controller has its row."""
    prepare, counts = simulate._prepare, list[int]()

    def refuses(study: Any, runs: Any) -> Any:
        if study.seed == 7 and ("low", "pi") in runs:
            raise StudyError(f"{study.source.path}: low/pi: no design")
        return prepare(study, runs)

    def together(plans: Any, *of: Any) -> Any:
        counts.append(len(plans))
        return carried_out_together(plans, *of)

    monkeypatch.setattr(simulate, "_prepare", refuses)
    monkeypatch.setattr(simulate, "carried_out_together", together)
    pairs = [("low", "pi"), ("low", "pi-ilc")]
    one, none, other = sweeping.variant_rows(
        pack(ensembles.study(tmp_path)), [{"seed": n} for n in (6, 7, 8)], pairs
    )
    assert none[0] == [None, None, None, "study.toml: low/pi: no design"]
    rows = [*one, none[1], *other]
    assert all(row[-1] is None and row[0] > 0 for row in rows)
    assert sum(counts) == 5


def test_a_worker_starts_without_scipy() -> None:
    """It draws no variants; SciPy would be a quarter of its start, and of its memory."""
    code = "import sys, cogless.ensemble.sweep; print('scipy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_callers_executor_that_lost_a_worker_ends_the_work_with_its_cure() -> None:
    """It stays broken: to send tasks to it again would never end."""
    with ProcessPoolExecutor(1) as own:
        with pytest.raises(BrokenProcessPool):
            own.submit(os._exit, 1).result()
        with pytest.raises(
            StudyError, match="a worker process of the caller's executor died: expected a new"
        ):
            run_all(executor_workers(own), abs, [1, 2], lambda number: (number,), lambda number, result: None)
