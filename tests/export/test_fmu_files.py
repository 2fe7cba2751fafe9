"""What an FMU says of itself and how it is packed, without a compiler: XML, C and C++ texts, units, names."""

from __future__ import annotations

import platform
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree.ElementTree import Element, fromstring

import numpy as np
import pytest

from cogless import units
from cogless.errors import StudyError
from cogless.export import fmu as export
from cogless.export.fmu import variables as room
from cogless.export.fmu import xml
from cogless.export.fmu.fmus import _drive_variables, _trials
from cogless.export.fmu.variables import (
    DOUBLE,
    TIME_VARIABLE,
    Unit,
    Variable,
    duties,
    first,
    in_precision,
    measurements,
    place_of,
    real,
    signal,
)

VARIABLES = [
    TIME_VARIABLE,
    Variable("external", "boolean", "parameter", "true: from outside"),
    real("input", "torque", "N*m", "a load", 0.25),
    Variable("learn", "boolean", "input", "false freezes", start=1.0),
    Variable("turns", "integer", "input", "whole", start=3.0),
    signal("omega_m", "rad/s"),
    signal("status", ""),
]
DESCRIPTION = xml.Description(
    "pi_drive", "pi-drive", "A <drive>", "cogless 1", "{token}", 8000, 0.5, VARIABLES, ["a.c", "b.cpp", "c.c"]
)


ABLE = {
    2: ("canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate", "canSerializeFMUstate"),
    3: ("canGetAndSetFMUState", "canSerializeFMUState"),
}


def the(root: Element, path: str) -> dict[str, str]:
    found = root.find(path)
    assert found is not None, path
    return found.attrib


@pytest.mark.parametrize("version", [2, 3])
def test_a_model_description_s_variables(version: int) -> None:
    root = fromstring((xml.fmi2 if version == 2 else xml.fmi3)(DESCRIPTION))
    variables = list(next(iter(root.iter("ModelVariables"))))
    assert [v.get("valueReference") for v in variables] == [str(n) for n in range(7)]
    assert [v.get("name") for v in variables] == [v.name for v in VARIABLES]
    assert [v.get("causality") for v in variables] == [v.causality for v in VARIABLES]
    assert [v.get("variability") for v in variables] == [
        "continuous", "fixed", "continuous", "discrete", "discrete", "continuous", "discrete"
    ]  # fmt: skip
    assert [v.get("initial") for v in variables] == [None] * 5 + ["calculated"] * 2
    typed = [v[0] for v in variables] if version == 2 else variables
    real_, integer = ("Real", "Integer") if version == 2 else ("Float64", "Int32")
    assert [v.tag for v in typed] == [real_, "Boolean", real_, "Boolean", integer, real_, integer]
    assert [v.get("unit") for v in typed] == ["s", None, "N*m", None, None, "rad/s", None]
    assert [v.get("start") for v in typed] == [None, "false", "0.25", "true", "3", None, None]
    assert the(root, "DefaultExperiment") == {"startTime": "0", "stopTime": "0.5", "stepSize": "0.000125"}
    able = ("canHandleVariableCommunicationStepSize", *ABLE[version])
    step = {"fixedInternalStepSize": "0.000125"} if version == 3 else {}
    assert the(root, "CoSimulation") == {
        "modelIdentifier": "pi_drive", **dict.fromkeys(able, "true"), **step
    }  # fmt: skip
    token = root.attrib.pop("guid" if version == 2 else "instantiationToken")
    assert (token, root.attrib) == (
        "{token}",
        {
            "fmiVersion": f"{version}.0",
            "modelName": "pi-drive",
            "description": "A <drive>",
            "generationTool": "cogless 1",
            "variableNamingConvention": "structured",
        },
    )
    assert [v.get("description") for v in variables] == [v.description for v in VARIABLES]
    category = {"name": "logStatusError", "description": "why a function returned an error"}
    assert [each.attrib for each in root.iter("Category")] == [category]
    assert {unit.get("name") for unit in root.iter("Unit")} == {"s", "rad/s", "N*m"}  # those that are used
    assert [unit.attrib for unit in root.iter("BaseUnit")][-1] == {"kg": "1", "m": "2", "s": "-2"}


