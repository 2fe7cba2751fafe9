"""Growth of the error over simulated trials of finite length, which the frequency response doesn't show.

At both ends of the trial the filter extends the signal (it reflects it about its last sample), and the
shift repeats the last error. So the error may grow there although it shrinks at every frequency. The
simulation starts with noise in v, without a reference, and applies the update trial by trial.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cogless.design.feedforward import polynomials
from cogless.design.linear_filter import forward, forward_and_backward
from cogless.design.model import Model, Real
from cogless.design.response import Filter, Filtered, Loop

TRIALS = 80


def growth(
    loops: Sequence[Loop],
    K_3: float,
    shift: int,
    q_filter: Filter | None,
    filtered: Filtered,
    samples: int,
) -> Real:
    """Factor per trial of each loop's error: its geometric mean over the last half of `TRIALS` trials."""
    transfer = [polynomials(Model(loop.A, loop.B), loop.C) for loop in loops]
    a, b = (np.array(coefficients) for coefficients in zip(*transfer, strict=True))

    def error(v: Real) -> Real:
        # filtered in the time domain: a product of spectra spreads the largest samples' rounding over all
        e = -forward(b, a, v)
        e[:, :shift] = 0.0
        return e

    def smooth(x: Real) -> Real:
        return x if q_filter is None else forward_and_backward(q_filter.b, q_filter.a, x, q_filter.odd)

    def ahead(e: Real) -> Real:
        return np.hstack([e[:, shift:], np.repeat(e[:, -1:], shift, axis=1)])

    # the last samples of v act only after the trial, unless a filter on v spreads them to earlier samples
    idle = np.array([samples - int(np.flatnonzero(row)[0]) for row in b])
    acts = np.arange(samples) < (idle[:, None] if q_filter is None or filtered == "error" else samples)
    v = np.random.default_rng(0).normal(size=(len(loops), samples)) * acts
    sizes = np.ones((TRIALS, len(loops)))
    for k in range(TRIALS):
        e = error(v)
        sizes[k] = np.maximum(np.linalg.norm(e, axis=1), 1e-300)
        # the update is linear: scaled to |e| = 1, many trials neither overflow nor vanish in rounding
        v, e = v / sizes[k][:, None], e / sizes[k][:, None]
        v = (v + K_3 * ahead(smooth(e)) if filtered == "error" else smooth(v + K_3 * ahead(e))) * acts
    return np.asarray(np.exp(np.log(sizes[TRIALS // 2 :]).mean(axis=0)))
