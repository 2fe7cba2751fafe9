"""Warnings about a controller before it is run, exported, or run on a processor.

Whether a position sensor's edges come often enough for the loop around them.

docs/theory/sensors.md#few-edges derives it. Let edges come every T_e, longer than a sample T. A speed timed
from edge to edge is then T_e late, where speed_loop.py assumes T / 2. This costs w_c (T_e - T / 2) of the
phase margin at the crossover w_c. A speed from counts over a fixed time then consists of single counts. If
w_c T_e is above one, the rotor coasts from one count to the next.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from cogless.design import verdict as learning
from cogless.design.back_emf import back_emf_warning
from cogless.design.changes import SPEED_RESERVE, cure_words, either, first, helping, unit_text
from cogless.design.closed_loop import Linear, position_margins
from cogless.design.current_needed import noisy_currents, noisy_voltage, starts_after, too_much_current
from cogless.design.detent import Swing, snaps, stop_claim, swing, turns_from
from cogless.design.gentler import (
    finer_sensor,
    slower_feedback,
    slower_proportional,
    timed_edges,
    younger_speeds,
)
from cogless.design.law_rules import feedback_of, rules_of, unstable_feedback
from cogless.design.laws.harmonic import main_order
from cogless.design.margins import Margins, Real
from cogless.design.ripple import Sampled, counting, sampled
from cogless.design.speed_loop import SpeedLoop, gentler_loop, speed_loop
from cogless.design.summary import CurrentLoopDesign, current_loop_summary, weakest_margins
from cogless.design.turning import late_angle, unstable_turning
from cogless.design.unlearned import foreseen, map_warning
from cogless.study import Study, for_scenario
from cogless.study.base import speed_text
from cogless.study.messages import dotted
from cogless.study.motion import Course, course
from cogless.study.motor import StepMotor
from cogless.study.numerics import voltage_reach
from cogless.study.position_sensor import Counted
from cogless.study.reading import Changes, Remark, Stop
from cogless.units import RPM, TURN

SLOW_TIME_SHARE = (
    0.05  # of the time in motion: speeds that are lower only for less time than this are ignored
)
DELAY_MARGIN_SHARE = 0.5  # share of the phase margin that a delay may use
COASTING_ANGLE = 1.0  # rad
SPEED_COUNTS_LEAST = 0.5  # counts in a speed sample: with fewer, most samples have none
CURED_RATIO = 0.9  # ripple with a change that is advised / without it, at most
# The same ratio for a slower feedback, which lets more of the cogging through. In 30 random drives a ratio of
# .2 or more came out up to 1.4 times as large as predicted (benchmarks/slow_feedback.py).
LESS_BY_FEEDBACK = 0.7
STARTED_SHARE = 0.5  # of a run: by then a feedback that is advised turns a rotor that rests


def slow_warning(study: Study, name: str) -> Remark | None:
    """Warning that the rotor turns unevenly at the slowest speed of a controller; None if it turns evenly.

    Either the rotor snaps from detent to detent, or the sensor's edges come too rarely.
    """
    keys = study.scenarios_of(name)
    for key in keys:
        remark = _snapping(study, name, key) or _few_edges(study, name, key)
        if remark is not None:
            return remark.with_key(f"in scenario {key}") if len(keys) > 1 else remark
    return None


def _snapping(study: Study, name: str, scenario: str) -> Remark | None:
    """Warning of a rotor that snaps, with the speed from which on it turns if there is one.

    A law that begins with a learned map does not depend on its feedback alone, and gets no warning.
    """
    law, omega = study.controller[name], slowest_held_speed(study, scenario)
    stopping = _stopping(study, name, scenario)
    if (law.learned and not law.learns) or law.begins_with is not None or stopping is None:
        return None
    feedback, swinging = stopping
    sentence = snaps(
        study, swinging, omega, position_margins(speed_loop(study, scenario), feedback).crossover
    )
    begins = turns_from(study, scenario, feedback, omega)
    turning = swing(study, scenario, feedback, begins) if begins is not None else None
    if begins is None or turning is None or not turning.is_certain:
        return Remark(sentence, stop=Stop(scenario, stop_claim(swinging)))
    turns = f"; at {speed_text(study, SPEED_RESERVE * begins, 2)} and above the rotor does not stop"
    cure: Changes = {dotted(("scenario", scenario, "reference")): unit_text(SPEED_RESERVE * begins, "rad/s")}
    cures = (cure,) if study.scenario[scenario].reference.kind == "constant" else ()
    return Remark(sentence + turns, cures, Stop(scenario, stop_claim(swinging), turns))


def turning_speed(study: Study, name: str, scenario: str) -> float | None:
    """The speed, rad/s, from which on the detents do not stop the rotor under a controller, with a reserve.

    None if the detents do not stop it at the scenario's slowest speed, or stop it at every speed.
    """
    stopping = _stopping(study, name, scenario)
    if stopping is None:
        return None
    begins = turns_from(study, scenario, stopping[0], slowest_held_speed(study, scenario))
    return None if begins is None else SPEED_RESERVE * begins


def _stopping(study: Study, name: str, scenario: str) -> tuple[Linear, Swing] | None:
    """The feedback and the swing that stops the rotor at a scenario's slowest speed; None if it turns."""
    omega = slowest_held_speed(study, scenario)
    feedback = feedback_of(study, name, omega)
    if feedback is None or not omega:
        return None
    swinging = swing(study, scenario, feedback, omega)
    return (feedback, swinging) if swinging is not None and swinging.stops else None


