"""The rule auto: what it gives settles in every case that it allows for, and what a study gives stays."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogless import load, run_study
from cogless.design import auto
from cogless.design.auto import CORNERS, filled, known_orders, missing
from cogless.design.laws import space
from cogless.design.laws.periodic import PeriodicLoop
from cogless.design.laws.space import SpaceLoop
from cogless.design.learning_loop import FACTOR_MOST, LearningLoop
from cogless.design.speed_loop import speed_loop
from cogless.design.summary import design
from cogless.design.verdict import verdict
from cogless.errors import StudyError
from cogless.study import Study
from cogless.study import load as load_raw
from cogless.study.base import Source
from cogless.study.laws.space import SpaceSpeed
from cogless.study.reading import checked

ARM = {"harmonics": [{"order": 1, "torque": "1 mN*m"}]}
SIDE = {"inertia": "6e-6 kg*m^2", "stiffness": "100 N*m/rad"}
LAWS = ("pi-ilc", "robust-ilc", "pi-afc", "anti-cogging", "space-speed", "space-position")


def with_law(law: str, study: str = "uomodri", **more: object) -> Study:
    changes = {"controller.mine.law": law, "controller.mine.tuning": {"rule": "auto"}}
    found = load(study, {**changes, **{f"controller.mine.{key}": value for key, value in more.items()}})
    assert isinstance(found, Study)
    return found


by_rule = cache(with_law)  # the rule takes long


@pytest.mark.parametrize("law", LAWS)
def test_learning_settles_and_the_design_tells_the_rule(law: str) -> None:
    study = by_rule(law)
    found = verdict(study, "mine")
    assert found is None or found.kind == "settles"
    assert missing(study) == []
    assert design(study, "mine").rule == "auto"


@pytest.mark.parametrize("law", ["pi-ilc", "robust-ilc"])
@pytest.mark.parametrize("corner", CORNERS)
def test_no_frequency_grows_in_any_corner(law: str, corner: tuple[float, int]) -> None:
    study = by_rule(law)
    late = corner[1] * speed_loop(study).period
    for speed in (1.571, 25.13):
        loop = PeriodicLoop(study, "mine", speed, torque=corner[0], late=late)
        assert np.max(loop.factor(loop.frequencies)) <= FACTOR_MOST


def test_a_delay_beyond_what_the_rule_allows_for_grows() -> None:
    """The corners are no idle claim: far outside them learning doesn't settle."""
    study = by_rule("pi-ilc")
    loop = PeriodicLoop(study, "mine", 25.13, late=6 * speed_loop(study).period)
    assert np.max(loop.factor(loop.frequencies)) > FACTOR_MOST


def test_a_number_by_hand_stays() -> None:
    by_hand = with_law("pi-ilc", gain=0.01, cells=512)
    assert by_hand.controller["mine"].gain == 0.01
    assert by_hand.controller["mine"].cells == 512
    assert by_hand.controller["mine"].lead > 0
    assert by_rule("pi-ilc").controller["mine"].gain > 0.05


@pytest.mark.parametrize(
    ("law", "hand"),
    [
        ("pi-ilc", {"cells": 4096}),
        ("pi-ilc", {"lead": "0.4 ms"}),
        ("pi-ilc", {"q_half_width": 4}),
        ("pi-afc", {"orders": [24, 72], "lead": "1 ms"}),
        ("pi-afc", {"lead": "0 s"}),
        ("robust-ilc", {"cells": 8192}),
        ("robust-ilc", {"b": "9000 rad/s^2/A", "c": "200 1/s"}),
        ("space-speed", {"k": "0.1 A*s/rad"}),
        ("space-speed", {"cells": 512}),
    ],
)
def test_the_rest_follows_from_what_is_given(law: str, hand: dict[str, object]) -> None:
    study = with_law(law, "uomodri-dead-time", **hand)
    found = verdict(study, "mine")
    assert found is not None and found.kind == "settles"
    for key in hand:
        assert key in study.source.tables["controller"]["mine"]


