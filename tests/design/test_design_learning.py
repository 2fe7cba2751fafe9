"""The factor per period that `cogless design` predicts, against simulations that learn."""

from __future__ import annotations

import io
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from cogless import changed, load, run_study
from cogless.design.answers import to_dict
from cogless.design.closed_loop import Oscillation
from cogless.design.design_table import design_table
from cogless.design.law_rules import unstable_feedback
from cogless.design.laws import periodic
from cogless.design.laws.periodic import PeriodicLoop
from cogless.design.learning_loop import FACTOR_MOST, Worst
from cogless.design.ripple import Ripple
from cogless.design.summary import weakest_margins
from cogless.design.verdict import Verdict, verdict
from cogless.study import Study
from cogless.study.laws.periodic import PiIlc, RobustIlc

# without quantisation and forgetting, so that growth and decay can be seen over many periods
CLEAN: dict[str, Any] = {
    "drive.position_sensor.lines": 1_000_000,
    "drive.current_sensors.gain_error": [0.0, 0.0, 0.0],
    "controller.pi-ilc.forgetting": 1.0,
    "controller.pi-ilc.learning_start": "1 s",
    "controller.pi-ilc.cells": 8192,  # so many that interpolation between them doesn't filter
    "trace.rate": "1 kHz",
}


def known(study: Study, name: str) -> Verdict:
    found = verdict(study, name)
    assert found is not None
    return found


def worst(study: Study, name: str) -> Worst:
    found = known(study, name).worst
    assert found is not None
    return found


def growth(changes: dict[str, Any], frequency: float, begin: float, end: float) -> float:
    """Factor per period of the error's component at a frequency, over so many seconds of the run."""
    study = load("liu2018", {**CLEAN, **changes})
    (run,) = run_study(study, ["60-rpm/pi-ilc"]).runs
    time, error = run.trace["time"], run.trace["omega_error"]
    period, amplitudes = 0.25, []  # 60 r/min, 4 pole pairs
    for start in np.arange(begin, end, period):
        rows = (time >= start) & (time < start + period)
        amplitudes.append(abs(np.mean(error[rows] * np.exp(-2j * np.pi * frequency * time[rows]))))
    slope = np.polyfit(np.arange(len(amplitudes)), np.log(amplitudes), 1)[0]
    return float(np.exp(slope))


@pytest.mark.parametrize(("gain", "lead"), [("0.02 A/rpm", "0 s"), ("0.015 A/rpm", "6 ms")])
def test_growth_is_the_predicted_one(gain: str, lead: str) -> None:
    changes = {"controller.pi-ilc.gain": gain, "controller.pi-ilc.lead": lead}
    study = load("liu2018", {**CLEAN, **changes})
    found = PeriodicLoop(study, "pi-ilc", 2 * math.pi, scenario="60-rpm").worst()
    assert found.factor > 1.02
    frequency = round(found.frequency / 4.0) * 4.0  # whole orders of the electrical revolution
    assert growth(changes, frequency, 2.5, 4.5) == pytest.approx(found.factor, rel=0.03)


def test_a_lead_makes_every_frequency_decay() -> None:
    with_lead, without = (
        worst(load("uomodri", {"controller.pi-ilc.lead": lead}), "pi-ilc") for lead in ("0.4 ms", "0 s")
    )
    assert with_lead.factor < 1.001
    assert without.factor > 1.2


def test_the_lead_that_is_advised_settles_and_a_shorter_one_does_not() -> None:
    for name, controller in (("liu2018", "pi-ilc-printed"), ("uomodri", "pi-ilc")):
        changes = {f"controller.{controller}.lead": "0 s", f"controller.{controller}.q_half_width": 0}
        without = load(name, changes)
        assert worst(without, controller).factor > FACTOR_MOST
        repair = known(without, controller).repair
        assert repair is not None and repair.lead is not None
        lead = repair.lead
        period = 1.0 / without.drive.rates.speed_loop
        factors = [
            worst(load(name, {**changes, f"controller.{controller}.lead": f"{s} s"}), controller).factor
            for s in (lead, lead - period)
        ]
        assert factors[0] <= FACTOR_MOST < factors[1]


def test_only_learning_laws_have_a_factor() -> None:
    study = load("uomodri")
    assert verdict(study, "pi") is None
    assert verdict(study, "table") is None
    assert known(study, "robust-ilc").worst is not None


# Where a memory refuses to learn

BY_TIME: dict[str, Any] = {"controller.pi-ilc.memory": "time", "controller.pi-ilc.cells": 2000}
LONG_LEAD: dict[str, Any] = {"controller.pi-ilc.lead": "80 ms"}  # 400 samples


def printed(changes: dict[str, Any]) -> str:
    console = Console(file=io.StringIO(), width=400)
    console.print(design_table(load("uomodri", changes)))
    return console.file.getvalue()


