"""The C of a controller whose plant is linear: it repeats the simulation, and controls a plant in NumPy."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_studies
from test_export_c import ASKS, compiled, self_tested
from typer.testing import CliRunner

from cogless.cli import app
from cogless.export.c.linear import export_linear
from cogless.run.simulate import simulate

GALVO = """
title = "A mirror on a galvanometer, line after line"
[plant]
period = "50 us"
states = ["angle", "rate"]
A = [[0, 1], [0, "-B / J"]]
B = [0, "K_t / J"]
C = [1, 0]
input_limit = 8.0
[plant.parameter]
J = { range = [2.5e-7, 3.5e-7] }
B = { range = [1e-5, 3e-5] }
K_t = 0.006
[design]
discretisation = "exact"
state_weight = [4e6, 0.1, 100]
input_weight = 1.0
initial_state = [0.001, 0, 0]
[scenario.scan]
duration = "10 ms"
trials = 5
reference = [["0.5 ms", 0], ["3 ms", 0.05], ["6 ms", 0.05], ["9 ms", 0]]
changes = [{ trial = 3, override = { J = 3.5e-7 }, load_steps = [[50, 0.3]] }]
[controller]
feedback = { law = "trial-ilc", learning = false }
ilc = { law = "trial-ilc", q_filter = { cutoff = "400 Hz", acts_on = "signal" } }
observer = { law = "observer-ilc" }
matrix = { law = "norm-optimal" }
[[metric]]
name = "error"
kind = "rms"
signal = "y_error"
"""
MAIN = """
#include <stdio.h>
#include "NAME_controller.h"
int main(void)
{
    static NAME_controller c;
    static cgl_real y_ref[UPPER_SAMPLES];
    if (NAME_init(&c) != CGL_OK) return 1;
    while (fread(y_ref, sizeof y_ref, 1, stdin) == 1) {
        NAME_begin(&c, y_ref);
        for (unsigned p = 0; p < UPPER_SAMPLES; ++p) {
            cgl_trial_input in = {.learn = true};
            cgl_trial_output out;
            if (fread(in.x, sizeof in.x[0], UPPER_STATES, stdin) != UPPER_STATES) return 2;
            NAME_step(&c, &in, &out);
            fwrite(&out.u, sizeof out.u, 1, stdout);
            fflush(stdout);
        }
        NAME_end(&c);
    }
    return 0;
}
"""
LAWS = ("feedback", "ilc", "observer", "matrix")


@pytest.mark.parametrize("controller", LAWS)
def test_the_self_test_of_a_linear_plant_repeats_the_simulation(tmp_path: Path, controller: str) -> None:
    study = trial_studies.loaded(tmp_path, text=GALVO)
    export_linear(study, controller, tmp_path / "out")
    assert self_tested(tmp_path / "out") == (0, f"{controller}: 3 trials of 200 samples, all bits equal\n")
    manifest = json.loads((tmp_path / "out" / "export.json").read_text())
    assert (manifest["scenario"], manifest["law"]) == ("scan", "trial")


def test_a_plant_of_other_order_and_a_long_trial(tmp_path: Path) -> None:
    """A trial of more samples than a self-test has by itself: it has two, so that what is learned counts."""
    changes: dict[str, Any] = {"plant.period": "2 ms", "design.discretisation": "exact"}
    changes |= {"controller.ilc.q_filter": {"cutoff": "1 Hz", "acts_on": "signal"}}
    study = trial_studies.loaded(tmp_path, changes, text=trial_studies.LINEAR)
    export_linear(study, "ilc", tmp_path / "out")
    assert self_tested(tmp_path / "out") == (0, "ilc: 2 trials of 2500 samples, all bits equal\n")


def test_the_self_test_finds_another_constant(tmp_path: Path) -> None:
    export_linear(trial_studies.loaded(tmp_path, text=GALVO), "ilc", tmp_path / "out")
    source = tmp_path / "out" / "ilc_controller.c"
    text = source.read_text()
    (line,) = (line for line in text.splitlines() if line.strip().startswith(".k_3 = "))
    other = line.replace(line.split("=")[1].split(",")[0], " 0.1")
    source.write_text(text.replace(line, other))
    code, out = self_tested(tmp_path / "out")
    assert code == 1 and re.fullmatch(f"ilc: trial 2 differs at sample \\d+\n{ASKS}", out)


@pytest.mark.parametrize("controller", LAWS)
def test_the_exported_law_controls_a_plant_in_numpy(tmp_path: Path, controller: str) -> None:
    """All trials, with the change of plant and load: inputs and errors are the simulation's."""
    study = trial_studies.loaded(tmp_path, text=GALVO)
    export_linear(study, controller, tmp_path / "out")
    main = tmp_path / "main.c"
    main.write_text(MAIN.replace("NAME", controller).replace("UPPER", controller.upper()))
    program = compiled(tmp_path / "out", main)
    trace = simulate(study, "scan", controller).trace
    references = trace["y_ref"].reshape(5, -1)
    inputs = np.zeros_like(references)
    with subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as running:
        assert running.stdin is not None and running.stdout is not None
        for trial, y_ref in enumerate(references):
            running.stdin.write(y_ref.tobytes())
            J, x = (3.5e-7 if trial >= 2 else 3e-7), np.zeros(2)
            pole = np.exp(-2e-5 / J * 50e-6)
            for p in range(len(y_ref)):
                running.stdin.write(x.tobytes())
                running.stdin.flush()
                (u,) = np.frombuffer(running.stdout.read(8))
                inputs[trial, p] = u
                drive = 0.006 * (u - (0.3 if trial >= 2 and p >= 50 else 0.0)) / 2e-5  # final rate
                rate = drive + (x[1] - drive) * pole
                x = np.array([x[0] + drive * 50e-6 + (x[1] - drive) * (1 - pole) * J / 2e-5, rate])
        running.stdin.close()
        assert running.wait(timeout=10) == 0
    simulated = trace["u"].reshape(5, -1)
    assert np.max(np.abs(inputs - simulated)) < 1e-6 * np.max(np.abs(simulated))


def test_the_command_exports_a_linear_plant_and_says_how_large_a_matrix_is(tmp_path: Path) -> None:
    path = trial_studies.write(tmp_path, GALVO)

    def said(controller: str) -> str:
        words = [
            "export", str(path), "--controller", controller, "--to", "c", "-o", str(tmp_path / controller),
        ]  # fmt: skip
        found = CliRunner().invoke(app, words)
        assert found.exit_code == 0, found.exception
        return found.stdout

    assert said("ilc") == f"Export: {tmp_path / 'ilc' / 'README.md'}\n"
    size, export = said("matrix").splitlines()
    whole = sum(
        p.stat().st_size for p in (tmp_path / "matrix").rglob("*") if p.is_file() and p.name != "export.json"
    )
    source = (tmp_path / "matrix" / "matrix_controller.c").stat().st_size
    assert size == (
        f"Size: {whole / 1e6:.3g} MB of files, {source / 1e6:.3g} MB of them matrix_controller.c; "
        "the learning matrix takes 0.32 MB of flash."
    )
    assert export == f"Export: {tmp_path / 'matrix' / 'README.md'}"


def test_the_size_is_told_before_anything_is_written(tmp_path: Path) -> None:
    study, target = trial_studies.loaded(tmp_path, text=GALVO), tmp_path / "out"
    before: list[bool] = []
    export_linear(study, "matrix", target, announce=lambda _: before.append(target.exists()))
    assert before == [False] and target.exists()
