"""A script for ODrive's own Python package that plays the motions of a plan, and logs what identify needs."""

from __future__ import annotations

from pathlib import Path

from cogless.drives.adapter import Motions
from cogless.drives.script_motions import motions_text

ODRIVE_SCRIPT = "record_odrive.py"

ODRIVE_TEXT = '''\
"""Play motions on an ODrive and log them, by cogless. Needs: pip install odrive

    python {name}          prints what would happen; nothing moves
    python {name} --yes    moves the motor

The motor must be free to turn, without stops, and calibrated. Firmware 0.5.6 and 0.6. Ctrl-C, an error or
too high a speed stops the motor. Settings are changed for the run only, and nothing is saved.
"""

import argparse
import time

{motions}
CURRENT_LIMIT = {current:.6g}  # A: the study's
PERIOD = 0.002  # s between rows; USB may be slower


def paths(axis):
    """Of firmware 0.6, else of 0.5: angle, speed, current; the settings' place; the errors' name."""
    if hasattr(axis, "pos_estimate"):
        columns = ("pos_estimate", "vel_estimate", "motor.foc.Iq_measured")
        return columns, axis.config.motor, "current_soft_max", "active_errors"
    columns = ("encoder.pos_estimate", "encoder.vel_estimate", "motor.current_control.Iq_measured")
    return columns, axis.motor.config, "current_lim", "error"


def value(axis, path):
    for name in path.split("."):
        axis = getattr(axis, name)
    return axis


def play(odrv, axis, label, name, motion):
    columns, _, _, errors = paths(axis)
    start = time.monotonic()
    commanded = None
    with open(f"{{name}}.csv", "w") as file:
        print(",".join(["t", *(f"{{label}}.{{column}}" for column in columns), "vbus_voltage"]), file=file)
        while True:
            t = time.monotonic() - start
            if t >= motion[-1][0]:
                return
            command = command_at(motion, t)
            if command != commanded:
                axis.controller.config.vel_ramp_rate = command[1]
                axis.controller.input_vel = command[0]
                commanded = command
            row = [value(axis, column) for column in columns]
            t = time.monotonic() - start
            print(",".join(map(str, [t, *row, odrv.vbus_voltage])), file=file)
            if getattr(axis, errors):
                raise SystemExit(f"{{name}}: error {{getattr(axis, errors):#x}}: stopped")
            if abs(row[1]) > SPEED_LIMIT:
                raise SystemExit(f"{{name}}: {{row[1]:.3g}} turns/s: stopped")
            time.sleep(PERIOD)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--yes", action="store_true", help="move the motor")
    parser.add_argument("--axis", type=int, default=0)
    options = parser.parse_args()
    describe()
    if not options.yes:
        print("Nothing was moved. --yes moves the motor.")
        return
    try:
        import odrive
    except ModuleNotFoundError:
        raise SystemExit("no package odrive: pip install odrive") from None

    odrv = odrive.find_any()
    label = f"axis{{options.axis}}"
    axis = getattr(odrv, label)
    _, settings, limit, _ = paths(axis)
    config = axis.controller.config
    before = config.control_mode, config.input_mode, config.vel_ramp_rate, getattr(settings, limit)
    try:
        setattr(settings, limit, min(CURRENT_LIMIT, before[3]))
        config.control_mode, config.input_mode = 2, 2  # velocity control, ramped velocity
        axis.controller.input_vel = 0
        axis.requested_state = 8  # closed loop
        time.sleep(0.5)
        for name, motion in MOTIONS.items():
            print(name, flush=True)
            play(odrv, axis, label, name, motion)
    finally:
        axis.requested_state = 1  # idle
        config.control_mode, config.input_mode, config.vel_ramp_rate = before[:3]
        setattr(settings, limit, before[3])


if __name__ == "__main__":
    main()
'''


def write_script(motions: Motions, configuration: Path | None) -> dict[str, str]:
    """The script. An ODrive's encoder is on the rotor."""
    del configuration
    return {
        ODRIVE_SCRIPT: ODRIVE_TEXT.format(
            name=ODRIVE_SCRIPT,
            motions=motions_text(motions, 1.0, "CURRENT_LIMIT", "A"),
            current=motions.current_limit,
        )
    }
