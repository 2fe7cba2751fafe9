"""Find logs that mislead: sentences with cures, and values that must not be concluded from such logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cogless.identify.advice import Advice, AdvisedError, logs_of_kind, recording
from cogless.identify.balance import BLUR_PHASE, WAVE_RATE_SHARE, Model, Rows, narrowest_width
from cogless.identify.cogging_orders import ORDER_HIGHEST
from cogless.identify.config import Identification
from cogless.identify.jackknife import Fit, fit, jackknife
from cogless.identify.log import Log
from cogless.identify.result import Estimate, Wave
from cogless.results.trace import Array
from cogless.units import TURN

SPEED_DIFFERENCE = 0.15  # relative: speeds that differ by less are one
FED_BACK = 0.99  # correlation of i_q with an earlier speed, above which i_q is the feedback law's answer
FEEDBACK_LAGS = 6  # lags that are tried, from 0 samples on
STILL_SHARE, STILL_TIME = 0.25, 0.02  # share of standstill that spoils a log; s without a count: standstill
SLIPS_LEAST, SLIP_ROWS = 3, 4  # least slips of a rotor that sticks and slips; rows for the speed of a slip
FRICTION_DIFFERENCE = 0.2  # relative difference of friction between logs, above which a sentence reports it
PHASE_DIFFERENCE = 0.35  # rad, difference of the strongest order's phase between logs that is reported
LOG_PARTS = 12  # parts of a log, each left out by the jackknife of the log's own coefficients
CONDITION_MOST = 1e8  # largest condition of equations that are still solved
STANDS_OUT = 5.0  # standard errors
LIKELY_RIPPLE = 0.1  # largest likely ripple of K_t, relative
SIDEBAND_SHARE = 0.5  # largest size of a sideband over the size of the order between the sidebands
WIDTH_SLACK = 1e-6  # relative, for rounding
SPARE_SPEED = 0.9  # advised speed over the speed at which an order just shows
# least correlation of current changes with reference changes a row later that shows exchanged columns, and
# least excess of this correlation over the one with the opposite lag
LEAD_CORRELATION = 0.2


def usable(identification: Identification, logs: Sequence[Log]) -> tuple[list[Log], list[str]]:
    """The logs that can be used, and sentences on unusable logs and on logs that mislead."""
    used: list[Log] = []
    sentences: list[str] = []
    offsets = offsets_of(logs)
    if offsets is not None:
        offset_text = ", ".join(f"{1e3 * offset:.3g}" for offset in offsets)
        sentences.append(
            f"With the bridge off the phase currents show {offset_text} mA; these offsets are taken out of "
            "i_q."
        )
    for log in logs:
        if log.kind == "bridge-off":
            sentences += _said_of_bridge_off(identification, log)
            continue
        without = _unusable(identification, log)
        if without:
            sentences.append(without)
            continue
        used.append(prepared(identification, log, offsets))
        exchanged = _exchanged(identification, log)
        if exchanged is not None:
            sentences.append(exchanged)
        law = feedback(log)
        if law is not None:
            lag, correlation, gain = law
            sentences.append(
                Advice(
                    f"{log.name}: i_q follows the speed with a gain of {-gain:.3g} A*s/rad, {lag} samples "
                    f"late (correlation {correlation:.4f}). So it shows the feedback law, and little of the "
                    "motor; add an acceleration log.",
                    logs_of_kind("acceleration"),
                )
            )
    plant = [log for log in used if feedback(log) is None]
    return (plant if any(log.dt for log in plant) else used), sentences


def heading(identification: Identification, signal: str) -> str:
    """The heading that a log lacks, in brackets; "" where the file of columns names none."""
    return f' (no column "{identification.columns[signal].name}")' if signal in identification.columns else ""


def _said_of_bridge_off(identification: Identification, log: Log) -> list[str]:
    """Sentences on what cannot be known from a log with the bridge off."""
    if not {"i_a", "i_b"} <= log.signals.keys():
        return [
            Advice(
                f"{log.name}: the bridge is off, and there are no phase currents"
                f"{heading(identification, 'i_a')}, so nothing can be identified from it; "
                "record i_a and i_b.",
                recording(signal=("i_a", "i_b"), log=log.name),
            )
        ]
    if "theta" in log and np.ptp(log["theta"]) > TURN:
        return [
            Advice(
                f"{log.name}: this log gives only the currents' offsets, since with the bridge off it is "
                "not known what turns the rotor; if nothing turns it, give the log the kind coast-down.",
                recording(kind="coast-down", log=log.name),
            )
        ]
    return []


def _unusable(identification: Identification, log: Log) -> str | None:
    """Why a log can't be used, with the cure; None if it can."""
    if "theta" not in log:
        missing = heading(identification, "theta")
        return Advice(
            f"{log.name}: no angle{missing}: cogging cannot be placed; record the encoder's angle as theta.",
            recording(signal="theta", log=log.name),
        )
    if "i_q" not in log and log.kind != "coast-down":
        return Advice(
            f"{log.name}: no current{heading(identification, 'i_q')}: torque is not known; "
            "record i_q, or give the log the kind coast-down.",
            recording(signal="i_q", log=log.name),
            recording(kind="coast-down", log=log.name),
        )
    if not log.dt:
        return None
    stuck = _sticks(identification, log)
    if stuck:
        return stuck
    return None


