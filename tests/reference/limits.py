"""Limits, and what counts as an input."""

import math

ANGLE_MAX = 1.0e5  # rad


def clip(x: float, limit: float) -> float:
    return min(max(x, -limit), limit)


def sgn(x: float) -> float:
    """liu2018 (17)"""
    return float(x > 0) - float(x < 0)


def is_angle(theta: float) -> bool:
    return abs(theta) < ANGLE_MAX


def finite_or_zero(x: float) -> float:
    return x if math.isfinite(x) else 0.0
