"""A map over the angle that is too small for the orders that motor and load are known to have."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import studies
from cogless import load
from cogless.cli import printed
from cogless.design.design_table import design_table
from cogless.design.unlearned import map_warning, share_kept

LAW = {"law": "space-position", "k_theta": 5, "k_omega": 0.1, "mu_alpha": 0.1, "q_half_width": 0,
       "period": {"of": "mechanical"}}  # fmt: skip
COGGING = [{"order": 100, "torque": "4 mN*m"}, {"order": 24, "torque": "1 mN*m"}]


def warned(folder: Path, **law: Any) -> str | None:
    changes = {"controller.pi": {**LAW, **law}, "motor.cogging": COGGING}
    found = map_warning(load(studies.write(folder), changes), "pi")
    return None if found is None else str(found)


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        (1000, None),
        (
            600,
            "6 cells: linear interpolation between cells loses 8.8 % of the wave",
        ),
        (199, "1.99 cells: too few for a map to hold the wave"),
    ],
)
def test_it_is_told(cells: int, said: str | None, tmp_path: Path) -> None:
    """With 1000 cells the order grows at this gain. So 1000 are advised only if it grows already."""
    ways = "; cells = 1000 would be enough by calculation" if cells == 600 else ""
    wave = f"with cells = {cells} a wave of order 100 (mechanical) has only"
    assert warned(tmp_path, cells=cells) == (f"{wave} {said}{ways}" if said else None)


def test_a_filter_as_wide_as_the_wave_keeps_nothing_of_it(tmp_path: Path) -> None:
    assert warned(tmp_path, cells=3300, q_half_width=5) is None
    assert warned(tmp_path, cells=1100, q_half_width=5) == (
        "with cells = 1100 a wave of order 100 (mechanical) has only 11 cells: linear interpolation between "
        "cells and the Q filter over 11 cells together lose 100 % of the wave in each period; cells = 3300, "
        "or q_half_width = 1 would be enough by calculation"
    )
    weights = np.cos(2 * np.pi * np.arange(-2, 3) / 20)
    assert share_kept(20, 2) == pytest.approx(np.mean(weights) * np.sinc(1 / 20) ** 2)


def test_a_shorter_period_needs_fewer(tmp_path: Path) -> None:
    """An electrical revolution has 25 of the 100 waves."""
    assert warned(tmp_path, cells=250, period={"of": "electrical"}) is None
    said = warned(tmp_path, cells=240, period={"of": "electrical"})
    assert said is not None and "cells = 250 would be enough" in said


def test_of_older_laws_too(tmp_path: Path) -> None:
    ilc = {"law": "pi-ilc", "kp": 0.1, "ki": 1.0, "gain": 0.1, "cells": 600, "memory": "angle"}
    study = load(studies.write(tmp_path), {"controller.pi": ilc, "motor.cogging": COGGING})
    assert "with cells = 600 a wave of order 100 (mechanical) has only 6 cells" in str(
        map_warning(study, "pi")
    )


def test_where_there_is_no_map(tmp_path: Path) -> None:
    assert warned(tmp_path, cells=1000, memory="delay") is None
    assert warned(tmp_path, cells=40, learning=False) is None


def test_run_and_design_tell_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changes = {"controller.pi": {**LAW, "cells": 150}, "motor.cogging": COGGING}
    study = load(studies.write(tmp_path), changes)
    text = "controller.pi: with cells = 150 a wave of order 100 (mechanical) has only 1.5 cells"
    assert any(text in str(part) for part in design_table(study).renderables)
    printed.print_warnings(study, [("low", "pi")])
    assert f"Warning: {text}" in capsys.readouterr().err


def test_what_a_map_loses_comes_out_of_interpolation() -> None:
    """What straight lines leave of a wave, as a plain sum over the lines."""
    each, fine = 5, 1000
    x = np.arange(each * fine) / fine
    wave = np.interp(x, np.arange(each + 1), np.cos(2 * np.pi * np.arange(each + 1) / each))
    share = 2 * np.mean(wave * np.cos(2 * np.pi * x / each))
    assert share == pytest.approx(np.sinc(1 / each) ** 2, rel=1e-3)