def _up(rate: float) -> float:
    """A rate rounded up to two digits, as messages show."""
    digit = 10.0 ** (np.floor(np.log10(rate)) - 1)
    return float(np.ceil(rate / digit * (1 - 1e-9)) * digit)


def _sticks(identification: Identification, log: Log) -> str | None:
    """Advice what to record instead of a log whose rotor stands still too often; None for other logs."""
    rows = max(1, round(STILL_TIME / log.dt))
    still = np.abs(log["theta"][rows:] - log["theta"][:-rows]) <= identification.step
    share = float(np.mean(still))
    if share <= STILL_SHARE:
        return None
    beginning = (
        f"{log.name}: the rotor stands still {100 * share:.0f} % of the time, where friction is not known"
    )
    if np.count_nonzero(np.diff(still.astype(np.int8)) < 0) < SLIPS_LEAST:
        return Advice(
            f"{beginning}; turn faster, or with higher feedback gains.",
            recording(kind="constant-speed", log=log.name),
        )
    turned = np.abs(log["theta"][SLIP_ROWS:] - log["theta"][:-SLIP_ROWS])
    slip = float(np.percentile(turned[rows:], 99)) / (SLIP_ROWS * log.dt * TURN)
    needed = 6 * identification.motor.pole_pairs * slip / WAVE_RATE_SHARE
    rate = _up(max(needed, 1 / log.dt))
    return Advice(
        f"{beginning}: the rotor sticks and slips at {slip:.2g} rev/s; record at this speed or faster, with "
        f"{rate:.0f} rows a second or more, or with higher feedback gains.",
        recording(speed=TURN * slip, rate=rate, log=log.name),
    )


def offsets_of(logs: Sequence[Log]) -> tuple[float, float, float] | None:
    """Offsets of the phase currents, A, from logs with the bridge off; None if there is no such log."""
    off = [log for log in logs if log.kind == "bridge-off" and "i_a" in log and "i_b" in log]
    if not off:
        return None
    a, b = (float(np.mean(np.concatenate([log[name] for log in off]))) for name in ("i_a", "i_b"))
    with_c = [log["i_c"] for log in off if "i_c" in log]
    return a, b, float(np.mean(np.concatenate(with_c))) if with_c else -a - b


