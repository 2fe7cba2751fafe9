"""Variants are spread as [vary] says, and the same everywhere."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import ensembles
import numpy as np
import pytest
from scipy.stats import qmc, spearmanr

from cogless.ensemble.variants import axes, draw, seeds, together
from cogless.errors import StudyError

COUNT = 1024


def drawn(folder: Path, vary: str, count: int = COUNT) -> dict[str, np.ndarray]:
    """Values of each key, SI."""
    ensemble = draw(ensembles.study(folder, vary=f"[vary]\n{vary}"), count)
    return {key: np.array(ensemble.si[key]) for key in ensemble.drawn}


@pytest.mark.parametrize(
    ("form", "low", "high"),
    [
        ('uniform = "20 %"', 2e-4, 3e-4),
        ('uniform = ["-20 %", "60 %"]', 2e-4, 4e-4),
        ('uniform = "0.5 kg*cm^2"', 2e-4, 3e-4),
        ('uniform = ["1 kg*cm^2", "3e-4 kg*m^2"]', 1e-4, 3e-4),
    ],
)
def test_uniform(tmp_path: Path, form: str, low: float, high: float) -> None:
    found = np.sort(drawn(tmp_path, f"mechanics.inertia = {{ {form} }}")["mechanics.inertia"])
    even = low + (high - low) * (np.arange(COUNT) + 0.5) / COUNT
    assert np.max(np.abs(found - even)) < 1.01 * (high - low) / COUNT  # one in each of equal parts


@pytest.mark.parametrize(
    ("form", "low", "high"),
    [('log = "100 %"', 1.25e-4, 5e-4), ('log = ["1 kg*cm^2", "1e-3 kg*m^2"]', 1e-4, 1e-3)],
)
def test_log(tmp_path: Path, form: str, low: float, high: float) -> None:
    found = np.sort(np.log(drawn(tmp_path, f"mechanics.inertia = {{ {form} }}")["mechanics.inertia"]))
    even = np.log(low) + np.log(high / low) * (np.arange(COUNT) + 0.5) / COUNT
    assert np.max(np.abs(found - even)) < 1.01 * np.log(high / low) / COUNT


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_ctrl_c_while_variants_are_drawn_ends_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The compiled code of SciPy drops it, and draws wrong numbers from then on."""

    class Pressed(qmc.Sobol):
        def __init__(self, *of: Any, **how: Any) -> None:
            with suppress(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGINT)
                super().__init__(*of, **how)

    monkeypatch.setattr(qmc, "Sobol", Pressed)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            drawn(tmp_path, 'mechanics.inertia = { uniform = "20 %" }', 2)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    monkeypatch.undo()
    with ThreadPoolExecutor(1) as other:  # signals are the main thread's
        assert other.submit(drawn, tmp_path, 'mechanics.inertia = { uniform = "20 %" }', 2).result()


@pytest.mark.parametrize("form", ['normal = "10 %"', 'normal = ["2.5e-4 kg*m^2", "0.25 kg*cm^2"]'])
def test_normal_ends_at_three_deviations(tmp_path: Path, form: str) -> None:
    found = drawn(tmp_path, f"mechanics.inertia = {{ {form} }}")["mechanics.inertia"]
    assert np.mean(found) == pytest.approx(2.5e-4, rel=1e-3)
    assert np.std(found) == pytest.approx(0.25e-4, rel=0.03)  # cut off at 3: 1.4 % less than without
    assert np.max(np.abs(found - 2.5e-4)) <= 3.001 * 0.25e-4


def test_corners_come_in_all_combinations(tmp_path: Path) -> None:
    keys = ("motor.R_s", "motor.L_d", "motor.L_q", "motor.psi_f")
    found = drawn(tmp_path, "\n".join(f'{key} = {{ corners = "10 %" }}' for key in keys), 64)
    assert set(found["motor.R_s"]) == {0.9, 1.1}
    combinations = np.column_stack([found[key] > np.median(found[key]) for key in keys])
    assert len(np.unique(combinations, axis=0)) == 16


