"""The C library's guard: what it decides, from the errors that it sees."""

import math
import random
from itertools import pairwise

import numpy as np
import pytest
from control_library import control_library
from hypothesis import given, settings
from hypothesis import strategies as st

PRECISIONS = pytest.mark.parametrize("precision", ["float", "double"])
TS, OMEGA = 1e-3, 2 * math.pi * 3.9  # a window is a turn, just above 0.25 s
WINDOW = 257
STEPS = 6
START, LEARN, HOLD, PART, ALONE, FORGET, MUTE = range(7)


class Guard:
    """A guard, and a drive whose ripple depends on what the guard lets act."""

    def __init__(self, precision="double"):
        library = control_library(precision)
        self.lib, self.state, self.input = (
            library.lib,
            library.new("cgl_guard"),
            library.new("cgl_guard_input"),
        )
        assert self.lib.cgl_guard_init(self.state, TS) == self.lib.CGL_OK
        self.n = 0

    @property
    def phase(self):
        return self.state.phase

    @property
    def learns(self):
        return self.state.phase == LEARN and self.state.share == 1

    def step(self, error, omega_ref=OMEGA, plausible=True, saturated=False, learn=True, learned=None):
        learned = learn and self.learns if learned is None else learned
        self.input[0] = (error, omega_ref, plausible, saturated, learn, learned)
        self.lib.cgl_guard_step(self.state, self.input)
        self.n += 1

    def run(self, windows, amplitude, until=None, omega=OMEGA, **flags):
        """Steps for so many windows at most, until `until` holds; amplitude: of the ripple, or a function of
        the guard's state. Returns the windows that it took."""
        for n in range(round(windows * WINDOW)):
            if until is not None and until(self.state):
                return n / WINDOW
            size = amplitude(self.state) if callable(amplitude) else amplitude
            self.step(size * math.sin(6 * OMEGA * TS * self.n), omega, **flags)
        return windows


def begun(precision="double", **flags):
    """A guard that knows the ripple of the feedback alone, an amplitude of 1, and lets the law learn."""
    guard = Guard(precision)
    guard.step(0.2 * OMEGA, **flags)  # not yet at its reference, or it would learn at once
    guard.run(4, 1.0, until=lambda s: s.phase == LEARN, **flags)
    assert guard.phase == LEARN and guard.state.alone > 0
    return guard


def hurting(state):
    """Amplitude 1 without what is learned, and 3 with it."""
    return 1 + 2 * state.share


def helping(state):
    return 1 - 0.9 * state.share


def states(*names):
    return lambda state: state.phase in names


@PRECISIONS
def test_the_feedback_is_measured_before_anything_is_learned(precision):
    guard = Guard(precision)
    guard.step(0.2 * OMEGA)
    assert guard.run(9, 1.0, until=states(LEARN)) == pytest.approx(2, abs=0.02)
    assert guard.state.alone == pytest.approx(0.5, rel=0.03)
    run_up = Guard(precision)
    for n in range(9 * WINDOW):
        run_up.step(OMEGA * math.exp(-n / 100) + math.sin(6 * OMEGA * TS * n))
        if run_up.phase == LEARN:
            break
    assert n > 2.9 * WINDOW
    assert run_up.state.alone == pytest.approx(0.5, rel=0.1)  # and not what the run-up left


@PRECISIONS
def test_a_rotor_that_begins_at_its_reference_learns_at_once(precision):
    """Its first window is the bar, and no burst ends it."""
    guard = Guard(precision)
    guard.step(0.05 * OMEGA)
    assert guard.learns
    guard.run(1.01, 1.0)
    assert guard.learns and guard.state.alone == pytest.approx(0.5, rel=0.05)
    assert guard.run(20, 0.95, until=states(HOLD)) == pytest.approx(16, abs=0.1)


