"""The curves in a page's still pictures."""

from __future__ import annotations

import re

import numpy as np


def curves(page: str) -> list[tuple[str, np.ndarray]]:
    """Colour and points, px, of each curve, with every point of its path."""
    found = re.findall(r'<path d="([^"]+)" fill="none" stroke="var\(--(c\d)\)"', page)
    pairs = [(colour, re.findall(r"[ML]([\d.]+) ([\d.]+)", path)) for path, colour in found]
    return [(colour, np.array(points, dtype=float)) for colour, points in pairs]
