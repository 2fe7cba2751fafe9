"""Estimate a motor from logs: find orders and delay, fit all, drop inseparable columns, add errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from cogless.identify import findings, flexible_shaft, voltage
from cogless.identify.advice import Advice, AdvisedError, logs_of_kind
from cogless.identify.balance import (
    LADDER,
    WIDE_INSTRUMENT,
    Model,
    Name,
    Rows,
    Sensor,
    angle_noise,
    narrowest_width,
    rows_of,
)
from cogless.identify.cogging_orders import FALSE_ALARM, ORDER_CHANCE, found_orders
from cogless.identify.config import Identification
from cogless.identify.jackknife import LARGEST_INFLATION, Equations, Fit
from cogless.identify.kernel import white_noise
from cogless.identify.log import Log
from cogless.identify.result import Estimate, Value, Wave, wave_of
from cogless.units import TURN

ORDERS_MOST = 48
LONGEST_DELAY, EARLIEST_DELAY = 6e-3, -3e-3  # s; negative: the angle is filtered, so i_q comes before it
UNSURE_DELAY = 5e-3  # s, error at which a delay counts as unknown
DELAY_TRIES, DELAY_SETTLED = 10, 0.01  # most parabolas, and the last move of the delay, in steps of the grid
ORDERS_FOR_ENCODER = 3  # least known orders of cogging; with fewer the encoder's error would replace orders
ENCODER_ROUNDS, ENCODER_SETTLED = 3, 0.1  # most rounds; sensor's error left over its interval, at most
SEARCH_ROUNDS = 2
AGREEMENT_SHARE = 0.5  # share of a wider instrument's interval within which a narrower one agrees with it
ALIKE_INERTIA = 1e-3
SURE_LADDER = 2.0  # ratio of intervals below which a wider instrument's inertia is another measurement
KERNEL_WIDEST = 0.02  # s
NARROW_SHARE = 0.4  # width of the kernels of the second search, for faster orders, over the narrowest width
PASSED_PHASE = 2.0  # rad that the fastest order turns in a kernel's width: a seventh of the wave passes
OTHER_WIDTH = 1.4  # factor on the kernel's width; the change of the values by it is a part of their errors
FEW_CHANCE = FALSE_ALARM / 4  # chance of a false alarm for a wave that is one of a few candidates
CLEAR_ERRORS = {  # least size of a wave over its error at 95 %: noise alone exceeds it by these chances
    "cogging": float(np.sqrt(-2 * np.log(ORDER_CHANCE))) / 1.96,
    "ripple": float(np.sqrt(-2 * np.log(FEW_CHANCE))) / 1.96,
}
SEEING_SHARE = 0.1  # share of a log's rows that show an order, at least
FRICTION_ORDERS = (1, 2)
STRIBECK_SPEEDS = (0.3, 5.0, 7)  # first and last over the slowest log's speed, and the count of speeds
STRIBECK_COST = 8.0  # cost above the least at 95 % of one value, where half of the rows are independent
STRIBECK_ERRORS, STRIBECK_INFLATION = 1.5, 30.0
UNSURE_ROWS = 1.5  # rows by which a current may be early or late if the delay is not known
NO_LOG = "no log is left: expected logs with theta and i_q"
Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class State:
    """A model, its equations, and their solution with one instrument of the ladder."""

    model: Model
    equations: Equations
    fit: Fit
    instrument: int


CURES = {
    "j": "Inertia cannot be told apart from cogging or friction; add an acceleration log.",
    "b": "Viscous and Coulomb friction cannot be told apart; add a log at a second, fast speed, in both "
    "directions.",
    "c": "Friction and a load cannot be told apart; record each log in both directions.",
    "offset": "A current offset and friction cannot be told apart; record each log in both directions.",
    "ripple": "Order {0}: K_t ripple and cogging cannot be told apart; record logs with loads of both "
    "signs, and an acceleration log.",
    "encoder": "Order {0}: the encoder's error and cogging cannot be told apart; add a log at a fast speed, "
    "in both "
    "directions.",
    "cogging": "Order {0}: cogging cannot be told apart from the rest; add a slow sweep.",
}
CURE_LOGS = {  # kinds of log that separate a column from the other columns
    "j": ("acceleration",),
    **dict.fromkeys(("b", "encoder"), ("constant-speed",)),
    **dict.fromkeys(("c", "offset", "cogging"), ("slow-sweep",)),
    "ripple": ("load", "acceleration"),
}


class Logs:
    """The logs of one drive, with the drive's description. Builds and solves the logs' equations."""

    def __init__(self, identification: Identification, logs: Sequence[Log], progress: Progress) -> None:
        rates = identification.drive.rates
        self.identification, self.logs, self.progress = identification, tuple(logs), progress
        self.period = 1 / (rates.speed_loop or rates.current_loop)
        self.sensor = Sensor(identification.step, identification.motor.pole_pairs, self.period)
        self.poles = identification.motor.pole_pairs
        self.moving = [log for log in logs if log.dt]
        self._last: tuple[Model, Equations] | None = None

    def equations(self, model: Model) -> Equations:
        """The equations of all logs at the model's delay, with a column of the remaining delay on demand."""
        if self._last is None or self._last[0] != model:
            self._last = None  # This frees their memory before the next ones are made.
            rows = [rows for log in self.logs for rows in rows_of(log, model, self.sensor)]
            self._last = model, Equations(rows)
        return self._last[1]

    def solve(self, model: Model, instrument: int = WIDE_INSTRUMENT) -> State:
        equations = self.equations(model)
        return State(model, equations, equations.fit(instrument), instrument)

    def agreeing(self, model: Model) -> State:
        """Solve with the narrowest instrument whose inertia agrees with that of every wider one."""
        equations = self.equations(model)
        chosen, before = len(LADDER) - 1, list[tuple[float, float]]()
        best = equations.fit(chosen)
        if ("j",) not in best:
            return State(model, equations, best, WIDE_INSTRUMENT)
        for instrument in reversed(range(len(LADDER))):
            one = equations.fit(instrument)
            j, unsure = one["j",], best.interval(("j",)) > 0.5 * abs(best["j",])
            contradicts = (abs(j - v) > max(AGREEMENT_SHARE * e, ALIKE_INERTIA * abs(v)) for v, e in before)
            if not unsure and any(contradicts):
                break
            before.append((j, one.interval(("j",))))
            chosen, best = instrument, one
        return State(model, equations, best, chosen)

    def widths(self, model: Model) -> Model:
        """The model with kernels up to the frequency at which the angle's noise meets the current's.

        The kernels are no wider than the slowest log needs to show order 6 p. `passing` allows faster orders.
        """
        j = abs(self.solve(model).fit.get("j")) or 1e-9
        stretches = {
            log.name: max(log.stretches, key=lambda rows: rows.stop - rows.start) for log in self.moving
        }
        currents = {
            log.name: white_noise(*(log[name][stretches[log.name]] for name in ("i_q", "theta")))
            for log in self.moving
            if "i_q" in log
        }
        mean = float(np.mean(list(currents.values()))) if currents else 0.0
        widest = min(KERNEL_WIDEST, 1 / max(6 * self.poles * self._slowest, 1e-9))
        widths = {}
        for log in self.moving:
            angle = angle_noise(log, stretches[log.name], self.identification.step)
            current = currents.get(log.name) or mean
            meeting = np.sqrt(np.sqrt(current / max(angle, 1e-300)) / j) / TURN
            least = self._narrowest(log)
            widths[log.name] = float(np.clip(1 / max(TURN * meeting, 1e-9), least, max(widest, least)))
        return replace(model, widths=widths)

    def narrowed(self, model: Model, widest: Callable[[Log], float]) -> Model:
        """The model with kernels no wider than `widest` of each log, s, as far as rows and law allow this."""
        widths = {
            log.name: min(model.width(log), max(self._narrowest(log), widest(log))) for log in self.moving
        }
        return replace(model, widths=widths)

    def comparable(self, state: State) -> Sequence[Rows]:
        """Rows with kernels so narrow that every log shows the strongest order as clearly as possible."""
        if not state.model.cogging:
            return state.equations.rows
        order = findings.strongest_order(state.fit, state.model)
        sharp = self.narrowed(state.model, lambda log: 1 / max(order * findings.speed(log), 1e-9))
        return self.equations(sharp).rows

    def lateness(self, unsure: float) -> float:
        """Time by which currents may act earlier or later than the model's delay says, s.

        `unsure`: the delay's error, s; inf: the delay is not known.
        """
        return min(unsure, UNSURE_ROWS * max((log.dt for log in self.moving), default=0.0))

    def passing(self, model: Model, widths: Mapping[str, float]) -> Model:
        """The model with these widths of kernels, narrowed until the model's fastest order passes them."""
        fastest = max(model.cogging, default=1) * self._slowest
        return self.narrowed(replace(model, widths=widths), lambda log: PASSED_PHASE / max(fastest, 1e-9))

    def _narrowest(self, log: Log) -> float:
        return max(narrowest_width(log), self.period)

    @cached_property
    def _slowest(self) -> float:
        """Speed of the slowest log, rad/s."""
        return min(findings.speed(log) for log in self.moving)

    def sees(self, order: int) -> bool:
        """Whether some log has more than two rows for each wave of an order."""
        for log in self.moving:
            moved = np.abs(np.diff(log["theta"]))
            if np.mean(order * moved < 2.4) > SEEING_SHARE and np.median(moved) > 0:
                return True
        return not self.moving

    def settled(self, model: Model, instrument: int) -> State:
        """Solve, subtract the sensor's error from the angle, and repeat until little of the error is left.

        The error shows as sidebands of the cogging, so the cogging is fitted first.
        """
        if model.encoder and not model.waves.keys() >= set(model.cogging):
            fit = self.solve(model, instrument).fit
            model = with_waves(model, fit) if fit.get("j") > 0 else model
        for _ in range(ENCODER_ROUNDS):
            state = self.solve(model, instrument)
            fit = state.fit
            remaining = [("encoder", n, part) for n in model.encoder for part in "cs"]
            if fit.get("j") <= 0 or all(abs(fit[k]) < ENCODER_SETTLED * fit.interval(k) for k in remaining):
                return state
            model = taken_out(model, fit)
        return self.solve(model, instrument)

    def delayed(self, model: Model, instrument: int) -> tuple[Model, float]:
        """The model with the delay of the least residual, and the delay's error, s; 0 and inf: not known.

        A fit with instruments gives the remaining delay. Its error and its size make the delay's error.
        """
        grid = max(min((log.dt for log in self.moving), default=0.0), self.period) / 2
        start = model

        @cache
        def cost(delay: float) -> float:
            return self.equations(replace(start, delay=delay)).cost(instrument)

        if not model.delay:
            delays = np.arange(EARLIEST_DELAY, LONGEST_DELAY, 2 * grid).tolist()
            model = replace(model, delay=min(delays, key=cost))
        for _ in range(DELAY_TRIES):
            costs = [cost(model.delay + k * grid) for k in (-1, 0, 1)]
            bend, slope = costs[0] - 2 * costs[1] + costs[2], (costs[0] - costs[2]) / 2
            steps = float(np.argmin(costs)) - 1.0  # On a flank the curve may bend down: move by a whole step.
            if steps == 0.0 and bend > 0:
                steps = slope / bend
            delay = float(np.clip(model.delay + steps * grid, EARLIEST_DELAY, LONGEST_DELAY))
            model = replace(model, delay=delay)
            if abs(steps) < DELAY_SETTLED:
                break
        fit = self.solve(replace(model, columns=model.columns | {"delay"}), instrument).fit
        if ("delay",) not in fit:
            return replace(model, delay=0.0), np.inf
        error = float(np.hypot(fit.interval(("delay",)), fit["delay",]))
        inside = EARLIEST_DELAY < model.delay < LONGEST_DELAY
        if error < UNSURE_DELAY and inside:
            return model, error
        return replace(model, delay=0.0), np.inf


