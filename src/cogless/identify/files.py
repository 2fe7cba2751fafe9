"""Read the columns of a log file: CSV (packed or not), NPZ, Parquet, MAT, MDF4, and traces of a run."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.files import no_device, reason

Array = NDArray[np.float64]
Columns = dict[str, Array]
BLOCK = 1 << 16  # rows of a CSV that are converted together
DELIMITERS = (",", ";", "\t")
LONGEST_PREAMBLE = 50  # lines


def read(path: Path, wanted: list[str]) -> Iterator[tuple[str, Columns]]:
    """Yield the name and the wanted columns of each log in a file; a trace file has several, others one.

    A column that isn't there is left out. StudyError names file, column and row.
    """
    name = path.name.lower()
    suffix = Path(name.removesuffix(".gz")).suffix
    reader = READERS.get(suffix)
    if reader is None:
        raise StudyError(f"{path}: unknown kind of file: expected one of {', '.join(READERS)}, .csv.gz")
    try:
        no_device(path)
        for part, columns in reader(path, wanted):
            _check(path, columns)
            yield part or path.name, columns
    except (OSError, EOFError, zipfile.BadZipFile) as error:
        why = reason(error) if isinstance(error, OSError) else str(error)
        raise StudyError(f"{path}: {why}: expected a readable {suffix} file") from error


def _check(path: Path, columns: Columns) -> None:
    lengths = {len(values) for values in columns.values()}
    if not lengths or lengths == {0}:
        raise StudyError(f"{path}: no rows: expected a log")
    if len(lengths) > 1:
        raise StudyError(f"{path}: columns of {min(lengths)} and {max(lengths)} rows: expected one clock")
    for name, values in columns.items():
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            raise StudyError(
                f"{path}: {name}: row {wrong[0] + 1}: {values[wrong[0]]}: expected a finite number "
                f"({len(wrong)} rows lack one)"
            )


def _csv(path: Path, wanted: list[str]) -> Iterator[tuple[str, Columns]]:
    packed = path.name.lower().endswith(".gz")
    try:
        with (
            path.open("rb") as raw,
            gzip.open(raw) if packed else raw as data,
            io.TextIOWrapper(data, encoding="utf-8-sig", newline="") as file,
        ):
            columns = _rows(path, file, wanted)
    except UnicodeDecodeError:
        raise StudyError(f"{path}: not UTF-8: expected a CSV in UTF-8") from None
    except csv.Error as error:
        raise StudyError(f"{path}: {error}: expected a CSV") from None
    yield "", columns


def _rows(path: Path, file: Iterator[str], wanted: list[str]) -> Columns:
    first = next((line for line in file if line.strip() and not line.startswith("#")), "")
    if not first:
        raise StudyError(f"{path}: empty: expected a heading and rows of numbers")
    delimiter = max(DELIMITERS, key=first.count)
    heading = [cell.strip() for cell in next(csv.reader([first], delimiter=delimiter))]
    places = {name: heading.index(name) for name in wanted if name in heading}
    if not places:
        _preamble(path, first, file, wanted)
    twice = next((name for name in places if heading.count(name) > 1), None)
    if twice is not None:
        raise StudyError(f"{path}: {twice}: {heading.count(twice)} columns have this heading: expected one")
    _near(path, wanted, heading)
    if not places:
        raise StudyError(f"{path}: columns {', '.join(heading[:12])}: expected {', '.join(wanted)}")
    blocks: list[Array] = []
    row = 0
    while lines := list(islice(file, BLOCK)):
        made = _converted(lines, delimiter, len(heading), list(places.values()))
        if made is None:
            made = _checked(path, lines, delimiter, heading, places, row)
        blocks.append(made)
        row += len(made)
    return {
        name: np.concatenate([block[:, k] for block in blocks]) for k, name in enumerate(places) if blocks
    }


def _near(path: Path, wanted: list[str], heading: list[str]) -> None:
    """Refuse a file whose headings differ from the wanted ones only by a unit, spaces or capitals."""

    def plain(name: str) -> str:
        return "".join(filter(str.isalnum, re.sub(r"[\[(].*", "", name).casefold()))

    free = {plain(name): name for name in heading if name not in wanted}
    for name in wanted:
        near = free.get(plain(name)) if name not in heading else None
        if near:
            raise StudyError(f'{path}: no column "{name}", but "{near}": expected name = "{near}" in columns')


def _preamble(path: Path, first: str, file: Iterator[str], wanted: list[str]) -> None:
    """Refuse a file that has text before its heading."""
    for line in islice(file, LONGEST_PREAMBLE):
        cells = {cell.strip().strip('"') for delimiter in DELIMITERS for cell in line.split(delimiter)}
        if len(cells & set(wanted)) > 1:
            raise StudyError(
                f'{path}: the heading "{line.strip()[:60]}" comes after text, "{first.strip()[:40]}": '
                "expected it first, or # before each line of the text"
            )


def _converted(lines: list[str], delimiter: str, cells: int, places: list[int]) -> Array | None:
    """Numbers of these lines, a column for each place; None where a line isn't as the heading."""
    if any(line.count(delimiter) != cells - 1 for line in lines):
        return None
    try:
        return np.loadtxt(lines, delimiter=delimiter, usecols=places, ndmin=2, comments=None)
    except ValueError:
        return None


