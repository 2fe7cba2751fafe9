"""Correction tables of an encoder's own error, from what identify tells of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cogless.drives.adapter import TableFrame, TableText
from cogless.drives.holding_current import AngleWaves, Waves, cancelling_waves, samples
from cogless.errors import StudyError
from cogless.identify.files import Array

MOTEUS_POINTS, MOTEUS_STEPS = 256, 127


@dataclass(frozen=True, eq=False)
class AngleCorrection(AngleWaves):
    """What is added to a measured angle, rad, over that angle: sum Re(waves[n] exp(j n angle))."""

    waves: Waves
    source: str


def correction_from(folder: Path) -> AngleCorrection:
    """The correction of the identified encoder's error. StudyError: the folder has none."""
    waves, _ = cancelling_waves(
        folder,
        "encoder",
        amplitude="amplitude_rad",
        expected="expected logs that tell the encoder's error",
    )
    return AngleCorrection(waves, str(folder))


def write_moteus(correction: AngleWaves, frame: TableFrame) -> TableText:
    """Lines for `moteus_tool --restore-config`: entry i at i / 256, straight lines between, added.

    `applied` is in rad over rad. StudyError: a table was on in the logs.
    """
    if frame.encoder_table_on:
        raise StudyError(
            f"{correction.source}: the logs were made with a table of the encoder: expected logs without it "
            "(compensation_scale 0), since the new one replaces it"
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
        f"{360 * scale / MOTEUS_STEPS:.3g} deg a step, -127 to 127",
        applied,
        install="moteus_tool -t 1 --restore-config FILE",
        remove=f'in tview: "conf set {prefix}.compensation_scale 0", then "conf write"',
        sign_check="identify again from new logs: the encoder's orders are gone; with the wrong sign they "
        "are twice as large",
        notes=(
            "It moves the index of the cogging table: calibrate, then make new logs and a new cogging table.",
        ),
    )
