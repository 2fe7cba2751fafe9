"""What every learning loop is made of, in closed form: memory, filter, images of a coarse map, the rest."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import welch

import studies
from cogless import load
from cogless.design import ripple as module
from cogless.design import verdict
from cogless.design.angle_functions import AngleFunctions
from cogless.design.closed_loop import Linear, Oscillation
from cogless.design.detent import STALLING_RATIO
from cogless.design.laws import space
from cogless.design.laws.periodic import PeriodicLoop
from cogless.design.laws.space import SpaceLoop
from cogless.design.learning_loop import LearningLoop, _with_near, opened, sensitivity
from cogless.design.margins import Complex, Real
from cogless.design.ripple import Ripple, Sampled, _density, _noise, orders, ripple, sampled, sensor_waves
from cogless.design.speed_loop import counting_window
from cogless.design.verdict import doubts
from cogless.study.laws.space import SpaceSpeed

T, GAIN = 1e-3, 0.4
TURNS = 6.0  # learning periods a second
CELLS = 50
CELLS_OF_ONE = TURNS  # a second, of a map of a single cell


class Loop(LearningLoop):
    """G S = 1 / (1 + j f / 100 Hz) at 1 kHz, and a learning gain of its own."""

    @property
    def law(self) -> Any:
        return self.study.law

    @property
    def gamma(self) -> tuple[float, float]:
        return GAIN, self.law.k_i

    @property
    def lead(self) -> int:
        return self.law.lead

    @property
    def feedback_before(self) -> Linear:
        return Linear(ratio=1, k=0.5, k_i=2.0)

    @property
    def plant(self) -> Any:
        return SimpleNamespace(period=T, near=None)

    def oscillation(self) -> Oscillation | None:
        return self.law.oscillation

    def closed(self, f: Real) -> Complex:
        assert np.all(f >= 0)
        return np.asarray(1 / (1 + 0.01j * f))


def loop(over_angle: bool = True, cells: int = CELLS, lead: int = 0, wide: int = 0, k_i: float = 0.0) -> Loop:
    """At three revolutions a second backwards, with a period of half a revolution."""
    law = SimpleNamespace(over_angle=over_angle, cells=cells, lead=lead, q_half_width=wide, k_i=k_i)
    law.oscillation = None
    law.revolutions = lambda pole_pairs: Fraction(2, pole_pairs)
    study = SimpleNamespace(law=law, motor=SimpleNamespace(pole_pairs=4))
    return Loop(study, "mine", -2 * np.pi * 3.0)


def x(f: float, lead: int = 0) -> complex:
    return complex(GAIN / (1 + 0.01j * f) * np.exp(2j * np.pi * f * lead * T))


def test_a_map_has_cells_and_a_delay_line_samples() -> None:
    in_map, line = loop(), loop(over_angle=False, cells=2000)
    assert in_map.periods_per_second == pytest.approx(TURNS)
    assert in_map.cells_per_second == pytest.approx(CELLS * TURNS) and line.cells_per_second == 1 / T
    assert in_map.highest == pytest.approx(0.499 * CELLS * TURNS) and line.highest == 0.499 / T
    assert loop(cells=200).highest == 0.499 / T  # more cells than samples
    assert (in_map.widest_filter, line.widest_filter) == (24, 82)  # of 50 cells, of 166.7 samples
    assert loop(cells=51).widest_filter == 25


def test_the_filter_is_a_mean_over_neighbours() -> None:
    f = np.array([0.0, 40.0, 110.0])
    neighbours = np.cos(2 * np.pi * f / (CELLS * TURNS))
    assert loop(wide=1).q(f) == pytest.approx(np.abs(1 + 2 * neighbours) / 3)
    assert loop(wide=1).q(f, 0) == pytest.approx(np.ones(3))


def test_a_lead_is_a_later_error_s_and_what_acts_at_once_a_feedback() -> None:
    for lead in (0, 2):
        assert loop(lead=lead).x(70.0) == pytest.approx(x(70.0, lead))
        assert loop(lead=lead).x(-70.0) == pytest.approx(np.conj(x(70.0, lead)))
    assert loop().share_kept(70.0) == pytest.approx(1 / (1 + x(70.0)))
    assert loop().share_kept(70.0, 2) == loop(lead=2).share_kept(70.0) == pytest.approx(1 - x(70.0, 2))
    integral = 30.0 * T / (1 - np.exp(-2j * np.pi * 70.0 * T))
    assert loop(k_i=30.0).x(70.0) == pytest.approx(x(70.0) * (1 + integral / GAIN))
    assert loop(k_i=30.0).at_once == Linear(ratio=1, k=0.5 + GAIN, k_i=32.0)
    assert loop().at_once == Linear(ratio=1, k=0.5 + GAIN, k_i=2.0)
    assert loop(lead=2).at_once == loop().feedback == Linear(ratio=1, k=0.5, k_i=2.0)


@pytest.mark.parametrize("images", [[-230.0, 70.0, 370.0], [-400.0, -100.0, 200.0, 500.0]])
def test_a_coarse_map_mixes_the_images_that_samples_hold(images: list[float]) -> None:
    """Of 300 cells a second, up to half of the rate: 70 Hz has images at -530 and 670 Hz, too."""
    weights = np.sinc(np.array(images) / 300) ** 2
    kept = np.array([1 / (1 + (x(f) if f > 0 else np.conj(x(-f)))) for f in images])
    mixed = abs(np.sum(weights * kept) / np.sum(weights))
    assert loop().unfiltered(images[-2]) == pytest.approx(mixed)


def test_without_images_a_frequency_keeps_its_own_share() -> None:
    assert loop(wide=1).factor(70.0) == pytest.approx(loop(wide=1).q(70.0) * loop().unfiltered(70.0))
    assert loop().unfiltered(0.0) == pytest.approx(1 / (1 + GAIN))
    for fine in (loop(cells=200), loop(over_angle=False)):
        assert fine.unfiltered(70.0) == pytest.approx(abs(1 / (1 + x(70.0))))


def test_of_a_very_coarse_map_fifty_images_on_each_side_are_enough() -> None:
    """Six cells a second: 83 images on each side are below half of the rate."""

    def mixed(most: int) -> float:
        images = 2.5 + CELLS_OF_ONE * np.arange(-most, most + 1)
        weights = np.sinc(images / CELLS_OF_ONE) ** 2
        kept = [1 / (1 + (x(f) if f > 0 else np.conj(x(-f)))) for f in images]
        return float(abs(np.sum(weights * kept) / np.sum(weights)))

    found = loop(cells=1).unfiltered(2.5)
    assert found == pytest.approx(mixed(50), rel=1e-9)
    assert found == pytest.approx(mixed(82), rel=0.01)


def test_a_loop_settles_if_it_neither_oscillates_nor_grows() -> None:
    """Five samples of lead turn 100 Hz by half a turn."""
    assert loop().settled and not loop(lead=5).settled
    shaking = loop()
    shaking.law.oscillation = Oscillation(87.6, 3.0)
    assert not shaking.settled


def test_straight_lines_between_samples_smooth() -> None:
    """A delay line at a steady 166.7 samples reads a third before a sample, else anywhere: exp(pi/4 - 1)."""
    f, fine = 250.0, loop(cells=300)
    assert loop().interpolation_gain(f, True) == pytest.approx(np.sinc(f * T) ** 4)
    assert fine.interpolation_gain(f, True) == pytest.approx(np.sinc(f * T) ** 2 * np.sinc(f / 1800) ** 2)
    line = loop(over_angle=False)
    assert line.interpolation_gain(f, True) == pytest.approx(abs(1 / 3 + 2 / 3 * np.exp(-2j * np.pi * f * T)))
    assert line.interpolation_gain(f, False) == pytest.approx(np.exp(np.pi / 4 - 1), rel=1e-3)
    assert line.recalled(f, True) == pytest.approx(line.interpolation_gain(f, True))


@pytest.mark.parametrize("lead", [0, 2])
def test_what_comes_again_is_learned_and_what_does_not_may_double(lead: int) -> None:
    """Whole waves in a period: only what filter and lines lose is left. Half a wave more: -1."""
    here = loop(lead=lead, wide=1)
    for f, turned in ((4 * TURNS, 1.0), (4.5 * TURNS, -1.0), (4.25 * TURNS, -1j)):
        q = turned * float(here.recalled(f, True))
        kept = 1 - x(f, lead) if lead else 1 / (1 + x(f))
        left = (1 - q) / (1 - q * kept) * (1 if lead else kept)
        assert here.share_left(f) == pytest.approx(left)
        assert here.residual(f) == pytest.approx(abs(left))
        learned = 0.0  # of a disturbance of one, recalled in the first period
        for n in range(8):
            error = (1 - learned) * (1 if lead else kept)
            assert here.yet(f, n) == pytest.approx(abs(error)), n
            learned = q * (learned + x(f, lead) * error)


def test_the_worst_frequency_is_the_one_that_keeps_most() -> None:
    """The loop answers ever less to higher frequencies: the highest keeps most."""
    found = loop(over_angle=False).worst()
    assert found.frequency == pytest.approx(0.499 / T)
    assert found.factor == pytest.approx(abs(1 / (1 + x(0.499 / T))))


def test_the_sensitivity_is_that_of_all_that_feeds_back() -> None:
    """In a frame of 50: the PI acts on speed and k_theta times the angle, k_v on the angle alone."""
    feedback = Linear(ratio=50, k=0.2, k_theta=7.0, k_i=3.0, k_v=0.6)
    w, speed, angle = np.array([40.0]), np.array([0.3 - 0.1j]), np.array([-0.02j])
    pi = 0.2 + 3.0 * T / (1 - np.exp(-1j * w * T))
    assert opened(feedback, speed, angle) == pytest.approx(50 * (speed + 7.0 * angle))
    plant: Any = SimpleNamespace(period=T)
    around = pi * 50 * (speed + 7.0 * angle) + 0.6 * 50 * angle
    assert 1 / sensitivity(plant, feedback, w, speed, angle) == pytest.approx(1 + around)


def test_frequencies_around_a_resonance_come_in_between() -> None:
    near = 2 * np.pi * np.array([0.5, 1.5, 2.5, 3.5])
    told: Any = SimpleNamespace(near=near)
    f = np.array([1.0, 2.0, 3.0])
    assert _with_near(f, told) == pytest.approx([1.0, 1.5, 2.0, 2.5, 3.0])
    told.near = None
    assert _with_near(f, told) is f


@pytest.mark.parametrize("turn", [0.02, 0.5, 0.98])
def test_a_load_at_any_angle_may_keep_space_speed_from_learning(
    monkeypatch: pytest.MonkeyPatch, turn: float
) -> None:
    """Without learning its error is the largest current over k; up to eta_bar it learns."""
    law = SpaceSpeed.model_construct(k=2.0, eta_bar=1.5)
    study: Any = SimpleNamespace(controller={"x": law})

    def doubt(largest: float, scenario: str | None = "s") -> str | None:
        def current(theta: Real, omega_m: float) -> Real:
            assert omega_m == 3.0
            return np.where(np.abs(theta - turn * 2 * np.pi) < 0.01, -largest, 0.1)

        functions = SimpleNamespace(current=current)
        monkeypatch.setattr(space, "functions_in", lambda study, scenario: functions)
        return SpaceLoop(study, "x", -3.0, scenario=scenario).doubt

    monkeypatch.setattr(space, "speed_text", lambda study, speed: f"{speed:g} rad/s")
    assert doubt(3.0) is None and doubt(3.2, None) is None
    assert doubt(3.2) == (
        "the gain k alone leaves a speed error of up to 1.6 rad/s. The law learns only below eta_bar, so "
        "it may never learn"
    )


# Ripple


def test_no_ripple_is_as_much_as_before() -> None:
    assert [each.ratio for each in (Ripple(2.0, 1.0), Ripple(0.5, 1.0), Ripple(0.0, 0.0))] == [0.5, 2.0, 1.0]


def test_counts_come_by_speed_and_window() -> None:
    sensor = Sampled(count=0.01, window=1e-3, timed=False)
    assert sensor.counts(-20.0) == pytest.approx(2.0)
    assert sensor.counts_clause(-20.0) == "the position sensor gives 2 counts per speed sample"


TURN, ENCODER = 2 * np.pi, {"kind": "encoder", "lines": 2500}
OBSERVER = {"speed_method": "observer", "observer_bandwidth": "100 Hz"}


@pytest.mark.parametrize(
    ("sensor", "expected"),
    [
        ({"kind": "ideal"}, None),
        ({**ENCODER, "speed_method": "M"}, Sampled(TURN / 10_000, 1e-3, False)),
        ({**ENCODER, "speed_method": "MT"}, Sampled(TURN / 10_000, 1e-3, True)),
        ({"kind": "absolute", "bits": 12, "window": 3}, Sampled(TURN / 4096, 3 / 15e3, False)),
        (
            {**ENCODER, **OBSERVER},
            Sampled(
                TURN / 10_000,
                counting_window(TURN * 100, 1 / 15e3),
                False,
                observer=(TURN * 100, 1 / 15e3),
            ),
        ),
        # a mean over four intervals is as late as one edge of two and a half
        ({"kind": "hall", "edges": 4}, Sampled(TURN / 24 * 2.5, 1e-3, True)),
    ],
)
def test_how_a_sensor_measures_speed(
    tmp_path: Path, sensor: dict[str, Any], expected: Sampled | None
) -> None:
    """Current loop at 15 kHz, speed loop at 1 kHz, four pole pairs."""
    found = sampled(studies.study(tmp_path, {"drive.position_sensor": sensor}), "low")
    assert (found is None) == (expected is None)
    if found is not None and expected is not None:
        assert (found.count, found.window) == pytest.approx((expected.count, expected.window))
        assert found.timed == expected.timed
        assert (found.observer is None) == (expected.observer is None)
        if found.observer is not None:
            assert found.observer == pytest.approx(expected.observer)


@pytest.mark.parametrize(("bandwidth", "samples"), [(2000.0, 1), (290.0, 1), (1000.0, 8)])
def test_an_observer_of_the_steps_is_quiet_at_low_frequencies(bandwidth: float, samples: int) -> None:
    """Spectrum of an observer, written out here, of an angle of random steps at 8 kHz."""
    count, period, rows = 1e-3, 1 / 8e3, 400_000
    p = math.exp(-TURN * bandwidth * period)
    of_angle, of_speed, of_rate = 1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p), (1 - p) ** 3
    theta = turned = rate = 0.0
    speeds = []
    for measured in np.random.default_rng(1).uniform(-count / 2, count / 2, rows).tolist():
        theta, turned = theta + turned + rate / 2, turned + rate
        error = measured - theta
        theta, turned, rate = theta + of_angle * error, turned + of_speed * error, rate + of_rate * error
        speeds.append(turned / period)
    f, density = welch(np.array(speeds[::samples]), 1 / (samples * period), nperseg=2000)
    source = Sampled(count, period, False, observer=(TURN * bandwidth, period))
    at, variances = _density(samples * period, source)
    for low, high in itertools.pairwise(np.array([0.005, 0.02, 0.05, 0.15, 0.4]) / (samples * period)):
        inside = (f >= low) & (f < high)
        expected = float(np.sum(variances[(at >= low) & (at < high)]))
        assert float(np.sum(density[inside]) * f[1]) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(("counts", "told"), [(1.5, False), (1.0, False), (0.9, True)])
def test_less_than_a_count_in_a_sample_is_a_doubt(counts: float, told: bool) -> None:
    """Between pulses the measured speed says nothing; the slowest speed decides."""
    study = load("uomodri", {"drive.position_sensor.speed_method": "M"})
    key, other = list(study.scenario)[:2]
    source = sampled(study, key)
    assert source is not None
    slow, fast = (each * source.count / source.window for each in (counts, 5.0))
    few = f" the position sensor gives {counts:.2g} counts per speed sample"
    for scenario, inside in ((key, ""), (other, f" in scenario {key}")):
        at = ((slow, key), (fast, scenario))
        found = doubts([PeriodicLoop(study, "pi-ilc", speed, scenario=name) for speed, name in at])
        lines = [str(remark) for remark in found if f"{inside}{few}" in str(remark)]
        assert len(lines) == told


def noisy(lead: int) -> Any:
    """A loop whose responses are the same at all frequencies; while it learns it has half of its feedback."""
    before, after = (SimpleNamespace(ratio=2, response=lambda w, T, c=c: c) for c in (0.6, 0.3))
    flat = {"gain": lambda w: np.full(len(w), 0.5), "share_kept": lambda f: np.full(len(f), 0.8 - 0.6j)}
    flat |= {
        "q": lambda f: np.full(len(f), 0.9),
        "interpolation_gain": lambda f, constant: 0.8 if constant else 0.0,
    }
    plant = SimpleNamespace(period=1e-3)
    return SimpleNamespace(plant=plant, feedback_before=before, feedback=after, lead=lead, **flat)


@pytest.mark.parametrize("lead", [0, 3])
@pytest.mark.parametrize(("window", "spread"), [(0.5e-3, 2.0), (1e-3, 2.0), (1.5e-3, 2 + 2 / (1.5 * np.pi))])
def test_noise_of_counts_adds_up_in_what_is_learned(
    monkeypatch: pytest.MonkeyPatch, lead: int, window: float, spread: float
) -> None:
    """An angle's variance is q^2 / 12; a speed has two, which samples share if the window is longer."""
    passed = {0.6: (3.0, 5.0), 0.3: (2.0, 0.4)}

    def responses(plant: Any, feedback: Any, f: Real) -> tuple[Real, Real]:
        through, S = passed[feedback.response(0, 0)]
        return np.full(len(f), through), np.full(len(f), S)

    monkeypatch.setattr(module, "responses", responses)
    variance = spread * 0.01**2 / 12 / window**2
    alone, learned = _noise(noisy(lead), Sampled(0.01, window, False), 3.0)
    assert alone == pytest.approx((3.0 * 2 * 0.6) ** 2 * variance, rel=1e-5)
    rho, V = (0.72 * 1.0) ** 2, 2 * 0.5 * 0.4
    times = 1 + rho + rho**2
    if lead:
        left = 0.6**2 + V**2 * 0.72**2 * times
    else:
        V = V * (0.8 - 0.6j)
        left = abs(0.6 + V) ** 2 + abs(V) ** 2 * rho * times
    assert learned == pytest.approx(2.0**2 * left * variance, rel=1e-5)


