"""A study of trials: what it means, and a mistake in it as one line."""

import itertools
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_studies
from hypothesis import given
from hypothesis import strategies as st
from trial_studies import DRIVE, LINEAR

from cogless.study import Study, load
from cogless.study.linear_plant import ExpressionError, evaluate
from cogless.study.trial_study import PositionReference
from studies import refusal

line_of = partial(refusal, trial_studies.loaded)


def test_phases_keep_what_a_change_does_not_name(tmp_path: Path) -> None:
    study = trial_studies.loaded(tmp_path)
    scenario = study.scenario["move"]
    assert scenario.starts == (1, 5, 9)
    conditions = [conditions for _, conditions in scenario.phases]
    assert [c.load_steps for c in conditions] == [None, ((40, 0.5),), ((40, 0.5),)]
    assert all(c.reference == scenario.reference for c in conditions)
    assert [h.mechanics.inertia for h in study.hardware("move")] == pytest.approx([5.9e-4, 5.9e-4, 10.6e-4])
    assert (study.samples("move"), study.period, study.states) == (200, 0.0025, 2)


def test_the_top_speed_is_in_the_middle_of_the_steepest_move_or_at_the_start(tmp_path: Path) -> None:
    """A move's top speed is 15/8 of its mean: of 1 rad in 0.35 s, or of 2 rad after a change."""
    further = [["0.05 s", "0 rad"], ["0.4 s", "-2 rad"]]
    for changes, speed in (
        ({}, 1.875 / 0.35),
        ({"scenario.move.changes.0.reference": further}, 2 * 1.875 / 0.35),
        ({"scenario.move.initial_speed": "-20 rad/s"}, 20.0),
        ({"scenario.move.changes.1.initial_speed": "-20 rad/s"}, 20.0),
    ):
        assert trial_studies.loaded(tmp_path, changes).top_speed("move") == pytest.approx(speed, rel=1e-3)


def test_a_step_that_is_too_long_names_the_fastest_scenario(tmp_path: Path) -> None:
    found = line_of(tmp_path, {"scenario.move.initial_speed": "-9e4 rpm"}, DRIVE)
    assert found.startswith("study.toml: drive.rates.integration_steps: 1, the default: expected ")
    assert "the highest order at the 90000 rpm of scenario.move changes within" in found


def test_a_metric_has_a_value_for_each_trial_or_phase(tmp_path: Path) -> None:
    study = trial_studies.loaded(tmp_path)
    assert {m.name: study.values_of(m, "move") for m in study.metric} == {"error": 12, "to_floor": 3}


def test_a_change_may_be_of_the_last_trial(tmp_path: Path) -> None:
    study = trial_studies.loaded(tmp_path, {"scenario.move.changes.1.trial": 12, "scenario.move.trials": 12})
    assert [first for first, _ in study.scenario["move"].phases] == [1, 5, 12]


def test_a_change_takes_a_bare_number_in_the_study_s_unit(tmp_path: Path) -> None:
    study = trial_studies.loaded(tmp_path, {"scenario.move.changes.1.override": {"mechanics.inertia": 8e-4}})
    assert study.hardware("move")[2].mechanics.inertia == pytest.approx(8e-4)


def test_a_law_that_learns_by_a_matrix_takes_no_long_trial(tmp_path: Path) -> None:
    """4000 samples of 2.5 ms are 10 s; the others have no such limit."""
    matrix = {"controller.ilc": {"law": "norm-optimal"}, "scenario.move.trials": 12}
    longer = {"scenario.move.duration": "10.0025 s"}
    assert (
        trial_studies.loaded(tmp_path, {**matrix, "scenario.move.duration": "10 s"}).samples("move") == 4000
    )
    assert trial_studies.loaded(tmp_path, longer).samples("move") == 4001
    told = 'expected at most 4000 samples, since "ilc" learns by a matrix'
    assert line_of(tmp_path, {**matrix, **longer}, DRIVE).endswith(f'duration: "10.0025 s": {told}')


def test_studies_of_speed_stay_what_they_are() -> None:
    assert isinstance(load("liu2018"), Study)


def test_a_plant_s_matrices_follow_its_parameters(tmp_path: Path) -> None:
    plant = trial_studies.loaded(tmp_path, text=LINEAR).plant
    assert plant is not None
    assert plant.matrices_at({}) == ([[-0.75, 0.0], [1.0, -1.5]], [2.0, 0.0])
    assert plant.matrices_at({"a": 0.5, "k": 1.8}) == ([[-0.5, 0.0], [1.0, -1.0]], [1.8, 0.0])


