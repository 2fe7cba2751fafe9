"""A script for moteus's own Python package that plays the motions of a plan, and logs what identify needs."""

from __future__ import annotations

from pathlib import Path

from cogless.drives.adapter import Motions
from cogless.drives.moteus_dump import read_dump
from cogless.drives.script_motions import motions_text

MOTEUS_SCRIPT = "record_moteus.py"

MOTEUS_TEXT = '''\
"""Play motions on a moteus and log them, by cogless. Needs: pip install moteus

    python {name}          prints what would happen; nothing moves
    python {name} --yes    moves the motor

The motor must be free to turn, without stops: the motions take many turns. Position limits must allow
that (servopos.position_min and position_max: nan). Ctrl-C, a fault or too high a speed stops the motor.
"""

import argparse
import asyncio
import math
import time

{motions}
MAXIMUM_TORQUE = {torque:.6g}  # N m at the output: the study's current limit
PERIOD = 0.002  # s between commands; each is answered with a row
COLUMNS = ("POSITION", "VELOCITY", "TORQUE", "Q_CURRENT", "D_CURRENT", "VOLTAGE", "FAULT", {encoder!r})


async def play(controller, moteus, name, motion):
    registers = [getattr(moteus.Register, column) for column in COLUMNS]
    start = time.monotonic()
    with open(f"{{name}}.csv", "w") as file:
        print(",".join(("time", *COLUMNS)), file=file)
        while True:
            t = time.monotonic() - start
            if t >= motion[-1][0]:
                return
            velocity, acceleration = command_at(motion, t)
            result = await controller.set_position(
                position=math.nan,
                velocity=velocity,
                accel_limit=acceleration,
                maximum_torque=MAXIMUM_TORQUE,
                query=True,
            )
            if result is not None:
                values = [result.values.get(register, 0) for register in registers]
                print(",".join(map(str, [time.monotonic() - start, *map(float, values)])), file=file)
                if values[COLUMNS.index("FAULT")]:
                    raise SystemExit(f"{{name}}: fault {{values[COLUMNS.index('FAULT')]}}: stopped")
                if abs(values[COLUMNS.index("VELOCITY")]) > SPEED_LIMIT:
                    raise SystemExit(f"{{name}}: {{values[COLUMNS.index('VELOCITY')]:.3g}} rev/s: stopped")
            await asyncio.sleep(PERIOD)


async def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--yes", action="store_true", help="move the motor")
    parser.add_argument("--id", type=int, default=1, help="of the controller on the bus")
    options = parser.parse_args()
    describe()
    if not options.yes:
        print("Nothing was moved. --yes moves the motor.")
        return
    try:
        import moteus
    except ModuleNotFoundError:
        raise SystemExit("no package moteus: pip install moteus") from None

    resolution = moteus.QueryResolution()
    for field in ("position", "velocity", "torque", "q_current", "d_current", "voltage"):
        setattr(resolution, field, moteus.F32)
    resolution._extra = {{moteus.Register.{encoder}: moteus.F32}}
    controller = moteus.Controller(id=options.id, query_resolution=resolution)
    await controller.set_stop()  # It clears a fault of before.
    try:
        for name, motion in MOTIONS.items():
            print(name, flush=True)
            await play(controller, moteus, name, motion)
    finally:
        await controller.set_stop()


if __name__ == "__main__":
    asyncio.run(main())
'''


def write_script(motions: Motions, configuration: Path | None) -> dict[str, str]:
    """The script. Gear and encoder are those of the dump; without a dump: no gear, encoder 0."""
    dump = read_dump(configuration) if configuration is not None else None
    ratio = dump.ratio if dump is not None else 1.0
    source = dump.source if dump is not None else 0
    text = MOTEUS_TEXT.format(
        name=MOTEUS_SCRIPT,
        motions=motions_text(motions, ratio, "MAXIMUM_TORQUE", "N m"),
        torque=motions.K_t * motions.current_limit / ratio,
        encoder=f"ENCODER_{source}_POSITION",
    )
    return {MOTEUS_SCRIPT: text}
