"""Corrections from runs at a constant speed whose start is not known: only the sizes of lines are used.

A run with the correction phi has |A|^2 = g |psi + phi|^2 = g |phi|^2 + 2 Re(conj(b) phi) + e, which is linear
in g, b = g psi and e. Four runs with different phi are enough; noise adds to e alone, and so does no harm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from cogless.errors import StudyError
from cogless.printer.axis import Axis
from cogless.printer.corrections import RESONANCE_RATIO, Answer, Coefficient, Lines, OrderRipple
from cogless.printer.records import (
    CORRECTED_ORDERS,
    FITTED_ORDERS,
    PROBE_SIZE,
    Numbers,
    Orders,
    Run,
    coupling,
    lines_fit,
    shifted_orders,
)

CLOCK_SHARE = 0.012  # share by which an accelerometer's rate may be off
CLOCK_STEPS = 121  # rates that are tried
RUNS_LEAST = 4  # runs at each speed
SAMPLED_SHARE = 0.42  # of the sampling rate: an order above it is not heard
RESONANCE_APART = 0.15  # distance of an order from a resonance / its frequency, at least
LOUD_ERROR = 0.03  # share of an amplitude that the model misses
CONFIDENCE_RADIUS = math.sqrt(-2 * math.log(0.05))  # 95 % in a plane, in standard deviations of a coordinate
RUN_ROUNDS = 3  # rounds, after which each correction's share in each order has settled
SWING_MOST = 2 * PROBE_SIZE  # rad, swing of a motor with the probe, if the carriage follows it
HEARD_ERROR = 0.5  # error / size of psi and probe: an order with more is not heard
GRID_SPEED = 1e-3  # m/s, between speeds that are tried
SPEEDS_SOUGHT = (0.03, 0.12)  # m/s
MODES_MISS = 0.1  # share by which a model with two modes may miss the carriage's answer
CURVE_SPAN = 8.0  # highest / lowest speed at which the ripple is shown
CURVE_SPEEDS = 40
RUNS_NOTE = (
    "How far each order of the electrical revolution moves the carriage (amplitude), computed from the runs "
    "with a model of the axis: a mass on a belt, and a rotor that the magnetic field holds like a spring. A "
    "picture ends at the highest frequency of the runs. Near a resonance, where the carriage moves more than "
    f"{RESONANCE_RATIO:g} times as far as the motor, the curves are cut: the ripple is larger there. The "
    "curve with the correction is not a measurement: it shows the ripple that the correction's error may "
    "leave."
)


@dataclass(frozen=True, eq=False)
class SpeedRun:
    """A run at a constant speed, m/s."""

    run: Run
    speed: float


def heard_orders(speed: float, rate: float, wavelength: float) -> tuple[int, ...]:
    """The orders that an accelerometer of this rate hears at this speed."""
    return tuple(n for n in FITTED_ORDERS if n * speed / wavelength < SAMPLED_SHARE * rate)


def line_sizes(record: SpeedRun, wavelength: float) -> tuple[dict[int, float], dict[int, float]]:
    """|A|^2 by order, and variances of |A|^2, with the sampling rate that makes the lines largest."""
    run = record.run
    orders = heard_orders(record.speed, run.rate, wavelength)
    turns = record.speed / wavelength * (run.times - run.times[0])
    window = np.hanning(len(turns))
    centred = window * (run.acceleration - np.mean(run.acceleration))

    def energy(scale: float) -> float:
        waves = (np.exp(-1j * math.tau * scale * n * turns) for n in CORRECTED_ORDERS if n in orders)
        return sum(abs(complex(np.dot(centred, wave))) ** 2 for wave in waves)

    scales = 1 + CLOCK_SHARE * np.linspace(-1, 1, CLOCK_STEPS)
    scale = float(scales[np.argmax([energy(float(s)) for s in scales])])
    fit = lines_fit(run.acceleration, scale * turns, orders, np.empty((len(turns), 0)))
    squares = np.abs(fit.values) ** 2
    variances = 4 * squares * fit.variances + 8 * fit.variances**2 + (2 * LOUD_ERROR * squares) ** 2
    return dict(zip(orders, squares, strict=True)), dict(zip(orders, variances, strict=True))


def quiet_speed(axis: Axis, resonances: Sequence[float], near: float) -> float | None:
    """The speed nearest to `near`, m/s, at which each order is off the resonances; None: there is none."""
    speeds = np.arange(*SPEEDS_SOUGHT, GRID_SPEED)
    frequencies = np.outer(CORRECTED_ORDERS, speeds) / axis.wavelength
    apart = np.min(
        [np.min(np.abs(frequencies / f - 1), axis=0) for f in resonances], axis=0, initial=math.inf
    )
    allowed = speeds[apart > RESONANCE_APART]
    return float(allowed[np.argmin(np.abs(allowed - near))]) if len(allowed) else None


def check_speed(axis: Axis, speed: float, resonances: Sequence[float], where: str) -> None:
    """StudyError: an order lies on a resonance at this speed, so the carriage's answer is not linear."""
    for n in CORRECTED_ORDERS:
        frequency = n * speed / axis.wavelength
        near = next((f for f in resonances if abs(frequency / f - 1) <= RESONANCE_APART), None)
        if near is not None:
            better = quiet_speed(axis, resonances, speed)
            advice = (
                "an axis with other resonances"
                if better is None
                else f"another speed, such as {1e3 * better:.0f} mm/s"
            )
            raise StudyError(
                f"{where}: {1e3 * speed:.4g} mm/s: order {n} is at {frequency:.0f} Hz there, on the "
                f"resonance at {near:.0f} Hz: expected {advice}"
            )


