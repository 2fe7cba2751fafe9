"""How a verdict follows from the loops along a reference, which are made up here: kind, mean and remedy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogless.design import verdict as module
from cogless.design.closed_loop import Oscillation
from cogless.design.laws.periodic import PeriodicLoop
from cogless.design.laws.pi_afc import OrderLoop
from cogless.design.laws.space import SpaceLoop
from cogless.design.learning_loop import FACTOR_MOST, Worst
from cogless.design.ripple import HARMFUL_RATIO, Ripple
from cogless.design.verdict import (
    FILTER_WIDTH_MOST,
    Mean,
    Passing,
    Repair,
    Verdict,
    _At,
    _channels,
    _mean,
    _Motion,
    _motion,
    _repair,
    _verdict,
    judged,
)
from cogless.study.laws.periodic import PiIlc
from cogless.study.laws.space import SpacePosition, SpaceSpeed

SLOW, FAST = Oscillation(80.0, 2.0), Oscillation(90.0, 3.0)


def loop(
    factor: float = 1.0, growing: Oscillation | None = None, omega_m: float = 1.0, **more: Any
) -> SimpleNamespace:
    """A loop whose worst factor is at 100 times its speed."""
    own = {"worst": lambda: Worst(factor, 100 * omega_m), "oscillation": lambda: growing}
    where = {"study": None, "scenario": "here", "plant": "plant", "feedback_before": None}
    return SimpleNamespace(**{**where, "omega_m": omega_m, "alpha_m": 0.0, **own, **more})


def at(*loops: Any) -> Any:
    return _At(loops, np.arange(3))


# One point


def test_a_point_is_as_bad_as_its_worst_torque_constant() -> None:
    """The last of its loops is the mean one."""
    both = at(loop(1.2, SLOW), loop(0.9, FAST), loop(1.1))
    assert both.worst.factor == 1.2 and both.oscillation is FAST and both.loop is both.loops[2]
    assert at(loop(1.0), loop(0.9)).oscillation is None
    fine = [
        at(loop(FACTOR_MOST)),
        at(loop(FACTOR_MOST + 1e-9)),
        at(loop(1.0, SLOW)),
        at(loop(FACTOR_MOST), loop(1.2)),
    ]
    assert [each.fine for each in fine] == [True, False, False, False]


def test_the_feedback_alone_oscillates_before_or_while_learning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "oscillation", lambda plant, feedback: feedback)
    for before, during, told in ((SLOW, FAST, SLOW), (None, FAST, FAST), (None, None, None)):
        assert at(loop(feedback_before=before, feedback=during)).of_feedback() is told


def test_ripple_counts_by_its_square_and_its_share_of_the_angle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ripple", lambda at, duration: Ripple(at.without, duration * at.learned))
    calm, loud = at(loop(without=4.0, learned=0.5)), at(loop(without=1.0, learned=1.5))
    found = _Motion(((calm, 0.75), (loud, 0.25)), duration=2.0)
    assert found.ratio == pytest.approx(math.sqrt((0.75 * 1 + 0.25 * 9) / (0.75 * 16 + 0.25)))
    assert found.loudest is loud
    silent = at(loop(without=0.0, learned=1.0))
    assert _Motion(((silent, 1.0),), duration=2.0).ratio == 1.0


def at_once(**parts: Any) -> Any:
    """A study of these parts that keeps nothing."""
    study = SimpleNamespace(**parts)
    study.once = lambda make, of: make(study, of)
    return study


def test_a_scenario_s_slowest_and_fastest_loop_are_shown_without_acceleration(
    monkeypatch: pytest.MonkeyPatch,
) -> None:

    @dataclass(frozen=True)
    class One:
        omega_m: float
        alpha_m: float

    def shown(*speeds: float) -> list[One]:
        points = tuple((at(One(speed, 0.5)), 0.1) for speed in speeds)
        monkeypatch.setattr(module, "_motion", lambda *_: _Motion(points))
        return judged(at_once(), "s", "x")

    assert shown(3.0, 1.0, 2.0, 4.0) == [One(1.0, 0.0), One(4.0, 0.0)]
    assert shown(2.0, 2.0) == [One(2.0, 0.0)] and shown() == []


# The kind


def told(
    monkeypatch: pytest.MonkeyPatch,
    *motions: _Motion,
    law: Any = None,
    doubts: tuple[str, ...] = (),
    means: tuple[Mean, ...] = (),
) -> Any:
    """The verdict on these motions. Learning leaves all of the ripple, or the `ratio` that a loop has."""
    left = iter(means)
    of_part: dict[str, Any] = {
        "_motion": lambda study, of: motions[int(of[0])],
        "doubts": lambda loops: doubts,
        "spoken_unit": lambda *_: "rpm",
        "ripple": lambda loop, duration: Ripple(1.0, getattr(loop, "ratio", 1.0)),
        "_mean": lambda points: next(left),
        "_repair": lambda found: Repair(q_half_width=len(found)),
        "oscillation": lambda plant, feedback: feedback,
        "swing": lambda *_: None,
    }
    for name, part in of_part.items():
        monkeypatch.setattr(module, name, part)
    study = at_once(
        controller={"x": law or PiIlc.model_construct()},
        scenarios_of=lambda name: [str(n) for n in range(len(motions))],
    )
    return _verdict(study, "x")


def motion(*points: Any, **more: Any) -> _Motion:
    return _Motion(tuple((point, 1 / len(points)) for point in points), **more)


def quiet(factor: float, growing: Oscillation | None = None, omega_m: float = 1.0, **more: Any) -> Any:
    return loop(factor, growing, omega_m, **{"feedback": None, "feedback_before": None, **more})


def test_an_unstable_loop_is_told_first_by_its_fastest_growth(monkeypatch: pytest.MonkeyPatch) -> None:
    """That of the feedback alone, else with the mean torque constant, else with any."""
    mean, ends = at(quiet(2.0, SLOW)), at(quiet(2.0, FAST), quiet(2.0))
    shaking = at(quiet(1.0, feedback_before=SLOW))
    for points, kind, grows in (
        ((ends, mean, shaking), "feedback unstable", SLOW),
        ((ends, mean), "unstable", SLOW),
        ((ends, at(quiet(0.5))), "may be unstable", FAST),
        ((at(quiet(1.0, SLOW)), at(quiet(1.0, FAST)), at(quiet(1.0, SLOW))), "unstable", FAST),
    ):
        found = told(monkeypatch, motion(*points))
        assert (found.kind, found.unstable, found.worst, found.varies) == (kind, grows, None, False)


def test_what_settles_names_its_worst_or_its_loudest_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    low, high = at(quiet(0.9, omega_m=1.0, ratio=0.1)), at(quiet(FACTOR_MOST, omega_m=2.0, ratio=0.2))
    found = told(monkeypatch, motion(low, high), law=SpaceSpeed.model_construct())
    assert (found.kind, found.omega_m, found.varies) == ("settles", 2.0, True)
    assert found.ratio == pytest.approx(math.sqrt((0.01 + 0.04) / 2)) and found.unit == "rpm"
    assert found.scenario is None and found.worst.factor == FACTOR_MOST
    loud = at(quiet(0.5, omega_m=3.0, ratio=3.0))
    found = told(monkeypatch, motion(high), motion(low, loud), motion())
    assert found.omega_m == 3.0
    assert found.ratio == pytest.approx(math.sqrt((0.01 + 9) / 2))
    just = at(quiet(0.5, omega_m=3.0, ratio=HARMFUL_RATIO))
    assert told(monkeypatch, motion(high, just)).omega_m == 2.0


def test_growth_is_sure_if_it_is_in_any_scenario_that_never_freezes(monkeypatch: pytest.MonkeyPatch) -> None:
    up, down = at(quiet(1.3, omega_m=1.0)), at(quiet(0.9, omega_m=2.0))
    sure, unsure, steady = Mean(1.1, 3.0, 4.0, True), Mean(1.2, 3.0, 4.0, False), Mean(1.1, 3.0, 3.0, True)
    frozen = ((1.0, "few samples"),)
    for motions, means, doubts, kind, mean in (
        ((motion(up, down),), (sure,), (), "grows", sure),
        ((motion(up, down),), (steady,), (), "grows", None),
        ((motion(up, down),), (unsure,), (), "may grow", None),
        ((motion(up, down),), (sure,), ("pulses",), "may grow", None),
        ((motion(up, frozen=frozen),), (sure,), (), "may grow", None),
        ((motion(up), motion(frozen=frozen), motion(down)), (unsure, sure), (), "grows", unsure),
    ):
        found = told(monkeypatch, *motions, means=means, doubts=doubts)
        assert (found.kind, found.mean, found.omega_m, found.doubts) == (kind, mean, 1.0, doubts)
        assert found.repair == Repair(q_half_width=sum(len(each.judged) for each in motions))
        assert found.frozen == (("few samples",) if any(each.frozen for each in motions) else ())


def test_what_freezes_is_told_once_from_the_slowest_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of several passages the one with the highest speed is told, and the scenario if the plants differ."""
    reasons = [((3.0, "fast"), (1.0, "slow")), ((2.0, "slow"),)]
    found = told(monkeypatch, *(motion(frozen=each) for each in reasons))
    assert found == Verdict("rests", frozen=("slow", "fast"))
    one, other = Passing(0.1, 2.0, 3.0, False), Passing(0.2, 1.0, 2.0, True)
    here, there = at(quiet(0.5)), at(quiet(0.9))
    here.loop.plant, there.loop.scenario = "another", "there"
    found = told(monkeypatch, motion(here, passing=other), motion(there, passing=one), motion())
    assert found.passing is other and found.scenario == "there"


