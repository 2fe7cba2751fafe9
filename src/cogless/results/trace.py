"""A trace: the recorded signals of one run, by name, with units.

Units: SI. Angles are mechanical and unwrapped (`theta_m`), speeds mechanical (`omega_m`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cogless.files import replacing
from cogless.signals import DERIVED

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trace:
    """Recorded signals of a run.

    `data`: a row per time, a column per signal, used without a copy; one of the signals is "time".
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    data: Array

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
        if name in self.names:
            return np.asarray(self.data[:, self.names.index(name)])
        if name in self.derived:
            derived = DERIVED[name]
            return np.asarray(derived.of(*(self[signal] for signal in derived.needs)))
        raise self._unknown(name)

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
        return self["time"]

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
        """A Dataset over the coordinate `time`, units in the attributes."""
        import xarray

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
    path: Path, runs: Iterable[RunWithTrace], attributes: Mapping[str, Any] | None = None
) -> None:
    """Write all runs to one netCDF-4 file, one group per "scenario/controller", completely or not at all.

    `time` and `theta_m` are stored in double precision, since both grow without bound; the others in single.
    `attributes` go to the file's root. `xarray.open_dataset(path, group="scenario/controller")` opens a run.
    StudyError: the file can't be written.
    """
    import netCDF4

    with replacing(Path(path)) as temporary:
        try:
            with netCDF4.Dataset(temporary, "w") as file:
                file.setncatts(dict(attributes or {}))
                for run in runs:
                    _write_group(file.createGroup(f"{run.scenario}/{run.controller}"), run.trace)
        except RuntimeError as error:  # on a full disk: "NetCDF: HDF error"
            raise OSError(f"{error}, is the disk full?") from error


def _write_group(group: Any, trace: Trace) -> None:
    rows = len(trace)
    group.createDimension("time", rows)
    for name, unit in zip(trace.names, trace.units, strict=True):
        kind = "f8" if name in ("time", "theta_m") else "f4"
        variable = group.createVariable(name, kind, ("time",), fill_value=False, contiguous=rows > 0)
        variable.units = unit
        variable.set_auto_maskandscale(False)
        variable[:] = trace[name].astype(kind)