@dataclass(frozen=True)
class _Edges:
    """A sensor's edges at the slowest speed of a scenario, and a loop around them."""

    omega: float  # rad/s
    source: Sampled
    loop: SpeedLoop
    feedback: Linear
    margins: Margins
    late_margins: Margins  # with the speed as late as its edges are
    swing: float  # rad/s rms, speed ripple by orders of torque and sensors
    late_swing: float  # rad/s rms, that ripple with a speed as late as its edges

    @property
    def time(self) -> float:
        """Time from edge to edge, s."""
        return self.source.count / self.omega

    @property
    def late(self) -> float:
        """Time by which a timed speed is later than the design assumes, s."""
        return self.time - self.loop.period / 2

    @property
    def factor(self) -> float:
        """Factor by which the counts are too few for the loop; at one or less they are enough."""
        if not self.source.timed:
            return self.margins.crossover * self.time / COASTING_ANGLE
        allowed = (
            DELAY_MARGIN_SHARE * self.margins.phase_margin / self.margins.crossover + self.loop.period / 2
        )
        return self.time / allowed

    @property
    def enough(self) -> bool:
        """Whether the edges come often enough: the speed's lateness takes no more than half of the margin."""
        if not self.source.hall:
            return self.factor <= 1
        least = (1 - DELAY_MARGIN_SHARE) * self.margins.phase_margin
        return self.late_margins.stable and self.late_margins.phase_margin >= least

    @property
    def spent(self) -> bool:
        """Whether nothing is left of the phase margin of a timed speed."""
        if self.source.hall:
            return not self.late_margins.stable
        return self.margins.crossover * self.late > self.margins.phase_margin

    @property
    def counts(self) -> float:
        """Speed ripple that single counts cause, rad/s rms.

        Edges that come later than samples make a sawtooth of the angle, one count high. Beyond the crossover
        w_c the loop turns it into a sawtooth of the speed, w_c times as high, however often the edges come. A
        timed speed has no such ripple while its edges come in time. From then on the ripple that depends on
        the angle is that of the later loop. With no margin left the rotor stops and goes.
        """
        if self.source.timed:
            if self.enough:
                return 0.0
            return self.omega if self.spent else math.sqrt(max(0.0, self.late_swing**2 - self.swing**2))
        steps = math.sqrt(counting(self.loop, self.feedback, self.source))
        sawtooth = self.margins.crossover * self.source.count / math.sqrt(12)
        return max(sawtooth, steps) if self.time > self.loop.period else steps

    @property
    def ripple(self) -> float:
        """Speed ripple, rad/s rms, from the counts and from torques over the angle together."""
        return math.hypot(self.counts, self.swing)


