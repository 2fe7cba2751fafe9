"""Corrections from ramps of speed: one with the driver as it is, one with a probe added to its correction.

A ramp is cut into blocks. In each block, the carriage answers the command's error by another coefficient G.
So order n has A0 = G psi without the probe and A1 = G (psi + p) with it. The pairs of all blocks lie on one
complex line, whatever belt and sensor do. Total least squares give its slope, and psi = p A0 / (A1 - A0).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from cogless.errors import StudyError
from cogless.printer.axis import PULLEY_TEETH_LEAST, Axis
from cogless.printer.corrections import Answer, Coefficient, Lines, OrderRipple, spread
from cogless.printer.moves import Move, ramp
from cogless.printer.records import (
    FITTED_ORDERS,
    ComplexNumbers,
    Numbers,
    Run,
    coupling,
    lines_fit,
    shifted_orders,
)
from cogless.study.motor import teeth_of
from cogless.study.toml import toml

BLOCK_SPEED = 8e-3  # m/s, change of the speed in a block, at least
BLOCK_TURNS = 2.0  # electrical turns in a block, at least
BLOCK_SAMPLES = 24  # samples in a block, at least
SPEED_LEAST = 0.012  # m/s, below which a carriage hardly shakes
NYQUIST_SHARE = 0.84  # of half the sampling rate: above it a line is folded or filtered
LOUD_SHARE = 0.1  # share of a coefficient that the model misses
SPREAD_MOST = 0.4  # change / mean of the speed in a block: with more, its way is not shown
START_GRID = 8e-3  # s, of the search for the move in the log
LAG_MOST = 16e-3  # s, error of a start from log to log, at most
LAG_COARSE = 1e-4  # s, step of the search for this error
LAG_FINE = 2e-5  # s, last step
MOVE_SHARE_LEAST = 0.25  # orders' energy / all energy without noise; with less, it is another move
DURATION_MISS = 0.05  # share by which a move's time may be off
DURATION_SIGMAS = 4.0  # standard deviations of noise in this time that are allowed as well
SPEED_SMOOTHING = 0.1  # s, over which a speed is smoothed, to take the orders out
HEARD_SIGMAS = 5.0  # standard deviations of noise's energy; a move has to exceed them
REST_SAMPLES = 250  # samples before or after a move, at least, if noise is taken from them
RING_TIME = 0.2  # s, for which a carriage rings after a move
# Factor by which a move is looked for faster and slower -> grid of its start, s; coarse for large factors.
PACES = {
    **dict.fromkeys((1.02, 1.04, 1.07, 1.1), START_GRID),
    **dict.fromkeys((1.15, 1.21, 1.28, 1.36, 1.45, 1.55, 1.66, 1.78, 1.9, 2.02), 2 * START_GRID),
}
HIDDEN_PACE = (
    "The log is so noisy that a wrong number of pulley teeth, or a wrong step angle, may go unnoticed: check "
    "both, or record the log with the fans off."
)
RAMPS_NOTE = (
    "Amplitude of the carriage's displacement that each order of the electrical revolution causes in the "
    "ramps. The ripple with the correction is computed from the ramps with the probe, a known change of the "
    "driver's correction. Noise and the error of "
    "the model hide a ripple below the dotted line. A ramp passes a resonance quickly, so the peak is too "
    "low: at a constant speed there, the ripple is a few times larger."
)
MODE_WIDTH = 3.0  # Hz, over which the spectrum is smoothed
MODE_LEAST = 15.0  # Hz, lowest mode
MODE_HEIGHT = 6.0  # power of a mode / median power of what the orders leave, at least
MODE_APART = 0.3  # share of a mode's frequency within which no other mode is sought
MODES_MOST = 2
GROUPS_MOST = 5  # groups of blocks, from which errors are computed
CHANGE_LEAST = 1.5  # Pair.change of some order, if the probe acts
HUBER_LIMIT = 2.0  # standard deviations
TOOTH_WINDOW = 6  # belt teeth in a window
TOOTH_SAMPLES = 60  # samples in a window, at least
TOOTH_SPEED_LEAST = 0.05  # m/s
WEIGHT_ROUNDS = 8
PROBE_ROUNDS = 3  # rounds, after which the probe's share in each order has settled


@dataclass(frozen=True, eq=False)
class Blocks:
    """Coefficients of a ramp's blocks: rows of blocks, columns of FITTED_ORDERS. Speeds are in m/s.

    `variance`: of a coefficient's real or imaginary part. `energy`: the sum of squares that the orders
    explain, m^2/s^4. `rest`: the sum that is left. For white noise of variance 1, `energy_freedom` and
    `rest_freedom` are their means.
    """

    speeds: Numbers
    coefficients: ComplexNumbers
    variance: Numbers
    energy: float
    rest: float
    energy_freedom: int
    rest_freedom: int

    def share(self, noise: float) -> float:
        """The orders' share of the energy, without noise of this variance; 0: they are lost in noise."""
        own = self.energy - self.energy_freedom * noise
        if own <= chance(self.energy_freedom, noise):
            return 0.0
        return own / (own + max(self.rest - self.rest_freedom * noise, 0.0))


