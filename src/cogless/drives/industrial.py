"""Kollmorgen's AKD and Beckhoff's AX8000: cogging tables by their manuals, which leave signs and zeros open.

So each table comes with a test on the drive, which settles what the manual does not say.
"""

from __future__ import annotations

import math

import numpy as np

from cogless.drives.adapter import Adapter, Certainty, Feature, TableFrame, TableText
from cogless.drives.holding_current import HoldingCurrent, samples
from cogless.errors import StudyError
from cogless.results.trace import Array

AKD_ENTRIES = 8192
AX8000_WAVES, AX8000_ORDER_MOST = 10, 200
AX8000_OBJECT, AX8000_FIRST, AX8000_STEP = 0x32CB, 7, 3  # sub-indices of an order: its number, phase, torque


def write_akd(current: HoldingCurrent, frame: TableFrame) -> TableText:
    """8,192 currents over a revolution, one a line."""
    values = np.array([float(f"{x:.5g}") for x in samples(current, AKD_ENTRIES, frame.direction, "linear")])
    closed = np.append(values, values[0])

    def applied(angle: Array) -> Array:
        place = np.mod(frame.direction * angle / math.tau, 1.0) * AKD_ENTRIES
        return np.asarray(np.interp(place, np.arange(AKD_ENTRIES + 1), closed))

    return TableText(
        "".join(f"{value:.5g}\n" for value in values),
        AKD_ENTRIES,
        "one a line, each a current in peak A",
        applied,
        install="disable the drive, import FILE in WorkBench's cogging compensation, then send COGCOMP.EN 1",
        remove="send COGCOMP.EN 0",
        sign_check="import 30 % of the table, then -30 %, each at a slow speed: the ripple falls with the "
        "first and grows with the second",
        notes=(
            "The manual says neither the sign, nor whether a current is peak or rms, nor the file's layout. "
            "First export the drive's own table, then give this table the same layout. Try 71 % of the table "
            "(1/sqrt(2)), too: if it leaves less ripple, the drive's currents are rms, so keep 71 %.",
        ),
    )


def write_ax8000(current: HoldingCurrent, frame: TableFrame) -> TableText:
    """The ten largest orders, as object 0x32CB takes them."""
    if not current.K_t:
        raise StudyError(
            f"{current.source}: no K_t: AX8000 takes torques: expected a folder of cogless identify, with K_t"
        )
    waves = np.array(current.waves if frame.direction > 0 else np.conj(current.waves))
    able = [order for order in current.orders if order <= AX8000_ORDER_MOST]
    chosen = sorted(sorted(able, key=lambda order: -abs(waves[order]))[:AX8000_WAVES])
    if not chosen:
        raise StudyError(
            f"{current.source}: all orders are above {AX8000_ORDER_MOST}, the highest of AX8000: "
            "expected a lower order"
        )
    torques = {order: float(np.float32(current.K_t * abs(waves[order]))) for order in chosen}
    phases = {order: float(np.float32(np.degrees(np.angle(waves[order])) % 360)) for order in chosen}
    lines = [f"# Object 0x{AX8000_OBJECT:X}: sub-index, type, value", ":01 - 3", ":02 - 1.0"]
    for number, order in enumerate(chosen):
        first = AX8000_FIRST + AX8000_STEP * number
        lines += [
            f":{first:02d} UINT32 {order}",
            f":{first + 1:02d} REAL32 {phases[order]:.7g}",
            f":{first + 2:02d} REAL32 {torques[order]:.7g}",
        ]

    def applied(angle: Array) -> Array:
        index = frame.direction * angle
        parts = (
            torques[order] / current.K_t * np.cos(order * index + math.radians(phases[order]))
            for order in chosen
        )
        return np.asarray(sum(parts))

    return TableText(
        "\n".join(lines) + "\n",
        len(chosen),
        "each an order with its phase in degrees and torque in N*m",
        applied,
        install=f"put the lines of FILE into the startup list of object 0x{AX8000_OBJECT:X}",
        remove=f"set 0x{AX8000_OBJECT:X}:01 to 4",
        sign_check="one order at a time, at a slow speed: set the table's gain :02 to 0.3, then add 0, 90, "
        "180 and 270 deg to the order's phase; the phase that leaves the least ripple of this order is right",
        notes=(
            "The manual does not say whether the drive adds sines or cosines, with which sign, or where its "
            "angle is zero. The file has cosines with the sign of the holding torque. If the drive's zero "
            "differs, each order's phase is wrong by another angle, so each order needs its own test.",
        ),
    )


AKD = Adapter(
    name="akd",
    title="Kollmorgen AKD",
    reads=(),
    writes=(Feature("cogging table: 8,192 currents", Certainty.DRIVE),),
    write=write_akd,
)
NOVANTA = Adapter(
    name="novanta",
    title="Novanta Summit",
    reads=(),
    writes=(),
    refusal="its table is over the electrical angle, so it holds only orders that are multiples of the pole "
    "pairs",
)
AX8000 = Adapter(
    name="ax8000",
    title="Beckhoff AX8000",
    reads=(),
    writes=(Feature("cogging compensation: ten orders for object 0x32CB", Certainty.DRIVE),),
    write=write_ax8000,
)