@pytest.mark.parametrize(
    ("law", "kind", "hand"),
    [
        ("robust-ilc", PeriodicLoop, {"c": "60 1/s"}),
        ("robust-ilc", PeriodicLoop, {"b": "40000 rad/s^2/A"}),
        ("space-speed", SpaceLoop, {"k": "0.03 A*s/rad"}),
    ],
)
def test_the_learning_gain_is_that_of_the_feedback_by_hand(
    law: str, kind: type[PeriodicLoop | SpaceLoop], hand: dict[str, object]
) -> None:
    """No frequency is learned by more than all of its error in a period."""
    study = with_law(law, "uomodri-dead-time", **hand)
    loop = kind(study, "mine", 6.283)
    assert np.max(np.abs(loop.x(loop.frequencies))) <= 1 + 1e-3


def test_what_settles_with_nothing_stays_and_is_told() -> None:
    """At one speed, because every gain is tried."""
    only = {"scenario": {"steady": {"duration": "1 s", "reference": "60 rpm"}}, "metric": []}
    mine = {"law": "pi-ilc", "tuning": {"rule": "auto"}, "gain": "50 A*s/rad"}
    study = load("uomodri", {**only, "controller": {"mine": mine}})
    assert isinstance(study, Study)
    found = verdict(study, "mine")
    assert found is not None and found.kind != "settles"
    assert missing(study) == []


def test_a_feedback_by_hand_is_what_learning_is_designed_around() -> None:
    soft = with_law("pi-ilc", kp=0.05, ki=5.0)
    assert design(soft, "mine").gains["kp"].value == 0.05
    assert soft.controller["mine"].gain < 0.5 * by_rule("pi-ilc").controller["mine"].gain


def test_a_filled_study_is_filled_already() -> None:
    study = by_rule("pi-ilc")
    assert filled(study) is study


def test_a_study_without_its_numbers_doesnt_run() -> None:
    changes = {"controller.mine.law": "pi-ilc", "controller.mine.tuning": {"rule": "auto"}}
    with pytest.raises(StudyError, match=r"controller\.mine\.tuning: expected a study from cogless\.load"):
        run_study(load_raw("uomodri", changes), ["1-rev-s/mine"])


MOVES = {"moves": [["0.5 s", "0 deg"], ["1.5 s", "200 deg"], ["2.5 s", "0 deg"]]}
SWING = {"offset": "0 rpm", "amplitude": "60 rpm", "frequency": "0.25 Hz"}


@pytest.mark.parametrize(
    ("law", "reference", "top"), [("space-position", MOVES, 6.545), ("space-speed", SWING, 6.283)]
)
def test_in_angle_a_reference_that_stops_is_learned_above_half_of_its_speed(
    law: str, reference: object, top: float
) -> None:
    """mu_alpha / |omega| would be unstable on the way to standstill."""
    only = {"scenario": {"swing": {"duration": "4 s", "reference": reference}}, "metric": []}
    study = load("uomodri", {**only, "controller": {"mine": {"law": law, "tuning": {"rule": "auto"}}}})
    assert isinstance(study, Study)
    found = verdict(study, "mine")
    assert found is not None
    assert found.kind == "settles"
    assert found.passing is None
    assert study.controller["mine"].omega_min == pytest.approx(top / 2, rel=1e-3)


def test_an_axis_at_rest_has_nothing_to_tune_for() -> None:
    with pytest.raises(StudyError, match="expected a scenario of this controller in which the rotor turns"):
        load(
            "uomodri",
            {
                "controller.mine.law": "pi-ilc",
                "controller.mine.tuning": {"rule": "auto"},
                "scenario": {"rest": {"duration": "5 s", "reference": "0 rpm"}},
                "metric": [],
            },
        )


def test_phase_margin_must_be_given_for_its_own_rule() -> None:
    with pytest.raises(
        StudyError, match=r"controller\.pi\.tuning\.phase_margin: missing: expected a phase margin"
    ):
        load("uomodri", {"controller.pi.tuning": {"rule": "phase-margin"}})