def chance(freedom: int, noise: float) -> float:
    """The energy that noise of this variance may have in `freedom` squares, beyond its mean."""
    return HEARD_SIGMAS * math.sqrt(2 * freedom) * noise


@lru_cache(maxsize=len(PACES))
def block_edges(move: Move, wavelength: float) -> tuple[tuple[float, float], ...]:
    """Begin and end of each block, s since the start of the move: first of the rise, then of the fall."""
    edges: list[tuple[float, float]] = []
    t = SPEED_LEAST / move.acceleration
    while t < move.ramp_time:
        speed = move.acceleration * t
        needed = BLOCK_TURNS * wavelength
        turns_time = (math.sqrt(speed**2 + 2 * move.acceleration * needed) - speed) / move.acceleration
        end = t + max(BLOCK_SPEED / move.acceleration, turns_time)
        if end > move.ramp_time:
            break
        edges.append((t, end))
        t = end
    return (*edges, *((move.duration - end, move.duration - t) for t, end in reversed(edges)))


def blocks(run: Run, start: float, move: Move, wavelength: float, modes: tuple[float, ...] = ()) -> Blocks:
    """Fit the orders in each block of a move that begins at `start` in the log. `modes`: of ringing, Hz."""
    speeds, rows, variances = [], [], []
    explained = rest = 0.0
    energy_freedom = rest_freedom = 0
    for begin, end in block_edges(move, wavelength):
        first, last = np.searchsorted(run.times, [start + begin, start + end])
        if last - first < BLOCK_SAMPLES:
            continue
        t = run.times[first:last] - start
        speed = float(np.mean(move.speed_at(t)))
        top = NYQUIST_SHARE * run.rate / 2
        orders = tuple(n for n in FITTED_ORDERS if n * speed / wavelength < top)
        turns = run.sign * move.position_at(t) / wavelength
        ringing = [wave(math.tau * f * t) for f in modes for wave in (np.sin, np.cos)]
        fit = lines_fit(run.acceleration[first:last], turns, orders, np.array(ringing).reshape(-1, len(t)).T)
        row, variance = np.full(len(FITTED_ORDERS), np.nan, complex), np.full(len(FITTED_ORDERS), np.inf)
        row[: len(orders)], variance[: len(orders)] = fit.values, fit.variances
        noise = float(np.mean(fit.rest**2))
        count = last - first
        rows.append(row)
        speeds.append(speed)
        variances.append(variance)
        explained += count * 0.5 * float(np.sum(np.abs(fit.values) ** 2))
        rest += count * noise
        energy_freedom += 2 * len(orders)
        rest_freedom += count - 2 * len(orders) - 2 - len(ringing)
    return Blocks(
        speeds=np.array(speeds),
        coefficients=np.array(rows).reshape(-1, len(FITTED_ORDERS)),
        variance=np.array(variances).reshape(-1, len(FITTED_ORDERS)),
        energy=explained,
        rest=rest,
        energy_freedom=energy_freedom,
        rest_freedom=rest_freedom,
    )


