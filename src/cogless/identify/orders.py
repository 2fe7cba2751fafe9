"""Find the orders of cogging in what a fit leaves, with a stated rate of false alarms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import f as fisher

from cogless.identify.files import Array
from cogless.identify.regression import Fit
from cogless.identify.weak_form import Rows, width_of

FALSE_ALARM = 0.01  # chance that a search finds any order where there is none
HIGHEST = 400
HIDDEN = 5.0  # widths of the kernel, in rad of a wave, that leave a millionth of it


def residual(rows: Rows, fit: Fit) -> Array:
    """What the fit leaves of i_q, A."""
    return np.asarray(rows.y - fit.prediction(rows))


def gains(rows: Sequence[Rows], fit: Fit, width: float, highest: int = HIGHEST) -> tuple[Array, Array]:
    """Share of the residual that each order from 1 explains by itself, and how many waves could be seen.

    The waves in it are taken as filtered by the kernel at the speed of each row.
    """
    crossed = np.zeros((highest, 2))
    squared = np.zeros(highest)
    total = weight = 0.0
    for each in rows:
        noise = fit.noise[each.log.name]
        slowest = np.argsort(np.abs(each.omega))  # first: an order passes the kernel up to a speed
        r, speed = (residual(each, fit) / noise)[slowest], np.abs(each.omega)[slowest]
        total += float(r @ r)
        independent = _independent(each, width)
        weight += independent
        rotation = np.exp(1j * each.theta[slowest]).astype(np.complex64)
        wave = np.ones_like(rotation)
        kernel = width_of(each.log, width) if each.log.dt else 0.0
        top = HIDDEN / kernel if kernel else np.inf
        for n in range(1, highest + 1):
            seen = slice(0, int(np.searchsorted(n * speed, top)))
            if not seen.stop:
                break
            wave[seen] *= rotation[seen]
            gain = np.exp(-0.5 * (n * speed[seen] * kernel) ** 2) / noise
            crossed[n - 1] += (gain * r[seen]) @ wave[seen].view(np.float32).reshape(-1, 2)
            squared[n - 1] += 0.5 * (gain @ gain)
    with np.errstate(invalid="ignore", divide="ignore"):
        explained = np.where(squared > 1e-3 * np.max(squared), np.sum(crossed**2, axis=1) / squared, 0.0)
    return explained / max(total, 1e-300), np.full(highest, weight)


def _independent(rows: Rows, width: float) -> float:
    """How many independent values these filtered rows have."""
    if not rows.log.dt:
        return len(rows.y) / 4
    span: float = len(rows.y) * max(1, round(width_of(rows.log, width) / rows.log.dt)) * rows.log.dt
    return span / (2 * math.sqrt(math.pi) * width_of(rows.log, width))


def found_orders(
    rows: Sequence[Rows], fit: Fit, width: float, known: Sequence[int], most: int = 6
) -> list[int]:
    """Up to `most` new orders in the residual, the strongest first; none by chance at a rate of 1 %."""
    share, counts = gains(rows, fit, width)
    spare = counts - 2
    with np.errstate(divide="ignore"):
        statistic = share / 2 / np.maximum(1e-300, 1 - np.minimum(share, 1 - 1e-12)) * spare
    limit = np.asarray(fisher.isf(FALSE_ALARM / len(share), 2, spare))
    strongest = np.argsort(-share)
    wanted = [int(k) + 1 for k in strongest if statistic[k] > limit[k] and int(k) + 1 not in known]
    best = share[wanted[0] - 1] if wanted else 0.0
    return [n for n in wanted if share[n - 1] > 0.1 * best][:most]