def _edges(study: Study, name: str, scenario: str) -> _Edges | None:
    """The edges that a controller gets; None without edges, at rest, or if no loop is stable."""
    omega, loop = slowest_held_speed(study, scenario), speed_loop(study, scenario)
    source, feedback = sampled(study, scenario), feedback_of(study, name, omega)
    if not omega or source is None or feedback is None:
        return None
    margins = position_margins(loop, feedback)
    if not margins.stable or math.isnan(margins.crossover):
        return None
    later = _late(loop, source, omega)
    swings = (swing(study, scenario, feedback, omega, late_loop) for late_loop in (loop, later))
    sizes = [swinging.rms * omega if swinging is not None else 0.0 for swinging in swings]
    return _Edges(omega, source, loop, feedback, margins, position_margins(later, feedback), *sizes)


def _late(loop: SpeedLoop, source: Sampled, omega: float) -> SpeedLoop:
    """The loop with a timed speed as late as its edges are: a delay, or a mean over several of them."""
    if source.hall:
        return replace(loop, edge=source.edge / omega, edges=source.intervals)
    late = max(0.0, source.count / omega - loop.period / 2) if source.timed else 0.0
    return replace(loop, delay=loop.delay + late) if late else loop


def _few_edges(study: Study, name: str, scenario: str) -> Remark | None:
    """Warning of edges that come too rarely, with enough counts, or with a feedback slow enough."""
    edges = _edges(study, name, scenario)
    if edges is None or edges.enough:
        return None
    source = edges.source
    every = 1e3 * source.edge / edges.omega
    comes = f"at {speed_text(study, edges.omega)} a sensor edge comes every {every:.2g} ms"
    if source.intervals > 1:
        comes += f", and the speed is the mean over {source.intervals} such intervals"
    comes += f"; the loop's crossover is {edges.margins.crossover / math.tau:.3g} Hz: {_costs(edges)}"

    late = max(
        STARTED_SHARE * study.scenario[scenario].duration,
        starts_after(study, scenario, edges.feedback, edges.omega),
    )

    def cured(other: Study, most: float = CURED_RATIO) -> bool:
        after = _edges(other, name, scenario)
        enough = after is not None and after.enough and after.ripple <= most * edges.ripple
        starts = after is not None and starts_after(other, scenario, after.feedback, after.omega) <= late
        return enough and starts and _snapping(other, name, scenario) is None

    factor = SPEED_RESERVE * edges.factor
    slower = slower_feedback(study, name, factor)
    quicker = slower_proportional(study, name, factor, edges.margins.crossover)
    gentler = [*([slower] if slower is not None else []), *quicker]
    feedbacks = first(study, gentler, lambda other: cured(other, LESS_BY_FEEDBACK))
    finer = helping(study, (finer_sensor(study, factor),), cured)
    cures = (*first(study, younger_speeds(study), cured), *finer, *feedbacks)
    return Remark(comes + cure_words(cures, dotted(("controller", name))), cures)


def _costs(edges: _Edges) -> str:
    """The effect of edges that come too rarely, in words."""
    if not edges.source.timed:
        return "the rotor coasts from count to count"
    has, speed_is_late = edges.margins.phase_margin, f"the measured speed is {1e3 * edges.late:.2g} ms late"
    if edges.source.hall:
        remains = "none" if edges.spent else f"{math.degrees(edges.late_margins.phase_margin):.0f} deg"
        return f"{speed_is_late}, which leaves {remains} of the {math.degrees(has):.0f} deg of phase margin"
    lag = f"{math.degrees(edges.margins.crossover * edges.late):.0f} deg of lag at the crossover"
    high = (
        "; when the rotor stops and goes, the measured speed is too high: by 10 % if every second interval "
        "between edges is twice as long"
    )
    margin = f"the phase margin without this lag is {math.degrees(has):.0f} deg"
    return f"{speed_is_late}, which is {lag}; {margin}{high if edges.spent else ''}"


