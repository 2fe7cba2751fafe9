"""A design's searches for filters, shifts and leads, and its words on them, for made-up responses."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogless.design import from_study, learning, order_learning, q_filter, slow_running, summary, trial
from cogless.design.closed_loop import Linear, Oscillation
from cogless.design.error import DesignError
from cogless.design.learning import PeriodicLoop
from cogless.design.learning_loop import Worst
from cogless.design.margins import UNSTABLE, Margins
from cogless.design.order_learning import OrderLoop
from cogless.design.q_filter import better_shift, workable_cutoff
from cogless.design.response import Filter, best_gain, factor, gain_limits
from cogless.design.ripple import Ripple, Sampled
from cogless.design.summary import Design
from cogless.design.verdict import Verdict
from cogless.study.controller import PiIlc, RobustIlc
from cogless.study.pi_afc import PiAfc
from cogless.study.position_sensor import Encoder
from cogless.study.trial_controller import StateIlc

LOOPS: Any = []


class Bundle:
    """The responses of loops, where nothing looks at them."""

    grid = np.zeros(1)

    def __init__(self, *of: Any) -> None:
        pass

    def __call__(self, w: Any) -> None:
        pass


def test_without_a_filter_its_gain_is_one_and_it_acts_on_the_error() -> None:
    G = np.array([[0.5 + 0.1j, 1.0 - 0.3j]])
    assert np.array_equal(gain_limits(G), gain_limits(G, 1.0, "error"))
    assert best_gain(G) == best_gain(G, np.ones(2))
    assert np.array_equal(factor(G, 0.7), np.abs(1 - 0.7 * G))
    assert np.array_equal(factor(G, 0.7, 0.5), np.abs(1 - 0.7 * G * 0.5))


@pytest.mark.parametrize(
    ("samples", "by_gain", "by_ends", "found"),
    [
        (100, {3: 0.8}, {3: 0.7}, (0.9, 3, 0.8)),
        (100, {3: 0.6}, {3: 0.8}, (0.9, 3, 0.8)),  # the trial's ends count
        (100, {3: 0.86}, {}, None),  # not clearly faster
        (100, {7: 0.5, 8: 0.4}, {}, (0.9, 7, 0.5)),  # six beyond the relative degree
        (7, {7: 0.5, 6: 0.7}, {}, (0.9, 6, 0.7)),
        (100, {2: 0.5}, {}, None),
    ],
)
def test_another_shift_is_proposed_if_it_is_clearly_faster(
    monkeypatch: pytest.MonkeyPatch, samples: int, by_gain: Any, by_ends: Any, found: Any
) -> None:
    class Shifted:
        grid = np.zeros(1)

        def __init__(self, loops: Any, shift: int):
            self.shift = shift

        def __call__(self, w: Any) -> int:
            return self.shift

    monkeypatch.setattr(q_filter, "Bundle", Shifted)
    monkeypatch.setattr(q_filter, "best_gain", lambda shift, H: (10 * shift, by_gain.get(shift, 0.9)))

    def growth(loops: Any, K: int, shift: int, q: Any, filtered: str, count: int) -> Any:
        assert (K, filtered, count) == (10 * shift, "signal", samples)
        return np.array([0.1, by_ends.get(shift, 0.2)])

    monkeypatch.setattr(q_filter, "growth", growth)
    q: Any = SimpleNamespace(gain=lambda w: w)
    assert better_shift(LOOPS, 1, q, 2, samples) == found


@pytest.mark.parametrize(
    ("worst", "grows_above", "cutoff"),
    [
        (100.0, 1000.0, 95.0),
        (1e4, 1000.0, 490.0),
        (100.0, 95.0 * 0.8**3, 95.0 * 0.8**3),
        (100.0, 95.0 * 0.8**9, 95.0 * 0.8**9),
        (100.0, 95.0 * 0.8**9.5, None),
        (1.0, 1000.0, None),
    ],
)
@pytest.mark.parametrize("K_3", [None, 0.7])
def test_a_workable_cutoff_leaves_at_most_95_percent_at_the_ends_of_a_trial_too(
    monkeypatch: pytest.MonkeyPatch, worst: float, grows_above: float, cutoff: float | None, K_3: float | None
) -> None:
    """The factor is here the cutoff over `worst` Hz. Cutoffs of 0.001 to 0.49 of the rate are tried."""
    monkeypatch.setattr(q_filter, "Bundle", Bundle)
    one: Any = lambda cutoff, order, period: SimpleNamespace(cutoff=cutoff, gain=lambda w: cutoff)  # noqa: E731
    monkeypatch.setattr(q_filter, "butterworth", one)
    monkeypatch.setattr(q_filter, "best_gain", lambda G, H: (5.0, H / worst))
    monkeypatch.setattr(q_filter, "factor", lambda G, K, H, filtered: np.array([0.0, H / worst]))

    def growth(loops: Any, K: float, shift: int, q: Any, filtered: str, samples: int) -> Any:
        assert (K, shift, filtered, samples) == (K_3 or 5.0, 2, "signal", 300)
        return np.array([0.5, 0.96 if q.cutoff > grows_above else 0.95])

    monkeypatch.setattr(q_filter, "growth", growth)
    found = workable_cutoff(LOOPS, 2, 2, 1e-3, 300, K_3)
    assert found is None if cutoff is None else found == pytest.approx(cutoff, rel=7e-3)


@pytest.mark.parametrize(
    ("works", "said"),
    [
        ({2: 12.3456, 3: 20.0}, " of 12.3 Hz or less"),
        ({3: 20.0}, " of 20 Hz or less, and shift = 3"),
        ({8: 20.0}, " of 20 Hz or less, and shift = 8"),
        ({9: 20.0}, "; with this feedback none makes it fast, though"),
    ],
)
def test_a_filter_that_would_do_is_told(
    monkeypatch: pytest.MonkeyPatch, works: dict[int, float], said: str
) -> None:
    monkeypatch.setattr(trial, "workable_cutoff", lambda loops, shift, *_: works.get(shift))
    plant, settings = SimpleNamespace(period=1e-3), SimpleNamespace(filter_order=2, samples=100)
    assert trial._low_pass(LOOPS, plant, settings, 2) == said  # type: ignore[arg-type]


FASTEST = "K_3 by frequency, for the smallest factor a trial"
OTHER_SHIFT = "(35) is for a shift of 2"
FILTERED = f"{FASTEST} with the filter on the learned signal"


@pytest.mark.parametrize(
    ("cutoff", "filtered", "worst", "better", "note"),
    [
        (None, "error", 0.95, None, f"{FASTEST}, 0.95: {OTHER_SHIFT}"),
        (30.0, "error", 0.8, None, f"{FASTEST}, 0.8: {OTHER_SHIFT}"),
        (None, "error", 0.951, None, None),
        (30.0, "signal", 0.95, None, f"{FILTERED}, 0.95"),
        (30.0, "signal", 0.951, None, None),
        (
            30.0, "signal", 0.8, (0.9, 4, 0.5),
            f"{FILTERED}, 0.8, or 0.9 with the trial's ends; shift = 4 would make that 0.5",
        ),
    ],
)  # fmt: skip
def test_a_gain_by_frequency_says_how_fast_it_is(
    monkeypatch: pytest.MonkeyPatch,
    cutoff: float | None,
    filtered: str,
    worst: float,
    better: Any,
    note: str | None,
) -> None:
    monkeypatch.setattr(trial, "Bundle", Bundle)
    monkeypatch.setattr(trial, "best_gain", lambda *of: (0.7 + len(of), worst))
    monkeypatch.setattr(trial, "butterworth", lambda *_: Filter(np.ones(1), np.ones(1)))
    monkeypatch.setattr(trial, "better_shift", lambda loops, r, q, shift, samples: better)
    plant: Any = SimpleNamespace(period=1e-3, relative_degree=2)
    settings: Any = SimpleNamespace(cutoff=cutoff, filtered=filtered, filter_order=2, samples=100)
    found = trial._by_frequency(LOOPS, plant, settings, 3)
    with_filter = 2.7 if cutoff and filtered == "signal" else 1.7
    assert found == (None if note is None else (with_filter, note))


# Mistakes in a study's own keys


@pytest.mark.parametrize(
    ("message", "plant", "key"),
    [
        ("samples: 2: expected more", None, "scenario.s.duration"),
        ("K_s: expected more", None, "controller.ilc.K_s"),
        ("static_gain: expected more", None, "controller.ilc.N"),
        ("feedforward: expected more", None, "controller.ilc.feedforward"),
        ("state_weight: expected more", None, "design.state_weight"),
        ("nominal: expected more", None, "design.nominal"),
        ("nominal: expected more", [], "plant.parameter"),
        ("range.J: expected more", [], "design.range.J"),
        ("range: expected more", [], "plant.parameter"),
        ("output: expected more", [], "plant.C"),
        ("period: expected more", [], "plant.period"),
        ("vertex 2: expected more", [1], "plant.vertex"),
        ("vertex: expected more", [], "plant"),
        ("vertex: expected more", None, "design.vertex"),
    ],
)
def test_a_design_s_error_names_the_study_s_own_key(message: str, plant: Any, key: str) -> None:
    given = None if plant is None else SimpleNamespace(vertex=plant)
    laws = {"ilc": None, "older": StateIlc.model_construct()}
    study: Any = SimpleNamespace(source=SimpleNamespace(path="a.toml"), plant=given, controller=laws)
    text = message.partition(": ")[2]
    found = from_study._study_error(DesignError(message), study, "s", "ilc")
    assert str(found) == f"a.toml: {key}: {text}"


def test_the_older_law_has_names_of_its_own_for_its_gains() -> None:
    laws = {"older": StateIlc.model_construct()}
    study: Any = SimpleNamespace(source=SimpleNamespace(path="a.toml"), plant=None, controller=laws)
    for key, own in (("K_s", "K_stab"), ("K_3", "K_ilc"), ("shift", "shift")):
        found = from_study._study_error(DesignError(f"{key}: expected more"), study, "s", "older")
        assert str(found) == f"a.toml: controller.older.{own}: expected more"
    nobody = from_study._study_error(DesignError("K_s: expected more"), study, "", "")
    assert str(nobody) == "a.toml: design.K_s: expected more"


def test_values_outside_the_ranges_of_a_design_are_told() -> None:
    """A parameter without a range has its nominal value alone; rounding at an end is inside."""
    known = {
        "J": SimpleNamespace(range=(1.0, 2.0), nominal=1.5),
        "B": SimpleNamespace(range=None, nominal=3.0),
    }
    overrides = (None, {"J": 2.0 * (1 + 1e-10), "B": 3.0}, {"J": 2.1, "other": 1.0}, {"J": 0.9, "B": 3.1})
    phases = [(10 * n, SimpleNamespace(override=each)) for n, each in enumerate(overrides)]
    study: Any = SimpleNamespace(
        plant=SimpleNamespace(parameter=known), scenario={"s": SimpleNamespace(phases=phases)}
    )
    assert from_study._outside(study, "s") == (
        "scenario s, from trial 20: J is 2.1, outside the design's 1 to 2",
        "scenario s, from trial 30: J is 0.9, outside the design's 1 to 2",
        "scenario s, from trial 30: B is 3.1, outside the design's 3 to 3",
    )


# What a design says


def test_a_design_says_up_to_which_speed_it_learns() -> None:
    found = Verdict("settles", unit="rpm")
    one = Design("pi-ilc", None, {}, None, found, fastest=math.tau)
    assert one.words() == "settles; learns up to 60 rpm"
    fine = Design("pi-ilc", None, {}, None, Verdict("settles"), fastest=1.23456789)
    assert fine.words() == "settles; learns up to 1.23457 rad/s"
    assert Design("pi-ilc", None, {}, None, found).words() == "settles"
    assert Design("pi", None, {}, None, None, fastest=math.tau).words() == ""
    certified: Any = SimpleNamespace(words=lambda: "all settle")
    assert (
        Design("harmonic", None, {}, None, found, fastest=1.0, certificate=certified).words() == "all settle"
    )


@pytest.mark.parametrize(
    ("lead", "value", "note"),
    [(2e-3, 2e-3, ""), (1.4e-3, 1e-3, "1 samples; 0.0014 s asked for"), (2e-3 * (1 + 1e-10), 2e-3, "")],
)
def test_a_lead_is_told_in_whole_samples(lead: float, value: float, note: str) -> None:
    study: Any = SimpleNamespace(drive=SimpleNamespace(rates=SimpleNamespace(outer_loop=1e3)))
    law: Any = SimpleNamespace(lead=lead)
    found = summary._lead(study, law)
    assert (found.value, found.unit, found.note) == (pytest.approx(value), "s", note)


FIRM = Margins(True, 100.0, 1.0, 3.0, 300.0)
COUNT = 0.02  # rad


@pytest.mark.parametrize(
    ("omega", "timed", "margins", "said"),
    [
        (2.0, False, FIRM, None),  # 100 rad/s times 10 ms are a radian
        (
            1.0, False, FIRM,
            "at 1 rad/s an edge comes every 20 ms, the crossover is 15.9 Hz: the rotor coasts from count to "
            "count; 2 times the counts would do, or a crossover of 8 Hz",
        ),
        (4.0, True, FIRM, None),  # 4.5 ms late, 0.45 of the margin
        (
            2.5, True, FIRM,
            "at 2.5 rad/s an edge comes every 8 ms, the crossover is 15.9 Hz: the speed is 7.5 ms late, "
            "which costs 43 deg of 57 deg of phase margin; 1.5 times the counts would do, or a crossover of "
            "11 Hz",
        ),
        (
            1.0, True, FIRM,
            "at 1 rad/s an edge comes every 20 ms, the crossover is 15.9 Hz: the speed is 20 ms late, "
            "which costs 112 deg of 57 deg of phase margin; where it stops and goes it reads high, by 10 % "
            "if every other edge takes twice as long; 3.6 times the counts would do, or a crossover of "
            "4.4 Hz",
        ),
        (1.0, False, UNSTABLE, None),
        (1.0, False, Margins(True, math.nan, math.nan, 3.0, 300.0), None),
        (0.0, False, FIRM, None),
    ],
)  # fmt: skip
def test_edges_that_come_too_rarely_for_the_loop(
    monkeypatch: pytest.MonkeyPatch, omega: float, timed: bool, margins: Margins, said: str | None
) -> None:
    of_part: dict[str, Any] = {
        "held": lambda study, scenario: omega,
        "speed_loop": lambda study, scenario: SimpleNamespace(period=1e-3),
        "sampled": lambda study, scenario: Sampled(COUNT, 1e-3, timed),
        "feedback_of": lambda study, name, speed: "feedback",
        "position_margins": lambda loop, feedback: margins,
        "speed_text": lambda study, speed: f"{speed:g} rad/s",
    }
    for name, part in of_part.items():
        monkeypatch.setattr(slow_running, name, part)
    study: Any = SimpleNamespace(scenarios_of=lambda name: ["a", "b"])
    assert slow_running.slow_warning(study, "x") == said
    for name in ("sampled", "feedback_of"):
        with monkeypatch.context() as without:
            without.setattr(slow_running, name, lambda *_: None)
            assert slow_running.slow_warning(study, "x") is None


@pytest.mark.parametrize(
    ("method", "counts", "told"), [("M", 0.5, False), ("average", 0.49, True), ("MT", 0.4, False)]
)
def test_a_counted_speed_of_less_than_half_a_count_reads_zero(
    monkeypatch: pytest.MonkeyPatch, method: str, counts: float, told: bool
) -> None:
    sensor = Encoder.model_construct(kind="encoder", speed_method=method)
    here = SimpleNamespace(drive=SimpleNamespace(position_sensor=sensor))
    monkeypatch.setattr(slow_running, "held", lambda *_: counts * 20.0)
    monkeypatch.setattr(slow_running, "sampled", lambda *_: Sampled(COUNT, 1e-3, False))
    monkeypatch.setattr(slow_running, "for_scenario", lambda *_: here)
    monkeypatch.setattr(slow_running, "speed_text", lambda study, speed: f"{speed:g} rad/s")
    found = slow_running.reads_zero(None, "s")  # type: ignore[arg-type]
    line = "at 9.8 rad/s 0.49 counts come in a speed sample: most read 0, others 20 rad/s; "
    assert found == (f'{line}speed_method = "MT" times the edges, "observer" smooths' if told else None)


def test_the_slowest_speed_is_held_for_a_twentieth_of_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    study: Any = SimpleNamespace(scenario={"s": None})
    ways = [np.array([0.0, *-np.arange(1.0, 102.0)]), np.zeros(5)]
    monkeypatch.setattr(slow_running, "course", lambda scenario: SimpleNamespace(omega=ways.pop(0)))
    assert [slow_running.held(study, "s"), slow_running.held(study, "s")] == [pytest.approx(6.0), 0.0]


class Switching(PeriodicLoop):
    """A loop that settles while its beta_2 is below `limit`."""

    limit, swings = 2.28, None

    @property
    def settled(self) -> bool:
        return self.law.beta_2 < self.limit  # type: ignore[attr-defined, no-any-return]

    def oscillation(self) -> Oscillation | None:
        return self.swings

    def worst(self) -> Worst:
        return Worst(1.5, 55.6)


def test_the_smallest_oscillation_that_switching_makes_grow_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Amplitudes A 2^n are tried; A makes the ripple 1.25 times as large. The gain is 4 / (pi A 2^n)."""
    law = RobustIlc.model_construct(beta_1=1.0, beta_2=2.0)
    monkeypatch.setattr(learning, "speed_text", lambda study, speed, digits: f"{speed:.{digits}g} rad/s")
    monkeypatch.setattr(learning, "ripple", lambda loop, time: Ripple(0.8, 0.6))

    def doubt(law: RobustIlc, kind: type[PeriodicLoop] = Switching) -> str | None:
        controllers = {"x": law}
        made = SimpleNamespace(controller=controllers)
        made.model_copy = lambda update: SimpleNamespace(**update)
        return kind(made, "x", 1.0).doubt  # type: ignore[arg-type]

    A = math.sqrt(2 * (1.0 - 0.36))
    gains = [4 / (math.pi * A * 2**n) for n in range(6)]
    assert gains[3] < 0.28 < gains[2]
    told = "beta_1 sgn S keeps 3.2 rad/s rms of ripple or more alive, at {} Hz"  # A 2^2 / sqrt 2
    assert doubt(law) == told.format(56)
    shaking = type("Shaking", (Switching,), {"swings": Oscillation(87.6, 3.0)})
    assert doubt(law, shaking) == told.format(88)
    for last, limit in ((5, 2.0 + 0.99 * gains[5]), (0, 2.0 + 0.99 * gains[0])):
        edge = type("Edge", (Switching,), {"limit": limit})
        assert f"keeps {0.8 * 2**last:.2g} rad/s" in (doubt(law, edge) or "")
    assert doubt(law, type("Firm", (Switching,), {"limit": 2.0 + 1.01 * gains[0]})) is None
    assert doubt(law, type("Grown", (Switching,), {"limit": 2.0})) is None
    assert doubt(law.model_copy(update={"beta_1": 0.0})) is None
    monkeypatch.setattr(learning, "ripple", lambda loop, time: Ripple(0.8, 1.0))
    assert doubt(law) is None


