"""Laws that learn over the angle (Verrelli 2016): law (6) and its sampled form for position, law (4) for
speed."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from cogless import units
from cogless.control_library import real_number
from cogless.study.laws.law import (
    FEWEST_SAMPLES,
    LINE_SAMPLES_MOST,
    AutoTuning,
    Cells,
    LawLoop,
    LearnsWhileRunning,
    StudyOfLaws,
    Tuning,
    check_cells,
)
from cogless.study.table import (
    CurrentBound,
    LawSpeed,
    Quantity,
    RateGain,
    SpeedGain,
    SpeedIntegralGain,
    StartTime,
    Table,
    check_precision,
    excluded,
    invalid,
)
from cogless.units import TURN

LEARNS_NEVER = 1e18  # s, a time of learning that never comes
ANGLE_MAX = real_number("CGL_ANGLE_MAX")  # rad
MOST_PARTS = 65535  # largest denominator of a period in revolutions of the law's angle
Whole = Annotated[int, Field(ge=1, le=65535)]


class Period(Table):
    """The period of what is learned: turns / parts of an electrical or mechanical revolution."""

    of: Literal["electrical", "mechanical"] = "electrical"
    """Whether `turns` counts electrical or mechanical revolutions."""
    turns: Whole = 1
    """Numerator of the period's length: the ripple repeats after `turns`/`parts` revolutions."""
    parts: Whole = 1
    """Denominator of the period's length: the ripple repeats after `turns`/`parts` revolutions."""

    @property
    def description(self) -> str:
        """The period's length in words, such as "1/6 of one electrical revolution"."""
        share = f"{self.turns}/{self.parts} of " if (self.turns, self.parts) != (1, 1) else ""
        return f"{share}one {self.of} revolution"

    def revolutions(self, pole_pairs: int) -> Fraction:
        """Length of the period in mechanical revolutions."""
        return Fraction(self.turns, self.parts * (pole_pairs if self.of == "electrical" else 1))


