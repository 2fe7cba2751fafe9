"""A law that is off gives nothing, its integrals start anew, what is learned stays; a reset one is new."""

import math
from operator import attrgetter
from typing import Any

import numpy as np
import pytest
from control_library import ControlLibrary, control_library
from laws import OF_SPEED, ROWS
from test_control_init import needed

from cogless.control_library import C_LAWS

TS = 1e-3
STEPS = {C_LAWS[name].step.removeprefix("cgl_").removesuffix("_step"): name for name in OF_SPEED}
LAWS = {step: ROWS[name].running for step, name in STEPS.items()}
WITHOUT_MEMORY = {step for step, name in STEPS.items() if C_LAWS[name].cells is None}
INTEGRALS = [(step, integral) for step, name in STEPS.items() for integral in ROWS[name].integrals]


def terms(state) -> dict[str, float]:
    """The shares of the last output that a law's state tells."""
    own = {name: getattr(state, name) for name in ("learned", "looked_up") if hasattr(state, name)}
    if hasattr(state, "terms"):
        own |= {name: getattr(state.terms, name) for name in dir(state.terms)}
    return own


class Law:
    """A law at 10 rad/s, with an error that repeats each revolution, on a base."""

    def __init__(self, library: ControlLibrary, name: str, **changes: Any):
        self.library, self.name = library, name
        base = "cgl_pi" if name == "speed_pi" else f"cgl_{name}"
        self.config = library.new(f"{base}_config", **LAWS[name] | changes)
        self.state = library.new(base)
        self.cell, pointer = library.array(np.zeros(200))
        self.rows = self.cell[
            : ROWS[STEPS[name]].own_entries
        ]  # behind a map is a ring of the cells last passed
        self.memory = () if name in WITHOUT_MEMORY else (pointer, needed(name, LAWS[name] | changes))
        self.init = getattr(library.lib, f"{base}_init")
        assert self.init(self.state, self.config, library.loop(TS), *self.memory) == library.lib.CGL_OK
        self.input, self.out = library.new("cgl_law_input", omega_ref=10.0), library.new("cgl_law_output")
        self.c_step = getattr(library.lib, f"cgl_{name}_step")
        self.n = 0

    def step(self, off: bool = False, base: float = 0.3) -> tuple[float, int]:
        theta = 10 * TS * self.n % (2 * math.pi)
        self.n += 1
        omega_m = 10.0 - base - 0.5 * math.sin(theta)
        of_law = self.input
        of_law.omega_m, of_law.theta_m, of_law.theta_ref = omega_m, theta, theta
        of_law.learn, of_law.off = True, off
        self.c_step(self.state, of_law, self.out)
        return self.out.i_q_ref, self.out.status


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("name", LAWS)
def test_off_gives_nothing_and_keeps_what_is_learned(precision, name):
    library = control_library(precision)
    law = Law(library, name)
    if name == "anti_cogging":
        law.cell[:64] = np.sin(np.arange(64))
    for _ in range(1500):
        before = law.step()[0]
    assert before != 0 and all(terms(law.state).get(name, 1.0) for name in ("learned", "looked_up", "alpha"))
    law.step(off=True)
    assert not any(terms(law.state).values())
    learned = law.rows.copy()
    assert learned.any() == (name not in WITHOUT_MEMORY)
    for _ in range(700):
        assert law.step(off=True) == (0.0, library.lib.CGL_STATUS_OFF | library.lib.CGL_STATUS_FROZEN)
    assert np.array_equal(law.rows, learned)
    status = law.step(base=0.0)[1]
    assert not status & library.lib.CGL_STATUS_OFF


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize(("name", "integral"), INTEGRALS)
def test_integrals_start_anew(precision, name, integral):
    law, value = Law(control_library(precision), name), attrgetter(integral)
    for _ in range(100):
        law.step()
    wound_up = value(law.state)
    assert wound_up != 0
    law.step(off=True)
    assert value(law.state) == 0
    law.step()
    assert 0 < abs(value(law.state)) < 0.1 * abs(wound_up)


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("name", LAWS)
def test_a_reset_law_does_as_a_new_one(precision, name):
    library = control_library(precision)
    law, new = Law(library, name), Law(library, name)
    worn = [law.step(base=0.6) for _ in range(1000)]
    if name == "speed_pi":
        library.lib.cgl_pi_reset(law.state)
    else:
        getattr(library.lib, f"cgl_{name}_reset")(law.state)
    law.n = 0
    again = [law.step() for _ in range(1000)]
    assert again == [new.step() for _ in range(1000)] != worn
    assert np.array_equal(law.cell, new.cell) and terms(law.state) == terms(new.state)


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("name", LAWS)
def test_a_law_in_memory_that_another_has_used_does_as_a_new_one(precision, name):
    library = control_library(precision)
    law, new = Law(library, name), Law(library, name)
    for _ in range(300):
        law.step(base=0.6)
    assert law.init(law.state, law.config, library.loop(TS), *law.memory) == library.lib.CGL_OK
    law.n = 0
    assert [law.step() for _ in range(300)] == [new.step() for _ in range(300)]
    assert np.array_equal(law.rows, new.rows) and terms(law.state) == terms(new.state)