def _solve(
    corrections: Sequence[complex], squares: Numbers, variances: Numbers
) -> tuple[complex, Numbers, float] | None:
    """psi, the covariance of its real and imaginary part, and g = |G|^2; None: the runs do not give them."""
    phi = np.array(corrections)
    columns = np.column_stack([np.abs(phi) ** 2, 2 * phi.real, 2 * phi.imag, np.ones(len(phi))])
    scaled = columns / PROBE_SIZE ** np.array([2, 1, 1, 0])
    weights = 1 / variances
    normal = scaled.T @ (weights[:, None] * scaled)
    if np.linalg.matrix_rank(scaled) < RUNS_LEAST:
        return None
    solution = np.linalg.solve(normal, scaled.T @ (weights * squares))
    g, b = float(solution[0]), complex(solution[1], solution[2])
    if g <= 0:
        return None
    psi = PROBE_SIZE * b / g
    gradient = np.array([[-psi.real, PROBE_SIZE, 0, 0], [-psi.imag, 0, PROBE_SIZE, 0]]) / g
    return psi, gradient @ np.linalg.inv(normal) @ gradient.T, g / PROBE_SIZE**2


def inverse_answer(answer: Answer) -> tuple[float, float] | None:
    """a and b of 1 / H = 1 - a f^2 + b f^4, Hz^-2 and Hz^-4: a rotor on its field, a belt and a carriage.

    Only |H| is known. H is negative between its two resonances, so the fit tries all places of the two.
    None: no fit is close.
    """
    scale = float(np.max(answer.frequencies)) ** 2
    squares, ratios = answer.frequencies**2 / scale, answer.ratios
    columns = ratios[:, None] * np.column_stack([-squares, squares**2])
    least, fit = MODES_MISS, None
    for low, high in combinations_with_replacement([0.0, *np.unique(squares)], 2):
        rest = np.where((squares > low) & (squares <= high), -1.0, 1.0) - ratios
        (a, b), *_ = np.linalg.lstsq(columns, rest)
        miss = float(np.max(np.abs(columns @ [a, b] - rest)))
        if miss < least and b >= 0 and a >= 2 * math.sqrt(b):
            least, fit = miss, (float(a) / scale, float(b) / scale**2)
    return fit


def order_ripple(
    coefficients: Mapping[int, Coefficient], answer: Answer, wavelength: float
) -> dict[int, OrderRipple]:
    """The carriage's ripple by order, up to the runs' highest frequency. A correction leaves its error."""
    fit = inverse_answer(answer)
    if fit is None:
        return {}
    top = float(np.max(answer.frequencies))
    frequencies = np.geomspace(top / CURVE_SPAN, top, CURVE_SPEEDS)
    inverse = np.abs(1 - fit[0] * frequencies**2 + fit[1] * frequencies**4)
    ways = wavelength / math.tau / np.maximum(inverse, 1 / RESONANCE_RATIO)
    return {
        n: OrderRipple(
            frequencies * wavelength / n, abs(entry.value) * ways, entry.error * ways, entry.error * ways
        )
        for n, entry in coefficients.items()
    }


