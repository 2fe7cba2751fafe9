"""Up to which speed a law learns, by its orders, lead and filter."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from cogless.design import learning_loop
from cogless.design.law_rules import rules_of
from cogless.study.laws.periodic import PiIlc
from cogless.study.laws.pi_afc import PiAfc
from cogless.study.laws.space import SpaceSpeed


@pytest.mark.parametrize(
    ("law", "top"), [(PiAfc.model_construct(orders=(4, 9)), math.pi * 1e3 / 4), (SimpleNamespace(), None)]
)
def test_the_fastest_speed_that_is_learned(law: Any, top: float | None) -> None:
    rates = SimpleNamespace(outer_loop=1e3)
    study: Any = SimpleNamespace(controller={"x": law}, drive=SimpleNamespace(rates=rates))
    assert rules_of(study, "x").fastest() == (None if top is None else pytest.approx(top))


def test_a_period_has_at_least_four_samples_and_four_leads_and_its_filter() -> None:
    """A map's filter does not count: its width is in cells, not in samples."""
    in_map = SpaceSpeed.model_construct(memory="map", q_half_width=40)
    line = PiIlc.model_construct(memory="time", q_half_width=40)
    short = PiIlc.model_construct(memory="time", q_half_width=2)
    assert [learning_loop.fewest_samples(in_map, lead) for lead in (0, 1, 3)] == [4, 4, 12]
    assert [learning_loop.fewest_samples(line, lead) for lead in (0, 20)] == [41, 80]
    assert learning_loop.fewest_samples(short, 0) == 4