def reads_zero(study: Study, scenario: str) -> Remark | None:
    """Warning that most samples of a counted speed are zero at the slowest speed; None if they aren't.

    The warning advises to time the edges if each controller of the scenario then leaves less ripple. Timed
    edges leave more where they come so late that their delay takes the loop's phase margin.
    """
    omega, source = slowest_held_speed(study, scenario), sampled(study, scenario)
    sensor = for_scenario(study, scenario).drive.position_sensor
    if not (omega and source and isinstance(sensor, Counted)) or sensor.speed_method not in ("M", "average"):
        return None
    if source.counts(omega) >= SPEED_COUNTS_LEAST:
        return None
    comes = f"at {speed_text(study, omega)} {source.counts_clause(omega)}"
    reads = f"{comes}: most speed samples are 0, the others {speed_text(study, source.count / source.window)}"
    edges_of = {name: _edges(study, name, scenario) for name in study.controllers_in(scenario)}
    before = {name: edges for name, edges in edges_of.items() if edges is not None}

    def cured(other: Study) -> bool:
        after = [(_edges(other, name, scenario), edges) for name, edges in before.items()]
        return bool(after) and all(
            new is not None and new.factor <= 1 and new.ripple <= CURED_RATIO * old.ripple
            for new, old in after
        )

    cures = helping(study, (timed_edges(study),), cured)
    timed = f"; {either(cures)} would time the edges, and by calculation leave less ripple"
    return Remark(f"{reads}{timed}" if cures else reads, cures)


def slowest_held_speed(study: Study, scenario: str) -> float:
    """The slowest speed at which a scenario's reference spends some time, rad/s; 0 if it stands still.

    Within a count of where the reference stops or turns back, the sensor sees no motion: that counts as rest.
    """
    sampling, source = course(study.scenario[scenario]), sampled(study, scenario)
    omega, count = np.abs(sampling.omega), source.count if source else 0.0
    moving = omega[(omega > 0) & (_from_rest(sampling) >= count)]
    return float(np.quantile(moving, SLOW_TIME_SHARE)) if len(moving) else 0.0


def _from_rest(sampling: Course) -> Real:
    """The way from each sample to the nearest rest of a reference, rad; infinite if it never rests."""
    direction = np.sign(sampling.omega)
    way = np.cumsum(np.abs(sampling.omega)) * sampling.step
    turns = np.concatenate(([False], direction[1:] * direction[:-1] < 0))
    rests = (direction == 0) | turns
    before = np.maximum.accumulate(np.where(rests, way, -np.inf))
    after = np.minimum.accumulate(np.where(rests, way, np.inf)[::-1])[::-1]
    return np.asarray(np.minimum(way - before, after - way))


def warnings(study: Study, scenario: str, name: str) -> list[Remark]:
    """Warnings about a controller and its current loop, one line each, which begins with the study's key."""
    return [
        *loop_remarks(study),
        *(remark.with_key(f"controller.{name}") for remark in _feedback_and_learning(study, name)),
        *notes(study, name),
    ]


def notes(study: Study, name: str) -> list[Remark]:
    """Warnings of what a law, its map and its sensor cost or leave, one line each, key first."""
    all_of = (
        back_emf_warning,
        map_warning,
        slow_warning,
        _less_margin,
    )
    remarks = (*(of(study, name) for of in all_of), *rules_of(study, name).notes())
    return [remark.with_key(f"controller.{name}") for remark in remarks if remark is not None]


