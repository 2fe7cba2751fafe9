"""What a user may do with trials: a law of their own, faults, a fit."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_studies

import cogless
from cogless.control_library import Status
from cogless.errors import StudyError
from cogless.export.prepared import prepare
from cogless.run.calibrate import calibrate, residual_rows
from cogless.run.simulate import simulate
from cogless.study import TrialStudy

LAWS = """
import math

class Law:
    def __init__(self, kp, kd, gain):
        self.kp, self.kd, self.gain, self.learned = kp, kd, gain, None

    def begin_trial(self, theta_ref):
        self.errors = []
        self.learned = self.learned or [0.0] * len(theta_ref)

    def step(self, inputs):
        turn = 2 * math.pi
        error = inputs.theta_ref - inputs.theta_m
        error -= turn * math.floor(error / turn + 0.5)
        self.errors.append(error)
        return self.kp * error - self.kd * inputs.omega_m + self.learned[len(self.errors) - 1]

    def end_trial(self):
        ahead = self.errors[2:] + self.errors[-1:] * 2
        self.learned = [v + self.gain * e for v, e in zip(self.learned, ahead)]
"""

C = """
#include <math.h>
#include <string.h>
#include "cogless/plugin.h"

typedef struct { double kp, kd, gain, learned[200], error[200]; size_t n; } law;

