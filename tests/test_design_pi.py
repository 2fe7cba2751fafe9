"""The fair PI: designed margins against the sampled loop, computed another way."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete

import studies
from cogless.design.pi import SpeedLoop, gains, margins, phase_margin_pi, speed_loop
from cogless.design.summary import summary, to_dict
from cogless.errors import StudyError
from cogless.study.controller import Tuning

LOOP = SpeedLoop(
    b=1632.0, period=1e-3, measurement_delay=0.5e-3, kp_q=150.0, ki_q=77000.0, R_s=15.42, L_q=0.03
)
ENCODER = {"kind": "encoder", "lines": 2500}


def tuning(margin: float) -> Tuning:
    return Tuning.model_validate({"rule": "phase-margin", "phase_margin": f"{math.degrees(margin)!r} deg"})


def sampled_response(loop: SpeedLoop, kp: float, ki: float, w: np.ndarray) -> np.ndarray:
    """The open loop: current loop and motor as one exactly sampled state space, speed by counting."""
    # integral of the current error, i_q, omega, theta
    A = np.array(
        [
            [0, -1, 0, 0],
            [loop.ki_q / loop.L_q, -(loop.R_s + loop.kp_q) / loop.L_q, 0, 0],
            [0, loop.b, 0, 0],
            [0, 0, 1, 0],
        ]
    )
    B = np.array([[1], [loop.kp_q / loop.L_q], [0], [0]])
    Ad, Bd, *_ = cont2discrete((A, B, np.eye(4), np.zeros((4, 1))), loop.period)
    z = np.exp(1j * w * loop.period)
    theta = np.linalg.solve(z[:, None, None] * np.eye(4) - Ad, np.broadcast_to(Bd, (len(w), 4, 1)))[:, 3, 0]
    counted = theta * (1 - 1 / z) / loop.period
    return np.asarray(counted * (kp + ki * loop.period * z / (z - 1)))


def crossings(loop: SpeedLoop, kp: float, ki: float) -> tuple[float, float, float]:
    """Crossover (rad/s), phase margin (rad) and gain margin from a fine scan."""
    w = np.geomspace(1.0, 0.999 * math.pi / loop.period, 20000)
    L = sampled_response(loop, kp, ki, w)
    phase = np.unwrap(np.angle(-L))
    phase -= 2 * math.pi * round(float(phase[0]) / (2 * math.pi))
    at = int(np.flatnonzero(np.abs(L) >= 1)[-1])
    limit = int(np.flatnonzero(phase > 0)[-1])
    return float(w[at]), float(phase[at]), 1 / float(np.abs(L[limit]))


@pytest.mark.parametrize("degrees", [30, 45, 60, 75])
@pytest.mark.parametrize("current_gains", [(150.0, 77000.0), (100.0, 1e4), (600.0, 3e5)])
def test_the_sampled_loop_has_the_designed_margins(
    degrees: float, current_gains: tuple[float, float]
) -> None:
    loop = dataclasses.replace(LOOP, kp_q=current_gains[0], ki_q=current_gains[1])
    design = phase_margin_pi(loop, tuning(math.radians(degrees)))
    assert design.phase_margin == pytest.approx(math.radians(degrees), abs=1e-9)
    crossover, phase_margin, gain_margin = crossings(loop, design.kp, design.ki)
    assert crossover == pytest.approx(design.crossover, rel=0.002)
    assert phase_margin == pytest.approx(design.phase_margin, abs=math.radians(0.1))
    assert gain_margin == pytest.approx(design.gain_margin, rel=0.04)


@settings(max_examples=40, deadline=None)
@given(
    b=st.floats(10, 1e5),
    period=st.floats(1e-4, 1e-2),
    bandwidth=st.floats(200, 5000),
    margin=st.floats(math.radians(25), math.radians(75)),
)
def test_any_loop_gets_its_margin(b: float, period: float, bandwidth: float, margin: float) -> None:
    loop = SpeedLoop(
        b, period, period / 2, kp_q=bandwidth * 0.03, ki_q=bandwidth * 15.42, R_s=15.42, L_q=0.03
    )
    design = phase_margin_pi(loop, tuning(margin))
    assert design.kp > 0 and design.ki > 0
    assert design.phase_margin == pytest.approx(margin, abs=1e-6)
    assert design.gain_margin > 1


def test_the_crossover_lies_where_the_phase_is_largest() -> None:
    design = phase_margin_pi(LOOP, tuning(math.radians(60)))
    w = design.crossover * np.linspace(0.7, 1.4, 701)
    phase = np.angle(-LOOP.response(w, design.kp, design.ki))
    assert float(np.max(phase)) == pytest.approx(design.phase_margin, abs=math.radians(0.1))


def test_closed_form_of_the_symmetrical_optimum() -> None:
    # Slow against the sampling, with a fast current loop: w_c = x / ((1 + x^2) T_e), T_i = x / w_c.
    loop = dataclasses.replace(LOOP, kp_q=3e4, ki_q=3e4 * 15.42 / 0.03)
    margin = math.radians(75)
    design = phase_margin_pi(loop, tuning(margin))
    x = design.kp / design.ki * design.crossover
    assert math.atan(x) - x / (1 + x * x) == pytest.approx(margin, abs=math.radians(0.5))
    assert design.crossover == pytest.approx(x / (1 + x * x) / 1e-3, rel=0.02)


def test_gains_without_a_crossing_have_no_margins() -> None:
    none = margins(LOOP, 0.0, 0.0)
    assert math.isnan(none.crossover) and math.isnan(none.phase_margin)


# Of a study


def test_belief_and_inertia_make_b(tmp_path: Path) -> None:
    study = studies.study(
        tmp_path,
        {"drive.belief": {"psi_f": "50 mWb"}, "mechanics.inertia": 5e-4, "drive.position_sensor": ENCODER},
    )
    loop = speed_loop(study)
    assert loop.b == pytest.approx(1.5 * 4 * 0.05 / 5e-4)
    assert (loop.period, loop.measurement_delay) == (1e-3, 0.5e-3)
    assert loop.kp_q == pytest.approx(2 * math.pi * 800 * 0.03)


def test_the_speed_sensor_decides_the_delay(tmp_path: Path) -> None:
    assert speed_loop(studies.study(tmp_path)).measurement_delay == 0.0
    resolver = studies.study(tmp_path, {"drive.position_sensor": {"kind": "resolver", "window": 30}})
    assert speed_loop(resolver).measurement_delay == pytest.approx(1e-3)


def test_the_rule_gives_a_controller_its_gains(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    kp, ki = gains(study, "fair")
    assert margins(speed_loop(study), kp, ki).phase_margin == pytest.approx(math.radians(60))
    assert gains(study, "pi") == (study.controller["pi"].kp, study.controller["pi"].ki)


def test_a_current_loop_that_rings_allows_no_margin(tmp_path: Path) -> None:
    ringing = {"kp": "0 V/A", "ki": "1e4 V/A/s", "current_limit": "3 A"}
    study = studies.study(tmp_path, {"drive.current_loop": ringing, "motor.R_s": 0.5})
    with pytest.raises(StudyError) as error:
        gains(study, "fair")
    assert str(error.value).endswith(
        "study.toml: controller.fair.tuning: expected a faster and better damped current loop for this margin"
    )


def test_the_summary_has_every_controller(tmp_path: Path) -> None:
    robust = {
        "law": "robust-ilc",
        "b": "3900 rpm/s/A",
        "c": "5 1/s",
        "g": "500 rpm/s",
        "eta": "180 1/s",
        "q": 0.1,
    }
    robust |= {"beta_1": "0.4 rpm/s", "beta_2": "0.3 1/s", "gamma": "3 1/s^2"}
    study = studies.study(tmp_path, {"controller.robust": robust})
    designs = summary(study)
    assert {name: design.rule for name, design in designs.items()} == {
        "pi": None,
        "fair": "phase-margin",
        "robust": None,
    }
    assert designs["robust"].gains["b"].unit == "rad/s^2/A"
    # Its linear part is a PI with kp = (c + eta) / b.
    b = 3900 * math.pi / 30
    assert designs["robust"].margins.kp == pytest.approx(185 / b)
    plain = to_dict(study)
    assert plain["controllers"]["fair"]["margins"]["phase_margin_rad"] == pytest.approx(math.radians(60))
    assert plain["speed_loop"]["period"] == 1e-3