@pytest.mark.parametrize(
    ("changes", "speed", "why"),
    [
        (BY_TIME, 1.0, "a period at 60 rpm has 5000 samples, more than cells = 2000"),
        (BY_TIME, 4.0, None),
        (
            {**BY_TIME, "controller.pi-ilc.q_half_width": 900},
            6.0,
            "833.3 samples, but the Q filter needs 901",
        ),
        ({**BY_TIME, "controller.pi-ilc.q_half_width": 800}, 6.0, None),
        (LONG_LEAD, 1.0, None),
        (
            LONG_LEAD,
            4.0,
            "a period at 240 rpm has 1250 samples, but the lead has 400: it may have at most a quarter of "
            "a period",
        ),
    ],
)
def test_what_is_said_to_be_frozen_learns_nothing(
    changes: dict[str, Any], speed: float, why: str | None
) -> None:
    study = load(
        "uomodri",
        {
            **changes,
            "scenario.slow.reference": "8 rev/s",  # a study in which no scenario learns is refused
            "scenario.fast.reference": f"{speed} rev/s",
            "scenario.fast.initial_speed": f"{speed} rev/s",
            "scenario.fast.duration": "5 s",
        },
    )
    found = PeriodicLoop(study, "pi-ilc", speed * 2 * math.pi).frozen
    assert found is None if why is None else (found or "").endswith(why)
    (run,) = run_study(study, ["fast/pi-ilc"]).runs
    learned = np.max(np.abs(run.trace["term_ilc"]))
    assert learned == 0.0 if why else learned > 0.0


def test_a_map_needs_four_samples_a_period() -> None:
    study = load("uomodri")  # 5 kHz
    assert PeriodicLoop(study, "pi-ilc", 2 * math.pi * 60 * 20).frozen is not None
    no_lead = load("uomodri", {"controller.pi-ilc.lead": "0 s"})
    assert PeriodicLoop(no_lead, "pi-ilc", 2 * math.pi * 1240).frozen is None
    assert "at least 4" in (PeriodicLoop(no_lead, "pi-ilc", 2 * math.pi * 1260).frozen or "")


def test_frozen_is_printed_and_in_json() -> None:
    reasons = known(load("uomodri", BY_TIME), "pi-ilc").frozen
    assert reasons == (
        "a period at 15 rpm has 20000 samples, more than cells = 2000",
        "a period at 60 rpm has 5000 samples, more than cells = 2000",
    )
    shown = printed(BY_TIME)  # its column folds
    assert "some speeds: a period at 60 rpm" in shown and "has 5000 samples, more than cells = 2000" in shown
    plain = to_dict(load("uomodri", BY_TIME))["controllers"]
    assert plain["pi-ilc"]["learning"]["frozen"] == list(reasons)
    assert plain["robust-ilc"]["learning"]["frozen"] == []
    assert plain["pi"]["learning"] is None
    assert "learns nothing" not in printed({})


def test_learning_does_not_settle_where_it_makes_the_feedback_unstable() -> None:
    too_much = {"controller.pi-ilc.gain": "20 A*s/rad", "controller.pi-ilc.lead": "0 s"}
    assert known(load("uomodri", too_much), "pi-ilc").kind == "unstable"
    assert "unstable with the feedback that learning adds" in printed(too_much)
    assert known(load("uomodri"), "pi-ilc").unstable is None


def test_a_delay_line_halfway_between_two_samples_smooths_what_it_recalls() -> None:
    """Its mean of two samples has the gain cos(pi f T), which leaves that much more of an order."""
    study = load("liu2018", {**CLEAN, "controller.pi-ilc.memory": "time"})
    T = PeriodicLoop(study, "pi-ilc", 2 * math.pi).plant.period
    poles = study.motor.pole_pairs if study.controller["pi-ilc"].period == "electrical" else 1
    loop = PeriodicLoop(study, "pi-ilc", 2 * math.pi / (200.5 * T * poles))
    f = np.arange(1, 60) * loop.periods_per_second
    kept, recalled = loop.share_kept(f), loop.q(f) * np.cos(np.pi * f * T)
    left = (1 - recalled) / (1 - recalled * kept) * (1 if loop.lead else kept)
    np.testing.assert_allclose(loop.residual(f), np.abs(left), rtol=1e-9)