def estimate_motor(identification: Identification, logs: Sequence[Log], progress: Progress) -> Estimate:
    """Estimate all that can be known from the logs. StudyError: nothing can be known."""
    remarks = [remark for log in logs for remark in log.remarks]
    used, log_remarks = findings.usable(identification, logs)
    remarks += log_remarks
    if not used:
        none = [] if any(log.kind != "bridge-off" for log in logs) else [NO_LOG]
        raise AdvisedError(*log_remarks, *none)
    left_out: list[str] = []
    try:
        voltage.require_units(identification, used)
        rows = Logs(identification, used, progress).equations(Model()).rows
        findings.check_sign(identification, used, rows)
        model = _start(used, left_out)
    except AdvisedError as error:
        out = tuple(f"{log.name}: " for log in logs if log.name not in {one.name for one in used})
        causes = [line for line in log_remarks if line.startswith(out)]  # They precede their consequences.
        others = [line for line in log_remarks if line not in causes]
        raise AdvisedError(*causes, *error.mistakes, *others) from None
    if "j" not in model.columns:
        used = [log for log in used if not log.dt]
    drive = Logs(identification, used, progress)
    progress("orders", 0.0)
    state, unsure = _searched(drive, model)
    delay = None  # A held current is the same wherever in its period it is logged: half a period is unsure.
    if np.isfinite(unsure):
        delay = Value(state.model.delay, float(np.hypot(unsure, drive.period / 2)))
    state = _told_apart(drive, state, left_out)
    progress("errors", 0.0)
    remarks += voltage.check(identification, used)
    shift = drive.lateness(unsure)
    remarks += findings.between_logs(drive.comparable(state), state.fit, state.model, left_out, shift)
    empty = Estimate(
        identification,
        tuple(used),
        values={},
        cogging=(),
        ripple=(),
        encoder=(),
        loads={},
        remarks=tuple(remarks),
        left_out=(),
        offsets=findings.offsets_of(logs),
    )
    estimate = with_errors(drive, state, delay, unsure, empty)
    return findings.without_nonsense(_with_flexible_shaft(drive, estimate, shift), left_out)


