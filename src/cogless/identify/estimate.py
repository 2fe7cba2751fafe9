"""From logs to a motor: orders, joint fit, what can't be told apart left out, errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from cogless.identify import findings, voltage
from cogless.identify.advice import Advice, AdvisedError, logs_of_kind
from cogless.identify.config import Identification
from cogless.identify.log import Log
from cogless.identify.orders import found_orders
from cogless.identify.regression import LARGEST_INFLATION, Fit, fit
from cogless.identify.result import Estimate, Value, Wave, wave_of
from cogless.identify.weak_form import WIDTH, Model, Name, Rows, Sensor, rows_of, width_of

OTHERS = (0.75, 1.35)  # times the kernel's width: how far the values move is a part of their errors
SETTLED = 0.1  # standard errors that may be left of what is taken out
SURE = 5.0  # standard errors from which on an order is one
SMALLEST = 1e-3  # of the largest order, likewise
MOST_ORDERS = 40
BESIDE = 2  # orders on each side of one that an error of the encoder spreads it over
LONGEST_DELAY, EARLIEST = 5e-3, -2e-3  # s; i_q before the angle: that of a filtered angle
ROUNDS = 5  # delay and the sensor's error are taken out, and found again
SEARCHES = 5  # at most
NO_LOG = "no log is left: expected logs with theta and i_q"
Progress = Callable[[str, float], None]
State = tuple[list[Rows], Fit, Model]


def estimate(known: Identification, logs: Sequence[Log], progress: Progress) -> Estimate:
    """Estimate all that the logs tell. StudyError: nothing can be told."""
    remarks = [remark for log in logs for remark in log.remarks]
    used, said = findings.usable(known, logs)
    remarks += said
    if not used:
        none = [] if any(log.kind != "bridge-off" for log in logs) else [NO_LOG]
        raise AdvisedError(*said, *none)
    findings.check_sign(known, used, _rows(known, used, Model()))
    left: list[str] = []
    try:
        used, model = _start(known, used, left)
    except AdvisedError as error:
        out = tuple(f"{log.name}: " for log in logs if log.name not in {one.name for one in used})
        causes = [line for line in said if line.startswith(out)]  # before what follows from them
        others = [line for line in said if line not in causes]
        raise AdvisedError(*causes, *error.lines, *others) from None
    state = _searched_again(known, used, model, progress)
    rows, found, model = _told_apart(known, used, *_likely_delay(known, used, *state, left), left)
    progress("errors", 0.0)
    remarks += voltage.check(known, used)
    remarks += findings.between_logs(rows, found, model, left)
    return _told(known, used, model, rows, found, remarks, left, findings.offsets_of(logs))


def _rows(known: Identification, logs: Sequence[Log], model: Model, factor: float = 1.0) -> list[Rows]:
    sensor = Sensor(known.step, known.motor.pole_pairs)
    return [rows for log in logs for rows in rows_of(log, model, factor * model.width, sensor)]


def _start(known: Identification, logs: Sequence[Log], left: list[str]) -> tuple[list[Log], Model]:
    """The logs and columns that tell something together."""
    held, moving = [log for log in logs if not log.dt], [log for log in logs if log.dt]
    sixth = (6 * known.motor.pole_pairs,)
    if not moving:
        left.append(
            Advice(
                "No log of a turning motor: inertia and friction cannot be identified; add an acceleration "
                "log.",
                logs_of_kind("acceleration"),
            )
        )
    elif findings.one_speed(moving):
        left.append(findings.said_of_one_speed(moving))
        if not held:
            raise AdvisedError(left[-1])
    else:
        columns = {"j", "b", "c", "offset", "delay"}
        if all(findings.feedback(log) is not None for log in moving):
            columns -= {"delay"}
            left.append(
                Advice(
                    "All logs of a turning motor show the feedback law: the delay cannot be identified; "
                    "add an acceleration log.",
                    logs_of_kind("acceleration"),
                )
            )
        model = Model(
            sixth, encoder=(1, 2), columns=frozenset(columns), width=findings.kernel_width(known, logs)
        )
        return list(logs), model if model.width == WIDTH else _scanned(known, moving, model)
    return held, Model(cogging=sixth, columns=frozenset({"offset"}))


def _scanned(known: Identification, logs: Sequence[Log], model: Model) -> Model:
    """The model with the delay and the encoder's error with which the slowest log fits best.

    A delay beyond a narrow kernel cannot be found step by step; nor can orders of the poles, before the
    encoder's error is known, or it without them. The orders beside these show all that it does to them.
    """
    log = min(logs, key=lambda log: (log.kind == "load", findings.speed(log)))
    poles = tuple(known.motor.pole_pairs * n for n in (2, 4, 6))
    beside = tuple(n + k for n in poles for k in range(-BESIDE, BESIDE + 1))
    alone = replace(model, cogging=beside, columns=frozenset({"j", "c", "offset"}), encoder=())
    delays = np.arange(EARLIEST, LONGEST_DELAY, width_of(log, model.width))
    found = [(delay, fit(_rows(known, [log], replace(alone, delay=float(delay))))) for delay in delays]
    delay, best = min(found, key=lambda each: each[1].noise[log.name])
    start = _taken_out(replace(alone, cogging=poles, delay=float(delay)), best)
    start, _ = settled(known, [log], replace(start, encoder=(1,), columns=alone.columns | {"delay"}))
    return replace(start, columns=model.columns, encoder=model.encoder)


def _searched_again(known: Identification, logs: Sequence[Log], model: Model, progress: Progress) -> State:
    """Search from the orders that stand out of the search before, until these are the same again.

    A false order that is found early may hide a true one, or take its place.
    """
    states: dict[tuple[int, ...], State] = {}
    for _ in range(SEARCHES):
        state = _significant(known, logs, *_searched(known, logs, model, progress))
        kept = state[2].cogging
        if not kept or kept in states:
            return states.get(kept, state)
        states[kept] = state
        model = replace(model, cogging=kept)
    return state


def _searched(known: Identification, logs: Sequence[Log], model: Model, progress: Progress) -> State:
    """Add the orders that the residual has, the strongest first; then look for delay and encoder's error.

    Delay and encoder's error come last: before, they would take the place of orders not found yet.
    """
    sought = replace(model, encoder=(), columns=model.columns - {"delay"})
    while True:
        progress(f"orders: {len(sought.cogging)}", 0.0)
        rows = _rows(known, logs, sought)
        found = fit(rows)
        new = found_orders(rows, found, sought.width, sought.cogging)
        if not new or len(sought.cogging) > MOST_ORDERS:
            break
        sought = replace(sought, cogging=tuple(sorted({*sought.cogging, *new})))
    model = replace(model, cogging=sought.cogging)
    poles = known.motor.pole_pairs
    if "j" in model.columns:  # the currents that accelerate are loads of both signs
        ripple = (2 * poles, 6 * poles)
        model = replace(model, ripple=ripple, cogging=tuple(sorted({*model.cogging, *ripple})))
        electrical = _electrical_errors(known, logs, model)
        if electrical:
            model = replace(model, encoder=tuple(sorted({*model.encoder, *electrical})))
    return _without_sidebands(known, logs, model, found)


def _electrical_errors(known: Identification, logs: Sequence[Log], model: Model) -> list[int]:
    """The orders of p and 2 p in which the angle has an error, as with a resolver or a magnet near the motor.

    An order has a column only if its error stands out of a fit that also has the torques of these orders.
    """
    orders = [n for n in (known.motor.pole_pairs, 2 * known.motor.pole_pairs) if n not in model.encoder]
    torques = tuple(sorted({*model.cogging, *orders}))
    sought = replace(model, cogging=torques, encoder=tuple(orders), columns=model.columns - {"delay"})
    found = fit(_rows(known, logs, sought))
    return [n for n in orders if found.get("j") > 0 and _stands_out(found, "encoder", n)]


def _without_sidebands(known: Identification, logs: Sequence[Log], model: Model, found: Fit) -> State:
    """Fit without orders that an encoder's error makes of larger ones, where there is such an error.

    An error of order k turns cogging of order n into n - k and n + k, too. One error says more with less than
    orders beside all others; those that it doesn't explain come back. `found`: a fit with all orders.
    Small ones may lead the fit astray before the error is known: then it is sought with the large ones first.
    """
    sizes = {n: _size(found, "cogging", n) for n in model.cogging if ("cogging", n, "c") in found}
    beside = {
        n
        for n, size in sizes.items()
        for k in model.encoder
        if size < findings.SIDEBAND * max(sizes.get(n - k, 0.0), sizes.get(n + k, 0.0))
    }
    if not beside:
        return _settled(known, logs, model)
    others = tuple(n for n in model.cogging if n not in beside)
    rows, fewer, alone = _settled(known, logs, replace(model, cogging=others))
    if _runs_away(fewer, alone):
        largest = max(sizes[n] for n in beside)
        large = tuple(n for n in others if sizes.get(n, 0.0) >= largest)
        _, _, alone = _settled(known, logs, replace(model, cogging=large))
        rows, fewer, alone = _settled(known, logs, replace(alone, cogging=others))
    if not any(_errs(fewer, alone, k) for k in alone.encoder):
        return _settled(known, logs, model)
    back = found_orders(rows, fewer, alone.width, alone.cogging)
    if not back:
        return rows, fewer, alone
    return _settled(known, logs, replace(alone, cogging=tuple(sorted({*alone.cogging, *back}))))


def _errs(found: Fit, model: Model, order: int) -> bool:
    """Whether the sensor's error of an order stands out."""
    j = found.get("j")
    c, s = model.error.get(order, (0.0, 0.0))
    return _stands_out(found, "encoder", order, (j * c, j * s))


