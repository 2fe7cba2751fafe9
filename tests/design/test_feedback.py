"""Which feedback a controller is, and in which scenario it is unstable."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from cogless.design import law_rules
from cogless.design.closed_loop import Linear, Oscillation
from cogless.study.laws.periodic import RobustIlc


@pytest.mark.parametrize(
    ("keys", "unstable", "said"),
    [
        (["a", "b"], {("b", 4.0)}, "feedback unstable, at 88 Hz in scenario b"),
        (["b"], {("b", 2.0)}, "feedback unstable, at 88 Hz"),
        (["a", "b"], {("c", 2.0)}, None),
    ],
)
def test_the_first_scenario_with_unstable_feedback_is_named(
    monkeypatch: pytest.MonkeyPatch, keys: list[str], unstable: set[tuple[str, float]], said: str | None
) -> None:
    monkeypatch.setattr(law_rules, "feedback_of", lambda study, name, omega_m: omega_m)
    monkeypatch.setattr(law_rules, "speed_loop", lambda study, key: key)
    grows = Oscillation(87.6, 3.0)
    monkeypatch.setattr(
        law_rules, "oscillation", lambda key, speed: grows if (key, speed) in unstable else None
    )
    ends = SimpleNamespace(slowest=2.0, top_reference=4.0)
    study: Any = SimpleNamespace(scenarios_of=lambda name: keys, scenario=dict.fromkeys("abc", ends))
    assert law_rules.unstable_feedback(study, "x") == said


def test_robust_ilc_s_feedback_has_an_integral_of_its_sliding_variable() -> None:
    law = RobustIlc.model_construct(b=20.0, c=30.0, eta=10.0, q=0.5, g=0.0, gamma=60.0)
    study: Any = SimpleNamespace(controller={"x": law})
    k, k_i = law.linear
    assert law_rules.feedback_of(study, "x") == Linear(
        ratio=1, k=k, k_theta=0.0, k_i=k_i, k_v=0.0, k_r=3.0, c=30.0
    )
