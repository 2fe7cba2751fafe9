"""The PI controller and PI speed control of the C library."""

import math

import numpy as np
import pytest
from control_library import control_library
from reference.motion import rounded
from reference.pi import Pi

STEPS = 4000


class CPi:
    """The C controller with the face of the reference."""

    def __init__(self, library, reference: Pi):
        self.library = library
        self.config = library.new("cgl_pi_config", kp=reference.kp, ki=reference.ki, limit=reference.limit)
        self.state = library.new("cgl_pi")
        assert (
            library.lib.cgl_pi_init(self.state, self.config, library.loop(reference.ts)) == library.lib.CGL_OK
        )

    def step(self, error: float, feedforward: float = 0.0) -> float:
        return self.library.lib.cgl_pi_step(self.state, error, feedforward)


def random_pi(rng, real) -> Pi:
    kp, ki, ts, limit = rounded(
        [rng.uniform(0.2, 1), 10 ** rng.uniform(-1, 2), 1e-3, rng.uniform(1, 5)], real
    )
    return Pi(kp, ki, ts, limit)


@pytest.mark.parametrize("seed", range(6))
def test_double_equals_the_reference(seed):
    rng = np.random.default_rng(seed)
    library = control_library("double")
    reference = random_pi(rng, np.float64)
    law = CPi(library, reference)
    error = rng.normal(0, 5, STEPS) + 8 * np.sin(np.arange(STEPS) / rng.uniform(10, 300))
    feedforward = rng.normal(0, 1, STEPS)
    error[rng.random(STEPS) < 0.005] = np.nan
    feedforward[rng.random(STEPS) < 0.005] = np.inf
    saturated = 0
    for e, ff in zip(error, feedforward, strict=True):
        assert abs(law.step(e, ff) - reference.step(e, ff)) <= 1e-12 * reference.limit
        assert bool(law.state.saturated) == reference.saturated
        saturated += reference.saturated
    assert 0 < saturated < STEPS


@pytest.mark.parametrize("seed", range(6))
def test_single_stays_within_rounding(seed):
    """What a sum loses is made up for, so only increments are rounded, by eps of one at random: after n steps
    eps increment sqrt(n). The gain ki ts is rounded once for good: eps of the integral. Where the output is
    so close to its limit that rounding decides whether the integral holds, the C's integral is taken over
    and the walk starts anew."""
    rng = np.random.default_rng(100 + seed)
    library = control_library("float")
    reference = random_pi(rng, np.float32)
    law = CPi(library, reference)
    error = rounded(rng.normal(0, 5, STEPS) + 8 * np.sin(np.arange(STEPS) / rng.uniform(10, 300)), np.float32)
    increment = reference.ki * reference.ts * np.max(np.abs(error))
    undecided = 0
    since = 0
    for e in error:
        since += 1
        scale = reference.limit + abs(reference.kp * e)
        bound = library.eps * (4 * scale + 2 * increment * math.sqrt(since))
        got, expected = law.step(e), reference.step(e)
        assert abs(got - expected) <= bound
        if bool(law.state.saturated) != reference.saturated:
            assert abs(abs(expected) - reference.limit) <= bound
            reference.integral, since = law.state.integral, 0
            undecided += 1
        assert abs(law.state.integral - reference.integral) <= bound
    assert undecided <= 3


@pytest.mark.parametrize("precision", ["float", "double"])
def test_recovers_from_saturation_at_once(precision):
    """A second at the limit winds nothing up: the output leaves the limit at the step where the error
    turns."""
    library = control_library(precision)
    law = CPi(library, Pi(kp=0.5, ki=50.0, ts=1e-3, limit=2.0))
    for _ in range(1000):
        assert law.step(10.0) == 2.0
    assert abs(law.state.integral) <= 2.0
    assert law.step(-1.0) < 2.0
    assert law.step(-1.0) < law.state.integral


@pytest.mark.parametrize("precision", ["float", "double"])
def test_the_integral_alone_never_exceeds_the_limit(precision):
    """A feedforward that pulls the other way must not let it grow beyond what the output could use."""
    law = CPi(control_library(precision), Pi(kp=0.5, ki=50.0, ts=1e-3, limit=2.0))
    for _ in range(1000):
        law.step(1.0, -3.0)
    assert law.state.integral == 2.0


@pytest.mark.parametrize("precision", ["float", "double"])
def test_reset_forgets(precision):
    library = control_library(precision)
    law = CPi(library, Pi(kp=0.5, ki=50.0, ts=1e-3, limit=2.0))
    first = law.step(1.0)
    assert law.step(1.0) > first
    library.lib.cgl_pi_reset(law.state)
    assert law.step(1.0) == first


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize(
    "omega_ref, omega_m, status", [(1.0, 0.0, 0), (0.0, 9.0, 1), (math.nan, 0.0, 2), (0.0, math.inf, 2)]
)
def test_speed_pi_is_the_pi_of_the_speed_error(precision, omega_ref, omega_m, status):
    library = control_library(precision)
    law = CPi(library, Pi(kp=0.5, ki=50.0, ts=1e-3, limit=2.0))
    out = library.new("cgl_law_output")
    inputs = library.new("cgl_law_input", omega_ref=omega_ref, omega_m=omega_m)
    library.lib.cgl_speed_pi_step(law.state, inputs, out)
    assert out.status == status | library.lib.CGL_STATUS_FROZEN  # nothing is learned
    assert out.i_q_ref == CPi(library, Pi(kp=0.5, ki=50.0, ts=1e-3, limit=2.0)).step(omega_ref - omega_m)


def retune(law: CPi, **gains: float) -> int:
    config = {"kp": law.config.kp, "ki": law.config.ki, "limit": law.config.limit} | gains
    return law.library.lib.cgl_pi_retune(law.state, law.library.new("cgl_pi_config", **config))


def test_small_terms_add_up_beside_a_large_integral():
    """ki ts e is less than half of what a float tells apart at 5."""
    library, steps = control_library("float"), 200_000
    law = CPi(library, Pi(kp=0.0, ki=1.0, ts=50e-6, limit=20.0))
    law.state.integral = 5.0
    assert library.real(5.0) + library.real(50e-6 * 0.004) == 5.0
    for _ in range(steps):
        law.step(0.004)
    assert law.state.integral - 5.0 == pytest.approx(steps * 50e-6 * 0.004, rel=0.01)


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("kp", [0.0, 0.1, 0.5, 2.0])
def test_another_proportional_gain_does_not_move_the_output(precision, kp):
    library = control_library(precision)
    law = CPi(library, Pi(kp=0.5, ki=0.0, ts=1e-3, limit=2.0))
    law.state.integral = 0.3
    before = law.step(0.25)
    assert retune(law, kp=kp) == library.lib.CGL_OK
    assert law.state.proportional == pytest.approx(kp * 0.25, rel=4 * library.eps)
    assert law.step(0.25) == pytest.approx(before, abs=4 * library.eps)


@pytest.mark.parametrize("precision", ["float", "double"])
def test_another_integral_gain_keeps_the_integral(precision):
    library = control_library(precision)
    law = CPi(library, Pi(kp=0.5, ki=50.0, ts=1e-3, limit=2.0))
    for _ in range(10):
        law.step(0.2)
    integral = law.state.integral
    assert retune(law, ki=5.0) == library.lib.CGL_OK
    assert law.state.integral == integral
    law.step(0.2)
    assert law.state.integral - integral == pytest.approx(5.0 * 1e-3 * 0.2, rel=1e-3)
    assert retune(law, limit=0.05) == library.lib.CGL_OK
    assert law.state.integral == library.real(0.05)
