"""Prusa's phase stepping: runs at a constant speed by M974, corrections by M973, or M971 in newer firmware.

Read in its source (prusa3d/Prusa-Firmware-Buddy 0632020 and 166209e; lut.cpp at 12d6ccb): the correction
adds sum mag sin(n u + pha) to the angle, held as int8 of 1/4096 turn, which wraps at 0.195 rad. M974 prints
samples of the cruise alone, whose start is not known. Each run is preceded by a line that M118 prints.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cogless.drives.adapter import Adapter, Certainty, CorrectionText, Feature, text_of
from cogless.errors import StudyError
from cogless.printer.axis import Axis
from cogless.printer.corrections import Correction, Lines
from cogless.printer.magnitudes import SpeedRun, check_speed, heard_orders, identify_magnitudes
from cogless.printer.records import (
    CORRECTED_ORDERS,
    DIRECTIONS,
    Direction,
    Numbers,
    Orders,
    Run,
    check_saturation,
    phase_shift,
    probe,
)

TABLE_POINTS = 1024
PHASE_STEPS = 4096  # steps in a turn
PHASE_STEP_MOST = 127
PHASE_MOST = math.tau * PHASE_STEP_MOST / PHASE_STEPS  # rad; a larger shift wraps
TABLE_ORDERS = 17
PROBE_TURNS = 3  # runs with the probe, each time turned by a third
MOVE_MARGIN = 0.2  # revolutions and s that M974 adds before its samples
RUN_SAMPLES_LEAST = 200
PRUSA_LOG = "the printer's output while it executes the file that --plan wrote"
RUN_MARK = re.compile(r"cogless-run (x|y) (forward|backward) ([0-9.]+) mm/s((?: \d+:[0-9.]+:-?[0-9.]+)*)\s*$")
SAMPLE = re.compile(r"^(?:Recv: )?(\d+), (\S+), (\S+), (\S+)$")
RATE_LINE = re.compile(r"sample freq: (\S+)")


def run_corrections() -> list[dict[int, complex]]:
    """The corrections of the runs at a speed: none, then the probe, turned by a third of a turn each."""
    turned = [
        {n: c * np.exp(1j * math.tau * k / PROBE_TURNS) for n, c in probe().items()}
        for k in range(PROBE_TURNS)
    ]
    return [{}, *turned]


def _table_pairs(correction: Orders) -> str:
    """Magnitude and phase of each order of M973, from order 0."""
    pairs = [
        (abs(c), float(np.angle(c)))
        for c in (correction.get(n, 0j) for n in range(max(correction, default=0) + 1))
    ]
    return " ".join(f"{magnitude:.6f},{phase:.6f}" for magnitude, phase in pairs)


def write_runs(axis: Axis) -> Mapping[str, str]:
    """The G-code that makes the runs of an axis. StudyError: a speed on a resonance, or too little way."""
    letter = axis.motor.upper()
    turn = axis.pulley_teeth * axis.belt_pitch * axis.path_share
    lines = [
        "; Home, move to the middle of the bed, and save all that the printer prints on its serial port.",
        f"M970 {letter}",
    ]
    for speed in axis.speeds:
        check_speed(axis, speed, axis.resonances, "printer.speeds")
        rate = speed / turn
        way = axis.travel / turn - MOVE_MARGIN * (1 + rate)
        if way < 1:
            raise StudyError(
                f"printer.travel: {1e3 * axis.travel:.4g} mm: expected "
                f"{1e3 * turn * (1 + MOVE_MARGIN * (1 + rate)):.0f} mm or more at {1e3 * speed:.4g} mm/s"
            )
        for correction in run_corrections():
            for direction in DIRECTIONS:
                marks = "".join(f" {n}:{abs(c):.6f}:{np.angle(c):.6f}" for n, c in correction.items())
                sign = "" if direction == "forward" else "-"
                lines += [
                    f"M973 {letter}F{_table_pairs(correction)}",
                    f"M973 {letter}B{_table_pairs(correction)}",
                    f"M118 cogless-run {axis.motor} {direction} {1e3 * speed:.4f} mm/s{marks}",
                    f"M974 {letter} F{rate:.6f} R{sign}{way:.4f}",
                ]
    lines += [f"M973 {letter}F0,0", f"M973 {letter}B0,0"]
    return {"cogless_runs.gcode": "\n".join(lines) + "\n"}


def read_runs(paths: Sequence[Path], axis: Axis) -> dict[Direction, list[SpeedRun]]:
    """All runs by direction. StudyError: a log without a run, or with one that can't be used."""
    runs: dict[Direction, list[SpeedRun]] = {name: [] for name in DIRECTIONS}
    for path in paths:
        before = sum(map(len, runs.values()))
        mark: re.Match[str] | None = None
        samples: list[tuple[float, float]] = []
        for line in text_of(path, PRUSA_LOG).splitlines():
            text = line.strip()
            if match := RUN_MARK.search(text):
                mark, samples = match, []
            elif match := SAMPLE.match(text):
                try:
                    values = float(match[2]), float(match[3])
                except ValueError:
                    continue
                samples.append(values)
            elif (match := RATE_LINE.search(text)) and mark is not None:
                direction: Direction = "forward" if mark[2] == "forward" else "backward"
                runs[direction].append(_run(path, axis, mark, samples, match[1]))
                mark = None
        if sum(map(len, runs.values())) == before:
            raise StudyError(
                f'{path}: no whole run, from its line "cogless-run" to its line "sample freq": expected '
                f"{PRUSA_LOG}"
            )
    return runs


