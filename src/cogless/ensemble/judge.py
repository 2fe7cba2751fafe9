"""Judge a sweep: how each metric spreads, which share keeps its limit, which variant is the worst."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogless.ensemble.columns import Column
from cogless.ensemble.table import Sweep
from cogless.run.simulate import Pair
from cogless.study.error_messages import toml

Array = NDArray[np.float64]
CONFIDENCE = 1.96  # standard deviations, for 95 %


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How a metric of one run spreads over the variants; SI, infinite where a run has no value.

    `edge`: the value that 95 % of the variants are no worse than. `worst`: the variant with the worst value.
    `within`: the share that keeps the limit, and `interval` where the share of all possible variants is, with
    95 % confidence; None without a limit.
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
    """Spreads of a scenario: a list for each column that is taken there, with one for each controller."""
    taken = {metric.name for metric in sweep.study.metrics_in(scenario)}
    places = [place for place, pair in enumerate(sweep.pairs) if pair[0] == scenario]
    return [
        [_spread(sweep, place, index) for place in places]
        for index, column in enumerate(sweep.columns)
        if column.metric.name in taken
    ]


def badness(sweep: Sweep, place: int, index: int) -> Array:
    """A metric of each variant, turned so that less is better; infinite where a run has no value."""
    sign = -1.0 if sweep.columns[index].metric.wanted == "higher" else 1.0
    values = sign * sweep.values[:, place, index]
    return np.where(np.isnan(values), np.inf, values)


def keeps(sweep: Sweep, place: int, index: int) -> NDArray[np.bool_] | None:
    """Whether each variant keeps a metric's limit; None without one."""
    metric = sweep.columns[index].metric
    if metric.limit is None:
        return None
    bad = badness(sweep, place, index)
    return np.asarray(bad <= (-metric.limit if metric.wanted == "higher" else metric.limit))


def _spread(sweep: Sweep, place: int, index: int) -> Spread:
    column, bad = sweep.columns[index], badness(sweep, place, index)
    sign = -1.0 if column.metric.wanted == "higher" else 1.0
    worst = int(np.argmax(bad))
    kept = keeps(sweep, place, index)
    share = None if kept is None else float(np.mean(kept))
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
    """Wilson's 95 % interval of the share of all variants, if `count` drawn ones had `share`."""
    z = CONFIDENCE**2 / count
    middle, half = share + z / 2, math.sqrt(z * share * (1 - share) + z**2 / 4)
    return max(0.0, (middle - half) / (1 + z)), min(1.0, (middle + half) / (1 + z))


def settings(sweep: Sweep, variant: int, scenario: str) -> list[str]:
    """What differs from the study in a variant's scenario, each as KEY=VALUE for --set."""
    return [f"{key}={toml(value)}" for key, value in sweep.ensemble.changes(variant, scenario).items()]
