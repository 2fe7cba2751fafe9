"""Runs of a study on the engine: what comes out, what fails and how, what is kept."""

import json
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine import unpacked

import studies
from cogless.control_library import C_LAWS
from cogless.errors import StudyError
from cogless.results import Results
from cogless.results.results_json import to_dict
from cogless.run import carry_out as room
from cogless.run import side_by_side
from cogless.run.drive_config import engine_config
from cogless.run.simulate import RunDefect, RunError, rollout, run_study, runs_of, simulate
from cogless.study import Study, changed, load

TABLE = {
    "law": "anti-cogging",
    "kp": "0.015 A/rpm",
    "ki": "0.3 A/rpm/s",
    "cells": 480,
    "calibration": {"speed": "20 rpm", "position_gain": "20 1/s"},
}
LEARNING = {"memory": "angle", "period": "electrical", "forgetting": 0.9}
ILC = {**LEARNING, "law": "pi-ilc", "kp": "0.015 A/rpm", "ki": "0.3 A/rpm/s", "gain": "0.004 A/rpm"}
ROBUST = {
    **LEARNING,
    "law": "robust-ilc",
    "b": "3900 rpm/s/A",
    "c": "5 1/s",
    "g": "500 rpm/s",
    "eta": "180 1/s",
    "q": 0.1,
    "beta_1": "0.4 rpm/s",
    "beta_2": "0.3 1/s",
    "gamma": "3 1/s^2",
}
LAWS = """
class Pi:
    def __init__(self, kp=0.14, ki=2.9):
        self.kp, self.ki, self.sum = kp, ki, 0.0

    def step(self, inputs):
        error = inputs.omega_ref - inputs.omega_m
        self.sum += self.ki * 1e-3 * error
        return self.kp * error + self.sum


class Breaks:
    def step(self, inputs):
        if inputs.time > 0.05:
            return inputs.nothing
        return 0.0


class Nan:
    def step(self, inputs):
        return float("nan") if inputs.time > 0.05 else 0.0


class Text:
    def step(self, inputs):
        return "1 A"


class Nothing:
    def step(self, inputs):
        pass


class Three:
    def step(self, inputs):
        return 0.0, 0.0, 0.0


class Exits:
    def step(self, inputs):
        raise SystemExit("enough")


class Interrupts:
    def step(self, inputs):
        raise KeyboardInterrupt


class NoStep:
    pass
"""


def with_law(folder: Path, name: str, params: dict[str, Any] | None = None) -> Any:
    (folder / "laws.py").write_text(LAWS, encoding="utf-8")
    law = {"law": "python", "object": f"laws.py:{name}", "params": params or {}}
    return studies.study(folder, {"controller.mine": law})


def line(error: pytest.ExceptionInfo[StudyError], folder: Path) -> str:
    return str(error.value).replace(str(folder) + "/", "")


def test_a_switched_drive_has_rows_between_its_samples(tmp_path: Path) -> None:
    """The run stays as it is."""
    switched = {"drive.inverter.kind": "switched", "drive.inverter.pwm": "edge"}
    plain = simulate(studies.study(tmp_path, switched), "step", "pi").trace
    study = studies.study(tmp_path, {**switched, "trace.rate": "60 kHz"})
    finer = simulate(study, "step", "pi").trace
    assert len(finer) == 4 * len(plain) and finer.period == pytest.approx(1 / 60_000)
    assert all(np.array_equal(plain[name], finer[name][::4]) for name in plain.names)


def test_a_run_has_trace_and_metrics(tmp_path: Path) -> None:
    study = studies.study(tmp_path, {"trace.rate": "1 kHz"})
    shares: list[float] = []
    run = simulate(study, "low", "pi", shares.append)
    assert len(run.trace) == 400
    assert run.trace.period == pytest.approx(1e-3)
    assert set(run.metrics) == {"speed_ripple_rad_s", "speed_rad_s"}
    assert run.metrics["speed_ripple_rad_s"] > 0
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert run.memory == {}


