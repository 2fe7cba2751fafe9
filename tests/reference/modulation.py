"""Space-vector modulation in its textbook form: a sector, two active vectors and the zero vector."""

import cmath
import math

import numpy as np

# switching states (a, b, c) of the six active vectors, at 0, 60, ... 300 degrees
ACTIVE = np.array([(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 1)], dtype=float)


def modulate(u: complex, u_dc: float) -> np.ndarray:
    """Duty cycles: time shares of the sector's two vectors, and the zero time split in equal halves over
    000 and 111."""
    if not (u_dc > 0 and math.isfinite(u_dc) and cmath.isfinite(u)):
        return np.full(3, 0.5)
    sector = int(cmath.phase(u) % (2 * math.pi) // (math.pi / 3)) % 6
    within = u * cmath.exp(-1j * math.pi / 3 * sector)
    # an active vector is 2/3 u_dc long: u = 2/3 u_dc (first + second exp(j pi/3))
    second = within.imag / (math.sin(math.pi / 3) * 2 / 3 * u_dc)
    first = within.real / (2 / 3 * u_dc) - second / 2
    zero = 1 - first - second
    duty = first * ACTIVE[sector] + second * ACTIVE[(sector + 1) % 6] + zero / 2
    return duty.clip(0, 1)