def prepared(identification: Identification, log: Log, offsets: tuple[float, float, float] | None) -> Log:
    """The log with torque over K_t, A, i_q without the currents' offsets, and i_q = 0 with the bridge off."""
    signals = dict(log.signals)
    if offsets is not None and "i_q" in signals:
        theta_e = identification.motor.pole_pairs * signals["theta"]
        waves = [np.sin(theta_e - third * TURN / 3) for third in range(3)]
        signals["i_q"] = signals["i_q"] + 2 / 3 * sum(o * w for o, w in zip(offsets, waves, strict=True))
    if "torque" in signals:
        signals["torque"] = signals["torque"] / identification.motor.star().K_t
    if log.kind in ("coast-down", "bridge-off"):
        signals["i_q"] = np.zeros(len(log))
    return replace(log, signals=signals)


def check_sign(identification: Identification, logs: Sequence[Log], rows: Sequence[Rows]) -> None:
    """Refuse currents of the wrong sign: they brake a motor that turns against friction."""
    for log in logs:
        own = [stretch for stretch in rows if stretch.log is log and len(stretch.y) > 30]
        if not log.dt or not own or log.kind in ("load", "coast-down"):
            continue
        log_fit = fit(own)
        wrong = log_fit["c",] < -STANDS_OUT * log_fit.error(("c",)) and log_fit["j",] <= 0
        speed = np.concatenate([stretch.omega for stretch in own])
        power = float(np.mean(np.concatenate([stretch.y for stretch in own]) * speed))
        alpha = np.concatenate([stretch.columns[:, 0] for stretch in own])
        stored = log_fit["j",] * float(np.mean(alpha * speed))
        if wrong and power - stored < 0:
            heading = identification.columns["i_q"].name
            raise AdvisedError(
                Advice(
                    f"{log.name}: {heading}: inertia and friction come out negative, as if the current "
                    "braked the motor that it drives: expected the other sign: "
                    f'columns.i_q = {{ name = "{heading}", sign = {-identification.columns["i_q"].sign} }}',
                    {"columns.i_q.sign": -identification.columns["i_q"].sign},
                )
            )


def one_speed(logs: Sequence[Log]) -> bool:
    """Whether all logs are at one speed, by mean speeds over a twentieth of each log."""
    low, high = zip(*(np.percentile(_speeds(log), [30, 95]) for log in logs), strict=True)
    return bool(min(low) > (1 - SPEED_DIFFERENCE) * max(high))


def said_of_one_speed(logs: Sequence[Log]) -> str:
    """A sentence on what can be known from logs at one speed, and what not."""
    speed = float(np.median(np.concatenate([_speeds(log) for log in logs]))) / TURN
    turning = [(log["i_q"], np.sign(log["theta"][-1] - log["theta"][0])) for log in logs]
    mean = float(np.mean([np.mean(current) * sign for current, sign in turning]))
    return Advice(
        f"The logs have only one speed ({speed:.3g} rev/s): inertia, friction and delay cannot be identified "
        f"(its mean current, {mean:.3g} A, is friction and load together); add an acceleration log "
        "and a second speed.",
        logs_of_kind("acceleration", "constant-speed"),
    )


