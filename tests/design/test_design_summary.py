"""What a design says of a controller in a line, and of its lead."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from cogless.design.laws.periodic import LearningRules
from cogless.design.summary import Design
from cogless.design.verdict import Verdict


def test_a_design_says_up_to_which_speed_it_learns() -> None:
    found = Verdict("settles", unit="rpm")
    one = Design("pi-ilc", None, {}, None, found, fastest=math.tau)
    assert one.in_words() == "settles; learns up to 60 rpm"
    fine = Design("pi-ilc", None, {}, None, Verdict("settles"), fastest=1.23456789)
    assert fine.in_words() == "settles; learns up to 1.23457 rad/s"
    assert Design("pi-ilc", None, {}, None, found).in_words() == "settles"
    assert Design("pi", None, {}, None, None, fastest=math.tau).in_words() == ""
    certified: Any = SimpleNamespace(clauses=["all settle"])
    assert (
        Design("harmonic", None, {}, None, found, fastest=1.0, certificate=certified).in_words()
        == "all settle"
    )


@pytest.mark.parametrize(
    ("lead", "value", "note"),
    [(2e-3, 2e-3, ""), (1.4e-3, 1e-3, "1 samples; 0.0014 s asked for"), (2e-3 * (1 + 1e-10), 2e-3, "")],
)
def test_a_lead_is_told_in_whole_samples(lead: float, value: float, note: str) -> None:
    drive, law = SimpleNamespace(rates=SimpleNamespace(outer_loop=1e3)), SimpleNamespace(lead=lead)
    study: Any = SimpleNamespace(drive=drive, controller={"x": law})
    found = LearningRules(study, "x").numbers_used()["lead"]
    assert (found.value, found.unit, found.note) == (pytest.approx(value), "s", note)
