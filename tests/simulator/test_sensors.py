"""Sensors against closed forms: encoder, resolver, current sensors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from engine import run

TURN = 2.0 * np.pi
# so heavy that it turns at constant speed
STEADY: dict[str, Any] = {"mechanics": {"inertia": 1e6}, "controller": {"config": {"kp": 0.0, "ki": 0.0}}}


def measured(speed: float, sensor: dict[str, Any], seconds: float = 1.0) -> np.ndarray:
    change = {**STEADY, "initial_speed": speed, "drive": {"position_sensor": sensor}}
    return run(change, seconds)["omega_measured"]


def encoder(method: str, **more: Any) -> dict[str, Any]:
    return {
        "kind": "encoder",
        "counts": 2000.0,
        "speed_method": method,
        "timer": 1e9,
        "bandwidth": 0.0,
        **more,
    }


def word(bits: int, kind: str = "resolver", **more: Any) -> dict[str, Any]:
    return {"kind": kind, "counts": 2.0**bits, "speed_method": "average", **more}


@pytest.mark.parametrize("speed", [3.7, -3.7, 0.4, 41.0])
def test_counting_gives_whole_counts_and_the_right_mean(speed: float) -> None:
    omega = measured(speed, encoder("M"))[10:]
    count = TURN / 2000 / 1e-3  # one count in a speed-loop period, rad/s
    assert np.abs(omega / count - np.round(omega / count)).max() <= 1e-9
    assert np.abs(omega - speed).max() < count
    assert omega[:9900].mean() == pytest.approx(speed, abs=count / 990)


def test_counting_is_the_difference_of_counts_over_the_period_bit_for_bit() -> None:
    change = {"load": {"torque": 0.3}, "drive": {"position_sensor": encoder("M")}}
    x = run(change, 0.5)
    step = TURN / 2000
    counts = np.floor(x["theta_m"][::10] / step)
    assert np.array_equal(x["omega_measured"][10::10], np.diff(counts) * step / (1e-4 * 10.0))


@pytest.mark.parametrize("speed", [3.7, -41.0])
def test_the_observer_smooths_the_counts(speed: float) -> None:
    """A count is a step of the angle; its noise through the observer is far below that of counting."""
    noise = []
    for bandwidth in (100.0, 400.0):
        omega = measured(speed, encoder("observer", bandwidth=bandwidth))[2000:]
        assert omega.mean() == pytest.approx(speed, rel=2e-3)
        noise.append(omega.std())
    assert noise[0] < noise[1] < 0.3 * measured(speed, encoder("M"))[2000:].std()


@pytest.mark.parametrize("method", ["T", "MT"])
@pytest.mark.parametrize("speed", [3.7, -3.7, 0.4, 41.0, -250.0])
def test_timed_edges_give_the_speed_itself(method: str, speed: float) -> None:
    omega = measured(speed, encoder(method))[200:]
    tick = 1.0 / (1e9 * min(TURN / 2000 / abs(speed), 1e-3))  # of what is timed: an edge's interval
    assert np.abs(omega - speed).max() <= 2.1 * tick * abs(speed)


def test_timer_quantises_the_period() -> None:
    speed, timer = 30.0, 1e6
    period = TURN / 2000 / speed
    omega = measured(speed, encoder("T", timer=timer))[200:]
    assert np.abs(period / (TURN / 2000 / omega) - 1.0).max() <= 1.0 / (period * timer) * 1.01
    assert np.ptp(omega) > 0.0


@pytest.mark.parametrize("method", ["T", "MT"])
@pytest.mark.parametrize("speed", [37.7, -91.3])
def test_edges_are_timed_by_whole_ticks_of_the_timer(method: str, speed: float) -> None:
    """The tick that the clock shows, not the nearest one."""
    timer, step = 123_457.0, TURN / 2000
    omega = measured(speed, encoder(method, timer=timer), 0.2)[::10]
    samples = 1e-3 * np.arange(len(omega))
    # the rotor starts on an edge, which counts as passed when it turns forward
    edges = np.floor(np.arange(-40, 40_000) * step / abs(speed) * timer) / timer
    last = np.searchsorted(np.arange(-40, 40_000) * step / abs(speed), samples, side="right") - 1
    if method == "MT":
        expected = np.diff(last) * step / np.diff(edges[last])
    else:
        ends = np.maximum(edges[last] - edges[last - 1], np.floor(samples * timer) / timer - edges[last])
        expected = (step / ends)[1:]
    assert np.abs(omega[5:]) == pytest.approx(expected[4:], rel=1e-9)
    assert np.ptp(expected[4:]) > 0.0


def test_no_edge_for_long_bounds_the_speed() -> None:
    change = {
        **STEADY,
        "mechanics": {"inertia": 1e-3, "coulomb_friction": 0.5, "breakaway_friction": 0.5},
        "initial_speed": 20.0,
        "drive": {"position_sensor": encoder("T")},
    }
    x = run(change, 1.0)
    # stands still from 0.04 s on: the estimate falls with the time since the last edge
    assert x["omega_m"][1000] == 0.0
    assert abs(x["omega_measured"][-1]) <= TURN / 2000 / 0.9


@pytest.mark.parametrize("speed", [12.0, -12.0])
def test_eccentricity_adds_its_derivative(speed: float) -> None:
    eccentricity, phase = 5e-3, 0.7
    sensor = encoder("MT", error=[{"order": 1, "amplitude": eccentricity, "phase": phase}])
    change = {**STEADY, "initial_speed": speed, "drive": {"position_sensor": sensor}}
    x = run(change, 1.0)
    middle = x["theta_m"] - speed * 0.5e-3  # the estimate is the mean over about a millisecond
    expected = speed * (1.0 + eccentricity * np.cos(middle + phase))
    assert x["omega_measured"][100::10] == pytest.approx(
        expected[100::10], abs=speed**2 * eccentricity * 2e-3 * 1.5
    )


def test_resolver_is_a_moving_average_of_a_quantised_angle() -> None:
    bits, window, speed = 12, 20, 5.0
    x = run(
        {
            **STEADY,
            "initial_speed": speed,
            "drive": {"position_sensor": word(bits, window=window)},
        },
        1.0,
    )
    step = TURN / 2**bits
    angle = np.floor(x["theta_m"] / step) * step
    expected = (angle[window:] - angle[:-window]) / (window * 1e-4)
    assert x["omega_measured"][window:] == pytest.approx(expected, abs=1e-9)


def order(x: dict[str, np.ndarray], signal: str, h: int, pole_pairs: int = 4) -> float:
    theta = pole_pairs * x["theta_m"]
    revolutions = int((theta[-1] - theta[0]) / TURN)
    keep = theta <= theta[0] + revolutions * TURN
    integral = np.trapezoid(x[signal][keep] * np.exp(-1j * h * theta[keep]), theta[keep])
    return float(2.0 * np.abs(integral) / (theta[keep][-1] - theta[keep][0]))


@pytest.mark.parametrize(
    ("sensors", "h", "expected"),
    [
        # an offset in one phase is 2/3 of it in the stationary frame, and turns once in the rotor's frame
        ({"offset": [0.3, 0.0, 0.0]}, 1, 0.2),
        # a gain error of one phase leaves a third of it at twice the frequency
        ({"gain_error": [0.06, 0.0, 0.0]}, 2, 5.0 * 0.06 / 3.0 / (1.0 + 0.06 * 2.0 / 3.0)),
        # two sensors: i_c is calculated, so an offset counts in both
        ({"offset": [0.3, 0.0, 0.0], "sensors": 2}, 1, 0.3 * 2.0 / np.sqrt(3.0)),
    ],
)
def test_current_sensor_errors_become_torque_ripple(sensors: dict[str, Any], h: int, expected: float) -> None:
    class Constant:
        def step(self, _: object) -> float:
            return 5.0

    change: dict[str, Any] = {
        "motor": {"L_d": 2e-3, "L_q": 2e-3},
        "mechanics": {"inertia": 1e6},
        "initial_speed": 6.0,
        "drive": {"current_sensors": sensors},
        "controller": {"law": "python"},
    }
    x = run(change, 2.0, controller=Constant())
    late = {name: signal[5000:] for name, signal in x.items()}
    assert order(late, "i_q", h) == pytest.approx(expected, rel=0.02)


def test_converter_rounds_to_its_step_and_ends_at_its_range() -> None:
    seen: list[float] = []

    class Watch:
        def step(self, inputs: Any) -> float:
            seen.append(inputs.i_q)
            return 5.0

    change: dict[str, Any] = {
        "mechanics": {"inertia": 1e6},
        "initial_speed": 0.0,
        "initial_angle": np.pi / 8 * 3,  # theta_e = 3 pi / 2: i_a = i_q
        "drive": {"current_sensors": {"bits": 8, "range": 4.0}},
        "controller": {"law": "python"},
    }
    x = run(change, 0.2, controller=Watch())
    step = 4.0 / 128
    i = np.array(seen[5:])
    # phases b and c each round on their own: i_q is a multiple of a third of the step
    assert i / (step / 3) == pytest.approx(np.round(i / (step / 3)), abs=1e-6)
    # phase a ends at its range, so the loop raises the others until 2/3 (4 - step) - (i_b + i_c) / 3 is 5
    assert x["i_q"][-1] == pytest.approx(15.0 - 2.0 * (4.0 - step), abs=step)


def test_noise_has_its_deviation_and_depends_on_the_seed() -> None:
    noises = []
    for seed in (1, 1, 2):
        seen: list[float] = []

        class Watch:
            def __init__(self, into: list[float]) -> None:
                self.into = into

            def step(self, inputs: Any) -> float:
                self.into.append(inputs.i_d)
                return 0.0

        change: dict[str, Any] = {
            "seed": seed,
            "mechanics": {"inertia": 1e6},
            "initial_speed": 0.0,
            "drive": {"kp_d": 0.0, "ki_d": 0.0, "kp_q": 0.0, "ki_q": 0.0, "current_sensors": {"noise": 0.05}},
            "controller": {"law": "python"},
        }
        run(change, 2.0, controller=Watch(seen))
        noises.append(np.array(seen))
    assert np.array_equal(noises[0], noises[1])
    assert not np.array_equal(noises[0], noises[2])
    # independent noise on three phases: variance of a Clarke component is 2/3 of one phase's
    assert noises[0][1:].std() == pytest.approx(0.05 * np.sqrt(2.0 / 3.0), rel=0.05)


def angle_error(
    x: dict[str, np.ndarray], sensor: dict[str, Any], true: np.ndarray | None = None
) -> np.ndarray:
    """Measured less true angle, within half a revolution, without the mean half step of rounding down."""
    error = x["theta_measured"] - (x["theta_m"] if true is None else true)
    return (error + np.pi) % TURN - np.pi + TURN / sensor["counts"] / 2


def turning(sensor: dict[str, Any], speed: float, seconds: float, **more: Any) -> dict[str, np.ndarray]:
    drive = {"position_sensor": sensor, **more}
    return run({**STEADY, "initial_speed": speed, "drive": drive}, seconds)


ORDERS = [
    {"order": 1, "amplitude": 8e-3, "phase": 0.4},
    {"order": 2, "amplitude": -3e-3, "phase": -1.2},
    {"order": 17, "amplitude": 4e-4, "phase": 2.0},
]


def spectrum(error: np.ndarray) -> np.ndarray:
    """Orders of an error over whole revolutions, as amplitudes of sines with their phases."""
    return 2j * np.fft.rfft(error) / len(error)


@pytest.mark.parametrize(
    "sensor",
    [
        {**encoder("M"), "counts": 2.0**22},
        word(22, "absolute", window=16),
        word(22, "resolver", window=16),
        {**word(22, "absolute"), "speed_method": "observer", "bandwidth": 200.0},
    ],
    ids=["encoder", "absolute", "resolver", "observer"],
)
def test_the_orders_of_an_error_are_in_the_measured_angle(sensor: dict[str, Any]) -> None:
    speed = TURN / 0.5  # a revolution in 5000 samples
    x = turning({**sensor, "error": ORDERS}, speed, 0.5)
    found = spectrum(angle_error(x, sensor))
    wanted = np.zeros(len(found), complex)
    for part in ORDERS:
        wanted[part["order"]] = part["amplitude"] * np.exp(1j * part["phase"])
    # rounding leaves the root of the samples' number less than a step
    assert np.abs(found - wanted)[1:].max() < TURN / 2**22


def test_a_table_of_an_error_is_its_orders_but_for_interpolation() -> None:
    points = 360
    angle = TURN / points * np.arange(points)
    error = sum(p["amplitude"] * np.sin(p["order"] * angle + p["phase"]) for p in ORDERS)
    table = {"angle": angle.tolist(), "error": error.tolist()}
    by_table, by_orders = (
        spectrum(angle_error(turning({**word(24), **change}, TURN / 0.5, 0.5), word(24)))
        for change in ({"error_table": table}, {"error": ORDERS})
    )
    for part in ORDERS:
        n, amplitude = part["order"], abs(part["amplitude"])
        # straight lines between points keep sinc^2 of an order
        kept = np.sinc(n / points) ** 2
        assert by_table[n] == pytest.approx(
            kept * by_orders[n], abs=2e-3 * amplitude * (n * TURN / points) + 1e-6
        )


@pytest.mark.parametrize("latency", [1e-4, 3e-4, 2.5e-4, 0.4e-4])
@pytest.mark.parametrize("speed", [9.0, -30.0])
def test_latency_shifts_angle_and_speed(latency: float, speed: float) -> None:
    """The rotor swings, so the angle between two samples has to be right too."""
    change = {
        "mechanics": {"inertia": 1e-3},
        "load": {"harmonics": [{"order": 4, "torque": 0.5, "phase": 0.0}]},
        "controller": {"config": {"kp": 0.0, "ki": 0.0}},
        "initial_speed": speed,
        "initial_angle": 0.3,
    }
    sensor = word(32, "absolute", window=1)
    free = {"ideal_current": True}
    late = run({**change, "drive": {**free, "position_sensor": {**sensor, "latency": latency}}}, 0.3)
    fine = run({**change, "drive": {**free, "current_rate": 100_000, "speed_divider": 100}}, 0.3)
    then = np.interp(late["time"] - latency, fine["time"], fine["theta_m"])
    error = angle_error(late, sensor, then)[10:]
    assert np.abs(error).max() < 3e-8  # of the interpolation of `then`
    assert np.ptp(late["omega_m"]) > 0.5
    middle = then - np.interp(late["time"] - latency - 1e-4, fine["time"], fine["theta_m"])
    assert np.abs(late["omega_measured"] - middle / 1e-4)[10:].max() <= 1e-3


def test_a_latency_of_zero_changes_no_bit() -> None:
    plain, late = (turning({**word(14), **more}, 9.0, 0.1) for more in ({}, {"latency": 0.0}))
    assert all(np.array_equal(plain[name], late[name]) for name in plain)


def test_an_absolute_encoder_counts_as_a_resolver_does() -> None:
    one, other = (turning(word(14, kind, window=8), 9.0, 0.1) for kind in ("absolute", "resolver"))
    assert all(np.array_equal(one[name], other[name]) for name in one)


PLACEMENT = [0.1, -0.05, 0.02, 0.0, -0.12, 0.07]  # rad, electrical


def hall(pole_pairs: int = 4, **more: Any) -> dict[str, Any]:
    placement = [late / pole_pairs for late in more.pop("placement", [0.0] * 6)]
    return {
        "kind": "hall", "counts": 6.0 * pole_pairs, "window": 6, "timer": 1e8, "placement": placement, **more
    }  # fmt: skip


@pytest.mark.parametrize("speed", [9.0, -9.0, 123.0])
@pytest.mark.parametrize("placement", [[0.0] * 6, PLACEMENT])
def test_hall_speed_is_exact_whatever_the_placement(speed: float, placement: list[float]) -> None:
    x = turning(hall(placement=placement), speed, 0.5)
    revolution = TURN / 4 / abs(speed)  # electrical; a tick of the timer is its error
    assert x["omega_measured"][5:] == pytest.approx(speed, rel=2 / (revolution * 1e8))


def test_hall_speed_over_one_interval_shows_the_placement() -> None:
    x = turning(hall(placement=PLACEMENT, window=1), 9.0, 0.5)
    late = np.append(PLACEMENT, PLACEMENT[0])
    intervals = 1 + np.diff(late) / (np.pi / 3)
    seen = np.unique(np.round(x["omega_measured"][3000:] / 9.0, 4))
    assert seen == pytest.approx(np.unique(np.round(1 / intervals, 4)), abs=2e-4)


@pytest.mark.parametrize("speed", [9.0, -41.0])
def test_hall_angle_is_interpolated_between_edges(speed: float) -> None:
    exact = angle_error(turning(hall(), speed, 0.5), hall()) - TURN / 24 / 2
    assert np.abs(exact).max() < 1e-4
    placed = turning(hall(placement=PLACEMENT), speed, 0.5)
    error = 4 * (angle_error(placed, hall()) - TURN / 24 / 2)  # electrical
    # behind an edge that comes late the angle is behind, until the next
    theta = 4 * placed["theta_m"] % TURN
    edges = (np.arange(7) * np.pi / 3 + np.append(PLACEMENT, PLACEMENT[0])) % TURN
    for n in range(6):
        inside = (theta - edges[n]) % TURN < (edges[n + 1] - edges[n]) % TURN
        late = PLACEMENT[n] if speed > 0 else PLACEMENT[(n + 1) % 6]
        width = np.pi / 3
        near = inside & (np.abs((theta - edges[n if speed > 0 else n + 1] + np.pi) % TURN - np.pi) < 0.7)
        assert error[near] == pytest.approx(-late, abs=2e-3)
        assert np.abs(error[inside]).max() < width


def test_hall_speed_falls_where_no_edge_comes_and_is_zero_after_a_turn_back() -> None:
    stops = {"inertia": 1e-3, "coulomb_friction": 0.5, "breakaway_friction": 0.5}
    change = {**STEADY, "mechanics": stops, "initial_speed": 40.0, "drive": {"position_sensor": hall()}}
    x = run(change, 1.0)
    assert x["omega_m"][-1] == 0.0
    assert 0 < x["omega_measured"][-1] <= 1.5 * TURN / 24 / 0.9
    swings = {"inertia": 1e-3}
    load = {"harmonics": [{"order": 1, "torque": 0.3, "phase": 0.0}]}
    change = {
        **STEADY,
        "mechanics": swings,
        "load": load,
        "initial_speed": 10.0,
        "drive": {"position_sensor": hall()},
    }
    x = run(change, 2.0)
    back = np.flatnonzero(np.diff(np.sign(x["omega_m"])))
    assert len(back) > 2
    assert x["omega_measured"].min() < -5 and x["omega_measured"].max() > 5
    assert np.count_nonzero(x["omega_measured"] == 0.0) > 20


def test_the_speed_filter_answers_a_step_as_a_lag() -> None:
    bandwidth = TURN * 200
    change = {
        "controller": {"config": {"kp": 0.0, "ki": 0.0}},
        "initial_speed": 0.0,
        "events": [{"time": 0.01, "load": -30.0}],
        "mechanics": {"inertia": 2e-3, "viscous_friction": 1.0},
        "drive": {"speed_filter": bandwidth},
    }
    x = run(change, 0.05)
    p, y = np.exp(-bandwidth * 1e-4), 0.0
    for omega, found in zip(x["omega_m"], x["omega_measured"], strict=True):
        y = p * y + (1 - p) * omega
        assert found == pytest.approx(y, rel=1e-12, abs=1e-15)
    assert x["omega_measured"][-1] == pytest.approx(30.0, rel=1e-3)