def _stands_out(found: Fit, kind: str, order: int, taken: tuple[float, float] = (0.0, 0.0)) -> bool:
    """Whether an order stands out of its error, with what is already taken out."""
    error = np.hypot(found.error((kind, order, "c")), found.error((kind, order, "s")))
    return bool(_size(found, kind, order, taken) > SURE * error)


def _settled(known: Identification, logs: Sequence[Log], model: Model) -> State:
    """Fit, take delay and the sensor's error out, and fit again, until little is left of them."""
    for _ in range(ROUNDS):
        rows = _rows(known, logs, model)
        found = fit(rows)
        left = [name for name in found.names if name[0] in ("delay", "encoder")]
        if all(abs(found[name]) < SETTLED * found.error(name) for name in left):
            break
        if _runs_away(found, model):
            break
        model = _taken_out(model, found)
    else:
        rows = _rows(known, logs, model)
        found = fit(rows)
    return rows, found, model


def _runs_away(found: Fit, model: Model) -> bool:
    """Whether the delay is one that no log has."""
    return not EARLIEST < model.delay + found.get("delay") < LONGEST_DELAY


def _taken_out(model: Model, found: Fit) -> Model:
    """The model with the delay and the sensor's error that are left taken out."""
    error = dict(model.error)
    j = found.get("j")
    for order in model.encoder if j > 0 else ():
        c, s = error.get(order, (0.0, 0.0))
        error[order] = (c + found["encoder", order, "c"] / j, s + found["encoder", order, "s"] / j)
    waves = {n: (found["cogging", n, "c"], found["cogging", n, "s"]) for n in model.cogging if j > 0}
    return replace(model, delay=model.delay + found.get("delay"), error=error, waves=waves, j=j)


