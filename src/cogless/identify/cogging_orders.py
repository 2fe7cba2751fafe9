"""Find orders of the angle in the residual of a fit, all orders at once, at a stated rate of false alarms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from cogless.identify.balance import BLUR_PHASE, LOG_BLOCKS, Model, Rows, Sensor
from cogless.identify.jackknife import BLOCK_ROWS_LEAST, Fit
from cogless.results.trace import Array
from cogless.units import TURN

FALSE_ALARM = 0.01  # chance that a search finds an order in noise alone
ORDER_HIGHEST = 420
ANGLE_BINS = 4096  # bins per turn
NEW_MOST, NEW_SHARE = 4, 0.25  # most orders that a round adds, and their least gain over the strongest's
BLOCK_SHARE = 1e-3  # least information of a block on an order, over that of the best block, for it to count
BLOCKS_LEAST = 4
STEP_SHARE = 0.1  # share of a sensor's step: rows alias the steps into repeating orders of about this size
ORDER_CHANCE = FALSE_ALARM / ORDER_HIGHEST  # Bonferroni


def found_orders(
    residuals: Sequence[tuple[Rows, Array]], fit: Fit, model: Model, sensor: Sensor
) -> list[int]:
    """The strongest new orders of the residual, the strongest first. In noise alone 1 % of searches find one.

    Each block of a log gives its own wave of each order: the scatter between blocks is the noise.
    """
    orders = np.arange(1, ORDER_HIGHEST + 1)
    waves: list[NDArray[np.complex128]] = []
    information: list[Array] = []
    speeds: list[float] = []
    for rows, residual in residuals:
        weight = 1 / fit.noise[rows.log.name] ** 2
        width = model.width(rows.log) if rows.log.dt else 0.0
        bins = (np.floor(rows.theta / TURN * ANGLE_BINS) % ANGLE_BINS).astype(int)
        blocks = max(1, min(LOG_BLOCKS, len(residual) // BLOCK_ROWS_LEAST))
        for part in np.array_split(np.arange(len(residual)), blocks):
            if len(part) < 3:
                continue
            summed = np.fft.fft(np.bincount(bins[part], residual[part], ANGLE_BINS))[orders]
            summed *= np.exp(-1j * np.pi * orders / ANGLE_BINS)  # from the bin's edge to its middle
            speeds.append(float(np.sqrt(np.mean(rows.omega[part] ** 2))))
            turning = orders * speeds[-1]
            seen = (turning < sensor.top(rows.log)) & (turning * width < BLUR_PHASE)
            passed = np.exp(-0.5 * (turning * width) ** 2) * seen
            waves.append(weight * passed * summed)
            information.append(weight * passed**2 * len(part))
    if not waves:
        return []
    wave, square = np.array(waves), np.array(information)
    whole, total = wave.sum(axis=0), square.sum(axis=0)
    used = square > BLOCK_SHARE * square.max(axis=0)
    count = used.sum(axis=0)
    mean = whole / np.maximum(total, 1e-300)
    scatter = (np.abs(wave - square * mean) ** 2 * used).sum(axis=0)
    ratio = np.abs(whole) ** 2 / np.maximum(scatter, 1e-300) * (count - 1) / np.maximum(count, 1)
    spare = 2 * np.maximum(count - 1, 1)
    chance = np.where(count >= BLOCKS_LEAST, fisher.sf(ratio, 2, spare), 1.0)
    fastest = max(speeds)
    slowest = np.min(np.where(used, np.array(speeds)[:, None], fastest), axis=0)
    steps = STEP_SHARE * sensor.step * abs(fit.get("j")) * (orders * slowest) ** 2
    chance[2 * np.abs(mean) < steps] = 1.0
    gain = np.abs(whole) ** 2 / np.maximum(total, 1e-300)
    new = [int(n) for n in orders[chance < ORDER_CHANCE] if n not in model.cogging]
    new.sort(key=lambda n: -gain[n - 1])
    return [n for n in new[:NEW_MOST] if gain[n - 1] > NEW_SHARE * gain[new[0] - 1]]
