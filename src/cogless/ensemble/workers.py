"""Run tasks on any `concurrent.futures.Executor`. If a worker dies, only its task runs again.

A `Parcel` holds a study for a worker on any machine: the study's tables and the files that they name.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import signal
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from multiprocessing import parent_process
from pathlib import Path
from threading import Thread
from typing import Any, TypeVar

from cogless.errors import StudyError, first_line
from cogless.run.own_law import no_exit
from cogless.study import AnyStudy
from cogless.study.base import Source
from cogless.study.named_files import named_files
from cogless.study.reading import checked

T = TypeVar("T")
MOST_LOSSES = 3  # a task is given up when this many of its workers have died
TASKS_AHEAD = 2  # tasks that are sent per worker: one runs, one waits
EXECUTOR_BROKEN = (
    "a worker process of the caller's executor died: expected a new executor; the same call "
    "with it continues from here"
)
END_PROCESS = os._exit  # for a worker that ends itself; for tasks os._exit is blocked
CLUSTER_PATIENCE = 10  # s, within which a cluster must answer


class Workers:
    """Where tasks run. `executor` is made when first needed, and again after its workers have died."""

    def __init__(self, make: Callable[[], Executor], count: Callable[[], int]) -> None:
        self._make = make
        self._executor: Executor | None = None
        self.count = count  # number of workers; a cluster's may change

    @property
    def executor(self) -> Executor:
        if self._executor is None:
            self._executor = self._make()
        return self._executor

    def renew(self) -> None:
        """Drop this executor, which is broken, so that the next use makes another one."""
        broken, self._executor = self._executor, None
        if broken is not None:
            broken.shutdown(wait=False)


def executor_workers(executor: Executor) -> Workers:
    """The workers of a caller's executor. Nothing here closes it, unless it breaks."""
    most = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    return Workers(lambda: executor, lambda: most)


class ProcessPool(ProcessPoolExecutor):
    """Worker processes in which a law can't end the process by os._exit."""

    def submit(self, work: Callable[..., T], /, *arguments: Any) -> Future[T]:  # type: ignore[override]
        return super().submit(_without_exit, work, *arguments)


def _without_exit(work: Callable[..., T], *arguments: Any) -> T:
    with no_exit():
        return work(*arguments)


@contextmanager
def processes(count: int) -> Iterator[Workers]:
    """`count` worker processes; unlike threads, they don't wait for a common lock."""
    pools: list[ProcessPool] = []

    def pool() -> Executor:
        context = multiprocessing.get_context("spawn")
        pools.append(ProcessPool(count, context, initializer=_led))
        return pools[-1]

    try:
        yield Workers(pool, lambda: count)
    except BaseException:  # such as Ctrl-C: running tasks are killed
        for executor in pools:
            running = list((executor._processes or {}).values())
            executor.shutdown(wait=False, cancel_futures=True)
            for process in running:
                process.kill()
        raise
    for executor in pools:
        executor.shutdown()