def test_all_runs_come_in_the_studys_order_whatever_the_jobs(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    one, two = run_study(study, jobs=1), run_study(study, jobs=4)
    names = [("low", "pi"), ("low", "fair"), ("step", "pi"), ("step", "fair")]
    assert [(run.scenario, run.controller) for run in one.runs] == names
    assert [run.metrics for run in one.runs] == [run.metrics for run in two.runs]
    assert not one.interrupted


def test_only_chooses_runs(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    assert runs_of(study, ["step/pi"]) == [("step", "pi")]
    assert runs_of(study, ["*/fair", "low/*"]) == [("low", "pi"), ("low", "fair"), ("step", "fair")]
    with pytest.raises(StudyError) as error:
        runs_of(study, ["low/robust"])
    expected = "expected SCENARIO/CONTROLLER of low/pi, low/fair, step/pi, step/fair"
    assert line(error, tmp_path) == f'study.toml: --only: "low/robust": {expected}'
    for half, whole in (("step", "step/*"), ("fair", "*/fair")):
        with pytest.raises(StudyError) as error:
            runs_of(study, [half])
        told = f'"{half}": expected SCENARIO/CONTROLLER, perhaps "{whole}"'
        assert line(error, tmp_path) == f"study.toml: --only: {told}"


def test_unknown_names(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    with pytest.raises(StudyError) as error:
        simulate(study, "high", "pi")
    assert line(error, tmp_path) == 'study.toml: scenario: "high": expected one of low, step'


def test_single_and_double_precision_nearly_agree(tmp_path: Path) -> None:
    single = simulate(studies.study(tmp_path), "low", "pi")
    double = simulate(studies.study(tmp_path, {"drive.precision": "double"}), "low", "pi")
    a, b = single.trace["omega_m"], double.trace["omega_m"]
    assert not np.array_equal(a, b)
    assert np.max(np.abs(a - b)) < 1e-3 * np.max(np.abs(b))


def test_an_anti_cogging_table_is_learned_before_the_run(tmp_path: Path) -> None:
    study = studies.study(tmp_path, {"controller.table": TABLE, "motor.cogging.0.torque": 20})
    run, plain = simulate(study, "low", "table"), simulate(study, "low", "pi")
    assert run.memory["frame"] == "mechanical"
    assert len(run.memory["current"]) == len(run.memory["angle"]) == 480
    # 20 mN*m at K_t = 0.408 N*m/A
    assert np.max(np.abs(run.memory["current"])) == pytest.approx(0.049, rel=0.2)
    assert run.metrics["speed_ripple_rad_s"] < 0.5 * plain.metrics["speed_ripple_rad_s"]


def test_a_commissioning_run_that_does_not_get_round(tmp_path: Path) -> None:
    stuck = {**TABLE, "kp": 1e-6, "ki": 0.0}
    study = studies.study(tmp_path, {"controller.table": stuck, "mechanics.coulomb_friction": "0.1 N*m"})
    with pytest.raises(StudyError) as error:
        simulate(study, "low", "table")
    start = (
        "study.toml: controller.table.calibration: scenario low: the calibration run is not done "
        "after 20.3 s: "
    )
    assert line(error, tmp_path) == start + "expected kp and ki that hold the run's speed"


@pytest.mark.parametrize("law", [ILC, ROBUST], ids=["pi-ilc", "robust-ilc"])
def test_a_learning_law_keeps_its_limit_and_its_terms(tmp_path: Path, law: dict[str, Any]) -> None:
    study = studies.study(tmp_path, {"controller.learning": law})
    memory = unpacked(engine_config(study, "low", "learning"))["controller"]["config"]["memory"]
    limit = abs(study.controller["learning"].unit) * study.drive.current_loop.current_limit
    assert memory["limit"] == pytest.approx([limit, 0, 0])  # of one layer
    run = simulate(study, "low", "learning")
    terms = [name for name in run.trace.names if name.startswith("term_")]
    assert terms == [term.signal for term in C_LAWS[law["law"]].terms]
    assert run.memory["frame"] == "electrical"
    assert np.any(run.memory["current"])


# Laws in Python


def test_a_python_law_drives_the_motor(tmp_path: Path) -> None:
    run = simulate(with_law(tmp_path, "Pi", {"kp": 0.1432394, "ki": 2.864789}), "low", "mine")
    built_in = simulate(studies.study(tmp_path), "low", "pi")
    assert np.max(np.abs(run.trace["omega_m"] - built_in.trace["omega_m"])) < 0.01


@pytest.mark.parametrize(
    ("name", "params", "expected"),
    [
        ("Missing", {}, "expected laws.py to define Missing"),
        ("NoStep", {}, "expected a class with a method step(inputs)"),
    ],
)
def test_a_law_that_is_none(tmp_path: Path, name: str, params: dict[str, Any], expected: str) -> None:
    with pytest.raises(StudyError) as error:
        simulate(with_law(tmp_path, name, params), "low", "mine")
    assert line(error, tmp_path) == f'study.toml: controller.mine.object: "laws.py:{name}": {expected}'


def test_a_law_whose_params_do_not_fit(tmp_path: Path) -> None:
    with pytest.raises(
        StudyError, match=r"TypeError: .*kd.*: expected a class that takes the controller's params"
    ):
        simulate(with_law(tmp_path, "Pi", {"kd": 1}), "low", "mine")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    study = studies.study(tmp_path, {"controller.mine": {"law": "python", "object": "x.py:Law"}})
    with pytest.raises(StudyError, match=r'"x\.py:Law": expected a file at '):
        simulate(study, "low", "mine")


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("Nan", "0.051 s: returned nan"),
        (
            "Breaks",
            "0.051 s: laws.py line 15: AttributeError: 'LawInput' object has no attribute 'nothing': "
            "expected one of time, omega_ref, omega_m, theta_m, i_d, i_q, i_limit, ts, learn",
        ),
        ("Text", "0 s: laws.py: step() returns i_q_ref or (i_d_ref, i_q_ref)"),
        ("Nothing", "0 s: laws.py: step() returns i_q_ref or (i_d_ref, i_q_ref)"),
        ("Three", "0 s: laws.py: step() returns i_q_ref or (i_d_ref, i_q_ref)"),
        ("Exits", "0 s: laws.py line 41: calls exit(enough)"),
    ],
)
def test_a_law_that_fails_names_controller_and_time(tmp_path: Path, name: str, cause: str) -> None:
    with pytest.raises(StudyError) as error:
        simulate(with_law(tmp_path, name), "low", "mine")
    assert line(error, tmp_path).startswith(f"study.toml: controller.mine: scenario low at {cause}")


def test_the_line_of_a_law_is_named_whatever_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_law(tmp_path, "Breaks")
    monkeypatch.chdir(tmp_path)
    study = load("study.toml", {"controller.mine": {"law": "python", "object": "laws.py:Breaks"}})
    with pytest.raises(StudyError, match=r"at 0\.051 s: laws\.py line 15: AttributeError"):
        simulate(study, "low", "mine")


def test_a_law_that_exits_on_import(tmp_path: Path) -> None:
    (tmp_path / "laws.py").write_text("import sys\nsys.exit(3)\n", encoding="utf-8")
    study = studies.study(tmp_path, {"controller.mine": {"law": "python", "object": "laws.py:Law"}})
    with pytest.raises(StudyError, match=r'"laws\.py:Law": laws\.py line 2: calls exit\(3\)'):
        simulate(study, "low", "mine")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"metric.1.window": ["0.1 s", "0.2 s"]},
            'metric.1.window: ["0.1 s", "0.2 s"]: expected a window of 1 or more electrical revolutions at '
            'the top speed of scenario "low", not of 0.4'),
        ({"metric.1.last": "0.2 s"},
            'metric.1.last: "0.2 s": expected a window of 1 or more electrical revolutions at the top '
            'speed of scenario "low", not of 0.8'),
        ({"scenario.low.reference": "0 rpm", "scenario.low.initial_speed": "0 rpm"},
            "metric.1.window: expected a window of 1 or more electrical revolutions at the top speed "
            'of scenario "low", not of 0'),
        ({"metric.1.order": [1.5]}, "metric.1.window: expected a window of 2 or more electrical revolutions"),
        ({"metric.0.window": None, "metric.0.last": "1 us"},
            'metric.0.last: "1 us": expected a window of 10 or more rows of the trace'),
        ({"scenario.low.duration": "0.5 ms"}, 'scenario.low.duration: "0.5 ms": expected 0.000666667 s or '),
        ({"scenario.step.events.1.time": "0.1001 s"}, "metric.2.event: "),
    ],
)  # fmt: skip
def test_a_metric_that_cannot_be_taken_is_refused_before_the_run(
    tmp_path: Path, changes: dict[str, Any], expected: str
) -> None:
    text = studies.BASE
    for key in [key for key, value in changes.items() if value is None]:
        assert key == "metric.0.window"
        text = text.replace('window = ["0.1 s", "0.3 s"]\n', "")
    with pytest.raises(StudyError) as error:
        studies.study(tmp_path, {key: value for key, value in changes.items() if value is not None}, text)
    assert line(error, tmp_path).startswith(f"study.toml: {expected}")


