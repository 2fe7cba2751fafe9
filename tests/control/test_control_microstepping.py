"""Microstepping of the C library, against a transcription and closed forms."""

import dataclasses
import math

import numpy as np
import pytest
from control_library import ControlLibrary, control_library
from reference.microstepping import Microstepping

NAN, INF = math.nan, math.inf
FORWARD = [(1, 0.011, 0.6), (2, 0.012, 2.9), (4, 0.025, -0.3)]
BACKWARD = [(1, 0.02, -1.6), (4, 0.025, 0.3)]
USUAL = Microstepping(teeth=50, current=1.13, microsteps=256, forward=FORWARD, backward=BACKWARD)


class CMicrostepping:
    def __init__(self, library: ControlLibrary, reference: Microstepping):
        self.lib = library.lib
        self.config = library.new(
            "cgl_microstepping_config",
            teeth=reference.teeth,
            current=reference.current,
            microsteps=reference.microsteps,
        )
        for direction in ("forward", "backward"):
            for place, wave in enumerate(getattr(reference, direction)):
                member = getattr(self.config, direction)[place]
                member.order, member.magnitude, member.phase = wave
        self.state, self.out = library.new("cgl_microstepping"), library.new("cgl_microstepping_output")
        self.error = self.lib.cgl_microstepping_init(self.state, self.config)

    def step(self, theta_ref: float, omega_ref: float = 1.0) -> np.ndarray:
        self.lib.cgl_microstepping_step(self.state, theta_ref, omega_ref, self.out)
        return np.array([self.out.i_a, self.out.i_b])


@pytest.mark.parametrize(("precision", "bound"), [("double", 1e-7), ("float", 4e-5)])
@pytest.mark.parametrize("microsteps", [1, 16, 256, 1024])
def test_equals_the_reference(precision: str, bound: float, microsteps: int) -> None:
    """But where the command is so near to the middle between two microsteps that rounding decides."""
    reference = dataclasses.replace(USUAL, microsteps=microsteps)
    library = control_library(precision)
    motor, rng, alike = CMicrostepping(library, reference), np.random.default_rng(microsteps), 0
    for theta, omega in zip(rng.uniform(0, math.tau, 500), rng.integers(-1, 2, 500), strict=True):
        expected, currents = reference.step(float(library.real(theta)), omega), motor.step(theta, omega)
        into = reference.command / (math.tau / (4 * microsteps)) % 1
        if abs(into - 0.5) > 4 * microsteps * bound:
            np.testing.assert_allclose(currents, expected, atol=bound)
            alike += 1
    assert alike > 300


def test_a_full_step_is_a_quarter_of_a_tooth_and_waits_half_of_it() -> None:
    motor = CMicrostepping(
        control_library("double"), dataclasses.replace(USUAL, microsteps=1, forward=[], backward=[])
    )
    step = math.tau / 200
    for n, (a, b) in enumerate([(1, 0), (0, 1), (-1, 0), (0, -1), (1, 0)]):
        for theta in (n * step - 0.49 * step, n * step + 0.49 * step):
            np.testing.assert_allclose(motor.step(theta % math.tau), 1.13 * np.array([a, b]), atol=1e-12)


def test_what_is_not_plausible_holds_the_rotor() -> None:
    motor = CMicrostepping(control_library("float"), USUAL)
    before = motor.step(0.7, -2.0)
    for wrong in [(NAN, 1.0), (INF, 1.0), (1e9, 1.0), (0.3, NAN), (0.3, -INF)]:
        np.testing.assert_array_equal(motor.step(*wrong), before)
        assert motor.out.status == motor.lib.CGL_STATUS_FAULT
    np.testing.assert_array_equal(motor.step(0.7, 0.0), before)  # at rest the direction stays
    assert motor.out.status == 0
    motor.lib.cgl_microstepping_reset(motor.state)
    assert motor.state.command == 0 and not motor.state.backward


def test_a_state_of_zeros_gives_no_current() -> None:
    library = control_library("float")
    out = library.new("cgl_microstepping_output", i_a=NAN, i_b=NAN)
    library.lib.cgl_microstepping_step(library.new("cgl_microstepping"), 0.3, 1.0, out)
    assert out.i_a == out.i_b == 0.0
    assert out.status == library.lib.CGL_STATUS_FAULT | library.lib.CGL_STATUS_OFF


@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ({"teeth": 0}, "teeth"),
        ({"teeth": 70000}, "teeth"),
        ({"current": 0.0}, "current"),
        ({"current": NAN}, "current"),
        ({"microsteps": 3}, "microsteps"),
        ({"microsteps": 2048}, "microsteps"),
        ({"forward": [(1, -0.1, 0.0)]}, "forward"),
        ({"forward": [(2, 0.3, 0.0), (4, 0.1, 0.0)]}, "forward"),
        ({"forward": [(70000, 0.0, 0.0)]}, "forward"),
        ({"backward": [(1, NAN, 0.0)]}, "backward"),
        ({"backward": [(1, 0.1, INF)]}, "backward"),
    ],
)
def test_init_refuses(wrong: dict[str, float], field: str) -> None:
    library = control_library("float")
    motor = CMicrostepping(library, dataclasses.replace(USUAL, **wrong))
    assert motor.error == library.lib.CGL_ERROR_CONFIG
    name = library.ffi.string(library.lib.cgl_microstepping_bad_field(motor.config)).decode()
    assert name == f"microstepping.{field}"


def test_retune_keeps_the_state_and_refuses_like_init() -> None:
    motor = CMicrostepping(control_library("double"), dataclasses.replace(USUAL, microsteps=0))
    assert motor.error == motor.lib.CGL_OK and motor.state.microstep == 2**30 // 256
    motor.step(0.7, -2.0)
    motor.config.current = -1.0
    assert motor.lib.cgl_microstepping_retune(motor.state, motor.config) == motor.lib.CGL_ERROR_CONFIG
    assert motor.state.config.current == 1.13
    motor.config.current = 0.5
    assert motor.lib.cgl_microstepping_retune(motor.state, motor.config) == motor.lib.CGL_OK
    assert motor.state.backward and np.hypot(*motor.step(0.7, 0.0)) == pytest.approx(0.5)
