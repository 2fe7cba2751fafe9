"""Warnings about a controller before it is run, exported, or run on a processor."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from cogless.design import verdict as learning
from cogless.design.commissioning import commissioning_warning
from cogless.design.cures import either, helping
from cogless.design.current_loop import gentler_loop
from cogless.design.current_needed import too_much_current
from cogless.design.feedback import unstable_feedback
from cogless.design.harmonic import BENDS_FROM, learner, least_base, main_order, roomy_base
from cogless.design.map_size import map_warning
from cogless.design.pi import speed_loop
from cogless.design.relay import relay_warning
from cogless.design.slow_running import reads_zero, slow_warning
from cogless.design.summary import CurrentLoopDesign, current_loop_summary, weakest_margins
from cogless.design.turning import late_angle, unstable_turning
from cogless.design.unlearned import foreseen
from cogless.study import AnyStudy, Study, TrialStudy, for_scenario
from cogless.study.harmonic import ORDERS, Harmonic
from cogless.study.motion import course
from cogless.study.numerics import voltage_reach
from cogless.study.reading import Changes
from cogless.study.remark import Remark

RPM = 30 / math.pi


def warnings(study: AnyStudy, scenario: str, name: str) -> list[Remark]:
    """Warnings about a controller and its current loop, one line each, which begins with the study's key."""
    if isinstance(study, TrialStudy):
        from cogless.design.from_study import design_study
        from cogless.design.trial_summary import warnings as trial_warnings

        found = trial_warnings(design_study(study, [(scenario, name)])[scenario, name])
        return [Remark(f"controller.{name}: {line}") for line in found]
    return [
        *loop_remarks(study),
        *(remark.about(f"controller.{name}") for remark in _feedback_and_learning(study, name)),
        *notes(study, name),
    ]


def notes(study: Study, name: str) -> list[Remark]:
    """Warnings of what a law, its map and its sensor cost or leave, one line each, key first."""
    all_of = (
        map_warning,
        slow_warning,
        _less_margin,
        _not_learned,
        _no_room,
        relay_warning,
        commissioning_warning,
    )
    found = (of(study, name) for of in all_of)
    return [remark.about(f"controller.{name}") for remark in found if remark is not None]


def likely_harm(study: Study, name: str) -> str | None:
    """What the design says of why a controller's learning may do harm; None if nothing."""
    found = next(iter(_feedback_and_learning(study, name)), None) or _not_learned(study, name)
    return None if found is None else str(found)


def too_short(study: AnyStudy, runs: Iterable[tuple[str, str]]) -> list[str]:
    """Warnings of scenarios in which a controller will learn nothing; `runs` are (scenario, controller)."""
    if isinstance(study, TrialStudy):
        return []
    pairs = [*runs]
    found = ((scenario, name, foreseen(study, scenario, name)) for scenario, name in pairs)
    tables = ((scenario, _idle_table(study, scenario)) for scenario in dict.fromkeys(s for s, _ in pairs))
    return [
        *(f"controller.{name}: learns nothing in {where}: {why}" for where, name, why in found if why),
        *(f"drive.encoder_table: learns nothing in {where}: {why}" for where, why in tables if why),
    ]


def _idle_table(study: Study, scenario: str) -> str:
    """Why a table of the position sensor's error learns nothing in a scenario; "" if it may, or is none."""
    table, way = for_scenario(study, scenario).drive.encoder_table, course(study.scenario[scenario])
    if table is None:
        return ""
    fast = float(np.sum(np.abs(way.omega) >= table.omega_min)) * way.step
    if not fast:
        return "the reference never reaches omega_min"
    settles = f"its observer settles in {table.settling:.3g} s or more above omega_min"
    return f"{settles}, the reference is there for {fast:.3g} s" if fast <= table.settling else ""


def beyond_drive(study: AnyStudy, scenarios: Iterable[str]) -> list[Remark]:
    """Warnings of references that the drive cannot follow.

    A reference may be too fast for the bus voltage, for the current loop or for the age of the angle, too
    slow for the position sensor, or need more current than the limit.
    """
    if not isinstance(study, Study):
        return []
    all_of = (_out_of_reach, unstable_turning, late_angle, too_much_current, reads_zero)
    found = ((name, of(study, name)) for name in dict.fromkeys(scenarios) for of in all_of)
    return [remark.about(f"scenario.{name}") for name, remark in found if remark is not None]


def _out_of_reach(study: Study, scenario: str) -> Remark | None:
    """A warning of a reference that the bus voltage can't turn the motor at."""
    here, wanted = for_scenario(study, scenario), study.scenario[scenario].top_reference
    most = voltage_reach(here)
    if wanted <= most or here.drive.inverter is None:
        return None
    needs = f"its reference of {wanted * RPM:.4g} rpm needs more voltage than there is"
    volts = here.drive.inverter.bus_voltage
    return Remark(f"{needs}: {volts:.4g} V turn this motor at {most * RPM:.4g} rpm without load")


def _unlearned(study: Study, name: str) -> tuple[list[int], list[int]] | None:
    """The orders of the cogging, and those that a controller doesn't learn; None: its law has no base."""
    law = study.controller[name]
    if not isinstance(law, Harmonic):
        return None
    cogging = sorted(
        {
            wave.order
            for key in study.scenarios_of(name)
            for wave in for_scenario(study, key).motor.star().cogging
            if wave.torque
        }
    )
    told = learner(study, name)
    return cogging, [n for n in cogging if n % told.base or n > told.base * told.orders]