@pytest.mark.parametrize(
    ("pole_pairs", "order", "cells"),
    [
        (1, 12, 256), (1, 25, 256), (1, 26, 512), (12, 12, 1024), (12, 103, 2048), (12, 204, 2048),
        (12, 900, 8192),
    ],
)  # fmt: skip
def test_a_map_has_ten_cells_or_more_in_a_wave(pole_pairs: int, order: int, cells: int) -> None:
    """A power of two from 256 to 8192, for what is known or for the sixth order of the poles."""
    changes = {
        "drive.rates.integration_steps": 3,
        "motor.pole_pairs": pole_pairs,
        "motor.cogging": [{"order": order, "torque": "4 mN*m"}],
        "motor.flux_harmonics": [],
        "controller.mine.law": "pi-ilc",
        "controller.mine.tuning.rule": "auto",
    }
    study = load_raw("uomodri", changes)
    assert isinstance(study, Study)
    assert auto.map_cells(study, "mine") == cells


@pytest.mark.parametrize(
    ("changes", "period", "cells"),
    [
        ({"motor.cogging": []}, "electrical", 256),  # of 12 pole pairs the drive's own, at most 6
        ({"motor.cogging": [{"order": 612, "torque": "1 mN*m"}]}, "electrical", 512),  # 51 in a pair
        ({"motor.cogging": [{"order": 18, "torque": "1 mN*m"}]}, "mechanical", 1024),
        ({"motor.cogging": [], "mechanics.load": ARM}, "mechanical", 1024),
        ({"motor.cogging": [], "mechanics.load_side": SIDE}, "mechanical", 1024),
    ],
)
def test_a_map_is_over_the_shorter_period_that_all_known_orders_have(
    changes: dict[str, Any], period: str, cells: int
) -> None:
    study = load_raw("uomodri", {"drive.rates.integration_steps": 20, **changes})
    assert isinstance(study, Study)
    assert auto.shared_period(study, "pi") == period
    assert auto.map_cells(study, "pi", period) == cells


def test_an_order_that_hardly_differs_from_its_image_is_left_out() -> None:
    """At 900 r/min and 1 kHz order 24 turns by 2.3 rad a sample, order 32 by 3.0."""
    scenario = {"duration": "1 s", "reference": "900 rpm", "initial_speed": "900 rpm"}
    alone = {"scenario": {"x": scenario}, "metric": [], "calibration": None}
    tables = {k: v for k, v in load_raw("liu2018").source.tables.items() if k not in alone}
    made = {"law": "pi-afc", "tuning": {"rule": "auto"}}
    source = load_raw("liu2018").source
    kept = tables | {"scenario": alone["scenario"], "controller": {"mine": made}}
    study = filled(checked(Source(source.path, kept, source.datasheet, source.own_motor_keys)))
    assert isinstance(study, Study)
    assert study.controller["mine"].orders == (4, 8, 16, 24)
    assert 32 in known_orders(study, "mine")


def test_known_orders_go_by_the_current_that_they_need() -> None:
    """0.003 mN m is left out, under a thousandth of the largest; 0.005 isn't. The drive's own come last."""
    sizes = ((30, 1.0), (12, 4.0), (50, 0.003), (60, 0.005))
    cogging = [{"order": n, "torque": f"{size} mN*m"} for n, size in sizes]
    changes = {"motor.cogging": cogging, "motor.flux_harmonics": [], "motor.pole_pairs": 7}
    study = load_raw("uomodri", changes)
    assert isinstance(study, Study)
    assert known_orders(study, "pi") == [12, 30, 60, 7, 14, 42]


def test_a_table_is_read_ahead_and_made_slowly() -> None:
    """Its position loop is a quarter as fast as the crossover, and the highest order stays below that."""
    study = by_rule("anti-cogging")
    law = study.controller["mine"]
    crossover = design(study, "mine").margins.crossover
    run = law.calibration
    assert run is not None and run.position_gain == pytest.approx(crossover / 4)
    assert run.speed * max(known_orders(study, "mine")) == pytest.approx(run.position_gain)
    assert run.revolutions == 1


def test_a_lead_reaches_up_to_the_first_frequency_that_grows() -> None:
    """|1 - X| is 0.5, 1, 1.2 and 0.4."""
    f = np.array([1.0, 2.0, 3.0, 4.0])
    x = np.array([0.5, 1 + 1j, 2.2, 0.6])
    assert auto.settling_reach(x, f) == 3.0
    assert auto.settling_reach(x[:2], f[:2]) == 2.0


