"""What the Python scripts of all drives share: the motions, the command at a time, the dry run's lines."""

from __future__ import annotations

import math

from cogless.drives.adapter import RAMP_TIME, Motions, ramped

SPEED_MARGIN = 1.5  # speed at which a script stops the motor / highest speed of the motions

MOTIONS_TEXT = '''\
# Speeds of the output, turns/s over s, with straight lines between.
MOTIONS = {{
{motions}
}}
SPEED_LIMIT = {speed_limit:.6g}  # turns/s of the output: the motor is stopped beyond
STEADY_ACCELERATION = {steady:.6g}  # turns/s^2, where the speed is constant


def command_at(motion, t):
    """The speed at the end of this ramp, and its acceleration. The drive makes the ramp itself: steps of a
    speed at each command would show in every row of the current, at the same place behind a command."""
    for (t0, v0), (t1, v1) in zip(motion, motion[1:]):
        if t < t1:
            break
    return v1, abs(v1 - v0) / (t1 - t0) or STEADY_ACCELERATION


def describe():
    for name, motion in MOTIONS.items():
        top = max(abs(speed) for _, speed in motion)
        print(f"{{name}}.csv: {{motion[-1][0]:.1f}} s, up to {{top:.3g}} turns/s")
    print(f"At most {{{limit}:.3g}} {unit}, stopped beyond {{SPEED_LIMIT:.3g}} turns/s.")
'''


def motions_text(motions: Motions, ratio: float, limit: str, unit: str) -> str:
    """The shared part of a script. `ratio`: turns of output / rotor. `limit`: a constant's name."""
    speeds = {
        name: [(t, speed * ratio / math.tau) for t, speed in ramped(points)]
        for name, points in motions.speeds.items()
    }
    lines = []
    for name, points in speeds.items():
        pairs = ", ".join(f"({t:.6g}, {speed:.6g})" for t, speed in points)
        lines.append(f'    "{name}": [{pairs}],')
    top = max(abs(speed) for points in speeds.values() for _, speed in points)
    return MOTIONS_TEXT.format(
        motions="\n".join(lines),
        speed_limit=SPEED_MARGIN * top,
        steady=2 * top / RAMP_TIME,
        limit=limit,
        unit=unit,
    )
