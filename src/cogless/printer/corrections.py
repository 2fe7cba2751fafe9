"""A correction of both directions: coefficients with their errors, the friction that follows, the file."""

from __future__ import annotations

import cmath
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cogless.errors import StudyError
from cogless.files import no_device, reason
from cogless.printer.axis import Axis
from cogless.printer.records import CORRECTED_ORDERS, DIRECTIONS, ComplexNumbers, Direction, Numbers

CORRECTION_FILE = "correction.json"
FRICTION_ORDER = 4  # order whose phases show friction
RESONANCE_RATIO = 3.1  # |H| 15 % off a resonance without damping, on the side where it is smaller
GROUPS_LEAST = 4  # groups that an error needs
ERROR_CHANCE = 0.05  # chance that the truth lies outside an error's circle


def spread(values: ComplexNumbers) -> float:
    """Radius that holds the truth in 95 %. `values`: a complex estimate, with each group left out in turn.

    It is Hotelling's T^2 in two dimensions, by the quantile of F with 2 and k - 2 degrees, in closed form.
    """
    count = len(values)
    if count < GROUPS_LEAST:
        return math.inf
    variance = (count - 1) / count * float(np.sum(np.abs(values - np.mean(values)) ** 2)) / 2
    freedom = count - 2
    quantile = freedom / 2 * (ERROR_CHANCE ** (-2 / freedom) - 1)
    return math.sqrt(2 * (count - 1) / freedom * quantile * variance)


@dataclass(frozen=True)
class Coefficient:
    """c of sum Im(c exp(j n u)), rad, and the radius of a circle that holds the truth in 95 %."""

    value: complex
    error: float


@dataclass(frozen=True, eq=False)
class Answer:
    """How the carriage answers an angle of the motor: |H| over the frequency, Hz; 1 where it follows."""

    frequencies: Numbers
    ratios: Numbers

    def resonance(self) -> tuple[float, float]:
        """Frequency, Hz, and ratio where the carriage moves farthest."""
        k = int(np.argmax(self.ratios))
        return float(self.frequencies[k]), float(self.ratios[k])


@dataclass(frozen=True, eq=False)
class OrderRipple:
    """Amplitudes of the carriage's way by an order, m, at these rising speeds, m/s, without a correction and
    with it. `doubt`: what noise and the model's error would show with a perfect correction.
    """

    speeds: Numbers
    before: Numbers
    after: Numbers
    doubt: Numbers


@dataclass(frozen=True, eq=False)
class Lines:
    """What a direction's runs give: the correction by order, the carriage's answer, and remarks.

    `ripple`: by order, over the speed; empty if the runs do not show it. `ripple_note`: how it was found.
    """

    coefficients: Mapping[int, Coefficient]
    answer: Answer
    remarks: Sequence[str] = ()
    ripple: Mapping[int, OrderRipple] = field(default_factory=dict)
    ripple_note: str = ""


@dataclass(frozen=True)
class Friction:
    """Electrical angle by which friction holds the rotor back, and its error, rad; torque: N m, if known."""

    angle: float
    error: float
    torque: float | None