def _speeds(log: Log) -> Array:
    theta, rows = log["theta"], max(2, len(log) // 20)
    return np.asarray(np.abs(theta[rows:] - theta[:-rows]) / (rows * log.dt))


def _exchanged(identification: Identification, log: Log) -> str | None:
    """Advice on a log whose i_q comes before its i_q_ref: the measured current should be the later one."""
    if not {"i_q", "i_q_ref"} <= log.signals.keys() or not log.dt:
        return None
    current, reference_changes = (np.diff(log[name]) for name in ("i_q", "i_q_ref"))
    size = float(np.linalg.norm(current) * np.linalg.norm(reference_changes))
    if size == 0:
        return None
    after, before = (
        float(current[1:] @ reference_changes[:-1]) / size,
        float(current[:-1] @ reference_changes[1:]) / size,
    )
    if min(before, before - after) < LEAD_CORRELATION:
        return None
    measured, reference = (identification.columns[name].name for name in ("i_q", "i_q_ref"))
    return Advice(
        f"{log.name}: {measured} comes before {reference}, which it should follow (correlation of their "
        f"changes {before:.2g} a row before, {after:.2g} a row after): the two look exchanged: expected "
        f'columns.i_q.name = "{reference}", columns.i_q_ref.name = "{measured}".',
        {"columns.i_q.name": reference, "columns.i_q_ref.name": measured},
    )


def feedback(log: Log) -> tuple[int, float, float] | None:
    """Lag, samples, size of the correlation, and gain of i_q on the earlier speed; None: no feedback law."""
    if "omega" not in log or "i_q" not in log or not log.dt:
        return None
    omega, current = log["omega"], log["i_q"]
    best = (0, 0.0)
    for lag in range(FEEDBACK_LAGS):
        x, y = omega[: len(omega) - lag], current[lag:]
        if np.std(x) == 0 or np.std(y) == 0:
            return None
        correlation = float(np.corrcoef(x, y)[0, 1])
        if abs(correlation) > abs(best[1]):
            best = (lag, correlation)
    lag, correlation = best
    if not correlation < -FED_BACK:
        return None
    return lag, -correlation, float(np.polyfit(omega[: len(omega) - lag], current[lag:], 1)[0])


def between_logs(
    rows: Sequence[Rows], joint_fit: Fit, model: Model, left_out: list[str], delay_error: float = 0.0
) -> list[str]:
    """Sentences on differences between logs: friction, and the place of the strongest order.

    `delay_error`: error of the currents' delay, s; it moves a wave's phase in proportion to each log's speed.
    """
    sentences: list[str] = []
    by_log: dict[str, list[Rows]] = {}
    for stretch in rows:
        by_log.setdefault(stretch.log.name, []).append(stretch)
    if ("c",) in joint_fit and joint_fit["c",] > 0:
        friction = {
            name: of
            for name, own in by_log.items()
            if own[0].log.dt and own[0].log.kind != "load"
            for of in [_own(own, joint_fit, (("c",),))[0].real]
        }
        named = {stretch.log.rule.session for stretch in rows} - {None}
        if len(friction) > 1 and len(named) < 2:  # Otherwise the sessions say it.
            low, high = min(friction, key=friction.__getitem__), max(friction, key=friction.__getitem__)
            if friction[high] - friction[low] > FRICTION_DIFFERENCE * joint_fit["c",]:
                sentences.append(
                    Advice(
                        f"Sessions differ: friction {friction[low]:.3g} A in {low} and {friction[high]:.3g} "
                        "A in "
                        f"{high}; identify each session by itself, or warm the motor up first.",
                        recording(logs=(low,)),
                        recording(logs=(high,)),
                    )
                )
    if model.cogging:
        sentences += _turned(by_log, joint_fit, model, left_out, delay_error)
    return sentences


def strongest_order(joint_fit: Fit, model: Model) -> int:
    """The order of the largest cogging."""
    return max(
        model.cogging, key=lambda n: np.hypot(joint_fit["cogging", n, "c"], joint_fit["cogging", n, "s"])
    )


def _turned(
    by_log: dict[str, list[Rows]], joint_fit: Fit, model: Model, left_out: list[str], delay_error: float
) -> list[str]:
    strongest = strongest_order(joint_fit, model)
    names = (("cogging", strongest, "c"), ("cogging", strongest, "s"))
    waves = {name: _own(own, joint_fit, names) for name, own in by_log.items()}
    clear = {name: w for name, (w, error) in waves.items() if 0 < error < PHASE_DIFFERENCE * abs(w)}
    if len(clear) < 2:
        return []
    late = {name: delay_error * strongest * _median_speed(own) for name, own in by_log.items()}
    open_by = {name: waves[name][1] / abs(wave) + late[name] for name, wave in clear.items()}  # rad
    first = min(open_by, key=open_by.__getitem__)
    for name, wave in clear.items():
        turn, size = float(np.angle(wave / clear[first])), abs(wave / clear[first])
        unsure = PHASE_DIFFERENCE + np.hypot(open_by[name], open_by[first])
        if abs(turn) > unsure:
            left_out.append("Cogging is left out, since its place differs between the logs.")
            if abs(np.log(size)) > unsure:  # A slipped index would change the wave's phase, not its size.
                return [
                    f"{name}: order {strongest} is {size:.2g} times as large as in {first}, and its phase "
                    f"differs by {np.degrees(turn):.0f} deg. Cogging alone would be equal in all logs; the "
                    "effect of an angle error grows with the speed, other effects may change with load "
                    "and temperature."
                ]
            return [
                Advice(
                    f"{name}: the phase of order {strongest} differs by {np.degrees(turn):.0f} deg from that "
                    f"in {first}, so the rotor's angle is shifted by {np.degrees(abs(turn)) / strongest:.2g} "
                    "deg or more. Either the encoder's index has slipped, or the encoder takes the position "
                    "at switch-on as zero; find the index before each log.",
                    recording(index=True, log=name),
                )
            ]
    return []


def _median_speed(rows: Sequence[Rows]) -> float:
    return float(np.median(np.abs(np.concatenate([part.omega for part in rows]))))


def _own(
    rows: Sequence[Rows], joint_fit: Fit, names: Sequence[tuple[str | int, ...]]
) -> tuple[complex, float]:
    """One or two coefficients fitted to these rows alone (the second as imaginary part), and their error.

    The error is three standard errors by a jackknife. It is large where a single part of the rows shows the
    coefficient, such as the reversal in a fast log.
    """
    a = np.concatenate(
        [stretch.columns[:, [stretch.names.index(name) for name in names]] for stretch in rows]
    )
    r = np.concatenate([stretch.y - joint_fit.prediction(stretch) for stretch in rows])
    matrix, vector = a.T @ a, a.T @ r
    if np.linalg.cond(matrix) > CONDITION_MOST:
        return 0j, 0.0
    moved = np.linalg.solve(matrix, vector)
    own = [joint_fit[name] + by for name, by in zip(names, moved, strict=True)]
    wave = complex(own[0], own[1] if len(own) > 1 else 0.0)
    without = []
    for part in np.array_split(np.arange(len(r)), LOG_PARTS):
        rest = matrix - a[part].T @ a[part]
        if np.linalg.cond(rest) > CONDITION_MOST:
            return wave, np.inf
        without.append(np.linalg.solve(rest, vector - a[part].T @ r[part]))
    return wave, 3 * float(np.max(jackknife(np.array(without))))


def _without_sidebands(estimate: Estimate, cogging: tuple[Wave, ...]) -> tuple[tuple[Wave, ...], list[str]]:
    """Leave out orders n -+ k of a larger order n: an encoder's error of order k makes such sidebands."""
    waves, encoder_orders = {wave.order: wave for wave in cogging}, {wave.order for wave in estimate.encoder}
    out: set[int] = set()
    sentences: list[str] = []
    for k in (k for k in (1, 2) if k not in encoder_orders):
        for main in sorted(cogging, key=lambda wave: -wave.size.value):
            near = (waves.get(main.order - k), waves.get(main.order + k))
            weaker = [wave for wave in near if wave and wave.size.value < SIDEBAND_SHARE * main.size.value]
            weaker = [wave for wave in weaker if wave.order not in out]
            if main.order in out or not weaker:
                continue
            largest = max(wave.size.value for wave in weaker)
            degrees = np.degrees(2 * largest / (main.order * main.size.value))
            out |= {wave.order for wave in weaker}
            sentences.append(
                Advice(
                    f"Order {' and '.join(str(wave.order) for wave in weaker)} may be cogging, or come from "
                    f"the larger order {main.order} by an encoder's error of order {k} ({degrees:.2g} deg), "
                    "which distorts it; add a faster log.",
                    logs_of_kind("constant-speed"),
                )
            )
    return tuple(wave for wave in cogging if wave.order not in out), sentences


def without_nonsense(estimate: Estimate, left_out: list[str]) -> Estimate:
    """The estimate without wrong or inseparable values; `left_out` gets a sentence on each."""
    values, cogging = dict(estimate.values), estimate.cogging
    poles = estimate.identification.motor.pole_pairs
    if "j" in values and not values["j"].value > 2 * values["j"].error:
        left_out.append(
            Advice(
                "Inertia is not larger than its error, so inertia, friction and delay cannot be identified; "
                "add an acceleration log.",
                logs_of_kind("acceleration"),
            )
        )
        for key in ("j", "b", "c", "delay"):
            values.pop(key, None)
    if "b" in values and values["b"].value < 0:
        small = values["b"].value > -2 * values["b"].error
        if not small:
            left_out.append("Viscous friction comes out negative and is left out.")
        del values["b"]
    if any("is left out, since its place" in sentence for sentence in left_out):
        cogging = ()
    cogging, sideband_remarks = _without_sidebands(estimate, cogging)
    left_out += sideband_remarks
    left_out += _out_of_sight(estimate)
    unknown: tuple[Wave, ...] = ()
    if any(wave.order == poles for wave in cogging) and estimate.offsets is None:
        left_out.append(
            Advice(
                f"Order {poles} is the number of pole pairs: cogging and a current offset cannot be told "
                "apart; record currents with the bridge off.",
                logs_of_kind("bridge-off"),
            )
        )
        unknown = tuple(wave for wave in cogging if wave.order == poles)
        cogging = tuple(wave for wave in cogging if wave.order != poles)
    current = float(np.mean([abs(np.mean(stretch.y)) for stretch in estimate.rows])) if estimate.rows else 0.0
    if not any(log.dt for log in estimate.logs) and any(wave.order == 6 * poles for wave in cogging):
        left_out.append(
            Advice(
                f"Order {6 * poles} is six times the pole pairs: K_t ripple and cogging cannot be told "
                f"apart at one load; a ripple of {100 * LIKELY_RIPPLE:.0f} % would be "
                f"{LIKELY_RIPPLE * current:.2g} A of this order; record logs with loads of both signs.",
                logs_of_kind("load"),
            )
        )
    sentences = tuple(dict.fromkeys(left_out))
    return replace(estimate, values=values, cogging=cogging, of_unknown_cause=unknown, left_out=sentences)


def _out_of_sight(estimate: Estimate) -> list[str]:
    """Advice for the highest order at which such a motor may cog, if no log can show this order."""
    moving = [log for log in estimate.logs if log.dt]
    if len(moving) < len(estimate.logs) or not moving:
        return []
    log = min(moving, key=lambda log: estimate.model.width(log) * speed(log))
    turning = max(1e-9, speed(log))
    highest = BLUR_PHASE / (estimate.model.width(log) * turning)
    poles = estimate.identification.motor.pole_pairs
    order = max((n for n in (2 * poles, 6 * poles, 12 * poles) if highest < n <= ORDER_HIGHEST), default=0)
    if not order:
        return []
    slower = SPARE_SPEED * turning * highest / order
    cures = [recording(speed=slower, log=log.name)]
    needs = f"turn at {slower / TURN:.2g} rev/s"
    by_rows = narrowest_width(log)
    if estimate.model.width(log) < (1 + WIDTH_SLACK) * by_rows:  # more rows make the kernel narrower
        rate = _up(by_rows / log.dt * order * turning / BLUR_PHASE / SPARE_SPEED)
        cures = [recording(rate=rate, log=log.name), *cures]
        needs = f"record {rate:.0f} rows a second, or {needs}"
    return [
        Advice(
            f"{log.name}: orders are seen up to {highest:.0f} at {turning / TURN:.2g} rev/s, the slowest "
            f"speed. A motor of {poles} pole pairs may also cog at order {order}. To see this order, "
            f"{needs}.",
            *cures,
        )
    ]


def speed(log: Log) -> float:
    """Median speed of a log of a turning motor, rad/s, without sign."""
    return float(np.median(_speeds(log)))
