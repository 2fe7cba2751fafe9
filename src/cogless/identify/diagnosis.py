"""Find the causes of the speed's ripple: the main cause, those of each log and order, and what stays open."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cogless.errors import StudyError
from cogless.identify import config, speed_alone
from cogless.identify.advice import Advice, AdvisedError, logs_of_kind, recording
from cogless.identify.balance import corrected
from cogless.identify.causes import (
    BEYOND,
    COGGING,
    ENCODER,
    OR,
    RIPPLE,
    SPEED_RATIO_LEAST,
    Cause,
    OrderCauses,
    attributed,
)
from cogless.identify.estimate import Progress, estimate_motor, not_told_apart
from cogless.identify.findings import prepared
from cogless.identify.log import Log, load_logs
from cogless.identify.result import Estimate
from cogless.identify.speed_alone import LARGE_SHARE
from cogless.identify.steady import Steady, steady, with_angle
from cogless.identify.voltage import Agreement
from cogless.units import TURN

NO_ORDER = "no order"  # of the rotor's motion: vibration, or slow changes of the speed
LINE_SHARE_LEAST = 0.01  # share of the ripple's square: an order below it has no line
CANCELLED_SHARE = 0.2  # share of an order: a sentence reports causes that cancel by more
ROWS_A_WAVE = 2.5  # rows that show an order, with some to spare


@dataclass(frozen=True)
class Diagnosis:
    """The orders of each log's motion with their causes.

    `whole`: ripple of each log by its angle, with the sensor's error, rms, rad/s. `logged`: ripple of the
    logged speed, for logs that have a speed. `uses`: for each log without a steady part, its use or the
    reason why it is not used.
    """

    title: str
    orders: tuple[OrderCauses, ...]
    whole: Mapping[str, float]
    remarks: tuple[str, ...]
    logged: Mapping[str, float] = field(default_factory=dict)
    uses: Mapping[str, str] = field(default_factory=dict)

    def motion(self, log: str) -> float:
        """Ripple of the rotor's own speed, rms, rad/s."""
        measured = sum(entry.share * entry.measured for entry in self.orders_of(log))
        return self.whole[log] * math.sqrt(max(0.0, 1 - measured))

    def noise(self, log: str) -> float:
        """Share of the logged speed's square that is steps and noise, not waves of the angle."""
        logged = self.logged.get(log, 0.0)
        return max(0.0, 1 - (self.whole[log] / logged) ** 2) if logged else 0.0

    def orders_of(self, log: str) -> list[OrderCauses]:
        return [entry for entry in self.orders if entry.log == log]

    def causes(self, log: str) -> dict[str, float]:
        """Share of each cause in the square of a log's ripple, the largest first.

        A cause that opposes an order's ripple counts as 0; the other causes share the order's ripple.
        """
        shares: dict[str, float] = defaultdict(float)
        for entry in self.orders_of(log):
            adds = sum(max(0.0, cause.share) for cause in entry.causes)
            for cause in entry.causes:
                if cause.share > 0:
                    shares[cause.name] += entry.share * cause.share / adds
        shares[NO_ORDER] = max(0.0, 1 - sum(entry.share for entry in self.orders_of(log)))
        return dict(sorted(shares.items(), key=lambda item: -item[1]))


