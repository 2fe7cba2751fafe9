"""Read, check and write learned maps in the format that firmware keeps in flash (see control/SPEC.md).

Show stored maps to a person: as lines of text, and as a table of their entries.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from cogless.control_library import C_LAWS
from cogless.errors import StudyError
from cogless.files import no_device, reason, replacing
from cogless.units import TURN

MAGIC_BYTES, FORMAT_VERSION, HEADER_BYTES, END_MARK = b"CGLM", 1, 64, b"DONE"
FLOAT32_CODE = 1  # code of float32, the only number type
OWN_LAW_CODE = 128  # the first code of a user's own laws
LONGEST_WRITE = 256  # bytes, the largest write size

LAWS = ("other", *(law.name for law in C_LAWS.values() if law.cells))  # index: code of the law
# Index: code of a channel's unit. Entry: what the channel is, its unit, and its column's name.
CHANNEL_UNITS = (
    ("none", "", "none"),
    ("current", "A", "current_A"),
    ("current per speed", "A*s/rad", "current_per_speed_A_s_rad"),
    ("current per acceleration", "A*s^2/rad", "current_per_acceleration_A_s2_rad"),
    ("acceleration", "rad/s^2", "acceleration_rad_s2"),
    ("signal of the trial", "", "signal"),
    ("amplitude of the cosine", "A", "cosine_A"),
    ("amplitude of the sine", "A", "sine_A"),
    ("order", "", "order"),
)
CURRENT_CODE, COSINE_CODE, SINE_CODE, ORDER_CODE = 1, 6, 7, 8  # codes of units

Entries = NDArray[np.float32]
# All of the header except its CRC.
_FIELDS = struct.Struct("<4sHHIIIBBHIIIHB3sH3fI")


class MapError(StudyError):
    """Bytes that aren't a valid map; the message says why, in one line."""


@dataclass(frozen=True, eq=False)
class StoredMap:
    """What a law has learned, with the identity of its motor.

    `values[c, n]` is entry n of channel c. It is for the mechanical angle 2 pi n turns / (parts * cells),
    rad; if turns = parts = 0, for sample n of a trial; if one channel contains orders, for the order in
    entry n of that channel. `ratio`: angle in the units of the channels / mechanical angle. `units`: for
    each channel, an index of CHANNEL_UNITS. `limits`: for each channel, the bound of its entries' magnitude.
    """

    values: Entries
    units: tuple[int, ...]
    limits: tuple[float, ...]
    _: KW_ONLY
    law: int = 0
    turns: int = 1
    parts: int = 1
    ratio: int = 1
    motor: int = 0  # identity, 32 bits
    motion: int = 0  # identity of a trial's reference
    sequence: int = 1  # number of the save: a newer map has a higher number
    write_size: int = 8  # bytes: the mark at the end begins at a multiple of this size

    def __post_init__(self) -> None:
        values = np.atleast_2d(np.asarray(self.values, dtype=np.float32))
        object.__setattr__(self, "values", values)
        channels, cells = values.shape
        if not (1 <= channels == len(self.units) == len(self.limits) <= 3 and 1 <= cells <= 1 << 24):
            raise ValueError(
                f"stored map: {values.shape} values, {len(self.units)} units, {len(self.limits)} limits"
            )

    @property
    def channels(self) -> int:
        return int(self.values.shape[0])

    @property
    def cells(self) -> int:
        return int(self.values.shape[1])

    @property
    def law_name(self) -> str:
        if self.law >= OWN_LAW_CODE:
            return f"own law {self.law}"
        return LAWS[self.law] if self.law < len(LAWS) else str(self.law)

    @property
    def angle(self) -> NDArray[np.float64] | None:
        """Mechanical angle of each entry, rad; None for a trial and for orders."""
        if self.turns == 0 or ORDER_CODE in self.units:
            return None
        step = TURN * self.turns / (self.parts * self.cells)
        return step * np.arange(self.cells, dtype=np.float64)

    def unit(self, channel: int) -> tuple[str, str, str]:
        """What a channel is, its unit, and the name of its column."""
        code = self.units[channel]
        return CHANNEL_UNITS[code] if code < len(CHANNEL_UNITS) else (f"unit {code}", "", f"unit_{code}")

    def __bytes__(self) -> bytes:
        """The map's bytes in flash, from the start of the slot to the end of the mark after the entries."""
        limits = [*np.asarray(self.limits, dtype=np.float32), 0.0, 0.0][:3]
        entries = self.values.astype("<f4").tobytes()
        entries += b"\xff" * (-(HEADER_BYTES + len(entries)) % self.write_size)
        header = _FIELDS.pack(
            MAGIC_BYTES,
            FORMAT_VERSION,
            HEADER_BYTES,
            self.sequence,
            self.motor,
            self.motion,
            self.law,
            FLOAT32_CODE,
            self.write_size,
            self.cells,
            self.turns,
            self.parts,
            self.ratio,
            self.channels,
            bytes([*self.units, 0, 0][:3]),
            0,
            *limits,
            crc32(entries),
        )
        crc = crc32(header)
        return header + struct.pack("<I", crc) + entries + _mark(crc, self.write_size)


