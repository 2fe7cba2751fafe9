"""Speed estimators of the C library: counts, edge times, an observer of the angle."""

import math

import numpy as np
import pytest
from control_library import control_library
from reference import speed as reference

PRECISIONS = ["double", "float"]
WRAP = 2**32


def count_law(precision: str, counts: int, window: int, ts: float, start: int = 0):
    library = control_library(precision)
    state, ring = library.new("cgl_speed_count"), library.ffi.new("uint32_t[]", window)
    config = library.new("cgl_speed_count_config", counts=counts, window=window)
    assert library.lib.cgl_speed_count_init(state, config, ts, ring, window) == library.lib.CGL_OK
    library.lib.cgl_speed_count_reset(state, start % WRAP)
    return library, state, ring


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("window", [1, 7])
def test_counting_equals_the_reference_across_the_wrap(precision: str, window: int) -> None:
    rng = np.random.default_rng(window)
    counts = -500 + np.cumsum(rng.integers(-300, 400, 500))
    library, state, _ring = count_law(precision, 10_000, window, 1e-3, int(counts[0]))
    found = [library.lib.cgl_speed_count_step(state, int(c) % WRAP) for c in counts]
    np.testing.assert_allclose(found, reference.counted(counts, 10_000, window, 1e-3), rtol=4 * library.eps)


@pytest.mark.parametrize(
    "wrong",
    [{"counts": 0}, {"window": 0}, {"window": 2**20 + 1}, {"ts": 0.0}, {"ts": math.nan}, {"ts": 1e-38}],
)
def test_counting_refuses(wrong: dict[str, float]) -> None:
    library = control_library("float")
    given = {"counts": 1000, "window": 4, "ts": 1e-3, **wrong}
    config = library.new("cgl_speed_count_config", counts=given["counts"], window=given["window"])
    ring = library.ffi.new("uint32_t[]", 4)
    state = library.new("cgl_speed_count")
    assert (
        library.lib.cgl_speed_count_init(state, config, given["ts"], ring, 4) == library.lib.CGL_ERROR_CONFIG
    )
    right = library.new("cgl_speed_count_config", counts=1000, window=5)
    assert library.lib.cgl_speed_count_init(state, right, 1e-3, ring, 4) == library.lib.CGL_ERROR_MEMORY


TIMER, COUNTS = 90e6, 20_000
STEP = 2 * np.pi / COUNTS


