"""What a user's own law is told about the drive: the numbers that a rule for its gains needs."""

from __future__ import annotations

from dataclasses import dataclass

from cogless.study import AnyStudy


@dataclass(frozen=True, kw_only=True)
class KnownDrive:
    """A drive as its controller knows it, without the overrides of a scenario; SI units.

    The fields are those of `cogless_plugin_drive` in plugin.h.
    """

    pole_pairs: int
    phases: int  # 2 or 3
    slots: int  # of the stator; 0: the study doesn't tell
    R_s: float  # ohm, of a phase
    L_d: float  # H
    L_q: float  # H
    psi_f: float  # Wb
    torque_constant: float  # N*m/A, of i_q
    inertia: float  # kg*m^2, of rotor and load
    current_limit: float  # A
    current_bandwidth: float  # rad/s, of the current loop; 0: it is ideal
    current_period: float  # s
    delay: float  # s, from sampling to the middle of the period in which the voltage acts; 0: ideal


def known_drive(study: AnyStudy) -> KnownDrive:
    """What a controller of a drive is told."""
    motor, mechanics, drive = study.motor, study.mechanics, study.drive
    assert motor is not None and mechanics is not None and drive is not None
    star, period = motor.star(), 1 / drive.rates.current_loop
    belief = drive.belief.resolved(star)
    return KnownDrive(
        pole_pairs=motor.pole_pairs,
        phases=star.phases,
        slots=getattr(motor, "slots", None) or 0,
        R_s=belief.R_s,
        L_d=belief.L_d,
        L_q=belief.L_q,
        psi_f=belief.psi_f,
        torque_constant=star.power_factor * motor.pole_pairs * belief.psi_f,
        inertia=mechanics.stiff.inertia,
        current_limit=drive.current_loop.current_limit,
        current_bandwidth=drive.current_loop.gains(belief)["kp_q"] / belief.L_q,
        current_period=period,
        delay=0.0 if drive.ideal else drive.advance * period,
    )
