"""What `cogless design` prints: only what acts, in words, and no wider than a screen."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path
from typing import Any

import pytest
from engine import unpacked
from rich.console import Console

from cogless import load
from cogless.design.answers import to_dict
from cogless.design.design_table import _margins, design_table, shown_gain
from cogless.design.law_rules import Gain
from cogless.design.laws.periodic import PeriodicLoop
from cogless.design.laws.space_bounds import theorem
from cogless.design.margins import UNSTABLE, Margins
from cogless.design.summary import design, design_dict
from cogless.export.c.export_c import export_c
from cogless.run.drive_config import engine_config
from cogless.study import Study


def shown(table: Any, width: int = 500) -> str:
    file = io.StringIO()
    Console(file=file, width=width).print(table)
    return file.getvalue()


def printed(study: Any) -> str:
    return shown(design_table(study))


def test_a_bound_that_does_not_exist_is_said_in_words() -> None:
    slow = load("verrelli2016-speed", {"controller.learning.eta_bar": "2.5 rad/s"})
    found = theorem(slow, "learning")
    assert found is not None and not found.holds
    said = "no k is enough for the printed bound, the corrected bound or the bound with its own limits"
    assert found.verdict().endswith(f"; {said}")
    without = load("verrelli2016-position", {"controller.true-period.k_v": 0.0})
    found = theorem(without, "true-period")
    assert found is not None
    assert found.verdict().endswith("; no k_omega + v is enough for what footnote 6 asks without k_v")
    # what isn't learned takes no gain, however slow the reference
    text = printed(load("verrelli2016-speed", {"controller.learning.eta_bar": "2.5 rad/s",
                                               "controller.learning.mu_beta": 0.0}))  # fmt: skip
    assert not re.search(r"\b(inf|nan)\b", text)


def test_the_table_shows_what_acts() -> None:
    """Neither learning keys of a law that may not learn nor gains of zero."""
    study = load("verrelli2016")
    assert isinstance(study, Study)
    found, plain = design_table(study), to_dict(study)["controllers"]
    text = shown(found)
    rows = {line.split("  ")[0]: line for line in text.splitlines()}
    assert not re.search("mu_|cells|q_half|ramp|omega_min|learning_start", rows["PI, as published"])
    assert "mu_alpha" in text and "k_v 0" not in text
    assert "mu_alpha" not in plain["pi"]["gains"] and "k_v" in plain["filtered"]["gains"]
    assert "k_pp" in plain["printed"]["gains"] and "k_pp" not in plain["filtered"]["gains"]
    table = shown(found, width=240).split("Known bounds")[0]
    assert max(len(line.rstrip()) for line in table.splitlines()) < 210


@pytest.mark.parametrize(("lead", "samples"), [("0.6 ms", 2), ("0.65 ms", 3)])
def test_a_lead_is_rounded_to_the_nearest_sample_everywhere(lead: str, samples: int, tmp_path: Path) -> None:
    rates = {"current_loop": "20 kHz", "speed_loop": "4 kHz"}
    study = load("uomodri", {"drive.rates": rates, "controller.pi-ilc.lead": lead})
    assert isinstance(study, Study)
    config = engine_config(study, next(iter(study.scenario)), "pi-ilc")
    assert unpacked(config)["controller"]["config"]["memory"]["lead"] == samples
    assert PeriodicLoop(study, "pi-ilc", 1.0).lead == samples
    gain = design(study, "pi-ilc").gains["lead"]
    assert gain.value == pytest.approx(samples / 4000) and gain.note.startswith(f"{samples} samples")
    export_c(study, "pi-ilc", tmp_path / "out")
    (source,) = (tmp_path / "out").glob("*_controller.c")
    assert f".lead = {samples}," in source.read_text()


def test_a_lead_is_shown_as_it_is_used() -> None:
    """The controller counts whole samples of the speed loop."""
    rates = {"current_loop": "20 kHz", "speed_loop": "4 kHz"}
    coarse = load("uomodri", {"drive.rates": rates})  # its lead is 0.6 ms
    assert "lead 0.0005 s (2 samples; 0.0006 s asked for)" in printed(coarse)
    lead = design_dict(design(coarse, "pi-ilc"))["gains"]["lead"]
    assert lead == {"value": 0.0005, "unit": "s", "note": "2 samples; 0.0006 s asked for"}
    none = load("uomodri", {"drive.rates": rates, "controller.pi-ilc.lead": "0.1 ms"})
    leads = [shown_gain(design(study, "pi-ilc").gains["lead"]) for study in (none, load("uomodri"))]
    assert leads == ["0 s (0 samples; 0.0001 s asked for)", "0.0006 s"]


TURN = 2 * math.pi


@pytest.mark.parametrize(
    ("margins", "cells"),
    [
        (None, ("", "", "")),
        (UNSTABLE, ("", "unstable", "")),
        (Margins(True, 12.3456 * TURN, 0.5, 2.345, 80 * TURN), ("12.35 Hz", "28.6 deg", "2.35 at 80 Hz")),
        (Margins(True, 12 * TURN, 1.0, math.nan, math.nan), ("12 Hz", "57.3 deg", "none")),
        (Margins(True, math.nan, math.nan, 2.0, 80 * TURN), ("none", "none", "2.00 at 80 Hz")),
    ],
)
def test_margins_that_a_loop_has_or_lacks(margins: Margins | None, cells: tuple[str, str, str]) -> None:
    assert _margins(margins) == cells


def test_a_gain_is_shown_in_its_datasheet_s_unit_with_its_note() -> None:
    told = [Gain(0.5, "A*s/rad"), Gain(2.34567, "1/s"), Gain(12.0, ""), Gain(4e-3, "s", "4 samples")]
    assert [shown_gain(gain) for gain in told] == ["0.05236 A/rpm", "2.346 1/s", "12", "0.004 s (4 samples)"]