def some_edges(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Edges of a rotor that turns fast, slowly, stops and goes back: times in ticks, directions."""
    gaps, directions = [], []
    for _ in range(16):
        many, way = int(rng.integers(1, 40)), int(rng.choice([-1, 1]))
        gaps += [int(rng.integers(2_000, 200_000)) * int(rng.choice([1, 1, 1, 8])) for _ in range(many)]
        directions += [way] * many
    return np.cumsum(gaps) + 5_000, np.array(directions)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("last_interval", [False, True])
@pytest.mark.parametrize("offset", [0, WRAP - 10_000_000])
def test_timing_equals_the_reference(precision: str, last_interval: bool, offset: int) -> None:
    """Where the counter and the timer run round, too; the board reads both at each edge."""
    library, rng = control_library(precision), np.random.default_rng(3)
    ticks, directions = some_edges(rng)
    samples = np.arange(ticks[1] + 1, ticks[-1], 18_000)  # 0.2 ms
    expected = reference.timed(ticks / TIMER, directions, samples / TIMER, STEP, last_interval)
    config = library.new("cgl_speed_timed_config", counts=COUNTS, timer=TIMER, last_interval=last_interval)
    state, edges = library.new("cgl_speed_timed"), library.new("cgl_edges")
    assert library.lib.cgl_speed_timed_init(state, config) == library.lib.CGL_OK
    found, count, n = [], offset, 0
    edges.count = count % WRAP
    for sample in samples:
        while n < len(ticks) and ticks[n] <= sample:
            count += int(directions[n])
            library.lib.cgl_edges_pass(edges, count % WRAP, int(ticks[n] + offset) % WRAP)
            n += 1
        now = int(sample + offset) % WRAP
        if not found:
            library.lib.cgl_speed_timed_reset(state, edges, now, 0.0)
        found.append(library.lib.cgl_speed_timed_step(state, edges, now))
    np.testing.assert_allclose(
        found[1:], expected, rtol=max(6 * library.eps, 1e-9), atol=0
    )  # its times are in seconds
    assert (np.abs(expected) > 0).mean() > 0.5
    assert (expected == 0).any() or last_interval


def test_a_rotor_that_stands_longer_than_the_timer_goes_round_does_not_start_again() -> None:
    library = control_library("double")
    config = library.new("cgl_speed_timed_config", counts=COUNTS, timer=TIMER)
    state, edges = library.new("cgl_speed_timed"), library.new("cgl_edges")
    library.lib.cgl_speed_timed_init(state, config)
    library.lib.cgl_edges_pass(edges, 1, 1000)
    library.lib.cgl_edges_pass(edges, 2, 2000)
    quarter, speeds = WRAP // 4, []
    for n in range(1, 40):
        speeds.append(library.lib.cgl_speed_timed_step(state, edges, (2000 + n * quarter) % WRAP))
    assert np.all(np.diff(speeds[1:]) <= 0)
    assert speeds[-1] == pytest.approx(STEP * TIMER / (WRAP - 1))
    library.lib.cgl_edges_pass(edges, 3, (2000 + 39 * quarter + 50) % WRAP)
    late = library.lib.cgl_speed_timed_step(state, edges, (2000 + 39 * quarter + 90) % WRAP)
    assert late == pytest.approx(
        STEP * TIMER / (WRAP - 1)
    )  # the edge came after that time, not after 50 ticks


def test_several_edges_between_two_readings_have_their_mean_interval() -> None:
    library = control_library("double")
    edges = library.new("cgl_edges")
    library.lib.cgl_edges_pass(edges, 0xFFFFFFFE, 10)
    library.lib.cgl_edges_pass(edges, 2, 410)
    assert (edges.interval, edges.backward, edges.reversed) == (100, False, False)
    library.lib.cgl_edges_pass(edges, 1, 500)
    assert (edges.interval, edges.backward, edges.reversed) == (90, True, True)
    library.lib.cgl_edges_pass(edges, 1, 900)
    assert edges.time == 500


@pytest.mark.parametrize(
    "wrong", [{"counts": 0}, {"timer": 0.0}, {"timer": math.inf}, {"timer": math.nan}, {"timer": 1e35}]
)
def test_timing_refuses(wrong: dict[str, float]) -> None:
    library = control_library("float")
    config = library.new("cgl_speed_timed_config", **{"counts": 1, "timer": 1e6, **wrong})
    assert (
        library.lib.cgl_speed_timed_init(library.new("cgl_speed_timed"), config)
        == library.lib.CGL_ERROR_CONFIG
    )


def observer_of(precision: str, bandwidth: float, ts: float):
    library = control_library(precision)
    state = library.new("cgl_angle_observer")
    config = library.new("cgl_angle_observer_config", bandwidth=bandwidth)
    return library, state, library.lib.cgl_angle_observer_init(state, config, ts)


@pytest.mark.parametrize(("precision", "bound"), [("double", 1e-6), ("float", 2e-3)])
@pytest.mark.parametrize("bandwidth", [50.0, 2000.0, 20000.0])
def test_the_observer_has_its_poles_where_it_says(precision: str, bandwidth: float, bound: float) -> None:
    """Against an observer whose gains come from pole placement; turns of 2^-32 are its rounding.

    A step rounds the speed twice, by half a last place each; the angle is off by what undoes that, over l2.
    """
    ts = 5e-5
    library, state, error = observer_of(precision, bandwidth, ts)
    assert error == library.lib.CGL_OK
    t = ts * np.arange(4000)
    theta = 3.0 + 20.0 * t + 4.0 * np.sin(40.0 * t)
    turns = np.round(theta / (2 * np.pi) * WRAP).astype(np.int64)
    expected = reference.observed(turns / WRAP * 2 * np.pi, bandwidth, ts, 180.0)
    first = int(turns[0] - 180.0 * ts / (2 * np.pi) * WRAP)
    library.lib.cgl_angle_observer_reset(state, first % WRAP, 180.0)
    speeds, angles = [], []
    for turn in turns:
        library.lib.cgl_angle_observer_step(state, int(turn) % WRAP)
        speeds.append(state.omega)
        angles.append(state.theta)
    scale = 180.0 + 20 * bandwidth * 2 * np.pi / WRAP
    np.testing.assert_allclose(speeds, expected[:, 1], atol=bound * scale)
    off = (np.array(angles) - expected[:, 0] / (2 * np.pi) * WRAP + WRAP / 2) % WRAP - WRAP / 2
    rounded = library.eps * 128 / 2 / state.l2 / (2 * np.pi) * WRAP  # speeds of 128 to 256 rad/s
    assert np.abs(off).max() < (400 if precision == "double" else 5000) + 2 * rounded


def test_the_observer_is_right_at_constant_acceleration() -> None:
    library, state, _ = observer_of("float", 1000.0, 1e-4)
    for n in range(2000):
        t = 1e-4 * n
        library.lib.cgl_angle_observer_step(state, int((10 * t + 50 * t * t) / (2 * np.pi) * WRAP) % WRAP)
    assert state.omega == pytest.approx(10 + 100 * t, rel=1e-4)
    assert state.alpha == pytest.approx(100.0, rel=0.02)


def test_the_observer_takes_any_angle_and_stays_bounded() -> None:
    library, state, _ = observer_of("float", 40_000.0, 5e-5)
    rng = np.random.default_rng(0)
    for turn in rng.integers(0, WRAP, 3000):
        library.lib.cgl_angle_observer_step(state, int(turn))
        assert abs(state.omega) <= math.pi / 5e-5 * 1.001
        assert abs(state.alpha) <= math.pi / 5e-5**2 * 1.001


@pytest.mark.parametrize(
    ("bandwidth", "ts"),
    [(0.0, 1e-4), (-1.0, 1e-4), (math.nan, 1e-4), (21e3, 1e-4), (10.0, 0.0), (10.0, math.inf), (10.0, 1e-10)],
)
def test_the_observer_refuses(bandwidth: float, ts: float) -> None:
    library, _state, error = observer_of("float", bandwidth, ts)
    assert error == library.lib.CGL_ERROR_CONFIG


def test_the_observer_takes_another_bandwidth_while_it_runs() -> None:
    library, state, _ = observer_of("double", 100.0, 1e-4)
    library.lib.cgl_angle_observer_reset(state, 77, 12.0)
    faster = library.new("cgl_angle_observer_config", bandwidth=1000.0)
    assert library.lib.cgl_angle_observer_retune(state, faster) == library.lib.CGL_OK
    assert (state.theta, state.omega) == (77, 12.0)
    assert state.l1 == pytest.approx(1 - math.exp(-0.3))
    assert (
        library.lib.cgl_angle_observer_retune(state, library.new("cgl_angle_observer_config"))
        != library.lib.CGL_OK
    )