def test_a_metric_that_a_run_does_not_yield_is_null(tmp_path: Path) -> None:
    """A speed that swings about zero asks for revolutions, and ends where it began."""
    swing = {"offset": "0 rpm", "amplitude": "60 rpm", "frequency": "10 Hz"}
    study = studies.study(tmp_path, {"scenario.low.reference": swing})
    run = simulate(study, "low", "pi")
    assert np.isnan(run.metrics["speed_rad_s"]).all() and len(run.metrics["speed_rad_s"]) == 3
    assert np.isfinite(run.metrics["speed_ripple_rad_s"])
    assert to_dict(Results(study, [run]))["runs"][0]["metrics"]["speed_rad_s"] == [None, None, None]


def test_names_that_collide_in_results_json(tmp_path: Path) -> None:
    metric = [
        {"name": "a", "kind": "ripple-rms", "signal": "omega_m"},
        {"name": "a_rad_s", "kind": "peak-to-peak", "signal": "omega_m"},
    ]
    with pytest.raises(StudyError) as error:
        studies.study(tmp_path, {"metric": metric})
    expected = 'expected a name that no other metric of scenario "low" has in results.json: a_rad_s'
    assert line(error, tmp_path) == f'study.toml: metric.1.name: "a_rad_s": {expected}'
    apart = [{**metric[0], "scenarios": ["low"]}, {**metric[1], "scenarios": ["step"]}]
    with pytest.raises(StudyError, match=r"metric\.1\.name: .*expected the same kind, signal"):
        studies.study(tmp_path, {"metric": apart})


