"""Dead-time compensation of the C library."""

import dataclasses
import math

import numpy as np
import pytest
from control_library import control_library
from reference.dead_time import DeadTime
from reference.motion import rounded

NAN, INF = math.nan, math.inf
USUAL = DeadTime(time=1e-6, drop=0.5, band=0.05, lag=1.6e-4, advance=1.5, phases=3, ts=5e-5)


class CDeadTime:
    def __init__(self, library, reference: DeadTime):
        self.library, self.lib = library, library.lib
        fields = dataclasses.asdict(reference)
        ts = fields.pop("ts")
        fields.pop("current")
        self.config = library.new("cgl_dead_time_config", **fields)
        self.state = library.new("cgl_dead_time")
        self.error = self.lib.cgl_dead_time_init(self.state, self.config, ts)
        self.input = library.new("cgl_foc_input")
        self.duty, self.pointer = library.array(np.zeros(3))

    def step(self, theta_e, omega_e, u_dc, i_ref: complex, duty) -> np.ndarray:
        into = self.input
        into.theta_e, into.omega_e, into.u_dc = theta_e, omega_e, u_dc
        into.i_d_ref, into.i_q_ref = i_ref.real, i_ref.imag
        self.duty[:] = duty
        self.lib.cgl_dead_time_step(self.state, into, self.pointer)
        return self.duty.copy()


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("phases", [3, 2])
def test_equals_the_reference(precision: str, phases: int) -> None:
    rng, library = np.random.default_rng(phases), control_library(precision)
    drawn = rounded(rng.uniform([0, 0, 0.02, 0, 0], [2e-5, 2, 1, 1e-3, 2]), library.real)
    reference = DeadTime(*drawn, phases, *rounded([5e-5], library.real))
    law = CDeadTime(library, reference)
    assert law.error == library.lib.CGL_OK
    theta, i_ref = 0.0, 0j
    for n in range(1000):
        if n % 40 == 0:
            omega, i_ref = rng.uniform(-600, 600), complex(*rng.normal(0, 0.5, 2))
        theta = (theta + omega * 5e-5) % (2 * math.pi)
        duty = rounded(np.where(rng.random(3) < 0.1, rng.integers(0, 2, 3), rng.random(3)), library.real)
        inputs = (
            *rounded([theta, omega, 24.0], library.real),
            complex(*rounded([i_ref.real, i_ref.imag], library.real)),
        )
        expected = reference.step(*inputs, np.array(duty))
        bound = (200 + n / 10) * library.eps / reference.band
        assert np.abs(law.step(*inputs, duty) - expected).max() <= bound


@pytest.mark.parametrize("phases", [3, 2])
def test_gives_back_what_the_inverter_takes(phases: int) -> None:
    """Beyond the band, and settled, the legs' mean voltages are those asked for: the loss's closed form."""
    library = control_library("double")
    law = CDeadTime(library, dataclasses.replace(USUAL, phases=phases))
    theta, u_dc, i_ref = 0.7, 24.0, 0.3 + 2.0j
    asked = np.array([0.4, 0.55, 0.61])
    for _ in range(300):
        duty = law.step(theta, 0.0, u_dc, i_ref, asked)
    vector = i_ref * np.exp(1j * theta)
    i = (
        np.real(vector * np.exp(-2j * np.pi / 3 * np.arange(3)))
        if phases == 3
        else np.array([vector.real, vector.imag])
    )
    assert np.abs(i).min() > USUAL.band
    legs = len(i)
    realised = duty[:legs] - np.sign(i) * (USUAL.time / USUAL.ts + USUAL.drop / u_dc)
    np.testing.assert_allclose(realised, asked[:legs], atol=1e-12)


def test_within_the_band_the_correction_is_linear_and_odd() -> None:
    law = CDeadTime(control_library("double"), dataclasses.replace(USUAL, lag=0.0, advance=0.0))
    full = USUAL.time / USUAL.ts + USUAL.drop / 24.0
    for part in (-1.0, -0.5, 0.0, 0.25, 1.0, 3.0):
        duty = law.step(0.0, 0.0, 24.0, complex(part * USUAL.band, 0.0), [0.5, 0.5, 0.5])
        assert duty[0] - 0.5 == pytest.approx(full * np.clip(part, -1, 1), abs=1e-12)


@pytest.mark.parametrize("place", range(5))
@pytest.mark.parametrize("value", [NAN, INF, -INF, 1e38])
def test_what_is_not_plausible_changes_nothing_for_long(place: int, value: float) -> None:
    """The duty cycles stay in [0, 1], and afterwards the correction is what it was."""
    law = CDeadTime(control_library("float"), USUAL)
    usual = [0.3, 100.0, 24.0, 0.1, 1.0]
    for n in range(400):
        wrong = [value if p == place and n == 100 else x for p, x in enumerate(usual)]
        duty = law.step(*wrong[:3], complex(wrong[3], wrong[4]), [0.2, 0.5, 0.9])
        assert np.all((duty >= 0) & (duty <= 1))
        if n == 99:
            before = duty
        if n == 100 and not math.isfinite(value):
            np.testing.assert_array_equal(duty, np.float32([0.2, 0.5, 0.9]))
    if not (math.isfinite(value) and place > 2):  # a huge current takes the lag's time to be forgotten
        np.testing.assert_allclose(duty, before, atol=1e-6)


@pytest.mark.parametrize(
    "wrong",
    [
        {"time": -1e-9},
        {"time": 2.6e-5},
        {"time": NAN},
        {"drop": -1.0},
        {"drop": INF},
        {"band": 0.0},
        {"band": 1e-39},
        {"lag": -1.0},
        {"lag": NAN},
        {"advance": -1.0},
        {"phases": 1},
        {"phases": 4},
        {"ts": 0.0},
        {"ts": NAN},
    ],
)
def test_init_refuses(wrong: dict[str, float]) -> None:
    library = control_library("float")
    assert CDeadTime(library, dataclasses.replace(USUAL, **wrong)).error == library.lib.CGL_ERROR_CONFIG


def test_retune_keeps_the_state_and_refuses_like_init() -> None:
    library = control_library("double")
    law = CDeadTime(library, USUAL)
    law.step(0.0, 0.0, 24.0, 1j, [0.5, 0.5, 0.5])
    before = law.state.i_q
    better, wrong = (
        library.new("cgl_dead_time_config", time=2e-6, band=band, phases=3) for band in (0.05, 0.0)
    )
    assert law.lib.cgl_dead_time_retune(law.state, wrong) == library.lib.CGL_ERROR_CONFIG
    assert law.state.config.time == law.config.time
    assert law.lib.cgl_dead_time_retune(law.state, better) == library.lib.CGL_OK
    assert law.state.i_q == before != 0.0
    assert law.state.share == 2e-6 / USUAL.ts
