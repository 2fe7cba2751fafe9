"""From logs to a motor: orders, joint fit, what can't be told apart left out, errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cogless.errors import StudyError
from cogless.identify import findings
from cogless.identify.config import Identification
from cogless.identify.files import Array
from cogless.identify.log import Log
from cogless.identify.orders import found_orders
from cogless.identify.regression import Fit, fit
from cogless.identify.weak_form import Model, Rows, Sensor, rows_of

WIDTH = 6e-3  # s, of the kernel
OTHERS = (0.75, 1.35)  # times that: how far the values move is a part of their errors
LARGEST_INFLATION = 100.0  # of a variance by the other columns
SURE = 5.0  # standard errors from which on an order is one
SMALLEST = 1e-3  # of the largest order, likewise
ROUNDS = 3  # delay and the sensor's error are taken out, and found again
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Value:
    """A number and its error at 95 %, SI."""

    value: float
    error: float

    def times(self, factor: float) -> Value:
        return Value(self.value * factor, self.error * abs(factor))


@dataclass(frozen=True)
class Wave:
    """size sin(order theta + phase), with errors at 95 %, SI."""

    order: int
    size: Value
    phase: Value


@dataclass(frozen=True, eq=False)
class Estimate:
    """What the logs tell. Torques are over K_t, in A; `ripple` is a share of K_t.

    A value that can't be told is not in `values`; `left_out` has a sentence on each.
    """

    known: Identification
    logs: tuple[Log, ...]
    values: dict[str, Value]
    cogging: tuple[Wave, ...]
    ripple: tuple[Wave, ...]
    encoder: tuple[Wave, ...]
    loads: dict[str, Value]
    remarks: tuple[str, ...]
    left_out: tuple[str, ...]
    model: Model = field(repr=False, default=Model())
    rows: tuple[Rows, ...] = field(repr=False, default=())
    fit: Fit | None = field(repr=False, default=None)

    @property
    def K_t(self) -> float:
        """Torque constant that is taken as known, N*m/A."""
        return self.known.motor.star().K_t


def estimate(known: Identification, logs: Sequence[Log], progress: Progress) -> Estimate:
    """Estimate all that the logs tell. StudyError: nothing can be told."""
    remarks = [remark for log in logs for remark in log.remarks]
    used, said = findings.usable(known, logs)
    remarks += said
    if not used:
        raise StudyError("\n".join(said) or "no log is left: expected logs with theta and i_q")
    findings.check_sign(known, used, _rows(known, used, Model(), WIDTH))
    left: list[str] = []
    model = _start(known, used, left)
    rows, found, model = _searched(known, used, model, progress)
    rows, found, model = _significant(known, used, model)
    rows, found, model = _told_apart(known, used, model, left)
    progress("errors", 0.0)
    remarks += findings.between_logs(rows, found, model, left)
    return _told(known, used, model, rows, found, remarks, left)


def _rows(known: Identification, logs: Sequence[Log], model: Model, width: float) -> list[Rows]:
    sensor = Sensor(known.step, known.motor.pole_pairs)
    return [rows for log in logs for rows in rows_of(log, model, width, sensor)]


def _start(known: Identification, logs: Sequence[Log], left: list[str]) -> Model:
    """The columns that the kinds of logs allow to ask for."""
    moving = [log for log in logs if log.dt]
    columns = {"offset"}
    if not moving:
        left.append("No log of a turning motor: inertia and friction cannot be identified; add an acceleration log.")
        return Model(columns=frozenset(columns))
    columns |= {"c"}
    speeds = findings.speeds(moving)
    if findings.one_speed(speeds):
        left.append(
            f"One speed only ({speeds[0][1] / (2 * np.pi):.3g} rev/s): inertia, viscous friction and delay cannot be "
            "identified; add an acceleration log and a second speed."
        )
    else:
        columns |= {"j", "b", "delay"}
    fed_back = [log for log in moving if findings.feedback(log) is not None]
    if fed_back and len(fed_back) == len(moving):
        columns -= {"delay"}
        left.append(
            "All logs of a turning motor show the feedback law: the delay cannot be identified; add an acceleration log."
        )
    poles = known.motor.pole_pairs
    encoder = (1, 2) if "j" in columns else ()
    return Model(cogging=(6 * poles,), encoder=encoder, columns=frozenset(columns))


def _searched(
    known: Identification, logs: Sequence[Log], model: Model, progress: Progress
) -> tuple[list[Rows], Fit, Model]:
    """Add the orders that the residual has, the strongest first."""
    while True:
        progress(f"orders: {len(model.cogging)}", 0.0)
        rows = _rows(known, logs, model, WIDTH)
        found = fit(rows)
        new = found_orders(rows, found, WIDTH, model.cogging)
        if not new or len(model.cogging) > 40:
            break
        model = replace(model, cogging=tuple(sorted({*model.cogging, *new})))
    poles = known.motor.pole_pairs
    if any(log.kind == "load" for log in logs):
        ripple = (2 * poles, 6 * poles)
        model = replace(model, ripple=ripple, cogging=tuple(sorted({*model.cogging, *ripple})))
    return _settled(known, logs, model)


def _settled(known: Identification, logs: Sequence[Log], model: Model) -> tuple[list[Rows], Fit, Model]:
    """Fit, take delay and the sensor's error out, and fit again."""
    for _ in range(ROUNDS):
        rows = _rows(known, logs, model, WIDTH)
        found = fit(rows)
        if ("delay",) in found:
            model = replace(model, delay=model.delay + found["delay",])
        if model.encoder and ("j",) in found and found["j",] > 0:
            error = dict(model.error)
            for order in model.encoder:
                c, s = error.get(order, (0.0, 0.0))
                error[order] = (
                    c + found["encoder", order, "c"] / found["j",],
                    s + found["encoder", order, "s"] / found["j",],
                )
            model = replace(model, error=error)
    rows = _rows(known, logs, model, WIDTH)
    return rows, fit(rows), model