@given(
    st.lists(st.floats(-10, 10), min_size=2, max_size=6), st.lists(st.floats(0.01, 3), min_size=6, max_size=6)
)
def test_references_stop_at_each_point_and_stay_between(values: list[float], gaps: list[float]) -> None:
    times = list(itertools.accumulate(gaps[: len(values)]))
    points = tuple((f"{t!r} s", v) for t, v in zip(times, values, strict=True))
    reference = PositionReference(points=points)
    assert reference.values_at(np.array(times)) == pytest.approx(values, abs=1e-9)
    for (begin, low), (end, high) in itertools.pairwise(zip(times, values, strict=True)):
        inside = reference.values_at(np.linspace(begin, end, 201))
        assert np.all(inside >= min(low, high) - 1e-9) and np.all(inside <= max(low, high) + 1e-9)
        # at rest, and without a jolt: the third power of what is left at either end
        near = 1e-3 * (end - begin)
        step = reference.values_at(np.array([begin, begin + near, end - near, end]))
        assert abs(step[1] - step[0]) <= 1.1e-8 * abs(high - low) + 1e-12
        assert abs(step[3] - step[2]) <= 1.1e-8 * abs(high - low) + 1e-12
    assert reference.values_at(np.array([-1.0, times[-1] + 5])) == pytest.approx([values[0], values[-1]])


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-B / J", -2.0), ("2*(J+B)**2", 18.0), ("1.5e-3", 0.0015), ("+J", 1.0), ("-2**2", -4.0),
        ("J" + 99 * "+J" + " ", 100.0),
    ],
)  # fmt: skip
def test_expressions(text: str, value: float) -> None:
    assert evaluate(text, {"B": 2.0, "J": 1.0}) == value


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("B / (J - 1)", "expected a formula that can be computed (float division by zero)"),
        ("J / x", 'expected only known parameters (B, J), not "x"'),
        ("__import__('os')", 'expected arithmetic of + - * / ** over parameters, such as "-B / J"'),
        ("J.real", 'expected arithmetic of + - * / ** over parameters, such as "-B / J"'),
        ("J if B else 1", 'expected arithmetic of + - * / ** over parameters, such as "-B / J"'),
        ("True", 'expected arithmetic of + - * / ** over parameters, such as "-B / J"'),
        ("J +", 'expected arithmetic over parameters, such as "-B / J"'),
        ("J" + 100 * "+J", 'expected arithmetic over parameters, such as "-B / J"'),
        ("9**9**9**9", "expected a formula that can be computed (math range error)"),
        ("(0-1)**0.5", "expected a formula that can be computed (math domain error)"),
        ("1e999", "expected a finite value"),
    ],
)
def test_expressions_that_have_no_value(text: str, line: str) -> None:
    with pytest.raises(ExpressionError) as error:
        evaluate(text, {"B": 2.0, "J": 1.0})
    assert str(error.value) == line


VERTICES = {
    "plant": {"period": "0.1 s", "C": [1], "vertex": [{"A": [[0.5]], "B": [1]}, {"A": [[0.7]], "B": [2]}]},
    "design": {"state_weight": [1, 1], "input_weight": 1, "initial_state": [1, 0]},
    "scenario.cycle.changes": [],
}


