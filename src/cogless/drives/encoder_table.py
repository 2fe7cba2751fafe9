"""Tables that correct an encoder's own error, as identify found it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cogless.c_literals import array
from cogless.drives.adapter import TableFrame, TableText
from cogless.drives.holding_current import AngleWaves, Waves, cancelling_waves, samples
from cogless.errors import StudyError
from cogless.results.trace import Array

MOTEUS_POINTS, MOTEUS_STEPS = 256, 127
WAVE_ENTRIES, SIMPLEFOC_ENTRIES_LEAST = 8, 128  # entries in a wave of the highest order; in a table
VESC_CELLS, VESC_DEGREES_MOST = 360, 120  # cells in a revolution; deg electrical
SIGN_CHECK = (
    "identify again from new logs: the encoder's orders are gone; with the wrong sign they are twice as large"
)
MOVED_NOTE = (
    "This correction shifts the angle over which the drive reads its cogging table: afterwards record new "
    "logs and write a new cogging table."
)
SIMPLEFOC_TEXT = """\
// Encoder correction for SimpleFOC, by cogless. CalibratedSensor of its drivers subtracts it:
//     CalibratedSensor calibrated(sensor, ENCODER_ENTRIES, encoder_table);
//     motor.linkSensor(&calibrated);
// after sensor.init() and without calibrate(), which would write its own over it.
#define ENCODER_ENTRIES {count}

/* rad; entry i is at i / ENCODER_ENTRIES of a revolution of the sensor, straight lines between. */
static float encoder_table[ENCODER_ENTRIES] = {{
{entries}
}};
"""


@dataclass(frozen=True, eq=False)
class AngleCorrection(AngleWaves):
    """What is added to a measured angle, rad, over that angle: sum Re(waves[n] exp(j n angle))."""

    waves: Waves
    source: str


def correction_from(folder: Path) -> AngleCorrection:
    """The correction that cancels the encoder's error in identify's results. StudyError: they have none."""
    waves, _ = cancelling_waves(
        folder,
        "encoder",
        amplitude="amplitude_rad",
        expected="expected logs that show the encoder's error",
    )
    return AngleCorrection(waves, str(folder))


def write_moteus(correction: AngleWaves, frame: TableFrame) -> TableText:
    """Lines for `moteus_tool --restore-config`. moteus adds the table to the angle.

    Entry i is at i / 256 of a turn, straight lines between. The result's `applied` gives rad at an angle in
    rad. StudyError: a table was on in the logs.
    """
    if frame.encoder_table_on:
        raise StudyError(
            f"{correction.source}: the logs were recorded with an encoder table: expected logs without this "
            "table (compensation_scale 0), since the new table replaces it"
        )
    values = samples(correction.turned(frame.direction), MOTEUS_POINTS, 1, "linear") / math.tau
    scale = float(np.float32(np.max(np.abs(values))))
    entries = [round(x) for x in np.clip(MOTEUS_STEPS * values / scale, -MOTEUS_STEPS, MOTEUS_STEPS)]
    prefix = f"motor_position.sources.{frame.encoder}"
    closed = math.tau * scale / MOTEUS_STEPS * np.array([*entries, entries[0]])

    def applied(angle: Array) -> Array:
        place = np.mod(frame.direction * angle / math.tau, 1.0) * MOTEUS_POINTS
        return np.asarray(frame.direction * np.interp(place, np.arange(MOTEUS_POINTS + 1), closed))

    lines = [
        "# Encoder table of moteus, by cogless. Install: moteus_tool -t 1 --restore-config THIS_FILE",
        f"{prefix}.compensation_scale {scale:.9g}",
        *(f"{prefix}.compensation_table.{n} {entry}" for n, entry in enumerate(entries)),
    ]
    return TableText(
        "\n".join(lines) + "\n",
        MOTEUS_POINTS,
        f"each a whole number from -127 to 127, in steps of {360 * scale / MOTEUS_STEPS:.3g} deg",
        applied,
        install="moteus_tool -t 1 --restore-config FILE",
        remove=f'in tview: "conf set {prefix}.compensation_scale 0", then "conf write"',
        sign_check=SIGN_CHECK,
        notes=(
            "This correction shifts the angle over which moteus reads its cogging table: calibrate, record "
            "new logs and write a new cogging table.",
        ),
    )


def _own_angle(correction: AngleWaves, frame: TableFrame) -> AngleWaves:
    """The correction over the encoder's own angle. StudyError: the frame does not give this angle."""
    if not frame.encoder_direction:
        lacking = frame.encoder_lacking or "expected new results of identify --drive"
        raise StudyError(f"{correction.source}: the encoder's own angle is not known: {lacking}")
    return correction.turned(frame.encoder_direction, frame.encoder_shift)


