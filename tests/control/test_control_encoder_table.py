"""The sensor's own error, learned by its orders: what converges, what may not disturb or break it."""

import functools
import math
from typing import Any

import numpy as np
import pytest
from control_library import control_library

from cogless.study.drive import EncoderTable

TS = 1e-4
USUAL: dict[str, Any] = {
    "orders": 2,
    "order": [1, 3],
    "gain": 4.0,
    "omega_min": 50.0,
    "bandwidth": 12.0,
    "b": 400.0,
    "limit": 0.1,
}
ERROR = {1: 0.009 * np.exp(0.7j), 3: 0.002 * np.exp(-2.0j)}  # Re c exp(j n theta)


def table_of(precision: str = "float", **changes: Any):
    library = control_library(precision)
    state = library.new("cgl_encoder_table")
    error = library.lib.cgl_encoder_table_init(
        state, library.new("cgl_encoder_table_config", **{**USUAL, **changes}), TS
    )
    return library, state, error


def test_a_study_knows_how_long_its_observer_settles() -> None:
    table = EncoderTable.model_validate({"orders": [2, 3], "omega_min": "40 rad/s"})
    _, state, _ = table_of(order=list(table.orders), omega_min=table.omega_min, bandwidth=table.bandwidth)
    assert state.settle * TS == pytest.approx(table.settling, abs=2 * TS)


WINDOW = 37  # steps over which the speed of these tests is the mean