def loop_of(delay: float, periods: float = 2.0) -> Any:
    """A loop that is late by `delay`, whose size plays no part."""
    return SimpleNamespace(
        plant=SimpleNamespace(period=1e-3),
        periods_per_second=periods,
        closed=lambda f: 0.01 * np.exp(-2j * np.pi * f * delay),
    )


def test_a_lead_takes_away_its_samples_of_delay() -> None:
    f = np.array([10.0, 40.0])
    for lead in (0, 3):
        late = 2 * np.pi * f * (5e-3 - lead * 1e-3)
        assert auto.phase_cosine(loop_of(5e-3), f, lead) == pytest.approx(np.cos(late))
    assert auto.phase_cosine(loop_of(5e-3), f, 5) == pytest.approx(np.ones(2))


def test_frequencies_reach_from_the_slowest_period_to_half_the_rate() -> None:
    found = auto.frequency_grid([loop_of(0.0, 7.0), loop_of(0.0, 2.0)])
    assert (found[0], found[-1], len(found)) == (pytest.approx(2.0), pytest.approx(499.0), 1000)


def narrow(grows: float, widest: int = 9, oscillates: object = None) -> Any:
    """A loop in which 5 Hz grows by a factor, and a filter of half width n keeps 1 / (1 + n) of that."""
    return SimpleNamespace(
        frequencies=np.array([1.0, 5.0]),
        unfiltered=lambda f: np.array([1.0, grows]),
        q=lambda f, n: np.ones(len(f)) / (1 + n),
        widest_filter=widest,
        oscillation=lambda: oscillates,
    )


def test_filters_let_every_loop_settle_the_narrowest_first() -> None:
    def widths(loops: list[Any], **fixed: int) -> list[int]:
        return list(auto._widths(loops, fixed))

    assert widths([narrow(1.0, widest=2), narrow(0.9)]) == [0, 1, 2]
    assert widths([narrow(1.0), narrow(2.5, widest=4), narrow(1.5)]) == [2, 3, 4]
    assert widths([narrow(4.0)])[0] == 3
    assert widths([narrow(4.0, widest=2)]) == []
    assert widths([narrow(4.0), narrow(1.0, widest=2)]) == []
    assert widths([narrow(4.0)], q_half_width=5) == [5]
    assert widths([narrow(4.0)], q_half_width=2) == []
    assert widths([narrow(1.0), narrow(1.0, oscillates=9.0)]) == []


def test_a_filter_is_widened_while_that_leaves_less(monkeypatch: pytest.MonkeyPatch) -> None:
    study: Any = None
    left = {2: 0.5, 3: 0.4, 4: 0.4, 5: 0.1}
    monkeypatch.setattr(auto, "with_numbers", lambda *_: None)
    monkeypatch.setattr(auto, "loops_in_corners", lambda *_: [])
    monkeypatch.setattr(auto, "_ripple_share", lambda study, name, kind, values: left[values["q_half_width"]])
    for widths, best in (((2, 3, 4, 5), (0.4, 3)), ((5,), (0.1, 5)), ((3, 2), (0.4, 3))):
        monkeypatch.setattr(auto, "_widths", lambda loops, fixed, widths=widths: iter(widths))
        found = auto._filter(study, "x", LearningLoop, {"mu": 1.0}, {})
        assert found == (best[0], {"mu": 1.0, "q_half_width": best[1]})
    monkeypatch.setattr(auto, "_widths", lambda loops, fixed: iter(()))
    assert auto._filter(study, "x", LearningLoop, {}, {}) is None


