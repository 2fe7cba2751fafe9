"""The linear feedback of each law, and the first scenario in which it is unstable."""

from __future__ import annotations

from dataclasses import astuple

from cogless.design.closed_loop import Linear, feedback_at, harmonic_gains, oscillation
from cogless.design.speed_loop import gains, speed_loop
from cogless.study import Study
from cogless.study.laws.harmonic import Harmonic
from cogless.study.laws.law import Feedback
from cogless.study.laws.periodic import RobustIlc
from cogless.study.laws.space import SpacePosition

FeedbackNumbers = list[tuple[float, ...]]


def feedback_of(study: Study, name: str, omega_m: float = 0.0) -> Linear | None:
    """A controller's linear feedback before it learns, at a speed in rad/s; None for a user's own law."""
    law = study.controller[name]
    if isinstance(law, SpacePosition):
        return feedback_at(study, name, omega_m)
    if isinstance(law, Harmonic):
        k_theta, kp, ki = harmonic_gains(study, name)
        return Linear(ratio=1, k=kp, k_theta=k_theta, k_i=ki)
    if isinstance(law, RobustIlc):
        return Linear(ratio=1, k=law.linear[0], k_i=law.linear[1], k_r=law.gamma / law.b, c=law.c)
    pi = gains(study, name) if isinstance(law, Feedback) else law.linear
    return None if pi is None else Linear(ratio=1, k=pi[0], k_i=pi[1])


def feedback_numbers(study: Study, name: str) -> FeedbackNumbers | None:
    """A controller's feedback at rest and at its top speed, to six digits; None for a user's own law."""
    top = max((study.scenario[key].top_reference for key in study.scenarios_of(name)), default=0.0)
    laws = [feedback_of(study, name, omega) for omega in (0.0, top)]
    return [tuple(float(f"{x:.6g}") for x in astuple(law)) for law in laws if law is not None] or None


def unstable_feedback(study: Study, name: str) -> str | None:
    """Message on the first scenario with unstable feedback, and the frequency; None if all are stable."""
    keys = study.scenarios_of(name)
    for key in keys:
        speeds = {study.scenario[key].slowest, study.scenario[key].top_reference}
        for feedback in (feedback_of(study, name, omega_m) for omega_m in sorted(speeds)):
            found = feedback and oscillation(speed_loop(study, key), feedback)
            if found:
                where = f" in scenario {key}" if len(keys) > 1 else ""
                return f"feedback unstable, at {found.frequency:.0f} Hz{where}"
    return None