@pytest.mark.parametrize(
    ("text", "key", "value", "line"),
    [
        # the plant
        (LINEAR, "plant.parameter.a", {}, "plant.parameter.a: expected the key value, range or both"),
        (LINEAR, "plant.states", ["x"], 'plant.states: ["x"]: expected 2 names, one for each state'),
        (LINEAR, "design.range", {"motor.K_t": ["1 N*m/A", "2 N*m/A"]},
            "design.range: expected no such key, since there is a linear plant: delete range, or give "
            "plant.parameter.NAME.range in its place; range is from --set, plant from the file"),
        (LINEAR, "plant.parameter", {name: [0.5, 1.0] for name in "abcdefghijkmnopqrstuvwxyz"},
            "plant.parameter: expected at most 12 parameters with a range"),
        (LINEAR, "trace.energy", True, "trace.energy: true: expected false, since there is no drive"),
        # metrics
        (LINEAR, "metric.0.kind", "three-sigma",
            'metric.0.kind: "three-sigma": expected a kind for studies of trials: rms, ripple-rms, mean, '
            'maximum, '
            "peak-to-peak, first-rms, final-rms, trials-to-floor"),
        (LINEAR, "metric.0.window", ["0 s", "1 s"],
            'metric.0.window: ["0 s", "1 s"]: expected no such key in a study of trials: '
            'delete window'),
        # the scenario
        (DRIVE, "scenario.move.duration", "0.501 s",
            'scenario.move.duration: "0.501 s": expected a whole number of samples of 0.0025 s'),
        (DRIVE, "scenario.move.duration", "0.005 s",
            'scenario.move.duration: "0.005 s": expected 4 to 65535 samples, not 2'),
        (DRIVE, "scenario.move.trials", 0, "scenario.move.trials: 0: expected a number of 1 or more"),
        (DRIVE, "scenario.move.reference", "1 rad", 'scenario.move.reference: "1 rad": expected a table with '
                                                    'the keys '
            'points'),
        (DRIVE, "scenario.move.reference", [["1 s", "0 rad"], ["1 s", "1 rad"]],
            "scenario.move.reference.points: expected one or more points, each later than the previous one"),
        (DRIVE, "scenario.move.changes.0.trial", 1, "scenario.move.changes.0.trial: 1: expected a "
            "number of 2 or more"),
        (DRIVE, "scenario.move.changes.0.trial", 13,
            "scenario.move.changes.0.trial: 13: expected a trial after 1, at most 12"),
        (DRIVE, "scenario.move.changes.1.trial", 5,
            "scenario.move.changes.1.trial: 5: expected a trial after 5, at most 12"),
        (DRIVE, "scenario.move.changes.1.trial", 13,
            "scenario.move.changes.1.trial: 13: expected a trial after 5, at most 12"),
        (DRIVE, "scenario.move.changes.0.load_steps", [[200, "1 N*m"]],
            'scenario.move.changes.0.load_steps.0: [200, "1 N*m"]: expected a sample below 200, within the '
                'trial'),
        (DRIVE, "scenario.move.changes.0.load_steps", [[50, "1 N*m"], [20, "0 N*m"]],
            'scenario.move.changes.0.load_steps.1: [20, "0 N*m"]: expected a sample after that of the '
        'previous step'),
        (DRIVE, "scenario.move.changes.0.initial_state", [0, 0],
            "scenario.move.changes.0.initial_state: [0, 0]: expected no such key, since the plant "
            "is a drive: delete initial_state, or give initial_angle and initial_speed in its place; "
            "initial_state is from --set, drive from the file"),
        (DRIVE, "scenario.move.changes.1.override", {"drive.rates": 1},
            'scenario.move.changes.1.override."drive.rates": 1: expected a key of motor or mechanics, such '
            "as mechanics.inertia"),
        (DRIVE, "scenario.move.changes.1.override", {"mechanics.inertia": "-1 kg*m^2"},
            'scenario.move.changes.1.override: mechanics.inertia: "-1 kg*m^2": expected an inertia '
                'above zero, '
            'such as "1 kg*m^2"'),
        (DRIVE, "scenario.move.changes.1.override", {"motor.datasheet": "liu2018"},
            'scenario.move.changes.1.override."motor.datasheet": "liu2018": expected a key of motor or '
            "mechanics, such as mechanics.inertia"),
        (DRIVE, "scenario.move.initial_angle", "0.6 rev",
            'scenario.move.initial_angle: "0.6 rev": expected an angle less than half a turn from where the '
            "reference begins, 0 rad: the sensor doesn't count turns"),
        (DRIVE, "scenario.move.reference", [["0 s", "0 rad"], ["0.6 s", "1 rad"]],
            'scenario.move.reference.1: ["0.6 s", "1 rad"]: expected a time within the 0.5 s of the trial'),
        (LINEAR, "scenario.cycle.reference", [["0 s", "0 rad"], ["1 s", "1 rad"]],
            'scenario.cycle.reference.0: ["0 s", "0 rad"]: expected a plain number, such as ["1 s", 1.0]'),
        (LINEAR, "scenario.cycle.load_steps", [[10, "1 N*m"]],
            'scenario.cycle.load_steps.0: [10, "1 N*m"]: expected a number in the unit of u, such as '
            "[100, 1.0]"),
        # the plant
        (LINEAR, "plant.A.0.0", "1 / (a - 0.5)",
            'plant.A.0.0: "1 / (a - 0.5)": expected a formula that can be computed (float division by zero) '
            'at '
            "a = 0.5, k = 1.8"),
        (DRIVE, "plant", {"period": "1 s", "A": [[0.5]], "B": [1], "C": [1]},
            "motor: expected no such key, since the table [plant] is a linear plant without a drive: "
            "delete motor, or delete plant; motor is from the file, plant from --set: add --set motor= to "
            "delete motor"),
        (LINEAR, "plant.period", "0 s", 'plant.period: "0 s": expected a time above zero, such as "1 s"'),
        (LINEAR, "plant.C", [], "plant.C: []: expected 1 to 8 numbers, one for each state"),
        (LINEAR, "plant.B", [1], "plant.B: [1]: expected 2 numbers, as many as C has"),
        (LINEAR, "plant.A", [[1, 2]], "plant.A: [[1, 2]]: expected 2 rows of 2 numbers, as many as C has"),
        (LINEAR, "plant.A.0.0", "-b", 'plant.A.0.0: "-b": expected only known parameters (a, k), not "b"'),
        (LINEAR, "plant.A.0.0", "1 / (a - 0.75)",
            'plant.A.0.0: "1 / (a - 0.75)": expected a formula that can be computed (float '
            'division by zero) at '
            "a = 0.75, k = 2"),
        (LINEAR, "plant.parameter.a", [1.0, 0.5],
            "plant.parameter.a.range: expected a range from the smallest to the largest value"),
        (LINEAR, "plant.parameter.k.value", 3.0,
            "plant.parameter.k.value: 3.0: expected a value within the range, 1.8 to 2.2"),
        (LINEAR, "plant.vertex", [{"A": [[1, 0], [0, 1]], "B": [1, 0]}],
            "plant.vertex: [{ A = [[1, 0], [0, 1]], B = [1, 0] }]: expected no such key, since A is given: "
            "delete vertex, or delete A and B; vertex is from --set, A from the file: add --set plant.A= to "
            "delete A"),
        (LINEAR, "plant", {**VERTICES["plant"], "vertex": [{"A": [[0.5, 1]], "B": [1]}]},
            "plant.vertex.0.A: [[0.5, 1]]: expected 1 rows of 1 numbers, as many as C has"),
        (LINEAR, "plant", {**VERTICES["plant"], "vertex": [{"A": [[1]], "B": [1]}, {"A": [[1]], "B": []}]},
            "plant.vertex.1.B: []: expected 1 numbers, as many as C has"),
        (LINEAR, "plant", {**VERTICES["plant"], "parameter": {"a": 1.0}},
            "plant.parameter: expected no such key, since vertex gives numbers: delete parameter, or give A "
            "and B in place of vertex"),
        (LINEAR, "plant", {"period": "1 s", "C": [1]},
            "plant.A: missing: expected either A and B, or vertex"),
        (LINEAR, "plant", {"period": "1 s", "C": [1], "A": [[1]]},
            "plant.A: [[1]]: expected either A and B, or vertex"),
        (LINEAR, "plant", {"period": "1 s", "C": [1] * 9, "A": [[1] * 9] * 9, "B": [1] * 9},
            "plant.C: [1, 1, 1, 1, 1, 1, 1, 1, 1]: expected 1 to 8 numbers, one for each state"),
        (LINEAR, "plant.A.1.0", "c + a - d",
            'plant.A.1.0: "c + a - d": expected only known parameters (a, k), not "c"'),
        (LINEAR, "plant.B.1", "2 *",
            'plant.B.1: "2 *": expected arithmetic over parameters, such as "-B / J"'),
        (LINEAR, "scenario.cycle.changes.0.override.b", 1,
            "scenario.cycle.changes.0.override.b: 1: expected a parameter of the plant: a, k"),
        (LINEAR, "scenario.cycle.changes.0.override.a", "much",
            'scenario.cycle.changes.0.override.a: "much": expected a number'),
        (LINEAR, "scenario.cycle.initial_state", [1],
            "scenario.cycle.initial_state: [1]: expected 2 numbers, one for each state"),
        # the design
        (DRIVE, "design.state_weight", [1, 1, 0],
            "design.state_weight: [1, 1, 0]: expected a positive definite weight"),
        (DRIVE, "design.state_weight", [[1, 2, 0], [0, 1, 0], [0, 0, 1]],
            "design.state_weight: [[1, 2, 0], [0, 1, 0], [0, 0, 1]]: expected a positive definite weight"),
        (DRIVE, "design.state_weight", [[1, 0], [0, 1], [0, 0]],
            "design.state_weight: [[1, 0], [0, 1], [0, 0]]: expected the diagonal, or as many rows as "
            "columns"),
        (DRIVE, "design.state_weight", [[1, 0, 0], [0, 1, 0]],
            "design.state_weight: [[1, 0, 0], [0, 1, 0]]: expected the diagonal, or as many rows as columns"),
        (DRIVE, "design.range", {"mechanics.inertia": ["1e-4 kg*m^2"]},
            'design.range."mechanics.inertia": ["1e-4 kg*m^2"]: expected the smallest and the largest value'),
        (DRIVE, "design.range", {"mechanics.inertia": "1e-4 kg*m^2"},
            'design.range."mechanics.inertia": "1e-4 kg*m^2": expected the smallest and the largest value'),
        (DRIVE, "design.input_weight", 0, "design.input_weight: 0: expected a number above 0"),
        (DRIVE, "design.initial_state", [0, 0, 0],
            "design.initial_state: [0, 0, 0]: expected a number other than zero"),
        (DRIVE, "design.initial_change", [0, 0],
            "design.initial_change: [0, 0]: expected 3 numbers, as many as state_weight has rows"),
        (DRIVE, "design.initial_state", [1], "design.initial_state: [1]: expected 3 numbers, as many as "
            "state_weight has rows"),
        (DRIVE, "design.range", {"motor.R_s": ["1 ohm", "2 ohm"]},
            'design.range."motor.R_s": ["1 ohm", "2 ohm"]: expected one of mechanics.inertia, '
            "mechanics.viscous_friction, motor.K_t"),
        (DRIVE, "design.range", {"mechanics.inertia": ["2e-4 kg*m^2", "1e-4 kg*m^2"]},
            'design.range."mechanics.inertia": ["2e-4 kg*m^2", "1e-4 kg*m^2"]: expected a range '
                'from the smallest '
            "to the largest value"),
        (DRIVE, "design.range", {"mechanics.inertia": ["0 kg*m^2", "1e-4 kg*m^2"]},
            'design.range."mechanics.inertia".0: "0 kg*m^2": expected an inertia above zero, such '
                'as "1 kg*m^2"'),
        # controllers and metrics
        (DRIVE, "controller.ilc.K_s", [1, 2],
            "controller.ilc.K_s: [1, 2]: expected 3 numbers: one for each state, and one for the integrator"),
        (DRIVE, "controller.ilc.q_filter.cutoff", "200 Hz",
            'controller.ilc.q_filter.cutoff: "200 Hz": expected less than half the sampling rate, 200 Hz'),
        (DRIVE, "controller.ilc.law", "pi",
            'controller.ilc.law: "pi": expected one of "trial-ilc", "state-ilc", "norm-optimal", '
            '"observer-ilc", "python", "library"'),
        (DRIVE, "drive.current_loop", {"bandwidth": "800 Hz", "current_limit": "3 A"},
            "drive.inverter: missing: expected a table with bus_voltage, ..."),
        (DRIVE, "drive.rates.position_loop", "3 kHz",
            'drive.rates.position_loop: "3 kHz": expected a rate that divides current_loop, 8000 Hz'),
        (DRIVE, "trace.rate", "200 Hz",
            'trace.rate: "200 Hz": expected 400 Hz or a multiple of it, so that each sample of a trial has a '
            'row'),
        (DRIVE, "metric.0.signal", "u_d", None),
        (DRIVE, "metric.1.floor", "1 A", 'metric.1.floor: "1 A": expected an angle, such as "1 deg"'),
        (DRIVE, "metric.0.floor", "1 mrad", 'metric.0.floor: "1 mrad": expected no such key, since kind = '
            '"rms": delete floor, or set a kind that takes floor; floor is from --set, kind from the file'),
        (LINEAR, "metric.0.signal", "theta_error",
            'metric.0.signal: "theta_error": expected a signal: y_ref, y, y_error, u, load, term_feedback, '
            "term_integral, term_feedforward, term_learned, learned, status, x_1, x_2"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(tmp_path: Path, text: str, key: str, value: Any, line: str | None) -> None:
    found = line_of(tmp_path, {key: value}, text)
    assert found.startswith("study.toml: ")
    if line is not None:
        assert found.removeprefix("study.toml: ").split(" (and ")[0] == line


OBSERVED = {"law": "observer-ilc"}
FIXED = {"law": "trial-ilc", "K_s": [1.0, 2.0, 3.0], "N": 1.0, "K_3": 0.1}
OWN = {"law": "python", "object": "law.py:Law"}


@pytest.mark.parametrize(
    ("text", "common", "key", "most", "beyond", "told"),
    [
        # samples of a trial, up to rounding
        (DRIVE, {"scenario.move.changes": [], "scenario.move.reference": [["0 s", "0 rad"]]},
            "scenario.move.duration", "10 ms", "7.5 ms", "expected 4 to 65535 samples, not 3"),
        (DRIVE, {}, "scenario.move.duration", "163.8375 s", "163.84 s",
            "expected 4 to 65535 samples, not 65536"),
        (DRIVE, {}, "scenario.move.duration", "0.50000000025 s", "0.5000000008 s",
            "expected a whole number of samples of 0.0025 s"),
        # rows of the trace
        (DRIVE, {"trace.rate": "8 kHz"}, "scenario.move.trials", 5000, 5001,
            "expected at most 5000: 5001 trials make 2e+07 rows, too many for the trace"),
        (DRIVE, {}, "scenario.move.trials", 100_000, 100_001, "expected a number of 100000 or less"),
        (DRIVE, {}, "trace.rate", "4000.000000002 Hz", "4000.000000006 Hz",
            "expected a rate that divides 8000 Hz"),
        # what happens within a trial
        (LINEAR, {}, "scenario.cycle.load_steps", [[49, 0.1]], [[50, 0.1]],
            "expected a sample below 50, within the trial"),
        (DRIVE, {}, "scenario.move.reference", [["0 s", "0 rad"], ["0.5 s", "1 rad"]],
            [["0 s", "0 rad"], ["0.5001 s", "1 rad"]], "expected a time within the 0.5 s of the trial"),
        (DRIVE, {}, "scenario.move.initial_angle", "-0.4999 rev", "-0.5 rev",
            "expected an angle less than half a turn from where the reference begins, 0 rad: the sensor "
            "doesn't count "
            "turns"),
        (DRIVE, {}, "scenario.move.changes.0.initial_angle", "0.4999 rev", "0.5 rev",
            "expected an angle less than half a turn from where the reference begins, 0 rad: the sensor "
            "doesn't count "
            "turns"),
        (LINEAR, VERTICES, "scenario.cycle.override", {"vertex": 2}, {"vertex": 3},
            "expected vertex = 1 to 2, or no vertex for the mean of all"),
        (LINEAR, VERTICES, "scenario.cycle.override", {"vertex": 1}, {"vertex": 0},
            "expected vertex = 1 to 2, or no vertex for the mean of all"),
        (LINEAR, VERTICES, "scenario.cycle.override", {}, {"vertex": True},
            "expected vertex = 1 to 2, or no vertex for the mean of all"),
        (LINEAR, VERTICES, "scenario.cycle.override", {}, {"corner": 1},
            "expected vertex = 1 to 2, or no vertex for the mean of all"),
        (LINEAR, {}, "scenario.cycle.override.a", 0.6, True, "expected a number"),
        (LINEAR, {}, "scenario.cycle.override.a", 1, "1", "expected a number"),
        (LINEAR, {}, "scenario.cycle.override.a", 1, float("inf"), "expected a number"),
        # laws
        (DRIVE, {}, "controller.ilc.q_filter.cutoff", "199.9 Hz", "200 Hz",
            "expected less than half the sampling rate, 200 Hz"),
        (DRIVE, {"controller.ilc": OBSERVED}, "controller.ilc.cutoff", "199.9 Hz", "200 Hz",
            "expected less than half the sampling rate, 200 Hz"),
        (DRIVE, {"controller.ilc": FIXED}, "controller.ilc.K_s", [1, 2, 3], [1, 2, 3, 4],
            "expected 3 numbers: one for each state, and one for the integrator"),
        (DRIVE, {"controller.ilc": {**FIXED, "integral": False}}, "controller.ilc.K_s", [1, 2], [1],
            "expected 3 numbers: one for each state, and one for the integrator"),
        (DRIVE, {"controller.ilc": {**FIXED, "integral": False}}, "controller.ilc.K_s", [1, 2, 3],
            [1, 2, 3, 4], "expected 3 numbers: one for each state, and one for the integrator"),
        (DRIVE, {"controller.ilc": {"law": "state-ilc"}}, "controller.ilc.K_stab", [1, 2], [1, 2, 3],
            "expected 2 numbers, one for each state"),
    ],
)  # fmt: skip
def test_a_study_of_trials_at_its_bounds_and_beyond(
    tmp_path: Path, text: str, common: dict[str, Any], key: str, most: Any, beyond: Any, told: str
) -> None:
    trial_studies.loaded(tmp_path, {**common, key: most}, text)
    found = line_of(tmp_path, {**common, key: beyond}, text)
    assert found.startswith(f"study.toml: {key}") and found.endswith(f": {told}")


@pytest.mark.parametrize(
    ("text", "law", "told"),
    [
        (DRIVE, {**OWN, "start": {"map": "a.bin"}},
            "start: expected no such key, since what is learned from trial to trial fits only the reference "
            "of these trials: delete start"),
        (LINEAR, OWN, 'law: "python": expected a law of trials, since a law of your own needs a drive'),
    ],
)  # fmt: skip
def test_a_law_of_one_s_own_in_trials(tmp_path: Path, text: str, law: dict[str, Any], told: str) -> None:
    assert line_of(tmp_path, {"controller.new": law}, text) == f"study.toml: controller.new.{told}"


@pytest.mark.parametrize("part", ["motor", "mechanics", "drive"])
def test_trials_need_a_whole_drive_or_a_plant(tmp_path: Path, part: str) -> None:
    before, _, rest = DRIVE.partition(f"[{part}]")
    text = before + rest[rest.index("\n[") + 1 :]
    expected = "expected this table, or [plant] in place of [motor], [mechanics] and [drive]"
    assert line_of(tmp_path, {}, text) == f"study.toml: {part}: missing: {expected}"


def test_a_trace_that_is_too_large(tmp_path: Path) -> None:
    found = line_of(tmp_path, {"scenario.move.trials": 100_000, "scenario.move.duration": "1 s"}, DRIVE)
    expected = "expected at most 50000: 100000 trials make 4e+07 rows, too many for the trace"
    assert found == f"study.toml: scenario.move.trials: 100000: {expected}"


def test_integral_action_needs_a_weight_of_its_own(tmp_path: Path) -> None:
    found = line_of(tmp_path, {"design.state_weight": [1, 1], "design.initial_state": [1, 0]}, DRIVE)
    expected = 'expected 3 numbers: one for each state, and one for the integrator of controller "ilc"'
    assert found == f"study.toml: design.state_weight: [1, 1]: {expected}"


def test_a_plant_without_a_value_in_a_trial_is_refused(tmp_path: Path) -> None:
    changes = {"plant.A.0.0": "1 / (a - 3)", "scenario.cycle.changes.0.override.a": 3.0}
    found = line_of(tmp_path, changes, LINEAR)
    assert found.startswith("study.toml: scenario.cycle.changes.0.override")
    assert found.endswith("expected a formula that can be computed (float division by zero) at a = 3, k = 2")


def test_a_table_of_an_override_changes_its_keys_alone(tmp_path: Path) -> None:
    nested = {"scenario.move.changes.1.override": {"mechanics": {"inertia": "8e-4 kg*m^2"}}}
    hardware = trial_studies.loaded(tmp_path, nested).hardware("move")[2]
    assert (hardware.mechanics.inertia, hardware.mechanics.viscous_friction) == (8e-4, 1.4e-3)


def test_of_a_load_and_an_override_of_it_the_later_one_counts(tmp_path: Path) -> None:
    changes = {
        "scenario.move.changes.0.load": "1 N*m",
        "scenario.move.changes.1.override": {"mechanics.load.torque": "0.2 N*m"},
    }
    hardware = trial_studies.loaded(tmp_path, changes).hardware("move")
    assert [phase.load.torque for phase in hardware] == [0.0, 1.0, 0.2]
