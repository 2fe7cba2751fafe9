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

ENGINES = {"single": "cogless._simulator_f32", "double": "cogless._simulator_f64"}
PIECE = 0.1  # s of wall time between two reports of progress and checks for Ctrl-C

Progress = Callable[[float], None]


class Stopped(Exception):  # noqa: N818, it isn't an error
    """Ctrl-C was pressed."""


@contextmanager
def failures(
    study: AnyStudy, scenario: str, controller: str, when: Callable[[], str] = str
) -> Iterator[None]:
    """Turn any failure in a run into a StudyError of one line. `when`: returns the time in the run, or ""."""
    try:
        yield
    except BaseException as error:
        if isinstance(error, StudyError | Stopped) or not is_failure(error):
            raise
        where = f"controller.{controller}: scenario {scenario}{when()}"
        cause = describe(error, law_file(study, controller))
        raise StudyError(f"{study.source.path}: {where}: {cause}") from error


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
