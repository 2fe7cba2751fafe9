"""A trace has one hash: with any compiler, level of optimisation and C library, and with fused instructions
or without.

`make hash` compiles the simulator with each compiler, minutes of work that `make test` leaves out.
"""

import hashlib
import importlib.util
import os
import pickle
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from engine import PI_ILC, RIPPLE, config, described

from cogless import _simulator_f32 as engine
from cogless.export.fmu import OPTIONS, STANDARDS
from cogless.export.fmu.variables import description_cpp

ROOT = Path(__file__).parents[2]
TICKS = 2000
WITHOUT_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable,-FMA4_Usable"}
INVERTERS = ["averaged", "switched"]
DECLARED = """
#include <vector>
#include "value.hpp"
cogless::Value description();
std::vector<double> taught();
"""
INSTALLED = """
import pickle, sys
from cogless import _simulator_f32 as engine
description, ticks = pickle.load(sys.stdin.buffer)
drive = engine.Drive(description, None)
state, recorder = drive.start(), engine.Recorder(drive, 1)
drive.advance(state, recorder, ticks)
sys.stdout.buffer.write(recorder.take().tobytes())
"""


def description(inverter: str) -> dict[str, Any]:
    """A run with all that the engine computes with elementary functions, without numbers that Python
    computed."""
    change: dict[str, Any] = {
        "motor": RIPPLE,
        "controller": PI_ILC,
        "energy": True,
        "load": {"torque": 0.1, "lag": 0.003},
        "events": [{"time": 0.01, "load": 0.3}],
        "reference": {
            "kind": "fm",
            "offset": 10.0,
            "amplitude": 3.0,
            "frequency": 5.0,
            "depth": 2.0,
            "modulation": 3.0,
        },
        "drive": {
            "inverter": {"kind": inverter, "dead_time": 1e-6},
            "current_sensors": {"noise": 0.02},
            "position_sensor": {
                "kind": "encoder",
                "counts": 4000.0,
                "speed_method": "M",
                "timer": 1e9,
                "error": [{"order": 1, "amplitude": 0.01, "phase": 0.2}],
            },
        },
    }
    return described(config(change), engine)


def trace_hash(command: list[str], given: bytes = b"", **environment: str) -> str:
    made = subprocess.run(
        command, input=given, capture_output=True, check=True, env={**os.environ, **environment}
    )
    assert len(made.stdout) > 8 * TICKS
    return hashlib.sha256(made.stdout).hexdigest()


def installed(inverter: str, **environment: str) -> str:
    given = pickle.dumps((description(inverter), TICKS))
    return trace_hash([sys.executable, "-c", INSTALLED], given, **environment)


@pytest.mark.parametrize("inverter", INVERTERS)
def test_with_and_without_fused_instructions_in_libc(inverter: str) -> None:
    """glibc's sine differs in the last bit with -FMA; the engine's does not."""
    assert installed(inverter, **WITHOUT_FMA) == installed(inverter)


def compilers() -> Iterator[Any]:
    """Commands for C and C++, the level of optimisation, and whether their C library is glibc; skipped where
    one is missing; the longest first, whose C library is compiled, too."""
    absent = sys.platform != "linux" or importlib.util.find_spec("ziglang") is None
    missing = pytest.mark.skipif(absent, reason="no ziglang, which is in the extra pil, or no Linux")
    zig = [sys.executable, "-m", "ziglang"]
    musl = ["-target", f"{platform.machine()}-linux-musl", "-fno-sanitize=all"]
    yield pytest.param([*zig, "cc", *musl], [*zig, "c++", *musl], "-O2", False, id="musl", marks=missing)
    glibc = sys.platform == "linux"
    for level in ("-O2", "-O3"):
        for c, cpp in (("gcc", "g++"), ("clang", "clang++")):
            missing = pytest.mark.skipif(shutil.which(cpp) is None, reason=f"no {cpp}")
            yield pytest.param([c], [cpp], level, glibc, id=c + level, marks=missing)


def programs(c: list[str], cpp: list[str], options: list[str], folder: Path) -> Iterator[tuple[str, Path]]:
    """A program for each inverter; the simulator is compiled once, as one file."""
    options = [*options, f"-I{ROOT / 'control' / 'src'}", f"-I{ROOT / 'simulator'}", f"-I{folder}"]
    (folder / "drive_variables.hpp").write_text(DECLARED)
    laws = map(str, (ROOT / "control" / "src" / "cogless").glob("*.c"))
    main = str(Path(__file__).with_name("one_hash.cpp"))
    subprocess.run([*c, STANDARDS["C"], *options, "-c", *laws], cwd=folder, check=True)
    subprocess.run([*cpp, STANDARDS["C++"], *options, "-c", main], cwd=folder, check=True)
    objects = list(map(str, folder.glob("*.o")))
    for inverter in INVERTERS:
        source, program = folder / f"{inverter}.cpp", folder / inverter
        source.write_text(description_cpp(description(inverter), []))
        described = [*cpp, STANDARDS["C++"], *options, str(source), *objects, "-ldl", "-o", str(program)]
        subprocess.run(described, check=True)
        yield inverter, program


@pytest.mark.compilers
@pytest.mark.parametrize(("c", "cpp", "level", "glibc"), list(compilers()))
def test_with_each_compiler(c: list[str], cpp: list[str], level: str, glibc: bool, tmp_path: Path) -> None:
    options = [level if option == "-O2" else option for option in OPTIONS]
    for inverter, program in programs(c, cpp, options, tmp_path):
        expected = installed(inverter)
        assert trace_hash([str(program)]) == expected
        if glibc:
            assert trace_hash([str(program)], **WITHOUT_FMA) == expected
