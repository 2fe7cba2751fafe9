"""Active disturbance rejection of the C library."""

import math

import numpy as np
import pytest
from control_library import control_library
from reference.adrc import Adrc
from reference.motion import rounded


class CAdrc:
    """The C controller with the face of the reference."""

    def __init__(self, library, reference: Adrc):
        self.library = library
        gains = {name: getattr(reference, name) for name in ("b", "omega_c", "omega_o", "limit")}
        self.state = library.new("cgl_adrc")
        config = library.new("cgl_adrc_config", **gains)
        assert library.lib.cgl_adrc_init(self.state, config, library.loop(reference.ts)) == library.lib.CGL_OK
        self.out = library.new("cgl_law_output")

    def step(self, omega_ref: float, omega_m: float, **more: object) -> float:
        inputs = self.library.new("cgl_law_input", omega_ref=omega_ref, omega_m=omega_m, **more)
        self.library.lib.cgl_adrc_step(self.state, inputs, self.out)
        return float(self.out.i_q_ref)


def random_adrc(rng, real) -> Adrc:
    omega_c = rng.uniform(5, 120)
    numbers = [10 ** rng.uniform(0, 4), omega_c, omega_c * rng.uniform(2, 10), 1e-3, rng.uniform(1, 5)]
    return Adrc(*rounded(numbers, real))


def inputs(rng, steps: int) -> tuple[np.ndarray, np.ndarray]:
    omega_ref = np.repeat(rng.uniform(-20, 20, 8), steps // 8)
    omega_m = omega_ref + rng.normal(0, 0.5, len(omega_ref)) + 3 * np.sin(np.arange(len(omega_ref)) / 30)
    for signal in (omega_ref, omega_m):
        signal[rng.random(len(signal)) < 0.005] = np.nan
    return omega_ref, omega_m


@pytest.mark.parametrize("seed", range(6))
def test_double_equals_the_reference(seed):
    rng = np.random.default_rng(seed)
    reference = random_adrc(rng, np.float64)
    law = CAdrc(control_library("double"), reference)
    for omega_ref, omega_m in zip(*inputs(rng, 4000), strict=True):
        assert (
            abs(law.step(omega_ref, omega_m) - reference.step(omega_ref, omega_m)) <= 1e-11 * reference.limit
        )


@pytest.mark.parametrize("seed", range(6))
def test_single_stays_within_rounding(seed):
    """The observer forgets its rounding: in 1 / omega_o of time, as the poles say."""
    rng = np.random.default_rng(seed)
    library = control_library("float")
    reference = random_adrc(rng, np.float32)
    law = CAdrc(library, reference)
    gain = (reference.omega_c + reference.omega_o) / reference.b  # from a speed to the output
    memory = 40 / (1 - math.exp(-reference.omega_o * reference.ts))
    for omega_ref, omega_m in zip(*(rounded(x, np.float32) for x in inputs(rng, 4000)), strict=True):
        expected = reference.step(omega_ref, omega_m)
        found = law.step(omega_ref, omega_m)
        assert abs(found - expected) <= memory * library.eps * (25 * gain + reference.limit)


def test_a_load_is_found_and_taken_away():
    """On a rotor without friction the estimate becomes the load's acceleration, and the speed its
    reference.
    """
    law = CAdrc(control_library("double"), Adrc(100.0, 40.0, 160.0, 1e-3, 10.0))
    omega = 10.0
    for n in range(2000):
        current = law.step(10.0, omega)
        omega += 1e-3 * (100.0 * current - (300.0 if n > 500 else 0.0))
    assert law.state.f == pytest.approx(-300.0, rel=1e-3)
    assert omega == pytest.approx(10.0, abs=1e-3)
    assert current == pytest.approx(3.0, rel=1e-3)


def test_nothing_winds_up_at_the_limit():
    """A stuck rotor, then a free one: the estimate never asks for more than the current can give."""
    law = CAdrc(control_library("double"), Adrc(100.0, 40.0, 160.0, 1e-3, 2.0))
    for _ in range(3000):
        assert law.step(10.0, 0.0) == 2.0
    omega, peak = 0.0, 0.0
    for _ in range(2000):
        omega += 1e-3 * 100.0 * law.step(10.0, omega)
        peak = max(peak, omega)
    assert peak < 12.5 and omega == pytest.approx(10.0, abs=0.01)


@pytest.mark.parametrize("precision", ["float", "double"])
def test_a_missing_speed_is_bridged_by_the_model_and_told(precision):
    library = control_library(precision)
    law = CAdrc(library, Adrc(100.0, 40.0, 160.0, 1e-3, 10.0))
    for _ in range(100):
        law.step(10.0, 10.0)
    assert law.step(10.0, math.nan) == pytest.approx(0.0, abs=1e-4)
    assert law.out.status == library.lib.CGL_STATUS_FROZEN | library.lib.CGL_STATUS_FAULT
    assert law.step(math.inf, 10.0) == pytest.approx(0.0, abs=1e-4)
    assert law.out.status & library.lib.CGL_STATUS_FAULT
