"""The current loop of one axis, sampled with period T_c, as the drive runs it.

G is the open loop of the winding R, L and the PI controller of control/src/cogless/foc.c, whose integral is
forward Euler. The voltage acts `delay` periods after the current was sampled. G is exact for the averaged
inverter at standstill:

    G = (kp + ki T_c / (z - 1)) z^-delay (1 - a) / (R (z - a)),    a = exp(-R T_c / L),    z = exp(jw T_c)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from cogless.design.cures import either, first, helps, text
from cogless.design.margins import Complex, Margins, Real, margins_of
from cogless.errors import StudyError
from cogless.study import Study, for_scenario
from cogless.study.drive import IdealCurrentLoop
from cogless.study.error_messages import dotted, shown
from cogless.study.position_sensor import Counted
from cogless.study.reading import Changes
from cogless.units import unit_of

FACTORS = (2.0, 4.0, 8.0)  # of gains and bandwidths that are tried
SLOWER_FACTORS = (*FACTORS, 16.0, 32.0, 64.0)  # by which the gains of the current loop are divided
LEAST_MARGIN = 20  # deg, that a rule takes
RATE_SHARE = 0.05  # of the loop's rate: a bandwidth at which its delay of 1.5 periods costs 27 deg
LEAST = math.radians(30)  # smallest phase margin with which it is good enough for a speed loop
Tuned = TypeVar("Tuned")


class NoMarginError(ValueError):
    """No gains give a loop the phase margin that a tuning rule asks for."""

    def __init__(self) -> None:
        super().__init__("expected a loop that some gains give this phase margin")


@dataclass(frozen=True, kw_only=True)
class CurrentLoop:
    """Winding and current controller of one axis."""

    kp: float  # V/A
    ki: float  # V/A/s
    R: float  # ohm
    L: float  # H
    period: float  # s
    delay: int  # periods, from sampling the current to the voltage

    def response(self, w: Real) -> Complex:
        """The open loop G(jw), w in rad/s."""
        z = np.exp(1j * w * self.period)
        x = self.R * self.period / self.L
        gain = self.period / self.L * (-math.expm1(-x) / x if x > 0 else 1.0)
        pi = self.kp + self.ki * self.period / (z - 1)
        return np.asarray(pi * gain / (z - math.exp(-x)) / z**self.delay)

    def margins(self) -> Margins:
        """Margins of the open loop G."""
        return _margins(self)


@lru_cache(maxsize=16)  # called for every controller, at every speed
def _margins(loop: CurrentLoop) -> Margins:
    integrators = (loop.ki > 0) + (loop.R == 0 and loop.kp + loop.ki > 0)
    return margins_of(loop.response, loop.period, integrators)


@dataclass(frozen=True)
class IdealLoop:
    """An ideal current loop: the current equals its reference. Only the loop's period is needed."""

    period: float  # s


def current_loops(study: Study, scenario: str | None = None) -> dict[str, CurrentLoop]:
    """Loops of the q and d axes, with the motor that the controller assumes or with a scenario's true motor.

    The result is empty if the current loop is ideal.
    """
    study_here = study if scenario is None else for_scenario(study, scenario)
    drive = study_here.drive
    loop, inverter, T = drive.current_loop, drive.inverter, 1 / drive.rates.current_loop
    if isinstance(loop, IdealCurrentLoop) or inverter is None:
        return {}
    belief = drive.belief.resolved(study.motor.star())
    motor = belief if scenario is None else study_here.motor.star()
    gains, delay = loop.gains(belief), inverter.computation_delay
    return {
        "q": CurrentLoop(kp=gains["kp_q"], ki=gains["ki_q"], R=motor.R_s, L=motor.L_q, period=T, delay=delay),
        "d": CurrentLoop(kp=gains["kp_d"], ki=gains["ki_d"], R=motor.R_s, L=motor.L_d, period=T, delay=delay),
    }


def weakness(margins: Margins) -> str | None:
    """The reason, in words, why a current loop isn't good enough for a speed loop; None if it is."""
    if not margins.stable:
        return "is unstable"
    if margins.phase_margin < LEAST:
        return f"has {math.degrees(margins.phase_margin):.1f} deg"
    return None


def tuned(study: Study, name: str, rule: Callable[[Study], Tuned]) -> Tuned:
    """The gains that a controller's tuning rule gives.

    StudyError: the current loop is too weak for the rule, or the rule raises NoMarginError. The error
    advises the least change of loop or margin with which the rule gives gains.
    """
    for axis, loop in current_loops(study).items():
        wrong = weakness(loop.margins())
        if wrong:
            raise _too_weak(study, f"to tune controller.{name} around it; its {axis} axis {wrong}")
    try:
        return rule(study)
    except NoMarginError as error:
        raise _no_margin(study, name, rule, str(error)) from None