def diagnosed(logs: Sequence[Path], columns: Path, progress: Progress) -> Diagnosis:
    """Diagnose logs. StudyError: a mistake in a file, or no log with a steady speed."""
    if not columns.is_file():
        raise StudyError(f"{columns}: no such file: expected a TOML file that names the columns")
    identification = config.load(columns)
    progress("reading", 0.0)
    loaded = load_logs(list(logs), identification)
    whole = [
        log for log in loaded if log.kind == "bridge-off" or ("theta" in log and ("i_q" in log or not log.dt))
    ]
    remarks: list[str] = []
    estimate = None
    if any(log.dt and log.kind != "bridge-off" for log in whole):
        try:
            estimate = _with_sure_error(estimate_motor(identification, whole, progress))
            remarks += [*estimate.left_out, *estimate.remarks]
        except StudyError as error:
            remarks += error.mistakes
    poles = identification.motor.pole_pairs
    explained, own = _explained(estimate, loaded), own_orders(poles, identification.motor.slots)
    angles = {log.name for log in loaded if "theta" in log}
    misread = _error(estimate)
    parts = [part for log in explained.values() for part in steady(log, identification.step, own, misread)]
    orders = attributed(estimate, parts) if estimate is not None and parts else []
    others = [
        part
        for log in map(with_angle, loaded)
        if log.dt and log.name not in explained and "theta" in log
        for part in steady(log, identification.step if log.name in angles else 0.0, own)
    ]
    alone = speed_alone.by_order(others, poles)
    remarks += _without(loaded) + speed_alone.sentences(alone)
    every = [*parts, *others]
    uses = _uses(loaded, {part.log.name for part in every}, set(explained))
    if not every:
        none = Advice(
            "no log turns at a steady speed for a revolution; record one that does",
            logs_of_kind("constant-speed"),
        )
        raise AdvisedError(*remarks, *(f"{name}: {use}" for name, use in uses.items()), none)
    if parts and not any("i_q_ref" in part.log for part in parts):
        remarks.append(
            Advice(
                f"Dead time disturbs the current at order {6 * poles}, and cannot be told apart from the "
                "current that the law asks for; record the current's reference as i_q_ref.",
                recording(signal="i_q_ref"),
            )
        )
    ripples = _rms_by_log(every, lambda part: part.ripple)
    merged = tuple(_merged([*orders, *alone], ripples, Counter(part.log.name for part in every)))
    remarks += _of_one_speed(merged, every) + _of_loads(merged) + _opposed(merged) + _out_of_sight(every)
    measured = [part for part in every if part.log.name in angles and "omega" in part.log]
    logged = _rms_by_log(measured, lambda part: part.logged_ripple)
    return Diagnosis(
        title=identification.title,
        orders=merged,
        whole=ripples,
        remarks=tuple(dict.fromkeys(remarks)),
        logged=logged,
        uses=uses,
    )


def own_orders(poles: int, slots: int | None) -> tuple[int, ...]:
    """Orders that a motor has by itself: 2, 6 and 12 times the pole pairs, slots, and lcm(slots, poles)."""
    by_slots = () if slots is None else (slots, math.lcm(slots, 2 * poles))
    return tuple(sorted({2 * poles, 6 * poles, 12 * poles, *by_slots}))


def _explained(estimate: Estimate | None, loaded: Sequence[Log]) -> dict[str, Log]:
    """Logs whose torques are known from the estimate, by name.

    With the bridge off, the torque that turns the rotor from outside is not known.
    """
    if estimate is None or estimate.fit is None or "j" not in estimate.values:
        return {}
    off = [
        prepared(estimate.identification, log, None)
        for log in loaded
        if log.kind == "bridge-off" and "theta" in log
    ]
    return {log.name: _without_error(log, estimate) for log in (*estimate.logs, *off) if log.dt}


def _with_sure_error(estimate: Estimate) -> Estimate:
    """The estimate with only those orders of the sensor's error that are larger than their own error."""
    sure = {wave.order for wave in estimate.encoder if wave.size.value > wave.size.error}
    error = {order: wave for order, wave in estimate.model.error.items() if order in sure}
    return replace(estimate, model=replace(estimate.model, error=error))


def _without_error(log: Log, estimate: Estimate) -> Log:
    """The log with the angle corrected for the estimate's sensor error."""
    return replace(log, signals={**log.signals, "theta": corrected(log["theta"], estimate.model)})


def _error(estimate: Estimate | None) -> dict[int, complex]:
    """The estimate's sensor error by order n, E, rad: Re(E exp(j n theta))."""
    return {} if estimate is None else {n: complex(c, -s) for n, (c, s) in estimate.model.error.items()}


