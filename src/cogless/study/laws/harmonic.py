"""Keys of the law "PI with learned harmonics" in a study."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from cogless.control_library import real_number, whole_number
from cogless.study.laws.law import Feedback, LawLoop, LearnsWhileRunning
from cogless.study.table import CurrentBound, RateGain, excluded, invalid

HARMONIC_ORDERS = whole_number("CGL_HARMONIC_ORDERS")
HARMONIC_ORDER_MAX = whole_number("CGL_HARMONIC_ORDER_MAX")
HARMONIC_BANDS = whole_number("CGL_HARMONIC_EDGES") // 2  # a band has two edges
ORDER_ANGLE_MOST = real_number("CGL_HARMONIC_FASTEST")  # rad, largest angle that an order turns in a sample


@dataclass(frozen=True, kw_only=True)
class Learner:
    """The numbers of the learning part, which a rule computes (cogless.design.laws.harmonic)."""

    b: float  # rad/s^2/A
    delay: float  # s
    step: float  # rad, step of an angle sensor whose edges are timed; 0: the edges are not timed
    base: int  # lowest learned order, mechanical
    bends: int  # 1: the sensor's error once per turn is learned; 2: the error twice per turn, too
    orders: int  # number of learned orders
    # number of the lowest orders that act up to ORDER_ANGLE_MOST; others need 12 samples in a cycle or more
    fast: int
    rate: float  # 1/s, rate of learning at its begin; the law shares at most 1/16 per sample among the orders
    rate_min: float  # 1/s, rate to which learning slows down
    held: tuple[float, ...] = ()  # rad per sample, begin and end of each band in which no order learns

    def learns(self, order: int) -> bool:
        """Whether the law learns this order of a mechanical revolution."""
        return order % self.base == 0 and order <= self.base * self.orders

    @property
    def order_words(self) -> str:
        """The learned orders in words, such as "orders 2, 4, ..., 256"."""
        last = self.base * self.orders
        if self.orders == 1:
            return f"order {last}"
        if self.orders == 2:
            return f"orders {self.base} and {last}"
        if self.base == 1:
            return f"orders 1 to {last}"
        rest = f" and {last}" if self.orders == 3 else f", ..., {last}"
        return f"orders {self.base}, {2 * self.base}{rest}"


class Harmonic(Feedback, LearnsWhileRunning):
    """PI with learned harmonics: every gain and order follows from motor and drive."""

    law: Literal["harmonic"]
    """PI with learned harmonics of the motor's ripple. [A rule](/laws/harmonic.md#the-rule) computes the
    numbers of the learning part."""
    base: Annotated[int, Field(ge=1, le=HARMONIC_ORDER_MAX)] | None = None
    """Lowest order that the law learns, in waves per mechanical revolution. The law learns only multiples of
    `base`. Default: the greatest common divisor of `slots` and poles, or in two cases [a multiple of
    it](/laws/harmonic.md#the-rule); with Hall sensors 1. If you give `base`, all learned orders count as
    [known to exist](/laws/harmonic.md#the-rule). Such orders act up to higher speeds than others."""
    limit: CurrentBound | None = None  # A
    """Largest magnitude of the learned current, and of the cosine and the sine coefficient of each order.
    Default: `current_limit` of the drive."""
    position: bool = False
    """True: the law controls the position. False: the law controls the speed."""
    k_theta: RateGain | None = None  # 1/s
    """Position gain: speed per angle error. Give it if `position` is true and you also give `kp` and `ki`;
    otherwise leave it out."""

    @model_validator(mode="after")
    def _of_position(self) -> Self:
        by_hand = self.position and self.kp is not None
        if by_hand and self.k_theta is None:
            raise invalid(
                "expected a gain, since kp and ki are given and position is true", "k_theta", value="missing"
            )
        if self.k_theta is not None and not by_hand:
            if self.position:
                raise excluded("k_theta", "kp", "kp and ki are not given", "give kp and ki")
            cure = "set position = true and give kp and ki"
            raise excluded("k_theta", "position", "position = false", cure)
        return self

    learns_every_order: ClassVar[bool] = True

    @property
    def holds_position(self) -> bool:
        return self.position

    @property
    def needs_slots(self) -> bool:
        return self.base is None

    @property
    def over_angle(self) -> bool:
        """Whether the memory is over the angle; true for this law."""
        return True

    def revolutions(self, pole_pairs: int) -> Fraction:
        """Length of the learned period in mechanical revolutions."""
        return Fraction(1)

    def c_config(self, loop: LawLoop, learner: Learner | None = None) -> dict[str, Any]:
        assert learner is not None, "the rule gives it: HarmonicRules in cogless.design.laws.harmonic"
        return {
            "pi": self.pi_config(loop),
            "k_theta": self.k_theta or 0.0,
            **asdict(learner),
            "held": list(learner.held),
            "limit": loop.bounded(self.limit),
        }