def test_from_the_least_share_to_the_largest(tmp_path: Path) -> None:
    """Three deviations about a mean, halves of corners, and never beyond the last choice of a list."""
    vary = """[vary]
mechanics.inertia = { normal = "10 %" }
motor.R_s = { corners = "10 %" }
motor.pole_pairs = { list = [2, 4] }"""
    normal, corners, pairs = axes(ensembles.study(tmp_path, vary=vary))
    assert normal.spread is not None and corners.spread is not None
    ends = normal.spread(np.array([0.0, 0.5, 1.0]))
    assert ends == pytest.approx([1.75e-4, 2.5e-4, 3.25e-4])
    assert list(corners.spread(np.array([0.0, 0.49, 0.5, 1.0]))) == pytest.approx([0.9, 0.9, 1.1, 1.1])
    assert pairs.values(np.array([0.0, 0.49, 0.5, 1.0])) == [2, 2, 4, 4]


def test_a_percentage_is_of_a_values_magnitude(tmp_path: Path) -> None:
    (axis,) = axes(
        ensembles.study(
            tmp_path,
            {"scenario.low.reference": "-300 rpm"},
            '[vary]\nscenario.low.reference = { uniform = "10 %" }',
        )
    )
    assert axis.spread is not None and axis.unit == "rpm"
    assert axis.spread(np.array([0.0, 1.0])) == pytest.approx([-330, -270])


def test_a_percentage_of_a_plain_number_is_a_plain_number(tmp_path: Path) -> None:
    vary = '[vary]\ncontroller.pi-ilc.forgetting = { uniform = "5 %" }'
    (axis,) = axes(ensembles.study(tmp_path, {"controller.pi-ilc.forgetting": 0.8}, vary))
    assert axis.unit == "" and axis.values(np.array([0.0, 1.0])) == pytest.approx([0.76, 0.84])


def test_correlations_at_the_ends_and_of_one(tmp_path: Path) -> None:
    """Shares of none and of all stay numbers; keys that go together are the same mix of all."""
    keys = ("mechanics.inertia", "motor.R_s", "motor.psi_f")
    vary = "[vary]\n" + "\n".join(f'{key} = {{ uniform = "10 %" }}' for key in keys)
    study = ensembles.study(
        tmp_path, vary=f"{vary}\ntogether = [{{ keys = {list(keys)}, correlation = 1.0 }}]"
    )
    found = together(np.array([[0.0, 1.0, 1.0], [0.5, 0.5, 0.5], [0.1, 0.2, 0.3]]), axes(study), study)
    assert np.all((found >= 0) & (found <= 1)) and found[1] == pytest.approx([0.5] * 3)
    assert found == pytest.approx(np.repeat(found[:, :1], 3, axis=1))


@pytest.mark.parametrize(
    ("form", "least", "most"),
    [
        ("uniform = [62, 65]", 62, 65),
        ("uniform = [61.2, 65.9]", 62, 65),
        ('uniform = "3 %"', 63, 65),
        ("log = [62, 65]", 62, 65),
        ("normal = [64, 3]", 55, 73),
        ("corners = [62, 65]", 62, 65),
    ],
)
def test_a_key_of_whole_numbers_gets_whole_numbers(tmp_path: Path, form: str, least: int, most: int) -> None:
    ensemble = draw(ensembles.study(tmp_path, vary=f"[vary]\ncontroller.pi-ilc.cells = {{ {form} }}"), COUNT)
    cells = ensemble.drawn["controller.pi-ilc.cells"]
    assert {type(value) for value in cells} == {int}
    assert (min(cells), max(cells)) == (least, most)
    if form.startswith("uniform = ["):  # the ends are as likely as the others
        counts = [cells.count(value) for value in range(least, most + 1)]
        assert max(counts) - min(counts) <= 2


