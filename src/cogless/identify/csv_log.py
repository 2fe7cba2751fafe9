"""Read the columns of a CSV, packed with gzip or not, in blocks of lines."""

from __future__ import annotations

import codecs
import csv
import gzip
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np

from cogless.errors import StudyError
from cogless.identify.files import Array, LogColumns, printable, readable, require_bytes, require_numbers

BLOCK_CHARACTERS = 1 << 22  # that are converted together; no line is longer
DELIMITERS = (",", ";", "\t")
SPACE = " "  # separates columns where none of the others does
LONGEST_PREAMBLE = 50  # lines
COMMENT_MARKS = ("#", "%")  # at the beginning of a line before the heading
SNIFFED_BYTES = 1 << 16  # of a file, by which its encoding is known
EMPTY_LINES_MOST = 10_000  # one after the other
NO_NUMBER = ("", "na", "n/a", "null", "none")  # cells, in small letters, beside "nan", which float reads


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
                raise StudyError(f"{path}: a line of {len(begun)} characters or more: expected rows")
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
    """UTF-16 by its mark, or UTF-8; text that is neither is Latin-1, where a micro sign is one byte."""
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
    commas = _decimal_commas(block, delimiter, list(places.values()))
    if commas:
        remarks.append(f"{path.name}: commas are taken for decimal points.")
    for lines in _without_half_a_line(path, chain([block], blocks), delimiter, len(heading), remarks):
        if commas:
            lines = [line.replace(",", ".") for line in lines]
        numbers = _converted(lines, delimiter, len(heading), list(places.values()))
        if numbers is None:
            numbers = _checked(path, lines, delimiter, heading, places, rows)
        if not len(numbers) and len(lines) > EMPTY_LINES_MOST:
            raise StudyError(f"{path}: row {rows + 1}: {len(lines)} empty lines before it: expected rows")
        rows += len(numbers)
        require_numbers(path, rows * len(places))
        pieces.append(numbers)
    columns = {name: np.concatenate([numbers[:, k] for numbers in pieces]) for k, name in enumerate(places)}
    return LogColumns("", columns, tuple(heading), tuple(remarks))


def _cells(block: list[str], delimiter: str, places: list[int]) -> list[list[str]]:
    """The cells at these places of the first two rows."""
    rows = [[cell.strip() for cell in row] for row in csv.reader(block[:2], delimiter=delimiter)]
    return [[row[place] for place in places] for row in rows if len(row) > max(places)]


def _are_units(block: list[str], delimiter: str, places: list[int]) -> bool:
    """Whether the first row has no number, and the second has only such: they may have decimal commas."""
    rows = _cells(block, delimiter, places)
    if len(rows) < 2 or any(map(_number_of_a_language, rows[0])):
        return False
    return any(rows[0]) and all(map(_number_of_a_language, rows[1]))


def _decimal_commas(block: list[str], delimiter: str, places: list[int]) -> bool:
    """Whether numbers of the first row have commas, none a point, and no comma separates cells."""
    rows = _cells(block, delimiter, places)
    if delimiter == "," or not rows or any("." in cell for cell in rows[0]):
        return False
    return any("," in cell for cell in rows[0]) and all(
        _lacks_number(cell) or _number_of_a_language(cell) for cell in rows[0]
    )


def _number_of_a_language(text: str) -> bool:
    return _number(text.replace(",", ".", 1))


def _without_half_a_line(
    path: Path, blocks: Iterable[list[str]], delimiter: str, cells: int, remarks: list[str]
) -> Iterator[list[str]]:
    """The lines, without a last one that has fewer cells: the recorder was switched off in it."""
    before: list[str] = []
    for lines in blocks:
        if before:
            yield before
        before = lines
    if before and before[-1].strip() and before[-1].count(delimiter) < cells - 1:
        remarks.append(f"{path.name}: the last line ends before its end, and is left out.")
        before = before[:-1]
    if before:
        yield before


def _delimiter(line: str, headings: list[str]) -> str:
    """What separates a heading's cells: spaces only where they give two of the wanted headings or more."""
    delimiter = max(DELIMITERS, key=line.count)
    spaced = delimiter not in line and len(set(_heading_cells(line, SPACE)) & set(headings)) > 1
    return SPACE if spaced else delimiter


def _heading_cells(line: str, delimiter: str) -> list[str]:
    line = _single_spaces(line, delimiter)
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]


def _single_spaces(line: str, delimiter: str) -> str:
    return SPACE.join(line.split()) if delimiter == SPACE else line


def _heading_row(block: list[str], first_row: int, headings: list[str]) -> int:
    """The row with two of the wanted headings or more, or the first: recorders write text before it."""
    for row, line in enumerate(block[first_row : first_row + LONGEST_PREAMBLE + 1], first_row):
        if len(set(_heading_cells(line, _delimiter(line, headings))) & set(headings)) > 1:
            return row
    return first_row


def _rows_only(
    path: Path, blocks: Iterable[list[str]], first: str, delimiter: str, remarks: list[str]
) -> Iterator[list[str]]:
    """The lines without headings that repeat the first: some recorders write it anew at each start."""
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
            f"{path.name}: the heading comes {repeated + 1} times; those between rows are left out."
        )


def _converted(lines: list[str], delimiter: str, cells: int, places: list[int]) -> Array | None:
    """Numbers of these lines, a column for each place; None where a line isn't as the heading."""
    if not lines or any(line.count(delimiter) != cells - 1 for line in lines):
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
    for values in csv.reader(lines, delimiter=delimiter, skipinitialspace=True):
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
            if _lacks_number(text):
                numbers.append(float("nan"))
                continue
            if not _number(text):
                how = " with a decimal point" if _number(text.replace(",", ".")) else ""
                raise StudyError(f'{path}: {name}: row {row}: "{printable(text)}": expected a number{how}')
            numbers.append(float(text))
        rows.append(numbers)
    return np.array(rows).reshape(-1, len(places))


def _lacks_number(text: str) -> bool:
    return text.strip().lower() in NO_NUMBER


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