# A reference


class Tried:
    """A loop that learns nothing above a speed, and is fine from a speed on."""

    periods_per_second = 1.0

    def __init__(self, study: Any, name: str, speed: float, acceleration: float, torque: float, key: str):
        self.omega_m, self.alpha_m, self.torque, self.scenario = speed, acceleration, torque, key
        self.frozen = f"frozen at {speed:g}" if speed > study.above else None
        self.bad = speed < study.fine

    def worst(self) -> Worst:
        return Worst(1.1 if self.bad else 0.9, 5.0)

    def oscillation(self) -> None:
        return None


def moved(
    monkeypatch: pytest.MonkeyPatch, law: Any, omega: list[float], above: float = 9.0, fine: float = 0.0
) -> _Motion:
    """A reference of half a second a sample, whose acceleration is its speed, and two torque constants."""
    speed = np.array(omega)
    way = SimpleNamespace(time=0.5 * np.arange(len(omega)), omega=speed, alpha=-speed, step=0.5)
    monkeypatch.setattr(module, "course", lambda scenario: way)
    monkeypatch.setattr(module, "loop_type", lambda study, name: Tried)
    monkeypatch.setattr(module, "_torques", lambda *_: [0.9, 1.0])
    study: Any = SimpleNamespace(controller={"x": law}, scenario={"s": None}, above=above, fine=fine)
    return _motion(study, ("s", "x"))


