"""The C library's guard: what it decides, from the errors that it sees."""

import math
import random
from itertools import pairwise

import pytest
from control_library import control_library
from hypothesis import given, settings
from hypothesis import strategies as st

PRECISIONS = pytest.mark.parametrize("precision", ["float", "double"])
TS, OMEGA = 1e-3, 2 * math.pi * 4  # a window is a turn, 0.25 s
WINDOW = 250
STEPS = 6


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
    def acts(self):
        return self.state.phase > self.lib.CGL_GUARD_LEARN or self.state.gentle > 1

    def step(
        self, error, omega_m=OMEGA, omega_ref=OMEGA, plausible=True, saturated=False, learn=True, learned=True
    ):
        self.input[0] = (error, omega_m, omega_ref, plausible, saturated, learn, learned)
        self.lib.cgl_guard_step(self.state, self.input)

    def run(self, windows, amplitude, wanted=True, omega=OMEGA, until=None):
        """Steps for so many windows at most, until `until` holds; amplitude: of the ripple, or a function of
        the guard's state. Returns the windows that it took."""
        for n in range(round(windows * WINDOW)):
            if until is not None and until(self.state):
                return n / WINDOW
            size = amplitude(self.state) if callable(amplitude) else amplitude
            error = size * math.sin(6 * OMEGA * TS * self.n)
            self.step(error, omega, omega, learn=wanted, learned=wanted and bool(self.state.learn))
            self.n += 1
        return windows


def hurting(state):
    """Ripple of 1 without what is learned, and of 3 with it."""
    return 1 + 2 * state.share


@PRECISIONS
def test_learning_that_helps_is_left_alone(precision):
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    for amplitude in (1.0, 0.7, 0.5, 0.4, *[0.3] * 300):
        guard.run(1, amplitude)
        assert guard.state.learn and guard.state.share == 1 and not guard.acts and not guard.state.forget


@PRECISIONS
def test_learning_that_hurts_is_stopped_cleared_and_tried_more_gently(precision):
    guard, lib = Guard(precision), control_library(precision).lib
    guard.run(4, 1.0, wanted=False)
    guard.run(5, 0.5)
    assert not guard.acts
    assert guard.run(20, hurting, until=lambda s: not s.learn) <= 3
    assert guard.phase == lib.CGL_GUARD_HOLD and guard.state.share == 1
    assert guard.run(20, hurting, until=lambda s: s.share == 0) <= 4
    assert guard.run(20, hurting, until=lambda s: s.forget) <= 4
    assert guard.state.share == 0
    turned = guard.run(20, hurting, until=lambda s: not s.forget)
    assert 1.5 < turned < 2.1  # every cell has been passed, after those that a Q filter waits for
    assert guard.state.gentle == 2 and not guard.state.learn
    guard.run(3, 0.5)  # learning waits until all of what was learned acts again
    assert guard.state.share == 1 and guard.state.learn and guard.acts


@PRECISIONS
def test_ripple_just_below_half_the_sampling_rate_is_seen(precision):
    """Less ripple of order 6, and more at three quarters of that rate: a mean of two samples hides it."""
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    for n in range(40 * WINDOW):
        low, high = math.sin(6 * OMEGA * TS * n), math.sin(0.75 * math.pi * n + 0.3)
        share = guard.state.share
        guard.step(low + share * (1.3 * high - 0.15 * low), learned=bool(guard.state.learn))
        if guard.state.forget:
            break
    assert guard.state.forget and n < 12 * WINDOW


def test_counts_that_telescope_weigh_less():
    """Speed from counts of an encoder: a white error of the angle, differenced."""
    guard, angle, last = Guard(), random.Random(1), 0.0
    for _ in range(100 * WINDOW):
        now = angle.uniform(-1.0, 1.0)
        guard.step(now - last, learn=False, learned=False)
        last = now
    variance = 2.0 / 3.0
    assert guard.state.baseline[0].slow == pytest.approx(0.25 * variance, rel=0.2)  # of one window
    assert guard.state.baseline[0].fast == pytest.approx(0.75 * variance, rel=0.2)