def _run(
    path: Path, axis: Axis, mark: re.Match[str], samples: Sequence[tuple[float, float]], rate_text: str
) -> SpeedRun:
    where = f"{path}: run {mark[2]} at {mark[3]} mm/s"
    if mark[1] != axis.motor:
        raise StudyError(f"{where}: of motor {mark[1]}: expected motor {axis.motor}")
    try:
        rate = float(rate_text)
    except ValueError:
        rate = math.nan
    if not 100 < rate < 1e5:
        raise StudyError(
            f"{where}: sample freq: {rate_text}: expected the accelerometer's rate in Hz, above 100 and "
            "below 100000"
        )
    if len(samples) < RUN_SAMPLES_LEAST:
        raise StudyError(
            f"{where}: {len(samples)} samples: expected {RUN_SAMPLES_LEAST} or more, from a longer travel"
        )
    table = np.array(samples)
    for k, name in enumerate("xy"):
        check_saturation(f"{where}: {name}", table[:, k])
    speed = 1e-3 * float(mark[3])
    lacking = set(CORRECTED_ORDERS) - set(heard_orders(speed, rate, axis.wavelength))
    if lacking:
        raise StudyError(
            f"{where}: order {min(lacking)} has {min(lacking) * speed / axis.wavelength:.0f} Hz, too much "
            f"for {rate:.0f} samples a second: expected a lower speed"
        )
    correction: dict[int, complex] = {}
    for word in mark[4].split():
        order, magnitude, phase = word.split(":")
        correction[int(order)] = complex(float(magnitude) * np.exp(1j * float(phase)))
    acceleration: Numbers = axis.direction[0] * table[:, 0] + axis.direction[1] * table[:, 1]
    times = np.arange(len(table)) / rate
    run = Run(path.name, "forward" if mark[2] == "forward" else "backward", times, acceleration, correction)
    return SpeedRun(run, speed)


def identify_runs(paths: Sequence[Path], axis: Axis) -> Correction:
    """The correction of runs in both directions. StudyError: runs are missing or can't be used."""
    runs = read_runs(paths, axis)
    lines: dict[Direction, Lines] = {}
    for direction, records in runs.items():
        if not records:
            raise StudyError(
                f"{paths[0]}: no {direction} run: expected runs in both directions, since friction makes "
                "the corrections of the two directions differ"
            )
        for record in records:
            check_speed(axis, record.speed, axis.resonances, str(paths[0]))
        lines[direction] = identify_magnitudes(axis, records, f"{paths[0]}: {direction}")
    return Correction.from_lines(axis, lines)


