"""A metric of trials: a number for each trial, or for each stretch between two changes."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from cogless import units
from cogless.c_laws import C_LAWS
from cogless.signals import dimensions
from cogless.study.table import Many, Quantity, Table, invalid
from cogless.units import Dimension

# Every signal that a drive's trial may have, recorded or derived, and those with an ideal current loop.
DRIVE_SIGNALS = dimensions(("trials", "electrical", "three_phases"), ["trial"])
IDEAL_SIGNALS = dimensions(("trials",), ["trial"])


def linear_signals(states: int) -> dict[str, Dimension]:
    """Every signal of a linear plant's trial; they have no unit."""
    terms = (term.signal for term in C_LAWS["trial"].terms)
    names = ("y_ref", "y", "y_error", "u", "load", *terms, "learned", "status")
    return dict.fromkeys((*names, *(f"x_{i + 1}" for i in range(states))), units.NONE)


class TrialMetric(Table):
    """One declared metric of trials.

    rms, maximum: one number a trial. first-rms, final-rms, trials-to-floor: one number a phase, which begins
    with the first trial and with each change.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
    kind: Literal["rms", "maximum", "first-rms", "final-rms", "trials-to-floor"]
    signal: str
    floor: Any = None  # of trials-to-floor, in the signal's unit
    scenarios: Many[str] | None = None  # default: all
    unit: str | None = None  # in tables and report; default: SI
    better: Literal["lower", "higher", "none"] = "lower"

    @field_validator("unit")
    @classmethod
    def _unit(cls, unit: str | None, info: ValidationInfo) -> str | None:
        dimension = DRIVE_SIGNALS.get(str(info.data.get("signal")))
        if unit is not None and info.data.get("kind") != "trials-to-floor" and dimension:
            try:
                units.factor(unit, dimension)
            except units.UnitError:
                raise invalid(f"expected a unit of {dimension.name}, such as {dimension.shown(1)}") from None
        return unit

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needed = self.kind == "trials-to-floor"
        if needed and self.floor is None:
            raise invalid(f'expected one, since kind is "{self.kind}"', "floor", value="missing")
        if not needed and self.floor is not None:
            raise invalid(f'expected none, since kind is "{self.kind}"', "floor")
        if needed:
            assert self.threshold > 0
        return self

    @property
    def threshold(self) -> float:
        """The floor, SI; raises the error that names what was expected."""
        dimension = DRIVE_SIGNALS.get(self.signal, units.NONE)
        try:
            return Quantity(dimension, ">", bare=dimension == units.NONE).read(self.floor)
        except PydanticCustomError as error:
            raise invalid(error.message(), "floor") from None

    @property
    def dimension(self) -> Dimension:
        """Dimension of the metric's value."""
        if self.kind == "trials-to-floor":
            return units.NONE
        return DRIVE_SIGNALS.get(self.signal, units.NONE)

    @property
    def per_trial(self) -> bool:
        """Whether it has one number a trial, not one a phase."""
        return self.kind in ("rms", "maximum")