def speeds(found: _Motion) -> list[float]:
    return [each.loop.omega_m for each, _ in found.judged]


ILC = PiIlc.model_construct(learning_start=1.0)


def test_a_reference_is_judged_from_where_learning_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the angle turned at each speed: two samples at 2 rad/s, one at 4; rest is left out."""
    found = moved(monkeypatch, ILC, [9.0, 9.0, 2.0, -2.0, 4.0, 0.0, 0.0199])
    assert speeds(found) == pytest.approx([2.0, 4.0])
    assert [share for _, share in found.judged] == pytest.approx([0.5, 0.5])
    assert found.duration == pytest.approx(2.5) and found.passing is None and found.frozen == ()
    first, _ = found.judged[0]
    assert [(each.torque, each.alpha_m, each.scenario) for each in first.loops] == [
        (0.9, 0.0, "s"), (1.0, 0.0, "s"),
    ]  # fmt: skip
    for top in (4.0, 0.5):
        assert speeds(moved(monkeypatch, ILC, [0.0, 0.0, top, top / 200])) == pytest.approx([top / 200, top])
    for still in ([9.0, 9.0, 0.0], [9.0, 9.0]):
        assert moved(monkeypatch, ILC, still) == _Motion(())


@pytest.mark.parametrize(("mu_h", "accelerations"), [(0.0, [0.0, 0.0]), (0.1, [2.0, 4.0])])
def test_laws_that_rest_have_their_own_least_speed(
    monkeypatch: pytest.MonkeyPatch, mu_h: float, accelerations: list[float]
) -> None:
    """Only those with mu_h see the acceleration."""
    law = SpaceSpeed.model_construct(learning_start=0.0, omega_min=2.0, mu_h=mu_h)
    found = moved(monkeypatch, law, [2.0, 4.0, 1.99])
    assert speeds(found) == pytest.approx([2.0, 4.0])
    assert [each.loop.alpha_m for each, _ in found.judged] == accelerations


def test_speeds_that_freeze_are_not_judged_and_their_ends_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    reference = [0.0, 0.0, 1.0, 2.0, 4.0, 8.0]
    found = moved(monkeypatch, ILC, reference, above=1.5)
    assert speeds(found) == pytest.approx([1.0])
    (low, slow), (high, fast) = found.frozen
    assert (slow, fast) == (f"frozen at {low:g}", "frozen at 8") and high == pytest.approx(8.0)
    assert low == pytest.approx(2.0, rel=0.04)
    nothing = moved(monkeypatch, ILC, [0.0, 0.0, 2.0, 2.0], above=1.5)
    assert nothing == _Motion((), None, ((2.0, "frozen at 2"),), 0.0)


def test_bad_speeds_that_are_only_passed_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sample at 1 rad/s next to rest is half a radian, and a period at 1 rad/s a whole one."""
    reference = [4.0, 4.0, 1.0, 1.0, 0.0, 4.0]
    space = SpaceSpeed.model_construct(learning_start=0.0, omega_min=0.1, mu_h=0.0)
    found = moved(monkeypatch, space, reference, fine=2.0)
    assert speeds(found) == pytest.approx([1.0, 4.0])  # a whole radian, as long as a period: judged
    short = [4.0, 4.0, 1.0, 0.0, 4.0]
    found = moved(monkeypatch, space, short, fine=2.0)
    assert speeds(found) == pytest.approx([4.0]) and [share for _, share in found.judged] == [1.0]
    assert found.passing == Passing(pytest.approx(4.0), 0.5, 5.0, False)
    ilc = moved(monkeypatch, ILC.model_copy(update={"learning_start": 0.0}), short, fine=2.0)
    assert speeds(ilc) == pytest.approx([4.0]) and ilc.passing is None
    only = moved(monkeypatch, space, [0.0, 1.0, 0.0], fine=2.0)  # all of it is such a passage
    assert speeds(only) == [1.0] and only.passing is None