def test_outputs_do_not_depend_on_inputs_within_a_step() -> None:
    """FMI 2.0 counts variables from one, FMI 3.0 names them by reference."""
    two, three = fromstring(xml.fmi2(DESCRIPTION)), fromstring(xml.fmi3(DESCRIPTION))
    for group, on in (("Outputs", {"dependencies": ""}), ("InitialUnknowns", {})):
        assert [u.attrib for u in two.findall(f"ModelStructure/{group}/Unknown")] == [
            {"index": index, **on} for index in ("6", "7")
        ]
        assert [u.attrib for u in three.findall(f"ModelStructure/{group[:-1]}")] == [
            {"valueReference": n, **on} for n in ("5", "6")
        ]
    assert two.get("guid") == three.get("instantiationToken") == "{token}"
    assert the(three, "CoSimulation")["fixedInternalStepSize"] == "0.000125"
    assert [f.get("name") for f in two.iter("File")] == ["a.c", "b.cpp", "c.c"]
    sets = list(fromstring(xml.build3(DESCRIPTION, "-O2")).iter("SourceFileSet"))
    assert [[f.get("name") for f in each] for each in sets] == [["a.c", "c.c"], ["b.cpp"]]
    assert [(s.get("language"), s.get("compilerOptions")) for s in sets] == [("C99", "-O2"), ("C++20", "-O2")]


BASE = {"gram": "kg", "meter": "m", "second": "s", "ampere": "A", "radian": "rad"}


@pytest.mark.parametrize("unit", [unit for unit in xml.UNIT_EXPONENTS if unit != "1"])
def test_units_have_the_exponents_of_their_dimension(unit: str) -> None:
    written = units._unit(unit)
    assert written is not None
    assert xml.UNIT_EXPONENTS[unit] == {BASE[base]: exponent for base, exponent in written.bases.items()}


@pytest.mark.parametrize(
    ("of", "text"),
    [
        (None, "Value()"),
        (True, "Value(true)"),
        (2**31 - 1, "Value(2147483647)"),
        (2**31, "Value(2147483648LL)"),
        (2**63 - 1, "Value(9223372036854775807LL)"),
        (2**63, "Value(9223372036854775808ULL)"),
        (0.1, "Value(0.1)"),
        (b"\x00a9", 'Value(std::string("\\000\\141\\071", 3))'),
        ('a "b"', 'Value("a \\"b\\"")'),
        (np.array([[1.0, 2.0, 3.0]]), "Value(Value::Matrix{1, 3, {1.0, 2.0, 3.0}})"),
        ([], "Value(Value::List{})"),
        ([1.0, 0.5], "Value(Value::Numbers{1.0, 0.5})"),
        ([1.0, 2], "Value(Value::List{\n        Value(1.0),\n        Value(2),\n    })"),
        (
            {"a": {"b": 1}},
            'Value(Value::Table{\n        {"a", Value(Value::Table{\n            {"b", Value(1)},\n'
            "        })},\n    })",
        ),
    ],
)
def test_values_in_cpp(of: object, text: str) -> None:
    assert room.value(of) == text


def test_numbers_that_are_none_are_refused() -> None:
    for x in (np.inf, np.nan):
        with pytest.raises(ValueError, match="expected a finite number"):
            room.value([1.0, x])


def test_variables_in_c() -> None:
    lines = room.variables_c(VARIABLES, "token", 8000).splitlines()
    assert 'const char fmu_token[] = "token";' in lines and "const uint32_t fmu_rate = 8000;" in lines
    assert "const uint32_t fmu_variable_count = 7;" in lines
    assert '    {"torque", FMU_REAL, FMU_INPUT, 0.25},' in lines
    assert '    {"external", FMU_BOOLEAN, FMU_PARAMETER, 0.0},' in lines
    places = room.places(VARIABLES, {"A": "torque", "B": "nothing"}).splitlines()
    assert places[1:-1] == [
        "    A = 2,", "    B = 0,", "    FMU_FIRST_INPUT = 2,", "    FMU_FIRST_OUTPUT = 5"
    ]  # fmt: skip
    assert place_of(VARIABLES, "status") == 6 and first(VARIABLES, "parameter") == 1


def test_two_phases_have_two_currents_and_duties() -> None:
    names = [[v.name for v in measurements("input", phases, 48.0)] for phases in (2, 3)]
    assert names[1] == [f"measured.{name}" for name in ("i_a", "i_b", "i_c", "theta_m", "omega_m", "u_dc")]
    assert names[0] == [name for name in names[1] if name != "measured.i_c"]
    assert measurements("input", 3, 48.0)[-1].start == 48.0
    assert [v.name for v in measurements("input", 3, None)] == ["measured.theta_m", "measured.omega_m"]
    assert [(v.name, v.start) for v in duties("input", 2)] == [("duty_a", 0.5), ("duty_b", 0.5)]


