"""Plausibility of measurements in the C library."""

import itertools
import math

import numpy as np
import pytest
from control_library import control_library
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.monitor import TURN, Monitor, between, in_turn

TS = 1e-4
BOUNDS = {
    "omega_max": 200.0, "angle_step": 1e-3, "speed_window": 2e-3, "stuck_angle": 0.5, "current_max": 10.0,
    "current_sum": 2.0, "bridge": 5e-3, "hold": 1e-2, "stuck_time": 5e-3,
}  # fmt: skip
PRECISIONS = pytest.mark.parametrize("precision", ["float", "double"])


class CMonitor:
    def __init__(self, library, **fields):
        self.library, self.lib = library, library.lib
        self.config = library.new("cgl_monitor_config", phases=fields.pop("phases", 3), **fields)
        self.state, self.now = library.new("cgl_monitor"), library.new("cgl_measurement")
        assert self.lib.cgl_monitor_init(self.state, self.config, TS) == self.lib.CGL_OK

    def step(self, i, theta, omega, u_dc, omega_ref, full):
        now = self.now
        now.i_abc, now.theta_m, now.omega_m, now.u_dc = i, theta, omega, u_dc
        self.lib.cgl_monitor_step(self.state, now, omega_ref, full)
        return self.state

    def said(self) -> set[str]:
        names = ("FAULT", "ANGLE_LOST", "ANGLE_SHIFTED", "ANGLE_STUCK", "CURRENT", "BUS")
        return {n for n in names if self.state.status & getattr(self.lib, f"CGL_STATUS_{n}")}


class Rotor:
    """One that turns at a speed, under a monitor."""

    def __init__(self, precision, omega=50.0, **changes):
        self.monitor = CMonitor(control_library(precision), **{**BOUNDS, **changes})
        self.omega, self.theta, self.offset = omega, 1.0, 0.0

    def run(
        self, periods, *, theta=None, speed=None, i=(0.5, -0.25, -0.25), u_dc=24.0, omega_ref=None, full=True
    ):
        """Whether it was safe in each period. theta, speed: what the sensor says instead."""
        safe = []
        for _ in range(periods):
            self.theta = in_turn(self.theta + self.omega * TS)
            seen = in_turn(self.theta + self.offset) if theta is None else theta
            told = self.omega if speed is None else speed
            asked = self.omega if omega_ref is None else omega_ref
            safe.append(self.monitor.step(list(i), seen, told, u_dc, asked, full).safe)
        return safe

    @property
    def error(self) -> float:
        return between(self.monitor.state.theta_m, self.theta)

    @property
    def state(self):
        return self.monitor.state


EVENTS = st.sampled_from(["run", "jump", "back", "nan", "stick", "noise", "fast", "i", "sum", "bus", "rest"])
# numbers of periods with full current and then with less
PUSHES = st.sampled_from([(1, 0), (0, 1), (2, 1), (1, 2), (30, 10)])


@PRECISIONS
@settings(max_examples=40, deadline=None)
@given(
    events=st.lists(st.tuples(EVENTS, st.integers(1, 120)), min_size=1, max_size=12),
    omega=st.floats(-150, 150),
    seed=st.integers(0, 999),
    phases=st.sampled_from([3, 2, 0]),
    pushes=PUSHES,
)
def test_equals_the_reference(precision, events, omega, seed, phases, pushes):
    """Angles on a grid of the sensor, away from every bound, so that float and double decide alike."""
    library, rng = control_library(precision), np.random.default_rng(seed)
    c = CMonitor(library, **BOUNDS, phases=phases)
    reference = Monitor(**BOUNDS, phases=phases)
    theta, offset = 1.0, 0.0
    fulls = itertools.cycle([True] * pushes[0] + [False] * pushes[1])
    for event, periods in [("run", 3), *events]:
        offset = {"jump": 1.0, "back": 0.0}.get(event, offset)
        for _ in range(periods):
            theta = in_turn(theta + omega * TS) if event != "rest" else theta
            seen = in_turn(theta + offset)
            seen = {"nan": math.nan, "stick": 2.0, "noise": rng.uniform(0, TURN)}.get(event, seen)
            seen = float(library.real(seen))
            speed = 1e3 if event == "fast" else float(library.real(omega))
            i = {"i": [9.0, -9.0, 9.0], "sum": [3.0, 0.0, 0.0]}.get(event, [0.5, -0.5, 0.0])
            u_dc, asked = -1.0 if event == "bus" else 24.0, 0.0 if event == "rest" else 60.0
            full = next(fulls)
            c.step(i, seen, speed, u_dc, asked, full)
            said = reference.step(i, seen, speed, u_dc, asked, full)
            assert c.said() == said
            assert (c.state.safe, c.state.trusted) == (reference.safe, reference.trusted)
            assert (c.state.missing_angles, c.state.speed_wait) == (reference.gap, reference.blind)
            assert (c.state.speed_lost, c.state.standstill) == (reference.dark, reference.standing)
            assert (c.state.full_current, c.state.stuck_after) == (reference.pushing, reference.attempt)
            assert abs(between(c.state.theta_m, reference.theta)) < 600 * library.eps
            assert abs(c.state.omega_m - reference.omega) < 300 * library.eps