# The mean


class Wave:
    """A loop whose factor is largest at order 4, and falls on both sides like a bell of this width."""

    orders: Any = None
    alpha_m = 0.0

    def __init__(self, speed: float, factor: float, width: float, highest: float = 10.0, sure: bool = False):
        self.periods_per_second, self.highest, self.sure = speed, highest * speed, sure
        self.factor, self.width = factor, width

    def recalled(self, f: Any, constant: bool) -> Any:
        return np.full(np.shape(f), 0.5 if constant else 0.9)

    def unfiltered(self, f: Any) -> Any:
        return self.factor * np.exp(-((np.asarray(f) / self.periods_per_second - 4) ** 2) / self.width)


@pytest.mark.parametrize(
    ("width", "channels", "least", "sure"),
    [(8.0, 1, 1.4, True), (8.0, 9, 1.4, False), (8.0, 1, 0.8, False), (0.8, 1, 1.4, False)],
)
def test_the_mean_is_that_of_logarithms_at_an_order(
    monkeypatch: pytest.MonkeyPatch, width: float, channels: int, least: float, sure: bool
) -> None:
    """It is sure if its bound, with the least torque constant, is above one for a whole order."""
    monkeypatch.setattr(module, "_channels", lambda judged: channels)
    slow, fast = at(Wave(1.0, least, width), Wave(1.0, 1.5, width)), at(Wave(2.0, 1.2, width, highest=15.0))
    found = _mean([(slow, 0.25), (fast, 0.75)])
    assert found.factor == pytest.approx(0.9 * 1.5**0.25 * 1.2**0.75, rel=1e-4)
    orders = np.linspace(1, 10, 2000)  # up to the least that a speed can hold
    order = orders[np.argmin(np.abs(orders - 4))]
    assert (found.lowest, found.highest) == pytest.approx((order, 2 * order), rel=1e-9)
    assert found.sure == sure


def test_at_a_constant_speed_the_loops_may_be_sure_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_channels", lambda judged: pytest.fail("one speed is one function"))
    found = _mean([(at(Wave(2.0, 1.8, 8.0)), 1.0)])
    assert (found.factor, found.lowest, found.sure) == (pytest.approx(0.9, rel=1e-4), found.highest, False)
    assert _mean([(at(Wave(2.0, 2.4, 80.0)), 1.0)]).sure
    for others, sure in (((True, True), True), ((False, True), False)):
        loops = [Wave(2.0, 1.8, 8.0, sure=each) for each in others]
        assert _mean([(at(*loops), 1.0)]).sure == sure


def test_orders_that_a_law_learns_are_judged_alone() -> None:
    slow, fast = Wave(1.0, 1.5, 8.0), Wave(2.0, 1.5, 8.0)
    slow.orders, fast.orders = np.array([2.0, 6.0, 7.0]), np.array([2.0])
    slow.study = fast.study = SimpleNamespace(controller={"x": ILC})
    slow.controller = fast.controller = "x"
    found = _mean([(at(slow), 0.5), (at(fast), 0.5)])
    assert (found.lowest, found.highest) == (2.0, 4.0)
    assert found.factor == pytest.approx(0.9 * 1.5 * math.exp(-0.5)) and not found.sure
    slow.factor = fast.factor = 1.02 / 0.9 * math.exp(0.5)
    assert _mean([(at(slow), 0.5), (at(fast), 0.5)]).sure  # by a single order