@PRECISIONS
def test_learning_that_halves_the_ripple_is_tested_by_a_quarter_of_its_share_and_rarely(precision):
    guard = begun(precision)
    shares, tests = set(), []
    for n in range(1000 * WINDOW):
        before = guard.phase
        guard.step(helping(guard.state) * math.sin(6 * OMEGA * TS * guard.n))
        shares.add(round(float(guard.state.share), 3))
        if guard.phase == PART != before:
            tests.append(n / WINDOW)
    assert min(shares) == 0.75 and guard.state.gentle == 1
    assert 120 < tests[0] < 135  # each of 128 windows counts an eighth
    assert tests[1] - tests[0] > 1.9 * tests[0] and len(tests) == 3


@PRECISIONS
@pytest.mark.parametrize("gain", [0.02, 0.0, -0.02])
def test_learning_that_changes_little_is_never_taken_away(precision, gain):
    """Three quarters of it show that the whole does no harm, as where a sensor's noise hides the ripple."""
    guard = begun(precision)
    shares, tests = set(), 0
    for _ in range(200 * WINDOW):
        before = guard.phase
        guard.step((1 - gain * guard.state.share) * math.sin(6 * OMEGA * TS * guard.n))
        shares.add(round(float(guard.state.share), 3))
        tests += guard.phase == PART != before
    assert min(shares) == 0.75 and tests >= 3
    assert guard.state.alone == pytest.approx(0.5, rel=0.1) and guard.state.gentle == 1


@PRECISIONS
def test_learning_that_begins_late_is_no_table(precision):
    """A table is tested four windows after the start; what is learned later, at the 16th."""
    table, late = begun(precision, learn=False), begun(precision, learn=False)
    assert table.run(30, 1.0, until=states(HOLD), learn=False) < 7
    assert late.run(1.5, 1.0, until=states(HOLD), learn=False) == 1.5
    assert late.run(30, 0.95, until=states(HOLD)) > 10


@PRECISIONS
def test_learning_that_hurts_is_taken_away_and_learned_more_gently(precision):
    guard = begun(precision)
    guard.run(5, 0.8)
    assert guard.run(20, hurting, until=states(HOLD)) <= 2.5 and guard.state.share == 1
    assert guard.run(20, hurting, until=states(ALONE)) <= 2.5
    assert guard.run(40, hurting, until=states(FORGET, HOLD)) <= 3.1 and guard.state.share == 0
    assert guard.phase == FORGET  # by one test, as it makes three times the ripple
    cleared = guard.run(20, hurting, until=states(MUTE))
    assert 1.55 < cleared < 1.65  # every cell has been passed, and those that a Q filter waits for
    guard.run(20, hurting, until=lambda s: guard.learns)
    assert guard.state.gentle == 3  # two steps, as it did harm at once
    waited = guard.run(1000, 0.8, until=lambda s: s.gentle == 2)
    assert 120 < waited < 145 and guard.state.retry == 128


@PRECISIONS
def test_one_test_is_no_proof(precision):
    """A disturbance while all of what is learned acts, and none while nothing does: it has to come twice."""
    guard = begun(precision)
    guard.run(3, 0.8)
    guard.run(9, 1.9, until=states(ALONE))
    guard.run(9, 1.0, until=states(HOLD))
    assert guard.state.evidence == 2
    guard.run(5, 0.8)
    assert guard.phase == LEARN and guard.state.gentle == 1


@PRECISIONS
def test_two_tests_convict_what_makes_less_than_twice_the_ripple(precision):
    guard = begun(precision)
    guard.run(5, 0.8)
    tests = []
    for _ in range(40 * WINDOW):
        before = guard.phase
        guard.step((1 + 0.8 * guard.state.share) * math.sin(6 * OMEGA * TS * guard.n))
        if guard.phase == ALONE != before:
            tests.append(guard.n)
        if guard.phase == FORGET:
            break
    assert guard.phase == FORGET and len(tests) == 2


@PRECISIONS
def test_a_ripple_that_ends_whenever_learning_pauses_is_made_by_learning(precision):
    guard = begun(precision)
    taken = guard.run(80, lambda state: 3.0 if guard.learns else 0.8, until=lambda s: s.gentle > 1)
    assert 8 < taken < 20


