"""Traces that are too long for memory: each in a file without a name, which ends with the command."""

from __future__ import annotations

import mmap
import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from threading import Lock

import numpy as np

from cogless.errors import StudyError
from cogless.files import reason
from cogless.results.trace import Array, Trace

IN_MEMORY = 48_000_000  # bytes of all traces that are not in files


class TraceFile:
    """A trace that is written while its run goes on, a signal after the other in the file."""

    def __init__(self, folder: Path, signals: Sequence[tuple[str, str]], rows: int) -> None:
        self._folder, self._signals = folder, signals
        self._rows, self._written = rows, 0
        try:
            # open until the trace is forgotten
            self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        except OSError as error:
            raise self._no_room(error) from error
        weakref.finalize(self, self._file.close)  # also of a run that fails

    def append(self, rows: Array) -> None:
        """Write further rows, with a column per signal. StudyError: there is no room for them."""
        try:
            for signal, values in enumerate(rows.T):
                self._file.seek(8 * (signal * self._rows + self._written))
                self._file.write(np.ascontiguousarray(values).data)
            self._file.flush()
        except OSError as error:
            raise self._no_room(error) from error
        self._written += len(rows)

    def trace(self) -> Trace:
        """The trace, once all rows are written."""
        if self._written != self._rows:
            raise RuntimeError(f"trace: {self._written} rows, expected {self._rows}")
        mapped = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        self._file.close()
        data = np.frombuffer(mapped).reshape(len(self._signals), self._rows).T
        names, units = zip(*self._signals, strict=True)
        return Trace(names, units, data, mapped)

    def _no_room(self, error: OSError) -> StudyError:
        size = f"{8e-6 * self._rows * len(self._signals):.3g} MB"
        why = f"{reason(error)}: expected room for {size} of a run's trace, or a lower trace.rate"
        return StudyError(f"{self._folder}: {why}")


class TraceRoom:
    """Room for a study's traces: memory for the first IN_MEMORY bytes, then files in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._left, self._lock = folder, IN_MEMORY, Lock()

    def file(self, signals: Sequence[tuple[str, str]], rows: int) -> TraceFile | None:
        """A file for a trace of so many rows of signals (name, unit); None if it may stay in memory."""
        size = 8 * rows * len(signals)
        with self._lock:
            if size <= self._left:
                self._left -= size
                return None
        return TraceFile(self._folder, signals, rows)
