"""What the README says is so: its figures are those of the studies, and the guide's whole study runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cogless import load, run_study

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_whole_study_of_the_guide_runs_and_learns(tmp_path: Path) -> None:
    guide = (ROOT / "docs" / "guide" / "study-file.md").read_text(encoding="utf-8")
    block = re.search(r"```toml\n(.*?)```", guide, re.DOTALL)
    assert block is not None
    (tmp_path / "mine.toml").write_text(block[1], encoding="utf-8")
    pi, learning = run_study(load(tmp_path / "mine.toml"), jobs=2).runs
    assert learning.metrics["speed_ripple_rad_s"] < 0.2 * pi.metrics["speed_ripple_rad_s"]


def test_the_figures_of_liu_are_the_studys() -> None:
    text = re.search(r"On the motor of \[Liu 2018\].*?\n\n", README, re.DOTALL)
    assert text is not None
    pi, robust, within, lead = (
        float(x) for x in re.findall(r"(?:leaves?|within)\s+(\d+(?:\.\d+)?)", text[0])
    )
    runs = run_study(
        load("liu2018"),
        ["60-rpm/pi", "60-rpm/robust-ilc", "60-rpm/pi-ilc-lead", "60-rpm-long/*printed"],
        jobs=2,
    ).runs
    found = {run.controller: run.metrics for run in runs}
    ripple = [
        found[name]["speed_ripple_rad_s"] * 30.0 / np.pi for name in ("pi", "robust-ilc", "pi-ilc-lead")
    ]
    assert [pi, robust, lead] == [float(f"{x:.2g}") for x in ripple]
    assert within - 1.0 < found["pi-ilc-printed"]["diverges_after_s"] < within


def test_the_figures_under_the_picture_are_the_demos() -> None:
    figures = [float(x) for x in re.findall(r"^\| .* \| ([\d.]+) \|$", README, re.MULTILINE)]
    runs = run_study(load("uomodri"), ["1-rev-s/*"], jobs=2).runs
    ripple = {run.controller: run.metrics["speed_ripple_rad_s"] * 30.0 / np.pi for run in runs}
    off = {"controller.harmonic.learning_start": "1000 s"}
    (alone,) = run_study(load("uomodri", off), ["1-rev-s/harmonic"]).runs
    ripple["alone"] = alone.metrics["speed_ripple_rad_s"] * 30.0 / np.pi
    names = ("pi", "table", "pi-ilc", "robust-ilc", "harmonic", "alone")
    assert figures == [float(f"{ripple[name]:.2g}") for name in names]
    copper = {run.controller: run.metrics["copper_loss_W"] for run in runs}
    saved = re.search(r"(\d+) % less copper loss", README)
    assert saved is not None
    assert int(saved[1]) == round(100 * (1 - copper["pi-ilc"] / copper["pi"]))
