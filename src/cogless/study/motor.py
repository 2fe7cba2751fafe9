"""The motor: a permanent-magnet synchronous machine in dq, with cogging and flux harmonics.

Also the permanent-magnet step motor with non-sinusoidal flux (Verrelli 2016, sections 2 and 5).

A step motor has two phases. It has the torque and speed voltages of a PMSM with flux harmonics of electrical
order j - 1 whose amplitudes are equal in both axes. So the same plant model simulates both kinds of motor:

    torque = N_r i_f (sum_j j L_mj cos((1 - j) N_r theta) i_q + sum_j j L_mj sin((1 - j) N_r theta) i_d)
             + 2 N_r L_1 i_d i_q - N_r i_f^2 / 2 sum_j j L_fj sin(j N_r theta)

The key `kind` of [motor] chooses a synchronous motor, the default, or a step motor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

from pydantic import Discriminator, Field, Tag, model_validator

from cogless.study.datasheet import (
    MAGNET,
    OF_A_PHASE,
    OTHER_WORDS,
    BackEmfTable,
    CoggingTable,
    check_agreement,
    torque_constant,
)
from cogless.study.saturation import MotorTemperature, Saturation
from cogless.study.table import (
    Angle,
    AngularSpeed,
    BackEmfConstant,
    Current,
    Datasheet,
    FluxAmplitude,
    FluxLinkage,
    Inductance,
    InductanceAmplitude,
    Many,
    PositiveCurrent,
    PositiveTorque,
    Resistance,
    SpeedConstant,
    Table,
    Torque,
    TorqueConstant,
    check_one,
    excluded,
    invalid,
)

Order = Annotated[int, Field(ge=1, le=10_000)]


class FluxHarmonic(Table):
    """Harmonics of the flux linkage, added to psi_d and psi_q; the order is electrical.

    psi_d += d cos(order theta_e + d_phase), psi_q += q sin(order theta_e + q_phase).
    """

    order: Order
    """Order of this harmonic: number of its waves per electrical revolution."""
    d: FluxAmplitude = 0.0  # Wb
    r"""Amplitude of this harmonic in the flux linkage $\psi_d$. The harmonic is `d` cos(`order` $\theta_e$ +
    `d_phase`) at the electrical angle $\theta_e$."""
    q: FluxAmplitude = 0.0  # Wb
    r"""Amplitude of this harmonic in the flux linkage $\psi_q$. The harmonic is `q` sin(`order` $\theta_e$ +
    `q_phase`) at the electrical angle $\theta_e$."""
    d_phase: Angle = 0.0  # rad
    r"""Phase of this harmonic in the flux linkage $\psi_d$ (see `d`)."""
    q_phase: Angle = 0.0  # rad
    r"""Phase of this harmonic in the flux linkage $\psi_q$ (see `q`)."""


class TorqueRipple(Table):
    """A harmonic of the torque constant over the mechanical angle, in per cent of its mean.

    K_t (1 + percent / 100 sin(order theta_m + phase)).
    """

    order: Order
    """Order of this harmonic: number of its waves per mechanical revolution."""
    percent: float | None = None  # amplitude
    r"""Amplitude of this harmonic, in per cent of the mean torque constant $K_t$. At the mechanical angle
    $\theta_m$ the torque constant is $K_t$ (1 + `percent`/100 sin(`order` $\theta_m$ + `phase`)). The
    [back-EMF has the same relative ripple](/theory/plant.md#torque-constant-ripple). Give `percent` or
    `percent_peak_to_peak`."""
    percent_peak_to_peak: float | None = None
    """Twice the amplitude of this harmonic, in per cent of the mean torque constant. Give `percent` or
    `percent_peak_to_peak`."""
    phase: Angle = 0.0  # rad
    """Phase of this harmonic: 360 deg are one of its waves."""

    @model_validator(mode="after")
    def _one_amplitude(self) -> Self:
        expected = "expected either percent, such as 1.5, or percent_peak_to_peak"
        check_one(self, ("percent", "percent_peak_to_peak"), expected)
        return self

    @property
    def share(self) -> float:
        """Amplitude as a share of K_t."""
        return (self.percent_peak_to_peak or 0.0) / 200 if self.percent is None else self.percent / 100


class Cogging(Table):
    """A harmonic of the cogging torque: torque sin(order theta_m + phase). The order is mechanical."""

    IN_PLACE: ClassVar[dict[str, str]] = {"amplitude": "torque", "peak_to_peak": "torque_peak_to_peak"}

    order: Order
    """Order of this harmonic: number of its waves per mechanical revolution."""
    torque: Torque | None = None  # N*m
    r"""Amplitude of this harmonic of the cogging torque. The harmonic is `torque` sin(`order` $\theta_m$ +
    `phase`) at the mechanical angle $\theta_m$. Give `torque`, `torque_peak_to_peak` or `current`."""
    torque_peak_to_peak: Torque | None = None  # N*m
    """Peak-to-peak torque of this harmonic, as in most datasheets: twice its amplitude. Give `torque`,
    `torque_peak_to_peak` or `current`."""
    current: Current | None = None  # A
    """Amplitude of the current that holds the rotor against this harmonic: the torque's amplitude divided by
    $K_t$. `phase` is the phase of the cogging torque: add 180 deg to the phase of a measured holding current.
    Give `torque`, `torque_peak_to_peak` or `current`."""
    phase: Angle = 0.0  # rad
    """Phase of this harmonic: 360 deg are one of its waves."""

    @model_validator(mode="after")
    def _one_amplitude(self) -> Self:
        expected = 'torque, such as "4 mN*m", torque_peak_to_peak, or current, such as "0.2 A"'
        check_one(self, ("torque", "torque_peak_to_peak", "current"), f"expected either {expected}")
        return self

    def as_torque(self, K_t: float) -> CoggingTorque:
        """The same harmonic with its amplitude as a torque; `K_t` in N*m/A."""
        torque = self.torque
        if torque is None:
            half = (self.torque_peak_to_peak or 0.0) / 2
            torque = half if self.current is None else K_t * self.current
        return CoggingTorque(self.order, torque, self.phase)


class CoggingTorque(NamedTuple):
    """A harmonic of the cogging torque: torque sin(order theta_m + phase). The order is mechanical."""

    order: int
    torque: float  # N*m
    phase: float = 0.0  # rad


class Motor(Table):
    """A synchronous motor, described as in its datasheet.

    R_s, L_d, L_q and flux linkages are those of one winding. K_t refers to the peak of the line current. What
    other words refer to is in their name; a phase is from line to star point.
    Phase angles of harmonics refer to the star equivalent's angle.
    """

    kind: Literal["pmsm"] = "pmsm"
    """A synchronous motor."""
    datasheet: Datasheet | None = None  # its file; its fields are already merged in here
    """Name of a shipped motor (see `cogless list`), or path of a datasheet file relative to the study. Keys
    in the study replace those of the datasheet."""
    pole_pairs: Annotated[int, Field(ge=1, le=1000)]
    """Number of pole pairs: electrical revolutions in a mechanical revolution."""
    slots: Annotated[int, Field(ge=3, le=10_000)] | None = None
    """Number of slots (teeth) of the stator. Slots and poles determine the orders of cogging. Only
    [harmonic](/laws/harmonic.md) needs this key."""
    # one word for each of resistance, inductance and magnet; several must agree, and the first counts
    R_s: Resistance | None = None  # ohm
    """Resistance of one winding. Give `R_s` or `resistance_line_to_line`."""
    resistance_line_to_line: Resistance | None = None  # ohm
    """Resistance between two terminals: twice that of a phase of the star equivalent. Give `R_s` or
    `resistance_line_to_line`."""
    L_d: Inductance | None = None  # H
    """Inductance of one winding in the d axis. Give `L_d` and `L_q`, or `inductance_line_to_line`."""
    L_q: Inductance | None = None  # H
    """Inductance of one winding in the q axis. Give `L_d` and `L_q`, or `inductance_line_to_line`."""
    inductance_line_to_line: Inductance | None = None  # H
    """Inductance between two terminals: twice that of a phase of the star equivalent. Only for motors with
    $L_d = L_q$. Give `L_d` and `L_q`, or `inductance_line_to_line`."""
    psi_f: FluxLinkage | None = None  # Wb
    r"""Peak flux linkage $\psi_f$ of the magnet with one winding. Instead you may give one of the keys whose
    names begin with `K_t`, `kv` or `K_e`."""
    K_t: TorqueConstant | None = None  # N*m/A
    r"""Torque constant $K_t$: torque per peak line current. It is $1.5\, p\, \psi_f$, with $p$ pole pairs and
    the flux linkage $\psi_f$ of the star equivalent."""
    K_t_rms: TorqueConstant | None = None  # N*m/A
    r"""Torque per rms line current: $\sqrt2\, K_t$, with the torque $K_t$ per peak line current."""
    kv: SpeedConstant | None = None  # rad/s/V
    r"""Speed constant $k_v$: no-load speed per peak voltage from line to line. It is the "Kv" of hobby
    motors, in rpm per volt of the battery. It is $1/(\sqrt3\, p\, \psi_f)$, with $p$ pole pairs and the flux
    linkage $\psi_f$ of the star equivalent, so $K_t = \frac{\sqrt3}{2}/k_v$."""
    kv_line_to_line_rms: SpeedConstant | None = None  # rad/s/V
    r"""No-load speed per rms voltage from line to line: $\sqrt2$ times the value of `kv`."""
    kv_phase_peak: SpeedConstant | None = None  # rad/s/V
    r"""No-load speed per peak voltage from line to star point: $\sqrt3$ times the value of `kv`."""
    kv_phase_rms: SpeedConstant | None = None  # rad/s/V
    r"""No-load speed per rms voltage from line to star point: $\sqrt6$ times the value of `kv`."""
    K_e_line_to_line_peak: BackEmfConstant | None = None  # V*s/rad
    """Peak back-EMF from line to line per speed: the reciprocal of `kv`."""
    K_e_line_to_line_rms: BackEmfConstant | None = None  # V*s/rad
    """Rms back-EMF from line to line per speed. Datasheets often state it in V per 1000 rpm: write 46 V per
    1000 rpm as `"46 mV/rpm"`."""
    K_e_phase_peak: BackEmfConstant | None = None  # V*s/rad
    r"""Peak back-EMF from line to star point per speed: $p\, \psi_f$, with $p$ pole pairs and the flux
    linkage $\psi_f$ of the star equivalent."""
    K_e_phase_rms: BackEmfConstant | None = None  # V*s/rad
    """Rms back-EMF from line to star point per speed."""
    winding: Literal["star", "delta"] = "star"
    r"""Connection of the windings to which `R_s`, `L_d`, `L_q` and the flux linkages refer. cogless converts
    a delta connection to its star equivalent: a third of the resistance and of the inductances, $1/\sqrt 3$
    of the flux linkages."""
    rated_torque: Torque | None = None  # N*m
    """Rated torque of the motor, only for information."""
    rated_speed: AngularSpeed | None = None  # rad/s
    """Rated speed of the motor, only for information."""
    flux_harmonics: Many[FluxHarmonic] = ()
    """Harmonics of the magnet's flux linkage."""
    torque_ripple: Many[TorqueRipple] = ()
    """Harmonics of the torque constant over the mechanical angle."""
    cogging: Many[Cogging] = ()
    """Harmonics of the cogging torque."""
    cogging_table: CoggingTable | None = None
    """Measured cogging torque over the angle, from a CSV file. It is added to `cogging`."""
    back_emf_table: BackEmfTable | None = None
    """Measured back-EMF over the angle, from a CSV file. It determines the magnet's flux and
    `flux_harmonics`."""
    saturation: Saturation | None = None
    """Flux linkages as functions of the currents. Default: constant inductances. Not possible with a delta
    connection."""
    temperature: MotorTemperature | None = None
    """Temperatures of winding and magnets. Default: resistance and flux remain as given."""

    @model_validator(mode="after")
    def _check_constants(self) -> Self:
        if not self._torque_constants:
            raise invalid(
                'expected a constant of the magnet, such as psi_f = "68 mWb", K_t = "0.4 N*m/A" or kv = "300 '
                'rpm/V"'
            )
        if not self._resistances:
            raise invalid(
                'expected a resistance, such as "1 ohm", or resistance_line_to_line', "R_s", value="missing"
            )
        for axis, other in (("L_d", self.L_q), ("L_q", self.L_d)):
            if getattr(self, axis) is None and (other is not None or self.inductance_line_to_line is None):
                expected = 'expected an inductance, such as "1 mH", or inductance_line_to_line'
                raise invalid(expected, axis, value="missing")
        for word in OF_A_PHASE:
            if self.winding == "delta" and getattr(self, word) is not None:
                raise invalid(
                    "expected a key with line_to_line in its name, since a delta has no star point", word
                )
        measured = self.back_emf_table
        if self.winding == "delta" and measured is not None and measured.between == "phase":
            expected = 'expected "line-to-line", since a delta has no star point'
            raise invalid(expected, "back_emf_table", "between")
        for by_word in (self._torque_constants, self._resistances, self._inductances):
            check_agreement(by_word)
        if self.saturation is not None:
            if self.winding == "delta":
                raise excluded("saturation", "winding", 'winding = "delta"', 'set winding = "star"')
            star = self.star()
            self.saturation.check(star.L_d, star.L_q)
        return self

    @property
    def _factors(self) -> tuple[float, float]:
        """Impedance and flux linkage of the star equivalent over those of a winding."""
        return (1 / 3, 1 / math.sqrt(3)) if self.winding == "delta" else (1.0, 1.0)

    @cached_property
    def _torque_constants(self) -> dict[str, float]:
        """K_t of the star equivalent, N*m/A, by each word for the magnet that is given."""
        flux = self._factors[1]
        magnet_words = {word: value for word in MAGNET if (value := getattr(self, word)) is not None}
        by_word = {word: torque_constant(word, v, self.pole_pairs, flux) for word, v in magnet_words.items()}
        if self.back_emf_table is None:
            return by_word
        psi_f, _ = self.back_emf_table.flux(self.pole_pairs)
        return {**by_word, "back_emf_table": 1.5 * self.pole_pairs * psi_f}

    @property
    def _resistances(self) -> dict[str, float]:
        """Resistance of the star equivalent, ohm, by each word that is given."""
        of_lines = self.resistance_line_to_line
        by_word = {} if self.R_s is None else {"R_s": self._factors[0] * self.R_s}
        return by_word if of_lines is None else {**by_word, "resistance_line_to_line": of_lines / 2}

    @property
    def _inductances(self) -> dict[str, float]:
        """Mean inductance of both axes of the star equivalent, H, by each word that is given."""
        of_lines, impedance = self.inductance_line_to_line, self._factors[0]
        by_word = {}
        if self.L_d is not None and self.L_q is not None:
            by_word["L_d"] = impedance * (self.L_d + self.L_q) / 2
        return by_word if of_lines is None else {**by_word, "inductance_line_to_line": of_lines / 2}

    @classmethod
    def other_word(cls, key: str, value: Any) -> str | None:
        if key in OTHER_WORDS:
            return f"expected the key {OTHER_WORDS[key]} instead"
        if key != "poles":
            return None
        even = isinstance(value, int) and value > 0 and value % 2 == 0
        return f'expected the key "pole_pairs" instead, half of the poles{f": {value // 2}" if even else ""}'

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
        """The result of `star`, computed once."""
        impedance, flux = self._factors
        K_t = next(iter(self._torque_constants.values()))
        L_d, L_q = (
            next(iter(self._inductances.values())) if L is None else impedance * L
            for L in (self.L_d, self.L_q)
        )
        return StarMotor(
            pole_pairs=self.pole_pairs,
            R_s=next(iter(self._resistances.values())),
            L_d=L_d,
            L_q=L_q,
            psi_f=K_t / (1.5 * self.pole_pairs),
            K_t=K_t,
            impedance_factor=impedance,
            flux_factor=flux,
            flux_harmonics=(
                *(h.model_copy(update={"d": flux * h.d, "q": flux * h.q}) for h in self.flux_harmonics),
                *self._measured_flux(),
            ),
            torque_ripple=self.torque_ripple,
            saturation=self.saturation,
            temperature=self.temperature,
            cogging=(*(c.as_torque(K_t) for c in self.cogging), *self._measured_cogging(K_t)),
        )

    def _measured_flux(self) -> list[FluxHarmonic]:
        if self.back_emf_table is None:
            return []
        _, harmonics = self.back_emf_table.flux(self.pole_pairs)
        return [
            FluxHarmonic.model_construct(order=h, d=d, q=q, d_phase=d_phase, q_phase=q_phase)
            for h, d, q, d_phase, q_phase in harmonics
        ]

    def _measured_cogging(self, K_t: float) -> list[CoggingTorque]:
        if self.cogging_table is None:
            return []
        return [CoggingTorque(*harmonic) for harmonic in self.cogging_table.harmonics(K_t, self.pole_pairs)]


@dataclass(frozen=True, kw_only=True)
class StarMotor:
    """A motor's star equivalent, all SI."""

    pole_pairs: int
    R_s: float  # ohm
    L_d: float  # H
    L_q: float  # H
    psi_f: float  # Wb
    K_t: float  # N*m/A
    impedance_factor: float  # R and L of this equivalent over those of one winding
    flux_factor: float  # flux linkage of this equivalent over that of one winding
    flux_harmonics: tuple[FluxHarmonic, ...]
    cogging: tuple[CoggingTorque, ...]
    phases: int = 3
    torque_ripple: tuple[TorqueRipple, ...] = ()
    saturation: Saturation | None = None  # simulated motor only; L_d, L_q and psi_f hold at zero current
    temperature: MotorTemperature | None = None  # simulated motor only; R_s and psi_f hold at its `reference`

    @property
    def power_factor(self) -> float:
        """Electrical power divided by u . i in dq coordinates: 3/2 for three phases, 1 for two."""
        return 0.5 * self.phases


FIRST_COGGING = 4  # j of the first L_fj
MOST_TEETH = 1000
STEPS_IN_A_PERIOD = 4  # full steps in an electrical revolution
STEP_ANGLE_TOLERANCE = 1e-6  # relative


def teeth_of(step_angle: float) -> int:
    """Teeth of a rotor whose full step is this angle, rad; 0: no step motor has this step."""
    count = math.tau / STEPS_IN_A_PERIOD / step_angle if step_angle > 0 else 0.0
    is_whole = math.isclose(count, round(count), rel_tol=STEP_ANGLE_TOLERANCE)
    return round(count) if is_whole and count < MOST_TEETH + 1 else 0


class StepMotor(Table):
    """A step motor, in the words of its datasheet or with the parameters that papers on it use."""

    kind: Literal["step"]
    """A two-phase step motor with non-sinusoidal flux."""
    datasheet: Datasheet | None = None  # its file; its fields are already merged in here
    """Name of a shipped motor (see `cogless list`), or path of a datasheet file relative to the study. Keys
    in the study replace those of the datasheet."""
    teeth: Annotated[int, Field(ge=1, le=MOST_TEETH)] | None = None
    """Number of rotor teeth $N_r$: electrical revolutions in a mechanical revolution. Give `teeth` or
    `step_angle`."""
    step_angle: Angle | None = None  # rad
    r"""Angle of a full step, $2 \pi / (4 N_r)$ with $N_r$ rotor teeth. Give `teeth` or `step_angle`."""
    R_s: Resistance  # ohm
    """Resistance of a phase."""
    L_0: Inductance  # H
    """Mean inductance $L_0$ of a phase."""
    L_1: InductanceAmplitude = 0.0  # H
    """Amplitude $L_1$ of the saliency of a phase's inductance, smaller than `L_0`: $L_d = L_0 + L_1$, $L_q =
    L_0 - L_1$."""
    L_m: Many[InductanceAmplitude] = ()  # H
    r"""Coefficients $L_{m1}, L_{m2}, \ldots$ of the magnet's flux. $L_{m1}$ makes the mean torque: $K_t = N_r
    i_f L_{m1}$ with $N_r$ rotor teeth and the key `i_f`. $L_{mj}$ makes ripple of the electrical order $j -
    1$. Give `L_m` or `holding_torque`."""
    holding_torque: PositiveTorque | None = None  # N*m
    r"""Torque with which the motor holds its position at `rated_current` in both phases. It determines $K_t$
    = `holding_torque` / ($\sqrt2$ `rated_current`). Give `L_m` or `holding_torque`."""
    rated_current: PositiveCurrent | None = None  # A
    """Direct current in each of the two phases at which the motor has its `holding_torque`."""
    L_m_backward: Many[InductanceAmplitude] = ()  # H
    """Coefficients like those of `L_m`, but for flux waves that turn backwards: coefficient number $j$ makes
    ripple of the electrical order $j + 1$. In a symmetric motor, the third harmonic of the flux turns
    backwards: give it as the third coefficient, after two zeros."""
    L_f: Many[InductanceAmplitude] = ()  # H
    r"""Coefficients $L_{f4}, L_{f5}, \ldots$ of the cogging torque; $L_{fj}$ makes cogging of the electrical
    order $j$. Give `L_f` or `detent_torque`."""
    detent_torque: Torque | None = None  # N*m
    """Amplitude of the cogging torque of the electrical order 4. It is $2 N_r i_f^2 L_{f4}$ with $N_r$ rotor
    teeth and the keys `i_f` and `L_f`. The detent torque in a datasheet also contains friction, because it is
    the torque that turns the rotor without current."""
    i_f: PositiveCurrent = 1.0  # A
    """Fictitious current $i_f$ that represents the magnet."""

    @model_validator(mode="after")
    def _one_word_each(self) -> Self:
        expected = 'expected either teeth, such as 50, or step_angle, such as "1.8 deg"'
        check_one(self, ("teeth", "step_angle"), expected, "teeth")
        if self.step_angle is not None and not teeth_of(self.step_angle):
            raise invalid(
                'expected 360 deg divided by four times the number of teeth, such as "1.8 deg"', "step_angle"
            )
        expected = 'expected either L_m, such as ["5 mH"], or holding_torque, such as "0.4 N*m"'
        check_one(self, ("L_m", "holding_torque"), expected, "L_m")
        if self.holding_torque is not None and self.rated_current is None:
            expected = 'expected the direct current of each phase at the holding torque, such as "1.5 A"'
            raise invalid(expected, "rated_current", value="missing")
        if self.L_f and self.detent_torque is not None:
            raise excluded("L_f", "detent_torque")
        return self

    @model_validator(mode="after")
    def _magnet(self) -> Self:
        if self.L_m and self.L_m[0] <= 0:
            raise invalid("expected a first coefficient (L_m1) above zero", "L_m")
        if abs(self.L_1) >= self.L_0:
            raise invalid("expected less than L_0", "L_1")
        return self

    @property
    def pole_pairs(self) -> int:
        """Electrical revolutions in a mechanical one."""
        return self.teeth or teeth_of(self.step_angle or 0.0)  # one of both is given

    @property
    def phases(self) -> int:
        return 2

    @property
    def psi_f(self) -> float:
        """Flux linkage of the magnet, Wb."""
        if self.holding_torque is None or self.rated_current is None:
            return self.i_f * self.L_m[0]
        return self.holding_torque / (math.sqrt(2) * self.rated_current * self.pole_pairs)

    def _flux_harmonics(self) -> list[FluxHarmonic]:
        """A forward wave of the flux has order j - 1 in the rotor's frame, a backward one j + 1."""
        forward = [(j - 1, L, L) for j, L in enumerate(self.L_m[1:], start=2)]
        backward = [(j + 1, L, -L) for j, L in enumerate(self.L_m_backward, start=1)]
        return [
            FluxHarmonic.model_construct(order=order, d=self.i_f * d, q=self.i_f * q)
            for order, d, q in forward + backward
            if d
        ]

    def _cogging(self) -> list[CoggingTorque]:
        teeth = self.pole_pairs
        if self.detent_torque is not None:
            return [CoggingTorque(FIRST_COGGING * teeth, -self.detent_torque)] if self.detent_torque else []
        amplitude = -0.5 * teeth * self.i_f**2
        return [
            CoggingTorque(j * teeth, amplitude * j * L)
            for j, L in enumerate(self.L_f, start=FIRST_COGGING)
            if L
        ]

    def star(self) -> StarMotor:
        """The equivalent two-phase motor for the plant model."""
        return StarMotor(
            pole_pairs=self.pole_pairs,
            R_s=self.R_s,
            L_d=self.L_0 + self.L_1,
            L_q=self.L_0 - self.L_1,
            psi_f=self.psi_f,
            K_t=self.pole_pairs * self.psi_f,
            impedance_factor=1.0,
            flux_factor=1.0,
            flux_harmonics=tuple(self._flux_harmonics()),
            cogging=tuple(self._cogging()),
            phases=self.phases,
        )


def _kind(data: Any) -> str:
    return str(data.get("kind", "pmsm") if isinstance(data, dict) else getattr(data, "kind", "pmsm"))


AnyMotor = Annotated[Annotated[Motor, Tag("pmsm")] | Annotated[StepMotor, Tag("step")], Discriminator(_kind)]
