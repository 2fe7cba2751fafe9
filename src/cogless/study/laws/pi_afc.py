"""Keys of the law "PI with adaptive feedforward cancellation" in a study."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator

from cogless.control_library import whole_number
from cogless.study.laws.law import Feedback, LawLoop, LearnsWhileRunning
from cogless.study.table import CurrentBound, LawSpeed, Many, SpeedIntegralGain, StartTime, invalid

PI_AFC_ORDERS = whole_number("CGL_PI_AFC_ORDERS")
PI_AFC_ORDER_MAX = whole_number("CGL_PI_AFC_ORDER_MAX")


class PiAfc(Feedback, LearnsWhileRunning):
    """PI with adaptive feedforward cancellation: amplitudes of chosen orders, learned over the angle."""

    law: Literal["pi-afc"]
    """PI with adaptive feedforward cancellation."""
    orders: Many[int]  # mechanical
    """Orders that the law learns, in waves per mechanical revolution and in rising order, at most 16."""
    gain: SpeedIntegralGain  # A/rad
    """Learning gain $g$ ([equations](/laws/pi-afc.md#equations)): change of a learned coefficient (a current)
    per time and per speed error."""
    lead: StartTime = 0.0  # s
    """Delay from the current to the measured speed. The law attributes the present error to the angle that
    the rotor had this long ago, and corrects the coefficients with the cosine and sine of that angle. The
    delay is not rounded to samples."""
    omega_min: LawSpeed = 0.01  # rad/s
    """Speed of the reference below which the law does not learn. What it has learned still acts."""
    limit: CurrentBound | None = None  # A
    """Largest magnitude of each learned coefficient and of the whole learned current. Default:
    `current_limit` of the drive."""

    AUTOMATIC: ClassVar[dict[str, Any]] = {"orders": [1], "gain": 0.0, "lead": 0.0}
    LEARNING_GAINS: ClassVar[tuple[str, ...]] = ("gain",)

    @property
    def missing_feedback(self) -> str | None:
        return "kp" if self.gain > 0 and self.kp == 0 else None

    @property
    def rests_below(self) -> float:
        return self.omega_min

    @property
    def over_angle(self) -> bool:
        """Whether the memory is over the angle; true for this law."""
        return True

    @property
    def cells(self) -> int:
        """Number of map cells per revolution that would resolve the highest order: two per wave."""
        return 2 * self.orders[-1]

    @property
    def q_half_width(self) -> int:
        """Half width of the Q filter; zero, since this law has none."""
        return 0

    def revolutions(self, pole_pairs: int) -> Fraction:
        """Length of the learned period in mechanical revolutions."""
        return Fraction(1)

    @model_validator(mode="after")
    def _rising(self) -> Self:
        rising = all(a < b for a, b in pairwise((0, *self.orders, PI_AFC_ORDER_MAX + 1)))
        if not rising or not 1 <= len(self.orders) <= PI_AFC_ORDERS:
            raise invalid(
                f"expected 1 to {PI_AFC_ORDERS} rising orders between 1 and {PI_AFC_ORDER_MAX}", "orders"
            )
        return self

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        return {
            "pi": self.pi_config(loop),
            "orders": len(self.orders),
            "order": self.orders,
            **self.model_dump(include={"gain", "lead", "omega_min"}),
            "limit": loop.bounded(self.limit),
        }
