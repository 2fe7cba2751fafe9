"""Read the columns of a CSV, packed with gzip or not, in blocks of lines."""

from __future__ import annotations

import codecs
import csv
import gzip
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np

from cogless.errors import StudyError
from cogless.identify.csv_cells import (
    OTHER,
    decimal_mark,
    is_number,
    is_number_of_a_language,
    lacks_number,
    plain,
    seconds,
)
from cogless.identify.log_files import LogColumns, printable, readable, require_bytes, require_numbers
from cogless.results.trace import Array

BLOCK_CHARACTERS = 1 << 22  # read at once; a longer line is refused
DELIMITERS = (",", ";", "\t")
SPACE = " "  # separates columns in files without any of DELIMITERS
LONGEST_PREAMBLE = 50  # lines
COMMENT_MARKS = ("#", "%")  # at the beginning of a line before the heading
SNIFFED_BYTES = 1 << 16  # bytes at the beginning of a file that show its encoding
EMPTY_LINES_MOST = 10_000  # one after the other
LANGUAGE_ROWS = 1000  # first rows, which show the mark before decimals


def read_csv(path: Path, headings: list[str]) -> list[LogColumns]:
    """The columns with these headings. StudyError names column and row."""
    blocks = _blocks(path)
    try:
        return [_columns(path, blocks, headings)]
    except csv.Error as error:
        raise StudyError(f"{path}: {error}: expected a CSV") from None


def _blocks(path: Path) -> Iterator[list[str]]:
    """The lines of a file, in lists of some thousands."""
    with _opened(path) as file:
        begun, size = "", 0
        while text := _next_text(path, file):
            size += len(text)
            require_bytes(path, size)
            *lines, begun = (begun + text).split("\n")
            if len(begun) > BLOCK_CHARACTERS:
                raise StudyError(
                    f"{path}: a line of {len(begun)} characters or more: expected rows of numbers"
                )
            if lines:
                yield lines
        if begun:
            yield [begun]


def _opened(path: Path) -> IO[str]:
    opening: Callable[..., IO[Any]] = gzip.open if path.name.lower().endswith(".gz") else open
    with readable(path, "CSV"):
        with opening(path, "rb") as file:
            encoding = _encoding(file.read(SNIFFED_BYTES))
        return opening(path, "rt", encoding=encoding)


def _encoding(first: bytes) -> str:
    """The encoding: UTF-16 if its mark is there, else UTF-8, else Latin-1, where a micro sign is one byte."""
    if first.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(first)
    except UnicodeDecodeError:
        if not any(byte < ord(" ") and byte not in b"\t\n\r" for byte in first):
            return "latin-1"
    return "utf-8-sig"


def _next_text(path: Path, file: IO[str]) -> str:
    with readable(path, "CSV"):
        try:
            return file.read(BLOCK_CHARACTERS)
        except UnicodeDecodeError:
            raise StudyError(f"{path}: not UTF-8: expected a CSV in UTF-8") from None


def _columns(path: Path, blocks: Iterator[list[str]], headings: list[str]) -> LogColumns:
    block = next(blocks, [])
    first_row = next(
        (k for k, line in enumerate(block) if line.strip() and not line.startswith(COMMENT_MARKS)), None
    )
    if first_row is None:
        raise StudyError(f"{path}: empty: expected a heading and rows of numbers")
    rows, remarks = 0, list[str]()
    heading_row = _heading_row(block, first_row, headings)
    if heading_row > first_row:
        text = printable(block[first_row].strip()[:40])
        remarks.append(f'{path.name}: the text before the heading, from "{text}" on, is left out.')
    first, block = block[heading_row], block[heading_row + 1 :]
    delimiter = _delimiter(first, headings)
    heading = _heading_cells(first, delimiter)
    places = {name: heading.index(name) for name in headings if name in heading}
    if not places:
        return LogColumns("", {}, tuple(heading))
    twice = next((name for name in places if heading.count(name) > 1), None)
    if twice is not None:
        raise StudyError(f"{path}: {twice}: {heading.count(twice)} columns have this heading: expected one")
    pieces: list[Array] = [np.empty((0, len(places)))]
    blocks = _rows_only(path, chain([block], blocks), first, delimiter, remarks)
    block = next(blocks, [])
    if _are_units(block, delimiter, list(places.values())):
        units = printable(block[0].strip().replace("\t", " ")[:60])
        remarks.append(
            f'{path.name}: "{units}" is a row of units. It is not used: the units are those of --config.'
        )
        block = block[1:]
    table = _Table(path, delimiter, heading, places, *_language(block, delimiter, places))
    if table.decimal == ",":
        remarks.append(f"{path.name}: commas are taken for decimal points.")
    for name, cell in table.clocks.items():
        remarks.append(f'{path.name}: {name}: "{cell}" is read as hours, minutes and seconds.')
    for lines in _without_half_a_line(path, chain([block], blocks), delimiter, len(heading), remarks):
        numbers = table.converted(lines)
        if numbers is None:
            numbers = table.checked(lines, rows)
        if not len(numbers) and len(lines) > EMPTY_LINES_MOST:
            raise StudyError(
                f"{path}: row {rows + 1}: {len(lines)} empty lines before it: expected {EMPTY_LINES_MOST} or "
                "fewer"
            )
        rows += len(numbers)
        require_numbers(path, rows * len(places))
        pieces.append(numbers)
    remarks += table.thousands
    columns = {name: np.concatenate([numbers[:, k] for numbers in pieces]) for k, name in enumerate(places)}
    return LogColumns("", columns, tuple(heading), tuple(remarks), tuple(table.clocks))


