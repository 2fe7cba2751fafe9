"""Trinamic's wave table: a quarter of a sine, by bits that choose between two slopes, in up to four segments.

By the TMC5160's datasheet and Klipper's configuration reference. Bit i says the step from entry i to i + 1;
where entry i + 1 lies in a segment of width control W, the step is W - 1, or W if the bit is set. Only
with this reading does the default table end at its own START_SIN90. Both coils take the same quarter, one of
them mirrored. So the table can shift the angle only by sin 4u, sin 8u and so on, in both directions alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from cogless.drives.adapter import Adapter, Certainty, CorrectionText, Feature
from cogless.printer.corrections import Correction
from cogless.printer.records import DIRECTIONS, Numbers

QUARTER_ENTRIES = 256  # and one at 90 deg, which START_SIN90 repeats
WORD_BITS = 32
SEGMENTS_MOST = 4
WIDTHS = (0, 1, 2, 3)
WAVE_ENTRY_MOST = 255
WAVE_AMPLITUDE = 247.0  # amplitude of the default table, too
TABLE_ORDER = 4  # lowest order that a quarter can hold


@dataclass(frozen=True)
class WaveTable:
    """Registers: MSLUT0 to 7, W0 to 3, X1 to 3, START_SIN and START_SIN90."""

    words: tuple[int, ...]
    widths: tuple[int, ...]
    borders: tuple[int, ...]
    start: int
    start_90: int

    def entries(self) -> Numbers:
        """The quarter wave that the driver makes of the registers, from 0 to 90 deg, both included."""
        values = [self.start]
        for i in range(QUARTER_ENTRIES):
            width = self.widths[sum(i + 1 >= border for border in self.borders)]
            bit = self.words[i // WORD_BITS] >> (i % WORD_BITS) & 1
            values.append(values[-1] + width - 1 + bit)
        return np.array(values, float)

    def phase(self) -> Numbers:
        """How far the currents' angle is ahead of each entry's angle, rad, over the quarter."""
        wave = self.entries()
        return np.asarray(np.arctan2(wave, wave[::-1]) - quarter_angles())

    def order_4(self) -> float:
        """The size of sin 4u in the phase, rad."""
        return float(2 * np.mean((self.phase() * np.sin(TABLE_ORDER * quarter_angles()))[1:]))

    def config_lines(self) -> list[str]:
        """The registers as lines of Klipper's configuration."""
        names = [*(f"MSLUT{k}" for k in range(8)), *(f"W{k}" for k in range(4)), "X1", "X2", "X3"]
        values = [*self.words, *self.widths, *self.borders, self.start, self.start_90]
        names += ["START_SIN", "START_SIN90"]
        return [f"driver_{name}: {value}" for name, value in zip(names, values, strict=True)]


DEFAULT_WAVE = WaveTable(
    words=(
        *(2863314260, 1251300522, 608774441, 269500962),
        *(4227858431, 3048961917, 1227445590, 4211234),
    ),
    widths=(2, 1, 1, 1),
    borders=(128, 255, 255),
    start=0,
    start_90=247,
)


def quarter_angles() -> Numbers:
    """The electrical angle of each entry, rad."""
    return np.asarray(math.tau / (4 * QUARTER_ENTRIES) * np.arange(QUARTER_ENTRIES + 1))


def encode(phase: Numbers) -> WaveTable:
    """The table nearest to a wave whose angle is ahead by `phase`, rad, over the quarter.

    Dynamic programming over entry, value, segment and width finds the least squares of the current's error.
    """
    target = WAVE_AMPLITUDE * np.sin(quarter_angles() + phase)
    values = np.arange(WAVE_ENTRY_MOST + 1)
    shape = (SEGMENTS_MOST, len(WIDTHS), WAVE_ENTRY_MOST + 1)
    cost = np.full(shape, np.inf)
    cost[0] = (values - target[0]) ** 2
    choices = np.empty((QUARTER_ENTRIES + 1, *shape, 3), np.int16)  # previous segment, width and value
    segments, widths = np.indices(shape[:2])
    for i in range(1, QUARTER_ENTRIES + 1):
        entered = np.full(shape, np.inf)
        source = np.empty((*shape, 2), np.int16)
        # A step lies in the segment of the entry at its end. This entry may be the first of the next segment.
        entered[:] = cost
        source[..., 0], source[..., 1] = segments[..., None], widths[..., None]
        if 1 < i <= WAVE_ENTRY_MOST:
            best = np.argmin(cost, axis=1)
            cheapest = np.min(cost, axis=1)
            for s in range(1, SEGMENTS_MOST):
                better = cheapest[s - 1][None, :] < entered[s]
                entered[s] = np.where(better, cheapest[s - 1][None, :], entered[s])
                source[s, ..., 0] = np.where(better, s - 1, source[s, ..., 0])
                source[s, ..., 1] = np.where(better, best[s - 1][None, :], source[s, ..., 1])
        cost = np.full(shape, np.inf)
        for w in WIDTHS:
            for step in (w - 1, w):
                first, last = max(0, step), WAVE_ENTRY_MOST + 1 + min(0, step)
                old = slice(first - step, last - step)
                new = slice(first, last)
                better = entered[:, w, old] < cost[:, w, new]
                cost[:, w, new] = np.where(better, entered[:, w, old], cost[:, w, new])
                for k in range(2):
                    part = choices[i, :, w, new, k]
                    part[better] = source[:, w, old, k][better]
                part = choices[i, :, w, new, 2]
                part[better] = np.broadcast_to(values[old], better.shape)[better]
        cost += (values - target[i]) ** 2
    return _registers(cost, choices)


