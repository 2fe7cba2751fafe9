"""The current i_q that a motion needs, which a learning law has to find."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cogless.report.packing import Array
from cogless.results import Results, Run
from cogless.study import for_scenario


def needed_current(results: Results, run: Run) -> Callable[[slice], Array] | None:
    """The i_q whose torque would produce the reference's motion, as a function of the trace's rows.

    None if the trace lacks the signals for it.

    It is the run's own current, corrected by the torque that is missing for the reference's speed and
    acceleration. So it doesn't depend on assumed flux harmonics. With a tracking error it is valid at the
    rotor's angle.
    """
    trace = run.trace
    if "alpha_ref" not in trace or "tau_cogging" not in trace:
        return None
    study = for_scenario(results.study, run.scenario)
    mechanics, K_t = study.mechanics.stiff, study.motor.star().K_t

    def needed(rows: slice) -> Array:
        speed, alpha, load, cogging, i_q, tau_e = (
            trace.part(name, rows)
            for name in ("omega_ref", "alpha_ref", "tau_load", "tau_cogging", "i_q", "tau_e")
        )
        friction = mechanics.viscous_friction * speed + mechanics.coulomb_friction * np.sign(speed)
        torque = mechanics.inertia * alpha + friction + load / study.mechanics.ratio - cogging
        return np.asarray(i_q + (torque - tau_e) / K_t)

    return needed
