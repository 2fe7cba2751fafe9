"""Show stored maps to a person: as lines of text, and as a table of their entries."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from cogless.errors import StudyError
from cogless.maps.stored_map import ORDER, Found, StoredMap, Valid

HEX = 16


def lines(found: list[Found], newest: Valid) -> list[str]:
    """Lines about every map that was found; the newest one in detail."""
    text = []
    for place in found:
        where = f"At byte {place.offset}: " if len(found) > 1 else ""
        if not isinstance(place.map, StoredMap):
            text.append(f"{where}{place.map}")
        elif place.offset == newest.offset:
            text.append(f"{where}a valid map{', the newest' if len(found) > 1 else ''}")
            text += [f"  {name:<26}{value}" for name, value in rows(place.map)]
        else:
            text.append(f"{where}a valid map, save {place.map.sequence}")
    return text


def rows(stored: StoredMap) -> list[tuple[str, str]]:
    """Name and value of the map's header fields, then a row for each channel."""
    facts = [
        ("learned by", stored.law_name),
        ("motor", f"0x{stored.motor:08X}"),
        ("save", str(stored.sequence)),
        ("period", _period(stored)),
        ("orders" if ORDER in stored.units else "cells" if stored.turns else "samples", str(stored.cells)),
    ]
    if stored.motion:
        facts.insert(2, ("motion", f"0x{stored.motion:08X}"))
    if stored.ratio != 1:
        facts.append(("rad of the units", f"of {stored.ratio} theta_m"))
    for c, values in enumerate(np.asarray(stored.values, dtype=np.float64)):
        what, unit, _ = stored.unit(c)
        if stored.units[c] == ORDER:
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
    return f"{revolutions} of a mechanical revolution, {360 * float(revolutions):.6g} deg"


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
        number = int(text, HEX if text.lower().startswith("0x") else 10)
    except ValueError:
        number = -1
    if not 0 <= number < 2**32:
        raise StudyError(f'--motor: "{text}": expected 32 bits, such as 0x1F2E3D4C')
    return number