def test_ripple_is_that_of_orders_and_of_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half the square of each amplitude; a speed that is timed has no noise of counts."""
    here: Any = SimpleNamespace(
        plant=None,
        study=None,
        scenario="s",
        omega_m=math.tau,
        feedback_before="before",
        feedback="after",
        residual=lambda f: np.array([0.5, 2.0]),
        periods_per_second=4.0,
    )
    monkeypatch.setattr(module, "orders", lambda *_: (np.array([3, 5]), np.array([2.0, 1.0])))
    answer = {"before": np.array([3.0, 4.0]), "after": np.array([1.0, 2.0])}
    monkeypatch.setattr(module, "disturbed", lambda plant, feedback, f: answer[feedback])
    before, after = (6.0**2 + 4.0**2) / 2, ((2.0 * 0.5) ** 2 + (2.0 * 2) ** 2) / 2
    asked: list[float] = []

    def noise(loop: Any, source: Sampled, periods: float) -> tuple[float, float]:
        asked.append(periods)
        return 0.5, 0.25

    monkeypatch.setattr(module, "_noise", noise)
    for source, more in ((None, 0), (Sampled(0.1, 1.0, True), 0), (Sampled(0.1, 1.0, False), 1)):
        monkeypatch.setattr(module, "_sensor", lambda loop, source=source: source)
        found = ripple(here, 3.0)
        assert found.without == pytest.approx((before + 0.5 * more) ** 0.5)
        assert found.learned == pytest.approx((after + 0.25 * more) ** 0.5)
    ripple(here, 0.1)
    assert asked == [12.0, 1.0]  # one period at least
    here.yet = lambda f, periods: np.array([periods, 0.0])
    assert ripple(here, 3.0, settled=False).learned == pytest.approx((24.0**2 / 2 + 0.25) ** 0.5)


@pytest.mark.parametrize("order", [15, 40])
def test_orders_of_motor_and_load_are_currents_at_a_speed(
    monkeypatch: pytest.MonkeyPatch, order: int
) -> None:
    """The mean is none of them, nor is what is as small as rounding."""

    def current(theta: Real, omega_m: float) -> Real:
        return 5.0 + 0.3 * omega_m * np.sin(order * theta) + 1e-10 * np.cos(2 * theta)

    functions: Any = SimpleNamespace(orders={order}, current=current)
    functions.waves = partial(AngleFunctions.waves, functions)
    monkeypatch.setattr(module, "functions_in", lambda study, scenario: functions)
    monkeypatch.setattr(module, "for_scenario", lambda study, scenario: study)
    of_sensors = {1: 0.0, order: 0.8}
    asked: list[float] = []
    monkeypatch.setattr(module, "sensor_waves", lambda study, mean: asked.append(mean) or of_sensors)
    none: Any = None
    n, d = orders(none, "s", -2.0)
    assert n.tolist() == [order] and d == pytest.approx([1.0])
    assert asked == pytest.approx([5.0])
    of_sensors[900] = 0.1  # above all that the motor has
    n, d = orders(none, "s", -2.0)
    assert n.tolist() == [order, 900] and d == pytest.approx([1.0, 0.1])


@pytest.mark.parametrize("phases", [2, 3])
@pytest.mark.parametrize("sensors", [2, 3])
def test_sensors_that_err_make_order_one_and_two_of_the_current(phases: int, sensors: int) -> None:
    """The expected values are measured currents of a constant i_q, transformed into the rotor's frame."""
    offset, gain, mean = (0.03, -0.01, 0.02), (0.05, 0.0, -0.02), 1.5
    errs = SimpleNamespace(offset=offset, gain_error=gain, sensors=sensors)
    motor: Any = SimpleNamespace(pole_pairs=4, star=lambda: SimpleNamespace(phases=phases))
    study: Any = SimpleNamespace(drive=SimpleNamespace(ideal=False, current_sensors=errs), motor=motor)
    theta = np.arange(360) * np.pi / 180  # electrical
    places = 2 * np.pi / 3 * np.arange(3) if phases == 3 else np.array([0.0, np.pi / 2])
    found = sensor_waves(study, mean)
    for parts, order in (((1, 0), 4), ((0, 1), 8)):
        true = [-mean * np.sin(theta - place) for place in places]
        seen = [i * (1 + parts[1] * g) + parts[0] * o for i, g, o in zip(true, gain, offset, strict=False)]
        if phases == 3 and sensors == 2:
            seen[2] = -seen[0] - seen[1]
        i_q = -2 / phases * sum(i * np.sin(theta - place) for i, place in zip(seen, places, strict=True))
        wave = 2 * abs(np.mean((i_q - mean) * np.exp(-1j * (order // 4) * theta)))
        assert found[order] == pytest.approx(wave), order
    study.drive.ideal = True
    assert not any(sensor_waves(study, mean).values())


@pytest.mark.parametrize(
    ("swing", "told"),
    [
        (0.999 * STALLING_RATIO, []),
        (0.414, ["at 3 rad/s the feedback alone lets the speed swing by 41 % rms"]),
    ],
)
def test_doubts_are_the_first_that_a_loop_has_itself_and_a_speed_that_swings_by_much(
    monkeypatch: pytest.MonkeyPatch, swing: float, told: list[str]
) -> None:
    reasons = [(1.0, None, 0.1), (3.0, "one", swing), (2.0, "other", 0.2)]
    loops: Any = [
        SimpleNamespace(omega_m=speed, doubt=reason, swing=each, study=None, scenario="s")
        for speed, reason, each in reasons
    ]
    monkeypatch.setattr(verdict, "sampled", lambda study, scenario: None)
    monkeypatch.setattr(verdict, "ripple", lambda loop, time: Ripple(loop.swing * loop.omega_m, 0.0))
    monkeypatch.setattr(verdict, "speed_text", lambda study, speed: f"{speed:g} rad/s")
    assert [*map(str, doubts(loops))] == ["one", *told]
