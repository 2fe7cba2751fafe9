"""Bits of a controller's status, as defined in control/src/cogless/status.h, and their names."""

from __future__ import annotations

from enum import IntFlag


class Status(IntFlag):
    """Status bits that a controller returns with each step."""

    SATURATED = 1
    FAULT = 2
    FROZEN = 4
    BUSY = 8
    ANGLE_LOST = 16
    ANGLE_SHIFTED = 32
    ANGLE_STUCK = 64
    CURRENT = 128
    BUS = 256
    OUTLIER = 512
    OFF = 1024
    GUARDED = 2048


SAFE = Status.FAULT | Status.OFF  # the controller holds its safe output
NOTICED = {  # what the monitor found wrong
    Status.ANGLE_LOST: "angle missing",
    Status.ANGLE_SHIFTED: "angle shifted",
    Status.ANGLE_STUCK: "angle stuck",
    Status.CURRENT: "current not plausible",
    Status.BUS: "bus voltage not plausible",
}
