"""Keys of the law "PI with learned harmonics" in a study."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Annotated, Any, Literal

from pydantic import Field

from cogless.study.controller import Feedback, LawLoop, LearnsWhileRunning
from cogless.study.table import CurrentBound

ORDERS, HIGHEST = 128, 65_535  # CGL_HARMONIC_ORDERS, CGL_HARMONIC_ORDER_MAX
FASTEST = 2.6  # rad a sample of an order: CGL_HARMONIC_FASTEST


@dataclass(frozen=True)
class Learner:
    """The numbers of the learning part, as its rule computes them: cogless.design.harmonic."""

    b: float  # rad/s^2/A
    delay: float  # s
    base: int  # mechanical
    orders: int
    rate: float  # 1/s
    rate_min: float  # 1/s


class Harmonic(Feedback, LearnsWhileRunning):
    """PI with learned harmonics: every gain and order follows from motor and drive."""

    law: Literal["harmonic"]
    base: Annotated[int, Field(ge=1, le=HIGHEST)] | None = None  # mechanical; default: of slots and poles
    limit: CurrentBound | None = None  # A, of the learned part; default: current_limit

    @property
    def over_angle(self) -> bool:
        """Whether the memory is over the angle; true for this law."""
        return True

    def revolutions(self, pole_pairs: int) -> Fraction:
        """Length of the learned period in mechanical revolutions."""
        return Fraction(1)

    def c_config(self, loop: LawLoop, learner: Learner) -> dict[str, Any]:
        return {
            "pi": self.pi_config(loop),
            **asdict(learner),
            "limit": loop.current_limit if self.limit is None else self.limit,
        }