def _with_flexible_shaft(drive: Logs, estimate: Estimate, delay_error: float) -> Estimate:
    """The estimate with a remark if the inertia differs from frequency to frequency."""
    if "j" not in estimate.values:
        return estimate
    bands = flexible_shaft.inertia_by_frequency(
        drive.equations, estimate.model, instrument=estimate.instrument, delay_error=delay_error
    )
    return replace(estimate, remarks=(*estimate.remarks, *flexible_shaft.sentences(bands)))


def at_delay(
    estimate: Estimate, delay: Value, simulated: Sequence[Log], truth: Mapping[Name, float]
) -> Estimate:
    """The estimate fitted again with a delay, s, that is known within its error.

    `simulated`: the same logs, simulated with a motor whose coefficients are `truth`. Where their fit differs
    from `truth` by more than the fit's error, the difference is subtracted from the estimate.
    """
    drive = Logs(estimate.identification, estimate.logs, lambda what, share: None)
    state = drive.agreeing(replace(estimate.model, delay=delay.value))
    state = drive.settled(state.model, state.instrument)
    fitted = with_errors(
        drive, state, delay, delay.error, estimate, lambda steady: _biases(drive, steady, simulated, truth)
    )
    orders = {
        kind: {wave.order for wave in getattr(estimate, kind)} for kind in ("cogging", "ripple", "encoder")
    }

    def waves_of(kind: str) -> tuple[Wave, ...]:
        return tuple(wave for wave in getattr(fitted, kind) if wave.order in orders[kind])

    return replace(
        fitted,
        values={key: x for key, x in fitted.values.items() if key in estimate.values or key == "delay"},
        cogging=waves_of("cogging"),
        ripple=waves_of("ripple"),
        encoder=waves_of("encoder"),
    )