def settled(known: Identification, logs: Sequence[Log], model: Model) -> tuple[Model, Fit]:
    """The model with the delay and the sensor's error of these logs taken out, and its fit."""
    _, found, model = _settled(known, logs, model)
    return model, found


def at_delay(made: Estimate, delay: float) -> Estimate:
    """The estimate fitted again with a delay, s, that is known."""
    model = replace(made.model, delay=delay, columns=made.model.columns - {"delay"})
    rows, found, model = _settled(made.known, made.logs, model)
    return replace(made, rows=tuple(rows), fit=found, model=model)


def coefficients(
    known: Identification, logs: Sequence[Log], model: Model, factor: float = 1.0
) -> dict[Name, float]:
    """Each coefficient by a kernel of so many times the width; delay [s] and encoder's error [rad] whole."""
    return whole(model, fit(_rows(known, logs, model, factor)))


def whole(model: Model, found: Fit) -> dict[Name, float]:
    """Each coefficient of a fit; delay [s] and encoder's error [rad] with what is already taken out."""
    values = dict(zip(found.names, found.values.tolist(), strict=True))
    if ("delay",) in values:
        values["delay",] += model.delay
    for order in model.encoder:
        for part, out in zip("cs", model.error.get(order, (0.0, 0.0)), strict=True):
            name: Name = ("encoder", order, part)
            values[name] = out + values[name] / found["j",]
    return values