def identify_magnitudes(axis: Axis, records: Sequence[SpeedRun], where: str) -> Lines:
    """The lines of a direction. `where`: begins the text of a StudyError.

    StudyError: too few runs at a speed, an order on a resonance, or an order that is heard in no run.
    """
    speeds = sorted({record.speed for record in records})
    sizes = {id(record): line_sizes(record, axis.wavelength) for record in records}
    psi: Orders = {}
    estimates: dict[int, list[tuple[complex, float]]] = {}
    answers: list[tuple[float, float]] = []
    for round_ in range(RUN_ROUNDS):
        estimates, answers = {n: [] for n in CORRECTED_ORDERS}, []
        for speed in speeds:
            runs = [record for record in records if record.speed == speed]
            if len(runs) < RUNS_LEAST:
                raise StudyError(
                    f"{where}: {len(runs)} runs at {1e3 * speed:.4g} mm/s: expected {RUNS_LEAST}, as "
                    "--plan writes"
                )
            shifts = [shifted_orders(psi, _whole(record.run.correction)) for record in runs]
            for n in CORRECTED_ORDERS:
                if any(n not in sizes[id(record)][0] for record in runs):
                    continue
                omega = math.tau * n * speed / axis.wavelength
                squares, variances = (np.array([sizes[id(r)][k][n] for r in runs]) for k in (0, 1))
                solved = _solve([shift[n] for shift in shifts], squares, variances)
                if solved is None:
                    swing = math.sqrt(float(np.mean(squares))) / omega**2 * math.tau / axis.wavelength
                    if swing > RESONANCE_RATIO * SWING_MOST:
                        check_speed(axis, speed, [omega / math.tau], where)
                    continue
                value, covariance, gain = solved
                ratio = math.sqrt(gain) / omega**2 * math.tau / axis.wavelength
                answers.append((omega / math.tau, ratio))
                if ratio > RESONANCE_RATIO and round_ == RUN_ROUNDS - 1:
                    check_speed(axis, speed, [omega / math.tau], where)
                error = CONFIDENCE_RADIUS * math.sqrt(float(np.trace(covariance)) / 2)
                if error < HEARD_ERROR * (abs(value) + PROBE_SIZE):
                    estimates[n].append((value, error))
        silent = next((n for n, values in estimates.items() if not values), None)
        if silent is not None:
            raise StudyError(
                f"{where}: order {silent} is lost in noise at {', '.join(f'{1e3 * s:.4g}' for s in speeds)} "
                "mm/s: expected runs with different corrections, another speed, or a quieter fan"
            )
        psi = {n: _mean(values)[0] for n, values in estimates.items()}
    products = coupling(psi, records[0].run.correction)
    coefficients = {
        n: Coefficient(-_mean(values)[0], math.hypot(_mean(values)[1], products[n]))
        for n, values in estimates.items()
    }
    answer = Answer(*(np.array(column) for column in zip(*answers, strict=True)))
    ripple = order_ripple(coefficients, answer, axis.wavelength)
    return Lines(coefficients, answer, ripple=ripple, ripple_note=RUNS_NOTE)


def _whole(correction: Orders) -> dict[int, complex]:
    return {n: complex(correction.get(n, 0j)) for n in CORRECTED_ORDERS}


def _mean(values: Sequence[tuple[complex, float]]) -> tuple[complex, float]:
    """Weighted mean of pairs of estimate and error; the mean's error, larger if they scatter more."""
    weights = [1 / error**2 for _, error in values]
    mean = sum(w * value for w, (value, _) in zip(weights, values, strict=True)) / sum(weights)
    misfit = sum(w * abs(value - mean) ** 2 for w, (value, _) in zip(weights, values, strict=True))
    scale = max(1.0, CONFIDENCE_RADIUS**2 * misfit / 2 / max(len(values) - 1, 1))
    return mean, math.sqrt(scale / sum(weights))