def refit(known: Identification, logs: Sequence[Log], model: Model) -> tuple[Fit, Model]:
    """The same fit of other logs: its coefficients, and the model with the delay and errors taken out."""
    _, found, settled = _settled(known, logs, model)
    return found, settled


def _significant(
    known: Identification, logs: Sequence[Log], model: Model
) -> tuple[list[Rows], Fit, Model]:
    """Keep the orders that stand out of their errors."""
    rows = _rows(known, logs, model, WIDTH)
    found = fit(rows)

    def stands_out(kind: str, order: int, taken: tuple[float, float] = (0.0, 0.0)) -> bool:
        names = ((kind, order, "c"), (kind, order, "s"))
        size = np.hypot(*(found[name] + out for name, out in zip(names, taken, strict=True)))
        return bool(size > SURE * np.hypot(*(found.error(name) for name in names)))

    largest = max((np.hypot(found["cogging", n, "c"], found["cogging", n, "s"]) for n in model.cogging), default=0.0)
    kept = {
        n
        for n in model.cogging
        if stands_out("cogging", n)
        and np.hypot(found["cogging", n, "c"], found["cogging", n, "s"]) > SMALLEST * largest
    }
    ripple = tuple(n for n in model.ripple if stands_out("ripple", n))
    j = found["j",] if ("j",) in found else 0.0
    encoder = tuple(
        n
        for n in model.encoder
        if stands_out("encoder", n, (j * model.error.get(n, (0, 0))[0], j * model.error.get(n, (0, 0))[1]))
    )
    error = {n: pair for n, pair in model.error.items() if n in encoder}
    pruned = replace(
        model, cogging=tuple(sorted(kept | set(ripple))), ripple=ripple, encoder=encoder, error=error
    )
    return _settled(known, logs, pruned)


CURES = {
    "j": "Inertia cannot be told apart from cogging or friction; add an acceleration log.",
    "b": "Viscous and Coulomb friction cannot be told apart; add a log at a second, fast speed.",
    "c": "Friction and a load cannot be told apart; record each log in both directions.",
    "offset": "An offset of the current cannot be told apart from friction; record each log in both directions.",
    "delay": "The delay of the log cannot be told apart from inertia; add an acceleration log.",
    "load": "The load of {0} cannot be told apart from friction; record it in both directions.",
    "ripple": "Order {0}: K_t ripple and cogging cannot be told apart; record logs with loads of both signs.",
    "encoder": "Order {0}: the encoder's error and cogging cannot be told apart; add a log at a second, fast speed.",
    "cogging": "Order {0}: cogging cannot be told apart from the rest; add a slow sweep.",
}
WEAKEST = ("delay", "encoder", "ripple", "offset", "b", "cogging", "load", "c", "c_hold", "j")