def matched_energy(run: Run, start: float, move: Move, wavelength: float, noise: float = 0.0) -> float:
    """About the `energy` of `blocks`, in a tenth of the time, less what white noise of this variance adds.

    Each order is correlated alone, since orders are orthogonal over whole turns.
    """
    edges = [start + t for t in (0.0, *(t for edge in block_edges(move, wavelength) for t in edge))]
    first, *bounds = np.searchsorted(run.times, edges)
    counts = np.diff([first, *bounds])
    sound = counts >= BLOCK_SAMPLES
    samples = slice(int(first), int(bounds[-1]))
    turns = run.sign * move.position_at(run.times[samples] - start) / wavelength
    wave = np.exp(-1j * math.tau * turns)
    product = (run.acceleration[samples] - np.mean(run.acceleration)).astype(complex)
    energy = -2.0 * len(FITTED_ORDERS) * np.count_nonzero(sound) * noise
    for n in range(1, max(FITTED_ORDERS) + 1):
        product = product * wave
        if n in FITTED_ORDERS:
            sums = np.add.reduceat(np.append(product, 0.0), [0, *(np.array(bounds[:-1]) - first)])
            energy += float(np.sum(2 * np.abs(sums[sound]) ** 2 / counts[sound]))
    return energy


def coarse_start(
    run: Run, move: Move, wavelength: float, grid: float = START_GRID, noise: float = 0.0
) -> tuple[float, float]:
    """The time of the log at which the move begins, s, within `grid`, and the orders' energy there.

    The energy is zero if the log is shorter than the move.
    """
    first, last = float(run.times[0]), float(run.times[-1]) - move.duration
    if last < first:
        return first, 0.0
    starts = np.arange(first, last + grid, grid)
    energies = [matched_energy(run, float(start), move, wavelength, noise) for start in starts]
    k = int(np.argmax(energies))
    return float(starts[k]), energies[k]


def check_pace(run: Run, start: float, move: Move, wavelength: float) -> str:
    """A remark if the log's noise hides whether the move has another pace than this; "" if it does not.

    A ramp of another speed, a way of another length, a pulley of other teeth and a clock that is off all
    change how fast the orders sweep. Their energy is then larger for a move of another pace.

    StudyError: the energy at another pace is larger, by more than noise may add. `start`: where the move
    of the log seemed to begin.
    """
    noise = noise_at_rest(run, start, move)
    freedom = 2 * len(FITTED_ORDERS) * len(block_edges(move, wavelength))
    own_energy = matched_energy(run, start, move, wavelength, noise)
    best, best_energy, by_chance = 1.0, 0.0, chance(freedom, noise)
    for step, grid in PACES.items():
        for pace in (1 / step, step):
            other = Move(move.length, pace * move.speed, pace**2 * move.acceleration)
            _, energy = coarse_start(run, other, wavelength, grid, noise)
            if energy > best_energy:
                best, best_energy = pace, energy
    if best_energy > own_energy + by_chance:
        raise StudyError(
            f"{run.name}: the move is about {best:.2f} times as fast as the planned {1e3 * move.length:.4g} "
            f"mm with up to {1e3 * move.top_speed:.4g} mm/s: expected the --drive-config file of --plan, "
            "and a correct clock"
        )
    return HIDDEN_PACE if best_energy > own_energy - by_chance else ""


