"""The drive's controller from outside: what it is made of, and another one in its place."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from control_library import control_library
from engine import PI_ILC, RIPPLE, config, described, drive_of, trial_config

from cogless import _simulator_f32, _simulator_f64
from cogless.c_layout import control_layout
from cogless.control_library import C_LAWS

CHANGE: dict[str, Any] = {
    "motor": RIPPLE,
    "load": {"torque": 0.1},
    "drive": {
        "current_sensors": {"noise": 0.01},
        "monitor": {"omega_max": 500.0, "stuck_angle": 0.5, "current_max": 40.0, "bridge": 5e-3},
        "quality": {"outlier": 8.0, "floor": 0.1},
    },
    "controller": PI_ILC,
}
MODULES = {"float": _simulator_f32, "double": _simulator_f64}


class Outside:
    """The control library, compiled apart, on the engine's measurements: what a microcontroller would do."""

    def __init__(self, description: dict[str, Any], memory_length: int, precision: str) -> None:
        self.library = control_library(precision)
        self.config = self._struct("cgl_drive_config", description["drive"]["control"])
        self.law_config = self._struct("cgl_pi_ilc_config", description["controller"]["config"])
        self.drive, self.law = self.library.new("cgl_drive"), self.library.new("cgl_pi_ilc")
        self.memory, pointer = self.library.array(np.zeros(memory_length))
        lib = self.library.lib
        assert (
            lib.cgl_drive_init(self.drive, self.config, 1 / description["drive"]["current_rate"])
            == lib.CGL_OK
        )
        loop = self.library.ffi.addressof(self.drive, "loop")
        init = lib.cgl_pi_ilc_init
        assert init(self.law, self.law_config, loop, pointer, len(self.memory)) == lib.CGL_OK

    def _struct(self, name: str, value: bytes) -> Any:
        ffi = self.library.ffi
        assert len(value) == ffi.sizeof(name)
        new = ffi.new(f"{name} *")
        ffi.memmove(new, value, len(value))
        return new

    def step(self, measurement: bytes, reference: bytes) -> bytes:
        ffi, lib = self.library.ffi, self.library.lib
        now = self._struct("cgl_measurement", measurement)
        asked, out = self._struct("cgl_reference", reference), ffi.new("cgl_drive_output *")
        if lib.cgl_drive_measure(self.drive, now, asked):
            law_input = ffi.addressof(self.drive[0], "in")
            command = ffi.addressof(self.drive[0], "command")
            lib.cgl_pi_ilc_step(self.law, law_input, command)
        lib.cgl_drive_actuate(self.drive, out)
        return bytes(ffi.buffer(out))


def rows(drive: Any, module: Any, ticks: int, controller: object = None) -> tuple[dict[str, Any], Any]:
    recorder, state = module.Recorder(drive, 1), drive.start()
    drive.advance(state, recorder, ticks, controller)
    table = recorder.take()
    return {name: table[:, n] for n, (name, _) in enumerate(drive.signals)}, state


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("ideal", [False, True])
def test_the_same_code_outside_gives_the_same_run_bit_for_bit(precision: str, ideal: bool) -> None:
    change = {**CHANGE, "drive": {**CHANGE["drive"], "ideal_current": ideal}}
    description = described(config(change), MODULES[precision])
    drive = MODULES[precision].Drive(description)
    outside = Outside(description, len(drive.law_memory(drive.start())), precision)
    own, state = rows(drive, MODULES[precision], 8000)
    other, unused = rows(drive, MODULES[precision], 8000, outside)
    for name in own:
        if not name.startswith("term_"):
            assert np.array_equal(own[name], other[name]), name
    learned = drive.law_memory(state)
    assert learned.dtype == (np.float32 if precision == "float" else np.float64)
    assert np.array_equal(learned, outside.memory)
    assert np.max(np.abs(learned)) > 0
    assert not drive.law_memory(unused).any()
    quality = drive.quality(state)
    assert quality["known"]
    assert (
        quality["residual"]
        == control_library(precision)
        .lib.cgl_quality_read(outside.library.ffi.addressof(outside.drive[0], "quality"))
        .residual
    )


