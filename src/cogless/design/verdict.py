"""Verdict on a learning law before a run: whether its learning settles along its scenarios' references.

learning_loop.py has the factor per period at one speed and acceleration, with a scenario's true plant. Along
a reference (docs/theory/learning-in-angle.md#along-a-reference)

    - learning settles if the factor is below one at all speeds and accelerations of the reference;
    - it grows if the mean of log(Q^n / (1 + mu S)) over the angle, taken at a fixed order of the period, is
      above zero. For n learned functions this mean is a lower bound of n times the rate of growth. At a
      constant speed n is one.

If neither holds, it may grow. Stability is checked first, because there is no factor if 1 + mu S is unstable.
A reference that stops or reverses passes such bad speeds within less than a period. What is learned there
isn't recalled before the passage is over. The verdict reports such a passage, but doesn't judge what follows
it.

If the torque constant ripples, "settles" and "grows" have to hold for its least and its largest value.
"unstable" refers to its mean. If only some values are affected, the verdict is "may grow" or "may be
unstable".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cogless import units
from cogless.design.angle_functions import angle_functions
from cogless.design.changes import change_words, cure_words, either, first, helping, helps, unit_text
from cogless.design.closed_loop import Oscillation, oscillation, position_margins
from cogless.design.detent import STALLING_RATIO, snaps, swing
from cogless.design.gentler import TRIED_HALVINGS, finer_sensor, slower_feedback, weaker_learning
from cogless.design.law_rules import feedback_of, rules_of
from cogless.design.learning_loop import FACTOR_MOST, LearningLoop, Worst
from cogless.design.margins import Real
from cogless.design.ripple import HARMFUL_RATIO, ripple, sampled
from cogless.design.speed_loop import PHASE_MARGIN_LEAST, speed_loop
from cogless.errors import StudyError
from cogless.study import Study, changed, for_scenario
from cogless.study.base import speed_text, spoken_unit
from cogless.study.mechanics import Load
from cogless.study.messages import dotted
from cogless.study.motion import course
from cogless.study.reading import Changes, Remark
from cogless.units import ANGULAR_SPEED, TURN

SPEED_STEP = 1.06  # ratio of one judged speed to the one before
FEWEST_SPEEDS = 15  # least number of judged speeds, if the speed varies
SPEED_TOLERANCE = 1e-6  # relative; speeds that differ by less are one
ACCELERATION_COUNT = 3  # accelerations that are judged at each speed, if mu depends on the acceleration
FILTER_WIDTH_MOST = 400  # widest Q filter that is tried, in cells or samples on each side
REST_RATIO = 200.0  # speeds below the fastest one divided by this count as rest
ORDER_POINTS = 2000  # orders at which the mean factor is computed
TORQUE_ANGLES = 720  # angles of an electrical revolution at which the torque constant is evaluated
K_T_RIPPLE_LEAST = 0.01  # relative; a smaller ripple of the torque constant is neglected
# proposed omega_min / unstable speed: a gain margin, since mu is proportional to 1 / |omega|
OMEGA_MIN_MARGIN = 2
LOG_FLOOR = 1e-30  # keeps a logarithm of zero finite
SAMPLE_COUNTS_LEAST = 1.0  # counts per speed sample; below this the measured speed comes in pulses, or late
COUNT_ROUNDING = 1e-9  # relative error of a number of counts

Samples = NDArray[np.intp]

Kind = Literal[
    "settles",
    "may grow",
    "grows",
    "may be unstable",
    "unstable",
    "feedback unstable",
    "not judged",
    "rests",
]


@dataclass(frozen=True)
class Passing:
    """Low speeds that a reference only passes to stop or reverse, and at which learning doesn't settle."""

    below: float  # rad/s, mechanical
    time: float  # s, of the longest passage
    frequency: float  # Hz, of the instability or the growth there
    unstable: bool

    @property
    def least(self) -> float:
        """The omega_min, rad/s, with which learning rests during the passage."""
        return OMEGA_MIN_MARGIN * self.below

    def in_words(self, unit: str = ANGULAR_SPEED.unit) -> str:
        """The report of the passage in one line; `unit` is that of speeds."""
        what = "is unstable" if self.unstable else "grows"
        below = units.format(self.below, unit, ANGULAR_SPEED, 2)
        passed = f"the reference passes these speeds within {self.time:.2g} s"
        return f"below {below} learning {what} at {self.frequency:.0f} Hz ({passed})"