@PRECISIONS
def test_a_parabola_bounds_the_ripple_without_what_is_learned(precision):
    """Amplitude 1 alone and 0.1 with all that is learned: P(3/4) gives P(0) without a look at it."""
    guard = begun(precision)
    guard.run(300, helping, until=states(PART))
    guard.state.alone = 0.004  # a bar so low that learning is above it
    guard.run(9, helping, until=states(LEARN))
    assert 0.19 < guard.state.alone <= 0.5  # 4 (1 - 0.9 * 0.75)^2 / 2 - 3 * 0.1^2 / 2


@PRECISIONS
def test_a_bar_above_what_learning_leaves_costs_no_second_window_of_a_test(precision):
    guard = begun(precision)
    guard.run(300, helping, until=states(PART))
    guard.state.alone = 0.1
    assert guard.run(9, helping, until=states(LEARN)) < 2
    assert guard.state.alone == pytest.approx(0.1)


@PRECISIONS
def test_a_reference_that_moved_in_a_test_is_no_reason_for_another_soon(precision):
    """Each window has another speed than the test had; this alone must not bring the next one."""
    guard, tests = begun(precision), []
    for _ in range(700 * WINDOW):
        speed = OMEGA * (1 + 0.5 * math.sin(0.7 * guard.n / WINDOW))
        before = guard.phase
        guard.step(helping(guard.state) * math.sin(6 * OMEGA * TS * guard.n), omega_ref=speed)
        if guard.phase == PART != before:
            tests.append(guard.n)
    gaps = np.diff(tests)
    assert len(gaps) >= 1 and gaps[0] > 1.6 * tests[0]


