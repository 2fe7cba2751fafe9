"""Helpers of a run: the engine's modules, simulation in short pieces, failures as one-line errors."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event
from typing import Any

from cogless.errors import StudyError
from cogless.results.trace import Trace
from cogless.run.own_law import describe, is_failure, law_file
from cogless.study import AnyStudy
from cogless.study.controller import OwnLaw

ENGINES = {"single": "cogless._simulator_f32", "double": "cogless._simulator_f64"}
REFUSALS = (ValueError, RuntimeError, MemoryError)  # exactly these does the engine raise about a study
PIECE = 0.1  # s of wall time between two reports of progress and checks for Ctrl-C

Progress = Callable[[float], None]


class Stopped(Exception):  # noqa: N818, it isn't an error
    """Ctrl-C was pressed."""


@contextmanager
def failures(
    study: AnyStudy, scenario: str, controller: str, when: Callable[[], str] = str
) -> Iterator[None]:
    """Turn what a call of the engine raises into a StudyError of one line: the engine's refusal, or any
    exception of a user's law.

    Any other exception is a defect of cogless, and goes on. So only calls of the engine belong in here.
    `when`: returns the time in the run, or "".
    """
    try:
        yield
    except BaseException as error:
        of_user = isinstance(study.controller[controller], OwnLaw) and is_failure(error)
        if isinstance(error, StudyError) or not (of_user or type(error) in REFUSALS):
            raise
        where = f"controller.{controller}: scenario {scenario}{when()}"
        cause = describe(error, law_file(study, controller))
        raise StudyError(f"{study.source.path}: {where}: {cause}") from error


@contextmanager
def memory_enough(study: AnyStudy, scenario: str, controller: str) -> Iterator[None]:
    """Turn a MemoryError into a StudyError of one line: the run needs more memory than there is."""
    try:
        yield
    except MemoryError as error:
        where = f"controller.{controller}: scenario {scenario}"
        raise StudyError(f"{study.source.path}: {where}: {describe(error, None)}") from error


def advance(run: Callable[[int], None], ticks: int, progress: Progress, stop: Event) -> None:
    """Call `run` for all the ticks, in pieces of about PIECE. In between, report progress, see `stop`."""
    done, piece = 0, 1000
    while done < ticks:
        if stop.is_set():
            raise Stopped
        begun = time.perf_counter()
        step = min(piece, ticks - done)
        run(step)
        done += step
        progress(done / ticks)
        spent = max(time.perf_counter() - begun, 1e-6)
        piece = max(1, min(4 * piece, int(step * PIECE / spent)))


def trace_of(drive: Any, recorder: Any) -> Trace:
    """Take the rows recorded so far from the recorder, as a trace."""
    names, units = zip(*drive.signals, strict=True)
    return Trace(names, units, recorder.take())