def test_a_list_is_drawn_evenly(tmp_path: Path) -> None:
    found = drawn(
        tmp_path, 'motor.pole_pairs = { list = [2, 4, 6, 8] }\nmotor.winding = { list = ["star", "delta"] }'
    )
    assert {value: np.count_nonzero(found["motor.pole_pairs"] == value) for value in (2, 4, 6, 8)} == {
        2: 256, 4: 256, 6: 256, 8: 256,
    }  # fmt: skip
    assert set(found["motor.winding"]) == {"star", "delta"}


@pytest.mark.parametrize("correlation", [-0.8, 0.5, 1.0])
def test_correlated_keys(tmp_path: Path, correlation: float) -> None:
    vary = """motor.R_s = { uniform = "20 %" }
motor.psi_f = { normal = "2 %" }
[[vary.together]]
keys = ["motor.R_s", "motor.psi_f"]
correlation = CORRELATION""".replace("CORRELATION", str(correlation))
    found = drawn(tmp_path, vary)
    ranks = spearmanr(found["motor.R_s"], found["motor.psi_f"]).statistic
    assert ranks == pytest.approx(6 / np.pi * np.arcsin(correlation / 2), abs=0.02)  # of a Gaussian copula
    # what each does alone stays as it was
    assert np.histogram(found["motor.R_s"], 4, (0.8, 1.2))[0] == pytest.approx(COUNT / 4, rel=0.02)


def test_a_key_without_a_value_needs_limits_and_the_magnet_by_any_of_its_keys(tmp_path: Path) -> None:
    found = drawn(tmp_path, 'motor.K_t = { uniform = "10 %" }')["motor.K_t"]
    assert np.mean(found) == pytest.approx(1.5 * 4 * 20e-3, rel=1e-3)
    with pytest.raises(StudyError, match="expected two limits, since the study has no value at this key"):
        drawn(tmp_path, 'mechanics.coulomb_friction = { uniform = "10 %" }')


def test_the_plant_varies_as_an_override_where_a_scenario_has_none(tmp_path: Path) -> None:
    """The law's own keys and the seed vary in the study itself, for every scenario."""
    vary = """[vary]
seeds = true
mechanics.inertia = { uniform = "20 %" }
controller.pi.kp = { list = ["0.01 A/rpm", "0.02 A/rpm"] }"""
    other = {"duration": "0.3 s", "reference": "300 rpm", "override": {"mechanics.inertia": "1e-3 kg*m^2"}}
    ensemble = draw(ensembles.study(tmp_path, {"scenario.high": other}, vary), 8)
    whole, low, high = (ensemble.changes(7, name) for name in (None, "low", "high"))
    inertia = next(key for key in whole if "inertia" in key)
    assert whole == low and set(low) - set(high) == {inertia}
    assert inertia == 'scenario.low.override."mechanics.inertia"'
    assert set(high) == {"controller.pi.kp", "seed"} and high["seed"] == 5 + 1 + 7
    assert sorted({*ensemble.si["controller.pi.kp"]}) == pytest.approx([0.3 / np.pi, 0.6 / np.pi])


def test_seeds_differ_and_fresh_ones_too(tmp_path: Path) -> None:
    study = ensembles.study(tmp_path, vary='[vary]\nmechanics.inertia = { uniform = "20 %" }\nseeds = true')
    first, fresh = draw(study, 100), draw(study, 100, fresh=1)
    assert first.drawn["seed"] == list(range(6, 106))
    assert not set(first.drawn["seed"]) & set(fresh.drawn["seed"])
    assert seeds(study.model_copy(update={"seed": 2**64 - 2}), 3) == [2**64 - 1, 0, 1]
    assert not set(first.drawn["mechanics.inertia"]) & set(fresh.drawn["mechanics.inertia"])


def test_the_first_of_a_longer_ensemble_are_the_same(tmp_path: Path) -> None:
    study = ensembles.study(tmp_path)
    short, long = draw(study, 10), draw(study, 1000)
    assert [short.changes(v) for v in range(10)] == [long.changes(v) for v in range(10)]
    assert short.changes(0) != draw(ensembles.study(tmp_path, {"seed": 6}), 10).changes(0)