def _steadiest(state: State, ends: Sequence[Equations]) -> State:
    """The state with the instrument whose inertia has the least error, the delay's part included.

    A narrow instrument has more of the motion, but also waves whose phase depends on the delay. `ends`: the
    equations at both ends of the delay's interval. Instruments narrower than the state's are not tried: they
    contradict the wider ones.
    """

    def error(instrument: int) -> float:
        fit = state.equations.fit(instrument, exact=True)
        moved = (end.fit(instrument)["j",] - fit["j",] for end in ends)
        return float(np.hypot(fit.interval(("j",)), max(map(abs, moved))))

    best = min(range(state.instrument, len(LADDER)), key=error)
    return (
        state
        if best == state.instrument
        else State(state.model, state.equations, state.equations.fit(best), best)
    )


def _biases(
    drive: Logs, state: State, simulated: Sequence[Log], truth: Mapping[Name, float]
) -> dict[Name, Value]:
    """Differences of the simulated logs' fit from its truth that exceed their error; the encoder's in rad.

    Breiman's garrote, doi:10.1080/00401706.1995.10484371, shrinks each difference: a small one may be noise
    of the simulation, and subtracting it would add this noise to that of the logs.
    """
    played = Logs(drive.identification, simulated, drive.progress)
    twin = played.settled(replace(state.model, error={}), state.instrument)
    coefficients, j = whole(twin.model, twin.fit), twin.fit.get("j") or 1.0
    biases = {}
    for name, true in truth.items():
        if name in coefficients:
            error = twin.fit.interval(name) / (abs(j) if name[0] == "encoder" else 1.0)
            bias = coefficients[name] - true
            if abs(bias) > error:
                biases[name] = Value(bias * (1 - (error / bias) ** 2), error)
    return biases


