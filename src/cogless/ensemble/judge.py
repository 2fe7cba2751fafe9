"""Judge a sweep: how each metric spreads, what share of variants keeps its limit, which one is the worst.

This module also finds which key explains a metric's spread, by rank correlations and Sobol indices.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogless.ensemble.sweep_table import Column, Sweep
from cogless.ensemble.variants import SEED
from cogless.results.trace import Array
from cogless.run.simulate import Pair
from cogless.study.toml import toml

CONFIDENCE_95 = 1.96  # standard deviations: half of a 95 % interval of a normal distribution


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How a metric of one run spreads over the variants; SI, infinite where a run has no value.

    `edge`: 95 % of the variants are at least as good as this value. `worst`: the variant with the worst
    value. `within`: the share of variants that keep the limit. `interval`: 95 % confidence interval of that
    share for all possible variants. Both are None without a limit.
    """

    pair: Pair
    column: Column
    median: float
    edge: float
    worst: int
    worst_value: float
    failed: int
    within: float | None
    interval: tuple[float, float] | None


def spreads(sweep: Sweep, scenario: str) -> list[list[Spread]]:
    """Spreads in a scenario: for each column that is taken there, a list with one spread per controller."""
    taken = {metric.name for metric in sweep.study.metrics_in(scenario)}
    places = [place for place, pair in enumerate(sweep.pairs) if pair[0] == scenario]
    return [
        [_spread(sweep, place, index) for place in places]
        for index, column in enumerate(sweep.columns)
        if column.metric.name in taken
    ]


def badness(sweep: Sweep, place: int, index: int) -> Array:
    """A metric of each variant, negated if higher is better; infinite where a run has no value."""
    sign = -1.0 if sweep.columns[index].metric.better_direction == "higher" else 1.0
    values = sign * sweep.values[:, place, index]
    return np.where(np.isnan(values), np.inf, values)


def keeps(sweep: Sweep, place: int, index: int) -> NDArray[np.bool_] | None:
    """Whether each variant keeps a metric's limit; None if the metric has no limit."""
    metric = sweep.columns[index].metric
    if metric.limit is None:
        return None
    bad = badness(sweep, place, index)
    return np.asarray(bad <= (-metric.limit if metric.better_direction == "higher" else metric.limit))


def _spread(sweep: Sweep, place: int, index: int) -> Spread:
    column, bad = sweep.columns[index], badness(sweep, place, index)
    sign = -1.0 if column.metric.better_direction == "higher" else 1.0
    worst = int(np.argmax(bad))
    keeping = keeps(sweep, place, index)
    share = None if keeping is None else float(np.mean(keeping))
    return Spread(
        pair=sweep.pairs[place],
        column=column,
        median=sign * quantile(bad, 0.5),
        edge=sign * quantile(bad, 0.95),
        worst=worst,
        worst_value=sign * float(bad[worst]),
        failed=int(np.count_nonzero(np.isinf(bad))),
        within=share,
        interval=None if share is None else likely(share, len(bad)),
    )


def quantile(values: Array, share: float) -> float:
    """The smallest value that at least this share of the values doesn't exceed."""
    place = max(0, math.ceil(share * len(values) - 1e-9) - 1)
    return float(np.partition(values, place)[place])


def likely(share: float, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share of all possible variants, from the `share` in `count` of them."""
    z = CONFIDENCE_95**2 / count
    middle, half = share + z / 2, math.sqrt(z * share * (1 - share) + z**2 / 4)
    return max(0.0, (middle - half) / (1 + z)), min(1.0, (middle + half) / (1 + z))


def settings(sweep: Sweep, variant: int, scenario: str) -> list[str]:
    """The changes of a study that give a variant's scenario, each as KEY=VALUE for --set."""
    return [f"{key}={toml(value)}" for key, value in sweep.ensemble.changes(variant, scenario).items()]


SOBOL_VARIANTS_LEAST = 200  # least number of variants for Sobol indices: with fewer, they scatter by 0.1
FEWEST_RANKS = 10  # least number of variants for a rank correlation


@dataclass(frozen=True)
class Influence:
    """How a key influences a metric; None: can't be computed.

    `rank`: Spearman's correlation, -1 to 1. `first`: share of the variance that the key explains by itself.
    """

    key: str
    rank: float | None
    first: float | None


def influences(sweep: Sweep, place: int, index: int) -> list[Influence]:
    """The influence of each varied key on one metric of one run."""
    values = sweep.values[:, place, index]
    finite = np.isfinite(values)
    y = values[finite]
    keys = [key for key in sweep.ensemble.drawn if key != SEED]
    flat = len(y) < FEWEST_RANKS or np.ptp(y) == 0
    if flat or not keys:
        return [Influence(key, None, None) for key in keys]
    x = np.column_stack([positions(sweep, key)[finite] for key in keys])
    firsts = _first_order(x, y, keys) if len(y) >= SOBOL_VARIANTS_LEAST else [None] * len(keys)
    return [
        Influence(key, _rank(column, y), first) for key, column, first in zip(keys, x.T, firsts, strict=True)
    ]


def positions(sweep: Sweep, key: str) -> Array:
    """The values of a key as numbers, SI; a text by its index in the list of choices."""
    values = sweep.ensemble.si[key]
    if all(isinstance(value, int | float) for value in values):
        return np.asarray(values, dtype=float)
    axis = next(axis for axis in sweep.ensemble.axes if axis.key == key)
    return np.array([axis.choices.index(value) for value in sweep.ensemble.drawn[key]], dtype=float)


def _rank(x: Array, y: Array) -> float | None:
    from scipy.stats import spearmanr

    return float(spearmanr(x, y).statistic) if np.ptp(x) else None


def _first_order(x: Array, y: Array, keys: Sequence[str]) -> list[float | None]:
    """First-order Sobol indices by RBD-FAST, which works on any sample (Tarantola 2006, Plischke 2010)."""
    from SALib.analyze import rbd_fast

    bounds = [[float(column.min()), float(column.max())] for column in x.T]
    problem = {"num_vars": len(keys), "names": list(keys), "bounds": bounds}
    indices = rbd_fast.analyze(problem, x, y, num_resamples=2, seed=0)["S1"]
    return [
        float(min(1.0, max(0.0, first))) if np.ptp(column) and np.isfinite(first) else None
        for first, column in zip(indices, x.T, strict=True)
    ]