def sensed(theta: np.ndarray, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The angle that a sensor shows, and its mean speed. The sensor's error depends on the shown angle."""
    shown = theta.copy()
    for _ in range(30):
        shown = theta + sum(np.real(c * np.exp(1j * n * shown)) for n, c in ERROR.items())
    speed = omega.copy()
    speed[WINDOW:] = (shown[WINDOW:] - shown[:-WINDOW]) / (WINDOW * TS)
    return shown, speed


def run(library, state, theta, omega, i_q, learn: bool = True) -> np.ndarray:
    """Corrected angles and speeds."""
    found = []
    shown, speed = sensed(theta, omega)
    now = library.new("cgl_measurement")
    for n, angle in enumerate(shown % (2 * np.pi)):
        now.theta_m, now.omega_m = angle, speed[n]
        library.lib.cgl_encoder_table_step(state, now, i_q[n], learn)
        mean = library.lib.cgl_encoder_table_speed(state, now.omega_m, WINDOW * TS)
        found.append((now.theta_m, mean))
    return np.array(found)


def learned(state) -> dict[int, complex]:
    return {order: complex(state.a[k], -state.c[k]) for k, order in enumerate((1, 3))}


def steady(speed: float, seconds: float = 3.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = TS * np.arange(round(seconds / TS))
    return speed * t, np.full_like(t, speed), np.zeros_like(t)


@pytest.mark.parametrize(("precision", "bound", "speed"), [("double", 2e-5, -80.0), ("float", 4e-5, 80.0)])
def test_it_learns_the_error_and_takes_it_out_of_angle_and_speed(
    precision: str, bound: float, speed: float
) -> None:
    library, state, error = table_of(precision)
    assert error == library.lib.CGL_OK
    theta, omega, i_q = steady(speed)
    found = run(library, state, theta, omega, i_q)
    for order, value in learned(state).items():
        assert abs(value - ERROR[order]) < bound
    late = slice(-2000, None)
    off = (found[late, 0] - theta[late] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(off).max() < 2 * bound
    assert np.abs(found[late, 1] - speed).max() < 1e-4 * abs(speed)


def test_a_rotor_that_follows_the_error_is_seen_through_by_its_current() -> None:
    """A stiff loop makes the rotor follow the sensor: it shows a constant speed, only the current tells."""
    speed, b = 80.0, 400.0
    t = TS * np.arange(40_000)
    shown = speed * t
    ripple = sum(np.real(c * np.exp(1j * n * shown)) for n, c in ERROR.items())
    i_q = sum(np.real(c * (n * speed) ** 2 * np.exp(1j * n * shown)) for n, c in ERROR.items()) / b
    theta = shown - ripple
    for known, close in ((b, True), (0.0, False)):
        library, state, _ = table_of("double", b=known)
        run(library, state, theta, np.gradient(theta, TS), i_q)
        assert (
            all(abs(value - ERROR[n]) < 0.05 * abs(ERROR[n]) for n, value in learned(state).items()) == close
        )


@pytest.mark.parametrize("current", [0.5, -5.0])
def test_a_load_that_the_current_holds_against_keeps_nothing_from_being_learned(current: float) -> None:
    library, state, _ = table_of()
    theta, omega, i_q = steady(80.0, 4.0)
    run(library, state, theta, omega, i_q + current)
    for order, value in learned(state).items():
        assert abs(value - ERROR[order]) < 1e-4


def test_what_it_takes_for_the_sensor_of_a_torque_ripple_falls_with_the_square_of_the_speed() -> None:
    """A torque of order 3 that nobody knows, an acceleration of d, moves the rotor by d / (3 omega)^2."""
    found = []
    for speed in (60.0, 120.0):
        t = TS * np.arange(40_000)
        moved = 300.0 / (3 * speed) ** 2
        theta = speed * t - moved * np.cos(3 * speed * t)
        library, state, _ = table_of("double")
        run(library, state, theta, np.gradient(theta, TS), np.zeros_like(t))
        found.append(abs(learned(state)[3] - ERROR[3]))
        assert found[-1] == pytest.approx(moved, rel=0.25)
    assert found[0] / found[1] == pytest.approx(4.0, rel=0.3)


@pytest.mark.parametrize(("speed", "learn"), [(49.0, True), (80.0, False)])
def test_it_learns_nothing_when_slow_or_not_allowed(speed: float, learn: bool) -> None:
    library, state, _ = table_of()
    run(library, state, *steady(speed, 1.5), learn)
    assert learned(state) == {1: 0.0, 3: 0.0}
    assert not state.learning


@functools.cache
def taught() -> bytes:
    """The state after 3 s at 80 rad/s."""
    library, state, _ = table_of()
    run(library, state, *steady(80.0))
    return bytes(library.ffi.buffer(state))


@pytest.mark.parametrize("place", ["theta_m", "omega_m", "i_q"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3e38, 1e30])
def test_what_is_not_plausible_is_not_learned(place: str, value: float) -> None:
    library, state, _ = table_of()
    library.ffi.buffer(state)[:] = taught()
    before = learned(state)
    theta, omega, i_q = (x[30_000:] for x in steady(80.0, 3.8))  # the rotor turns on meanwhile
    shown, speed = sensed(theta[:1], omega[:1])
    now = library.new("cgl_measurement", theta_m=shown[0] % (2 * np.pi), omega_m=speed[0])
    if place != "i_q":
        setattr(now, place, value)
    library.lib.cgl_encoder_table_step(state, now, value if place == "i_q" else 0.0, True)
    if place == "theta_m" or not math.isfinite(value):
        passed = getattr(now, place) if place != "i_q" else value
        assert passed == value or math.isnan(value) or place == "theta_m"
    run(library, state, theta[1:], omega[1:], i_q[1:])
    for order, found in learned(state).items():
        assert abs(found - before[order]) < 2e-4
    assert math.isfinite(state.observer.omega)


@pytest.mark.parametrize(
    "wrong",
    [
        {"orders": 0},
        {"orders": 5},
        {"order": [3, 1]},
        {"order": [0, 1]},
        {"order": [1, 1001]},
        {"gain": -1.0},
        {"gain": 1001.0},
        {"omega_min": 0.0},
        {"bandwidth": 17.0},
        {"bandwidth": 0.0},
        {"b": -1.0},
        {"b": math.nan},
        {"limit": 0.0},
        {"limit": 0.34},
        {"bandwidth": 1e-9},
    ],
)
def test_init_refuses(wrong: dict[str, Any]) -> None:
    library, _state, error = table_of(**wrong)
    assert error == library.lib.CGL_ERROR_CONFIG


def test_retune_keeps_what_was_learned_and_refuses_other_orders() -> None:
    library, state, _ = table_of()
    state.a[0], state.c[1] = 0.05, -0.01
    others = library.new("cgl_encoder_table_config", **{**USUAL, "order": [1, 2]})
    assert library.lib.cgl_encoder_table_retune(state, others) == library.lib.CGL_ERROR_CONFIG
    tighter = library.new("cgl_encoder_table_config", **{**USUAL, "limit": 0.02})
    assert library.lib.cgl_encoder_table_retune(state, tighter) == library.lib.CGL_OK
    assert (state.a[0], state.c[1]) == (pytest.approx(0.02), pytest.approx(-0.01))
    library.lib.cgl_encoder_table_reset(state)
    assert learned(state) == {1: 0.0, 3: 0.0}


COUNTS, DIVIDER = 65_536, 10  # of the sensor, and steps in a period of the law
ORDER, SIZE = 20, math.radians(0.4)  # of the sensor's error


class Estimator:
    """The speed from counts by the C library, as in a firmware, with or without correction of the sensor."""

    def __init__(self, library, method: str, corrected: bool) -> None:
        self.library, self.lib, self.method, self.omega = library, library.lib, method, 0.0
        new = library.new
        _, self.table, error = table_of("double", orders=1, order=[ORDER], limit=0.02)
        assert error == self.lib.CGL_OK
        self.table.c[0] = SIZE if corrected else 0.0
        self.encoder, self.edges = new("cgl_encoder"), new("cgl_edges")
        self.lib.cgl_encoder_init(self.encoder, new("cgl_encoder_config", counts=COUNTS, range=0), 0)
        if method == "observer":
            self.speed = new("cgl_angle_observer")
            config = new("cgl_angle_observer_config", bandwidth=2500.0)
            assert self.lib.cgl_angle_observer_init(self.speed, config, TS) == self.lib.CGL_OK
        elif method in ("T", "MT"):
            self.speed = new("cgl_speed_timed")
            config = new("cgl_speed_timed_config", counts=COUNTS, timer=1e9, last_interval=method == "T")
            assert self.lib.cgl_speed_timed_init(self.speed, config) == self.lib.CGL_OK
        else:
            window, period = (1, DIVIDER * TS) if method == "M" else (DIVIDER, TS)
            self.speed, self.before = new("cgl_speed_count"), library.ffi.new("uint32_t[]", window)
            config = new("cgl_speed_count_config", counts=COUNTS, window=window)
            args = (self.speed, config, period, self.before, window)
            assert self.lib.cgl_speed_count_init(*args) == self.lib.CGL_OK

    def step(self, n: int, count: int, edges: list[tuple[int, float]]) -> float:
        """`edges`: counts and times, s, of the last edges. M, T and MT compute the speed once a period of the
        law."""
        lib, ticks = self.lib, 2**32
        lib.cgl_encoder_step(self.encoder, count % 2**32)
        now = self.library.new(
            "cgl_measurement", theta_m=lib.cgl_radians(self.encoder.turns), omega_m=self.omega
        )
        lib.cgl_encoder_table_step(self.table, now, 0.0, False)
        if self.method == "observer":
            lib.cgl_angle_observer_step(
                self.speed, lib.cgl_encoder_table_turns(self.table, self.encoder.turns)
            )
            self.omega = self.speed.omega
        elif self.method == "average" or (n % DIVIDER == 0 and self.method == "M"):
            raw = lib.cgl_speed_count_step(self.speed, self.encoder.count)
            self.omega = lib.cgl_encoder_table_speed(self.table, raw, self.speed.time)
        if self.method in ("T", "MT"):
            for passed, time in edges:
                lib.cgl_edges_pass(self.edges, passed % ticks, round(time * 1e9) % ticks)
            if n % DIVIDER == 0:
                raw = lib.cgl_speed_timed_step(self.speed, self.edges, round(n * TS * 1e9) % ticks)
                self.omega = lib.cgl_encoder_table_speed(self.table, raw, self.speed.time)
        return self.omega


def crossing(theta: float, before: float, boundary: int, n: int) -> float:
    """The time, s, at which the shown angle crosses a boundary of counts, at constant speed in a period."""
    shown = boundary * math.tau / COUNTS
    return (n - 1 + (shown - SIZE * math.sin(ORDER * shown) - before) / (theta - before)) * TS


def shown_angle(theta: float) -> float:
    """The angle that a sensor with the error SIZE sin(ORDER shown) shows."""
    shown = theta
    for _ in range(40):
        shown = theta + SIZE * math.sin(ORDER * shown)
    return shown


def closed_loop(method: str, corrected: bool, turns: float = 2.0) -> tuple[float, float, float]:
    """A plant of a few lines: a rotor at 600 r/min under a PI that controls the measured speed.

    Returns the amplitudes of the sensor's order in the true and the measured speed, rad/s, and in i_q, A.
    """
    J, K_t, kp, ki, reference = 2e-4, 0.3, 0.08, 4.0, 20 * math.pi
    estimator = Estimator(control_library("double"), method, corrected)
    theta, omega, integral, i_q = 0.0, reference, 0.0, 0.0
    before = 0.0
    estimator.omega = reference
    if method == "observer":
        estimator.speed.omega = reference
    rows, steps = [], round((turns + 3.0) / 10 / TS)
    for n in range(steps):
        count = math.floor(shown_angle(theta) * COUNTS / math.tau)
        edges = [(c, crossing(theta, before, c, n)) for c in (count - 1, count)] if n else []
        measured = estimator.step(n, count, edges)
        if n % DIVIDER == 0 and n >= DIVIDER:
            error = reference - measured
            integral += ki * DIVIDER * TS * error
            i_q = kp * error + integral
        rows.append((theta, omega, measured, i_q))
        before = theta
        omega += TS * K_t * i_q / J
        theta += TS * omega
    angle, *signals = np.array(rows)[-round(turns / 10 / TS) :].T
    wave = np.exp(-1j * ORDER * angle)
    return tuple(2 * abs(np.mean((x - x.mean()) * wave)) for x in signals)


@pytest.mark.parametrize("method", ["M", "average", "T", "MT", "observer"])
def test_the_speed_is_that_of_the_corrected_angles(method: str) -> None:
    """At 600 r/min order 20 turns by 1.26 rad in a period of 1 ms. The sensor's error is 0.4 degrees."""
    plain, corrected = closed_loop(method, False), closed_loop(method, True)
    assert plain[2] > 0.05  # A: the loop follows the sensor
    for before, after in zip(plain, corrected, strict=True):
        assert after < 0.02 * before


def test_a_speed_of_no_time_or_no_number_stays_as_it_is() -> None:
    library, state, _ = table_of("double")
    state.a[0] = 0.05
    speed = library.lib.cgl_encoder_table_speed
    for time in (0.0, -1.0, math.nan, math.inf, -math.inf):
        assert speed(state, 80.0, time) == 80.0
    for omega in (math.inf, -math.inf):
        assert speed(state, omega, 1e-3) == omega
    assert math.isnan(speed(state, math.nan, 1e-3))
    assert math.isfinite(speed(state, 80.0, 5e-324))