def _start(logs: Sequence[Log], left_out: list[str]) -> Model:
    """A model of the columns that the logs together can identify; `left_out` gets advice on the others.

    If the logs don't show the inertia, the model is for hold maps alone.
    """
    hold_maps, moving = [log for log in logs if not log.dt], [log for log in logs if log.dt]
    if not moving:
        left_out.append(
            Advice(
                "No log of a turning motor: inertia and friction cannot be identified; add an acceleration "
                "log.",
                logs_of_kind("acceleration"),
            )
        )
    elif findings.one_speed(moving):
        left_out.append(findings.said_of_one_speed(moving))
        if not hold_maps:
            raise AdvisedError(left_out[-1])
    else:
        columns = {"j", "b", "c", "offset"}
        if all(findings.feedback(log) is not None for log in moving):
            left_out.append(
                Advice(
                    "In all logs of a turning motor i_q only follows the feedback law: the delay cannot be "
                    "identified; "
                    "add an acceleration log.",
                    logs_of_kind("acceleration"),
                )
            )
        else:
            columns |= {"delay"}
        return Model(columns=frozenset(columns))
    return Model(columns=frozenset({"offset"}))


def _searched(drive: Logs, start: Model) -> tuple[State, float]:
    """The state with all that is found, and the delay's error, s; inf: the delay is not known."""
    poles, with_delay = drive.poles, "delay" in start.columns
    turning = "j" in start.columns
    model = replace(start, columns=start.columns - {"delay"})
    if turning:
        model = drive.widths(model)
    error, widths = np.inf, model.widths
    for search in range(SEARCH_ROUNDS):
        if search:  # the kernels hide faster orders
            model = drive.narrowed(model, lambda log: NARROW_SHARE * min(widths.values()))
        state = _with_orders(drive, model, first=not search and turning)
        model = drive.passing(state.model, widths) if turning else state.model
        forced = [n for n in (2 * poles, 4 * poles, 6 * poles) if drive.sees(n)] if turning else []
        cogging = tuple(sorted({*model.cogging, poles, *forced}))
        model = replace(model, cogging=cogging, ripple=tuple(forced), encoder=(1, 2) if turning else ())
        state = drive.settled(model, state.instrument)
        if with_delay:
            model, error = drive.delayed(state.model, state.instrument)
            state = drive.settled(model, state.instrument)
        state = _standing_out(drive, state)
        if turning:
            state = _with_rubbing(drive, state)
        model = drive.passing(state.model, widths) if turning else state.model
        if not turning:
            break
    if turning:
        state = _with_electrical_errors(drive, drive.agreeing(model))
        if with_delay:
            model, error = drive.delayed(state.model, state.instrument)
            state = drive.settled(model, state.instrument)
    return state, error