@PRECISIONS
def test_a_slip_long_after_the_sensor_was_stuck_is_told(precision):
    """Who was stuck may be anywhere when it comes back, until it shows that the rotor turns."""
    rotor = Rotor(precision, omega=20.0)
    rotor.run(100)
    rotor.run(120, theta=rotor.theta, omega_ref=60.0)
    assert "ANGLE_STUCK" in rotor.monitor.said()
    rotor.omega = 0.0
    rotor.run(300)
    rotor.omega = 1.0
    rotor.run(300)
    assert rotor.monitor.said() == set()
    rotor.offset = 1.0
    rotor.run(3)
    assert "ANGLE_SHIFTED" in rotor.monitor.said()
    assert abs(rotor.error) < 0.01


@PRECISIONS
def test_an_ordinary_period_hands_measurements_on_untouched(precision):
    rotor = Rotor(precision)
    for _ in range(3000):
        assert rotor.run(1) == [False]
        assert rotor.state.trusted
        assert rotor.state.status == 0
        assert abs(rotor.error) < 1e-6


@PRECISIONS
@pytest.mark.parametrize("jump", [0.1, 1.0, -2.0, math.pi])
def test_a_jump_is_taken_out_and_learning_waits_until_it_goes_back(precision, jump):
    rotor = Rotor(precision)
    rotor.run(100)
    rotor.offset = jump
    safe = rotor.run(500)
    assert not any(safe)
    assert abs(rotor.error) < 2e-3
    assert rotor.monitor.said() == {"ANGLE_SHIFTED"}
    assert abs(between(rotor.state.sensor_offset, jump)) < 2e-3
    assert not rotor.state.trusted
    rotor.offset = 0.0
    rotor.run(25)
    assert rotor.state.trusted
    assert rotor.state.sensor_offset == 0
    assert abs(rotor.error) < 1e-6
    assert rotor.state.jumps == 2


@PRECISIONS
def test_trust_takes_the_angle_as_it_is(precision):
    rotor = Rotor(precision)
    rotor.run(10)
    rotor.offset = 1.0
    rotor.run(100)
    rotor.monitor.lib.cgl_monitor_trust(rotor.state)
    rotor.run(1)
    assert rotor.state.trusted
    assert abs(rotor.error - 1.0) < 1e-6


@PRECISIONS
def test_a_jump_spoils_the_speed_for_its_window(precision):
    rotor = Rotor(precision)
    rotor.run(50)
    rotor.offset = 1.0
    rotor.run(20, speed=150.0)
    assert rotor.state.omega_m == 50
    rotor.run(3, speed=60.0)
    assert rotor.state.omega_m == 60


@PRECISIONS
@pytest.mark.parametrize("theta", [math.nan, math.inf, 1e6])
def test_a_short_gap_is_bridged_by_the_last_speed(precision, theta):
    rotor = Rotor(precision)
    rotor.run(50)
    # the first angle after it waits for the second, which is the 50th missing one
    assert not any(rotor.run(49, theta=theta, speed=math.nan))
    assert abs(rotor.error) < 1e-5
    assert rotor.monitor.said() == {"ANGLE_LOST"}
    rotor.run(2)
    assert rotor.monitor.said() == set()
    assert abs(rotor.error) < 1e-6
    rotor.run(50)
    assert rotor.state.trusted