MISTAKES = {
    'mechanics.inertai = { uniform = ["1 g", "2 g"] }': (
        'mechanics.inertai: "1.5 g": expected a known key, perhaps "inertia"'
    ),
    'nowhere.at = { uniform = ["1 s", "2 s"] }': "vary: nowhere: ",
    'mechanics.inertia = { uniform = ["3e-4 kg*m^2", "2e-4 kg*m^2"] }': (
        'vary.mechanics.inertia.uniform: ["3e-4 kg*m^2", "2e-4 kg*m^2"]: '
        "expected a range whose second limit is above its first"
    ),
    'mechanics.inertia = { uniform = ["3e-4 kg*m^2", "3e-4 kg*m^2"] }': (
        "expected a range whose second limit is above its first"
    ),
    'controller.pi.baseline = { uniform = "10 %" }': "expected the key of a number, or a list of values",
    'mechanics.inertia = { uniform = "0 %" }': (
        'vary.mechanics.inertia.uniform: "0 %": expected a deviation above zero'
    ),
    'mechanics.inertia = { uniform = ["1 s", "2 s"] }': (
        'vary.mechanics.inertia.uniform: "1 s": expected a number with a unit like "kg*m^2"'
    ),
    "mechanics.inertia = { uniform = [1, 2] }": (
        'vary.mechanics.inertia.uniform: 1: expected a text with a unit, such as "1 kg*m^2", or with %'
    ),
    'mechanics.inertia = { log = ["0 kg*m^2", "1 kg*m^2"] }': (
        'vary.mechanics.inertia.log: ["0 kg*m^2", "1 kg*m^2"]: expected limits above zero'
    ),
    'motor.cogging = { uniform = "10 %" }': (
        'vary.motor.cogging.uniform: "10 %": expected the key of a number, or a list of values'
    ),
    'motor.winding = { list = ["star", "triangle"] }': 'motor.winding: "triangle": expected ',
}


@pytest.mark.parametrize("vary", MISTAKES)
def test_mistakes_are_one_line_each(tmp_path: Path, vary: str) -> None:
    with pytest.raises(StudyError) as error:
        draw(ensembles.study(tmp_path, {"controller.pi.baseline": True}, f"[vary]\n{vary}"), 4)
    assert str(error.value).startswith(f"{tmp_path / 'study.toml'}: vary")
    assert MISTAKES[vary] in str(error.value) and len(str(error.value).splitlines()) == 1


WRONG_TABLES = {
    'mechanics.inertia = { unifrom = "1 %" }': (
        'vary.mechanics.inertia.unifrom: "1 %": expected a known key, perhaps "uniform"'
    ),
    'motor.R_s = { uniform = "1 %", log = "1 %" }': "expected one of uniform, log, normal, corners, list",
    'mechanics.inertia = { uniform = ["1 %"] }': "expected one number or two numbers",
    "motor.pole_pairs = { list = [] }": "expected one or more",
    "": "expected one or more keys that vary, or seeds = true",
    'mechanics.inertia = { uniform = "1 %" }\n'
    'together = [{ keys = ["mechanics.inertia", "x"], correlation = 0.5 }]': (
        'vary.together.0.keys.1: "x": expected one of mechanics.inertia'
    ),
}


@pytest.mark.parametrize("vary", WRONG_TABLES)
def test_a_wrong_table_is_told_when_the_study_is_read(tmp_path: Path, vary: str) -> None:
    with pytest.raises(StudyError) as error:
        ensembles.study(tmp_path, vary=f"[vary]\n{vary}")
    assert WRONG_TABLES[vary] in str(error.value) and len(str(error.value).splitlines()) == 1


def test_a_study_without_vary(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="vary: missing: expected a table of keys that vary"):
        draw(ensembles.study(tmp_path, vary=""), 4)