def _checked(
    path: Path, lines: list[str], delimiter: str, heading: list[str], places: Mapping[str, int], before: int
) -> Array:
    """The same, cell by cell; StudyError: names column and row, of which so many were before these lines."""
    rows: list[list[float]] = []
    for values in csv.reader(lines, delimiter=delimiter):
        if not values:
            continue
        row = before + len(rows) + 1
        if len(values) > len(heading) and any(cell.strip() for cell in values[len(heading) :]):
            expected = f"expected {len(heading)}, as in the heading"
            raise StudyError(f"{path}: row {row}: {len(values)} cells: {expected}, and decimal points")
        numbers = []
        for name, place in places.items():
            if place >= len(values):
                raise StudyError(f"{path}: {name}: row {row}: missing: expected a number")
            text = values[place]
            if not _number(text):
                how = " with a decimal point" if _number(text.replace(",", ".")) else ""
                raise StudyError(f'{path}: {name}: row {row}: "{text}": expected a number{how}')
            numbers.append(float(text))
        rows.append(numbers)
    return np.array(rows).reshape(-1, len(places))


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _npz(path: Path, wanted: list[str]) -> Iterator[tuple[str, Columns]]:
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            yield "", {name: _numbers(path, name, file[name]) for name in wanted if name in file}
    except ValueError:
        raise StudyError(
            f"{path}: no NPZ file, or one with objects in it: expected arrays of numbers"
        ) from None


def _parquet(path: Path, wanted: list[str]) -> Iterator[tuple[str, Columns]]:
    try:
        import pyarrow.parquet as pq
    except ImportError:
        raise StudyError(f"{path}: expected the extra: pip install 'cogless[logs]'") from None
    from pyarrow.lib import ArrowException

    try:
        there = set(pq.read_schema(path).names)
        table = pq.read_table(path, columns=[name for name in wanted if name in there])
    except ArrowException as error:
        raise StudyError(f"{path}: {str(error).splitlines()[0]}: expected a Parquet file") from None
    yield "", {name: _numbers(path, name, table[name].to_numpy()) for name in table.column_names}


def _mat(path: Path, wanted: list[str]) -> Iterator[tuple[str, Columns]]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(path, variable_names=wanted)
    except NotImplementedError:
        raise StudyError(f"{path}: MATLAB 7.3: expected an older format (save -v7)") from None
    except (MatReadError, ValueError, TypeError) as error:
        raise StudyError(f"{path}: {error}: expected a MAT file") from None
    yield "", {name: _numbers(path, name, found[name]) for name in wanted if name in found}


def _mdf(path: Path, wanted: list[str]) -> Iterator[tuple[str, Columns]]:
    """Channels of an MDF4 file, brought to the time of the first; the column `t` is then its time."""
    try:
        from asammdf import MDF
        from asammdf.blocks.utils import MdfException
    except ImportError:
        raise StudyError(f"{path}: expected the extra: pip install 'cogless[logs]'") from None
    try:
        with MDF(path) as file:
            there = [name for name in wanted if name in file]
            signals = [file.get(name) for name in there]
    except MdfException as error:
        raise StudyError(f"{path}: {error}: expected an MDF file") from None
    if not signals:
        raise StudyError(f"{path}: no such channels: expected {', '.join(wanted)}")
    time = np.asarray(signals[0].timestamps, dtype=np.float64)
    found = {name: np.asarray(s.interp(time).samples, float) for name, s in zip(there, signals, strict=True)}
    yield "", {**{name: time for name in wanted[:1] if name not in found}, **found}


def _trace(path: Path, wanted: list[str]) -> Iterator[tuple[str, Columns]]:
    """The runs of a traces.nc, each a log named by its scenario."""
    import netCDF4

    with netCDF4.Dataset(path) as file:
        runs = [
            (scenario, group) for scenario, outer in file.groups.items() for group in outer.groups.values()
        ]
        for scenario, group in runs:
            there = group.variables
            yield scenario, {n: _numbers(path, n, np.asarray(there[n][:])) for n in wanted if n in there}


def _numbers(path: Path, name: str, values: NDArray[np.generic]) -> Array:
    try:
        if np.iscomplexobj(values):  # of which NumPy would take the real part
            raise TypeError
        return np.asarray(values, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise StudyError(f"{path}: {name}: expected numbers") from None


READERS: dict[str, Callable[[Path, list[str]], Iterator[tuple[str, Columns]]]] = {
    ".csv": _csv,
    ".npz": _npz,
    ".parquet": _parquet,
    ".mat": _mat,
    ".mf4": _mdf,
    ".nc": _trace,
}