@PRECISIONS
def test_a_long_gap_gives_a_safe_output_and_then_any_angle_is_right(precision):
    rotor = Rotor(precision)
    rotor.run(50)
    safe = rotor.run(400, theta=math.nan)
    assert safe == [False] * 50 + [True] * 350
    rotor.theta = in_turn(rotor.theta + 2.5)  # it was turned by hand
    safe = rotor.run(300)
    # the speed's window, hold, and the period that the first angle waits for the second
    assert safe.index(False) == 20 + 101
    assert abs(rotor.error) < 1e-6
    assert rotor.state.trusted


@PRECISIONS
def test_an_angle_that_jumps_all_the_time_is_none(precision):
    rotor, rng = Rotor(precision), np.random.default_rng(1)
    rotor.run(50)
    safe = [rotor.run(1, theta=float(x))[0] for x in rng.uniform(0, TURN, 2000)]
    assert sum(safe[100:]) == 1900
    rotor.run(300)
    assert rotor.state.trusted
    assert abs(rotor.error) < 1e-6


@PRECISIONS
def test_single_wrong_angles_are_passed_over(precision):
    rotor, rng = Rotor(precision), np.random.default_rng(2)
    for _ in range(200):
        assert not any(rotor.run(29))
        assert rotor.run(1, theta=in_turn(rotor.theta + rng.uniform(0.1, 6.1))) == [False]
        assert abs(rotor.error) < 1e-4
    rotor.run(100)
    assert rotor.state.trusted


@PRECISIONS
def test_jumps_that_leave_no_time_for_a_speed_end_in_a_safe_output(precision):
    rotor = Rotor(precision)
    rotor.run(50)
    safe = []
    for _ in range(60):
        safe += rotor.run(7) + rotor.run(1, theta=in_turn(rotor.theta + 1.0))
    assert 70 <= safe.index(True) <= 90  # speed_window and bridge
    assert all(safe[90:])
    assert rotor.monitor.said() >= {"ANGLE_LOST", "FAULT"}
    rotor.run(200)
    assert rotor.state.trusted


@PRECISIONS
@pytest.mark.parametrize("offset", [0.7, -1.2])
@pytest.mark.parametrize("missing", [1, 20, 45])
def test_a_sensor_that_has_slipped_is_still_off_after_a_gap(precision, offset, missing):
    rotor = Rotor(precision, omega_max=2000.0)
    rotor.run(50)
    rotor.offset = offset
    rotor.run(100)
    rotor.run(missing, theta=math.nan)
    rotor.run(60)
    assert rotor.monitor.said() == {"ANGLE_SHIFTED"}
    assert abs(rotor.error) < 1e-2
    rotor.run(missing, theta=math.nan)
    rotor.offset = 0.0  # right again after another one
    rotor.run(60)
    assert rotor.state.trusted
    assert abs(rotor.error) < 1e-6


@PRECISIONS
def test_lost_for_long_while_shifted_is_safe_until_it_is_trusted(precision):
    """The rotor has coasted: whether the sensor is still off, nothing tells."""
    rotor = Rotor(precision)
    rotor.run(50)
    rotor.offset = 0.7
    rotor.run(100)
    rotor.run(200, theta=math.nan)
    assert all(rotor.run(2000))
    assert "FAULT" in rotor.monitor.said()
    rotor.offset = 0.0  # homed
    rotor.run(1)
    assert rotor.monitor.lib.cgl_monitor_trust(rotor.state)
    assert not rotor.run(200)[-1]
    assert rotor.state.trusted
    assert abs(rotor.error) < 1e-6


@PRECISIONS
@pytest.mark.parametrize("wrong", [0.6, -0.6, 2.5])
@pytest.mark.parametrize("asked", [5.0, 50.0])
def test_a_wrong_sample_while_the_angle_stands_still_leaves_nothing(precision, wrong, asked):
    rotor = Rotor(precision, omega=0.0, stuck_time=0.02)
    for periods in (100, 300, 800, 3000):
        rotor.run(periods, omega_ref=asked)
        rotor.run(1, theta=in_turn(rotor.theta + wrong), omega_ref=asked)
        rotor.run(5, omega_ref=asked)
        assert abs(rotor.error) < 1e-6
        assert "ANGLE_SHIFTED" not in rotor.monitor.said()


@PRECISIONS
@pytest.mark.parametrize("speed", [20.0, 150.0, -150.0])
def test_a_wrong_sample_by_any_angle_leaves_no_shift(precision, speed):
    rotor = Rotor(precision, omega=speed)
    rotor.run(50)
    for wrong in np.linspace(-0.06, 0.06, 121):  # about what a rotor can turn in a period
        rotor.run(1, theta=in_turn(rotor.theta + speed * TS + wrong))
        rotor.run(60)
        assert abs(rotor.error) < 1e-6
        assert rotor.state.trusted