@pytest.mark.parametrize(
    ("law", "alpha_m", "channels"),
    [
        (PiIlc.model_construct(), 1.0, 1),
        (SpacePosition.model_construct(mu_alpha=1.0, mu_beta=1.0, mu_h=1.0), 1.0, 3),
        (SpacePosition.model_construct(mu_alpha=1.0, mu_beta=1.0, mu_h=1.0), 0.0, 2),
        (SpacePosition.model_construct(mu_alpha=1.0, mu_beta=0.0, mu_h=1.0), 1.0, 2),
        (SpacePosition.model_construct(mu_alpha=0.0, mu_beta=0.0, mu_h=1.0), 0.0, 1),
    ],
)
def test_functions_that_learn_have_a_gain_and_for_mu_h_an_acceleration(
    law: Any, alpha_m: float, channels: int
) -> None:
    study = SimpleNamespace(controller={"x": law})
    points: Any = [
        (at(SimpleNamespace(alpha_m=alpha, study=study, controller="x")), 0.5) for alpha in (0.0, alpha_m)
    ]
    assert _channels(points) == channels


# The remedy


def curable(
    kind: type[Any], *factors: float, leads: set[int] | None = None, widest: int = 9, forgetting: float = 0.5
) -> Any:
    """A loop whose factor without filter is given at 1, 2 ... Hz; half width n keeps 1 / (1 + n) of it."""
    own: dict[str, Any] = {
        "settling_leads": lambda self: leads or set(),
        "plant": SimpleNamespace(period=1e-3),
        "frequencies": np.arange(1.0, len(factors) + 1),
        "unfiltered": lambda self, f: np.array(factors)[np.asarray(f, int) - 1],
        "widest_filter": widest,
        "forgetting": forgetting,
        "q": lambda self, f, n=None: np.full(len(f), forgetting / (1 + (1 if n is None else n))),
    }
    return type("Curable", (kind,), own)(None, "x", 1.0)


def test_the_first_remedy_is_the_shortest_lead_that_all_points_share() -> None:
    points = [at(curable(PeriodicLoop, 2.0, leads={7, 4, 5})), at(curable(PeriodicLoop, leads={3, 5, 7}))]
    assert _repair(points) == Repair(lead=5e-3)
    orders = [at(curable(OrderLoop, 2.0, leads={4})), at(curable(OrderLoop, 2.0))]
    assert _repair(orders) == Repair()


@pytest.mark.parametrize(
    ("factors", "widest", "repair"),
    [
        ((0.9, 2.0), 9, Repair(q_half_width=0)),
        ((0.9, 3.0), 9, Repair(q_half_width=1)),
        ((8.0, 3.0), 9, Repair(q_half_width=3)),
        ((8.0, 3.0), 3, Repair(q_half_width=3)),
        ((8.0, 3.0), 2, Repair()),
        ((0.5 * 401.0, 1.0), 1000, Repair(q_half_width=100)),
        ((2.0 * (FILTER_WIDTH_MOST + 1), 1.0), 1000, Repair(q_half_width=FILTER_WIDTH_MOST)),
        ((2.0 * (FILTER_WIDTH_MOST + 2), 1.0), 1000, Repair()),
    ],
)
def test_without_such_a_lead_it_is_the_narrowest_filter(
    factors: tuple[float, ...], widest: int, repair: Repair
) -> None:
    """One that is enough at all points with all torque constants, and fits into every period."""
    least, most = curable(SpaceLoop, factors[0], widest=1000), curable(SpaceLoop, 1.5, widest=1000)
    points = [at(curable(SpaceLoop, 0.5, widest=widest)), at(least, most)]
    assert _repair([*points, at(curable(SpaceLoop, 1.0, factors[1], widest=1000))]) == repair


def test_where_no_filter_is_wide_enough_it_is_forgetting() -> None:
    """In hundredths, rounded down: the filter as it is leaves 3.5 of 7, and 1 / 3.5 is 0.2857."""
    points = [at(curable(PeriodicLoop, 2.5, 7.0, widest=2)), at(curable(PeriodicLoop, 6.0, widest=2))]
    assert _repair(points) == Repair(forgetting=0.28)


def test_a_verdict_says_nothing_that_it_isnt_told() -> None:
    left_out = Verdict("settles")
    assert (left_out.omega_m, left_out.varies, left_out.ratio, left_out.unit) == (0.0, False, 1.0, "rad/s")
    assert left_out.fine and left_out.in_words() == "settles"
    assert (
        not Verdict("settles", ratio=HARMFUL_RATIO + 1e-9).fine
        and Verdict("settles", ratio=HARMFUL_RATIO).fine
    )
