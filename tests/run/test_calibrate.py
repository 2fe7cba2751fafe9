"""Fitting a study to target values."""

from math import inf, sqrt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import studies
from cogless.errors import StudyError
from cogless.run import calibrate as room
from cogless.run.calibrate import Fit, Residual, calibrate, residual_rows
from cogless.run.simulate import run_study, simulate
from cogless.study import Study, changed

SHORT = {"trace.rate": "3 kHz", "metric.1.frame": "mechanical", "metric.1.order": [24]}


def problem(folder: Path, parameters: list[dict[str, Any]], targets: list[dict[str, Any]]) -> Study:
    calibration = {"parameters": parameters, "targets": targets}
    changes = {**SHORT, "scenario.low.duration": 1.1, "calibration": calibration}
    return studies.study(folder, changes)


def target(metric: str, value: object, scenario: str = "low") -> dict[str, Any]:
    return {"scenario": scenario, "controller": "pi", "metric": metric, "value": value}


def test_a_cogging_torque_is_found_again(tmp_path: Path) -> None:
    truth = studies.study(tmp_path, {**SHORT, "scenario.low.duration": 1.1, "motor.cogging.0.torque": 9})
    (amplitude,) = simulate(truth, "low", "pi").metrics["speed_rad_s"]
    study = problem(
        tmp_path, [{"key": "motor.cogging.0.torque"}], [target("speed", [f"{amplitude!r} rad/s"])]
    )
    seen: list[float] = []
    fit = calibrate(study, lambda evaluations, deviation: seen.append(deviation))
    assert fit.settled
    assert fit.study.motor.cogging[0].torque == pytest.approx(0.009, rel=1e-3)
    assert fit.parameters[0].before == '"4.0 mN*m"'
    assert fit.parameters[0].toml.startswith('motor.cogging.0.torque = "')
    assert fit.parameters[0].toml.endswith(' mN*m"')
    assert seen[0] > 0.3 and fit.deviation < 1e-3
    run, metric, *_ = residual_rows(fit)[0]
    assert (run, metric) == ("low/pi", "speed 24")


def test_a_target_of_zero_counts_as_it_is(tmp_path: Path) -> None:
    """There is nothing to divide by: the deviation is the value itself, and the fit goes to its bound."""
    bounds = {"lower": "3 mN*m", "upper": "5 mN*m"}
    study = problem(tmp_path, [{"key": "motor.cogging.0.torque", **bounds}], [target("speed", ["0 rad/s"])])
    fit = calibrate(study)
    (row,) = fit.residuals
    assert fit.deviation == pytest.approx(row.got) and row.got > 0
    assert fit.study.motor.cogging[0].torque == pytest.approx(0.003, rel=1e-3)
    assert residual_rows(fit)[0][4] == ""  # no share of zero


def test_a_parameter_of_one_scenario_moves_only_its_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[list[str]] = []

    def counted(study: Study, only: list[str], jobs: int) -> Any:
        made.append(only)
        return run_study(study, only, jobs=jobs)

    monkeypatch.setattr(room, "run_study", counted)
    study = problem(
        tmp_path,
        [{"key": "motor.cogging.0.torque", "scenario": "step", "lower": "1 mN*m", "upper": "0.02 N*m"}],
        [target("speed", ["0.1 rad/s"]), target("speed_ripple", "20 rpm", "step")],
    )
    fit = calibrate(study)
    assert made[0] == ["low/pi", "step/pi"]
    assert all(only == ["step/pi"] for only in made[1:])
    assert fit.parameters[0].toml.startswith('scenario.step.override."motor.cogging.0.torque" = "')
    assert fit.study.motor.cogging[0].torque == pytest.approx(0.004)
    assert (
        0.001 <= float(fit.study.scenario["step"].override["motor.cogging.0.torque"].split()[0]) / 1e3 <= 0.02
    )


@pytest.mark.parametrize(
    ("parameter", "line"),
    [
        ({"key": "motor.cogging.7.torque"}, "key: missing: expected a key of the study that holds a number"),
        ({"key": "title"}, 'key: "A small drive": expected a key of the study that holds a number'),
        ({"key": "mechanics.inertia", "lower": "1 s"},
            'lower: "1 s": expected a number with a unit like "kg*m^2"'),
        ({"key": "mechanics.inertia", "lower": 1},
            'initial: "2.5e-4 kg*m^2": expected a value between lower and upper'),
    ],
)  # fmt: skip
def test_a_parameter_that_cannot_be_fitted(tmp_path: Path, parameter: dict[str, Any], line: str) -> None:
    with pytest.raises(StudyError) as error:
        calibrate(problem(tmp_path, [parameter], [target("speed_ripple", "5 rpm")]))
    assert f"study.toml: calibration.parameters.0.{line}" in str(error.value)