def _led() -> None:
    """Ignore Ctrl-C, and end when the process that started this one has ended, even if it was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_after, args=(parent_process(),), daemon=True).start()


def _end_after(leader: Any) -> None:
    leader.join()
    END_PROCESS(1)


@contextmanager
def dask(address: str) -> Iterator[Workers]:
    """The workers of a Dask cluster. StudyError: no answer, no worker, another version of cogless there."""
    try:
        from distributed import Client
    except ImportError:
        raise StudyError("--dask: expected more packages: pip install 'cogless[dask]'") from None
    try:
        client = Client(address, timeout=CLUSTER_PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        reason = first_line(error) if isinstance(error, ValueError) else "no answer"
        expected = "expected the address of a Dask scheduler, such as tcp://127.0.0.1:8786"
        raise StudyError(f"--dask: {address}: {reason}: {expected}") from None
    with client:
        _check_versions(address, client)

        workers = Workers(partial(client.get_executor, pure=False), lambda: sum(client.nthreads().values()))
        yield workers
        workers.renew()


def _check_versions(address: str, client: Any) -> None:
    from cogless.files import versions

    own_version = versions()["cogless"]
    versions_of_workers = client.run(_version, on_error="return")
    if not versions_of_workers:
        raise StudyError(f"--dask: {address}: the cluster has no worker: expected one or more")
    for worker, version in versions_of_workers.items():
        if version != own_version:
            has = f"has cogless {version}" if isinstance(version, str) else "has no cogless"
            raise StudyError(
                f"--dask: worker {worker}: {has}: expected {own_version}, the version of this command"
            )


def _version() -> str:
    from importlib.metadata import version

    return version("cogless")


def run_all(
    workers: Workers,
    work: Callable[..., T],
    tasks: Iterable[int],
    arguments: Callable[[int], Sequence[Any]],
    finished: Callable[[int, T], None],
    expected: str = "enough memory for it",
) -> None:
    """Call work(*arguments(number)) for each task, and `finished` with its number and result when it ends.

    A task's arguments are made when it is sent, so that waiting tasks take no memory. A task whose worker
    dies is sent again, and alone, since it may be what kills workers. StudyError: a task's worker has died
    MOST_LOSSES times (`expected`, in the message: what the task needs to end), or a cluster is gone.
    """
    waiting = deque(tasks)
    losses = dict.fromkeys(waiting, 0)
    while waiting:
        _use(workers, work, arguments, finished, waiting, losses, expected)
        if waiting:
            workers.renew()


def _use(
    workers: Workers,
    work: Callable[..., T],
    arguments: Callable[[int], Sequence[Any]],
    finished: Callable[[int, T], None],
    waiting: deque[int],
    losses: dict[int, int],
    expected: str,
) -> None:
    """Run the waiting tasks until none is left or the executor is broken; lost tasks are waiting again."""
    running: dict[Future[T], int] = {}
    broken = sent = False
    while running or (waiting and not broken):
        most = TASKS_AHEAD * max(1, workers.count())
        while waiting and not broken and len(running) < (1 if losses[waiting[0]] else most):
            alone = any(losses[number] for number in running.values())
            if alone:
                break
            try:
                running[workers.executor.submit(work, *arguments(waiting[0]))] = waiting[0]
                waiting.popleft()
                sent = True
            except BrokenProcessPool:
                if not sent:  # a caller's executor, which renewing does not replace
                    raise StudyError(EXECUTOR_BROKEN) from None
                broken = True
        done = wait(running, return_when=FIRST_COMPLETED).done
        for future in [future for future in running if future in done]:  # in the order that they were sent
            number = running.pop(future)
            try:
                result = future.result()
            except CancelledError:
                raise StudyError(
                    "the cluster is gone: the same command, repeated, continues from here"
                ) from None
            except Exception as error:
                if not _is_loss(error):
                    raise
                broken = broken or isinstance(error, BrokenProcessPool)
                losses[number] += 1
                if losses[number] >= MOST_LOSSES:
                    raise StudyError(
                        f"chunk {number}: its worker process died {MOST_LOSSES} times: expected {expected}"
                    ) from None
                waiting.appendleft(number)
            else:
                finished(number, result)


def _is_loss(error: Exception) -> bool:
    """Whether the worker died, rather than the task failed."""
    return isinstance(error, BrokenProcessPool) or type(error).__name__ == "KilledWorker"


@dataclass(frozen=True, eq=False)
class Parcel:
    """A packed study. `files`: content by path relative to the study. Equal digests make equal parcels."""

    source: Source
    files: Mapping[str, bytes]
    digest: str

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Parcel) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)


def pack(study: AnyStudy) -> Parcel:
    """Pack a study as it was read, changes included."""
    source = study.source
    files = {name: (source.folder / name).read_bytes() for name in sorted(_named(study))}
    text = json.dumps(source.tables, sort_keys=True, default=str)
    digest = hashlib.sha256(text.encode())
    for name, content in files.items():
        digest.update(f"\n{name} {len(content)}\n".encode() + content)
    return Parcel(source, files, digest.hexdigest())


@lru_cache(maxsize=8)
def unpacked(parcel: Parcel) -> AnyStudy:
    """The study of a parcel: in its original folder if all its files are there, else in a temporary one."""
    source = parcel.source
    if all(_is(source.folder / name, content) for name, content in parcel.files.items()):
        return checked(source)
    up = max(name.count("../") for name in parcel.files)
    folder = Path(tempfile.mkdtemp(prefix="cogless-"), *("in",) * up)
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in parcel.files.items():
        place = Path(os.path.normpath(folder / name))
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
    return checked(replace(source, path=folder / source.path.name, directory=folder))


def _is(path: Path, content: bytes) -> bool:
    try:
        return path.read_bytes() == content
    except OSError:
        return False


def _named(study: AnyStudy) -> set[str]:
    """Files that a study names by relative path; with a Python file, all Python files in the same folder."""
    folder = study.source.folder
    names = set()
    for file in named_files(type(study), study.source.tables):
        path = folder / file.path
        if os.path.isabs(file.path) or not os.path.isfile(path):
            continue
        names.add(file.path)
        if path.suffix == ".py":
            inside = os.path.dirname(file.path)
            names |= {os.path.join(inside, neighbour.name) for neighbour in path.parent.glob("*.py")}
    return names
