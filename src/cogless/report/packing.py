"""Numbers for the page: waveforms are thinned without losing their peaks, and packed as 16-bit integers."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def thin(x: Array, points: int) -> tuple[Array, float]:
    """Thin x to at most `points` values that keep its peaks; also how many rows of x each stands for.

    Each bucket of rows gives its smallest and largest value, in their order in time, so the result is evenly
    spaced. A bucket of NaN only gives NaN.
    """
    size = bucket(len(x), points)
    return (peaks(x, size), size / 2) if size else (x, 1.0)


def bucket(count: int, points: int) -> int:
    """Rows in a bucket, to thin `count` rows to at most `points` values; 0 if they are that few already."""
    return -(-count // (points // 2)) if count > points else 0


def peaks(x: Array, size: int) -> Array:
    """Smallest and largest value of each `size` rows of x, in their order in time."""
    x = np.concatenate((x, np.full(-len(x) % size, x[-1])))
    parts = x.reshape(-1, size)
    rows = np.arange(len(parts))
    gaps = np.isnan(parts)
    low, high = np.where(gaps, np.inf, parts).argmin(axis=1), np.where(gaps, -np.inf, parts).argmax(axis=1)
    pairs = np.column_stack((parts[rows, np.minimum(low, high)], parts[rows, np.maximum(low, high)]))
    return pairs.ravel()


def pack(x: Array) -> dict[str, Any]:
    """x as 16-bit integers in base64: x = offset + scale * integer; the lowest integer means not finite.

    Half the size of single precision, and finer than a screen can show: 1/65534 of the range.
    """
    finite = np.isfinite(x)
    low, high = (float(x[finite].min()), float(x[finite].max())) if finite.any() else (0.0, 0.0)
    scale = (high - low) / 65534 or 1.0
    offset = (high + low) / 2
    integers = np.where(finite, np.rint((np.where(finite, x, offset) - offset) / scale), -32768)
    return {
        "offset": offset,
        "scale": scale,
        "data": base64.b64encode(integers.astype("<i2").tobytes()).decode(),
    }


def unpack(packed: dict[str, Any]) -> Array:
    """The values of a packed array; NaN where they weren't finite."""
    integers = np.frombuffer(base64.b64decode(packed["data"]), dtype="<i2").astype(float)
    return np.asarray(packed["offset"] + packed["scale"] * np.where(integers == -32768, np.nan, integers))


def rms(x: Array) -> Array:
    """Root of the mean square along the last axis; infinite if a square overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(np.mean(np.square(x), axis=-1)))


def plain(values: Array) -> list[float | None]:
    """Values for JSON, to five digits; null if not finite. For short arrays: `pack` is smaller."""
    return [float(f"{v:.5g}") if math.isfinite(v) else None for v in values.tolist()]


def number(value: float) -> str:
    """The value to three significant digits, without an exponent if 1e-4 <= |value| < 1e6."""
    if value == 0 or not 1e-4 <= abs(value) < 1e6:
        return f"{value:.3g}"
    digits = max(0, 2 - math.floor(math.log10(abs(value)) + 1e-9))
    return f"{value:.{digits}f}"