def output(size: int = 40) -> bytes:
    duty = struct.pack("<3f6fI", 0.5, 0.5, 0.5, 0, 0, 0, 0, 0, 1.5, 4)
    return (duty + bytes(size))[:size]


class Idle:
    """No voltage."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def step(self, measurement: bytes, reference: bytes) -> bytes:
        self.heard.append(f"{len(measurement)} {len(reference)}")
        return output()

    def begin(self, trajectory: bytes) -> None:
        self.heard.append(f"begin {np.frombuffer(trajectory, np.float32).tolist()}")

    def end(self) -> None:
        self.heard.append("end")


def test_what_a_controller_says_is_recorded_and_done() -> None:
    drive = drive_of(_simulator_f32, config())
    got, _ = rows(drive, _simulator_f32, 500, Idle())
    assert (got["status"] == 4).all()
    assert (got["i_q_ref"] == 1.5).all()
    assert got["omega_m"][-1] < 9.9  # a shorted winding brakes


def test_trials_begin_and_end_outside_too() -> None:
    reference = [0.0, 0.5, 1.0]
    drive = drive_of(_simulator_f32, trial_config(2, [{"reference": reference}]))
    idle = Idle()
    rows(drive, _simulator_f32, 2 * 3 * 20, idle)
    trial = [f"begin {reference}", *["24 24"] * 60, "end"]
    assert idle.heard == trial * 2


@pytest.mark.parametrize(
    "answer, error, message",
    [
        (lambda: output(39), ValueError, "39 bytes: expected 40 bytes of a cgl_drive_output"),
        (lambda: output(44), ValueError, "44 bytes"),
        (lambda: None, ValueError, "NoneType: expected 40 bytes"),
        (lambda: 1 / 0, ZeroDivisionError, "division by zero"),
    ],
)
def test_a_controller_that_fails_ends_the_run(answer: Any, error: type[Exception], message: str) -> None:
    class Failing:
        calls = 0

        def step(self, measurement: bytes, reference: bytes) -> Any:
            self.calls += 1
            return output() if self.calls < 10 else answer()

    drive, state = drive_of(_simulator_f32, config()), None
    state = drive.start()
    with pytest.raises(error, match=message):
        drive.advance(state, _simulator_f32.Recorder(drive, 1), 100, Failing())
    assert state.tick == 9
    drive.advance(state, _simulator_f32.Recorder(drive, 1), 1)  # and can go on


def test_a_controller_without_step_is_refused() -> None:
    drive = drive_of(_simulator_f32, config())
    with pytest.raises(AttributeError, match="step"):
        drive.advance(drive.start(), _simulator_f32.Recorder(drive, 1), 1, 5)


def test_a_map_can_be_put_back() -> None:
    drive = drive_of(_simulator_f32, config(CHANGE))
    _, state = rows(drive, _simulator_f32, 8000)
    learned, fresh = drive.stored(state)["values"], drive.start()
    assert learned.any()
    drive.load_map(fresh, learned)
    put = drive.stored(fresh)["values"]
    np.testing.assert_allclose(put, learned - learned.mean(), atol=1e-7)  # the mean is the integral's
    drive.load_map(fresh, put)
    assert np.array_equal(drive.stored(fresh)["values"], put)
    with pytest.raises(ValueError, match=f"1 channels of {learned.shape[1]} entries"):
        drive.load_map(fresh, [[1.0, 2.0, 3.0]])
    plain = drive_of(_simulator_f32, config())
    assert len(plain.law_memory(plain.start())) == 0
    with pytest.raises(ValueError, match="this law has no map"):
        plain.load_map(plain.start(), [[1.0]])


@pytest.mark.parametrize(("section", "key"), [("drive", "control"), ("controller", "config")])
def test_a_configuration_of_another_size_is_refused(section: str, key: str) -> None:
    """That of the other precision, say."""
    single, double = (described(config(CHANGE), module) for module in MODULES.values())
    there, here = (one[section][key] for one in (double, single))
    with pytest.raises(ValueError, match=f"^{section}.{key}: {len(there)} bytes: expected {len(here)}$"):
        _simulator_f32.Drive({**single, section: {**single[section], key: there}})


@pytest.mark.parametrize("law", [name for name, law in C_LAWS.items() if law.cells])
@pytest.mark.parametrize("byte", [0, 127, 255])
def test_a_configuration_of_any_bytes_takes_no_memory_without_bound(law: str, byte: int) -> None:
    size = control_layout("single").size(C_LAWS[law].config)
    settings = trial_config(1, [{"reference": [0.0, 0.5, 1.0]}]) if law == "trial" else config()
    description = described(settings, _simulator_f32)
    description["controller"] = {"law": law, "config": bytes([byte]) * size}
    with pytest.raises(ValueError, match=f"^{law}: .* is outside its range$"):
        _simulator_f32.Drive(description)


def test_as_many_phases_as_the_motor_has() -> None:
    description = described(config(), _simulator_f32)
    with pytest.raises(ValueError, match="expected as many phases as the motor has"):
        _simulator_f32.Drive({**description, "motor": {**description["motor"], "phases": 2}})


def test_a_trial_of_the_controller_alone_starts_afresh() -> None:
    """Its current loop and its monitor, too: the same trial gives the same, to the bit."""
    library = control_library("float")
    trial = np.linspace(0.0, 1.0, 8)
    drive = drive_of(
        _simulator_f32, trial_config(3, [{"reference": trial}], {"k_3": 0.0}, ideal_current=False)
    )
    state = drive.start()

    def steps() -> list[bytes]:
        drive.begin_trial(state, np.float32(trial).tobytes())
        outputs = []
        for n in range(8 * 20):
            moving = {"theta_m": 1e-3 * n, "omega_m": 0.4}
            now = library.new("cgl_measurement", i_abc=[0.5, -0.2, -0.3], u_dc=100.0, **moving)
            asked = library.new("cgl_reference", theta_ref=float(trial[n // 20]), learn=True)
            both = (bytes(library.ffi.buffer(struct)) for struct in (now, asked))
            outputs.append(drive.step_controller(state, *both))
        drive.end_trial(state)
        return outputs

    first = steps()
    assert len(set(first)) > 100
    assert steps() == first


class Duties:
    """Three duty cycles, whatever is measured."""

    def __init__(self, duty: list[float], precision: str) -> None:
        library = control_library(precision)
        self.output = bytes(library.ffi.buffer(library.new("cgl_drive_output", duty=duty)))

    def step(self, measurement: bytes, reference: bytes) -> bytes:
        return self.output


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("phases", [3, 2])
def test_a_duty_cycle_from_outside_is_one_that_there_is(precision: str, phases: int) -> None:
    """No more than the bus has; and no number, no voltage."""
    change = {"motor": {"phases": phases}, "drive": {"current_sensors": {"sensors": phases}}}
    drive = drive_of(MODULES[precision], config(change))

    def currents(*duty: float) -> Any:
        return rows(drive, MODULES[precision], 100, Duties(list(duty), precision))[0]["i_a"]

    assert np.abs(currents(1.0, 0.0, 0.5)).max() > 0.1
    for wrong in ((10.0, -3.0, math.nan), (math.inf, -math.inf, 0.5), (1.0 + 1e-6, -1e-30, -math.nan)):
        np.testing.assert_array_equal(currents(*wrong), currents(1.0, 0.0, 0.5))
    np.testing.assert_array_equal(currents(0.3, 1e-9, 0.7), currents(0.3, 1e-9, 0.7))