def _own_turns(angle: Array, frame: TableFrame) -> Array:
    """The encoder's own angle within a revolution, in revolutions, at identified angles, rad."""
    return np.asarray(np.mod((frame.encoder_direction * angle + frame.encoder_shift) / math.tau, 1.0))


def write_simplefoc(correction: AngleWaves, frame: TableFrame) -> TableText:
    """A table for CalibratedSensor, which subtracts it. `applied` gives rad at an angle in rad."""
    entries_least = WAVE_ENTRIES * max(correction.orders)
    count = max(SIMPLEFOC_ENTRIES_LEAST, 1 << (entries_least - 1).bit_length())
    values = -samples(_own_angle(correction, frame), count, 1, "linear")
    entries = np.asarray(values, dtype=np.float32)
    closed = np.append(entries, entries[0]).astype(np.float64)

    def applied(angle: Array) -> Array:
        place = _own_turns(angle, frame) * count
        return np.asarray(-frame.encoder_direction * np.interp(place, np.arange(count + 1), closed))

    return TableText(
        SIMPLEFOC_TEXT.format(count=count, entries=array(entries, "f")),
        count,
        "each a float in rad",
        applied,
        install="copy FILE into the sketch, #include it, and wrap the sensor as its first lines say",
        remove="link the sensor itself: motor.linkSensor(&sensor)",
        sign_check=SIGN_CHECK,
        notes=(
            "The sketch needs CalibratedSensor(sensor, count, table), which commit 011c612 of SimpleFOC's "
            "drivers has. A release whose CalibratedSensor takes only the sensor can't use the table.",
            MOVED_NOTE,
        ),
    )


def write_vesc(correction: AngleWaves, frame: TableFrame) -> TableText:
    """Lines in Lisp: for each degree of the encoder, whole electrical degrees that VESC takes off the phase.

    `applied` gives rad at an angle in rad. StudyError: a correction beyond 120 deg, or nothing but zeros.
    """
    own = _own_angle(correction, frame)
    values = -np.degrees(frame.pole_pairs * samples(own, VESC_CELLS, 1, "step"))
    entries = np.round(values)
    most = float(np.max(np.abs(values)))
    if most > VESC_DEGREES_MOST or not np.any(entries):
        raise StudyError(
            f"{correction.source}: the encoder's error is up to {most:.2g} deg electrical: expected 0.5 to "
            f"{VESC_DEGREES_MOST} deg, since VESC holds whole degrees"
        )

    def applied(angle: Array) -> Array:
        cells = (_own_turns(angle, frame) * VESC_CELLS).astype(int) % VESC_CELLS
        return np.asarray(-frame.encoder_direction * np.radians(entries[cells]) / frame.pole_pairs)

    lines = [
        "; Encoder correction of VESC, by cogless. Run it in VESC Tool's LispBM page.",
        *(f"(enc-corr {degree} {entry:.0f})" for degree, entry in enumerate(entries)),
        "(enc-corr-en 1)",
    ]
    return TableText(
        "\n".join(lines) + "\n",
        VESC_CELLS,
        f"in steps of 1 deg electrical ({360 / VESC_CELLS / frame.pole_pairs:.3g} deg of the encoder)",
        applied,
        install="run FILE in VESC Tool's LispBM page; a shutdown or reboot by VESC Tool stores it",
        remove="run (enc-corr-en 0) in the LispBM page",
        sign_check="at a steady speed and load, the mean of q_axis_current falls when the table is switched "
        "on; with the wrong sign it grows. If the encoder's error is 8 deg electrical rms, it falls by about "
        "1 %, or grows by about 3 %",
        notes=(
            "The correction acts only on the phase of the current: position and speed keep the encoder's "
            "error.",
        ),
    )