def test_linear_parts_of_robust_ilc_are_two_real_roots() -> None:
    """Its kp b is their sum, and their product as near to ki b as real roots come; b = K_t / J."""
    study = by_rule("robust-ilc")
    law = study.controller["mine"]
    kp, ki = auto.phase_margin_gains(study, "mine")
    b, c, eta = (getattr(law, key) for key in ("b", "c", "eta"))
    assert b == pytest.approx(study.K_t / study.mechanics.stiff.inertia)
    assert c + eta == pytest.approx(b * kp)
    assert c * eta == pytest.approx(min(b * ki, (b * kp / 2) ** 2))
    assert law.g == pytest.approx(2 * b * study.drive.current_sensors.noise)
    assert (law.q, law.beta_1, law.gamma) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("settles", "left", "tried", "best"),
    [
        ({4: 3, 2: 2, 1: 1, 0.5: 0}, {4: 0.5, 2: 0.3, 1: 0.4, 0.5: 0.1}, [8, 4, 2, 1], (2, 2)),
        ({8: 3, 4: 3, 2: 2}, {8: 0.5, 4: 0.5, 2: 0.1}, [8, 4], (8, 3)),  # half of it leaves as much
        ({8: 5, 2: 2, 1: 1}, {8: 0.5, 2: 0.4, 1: 0.6}, [8, 4, 2, 1], (2, 2)),
    ],
)
def test_a_gain_is_halved_while_half_of_it_leaves_less(
    monkeypatch: pytest.MonkeyPatch,
    settles: dict[float, int],
    left: dict[float, float],
    tried: list[float],
    best: tuple[float, int],
) -> None:
    """`settles`: the width of the filter with which a gain does; others don't with any."""
    study: Any = None
    asked: list[float] = []
    for_gain: dict[str, Any] = {
        "numbers_by_hand": lambda *_: {},
        "with_numbers": lambda *_: None,
        "loops_in_corners": lambda *_: [],
        "_widths": lambda *_: [settles[asked[-1]]] if asked[-1] in settles else [],
        "_ripple_share": lambda study, name, kind, values: left[values["mu"]],
    }
    for name, of in for_gain.items():
        monkeypatch.setattr(auto, name, of)

    def keys(gain: float) -> dict[str, float]:
        asked.append(gain)
        return {"mu": gain}

    found = auto.gain_and_filter(study, "x", LearningLoop, 8.0, keys)
    assert asked == tried
    assert found == {"mu": best[0], "q_half_width": best[1]}


