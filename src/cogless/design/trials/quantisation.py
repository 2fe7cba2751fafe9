"""What the steps of a position sensor leave of error, before anything is run.

The error of the angle that the law gets is taken as white noise, even over a step, so of the variance
step^2 / 12. That is so while the motion passes a step or more in a sample. In a trial the noise passes
through the loop; and it is learned, and then repeated and learned again. At each frequency, with F of
response.py, the noise n and v's update v <- F v + H R T n, the variances add up:

    v after k trials   |H R T|^2 (1 - |F|^2k) / (1 - |F|^2) step^2 / 12
    error              |T_y|^2 step^2 / 12 + |G_y|^2 (that of v)

An axis at rest may keep to a limit cycle within a few steps instead. That is no noise, and no bound here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.design.trials.certificate import Gains, Update
from cogless.design.trials.model import Model, Real
from cogless.design.trials.response import Bundle, Filter, Filtered
from cogless.design.trials.sensing import Sensor
from cogless.design.trials.trial_observer import ObserverGains

STEP_FREQUENCIES = 400  # frequencies at which the noise of the steps is computed


@dataclass(frozen=True)
class Steps:
    """RMS of the error that the sensor's steps leave, of each plant."""

    feedback: Real  # (plants,)
    learned: Real  # (plants, trials counted), after so many trials
    count: bool = True  # whether the certificate counts them


def steps(
    models: Sequence[Model],
    C: Real,
    law: Gains | ObserverGains,
    update: Update | None,
    q_filter: Filter | None,
    filtered: Filtered,
    *,
    sensor: Sensor,
    period: float,
    trials: Sequence[int],
) -> Steps:
    """What the steps leave with these gains, without learning and after so many trials."""
    if not sensor.step:
        return Steps(np.zeros(len(models)), np.zeros((len(models), len(trials))))
    w = (np.arange(STEP_FREQUENCIES) + 0.5) * np.pi / STEP_FREQUENCIES
    variance = sensor.step**2 / 12
    response = np.array([sensor.powers(law.disturbed(model, C), w, period) for model in models])
    error, lesson, _ = response.transpose(1, 0, 2)
    feedback = np.sqrt(variance * error.mean(axis=1))
    learned = np.repeat(feedback[:, None], len(trials), axis=1)
    if update is not None:
        H = np.ones(len(w)) if q_filter is None else q_filter.gain(w)
        ahead = np.exp(1j * w * update.shift)
        reads = update.gain * np.abs(update.on(ahead[None, :], w))
        G = update.gain * update.on(Bundle([law.closed(m, C) for m in models], update.shift)(w), w)
        F = np.abs(1 - G * H) if filtered == "error" else np.abs(H * (1 - G))
        moved = np.abs(Bundle([law.position(m, C) for m in models], 0)(w)) ** 2
        for k, count in enumerate(trials):
            with np.errstate(over="ignore"):
                repeats = np.where(
                    F**2 == 1, count, (1 - F ** (2 * count)) / np.where(F**2 == 1, 1, 1 - F**2)
                )
            of_v = (H * reads) ** 2 * lesson * repeats
            learned[:, k] = np.sqrt(variance * (error + moved * of_v).mean(axis=1))
    return Steps(feedback, learned)