def likely_harm(study: Study, name: str, scenario: str) -> str | None:
    """What the design says of why a controller's learning may do harm in a scenario; None if nothing."""
    reasons = _feedback_and_learning(study, name, scenario)
    reason = next(iter(reasons), None) or rules_of(study, name).shortfall()
    return None if reason is None else str(reason)


def too_short(study: Study, runs: Iterable[tuple[str, str]]) -> list[str]:
    """Warnings of scenarios in which a controller will learn nothing; `runs` are (scenario, controller)."""
    pairs = [*runs]
    reasons = ((scenario, name, foreseen(study, scenario, name)) for scenario, name in pairs)
    tables = ((scenario, _idle_table(study, scenario)) for scenario in dict.fromkeys(s for s, _ in pairs))
    return [
        *(f"controller.{name}: learns nothing in {where}: {why}" for where, name, why in reasons if why),
        *(f"drive.encoder_table: learns nothing in {where}: {why}" for where, why in tables if why),
    ]


def _idle_table(study: Study, scenario: str) -> str:
    """Why a table of the position sensor's error learns nothing in a scenario; "" if it may, or no table."""
    table, way = for_scenario(study, scenario).drive.encoder_table, course(study.scenario[scenario])
    if table is None:
        return ""
    fast = float(np.sum(np.abs(way.omega) >= table.omega_min)) * way.step
    if not fast:
        return "the reference never reaches omega_min"
    settles = f"its observer needs {table.settling:.3g} s or more above omega_min to settle"
    rests = f"{settles}, but the reference is above omega_min for only {fast:.3g} s"
    return rests if fast <= table.settling else ""


def beyond_drive(study: Study, scenarios: Iterable[str]) -> list[Remark]:
    """Warnings of references that the drive cannot follow.

    A reference may be too fast for the bus voltage, for the current loop or for the age of the angle, too
    slow for the position sensor, or need more current than the limit.
    """
    all_of = (
        _out_of_reach,
        unstable_turning,
        late_angle,
        too_much_current,
        noisy_currents,
        noisy_voltage,
        reads_zero,
    )
    remarks = ((name, of(study, name)) for name in dict.fromkeys(scenarios) for of in all_of)
    return [remark.with_key(f"scenario.{name}") for name, remark in remarks if remark is not None]


def _out_of_reach(study: Study, scenario: str) -> Remark | None:
    """A warning of a reference that the bus voltage can't turn the motor at."""
    own_study, top_speed = for_scenario(study, scenario), study.scenario[scenario].top_reference
    most = voltage_reach(own_study)
    if top_speed <= most or own_study.drive.inverter is None:
        return None
    needs = f"its reference of {top_speed / RPM:.4g} rpm needs more than the bus voltage"
    volts = own_study.drive.inverter.bus_voltage
    return Remark(f"{needs}: {volts:.4g} V turn this motor at {most / RPM:.4g} rpm at most, without load")


def cogging_notes(study: Study) -> list[str]:
    """Warnings of cogging whose orders do not fit the motor's slots."""
    return [*_coarse_table(study), *_orders_of_other_slots(study)]


def _coarse_table(study: Study) -> list[str]:
    """A warning of a table of the cogging with too few points for the main order of slots and poles."""
    table = getattr(study.motor, "cogging_table", None)
    if table is None:
        return []
    main, highest = main_order(study, 0), table.highest(study.motor.pole_pairs)
    if main <= highest:
        return []
    needed = 2 * math.ceil(main / (study.motor.pole_pairs if table.frame == "electrical" else 1)) + 1
    return [
        f"motor.cogging_table: {table.points} points show orders up to {highest}, so the cogging's main "
        f"order, {main}, looks like a lower order: expected {needed} points or more"
    ]