@PRECISIONS
def test_the_bound_of_the_parabola_holds_for_any_frozen_map(precision):
    """P(0) >= (P(3/4) - 3/4 P(1)) / (1/4), for errors that are a sum of the feedback's and the map's."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        alone, learned = rng.normal(size=(2, 64))
        power = [float(np.mean((alone + s * learned) ** 2)) for s in (0, 0.75, 1)]
        assert power[0] >= (power[1] - 0.75 * power[2]) / 0.25 - 1e-12
        if power[1] > power[2]:
            assert power[0] > power[2]


@PRECISIONS
def test_ripple_just_below_half_the_sampling_rate_is_seen(precision):
    """Less ripple of order 6, and more at three quarters of that rate: a mean of two samples hides it."""
    guard = begun(precision)
    for n in range(40 * WINDOW):
        low, high = math.sin(6 * OMEGA * TS * n), math.sin(0.75 * math.pi * n + 0.3)
        share = guard.state.share
        guard.step(low + share * (1.3 * high - 0.15 * low))
        if guard.phase == FORGET:
            break
    assert guard.phase == FORGET and n < 20 * WINDOW


def test_counts_that_telescope_weigh_less():
    """Speed from counts of an encoder: a white error of the angle, differenced."""
    guard, angle, last = Guard(), random.Random(1), 0.0
    for _ in range(3 * WINDOW):
        now = angle.uniform(-1.0, 1.0)
        guard.step(now - last, learn=False)
        last = now
    variance = 2.0 / 3.0
    assert guard.state.alone == pytest.approx(0.25 * variance, rel=0.2)
    assert guard.state.noise == pytest.approx(0.75 * variance, rel=0.2)


@PRECISIONS
@pytest.mark.parametrize("factor", [1.5, 5.0])
def test_a_load_with_more_ripple_is_no_fault_of_learning(precision, factor):
    guard = begun(precision)
    guard.run(20, 0.8)
    guard.run(25, factor)  # with and without what is learned
    assert guard.state.gentle == 1 and guard.state.alone == pytest.approx(factor**2 / 2, rel=0.05)
    for _ in range(100):
        guard.run(1, factor)
        assert guard.state.gentle == 1


@PRECISIONS
def test_a_shock_convicts_nothing(precision):
    guard = begun(precision)
    for _ in range(20):
        guard.run(16.2, lambda state: 1 - 0.6 * state.share)
        guard.run(0.25, 8.0)
    guard.run(9, helping)
    assert guard.state.gentle == 1 and guard.learns


@PRECISIONS
def test_a_weak_bus_is_no_fault_of_learning(precision):
    guard = begun(precision)
    guard.run(6, 0.4)
    for n in range(3 * WINDOW):
        guard.step(20.0 + math.sin(n), saturated=True, learned=False)
        assert guard.phase == LEARN
    for n in range(WINDOW):  # and the speed comes back
        guard.step(20.0 * math.exp(-n / 10))
    guard.run(9, 0.4)
    assert guard.state.gentle == 1 and guard.learns


@PRECISIONS
def test_a_map_that_drives_the_rotor_to_its_limit_is_found_and_cleared(precision):
    """Learned under a load that is gone. Nothing is learned at the limit, so it would stay there."""
    guard = begun(precision)
    guard.run(20, 0.4)
    for n in range(60 * WINDOW):
        acts = guard.state.share > 0
        guard.step((8.0 if acts else 1.0) * math.sin(6 * OMEGA * TS * n), saturated=acts, learned=False)
        if guard.state.gentle > 1:
            break
    assert 16 < n / WINDOW < 40


@PRECISIONS
def test_a_bar_of_a_rotor_that_stalls_is_none(precision):
    """A load holds the rotor with and without what is learned. The bar is that of the rotor that turned."""
    guard = begun(precision)
    guard.run(9, 0.8)
    for n in range(40 * WINDOW):
        guard.step(0.8 * OMEGA + math.sin(6 * OMEGA * TS * n), learned=False)
    assert guard.state.alone < 1 and guard.state.gentle == 1


@PRECISIONS
def test_a_burst_needs_no_whole_window_and_no_ramp(precision):
    guard = begun(precision)
    guard.run(5, 0.8)
    assert guard.run(5, 40.0, until=states(HOLD)) < 0.1
    assert guard.run(5, 40.0, until=states(ALONE)) < 0.1 and guard.state.share == 0


@PRECISIONS
def test_a_table_that_hurts_is_switched_off_and_not_cleared(precision):
    """The caller wants no learning, and the ripple at the start has the table in it."""
    guard = Guard(precision)
    seen = set()
    for _ in range(60 * WINDOW):
        guard.step(hurting(guard.state) * math.sin(6 * OMEGA * TS * guard.n), learn=False)
        seen.add(guard.phase)
    assert FORGET not in seen and guard.phase == MUTE and guard.state.share == 0
    again = guard.run(200, hurting, until=lambda s: s.share == 1, learn=False)
    assert again > 50  # it is tried again after 128 windows, and then after 256
    guard.run(40, hurting, learn=False)
    assert guard.state.retry == 256 and guard.phase == MUTE


@PRECISIONS
def test_a_table_that_helps_is_left_alone(precision):
    guard = Guard(precision)
    shares = set()
    for _ in range(100 * WINDOW):
        guard.step(helping(guard.state) * math.sin(6 * OMEGA * TS * guard.n), learn=False)
        shares.add(round(float(guard.state.share), 3))
    assert min(shares) == 0.75 and guard.state.gentle == 1


@PRECISIONS
def test_a_stored_map_that_hurts_is_cleared_and_learned_anew(precision):
    guard = Guard(precision)
    assert guard.run(60, hurting, until=states(FORGET)) < 30


@PRECISIONS
def test_a_reference_that_moves_changes_no_bar(precision):
    guard = begun(precision)
    alone = guard.state.alone
    for n in range(200 * WINDOW):
        omega = OMEGA * (1 + 0.6 * math.sin(OMEGA * TS * n / 9))
        guard.step(helping(guard.state) * (omega / OMEGA) ** 2 * math.sin(6 * OMEGA * TS * n), omega)
        assert guard.state.gentle == 1
    assert guard.state.alone == pytest.approx(alone, rel=0.5) or guard.state.alone < alone


@PRECISIONS
def test_at_the_last_step_nothing_is_learned_and_it_is_tried_again_much_later(precision):
    guard = begun(precision)
    taken = guard.run(400, hurting, until=lambda s: s.gentle == STEPS and s.phase == MUTE)
    assert taken < 80 and guard.state.share == 0
    retry = guard.state.retry
    waited = guard.run(1000, hurting, until=lambda s: s.share == 1)
    assert retry - 10 < waited < retry + 5 and guard.state.gentle == STEPS - 1


@PRECISIONS
def test_harm_that_comes_back_is_met_ever_more_rarely(precision):
    """The waits double, so the share of harmful time falls."""
    guard = begun(precision)
    harmful = np.array([])
    for _ in range(3000):
        guard.run(1, hurting)
        harmful = np.append(harmful, guard.state.share > 0)
    parts = [np.mean(part) for part in np.split(harmful, 3)]
    assert parts[2] < parts[0] and np.mean(harmful) < 0.05 and guard.state.retry >= 1024


@PRECISIONS
def test_a_mean_that_moves_is_no_burst(precision):
    guard = begun(precision)
    guard.run(3, 0.8)
    for n in range(40 * WINDOW):
        guard.step(2.0 + 0.8 * math.sin(6 * OMEGA * TS * n))
        assert guard.state.gentle == 1 and (guard.learns or n > 6 * WINDOW)


@PRECISIONS
def test_samples_that_are_none_are_ignored(precision):
    guard = begun(precision)
    for n in range(6 * WINDOW):
        guard.step(math.nan if n % 3 else 1e30)
        guard.step(1e6, plausible=False)
    guard.run(10, 0.8)
    assert guard.learns and guard.state.gentle == 1 and abs(guard.state.mean) < 1


@pytest.mark.parametrize("omega", [0.05, 1.0, 3.0, 25.0, 300.0, 5000.0])
def test_a_window_is_whole_turns_of_a_quarter_second_or_more(omega):
    guard = Guard()
    guard.step(0.0, omega)
    turns = (guard.state.length - 1) * TS * omega / 2 / math.pi
    assert 250 <= guard.state.length <= 2501
    assert guard.state.length >= 2500 or abs(turns - round(turns)) < omega * TS / 3


ANYTHING = st.one_of(st.floats(width=32), st.floats(-300, 300, width=32))


@PRECISIONS
@settings(max_examples=25, deadline=None)
@given(
    parts=st.lists(
        st.tuples(ANYTHING, ANYTHING, *[st.booleans()] * 4, st.integers(1, 300)),
        max_size=12,
    )
)
def test_whatever_comes_in_the_share_stays_within_0_and_1(precision, parts):
    guard = Guard(precision)
    state = guard.state
    for *values, count in parts:
        for n in range(count):
            guard.step(values[0] * (1 - 2 * (n % 2)), *values[1:])
            assert 0 <= state.share <= 1 and 1 <= state.gentle <= STEPS and state.phase <= MUTE
            assert math.isfinite(state.mean)


def test_the_gain_is_at_most_the_feedbacks_own_and_smaller_from_step_to_step():
    library = control_library("double")
    steps = [library.lib.cgl_gentle_steps[k] for k in range(STEPS + 1)]
    assert (steps[0].gain, steps[0].forgetting, steps[STEPS].gain) == (1, 1, 0)
    for before, after in pairwise(steps[1:]):
        assert after.most * after.gain < before.most * before.gain and after.forgetting < before.forgetting
    # whatever the phase, 1.25 times at most where |T| is up to 1.28 / k_p: gain |T| <= (1 - forgetting) / 5
    last = steps[STEPS - 1]
    assert 1.28 * last.most * last.gain <= (1 - last.forgetting) / 5 + 1e-9


@pytest.mark.parametrize("ts", [0.0, -1e-3, math.nan, math.inf])
def test_a_period_that_is_none_is_refused(ts):
    library = control_library("double")
    assert library.lib.cgl_guard_init(library.new("cgl_guard"), ts) == library.lib.CGL_ERROR_CONFIG