@pytest.mark.parametrize(
    ("cells", "turns", "longest"), [(1000, 10.0, 25), (44, 10.0, 11), (1000, 1.0, 30), (47, 1.0, 11)]
)
def test_leads_up_to_a_quarter_of_the_period_or_the_map_are_tried(
    cells: int, turns: float, longest: int
) -> None:
    """Of 30 samples at most, at 1 kHz and this many periods a second. A lead of 4 samples does not settle."""
    own: dict[str, Any] = {
        "plant": SimpleNamespace(period=1e-3),
        "periods_per_second": turns,
        "frequencies": np.array([1.0, 2.0]),
        "q": lambda self, f: np.array([0.5, 1.0]),
        "unfiltered": lambda self, f, n: np.array([1.9, 0.9 if n != 4 else 1.1]),
    }
    study = SimpleNamespace(controller={"x": PiIlc.model_construct(cells=cells)})
    found = type("Leading", (PeriodicLoop,), own)(study, "x", 1.0)
    assert found.settling_leads() == {*range(1, longest + 1)} - {4}


def test_leads_of_orders_settle_by_each_order_and_all_together() -> None:
    """Up to 30 samples of 50 ms."""
    own = {
        "unfiltered": lambda self, f, n: np.array([0.5, 1.0 if n == 3 else 0.9]),
        "_worst_with": lambda self, lead: Worst(1.1 if lead == pytest.approx(0.35) else 0.9, 7.0),
    }
    found = type("Leading", (Orders,), own)(orders().study, "x", 4.0)
    assert found.settling_leads() == {*range(31)} - {3, 7}