@dataclass(frozen=True)
class Mean:
    """The largest mean factor per period of any order; speeds are weighted by the angle turned at them."""

    factor: float
    lowest: float  # Hz, the order's frequency at the slowest speed
    highest: float  # Hz, at the fastest
    sure: bool  # whether the order certainly grows

    def in_words(self) -> str:
        """The mean in one line."""
        return f"on average {self.factor:.3g} from {self.lowest:.0f} to {self.highest:.0f} Hz"


@dataclass(frozen=True)
class Repair:
    """The smallest change of lead, Q filter or forgetting with which learning settles at all speeds."""

    lead: float | None = None  # s
    q_half_width: int | None = None
    forgetting: float | None = None

    def change(self, key: str) -> Changes | None:
        """The change of lead or Q filter, as values under the controller's key; None if it takes forgetting.

        Forgetting is no repair here: a smaller learning gain leaves more of what was learned.
        """
        if self.lead is not None:
            return {f"{key}.lead": f"{1e3 * self.lead:g} ms"}
        return None if self.q_half_width is None else {f"{key}.q_half_width": self.q_half_width}


@dataclass(frozen=True)
class Verdict:
    """Whether a controller's learning settles, over all its scenarios."""

    kind: Kind
    worst: Worst | None = None  # the largest factor per period, an upper bound; None if there is no factor
    omega_m: float = 0.0  # rad/s, speed of the worst factor, or of the instability
    scenario: str | None = None  # the scenario with that speed, if there are several
    unstable: Oscillation | None = None
    varies: bool = False  # whether the speed varies
    mean: Mean | None = None  # if learning grows and the speed varies
    repair: Repair | None = None  # the change that ends the growth
    remedy: Remark | None = None  # what cures it, if anything does
    passing: Passing | None = None
    frozen: tuple[str, ...] = ()  # why nothing is learned at some of the speeds
    ratio: float = 1.0  # if learning settles: speed ripple with learning / with the feedback alone
    doubts: tuple[Remark, ...] = ()  # why the small-signal prediction is unreliable at some speeds
    unit: str = ANGULAR_SPEED.unit  # of speeds, as the study writes them

    @property
    def fine(self) -> bool:
        """Whether learning settles without anything to warn of."""
        return (
            self.kind == "settles"
            and self.passing is None
            and not self.doubts
            and self.ratio <= HARMFUL_RATIO
        )

    @property
    def where(self) -> str:
        """Text with the speed and the scenario, each only if there are several."""
        speed = f" at {units.format(self.omega_m, self.unit, ANGULAR_SPEED, 3)}" if self.varies else ""
        return speed + (f" in scenario {self.scenario}" if self.scenario else "")

    def short(self) -> str:
        """The verdict without a remedy."""
        if self.unstable is not None:
            with_what = "" if self.kind == "feedback unstable" else " with the feedback that learning adds"
            sentence = f"{self.kind}{with_what}, at {self.unstable.frequency:.0f} Hz{self.where}"
            return sentence + (", where K_t is largest" if self.kind == "may be unstable" else "")
        if self.kind == "settles" and self.ratio > HARMFUL_RATIO:
            leaves = f"{self.ratio:.2g} times the speed ripple of its feedback alone"
            return f"settles, but leaves {leaves}{self.where}"
        if self.kind == "not judged":
            return f"not judged: {self._doubts}"
        if self.worst is None or self.kind in ("settles", "rests"):
            return self.kind
        up_to = "up to " if self.varies else ""
        factor = f"{up_to}{self.worst.factor:.4g} per period at {self.worst.frequency:.0f} Hz"
        mean = f", {self.mean.in_words()}" if self.mean else ""
        return f"{self.kind} by a factor of {factor}{self.where}{mean}"

    @property
    def _doubts(self) -> str:
        return ", ".join(map(str, self.doubts))

    def in_words(self) -> str:
        """The whole verdict in one line."""
        return str(self.remark())

    @property
    def clauses(self) -> list[str]:
        """The whole verdict, a statement each."""
        passing = self.passing.in_words(self.unit) if self.passing else ""
        frozen = [f"learns nothing at some speeds: {reason}" for reason in self.frozen]
        doubts = f"this is not sure: {self._doubts}" if self.doubts and self.kind != "not judged" else ""
        remedy = "" if self.remedy is None else str(self.remedy)
        return [part for part in (self.short(), passing, remedy, doubts, *frozen) if part]

    def remark(self) -> Remark:
        """The whole verdict in one line, with the changes that cure it."""
        remedy = [] if self.remedy is None else [self.remedy]
        cures = (cure for remark in (*remedy, *self.doubts) for cure in remark.cures)
        return Remark("; ".join(self.clauses), tuple(cures))