def decode(data: bytes, offset: int = 0) -> StoredMap:
    """Decode the map that begins at `offset`; bytes after it are ignored. MapError: it isn't a valid map."""
    whole = memoryview(data)[offset:]
    if bytes(whole[:4]) != MAGIC_BYTES:
        raise MapError(f'no map: expected "{MAGIC_BYTES.decode()}" at the beginning')
    if len(whole) < HEADER_BYTES:
        raise MapError(f"cut short: expected {HEADER_BYTES} bytes of header, got {len(whole)}")
    (crc,) = struct.unpack_from("<I", whole, HEADER_BYTES - 4)
    if crc32(whole[: HEADER_BYTES - 4]) != crc:
        raise MapError(
            f"damaged: the header stores the CRC 0x{crc:08X}, but has "
            f"0x{crc32(whole[: HEADER_BYTES - 4]):08X}"
        )
    fields = _FIELDS.unpack_from(whole)
    _, version, length, sequence, motor, motion, law, number_type, write_size = fields[:9]
    cells, turns, parts, ratio, channels, units, zero, *limits, entries_crc = fields[9:]
    if version != FORMAT_VERSION:
        raise MapError(f"version {version} of the format: expected {FORMAT_VERSION}")
    is_valid = (
        length == HEADER_BYTES and number_type == FLOAT32_CODE and zero == 0 and write_size in _write_sizes()
    )
    is_valid = is_valid and 1 <= channels <= 3 and 1 <= cells <= 1 << 24 and ratio > 0
    if not (is_valid and (turns == 0) == (parts == 0)):
        raise MapError("a header that is not valid in version 1, though its CRC is right")
    end = HEADER_BYTES + 4 * channels * cells
    end += -end % write_size
    mark = _mark(crc, write_size)
    if len(whole) < end + len(mark):
        raise MapError(f"cut short: expected {end + len(mark)} bytes, got {len(whole)}")
    if crc32(whole[HEADER_BYTES:end]) != entries_crc:
        raise MapError(
            f"damaged: the map stores the CRC 0x{entries_crc:08X} of its entries, but they have "
            f"0x{crc32(whole[HEADER_BYTES:end]):08X}"
        )
    if whole[end : end + len(mark)] != mark:
        raise MapError("damaged: no mark at the end: the map was not saved completely")
    values = np.frombuffer(whole, "<f4", channels * cells, HEADER_BYTES).reshape(channels, cells)
    for c, limit in enumerate(limits[:channels]):
        wrong = np.flatnonzero(~(np.abs(values[c]) <= np.float32(limit)))
        if len(wrong):
            entry = f"entry {wrong[0]} of channel {c + 1} is {values[c, wrong[0]]:g}"
            raise MapError(f"{entry}: expected a number within +-{limit:g}")
    return StoredMap(
        values=values.astype(np.float32),
        units=tuple(units[:channels]),
        limits=tuple(limits[:channels]),
        law=law,
        turns=turns,
        parts=parts,
        ratio=ratio,
        motor=motor,
        motion=motion,
        sequence=sequence,
        write_size=write_size,
    )


class FlashPlace(NamedTuple):
    """A place in a dump of flash that begins like a map: the map, or the error that says why it isn't one."""

    offset: int
    map: StoredMap | MapError


class Valid(NamedTuple):
    """A valid map in a dump of flash, and its place."""

    offset: int
    map: StoredMap


def find(data: bytes) -> list[FlashPlace]:
    """Find every map in a dump of flash, which contains whole slots."""
    return list(_find(data))


def _find(data: bytes) -> Iterator[FlashPlace]:
    offset = data.find(MAGIC_BYTES)
    while offset >= 0:
        try:
            stored = decode(data, offset)
        except MapError as error:
            yield FlashPlace(offset, error)
            offset = data.find(MAGIC_BYTES, offset + 1)
        else:
            yield FlashPlace(offset, stored)
            offset = data.find(MAGIC_BYTES, offset + len(bytes(stored)))