class SpaceLearning(LearnsWhileRunning):
    """The memory of a law that learns over the angle."""

    learning: bool = True
    """True: the law learns. False: only its feedback acts."""
    period: Period = Period()
    """Period after which the ripple repeats, as a part or a multiple of a revolution."""
    memory: Literal["map", "delay"] = "map"
    r"""Where the law stores the learned functions $\alpha$, $\beta$ and $h$. `"map"`: in a map over the
    angle. `"delay"`: in a delay line over time, from which the law reads what it stored the time $P_t$ ago.
    In this time the angle has risen by one period of the ripple."""
    delay_method: Literal["ode", "inversion"] = "ode"
    r"""How the law computes the delay $P_t$ of the delay line. `"inversion"`, the more exact method: it
    solves $\theta(t - P_t) = \theta(t) - T$ for $P_t$, with the angle $\theta$ over which the law learns and
    the period $T$. `"ode"`: by the differential equation in Section 5 of [Verrelli
    2016](/studies/verrelli2016.md)."""
    k_pp: Annotated[float, Quantity(units.RATE, ">", bare=True)] = 10.0  # 1/s
    """Rate at which errors of the delay $P_t$ decay with `delay_method = "ode"`. It must be below the rate
    `speed_loop` in Hz."""
    cells: Cells = 1024
    """With `memory = "map"`: number of entries of the map, at most 65535. With `"delay"`: largest number of
    speed-loop samples that a period may have."""
    q_half_width: Annotated[int, Field(ge=0)] = 5
    """Half width of the [Q filter](/theory/learning-in-angle.md#q-filter), which averages each entry of the
    map, or each sample of the delay line, with this many neighbours on each side. 0: no Q filter."""
    # learning gains of alpha, beta and h; rad in their units refers to the angle that the law uses
    mu_alpha: Annotated[float, Quantity(units.CURRENT, ">=", bare=True)] = 0.0  # A
    r"""Learning gain of $\alpha$, the learned current that depends only on the angle. 0: $\alpha$ is not
    learned."""
    mu_beta: Annotated[float, Quantity(units.SPEED_LEARNING, ">=", bare=True)] = 0.0  # A*s^2/rad^2
    r"""Learning gain of $\beta$. The learned current contains $\beta$ times the speed. 0: $\beta$ is not
    learned."""
    mu_h: Annotated[float, Quantity(units.ACCELERATION_LEARNING, ">=", bare=True)] = 0.0  # A*s^4/rad^2
    """Learning gain of $h$. The learned current contains $h$ times the acceleration. 0: $h$ is not
    learned."""
    alpha_limit: CurrentBound | None = None  # A
    r"""Largest magnitude of the learned function $\alpha$, a current. Default: `current_limit` of the
    drive."""
    beta_limit: Annotated[float, Quantity(units.SPEED_GAIN, ">", bare=True)] | None = None  # A*s/rad
    r"""Largest magnitude of the learned function $\beta$, current per speed. Default: `current_limit` divided
    by the largest reference speed in the scenarios."""
    h_limit: Annotated[float, Quantity(units.CURRENT_PER_ACCELERATION, ">", bare=True)] | None = None
    """Largest magnitude of the learned function $h$, current per acceleration. Default: `current_limit`
    divided by the largest reference acceleration in the scenarios."""
    omega_min: LawSpeed = 0.01  # rad/s
    """Speed below which the law does not learn. What it has learned still acts."""

    @model_validator(mode="after")
    def _cells_fit(self) -> Self:
        check_cells(self.cells, self.q_half_width, self.memory == "delay")
        return self

    @model_validator(mode="after")
    def _learns_something(self) -> Self:
        if self.learning and not (self.mu_alpha or self.mu_beta or self.mu_h):
            raise invalid(
                "expected false, since mu_alpha, mu_beta and mu_h are zero; or set one of them above zero",
                "learning",
            )
        return self

    @property
    def learns(self) -> bool:
        return self.learning

    @property
    def learns_from(self) -> float:
        return super().learns_from if self.learning else LEARNS_NEVER

    @property
    def over_angle(self) -> bool:
        """Whether the memory is a map over the angle; if not, it is a delay line over time."""
        return self.memory == "map"

    def revolutions(self, pole_pairs: int) -> Fraction:
        """Length of the learned period in mechanical revolutions."""
        return self.period.revolutions(pole_pairs)

    learns_functions: ClassVar[bool] = True
    LEARNING_GAINS: ClassVar[tuple[str, ...]] = ("mu_alpha", "mu_beta", "mu_h")

    @property
    def channels(self) -> int:
        """Number of stored functions of the angle: 1 for alpha, 2 for alpha and beta, 3 with h, too."""
        return 3 if self.mu_h else 2 if self.mu_beta else 1

    @property
    def unrecorded(self) -> frozenset[str]:
        absent = ("term_beta", "term_h")[self.channels - 1 :]
        return frozenset((*absent, *(() if self.memory == "delay" else ("P_t",))))

    @property
    def period_words(self) -> str:
        return self.period.description

    @property
    def uses_path(self) -> bool:
        return True

    @property
    def rests_below(self) -> float:
        return self.omega_min

    @property
    def uses_acceleration(self) -> bool:
        return self.mu_h > 0

    def functions_learned(self, accelerates: bool) -> int:
        gains = (self.mu_alpha, self.mu_beta, self.mu_h if accelerates else 0.0)
        return max(1, sum(gain > 0 for gain in gains))

    @property
    def idle_keys(self) -> frozenset[str]:
        if not self.learning:
            return frozenset({*SpaceLearning.model_fields, "ramp"})
        return frozenset() if (self.memory, self.delay_method) == ("delay", "ode") else frozenset({"k_pp"})

    def check(self, study: StudyOfLaws, name: str) -> None:
        """Check that the learned period suits the motor and the speeds, and that a delay line is long enough.

        A delay line also needs a reference speed that doesn't come near zero.
        """
        rate, pole_pairs = study.drive.rates.outer_loop, study.motor.pole_pairs
        revolutions = self.revolutions(pole_pairs)
        self._check_numbers(study, name)
        _check_angles(name, revolutions, self.ratio(pole_pairs))
        if self.by_rotor and (1 / revolutions).denominator != 1:
            expected = "expected a whole number of periods in a revolution of the rotor, not a period of"
            raise invalid(f"{expected} {float(revolutions):.4g} revolutions", "controller", name, "period")
        for key in study.scenarios_of(name) if self.learning else ():
            scenario = study.scenario[key]
            top, turn = scenario.top_reference, TURN * float(revolutions)
            if top > 0 and rate * turn / top < FEWEST_SAMPLES:
                samples = rate * turn / top
                expected = (
                    f"expected a longer period: at the top speed of scenario {key} it has {samples:.3g} "
                )
                needed = f"samples, but needs {FEWEST_SAMPLES}"
                raise invalid(expected + needed, "controller", name, "period")
            if self.memory == "delay":
                self._check_delay_line(name, key, scenario.speeds[0], rate * turn)

    def _check_numbers(self, study: StudyOfLaws, name: str) -> None:
        """Check that the numbers fit the controller's number type, and k_pp is below the law's rate."""
        # `terms`: the Q filter adds up this many entries
        check_precision(self, study.drive.precision, "controller", name, terms=2 * self.q_half_width + 2)
        rate = study.drive.rates.outer_loop
        if self.memory == "delay" and self.delay_method == "ode" and self.k_pp >= rate:
            expected = f"expected less than drive.rates.speed_loop, {rate:g} Hz"
            raise invalid(expected, "controller", name, "k_pp")

    def _check_delay_line(self, name: str, scenario: str, slowest: float, reach: float) -> None:
        if slowest < self.omega_min:
            expected = (
                f'expected "map": the reference of scenario {scenario} slows down to {slowest:.4g} rad/s, '
            )
            needed = f"but a delay line needs omega_min, {self.omega_min:g} rad/s, or more"
            raise invalid(expected + needed, "controller", name, "memory")
        samples = math.ceil(reach / slowest)
        if samples > LINE_SAMPLES_MOST:
            expected = f'expected "map": a period at the slowest speed of scenario {scenario} has {samples} '
            needed = f"samples, but a delay line holds at most {LINE_SAMPLES_MOST}"
            raise invalid(expected + needed, "controller", name, "memory")
        if samples > self.cells:
            expected = (
                f"expected {samples} or more, the number of samples in a period at the slowest speed of "
                "scenario"
            )
            raise invalid(f"{expected} {scenario}", "controller", name, "cells", value=self.cells)

    def memory_config(self, loop: LawLoop) -> dict[str, Any]:
        """Members of the C struct cgl_memory_config."""
        period = self.ratio(loop.pole_pairs) * self.revolutions(loop.pole_pairs)
        limits = (self.alpha_limit, self.beta_limit, self.h_limit)
        return {
            "kind": "CGL_MEMORY_ANGLE" if self.over_angle else "CGL_MEMORY_DELAY",
            "channels": self.channels,
            "cells": self.cells,
            "turns": period.numerator,
            "parts": period.denominator,
            "q_half_width": self.q_half_width,
            "lead": 0,
            "forgetting": 1.0,
            "limit": limits[: self.channels],
            "method": f"CGL_DELAY_{self.delay_method.upper()}",
            "k_pp": self.k_pp,
        }