@dataclass(frozen=True, eq=False)
class _At:
    """A speed and acceleration of a reference, the reference's samples near it, and the loops there."""

    loops: tuple[LearningLoop, ...]  # one for each torque constant to judge; the last has the mean one
    samples: Samples

    @property
    def loop(self) -> LearningLoop:
        return self.loops[-1]

    @cached_property
    def worst(self) -> Worst:
        return max((loop.worst() for loop in self.loops), key=lambda worst: worst.factor)

    @cached_property
    def oscillation(self) -> Oscillation | None:
        """The fastest growing oscillation over the judged torque constants; None if there is none."""
        oscillations = [o for loop in self.loops if (o := loop.oscillation()) is not None]
        return max(oscillations, key=lambda o: o.rate, default=None)

    def of_feedback(self) -> Oscillation | None:
        """The oscillation of the feedback alone, before or after learning takes over from its integral."""
        loop = self.loop
        return oscillation(loop.plant, loop.feedback_before) or oscillation(loop.plant, loop.feedback)

    @property
    def stops(self) -> str | None:
        """Why the rotor stops and snaps at this speed with the feedback alone; None if it doesn't."""
        loop = self.loop
        assert loop.scenario is not None
        swinging = swing(loop.study, loop.scenario, loop.feedback_before, loop.omega_m)
        if swinging is None or not swinging.stops:
            return None
        margins = position_margins(loop.plant, loop.feedback_before)
        return snaps(loop.study, swinging, loop.omega_m, margins.crossover)

    @property
    def fine(self) -> bool:
        return self.oscillation is None and self.worst.factor <= FACTOR_MOST


@dataclass(frozen=True)
class _Motion:
    """The judged points of a scenario's reference, each with its share of the angle, and the rest."""

    judged: tuple[tuple[_At, float], ...]
    passing: Passing | None = None
    frozen: tuple[tuple[float, str], ...] = ()  # slowest and fastest speed that learn nothing, and why
    duration: float = 0.0  # s, of learning

    @cached_property
    def snapping(self) -> str | None:
        """Why no learning is judged: the rotor snaps at each judged speed. None if it turns at one."""
        stops = [at.stops for at, _ in self.judged]
        return stops[0] if stops and None not in stops else None

    @property
    def ratio(self) -> float:
        """The speed ripple with learning divided by that of the feedback alone."""
        ripples = [(share, ripple(at.loop, self.duration)) for at, share in self.judged]
        with_it = sum(share * one.learned**2 for share, one in ripples)
        without = sum(share * one.without**2 for share, one in ripples)
        return math.sqrt(with_it / without) if without > 0 else 1.0

    @property
    def loudest(self) -> _At:
        """The point with the largest ripple relative to that of the feedback alone."""
        return max((at for at, _ in self.judged), key=lambda at: ripple(at.loop, self.duration).ratio)


def verdict(study: Study, name: str) -> Verdict | None:
    """Whether a controller's learning settles, with a remedy if not; None without learning or scenario."""
    return study.once(_with_remedy, name)


def judgement(study: Study, name: str) -> Verdict | None:
    """The verdict without a remedy. To find a remedy takes further verdicts."""
    return study.once(_verdict, name)