def test_the_solver_sees_a_parameter_in_units_of_where_it_starts(tmp_path: Path) -> None:
    """If that is zero, in units of the width between its bounds; without bounds, of 1."""
    inertia, torque = {"key": "mechanics.inertia"}, {"key": "motor.cogging.0.torque"}
    zero = {**torque, "initial": 0}
    given: list[dict[str, Any]] = [
        inertia,
        {**inertia, "scenario": "step"},
        {**inertia, "scenario": "low"},
        {**torque, "initial": "-0.003 N*m", "upper": 2},
        {**zero, "lower": "-2 mN*m", "upper": "4 mN*m"},
        {**zero, "lower": "-2 mN*m"},
        {**zero, "upper": 0},
        {**zero, "lower": 0},
        {**zero, "lower": 0, "upper": 0},
    ]
    study = problem(tmp_path, given, [target("speed_ripple", "5 rpm")])
    study = changed(study, {"scenario.step.override": {inertia["key"]: "5e-4 kg*m^2"}})
    assert study.calibration is not None
    *parameters, nothing = study.calibration.parameters
    knobs = [room._knob(study, n, parameter) for n, parameter in enumerate(parameters)]
    own = [f'scenario.{name}.override."mechanics.inertia"' for name in ("step", "low")]
    assert [knob.key for knob in knobs] == [inertia["key"], *own, *[torque["key"]] * 5]
    assert [knob.unit for knob in knobs] == ["kg*m^2"] * 3 + ["mN*m"] * 5
    assert [knob.start for knob in knobs] == pytest.approx([2.5e-4, 5e-4, 2.5e-4, -3.0, 0, 0, 0, 0])
    assert [knob.scale for knob in knobs] == pytest.approx([2.5e-4, 5e-4, 2.5e-4, 3.0, 6.0, 1, 1, 1])
    assert [knob.lower for knob in knobs] == [-inf] * 4 + [-2.0] * 2 + [-inf, 0.0]
    assert [knob.upper for knob in knobs] == [inf] * 3 + [2.0, 4.0, inf, 0.0, inf]
    with pytest.raises(StudyError, match=r"parameters\.8\.initial: 0\.0: expected a value between lower and"):
        room._knob(study, 8, nothing)


def test_a_study_without_calibration(tmp_path: Path) -> None:
    with pytest.raises(
        StudyError, match="calibration: missing: expected a table with parameters and targets"
    ):
        calibrate(studies.study(tmp_path))


def test_a_metric_without_a_value(tmp_path: Path) -> None:
    study = problem(tmp_path, [{"key": "mechanics.inertia"}], [target("recovery", "0.05 s", "step")])
    study = changed(study, {"metric.2.band": 0.0001})
    with pytest.raises(StudyError, match="calibration: recovery of step/pi has no value"):
        calibrate(study)


def test_a_parameter_of_a_python_law_is_fitted(tmp_path: Path) -> None:
    law = "class Law:\n    def __init__(self, kp):\n        self.kp = kp\n"
    law += "    def step(self, i):\n        return self.kp * (i.omega_ref - i.omega_m)\n"
    (tmp_path / "law.py").write_text(law, encoding="utf-8")
    mine = {"law": "python", "object": "law.py:Law", "params": {"kp": 0.3}}
    study = studies.study(tmp_path, {"controller.mine": mine})
    ripple = simulate(study, "low", "mine").metrics["speed_ripple_rad_s"]
    wanted = {**target("speed_ripple", f"{ripple!r} rad/s"), "controller": "mine"}
    calibration = {"parameters": [{"key": "controller.mine.params.kp"}], "targets": [wanted]}
    fit = calibrate(changed(study, {"controller.mine.params.kp": 0.2, "calibration": calibration}))
    assert float(fit.parameters[0].after) == pytest.approx(0.3, rel=1e-2)


def test_a_parameter_of_a_metric_counts(tmp_path: Path) -> None:
    """A metric's settings decide its value too, though not the run."""
    study = problem(tmp_path, [{"key": "metric.2.band"}], [target("recovery", "0.05 s", "step")])
    known: dict[str, Any] = {}
    (wide,) = room._residuals(changed(study, {"metric.2.band": 12}), known, 1)
    (narrow,) = room._residuals(changed(study, {"metric.2.band": 8}), known, 1)
    assert len(known) == 2 and wide.got != narrow.got


