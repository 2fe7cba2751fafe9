"""Learning over a trial of so many samples, ends included, by trying it: what frequencies can't say.

At both ends the filter extends the signal (filtfilt turns it about its last sample) and the shift repeats the
last error: the update may grow there although every frequency shrinks. So the change of v is sent through the
update, without reference, from noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cogless.design.feedforward import polynomials
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
    """Factor a trial of the error of each loop: the geometric mean over the last half of `TRIALS`."""
    from scipy.signal import filtfilt, lfilter

    transfer = [polynomials(Model(loop.A, loop.B), loop.C) for loop in loops]

    def error(v: Real) -> Real:
        # sample by sample: a product of spectra would smear the rounding of the largest samples over all
        e = -np.array([lfilter(b, a, row) for (a, b), row in zip(transfer, v, strict=True)])
        e[:, :shift] = 0.0
        return e

    def smooth(x: Real) -> Real:
        return x if q_filter is None else np.asarray(filtfilt(q_filter.b, q_filter.a, x))

    def ahead(e: Real) -> Real:
        return np.hstack([e[:, shift:], np.repeat(e[:, -1:], shift, axis=1)])

    # the last samples of v act after the trial, unless a filter on v brings them forward
    idle = np.array([samples - int(np.flatnonzero(b)[0]) for _, b in transfer])
    acts = np.arange(samples) < (idle[:, None] if q_filter is None or filtered == "error" else samples)
    v = np.random.default_rng(0).normal(size=(len(loops), samples)) * acts
    sizes = np.ones((TRIALS, len(loops)))
    for k in range(TRIALS):
        e = error(v)
        sizes[k] = np.maximum(np.linalg.norm(e, axis=1), 1e-300)
        # all of it is linear: kept at size one, so that many trials neither overflow nor end in rounding
        v, e = v / sizes[k][:, None], e / sizes[k][:, None]
        v = (v + K_3 * ahead(smooth(e)) if filtered == "error" else smooth(v + K_3 * ahead(e))) * acts
    return np.asarray(np.exp(np.log(sizes[TRIALS // 2 :]).mean(axis=0)))
