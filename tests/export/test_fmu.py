"""Functional mock-up units: valid, and the simulation itself."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
import trial_studies
from fmpy.validation import validate_fmu
from fmus import Slave
from kept import kept
from kept import version as compilers_version
from numpy.typing import NDArray

from cogless.errors import StudyError
from cogless.export import fmu
from cogless.export import fmu as export
from cogless.results.trace import Trace
from cogless.run.simulate import simulate
from cogless.study import AnyStudy, load

pytestmark = pytest.mark.skipif(
    not (shutil.which("cc") and shutil.which("c++")), reason="no C and C++ compiler on the PATH"
)

# a drive with everything that an FMU has to keep: an encoder's edges, noise, a converter, cogging, a gap
STUDY = """
title = "A drive with <everything> & more"
seed = 5
[trace]
rate = "10 kHz"
[motor]
pole_pairs = 4
R_s = "0.8 ohm"
L_d = "2 mH"
L_q = "3 mH"
psi_f = "50 mWb"
cogging = [ {order = 24, torque = "20 mN*m"} ]
flux_harmonics = [ {order = 6, d = "1 mWb", q = "1 mWb"} ]
[mechanics]
inertia = "5e-4 kg*m^2"
coulomb_friction = "5 mN*m"
breakaway_friction = "8 mN*m"
stribeck_speed = "10 rpm"
friction_table = { angle = ["0 deg", "180 deg"], torque = ["0 N*m", "1 mN*m"] }
[mechanics.load_side]
inertia = "2e-4 kg*m^2"
stiffness = "30 N*m/rad"
damping = "5 mN*m*s/rad"
backlash = "0.2 deg"
coulomb_friction = "2 mN*m"
gear_errors = [ {side = "output", order = 3, angle = "0.1 deg", phase = "10 deg"} ]
[drive]
rates = { current_loop = "10 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "500 Hz", current_limit = "10 A" }
inverter = { kind = "switched", bus_voltage = "48 V", dead_time = "1 us" }
position_sensor = { kind = "encoder", lines = 1024, speed_method = "MT" }
current_sensors = { noise = "5 mA", bits = 12, range = "20 A" }
[scenario.step]
duration = "0.08 s"
reference = "300 rpm"
initial_speed = "300 rpm"
events = [ {time = "0.03 s", load = "0.2 N*m"} ]
[controller.pi-ilc]
law = "pi-ilc"
kp = "0.1 A*s/rad"
ki = "2 A/rad"
gain = "0.05 A*s/rad"
memory = "angle"
cells = 64
period = "electrical"  # so that what is learned acts within the run, after 50 ms
q_half_width = 1
[controller.own]
law = "python"
object = "own.py:Own"
[[metric]]
name = "ripple"
kind = "peak-to-peak"
signal = "omega_m"
"""

OWN = "drive_variables.hpp"  # of each drive; no C includes it
CURRENTS = ("i_d", "i_q", "i_a", "i_b", "i_c")
PLANT = (
    "theta_m", "omega_m", "omega_ref", *CURRENTS, "tau_e", "tau_cogging", "tau_load", "theta_load",
    "tau_shaft",
)  # fmt: skip
INSIDE = ("i_q_ref", "u_d", "u_q", "status")


@dataclass
class Exported:
    """A study's FMUs, unpacked, and what the simulation itself gives."""

    study: AnyStudy
    controller: str
    files: list[Path]
    folders: dict[tuple[str, int], Path]
    trace: Trace


def exported(folder: Path, study: AnyStudy, controller: str) -> Exported:
    files = export.write_fmus(study, controller, None, folder / "fmus")
    folders = {}
    for part in ("controller", "drive"):
        for version in (2, 3):
            target = folder / f"{part}{version}"
            fmpy.extract(folder / "fmus" / f"{controller}-{part}-fmi{version}.fmu", unzipdir=target)
            folders[part, version] = target
    trace = simulate(study, next(iter(study.scenario)), controller).trace
    return Exported(study, controller, files, folders, trace)


@pytest.fixture(scope="module")
def shared() -> Iterator[None]:
    """What every FMU of these tests has alike is compiled once, and kept; its C++ as two units, of which one
    is a drive's own. So is what is linked of the same objects.

    Without optimising, and by clang where it is: that takes a third as long, and the bits are the same.
    """
    compile_all, link_all = export.objects, export.link

    def objects(sources: Iterable[Path], folder: Path) -> list[Path]:
        sources = list(sources)
        texts = {source: source.read_text() for source in sources if source.suffix == ".cpp"}
        for own in (False, True):
            units = [source for source in texts if (OWN in texts[source]) is own]
            for n, source in enumerate(units):
                source.write_text("" if n else "".join(texts[unit] for unit in units))
        return [compiled(source, folder) for source in sources]

    def compiled(source: Path, folder: Path) -> Path:
        included = (each for each in sorted(source.parent.rglob("*.*")) if each.suffix not in (".c", ".cpp"))
        read = [source, *(each for each in included if each.name != OWN or OWN in source.read_text())]
        words = [
            *fmu.OPTIONS,
            *(compilers_version(fmu.compiler(language)[0]) for language in fmu.LANGUAGE_COMPILERS),
        ]
        return kept(
            f"{source.stem}.o", words, read, lambda made: shutil.move(*compile_all([source], folder), made)
        )

    def link(parts: Sequence[Path], library: Path, language: str) -> None:
        def make(made: Path) -> None:
            link_all(parts, library, language)
            shutil.copy(library, made)

        words = [language, compilers_version(fmu.compiler(language)[0])]
        library.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(kept(library.name, words, [*parts, Path(fmu.__file__)], make), library)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "objects", objects)
        patch.setattr(export, "link", link)
        patch.setattr(fmu, "OPTIONS", ("-O0", *fmu.OPTIONS[1:]))
        if shutil.which("clang++"):
            patch.setenv("CXX", "clang++")
        yield