def _with_orders(drive: Logs, model: Model, first: bool) -> State:
    """Add the orders that the residual has, the strongest first, until there are no more."""
    while True:
        state = drive.agreeing(model)
        model = state.model
        drive.progress(f"orders: {len(model.cogging)}", 0.0)
        residuals = state.equations.residuals(state.fit)
        new = found_orders(residuals, state.fit, model, drive.sensor)
        if not new or len(model.cogging) >= ORDERS_MOST:
            return state
        model = replace(model, cogging=tuple(sorted({*model.cogging, *new})))
        if first and len(model.cogging) >= ORDERS_FOR_ENCODER and not model.encoder:
            model = replace(model, encoder=(1, 2))
        if model.encoder:
            model = drive.settled(model, state.instrument).model


def _standing_out(drive: Logs, state: State) -> State:
    """Keep the orders that stand out of their errors in the joint fit, and always the cogging of order p.

    The order that stands out least is dropped first, since it may widen the errors of the others.
    """
    model, equations, fit = state.model, state.equations, state.fit
    while True:
        waves = [("ripple", n) for n in model.ripple]
        waves += [("cogging", n) for n in model.cogging if n not in (*model.ripple, drive.poles)]
        clear = {wave: fit.clearness(*wave) / CLEAR_ERRORS[wave[0]] for wave in waves}
        kind, order = min(waves, key=clear.__getitem__, default=("", 0))
        if not waves or clear[kind, order] > 1:
            return state if model == state.model else drive.settled(model, state.instrument)
        model, equations = _remove_column(model, kind, (kind, order)), equations.without((kind, order))
        fit = equations.fit(state.instrument)


def _with_rubbing(drive: Logs, state: State) -> State:
    """The state with friction that varies with the angle or falls with the speed, if the logs show this."""
    model, instrument, rows = state.model, state.instrument, state.equations.rows
    slowest = min(float(np.median(np.abs(stretch.omega))) for stretch in rows if stretch.log.dt)
    grid = (slowest * np.geomspace(*STRIBECK_SPEEDS)).tolist()
    trials = [("stribeck", n) for n in range(len(grid))]
    equations = drive.equations(replace(model, friction=FRICTION_ORDERS, stribeck_trials=tuple(grid)))
    trial = equations.without(*trials).fit(instrument)
    friction = tuple(n for n in FRICTION_ORDERS if trial.chance("friction", n) < FEW_CHANCE)
    model = replace(model, friction=friction, stribeck=0.0)
    constant = [("friction", n) for n in FRICTION_ORDERS if n not in friction]
    equations = equations.without(("stribeck",), *constant)
    costs = [equations.without(*(k for k in trials if k != one)).cost(instrument) for one in trials]
    if min(costs) < equations.without(*trials).cost(instrument):
        model = _falling(drive, model, instrument, grid, costs)
    return state if model == state.model else drive.settled(model, instrument)


def _falling(
    drive: Logs, model: Model, instrument: int, grid: Sequence[float], costs: Sequence[float]
) -> Model:
    """The model with a friction that falls with the speed, where the logs show it clearly.

    `grid`: speeds over which it may fall, rad/s, with their costs.
    """
    place = int(np.argmin(costs))
    speed, ratio = grid[place], grid[1] / grid[0]
    if 0 < place < len(grid) - 1:
        before, middle, after = costs[place - 1 : place + 2]
        bend = before - 2 * middle + after
        speed *= ratio ** (0.5 * (before - after) / bend)
        ratio **= min(1.0, float(np.sqrt(2 * STRIBECK_COST / bend)))
    falling = replace(model, stribeck=speed, stribeck_ratio=ratio)
    fit = drive.solve(falling, instrument).fit
    clear = fit["stribeck",] > STRIBECK_ERRORS * fit.interval(("stribeck",))
    return falling if clear and fit.inflation[fit.names.index(("stribeck",))] < STRIBECK_INFLATION else model