def half_time(times: Numbers, acceleration: Numbers) -> float:
    """How long a speed is above half of its largest, s. It is the acceleration's integral from rest to rest.

    This time does not depend on the sensor's scale, which may be off by a tenth. A way would depend on it.
    """
    steps = np.diff(times)
    middles = 0.5 * (acceleration[1:] + acceleration[:-1])
    middles = middles - float(middles @ steps) / float(np.sum(steps))
    width = max(1, round(SPEED_SMOOTHING / float(np.mean(steps))))
    speed = np.convolve(np.cumsum(middles * steps), np.ones(width) / width, "same")
    speed = speed * np.sign(speed[np.argmax(np.abs(speed))])
    fast = np.flatnonzero(speed > 0.5 * np.max(speed))
    return float(times[fast[-1]] - times[fast[0]])


def check_duration(run: Run, start: float, move: Move) -> None:
    """StudyError: the log's move takes another time than `move`, by more than noise may add to an integral.

    The time shows that a way is too short even where the orders sweep nearly as they should.
    """
    t = run.times - start
    moving = (t > 0) & (t < move.duration)
    planned = np.where(moving, move.acceleration * np.where(t < move.duration / 2, 1.0, -1.0), 0.0)
    span = float(run.times[-1] - run.times[0])
    doubt = math.sqrt(noise_at_rest(run, start, move) * span / run.rate) / (2 * move.acceleration)
    expected = half_time(run.times, planned)
    ratio = half_time(run.times, run.acceleration) / expected
    if abs(ratio - 1) > DURATION_MISS + DURATION_SIGMAS * doubt / expected:
        raise StudyError(
            f"{run.name}: the move takes about {ratio:.2f} times as long as the planned "
            f"{1e3 * move.length:.4g} mm with up to {1e3 * move.top_speed:.4g} mm/s: expected the "
            "--drive-config file of --plan"
        )


def find_start(run: Run, move: Move, wavelength: float) -> float:
    """The time of the log at which the move begins: where the orders explain most of its energy.

    This is least squares over the whole log, since nothing outside the move is explained. The orders' share
    in the blocks alone would be larger at a wrong start whose blocks miss the loud part of the log.

    Noise before and after the move, such as a fan's, is taken off before the orders' share is judged.

    StudyError: the log is shorter than the move, or lacks the move's orders.
    """
    first = float(run.times[0])
    if run.times[-1] - first < move.duration:
        raise StudyError(
            f"{run.name}: {run.times[-1] - first:.3g} s long: expected the whole move of "
            f"{move.duration:.3g} s, as --plan writes it"
        )
    start, _ = coarse_start(run, move, wavelength)
    for step, count in ((START_GRID, 6), (START_GRID / 4, 4), (START_GRID / 16, 4)):
        starts = start + step * np.arange(-count, count + 1)
        fits = [blocks(run, float(s), move, wavelength) for s in starts]
        k = int(np.argmax([fit.energy for fit in fits]))
        start, fit = float(starts[k]), fits[k]
    noise = noise_at_rest(run, start, move)
    share = fit.share(noise)
    if not share and noise:
        raise StudyError(
            f"{run.name}: the motor's orders are lost in noise of {math.sqrt(noise):.2g} m/s^2: expected the "
            "move that --plan writes for this axis, and less noise, such as without fans"
        )
    if share < MOVE_SHARE_LEAST:
        raise StudyError(
            f"{run.name}: only {share:.0%} of the log's energy is at the motor's orders: expected the move "
            "that --plan writes for this axis; check motor, step_angle, pulley_teeth and travel"
        )
    return start


def noise_at_rest(run: Run, start: float, move: Move) -> float:
    """Variance of the acceleration before or after the move, whichever is quieter, m^2/s^4.

    0: the log has too few samples before and after.
    """
    sides = (run.times < start - START_GRID, run.times > start + move.duration + RING_TIME)
    return min((float(np.var(run.acceleration[s])) for s in sides if np.sum(s) >= REST_SAMPLES), default=0.0)