@pytest.fixture(scope="module")
def single(shared: None, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    folder = tmp_path_factory.mktemp("single")
    (folder / "study.toml").write_text(STUDY)
    return exported(folder, load(folder / "study.toml"), "pi-ilc")


@pytest.fixture(scope="module")
def trials(shared: None, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    """In double precision, with a filter of what is learned, load steps, and another rotor in the end."""
    changes = {
        "drive.precision": "double",
        "scenario.move.trials": 4,
        "scenario.move.duration": "0.1 s",
        "scenario.move.reference": [["0.01 s", "0 rad"], ["0.08 s", "0.2 rad"]],
        "scenario.move.changes": [
            {"trial": 2, "load_steps": [[20, "0.5 N*m"]]},
            {"trial": 3, "override": {"mechanics.inertia": "10.6e-4 kg*m^2"}},
        ],
        "trace.rate": "8 kHz",
    }
    folder = tmp_path_factory.mktemp("trials")
    return exported(folder, trial_studies.loaded(folder, changes), "ilc")


@pytest.fixture(params=["single", "trials"])
def both(request: pytest.FixtureRequest) -> Exported:
    found: Exported = request.getfixturevalue(request.param)
    return found


def columns(trace: Trace, names: list[str]) -> NDArray[np.float64]:
    return np.column_stack([trace[name] for name in names])


def test_fmpy_finds_nothing_wrong(both: Exported) -> None:
    assert len(both.files) == 4
    for path in both.files:
        assert validate_fmu(str(path)) == []


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("part", ["controller", "drive"])
def test_every_function_of_the_standard_is_there(single: Exported, part: str, version: int) -> None:
    header = Path(export.__file__).parents[1] / "fmi" / f"fmi{version}Functions.h"
    wanted = set(re.findall(rf"FMI{version}_Export\s+\w+\s+(fmi{version}\w+);", header.read_text()))
    (library,) = (single.folders[part, version] / "binaries").rglob("*.so")
    symbols = subprocess.run(
        ["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True
    )
    functions = {line.split()[-1] for line in symbols.stdout.splitlines() if line.split()[-2] in "TWuV"}
    assert len(wanted) > 40 and functions == wanted


@pytest.mark.parametrize("version", [2, 3])
def test_the_drive_is_the_simulation(both: Exported, version: int) -> None:
    slave = Slave(both.folders["drive", version])
    names = [name for name in both.trace.names if name != "time"]
    rows = slave.run(len(both.trace), names)
    np.testing.assert_array_equal(rows, columns(both.trace, names))
    assert slave.messages == []
    slave.close()


def test_a_drive_whose_law_is_elsewhere(shared: None, tmp_path: Path) -> None:
    """The whole drive with its bus; no controller, which is law and current loop in one."""
    (tmp_path / "study.toml").write_text(STUDY)
    bus = {"delay_measured": "0.3 ms", "delay_command": "1 ms", "jitter": "0.5 ms", "quantum": "1 mA"}
    study = load(tmp_path / "study.toml", {"drive.bus": bus})
    files = export.write_fmus(study, "pi-ilc", None, tmp_path / "fmus")
    assert [path.name for path in files] == ["pi-ilc-drive-fmi2.fmu", "pi-ilc-drive-fmi3.fmu"]
    fmpy.extract(files[1], unzipdir=tmp_path / "drive")
    trace = simulate(study, "step", "pi-ilc").trace
    names = [name for name in trace.names if name != "time"]
    slave, other = Slave(tmp_path / "drive"), Slave(tmp_path / "drive")
    first = slave.run(300, names)
    kept = slave.fmu.serializeFMUState(slave.fmu.getFMUState())
    state = other.fmu.deserializeFMUState(kept)
    other.fmu.setFMUState(state)
    other.steps = slave.steps
    rows = np.vstack([first, other.run(len(trace) - 300, names)])
    np.testing.assert_array_equal(rows, columns(trace, names))
    other.fmu.freeFMUState(state)
    slave.close()
    other.close()


def test_a_drive_with_rows_between_its_samples_gives_those_of_the_samples(
    shared: None, tmp_path: Path
) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    study = load(tmp_path / "study.toml", {"trace.rate": "30 kHz"})
    files = export.write_fmus(study, "pi-ilc", None, tmp_path / "fmus")
    fmpy.extract(files[-1], unzipdir=tmp_path / "drive")
    trace, slave = simulate(study, "step", "pi-ilc").trace, Slave(tmp_path / "drive")
    names = [name for name in trace.names if name != "time"]
    rows = slave.run(len(trace) // 3, names)
    np.testing.assert_array_equal(rows, columns(trace, names)[::3])
    assert "u_a" in names
    slave.close()


@pytest.mark.parametrize("version", [2, 3])
def test_fmpys_own_run_is_the_simulation(single: Exported, version: int) -> None:
    rows = fmpy.simulate_fmu(single.folders["drive", version], stop_time=0.05, output_interval=1e-4)
    assert len(rows) == 501
    for name in ("omega_m", "i_q_ref", "tau_load", "term_ilc"):
        np.testing.assert_array_equal(rows[name], single.trace[name][:501])


def closed_loop(of: Exported, version: int, steps: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The controller's FMU on the drive's: rows of the plant, and of the controller.

    Both take their steps at the same time, from what the other gave before: that is the one period that a
    microcontroller takes.
    """
    drive = Slave(of.folders["drive", version], {"external_control": True})
    controller = Slave(of.folders["controller", version])
    wires = [name for name, v in controller.variables.items() if v.causality == "input"]
    acts = [name for name in controller.outputs() if name in drive.variables and name.startswith("duty")]
    plant = [name for name in PLANT if name in drive.variables]
    inside = [name for name in INSIDE if name in controller.variables]
    outer, inner = [], []
    for _ in range(steps):
        outer.append(drive.get(plant))
        measured, asked = drive.get(wires), controller.get(acts)
        controller.put(dict(zip(wires, measured, strict=True)))
        controller.step()
        inner.append(controller.get(inside))
        if acts:
            drive.put(dict(zip(acts, asked, strict=True)))
        else:  # an ideal current loop has no such period
            drive.put({"input.i_q_ref": controller.get(["i_q_ref"])[0]})
        drive.step()
    assert drive.messages == controller.messages == []
    drive.close()
    controller.close()
    return np.array(outer), np.array(inner)


@pytest.mark.parametrize("version", [2, 3])
def test_both_fmus_together_are_the_simulation(both: Exported, version: int) -> None:
    outer, inner = closed_loop(both, version, len(both.trace))
    drive = fmpy.read_model_description(both.folders["drive", version])
    names = {v.name for v in drive.modelVariables}
    plant = [name for name in PLANT if name in names]
    inside = [name for name in INSIDE if name in names]
    expected = columns(both.trace, plant)
    if (
        "i_d" not in names
    ):  # the current that the step before asked for is not the one that flows from here on
        place = [n for n, name in enumerate(plant) if name not in ("i_q", "tau_e")]
        outer, expected = outer[:, place], expected[:, place]
    np.testing.assert_array_equal(outer, expected)
    np.testing.assert_array_equal(inner, columns(both.trace, inside))


@pytest.mark.parametrize("version", [2, 3])
def test_a_state_can_be_kept_and_taken_up_again(both: Exported, version: int) -> None:
    """With what was learned, which acts: in the second period of the angle, in the second trial."""
    slave = Slave(both.folders["drive", version])
    names = slave.outputs()
    slave.run(600 if both.controller == "pi-ilc" else 900, names)
    state, at = slave.fmu.getFMUState(), slave.steps
    first = slave.run(150, names)
    slave.fmu.setFMUState(state)
    slave.steps = at
    np.testing.assert_array_equal(slave.run(150, names), first)
    kept = slave.fmu.serializeFMUState(state)
    slave.fmu.freeFMUState(state)

    other = Slave(both.folders["drive", version])
    other.run(7, names)
    again = other.fmu.deserializeFMUState(kept)
    other.fmu.setFMUState(again)
    other.steps = at
    np.testing.assert_array_equal(other.run(150, names), first)
    broken = other.fmu.deserializeFMUState(kept[:-8])
    with pytest.raises(Exception, match="etFMU"):
        other.fmu.setFMUState(broken)
    assert other.messages == ["this is no state of this FMU"]
    for some in (again, broken):
        other.fmu.freeFMUState(some)
    slave.close()
    other.free()  # after such an error nothing else is allowed


@pytest.mark.parametrize("version", [2, 3])
def test_the_controllers_state_too(both: Exported, version: int) -> None:
    folder = both.folders["controller", version]
    slave, other = Slave(folder), Slave(folder)
    names = slave.outputs()

    def run(one: Slave, steps: int) -> NDArray[np.float64]:
        rows = []
        for _ in range(steps):
            angle = 2.4e-4 * (one.steps % 800)
            one.put({"measured.theta_m": angle, "measured.omega_m": 2.0, "reference.omega_ref": 2.3})
            if "measured.u_dc" in one.variables:
                one.put({"measured.i_a": 0.1})
            one.step()
            rows.append(one.get(names))
        return np.array(rows)

    run(slave, 900)
    state = slave.fmu.getFMUState()
    kept = slave.fmu.serializeFMUState(state)
    first = run(slave, 300)
    assert len(np.unique(first[:, names.index("i_q_ref")])) > 10
    slave.fmu.freeFMUState(state)
    state = other.fmu.deserializeFMUState(kept)
    other.fmu.setFMUState(state)
    other.fmu.freeFMUState(state)
    slave.close()  # nothing of the other may point into it
    other.steps = 900
    np.testing.assert_array_equal(run(other, 300), first)
    other.close()


@pytest.mark.parametrize("version", [2, 3])
def test_instances_do_not_disturb_each_other_and_reset_begins_anew(single: Exported, version: int) -> None:
    folder = single.folders["drive", version]
    names = ["omega_m", "i_q", "term_ilc"]
    alone = Slave(folder)
    expected = alone.run(200, names)
    alone.set(tau_load_added=0.3)
    alone.step()
    alone.reset()
    one, two = alone, Slave(folder)
    two.set(tau_load_added=0.1)
    rows = []
    for _ in range(200):
        rows.append(one.get(names))
        one.step()
        two.step(2)
    np.testing.assert_array_equal(np.array(rows), expected)
    assert two.get(names) != one.get(names)
    one.close()
    two.close()


@pytest.mark.parametrize("version", [2, 3])
def test_inputs_act_at_once(single: Exported, version: int) -> None:
    """A torque from outside is that of an event; a reference from outside is that of the scenario."""
    events = {"scenario.step.events": [{"time": "0 s", "load": "0.2 N*m"}]}
    expected = simulate(load(single.study.source.path, events), "step", "pi-ilc").trace
    slave = Slave(
        single.folders["drive", version],
        {"tau_load_added": 0.2, "external_reference": True, "input.omega_ref": 300 * 2 * np.pi / 60},
    )
    rows = slave.run(250, ["omega_m", "omega_ref", "tau_load"])
    np.testing.assert_array_equal(rows, columns(expected, ["omega_m", "omega_ref", "tau_load"])[:250])
    slave.put({"input.omega_ref": 40.0, "tau_load_added": 0.0})
    slave.step(20)
    assert slave.get(["omega_ref", "tau_load"]) == [40.0, pytest.approx(0.0)]
    slave.close()


@pytest.mark.parametrize("version", [2, 3])
def test_an_added_torque_acts_in_every_trial(trials: Exported, version: int) -> None:
    """Each trial begins with the described load anew, and its steps; and where it changes, within one too."""
    folder, steps, middle = trials.folders["drive", version], len(trials.trace), 1000
    plain, loaded = Slave(folder), Slave(folder, {"tau_load_added": 0.3})
    described = plain.run(steps, ["tau_load"])
    before = loaded.run(middle, ["tau_load"])
    loaded.put({"tau_load_added": 0.1})
    after = loaded.run(steps - middle, ["tau_load"])[1:]  # the change acts with the next step
    assert set(described.ravel()) == {0.0, 0.5}
    np.testing.assert_allclose(before, described[:middle] + 0.3, atol=1e-15)
    np.testing.assert_allclose(after, described[middle + 1 :] + 0.1, atol=1e-15)
    plain.close()
    loaded.close()


@pytest.mark.parametrize("version", [2, 3])
def test_a_terminated_instance_begins_anew(both: Exported, version: int) -> None:
    """By a state from before its end, or by a reset."""
    slave = Slave(both.folders["drive", version])
    names = [name for name in both.trace.names if name != "time"]
    expected = columns(both.trace, names)
    slave.step(40)
    state = slave.fmu.getFMUState()
    slave.run(60, names)
    slave.fmu.terminate()
    slave.fmu.setFMUState(state)
    slave.fmu.freeFMUState(state)
    slave.steps = 40
    np.testing.assert_array_equal(slave.run(100, names), expected[40:140])
    slave.fmu.terminate()
    slave.reset()
    np.testing.assert_array_equal(slave.run(100, names), expected[:100])
    slave.close()


@pytest.mark.parametrize("version", [2, 3])
def test_what_is_refused(single: Exported, version: int) -> None:
    slave = Slave(single.folders["drive", version])
    slave.step(3)
    before = slave.get(["omega_m"])

    def refused(expected: str, call: Any, *arguments: Any) -> None:
        with pytest.raises(Exception, match="fmi"):
            call(*arguments)
        assert expected in slave.messages[-1]

    refused(
        "communication step 0.00015 s: expected a whole number of periods of 0.0001 s",
        slave.fmu.doStep,
        3e-4,
        1.5e-4,
    )
    refused("communication point 0.0002 s: expected 0.0003 s", slave.fmu.doStep, 2e-4, 1e-4)
    refused("communication step 0 s", slave.fmu.doStep, 3e-4, 0.0)
    refused("communication step nan s", slave.fmu.doStep, 3e-4, float("nan"))
    refused("external_control: a parameter", slave.put, {"external_control": True})
    refused("omega_m: neither an input nor a parameter", slave.put, {"omega_m": 1.0})
    read = slave.fmu.getReal if version == 2 else slave.fmu.getFloat64
    refused("value reference 9999: no variable of this type", read, [9999])
    assert slave.get(["omega_m"]) == before
    slave.step()
    slave.close()


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("number", [float("nan"), float("inf"), -float("inf")])
def test_an_input_that_is_no_number_is_named(single: Exported, version: int, number: float) -> None:
    """Whether it comes before the start or with a step, and whether it acts or not."""
    folder = single.folders["drive", version]
    slave = Slave(folder)
    for name in ("tau_load_added", "duty_a", "duty_b", "duty_c", "input.omega_ref"):
        slave.step(3)
        slave.put({name: number})
        with pytest.raises(Exception, match=r"fmi.*DoStep"):
            slave.step()
        assert slave.messages[-1] == f"{name}: expected a finite number"
        slave.reset()
    slave.fmu.reset()
    slave.messages.clear()
    with pytest.raises(Exception, match="fmi"):
        slave.initialise({"duty_b": number, "external_control": True})
    assert slave.messages == ["duty_b: expected a finite number"]
    slave.reset()
    slave.close()


def test_the_trials_end(trials: Exported) -> None:
    slave = Slave(trials.folders["drive", 3])
    slave.step(len(trials.trace))
    with pytest.raises(Exception, match="fmi3DoStep"):
        slave.step()
    assert slave.messages == ["the study's trials are over"]
    slave.reset()
    assert slave.get(["trial"]) == [1.0]
    slave.close()


def test_functions_that_make_no_sense_say_so(single: Exported) -> None:
    names = {
        2: ("fmi2EnterEventMode", "fmi2EnterContinuousTimeMode", "fmi2CancelStep"),
        3: ("fmi3EnterEventMode", "fmi3EnterConfigurationMode", "fmi3EnterStepMode"),
    }
    for version in (2, 3):
        slave = Slave(single.folders["controller", version])
        for name in names[version]:
            assert getattr(slave.fmu.dll, name)(ctypes.c_void_p(slave.fmu.component)) == 3
            assert slave.messages[-1] == f"{name}: not supported by this FMU for co-simulation"
        slave.close()


def test_mistakes_are_one_line(single: Exported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def line(**changes: Any) -> str:
        options: dict[str, Any] = {"controller": "pi-ilc", "scenario": None, **changes}
        with pytest.raises(StudyError) as error:
            export.write_fmus(single.study, options["controller"], options["scenario"], tmp_path / "out")
        assert "\n" not in str(error.value)
        return str(error.value).replace(f"{single.study.source.path}: ", "")

    assert line(controller="pid") == 'controller: "pid": expected one of pi-ilc, own'
    assert line(scenario="slow").startswith('scenario: "slow": expected')
    assert line(controller="own").startswith('controller.own.law: "python": has no C form')
    # a compiler that is missing is told before the other has compiled for a minute
    monkeypatch.setattr(export, "objects", lambda *of: pytest.fail("compiled"))
    monkeypatch.setenv("CXX", "no-such-compiler")
    assert "no C++ compiler: expected CXX=no-such-compiler on the PATH" in line()
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "no C compiler: expected cc, gcc, clang on the PATH, or CC set" in line()
    assert not (tmp_path / "out").exists()