def _with_electrical_errors(drive: Logs, state: State) -> State:
    """The state with errors of the angle of orders p and 2 p, where the logs show them.

    A resolver, or a magnet near the motor, makes such errors.
    """
    model, poles = state.model, drive.poles
    orders = tuple(n for n in (poles, 2 * poles) if n not in model.encoder and drive.sees(n))
    if not orders or state.fit.get("j") <= 0:
        return state
    torques = tuple(sorted({*model.cogging, *orders}))
    trial = drive.solve(
        replace(model, cogging=torques, encoder=(*model.encoder, *orders)), state.instrument
    ).fit
    more = [n for n in orders if trial.chance("encoder", n) < ORDER_CHANCE]
    if not more:
        return state
    encoder = tuple(sorted({*model.encoder, *more}))
    return drive.settled(
        replace(model, cogging=tuple(sorted({*model.cogging, *more})), encoder=encoder), state.instrument
    )


def with_waves(model: Model, fit: Fit) -> Model:
    """The model with the cogging and inertia of a fit, which the columns of the sensor's error need."""
    waves = {n: (fit["cogging", n, "c"], fit["cogging", n, "s"]) for n in model.cogging}
    return replace(model, waves=waves, j=fit["j",])


def taken_out(model: Model, fit: Fit) -> Model:
    """The model whose sensor error, subtracted from the angle, also has the rest that this fit found."""
    j = fit["j",]
    error = dict(model.error)
    for order in model.encoder:
        c, s = error.get(order, (0.0, 0.0))
        error[order] = (c + fit["encoder", order, "c"] / j, s + fit["encoder", order, "s"] / j)
    return replace(with_waves(model, fit), error=error)


def whole(model: Model, fit: Fit) -> dict[Name, float]:
    """Each coefficient of a fit; the encoder's error, rad, plus the part already taken out of the angle."""
    values = dict(zip(fit.names, fit.values.tolist(), strict=True))
    for order in model.encoder:
        for part, out in zip("cs", model.error.get(order, (0.0, 0.0)), strict=True):
            values["encoder", order, part] = out + values["encoder", order, part] / fit["j",]
    return values


WEAKEST = ("encoder", "ripple", "offset", "b", "cogging", "load", "c", "c_hold", "j")


def _told_apart(drive: Logs, state: State, left_out: list[str]) -> State:
    """Drop columns until all can be separated, the least important first. `left_out` gets advice on each."""
    while True:
        fit = state.fit
        wide = [name for name, by in zip(fit.names, fit.inflation, strict=True) if by > LARGEST_INFLATION]
        wide = [name for name in wide if str(name[0]) in CURES and name[0] in WEAKEST]
        if not wide:
            return state
        worst = min(wide, key=lambda name: WEAKEST.index(str(name[0])))
        if worst[0] == "cogging" and ("j",) in wide:  # Cogging and inertia can replace each other.
            left_out.append(not_told_apart("j"))
        elif worst[0] != "offset" or "c" in state.model.columns:
            left_out.append(not_told_apart(str(worst[0]), *worst[1:]))
        state = drive.settled(_without(state.model, worst), state.instrument)


def not_told_apart(kind: str, *of: str | int) -> Advice:
    """Advice which log to record if a column can't be distinguished from others; `of`: its order or log."""
    return Advice(CURES[kind].format(*of), logs_of_kind(*CURE_LOGS[kind]))


def _without(model: Model, name: Name) -> Model:
    """The model without a column; the columns that replace it in the fit become `untold`."""
    kind = str(name[0])
    others: set[tuple[str, int]] = set()
    if kind == "cogging":
        others = {("j", 0), *(("cogging", order) for order in model.cogging)}
    elif kind == "ripple":
        others = {("cogging", int(name[1]))}
    elif kind in ("b", "offset"):
        others = {("c", 0)}
    return replace(_remove_column(model, kind, name), untold=model.untold | others)


