"""What a law starts from of another's map, in closed form, and how maps are shown."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogless.errors import StudyError
from cogless.maps import learned_map, stored_map
from cogless.maps.learned_map import entries, entries_within, of_current, resampled
from cogless.maps.stored_map import (
    COSINE_CODE,
    CURRENT_CODE,
    ORDER_CODE,
    SINE_CODE,
    FlashPlace,
    MapError,
    StoredMap,
    Valid,
)
from cogless.study.laws.own import PythonLaw

TURN = 2 * np.pi


def wave(cells: int, periods: int = 1, size: float = 0.5) -> np.ndarray:
    """A current over a period: a mean, and orders 3 and 5."""
    angle = TURN * periods * np.arange(cells) / cells
    return 0.1 + size * np.sin(3 * angle + 0.4) + 0.2 * np.cos(5 * angle)


def law(
    cells: int = 100, units: tuple[int, ...] = (CURRENT_CODE,), turns: int = 1, parts: int = 1, **more: Any
) -> Any:
    values = np.zeros((len(units), cells))
    return {"values": values, "units": units, "limits": [3.0] * len(units), "turns": turns, "parts": parts,
            "ratio": 1, **more}  # fmt: skip


def stored(values: Any, units: tuple[int, ...] = (CURRENT_CODE,), **more: Any) -> StoredMap:
    return StoredMap(np.atleast_2d(values), units, (3.0,) * len(units), **more)


def test_another_number_of_cells_keeps_what_both_resolve() -> None:
    assert resampled(wave(64), 100) == pytest.approx(wave(100))
    assert resampled(wave(100), 12) == pytest.approx(wave(12))
    assert resampled(wave(100), 10) == pytest.approx(0.1 + 0.5 * np.sin(3 * TURN * np.arange(10) / 10 + 0.4))
    same = wave(64)
    assert resampled(same, 64) is not None and resampled(same, 64).tolist() == same.tolist()


def test_a_map_of_a_shorter_period_is_repeated() -> None:
    """An electrical revolution of four pole pairs is a quarter: four of them in the law's revolution."""
    quarter = stored(wave(64), parts=4)
    assert entries(quarter, law(256), 1.0) == pytest.approx(wave(256, 4)[None], abs=1e-6)
    assert entries(quarter, law(50, turns=1, parts=2), 1.0) == pytest.approx(wave(50, 2)[None], abs=1e-6)
    with pytest.raises(
        MapError, match=r"^a map over a revolution: expected one over the law's period, 1/4 of a"
    ):
        entries(stored(wave(64)), law(parts=4), 1.0)
    with pytest.raises(MapError, match="a trial's signal: expected a map over the angle"):
        entries(stored(wave(64), turns=0, parts=0), law(), 1.0)


def test_a_current_becomes_the_laws_own_unit_in_its_first_channel() -> None:
    """Unless both are of one kind: a law of two channels takes them as they are, in its own frame."""
    found = entries(stored(wave(64)), law(64, (2, 3)), 2.5)
    assert found[0] == pytest.approx(2.5 * wave(64), abs=1e-6) and not found[1].any()
    both = stored([wave(64), 2 * wave(64)], (2, 3), ratio=4)
    taken = entries(both, law(64, (2, 3), ratio=4), 2.5)
    assert taken == pytest.approx(np.array([wave(64), 2 * wave(64)]), abs=1e-6)
    with pytest.raises(MapError, match=r": expected a map of this law's kind, or of a current only$"):
        entries(both, law(64, (2, 3), ratio=1), 2.5)
    alone = entries(stored(wave(64), ratio=4), law(64, ratio=1), 2.5)
    assert alone == pytest.approx(wave(64)[None], abs=1e-6)  # one channel of its own unit


ORDERS = law(
    2,
    (COSINE_CODE, SINE_CODE, ORDER_CODE),
    values=np.array([[0, 0], [0, 0], [3, 5]], float),
    limits=[3.0, 3.0, 9.0],
)