def _orders_of_other_slots(study: Study) -> list[str]:
    """A warning if a change of the slots leaves orders of cogging that only other slots would give."""
    motor, changes = study.motor, {change[:2] for change in study.source.changes}
    if isinstance(motor, StepMotor) or motor.slots is None or ("motor", "slots") not in changes:
        return []
    if ("motor", "cogging") in changes:
        return []
    slots, poles = motor.slots, 2 * motor.pole_pairs
    orders, shared = (wave.order for wave in motor.cogging if wave.torque), math.gcd(slots, poles)
    other = sorted({order for order in orders if order % shared})
    if not other:
        return []
    named = f"order {other[0]} belongs" if len(other) == 1 else f"orders {', '.join(map(str, other))} belong"
    main = f"the main order of {slots} slots with {poles} poles is {math.lcm(slots, poles)}"
    return [f"motor.slots was changed, but motor.cogging was not: {named} to other slots; {main}"]


def shaft_notes(study: Study) -> list[str]:
    """Where a soft shaft swings, and what the design makes of it; empty if there is none."""
    shaft = speed_loop(study).shaft
    if shaft is None:
        return []
    low, high = (w / TURN for w in (shaft.antiresonance, shaft.resonance))
    gap = study.mechanics.load_side is not None and study.mechanics.load_side.backlash > 0
    return [
        f"mechanics.load_side: the soft shaft has an antiresonance at {low:.4g} Hz and a resonance at "
        f"{high:.4g} Hz; the printed margins include this shaft{' with its gap closed' if gap else ''}. "
        "The tuning rules do not: they take motor and load as one mass"
    ]


def _less_margin(study: Study, name: str) -> Remark | None:
    """A warning if a tuned loop has less phase margin with its soft shaft than its rule asks for."""
    tuning = study.controller[name].rule
    if tuning is None or speed_loop(study).shaft is None:
        return None
    margins = weakest_margins(study, name)
    if margins is None or not margins.stable or margins.phase_margin > 0.9 * tuning.phase_margin:
        return None
    has, asked = math.degrees(margins.phase_margin), math.degrees(tuning.phase_margin)
    at = margins.crossover / TURN
    margin = f"its phase margin is {has:.3g} deg at {at:.4g} Hz, not the {asked:.3g} deg of its tuning rule"
    return Remark(f"with the soft shaft {margin}")


def loop_remarks(study: Study) -> list[Remark]:
    """Warnings of a current loop that is unstable or weak, with the least change that mends it."""
    lines = loop_warnings(current_loop_summary(study))
    cures = gentler_loop(study) if lines else ()
    return [Remark(line + cure_words(cures, "drive.current_loop"), cures) for line in lines]


def loop_warnings(loops: dict[str, CurrentLoopDesign]) -> list[str]:
    """Warnings of a current loop that is unstable or weak, one line each."""
    warnings = []
    for name, loop in told_apart(loops).items():
        if not loop.margins.stable:
            every = "and so is every speed loop around it"
            warnings.append(f"drive.current_loop: the {name} is unstable, {every}")
        elif loop.weakness:
            warnings.append(f"drive.current_loop: the {name} {loop.weakness} of phase margin")
    return warnings


def told_apart(loops: dict[str, CurrentLoopDesign]) -> dict[str, CurrentLoopDesign]:
    """The current loops by name for messages; a single entry if both axes are alike."""
    if not loops:
        return {}
    if loops["d"].margins == loops["q"].margins and loops["d"].gains == loops["q"].gains:
        return {"current loop": loops["q"]}
    return {f"current loop, {axis}": loop for axis, loop in loops.items()}


def _feedback_and_learning(study: Study, name: str, scenario: str | None = None) -> list[Remark]:
    """Warnings of a controller's learning, in one scenario or in all, or of its feedback if it has none."""
    if learning.loop_type(study, name) is not None:
        return learning.warnings(study, name, scenario)
    unstable = unstable_feedback(study, name)
    if not unstable:
        return []
    remedy = learning.steadier(study, name)
    return [Remark(unstable if remedy is None else f"{unstable}; {remedy}", remedy.cures if remedy else ())]
