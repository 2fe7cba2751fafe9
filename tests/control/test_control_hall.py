"""Hall sensors and the low-pass of the C library, against their definitions."""

import math
from bisect import bisect_right

import numpy as np
import pytest
from control_library import control_library

PRECISIONS = ["double", "float"]
TURN, WRAP = 2 * math.pi, 2**32


def hall_of(precision: str = "double", position: int = 0, **config: float):
    library = control_library(precision)
    state = library.new("cgl_hall")
    given = library.new("cgl_hall_config", **{"pole_pairs": 5, "edges": 6, "timer": 1e6, **config})
    error = library.lib.cgl_hall_init(state, given)
    if error == library.lib.CGL_OK:
        library.lib.cgl_hall_reset(state, position)
    return library, state, error


def turn(library, state, omega: float, late: list[float], steps: int, start: int = 0) -> np.ndarray:
    """Angle, speed and true angle each 100 us at constant speed; edges come `late`, electrical rad."""
    sector, edge, found = 0, 0, []
    places = [(n + late[n % 6] / (math.pi / 3)) for n in range(-200, 200)]
    for n in range(1, steps):
        theta = omega * 1e-4 * n  # mechanical
        sectors = theta * 5 / (math.pi / 3)
        passed = bisect_right(places, sectors) - 201
        if passed != sector:
            sector = passed
            last = places[passed + 200] if omega > 0 else places[passed + 201]
            edge = round(last * (math.pi / 3) / 5 / omega * 1e6)
        library.lib.cgl_hall_step(state, sector % 6, (edge + start) % WRAP, (100 * n + start) % WRAP)
        found.append((state.turns / WRAP * TURN, state.omega_m, theta % TURN))
    return np.array(found)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("omega", [11.0, -11.0])
@pytest.mark.parametrize("start", [0, WRAP - 50_000])
def test_speed_and_angle_at_constant_speed(precision: str, omega: float, start: int) -> None:
    library, state, _ = hall_of(precision, position=29 if omega < 0 else 0)
    library.lib.cgl_hall_step(state, 5 if omega < 0 else 0, start, start)
    found = turn(library, state, omega, [0.0] * 6, 4000, start)[1500:]
    assert found[:, 1] == pytest.approx(omega, rel=1e-4)
    off = (found[:, 0] - found[:, 2] + math.pi) % TURN - math.pi
    assert np.abs(off).max() < 11.0 * 3e-6 + 1e-4  # ticks


def test_errors_of_placement_cancel_over_a_revolution_only() -> None:
    late = [0.1, -0.2, 0.05, 0.2, -0.15, 0.0]
    speeds = []
    for edges in (1, 6):
        library, state, _ = hall_of(edges=edges)
        speeds.append(turn(library, state, 11.0, late, 4000)[2000:, 1])
    assert np.ptp(speeds[0]) > 0.3 * 11.0
    assert speeds[1] == pytest.approx(11.0, rel=1e-4)


def test_it_stands_in_the_middle_until_an_edge_comes_and_at_the_edge_after_a_turn_back() -> None:
    library, state, _ = hall_of(position=7)
    assert state.turns / WRAP * 30 == pytest.approx(7.5, abs=1e-6)
    library.lib.cgl_hall_step(state, 2, 1000, 1050)
    assert (state.position, state.omega_m) == (8, 0.0)
    assert state.turns / WRAP * 30 == pytest.approx(8.0, abs=1e-6)
    library.lib.cgl_hall_step(state, 3, 2000, 2000)
    speed = TURN / 30 / 1e-3
    assert state.omega_m == pytest.approx(speed)
    library.lib.cgl_hall_step(state, 2, 2500, 2600)  # the same edge again
    assert (state.position, state.omega_m) == (8, 0.0)
    assert state.turns / WRAP * 30 == pytest.approx(9.0, abs=1e-3)
    library.lib.cgl_hall_step(state, 1, 3500, 3500)
    assert state.omega_m == pytest.approx(-speed)


def test_without_edges_the_speed_falls_and_the_angle_waits_at_the_end_of_the_sector() -> None:
    library, state, _ = hall_of()
    for n in range(1, 9):
        library.lib.cgl_hall_step(state, n % 6, 1000 * n, 1000 * n)
    speed = TURN / 30 / 1e-3
    for waited in (1000, 1500, 3000, 60_000):
        library.lib.cgl_hall_step(state, 2, 8000, 8000 + waited)
        assert state.omega_m == pytest.approx(speed * min(1.0, 1500 / waited))
        assert state.turns / WRAP * 30 == pytest.approx(9.0, abs=1e-3)


def test_wrong_codes_are_not_believed_and_jumps_go_the_short_way() -> None:
    library, state, _ = hall_of(position=3)
    for code in (6, 7, 255):
        library.lib.cgl_hall_step(state, code, 10, 10)
        assert state.position == 3
    library.lib.cgl_hall_step(state, 5, 20, 20)
    assert state.position == 5
    library.lib.cgl_hall_step(state, 3, 30, 30)
    assert state.position == 3
    library.lib.cgl_hall_step(state, 0, 40, 40)  # half a revolution: as before, backward
    assert state.position == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"pole_pairs": 0},
        {"pole_pairs": 10_001},
        {"edges": 0},
        {"edges": 7},
        {"timer": 0.0},
        {"timer": math.nan},
    ],
)
def test_hall_refuses(wrong: dict[str, float]) -> None:
    library, _, error = hall_of(**wrong)
    assert error == library.lib.CGL_ERROR_CONFIG


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_low_pass_answers_a_step(precision: str) -> None:
    library = control_library(precision)
    state, config = library.new("cgl_low_pass"), library.new("cgl_low_pass_config", bandwidth=TURN * 200)
    assert library.lib.cgl_low_pass_init(state, config, 25e-6) == library.lib.CGL_OK
    found = [library.lib.cgl_low_pass_step(state, 3.0) for _ in range(400)]
    expected = 3 * (1 - np.exp(-TURN * 200 * 25e-6 * np.arange(1, 401)))
    np.testing.assert_allclose(found, expected, rtol=40 * library.eps, atol=20 * library.eps)
    assert math.isnan(library.lib.cgl_low_pass_step(state, math.nan))
    assert library.lib.cgl_low_pass_step(state, 3.0) == pytest.approx(3.0, rel=1e-5)
    library.lib.cgl_low_pass_reset(state, -7.0)
    assert library.lib.cgl_low_pass_step(state, -7.0) == pytest.approx(-7.0)


@pytest.mark.parametrize("bandwidth", [0.0, -1.0, math.nan, math.inf, 2.1e3])
def test_the_low_pass_refuses(bandwidth: float) -> None:
    library = control_library("double")
    state, config = library.new("cgl_low_pass"), library.new("cgl_low_pass_config", bandwidth=100.0)
    assert library.lib.cgl_low_pass_init(state, config, 1e-3) == library.lib.CGL_OK
    wrong = library.new("cgl_low_pass_config", bandwidth=bandwidth)
    assert library.lib.cgl_low_pass_retune(state, wrong) == library.lib.CGL_ERROR_CONFIG
    assert state.config.bandwidth == 100.0