def _cells(block: list[str], delimiter: str, places: Collection[int], rows: int = 2) -> list[list[str]]:
    """The cells at these places of the first rows."""
    read = [[cell.strip() for cell in row] for row in csv.reader(block[:rows], delimiter=delimiter)]
    return [[row[place] for place in places] for row in read if len(row) > max(places)]


def _are_units(block: list[str], delimiter: str, places: list[int]) -> bool:
    """Whether the first row has no number and the second only numbers, with decimal points or commas."""
    rows = _cells(block, delimiter, places)
    if len(rows) < 2 or any(map(is_number_of_a_language, rows[0])):
        return False
    return any(rows[0]) and all(map(is_number_of_a_language, rows[1]))


def _language(
    block: list[str], delimiter: str, places: Mapping[str, int]
) -> tuple[str, bool, dict[str, str]]:
    """The mark before decimals, whether the mark is sure, and the first cell of each column of times of day.

    Commas that separate no cells are taken for decimal if no number has a point.
    """
    rows = _cells(block, delimiter, places.values(), LANGUAGE_ROWS)
    clocks = {
        name: cell
        for name, cell in zip(places, rows[0] if rows else (), strict=False)
        if seconds(cell) is not None
    }
    cells = [cell for row in rows for name, cell in zip(places, row, strict=True) if name not in clocks]
    numbers = [cell for cell in cells if is_number_of_a_language(cell)]
    if mark := decimal_mark(numbers):
        return mark, True, clocks
    commas = delimiter != "," and not any("." in cell for cell in numbers) and any("," in c for c in numbers)
    return "," if commas else ".", False, clocks


def _without_half_a_line(
    path: Path, blocks: Iterable[list[str]], delimiter: str, cells: int, remarks: list[str]
) -> Iterator[list[str]]:
    """The lines, without a last line that has fewer cells: there the recorder was switched off."""
    before: list[str] = []
    for lines in blocks:
        if before:
            yield before
        before = lines
    if before and before[-1].strip() and before[-1].count(delimiter) < cells - 1:
        remarks.append(f"{path.name}: the last line is incomplete, and is left out.")
        before = before[:-1]
    if before:
        yield before


def _delimiter(line: str, headings: list[str]) -> str:
    """The delimiter of a heading's cells. It is a space only if spaces give two wanted headings or more."""
    delimiter = max(DELIMITERS, key=line.count)
    spaced = delimiter not in line and len(set(_heading_cells(line, SPACE)) & set(headings)) > 1
    return SPACE if spaced else delimiter


def _heading_cells(line: str, delimiter: str) -> list[str]:
    line = _single_spaces(line, delimiter)
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]


def _single_spaces(line: str, delimiter: str) -> str:
    return SPACE.join(line.split()) if delimiter == SPACE else line


def _heading_row(block: list[str], first_row: int, headings: list[str]) -> int:
    """The index of the first row with two wanted headings or more, else `first_row`.

    Some recorders write text before the heading.
    """
    for row, line in enumerate(block[first_row : first_row + LONGEST_PREAMBLE + 1], first_row):
        if len(set(_heading_cells(line, _delimiter(line, headings))) & set(headings)) > 1:
            return row
    return first_row