class Orders(OrderLoop):
    """Orders 2, 5 and 9 at 4 rad/s; the loop, at 20 Hz, lags by a quarter of a turn more every 4 Hz."""

    plant: Any = SimpleNamespace(period=0.05)
    feedback: Any = Linear(1, 1.0)

    def closed(self, f: Any) -> Any:
        return np.exp(-2j * np.pi * np.asarray(f) / 16)


def orders(omega_m: float = 4.0, **more: Any) -> Orders:
    law = {"orders": (2, 5, 9), "omega_min": 0.5, "gain": 3.0, "lead": 0.0, **more}
    study = SimpleNamespace(
        controller={"x": PiAfc.model_construct(**law)}, motor=SimpleNamespace(pole_pairs=3)
    )
    return Orders(study, "x", omega_m)  # type: ignore[arg-type]


def test_orders_with_more_than_two_samples_a_cycle_are_learned_by_their_averaged_factor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(order_learning, "speed_text", lambda study, speed: f"{speed:g} rad/s")
    here = orders()
    assert here.orders.tolist() == [2.0, 5.0, 9.0] and orders(7.0).orders.tolist() == [2.0, 5.0]
    second = 4.0 / math.tau
    assert here.frequencies == pytest.approx(np.array([2, 5, 9]) * second)
    for lead, time in ((None, 0.0), (3, 0.15)):
        f = np.array([1.0, 3.0, 10.0])
        seen = np.cos(2 * np.pi * f * (time - 1 / 16))
        expected = np.exp(-1.5 * seen / second)
        expected[2] = 1.0  # half the rate: too fast to be learned
        assert here.unfiltered(f, lead) == pytest.approx(expected)
    assert here.q(f).tolist() == [0.0] * 3 and here.recalled(f, True).tolist() == [1.0] * 3
    assert here.cells_per_second == 20.0 and here.gamma == (0.0, 0.0)
    assert orders(-4.0).frozen is None and orders(0.5).frozen is None
    assert orders(-0.4).frozen == "-0.4 rad/s is below omega_min"
    assert orders(32.0).frozen == "order 2 has less than two samples at 32 rad/s"


def test_growth_is_an_oscillation_only_if_no_order_grows_by_itself() -> None:
    def found(factor: float, grows: bool) -> Oscillation | None:
        own = {
            "_worst": Worst(factor, 7.0),
            "unfiltered": lambda self, f: np.array([0.9, 1.1 if grows else 1.0]),
        }
        return type("Known", (Orders,), own)(orders().study, "x", 4.0).oscillation()  # type: ignore[no-any-return]

    assert found(1.001, False) is None and found(1.5, True) is None
    shaking = found(1.5, False)
    assert shaking == Oscillation(7.0, pytest.approx(math.log(1.5) * 4.0 / math.tau))  # type: ignore[arg-type]
