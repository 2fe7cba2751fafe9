"""Read the columns of an NPZ, Parquet or MAT file, and of a run's traces.nc. Sizes are checked first."""

from __future__ import annotations

import math
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.identify.log_files import (
    LogColumns,
    no_numbers,
    readable,
    require_numbers,
    require_unpacked,
)

PIECE_BYTES = 1 << 16  # bytes of a packed part that are read at once
MAT_INTEGERS = [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
MAT_NUMBERS = ("double", "single", "logical", *MAT_INTEGERS)
MAT_PACKED = 15  # type of an element: miCOMPRESSED
MAT_HEADER = 128  # bytes before the first element
NPY_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_npz(path: Path, headings: list[str]) -> list[LogColumns]:
    """The arrays of these names."""
    with readable(path, "NPZ"), path.open("rb") as raw, zipfile.ZipFile(raw) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        present = {name: members[name] for name in headings if name in members}
        count = 0
        for name, info in present.items():
            with archive.open(info) as member:
                count += _npy_numbers(path, name, info.file_size, member)
            require_numbers(path, count)
        columns = {}
        for name, info in present.items():
            with archive.open(info) as member:
                columns[name] = np.lib.format.read_array(member, allow_pickle=False)
        return [LogColumns("", columns, tuple(members))]


def _npy_numbers(path: Path, name: str, size: int, member: IO[bytes]) -> int:
    """The count of numbers in an array of an archive. StudyError: header and size in bytes disagree."""
    shape, _, dtype = NPY_HEADERS[np.lib.format.read_magic(member)](member)
    if dtype.hasobject:
        raise no_numbers(path, name)
    count, stored = math.prod(shape), size - member.tell()
    require_numbers(path, count)
    if count * dtype.itemsize != stored:
        raise StudyError(
            f"{path}: {name}: its header claims {count} numbers of {dtype.itemsize} bytes: "
            f"expected as many as the archive has, {stored} bytes"
        )
    return count


def read_parquet(path: Path, headings: list[str]) -> list[LogColumns]:
    """The columns of these names. StudyError: the extra is not installed."""
    try:
        import pyarrow.parquet as pq
    except ImportError:
        raise StudyError(f"{path}: expected more packages: pip install 'cogless[logs]'") from None
    with readable(path, "Parquet"), path.open("rb") as raw, pq.ParquetFile(raw) as file:
        names = file.schema_arrow.names
        present = [name for name in headings if name in names]
        require_numbers(path, file.metadata.num_rows * len(present))
        # No column is read from the metadata: at a damaged one the library would end the process.
        groups = (file.metadata.row_group(group) for group in range(file.metadata.num_row_groups))
        require_numbers(path, sum(group.num_rows for group in groups) * len(present))
        table = file.read(columns=present, use_threads=False)
        return [LogColumns("", {name: table[name].to_numpy() for name in present}, tuple(names))]


def read_mat(path: Path, headings: list[str]) -> list[LogColumns]:
    """The variables of these names of a MAT file up to version 7."""
    from scipy.io import loadmat, whosmat

    with readable(path, "MAT"):
        with path.open("rb") as file:
            start = file.read(MAT_HEADER)
            if start.startswith(b"MATLAB 7.3"):
                raise StudyError(f"{path}: MATLAB 7.3: expected an older format (save -v7)")
            order = {b"IM": "<", b"MI": ">"}.get(start[-2:])  # version 4 has no such mark, and packs nothing
            if order is not None:
                require_unpacked(path, _mat_packed(file, order))
        variables = {name: (math.prod(shape), kind) for name, shape, kind in whosmat(path)}
        present = [name for name in headings if name in variables]
        for name in present:
            if variables[name][1] not in MAT_NUMBERS:
                raise no_numbers(path, name)
        require_numbers(path, sum(variables[name][0] for name in present))
        values = loadmat(path, variable_names=present)
        return [LogColumns("", {name: values[name] for name in present}, tuple(variables))]


def _mat_packed(file: IO[bytes], order: str) -> Iterator[Iterator[bytes]]:
    """The packed elements of a MAT file of version 5, each in pieces."""
    start = MAT_HEADER
    while len(tag := _bytes_at(file, start, 8)) == 8:
        kind, size = struct.unpack(f"{order}II", tag)
        if kind == MAT_PACKED:
            yield _pieces(file, start + 8, size)
        start += 8 + size


def _bytes_at(file: IO[bytes], start: int, size: int) -> bytes:
    file.seek(start)
    return file.read(size)


def _pieces(file: IO[bytes], start: int, size: int) -> Iterator[bytes]:
    end = start + size
    while start < end and (piece := _bytes_at(file, start, min(PIECE_BYTES, end - start))):
        yield piece
        start += len(piece)


def read_trace(path: Path, headings: list[str]) -> list[LogColumns]:
    """The runs of a traces.nc, each a log named by its scenario."""
    import netCDF4

    with readable(path, "netCDF"), netCDF4.Dataset(path) as file:
        scenarios = file.groups.items()
        runs = [(scenario, group) for scenario, outer in scenarios for group in outer.groups.values()]
        count = 0
        for _, group in runs:
            for name in headings:
                if name in group.variables:
                    if not isinstance(group.variables[name].dtype, np.dtype):  # texts, or rows of any length
                        raise no_numbers(path, name)
                    count += math.prod(group.variables[name].shape)
        require_numbers(path, count)
        return [
            LogColumns(
                scenario,
                {name: _filled(group.variables[name][:]) for name in headings if name in group.variables},
                tuple(group.variables),
            )
            for scenario, group in runs
        ]


def _filled(values: Any) -> NDArray[Any]:
    """Values of a variable, NaN where none was written."""
    if np.ma.is_masked(values):
        return np.ma.filled(values.astype(np.float64), np.nan)
    return np.asarray(values)