def _significant(
    known: Identification, logs: Sequence[Log], rows: list[Rows], found: Fit, model: Model
) -> State:
    """Keep the orders that stand out of their errors, and ripple that is tied to cogging.

    A sensor's error that the file tells is kept, too: else logs without it would be simulated with it.
    """
    largest = max((_size(found, "cogging", n) for n in model.cogging), default=0.0)
    kept = {n for n in model.cogging if _stands_out(found, "cogging", n)}
    kept = {n for n in kept if _size(found, "cogging", n) > SMALLEST * largest}
    tied = {
        n for n in model.ripple if found.inflation[found.names.index(("ripple", n, "c"))] > LARGEST_INFLATION
    }
    ripple = tuple(n for n in model.ripple if n in tied or _stands_out(found, "ripple", n))
    encoder = tuple(n for n in model.encoder if known.tells_error(n) or _errs(found, model, n))
    error = {n: pair for n, pair in model.error.items() if n in encoder}
    pruned = replace(
        model, cogging=tuple(sorted(kept | set(ripple))), ripple=ripple, encoder=encoder, error=error
    )
    return (rows, found, model) if pruned == model else _settled(known, logs, pruned)


def _size(found: Fit, kind: str, order: int, taken: tuple[float, float] = (0.0, 0.0)) -> float:
    """Amplitude of an order, A, with what is already taken out."""
    return float(np.hypot(found[kind, order, "c"] + taken[0], found[kind, order, "s"] + taken[1]))


CURES = {
    "j": "Inertia cannot be told apart from cogging or friction; add an acceleration log.",
    "b": "Viscous and Coulomb friction cannot be told apart; add a log at a second, fast speed, in both "
    "directions.",
    "c": "Friction and a load cannot be told apart; record each log in both directions.",
    "offset": "A current offset and friction cannot be told apart; record each log in both directions.",
    "delay": "The delay of the log cannot be told apart from inertia; add an acceleration log.",
    "ripple": "Order {0}: K_t ripple and cogging cannot be told apart; record logs with loads of both "
    "signs, and an acceleration log.",
    "encoder": "Order {0}: the encoder's error and cogging cannot be told apart; add a log at a fast speed, "
    "in both "
    "directions.",
    "cogging": "Order {0}: cogging cannot be told apart from the rest; add a slow sweep.",
}
CURE_LOGS = {  # kinds of log that tell a column apart
    **dict.fromkeys(("j", "delay"), ("acceleration",)),
    **dict.fromkeys(("b", "encoder"), ("constant-speed",)),
    **dict.fromkeys(("c", "offset", "cogging"), ("slow-sweep",)),
    "ripple": ("load", "acceleration"),
}
WEAKEST = ("delay", "encoder", "ripple", "offset", "b", "cogging", "load", "c", "c_hold", "j")


def _likely_delay(
    known: Identification, logs: Sequence[Log], rows: list[Rows], found: Fit, model: Model, left: list[str]
) -> State:
    """Leave the delay out where the logs hardly show it: nothing in them changes fast."""
    if ("delay",) not in found:
        return rows, found, model
    delay, error = model.delay + found["delay",], 2 * found.error(("delay",))
    if EARLIEST < delay < LONGEST_DELAY and error < LONGEST_DELAY:
        return rows, found, model
    left.append(
        Advice(
            f"The delay of the log comes out as {1e3 * delay:.2g} +- {1e3 * error:.2g} ms, which no drive "
            "has; it is left out; add an acceleration log that turns around sharply.",
            logs_of_kind("acceleration"),
        )
    )
    return _settled(known, logs, _left(model, "delay", ("delay",)))