def _without(logs: Sequence[Log]) -> list[str]:
    """Sentences on logs without angle or current: what they cannot show, and what to record."""
    remarks: list[str] = []
    for log in logs:
        if "theta" not in log and "omega" in log:
            remarks.append(
                Advice(
                    f"{log.name}: no angle: the angle is the speed's integral, so the phase of an order on "
                    "the rotor is unknown; record the encoder's angle as theta.",
                    recording(signal="theta", log=log.name),
                )
            )
        if "i_q" not in log and log.kind not in ("coast-down", "bridge-off"):
            remarks.append(
                Advice(
                    f"{log.name}: no current: the log shows how an order changes with the speed, but "
                    "not which cause the order has; record i_q.",
                    recording(signal="i_q", log=log.name),
                )
            )
    return remarks


def _uses(logs: Sequence[Log], steady_logs: set[str], explained: set[str]) -> dict[str, str]:
    """The use of each log without a steady part, or the reason why it is not used."""
    uses = {}
    for log in logs:
        if log.name in steady_logs:
            continue
        if log.kind == "bridge-off":
            uses[log.name] = (
                "the bridge is off, so the log is used only for the offsets of the phase currents"
            )
        elif not log.dt:
            uses[log.name] = "the rotor is held, so the log is used for the cogging"
        elif log.name in explained:
            uses[log.name] = (
                "the log has no turn at a steady speed, so it is used for inertia, friction and "
                "orders, not for shares"
            )
        else:
            uses[log.name] = "the log is not used: it has neither a turn at a steady speed nor known torques"
    return uses


def _possible_causes(orders: Sequence[OrderCauses]) -> dict[int, set[str]]:
    """The possible causes of each large order, by rising order."""
    large = sorted((entry for entry in orders if entry.share > LARGE_SHARE), key=lambda entry: entry.order)
    return {entry.order: set(entry.causes[0].name.split(OR)) for entry in large}


def _of_one_speed(orders: Sequence[OrderCauses], parts: Sequence[Steady]) -> list[str]:
    """A sentence on orders that are an error of the angle or a torque; one speed can't distinguish them."""
    speeds = [abs(part.speed) for part in parts]
    possible = _possible_causes(orders).items()
    either = [order for order, causes in possible if ENCODER in causes and len(causes) > 1]
    if not either or max(speeds) >= SPEED_RATIO_LEAST * min(speeds):
        return []
    return [
        Advice(
            f"{_named(either)}: from one speed, an error of the angle cannot be told apart from a torque. "
            "The error is the same at every speed; the motion that a torque makes falls with the speed "
            "squared. Record a second speed, and an acceleration log, which gives the inertia.",
            logs_of_kind("constant-speed", "acceleration"),
        )
    ]


def _of_loads(orders: Sequence[OrderCauses]) -> list[Advice]:
    """Advice on logs that separate cogging from K_t ripple, for large orders that may be either."""
    possible = _possible_causes(orders).items()
    return [not_told_apart("ripple", order) for order, causes in possible if {COGGING, RIPPLE} <= causes]


def _out_of_sight(parts: Sequence[Steady]) -> list[str]:
    """Sentences on the highest order that each log can show, and the motor's own orders above it."""
    remarks: list[str] = []
    for name in dict.fromkeys(part.log.name for part in parts):
        part = min((part for part in parts if part.log.name == name), key=lambda part: part.waves.half_rate)
        waves, speed = part.waves, abs(part.speed) / TURN
        by_rows = [n for n in part.own_orders if n > waves.half_rate]
        by_noise = [n for n in part.own_orders if n in waves.hidden and n not in waves.amplitude]
        sight = f"{name}: its rows show orders up to {math.floor(waves.half_rate)} at {speed:.3g} rev/s"
        if by_rows:
            rate = ROWS_A_WAVE * max(by_rows) * speed
            remarks.append(
                Advice(
                    f"{sight}. {_named(by_rows)} of this motor cannot be seen: its wave is shorter than two "
                    f"rows, so it may appear as another order; record {rate:.3g} rows a second, or turn more "
                    "slowly.",
                    recording(rate=rate),
                    recording(speed=abs(part.speed) / (part.log.dt * rate)),
                )
            )
        else:
            remarks.append(Agreement(f"{sight}."))
        if by_noise:
            remarks.append(
                f"{name}: {_named(by_noise)} of this motor cannot be seen where it is a tenth of the ripple "
                "or less: "
                "noise and steps of the angle hide it."
            )
    return remarks


