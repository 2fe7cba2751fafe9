"""Predicted oscillation of robust ILC's relay: against simulation, in closed form, and what is said of it."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import studies
from cogless.design.laws.periodic import relay_warning, switching
from cogless.design.warnings import warnings
from cogless.run.simulate import run_study, simulate
from cogless.study import Study, changed, load

LAW = {"law": "robust-ilc", "b": 400.0, "c": 5.0, "eta": 180.0, "g": 30.0}
UNLEARNED = {"q": 0.0, "beta_1": 0.0, "beta_2": 0.0, "gamma": 0.0}


def drive(folder: Path, law: dict[str, float], changes: dict[str, Any] | None = None) -> Study:
    """A drive without cogging whose controller r doesn't learn."""
    quiet = {"motor.cogging": [], "metric": [], "scenario.low.duration": "0.6 s"}
    return studies.study(folder, {**quiet, "controller.r": {**LAW, **UNLEARNED, **law}, **(changes or {})})


@pytest.mark.parametrize(
    ("rate", "bandwidth", "samples"), [("1 kHz", 300, 3), ("2.5 kHz", 650, 3), ("5 kHz", 650, 4)]
)
def test_a_simulated_relay_oscillates_as_predicted(
    tmp_path: Path, rate: str, bandwidth: int, samples: int
) -> None:
    """These loops turn the current by half a turn where three or four samples make half an oscillation."""
    changes = {
        "drive.position_sensor": {"kind": "absolute", "bits": 22, "speed_method": "M"},
        "drive.rates.speed_loop": rate,
        "drive.current_loop.bandwidth": f"{bandwidth} Hz",
    }
    study = drive(tmp_path, {}, changes)
    found = switching(study, "low", "r")
    assert found is not None
    f_s = study.drive.rates.outer_loop
    assert f_s / 2 / found.frequency == pytest.approx(samples, rel=0.035)
    omega = run_study(study, ["low/r"]).runs[0].trace["omega_m"]
    omega = omega[len(omega) // 2 :] - np.mean(omega[len(omega) // 2 :])
    strongest = np.argmax(np.abs(np.fft.rfft(omega))) * study.trace_rate / len(omega)
    assert strongest == pytest.approx(found.frequency, rel=0.05)
    assert np.std(omega) == pytest.approx(found.ripple, rel=0.1)


def test_at_once_the_current_changes_its_sign_with_every_sample(tmp_path: Path) -> None:
    """An ideal loop answers within a sample: g / b drives the speed up and down by K_t / J T each time."""
    ideal = {
        "drive.position_sensor": {"kind": "ideal"},
        "drive.current_loop": {"kind": "ideal", "current_limit": "3 A"},
        "drive.rates": {"current_loop": "1 kHz", "speed_loop": "1 kHz"},
        "drive.inverter": None,
        "scenario.step.override": {},
    }
    study = drive(tmp_path, {"c": 0.0, "eta": 0.0}, ideal)
    found = switching(study, "low", "r")
    assert found is not None
    assert found.frequency == pytest.approx(500.0)
    K_t, J = 1.5 * 4 * 68e-3, 2.5e-4
    assert found.ripple == pytest.approx(30 / 400 * K_t / J * 1e-3 / 2, rel=1e-6)


def test_the_ripple_grows_with_the_relay_and_not_the_frequency(tmp_path: Path) -> None:
    one, ten = (switching(drive(tmp_path, {"g": g}), "low", "r") for g in (3.0, 30.0))
    assert one is not None and ten is not None
    assert ten.frequency == one.frequency
    assert ten.ripple == pytest.approx(10 * one.ripple)


def test_what_has_no_relay_or_is_unstable_has_no_such_oscillation(tmp_path: Path) -> None:
    assert switching(drive(tmp_path, {"g": 0.0}), "low", "r") is None
    assert switching(drive(tmp_path, {}), "low", "pi") is None
    assert switching(drive(tmp_path, {"eta": 5000.0}), "low", "r") is None


def test_a_relay_is_told_where_it_makes_more_than_the_feedback_leaves() -> None:
    line = (
        "in scenario 900-rpm its relay g switches at 210 Hz and causes 2.5 rpm rms of speed ripple; with "
        "g = 0 the feedback alone leaves 1.8 rpm rms"
    )
    assert str(relay_warning(load("liu2018"), "robust-ilc")) == line
    assert f"controller.robust-ilc: {line}" in map(str, warnings(load("liu2018"), "60-rpm", "robust-ilc"))
    assert relay_warning(load("liu2018", {"controller.robust-ilc.g": "250 rpm/s"}), "robust-ilc") is None
    assert relay_warning(load("liu2018"), "pi-ilc") is None


def test_of_several_scenarios_the_first_in_which_it_does_is_named(tmp_path: Path) -> None:
    """Cogging of 40 mN m is more than this relay makes; a tenth of it, in the second scenario, is less."""
    changes = {
        "motor.cogging": [{"order": 24, "torque": "40 mN*m"}],
        "scenario.step.override": {"motor.cogging.0.torque": "4 mN*m"},
        "scenario.step.controllers": ["pi", "fair", "r"],
    }
    said = relay_warning(drive(tmp_path, {}, changes), "r")
    assert said is not None and str(said).startswith("in scenario step its relay")


def test_without_its_relay_a_paper_s_law_leaves_what_the_sentence_says() -> None:
    """docs/laws/robust-ilc.md: liu2018 has 3.2 r/min with the relay and 1.8 without."""
    study, off = load("liu2018"), {"controller.robust-ilc.g": "0 rad/s^2"}
    (said,) = (
        str(each) for each in warnings(study, "900-rpm", "robust-ilc") if "its relay g switches" in str(each)
    )
    of_both = (
        r"causes ([\d.]+) rpm rms of speed ripple; with g = 0 the feedback alone leaves ([\d.]+) rpm rms"
    )
    told = re.search(of_both, said)
    assert told is not None
    of_relay, without = map(float, told.groups())
    for scenario in ("900-rpm", "60-rpm"):
        ripple = []
        for changes in ({}, off):
            omega = simulate(changed(study, changes), scenario, "robust-ilc").trace["omega_m"]
            ripple.append(float(np.std(omega[len(omega) // 2 :])) * 30 / np.pi)
        assert ripple[1] == pytest.approx(without, rel=0.1) and ripple[1] == pytest.approx(1.8, abs=0.05)
        assert ripple[0] == pytest.approx(3.2, rel=0.1)
        assert ripple[0] ** 2 - ripple[1] ** 2 == pytest.approx(of_relay**2, rel=0.45)