def held_phase(correction: Orders) -> Numbers:
    """The shift that the firmware's table holds, rad, at even angles of an electrical turn.

    C cuts to whole steps, towards zero, and keeps eight bits, so a shift above PHASE_MOST changes sign.
    """
    u = math.tau / TABLE_POINTS * np.arange(TABLE_POINTS)
    steps = np.trunc(PHASE_STEPS / math.tau * phase_shift(correction, u)).astype(np.int64)
    wrapped = (steps + PHASE_STEP_MOST + 1) % (2 * (PHASE_STEP_MOST + 1)) - PHASE_STEP_MOST - 1
    return np.asarray(math.tau / PHASE_STEPS * wrapped)


def _checked_share(correction: Correction) -> tuple[float, float]:
    """Share that the table leaves; largest shift, rad. StudyError: a shift wraps, or an order is too high."""
    u = math.tau / TABLE_POINTS * np.arange(TABLE_POINTS)
    before = after = largest = 0.0
    for direction in DIRECTIONS:
        orders = correction.orders(direction)
        if max(orders) >= TABLE_ORDERS:
            raise StudyError(
                f"order {max(orders)}: expected orders below {TABLE_ORDERS}, as the firmware's table has"
            )
        shift = phase_shift(orders, u)
        most = float(np.max(np.abs(shift)))
        if most > PHASE_MOST:
            raise StudyError(
                f"the {direction} correction reaches {most:.3f} rad: expected {PHASE_MOST:.3f} or less, "
                "where the firmware's table wraps; look for a wrong step angle or a bad motor"
            )
        largest = max(largest, most)
        before += float(np.mean(shift**2))
        after += float(np.mean((shift - held_phase(orders)) ** 2))
    return math.sqrt(after / before) if before else 0.0, largest


def _holds(share: float, largest: float) -> list[str]:
    return [
        "The table can hold every order in each direction. Because of its steps of "
        f"1/{PHASE_STEPS} turn, it differs from the correction by {share:.1%} (rms).",
        f"The largest shift is {largest:.3f} rad. The firmware's table wraps at {PHASE_MOST:.3f} rad.",
    ]


def write_m973(correction: Correction) -> CorrectionText:
    """M973 lines, one a direction."""
    share, largest = _checked_share(correction)
    letter = correction.motor.upper()
    lines = [f"M973 {letter}{name[0].upper()}{_table_pairs(correction.orders(name))}" for name in DIRECTIONS]
    return CorrectionText(
        "\n".join(lines) + "\n",
        share,
        _holds(share, largest),
        install="send FILE to the printer after each start; its M973 sets a table and stores nothing",
        remove=f"send M973 {letter}F0,0 and M973 {letter}B0,0",
    )


def write_m971(correction: Correction) -> CorrectionText:
    """M971 lines of newer firmware, one an order and direction, with phase stepping off meanwhile."""
    share, largest = _checked_share(correction)
    letter = correction.motor.upper()
    lines = [f"M970 {letter}0", f"M971 {letter} F B R"]
    for name in DIRECTIONS:
        lines += [
            f"M971 {letter} {name[0].upper()} I{n} M{abs(c):.6f} P{np.angle(c):.6f}"
            for n, c in sorted(correction.orders(name).items())
        ]
    return CorrectionText(
        "\n".join([*lines, f"M970 {letter}1"]) + "\n",
        share,
        _holds(share, largest),
        install="first send M971 alone, and save the printer's answer, which is its present table; then send "
        "FILE once: the printer stores the new table",
        remove=f"send M970 {letter}0 (phase stepping off), M971 {letter} F B R (reset both tables), M970 "
        f"{letter}1 (phase stepping on); or run the printer's own calibration",
    )


PRUSA = Adapter(
    name="prusa",
    title="Prusa, firmware whose M973 sets corrections",
    reads=(
        Feature("what the printer sends during runs with M974, to correct a step motor", Certainty.SOURCE),
    ),
    writes=(Feature("M973 lines, one table for each direction", Certainty.SOURCE),),
    identify_runs=identify_runs,
    write_runs=write_runs,
    write_correction=write_m973,
)
PRUSA_M971 = Adapter(
    name="prusa-m971",
    title="Prusa, firmware whose M971 stores corrections",
    reads=(),
    writes=(Feature("M971 lines, one table for each direction", Certainty.SOURCE),),
    write_correction=write_m971,
)