def _told_apart(
    known: Identification, logs: Sequence[Log], rows: list[Rows], found: Fit, model: Model, left: list[str]
) -> State:
    """Leave out what can't be told apart, one after the other, the least important first."""
    current = np.concatenate([each.y for each in rows])
    if model.ripple and np.std(current) < abs(np.mean(current)):  # one load, in one direction
        for order in model.ripple:
            left.append(not_told_apart("ripple", order))
            model = _without(model, ("ripple", order))
        rows = _rows(known, logs, model)
        found = fit(rows)
    while True:
        wide = [name for name, by in zip(found.names, found.inflation, strict=True) if by > LARGEST_INFLATION]
        wide = [name for name in wide if str(name[0]) in CURES]
        if not wide:
            return rows, found, model
        worst = min(wide, key=lambda name: WEAKEST.index(str(name[0])))
        if worst[0] != "offset" or "c" in model.columns:
            left.append(not_told_apart(str(worst[0]), *worst[1:]))
        model = _without(model, worst)
        rows = _rows(known, logs, model)
        found = fit(rows)


def not_told_apart(kind: str, *of: str | int) -> Advice:
    """Advice which log to record if a column can't be distinguished from others; `of`: its order or log."""
    return Advice(CURES[kind].format(*of), logs_of_kind(*CURE_LOGS[kind]))


def _without(model: Model, name: Name) -> Model:
    """The model without a column; what takes its place in the fit is not told, either."""
    kind = str(name[0])
    others: set[tuple[str, int]] = set()
    if kind == "cogging":
        others = {("j", 0), *(("cogging", order) for order in model.cogging)}
    elif kind == "ripple":
        others = {("cogging", int(name[1]))}
    elif kind in ("b", "offset"):
        others = {("c", 0)}
    elif kind == "delay":
        others = {("j", 0)}
    return replace(_left(model, kind, name), untold=model.untold | others)


def _left(model: Model, kind: str, name: Name) -> Model:
    if kind == "cogging":
        return replace(model, cogging=tuple(n for n in model.cogging if n != name[1]))
    if kind == "ripple":
        return replace(model, ripple=tuple(n for n in model.ripple if n != name[1]))
    if kind == "encoder":
        kept = tuple(n for n in model.encoder if n != name[1])
        return replace(model, encoder=kept, error={n: model.error[n] for n in kept if n in model.error})
    if kind == "j":  # without it the sensor's error has no size
        model = replace(model, encoder=(), error={})
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
    offsets: tuple[float, float, float] | None = None,
) -> Estimate:
    here = whole(model, found)
    others = [coefficients(known, logs, model, factor) for factor in OTHERS]
    empty = Estimate(
        known, tuple(logs), {}, (), (), (), {}, tuple(remarks), (), model, tuple(rows), found, offsets
    )
    return findings.without_nonsense(with_values(empty, here, others), left)


def with_values(
    made: Estimate,
    here: dict[Name, float],
    others: Sequence[dict[Name, float]],
    simulated: Fit | None = None,
    phase: Mapping[Name, float] = MappingProxyType({}),
) -> Estimate:
    """The estimate with these coefficients; their errors are the fit's, and how far `others` are from them.

    `simulated`: the fit of simulated logs that the coefficients are corrected with, which has its own noise.
    `phase`: what they move by if currents that are held are logged in the middle of their period.
    """
    assert made.fit is not None
    found, scale = made.fit, {"encoder": 1 / (made.fit.get("j") or 1.0)}

    def value(name: Name) -> Value:
        within = found.error(name) if simulated is None else found.beside(name, simulated)
        own = max(within, found.between_logs(name, simulated)) * abs(scale.get(str(name[0]), 1.0))
        spread = np.sqrt(np.mean([(other.get(name, here[name]) - here[name]) ** 2 for other in others]))
        return Value(here[name], float(np.hypot(2 * np.hypot(own, spread), phase.get(name, 0.0))))

    untold = made.model.untold

    def waves(kind: str, orders: Sequence[int]) -> tuple[Wave, ...]:
        told = (n for n in orders if (kind, n) not in untold)
        return tuple(wave_of(n, value((kind, n, "c")), value((kind, n, "s"))) for n in told)

    return replace(
        made,
        values={
            str(name[0]): value(name) for name in here if len(name) == 1 and (str(name[0]), 0) not in untold
        },
        cogging=waves("cogging", made.model.cogging),
        ripple=waves("ripple", made.model.ripple),
        encoder=waves("encoder", made.model.encoder),
        loads={str(name[1]): value(name) for name in here if name[0] == "load"},
    )