def _told_apart(
    known: Identification, logs: Sequence[Log], model: Model, left: list[str]
) -> tuple[list[Rows], Fit, Model]:
    """Leave out what can't be told apart, one after the other, the least important first."""
    while True:
        rows = _rows(known, logs, model, WIDTH)
        found = fit(rows)
        wide = [name for name, by in zip(found.names, found.inflation, strict=True) if by > LARGEST_INFLATION]
        wide = [name for name in wide if str(name[0]) in CURES and name[0] != "load"]
        if not wide:
            return rows, found, model
        worst = min(wide, key=lambda name: WEAKEST.index(str(name[0])))
        if str(worst[0]) not in ("offset",):
            left.append(CURES[str(worst[0])].format(*worst[1:]))
        model = _without(model, worst)


def _without(model: Model, name: tuple[str | int, ...]) -> Model:
    kind = str(name[0])
    if kind in ("cogging", "ripple", "encoder"):
        kept = tuple(n for n in getattr(model, kind) if n != name[1])
        error = {n: pair for n, pair in model.error.items() if kind != "encoder" or n != name[1]}
        return replace(model, error=error, **{kind: kept})
    delay = 0.0 if kind == "delay" else model.delay
    return replace(model, columns=model.columns - {kind}, delay=delay)


def _told(
    known: Identification,
    logs: Sequence[Log],
    model: Model,
    rows: Sequence[Rows],
    found: Fit,
    remarks: Sequence[str],
    left: list[str],
) -> Estimate:
    spread = _spread(known, logs, model, found)

    def value(name: tuple[str | int, ...], plus: float = 0.0) -> Value:
        place = found.names.index(name)
        error = 2 * float(np.hypot(found.errors[place], spread[place]))
        return Value(found[name] + plus, error)

    values = {str(name[0]): value(name) for name in found.names if len(name) == 1}
    if "delay" in values:
        values["delay"] = value(("delay",), model.delay)
    cogging = [wave_of(n, value(("cogging", n, "c")), value(("cogging", n, "s"))) for n in model.cogging]
    ripple = [wave_of(n, value(("ripple", n, "c")), value(("ripple", n, "s"))) for n in model.ripple]
    encoder = []
    if model.encoder and "j" in values:
        j = values["j"].value
        for n in model.encoder:
            c, s = (value(("encoder", n, part)).times(1 / j) for part in "cs")
            out = model.error.get(n, (0.0, 0.0))
            encoder.append(wave_of(n, Value(c.value + out[0], c.error), Value(s.value + out[1], s.error)))
    loads = {str(name[1]): value(name) for name in found.names if name[0] == "load"}
    made = Estimate(
        known,
        tuple(logs),
        values,
        tuple(cogging),
        tuple(ripple),
        tuple(encoder),
        loads,
        tuple(remarks),
        (),
        model,
        tuple(rows),
        found,
    )
    return findings.without_nonsense(made, left)


def _spread(known: Identification, logs: Sequence[Log], model: Model, found: Fit) -> Array:
    """How far each coefficient moves with the width of the kernel, as a standard error."""
    moved = []
    for factor in OTHERS:
        other = fit(_rows(known, logs, model, factor * WIDTH))
        moved.append([other[name] - found[name] if name in other else 0.0 for name in found.names])
    return np.asarray(np.sqrt(np.mean(np.square(moved), axis=0)))


def wave_of(order: int, cosine: Value, sine: Value) -> Wave:
    """The wave of a cosine and a sine part."""
    size = float(np.hypot(cosine.value, sine.value))
    along = np.hypot(cosine.value * cosine.error, sine.value * sine.error) / max(size, 1e-300)
    across = np.hypot(sine.value * cosine.error, cosine.value * sine.error) / max(size, 1e-300)
    phase = float(np.arctan2(cosine.value, sine.value))
    return Wave(order, Value(size, float(along)), Value(phase, float(across) / max(size, 1e-300)))