def test_an_events_time_may_be_written_in_another_unit(tmp_path: Path) -> None:
    """A unit may round."""
    run = simulate(studies.study(tmp_path), "step", "pi")
    rounded = studies.study(tmp_path, {"metric.2.event": "0.10000000000001 s"})
    assert simulate(rounded, "step", "pi").metrics["recovery_s"] == pytest.approx(run.metrics["recovery_s"])


def test_a_law_may_have_dataclasses_and_a_helper_beside_it(tmp_path: Path) -> None:
    source = """
from __future__ import annotations
from dataclasses import dataclass
from law_helper import gain

@dataclass
class Law:
    kp: float = 0.1

    def step(self, inputs):
        return gain * self.kp * (inputs.omega_ref - inputs.omega_m)
"""
    runs = []
    for name, gain in (("one", 1.0), ("two", 2.0)):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "law.py").write_text(source, encoding="utf-8")
        (folder / "law_helper.py").write_text(f"gain = {gain}\n", encoding="utf-8")
        kp = {"kp": 0.2 / gain}
        study = studies.study(
            folder, {"controller.mine": {"law": "python", "object": "law.py:Law", "params": kp}}
        )
        runs.append(simulate(study, "low", "mine"))
    assert runs[0].metrics == runs[1].metrics
    assert "law_helper" not in sys.modules
    assert str(tmp_path / "one") not in sys.path