@PRECISIONS
def test_a_step_is_taken_back_after_a_while_without_trouble(precision):
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    guard.run(40, hurting, until=lambda s: s.gentle == 2)
    waited = guard.run(1000, 0.3, until=lambda s: s.gentle == 1)
    assert 90 < waited < 110
    guard.run(40, hurting, until=lambda s: s.gentle == 2)
    assert guard.run(1000, 0.3, until=lambda s: s.gentle == 1) > 1.9 * waited


@PRECISIONS
@pytest.mark.parametrize("factor", [1.5, 5.0])
def test_a_load_with_more_ripple_is_no_fault_of_learning(precision, factor):
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    guard.run(20, 0.5)
    guard.run(25, factor)  # with and without what is learned
    assert guard.state.gentle == 1 and guard.state.learn and guard.state.share == 1
    guard.run(100, factor)
    assert not guard.acts


@PRECISIONS
def test_one_bad_window_is_a_shock(precision):
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    for _ in range(20):
        guard.run(6, 0.5)
        guard.run(0.25, 8.0)
        assert not guard.acts


@PRECISIONS
def test_a_weak_bus_is_no_fault_of_learning(precision):
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    guard.run(6, 0.5)
    for n in range(2 * WINDOW):
        guard.step(20.0 + math.sin(n), omega_m=0.0, saturated=True, learned=False)
    for n in range(40):  # and the speed comes back
        guard.step(20.0 * math.exp(-n / 10))
    guard.run(6, 0.5)
    assert not guard.acts and guard.state.learn


def at_the_limit(guard, seconds, whose=lambda state: True):
    """Steps in which the current loop falls short, but for 10 in 160, so that nothing is learned, where
    `whose` says so of the guard's state."""
    for n in range(round(seconds / TS)):
        short = whose(guard.state) and n % 160 > 9
        guard.step(8.0 * short + math.sin(6 * OMEGA * TS * n), saturated=short, learned=False)


@PRECISIONS
def test_a_map_that_drives_the_rotor_to_its_limit_is_found_and_cleared(precision):
    """Learned under a load that is gone. Nothing is learned at the limit, so it would stay there."""
    guard, lib = Guard(precision), control_library(precision).lib
    guard.run(4, 1.0, wanted=False)
    guard.run(20, 0.5)
    at_the_limit(guard, 2.4, lambda state: state.share > 0)
    assert guard.phase == lib.CGL_GUARD_LEARN
    at_the_limit(guard, 2.0, lambda state: state.share > 0)
    assert guard.phase == lib.CGL_GUARD_CLEAR or guard.state.gentle > 1


@PRECISIONS
def test_a_limit_that_stays_without_what_was_learned_is_not_its_fault(precision):
    guard, lib = Guard(precision), control_library(precision).lib
    guard.run(4, 1.0, wanted=False)
    guard.run(20, 0.5)
    at_the_limit(guard, 8.0)
    assert guard.phase == lib.CGL_GUARD_PROBE and guard.state.share == 0
    phases = set()
    guard.run(6, 1.0, until=lambda state: phases.add(state.phase))
    assert guard.phase == lib.CGL_GUARD_LEARN and lib.CGL_GUARD_CLEAR not in phases
    guard.run(6, 0.5)
    assert not guard.acts


@PRECISIONS
def test_a_baseline_of_a_rotor_that_stands_is_measured_again(precision):
    """Under a load that the feedback alone does not turn. Without the load what was learned does harm."""
    guard = Guard(precision)
    for n in range(4 * WINDOW):
        error = 1.5 * OMEGA + 0.5 * math.sin(6 * OMEGA * TS * n)
        guard.step(error, OMEGA - error, learned=False)
    guard.run(20, 0.5)
    assert max(b.slow for b in guard.state.baseline) > OMEGA**2 and guard.state.share == 1
    taken = guard.run(40, lambda state: 0.3 + 2.7 * state.share, until=lambda state: state.share == 0)
    assert taken * WINDOW * TS < 5.0