uint32_t cogless_plugin_version(void) { return COGLESS_PLUGIN_VERSION; }
size_t cogless_plugin_state_size(void) { return sizeof(law); }
int cogless_plugin_init(void *state, const double *params, size_t count, double ts) {
    law *l = state;
    (void)ts;
    if (count != 3) return 1;
    l->kp = params[0]; l->kd = params[1]; l->gain = params[2];
    return 0;
}
void cogless_plugin_begin_trial(void *state, const double *theta_ref, size_t samples) {
    (void)theta_ref;
    ((law *)state)->n = samples == 200 ? 0 : 200;
}
void cogless_plugin_step(void *state, const cogless_plugin_input *in, cogless_plugin_output *out) {
    law *l = state;
    const double turn = 2 * 3.141592653589793;
    double error = in->theta_ref - in->theta_m;
    error -= turn * floor(error / turn + 0.5);
    l->error[l->n] = error;
    out->i_d_ref = 0;
    out->i_q_ref = l->kp * error - l->kd * in->omega_m + l->learned[l->n++];
}
void cogless_plugin_end_trial(void *state) {
    law *l = state;
    for (size_t n = 0; n < 200; ++n) l->learned[n] += l->gain * l->error[n + 2 < 200 ? n + 2 : 199];
}
"""
GAINS = {"kp": 20.0, "kd": 0.3, "gain": 4.0}
OWN = {"controller.own": {"law": "python", "object": "laws.py:Law", "params": GAINS, "learning": True}}


def own(folder: Path, changes: dict[str, Any] | None = None) -> TrialStudy:
    (folder / "laws.py").write_text(LAWS, encoding="utf-8")
    return trial_studies.loaded(folder, {**OWN, "scenario.move.changes": [], **(changes or {})})


def test_a_law_of_one_s_own_learns_from_trial_to_trial(tmp_path: Path) -> None:
    run = simulate(own(tmp_path), "move", "own")
    error = run.metrics["error_rad"]
    assert isinstance(error, list) and error[11] < 0.2 * error[0]
    assert run.design is None and not run.memory
    assert "learned" not in run.trace and "theta_ref" in run.trace


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_same_law_in_a_library_is_the_same_run(tmp_path: Path) -> None:
    (tmp_path / "law.c").write_text(C, encoding="utf-8")
    include = f"{Path(cogless.__file__).parent}/include"
    command = ["cc", "-std=c99", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-I", include, "law.c"]
    subprocess.run([*command, "-o", "law.so", "-lm"], cwd=tmp_path, check=True)
    library = {"law": "library", "library": "law.so", "params": list(GAINS.values())}
    study = own(tmp_path, {"controller.c": library})
    in_python, in_c = (simulate(study, "move", name).trace for name in ("own", "c"))
    assert np.array_equal(in_python.data, in_c.data)


def test_it_has_no_map_to_store_or_to_start_from(tmp_path: Path) -> None:
    (tmp_path / "maps.py").write_text(LAWS + "\n    def learned_map(self):\n        return [1.0, 2.0]\n")
    run = simulate(
        own(tmp_path, {"controller.own": OWN["controller.own"] | {"object": "maps.py:Law"}}), "move", "own"
    )
    assert run.map is None and not run.memory
    with pytest.raises(StudyError) as refused:
        own(tmp_path, {"controller.own": OWN["controller.own"] | {"start": {"map": "a.bin"}}})
    expected = (
        "expected no such key, since what is learned from trial to trial fits only the reference of these "
        "trials: delete start"
    )
    assert str(refused.value).endswith(f"controller.own.start: {expected}")


def test_it_has_no_c_form_and_no_linear_plant(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="has no C form: expected a law of the control library"):
        prepare(own(tmp_path), "move", "own")
    with pytest.raises(StudyError, match=r"controller.own.law: .python.: expected a law of trials, since"):
        trial_studies.loaded(tmp_path, OWN, trial_studies.LINEAR)


def test_a_fault_hits_one_trial_and_learning_goes_on(tmp_path: Path) -> None:
    """A trial in which the angle was missing teaches nothing: the next one is what it would have been."""
    fault = {"kind": "angle-missing", "time": "3.2 s", "duration": "20 ms"}  # in trial 7
    sound, hurt = (
        simulate(trial_studies.loaded(tmp_path, {"scenario.move.changes": [], **changes}), "move", "ilc")
        for changes in ({}, {"scenario.move.faults": [fault]})
    )
    assert np.array_equal(sound.trace.data[: 6 * 200], hurt.trace.data[: 6 * 200])
    status = hurt.trace["status"].astype(int).reshape(12, 200)
    assert np.flatnonzero(np.any(status & Status.ANGLE_LOST, axis=1)).tolist() == [6]
    before, error = (run.metrics["error_rad"] for run in (sound, hurt))
    assert isinstance(before, list) and isinstance(error, list)
    assert error[6] > 1.2 * before[6] and error[7:] == before[6:-1]


@pytest.mark.parametrize(
    ("text", "fault", "line"),
    [
        ("DRIVE", {"kind": "angle-stuck", "time": "6 s", "duration": "1 s"},
            'scenario.move.faults.0.time: "6 s": expected a time within the scenario\'s 6 s'),
        ("DRIVE", {"kind": "bus-voltage", "time": "1 s", "duration": "1 s", "voltage": "9 V"},
            'faults.0.kind: "bus-voltage": expected a fault of the angle, since an ideal current loop '
            'measures no'),
        ("LINEAR", {"kind": "angle-stuck", "time": "1 s", "duration": "1 s"},
            "scenario.cycle.faults: ...: expected no faults, since a linear plant has no drive"),
    ],
)  # fmt: skip
def test_a_fault_that_can_not_be_is_one_line(
    tmp_path: Path, text: str, fault: dict[str, Any], line: str
) -> None:
    scenario = "move" if text == "DRIVE" else "cycle"
    with pytest.raises(StudyError) as error:
        trial_studies.loaded(tmp_path, {f"scenario.{scenario}.faults": [fault]}, getattr(trial_studies, text))
    assert all(part in str(error.value) for part in line.split("..."))


def test_a_parameter_is_fitted_to_the_error_of_trials(tmp_path: Path) -> None:
    """The friction that was there comes out of the errors that it left, phase by phase."""
    changes = {
        "metric": [{"name": "first", "kind": "first-rms", "signal": "theta_error"}],
        "scenario.move.trials": 3,
        "scenario.move.changes": [{"trial": 3, "load_steps": [[40, "0.5 N*m"]]}],
        "controller.feedback.K_s": [-30, -1, 0.3],
        "drive.position_sensor": {"kind": "ideal"},
    }
    truth = {**changes, "scenario.move.override": {"mechanics.viscous_friction": "0.02 N*m*s/rad"}}
    wanted = simulate(trial_studies.loaded(tmp_path, truth), "move", "feedback").metrics["first_rad"]
    assert isinstance(wanted, list) and len(wanted) == 2
    target = {"scenario": "move", "controller": "feedback", "metric": "first"}
    friction = {"key": "mechanics.viscous_friction", "scenario": "move"}
    told = {
        "parameters": [{**friction, "lower": "0 N*m*s/rad", "upper": "0.1 N*m*s/rad"}],
        "targets": [{**target, "value": [f"{value!r} rad" for value in wanted]}],
    }
    fit = calibrate(trial_studies.loaded(tmp_path, {**changes, "calibration": told}))
    assert [row[1] for row in residual_rows(fit)] == ["first 1", "first 2"]
    assert isinstance(fit.study, TrialStudy)
    (mechanics, _) = (phase.mechanics for phase in fit.study.hardware("move"))
    assert mechanics.viscous_friction == pytest.approx(0.02, rel=1e-3)
    with pytest.raises(StudyError, match=r"calibration.targets.0.value: .*: expected 2 values"):
        one = {**told, "targets": [{**target, "value": "1 rad"}]}
        trial_studies.loaded(tmp_path, {**changes, "calibration": one})