def _not_learned(study: Study, name: str) -> Remark | None:
    """Warning of cogging orders that a controller doesn't learn, with a base with which it learns them."""
    found = _unlearned(study, name)
    if found is None or not found[1]:
        return None
    (cogging, left), told = found, learner(study, name)
    orders = f"order{'s' * (len(left) > 1)} {', '.join(map(str, left))}"
    said = f"it learns orders {told.base} k to {told.base * told.orders}, but the cogging has {orders}"
    needed = math.gcd(*cogging)
    if cogging[-1] > needed * ORDERS:
        return Remark(f"{said}; no base learns all of it with {ORDERS} orders")

    def cured(other: Study) -> bool:
        after = _unlearned(other, name)
        return after is not None and not after[1]

    cures = helping(study, ({f"controller.{name}.base": needed},), cured)
    return Remark(f"{said}; {either(cures)} learns all of it" if cures else said, cures)


def _lacks_room(study: Study, name: str) -> int | None:
    """The smallest base with room to learn a sensor's error; None: the controller's base has that room."""
    here = max((for_scenario(study, key) for key in study.scenarios_of(name)), key=least_base, default=study)
    least = least_base(here)
    return least if learner(study, name).base < least else None


def _no_room(study: Study, name: str) -> Remark | None:
    """Warning of a base without room to learn an eccentric sensor's error."""
    if not isinstance(study.controller[name], Harmonic):
        return None
    least = _lacks_room(study, name)
    if least is None:
        return None
    here = max((for_scenario(study, key) for key in study.scenarios_of(name)), key=least_base, default=study)
    roomy = roomy_base(here)
    often = "twice" if least > 1 + BENDS_FROM[0] else "once"
    base = learner(study, name).base
    told = f"base {base} leaves no room to learn what the sensor's angle is off {often} a turn"
    change: Changes | None = {f"controller.{name}.base": roomy} if roomy >= least else None
    cures = helping(study, (change,), lambda other: _lacks_room(other, name) is None)
    if not cures:
        return Remark(f"{told}, which takes one of {least} or more")
    cogging = sorted({wave.order for wave in here.motor.star().cogging if wave.torque and wave.order % roomy})
    but = f", but not order{'s' * (len(cogging) > 1)} {', '.join(map(str, cogging))} of the cogging"
    return Remark(f"{told}; {either(cures)} does{but if cogging else ''}", cures)


def coarse_table(study: AnyStudy) -> list[str]:
    """A warning of a table of the cogging with too few points for the main order of slots and poles."""
    table = getattr(study.motor, "cogging_table", None)
    if not isinstance(study, Study) or table is None:
        return []
    main, highest = main_order(study, 0), table.highest(study.motor.pole_pairs)
    if main <= highest:
        return []
    tells = f"its {table.points} points tell orders to {highest}, the main one is {main}"
    return [f"motor.cogging_table: {tells}, which shows as a lower one"]


def shaft_notes(study: Study) -> list[str]:
    """Where a soft shaft swings, and what the design makes of it; empty if there is none."""
    shaft = speed_loop(study).shaft
    if shaft is None:
        return []
    low, high = (w / (2 * math.pi) for w in (shaft.antiresonance, shaft.resonance))
    gap = study.mechanics.load_side is not None and study.mechanics.load_side.backlash > 0
    return [
        f"mechanics.load_side: antiresonance {low:.4g} Hz, resonance {high:.4g} Hz; rules tune for "
        f"both masses as one, margins are with the shaft{', its gap closed' if gap else ''}"
    ]


def _less_margin(study: Study, name: str) -> Remark | None:
    """A warning if a tuned loop has less phase margin with its soft shaft than its rule asks for."""
    tuning = getattr(study.controller[name], "tuning", None)
    if tuning is None or speed_loop(study).shaft is None:
        return None
    found = weakest_margins(study, name)
    if found is None or not found.stable or found.phase_margin > 0.9 * tuning.phase_margin:
        return None
    has, asked = math.degrees(found.phase_margin), math.degrees(tuning.phase_margin)
    at = found.crossover / (2 * math.pi)
    margin = f"its phase margin is {has:.3g} deg at {at:.4g} Hz, not {asked:.3g} deg"
    return Remark(f"with the soft shaft {margin}")


def loop_remarks(study: Study) -> list[Remark]:
    """Warnings of a current loop that is unstable or weak, with the least change that mends it."""
    lines = loop_warnings(current_loop_summary(study))
    cures = gentler_loop(study) if lines else ()
    would = f"; {either(cures, 'drive.current_loop')} would do" if cures else ""
    return [Remark(f"{line}{would}", cures) for line in lines]


def loop_warnings(loops: dict[str, CurrentLoopDesign]) -> list[str]:
    """Warnings of a current loop that is unstable or weak, one line each."""
    found = []
    for name, loop in told_apart(loops).items():
        if not loop.margins.stable:
            found.append(f"drive.current_loop: the {name} is unstable, and every speed loop around it")
        elif loop.weakness:
            found.append(f"drive.current_loop: the {name} is weak, it {loop.weakness} of phase margin")
    return found


def told_apart(loops: dict[str, CurrentLoopDesign]) -> dict[str, CurrentLoopDesign]:
    """The current loops by name for messages; a single entry if both axes are alike."""
    if not loops:
        return {}
    if loops["d"].margins == loops["q"].margins and loops["d"].gains == loops["q"].gains:
        return {"current loop": loops["q"]}
    return {f"current loop, {axis}": loop for axis, loop in loops.items()}


def _feedback_and_learning(study: Study, name: str) -> list[Remark]:
    if learning.loop_type(study.controller[name]) is not None:
        return learning.warnings(study, name)
    unstable = unstable_feedback(study, name)
    if not unstable:
        return []
    remedy = learning.steadier(study, name)
    return [Remark(unstable if remedy is None else f"{unstable}; {remedy}", remedy.cures if remedy else ())]
