"""Logs of three motors, right and with each unit wrong in turn: what is told, and that its cure cures."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from identify.three_plants import PLANTS

from cogless.identify import config, plan
from cogless.identify.advice import Advice, AdvisedError, advice_of, changed
from cogless.identify.command import identified
from cogless.identify.log import Log, load_logs
from cogless.identify.result import Estimate

DEGREES, TURN = 180 / math.pi, 2 * math.pi
JOINT_ERROR = 1.46  # 2.86 over 1.96 standard deviations: twelve waves at once lie within it in 95 %


@cache
def right(name: str) -> dict[str, np.ndarray]:
    return PLANTS[name].log()


def written(folder: Path, name: str, log: dict[str, np.ndarray], *cures) -> tuple[Path, Path]:
    """The files of a log and of its columns, those that the log has, with changes."""
    tables = PLANTS[name].columns()
    tables["columns"] = {key: heading for key, heading in tables["columns"].items() if heading in log}
    for cure in cures:
        tables = changed(tables, cure)
    (folder / "id.toml").write_text(plan.to_toml(tables))
    np.savez(folder / "a.npz", **log)
    return folder / "a.npz", folder / "id.toml"


def loaded(folder: Path, name: str, log: dict[str, np.ndarray], *cures) -> Log:
    path, columns = written(folder, name, log, *cures)
    (one,) = load_logs([path], config.load(columns))
    return one


def estimated(folder: Path, name: str, log: dict[str, np.ndarray], *cures) -> Estimate:
    path, columns = written(folder, name, log, *cures)
    return identified([path], columns, lambda what, share: None).estimate


def factors(name: str, **by: float) -> dict[str, np.ndarray]:
    """The right log with each of these columns so many times larger."""
    return {key: by.get(key, 1.0) * values for key, values in right(name).items()}


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("table", [0.0, 1.0])
def test_a_log_in_the_right_units_is_told_without_a_word(tmp_path: Path, name: str, table: float) -> None:
    """A table that is on changes nothing: its current is in i_q, so the balance of torque holds."""
    plant = PLANTS[name]
    told = estimated(tmp_path, name, plant.log(table=table) if table else right(name))
    assert told.values["j"].value * plant.K_t == pytest.approx(plant.J, rel=0.01)
    assert told.values["c"].value * plant.K_t == pytest.approx(plant.c, rel=0.02)
    assert {wave.order for wave in told.cogging} == {order for order, *_ in plant.cogging}
    for order, size, _ in plant.cogging:
        (wave,) = [wave for wave in told.cogging if wave.order == order]
        assert abs(wave.size.value * plant.K_t - size) < JOINT_ERROR * wave.size.error * plant.K_t, order
    words = ("exchanged", "looks", "look ", "from the logged voltage, ")
    assert not [line for line in (*told.remarks, *told.left_out) if any(word in line for word in words)]


def cases(name: str) -> dict[str, tuple[dict[str, float], str, set[str]]]:
    """Factors of columns, the end of what is said, and the keys that its cure changes."""
    poles, fraction = PLANTS[name].pole_pairs, f"{1 / PLANTS[name].pole_pairs:g}"
    of_both = {"columns.theta.unit", "columns.omega.unit"}
    return {
        "degrees": ({"theta": DEGREES}, 'the angle looks like degrees: unit = "deg"', {"columns.theta.unit"}),
        "turns": (
            {"theta": 1 / TURN},
            'the angle looks like revolutions: unit = "rev"',
            {"columns.theta.unit"},
        ),
        "electrical angle": (
            {"theta": poles},
            f"the angle looks electrical: scale = 1/{poles}",
            {"columns.theta.scale"},
        ),
        "electrical degrees": (
            {"theta": poles * DEGREES},
            f'the angle looks like electrical degrees: unit = "deg" and scale = 1/{poles}',
            {"columns.theta.scale", "columns.theta.unit"},
        ),
        "rpm": ({"omega": 30 / math.pi}, 'the speed looks like rpm: unit = "rpm"', {"columns.omega.unit"}),
        "electrical speed": (
            {"omega": poles},
            f"the speed looks electrical: scale = 1/{poles}",
            {"columns.omega.scale"},
        ),
        "electrical rpm": (
            {"omega": poles * 30 / math.pi},
            f'the speed looks like electrical rpm: unit = "rpm" and scale = 1/{poles}',
            {"columns.omega.scale", "columns.omega.unit"},
        ),
        "mA": ({"i_q": 1e3}, 'expected the column\'s unit, such as unit = "mA"', {"columns.i_q.unit"}),
        "current sign": (
            {"i_q": -1.0},
            'expected the other sign: columns.i_q = { name = "i_q", sign = -1 }',
            {"columns.i_q.sign"},
        ),
        "both in degrees": (
            {"theta": DEGREES, "omega": DEGREES},
            'with the unit deg it does not jump: expected columns.theta.unit = "deg" and '
            'columns.omega.unit = "deg/s"',
            of_both,
        ),
        "both in turns": (
            {"theta": 1 / TURN, "omega": 1 / TURN},
            "theta and omega look in revolutions: expected "
            'columns.theta.unit = "rev" and columns.omega.unit = "rev/s"',
            of_both,
        ),
        "both electrical": (
            {"theta": poles, "omega": poles},
            "theta and omega look electrical: expected "
            f"columns.theta.scale = {fraction} and columns.omega.scale = {fraction}",
            {"columns.theta.scale", "columns.omega.scale"},
        ),
        "a thousandth": (
            {"i_q": 1e-3, "i_q_ref": 1e-3},
            "i_q is 1000 times too small: expected columns.i_q.scale = 1000 and columns.i_q_ref.scale = 1000",
            {"columns.i_q.scale", "columns.i_q_ref.scale"},
        ),
    }


CASES = list(cases("servo"))


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("case", CASES)
def test_a_column_in_a_wrong_unit_is_refused_and_its_cure_gives_the_right_log(
    tmp_path: Path, name: str, case: str
) -> None:
    by, said, keys = cases(name)[case]
    wrong = factors(name, **by)
    with pytest.raises(AdvisedError) as caught:
        estimated(tmp_path, name, wrong)
    line = next(line for line in caught.value.mistakes if isinstance(line, Advice) and said in line)
    assert "\n" not in line
    cure = next(cure for cure in line.cures if cure.keys() == keys)
    true, cured = loaded(tmp_path, name, right(name)), loaded(tmp_path, name, wrong, cure)
    assert len(cured) == len(true)
    for signal in true.signals:
        size = float(np.max(np.abs(true[signal])))
        assert cured[signal] == pytest.approx(true[signal], abs=1e-6 * size), signal


@pytest.mark.parametrize("case", ["current sign", "both electrical", "a thousandth"])
def test_the_values_of_a_cured_log_are_right(tmp_path: Path, case: str) -> None:
    by, said, _ = cases("servo")[case]
    with pytest.raises(AdvisedError) as caught:
        estimated(tmp_path, "servo", factors("servo", **by))
    (cure,) = (cure for line in advice_of(caught.value.mistakes) if said in line for cure in line.cures)
    told = estimated(tmp_path, "servo", factors("servo", **by), cure)
    plant = PLANTS["servo"]
    assert told.values["j"].value * plant.K_t == pytest.approx(plant.J, rel=0.01)
    assert {wave.order for wave in told.cogging} == {order for order, *_ in plant.cogging}


@pytest.mark.parametrize("name", PLANTS)
def test_a_reference_in_the_place_of_the_measured_current_is_told(tmp_path: Path, name: str) -> None:
    log = right(name)
    told = estimated(tmp_path, name, {**log, "i_q": log["i_q_ref"], "i_q_ref": log["i_q"]})
    (line,) = [line for line in advice_of(told.remarks) if "exchanged" in line]
    assert line.startswith("a.npz: i_q comes before i_q_ref, which it should follow (correlation of their")
    (cure,) = line.cures
    again = estimated(tmp_path, name, {**log, "i_q": log["i_q_ref"], "i_q_ref": log["i_q"]}, cure)
    assert not [line for line in again.remarks if "exchanged" in line]
    assert again.logs[0]["i_q"] == pytest.approx(log["i_q"])


@pytest.mark.parametrize(
    ("change", "factor"),
    [({"motor.R_s": "0.5 ohm"}, 1.0), ({"motor.R_s": "2 ohm"}, 1.0), ({"motor.K_t": "0.52 N*m/A"}, 1.0)],
)
def test_a_winding_or_a_k_t_of_another_size_is_no_unit(tmp_path: Path, change, factor: float) -> None:
    """Twice R, half of it, or K_t per rms ampere of two lines, sqrt(3): these are the datasheet's."""
    assert "j" in estimated(tmp_path, "servo", factors("servo", i_q=factor), change).values
