"""Read the columns of an MDF file of version 4, whose blocks are checked before a library follows them."""

from __future__ import annotations

import logging
import mmap
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from cogless.errors import StudyError
from cogless.identify.log_files import (
    LogColumns,
    no_numbers,
    readable,
    require_bytes,
    require_numbers,
    require_unpacked,
)

HEADER_BYTE = 64  # byte at which the first block begins
# By kind of block: links that lead to the block's parts and to the next block of this kind. None: all links.
LINKS: dict[bytes, tuple[int, ...] | None] = {
    b"##HD": (0, 1, 2, 3, 4),
    b"##DG": (0, 1, 2),
    b"##CG": (0, 1),
    b"##CN": (0, 1),
    b"##CA": (0,),
    b"##FH": (0,),
    b"##AT": (0,),
    b"##CH": (0, 1),
    b"##EV": (0,),
    b"##HL": (0,),
    b"##LD": None,
    b"##DL": None,
}
DEFLATED = (0, 1)  # codes of packing by deflate: of a block's bytes, or of its transposed bytes
TEXT_CHANNEL = 1  # type of a channel whose values have any length


def read_mdf(path: Path, headings: list[str]) -> list[LogColumns]:
    """The channels of these names, interpolated at the times of the first channel that is no time itself.

    StudyError: the extra is not installed.
    """
    try:
        from asammdf import MDF
    except ImportError:
        raise StudyError(f"{path}: expected more packages: pip install 'cogless[logs]'") from None
    with readable(path, "MDF4"), _silent("asammdf"):
        _check_blocks(path)
        with MDF(path) as file:
            times = set(file.masters_db.items())
            names = tuple(file.channels_db)
            present = [name for name in headings if name in file.channels_db]
            places = {name: set(file.channels_db[name]) - times for name in present}
            for name, of_name in places.items():
                if len(of_name) > 1:
                    raise StudyError(f"{path}: {name}: {len(of_name)} channels have this name: expected one")
                if any(file.groups[group].channels[k].channel_type == TEXT_CHANNEL for group, k in of_name):
                    raise no_numbers(path, name)
            signals = {name: file.get(name, *of_name.pop()) for name, of_name in places.items() if of_name}
            if not signals:
                return [LogColumns("", {}, names)]
            time = np.asarray(next(iter(signals.values())).timestamps, dtype=np.float64)
            at_time = {name: signal.interp(time).samples for name, signal in signals.items()}
            return [LogColumns("", {name: at_time.get(name, time) for name in present}, names)]


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Switch a library's log off in this context. The library's exceptions say what is wrong with a file."""
    log = logging.getLogger(name)
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


def _check_blocks(path: Path) -> None:
    """Follow the blocks of a file. StudyError: a block is reached twice, is cut, or claims too much data."""
    with path.open("rb") as file:
        start = file.read(HEADER_BYTE)
        if start[:8] not in (b"MDF     ", b"UnFinMF ") or start[8:9] != b"4":
            raise StudyError(f"{path}: it does not begin like an MDF 4 file: expected a readable MDF4 file")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            packed = []
            numbers = 0
            for kind, data in _blocks(path, content):
                if kind == b"##CG":
                    _, cycles = struct.unpack_from("<QQ", content, data)
                    numbers += cycles
                elif kind == b"##DZ":
                    way, size, packed_size = struct.unpack_from("<2xBx4xQQ", content, data)
                    require_bytes(path, size)
                    if way in DEFLATED:
                        packed.append((data + 24, packed_size))
            require_numbers(path, numbers)
            require_unpacked(path, (_pieces(content, *place) for place in packed))


def _blocks(path: Path, content: Any) -> Iterator[tuple[bytes, int]]:
    """Yield each block's kind and the byte at which the block's data begins, after the links."""
    reached: set[int] = set()
    ahead = [HEADER_BYTE]
    while ahead:
        block = ahead.pop()
        kind, size, count = struct.unpack_from("<4s4xQQ", content, block)
        data = block + 24 + 8 * count
        if data > block + size or block + size > len(content):
            raise no_block(path, block, "cut")
        yield kind, data
        if kind not in LINKS:
            continue
        if block in reached:
            raise no_block(path, block, "reached twice")
        reached.add(block)
        links = struct.unpack_from(f"<{count}Q", content, block + 24)
        ahead += [link for k, link in enumerate(links) if link and k in (LINKS[kind] or range(count))]


def no_block(path: Path, block: int, why: str) -> StudyError:
    """The error of a block that begins at this byte."""
    return StudyError(f"{path}: the block at byte {block} is {why}: expected a readable MDF4 file")


def _pieces(content: Any, start: int, size: int) -> Iterator[bytes]:
    end = min(start + size, len(content))
    return (content[at : min(at + (1 << 16), end)] for at in range(start, end, 1 << 16))