def _named(orders: Sequence[int]) -> str:
    return f"Order {', '.join(map(str, orders))}"


def _opposed(orders: Sequence[OrderCauses]) -> list[str]:
    """Sentences on orders in which causes cancel, so that one cause has a share above 1."""
    remarks = []
    for entry in orders:
        against = [cause for cause in entry.causes if cause.share < -CANCELLED_SHARE]
        if entry.share >= LINE_SHARE_LEAST and entry.causes[0].share > 1 + CANCELLED_SHARE and against:
            remarks.append(
                f"Order {entry.order} in {entry.log}: {entry.causes[0].name} and {against[-1].name} oppose "
                "each other. Shares are of the ripple that is left, their difference, so one is above 100 %, "
                "and one below 0."
            )
    return remarks


def _rms_by_log(parts: Sequence[Steady], ripple: Callable[[Steady], float]) -> dict[str, float]:
    """Ripple of each log, rad/s: the rms over its parts."""
    squares = defaultdict(list)
    for part in parts:
        squares[part.log.name].append(ripple(part) ** 2)
    return {name: float(np.sqrt(np.mean(own))) for name, own in squares.items()}


def _merged(
    orders: Sequence[OrderCauses], ripples: Mapping[str, float], parts: Mapping[str, int]
) -> list[OrderCauses]:
    """The orders of a log's parts, such as both directions, merged.

    `ripples`: rms ripple of all parts of a log, rad/s. `parts`: the number of parts of a log.
    """
    groups: dict[tuple[str, int], list[OrderCauses]] = defaultdict(list)
    for entry in orders:
        groups[entry.log, entry.order].append(entry)
    merged = []
    for own in groups.values():
        weights = np.array([entry.ripple**2 for entry in own])
        names = dict.fromkeys(cause.name for entry in own for cause in entry.causes)

        def mean(values: Sequence[float], by: np.ndarray = weights) -> float:
            return float(np.average(values, weights=by))

        causes = []
        for name in names:
            has = [next((c for c in entry.causes if c.name == name), Cause(name, 0.0, 0.0)) for entry in own]
            causes.append(Cause(name, mean([c.share for c in has]), mean([c.error for c in has])))
        causes.sort(key=lambda cause: -cause.share)
        log = own[0].log
        ripple = math.sqrt(float(np.sum(weights)) / parts[log])
        merged.append(
            replace(
                own[0],
                ripple=ripple,
                share=(ripple / ripples[log]) ** 2,
                causes=tuple(causes),
                measured=mean([entry.measured for entry in own]),
            )
        )
    return sorted(merged, key=lambda entry: (entry.log, -entry.share))


def answer(diagnosis: Diagnosis) -> str:
    """A sentence with the main cause, by the ripple's square over all logs, and its share in each log."""
    logs = list(diagnosis.whole)
    totals: dict[str, dict[str, float]] = defaultdict(dict)
    for log in logs:
        for name, share in diagnosis.causes(log).items():
            totals[name][log] = share
    name, by_log = max(
        totals.items(), key=lambda item: sum(x * diagnosis.whole[log] ** 2 for log, x in item[1].items())
    )
    shares = list(by_log.values())
    if name == NO_ORDER:
        return (
            f"Most of the ripple belongs to {NO_ORDER} of the rotor that these logs can show, so it is "
            "vibration, or slow changes of the speed."
        )
    low, high = 100 * min(shares), 100 * max(shares)
    span = f"{low:.0f} to {high:.0f} %" if high - low > 1 else f"{high:.0f} %"
    where = "1 log" if len(logs) == 1 else f"{len(shares)} of {len(logs)} logs"
    verdict = ", which cannot be told apart here" if OR in name else ""
    if name == BEYOND:
        verdict = ", so the logs show it as a slower wave"
    return f"Most of the ripple is {name}{verdict}: {span} of the ripple's square in {where}."


