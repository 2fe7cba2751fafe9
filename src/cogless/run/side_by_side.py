"""Run tasks in parallel threads. Ctrl-C ends them; threads that don't end are abandoned."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from threading import Event, Thread
from typing import TypeVar

T = TypeVar("T")
GRACE_TIME = 1.0  # s, in which running tasks may end after Ctrl-C
THREAD_NAME = "cogless-run"


def side_by_side(tasks: Sequence[Callable[[], T]], jobs: int, stop: Event) -> list[Future[T]]:
    """Run tasks in threads, `jobs` at a time, and return their futures in order.

    Ctrl-C sets `stop`; some futures then stay open. The threads are daemons, for which Python doesn't wait at
    exit. With an executor's threads, a task that sleeps or never returns would keep the command from ending.
    """
    futures: list[Future[T]] = [Future() for _ in tasks]
    waiting = deque(zip(tasks, futures, strict=True))

    def work() -> None:
        while not stop.is_set():
            try:
                task, future = waiting.popleft()
            except IndexError:
                return
            try:
                future.set_result(task())
            except BaseException as error:
                future.set_exception(error)

    threads = [Thread(target=work, name=THREAD_NAME, daemon=True) for _ in tasks[: max(1, jobs)]]
    try:
        for thread in threads:
            thread.start()
        wait(futures)
    except KeyboardInterrupt:
        stop.set()
        with suppress(KeyboardInterrupt):  # Ctrl-C pressed again ends the wait
            _join(threads)
    return futures


def left_behind() -> bool:
    """Whether a thread of a task is still running."""
    return any(thread.name == THREAD_NAME for thread in threading.enumerate())


def _join(threads: Sequence[Thread]) -> None:
    """Wait for these threads to end, for at most GRACE_TIME in total."""
    end = time.monotonic() + GRACE_TIME
    for thread in threads:
        if thread.is_alive():
            thread.join(max(0.0, end - time.monotonic()))
