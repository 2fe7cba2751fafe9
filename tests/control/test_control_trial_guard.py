"""The guard of the trial law on axes of a few lines that it does not know: limits, payloads, wrong models."""

import math
import re
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from control_library import ControlLibrary, control_library
from reference.trial import Trial
from scipy.signal import butter
from test_control_trial import CTrial

PERIOD, SAMPLES = 0.002, 200
WORSE = 1.05


@dataclass
class Axis:
    """strength: rad/s^2 by one unit of the input; damping: 1/s; load: of the input, in the second half."""

    strength: float = 2000.0
    damping: float = 2.0
    load: float = 0.0
    start: float = 0.0  # rad

    def error(self, law: CTrial | Trial, y_ref: np.ndarray) -> float:
        """RMS of the error of one trial, which the law ends."""
        decay = math.exp(-self.damping * PERIOD)
        b_1 = (1 - decay) / self.damping
        b_0 = (PERIOD - b_1) / self.damping
        y, speed, errors = self.start, 0.0, []
        law.begin(y_ref)
        for p, wanted in enumerate(y_ref):
            errors.append(wanted - y)
            push = self.strength * (law.step([y, speed]) - self.load * (p > len(y_ref) // 2))
            y, speed = y + b_1 * speed + b_0 * push, decay * speed + b_1 * push
        law.end()
        return float(np.sqrt(np.mean(np.square(errors))))


def motion(angle: float = 20.0) -> np.ndarray:
    """There in 0.24 s, with a jerk that is bounded."""
    z = np.clip((np.arange(SAMPLES) * PERIOD - 0.02) / 0.24, 0, 1)
    return angle * (10 * z**3 - 15 * z**4 + 6 * z**5)


NOMINAL = Axis()
# of the input, without friction
NEED = float(np.abs(np.diff(motion(), 2)).max()) / PERIOD**2 / NOMINAL.strength


def law(kind: str, limit: float, guarded: bool = True, learning: bool = True) -> Trial:
    """Designed for the nominal axis without its friction: `gain` and `signal` filter at 30 Hz."""
    g = NOMINAL.strength * PERIOD**2
    b, a = butter(2, 30 * 2 * PERIOD)
    plain = Trial(
        SAMPLES,
        [-0.055 / g, -0.3 * PERIOD / g],
        0.0,
        0.055 / g,
        [1.0, 0.0],
        False,
        0.7 * learning,
        8,
        limit,
        1e3,
        [0.055 / g + (1 + 0.3) / g, -(2 + 0.3) / g, 1 / g],  # the inverse of the closed loop
        [1.0],
        1,
        list(b),
        list(a),
        filter_signal=kind == "signal",
        unguarded=not guarded,
    )
    if kind in ("gain", "signal"):
        return plain
    if kind == "observer":
        ahead = replace(plain, k_1=[0.0, 0.0], n=1.0, k_3=1.0 * learning, shift=2, num=[1 / g, -2 / g, 1 / g])
        return replace(ahead, response=g, pole=0.38, filter_signal=True)
    one = replace(plain, unguarded=True, num=[], limit=1e9, k_3=0.0)
    rows = lifted(one)
    L = np.linalg.solve(rows.T @ rows + 0.01 * np.eye(SAMPLES), rows.T)
    return replace(plain, learning_matrix=L if learning else None, k_3=0.0, b=[1.0], a=[1.0])


def lifted(loop: Trial) -> np.ndarray:
    """From v to y of the closed loop on an axis without friction."""
    A = np.array([[1, PERIOD], [0, 1]])
    B = NOMINAL.strength * np.array([PERIOD**2 / 2, PERIOD])
    closed, x, response = A + np.outer(B, loop.k_1), B * loop.n, [0.0]
    for _ in range(SAMPLES - 1):
        response.append(float(x[0]))
        x = closed @ x
    return np.array([[response[p - q] if p >= q else 0.0 for q in range(SAMPLES)] for p in range(SAMPLES)])


def run(of: Trial, axes: list[tuple[int, Axis]], library: ControlLibrary | None = None) -> np.ndarray:
    """Errors of so many trials on each axis in turn, mrad."""
    c = CTrial(library or control_library("double"), of)
    return 1e3 * np.array([axis.error(c, motion()) for trials, axis in axes for _ in range(trials)])


def longest_above(errors: np.ndarray, feedback: np.ndarray) -> int:
    """The most trials in a row that are above the feedback's."""
    above = ~(errors <= WORSE * feedback)
    return max((len(list(group)) for is_above, group in groupby(above) if is_above), default=0)


KINDS = ["gain", "signal", "matrix", "observer"]
SHORT = 0.88 * NEED  # a limit that the motion needs more than
PAYLOAD = [(40, NOMINAL), (40, Axis(strength=2000 / 1.35))]
CASES: dict[str, tuple[float, list[tuple[int, Axis]]]] = {
    "limit": (SHORT, [(80, NOMINAL)]),
    "payload": (1.15 * NEED, PAYLOAD),
    "payload and load": (1.15 * NEED, [(40, NOMINAL), (40, Axis(strength=2000 / 1.35, load=0.3))]),
    "payload removed": (1.15 * NEED, PAYLOAD[::-1]),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("kind", KINDS)
def test_learning_never_leaves_more_than_the_feedback_for_long(kind, case):
    limit, axes = CASES[case]
    errors, feedback = (run(law(kind, limit, learning=learning), axes) for learning in (True, False))
    assert longest_above(errors, feedback) <= 5
    for begin, end in ((20, 40), (60, 80)):
        assert np.sqrt(np.mean(errors[begin:end] ** 2)) <= WORSE * np.sqrt(np.mean(feedback[begin:end] ** 2))


@pytest.mark.parametrize("case", CASES)
def test_without_the_guard_the_matrix_diverges(case):
    """The cases are hard enough: several times the feedback's error, and for as long as they last."""
    limit, axes = CASES[case]
    errors = run(law("matrix", limit, guarded=False), axes)
    feedback = run(law("matrix", limit, learning=False), axes)
    assert longest_above(errors, feedback) > 30 and errors[-1] > 3 * feedback[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_where_learning_helps_the_guard_does_nothing(kind):
    """Not at the limit, with friction and an inertia that the design did not know: the same bits."""
    axes = [(30, Axis(strength=1700.0, damping=6.0))]
    guarded, unguarded = (run(law(kind, 3 * NEED, guarded), axes) for guarded in (True, False))
    assert guarded.tobytes() == unguarded.tobytes()
    assert guarded[-1] < 0.5 * guarded[0]


@pytest.mark.parametrize("kind", KINDS)
def test_what_was_best_does_not_convict_for_ever(kind):
    """After a payload with a load the errors of old are out of reach; learning goes on and gets near them."""
    axes = [(30, NOMINAL), (40, Axis(strength=2000 / 1.3, load=0.4))]
    errors = run(law(kind, 4 * NEED), axes)
    feedback = run(law(kind, 4 * NEED, learning=False), axes)
    assert errors[30] > 2 * errors[29]
    assert errors[-1] < 0.5 * feedback[-1]


def test_harm_becomes_rare_and_small():
    """A matrix of the wrong sign: each try is later than the one before and does less."""
    wrong = law("matrix", 5 * NEED)
    assert wrong.learning_matrix is not None
    errors = run(replace(wrong, learning_matrix=-wrong.learning_matrix), [(400, NOMINAL)])
    harmful = np.flatnonzero(errors > WORSE * errors[0])
    assert len(harmful) <= 4 and harmful[-1] < 20
    assert (errors[100:] <= WORSE * errors[0]).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("case", CASES)
def test_the_guard_equals_its_transcription(kind, case):
    """Decision for decision; v to rounding, where what a limit makes of it does not tear it apart."""
    limit, axes = CASES[case]
    reference = law(kind, limit)
    c = CTrial(control_library("double"), reference)
    acted = 0
    for trials, axis in axes:
        for _ in range(trials):
            shared = Both(c, reference)
            axis.error(shared, motion())
            guard, own = c.state.guard, reference.guard
            assert guard.phase == ["LEARN", "REPLAY", "HOLD", "COMPARE"].index(own.phase)
            assert (guard.strikes, guard.wait, guard.returns) == (own.strikes, own.wait, own.returns)
            assert abs(c.v - reference.v).max() <= 1e-9 * (1 + abs(reference.v).max())
            acted += guard.phase != 0
    assert acted or kind != "matrix"


class Both(CTrial):
    """Steps the transcription with what the C law measures, and with its v, so that roundings stay small."""

    def __init__(self, c: CTrial, reference: Trial) -> None:
        self.c, self.reference = c, reference

    def begin(self, y_ref: np.ndarray) -> None:
        samples = self.c.samples
        self.reference.v = self.c.v
        self.reference.best_v = self.c.memory[-samples:].copy()
        self.c.begin(y_ref)
        self.reference.begin(y_ref)

    def step(self, x: np.ndarray, learn: bool = True) -> float:
        u = self.c.step(x, learn)
        assert self.reference.step(x, learn) == pytest.approx(u, abs=1e-9)
        return u

    def end(self) -> bool:
        ended = self.c.end()
        assert self.reference.end() == ended
        return ended


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("kind", KINDS)
def test_random_axes(kind, seed):
    """Inertia within 40 %, friction, start offsets, loads, a limit that may be short: five trials."""
    rng = np.random.default_rng([37, seed])
    limit = NEED * float(rng.choice([0.85, 0.95, 1.1, 1.5]))
    start = float(rng.choice([0.0, 0.02]))
    first, then = (
        Axis(2000 / rng.uniform(0.7, 1.4), rng.uniform(0.5, 8), rng.uniform(-0.3, 0.3) * NEED, start)
        for _ in range(2)
    )
    axes = [(30, first), (30, then)]
    errors, feedback = (run(law(kind, limit, learning=learning), axes) for learning in (True, False))
    assert longest_above(errors, feedback) <= 5


# ---- decisions, one by one ----


class Guard:
    def __init__(self, library: ControlLibrary) -> None:
        self.lib, self.state = library.lib, library.new("cgl_trial_guard")
        self.lib.cgl_trial_guard_reset(self.state)

    def judge(self, rms: float, none: bool = False, limited: bool = False) -> set[str]:
        self.state.error, self.state.limited = rms * rms, limited
        verdict = self.lib.cgl_trial_guard_judge(self.state, none)
        return {name for name in ("store", "back", "clear", "learn") if getattr(verdict, name)}

    @property
    def phase(self) -> int:
        return int(self.state.phase)


@pytest.fixture(params=["float", "double"])
def guard(request) -> Guard:
    return Guard(control_library(request.param))


def test_the_first_trial_is_the_feedback_and_the_best(guard):
    assert guard.judge(10.0, none=True) == {"store", "learn"}
    assert guard.state.feedback == guard.state.best == 100.0


def test_growth_that_goes_on_brings_the_best_back(guard):
    guard.judge(10.0, none=True)
    assert guard.judge(2.0) == {"store", "learn"}
    assert guard.judge(2.9) == {"learn"}  # within 1.5 times the best
    assert guard.judge(3.1) == {"learn"}  # the plant may have changed: then learning makes it fall
    assert guard.judge(3.05) == {"back"}
    assert guard.phase == guard.lib.CGL_TRIAL_REPLAY
    assert guard.judge(2.1) == set()  # the plant is as it was
    assert guard.phase == guard.lib.CGL_TRIAL_HOLD and guard.state.strikes == 1
    assert guard.state.share == 0.125
    assert [guard.judge(2.1) for _ in range(3)] == [set(), set(), {"learn"}]
    assert guard.phase == guard.lib.CGL_TRIAL_LEARN
    assert guard.judge(4.3) == {"back"}  # a try after a strike has one trial
    assert guard.judge(2.1) == set() and guard.state.strikes == 2
    assert [guard.judge(2.1) for _ in range(15)] == [set()] * 14 + [{"learn"}]


def test_a_quarter_of_the_error_takes_a_strike_back(guard):
    guard.judge(10.0, none=True)
    assert [guard.judge(11.0), guard.judge(11.0), guard.judge(10.0, none=True)][-1] == set()
    while guard.phase != guard.lib.CGL_TRIAL_LEARN:
        guard.judge(10.0, none=True)
    strikes = []
    for rms in (9.0, 8.0, 6.0, 5.1, 4.9):
        guard.judge(rms)
        strikes.append(guard.state.strikes)
    assert strikes == [1, 1, 1, 1, 0] and guard.state.share == 1.0


@pytest.mark.parametrize(("rms", "changed"), [(1.8, True), (1.83, False), (2.18, False), (2.25, True)])
def test_held_v_tells_another_plant(guard, rms, changed):
    """Also one that would be easier now, which no growth shows."""
    guard.judge(10.0, none=True)
    guard.judge(2.0)
    assert [guard.judge(4.0), guard.judge(4.0), guard.judge(2.0)] == [{"learn"}, {"back"}, set()]
    assert guard.judge(rms) == ({"learn"} if changed else set())
    assert (guard.phase == guard.lib.CGL_TRIAL_HOLD) == (not changed)


def test_at_the_limit_a_little_growth_is_enough(guard):
    guard.judge(10.0, none=True)
    guard.judge(5.0)
    assert [guard.judge(5.4, limited=True) for _ in range(2)] == [{"learn"}, {"back"}]


def test_falling_after_a_jump_is_not_disturbed(guard):
    """The feedback's error is surely above: J is below that of old, and the change was small beside it."""
    guard.judge(100.0, none=True)
    for rms in (10.0, 1.0, 0.1):
        guard.judge(rms)
    assert [guard.judge(x) for x in (8.0, 4.0, 2.0, 1.0)] == [{"learn"}] * 4
    assert guard.judge(0.5) == {"store", "learn"}
    assert guard.phase == guard.lib.CGL_TRIAL_LEARN and guard.state.returns == 0


def test_another_plant_is_told_from_wrong_learning(guard):
    """The best of old has as much error now: v = 0 runs once, and is better."""
    guard.judge(10.0, none=True)
    guard.judge(1.0)
    guard.judge(9.0)
    assert guard.judge(9.1) == {"back"}
    assert guard.judge(9.0) == {"learn"}
    assert guard.phase == guard.lib.CGL_TRIAL_COMPARE
    assert guard.judge(6.0) == {"clear", "learn"}
    assert guard.phase == guard.lib.CGL_TRIAL_LEARN and guard.state.strikes == 0
    assert guard.state.best == guard.state.feedback == 36.0


def test_held_for_long_it_still_sees_another_plant(guard):
    guard.judge(10.0, none=True)
    for _ in range(3):  # strikes
        guard.judge(12.0)
        while guard.phase != guard.lib.CGL_TRIAL_LEARN:
            guard.judge(10.0, none=True)
    guard.judge(12.0)
    assert guard.judge(10.0, none=True) == set() and guard.state.wait > 60
    assert guard.judge(20.0, none=True) == {"learn"}
    assert guard.state.strikes == 0 and guard.state.feedback == 400.0


@pytest.mark.parametrize("limited", [False, True])
def test_no_error_is_too_strange(guard, limited):
    """Infinite, zero, the same for ever, at random: phases go on, the share stays within 0 and 1."""
    rng = np.random.default_rng(5)
    draws = [0.0, 1e-30, 1.0, 1e18, 1e19, math.inf]
    seen = set()
    for trial in range(4000):
        error = draws[int(rng.integers(6))] if trial % 400 < 200 else float(rng.uniform(0, 2))
        guard.judge(error, none=bool(rng.integers(8) == 0), limited=limited)
        seen.add(guard.phase)
        assert guard.state.strikes <= 6 and 0 < guard.state.share <= 1
        assert guard.state.wait < 4**6 and guard.state.above < 5
        assert not math.isnan(guard.state.best) and not math.isnan(guard.state.feedback)
    assert len(seen) == 4


# ---- the law around it ----


def test_v_and_status_in_a_compared_trial():
    """v = 0 acts and stays in the memory; the status says so."""
    c = CTrial(control_library("double"), law("gain", 5 * NEED))
    for _ in range(3):
        NOMINAL.error(c, motion())
    v = c.v
    assert v.any() and not c.status & c.lib.CGL_STATUS_GUARDED
    c.state.guard.phase = c.lib.CGL_TRIAL_COMPARE
    c.begin(motion())
    c.step([0.0, 0.0])
    assert c.terms["learned"] == 0.0 and c.state.v == 0.0
    assert c.status & c.lib.CGL_STATUS_GUARDED
    assert c.v.tobytes() == v.tobytes()


def test_a_trial_that_teaches_nothing_is_not_judged():
    c = CTrial(control_library("double"), law("gain", 5 * NEED))
    NOMINAL.error(c, motion())
    best = c.state.guard.best
    c.begin(motion())
    for _ in range(SAMPLES):
        c.step([1e3, 0.0], learn=False)
    assert not c.end()
    assert c.state.guard.best == best and c.state.guard.phase == c.lib.CGL_TRIAL_LEARN


def test_retune_forgets_what_was_measured_and_keeps_the_memory():
    c = CTrial(control_library("double"), law("gain", 5 * NEED))
    for _ in range(3):
        NOMINAL.error(c, motion())
    v = c.v
    c.config.k_3 = 0.5
    assert c.lib.cgl_trial_retune(c.state, c.config) == c.lib.CGL_OK
    assert c.state.guard.best < 0 and c.state.guard.feedback < 0 and c.v.tobytes() == v.tobytes()
    c.config.unguarded = True
    assert c.lib.cgl_trial_retune(c.state, c.config) == c.lib.CGL_ERROR_CONFIG


@pytest.mark.parametrize("unguarded", [False, True])
def test_the_memory_is_as_long_as_the_header_says(unguarded):
    library = control_library("double")
    of = replace(law("gain", 1.0), unguarded=unguarded)
    c = CTrial(library, of)
    assert len(c.memory) == (3 if unguarded else 4) * SAMPLES
    state, (_, pointer) = library.new("cgl_trial"), library.array(np.zeros(4 * SAMPLES))
    length = len(c.memory)
    assert c.lib.cgl_trial_init(state, c.config, pointer, length - 1) == c.lib.CGL_ERROR_MEMORY
    assert c.lib.cgl_trial_init(state, c.config, pointer, length) == c.lib.CGL_OK


# ---- the observer at the limit ----


def test_the_observer_s_feedback_can_brake_what_it_asks_for():
    """A step of two radians: the speed towards the reference is one that the limit brakes."""
    limit = 1.0
    of = replace(law("observer", limit, learning=False), num=[], den=[1.0])
    c = CTrial(control_library("double"), of)
    axis = Axis(damping=0.01, start=2.0)
    c.begin(np.zeros(SAMPLES))
    y, speed, path = axis.start, 0.0, []
    for _ in range(SAMPLES):
        push = axis.strength * c.step([y, speed])
        y, speed = y + PERIOD * speed + push * PERIOD**2 / 2, speed + PERIOD * push
        path.append(y)
    overshoot = -min(path)
    assert overshoot < 0.01 * axis.start
    assert abs(path[-1]) < 1e-3


def test_within_twice_the_limit_the_observer_s_feedback_is_linear():
    """u stays what the poles say until the error alone asks for more than (3 + p)^2 / 4 times the limit."""
    g, p = NOMINAL.strength * PERIOD**2, 0.38
    of = replace(law("observer", 1e9, learning=False), num=[], limit=1.0)
    for share, linear in ((0.99, True), (1.5, False)):
        c = CTrial(control_library("double"), of)
        error = share * g * (3 + p) ** 2 / 4 / (1 - p) ** 2
        c.begin(np.full(SAMPLES, error))
        c.step([0.0, 0.0])
        asked = (1 - p) ** 2 * error / g
        assert (c.terms["feedback"] == pytest.approx(asked, rel=1e-12)) == linear
        assert linear or c.terms["feedback"] == pytest.approx((3 + p) ** 2 / 4, rel=1e-12)


# ---- what the page says ----

PAGE = Path(__file__).parents[2] / "docs" / "laws" / "trial.md"


@pytest.mark.parametrize("case", ["limit", "payload"])
def test_the_page_s_figures(case):
    limit, axes = CASES[case]
    rows = re.findall(rf"^\| {case} \| (\w+) \|(.*)\|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert [kind for kind, _ in rows] == KINDS
    for kind, numbers in rows:
        feedback = run(law(kind, limit, learning=False), axes)
        expected = []
        for guarded in (False, True):
            errors = run(law(kind, limit, guarded), axes)
            expected += [f"{errors[-1] / feedback[-1]:.2f}", str(longest_above(errors, feedback))]
        assert [number.strip() for number in numbers.split("|")] == expected