def test_a_law_beside_an_environment_leaves_its_packages_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packages = tmp_path / "venv" / "packages"
    packages.mkdir(parents=True)
    (packages / "installed_for_a_law.py").touch()
    monkeypatch.syspath_prepend(str(packages))
    law = "import installed_for_a_law\nclass Law:\n    def step(self, i):\n        return 0.0\n"
    (tmp_path / "law.py").write_text(law, encoding="utf-8")
    simulate(
        studies.study(tmp_path, {"controller.mine": {"law": "python", "object": "law.py:Law"}}), "low", "mine"
    )
    assert sys.modules.pop("installed_for_a_law", None) is not None


def test_laws_load_side_by_side(tmp_path: Path) -> None:
    (tmp_path / "law_helper.py").write_text("gain = 0.1\n", encoding="utf-8")
    law = "from law_helper import gain\nclass Law:\n    def step(self, i):\n        return gain\n"
    (tmp_path / "law.py").write_text(law, encoding="utf-8")
    mine = {"law": "python", "object": "law.py:Law"}
    study = studies.study(tmp_path, {f"controller.c{n}": mine for n in range(8)})
    results = run_study(study, ["low/c*"], jobs=8)
    assert len(results.runs) == 8


def test_a_law_that_does_not_load(tmp_path: Path) -> None:
    (tmp_path / "laws.py").write_text("import no_such_thing\n", encoding="utf-8")
    study = studies.study(tmp_path, {"controller.mine": {"law": "python", "object": "laws.py:Law"}})
    with pytest.raises(StudyError) as error:
        simulate(study, "low", "mine")
    assert line(error, tmp_path).endswith(
        "laws.py line 1: ModuleNotFoundError: No module named 'no_such_thing': "
        "expected a file that loads; it may import installed modules, or files next to it"
    )


def test_a_library_that_is_not_there(tmp_path: Path) -> None:
    study = studies.study(tmp_path, {"controller.mine": {"law": "library", "library": "libnone.so"}})
    with pytest.raises(StudyError) as error:
        simulate(study, "low", "mine")
    expected = f"expected a file at {tmp_path / 'libnone.so'}".replace(f"{tmp_path}/", "")
    assert line(error, tmp_path) == f'study.toml: controller.mine.library: "libnone.so": {expected}'


@pytest.mark.parametrize(
    "law",
    [
        {"law": "python", "object": "x.py:Law"},
        {"law": "python", "object": "laws.py:Missing"},
        {"law": "library", "library": "libnone.so"},
    ],
    ids=["file", "class", "library"],
)
def test_a_missing_law_is_noticed_before_any_run(
    tmp_path: Path, law: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "laws.py").write_text(LAWS, encoding="utf-8")
    monkeypatch.setattr(room, "advance", lambda *_: pytest.fail("ran"))
    with pytest.raises(StudyError, match=r"controller\.mine\.(object|library): ") as error:
        run_study(studies.study(tmp_path, {"controller.mine": law}))
    assert not isinstance(error.value, RunError)