def _check_angles(name: str, revolutions: Fraction, ratio: int) -> None:
    """Check that the reference angle stays within the range of the controller.

    The controller counts this angle up to the smallest whole number of revolutions that is also a whole
    number of learned periods.
    """
    longest = int(ANGLE_MAX / (TURN * ratio))
    if revolutions.numerator > longest:
        raise invalid(
            f"expected a period of which a whole number fits into {longest} revolutions or fewer: this one "
            f"needs {revolutions.numerator}",
            "controller",
            name,
            "period",
        )
    if (ratio * revolutions).denominator > MOST_PARTS:
        raise invalid(f"expected at most {MOST_PARTS} parts", "controller", name, "period")


MECHANICAL = {"period": {"of": "mechanical"}, "mu_alpha": 1.0, "cells": 1024, "q_half_width": 0}


class SpacePosition(SpaceLearning):
    """Position control that learns in angle, with hand-over from integral action (Verrelli 2016, law 6)."""

    law: Literal["space-position"]
    """Position control that learns over the angle."""
    frame: Literal["electrical", "mechanical"] = "electrical"
    """Angles and speeds to which the gains of the law apply. `mechanical`: those of the rotor. `electrical`:
    those of the rotor times the pole pairs."""
    k_theta: RateGain | None = None  # 1/s
    """Position gain: speed per angle error. Give `k_theta` and `k_omega`, or `tuning`."""
    k_omega: SpeedGain | None = None  # A*s/rad
    """Speed gain: current per speed error. Give `k_theta` and `k_omega`, or `tuning`."""
    k_i: SpeedIntegralGain = 0.0  # A/rad
    """Integral gain: current per integral of a sum, namely the speed error plus `k_theta` times the angle
    error."""
    tuning: Tuning | None = None
    """[Rule](/theory/learning-in-angle.md#a-fair-pi) that computes `k_theta`, `k_omega` and `k_i`."""
    k_v: SpeedIntegralGain = 0.0  # A/rad
    """Gain of an additional current that is proportional to the angle error."""
    v_0: SpeedGain = 0.0  # A*s/rad
    r"""Constant part $v_0$ of the additional speed gain $v = v_0 + v_2\,\omega^2$ at the speed $\omega$
    ([equations](/laws/space-position.md#equations))."""
    v_2: Annotated[float, Quantity(units.CUBIC_SPEED_GAIN, ">=", bare=True)] = 0.0  # A*s^3/rad^3
    r"""Factor $v_2$ in the additional speed gain $v = v_0 + v_2\,\omega^2$ at the speed $\omega$
    ([equations](/laws/space-position.md#equations))."""
    hand_over: bool = True
    """True: the integral of the feedback fades out while learning fades in. False: the integral keeps
    acting."""
    ramp: StartTime = 1.0  # s
    """Time from `learning_start` on in which learning fades in and, with `hand_over`, the integral of the
    feedback fades out."""
    index: Literal["reference", "rotor"] = "reference"
    """Angle over which the law stores what it learns: the angle of the `reference` or the measured angle of
    the `rotor`."""

    AUTOMATIC: ClassVar[dict[str, Any]] = {"frame": "mechanical", "hand_over": False, **MECHANICAL}

    @property
    def holds_position(self) -> bool:
        return True

    @model_validator(mode="after")
    def _gains_or_rule(self) -> Self:
        gains = [key for key in ("k_theta", "k_omega") if getattr(self, key) is not None]
        if gains and self.tuning is not None:
            raise excluded("tuning", gains[0], instead=f"delete {' and '.join(gains)}")
        if len(gains) == 1 or not (gains or self.tuning):
            rule = '{ rule = "phase-margin", phase_margin = "60 deg" }'
            raise invalid(f"expected either k_theta and k_omega or tuning, such as {rule}")
        return self

    @property
    def by_rotor(self) -> bool:
        return self.index == "rotor"

    def ratio(self, pole_pairs: int) -> int:
        return pole_pairs if self.frame == "electrical" else 1

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        same = {"k_theta", "k_omega", "k_i", "k_v", "v_0", "v_2", "mu_alpha", "mu_beta", "mu_h"}
        return {
            **self.model_dump(include=same | {"hand_over", "ramp", "omega_min"}),
            "ratio": self.ratio(loop.pole_pairs),
            "index": f"CGL_SPACE_BY_{self.index.upper()}",
            "limit": loop.current_limit,
            "memory": self.memory_config(loop),
        }


class SpaceSpeed(SpaceLearning):
    """Speed control that learns in angle (Verrelli 2016, law 4); all of its quantities are mechanical."""

    law: Literal["space-speed"]
    """Speed control that learns over the rotor's angle."""
    k: SpeedGain  # A*s/rad
    """Gain of the feedback: current per speed error."""
    eta_bar: LawSpeed  # rad/s
    """Speed error above which the law does not learn."""
    tuning: AutoTuning | None = None
    """`{ rule = "auto" }`: [a rule](/laws/auto.md) computes each number of the law that the controller's
    table leaves out. Default: no rule."""

    AUTOMATIC: ClassVar[dict[str, Any]] = {"k": 0.0, "eta_bar": 1.0, **MECHANICAL}

    @property
    def linear(self) -> tuple[float, float]:
        return self.k, 0.0

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        same = {"k", "mu_alpha", "mu_beta", "mu_h", "eta_bar", "omega_min"}
        return {
            **self.model_dump(include=same),
            "limit": loop.current_limit,
            "ratio": self.ratio(loop.pole_pairs),
            "memory": self.memory_config(loop),
        }