@pytest.mark.parametrize(
    ("system", "machine", "paths"),
    [
        ("linux", "x86_64", ("linux64", "x86_64-linux", "so")),
        ("linux", "aarch64", ("linux64", "aarch64-linux", "so")),
        ("darwin", "arm64", ("darwin64", "aarch64-darwin", "dylib")),
    ],
)
def test_where_a_binary_is(
    monkeypatch: pytest.MonkeyPatch, system: str, machine: str, paths: tuple[str, str, str]
) -> None:
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(platform, "machine", lambda: machine)
    two, three, ending = paths
    assert export.binary(2, "pi") == f"binaries/{two}/pi.{ending}"
    assert export.binary(3, "pi") == f"binaries/{three}/pi.{ending}"
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(StudyError, match="export --to fmu: win32: expected Linux or macOS"):
        export.binary(2, "pi")


def test_equal_fmus_are_equal_files(tmp_path: Path) -> None:
    """Whenever they are packed, and in whatever order; whoever unpacks one may read it."""
    export.pack(tmp_path / "a.fmu", {"b": b"2", "a/c": b"1" * 1000})
    export.pack(tmp_path / "b.fmu", {"a/c": b"1" * 1000, "b": b"2"})
    assert (tmp_path / "a.fmu").read_bytes() == (tmp_path / "b.fmu").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.fmu") as fmu:
        assert fmu.namelist() == ["a/c", "b"] and fmu.read("a/c") == b"1" * 1000
        for entry in fmu.infolist():
            assert entry.date_time == (1980, 1, 1, 0, 0, 0) and entry.external_attr >> 16 == 0o644
        assert fmu.getinfo("a/c").compress_size < 100


def test_a_compiler_s_first_error_is_told() -> None:
    def told(*lines: str) -> str:
        done = subprocess.CompletedProcess([], 3, "", "\n".join(lines))
        return str(export._failed("sources/a.c", done))

    begin = "export --to fmu: a.c does not compile: "
    assert told("a.c: in f:", "a.c:1: error: x", "a.c:2: error: y") == f"{begin}a.c:1: error: x"
    assert told("killed", "so it is") == f"{begin}killed"
    assert told() == f"{begin}exit 3"


def test_names_and_precision_of_a_unit() -> None:
    assert Unit("2nd pi-drive", "", "C", 1, 1.0, (), {}).identifier == "unit_2nd_pi_drive"
    assert Unit("pi-drive", "", "C", 1, 1.0, (), {}).identifier == "pi_drive"
    sources = {"cogless/real.h": "real", "a.c": "a"}
    assert in_precision(sources, 32) == sources
    assert in_precision(sources, 64) == {"cogless/real.h": f"{DOUBLE}real", "a.c": "a"}


def test_each_trial_of_a_controller_s_fmu_has_the_motion_of_its_phase() -> None:
    """The last phase that has begun; a trial begins with its first tick, and ends before the next."""
    subject: Any = SimpleNamespace(precision="d", divider=3, name="ilc", law=SimpleNamespace(name="trial"))
    phases = [{"from": first, "reference": [0.0, 0.5 + first]} for first in (0, 2, 4)]
    run: Any = SimpleNamespace(description={"trials": {"samples": 2, "phases": phases}})
    lines = [line.strip() for line in _trials(run, subject).splitlines()]
    assert lines[0] == "enum { TRIAL_SAMPLES = 2, TRIAL_TICKS = 6 };"
    assert [lines[lines.index(f"static const cgl_real motion_{n}[] = {{") + 1] for n in range(3)] == [
        "0.0, 0.5,", "0.0, 2.5,", "0.0, 4.5,"
    ]  # fmt: skip
    at = lines.index("(void)trial;")
    assert lines[at + 1 : at + 4] == [
        "if (trial >= 4U) return motion_2;",
        "if (trial >= 2U) return motion_1;",
        "return motion_0;",
    ]
    due = "if (tick % TRIAL_TICKS == 0)"
    assert f"{due} ilc_begin_trial(controller, motion_of(tick));" in lines
    assert f"{due} (void)ilc_end_trial(controller);" in lines
    none: Any = SimpleNamespace(law=SimpleNamespace(name="pi"))
    assert _trials(run, none).count("    (void)controller;\n    (void)tick;\n") == 2
    assert "TRIAL" not in _trials(run, none)