@pytest.mark.parametrize("finished", [0, 3])
def test_an_interrupt_gives_the_best_so_far(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, finished: int
) -> None:
    made = 0

    def interrupted(study: Study, only: list[str], jobs: int) -> Any:
        nonlocal made
        if made == finished:
            raise KeyboardInterrupt
        made += 1
        return run_study(study, only, jobs=jobs)

    monkeypatch.setattr(room, "run_study", interrupted)
    study = problem(tmp_path, [{"key": "motor.cogging.0.torque"}], [target("speed_ripple", "1 rpm")])
    if not finished:
        with pytest.raises(KeyboardInterrupt):
            calibrate(study)
        return
    seen: list[float] = []
    fit = calibrate(study, lambda evaluations, deviation: seen.append(deviation))
    assert fit.interrupted and not fit.settled
    assert fit.deviation == seen[-1] < seen[0]
    assert abs(fit.residuals[0].got / fit.residuals[0].target - 1) == pytest.approx(fit.deviation)


def test_rows_of_a_fit_are_in_the_units_of_the_metrics(tmp_path: Path) -> None:
    """Deviations are shares of what was wanted, with their signs; of a metric with parts each is a row."""
    study = studies.study(tmp_path)
    residuals = (
        Residual("low", "pi", "speed_ripple", None, 0.2, 0.25),
        Residual("low", "fair", "speed", 6.0, -0.4, -0.3),
        Residual("step", "pi", "recovery", None, 0.0, 0.0123456),
    )
    rows = residual_rows(Fit((), residuals, 0.0, True, study))
    assert rows == [
        ("low/pi", "speed_ripple", "1.91 rpm", "2.387 rpm", "+25.0 %"),
        ("low/fair", "speed 6", "-0.4 rad/s", "-0.3 rad/s", "-25.0 %"),
        ("step/pi", "recovery", "0 s", "0.01235 s", ""),
    ]


def test_a_list_s_deviations_count_by_its_largest_target_and_a_weight(tmp_path: Path) -> None:
    """Of 2 and 4 rad/s at 24 and 48 per revolution, both deviations are shares of 4; weighed double here."""
    orders = {"metric.1.order": [24, 48]}
    goals = [{**target("speed", ["2 rad/s", "4 rad/s"]), "weight": 2.0}, target("speed_ripple", "5 rad/s")]
    bounds = {"lower": "3.999 mN*m", "upper": "4.001 mN*m"}
    calibration = {"parameters": [{"key": "motor.cogging.0.torque", **bounds}], "targets": goals}
    study = studies.study(
        tmp_path, {**SHORT, **orders, "scenario.low.duration": 1.1, "calibration": calibration}
    )
    fit = calibrate(study)
    first, second, ripple = (r.got - r.target for r in fit.residuals)
    shares = [2 * first / 4, 2 * second / 4, ripple / 5]
    assert fit.deviation == pytest.approx(sqrt(sum(x * x for x in shares) / 3), rel=1e-3)


@pytest.mark.parametrize("statuses", [(1, 1, 0), (0, 0, 2)])
def test_each_fit_begins_at_the_best_so_far_with_smaller_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, statuses: tuple[int, ...]
) -> None:
    """The last one says whether it settled; the best of all evaluations is the result, wherever it was."""
    begun, left = list[tuple[float, float]](), list(statuses)
    tried = [[1.0, 0.5, 2.0], [0.25, 0.3], [0.6]]  # shares of the deviation at the start

    def fit(deviations: Any, best: Any, *, bounds: Any, diff_step: Any, **_: Any) -> Any:
        assert [float(bound[0]) for bound in bounds] == [-inf, inf]
        begun.append((float(best[0]), float(diff_step[0])))
        for x in tried[len(begun) - 1]:
            assert deviations(np.array([x])) == pytest.approx([x])
        return SimpleNamespace(status=left.pop(0))

    def found(study: Study, known: Any, jobs: int) -> list[Residual]:
        return [Residual("low", "pi", "speed_ripple", None, 1.0, 1.0 + study.mechanics.inertia / 2.5e-4)]

    monkeypatch.setattr(room, "least_squares", fit)
    monkeypatch.setattr(room, "_residuals", found)
    study = problem(tmp_path, [{"key": "mechanics.inertia"}], [target("speed_ripple", "1 rad/s")])
    told: list[tuple[int, float]] = []
    made = calibrate(study, lambda count, least: told.append((count, round(least, 9))))
    assert begun == [(1.0, 0.3), (0.5, 0.1), (0.25, 0.02)]
    assert told == [(1, 1.0), (2, 0.5), (3, 0.5), (4, 0.25), (5, 0.25), (6, 0.25)]
    assert (made.settled, made.interrupted) == (statuses[-1] > 0, False)
    assert made.deviation == pytest.approx(0.25) and made.study.mechanics.inertia == pytest.approx(6.25e-5)
    assert (made.parameters[0].before, made.parameters[0].after) == ('"0.00025 kg*m^2"', '"6.25e-05 kg*m^2"')