@PRECISIONS
def test_an_instability_that_saturates_now_this_way_and_now_the_other_is_seen(precision):
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    for n in range(2 * WINDOW):
        guard.step(20.0 * (-1) ** (n // 5), saturated=n % 5 > 1, learned=n % 5 <= 1)
    assert guard.acts


def moving(guard, windows, amplitude):
    """Windows in which the reference moves, and the rotor follows it with a ripple."""
    for n in range(round(windows * WINDOW)):
        error = amplitude * math.sin(6 * OMEGA * TS * n)
        omega = OMEGA * (1 + 0.2 * math.sin(OMEGA * TS * n / 4))
        guard.step(error, omega, omega, learned=bool(guard.state.learn))


@PRECISIONS
def test_a_rotor_that_is_with_its_reference_may_learn_at_once(precision):
    for away, may in ((0.05, True), (-0.05, True), (0.2, False), (-0.2, False), (1.0, False)):
        guard = Guard(precision)
        guard.step(away * OMEGA, omega_m=(1 - away) * OMEGA, learned=False)
        assert guard.state.learn == may


@PRECISIONS
def test_learning_waits_for_one_calm_window_after_a_run_up(precision):
    guard = Guard(precision)
    guard.step(OMEGA, omega_m=0.0, learned=False)
    for _ in range(WINDOW // 4):
        guard.step(0.0, learned=False)
    assert 0.9 < guard.run(100, 1.0, until=lambda s: s.learn) < 1.6  # what is left of its quarters, and four
    assert guard.state.baseline[0].slow == pytest.approx(0.5, rel=0.02)


@PRECISIONS
def test_a_reference_that_never_rests_may_be_learned_after_three_seconds(precision):
    guard = Guard(precision)
    guard.step(OMEGA, omega_m=0.0, learned=False)
    moving(guard, 2.8 / WINDOW / TS, 1.0)
    assert not guard.state.learn
    moving(guard, 0.6 / WINDOW / TS, 1.0)
    assert guard.state.learn
    moving(guard, 100, 0.1)
    assert guard.state.learn and guard.state.share == 1


@PRECISIONS
def test_learning_that_has_not_begun_waits_at_a_new_speed_too(precision):
    guard = Guard(precision)
    guard.run(5, 1.0, wanted=False)
    assert guard.state.learn
    guard.run(0.3, 2.0, wanted=False, omega=4 * OMEGA)
    assert not guard.state.learn
    taken = guard.run(9, 2.0, omega=4 * OMEGA, until=lambda s: s.learn)
    assert taken < 2.5  # a quarter is a sixteenth of a second
    assert [b.slow for b in guard.state.baseline[0:2]] == pytest.approx([0.5, 2.0], rel=0.1)


@PRECISIONS
def test_without_a_known_baseline_three_calm_windows_are_probed(precision):
    guard = Guard(precision)
    moving(guard, 16, 1.0)
    assert guard.run(100, hurting, until=lambda s: s.share < 1) < 5
    guard.run(20, hurting, until=lambda s: s.gentle == 2)
    assert guard.state.gentle == 2


@PRECISIONS
def test_a_law_that_learns_at_once_is_probed_once(precision):
    """It takes nine tenths of the ripple away within the first quarter. After 16 turns,
    4 s, the guard looks what there is without it."""
    guard = Guard(precision)

    def left(state):
        return 1 - state.share * (0.9 - 0.9 * math.exp(-guard.n / 25))

    assert 15 < guard.run(80, left, until=lambda state: state.share < 1) < 18
    assert guard.run(80, left, until=lambda state: state.learn) < 8
    for _ in range(80):
        guard.run(1, left)
        assert guard.state.learn and guard.state.gentle == 1


@PRECISIONS
def test_a_start_that_dies_out_is_no_proof_of_learning(precision):
    """The first quarter has ten times what learning leaves, and that is ten times the feedback's."""
    guard = Guard(precision)

    def left(state):
        return 0.1 + 0.9 * state.share + 9 * math.exp(-guard.n / 10)

    assert guard.run(80, left, until=lambda state: state.forget) < 30
    assert guard.state.share == 0


def squares_until(guard, amplitude, until):
    """Sum of the squared errors, in windows of a variance of 1, until `until` holds."""
    total = last = 0.0
    while not until(guard.state):
        error = amplitude * (-1) ** (guard.n // 5)
        guard.step(error, learned=bool(guard.state.learn))
        guard.n += 1
        total += ((error + last) / 2) ** 2
        last = error
    return total / WINDOW


@PRECISIONS
@pytest.mark.parametrize("amplitude", [10.0, 100.0])
@pytest.mark.parametrize("known", [True, False])
def test_a_burst_is_over_within_the_quarter_in_which_it_begins(precision, known, amplitude):
    """72 quarters of the baseline are 18 windows, counted from the start of a quarter, and a period of the
    burst: until learning stops, and once more until nothing learned acts."""
    guard = Guard(precision)
    guard.run(4, math.sqrt(2), wanted=not known)
    guard.run(4, math.sqrt(2))
    assert guard.state.learn and guard.state.share == 1
    once = 36 + 10 * amplitude**2 / WINDOW
    assert 14 < squares_until(guard, amplitude, lambda s: not s.learn) < once
    assert 14 < squares_until(guard, amplitude, lambda s: s.share == 0) < once


@PRECISIONS
def test_a_jump_of_the_mean_holds_learning_for_a_window_at_most(precision):
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    guard.run(4.1, 0.5)
    for n in range(6 * WINDOW):
        guard.step(8.0 + 0.5 * math.sin(6 * OMEGA * TS * n), learned=bool(guard.state.learn))
        assert guard.state.share == 1 and (guard.state.learn or n < 1.5 * WINDOW)


@PRECISIONS
def test_learning_that_helps_is_left_alone_from_a_run_up_on(precision):
    guard = Guard(precision)
    for n in range(WINDOW):
        guard.step(OMEGA * math.exp(-n / 60), omega_m=OMEGA * (1 - math.exp(-n / 60)), learned=False)
    assert not guard.state.learn
    guard.run(3, 1.0, until=lambda state: state.learn)
    for n in range(40):
        guard.run(1, 0.9**n)
        assert guard.state.share == 1 and guard.state.learn


@PRECISIONS
@pytest.mark.parametrize("begun", [0.0, 1.0])
def test_a_burst_is_seen_although_the_mean_has_moved(precision, begun):
    """A law without an integral takes the mean error away, here at once, and then or later it swings."""
    guard = Guard(precision)
    guard.run(4, 0.01, wanted=False)
    calm = round(begun * WINDOW)
    for n in range(calm + 4 * WINDOW):
        if guard.state.share < 1:
            break
        size = 0.3 if n >= calm else 0.01
        guard.step(1.0 + size * math.sin(6 * OMEGA * TS * n), learned=bool(guard.state.learn))
    assert guard.state.share == 0
    assert calm < n < calm + 0.6 * WINDOW  # what is left of the quarter, and two looks


@PRECISIONS
def test_a_mean_that_moves_is_no_burst(precision):
    guard = Guard(precision)
    guard.run(4, 0.01, wanted=False)
    for n in range(20 * WINDOW):
        guard.step(1.0 + 0.01 * math.sin(6 * OMEGA * TS * n), learned=bool(guard.state.learn))
        assert guard.state.learn and guard.state.share == 1


@PRECISIONS
def test_a_rotor_that_swings_and_does_not_turn_is_looked_at_in_turns_of_the_reference(precision):
    guard = Guard(precision)
    swing = [1.5 * OMEGA * math.sin(2 * math.pi * n / 50) for n in range(20000)]
    taken = 0
    while guard.state.share == 1 and taken < len(swing):
        guard.step(OMEGA - swing[taken], omega_m=swing[taken])
        taken += 1
    assert taken * TS < 6


@PRECISIONS
def test_a_rotor_that_stands_without_learning_is_no_better_than_one_that_turns_unevenly(precision):
    """A feedback without an integral, under a load: what is learned moves the rotor."""
    guard = Guard(precision)
    for _ in range(40):
        for n in range(WINDOW):
            share = guard.state.share
            error = 0.1 * math.sin(6 * OMEGA * TS * n) * share + OMEGA * (1 - share)
            guard.step(error, omega_m=OMEGA * share, learned=bool(guard.state.learn))
    assert guard.state.gentle == 1 and guard.state.learn and guard.state.share == 1


@PRECISIONS
def test_learning_that_has_proven_itself_is_never_probed(precision):
    guard = Guard(precision)
    guard.run(1, 1.0)
    for _ in range(200):
        guard.run(1, 0.2)
        assert guard.state.share == 1 and guard.state.learn


@PRECISIONS
def test_at_the_last_step_nothing_is_learned_and_it_is_tried_again_much_later(precision):
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    bad = lambda s: 1 + 0.5 * s.share  # noqa: E731
    assert guard.run(400, bad, until=lambda s: s.gentle == STEPS) < 120
    assert guard.state.share < 1 and not guard.state.learn
    lib = control_library(precision).lib
    assert guard.run(4, bad, until=lambda s: s.phase == lib.CGL_GUARD_MUTE) < 3  # once all is cleared
    assert guard.state.retry_doublings == 5 and guard.state.wait_count == 50 << 5  # windows
    assert guard.run(20, bad, until=lambda s: s.share == 1) == 20 and guard.state.wait_count == (50 << 5) - 20
    guard.state.wait_count = 2
    assert 1 < guard.run(20, bad, until=lambda s: s.forget) <= 2  # cleared, and tried a step less gently
    assert guard.run(20, 1.0, until=lambda s: s.phase == lib.CGL_GUARD_LEARN) < 3
    assert guard.state.gentle == STEPS - 1 and not guard.state.learn
    assert guard.run(4, 1.0, until=lambda s: s.learn) < 4 and guard.state.share == 1  # as it acts in full


@PRECISIONS
def test_at_half_the_speed_learning_goes_on_as_before(precision):
    guard = Guard(precision)
    guard.run(4, 1.0, wanted=False)
    guard.run(40, hurting, until=lambda s: s.gentle == 2)
    guard.run(12, 0.5, omega=OMEGA / 2)
    assert guard.state.gentle == 1
    guard.run(4, 0.5)
    assert guard.state.gentle == 2


@PRECISIONS
def test_what_was_learned_at_another_speed_is_kept_while_it_does_not_act(precision):
    guard, lib = Guard(precision), control_library(precision).lib
    guard.run(4, 1.0, wanted=False)
    guard.run(20, 0.3)
    guard.run(30, hurting, omega=2 * OMEGA, until=lambda s: s.phase == lib.CGL_GUARD_MUTE)
    assert guard.phase == lib.CGL_GUARD_MUTE and not guard.state.forget
    guard.run(8, 0.3)
    assert guard.phase == lib.CGL_GUARD_LEARN and guard.state.share == 1


@PRECISIONS
def test_a_law_that_learns_nothing_is_left_alone(precision):
    guard = Guard(precision)
    for n in range(20000):
        guard.step(math.sin(n) * (1 + n % 7), learned=False)
    assert guard.state.share == 1 and guard.state.learn and not guard.acts


ANYTHING = st.one_of(st.floats(width=32), st.floats(-300, 300, width=32))


@PRECISIONS
@settings(max_examples=25, deadline=None)
@given(
    parts=st.lists(
        st.tuples(
            ANYTHING,
            ANYTHING,
            ANYTHING,
            st.booleans(),
            st.booleans(),
            st.booleans(),
            st.booleans(),
            st.integers(1, 300),
        ),
        max_size=12,
    )
)
def test_whatever_comes_in_the_share_stays_within_0_and_1(precision, parts):
    guard = Guard(precision)
    state = guard.state
    for *values, count in parts:
        for n in range(count):
            guard.step(values[0] * (1 - 2 * (n % 2)), *values[1:])
            assert 0 <= state.share <= 1 and 1 <= state.gentle <= STEPS
            assert not (state.forget and state.learn) and state.phase <= guard.lib.CGL_GUARD_MUTE


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