def test_orders_have_the_amplitudes_of_the_current() -> None:
    """0.5 sin(3 x + 0.4) + 0.2 cos 5 x, and back."""
    found = of_current(wave(64), ORDERS, 1.0)
    assert found[2].tolist() == [3, 5]
    assert found[0] == pytest.approx([0.5 * np.sin(0.4), 0.2])
    assert found[1] == pytest.approx([0.5 * np.cos(0.4), 0.0], abs=1e-12)
    assert of_current(wave(11), ORDERS, 1.0)[0] == pytest.approx([0.5 * np.sin(0.4), 0.2])
    with pytest.raises(
        MapError, match=r"^a map of 10 entries, which hold orders up to 4: expected orders up to the law's 5$"
    ):
        of_current(wave(10), ORDERS, 1.0)
    kept = stored(found, (COSINE_CODE, SINE_CODE, ORDER_CODE))
    assert entries(kept, ORDERS, 1.0) == pytest.approx(found, abs=1e-6)
    assert entries(kept, law(40), 1.0)[0] == pytest.approx(wave(40) - 0.1, abs=1e-6)  # orders have no mean
    other = {**ORDERS, "values": np.array([[0, 0], [0, 0], [3, 4]], float)}
    assert entries(kept, other, 1.0)[0] == pytest.approx([0.5 * np.sin(0.4), 0.0], abs=1e-6)


def test_entries_beyond_the_limit_are_refused_and_rounding_is_cut() -> None:
    assert entries_within(np.array([[3.0 + 1e-6, -3.0 - 1e-6]]), law(2)).tolist() == [[3.0, -3.0]]
    with pytest.raises(MapError, match=r"^an entry of 3.1: expected at most the law's limit, 3$"):
        entries_within(np.array([[0.0, -3.1]]), law(2))
    with pytest.raises(MapError, match=r"^an entry of 3: expected"):
        entries_within(np.array([[0.0, 3.0 * (1 + 1.5e-6)]]), law(2))
    with pytest.raises(MapError, match="an entry of nan"):
        entries_within(np.array([[np.nan, 0.0]]), law(2))


def test_maps_as_lines() -> None:
    """The newest with all its fields; of several each with its place."""
    one = stored([[0.3, -0.4, 0.0, 0.0]], parts=4, motor=0x1F2E3D4C, sequence=5, law=1, motion=0xAB, ratio=7)
    two = replace(one, turns=2, parts=1, sequence=4, motion=0, ratio=1)
    rows = dict(stored_map.map_rows(one))
    assert list(rows) == [
        "learned by", "motor", "motion", "save", "period", "cells", "rad of the units", "current",
    ]  # fmt: skip
    assert (rows["motor"], rows["motion"], rows["save"]) == ("0x1F2E3D4C", "0x000000AB", "5")
    assert rows["period"] == "1/4 of a mechanical revolution, 90 deg" and rows["cells"] == "4"
    assert rows["rad of the units"] == "of 7 theta_m"
    assert rows["current"] == "rms 0.25, peak 0.4, limit 3 A"
    plain = dict(stored_map.map_rows(two))
    assert "motion" not in plain and "rad of the units" not in plain
    assert plain["period"] == "2 mechanical revolutions, 720 deg"
    trial = dict(stored_map.map_rows(replace(one, turns=0, parts=0)))
    assert trial["period"] == "a trial" and trial["samples"] == "4"
    of_orders = stored([[0.1, 0.2], [0.0, 0.0], [6, 12]], (COSINE_CODE, SINE_CODE, ORDER_CODE))
    shown = dict(stored_map.map_rows(of_orders))
    assert (
        shown["orders"] == "2" and shown["period"] == "a mechanical revolution" and "6, 12" in shown.values()
    )
    alone = stored_map.map_lines([FlashPlace(0, one)], Valid(0, one))
    assert alone[0] == "a valid map" and alone[1] == f"  {'learned by':<26}{rows['learned by']}"
    several = stored_map.map_lines(
        [FlashPlace(0, "no mark"), FlashPlace(64, two), FlashPlace(128, one)], Valid(128, one)
    )
    assert several[:3] == [
        "At byte 0: no mark",
        "At byte 64: a valid map, save number 4",
        "At byte 128: a valid map, the newest",
    ]
    assert several[3:] == alone[1:]


def test_maps_as_csv() -> None:
    quarter = stored([[0.3, -0.4, 0.0, 0.125]], parts=4)
    head, *rows = stored_map.to_csv(quarter).splitlines()
    assert head.startswith("theta_m_rad,") and len(rows) == 4
    assert [float(row.split(",")[0]) for row in rows] == pytest.approx(TURN / 16 * np.arange(4), rel=1e-8)
    assert [float(row.split(",")[1]) for row in rows] == pytest.approx([0.3, -0.4, 0.0, 0.125], rel=1e-6)
    assert stored_map.to_csv(replace(quarter, turns=0, parts=0)).splitlines()[1].startswith("0,0.3")
    assert stored_map.to_csv(replace(quarter, turns=0, parts=0)).startswith("sample,")
    of_orders = stored([[0.1, 0.2], [0.0, 0.0], [6, 12]], (COSINE_CODE, SINE_CODE, ORDER_CODE))
    assert stored_map.to_csv(of_orders).splitlines()[2] == "1,0.200000003,0,12"