def _registers(cost: Numbers, choices: np.ndarray[tuple[int, ...], np.dtype[np.int16]]) -> WaveTable:
    """The registers of the cheapest table: its choices are followed back from the last entry."""
    segment, width, value = (int(k) for k in np.unravel_index(int(np.argmin(cost)), cost.shape))
    entries, used = [value], []
    for i in range(QUARTER_ENTRIES, 0, -1):
        used.append((segment, width))
        segment, width, value = (int(k) for k in choices[i, segment, width, value])
        entries.append(value)
    entries.reverse()
    used.reverse()
    widths, borders = [used[0][1]], []
    for i in range(1, len(used)):
        if used[i][0] != used[i - 1][0]:
            widths.append(used[i][1])
            borders.append(i + 1)
    borders += [WAVE_ENTRY_MOST] * (SEGMENTS_MOST - 1 - len(borders))
    widths += [widths[-1]] * (SEGMENTS_MOST - len(widths))
    bits = [entries[i + 1] - entries[i] - used[i][1] + 1 for i in range(len(used))]
    words = [
        sum(bit << k for k, bit in enumerate(bits[word * WORD_BITS : (word + 1) * WORD_BITS]))
        for word in range(QUARTER_ENTRIES // WORD_BITS)
    ]
    return WaveTable(tuple(words), tuple(widths), tuple(borders), entries[0], entries[-1])


def with_order_4(size: float) -> WaveTable:
    """The default table with `size` times sin 4u, rad, added to its phase."""
    shift = (DEFAULT_WAVE.order_4() + size) * np.sin(TABLE_ORDER * quarter_angles())
    return encode(np.asarray(shift))


def write(correction: Correction, chip: str) -> CorrectionText:
    """Lines for Klipper: a table with the sine of order 4 alone, the mean of both directions."""
    orders = [correction.orders(name) for name in DIRECTIONS]
    size = float(np.mean([table.get(TABLE_ORDER, 0j).real for table in orders]))
    wave = with_order_4(size)
    size_held = wave.order_4() - DEFAULT_WAVE.order_4()
    before = sum(abs(c) ** 2 for table in orders for c in table.values())
    after = sum(
        abs(c - (size_held if n == TABLE_ORDER else 0)) ** 2 for table in orders for n, c in table.items()
    )
    share = math.sqrt(after / before) if before else 0.0
    others = sorted({n for table in orders for n in table} - {TABLE_ORDER})
    return CorrectionText(
        "\n".join(wave.config_lines()) + "\n",
        share,
        [
            f"The table lacks {share:.0%} of the correction (rms): it can hold only the sine of "
            f"order 4, {size_held:+.4f} rad here, the same in both directions.",
            f"A wave table can't hold orders {', '.join(map(str, others))} or the cosine of order 4.",
        ],
        install=f"put FILE's lines into [{chip} stepper_{correction.motor}] of printer.cfg, then RESTART",
        remove="delete these lines, then RESTART",
    )


def _chip(name: str) -> Adapter:
    writer: Callable[[Correction], CorrectionText] = partial(write, chip=name)
    return Adapter(
        name=name,
        title=f"{name.upper()} under Klipper",
        reads=(),
        writes=(
            Feature(
                "the wave table, as lines of printer.cfg: holds only the sine of order 4", Certainty.MANUAL
            ),
        ),
        write_correction=writer,
    )


TMC2130, TMC5160, TMC2240 = (_chip(name) for name in ("tmc2130", "tmc5160", "tmc2240"))
