"""The linear feedback of each law, and where it is unstable."""

from __future__ import annotations

from cogless.design.closed_loop import Linear, oscillation
from cogless.design.pi import gains, speed_loop
from cogless.design.position import feedback_at
from cogless.study import Study
from cogless.study.controller import Feedback, RobustIlc
from cogless.study.space_controller import SpacePosition, SpaceSpeed


def feedback_of(study: Study, name: str, omega_m: float = 0.0) -> Linear | None:
    """A controller's linear feedback before it learns, at a speed in rad/s; None of a user's own law."""
    law = study.controller[name]
    if isinstance(law, SpacePosition):
        return feedback_at(study, name, omega_m)
    if isinstance(law, SpaceSpeed):
        return Linear(1, law.k)
    if isinstance(law, Feedback):
        kp, ki = gains(study, name)
    elif isinstance(law, RobustIlc):
        # (c e + eta S) / b with S = e + c integral(e)
        kp, ki = (law.c + law.eta) / law.b, law.c * law.eta / law.b
    else:
        return None
    return Linear(1, kp, k_i=ki)


def unstable_feedback(study: Study, name: str) -> str | None:
    """The first scenario in which the feedback is unstable, and at which frequency; None if in none."""
    keys = study.scenarios_of(name)
    for key in keys:
        speeds = {study.scenario[key].slowest, study.scenario[key].top_reference}
        for feedback in (feedback_of(study, name, omega_m) for omega_m in sorted(speeds)):
            found = feedback and oscillation(speed_loop(study, key), feedback)
            if found:
                where = f" in scenario {key}" if len(keys) > 1 else ""
                return f"feedback unstable, at {found.frequency:.0f} Hz{where}"
    return None