def in_scenario(study: Study, name: str, scenario: str) -> Verdict | None:
    """The verdict on a controller's learning in one scenario, with the remedy for all; None without learning.

    A scenario that the controller does not run in has no verdict.
    """
    of_all = verdict(study, name)
    own = study.once(_verdict_in, (name, scenario)) if scenario in study.scenarios_of(name) else None
    return None if own is None or of_all is None else replace(own, remedy=of_all.remedy)


def _with_remedy(study: Study, name: str) -> Verdict | None:
    verdict = judgement(study, name)
    if verdict is None:
        return None
    unsettled = verdict.kind in ("may grow", "grows", "may be unstable", "unstable")
    if verdict.kind == "feedback unstable":
        return replace(verdict, remedy=steadier(study, name))
    return replace(verdict, remedy=_remedy(study, name, verdict)) if unsettled or verdict.passing else verdict


def _remedy(study: Study, name: str, verdict: Verdict) -> Remark | None:
    """The mildest change with which learning settles; None if no change that is tried does it.

    First comes the verdict's repair, or omega_min for a law that has one. If neither helps, the learning gain
    is halved, with the repair that the smaller gain needs.
    """

    def cured(other: Study) -> bool:
        return settles(other, name)

    key, top = (
        dotted(("controller", name)),
        max(study.scenario[k].top_reference for k in study.scenarios_of(name)),
    )
    mild = verdict.repair.change(key) if verdict.repair else None
    cures = helping(study, (mild,), cured)
    if study.controller[name].rests_below is not None:
        low = verdict.passing.least if verdict.passing else OMEGA_MIN_MARGIN * verdict.omega_m
        least = (low * OMEGA_MIN_MARGIN**n for n in range(TRIED_HALVINGS))
        rests: list[Changes] = [
            {f"{key}.omega_min": unit_text(omega_min, "rad/s")} for omega_min in least if omega_min < top
        ]
        cures += first(study, rests, cured)
    if cures:
        return Remark(f"learning settles with {either(cures, key)}", cures)
    best = _weaker(study, name)
    return None if best is None else Remark(f"learning settles with {change_words(best, key)}", (best,))


def _weaker(study: Study, name: str) -> Changes | None:
    """The change that halves the learning gain until learning settles, and further while the ripple falls.

    It includes the repair that the smaller gain needs. None: learning settles with no gain that is tried.
    """
    best: tuple[float, Changes] | None = None
    for n in range(1, TRIED_HALVINGS):
        weaker = weaker_learning(study, name, 2.0**n)
        settled = _settled(study, name, weaker) if weaker else None
        if best is not None and (settled is None or settled[0] >= best[0]):
            break
        best = settled or best
    return None if best is None else best[1]


def _settled(study: Study, name: str, weaker: Changes) -> tuple[float, Changes] | None:
    """The ripple that a smaller gain leaves over that of the feedback alone, and the change to that gain.

    The change includes a repair where the gain needs one. None: learning doesn't settle.
    """
    for change in (weaker, _repaired(study, name, weaker)):
        if change is not None and helps(study, change, lambda other: settles(other, name)):
            verdict = judgement(changed(study, change), name)
            return None if verdict is None else (verdict.ratio, change)
    return None


def _repaired(study: Study, name: str, weaker: Changes) -> Changes | None:
    """The change to a smaller gain and to the repair that its verdict names; None: the verdict names none."""
    try:
        verdict = judgement(changed(study, weaker), name)
    except StudyError:
        return None
    mild = (
        verdict.repair.change(dotted(("controller", name)))
        if verdict is not None and verdict.repair
        else None
    )
    return None if mild is None else {**weaker, **mild}


def settles(study: Study, name: str) -> bool:
    """Whether learning settles, passes no speed at which it grows, and leaves no clearly larger ripple."""
    verdict = judgement(study, name)
    return (
        verdict is not None
        and verdict.kind == "settles"
        and verdict.passing is None
        and verdict.ratio <= HARMFUL_RATIO
    )


def steadier(study: Study, name: str) -> Remark | None:
    """The change to the fastest slower feedback that is stable with the usual margin; None if none is.

    All gains shrink together, so the damping stays.
    """
    for n in range(1, 2 * TRIED_HALVINGS):
        slower = slower_feedback(study, name, 2.0 ** (n / 2))
        if slower is not None and helps(study, slower, lambda other: _stable(other, name)):
            words = change_words(slower, dotted(("controller", name)))
            return Remark(f"the feedback is stable with {words}", (slower,))
    return None