def test_a_calibration_begins_anew_after_it():
    library = control_library("double")
    law = Law(library, "anti_cogging")
    library.lib.cgl_anti_cogging_calibrate(law.state)
    for _ in range(400):
        law.step()
    assert law.cell[:64].any() or law.state.cell > 0
    busy = library.lib.CGL_STATUS_BUSY | library.lib.CGL_STATUS_OFF | library.lib.CGL_STATUS_FROZEN
    assert law.step(off=True) == (0.0, busy)
    assert not law.cell.any()
    assert law.state.stage == library.lib.CGL_ANTI_COGGING_FORWARD and not law.state.started
    assert law.step()[1] & library.lib.CGL_STATUS_BUSY


TRIAL = {"samples": 50, "states": 2, "k_1": [-5.0, -0.5], "k_2": 0.1, "n": 5.0, "c": [1.0, 0.0],
         "through_integrator": True, "k_3": 0.5, "shift": 1, "limit": 1000.0, "learned_limit": 1.0,
         "unguarded": True,
         "feedforward": {"denominator": 1}}  # fmt: skip


class Trial:
    def __init__(self, library: ControlLibrary, start: float = 0.0):
        self.library = library
        self.config, self.state = library.new("cgl_trial_config", **TRIAL), library.new("cgl_trial")
        self.memory, pointer = library.array(np.zeros(160))
        assert library.lib.cgl_trial_init(self.state, self.config, pointer, 160) == library.lib.CGL_OK
        self.y_ref, pointer = library.array(start + np.linspace(0, 9, 50))
        self.out = library.new("cgl_law_output")
        library.lib.cgl_trial_begin(self.state, pointer)

    def step(self, theta: float, omega: float = 0.0, **fields: Any) -> tuple[float, int]:
        inputs = self.library.new(
            "cgl_law_input", **({"theta_m": theta, "omega_m": omega, "learn": True} | fields)
        )
        self.library.lib.cgl_trial_drive_step(self.state, inputs, self.out)
        return self.out.i_q_ref, self.out.status


@pytest.mark.parametrize("start", [0.0, 100.0, -37.0])
def test_a_drive_of_trials_unwraps_its_angle(start):
    """The same as the general step with the angle as it is, from whichever turn the trial starts."""
    library = control_library("double")
    drive, plain = Trial(library, start), Trial(library, start)
    out = library.new("cgl_trial_output")
    for p in range(60):
        theta = start + 0.2 * p
        got = drive.step(theta % (2 * math.pi), 3.0)
        inputs = library.new("cgl_trial_input", x=[theta, 3.0], learn=True)
        library.lib.cgl_trial_step(plain.state, inputs, out)
        assert got[0] == pytest.approx(out.u, abs=1e-10) and got[1] == out.status
    assert library.lib.cgl_trial_end(drive.state)
    library.lib.cgl_trial_end(plain.state)
    assert drive.memory[:50] == pytest.approx(plain.memory[:50], abs=1e-12)
    assert drive.memory[:50].any()


@pytest.mark.parametrize("precision", ["float", "double"])
def test_without_a_trial_there_is_no_output(precision):
    library = control_library(precision)
    trial, frozen = Trial(library), library.lib.CGL_STATUS_FROZEN
    assert trial.step(0.1)[0] != 0
    library.lib.cgl_trial_reset(trial.state)
    assert trial.step(0.1) == (0.0, frozen)
    assert trial.step(0.1, off=True) == (0.0, frozen | library.lib.CGL_STATUS_OFF)


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize(
    "bad", [{"theta_m": math.nan}, {"theta_m": 1e6}, {"omega_m": math.inf}, {"off": True}, {"learn": False}]
)
def test_nothing_is_learned_from_a_trial_with_a_bad_sample(precision, bad):
    library = control_library(precision)
    trial = Trial(library)
    for _ in range(10):
        trial.step(0.1)
    psi = trial.state.psi
    u, status = trial.step(0.1, **bad)
    if "off" in bad:
        assert (u, trial.state.psi) == (0.0, 0.0)
        assert status == library.lib.CGL_STATUS_OFF | library.lib.CGL_STATUS_FROZEN
    elif "learn" not in bad:
        assert (u, trial.state.psi) == (0.0, psi)
        assert status == library.lib.CGL_STATUS_FAULT | library.lib.CGL_STATUS_FROZEN
    for _ in range(40):
        assert trial.step(0.1)[1] & library.lib.CGL_STATUS_FROZEN
    assert not library.lib.cgl_trial_end(trial.state)
    assert not trial.memory[:50].any()


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize(("step", "learns"), [(0, True), (1, True), (2, False), (5, False)])
def test_the_guard_takes_the_sign_from_robust_ilc_from_step_2_on(precision, step, learns):
    """With beta_1 alone, nothing is left to learn (docs/laws/guard.md)."""
    law = Law(control_library(precision), "robust_ilc", beta_1=2.0, beta_2=0.0)
    law.input.gentle = step
    for _ in range(1500):
        law.step()
    assert bool(np.any(law.rows)) is learns