def answer_lines(diagnosis: Diagnosis) -> list[str]:
    """The answer, a line for each log, and one for each order that matters."""
    text = [answer(diagnosis), ""]
    for log in diagnosis.whole:
        own = diagnosis.orders_of(log)
        shares = ", ".join(
            f"{name} {100 * share:.0f} %"
            for name, share in diagnosis.causes(log).items()
            if share > LINE_SHARE_LEAST
        )
        at = f"{own[0].speed / TURN:.3g} rev/s" if own else "steady"
        load = f", {own[0].load:.3g} A" if own and not math.isnan(own[0].load) else ""
        text.append(f"{log} ({at}{load}): {sizes(diagnosis, log)}: {shares}")
    text += [f"{log}: {use}" for log, use in diagnosis.uses.items()]
    text += [
        "",
        f"{'log':<20} {'order':>5} {'rad/s rms':>10} {'of all':>7}  cause (share of the order), confidence",
    ]
    for entry in diagnosis.orders:
        if entry.share < LINE_SHARE_LEAST:
            continue
        causes = ", ".join(cause_text(cause) for cause in entry.causes if abs(cause.share) > 0.05)
        text.append(
            f"{entry.log:<20} {entry.order:>5} {entry.ripple:>10.3g} {100 * entry.share:>5.0f} %  {causes}: "
            f"{entry.confidence}"
        )
    return text


def sizes(diagnosis: Diagnosis, log: str) -> str:
    """The ripple of a log, and the part of it that is measurement, not motion."""
    size, motion, noise = diagnosis.whole[log], diagnosis.motion(log), diagnosis.noise(log)
    says = [f"{size:.3g} rad/s rms"]
    if motion < (1 - LINE_SHARE_LEAST) * size:
        says.append(f"of this the rotor's motion is {motion:.3g}, the rest is the encoder's error")
    if noise > LINE_SHARE_LEAST:
        says.append(
            f"the logged speed ripples by {diagnosis.logged[log]:.3g} rad/s rms; {100 * noise:.0f} % of its "
            "square come from steps and noise of the measurement"
        )
    return ", ".join(says)


def cause_text(cause: Cause) -> str:
    """A cause with its share and error at 95 %."""
    error = f" +- {100 * cause.error:.0f}" if cause.error else ""
    return f"{cause.name} {100 * cause.share:.0f}{error} %"


def to_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """The answer, the causes of each log, the orders, and every sentence. Ripple in rad/s rms, loads in A."""
    return {
        "answer": answer(diagnosis),
        "logs": {
            log: {
                "ripple_rad_per_s": whole,
                "motion_rad_per_s": diagnosis.motion(log),
                "noise_share_of_logged_speed": diagnosis.noise(log) if log in diagnosis.logged else None,
                "shares": diagnosis.causes(log),
            }
            for log, whole in diagnosis.whole.items()
        },
        "uses": dict(diagnosis.uses),
        "orders": [
            {
                "log": entry.log,
                "speed_rad_per_s": entry.speed,
                "load_A": None if math.isnan(entry.load) else entry.load,
                "order": entry.order,
                "ripple_rad_per_s": entry.ripple,
                "share": entry.share,
                "confidence": entry.confidence,
                "causes": [
                    {"name": cause.name, "share": cause.share, "error": cause.error} for cause in entry.causes
                ],
            }
            for entry in diagnosis.orders
        ],
        "said": list(diagnosis.remarks),
    }