def test_an_engine_that_was_not_compiled_is_told_before_any_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`make demo` leaves out double precision, and what needs it says how to get it."""
    monkeypatch.setitem(sys.modules, "cogless._simulator_f64", None)
    monkeypatch.setattr(room, "advance", lambda *_: pytest.fail("ran"))
    with pytest.raises(StudyError) as error:
        run_study(studies.study(tmp_path, {"drive.precision": "double"}), ["low/pi"])
    assert line(error, tmp_path) == (
        "study.toml: its control laws compute in double precision, and cogless was built without the "
        "double-precision engine; `make build` adds it"
    )


def test_a_law_of_ones_own_learns_where_it_says_so(tmp_path: Path) -> None:
    """Reports count it to those that learn, and the run tells how learning goes."""
    (tmp_path / "laws.py").write_text(LAWS, encoding="utf-8")
    mine = {"law": "python", "object": "laws.py:Pi"}
    laws = {"mine": mine, "taught": {**mine, "learning": True}, "ilc": ILC, "table": TABLE}
    study = studies.study(tmp_path, {f"controller.{name}": law for name, law in laws.items()})
    assert [study.controller[name].learned for name in ("pi", *laws)] == [False, False, True, True, True]
    goes_on = {name: study.controller[name].learns for name in laws}
    assert goes_on == {"mine": False, "taught": True, "ilc": True, "table": False}
    runs = run_study(study, ["low/mine", "low/taught"]).runs
    assert [sorted(run.quality) for run in runs] == [
        ["known", "residual"],
        ["improving", "known", "progress", "residual", "worsening"],
    ]


def test_power_in_the_rotors_frame_is_of_the_motors_phases(tmp_path: Path) -> None:
    """3/2 of three phases, 1 of two, in losses too."""
    step = {"kind": "step", "teeth": 4, "R_s": "15.42 ohm", "L_0": "30 mH", "L_m": ["68 mH"]}
    loss = [{"name": "loss", "kind": "copper-loss"}]
    for motor, factor in (({}, 1.5), ({"motor": step}, 1.0)):
        study = studies.study(tmp_path, {**motor, "metric": loss})
        run = simulate(study, "low", "pi")
        i_d, i_q = run.trace["i_d"], run.trace["i_q"]
        assert run.metrics["loss_W"] == pytest.approx(factor * 15.42 * np.mean(i_d**2 + i_q**2))


def test_a_law_that_is_not_asked_for_may_be_missing(tmp_path: Path) -> None:
    study = studies.study(tmp_path, {"controller.mine": {"law": "python", "object": "x.py:Law"}})
    assert len(run_study(study, ["low/pi"]).runs) == 1


@pytest.mark.parametrize("name", ["Nan", "Exits", "Interrupts"])
def test_a_failed_run_leaves_the_others(tmp_path: Path, name: str) -> None:
    study = with_law(tmp_path, name)
    with pytest.raises(RunError) as error:
        run_study(study, ["low/*"])
    assert "controller.mine: scenario low at 0" in str(error.value)
    results = error.value.results
    assert [run.controller for run in results.runs] == ["pi", "fair"]
    assert results.interrupted


def test_a_commissioning_run_that_fails_leaves_the_others(tmp_path: Path) -> None:
    changes = {"controller.table": TABLE, "mechanics.load": {"torque": "1e308 N*m"}}
    study = studies.study(tmp_path, {**changes, "scenario.low.load": {"torque": "0 N*m"}})
    with pytest.raises(RunError) as error:
        run_study(study, ["low/*"])
    where = "study.toml: controller.table: scenario low, commissioning run, at "
    assert line(error, tmp_path).startswith(where) and "\n" not in str(error.value)
    assert [run.controller for run in error.value.results.runs] == ["pi", "fair"]


def test_a_defect_of_cogless_is_nobodys_mistake_and_leaves_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measured(study: Study, scenario: str, trace: Any) -> dict[str, Any]:
        if scenario == "step":
            raise TypeError("of cogless itself")
        return {}

    monkeypatch.setattr(room, "measure", measured)
    with pytest.raises(RunDefect) as error:
        run_study(studies.study(tmp_path), ["*/pi"])
    assert isinstance(error.value.__cause__, TypeError)
    assert [run.scenario for run in error.value.results.runs] == ["low"]


def test_a_defect_beside_a_user_s_law_is_not_the_law_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "measure", lambda *of: len(None))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="has no len"):
        simulate(with_law(tmp_path, "Pi"), "low", "mine")


def test_runs_that_cannot_be_prepared_leave_those_of_other_studies(tmp_path: Path) -> None:
    good, bad = studies.study(tmp_path), with_law(tmp_path, "Missing", {})
    with pytest.raises(RunError) as error:
        rollout([good, bad], ["low/*"], jobs=1)
    names = [[run.controller for run in results.runs] for results in error.value.all_results]
    assert names == [["pi", "fair"], ["pi", "fair"]]
    assert [list(errors) for errors in error.value.all_errors] == [[], [("low", "mine")]]
    assert "expected laws.py to define Missing" in str(error.value)


def test_whatever_fails_in_a_run_leaves_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measured(study: Study, scenario: str, trace: Any) -> dict[str, Any]:
        if scenario == "step":
            raise MemoryError("no more")
        return {}

    monkeypatch.setattr(room, "measure", measured)
    with pytest.raises(RunError) as error:
        run_study(studies.study(tmp_path), ["*/pi"])
    assert line(error, tmp_path) == "study.toml: controller.pi: scenario step: MemoryError: no more"
    assert [run.scenario for run in error.value.results.runs] == ["low"]


def test_a_failed_run_leaves_the_other_studies(tmp_path: Path) -> None:
    base = with_law(tmp_path, "Pi")
    bad = changed(base, {"controller.mine.object": "laws.py:Nan"})
    with pytest.raises(RunError) as error:
        rollout([base, bad, base, bad], ["low/mine", "low/pi"], jobs=2)
    assert str(error.value).endswith("(and 1 more run failed)")
    found = error.value.all_results
    assert [[run.controller for run in results.runs] for results in found] == [
        ["pi", "mine"],
        ["pi"],
        ["pi", "mine"],
        ["pi"],
    ]
    assert [results.interrupted for results in found] == [False, True, False, True]
    assert error.value.results is found[1]


# Ctrl-C


def test_an_interrupt_while_threads_are_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = studies.study(tmp_path, {"scenario.low.duration": 1000})
    started: list[threading.Thread] = []

    class Thread(threading.Thread):
        def start(self) -> None:
            if started:
                raise KeyboardInterrupt
            started.append(self)
            super().start()

    monkeypatch.setattr(side_by_side, "Thread", Thread)
    results = run_study(study, jobs=2)
    assert results.interrupted and not results.runs
    assert not started[0].is_alive()


def test_an_interrupt_keeps_what_is_finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = studies.study(tmp_path, {"scenario.step.duration": 1000})
    begun = threading.Event()

    def progress(scenario: str, controller: str, share: float) -> None:
        if scenario == "step":
            begun.set()

    def ctrl_c(futures: Any) -> None:
        assert begun.wait(30)
        raise KeyboardInterrupt

    monkeypatch.setattr(side_by_side, "wait", ctrl_c)
    results = run_study(study, progress=progress)
    assert results.interrupted
    assert [(run.scenario, run.controller) for run in results.runs] == [("low", "pi"), ("low", "fair")]


def test_metrics_without_their_signal_are_left_out(tmp_path: Path) -> None:
    metric = {"name": "learned", "kind": "rms", "signal": "term_table"}
    study = studies.study(tmp_path, {"controller.table": TABLE, "metric": [metric]})
    assert simulate(study, "low", "pi").metrics == {}
    assert json.dumps(dict(simulate(study, "low", "table").metrics)).startswith('{"learned_A": ')


def test_the_energy_balance_of_a_study_closes(tmp_path: Path) -> None:
    metric = {"name": "lost", "kind": "maximum", "signal": "energy_residual"}
    study = studies.study(tmp_path, {"metric": [metric], "trace": {"energy": True}})
    run = simulate(study, "step", "pi")
    assert run.metrics["lost_J"] < 1e-6 * run.trace["energy_electrical"][-1]
    assert run.trace["energy_residual"][0] == 0.0  # counted from the start, as the energies are


def test_rollout_runs_many_studies_and_can_let_their_traces_go(tmp_path: Path) -> None:
    base = studies.study(tmp_path)
    many = [changed(base, {"controller.pi.kp": kp}) for kp in (0.01, 0.02, 0.03)]
    kept = rollout(many, ["low/pi"], jobs=2)
    bare = rollout(many, ["low/pi"], jobs=2, keep_traces=False)
    alone = [run_study(study, ["low/pi"]) for study in many]
    for one, other, third in zip(kept, bare, alone, strict=True):
        assert one.runs[0].metrics == other.runs[0].metrics == third.runs[0].metrics
        assert np.array_equal(one.runs[0].trace.data, third.runs[0].trace.data)
        assert len(other.runs[0].trace) == 0
    assert len({str(results.runs[0].metrics) for results in kept}) == 3


def test_selected_signals_are_recorded_as_among_all_alone_and_in_step(tmp_path: Path) -> None:
    """In the engine's order, besides time; metrics of the others are left out."""
    base = studies.study(tmp_path)
    many = [changed(base, {"controller.pi.kp": kp}) for kp in (0.01, 0.02)]
    for variants in (many, many[:1]):
        selected = rollout(variants, ["low/pi"], jobs=1, signals={"i_q", "theta_m"})
        for one, whole in zip(selected, rollout(variants, ["low/pi"], jobs=1), strict=True):
            (run,), (other) = one.runs, whole.runs[0]
            assert run.lanes == len(variants)
            assert (run.trace.names, run.trace.units) == (("time", "theta_m", "i_q"), ("s", "rad", "A"))
            assert all(np.array_equal(run.trace[name], other.trace[name]) for name in run.trace.names)
            assert other.metrics and not run.metrics