def _too_weak(study: Study, what: str) -> StudyError:
    given, key = study.source.tables["drive"]["current_loop"], "drive.current_loop"
    wrong = " and ".join(f"{key}.{each}: {shown(given[each])}" for each in _present(study))
    expected = f"expected {math.degrees(LEAST):.0f} deg of phase margin or more {what}"
    cures = gentler_loop(study)
    way = f"; {either(cures, key)} would do" if cures else ""
    return StudyError(f"{study.source.path}: {wrong}: {expected}{way}").advising(*cures)


def gentler_loop(study: Study) -> tuple[Changes, ...]:
    """The least change that makes the current loop good enough for a speed loop, as one or none.

    It divides the gains, or puts a bandwidth in their place.
    """
    bandwidth = text(RATE_SHARE * study.drive.rates.current_loop, "Hz")
    others = [f"drive.current_loop.{key}" for key in _present(study) if key != "bandwidth"]
    slower = [*slower_loop(study), {"drive.current_loop.bandwidth": bandwidth, **dict.fromkeys(others)}]
    return first(study, slower, lambda other: not _weak(other))


def slower_loop(study: Study) -> list[Changes]:
    """Smaller gains of the current loop, or a smaller bandwidth, the least change first."""
    given, present = study.source.tables["drive"]["current_loop"], _present(study)
    return [
        {f"drive.current_loop.{each}": _divided(given[each], factor) for each in keys}
        for keys in (present, [each for each in present if each == "ki"])
        for factor in SLOWER_FACTORS
        if keys
    ]


def _present(study: Study) -> list[str]:
    """The keys that give the current loop its gains."""
    given = study.source.tables["drive"]["current_loop"]
    return [each for each in ("kp", "ki", "bandwidth") if each in given]


def _no_margin(study: Study, name: str, rule: Callable[[Study], object], why: str) -> StudyError:
    """The error for a rule that finds no gains, with changes with which the rule finds some."""

    def cured(other: Study) -> bool:
        if _weak(other):
            return False
        try:
            rule(other)
        except NoMarginError:
            return False
        return True

    key = dotted(("controller", name, "tuning"))
    ways = [first(study, tried, cured) for tried in _faster(study)]
    softer = _softer(study, name, cured)
    cures = (*(cure for way in ways for cure in way), *([softer] if softer is not None else []))
    would = f"; {either(cures)} would do" if cures else ""
    return StudyError(f"{study.source.path}: {key}: {why}{would}").advising(*cures)


def _faster(study: Study) -> Iterator[list[Changes]]:
    """Lists of changes that take lag out of the loop; each list begins with the smallest change."""
    drive, tables = study.drive, study.source.tables["drive"]
    sensor = drive.position_sensor
    given = tables["current_loop"]
    if "bandwidth" in given:
        yield [{"drive.current_loop.bandwidth": _divided(given["bandwidth"], 1 / up)} for up in FACTORS]
    if isinstance(sensor, Counted) and sensor.observer_bandwidth:
        key, value = "drive.position_sensor.observer_bandwidth", sensor.observer_bandwidth
        yield [{key: text(value * up, "Hz")} for up in FACTORS]
    if drive.speed_filter:
        yield [{"drive.speed_filter": text(drive.speed_filter * up, "Hz")} for up in FACTORS]
    if isinstance(sensor, Counted) and sensor.speed_method == "average":
        key, window = "drive.position_sensor.window", sensor.window
        yield [{key: max(1, int(window / up))} for up in FACTORS if window > 1]


def _softer(study: Study, name: str, cured: Callable[[Study], bool]) -> Changes | None:
    """The largest phase margin, in whole degrees, that the rule can reach; None if it reaches none."""
    tuning = getattr(study.controller[name], "tuning", None)
    if tuning is None:
        return None
    key = dotted(("controller", name, "tuning", "phase_margin"))

    def change(degrees: int) -> Changes:
        return {key: f"{degrees} deg"}

    low, high = LEAST_MARGIN, math.ceil(math.degrees(tuning.phase_margin))
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if helps(study, change(middle), cured) else (low, middle)
    return change(low) if low > LEAST_MARGIN else None


def _weak(study: Study) -> bool:
    """Whether the current loop of one axis is too weak for a speed loop around it."""
    return any(weakness(loop.margins()) for loop in current_loops(study).values())


def _divided(value: Any, factor: float) -> Any:
    """A value divided by a factor; the value is a number, or a text of number and unit."""
    if isinstance(value, str):
        unit = unit_of(value)
        return f"{float(value.removesuffix(unit)) / factor:.3g} {unit}"
    return float(f"{value / factor:.3g}")