def _rows_only(
    path: Path, blocks: Iterable[list[str]], first: str, delimiter: str, remarks: list[str]
) -> Iterator[list[str]]:
    """The lines without repetitions of the heading: some recorders write the heading at each start."""
    if delimiter == SPACE:
        remarks.append(f"{path.name}: spaces are taken for the separators of columns.")
    heading, repeated = _single_spaces(first, delimiter).strip(), 0
    for block in blocks:
        spaced = [_single_spaces(line, delimiter) for line in block]
        lines = [line for line in spaced if line.strip() != heading]
        repeated += len(block) - len(lines)
        if lines:
            yield lines
    if repeated:
        remarks.append(
            f"{path.name}: the heading comes {repeated + 1} times; the headings between rows are left out."
        )


@dataclass(frozen=True)
class _Table:
    """How the rows of a file become numbers.

    `decimal`: mark before decimals. `sure`: whether other cells show this mark, so that the other mark can
    only separate thousands. `clocks`: first cell of each column of times of day. `thousands`: the remark on
    separators of thousands, once there are any.
    """

    path: Path
    delimiter: str
    heading: list[str]
    places: Mapping[str, int]
    decimal: str
    sure: bool
    clocks: Mapping[str, str]
    thousands: list[str] = field(default_factory=list)

    def converted(self, lines: list[str]) -> Array | None:
        """Numbers of the lines, a column for each of `places`; None if `checked` has to read each cell."""
        if not lines or any(line.count(self.delimiter) != len(self.heading) - 1 for line in lines):
            return None
        if self.decimal == ",":
            if self.delimiter == "," or any("." in line for line in lines):
                return None
            lines = [line.replace(",", ".") for line in lines]
        clocks: dict[int | str, Callable[[str], Any]] = {self.places[name]: _seconds for name in self.clocks}
        try:
            numbers: Array = np.loadtxt(
                lines,
                delimiter=self.delimiter,
                usecols=list(self.places.values()),
                ndmin=2,
                comments=None,
                converters=clocks or None,
            )
        except ValueError:
            return None
        return numbers

    def checked(self, lines: list[str], before: int) -> Array:
        """The numbers of the lines, cell by cell. StudyError names column and row.

        `before`: the count of rows before these lines.
        """
        rows: list[list[float]] = []
        for values in csv.reader(lines, delimiter=self.delimiter, skipinitialspace=True):
            if not values:
                continue
            row, cells = before + len(rows) + 1, len(self.heading)
            if len(values) > cells and any(cell.strip() for cell in values[cells:]):
                expected = f"expected {cells}, as in the heading"
                raise StudyError(
                    f"{self.path}: row {row}: {len(values)} cells: {expected}, with decimal points, "
                    "not commas"
                )
            numbers = []
            for name, place in self.places.items():
                if place >= len(values):
                    raise StudyError(f"{self.path}: {name}: row {row}: missing: expected a number")
                numbers.append(self._number(name, row, values[place]))
            rows.append(numbers)
        return np.array(rows).reshape(-1, len(self.places))

    def _number(self, name: str, row: int, text: str) -> float:
        if lacks_number(text):
            return float("nan")
        if name in self.clocks and (time := seconds(text)) is not None:
            return time
        number = plain(text, self.decimal)
        separator = OTHER[self.decimal] in text
        if not is_number(number) or (separator and not self.sure):
            where, cell = f"{self.path}: {name}: row {row}", printable(text)
            if seconds(text) is not None:
                raise StudyError(
                    f'{where}: "{cell}" is a time of day, but the first row has a number: expected a number'
                )
            how = " with a decimal point" if is_number_of_a_language(text) else ""
            raise StudyError(f'{where}: "{cell}": expected a number{how}')
        if not self.thousands and number != text.strip().replace(self.decimal, "."):
            self.thousands.append(
                f'{self.path.name}: {name}: "{printable(text.strip())}" is read as {float(number):.12g}, '
                "without its separators of thousands."
            )
        return float(number)


def _seconds(text: str) -> float:
    """Seconds of a time of day. ValueError: the text is no time."""
    time = seconds(text)
    if time is None:
        raise ValueError
    return time