def _stable(study: Study, name: str) -> bool:
    """Whether a feedback has PHASE_MARGIN_LEAST at the slowest and fastest speed of each scenario."""
    for key in study.scenarios_of(name):
        for speed in {study.scenario[key].slowest, study.scenario[key].top_reference}:
            feedback = feedback_of(study, name, speed)
            margins = position_margins(speed_loop(study, key), feedback) if feedback is not None else None
            if margins is None or not margins.stable or margins.phase_margin < PHASE_MARGIN_LEAST:
                return False
    return True


def _verdict(study: Study, name: str) -> Verdict | None:
    return _verdict_over(study, name, study.scenarios_of(name))


def _verdict_in(study: Study, of: tuple[str, str]) -> Verdict | None:
    name, scenario = of
    return _verdict_over(study, name, [scenario])


def _verdict_over(study: Study, name: str, keys: Sequence[str]) -> Verdict | None:
    if loop_type(study, name) is None or not keys:
        return None
    motions = [study.once(_motion, (key, name)) for key in keys]
    resting = sorted(unstable for motion in motions for unstable in motion.frozen)
    frozen = tuple(dict.fromkeys(reason for _, reason in resting))
    points = [at for motion in motions for at, _ in motion.judged]
    if not points:
        return Verdict("rests", frozen=frozen)
    plants = {at.loop.plant for at in points}
    base = Verdict(
        "settles",
        varies=len({at.loop.omega_m for at in points}) > 1,
        passing=max((m.passing for m in motions if m.passing), key=lambda p: p.below, default=None),
        frozen=frozen,
        doubts=doubts([at.loop for at in points]),
        unit=spoken_unit(study, ANGULAR_SPEED),
    )

    def verdict_at(at: _At, **more: Any) -> Verdict:
        scenario = at.loop.scenario if len(plants) > 1 else None
        return replace(base, omega_m=at.loop.omega_m, scenario=scenario, **more)

    instabilities: dict[Kind, Callable[[_At], Oscillation | None]] = {
        "feedback unstable": _At.of_feedback,
        "unstable": lambda at: at.loop.oscillation(),
        "may be unstable": lambda at: at.oscillation,
    }
    kind: Kind
    for kind, growing in instabilities.items():
        grow = [(at, unstable) for at in points if (unstable := growing(at)) is not None]
        if grow:
            at, fastest = max(grow, key=lambda pair: pair[1].rate)
            return verdict_at(at, kind=kind, unstable=fastest)
    snapping = next((why for motion in motions if (why := motion.snapping) is not None), None)
    if snapping is not None:
        return replace(base, kind="not judged", doubts=(Remark(snapping),), passing=None)
    most = max(points, key=lambda at: at.worst.factor)
    if most.worst.factor <= FACTOR_MOST:
        loud, ratio = max(((m, m.ratio) for m in motions if m.judged), key=lambda pair: pair[1])
        most = loud.loudest if ratio > HARMFUL_RATIO else most
        return verdict_at(most, worst=most.worst, ratio=ratio)
    learning = [motion for motion in motions if motion.judged]
    means = [_mean(motion.judged) for motion in learning]
    mean = max(means, key=lambda m: m.factor)
    sure_of = [mean.sure and not motion.frozen for mean, motion in zip(means, learning, strict=True)]
    kind = "grows" if any(sure_of) and not base.doubts else "may grow"
    range_mean = mean if kind == "grows" and mean.highest > mean.lowest else None
    return verdict_at(most, kind=kind, worst=most.worst, mean=range_mean, repair=_repair(points))


def loop_type(study: Study, name: str) -> type[LearningLoop] | None:
    """The class of learning loop for a controller's law; None if the law doesn't learn."""
    return rules_of(study, name).loop