@pytest.mark.parametrize(("beta_1", "worse"), [(300.0, False), (10_000.0, True)])
def test_what_learns_from_the_sign_keeps_an_oscillation_alive_and_is_told(beta_1: float, worse: bool) -> None:
    """To a small S, beta_1 sgn S is a large gain: with beta_2 alone the same learning settles."""
    law: dict[str, Any] = {"beta_2": 200.0, "forgetting": 0.8, "lead": 0.0, "g": 0.0, "gamma": 0.0}
    changes = {f"controller.robust-ilc.{key}": value for key, value in law.items()}
    clean = {"drive.position_sensor": {"kind": "ideal"}, "drive.current_sensors.noise": "0 A", "metric": []}
    only = {f"scenario.{name}.controllers": ["pi"] for name in ("slow", "fast")}
    study = load(
        "uomodri", {**changes, **clean, **only, "drive.guard": False, "scenario.1-rev-s.duration": "8 s"}
    )
    left = []
    for more in ({"beta_1": beta_1}, {"beta_1": beta_1, "learning_start": 1e6}):
        tried = changed(study, {f"controller.robust-ilc.{key}": value for key, value in more.items()})
        (run,) = run_study(tried, ["1-rev-s/robust-ilc"]).runs
        left.append(float(np.std(run.trace["omega_error"][-10_000:])))
    told = known(changed(study, {"controller.robust-ilc.beta_1": beta_1}), "robust-ilc").in_words()
    assert (left[0] > 1.25 * left[1]) == worse
    assert told == (
        "settles; this is not sure: the law's switching term, of gain beta_1, may keep alive an "
        "oscillation at 885 Hz with a ripple of 0.33 rev/s rms or more"
        if worse
        else "settles"
    )


@pytest.mark.parametrize(("gamma", "stable"), [(1.0e6, True), (1.4e6, False)])
def test_what_adapts_to_a_load_is_in_the_margins(gamma: float, stable: bool) -> None:
    """r_hat integrates S, which has an integral itself: beyond some gamma the feedback oscillates."""
    law = {"beta_2": 0.0, "lead": 0.0, "g": 0.0, "gamma": gamma}
    clean = {"drive.position_sensor": {"kind": "ideal"}, "drive.current_sensors.noise": "0 A", "metric": []}
    plain = {"motor.cogging": [], "drive.inverter.dead_time": "0 s", "mechanics.coulomb_friction": "0 N*m"}
    only = {f"scenario.{name}.controllers": ["pi"] for name in ("slow", "fast")}
    run = {
        "scenario.1-rev-s.duration": "3 s",
        "scenario.1-rev-s.events": [{"time": "0.5 s", "load": "1 mN*m"}],
    }
    changes = {f"controller.robust-ilc.{key}": value for key, value in law.items()}
    study = load("uomodri", {**changes, **clean, **plain, **only, **run})
    assert isinstance(study, Study)
    margins = weakest_margins(study, "robust-ilc")
    assert margins is not None
    assert margins.stable == stable
    unstable = unstable_feedback(study, "robust-ilc")
    assert (unstable is None) == stable
    (ran,) = run_study(study, ["1-rev-s/robust-ilc"]).runs
    assert (float(np.std(ran.trace["omega_error"][-5000:])) < 0.1) == stable


class Switching(PeriodicLoop):
    """A loop that settles while its beta_2 is below `limit`."""

    limit, swings = 2.28, None

    @property
    def settled(self) -> bool:
        return self.law.beta_2 < self.limit

    def oscillation(self) -> Oscillation | None:
        return self.swings

    def worst(self) -> Worst:
        return Worst(1.5, 55.6)


def test_the_smallest_oscillation_that_switching_makes_grow_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Amplitudes A 2^n are tried; A makes the ripple 1.25 times as large. The gain is 4 / (pi A 2^n)."""
    law = RobustIlc.model_construct(beta_1=1.0, beta_2=2.0)
    monkeypatch.setattr(periodic, "speed_text", lambda study, speed, digits: f"{speed:.{digits}g} rad/s")
    monkeypatch.setattr(periodic, "ripple", lambda loop, time: Ripple(0.8, 0.6))

    def doubt(law: RobustIlc, kind: type[PeriodicLoop] = Switching) -> str | None:
        controllers = {"x": law}
        made = SimpleNamespace(controller=controllers)
        made.model_copy = lambda update: SimpleNamespace(**update)
        return kind(made, "x", 1.0).doubt

    A = math.sqrt(2 * (1.0 - 0.36))
    gains = [4 / (math.pi * A * 2**n) for n in range(6)]
    assert gains[3] < 0.28 < gains[2]
    told = (  # A 2^2 / sqrt 2
        "the law's switching term, of gain beta_1, may keep alive an oscillation at {} Hz with a ripple of "
        "3.2 rad/s rms or more"
    )
    assert doubt(law) == told.format(56)
    shaking = type("Shaking", (Switching,), {"swings": Oscillation(87.6, 3.0)})
    assert doubt(law, shaking) == told.format(88)
    for last, limit in ((5, 2.0 + 0.99 * gains[5]), (0, 2.0 + 0.99 * gains[0])):
        edge = type("Edge", (Switching,), {"limit": limit})
        assert f"a ripple of {0.8 * 2**last:.2g} rad/s" in (doubt(law, edge) or "")
    assert doubt(law, type("Firm", (Switching,), {"limit": 2.0 + 1.01 * gains[0]})) is None
    assert doubt(law, type("Grown", (Switching,), {"limit": 2.0})) is None
    assert doubt(law.model_copy(update={"beta_1": 0.0})) is None
    monkeypatch.setattr(periodic, "ripple", lambda loop, time: Ripple(0.8, 1.0))
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
