"""What a user's own law is told and may tell, in Python and in a shared library: drive, params with units,
its learned part, and its step at the current loop's rate."""

from __future__ import annotations

import subprocess
from dataclasses import fields
from math import pi, tau
from pathlib import Path

import numpy as np
import pytest

import cogless
from cogless.errors import StudyError
from cogless.results import Run
from cogless.run.own_law import KnownDrive, known_drive

STUDY = """
title = "Own laws"

[motor]
datasheet = "liu2018"

[mechanics]
inertia = "3e-4 kg*m^2"

[drive]
rates = { current_loop = "10 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "500 Hz", current_limit = "5 A" }
inverter = { bus_voltage = "310 V" }

[scenario.slow]
duration = "20 ms"
reference = "60 rpm"
initial_speed = "60 rpm"

[trace]
rate = "10 kHz"

[controller.python]
law = "python"
object = "law.py:Law"
learning = true
params = { part = "0.25 mA", per = ["2 A*s/rad", 3], word = "5 lights" }

[controller.c]
law = "library"
library = "law.so"
learning = true
params = ["0.25 mA", -1]
"""

PYTHON = """
from math import cos


class Law:
    def __init__(self, part, per, word, drive):
        assert (part, per, word) == (0.25e-3, [2.0, 3], "5 lights")
        self.part, self.i_q_learned, self.periods = part, 0.0, 0

    def step(self, inputs):
        self.i_q_learned = 100 * self.part * cos(inputs.theta_m)
        return self.i_q_learned

    def current_step(self, inputs, i_d_ref, i_q_ref):
        self.periods += 1
        return i_d_ref + self.part, i_q_ref + self.part * cos(inputs.theta_m)
"""