@dataclass(frozen=True, eq=False)
class Correction:
    """What takes the ripple out of a motor: coefficients by direction and order, valid at one current.

    `current`: A rms. `wavelength`: the carriage's way in an electrical turn, m. `torque`: at a quarter period
    from rest, N m; None: the axis's file lacks it.
    """

    motor: str
    current: float
    wavelength: float
    torque: float | None
    directions: Mapping[Direction, Mapping[int, Coefficient]]
    remarks: Sequence[str] = ()
    ripple: Mapping[Direction, Mapping[int, OrderRipple]] = field(default_factory=dict)
    ripple_note: str = ""

    @classmethod
    def from_lines(cls, axis: Axis, lines: Mapping[Direction, Lines]) -> Correction:
        """The correction of an axis, from the lines of each direction."""
        remarks = [remark for entry in lines.values() for remark in entry.remarks]
        frequency, ratio = max(
            (entry.answer.resonance() for entry in lines.values()), key=lambda peak: peak[1]
        )
        if ratio > RESONANCE_RATIO:
            speeds = ", ".join(f"{1e3 * frequency * axis.wavelength / n:.0f}" for n in CORRECTED_ORDERS)
            remarks.append(
                f"Resonance near {frequency:.0f} Hz: the carriage moves {ratio:.0f} times as far as the "
                f"motor, so orders 1, 2, 4 are loudest at {speeds} mm/s."
            )
        return cls(
            motor=axis.motor,
            current=axis.current,
            wavelength=axis.wavelength,
            torque=axis.torque_at_current,
            directions={name: dict(entry.coefficients) for name, entry in lines.items()},
            remarks=tuple(remarks),
            ripple={name: entry.ripple for name, entry in lines.items() if entry.ripple},
            ripple_note=next((entry.ripple_note for entry in lines.values() if entry.ripple), ""),
        )

    def orders(self, direction: Direction) -> dict[int, complex]:
        return {n: entry.value for n, entry in self.directions[direction].items()}

    def friction(self) -> Friction | None:
        """The friction, from the phases of order 4, which the detent causes.

        An angle delta of friction turns these phases by 4 delta, in opposite senses for the two directions.
        None: order 4 does not stand out of its error.
        """
        forward, backward = (self.directions[name].get(FRICTION_ORDER) for name in DIRECTIONS)
        if forward is None or backward is None:
            return None
        if abs(forward.value) < forward.error or abs(backward.value) < backward.error:
            return None
        ends = 2 * FRICTION_ORDER
        angle = -float(np.angle(forward.value / backward.value)) / ends
        error = math.hypot(*(entry.error / abs(entry.value) for entry in (forward, backward))) / ends
        return Friction(angle, error, None if self.torque is None else self.torque * angle)

    def to_json(self) -> str:
        tables = {
            name: [
                {
                    "order": n,
                    "magnitude_rad": abs(entry.value),
                    "phase_rad": cmath.phase(entry.value),
                    "error_rad": entry.error,
                }
                for n, entry in sorted(entries.items())
            ]
            for name, entries in self.directions.items()
        }
        contents = {
            "motor": self.motor,
            "current_A_rms": self.current,
            "wavelength_m": self.wavelength,
            "torque_N_m": self.torque,
        }
        return json.dumps({**contents, **tables}, indent=2) + "\n"


def read_correction(path: Path) -> Correction:
    """Read a correction that identify wrote: its file, or the folder. StudyError: it is no such file."""
    if path.is_dir():
        path = path / CORRECTION_FILE
    try:
        no_device(path)
        contents = json.loads(path.read_text("utf-8"))
        torque = contents["torque_N_m"]
        return Correction(
            motor=str(contents["motor"]),
            current=_positive(contents["current_A_rms"]),
            wavelength=_positive(contents["wavelength_m"]),
            torque=None if torque is None else _positive(torque),
            directions={name: dict(map(_entry, contents[name])) for name in DIRECTIONS},
        )
    except OSError as error:
        raise StudyError(
            f"{path}: {reason(error)}: expected what cogless identify --drive klipper or prusa writes"
        ) from error
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError):
        raise StudyError(f"{path}: expected what cogless identify --drive klipper or prusa writes") from None


def _positive(value: float) -> float:
    if not 0 < float(value) < math.inf:
        raise ValueError
    return float(value)


def _entry(wave: Mapping[str, float]) -> tuple[int, Coefficient]:
    order, magnitude, phase = int(wave["order"]), float(wave["magnitude_rad"]), float(wave["phase_rad"])
    if order < 1 or not (0 <= magnitude < math.inf and math.isfinite(phase)):
        raise ValueError
    return order, Coefficient(cmath.rect(magnitude, phase), float(wave["error_rad"]))