def test_controllers_and_scenarios_of_one_duration_share_the_lanes(tmp_path: Path) -> None:
    base = changed(studies.study(tmp_path), {"controller.ilc": ILC})
    many = [changed(base, {"controller.pi.kp": kp}) for kp in (0.01, 0.02)]
    for each, one in zip(rollout(many, ["low/*"], jobs=1), many, strict=True):
        assert {run.lanes > len(many) for run in each.runs} == {True}
        for run, alone in zip(each.runs, run_study(one, ["low/*"]).runs, strict=True):
            assert run.metrics == alone.metrics and alone.lanes == 1


def test_variants_that_are_alike_run_in_step_and_give_what_each_gives_alone(tmp_path: Path) -> None:
    (tmp_path / "laws.py").write_text(LAWS)
    laws = {"controller.ilc": ILC, "controller.python": {"law": "python", "object": "laws.py:Pi"}}
    base = changed(studies.study(tmp_path), laws)
    many = [changed(base, {"mechanics.inertia": f"{n} kg*cm^2"}) for n in (4, 5, 6)]
    switched = changed(base, {"drive.inverter.kind": "switched"})
    side = {"inertia": "1 kg*cm^2", "stiffness": "30 N*m/rad", "backlash": "0.1 deg"}
    soft = changed(base, {"mechanics.load_side": side})
    every = [*many, switched, soft]
    results = rollout(every, ["low/ilc", "low/python"], jobs=1)
    assert [[run.lanes for run in one.runs] for one in results] == [[3, 1], [3, 1], [3, 1], [1, 1], [1, 1]]
    for study, one in zip(every, results, strict=True):
        for run, other in zip(one.runs, run_study(study, ["low/ilc", "low/python"]).runs, strict=True):
            assert run.metrics == other.metrics and run.quality == other.quality
            assert np.array_equal(run.trace.data, other.trace.data)
            assert other.lanes == 1