def test_a_gain_is_halved_nine_times_with_what_is_set_by_hand_and_without(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    study: Any = SimpleNamespace(source=SimpleNamespace(path="s.toml"))
    asked: list[Any] = []
    for name in ("with_numbers", "loops_in_corners"):
        monkeypatch.setattr(auto, name, lambda *_: [])
    monkeypatch.setattr(auto, "_widths", lambda loops, fixed: asked.append((gains[-1], fixed)) or [])
    gains: list[float] = []
    for by_hand in ({}, {"cells": 7}):
        monkeypatch.setattr(auto, "numbers_by_hand", lambda *_, by_hand=by_hand: by_hand)
        asked.clear()
        with pytest.raises(StudyError) as error:
            auto.gain_and_filter(study, "x", LearningLoop, 8.0, lambda gain: gains.append(gain) or {})
        halved = [8.0 / 2**n for n in range(10)]
        tried = [(gain, fixed) for fixed in ([by_hand] if by_hand else []) for gain in halved]
        assert asked == [*tried, *((gain, {}) for gain in halved)]
    assert str(error.value) == (
        "s.toml: controller.x.tuning: learning settles with no gain that this rule tried: expected another "
        "loop, such as one with less delay"
    )


def test_the_widest_filter_that_is_tried_has_400_neighbours_on_a_side() -> None:
    assert list(auto._widths([narrow(401.0, widest=1000)], {})) == [400]
    assert list(auto._widths([narrow(401.0 * FACTOR_MOST * 1.001, widest=1000)], {})) == []


@pytest.mark.parametrize(
    ("ends", "above"),
    [
        ([(1.0, 4.0)], None),
        ([(0.0, 4.0)], 2.0),
        ([(0.0, 4.0), (0.0, 3.0), (0.0, 0.0)], 1.5),
        ([(0.0, 4.0), (1.2, 5.0)], 1.2),
        ([(0.0, 4.0), (2.5, 5.0)], 2.0),
    ],
)
def test_learning_rests_below_half_of_the_top_speed_where_a_reference_stops(
    ends: list[tuple[float, float]], above: float | None
) -> None:
    """But at no speed of a reference that turns all the time, and not if omega_min is set by hand."""
    scenarios = {str(n): SimpleNamespace(slowest=low, top_reference=top) for n, (low, top) in enumerate(ends)}
    study: Any = SimpleNamespace(scenario=scenarios, scenarios_of=lambda name: [])
    for table in ({}, {"omega_min": "1 rad/s"}):
        study.source = SimpleNamespace(tables={"controller": {"x": table}})
        assert space._above(study, "x") == ({} if above is None or table else {"omega_min": above})


@pytest.mark.parametrize(
    ("law", "speeds"), [("pi-ilc", [2.0, 4.0]), ("space", [0.5, 2.0, 4.0]), ("fast", [2.0, 4.0])]
)
def test_loops_are_at_the_slowest_and_fastest_speeds_in_every_corner_that_is_stable(
    monkeypatch: pytest.MonkeyPatch, law: str, speeds: list[float]
) -> None:
    """The first two corners are taken even if unstable. A law with omega_min has a loop at that speed too."""
    laws = {"pi-ilc": SimpleNamespace(rests_below=None), "space": SpaceSpeed.model_construct(omega_min=0.5)}
    laws["fast"] = SpaceSpeed.model_construct(omega_min=9.0)
    ends = ((0.0, 4.0), (2.0, 4.0))
    scenarios = {str(n): SimpleNamespace(slowest=low, top_reference=top) for n, (low, top) in enumerate(ends)}
    study: Any = SimpleNamespace(scenario=scenarios, scenarios_of=lambda name: [], controller=laws)
    monkeypatch.setattr(auto, "speed_loop", lambda study: SimpleNamespace(period=1e-3))

    def kind(study: Any, name: str, speed: float, torque: float, late: float) -> Any:
        return SimpleNamespace(at=(speed, torque, late), plant=torque, feedback=None)

    kind.RISES_AT_REST = True
    monkeypatch.setattr(auto, "oscillation", lambda plant, feedback: 9.0 if plant >= 1.0 else None)
    corners = [(1.0, 0.0), (1 / 1.5, 0.0)]
    found = [loop.at for loop in auto.loops_in_corners(kind, study, law)]
    assert found == [(speed, torque, late) for speed in speeds for torque, late in corners]
    monkeypatch.setattr(auto, "oscillation", lambda plant, feedback: None)
    stable = [loop.at for loop in auto.loops_in_corners(kind, study, law)]
    assert stable[:4] == [
        (speeds[0], *each) for each in ((1.0, 0.0), (1 / 1.5, 0.0), (2.0, 0.0), (1.0, 1e-3))
    ]


def test_what_learning_leaves_is_the_mean_over_the_scenarios_that_turn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    speeds = {"slow": 2.0, "rest": 0.0, "fast": 4.0}
    study: Any = SimpleNamespace(
        scenario={key: SimpleNamespace(top_reference=speed) for key, speed in speeds.items()}
    )

    def kind(study: Any, name: str, speed: float, scenario: str) -> Any:
        return None

    def ripple(loop: Any, time: float, settled: bool) -> Any:
        assert not settled
        return SimpleNamespace(ratio=time)

    monkeypatch.setattr(auto, "with_numbers", lambda study, *_: study)
    monkeypatch.setattr(auto, "scenarios_tuned_for", lambda *_: list(speeds))
    monkeypatch.setattr(auto, "ripple", ripple)
    turn = 2 * np.pi
    assert auto._ripple_share(study, "x", kind, {}) == pytest.approx(10 * turn * (1 / 2 + 1 / 4) / 2)


@pytest.mark.parametrize("law", ["space-position", "space-speed"])
def test_a_law_whose_learning_is_off_needs_no_gain_that_settles(law: str) -> None:
    """At rest the rule finds no learning gain; a law with learning off needs none."""
    own = {"law": law, "tuning": {"rule": "auto"}}
    still = {"scenario.slow.reference": "0 rpm", "scenario.slow.controllers": ["pi", "off"]}
    still |= {f"scenario.{name}.controllers": ["pi"] for name in load("uomodri").scenario if name != "slow"}
    with pytest.raises(StudyError, match="in which the rotor turns"):
        auto.load("uomodri", {**still, "controller.off": own})
    study = auto.load("uomodri", {**still, "controller.off": {**own, "learning": False}})
    assert isinstance(study, Study) and missing(study) == []
    (run,) = run_study(study, ["slow/off"]).runs
    assert abs(float(run.trace["omega_m"][-1])) < 0.1
