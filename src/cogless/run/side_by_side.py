"""Tasks on threads of their own, which Ctrl-C ends, or leaves behind where they don't end."""

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
GRACE = 1.0  # s that running tasks have to end once Ctrl-C is pressed
NAME = "cogless-run"


def side_by_side(tasks: Sequence[Callable[[], T]], jobs: int, stop: Event) -> list[Future[T]]:
    """Outcomes of the tasks, in their order, so many at a time. Ctrl-C sets `stop`: then some aren't done.

    Python waits at its end for the threads of an executor; one whose task sleeps, or never returns, would
    keep the command from ending.
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

    threads = [Thread(target=work, name=NAME, daemon=True) for _ in tasks[: max(1, jobs)]]
    try:
        for thread in threads:
            thread.start()
        wait(futures)
    except KeyboardInterrupt:
        stop.set()
        with suppress(KeyboardInterrupt):  # pressed again: at once
            _join(threads)
    return futures


def left_behind() -> bool:
    """Whether a task is still under way."""
    return any(thread.name == NAME for thread in threading.enumerate())


def _join(threads: Sequence[Thread]) -> None:
    """Wait for these to end, all together no longer than GRACE."""
    end = time.monotonic() + GRACE
    for thread in threads:
        if thread.is_alive():
            thread.join(max(0.0, end - time.monotonic()))
