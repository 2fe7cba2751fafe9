"""Angles in parts of a turn, 2^32 a revolution: whole numbers that wrap, as in C."""

import math

from .limits import clip

TURN = 1 << 32  # parts of a turn


def parts(revolutions: float) -> int:
    return int(revolutions * TURN)


def parts_of_angle(theta: float) -> int:
    """The parts of a turn of an angle [rad]."""
    return parts(math.fmod(theta * (1 / math.tau), 1)) % TURN


def turned(angle: int, radians: float) -> int:
    """The angle that is ahead of `angle` by these radians, in parts of a turn."""
    return (angle + parts(clip(radians / math.tau, 0.4999))) % TURN
