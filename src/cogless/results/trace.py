"""A trace: the recorded signals of one run, by name, with units.

Units: SI. Angles are mechanical and unwrapped (`theta_m`), speeds mechanical (`omega_m`).

A trace that is too long for memory is in a file without a name, which vanishes when the command ends.
"""

from __future__ import annotations

import math
import mmap
import tempfile
import weakref
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.files import reason, replacing
from cogless.signals import DERIVED

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

BLOCK_ROWS = 1 << 18  # rows of a long trace that are read at a time
CHUNK_ROWS = 1 << 16  # rows that are compressed together


@dataclass(frozen=True, eq=False)
class Trace:
    """Recorded signals of a run.

    `trace[name]` is a signal. `data`: a row per time, a column per signal, used without a copy; one of the
    signals is "time". `mapped`: the file that `data` is in, if the trace isn't in memory. Then each signal is
    read as a copy, so that only the signals in use take memory. `largest`: a larger value is read as NaN.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    data: Array
    mapped: mmap.mmap | None = None
    largest: float = math.inf

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "units", tuple(self.units))
        rows_and_signals = (self.data.ndim, self.data.shape[-1])
        if rows_and_signals != (2, len(self.names)) or len(self.names) != len(self.units):
            raise ValueError(
                f"trace: data {self.data.shape} for {len(self.names)} names, {len(self.units)} units"
            )

    def __getitem__(self, name: str) -> Array:
        """One signal, recorded (a view) or derived (a new array); KeyError lists the available signals."""
        return self.part(name, slice(None))

    def part(self, name: str, rows: slice) -> Array:
        """These rows of a signal, as trace[name][rows]; other rows are read only for signals `from_start`."""
        if name in self.names:
            return self._recorded(self.data[rows, self.names.index(name)])
        if name not in self.derived:
            raise self._unknown(name)
        derived = DERIVED[name]
        if derived.from_start:
            return np.asarray(derived.of(*(self[signal] for signal in derived.needs))[rows])
        return np.asarray(derived.of(*(self.part(signal, rows) for signal in derived.needs)))

    def _recorded(self, x: Array) -> Array:
        if self.mapped is not None:
            x = x.copy()
            if hasattr(mmap, "MADV_DONTNEED"):
                self.mapped.madvise(mmap.MADV_DONTNEED)
        # a NaN makes both comparisons false
        if self.largest < math.inf and x.size and not (x.min() > -self.largest and x.max() < self.largest):
            with np.errstate(invalid="ignore"):
                return np.where(np.abs(x) < self.largest, x, np.nan)
        return np.asarray(x)

    def blocks(self, rows: slice = slice(None), size: int = BLOCK_ROWS) -> Iterator[slice]:
        """These rows in pieces of at most `size`, to go through a long trace in little memory."""
        first, last, _ = rows.indices(len(self))
        return (slice(row, min(row + size, last)) for row in range(first, last, size))

    @property
    def derived(self) -> tuple[str, ...]:
        """Signals that are computed from what was recorded."""
        return tuple(name for name, derived in DERIVED.items() if set(derived.needs) <= set(self.names))

    def __contains__(self, name: object) -> bool:
        return name in self.names or name in self.derived

    def __len__(self) -> int:
        return int(self.data.shape[0])

    @property
    def time(self) -> Array:
        """Time of each row, s."""
        return np.asarray(self.data[:, self.names.index("time")])

    @property
    def period(self) -> float:
        """Time between rows, s (0 with fewer than two rows)."""
        time = self.time
        return float(time[-1] - time[0]) / (len(time) - 1) if len(time) > 1 else 0.0

    def unit(self, name: str) -> str:
        """SI unit of a signal; KeyError as in `trace[name]`."""
        if name in self.names:
            return self.units[self.names.index(name)]
        if name in self.derived:
            return DERIVED[name].unit
        raise self._unknown(name)

    def _unknown(self, name: str) -> KeyError:
        return KeyError(f"no signal {name!r}; there are {', '.join((*self.names, *self.derived))}")

    def window(self, t0: float, t1: float) -> slice:
        """Rows with t0 <= time <= t1 (s), both ends included up to rounding."""
        time, slack = self.time, 1e-6 * self.period
        first = int(np.searchsorted(time, t0 - slack, side="left"))
        last = int(np.searchsorted(time, t1 + slack, side="right"))
        return slice(first, max(first, last))

    def to_xarray(self) -> xarray.Dataset:
        """A Dataset over the coordinate `time`, units in the attributes. StudyError: no xarray here."""
        try:
            import xarray
        except ImportError:
            raise StudyError("to_xarray: expected xarray (pip install 'cogless[xarray]')") from None

        signals = {
            name: ("time", self[name], {"units": unit})
            for name, unit in zip(self.names, self.units, strict=True)
            if name != "time"
        }
        return xarray.Dataset(signals, coords={"time": ("time", self.time, {"units": "s"})})


class RunWithTrace(Protocol):
    """Parts of a run that `write_netcdf` needs."""

    @property
    def scenario(self) -> str: ...
    @property
    def controller(self) -> str: ...
    @property
    def trace(self) -> Trace: ...


def write_netcdf(
    path: Path,
    runs: Iterable[RunWithTrace],
    attributes: Mapping[str, Any] | Callable[[], Mapping[str, Any]] | None = None,
    rate: float = math.inf,
) -> None:
    """Write all runs to one netCDF-4 file, one group per "scenario/controller", completely or not at all.

    `time` and `theta_m` are stored in double precision, since both grow without bound; the others in single.
    `rate`: largest number of stored rows a second, Hz. Of a trace with more, every n-th row is stored; n is
    the group's attribute `every`. `attributes` go to the file's root. A function that returns them is called
    when the runs are written.
    `xarray.open_dataset(path, group="scenario/controller")` opens a run.
    StudyError: the file can't be written.
    """
    import netCDF4

    with replacing(Path(path)) as temporary:
        try:
            with netCDF4.Dataset(temporary, "w") as file:
                for run in runs:
                    _write_group(file.createGroup(f"{run.scenario}/{run.controller}"), run.trace, rate)
                file.setncatts(dict((attributes() if callable(attributes) else attributes) or {}))
        except RuntimeError as error:  # on a full disk: "NetCDF: HDF error"
            raise OSError(f"{error}, is the disk full?") from error


def _write_group(group: Any, trace: Trace, rate: float) -> None:
    every = max(1, math.ceil(1 / (trace.period * rate) - 1e-6)) if trace.period else 1
    count = len(range(0, len(trace), every))
    group.createDimension("time", count)
    group.every = np.int32(every)
    for name, unit in zip(trace.names, trace.units, strict=True):
        kind = "f8" if name in ("time", "theta_m") else "f4"
        variable = group.createVariable(
            name,
            kind,
            ("time",),
            fill_value=False,
            compression="zlib",
            complevel=1,
            chunksizes=(max(1, min(count, CHUNK_ROWS)),),
            chunk_cache=1,  # whole chunks are written; kept in memory, they would add up
        )
        variable.units = unit
        variable.set_auto_maskandscale(False)
        for rows in trace.blocks(size=BLOCK_ROWS * every):
            stored = trace.part(name, slice(rows.start, rows.stop, every)).astype(kind)
            variable[rows.start // every : rows.start // every + len(stored)] = stored


IN_MEMORY = 48_000_000  # bytes of all traces that are not in files


class TraceFile:
    """A file to which a trace is written while its run goes on, one signal after the other in the file."""

    def __init__(self, folder: Path, signals: Sequence[tuple[str, str]], rows: int) -> None:
        self._folder, self._signals = folder, signals
        self._rows, self._written = rows, 0
        try:
            # open until the trace is forgotten
            self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        except OSError as error:
            raise self._no_room(error) from error
        weakref.finalize(self, self._file.close)  # also if the run fails

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
    """Room for a study's traces: memory for the first IN_MEMORY bytes, then files in a folder.

    `folder`: None: memory alone. `signals`: the only ones to record besides time; None: all.
    """

    def __init__(self, folder: Path | None = None, signals: Collection[str] | None = None) -> None:
        self._folder, self._left, self._lock = folder, IN_MEMORY, Lock()
        self._signals = signals

    def columns(self, signals: Sequence[tuple[str, str]]) -> list[int]:
        """Places of those of a run's signals (name, unit) that are recorded; empty: all are."""
        if self._signals is None:
            return []
        return [k for k, (name, _) in enumerate(signals) if name == "time" or name in self._signals]

    def file(self, signals: Sequence[tuple[str, str]], rows: int) -> TraceFile | None:
        """A file for a trace of so many rows of signals (name, unit); None if it may stay in memory."""
        if self._folder is None:
            return None
        size = 8 * rows * len(signals)
        with self._lock:
            if size <= self._left:
                self._left -= size
                return None
        return TraceFile(self._folder, signals, rows)
