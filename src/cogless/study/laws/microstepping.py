"""Keys of the law "microstepping": it turns a step motor without a sensor, as a printer's driver does."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from cogless import units
from cogless.control_library import MICROSTEPPING, whole_number
from cogless.files import reason
from cogless.study.laws.law import Base, LawLoop, StudyOfLaws
from cogless.study.position_sensor import IdealSensor
from cogless.study.table import File, Many, Quantity, Table, excluded, invalid

CORRECTION_WAVES_MOST = whole_number("CGL_MICROSTEPPING_WAVES")
MICROSTEPS_MOST = whole_number("CGL_MICROSTEPS_MAX")
RIPPLE_LEFT_MOST = 0.05  # share of the ripple that a correction may leave if it was found at another current
CORRECTED_DIRECTIONS: tuple[Literal["forward", "backward"], ...] = ("forward", "backward")


class Wave(Table):
    """A part of a correction: magnitude sin(order u + phase), u the electrical angle of the reference."""

    order: Annotated[int, Field(ge=1, le=1000)]
    """Number of periods of this wave in an electrical revolution."""
    magnitude: Annotated[float, Quantity(units.ANGLE, ">=", bare=True)]  # rad
    """Amplitude of this wave, as an electrical angle. The wave adds `magnitude` sin(`order` $u$ + `phase`) to
    the commanded electrical angle $u$."""
    phase: Annotated[float, Quantity(units.ANGLE, bare=True)] = 0.0  # rad
    """Phase of this wave: 360 deg are one of its periods."""


Waves = Annotated[Many[Wave], Field(max_length=CORRECTION_WAVES_MOST)]


def wrong_current(own: float, other: float) -> str:
    """A warning that a correction for the current `own` is used at `other`, both A rms; "": no harm.

    Offsets of the coils and the detent turn the rotor by an angle that is proportional to 1 / current. If
    they make all of the ripple, the ripple at `other` is own / other times the correction, and a share of
    |other / own - 1| of the ripple is left.
    """
    share = abs(other / own - 1)
    if share <= RIPPLE_LEFT_MOST:
        return ""
    return (
        f"the correction is for {own:.4g} A rms: at {other:.4g} A it leaves about {share:.0%} of the ripple"
    )


class AngleCorrection(Table):
    """What is added to the commanded electrical angle, for each direction."""

    forward: Waves = ()
    """Waves of the correction while the motor turns forwards (positive speed), at most 8."""
    backward: Waves = ()
    """Waves of the correction while the motor turns backwards (negative speed), at most 8."""

    current: Annotated[float, Quantity(units.CURRENT, ">", bare=True)] | None = None  # A rms
    """Rms current of each coil for which the correction is right. cogless warns if the law's key `current`
    differs from it so much that over 5 % of the ripple would remain."""

    file: File | None = None
    """File `correction.json` that `cogless identify` wrote for a printer. It replaces `forward`, `backward`
    and `current`."""

    @model_validator(mode="after")
    def _rises(self, info: ValidationInfo) -> AngleCorrection:
        if self.file is None:
            self._check("")
            return self
        for key in ("forward", "backward", "current"):
            if getattr(self, key):
                raise excluded(key, "file", "the file contains it", "delete file")
        if not info.context:
            return self
        correction = self.model_copy(update=_tables_of_file(info.context["folder"] / self.file))
        correction._check("file")
        return correction

    def _check(self, key: str) -> None:
        """Refuse waves with which the command would turn back.

        `key`: names the waves in the error; "": the key of their direction does.
        """
        for direction in CORRECTED_DIRECTIONS:
            slope = sum(wave.order * wave.magnitude for wave in getattr(self, direction))
            if slope >= 1:
                expected = (
                    f"expected waves whose products order * magnitude add up to less than 1 rad, not "
                    f"{slope:.3g} rad"
                )
                raise invalid(f"{expected}: otherwise the command turns back", key or direction)


def _tables_of_file(path: Path) -> dict[str, Any]:
    """The current and the waves of both directions in a file of `cogless identify`."""
    try:
        contents = json.loads(path.read_text("utf-8"))
        current = float(contents["current_A_rms"])
        if not 0 < current < math.inf:
            raise ValueError
        tables: dict[str, Any] = {name: tuple(map(_wave, contents[name])) for name in CORRECTED_DIRECTIONS}
        return {**tables, "current": current}
    except OSError as error:
        raise invalid(f"{reason(error)}: expected a file at {path}", "file") from error
    except (KeyError, OverflowError, TypeError, ValueError):
        raise invalid("expected the correction.json that cogless identify writes", "file") from None


def _wave(wave: Mapping[str, Any]) -> Wave:
    return Wave(order=wave["order"], magnitude=wave["magnitude_rad"], phase=wave["phase_rad"])


class Microstepping(Base):
    """Microstepping of a step motor without a sensor, with a correction of the angle by orders."""

    NO_DRIVE: ClassVar[bool] = True
    NOT_ON_PAGE: ClassVar[str] = "it has no gains to try"

    open_loop: ClassVar[bool] = True

    law: Literal["microstepping"]
    """[Microstepping](/laws/microstepping.md) of a step motor without a sensor."""
    current: Annotated[float, Quantity(units.CURRENT, ">", bare=True)]  # A rms
    r"""Rms current of each coil, like `run_current` of a stepper driver. The current's amplitude is $\sqrt2$
    times as large."""
    microsteps: Annotated[int, Field(ge=1, le=MICROSTEPS_MOST)] = 256
    """Number of microsteps in a full step: a power of two up to 1024."""
    correction: AngleCorrection | None = None
    """Waves that are added to the commanded angle to reduce ripple, such as those of `cogless identify
    --drive klipper`. Default: no correction."""

    @field_validator("microsteps")
    @classmethod
    def _power(cls, microsteps: int) -> int:
        if microsteps & (microsteps - 1):
            raise invalid("expected a power of two, such as 256")
        return microsteps

    @property
    def amplitude(self) -> float:
        """Amplitude of each coil's current, A."""
        return math.sqrt(2) * self.current

    @property
    def holds_position(self) -> bool:
        return True

    @property
    def learned(self) -> bool:
        return self.correction is not None

    @property
    def c_struct(self) -> str:
        return MICROSTEPPING.config

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        correction = self.correction or AngleCorrection()
        return {
            "teeth": loop.pole_pairs,
            "current": self.amplitude,
            "microsteps": self.microsteps,
            **{direction: _waves(getattr(correction, direction)) for direction in CORRECTED_DIRECTIONS},
        }

    def check(self, study: StudyOfLaws, name: str) -> None:
        """Check that motor and drive are like those of a step motor's driver."""
        drive, where = study.drive, ("controller", name, "law")
        rates = drive.rates
        unlike = {
            "a motor of kind step": study.motor.phases != 2,
            "a current loop that is not ideal": drive.ideal,
            "drive.rates.speed_loop equal to current_loop": rates.divider != 1
            or rates.position_loop is not None,
            "no drive.position_sensor, since a driver of step motors has none": (
                not isinstance(drive.position_sensor, IdealSensor)
            ),
            "no drive.bus": drive.bus is not None,
            "no drive.current_reference": drive.current_reference is not None,
            **{
                f"no torque_mode in scenario {key}": study.scenario[key].torque_mode is not None
                for key in study.scenarios_of(name)
            },
        }
        for expected, is_unlike in unlike.items():
            if is_unlike:
                raise invalid(f"expected {expected}", *where, value=self.law)
        if self.amplitude > drive.current_loop.current_limit * (1 + 1e-9):
            expected = f"expected at most {drive.current_loop.current_limit / math.sqrt(2):.6g} A rms"
            raise invalid(f"{expected}, the limit by drive.current_loop.current_limit", *where[:2], "current")


def _waves(waves: Sequence[Wave]) -> list[dict[str, float]]:
    unused = {"order": 0, "magnitude": 0.0, "phase": 0.0}
    numbers = [{"order": w.order, "magnitude": w.magnitude, "phase": w.phase} for w in waves]
    return numbers + [unused] * (CORRECTION_WAVES_MOST - len(numbers))