def displacement(run: Run) -> float:
    """The way from rest to rest, m: the acceleration less its mean, the sensor's offset, integrated twice."""
    steps = np.diff(run.times)
    middles = 0.5 * (run.acceleration[1:] + run.acceleration[:-1])
    middles = middles - float(middles @ steps) / float(np.sum(steps))
    speeds = np.concatenate([[0.0], np.cumsum(middles * steps)])
    return float(0.5 * (speeds[1:] + speeds[:-1]) @ steps)


def ringing_modes(run: Run, start: float, move: Move, wavelength: float) -> tuple[float, ...]:
    """Frequencies, Hz, at which the carriage rings when the orders are taken off; at most two."""
    rest = np.zeros(len(run.times))
    for begin, end in block_edges(move, wavelength):
        first, last = np.searchsorted(run.times, [start + begin, start + end])
        if last - first < BLOCK_SAMPLES:
            continue
        turns = run.sign * move.position_at(run.times[first:last] - start) / wavelength
        rest[first:last] = lines_fit(
            run.acceleration[first:last], turns, FITTED_ORDERS, np.empty((last - first, 0))
        ).rest
    power = np.abs(np.fft.rfft(rest)) ** 2
    frequencies = np.arange(len(power)) * run.rate / len(rest)
    width = max(1, round(MODE_WIDTH / frequencies[1]))
    smooth = np.convolve(power, np.ones(width) / width, "same")
    modes: list[float] = []
    allowed = (frequencies > MODE_LEAST) & (frequencies < NYQUIST_SHARE * run.rate / 2)
    while len(modes) < MODES_MOST and np.any(allowed):
        k = int(np.argmax(np.where(allowed, smooth, 0.0)))
        if smooth[k] < MODE_HEIGHT * np.median(smooth[allowed]):
            break
        modes.append(float(frequencies[k]))
        allowed &= np.abs(frequencies / frequencies[k] - 1) > MODE_APART
    return tuple(modes)


def tooth_way(run: Run, start: float, move: Move, axis: Axis) -> tuple[float, float]:
    """Amplitude of the carriage's way at the spacing of belt teeth, and three standard deviations, m.

    This spacing is no order of the motor, so a fit over a window of some teeth separates it from the orders.
    Both results are medians over the windows.
    """
    spacing = axis.belt_pitch * axis.path_share
    ways, doubts = [], []
    windows = math.floor(move.length / (TOOTH_WINDOW * spacing))
    for window in range(windows):
        t = run.times - start
        path = move.position_at(t)
        chosen = (path > window * TOOTH_WINDOW * spacing) & (path <= (window + 1) * TOOTH_WINDOW * spacing)
        speed = float(np.mean(move.speed_at(t[chosen]))) if np.any(chosen) else 0.0
        if np.count_nonzero(chosen) < TOOTH_SAMPLES or speed < TOOTH_SPEED_LEAST:
            continue
        tooth = math.tau * path[chosen] / spacing
        turns = np.column_stack(
            [
                wave(math.tau * n * path[chosen] / axis.wavelength)
                for n in FITTED_ORDERS
                for wave in (np.sin, np.cos)
            ]
        )
        fit = lines_fit(run.acceleration[chosen], tooth / math.tau, (1,), turns)
        omega = math.tau * speed / spacing
        ways.append(abs(complex(fit.values[0])) / omega**2)
        doubts.append(3 * math.sqrt(2 * float(fit.variances[0])) / omega**2)
    return (float(np.median(ways)), float(np.median(doubts))) if ways else (0.0, math.inf)


def other_causes(axis: Axis, run: Run, start: float, modes: tuple[float, ...]) -> list[str]:
    """Sentences on the carriage's ringing and on belt teeth, which are not the motor's orders."""
    remarks = []
    if modes:
        names = " and ".join(f"{f:.0f}" for f in modes)
        remarks.append(
            f"The carriage rings {run.direction} at {names} Hz at all speeds, so no order of the motor is "
            "the cause."
        )
    way, doubt = tooth_way(run, start, ramp(axis), axis)
    if way > doubt:
        remarks.append(
            f"When the carriage moves {run.direction}, the belt's teeth shift it by +-{1e6 * way:.2g} um, a "
            f"stripe every {1e3 * axis.belt_pitch * axis.path_share:.3g} mm; no correction removes it."
        )
    return remarks


