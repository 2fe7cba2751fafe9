"""The current i_q that a motion needs, which a learning law has to find."""

from __future__ import annotations

import numpy as np

from cogless.report.packing import Array
from cogless.results import Results, Run
from cogless.study import for_scenario


def needed_current(results: Results, run: Run) -> Array | None:
    """The i_q whose torque would produce the reference's motion; None if the trace lacks the signals for it.

    It is the run's own current, corrected by the torque that is missing for the reference's speed and
    acceleration. So it doesn't depend on assumed flux harmonics. With a tracking error it is valid at the
    rotor's angle.
    """
    trace = run.trace
    if "alpha_ref" not in trace or "tau_cogging" not in trace:
        return None
    study = for_scenario(results.study, run.scenario)
    mechanics, speed = study.mechanics, trace["omega_ref"]
    friction = mechanics.viscous_friction * speed + mechanics.coulomb_friction * np.sign(speed)
    torque = mechanics.inertia * trace["alpha_ref"] + friction + trace["tau_load"] - trace["tau_cogging"]
    return np.asarray(trace["i_q"] + (torque - trace["tau_e"]) / study.motor.star().K_t)
