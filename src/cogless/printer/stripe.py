"""What makes a stripe on a print: causes, from the spacing of the stripes and the speed."""

from __future__ import annotations

from dataclasses import dataclass

from cogless.printer.axis import DIAGONAL
from cogless.study.motor import teeth_of

STRIPE_TOLERANCE = 0.06  # share by which a spacing may be misread with a rule laid over some stripes
MOTOR_ORDERS = (1, 2, 4, 8)
TOOTH_HARMONICS = (1, 2)
RINGING_RANGE = (15.0, 400.0)  # Hz, of axes and frames
ORDER_CAUSES = {
    1: "offsets of the coils' currents",
    2: "unequal coils, or coils not at right angles",
    4: "detent torque, or a third harmonic of the flux",
    8: "the driver near zero current",
}


@dataclass(frozen=True)
class Cause:
    """A cause of a stripe, and the spacing that it has, m. `line`: the cause, and what takes it out.

    `kind`: "order", "tooth", "pulley" or "ringing". `order`: of an electrical turn; 0: none.
    """

    kind: str
    spacing: float
    line: str
    order: int = 0


def stripe_causes(
    spacing: float,
    speed: float,
    pulley_teeth: int,
    step_angle: float,
    belt_pitch: float,
    diagonal: bool = False,
) -> list[Cause]:
    """Causes of a stripe of this spacing at this speed, m and m/s; the nearest first.

    `step_angle`: rad. `diagonal`: along the way of a single CoreXY motor. Each cause keeps its spacing when
    the speed changes, except ringing, which keeps its frequency.
    """
    share = DIAGONAL if diagonal else 1.0
    turn = pulley_teeth * belt_pitch * share
    teeth = teeth_of(step_angle)
    frequency = speed / spacing
    candidates = [
        Cause(
            "order",
            turn / teeth / n,
            f"motor, electrical order {n}: {ORDER_CAUSES[n]}; a correction of order {n} removes it",
            n,
        )
        for n in MOTOR_ORDERS
    ]
    candidates += [
        Cause(
            "tooth",
            belt_pitch * share / k,
            f"teeth of the belt{'' if k == 1 else f' (harmonic {k})'}: no correction of the motor helps",
        )
        for k in TOOTH_HARMONICS
    ]
    candidates.append(
        Cause("pulley", turn, "eccentric pulley, one stripe a turn: no correction of the motor helps")
    )
    near = [cause for cause in candidates if abs(cause.spacing / spacing - 1) <= STRIPE_TOLERANCE]
    near.sort(key=lambda cause: abs(cause.spacing / spacing - 1))
    if RINGING_RANGE[0] <= frequency <= RINGING_RANGE[1]:
        near.append(
            Cause(
                "ringing",
                spacing,
                f"ringing at {frequency:.0f} Hz after corners, if the spacing doubles at twice the speed",
            )
        )
    return near
