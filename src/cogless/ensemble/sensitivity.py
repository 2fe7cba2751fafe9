"""Which key explains the spread of a metric: rank correlations, and Sobol indices from the same runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogless.ensemble.sample import SEED
from cogless.ensemble.table import Sweep

Array = NDArray[np.float64]
FEWEST = 200  # variants for Sobol indices: below, the estimate's own scatter reaches 0.1
FEWEST_RANKS = 10  # variants for a rank correlation


@dataclass(frozen=True)
class Influence:
    """What a key does to a metric; None: not to be had.

    `rank`: Spearman's correlation, -1 to 1. `first`: share of the variance that the key explains by itself.
    """

    key: str
    rank: float | None
    first: float | None


def influences(sweep: Sweep, place: int, index: int) -> list[Influence]:
    """The influence of each varied key on one metric of one run."""
    values = sweep.values[:, place, index]
    known = np.isfinite(values)
    y = values[known]
    keys = [key for key in sweep.ensemble.drawn if key != SEED]
    flat = len(y) < FEWEST_RANKS or np.ptp(y) == 0
    if flat or not keys:
        return [Influence(key, None, None) for key in keys]
    x = np.column_stack([positions(sweep, key)[known] for key in keys])
    firsts = _first_order(x, y, keys) if len(y) >= FEWEST else [None] * len(keys)
    return [
        Influence(key, _rank(column, y), first) for key, column, first in zip(keys, x.T, firsts, strict=True)
    ]


def positions(sweep: Sweep, key: str) -> Array:
    """The values of a key as numbers, SI; texts by their places in the list that they are drawn from."""
    values = sweep.ensemble.si(key)
    if all(isinstance(value, int | float) for value in values):
        return np.asarray(values, dtype=float)
    axis = next(axis for axis in sweep.ensemble.axes if axis.key == key)
    return np.array([axis.choices.index(value) for value in sweep.ensemble.drawn[key]], dtype=float)


def _rank(x: Array, y: Array) -> float | None:
    from scipy.stats import spearmanr

    return float(spearmanr(x, y).statistic) if np.ptp(x) else None


def _first_order(x: Array, y: Array, keys: Sequence[str]) -> list[float | None]:
    """First-order Sobol indices by RBD-FAST, which takes any sample (Tarantola 2006, Plischke 2010)."""
    from SALib.analyze import rbd_fast

    bounds = [[float(column.min()), float(column.max())] for column in x.T]
    problem = {"num_vars": len(keys), "names": list(keys), "bounds": bounds}
    found = rbd_fast.analyze(problem, x, y, num_resamples=2, seed=0)["S1"]
    return [
        float(min(1.0, max(0.0, first))) if np.ptp(column) and np.isfinite(first) else None
        for first, column in zip(found, x.T, strict=True)
    ]
