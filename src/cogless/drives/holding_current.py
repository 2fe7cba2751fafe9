"""The current that holds a rotor against its cogging, and the entries of a drive's table for this current."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.files import reason
from cogless.maps import stored_map
from cogless.maps.stored_map import CURRENT_CODE
from cogless.results.trace import Array

FINE_POINTS = 16  # grid points for each entry of a table, or each wave of the highest order
ORDER_LEAST = 1e-6  # an order below this share of the largest is rounding
Waves = NDArray[np.complex128]


class AngleWaves:
    """A value over the rotor's angle, sum Re(waves[n] exp(j n angle)); waves[0] is zero.

    `source`: for messages.
    """

    waves: Waves
    source: str

    def value(self, angle: Array) -> Array:
        """The value at these angles, rad."""
        orders = np.flatnonzero(self.waves)
        return np.asarray(sum((self.waves[n] * np.exp(1j * n * angle)).real for n in orders) + 0 * angle)

    @property
    def orders(self) -> list[int]:
        """The orders in these waves that are more than rounding."""
        sizes = np.abs(self.waves)
        return [int(n) for n in np.flatnonzero(sizes > ORDER_LEAST * np.max(sizes))]

    @property
    def rms(self) -> float:
        """Root mean square, in the value's unit."""
        return float(np.sqrt(np.sum(np.abs(self.waves) ** 2) / 2))

    def turned(self, direction: int, shift: float = 0.0) -> Self:
        """The waves over the angle direction * angle + shift, rad, with the value times `direction`, too."""
        n = np.arange(len(self.waves))
        waves = self.waves if direction > 0 else -np.conj(self.waves)
        return replace(self, waves=waves * np.exp(-1j * n * shift))  # type: ignore[type-var]


@dataclass(frozen=True, eq=False)
class HoldingCurrent(AngleWaves):
    """The current over the rotor's angle, A, that holds the rotor against its cogging.

    `K_t`: the motor's, N*m/A; 0: unknown.
    """

    waves: Waves
    K_t: float
    source: str


def from_samples(
    values: Array, K_t: float, source: str, kind: Literal["points", "linear", "step", "means"] = "points"
) -> HoldingCurrent:
    """The current of evenly spaced values over a revolution. Their mean, a load, is left out.

    Value i is `points`: the current at i / count. `linear`: a table's entry there, with straight lines
    between, which make an order n smaller by sinc^2(n / count). `step`: an entry that holds from i to i + 1.
    `means`: the mean of a current over that stretch, which is smaller than the current by sinc.
    """
    count = len(values)
    n = np.arange((count + 1) // 2)
    waves = 2 / count * np.fft.rfft(values)[: len(n)]
    sinc = np.sinc(n / count)
    if kind in ("step", "means"):
        waves *= np.exp(-1j * n * np.pi / count)
    waves *= sinc ** {"points": 0, "linear": 2, "step": 1, "means": -1}[kind]
    waves[0] = 0.0
    return HoldingCurrent(waves, K_t, source)


def samples(current: AngleWaves, count: int, direction: int, between: Literal["linear", "step"]) -> Array:
    """The entries of a table for a current. They make up for what the firmware's interpolation takes off.

    Entry i is at the index i / count, which counts as `direction` times the angle. `linear`: the firmware
    interpolates between entries, which makes an order n smaller by sinc^2(n / count). `step`: an entry holds
    from i to i + 1, which delays an order by half an entry and makes it smaller by sinc. Orders of half the
    entries and above can't be held, and are left out.
    """
    waves = np.array(current.waves if direction > 0 else np.conj(current.waves))[: (count + 1) // 2]
    n = np.arange(len(waves))
    waves = waves / np.sinc(n / count) ** (2 if between == "linear" else 1)
    if between == "step":
        waves = waves * np.exp(1j * n * np.pi / count)
    spectrum = np.zeros(count // 2 + 1, complex)
    spectrum[: len(waves)] = waves * count / 2
    return np.fft.irfft(spectrum, count)


@dataclass(frozen=True)
class Residue:
    """What a table leaves: rms before and after; the largest order that is left. Units are the value's."""

    before: float
    after: float
    order: int
    amplitude: float  # amplitude of this order

    @property
    def share(self) -> float:
        return self.after / self.before if self.before else 0.0


def residue(current: AngleWaves, entries: int, applied: Callable[[Array], Array]) -> Residue:
    """What is left of a current when the firmware's own look-up acts, computed on a fine grid of angles."""
    points = FINE_POINTS * max(entries, max(current.orders, default=1))
    angle: Array = math.tau / points * (np.arange(points, dtype=np.float64) + 0.5)
    rest = current.value(angle) - applied(angle)
    spectrum = 2 / points * np.abs(np.fft.rfft(rest))
    order = int(np.argmax(spectrum[1:])) + 1
    rms = float(np.sqrt(np.mean((rest - np.mean(rest)) ** 2)))
    return Residue(current.rms, rms, order, float(spectrum[order]))


def from_identified(folder: Path) -> HoldingCurrent:
    """The current that cancels the identified cogging. StudyError: the folder has none."""
    waves, K_t = cancelling_waves(
        folder,
        "cogging",
        amplitude="amplitude_N_m",
        divisor="K_t_N_m_per_A",
        expected="expected logs that show the cogging; left_out in this file says why the cogging is missing",
    )
    return HoldingCurrent(waves, K_t, str(folder))


def cancelling_waves(
    folder: Path, key: str, *, amplitude: str, expected: str, divisor: str | None = None
) -> tuple[Waves, float]:
    """Waves that cancel the A sin(n angle + phase) in a list of identified.json, and their divisor.

    `amplitude`: the name of A there. `divisor`: the name of a number by which A is divided; None: 1.
    StudyError: the folder has no such list; with an empty one, `expected` ends the message.
    """
    path = folder / "identified.json"
    try:
        contents = json.loads(path.read_text("utf-8"))
        number, parts = 1.0 if divisor is None else float(contents[divisor]), contents[key]
        waves = np.zeros(max((part["order"] for part in parts), default=0) + 1, complex)
        for part in parts:
            waves[part["order"]] = 1j * part[amplitude] / number * np.exp(1j * part["phase_rad"])
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a folder that cogless identify wrote") from error
    except (KeyError, TypeError, ValueError):
        raise StudyError(f"{path}: expected what cogless identify writes") from None
    if not parts:
        raise StudyError(f"{path}: {key}: no order: {expected}")
    return waves, number


def from_stored_map(path: Path) -> HoldingCurrent:
    """The current of the newest stored map in a file. StudyError: no map of a current over a revolution."""
    try:
        places = stored_map.read(path)
    except stored_map.MapError:
        raise StudyError(
            f"{path}: no stored map: expected a stored map, a folder of cogless identify, or --from "
            "DRIVE for the table of a drive"
        ) from None
    newest = stored_map.newest(places)
    if newest is None:
        raise StudyError(f"{path}: " + "; ".join(f"at byte {place.offset}: {place.map}" for place in places))
    stored = newest.map
    if stored.units != (CURRENT_CODE,) or stored.turns != stored.parts or not stored.turns:
        kind = " and ".join(stored.unit(c)[0] for c in range(stored.channels))
        raise StudyError(f"{path}: a map of {kind}: expected a map of a current over a mechanical revolution")
    return from_samples(np.asarray(stored.values[0], np.float64), 0.0, str(path))
