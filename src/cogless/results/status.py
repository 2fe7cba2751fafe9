"""Bits of a controller's status, as status.h of the control library defines them, and their names."""

from __future__ import annotations

from enum import IntFlag

from cogless.control_library import status_bits

_BITS = status_bits()


class Status(IntFlag):
    """Status bits that a controller returns with each step."""

    SATURATED = _BITS["CGL_STATUS_SATURATED"]
    FAULT = _BITS["CGL_STATUS_FAULT"]
    FROZEN = _BITS["CGL_STATUS_FROZEN"]
    BUSY = _BITS["CGL_STATUS_BUSY"]
    ANGLE_LOST = _BITS["CGL_STATUS_ANGLE_LOST"]
    ANGLE_SHIFTED = _BITS["CGL_STATUS_ANGLE_SHIFTED"]
    ANGLE_STUCK = _BITS["CGL_STATUS_ANGLE_STUCK"]
    CURRENT = _BITS["CGL_STATUS_CURRENT"]
    BUS = _BITS["CGL_STATUS_BUS"]
    OUTLIER = _BITS["CGL_STATUS_OUTLIER"]
    OFF = _BITS["CGL_STATUS_OFF"]
    GUARDED = _BITS["CGL_STATUS_GUARDED"]


SAFE_OUTPUT = Status.FAULT | Status.OFF  # the controller holds its safe output
NOTICED = {  # what the monitor found wrong
    Status.ANGLE_LOST: "angle missing",
    Status.ANGLE_SHIFTED: "angle shifted",
    Status.ANGLE_STUCK: "angle stuck",
    Status.CURRENT: "current not plausible",
    Status.BUS: "bus voltage not plausible",
}
