"""Calibration before the first run: current offsets, the rotor's zero angle in the simulated drive."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from control_library import control_library

from cogless import _simulator_f32, load
from cogless.run.drive_config import engine_config
from cogless.study import Study

OFFSETS: dict[str, Any] = {"samples": 500, "phases": 3, "largest": 0.2, "spread": 0.1}


def offsets_of(samples: np.ndarray, **changes: Any):
    """The results step by step, and the state."""
    library = control_library("float")
    state = library.new("cgl_offsets")
    config = library.new("cgl_offsets_config", **{**OFFSETS, **changes})
    assert library.lib.cgl_offsets_init(state, config) == library.lib.CGL_OK
    found = []
    for row in samples:
        _kept, pointer = library.array(row)
        found.append(library.lib.cgl_offsets_step(state, pointer))
    return found, state


def test_offsets_are_the_means() -> None:
    rng = np.random.default_rng(0)
    samples = np.array([0.1, -0.15, 0.02]) + rng.normal(0, 0.01, (600, 3))
    found, state = offsets_of(samples)
    assert found == [0] * 499 + [1] * 101
    np.testing.assert_allclose(list(state.mean), samples[:500].mean(axis=0), atol=1e-6)


@pytest.mark.parametrize(("phase", "value"), [(0, 0.5), (1, -0.5), (2, math.nan), (0, math.inf), (1, 3e38)])
def test_an_offset_is_refused_where_a_sample_stands_out(phase: int, value: float) -> None:
    samples = np.zeros((600, 3))
    samples[300, phase] = value
    found, state = offsets_of(samples)
    assert found == [0] * 300 + [2] * 300
    assert all(map(math.isfinite, state.mean))


def test_an_offset_is_refused_where_it_is_too_large() -> None:
    samples = np.zeros((500, 3))
    samples[:, 1] = -0.21
    assert offsets_of(samples)[0][-1] == 2
    assert offsets_of(samples, largest=0.22)[0][-1] == 1
    samples[:, 2] = math.nan
    assert offsets_of(samples[:, [0, 0, 2]], phases=2)[0][-1] == 1  # the third is not measured


ALIGN: dict[str, Any] = {
    "pole_pairs": 12,
    "current": 3.0,
    "ramp": 0.05,
    "sweep": math.pi / 2,
    "speed": 20.0,
    "settle": 0.2,
    "tolerance": 0.25,
}


class Aligner:
    """In place of the drive's controller: the alignment, and the current loop in the frame that it wants."""

    def __init__(self, description: dict[str, Any], seen: Callable[[float], float], **changes: Any) -> None:
        self.library, self.seen = control_library("float"), seen
        new, lib, self.ffi = self.library.new, self.library.lib, self.library.ffi
        drive = new("cgl_drive_config")
        self.ffi.memmove(drive, description["drive"]["control"], self.ffi.sizeof("cgl_drive_config"))
        self.foc, self.align, self.wanted = new("cgl_foc"), new("cgl_align"), new("cgl_align_output")
        ts = 1 / description["drive"]["current_rate"]
        assert lib.cgl_foc_init(self.foc, self.ffi.addressof(drive, "foc"), ts) == lib.CGL_OK
        config = new("cgl_align_config", **{**ALIGN, **changes})
        assert lib.cgl_align_init(self.align, config, ts) == lib.CGL_OK
        self.now, self.out = new("cgl_measurement"), new("cgl_drive_output")
        self.input, self.duties = new("cgl_foc_input"), new("cgl_foc_output")
        self.largest = 0.0

    def step(self, measurement: bytes, _reference: bytes) -> bytes:
        lib, ffi, now, into, wanted = self.library.lib, self.ffi, self.now, self.input, self.wanted
        ffi.memmove(now, measurement, len(measurement))
        self.result = lib.cgl_align_step(self.align, self.seen(now.theta_m), wanted)
        self.largest = max(self.largest, wanted.i_d_ref)
        into.i_abc, into.u_dc = now.i_abc, now.u_dc
        into.theta_e, into.omega_e, into.i_d_ref = wanted.theta_e, wanted.omega_e, wanted.i_d_ref
        lib.cgl_foc_step(self.foc, into, self.duties)
        self.out.duty = self.duties.duty
        return bytes(ffi.buffer(self.out))


def aligned(seen: Callable[[float], float], start: str = "100 deg", **changes: Any) -> tuple[Aligner, Study]:
    scenario = "scenario.1-rev-s."
    study = load(
        "uomodri",
        {
            "metric": [],
            scenario + "reference": "0 rpm",
            scenario + "initial_speed": "0 rpm",
            scenario + "initial_angle": start,
            **changes,
        },
    )
    description = engine_config(study, "1-rev-s", "pi")
    drive, controller = _simulator_f32.Drive(description, None), Aligner(description, seen)
    drive.advance(drive.start(), _simulator_f32.Recorder(drive, 1000), 26_000, controller)
    return controller, study


@pytest.mark.parametrize("cogs", [True, False])
def test_the_zero_angle_is_found_in_the_simulated_drive(cogs: bool) -> None:
    """A motor with friction, whose encoder stands 1 rad off: to what friction and cogging hold."""
    found, study = aligned(
        lambda theta: (theta + 1.0) % (2 * math.pi), **({} if cogs else {"motor.cogging": []})
    )
    assert found.result == 1
    pitch = 2 * math.pi / 12
    off = (found.align.zero - 1.0 + pitch / 2) % pitch - pitch / 2
    motor = study.motor.star()
    stiffness = 12 * motor.K_t * ALIGN["current"]  # N m/rad
    cogging = sum(harmonic.torque for harmonic in motor.cogging)
    friction = study.mechanics.coulomb_friction / stiffness  # it can stand so far off, to either side
    assert abs(off) < 1.1 * (cogging + study.mechanics.coulomb_friction) / stiffness
    assert cogs or abs(found.align.apart) < 1.1 * friction
    assert found.largest == pytest.approx(3.0)
    assert found.wanted.i_d_ref == 0.0


@pytest.mark.parametrize(
    "seen",
    [lambda _: 0.3, lambda theta: -theta, lambda theta: 2 * theta, lambda _: math.nan],
    ids=["stuck", "backward", "other gear", "missing"],
)
def test_a_rotor_that_does_not_follow_is_refused(seen: Callable[[float], float]) -> None:
    found, _study = aligned(seen)
    assert found.result == 2
    assert found.wanted.i_d_ref == 0.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"pole_pairs": 0},
        {"pole_pairs": 10_001},
        {"current": 0.0},
        {"ramp": math.inf},
        {"ramp": 1e6},
        {"sweep": 3.2},
        {"speed": 0.0},
        {"speed": 1e-9},
        {"settle": math.nan},
        {"tolerance": 1.0},
    ],
)
def test_init_refuses(wrong: dict[str, Any]) -> None:
    library = control_library("float")
    config = library.new("cgl_align_config", **{**ALIGN, **wrong})
    assert library.lib.cgl_align_init(library.new("cgl_align"), config, 1e-4) == library.lib.CGL_ERROR_CONFIG
