"""The permanent-magnet step motor with non-sinusoidal flux (Verrelli 2016, sections 2 and 5).

The motor has two phases. Its torque and speed voltages are those of a PMSM with flux harmonics of electrical
order j - 1 whose amplitudes are the same in both axes. So the same plant model simulates both kinds of motor:

    torque = N_r i_f (sum_j j L_mj cos((1 - j) N_r theta) i_q + sum_j j L_mj sin((1 - j) N_r theta) i_d)
             + 2 N_r L_1 i_d i_q - N_r i_f^2 / 2 sum_j j L_fj sin(j N_r theta)
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cogless.study.motor import CoggingTorque, FluxHarmonic, StarMotor
from cogless.study.table import (
    Datasheet,
    Inductance,
    InductanceAmplitude,
    MagnetCurrent,
    Many,
    Resistance,
    Table,
    invalid,
)

FIRST_COGGING = 4  # j of the first L_fj


class StepMotor(Table):
    """A step motor, with the parameters that papers on it use."""

    kind: Literal["step"]
    datasheet: Datasheet | None = None  # its file; its fields are already merged in here
    teeth: Annotated[int, Field(ge=1, le=1000)]  # N_r, of the rotor
    R_s: Resistance  # ohm, of a phase
    L_0: Inductance  # H, self inductance of a phase
    L_1: InductanceAmplitude = 0.0  # H, of the saliency
    L_m: Many[InductanceAmplitude]  # H, L_m1, L_m2, ...: flux of the magnet
    L_f: Many[InductanceAmplitude] = ()  # H, L_f4, L_f5, ...: cogging
    i_f: MagnetCurrent = 1.0  # A, fictitious, of the magnet

    @model_validator(mode="after")
    def _magnet(self) -> Self:
        if not self.L_m or self.L_m[0] <= 0:
            raise invalid("expected L_m1, above zero, and the others after it", "L_m")
        if abs(self.L_1) >= self.L_0:
            raise invalid("expected less than L_0", "L_1")
        return self

    @property
    def pole_pairs(self) -> int:
        """Electrical revolutions in a mechanical one."""
        return self.teeth

    @property
    def phases(self) -> int:
        return 2

    def star(self) -> StarMotor:
        """The equivalent two-phase motor for the plant model, with flux harmonics of order j - 1."""
        psi_f = self.i_f * self.L_m[0]
        harmonics = [
            FluxHarmonic.model_construct(order=j - 1, d=self.i_f * L, q=self.i_f * L)
            for j, L in enumerate(self.L_m[1:], start=2)
            if L
        ]
        amplitude = -0.5 * self.teeth * self.i_f**2
        cogging = [
            CoggingTorque(j * self.teeth, amplitude * j * L)
            for j, L in enumerate(self.L_f, start=FIRST_COGGING)
            if L
        ]
        return StarMotor(
            pole_pairs=self.teeth,
            R_s=self.R_s,
            L_d=self.L_0 + self.L_1,
            L_q=self.L_0 - self.L_1,
            psi_f=psi_f,
            K_t=self.teeth * psi_f,
            impedance_factor=1.0,
            flux_factor=1.0,
            flux_harmonics=tuple(harmonics),
            cogging=tuple(cogging),
            phases=self.phases,
        )