def test_a_motors_identity_has_32_bits() -> None:
    assert [stored_map.identity(text) for text in ("0x1F", "0X1f", "31", "0", "0xFFFFFFFF")] == [
        31, 31, 31, 0, 2**32 - 1,
    ]  # fmt: skip
    for wrong in ("0x100000000", "-1", "1F", "x", ""):
        with pytest.raises(StudyError, match=f'--motor: "{wrong}": expected 32 bits'):
            stored_map.identity(wrong)


def test_a_map_is_of_a_current_over_a_revolution_by_another_law_unless_it_says_more() -> None:
    plain = StoredMap(np.zeros(4), (CURRENT_CODE,), (3.0,))
    assert (plain.law_name, plain.turns, plain.parts, plain.ratio) == ("other", 1, 1, 1)
    assert (plain.motor, plain.motion, plain.sequence, plain.write_size) == (0, 0, 1, 8)


def test_currents_of_orders_are_over_eight_angles_a_wave() -> None:
    orders = np.array([[0.5, 0.0], [0.1, -0.2], [1.0, 3.0]])
    found = learned_map._over_angle(*orders)
    angle = TURN / 24 * np.arange(24)
    assert found["frame"] == "mechanical" and found["angle"] == pytest.approx(angle)
    current = 0.5 * np.cos(angle) + 0.1 * np.sin(angle) - 0.2 * np.sin(3 * angle)
    assert found["current"] == pytest.approx(current)


def test_a_run_s_map_is_cut_to_its_limits_and_its_period_to_lowest_terms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(learned_map, "study_identity", lambda study: 0xABCD)
    of_run: Any = {
        "values": [[4.0, -4.0, 1.0]],
        "limits": [3.0],
        "units": [CURRENT_CODE],
        "law": 2,
        "ratio": 5,
    }
    made = learned_map.of_run(None, {**of_run, "turns": 4, "parts": 6}, 7)
    assert made is not None and made.values.tolist() == [[3.0, -3.0, 1.0]]
    assert (made.turns, made.parts, made.ratio, made.law, made.motor, made.motion) == (2, 3, 5, 2, 0xABCD, 7)
    trial = learned_map.of_run(None, {**of_run, "turns": 0, "parts": 0})
    assert trial is not None and (trial.turns, trial.parts, trial.motion) == (0, 0, 0)
    assert learned_map.of_run(None, None) is None


@pytest.mark.parametrize(
    ("law", "period", "frame", "turn"),
    [
        (PythonLaw.model_construct(object="law.py:Law"), (1, 4), "electrical", 1.0),
        (PythonLaw.model_construct(object="law.py:Law"), (1, 2), "mechanical", 0.5),
        (SimpleNamespace(code=None, unit=0.1, ratio=lambda poles: poles), (1, 2), "electrical", 2.0),
        (SimpleNamespace(code=None, unit=0.1, ratio=lambda poles: poles), (1, 1), "mechanical", 1.0),
        (SimpleNamespace(code=None, unit=0.1, ratio=lambda poles: 1), (1, 2), "mechanical", 0.5),
    ],
)
def test_a_memory_s_currents_are_over_the_angle_of_its_law(
    law: Any, period: tuple[int, int], frame: str, turn: float
) -> None:
    """With four pole pairs. A user's own law is over the electrical angle if its period is one such turn."""
    four_pairs = SimpleNamespace(pole_pairs=4)
    study: Any = SimpleNamespace(controller={"x": law}, precision="double", conditions=lambda _: four_pairs)
    of_run = {
        "units": [CURRENT_CODE],
        "values": np.array([[2.0, 4.0]]),
        "turns": period[0],
        "parts": period[1],
    }
    found = learned_map.memory_of(study, "s", "x", of_run)
    assert found["frame"] == frame and found["angle"] == pytest.approx([0.0, turn * TURN / 2])
    for precision, unit in (("double", law.unit), ("single", float(np.float32(law.unit)))):
        study.precision = precision
        current = learned_map.memory_of(study, "s", "x", of_run)["current"]
        assert current.tolist() == [1 / unit * x for x in (2.0, 4.0)]
    assert learned_map.memory_of(study, "s", "x", None) == {}
