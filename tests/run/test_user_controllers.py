"""A user's own speed law, in Python or in a shared library, runs in the same loop."""

from __future__ import annotations

import subprocess
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine import config, drive_of, run

import cogless
from cogless import _simulator_f64
from cogless.run.own_law import KnownDrive

PLUGIN = """
#include "cogless/plugin.h"
typedef struct { double kp, ki, ts, integral; char rest[1000]; } pi;
uint32_t cogless_plugin_version(void) { return COGLESS_PLUGIN_VERSION; }
size_t cogless_plugin_state_size(void) { return sizeof(pi); }
int cogless_plugin_init(void *state, const double *params, size_t count, double ts)
{
    pi *s = state;
    const char *byte = state;
    size_t n;
    if (count != 2) return 1;
    for (n = 0; n < sizeof(pi); ++n) if (byte[n] != 0) return 2;
    s->kp = params[0]; s->ki = params[1]; s->ts = ts;
    return 0;
}
void cogless_plugin_step(void *state, const cogless_plugin_input *in, cogless_plugin_output *out)
{
    pi *s = state;
    const double error = in->omega_ref - in->omega_m;
    s->integral += s->ki * s->ts * error;
    out->i_d_ref = 0.0;
    out->i_q_ref = s->kp * error + s->integral;
}
"""

NOTHING_TOLD = dict.fromkeys((field.name for field in fields(KnownDrive)), 0.0)
DISTURBED: dict[str, Any] = {"load": {"harmonics": [{"order": 3, "torque": 0.05, "phase": 0.0}]}}


class Pi:
    def __init__(self) -> None:
        self.integral = 0.0

    def step(self, inputs: Any) -> float:
        error = inputs.omega_ref - inputs.omega_m
        self.integral += 1.0 * 1e-3 * error
        return 0.1 * error + self.integral


def compiled(folder: Path, text: str) -> str:
    (folder / "pi.c").write_text(text)
    include = Path(cogless.__file__).parent / "include"
    subprocess.run(
        ["cc", "-std=c99", "-shared", "-fPIC", "-Wall", "-Werror", f"-I{include}", "pi.c", "-o", "pi.so"],
        cwd=folder,
        check=True,
    )
    return str(folder / "pi.so")


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> str:
    return compiled(tmp_path_factory.mktemp("plugin"), PLUGIN)


def test_python_and_library_laws_equal_the_built_in_one(library: str) -> None:
    built_in = run(DISTURBED, 0.5)
    in_python = run({**DISTURBED, "controller": {"law": "python"}}, 0.5, controller=Pi())
    shared = {"law": "library", "library": library, "params": [0.1, 1.0], "drive": NOTHING_TOLD}
    in_library = run({**DISTURBED, "controller": shared}, 0.5)
    for other in (in_python, in_library):
        assert other["omega_m"] == pytest.approx(built_in["omega_m"], abs=1e-9)


def test_a_library_state_is_copied_with_the_drives(library: str) -> None:
    shared = {"law": "library", "library": library, "params": [0.1, 1.0], "drive": NOTHING_TOLD}
    drive = drive_of(_simulator_f64, config({**DISTURBED, "controller": shared}))
    state = drive.start()
    results = []
    for s in (state, state.copy()):
        recorder = _simulator_f64.Recorder(drive, 1)
        drive.advance(s, recorder, 2000)
        results.append(recorder.take())
    assert np.array_equal(*results)


def test_refused_params_and_missing_library(library: str) -> None:
    shared = {"law": "library", "library": library, "params": [0.1], "drive": NOTHING_TOLD}
    with pytest.raises(ValueError, match="refuses these params"):
        drive_of(_simulator_f64, config({"controller": shared}))
    with pytest.raises(ValueError, match="cannot open shared object file"):
        drive_of(_simulator_f64, config({"controller": {**shared, "library": "/nowhere/law.so"}}))


def test_a_library_may_have_a_mebibyte_of_state(tmp_path: Path) -> None:
    for more in (0, 1):
        folder = tmp_path / str(more)
        folder.mkdir()
        large = PLUGIN.replace("return sizeof(pi);", f"return 1048576 + {more};")
        shared = {"law": "library", "library": compiled(folder, large), "params": [0.1, 1.0]}
        if not more:
            drive_of(_simulator_f64, config({"controller": shared})).start()
            continue
        with pytest.raises(ValueError, match="more than 1 MiB of state"):
            drive_of(_simulator_f64, config({"controller": shared})).start()


def test_a_law_that_returns_no_number_ends_the_run() -> None:
    class Broken:
        def step(self, inputs: Any) -> float:
            return float("nan") if inputs.time > 0.1 else 0.0

    with pytest.raises(RuntimeError, match="returned nan"):
        run({"controller": {"law": "python"}}, 0.5, controller=Broken())


def test_an_exception_in_a_law_reaches_the_caller() -> None:
    class Raising:
        def step(self, _: Any) -> float:
            raise KeyError("gain")

    with pytest.raises(KeyError, match="gain"):
        run({"controller": {"law": "python"}}, 0.1, controller=Raising())