def warnings(study: Study, name: str, scenario: str | None = None) -> list[Remark]:
    """Warnings about a controller's learning before a run, in one scenario or in all, one line each."""
    judged = verdict(study, name) if scenario is None else in_scenario(study, name, scenario)
    remarks: list[Remark] = []
    if judged is None:
        return []
    if judged.kind == "rests":
        why = "; ".join(judged.frozen) or "no reference is fast enough after learning_start"
        remarks.append(Remark(f"learns nothing: {why}"))
    elif not judged.fine:
        remarks.append(judged.remark())
    foreign = rules_of(study, name).unfit()
    if foreign:
        stays = "the law learns a disturbance only as far as it changes little from one period to the next"
        remarks.append(Remark(f"{foreign}: {stays}"))
    return remarks


def doubts(loops: Sequence[LearningLoop]) -> tuple[Remark, ...]:
    """Reasons why the small-signal model predicts poorly at some speeds of a controller, one phrase each."""
    remarks = [Remark(reason) for loop in loops if (reason := loop.doubt) is not None][:1]
    slowest = min(loops, key=lambda loop: loop.omega_m)
    several = len({loop.scenario for loop in loops}) > 1
    few = _few_counts(slowest, several)
    remarks += [few] if few is not None else []
    at_speeds = {(loop.scenario, loop.omega_m): loop for loop in loops}  # no acceleration changes `without`
    swings = [(ripple(loop, 0.0).without / loop.omega_m, loop) for loop in at_speeds.values()]
    largest, where = max(swings, key=lambda pair: pair[0])
    if largest > STALLING_RATIO:
        speed = speed_text(where.study, where.omega_m)
        remarks.append(
            Remark(f"at {speed} the feedback alone lets the speed swing by {100 * largest:.0f} % rms")
        )
    return tuple(remarks)


def _few_counts(loop: LearningLoop, several: bool) -> Remark | None:
    """The doubt where a speed sample has less than a count. `several`: there are several scenarios."""
    assert loop.scenario is not None
    source = sampled(loop.study, loop.scenario)
    counts = source.counts(loop.omega_m) if source else SAMPLE_COUNTS_LEAST
    if source is None or counts >= SAMPLE_COUNTS_LEAST * (1 - COUNT_ROUNDING):
        return None
    inside = f" in scenario {loop.scenario}" if several else ""
    few = f"at {speed_text(loop.study, loop.omega_m)}{inside} {source.counts_clause(loop.omega_m)}"
    scenario = loop.scenario

    def cured(other: Study) -> bool:
        after = sampled(other, scenario)
        return after is not None and after.counts(loop.omega_m) >= SAMPLE_COUNTS_LEAST * (1 - COUNT_ROUNDING)

    tried = (
        (finer_sensor(loop.study, SAMPLE_COUNTS_LEAST / counts),) if counts and loop.study.scenario else ()
    )
    cures = helping(loop.study, tried, cured)
    return Remark(few + cure_words(cures), cures)


def judged(study: Study, scenario: str, name: str) -> list[LearningLoop]:
    """A controller's learning loops at the slowest and at the fastest judged speed of a scenario."""
    loops = [at.loop for at, _ in study.once(_motion, (scenario, name)).judged]
    loops.sort(key=lambda loop: loop.omega_m)
    ends = {loop.omega_m: replace(loop, alpha_m=0.0) for loop in (*loops[:1], *loops[-1:])}
    return list(ends.values())