def newest(places: list[FlashPlace]) -> Valid | None:
    """The valid map with the last number of the save, which wraps around at 2^32; None if there is none.

    Firmware loads this map, if it fits the law.
    """
    valid = [Valid(place.offset, place.map) for place in places if isinstance(place.map, StoredMap)]
    best = valid[0] if valid else None
    for other in valid[1:]:
        if best is not None and 0 < (other.map.sequence - best.map.sequence) % 2**32 < 2**31:
            best = other
    return best


def read(path: Path) -> list[FlashPlace]:
    """Find every map in a file. MapError: nothing in it begins like a map; StudyError: it can't be read."""
    try:
        no_device(Path(path))
        data = Path(path).read_bytes()
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a stored map") from error
    maps = find(data)
    if not maps:
        raise MapError(f'{path}: no map: expected "{MAGIC_BYTES.decode()}" as the first bytes of a map')
    return maps


def write(path: Path, content: bytes) -> None:
    """Write the bytes of a map or of its table, completely or not at all; StudyError if that fails."""
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(content)


def _mark(header_crc: int, write_size: int) -> bytes:
    mark = struct.pack("<I", ~header_crc & 0xFFFFFFFF) + END_MARK
    return mark + b"\xff" * (-len(mark) % write_size)


def _write_sizes() -> tuple[int, ...]:
    return tuple(1 << n for n in range(LONGEST_WRITE.bit_length()))


HEX_BASE = 16


def map_lines(maps: list[FlashPlace], newest: Valid) -> list[str]:
    """Lines about every map that was found; the newest one in detail."""
    text = []
    for place in maps:
        where = f"At byte {place.offset}: " if len(maps) > 1 else ""
        if not isinstance(place.map, StoredMap):
            text.append(f"{where}{place.map}")
        elif place.offset == newest.offset:
            text.append(f"{where}a valid map{', the newest' if len(maps) > 1 else ''}")
            text += [f"  {name:<26}{value}" for name, value in map_rows(place.map)]
        else:
            text.append(f"{where}a valid map, save number {place.map.sequence}")
    return text


def map_rows(stored: StoredMap) -> list[tuple[str, str]]:
    """Name and value of the map's header fields, then a row for each channel."""
    facts = [
        ("learned by", stored.law_name),
        ("motor", f"0x{stored.motor:08X}"),
        ("save", str(stored.sequence)),
        ("period", _period(stored)),
        (
            "orders" if ORDER_CODE in stored.units else "cells" if stored.turns else "samples",
            str(stored.cells),
        ),
    ]
    if stored.motion:
        facts.insert(2, ("motion", f"0x{stored.motion:08X}"))
    if stored.ratio != 1:
        facts.append(("rad of the units", f"of {stored.ratio} theta_m"))
    for c, values in enumerate(np.asarray(stored.values, dtype=np.float64)):
        what, unit, _ = stored.unit(c)
        if stored.units[c] == ORDER_CODE:
            facts.append((what, ", ".join(f"{value:g}" for value in values)))
            continue
        rms, peak = math.sqrt(float(np.mean(values**2))), float(np.max(np.abs(values)))
        figures = f"rms {rms:.4g}, peak {peak:.4g}, limit {stored.limits[c]:.4g}"
        facts.append((what, f"{figures} {unit}".rstrip()))
    return facts


def _period(stored: StoredMap) -> str:
    if stored.turns == 0:
        return "a trial"
    revolutions = Fraction(stored.turns, stored.parts)
    if revolutions == 1:
        return "a mechanical revolution"
    unit = "mechanical revolutions" if revolutions > 1 else "of a mechanical revolution"
    return f"{revolutions} {unit}, {360 * float(revolutions):.6g} deg"


def to_csv(stored: StoredMap) -> str:
    """The map as CSV: a heading, then a row per entry with its place and the value of each channel.

    The place is a mechanical angle, or the number of a sample or order.
    """
    angle = stored.angle
    first = "theta_m_rad" if angle is not None else "n" if stored.turns else "sample"
    text = [",".join([first, *(stored.unit(c)[2] for c in range(stored.channels))])]
    for n in range(stored.cells):
        place = str(n) if angle is None else f"{angle[n]:.9g}"
        text.append(",".join([place, *(f"{value:.9g}" for value in stored.values[:, n])]))
    return "\n".join(text) + "\n"


def identity(text: str) -> int:
    """Parse a motor's identity on the command line: hexadecimal after 0x, otherwise decimal."""
    try:
        number = int(text, HEX_BASE if text.lower().startswith("0x") else 10)
    except ValueError:
        number = -1
    if not 0 <= number < 2**32:
        raise StudyError(f'--motor: "{text}": expected 32 bits, such as 0x1F2E3D4C')
    return number
