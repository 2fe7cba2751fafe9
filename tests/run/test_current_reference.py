"""A salient motor above its base speed: most torque per current, field weakening, and learning there."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reference.current_reference import CurrentReference

import studies
from cogless.design.current_needed import available
from cogless.errors import StudyError
from cogless.run.simulate import simulate
from cogless.study import Study, load

RPM = math.pi / 30


def study(folder: Path, changes: dict[str, Any] | None = None) -> Study:
    source = folder / "traction.toml"
    source.write_text(studies.TRACTION)
    return load(source, changes or {})


def traces(study_here: Study, controller: str) -> dict[str, np.ndarray]:
    return simulate(study_here, "fast", controller).trace


def ripple(trace: dict[str, np.ndarray], share: float = 0.15) -> float:
    omega = trace["omega_m"]
    last = omega[-int(share * len(omega)) :]
    return float(last.std())


def test_above_base_speed_a_pi_holds_and_harmonic_learns_the_cogging(tmp_path: Path) -> None:
    of = study(tmp_path)
    model = CurrentReference(True, True, 0.6e-3, 1.5e-3, 0.3, 20e-3, 250.0)
    ripples = {}
    for controller in ("pi", "harmonic"):
        trace = traces(of, controller)
        last = slice(-len(trace["time"]) // 10, None)
        assert np.mean(trace["omega_m"][last]) == pytest.approx(4500 * RPM, rel=1e-3)
        i = trace["i_d"][last].mean() + 1j * trace["i_q"][last].mean()
        want, short = model.step(float(model.torque(i)), 4 * 4500 * RPM, 800.0)
        assert not short and abs(i - want) < 1.0
        assert i.real < -30.0
        ripples[controller] = ripple(trace)
    assert ripples["harmonic"] < 0.1 * ripples["pi"]


@pytest.mark.parametrize(
    ("belief", "share"),
    [
        ({"psi_f": "0.36 Wb"}, 1.0), ({"L_d": "0.48 mH"}, 1.0), ({"L_q": "1.8 mH"}, 1.0),
        ({"R_s": "16 mohm"}, 1.0), ({"psi_f": "0.24 Wb"}, 0.7), ({"L_d": "0.72 mH"}, 0.9),
    ],
)  # fmt: skip
def test_learning_holds_on_the_safe_side_of_a_wrong_belief(
    tmp_path: Path, belief: dict[str, str], share: float
) -> None:
    """The page's cure, a smaller share of the voltage, works on the other side, where learning stops else."""
    changes = {f"drive.belief.{key}": value for key, value in belief.items()}
    learned = traces(study(tmp_path, changes), "harmonic")
    if share < 1.0:
        assert ripple(learned) > 0.1 * RPM
        learned = traces(
            study(tmp_path, changes | {"drive.current_reference.voltage_share": share}), "harmonic"
        )
    assert ripple(learned) < 0.01 * RPM


def test_without_field_weakening_the_speed_is_not_reached(tmp_path: Path) -> None:
    trace = traces(study(tmp_path, {"drive.current_reference.field_weakening": False}), "pi")
    assert trace["omega_m"][-1] < 0.98 * 4500 * RPM


def test_most_torque_per_current_accelerates_faster_with_the_same_current(tmp_path: Path) -> None:
    changes = {"scenario.fast.initial_speed": "0 rpm", "scenario.fast.duration": "0.02 s", "metric": []}
    reached = {}
    for rule in ("mtpa", "zero-d"):
        trace = traces(study(tmp_path, {**changes, "drive.current_reference.rule": rule}), "pi")
        assert np.hypot(trace["i_d_ref"], trace["i_q_ref"]).max() <= 250.0 * (1 + 1e-5)
        reached[rule] = trace["omega_m"][-1]
    model = CurrentReference(True, False, 0.6e-3, 1.5e-3, 0.3, 20e-3, 250.0)
    assert reached["mtpa"] / reached["zero-d"] == pytest.approx(model.reach / 250.0, rel=0.02)


@pytest.mark.parametrize("speed", [0.0, 2000.0, 4500.0, 9000.0])
def test_what_design_takes_as_available_is_the_transcription_s(tmp_path: Path, speed: float) -> None:
    model = CurrentReference(True, True, 0.6e-3, 1.5e-3, 0.3, 20e-3, 250.0)
    i, _ = model.step(1e4, 4 * speed * RPM, 800.0)
    assert available(study(tmp_path), speed * RPM) == pytest.approx(model.torque(i), rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"drive.current_loop": {"kind": "ideal", "current_limit": "250 A"}, "drive.inverter": None},
         "drive.current_reference"),
        ({"drive.bus": {"delay_command": "1 ms"}}, "drive.current_reference"),
        ({"drive.current_reference.voltage_share": 1.1}, "drive.current_reference.voltage_share"),
        ({"drive.current_reference.rule": "mtpv"}, "drive.current_reference.rule"),
    ],
)  # fmt: skip
def test_refused(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    with pytest.raises(StudyError, match=said):
        study(tmp_path, changes)