def _motion(study: Study, of: tuple[str, str]) -> _Motion:
    """The points to judge of a scenario and a controller; none if its reference is too slow to learn."""
    scenario, name = of
    law, kind = study.controller[name], loop_type(study, name)
    assert kind is not None
    way = course(study.scenario[scenario])
    learns = way.time >= law.learns_from
    omega, alpha = np.abs(way.omega[learns]), np.abs(way.alpha[learns])
    slowest = float(np.max(omega, initial=0.0)) / REST_RATIO
    weighed = np.zeros(len(alpha))
    if law.rests_below is not None:
        slowest = law.rests_below
    if law.uses_acceleration:
        weighed = alpha
    moving = (omega >= slowest) & (omega > 0)
    if not np.any(moving):
        return _Motion(())
    points: list[_At] = []
    frozen: list[tuple[float, str]] = []
    torques = _torques(study, scenario)
    for speed, acceleration, samples in _places(omega, weighed, moving):
        loops = [kind(study, name, speed, acceleration, torque, scenario) for torque in torques]
        reason = loops[0].frozen
        if reason is None:
            points.append(_At(tuple(loops), samples))
        else:
            frozen.append((speed, reason))
            moving[samples] = False
    reasons = tuple(dict.fromkeys((*frozen[:1], *frozen[-1:])))
    if not points:
        return _Motion((), frozen=reasons)
    turned = omega * way.step
    passed, longest = _passed(points, ~moving, turned, points[0].loop)
    remaining = [at for at in points if not np.all(passed[at.samples])]
    if not remaining:  # all of the reference is such a passage
        remaining, passed = points, np.zeros(len(omega), dtype=bool)
    angles = [float(np.sum(turned[at.samples][~passed[at.samples]])) for at in remaining]
    shares = np.array(angles) / sum(angles)
    gone = [at for at in points if at not in remaining]
    stops = law.rests_below is not None  # the gains of other laws don't depend on the speed
    passing = _passing(gone, remaining, longest * way.step) if gone and stops else None
    duration = len(omega) * way.step
    return _Motion(tuple(zip(remaining, shares.tolist(), strict=True)), passing, reasons, duration)


def _torques(study: Study, scenario: str) -> list[float]:
    """Least, largest and mean torque constant over the angle, divided by the mean; only 1 without ripple."""
    study_here = for_scenario(study, scenario)
    motor = study_here.motor.star()
    theta = np.linspace(0, TURN / motor.pole_pairs, TORQUE_ANGLES, endpoint=False)
    K_t = study_here.mechanics.stiff.inertia / angle_functions(motor, study_here.mechanics, Load()).h(theta)
    ratios = K_t / motor.K_t
    least, most = float(np.min(ratios)), float(np.max(ratios))
    return [least, most, 1.0] if most > least + K_T_RIPPLE_LEAST and least > 0 else [1.0]


def _places(omega: Real, alpha: Real, moving: NDArray[np.bool_]) -> Iterator[tuple[float, float, Samples]]:
    """Yields the points at which a reference is judged: speed, acceleration, and the samples nearest to both.

    Speeds go from the slowest to the fastest in equal ratios, accelerations at each speed from the least to
    the largest in equal steps. A point without samples is left out.
    """
    slowest, fastest = float(np.min(omega[moving])), float(np.max(omega[moving]))
    count = 1
    if fastest > slowest * (1 + SPEED_TOLERANCE):
        count = max(FEWEST_SPEEDS, math.ceil(math.log(fastest / slowest) / math.log(SPEED_STEP)) + 1)
    speeds = np.geomspace(slowest, fastest, count)
    spacing = math.log(fastest / slowest) / (count - 1) if count > 1 else 1.0
    nearest = np.full(len(omega), -1)
    nearest[moving] = np.rint(np.log(omega[moving] / slowest) / spacing)
    for k, speed in enumerate(speeds.tolist()):
        near = np.flatnonzero(nearest == k)
        if not len(near):
            continue
        low, high = float(np.min(alpha[near])), float(np.max(alpha[near]))
        levels = np.linspace(low, high, ACCELERATION_COUNT if high > low else 1)
        level = np.argmin(np.abs(alpha[near, None] - levels), axis=1)
        for n, acceleration in enumerate(levels.tolist()):
            if np.any(level == n):
                yield speed, acceleration, near[level == n]


def _passed(
    points: list[_At], resting: NDArray[np.bool_], turned: Real, loop: LearningLoop
) -> tuple[NDArray[np.bool_], int]:
    """Samples at bad speeds in passages next to a stop or reversal, each less than a period long.

    Also returns the number of such samples in the longest passage.
    """
    period = loop.omega_m / loop.periods_per_second  # rad
    bad = np.zeros(len(turned), dtype=bool)
    for at in points:
        bad[at.samples] = not at.fine
    passed, longest = np.zeros(len(turned), dtype=bool), 0
    changes = np.flatnonzero(np.diff(np.concatenate(([False], bad | resting, [False])).astype(int)))
    for start, end in changes.reshape(-1, 2):
        count = int(np.sum(bad[start:end]))
        if count and np.any(resting[start:end]) and np.sum(turned[start:end]) < period:
            passed[start:end] = bad[start:end]
            longest = max(longest, count)
    return passed, longest


