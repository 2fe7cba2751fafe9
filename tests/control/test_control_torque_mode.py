"""Torque mode in C: a current from outside and what is learned act, nothing is learned, and the feedback
takes over without a jump."""

import math

import numpy as np
import pytest
from control_library import control_library
from test_control_off import LAWS, WITHOUT_MEMORY, Law, Trial, terms

PRECISIONS = pytest.mark.parametrize("precision", ["float", "double"])
INTEGRAL = [law for law in LAWS if law != "space_speed"]  # it has none


def step(law: Law, i_q_ref: float, *, torque=True, theta=None, **fields):
    theta = 10e-3 * law.n % (2 * math.pi) if theta is None else theta
    law.n += 1
    inputs = {"theta_ref": theta, "theta_m": theta, "omega_ref": 10.0, "omega_m": 10.0, "learn": True}
    inputs |= {"torque": torque, "i_q_ref": i_q_ref} | fields
    of_law = law.library.new("cgl_law_input", **inputs)
    law.c_step(law.state, of_law, law.out)
    return law.out.i_q_ref, law.out.status


def taught(library, name):
    law = Law(library, name)
    if name == "anti_cogging":
        law.cell[:64] = np.sin(np.arange(64))
    for _ in range(1500):
        law.step()
    return law


def learned(law: Law) -> float:
    return sum(share for name, share in terms(law.state).items() if name in ("learned", "looked_up", "alpha"))


@PRECISIONS
@pytest.mark.parametrize("name", LAWS)
def test_the_current_and_what_is_learned_act_and_the_map_stays(precision, name):
    law = taught(control_library(precision), name)
    cells, seen = law.rows.copy(), []
    for n in range(700):
        current = 0.7 * math.sin(0.01 * n)
        out, status = step(law, current, omega_m=10.0 + 3 * math.sin(n))
        seen.append(learned(law))
        assert abs(out - (current + seen[-1])) <= 8 * law.library.eps
        assert status == law.library.lib.CGL_STATUS_FROZEN
    assert np.array_equal(law.rows, cells)
    assert np.ptp(seen) > 0.02 or name in WITHOUT_MEMORY


@PRECISIONS
@pytest.mark.parametrize("name", INTEGRAL)
def test_the_feedback_takes_over_without_a_jump(precision, name):
    law = taught(control_library(precision), name)
    for _ in range(50):
        step(law, 0.7)
    at = 10e-3 * law.n % (2 * math.pi)
    before = step(law, 0.7, theta=at)[0] - learned(law)
    after, status = step(law, 0.0, torque=False, theta=at, learn=False)
    assert after - learned(law) == pytest.approx(before, abs=16 * law.library.eps)
    assert status == law.library.lib.CGL_STATUS_FROZEN


@PRECISIONS
@pytest.mark.parametrize("name", LAWS)
def test_limits_and_faults(precision, name):
    law = taught(control_library(precision), name)
    lib = law.library.lib
    out, status = step(law, 100.0)
    assert (out, status) == (5.0, lib.CGL_STATUS_FROZEN | lib.CGL_STATUS_SATURATED)
    for missing in (math.nan, math.inf):
        out, status = step(law, missing)
        assert out == pytest.approx(learned(law), abs=8 * law.library.eps)
        assert status == lib.CGL_STATUS_FROZEN | lib.CGL_STATUS_FAULT
    _, status = step(law, 0.1, theta=math.nan)
    assert status & lib.CGL_STATUS_FAULT
    out, status = step(law, 0.1, off=True)
    assert (out, status) == (0.0, lib.CGL_STATUS_FROZEN | lib.CGL_STATUS_OFF)


@PRECISIONS
@pytest.mark.parametrize("name", [law for law in LAWS if law not in WITHOUT_MEMORY])
def test_what_the_guard_says_holds(precision, name):
    """What is muted does not act, and nothing is cleared meanwhile."""
    law = taught(control_library(precision), name)
    cells = law.rows.copy()
    for _ in range(700):
        out, _ = step(law, 0.3, muted=1.0, forget=True)
        assert out == pytest.approx(0.3)
    assert np.array_equal(law.rows, cells) and cells.any()


@PRECISIONS
def test_trials_pass_the_current_and_learn_nothing(precision):
    library = control_library(precision)
    trial, frozen = Trial(library), library.lib.CGL_STATUS_FROZEN
    for _ in range(60):
        assert trial.step(0.1, torque=True, i_q_ref=2.0) == (2.0, frozen)
    assert not library.lib.cgl_trial_end(trial.state)
    library.lib.cgl_trial_reset(trial.state)
    assert trial.step(0.1, torque=True, i_q_ref=2.0) == (2.0, frozen)


def test_a_calibration_begins_anew_after_it():
    law = Law(control_library("double"), "anti_cogging")
    lib = law.library.lib
    lib.cgl_anti_cogging_calibrate(law.state)
    for _ in range(400):
        law.step()
    assert step(law, 0.3) == (0.3, lib.CGL_STATUS_BUSY | lib.CGL_STATUS_FROZEN)
    assert law.state.stage == lib.CGL_ANTI_COGGING_FORWARD and not law.state.started
