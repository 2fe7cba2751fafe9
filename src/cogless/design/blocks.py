"""What `cogless design` prints: a block for each controller, with its answer first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cogless.design.margins import Margins


@dataclass(frozen=True)
class Block:
    """A heading, and rows: a word, and the text that belongs to this word."""

    heading: str
    rows: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Blocks:
    """A study's title, its blocks, and notes below them, one sentence each."""

    title: str
    blocks: Sequence[Block]
    notes: Sequence[str]


def margin_words(margins: Margins | None) -> str:
    """Phase and gain margin with the frequencies where they are taken."""
    if margins is None:
        return "not known: the law is the study's own code"
    if not margins.stable:
        return "unstable"
    gain = f"gain {margins.gain_margin:.2f} at {_hertz(margins.phase_crossover)}"
    gain = "no limit of gain" if math.isnan(margins.gain_margin) else gain
    if math.isnan(margins.crossover):
        return gain
    return f"phase {math.degrees(margins.phase_margin):.0f} deg at {_hertz(margins.crossover)}, {gain}"


def _hertz(omega: float) -> str:
    return f"{omega / math.tau:.4g} Hz"