@PRECISIONS
def test_a_rotor_that_takes_its_time_is_not_stuck(precision):
    rotor = Rotor(precision, omega=0.0, stuck_time=0.05)
    safe = rotor.run(600, omega_ref=400.0)
    assert safe.index(True) in range(500, 506)  # 0.5 rad come after 1.25 ms
    safe = rotor.run(20_000, omega_ref=400.0)
    assert 0.88 < sum(safe) / 20_000 < 0.93


@PRECISIONS
def test_a_rotor_that_stood_for_half_a_day_is_tried_again(precision):
    """The next attempt comes after so many periods that their count does not end before."""
    rotor = Rotor(precision, omega=0.0)
    rotor.run(50, omega_ref=400.0, full=False)
    rotor.state.standstill = 3_000_000_000
    assert rotor.run(2600, omega_ref=400.0)[-1]  # safe: it counts as stuck
    rotor.state.standstill = 2**32 - 1  # where it stays
    assert not all(rotor.run(10, omega_ref=400.0))


@PRECISIONS
def test_nothing_is_learned_while_a_stuck_angle_is_in_doubt(precision):
    rotor = Rotor(precision, omega_max=500.0)
    rotor.run(50)
    stuck_at, trusted = rotor.theta, []
    for _ in range(60):  # 0.3 rad
        rotor.run(1, theta=stuck_at, omega_ref=50.0)
        trusted.append(rotor.state.trusted)
    assert trusted.index(False) <= 27  # a quarter of 0.5 rad, after two periods
    assert not any(trusted[27:])
    assert rotor.monitor.said() == set()
    rotor.run(60)
    assert rotor.state.trusted


@PRECISIONS
def test_a_stuck_angle_gives_a_safe_output_until_it_moves(precision):
    rotor = Rotor(precision, omega_max=500.0)
    rotor.run(50)
    safe = rotor.run(300, theta=2.0, omega_ref=50.0)
    assert safe.index(True) in (100, 101, 102)  # 0.5 rad at 50 rad/s
    assert all(safe[102:])
    assert rotor.monitor.said() >= {"ANGLE_STUCK", "FAULT"}
    assert not rotor.run(300)[-1]


@PRECISIONS
def test_a_rotor_without_full_current_is_never_stuck(precision):
    """The monitor leaves the feedback all the time to raise the current, and does not clear its integral."""
    rotor = Rotor(precision, omega=0.0)
    assert not any(rotor.run(20_000, omega_ref=50.0, full=False))
    assert not any(rotor.run(49, omega_ref=50.0))
    assert any(rotor.run(4, omega_ref=50.0))  # 5 ms of full current


@PRECISIONS
@pytest.mark.parametrize("pattern, stuck", [((9, 1), True), ((1, 1), False), ((1, 9), False)])
def test_full_current_may_flicker(precision, pattern, stuck):
    rotor, safe = Rotor(precision, omega=0.0), []
    for _ in range(400):
        for periods, full in zip(pattern, (True, False), strict=True):
            safe += rotor.run(periods, omega_ref=50.0, full=full)
    assert any(safe) == stuck


@PRECISIONS
@pytest.mark.parametrize("ramp", [0, 300, 2000])
def test_a_blocked_rotor_rests_ten_times_as_long_as_it_was_tried(precision, ramp):
    """In each attempt the feedback starts anew, and takes `ramp` periods to full current."""
    rotor, safe, since = Rotor(precision, omega=0.0), [], 0
    for _ in range(60_000):
        safe += rotor.run(1, omega_ref=50.0, full=since >= ramp)
        since = 0 if safe[-1] else since + 1
    changes = np.flatnonzero(np.diff(safe))
    rests, attempts = np.diff(changes)[::2], np.diff(changes)[1::2]
    assert len(attempts) >= 2
    assert np.abs(attempts - max(100, ramp + 51)).max() <= 2
    tried = attempts[0] - 25  # counted from a quarter of stuck_angle on
    assert rests == pytest.approx(max(1000, 10 * tried), abs=12)