@dataclass(frozen=True, eq=False)
class Pair:
    """The coefficients of one order in the same blocks, without and with the probe."""

    plain: ComplexNumbers
    probed: ComplexNumbers
    variance: Numbers  # variance of the real or the imaginary part of either coefficient
    speeds: Numbers  # m/s

    @property
    def weights(self) -> Numbers:
        loud = 0.5 * LOUD_SHARE**2 * (np.abs(self.plain) ** 2 + np.abs(self.probed) ** 2)
        return np.asarray(1 / (2 * self.variance + loud))

    @property
    def change(self) -> float:
        """Mean square of the probe's change of a block / that of noise and of the model's error."""
        squares = self.weights * np.abs(self.plain - self.probed) ** 2
        return float(np.sum(squares)) / (2 * max(len(squares), 1))


def joined(runs: Sequence[tuple[Blocks, Blocks]], n: int) -> Pair:
    """The pairs of blocks of an order, from all runs without and with the probe."""
    k = FITTED_ORDERS.index(n)
    plain, probed = (
        np.concatenate([one.coefficients[:, k] for one in kind]) for kind in zip(*runs, strict=True)
    )
    variance = np.concatenate([0.5 * (one.variance + other.variance)[:, k] for one, other in runs])
    speeds = np.concatenate([one.speeds for one, _ in runs])
    sound = np.isfinite(plain) & np.isfinite(probed)
    return Pair(plain[sound], probed[sound], variance[sound], speeds[sound])


def check_wavelength(
    name: str, axis: Axis, own: Sequence[tuple[Blocks, Blocks]], twice: Sequence[tuple[Blocks, Blocks]]
) -> str:
    """A remark if noise hides that an electrical turn is twice or half as long as the axis says; else "".

    A factor of 2 maps the motor's orders onto each other, but the probe has orders 1, 2 and 4 alone. With a
    turn of half the length, order 8 of the axis changes and order 1 does not; with twice the length, order
    1/2 does and order 4 does not. So order 8 is compared with order 1, and order 1/2 with the mean of orders
    4 and 1. `twice`: the blocks of orders of twice the wavelength.

    StudyError: order 8, or 1/2, changes more than what it is compared with, beyond what noise may add.
    """
    remark = ""
    for factor, runs, orders, other_order in ((0.5, own, (1,), 8), (2.0, twice, (8, 2), 1)):
        other, pairs = joined(runs, other_order), [joined(runs, n) for n in orders]
        counts = [max(len(pair.speeds), 1) for pair in (other, pairs[0])]
        by_chance = HEARD_SIGMAS * math.sqrt(sum(1 / count for count in counts))
        changes = [pair.change for pair in pairs]
        if other.change > np.mean(changes) + by_chance:
            raise wrong_wavelength(name, axis, factor)
        if other.change > max(changes) - by_chance:
            remark = HIDDEN_PACE
    return remark


def wrong_wavelength(name: str, axis: Axis, factor: float) -> StudyError:
    """The error: an electrical turn is 2 or 1/2 (`factor`) times as long as the axis says."""
    step = math.degrees(axis.step_angle)
    cures: list[dict[str, int | str]] = []
    teeth = axis.pulley_teeth * factor
    if teeth.is_integer() and teeth >= PULLEY_TEETH_LEAST:
        cures.append({"printer.pulley_teeth": int(teeth)})
    if teeth_of(axis.step_angle * factor):
        cures.append({"printer.step_angle": f"{step * factor:.6g} deg"})
    expected = " or ".join(f"{key} = {toml(value)}" for cure in cures for key, value in cure.items())
    return StudyError(
        f"{name}: an electrical turn is {'twice' if factor > 1 else 'half'} as long as with "
        f"printer.pulley_teeth = {axis.pulley_teeth} and printer.step_angle = {toml(f'{step:.6g} deg')}, as "
        f"the effect of the probe shows: expected {expected}"
    ).advising(*cures)