def _remove_column(model: Model, kind: str, name: Name) -> Model:
    if kind == "cogging":
        return replace(model, cogging=tuple(n for n in model.cogging if n != name[1]))
    if kind == "ripple":
        return replace(model, ripple=tuple(n for n in model.ripple if n != name[1]))
    if kind == "encoder":
        orders = tuple(n for n in model.encoder if n != name[1])
        return replace(model, encoder=orders, error={n: model.error[n] for n in orders if n in model.error})
    if kind == "j":  # without it the sensor's error has no size
        model = replace(model, encoder=(), error={})
    return replace(model, columns=model.columns - {kind})


def with_errors(
    drive: Logs,
    state: State,
    delay: Value | None,
    unsure: float,
    estimate: Estimate,
    bias_of: Callable[[State], Mapping[Name, Value]] = lambda state: {},
) -> Estimate:
    """The estimate with the values of a state. `bias_of`: biases that are subtracted from the values.

    Errors combine a jackknife's with the change of the values for a delay `unsure`, s, for a wider kernel,
    and for other instruments.
    """
    model, others = state.model, list[dict[Name, float]]()
    ends: list[Equations] = []
    if "j" in model.columns:
        shift = drive.lateness(unsure)
        ends = [drive.equations(replace(model, delay=model.delay + sign * shift)) for sign in (-1, 1)]
        state = _steadiest(state, ends)
    instrument, biases = state.instrument, bias_of(state)
    fit = state.equations.fit(instrument, exact=True)
    coefficients = whole(model, fit)
    if "j" in model.columns:
        others += [whole(model, end.fit(instrument)) for end in ends]
        if model.stribeck:
            speeds = (model.stribeck / model.stribeck_ratio, model.stribeck * model.stribeck_ratio)
            falling = [drive.solve(replace(model, stribeck=v), instrument).fit for v in speeds]
            others += [whole(model, fit) for fit in falling]
    moved = {
        name: max((abs(other.get(name, x) - x) for other in others), default=0.0)
        for name, x in coefficients.items()
    }
    if "j" in model.columns:
        wider = {log.name: OTHER_WIDTH * model.width(log) for log in drive.moving}
        other = whole(model, drive.solve(replace(model, widths=wider), instrument).fit)
        for name, x in coefficients.items():
            moved[name] = float(np.hypot(moved[name], other.get(name, x) - x))
        wider_ones = [state.equations.fit(k) for k in range(instrument + 1, len(LADDER))]
        sure = [one["j",] for one in wider_ones if one.interval(("j",)) < SURE_LADDER * fit.interval(("j",))]
        moved["j",] = float(np.hypot(moved["j",], max((abs(j - fit["j",]) for j in sure), default=0.0)))
    scale = {"encoder": 1 / (fit.get("j") or 1.0)}

    def value(name: Name) -> Value:
        own = fit.interval(name) * abs(scale.get(str(name[0]), 1.0))
        bias = biases.get(name, Value(0.0, 0.0))
        return Value(coefficients[name] - bias.value, float(np.linalg.norm([own, moved[name], bias.error])))

    def waves(kind: str, orders: Sequence[int]) -> tuple[Wave, ...]:
        separable = (n for n in orders if (kind, n) not in model.untold)
        return tuple(wave_of(n, value((kind, n, "c")), value((kind, n, "s"))) for n in separable)

    poles = drive.poles  # The model has this order of cogging even if the logs do not show it.
    cogging = [n for n in model.cogging if n != poles or fit.chance("cogging", n) < ORDER_CHANCE]
    single = ("j", "b", "c", "c_hold", "offset", "stribeck")
    values = {
        str(name[0]): value(name)
        for name in coefficients
        if name[0] in single and (name[0], 0) not in model.untold
    }
    if "stribeck" in values:
        speed = model.stribeck
        values["stribeck_speed"] = Value(speed, speed * (model.stribeck_ratio - 1))
    if delay is not None:
        values["delay"] = delay
    return replace(
        estimate,
        values=values,
        cogging=waves("cogging", cogging),
        ripple=waves("ripple", model.ripple),
        encoder=waves("encoder", model.encoder),
        friction=waves("friction", model.friction),
        loads={str(name[1]): value(name) for name in coefficients if name[0] == "load"},
        model=model,
        rows=state.equations.rows,
        fit=fit,
        instrument=instrument,
    )
