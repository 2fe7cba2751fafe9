"""The motor: a permanent-magnet synchronous machine in dq, with cogging and flux harmonics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cogless.study.table import (
    Angle,
    AngularSpeed,
    Current,
    FluxAmplitude,
    FluxLinkage,
    Inductance,
    Many,
    Resistance,
    SpeedConstant,
    Table,
    Torque,
    TorqueConstant,
    invalid,
)

Order = Annotated[int, Field(ge=1, le=10_000)]


class FluxHarmonic(Table):
    """Harmonics of the flux linkage, added to psi_d and psi_q; the order is electrical.

    psi_d += d cos(order theta_e + d_phase), psi_q += q sin(order theta_e + q_phase).
    """

    order: Order
    d: FluxAmplitude = 0.0  # Wb
    q: FluxAmplitude = 0.0  # Wb
    d_phase: Angle = 0.0  # rad
    q_phase: Angle = 0.0  # rad


class Cogging(Table):
    """A harmonic of the cogging torque: torque sin(order theta_m + phase). The order is mechanical."""

    order: Order
    torque: Torque | None = None  # N*m
    current: Current | None = None  # A, measured as the holding current: torque = K_t current
    phase: Angle = 0.0  # rad

    @model_validator(mode="after")
    def _one_amplitude(self) -> Self:
        if (self.torque is None) == (self.current is None):
            raise invalid('expected either torque, such as "4 mN*m", or current, such as "0.2 A"')
        return self


class Motor(Table):
    """A synchronous motor, described as in its datasheet.

    R_s, L_d, L_q and flux linkages are those of one winding. K_t refers to the peak of the line current.
    Phase angles of harmonics refer to the star equivalent's angle.
    """

    kind: Literal["pmsm"] = "pmsm"
    datasheet: str | None = None  # its file; its fields are already merged in here
    pole_pairs: Annotated[int, Field(ge=1, le=1000)]
    R_s: Resistance  # ohm
    L_d: Inductance  # H
    L_q: Inductance  # H
    psi_f: FluxLinkage | None = None  # Wb, peak
    K_t: TorqueConstant | None = None  # N*m/A, 1.5 pole_pairs psi_f of the star equivalent
    kv: SpeedConstant | None = None  # rad/s/V, no-load speed per peak voltage from line to line
    winding: Literal["star", "delta"] = "star"
    rated_torque: Torque | None = None  # N*m, informative
    rated_speed: AngularSpeed | None = None  # rad/s, informative
    flux_harmonics: Many[FluxHarmonic] = ()
    cogging: Many[Cogging] = ()

    @model_validator(mode="after")
    def _one_flux(self) -> Self:
        if [self.psi_f, self.K_t, self.kv].count(None) != 2:
            raise invalid('expected one of psi_f = "68 mWb", K_t = "0.4 N*m/A" and kv = "300 rpm/V"')
        return self

    @property
    def phases(self) -> int:
        return 3

    def star(self) -> StarMotor:
        """The star equivalent: a delta winding has R/3, L/3, psi/sqrt(3).

        K_t and kv are converted to psi_f, and cogging currents to torques.
        """
        return self.star_equivalent

    @cached_property
    def star_equivalent(self) -> StarMotor:
        """As `star`, which every kind of motor has."""
        delta = self.winding == "delta"
        impedance, flux = (1 / 3, 1 / math.sqrt(3)) if delta else (1.0, 1.0)
        if self.psi_f is not None:
            K_t = 1.5 * self.pole_pairs * flux * self.psi_f
        elif self.kv is not None:
            K_t = math.sqrt(3) / 2 / self.kv  # peak line voltage: sqrt(3) pole_pairs psi_f omega_m
        else:
            K_t = self.K_t or 0.0
        return StarMotor(
            pole_pairs=self.pole_pairs,
            R_s=impedance * self.R_s,
            L_d=impedance * self.L_d,
            L_q=impedance * self.L_q,
            psi_f=K_t / (1.5 * self.pole_pairs),
            K_t=K_t,
            impedance_factor=impedance,
            flux_factor=flux,
            flux_harmonics=tuple(
                h.model_copy(update={"d": flux * h.d, "q": flux * h.q}) for h in self.flux_harmonics
            ),
            cogging=tuple(
                c if c.current is None else c.model_copy(update={"torque": K_t * c.current, "current": None})
                for c in self.cogging
            ),
        )


@dataclass(frozen=True)
class StarMotor:
    """A motor's star equivalent, all SI."""

    pole_pairs: int
    R_s: float  # ohm
    L_d: float  # H
    L_q: float  # H
    psi_f: float  # Wb
    K_t: float  # N*m/A
    impedance_factor: float  # R and L of this equivalent over those of one winding
    flux_factor: float
    flux_harmonics: tuple[FluxHarmonic, ...]
    cogging: tuple[Cogging, ...]
    phases: int = 3

    @property
    def power_factor(self) -> float:
        """Electrical power divided by u . i in dq coordinates: 3/2 for three phases, 1 for two."""
        return 0.5 * self.phases