def _direction(pair: Pair, weights: Numbers) -> tuple[complex, complex]:
    """Unit vector (psi, psi + p) times a phase: the principal axis of the pairs of blocks."""
    a, b = pair.plain, pair.probed
    cross = np.sum(weights * a * np.conj(b))
    scatter = np.array(
        [[np.sum(weights * np.abs(a) ** 2), cross], [np.conj(cross), np.sum(weights * np.abs(b) ** 2)]]
    )
    _, vectors = np.linalg.eigh(scatter)
    return complex(vectors[0, -1]), complex(vectors[1, -1])


def _misfit(pair: Pair, weights: Numbers) -> Numbers:
    """Squared distance of each block from the line, in units of its variance."""
    v0, v1 = _direction(pair, weights)
    return np.asarray(pair.weights * np.abs(pair.plain * v1 - pair.probed * v0) ** 2)


def _robust_weights(pair: Pair) -> Numbers:
    weights = pair.weights
    for _ in range(WEIGHT_ROUNDS):
        squares = _misfit(pair, weights)
        scale = max(float(np.median(squares)) / math.log(2), 1e-300)  # The median of an exponential law.
        weights = pair.weights * np.minimum(1.0, HUBER_LIMIT / np.sqrt(np.maximum(squares / scale, 1e-12)))
    return weights


def psi_of(pair: Pair, probe: complex) -> tuple[complex, float]:
    """psi of an order, and its error, by leaving out one group of blocks after the other.

    Each group has a range of speeds, since the model's error varies with the speed, and not from run to run.
    """
    weights = _robust_weights(pair)

    def solve(chosen: Numbers) -> complex:
        v0, v1 = _direction(pair, weights * chosen)
        return probe * v0 / (v1 - v0)

    count = len(pair.plain)
    places = np.argsort(np.argsort(pair.speeds, kind="stable"))
    groups = places * min(GROUPS_MOST, count) // count
    values = np.array([solve((groups != g).astype(float)) for g in range(np.max(groups) + 1)])
    return solve(np.ones(count)), spread(values)


def order_ripple(pair: Pair, lever: complex, n: int, move: Move, wavelength: float) -> OrderRipple:
    """The carriage's ripple by an order, before and after a correction. `lever`: correction / probe.

    A block with the correction would have A0 + lever (A1 - A0). Slow blocks are left out: the speed changes
    so much within their few waves that an acceleration belongs to no single way.
    """
    spreads = np.maximum(BLOCK_SPEED, BLOCK_TURNS * wavelength * move.acceleration / pair.speeds)
    bins = np.round(pair.speeds / BLOCK_SPEED)
    bins[spreads > SPREAD_MOST * pair.speeds] = np.nan
    after = pair.plain + lever * (pair.probed - pair.plain)
    doubt = (abs(1 - lever) ** 2 + abs(lever) ** 2) / pair.weights
    chosen = [bins == k for k in np.unique(bins[np.isfinite(bins)])]
    speeds = np.array([np.mean(pair.speeds[rows]) for rows in chosen])
    squares = (np.abs(pair.plain) ** 2, np.abs(after) ** 2, doubt)
    ways = (
        np.sqrt([np.mean(square[rows]) for rows in chosen]) / (math.tau * n * speeds / wavelength) ** 2
        for square in squares
    )
    return OrderRipple(speeds, *ways)