@PRECISIONS
def test_a_stuck_angle_is_tried_again_a_tenth_of_the_time(precision):
    rotor = Rotor(precision, omega=0.0)
    safe = rotor.run(11_000, omega_ref=50.0)
    assert 0.88 < sum(safe[1000:]) / 10_000 < 0.93
    assert not all(safe[1000:2200])


@PRECISIONS
@pytest.mark.parametrize("periods", [50, 400])  # before it is said to be stuck, and after
def test_a_stuck_sensor_that_comes_back_is_right_as_it_measures(precision, periods):
    rotor = Rotor(precision, omega=50.0, omega_max=500.0)
    rotor.run(50)
    rotor.run(periods, theta=rotor.theta, speed=0.0)
    rotor.run(300)
    assert rotor.monitor.said() == set()
    assert abs(rotor.error) < 1e-3


@PRECISIONS
def test_a_blocked_rotor_starts_anew_when_the_reference_has_rested(precision):
    rotor = Rotor(precision, omega=0.0)
    assert any(rotor.run(300, omega_ref=50.0))
    assert not rotor.run(150, omega_ref=0.0)[-1]
    assert not any(rotor.run(90, omega_ref=50.0))


@PRECISIONS
@pytest.mark.parametrize("asked", [0.0, math.nan, math.inf])
def test_a_rotor_that_is_not_asked_to_turn_is_not_stuck(precision, asked):
    rotor = Rotor(precision, omega=0.0)
    assert not any(rotor.run(5000, omega_ref=asked))


@PRECISIONS
@pytest.mark.parametrize(
    "bad, bit",
    [
        ({"i": (math.nan, 0.0, 0.0)}, "CURRENT"), ({"i": (0.0, 0.0, -math.inf)}, "CURRENT"),
        ({"i": (12.0, -6.0, -6.0)}, "CURRENT"), ({"i": (2.5, 0.0, 0.0)}, "CURRENT"),
        ({"u_dc": 0.0}, "BUS"), ({"u_dc": math.nan}, "BUS"), ({"u_dc": math.inf}, "BUS"),
    ],
)  # fmt: skip
def test_a_bad_current_or_bus_gives_a_safe_output_for_a_while(precision, bad, bit):
    rotor = Rotor(precision)
    rotor.run(10)
    assert rotor.run(1, **bad) == [True]
    assert rotor.monitor.said() == {bit, "FAULT"}
    assert rotor.run(200) == [True] * 100 + [False] * 100
    assert rotor.state.trusted


@PRECISIONS
def test_currents_that_are_not_measured_are_not_looked_at(precision):
    rotor = Rotor(precision, phases=2)
    assert not any(rotor.run(10, i=(5.0, 5.0, math.nan)))
    rotor = Rotor(precision, phases=0)
    assert not any(rotor.run(10, i=(math.nan,) * 3, u_dc=math.nan))


@PRECISIONS
def test_a_speed_that_cannot_be_is_not_believed(precision):
    rotor = Rotor(precision)
    rotor.run(10)
    assert rotor.run(60, speed=1e4) == [False] * 50 + [True] * 10
    assert rotor.state.omega_m == 50
    assert abs(rotor.error) < 1e-6


@PRECISIONS
def test_nothing_is_safe_before_the_first_angle(precision):
    rotor = Rotor(precision, hold=0.0)
    assert rotor.run(3, theta=math.nan) == [True] * 3
    assert rotor.run(3)[-1] is False
    assert abs(rotor.error) < 1e-6


@PRECISIONS
def test_what_is_not_watched_triggers_nothing(precision):
    zero = dict.fromkeys(BOUNDS, 0.0)
    rotor = Rotor(precision, omega=3e3, **zero)
    for jump in (0.0, 1.0, 3.0):
        rotor.offset = jump
        assert not any(rotor.run(50, i=(1e6, 1e6, 1e6)))
        assert rotor.state.trusted


@PRECISIONS
@pytest.mark.parametrize(
    "field, value",
    [(name, v) for name in BOUNDS for v in (-1.0, math.nan, math.inf)]
    + [("phases", 1), ("phases", 4), ("hold", 1e6), ("bridge", 1e6), ("speed_window", 1e6)],
)
def test_init_refuses(precision, field, value):
    library = control_library(precision)
    config = library.new("cgl_monitor_config", **{**BOUNDS, "phases": 3, field: value})
    refused = library.lib.cgl_monitor_init(library.new("cgl_monitor"), config, TS)
    assert refused == library.lib.CGL_ERROR_CONFIG