LIBRARY = """
#include "cogless/plugin.h"
#include <math.h>
typedef struct { double part, i_q_learned, told; int field; } law;
uint32_t cogless_plugin_version(void) { return COGLESS_PLUGIN_VERSION; }
size_t cogless_plugin_state_size(void) { return sizeof(law); }
int cogless_plugin_init(void *state, const double *params, size_t count, double ts)
{
    law *s = state;
    (void)ts;
    s->part = params[0]; s->field = (int)params[1];
    return count != 2;
}
int cogless_plugin_design(void *state, const cogless_plugin_drive *drive)
{
    law *s = state;
    if (s->field >= 0) s->told = ((const double *)drive)[s->field];
    return drive->current_limit > 6.0;
}
double cogless_plugin_i_q_learned(const void *state)
{
    const law *s = state;
    return s->field >= 0 ? s->told : s->i_q_learned;
}
void cogless_plugin_step(void *state, const cogless_plugin_input *in, cogless_plugin_output *out)
{
    law *s = state;
    s->i_q_learned = in->off ? 99.0 : 100.0 * s->part * cos(in->theta_m);
    out->i_q_ref = s->i_q_learned;
}
void cogless_plugin_current_step(void *state, const cogless_plugin_input *in, cogless_plugin_output *out)
{
    const law *s = state;
    out->i_d_ref += s->part;
    out->i_q_ref += s->part * cos(in->theta_m);
}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("own")
    (folder / "law.c").write_text(LIBRARY)
    (folder / "law.py").write_text(PYTHON)
    (folder / "study.toml").write_text(STUDY)
    include = Path(cogless.__file__).parent / "include"
    flags = ["-std=c99", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", f"-I{include}"]
    subprocess.run(["cc", *flags, "law.c", "-o", "law.so", "-lm"], cwd=folder, check=True)
    return folder


@pytest.fixture(scope="module")
def runs(folder: Path) -> dict[str, Run]:
    results = cogless.run_study(cogless.load(folder / "study.toml"))
    return {run.controller: run for run in results.runs}


@pytest.mark.parametrize("name", ["python", "c"])
def test_the_learned_part_is_what_the_law_tells(runs: dict[str, Run], name: str) -> None:
    trace = runs[name].trace
    told, periods = trace["term_learned"], trace["theta_m"][::10]
    assert np.ptp(told.reshape(-1, 10), axis=1).max() == 0  # held between the speed loop's steps
    assert told[::10] == pytest.approx(0.025 * np.cos(periods), rel=1e-5)


@pytest.mark.parametrize("name", ["python", "c"])
def test_a_step_at_the_current_loops_rate_acts_each_period_from_where_the_last_left_off(
    runs: dict[str, Run], name: str
) -> None:
    trace = runs[name].trace
    added = np.diff(trace["i_q_ref"].reshape(-1, 10), axis=1)
    angle = trace["theta_m"].reshape(-1, 10)[:, 1:]
    assert added == pytest.approx(0.25e-3 * np.cos(angle), rel=1e-3)
    assert trace["i_d_ref"].reshape(-1, 10)[0] == pytest.approx(0.25e-3 * np.arange(1, 11), rel=1e-5)


def test_python_and_c_agree_in_all_of_it(runs: dict[str, Run]) -> None:
    for name in ("omega_m", "i_q_ref", "i_d_ref", "term_learned"):
        assert np.array_equal(runs["python"].trace[name], runs["c"].trace[name])


def test_a_law_is_told_the_drive_as_its_controller_knows_it(folder: Path) -> None:
    overridden = {"scenario.slow.override.mechanics.inertia": "9e-4 kg*m^2"}  # which it isn't told
    told = {}
    for n, field in enumerate(fields(KnownDrive)):
        study = cogless.load(folder / "study.toml", {"controller.c.params": [0, n], **overridden})
        run = cogless.run_study(study, only=["*/c"]).runs[0]
        told[field.name] = float(run.trace["term_learned"][-1])
    motor = study.motor.star()
    assert told == pytest.approx(
        {
            "pole_pairs": motor.pole_pairs,
            "phases": 3,
            "slots": 12,
            "R_s": motor.R_s,
            "L_d": motor.L_d,
            "L_q": motor.L_q,
            "psi_f": motor.psi_f,
            "torque_constant": 1.5 * motor.pole_pairs * motor.psi_f,
            "inertia": 3e-4,
            "current_limit": 5,
            "current_bandwidth": tau * 500,
            "current_period": 1e-4,
            "delay": 1.5e-4,
        }
    )


def test_a_motor_that_does_not_tell_its_slots_has_none(folder: Path) -> None:
    study = cogless.load(folder / "study.toml")
    untold = study.motor.model_copy(update={"slots": None})
    assert known_drive(study.model_copy(update={"motor": untold})).slots == 0


def test_a_library_may_refuse_the_drive(folder: Path) -> None:
    study = cogless.load(folder / "study.toml", {"drive.current_loop.current_limit": "7 A"})
    with pytest.raises(StudyError, match="cogless_plugin_design refuses this drive"):
        cogless.run_study(study, only=["*/c"])


def test_a_library_is_told_when_it_is_off(folder: Path) -> None:
    fault = {"kind": "angle-missing", "time": "4 ms", "duration": "8 ms"}
    study = cogless.load(folder / "study.toml", {"scenario.slow.faults": [fault]})
    trace = cogless.run_study(study, only=["*/c"]).runs[0].trace
    off = trace["term_learned"] == 99
    assert off.any() and not off[:40].any()


def test_a_law_that_holds_a_position_has_the_signals_of_its_angle(folder: Path) -> None:
    study = cogless.load(folder / "study.toml", {"controller.c.position": True})
    trace = cogless.run_study(study, only=["*/c"]).runs[0].trace
    assert trace["theta_ref"] == pytest.approx(2 * pi * trace["time"], abs=1e-9)


def test_params_are_numbers_with_known_units(folder: Path) -> None:
    with pytest.raises(StudyError) as refused:
        cogless.load(folder / "study.toml", {"controller.c.params": [1, "2 lights"]})
    expected = 'expected a number, or one with a known unit, such as "0.2 A*s/rad"'
    assert str(refused.value).endswith(f'controller.c.params.1: "2 lights": {expected}')


def test_over_a_bus_no_law_acts_at_the_current_loops_rate(folder: Path) -> None:
    study = cogless.load(folder / "study.toml", {"drive.bus.delay_command": "1 ms"})
    with pytest.raises(StudyError, match=r"expected a law without current_step\(\), which runs in the drive"):
        cogless.run_study(study, only=["*/python"])


def test_the_current_step_may_fail_with_its_line(folder: Path) -> None:
    (folder / "wrong.py").write_text(PYTHON.replace("self.periods += 1", "self.periods += None"))
    study = cogless.load(folder / "study.toml", {"controller.python.object": "wrong.py:Law"})
    with pytest.raises(StudyError, match=r"wrong.py line 15: TypeError"):
        cogless.run_study(study, only=["*/python"])


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ('float("nan")', "nan: expected a finite current"),
        ('float("-inf")', "-inf: expected a finite current"),
        ('"many"', "expected a number"),
        ("None", "expected a number"),
    ],
)
def test_a_learned_current_that_is_no_number_ends_the_run(tmp_path: Path, value: str, said: str) -> None:
    law = PYTHON.replace("100 * self.part * cos(inputs.theta_m)", value).replace(
        "return self.i_q_learned", "return 0.0"
    )
    (tmp_path / "law.py").write_text(law)
    (tmp_path / "study.toml").write_text(STUDY.partition("[controller.c]")[0])
    with pytest.raises(StudyError) as error:
        cogless.run_study(cogless.load(tmp_path / "study.toml"))
    where = f"{tmp_path / 'study.toml'}: controller.python: scenario slow at 0 s"
    assert str(error.value) == f"{where}: i_q_learned: {said}"


def test_a_learned_current_of_a_library_that_is_no_number_ends_the_run(tmp_path: Path) -> None:
    library = LIBRARY.replace("return s->field >= 0 ? s->told : s->i_q_learned;", "(void)s; return NAN;")
    (tmp_path / "law.c").write_text(library)
    (tmp_path / "study.toml").write_text(
        STUDY.replace(STUDY[STUDY.index("[controller.python]") : STUDY.index("[controller.c]")], "")
    )
    include = Path(cogless.__file__).parent / "include"
    flags = ["-std=c99", "-shared", "-fPIC", f"-I{include}"]
    subprocess.run(["cc", *flags, "law.c", "-o", "law.so", "-lm"], cwd=tmp_path, check=True)
    with pytest.raises(StudyError, match=r"at 0 s: i_q_learned: -?nan: expected a finite current$"):
        cogless.run_study(cogless.load(tmp_path / "study.toml"))