def refined_start(
    run: Run,
    plain: Blocks,
    other: Run,
    start: float,
    move: Move,
    wavelength: float,
    modes: tuple[float, ...],
) -> float:
    """The start in the other log at which the pairs of blocks lie best on a line, in all probed orders."""
    for most, step in ((LAG_MOST, LAG_COARSE), (LAG_MOST / 8, LAG_COARSE), (2 * LAG_COARSE, LAG_FINE)):
        probed = blocks(other, start, move, wavelength, modes)
        shifts = np.arange(-most, most + step / 2, step)
        total = np.zeros(len(shifts))
        for k, n in enumerate(FITTED_ORDERS):
            if n not in other.correction:
                continue
            turn = run.sign * math.tau * n * plain.speeds / wavelength
            sound = np.isfinite(plain.coefficients[:, k]) & np.isfinite(probed.coefficients[:, k])
            for j, shift in enumerate(shifts):
                shifted = probed.coefficients[:, k] * np.exp(1j * turn * shift)
                pair = Pair(
                    plain.coefficients[sound, k],
                    shifted[sound],
                    0.5 * (plain.variance + probed.variance)[sound, k],
                    plain.speeds[sound],
                )
                total[j] += float(np.sum(_misfit(pair, pair.weights)))
        start += float(shifts[np.argmin(total)])
    return start


def identify_ramps(axis: Axis, runs: Sequence[tuple[Run, Run]]) -> Lines:
    """The lines of a direction, from pairs of ramps without and with the probe.

    StudyError: a log lacks the move, or the probe has no effect.
    """
    move, wavelength = ramp(axis), axis.wavelength
    own: list[tuple[Blocks, Blocks]] = []
    twice: list[tuple[Blocks, Blocks]] = []
    remarks: list[str] = []
    hidden = ""
    for run, other in runs:
        start = find_start(run, move, wavelength)
        if run is runs[0][0]:
            hidden = check_pace(run, start, move, wavelength)
            check_duration(run, start, move)
        modes = ringing_modes(run, start, move, wavelength)
        remarks = remarks or other_causes(axis, run, start, modes)
        plain = blocks(run, start, move, wavelength, modes)
        other_start = refined_start(
            run, plain, other, find_start(other, move, wavelength), move, wavelength, modes
        )
        own.append((plain, blocks(other, other_start, move, wavelength, modes)))
        twice.append(
            (
                blocks(run, start, move, 2 * wavelength, modes),
                blocks(other, other_start, move, 2 * wavelength, modes),
            )
        )
    first, second = runs[0]
    pairs = {n: joined(own, n) for n in FITTED_ORDERS if n in second.correction}
    if max(pair.change for pair in pairs.values()) < CHANGE_LEAST:
        raise StudyError(
            f"{second.name}: the probe has no effect, compared with {first.name}: expected a printer whose "
            "SET_PHASE_CORRECTION acts, and a separate log for each ramp"
        )
    hidden = check_wavelength(second.name, axis, own, twice) or hidden
    psi: dict[int, complex] = {}
    coefficients: dict[int, Coefficient] = {}
    for _ in range(PROBE_ROUNDS):
        before, after = (shifted_orders(psi, run.correction) for run in (first, second))
        probe = {n: after[n] - before.get(n, 0j) for n in pairs}
        for n, pair in pairs.items():
            rest, error = psi_of(pair, probe[n])
            psi[n] = rest - before.get(n, 0j)
            coefficients[n] = Coefficient(-psi[n], error)
    products = coupling(psi, second.correction)
    coefficients = {
        n: replace(entry, error=math.hypot(entry.error, products[n])) for n, entry in coefficients.items()
    }
    frequencies = {n: n * pair.speeds / wavelength for n, pair in pairs.items()}
    ratios = [
        np.abs(pair.probed - pair.plain)
        / abs(probe[n])
        / (math.tau * frequencies[n]) ** 2
        * (math.tau / wavelength)
        for n, pair in pairs.items()
    ]
    answer = Answer(np.concatenate(list(frequencies.values())), np.concatenate(ratios))
    ripple = {
        n: order_ripple(pair, coefficients[n].value / probe[n], n, move, wavelength)
        for n, pair in pairs.items()
    }
    return Lines(coefficients, answer, [*filter(None, [hidden]), *remarks], ripple, RAMPS_NOTE)