@pytest.mark.parametrize("ideal", [False, True])
def test_a_drive_s_fmu_tells_when_its_inputs_count(ideal: bool) -> None:
    run: Any = SimpleNamespace(phases=2, bus_voltage=None if ideal else 24.0, trials=False)
    variables = _drive_variables(run, [("time", "s"), ("omega_ref", "rad/s"), ("omega_m", "rad/s")])
    told = {
        v.name: (v.causality, v.kind, v.unit, v.description) for v in variables if v.causality != "output"
    }
    what = "input.i_q_ref acts" if ideal else "the duty inputs act"
    of_current = ("input", "real", "A", "q-axis current reference; it acts only if external_control is true")
    open_ = (
        "if true, all switches are off and the duty inputs have no effect; "
        "connect bit 1024 of the status of a controller"
    )
    duty = ("input", "real", "1", "duty cycle, 0 to 1")
    own = {"input.i_q_ref": of_current} if ideal else {
        "bridge_open": ("input", "boolean", "", open_), "duty_a": duty, "duty_b": duty
    }  # fmt: skip
    assert told == {
        "time": ("independent", "real", "s", "time since the start of the simulation"),
        "external_control": (
            "parameter", "boolean", "", f"if true, {what} at once, in place of the study's controller"
        ),
        "external_reference": (
            "parameter", "boolean", "",
            "if true, inputs such as input.omega_ref give the reference, not the scenario",
        ),
        "tau_load_added": ("input", "real", "N*m", "load torque that is added to that of the scenario"),
        **own,
        "input.omega_ref": (
            "input", "real", "rad/s", "mechanical speed reference; it acts only if external_reference is true"
        ),
    }  # fmt: skip
    names = [v.name for v in variables if v.causality == "output"]
    voltages = [] if ideal else ["measured.i_a", "measured.i_b"]
    assert names == [
        "omega_ref", "omega_m", *voltages, "measured.theta_m", "measured.omega_m",
        *([] if ideal else ["measured.u_dc"]),
        *(f"reference.{name}" for name in ("theta_ref", "omega_ref", "alpha_ref", "i_d_ref", "learn")),
    ]  # fmt: skip
    run.trials = True  # whose reference is the motion that is taught
    about_references = {"external_reference", "input.omega_ref"}
    of_trials = {v.name for v in _drive_variables(run, [("omega_ref", "rad/s")])}
    assert of_trials.isdisjoint(about_references) and told.keys() - of_trials == about_references


def test_the_compiler_is_the_user_s_or_the_first_on_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    there = {"gcc", "clang", "g++"}
    monkeypatch.setattr(export.shutil, "which", lambda name: name if name in there else None)
    for variable in ("CC", "CXX"):
        monkeypatch.delenv(variable, raising=False)
    assert (export.compiler("C"), export.compiler("C++")) == (["gcc"], ["g++"])
    monkeypatch.setenv("CC", "clang -m64 '-DA=1 2'")
    assert export.compiler("C") == ["clang", "-m64", "-DA=1 2"]
    monkeypatch.setenv("CC", "icc -x")
    expected = "export --to fmu: no C compiler: expected CC=icc on the PATH"
    with pytest.raises(StudyError, match=f"^{expected}$"):
        export.compiler("C")
    there.clear()
    with pytest.raises(StudyError) as told:
        export.compiler("C++")
    names = "c++, g++, clang++"
    assert str(told.value) == (f"export --to fmu: no C++ compiler: expected {names} on the PATH, or CXX set")


@pytest.mark.parametrize(
    ("system", "language", "fails", "extra"),
    [
        ("linux", "C++", 0, [["-static-libgcc", "-static-libstdc++"]]),
        ("linux", "C++", 1, [["-static-libgcc", "-static-libstdc++"], []]),  # a system without static ones
        ("linux", "C", 0, [[]]),
        ("darwin", "C++", 0, [[]]),
        ("darwin", "C++", 1, [[]]),
        ("linux", "C++", 2, [["-static-libgcc", "-static-libstdc++"], []]),
    ],
)
def test_a_library_has_its_runtime_inside_where_that_links(
    system: str,
    language: str,
    fails: int,
    extra: list[list[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And shows the functions of the standard alone."""
    asked: list[list[str]] = []

    def run(command: list[str]) -> Any:
        asked.append(command)
        return SimpleNamespace(returncode=int(len(asked) <= fails), stderr="ld: error: no x")

    monkeypatch.setattr(export, "_run", run)
    monkeypatch.setattr(export, "compiler", lambda language: [language])
    monkeypatch.setattr(sys, "platform", system)
    library = tmp_path / "deep" / "pi.so"
    if fails < len(extra):
        export.link([Path("a.o"), Path("b.o")], library, language)
    else:
        with pytest.raises(StudyError, match=r"^export --to fmu: pi\.so does not compile: ld: error: no x$"):
            export.link([Path("a.o"), Path("b.o")], library, language)
    command = [language, "-shared", "-o", str(library), "a.o", "b.o"]
    exports = tmp_path / "deep" / "pi.map"
    if system == "linux":
        command += [f"-Wl,--version-script={exports}", "-ldl", "-lm"]
        assert exports.read_text() == "{ global: fmi2*; fmi3*; local: *; };\n"
    assert asked == [command + more for more in extra] and exports.exists() == (system == "linux")