def _passing(gone: list[_At], remaining: list[_At], time: float) -> Passing:
    highest = max(at.loop.omega_m for at in gone)
    above = min(
        (at.loop.omega_m for at in remaining if at.loop.omega_m > highest), default=highest * SPEED_STEP
    )
    digit = 10.0 ** (math.floor(math.log10(above)) - 1)
    below = math.ceil(above / digit - 1e-9) * digit
    unstable = [at.oscillation for at in gone if at.oscillation is not None]
    if unstable:
        return Passing(below, time, max(unstable, key=lambda o: o.rate).frequency, True)
    return Passing(below, time, max((at.worst for at in gone), key=lambda w: w.factor).frequency, False)


def _mean(judged: Sequence[tuple[_At, float]]) -> Mean:
    """The mean factor over one scenario.

    Growth is sure if the lower bound stays above one over a span of one order, because each order of the
    period has a mode within it.
    """
    constant = len(judged) == 1
    channels = 1 if constant else _channels(judged)
    highest = min(at.loop.highest / at.loop.periods_per_second for at, _ in judged)
    orders, window = np.linspace(1, max(highest, 1), ORDER_POINTS), 1
    chosen = [at.loop.orders for at, _ in judged if at.loop.orders is not None]
    if chosen:
        orders = max(chosen, key=len)  # the slowest speed has the most orders
    else:
        window += math.ceil(1 / max(orders[1] - orders[0], 1 / ORDER_POINTS))
    rate, bound = np.zeros(len(orders)), np.zeros(len(orders))
    for at, share in judged:
        f = orders * at.loop.periods_per_second
        recalled = np.log(at.loop.recalled(f, constant) + LOG_FLOOR)
        log_factors = np.log([loop.unfiltered(f) + LOG_FLOOR for loop in at.loops])
        rate += share * (recalled + log_factors[-1])
        bound += share * (recalled + np.min(log_factors, axis=0) / channels)
    least = np.min(np.lib.stride_tricks.sliding_window_view(bound, min(window, len(bound))), axis=1)
    k = int(np.argmax(rate))
    a_second = [at.loop.periods_per_second for at, _ in judged]
    return Mean(
        math.exp(rate[k]),
        float(orders[k]) * min(a_second),
        float(orders[k]) * max(a_second),
        float(np.max(least)) > math.log(FACTOR_MOST)
        or (constant and all(loop.sure for loop in judged[0][0].loops)),
    )


def _channels(judged: Sequence[tuple[_At, float]]) -> int:
    """Number of angle functions (alpha, beta, h) that are learned along a reference."""
    loop = judged[0][0].loop
    accelerates = any(at.loop.alpha_m for at, _ in judged)
    return loop.study.controller[loop.controller].functions_learned(accelerates)


def _repair(points: list[_At]) -> Repair:
    """The mildest change that brings the factor below one at every point found.

    It is the shortest lead, if a lead is enough; else the narrowest Q filter; else forgetting. A law that
    learns in angle has only the filter, one of chosen orders only the lead. It is empty if nothing is enough.
    """
    loops = [at.loop for at in points]
    common = set.intersection(*(loop.settling_leads() for loop in loops))
    if common:
        return Repair(lead=min(common) * loops[0].plant.period)
    if not loops[0].FILTERED:
        return Repair()
    parts = []
    for at in points:
        f = at.loop.frequencies
        without = np.max([loop.unfiltered(f) for loop in at.loops], axis=0)
        high = without > FACTOR_MOST  # no filter's gain exceeds one
        parts.append((at.loop, f[high], without[high]))
    widest = min(FILTER_WIDTH_MOST, *(loop.widest_filter for loop in loops))
    for n in range(widest + 1):
        if all(np.all(loop.q(f, n) * without <= FACTOR_MOST) for loop, f, without in parts):
            return Repair(q_half_width=n)
    if not loops[0].FORGETS:
        return Repair()
    peak = max(float(np.max(loop.q(f) / loop.forgetting * without)) for loop, f, without in parts)
    return Repair(forgetting=math.floor(100 * FACTOR_MOST / peak) / 100)
