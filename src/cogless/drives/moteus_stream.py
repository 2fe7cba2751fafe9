"""moteus's high-rate stream: records of a mark and one int16 for each set bit of `servo.emit_debug`.

Read in utils/highrate_defs.py. The file does not have this mask. It is in the dump, if the drive stored it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cogless.drives.moteus_dump import Dump
from cogless.errors import StudyError
from cogless.files import no_device
from cogless.identify.log_files import readable, require_bytes
from cogless.results.trace import Array

STREAM_SUFFIX = ".bin"
RECORD_MARK = 0x5A
INT16_MOST = 32767
MASK_BITS = 32
STREAM_RATE = 5000.0  # Hz, rate of rows after averaging
VELOCITY_BIT, D_BIT, Q_BIT, RAW_BIT = 1, 2, 3, 11
RAW_COUNTS = 1 << 16  # counts after which a raw count wraps
SYNC_RECORDS = 8  # marks in a row that make sure that a record begins there


def read_stream(path: Path, dump: Dump) -> tuple[dict[str, Array], Array | None]:
    """Columns as in servo_stats, with the time from the start, and the angle of the table's index, counts.

    The index is None if the encoder's own offset, sign or compensation makes it differ from raw counts.
    StudyError: the dump's mask lacks a value, or the file has no such records.
    """
    mask = int(dump.number("servo.emit_debug", "the bits with which the stream was recorded"))
    bits = [bit for bit in range(MASK_BITS) if mask >> bit & 1]
    raw_bit = RAW_BIT + dump.source
    if not {Q_BIT, raw_bit} <= set(bits):
        needed = 1 << Q_BIT | 1 << raw_bit | 1 << VELOCITY_BIT
        raise StudyError(
            f"{dump.path}: servo.emit_debug: {mask}: expected q_A and sources.{dump.source}.raw in the "
            f"stream, such as {needed}"
        )
    values = _records(path, len(bits))
    rate = dump.above_zero("servo.pwm_rate_hz", "a rate above zero")
    prefix = f"motor_position.sources.{dump.source}"
    counts = dump.above_zero(f"{prefix}.cpr", "counts of a turn")
    raw = values[:, bits.index(raw_bit)] % RAW_COUNTS
    angle = np.unwrap(raw, period=min(counts, RAW_COUNTS))
    sign = dump.number("motor_position.output.sign", "1 or -1", 1.0)
    encoder_sign = dump.number(f"{prefix}.sign", "1 or -1", 1.0)
    columns = {
        "timestamp": np.arange(len(raw)) / rate,
        "position": sign * encoder_sign * dump.ratio / counts * angle,
    }
    for name, bit in (("velocity", VELOCITY_BIT), ("d_A", D_BIT), ("q_A", Q_BIT)):
        if bit in bits:
            columns[name] = 100.0 / INT16_MOST * values[:, bits.index(bit)]
    together = max(1, round(rate / STREAM_RATE))
    direct = (
        encoder_sign == 1
        and dump.number(f"{prefix}.offset", "counts", 0.0) == 0
        and not dump.encoder_table_on
    )
    index = _averaged(angle, together) % counts if direct else None
    return {name: _averaged(column, together) for name, column in columns.items()}, index


def _averaged(column: Array, together: int) -> Array:
    """Means of `together` rows each."""
    rows = len(column) // together * together
    return np.asarray(column[:rows].reshape(-1, together).mean(axis=1))


def _records(path: Path, count: int) -> Array:
    """The numbers of the longest stretch of whole records, a row a record. StudyError: there is none."""
    with readable(path, "stream"):
        no_device(path)
        raw = path.read_bytes()
    require_bytes(path, len(raw))
    data, size = np.frombuffer(raw, np.uint8), 1 + 2 * count
    best, place = (0, 0), 0
    while place + SYNC_RECORDS * size <= len(data):
        marks = data[place::size] == RECORD_MARK
        length = len(marks) if marks.all() else int(np.argmin(marks))
        length = min(length, (len(data) - place) // size)
        if length < SYNC_RECORDS:
            place += 1
            continue
        best = max(best, (length, place))
        place += length * size
    length, place = best
    if not length:
        raise StudyError(
            f"{path}: no records of {size} bytes, as servo.emit_debug in the --drive-config file makes them: "
            "expected a stream recorded with this value"
        )
    rows = data[place : place + length * size].reshape(length, size)[:, 1:]
    return np.asarray(np.ascontiguousarray(rows).view("<i2").reshape(length, count), dtype=np.float64)
