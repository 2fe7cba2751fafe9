"""Keys of the law "active disturbance rejection control" in a study."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from cogless import units
from cogless.study.laws.law import AutoTuning, Base, LawLoop, StudyOfLaws
from cogless.study.table import CurrentToAcceleration, Quantity, RateGain, invalid

OBSERVER_BANDWIDTH_MOST = 2.0  # rad per sample, largest observer bandwidth: FASTEST in adrc.c


class Adrc(Base):
    """Active disturbance rejection with a linear extended state observer (Gao 2003)."""

    law: Literal["adrc"]
    """Active disturbance rejection."""
    b: CurrentToAcceleration  # rad/s^2/A
    """Acceleration per current that the controller assumes: $K_t / J$, the torque constant divided by the
    inertia."""
    omega_c: RateGain  # 1/s
    """Bandwidth of the closed speed loop."""
    omega_o: Annotated[float, Quantity(units.RATE, ">", bare=True)]  # 1/s
    """Bandwidth of the extended state observer, in rad/s. It must be below twice the rate `speed_loop` in Hz:
    below 4000 rad/s at 2 kHz."""
    tuning: AutoTuning | None = None
    """`{ rule = "auto" }`: [a rule](/laws/auto.md) computes each number of the law that the controller's
    table leaves out. Default: no rule."""

    AUTOMATIC: ClassVar[dict[str, Any]] = {"b": 1.0, "omega_c": 0.0, "omega_o": 1.0}

    def check(self, study: StudyOfLaws, name: str) -> None:
        """Check that the observer isn't too fast for the law's sampling rate."""
        fastest = OBSERVER_BANDWIDTH_MOST * study.drive.rates.outer_loop
        if self.omega_o > fastest * (1 - 1e-6):
            per_sample = f"{OBSERVER_BANDWIDTH_MOST:g} rad a sample of the speed loop"
            expected = f"expected less than {fastest:.6g} rad/s, {per_sample}"
            raise invalid(expected, "controller", name, "omega_o")

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        return {**self.model_dump(include={"b", "omega_c", "omega_o"}), "limit": loop.current_limit}
