"""Write a study from a request: motor, mechanics, drive, sensor, a scenario, two controllers, metrics.

Every number that the request lacks is guessed from the catalogue or by `motor_rules`. The file marks it as a
guess. docs/guide/new.md says how the numbers are chosen.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

from pydantic import TypeAdapter, ValidationError

from cogless import units
from cogless.design import warnings
from cogless.design.laws.harmonic import certificate, rival_bases, unlearned_orders
from cogless.design.settling import settling
from cogless.run.suspects import SENSOR
from cogless.starter.amounts import amount, digits, exact_rate
from cogless.starter.better_settings import better_settings
from cogless.starter.doubts import doubts, magnet_slip, unusual
from cogless.starter.guess_list import guessed_values
from cogless.starter.motor_sections import (
    MAGNET_CONSTANTS,
    MotorFacts,
    class_of,
    datasheet_tables,
    detent_friction,
    put_inertia,
    put_motor,
    put_step_motor,
    share_of,
)
from cogless.starter.part_catalogue import Figure, Part, parts
from cogless.starter.ranking import LEARNING_LAW, Outcomes, outcomes, shortfall
from cogless.starter.request import NUMBERS, Answer, Request, RequestError
from cogless.starter.sensor_choice import (
    COUNTS_PER_SECOND,
    HALL_EDGES_PER_SECOND,
    TRIED,
    fit_observer,
    put_sensor,
    reading_doubt,
    sensor_counts,
)
from cogless.starter.sheet import Guess, Section, Sheet, origin, round_125
from cogless.study import Study, changed
from cogless.study.datasheet import AGREEMENT_MOST
from cogless.study.mechanics import Mechanics
from cogless.study.motor import AnyMotor
from cogless.study.numerics import OVERMODULATION_MOST, no_load_speed, steps_needed, voltage_reach
from cogless.study.reading import checked, put, with_datasheet
from cogless.study.toml import toml

Feedbacks = Mapping[str, tuple[str, str]]  # kp and ki by controller

BASE_KEY = f"controller.{LEARNING_LAW}.base"
COMPENSATION = "drive.dead_time_compensation"
COMPENSATED = (
    f"The study has {COMPENSATION}, with which the learning law harmonic leaves less ripple. Your board's "
    "firmware must compensate the dead time of its inverter, too."
)
METHOD_KEYS = ("speed_method", "observer_bandwidth")
COGGING_FREQUENCY = 40.0  # Hz, frequency of the main order at the chosen speed
VOLTAGE_SHARE = 0.5  # chosen speed / speed without load, at most
SPEED_ROUNDS = 3  # speeds that are tried at most, while the rotor snaps at them
SPEED_PERIODS = 5  # periods of the current loop in one of the speed loop, if that makes a whole rate
SPEED_RATE_MOST = 6000.0  # Hz; a faster loop leaves a processor no time for a law that learns
BANDWIDTH_SHARE = 1 / 25  # bandwidth / rate of the current loop
RUN_TURNS = 6  # turns of the rotor in a run
SHORTEST_RUN, LONGEST_RUN = 6.0, 60.0  # s
SETTLING_FACTOR = 2.0  # a run's settling time / the model's, at most
LAST_SHARE = 1 / 3  # share of the run in which metrics are taken, if whole turns would take over half
LAST_LEAST = 2.0  # s in which metrics are taken, rounded up to whole turns
LAST_MARGIN = 1.05  # factor on the window of orders, so that a slightly slow rotor turns once, too
ROWS_MOST, ROWS_IN_WAVE = 300_000, 4  # rows of a trace, and in a wave of the main order
TRACE_RATE_LEAST, TRACE_RATE_MOST = 500.0, 5000.0  # Hz
STEP_PHASES = 2  # phases of a step motor
OF_PHASES = {  # number of phases -> answers that only such a motor has
    2: ("holding-torque", "detent-torque", "step-angle"),
    3: ("slots", "kv", "torque-constant", "back-emf", "pole-pairs"),
}
OF_A_STEP_DATASHEET = ("resistance", "inductance", "holding-torque", "detent-torque", "step-angle", "cogging")
OF_ENCODERS = {"bits": "absolute", "cpr": "incremental"}
ORDER_ROWS = 2.2  # rows in a wave of an order, at least, or no metric reports this order
CONVERTER_BITS = 12  # bits of each current sensor's converter
# 1 / Kv, the torque per ampere of the supply with block commutation / torque per ampere of a phase (peak)
BLOCK_RATIO = 2 / math.sqrt(3)


@dataclass(frozen=True, kw_only=True)
class Draft:
    """The text of a study, and its guesses; remarks and doubts about what was asked, in sentences.

    `unusual`: the numbers that such a motor seldom has. `guessed`: the guessed values as text, by the flag
    that sets each, else by the key in the study.
    """

    text: str
    guesses: tuple[Guess, ...]
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    unusual: tuple[str, ...] = ()
    guessed: Mapping[str, str] = field(default_factory=dict)

    @property
    def tables(self) -> dict[str, Any]:
        return tomllib.loads(self.text)


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Settings that are chosen by designs and runs of the study itself.

    `steps`: integration steps of the plant in a period of the current loop. `observer`: keys of the sensor;
    {} where its edges are timed. `tried_method`: the sensor's keys of a speed method chosen by runs.
    `compensation`: keys of the compensation of dead time; None: none. `feedbacks`: gains in place of a tuning
    rule. `base`: the learning law's base, and the reason. `settling`: the time in which the law learns, s.
    """

    steps: int = 1
    observer: Mapping[str, str] = field(default_factory=dict)
    tried_method: Mapping[str, str] = field(default_factory=dict)
    compensation: Mapping[str, str] | None = None
    feedbacks: Feedbacks = field(default_factory=dict)
    base: tuple[int, str] | None = None
    settling: float = 0.0


def draft(request: Request, title: str, path: Path) -> Draft:
    """Write the study of a request. `path`: where the file will be.

    RequestError: an answer does not fit the others. StudyError: a study with these numbers is refused.
    A speed that nobody asked for is raised until the rotor does not snap from detent to detent.
    """
    speed, drive = None, parts("drives")[request.drive]
    for _ in range(SPEED_ROUNDS):
        composed = _fitted(partial(_composed, request, title, speed), path, drive)
        speed = None if "speed" in request.numbers else turning_speed(_study(composed, path))
        if speed is None:
            break
    return composed


def _fitted(compose: Callable[[Fit], Draft], path: Path, drive: Part) -> Draft:
    """The study with the integration steps, the speed method, the feedbacks and the settings that suit it."""
    fit = Fit(steps=_integration_steps(compose(Fit()), path))
    fit = replace(fit, observer=fit_observer(_study(compose(fit), path)))
    fit = replace(fit, feedbacks=slower_feedbacks(_study(compose(fit), path)))
    fit = _learning(fit, compose, path)
    timer = exact_rate(drive["timer"].typical) if "timer" in drive.figures else ""
    better = better_settings(_study(compose(fit), path), timer, "compensates" in drive.table)
    if better:
        timed = better.get(SENSOR, {})  # the whole table
        chosen = {key: timed.get(key, better.get(f"{SENSOR}.{key}", "")) for key in METHOD_KEYS}
        method = {key: text for key, text in chosen.items() if text}
        fit = replace(fit, tried_method=method, compensation=better.get(COMPENSATION))
        fit = _learning(fit, compose, path)
    return compose(fit)


def _learning(fit: Fit, compose: Callable[[Fit], Draft], path: Path) -> Fit:
    """The fit with a run long enough to learn on either base, and the base that leaves less ripple in it."""
    fit = replace(fit, base=None)
    fit = replace(fit, settling=settling_time(_study(compose(fit), path)))
    return replace(fit, base=better_base(_study(compose(fit), path)))


def _integration_steps(composed: Draft, path: Path) -> int:
    """Integration steps in a period of the current loop, enough for every variant of every guess."""
    changes: list[Mapping[str, Any]] = [{}]
    changes += (change for guess in composed.guesses for change in guess.variants.values())
    tables = composed.tables
    return max(_steps(deepcopy(tables), change, path) for change in changes)


def _steps(tables: dict[str, Any], change: Mapping[str, Any], path: Path) -> int:
    for key, value in change.items():
        put(tables, key, value)
    source = with_datasheet(path, tables)
    tables = source.tables
    speed = max(
        units.parse(scenario["reference"], units.ANGULAR_SPEED) for scenario in tables["scenario"].values()
    )
    try:
        star = TypeAdapter(AnyMotor).validate_python(tables["motor"]).star()
    except ValidationError:
        checked(source)  # raises a StudyError that says in a line what is wrong
        raise
    voltage = units.parse(tables["drive"]["inverter"]["bus_voltage"], units.VOLTAGE)
    most = OVERMODULATION_MOST * no_load_speed(voltage, star, star.psi_f)
    return steps_needed(
        star,
        Mechanics.model_validate(tables["mechanics"]),
        min(most, speed),
        units.parse(tables["drive"]["rates"]["current_loop"], units.FREQUENCY),
    )


def slower_feedbacks(study: Study) -> Feedbacks:
    """Gains that the design advises where a sensor's edges come too rarely: controller -> kp and ki."""
    slower = {}
    for name in study.controller:
        remark = warnings.slow_warning(study, name)
        for change in remark.cures if remark is not None else ():
            table = change.get(f"controller.{name}")
            gains = table if isinstance(table, dict) else _gains_in(change, name)
            if "kp" in gains and "ki" in gains:
                slower[name] = (str(gains["kp"]), str(gains["ki"]))
                break
    return slower


def settling_time(study: Study) -> float:
    """The time, s, in which the law has learned at every speed, whatever its base; 0 if it does not learn."""
    rivals = rival_bases(study, LEARNING_LAW)
    variants = [study] if rivals is None else [changed(study, {BASE_KEY: base}) for base in rivals]
    times = [settling(variant, LEARNING_LAW, certificate(variant, LEARNING_LAW)) for variant in variants]
    return max((at_speed.time for of_base in times for at_speed in of_base), default=0.0)


def better_base(study: Study) -> tuple[int, str] | None:
    """Of two bases that each leave something out, the one with less ripple in a run, and a comment.

    None: one base learns all, or no base has room for the sensor's error.
    """
    rivals = rival_bases(study, LEARNING_LAW)
    if rivals is None:
        return None
    variants = [changed(study, {BASE_KEY: base}) for base in rivals]
    answers = dict(zip(rivals, outcomes(variants, LEARNING_LAW), strict=True))
    complete, roomy = rivals
    beyond = ", ".join(map(str, unlearned_orders(variants[0], LEARNING_LAW)))
    cogging = f"all orders of the cogging but {beyond}" if beyond else "all orders of the cogging"
    learns = f"either base {complete} learns {cogging}, or base {roomy} the error of the sensor"
    duration = max(run.duration for run in study.scenario.values())
    several = len(study.scenario) > 1
    of_runs = f"in {'runs' if several else 'the run'} of {duration:g} s below, with these numbers"
    if not any(answer.holds for of_base in answers.values() for answer in of_base.values()):
        return complete, f"{learns}: neither holds {'a' if several else 'the'} speed {of_runs}"
    best = min(rivals, key=lambda base: shortfall(study, answers[base]))
    rms = ("; " if several else ", ").join(
        f"base {base} {_ripples(study, of_base)}" for base, of_base in answers.items()
    )
    return best, f"{learns}. Ripple (rms) {of_runs}: {rms}"


def _ripples(study: Study, answers: Outcomes) -> str:
    """The ripple at each speed in words; where there is one speed, without it."""
    words = []
    for scenario, answer in answers.items():
        ripple = amount(answer.ripple, units.ANGULAR_SPEED) if answer.holds else "does not hold the speed"
        speed = amount(study.scenario[scenario].top_reference, units.ANGULAR_SPEED)
        words.append(f"{ripple} at {speed}" if len(answers) > 1 else ripple)
    return ", ".join(words)


def _gains_in(change: Mapping[str, Any], name: str) -> dict[str, Any]:
    begin = f"controller.{name}."
    return {key.removeprefix(begin): value for key, value in change.items() if key.startswith(begin)}


def _study(drafted: Draft, path: Path) -> Study:
    return cast(Study, checked(with_datasheet(path, drafted.tables)))


def turning_speed(study: Study) -> float | None:
    """A speed, r/min, at which the rotor turns without snapping; None: it turns so, or none is in reach."""
    ((name, scenario),) = study.scenario.items()
    speeds = [warnings.turning_speed(study, controller, name) or 0.0 for controller in study.controller]
    faster = max(speeds) / units.factor("rpm", units.ANGULAR_SPEED)
    most = VOLTAGE_SHARE * voltage_reach(study) / units.factor("rpm", units.ANGULAR_SPEED)
    if max(speeds) <= scenario.top_reference or faster > most:
        return None
    return min(
        up for up in (round_125(faster), round_125(1.5 * faster), round_125(2 * faster)) if up >= faster
    )


def _composed(request: Request, title: str, faster: float | None, fit: Fit) -> Draft:
    """The study of a request. `faster`: its speed, r/min, in place of the one that suits the cogging."""
    part = class_of(request)
    drive = parts("drives")[request.drive]
    _check_fit(request, part, drive)
    sheet = Sheet()
    motor = put_motor(sheet, request, part) if part.layouts else put_step_motor(sheet, request, part)
    sheet.remarks += [
        f"--{flag} {answer.written}: taken as {answer.text}."
        for flag, answer in request.numbers.items()
        if answer.written
    ]
    voltage = _voltage(request, motor, drive)
    slip = magnet_slip(request, motor, voltage.typical)
    sheet.doubts += doubts(request, motor, slip)
    sheet.unusual += [] if slip else unusual(request, motor)
    _mechanics(sheet, request, motor)
    sensor = parts("encoders")[request.encoder]
    speed = _speed(request, motor, sensor, voltage.typical)
    if faster is not None:
        speed = faster, "the slowest speed at which the rotor does not snap from detent to detent"
    current_rate = _drive(sheet, request, motor, drive, voltage, fit)
    put_sensor(sheet, request, sensor, drive, observer=fit.observer, tried=fit.tried_method)
    sheet.doubts += reading_doubt(request, sensor, current_rate)
    duration = _duration(speed[0], fit.settling)
    rows = _scenario(sheet, request, motor, speed, duration, current_rate, voltage.typical)
    _controllers(sheet, fit.feedbacks, fit.base)
    _metrics(sheet, motor, speed[0], duration, rows)
    return Draft(
        text=sheet.file_text(_head(title, request)),
        guesses=tuple(sheet.guesses),
        remarks=tuple(sheet.remarks),
        doubts=tuple(sheet.doubts),
        unusual=tuple(sheet.unusual),
        guessed=guessed_values(sheet),
    )


def _head(title: str, request: Request) -> list[str]:
    return [
        f"# By `cogless new`: motor {request.motor}, drive {request.drive}, encoder {request.encoder}.",
        '# A line with "guess:" has a range and a reason. Replace what you know.',
        f"title = {toml(title)}",
    ]


def _check_fit(request: Request, part: Part, drive: Part) -> None:
    """Refuse answers that a study of these parts would not use, rather than ignore them."""
    phases = 3 if part.layouts else 2
    if phases not in drive.table["phases"]:
        fitting = [name for name, other in parts("drives").items() if phases in other.table["phases"]]
        kind = "the motor has three phases"
        if phases == 2:
            kind = "a step motor has two phases; for a motor with three give another --motor, such as servo"
        raise RequestError("drive", request.drive, f"expected one of {', '.join(fitting)}, since {kind}")
    kinds = {2: "two phases, a step motor", 3: "three phases"}
    for own, names in OF_PHASES.items():
        _refuse(request, names if phases != own else (), f"unless the motor has {kinds[own]}")
    for flag, encoder in OF_ENCODERS.items():
        fits = request.encoder == encoder or (flag == "bits" and request.encoder not in OF_ENCODERS.values())
        unless = "unless the encoder is absolute" if flag == "bits" else "unless the encoder is incremental"
        _refuse(request, () if fits and request.encoder != "hall" else (flag,), unless)
    current = request.numbers.get("rated-current")
    if phases == 2 and current is not None and current.written:
        raise RequestError(
            "rated-current", current.written, 'expected the current of each coil at rest, such as "2.8 A"'
        )
    _check_constants(request)
    tables = datasheet_tables(request.motor)
    if tables:
        has = OF_A_STEP_DATASHEET if phases == 2 else ("cogging",) if "cogging" in tables else ()
        _refuse(request, has, f"since the datasheet of {request.motor} has it")


def _check_constants(request: Request) -> None:
    """Refuse two numbers of the magnet that do not agree: speed per volt, torque per current, back-EMF."""
    first, *others = [word for word in MAGNET_CONSTANTS if word in request.numbers] or [""]
    for other in others:
        answer = request.numbers[other]
        by_first = MAGNET_CONSTANTS[other][1](MAGNET_CONSTANTS[first][0](request.numbers[first].value))
        if not math.isclose(answer.value, by_first, rel_tol=AGREEMENT_MOST):
            number = NUMBERS[other]
            expected = amount(by_first, number.dimension, number.unit)
            which = "give one of the two"
            if {first, other} == {"torque-constant", "kv"} and math.isclose(
                answer.value, BLOCK_RATIO * by_first, rel_tol=AGREEMENT_MOST
            ):
                which = (
                    "this torque constant is per ampere of the supply (block commutation); give --kv alone"
                )
            stated = f"--{first} {request.numbers[first].text}"
            raise RequestError(other, answer.text, f"expected about {expected}, as {stated} says; {which}")


def _refuse(request: Request, names: tuple[str, ...], why: str) -> None:
    for name in names:
        if name in request.numbers:
            raise RequestError(name, request.numbers[name].text, f"expected no such option, {why}")


# mechanics


def _mechanics(sheet: Sheet, request: Request, motor: MotorFacts) -> None:
    section = sheet.section("[mechanics]")
    part, size = motor.part, motor.size
    if "inertia" in request.numbers:
        _refuse(request, ("load-inertia",), "since --inertia is that of rotor and load together: add the two")
    put_inertia(sheet, section, request, motor)
    if "friction" in request.numbers:
        section.put("coulomb_friction", request.numbers["friction"].text)
    else:
        detent = request.value("detent-torque")
        friction = (
            share_of(part["friction"], size.torque) if detent is None else detent_friction(part, detent)
        )
        sheet.guess(section, "coulomb_friction", friction, units.TORQUE, path="mechanics", name="friction")
    if request.value("load"):
        section.put_text("load", f'{{ torque = "{request.numbers["load"].text}" }}')


# the drive


def _voltage(request: Request, motor: MotorFacts, drive: Part) -> Figure:
    """The bus voltage: as stated, or that of the class, clipped to what the drive bears."""
    stated = request.value("bus-voltage")
    bears = drive["voltage"]
    if stated is not None:
        if not bears.low <= stated <= bears.high:
            text = request.numbers["bus-voltage"].text
            within = f"expected {bears.low:g} to {bears.high:g} V, the range of {request.drive}"
            raise RequestError("bus-voltage", text, within)
        return Figure(typical=stated, low=stated, high=stated, reason="", is_guess=False)
    usual = motor.part["bus_voltage"]
    typical, low, high = (min(max(v, bears.low), bears.high) for v in (usual.typical, usual.low, usual.high))
    return Figure(typical=typical, low=low, high=high, reason=usual.reason, is_guess=True)


def _speed(request: Request, motor: MotorFacts, sensor: Part, voltage: float) -> tuple[float, str]:
    """The scenario's speed, r/min, and why it was chosen; "" if it was stated."""
    if "speed" in request.numbers:
        return _in_rpm(request.numbers["speed"]), ""
    cogs = 60 * COGGING_FREQUENCY / motor.main_order
    if sensor.table["kind"] == "hall":
        seen = 60 * HALL_EDGES_PER_SECOND / (6 * motor.pole_pairs)
    else:
        seen = 60 * COUNTS_PER_SECOND / sensor_counts(request, sensor)
    speed = max(round_125(cogs), round_125(seen))
    reach = units.convert(motor.reach(voltage), "rpm", units.ANGULAR_SPEED)
    reason = f"slow: the main cogging order comes {motor.main_order * speed / 60:.3g} times a second"
    return min(speed, round_125(VOLTAGE_SHARE * reach)), reason


def _drive(
    sheet: Sheet, request: Request, motor: MotorFacts, drive: Part, voltage: Figure, fit: Fit
) -> float:
    """Write rates, current loop, inverter and current sensors; returns the current loop's rate, Hz."""
    current_rate, speed_rate = _rates(request, drive)
    sheet.section("[drive]").put("make", drive.name)
    section = sheet.section("[drive.rates]")
    for key, flag, rate in (
        ("current_loop", "current-rate", current_rate),
        ("speed_loop", "speed-rate", speed_rate),
    ):
        stated = flag in request.numbers or "current-rate" in request.numbers
        section.put(key, exact_rate(rate), *(() if stated else (origin(drive[key]),)))
    if fit.steps > 1:
        section.put(
            "integration_steps",
            fit.steps,
            note="enough at both ends of each guessed range, too",
        )

    section = sheet.section("[drive.current_loop]")
    bandwidth = current_rate * BANDWIDTH_SHARE
    section.put("bandwidth", f"{bandwidth:.4g} Hz", note="a 25th of the current loop's rate")
    if "no_decoupling" in drive.table:
        section.put("decoupling", False, f"from: {drive.table['no_decoupling']}")
    if "current-limit" in request.numbers:
        section.put("current_limit", request.numbers["current-limit"].text)
    else:
        _limit(sheet, section, motor, drive)

    section = sheet.section("[drive.inverter]")
    if voltage.is_guess:
        sheet.guess(section, "bus_voltage", voltage, units.VOLTAGE, path="drive.inverter", name="bus voltage")
    else:
        section.put("bus_voltage", request.numbers["bus-voltage"].text)
    dead = drive["dead_time"]
    if dead.is_guess:
        sheet.guess(section, "dead_time", dead, units.TIME, path="drive.inverter", name="dead time")
    else:
        section.put("dead_time", amount(dead.typical, units.TIME), origin(dead))

    if fit.compensation is not None:
        section = sheet.section(f"[{COMPENSATION}]")
        section.put("band", fit.compensation["band"], TRIED)
        sheet.remarks.append(COMPENSATED)

    section = sheet.section("[drive.current_sensors]")
    step = 2 * drive["current_range"].typical / 2**CONVERTER_BITS
    noise = Figure(
        typical=step, low=step / 4, high=2 * step, reason="one step of the converter", is_guess=True
    )
    sheet.guess(
        section,
        "noise",
        noise,
        units.CURRENT,
        path="drive.current_sensors",
        name="noise of the current sensors",
    )
    section.put("bits", CONVERTER_BITS)
    section.put(
        "range", amount(drive["current_range"].typical, units.CURRENT), origin(drive["current_range"])
    )
    return current_rate


def _limit(sheet: Sheet, section: Section, motor: MotorFacts, drive: Part) -> None:
    most = drive["current_limit"]
    if motor.limit >= most.typical:
        section.put("current_limit", amount(most.typical, units.CURRENT), origin(most))
        return
    what = "the motor's continuous current"
    limit = amount(motor.limit, units.CURRENT)
    if motor.phases == STEP_PHASES:
        sheet.remarks.append(f"Current limit: {limit} = {motor.limit_reason}.")
    if not motor.limit_is_guess:
        section.put("current_limit", limit, f"{what}: {motor.limit_reason}")
        return
    figure = Figure(
        typical=motor.limit,
        low=motor.limit / 2,
        high=min(2 * motor.limit, max(most.typical, motor.limit)),
        reason=f"{what}: {motor.limit_reason}",
        is_guess=True,
    )
    sheet.guess(
        section, "current_limit", figure, units.CURRENT, path="drive.current_loop", name="current limit"
    )


def _rates(request: Request, drive: Part) -> tuple[float, float]:
    current = request.value("current-rate") or drive["current_loop"].typical
    if current % 1:
        raise RequestError(
            "current-rate", request.numbers["current-rate"].text, "expected a whole number of Hz"
        )
    stated = request.value("speed-rate")
    if stated is not None:
        if stated % 1 or current % stated:
            text = request.numbers["speed-rate"].text
            raise RequestError(
                "speed-rate", text, f"expected a rate that divides the current loop's, {current:g} Hz"
            )
        return current, stated
    if "current-rate" not in request.numbers:
        return current, drive["speed_loop"].typical
    return current, current / _divider(int(current))


def _divider(rate: int) -> int:
    """Periods of the current loop in one of the speed loop: a divisor of the rate near SPEED_PERIODS."""
    least = math.ceil(rate / SPEED_RATE_MOST)
    fitting = [n for n in range(least, 41) if rate % n == 0]
    return min(fitting or [1], key=lambda n: abs(math.log(n / SPEED_PERIODS)))


# scenario, controllers, metrics


def _scenario(
    sheet: Sheet,
    request: Request,
    motor: MotorFacts,
    speed: tuple[float, str],
    duration: float,
    current_rate: float,
    voltage: float,
) -> float:
    """Write the trace, and a scenario for each speed; returns the trace's rows a second."""
    rpm, reason = speed
    text = request.numbers["speed"].text if "speed" in request.numbers else f"{rpm:.6g} rpm"
    speeds = {rpm: text, **{_in_rpm(answer): answer.text for answer in request.faster}}
    section = sheet.section("[trace]")
    fastest = motor.main_order * max(speeds) / 60
    rate = _trace_rate(int(current_rate), duration, fastest)
    section.put("rate", exact_rate(rate))
    for rpm, text in speeds.items():
        name = "slow" if len(speeds) == 1 else f"at_{digits(rpm).replace('.', '_')}_rpm"
        section = sheet.section(f"[scenario.{name}]")
        section.put("duration", f"{duration:g} s")
        section.put("reference", text, *((f"guess: {reason}",) if reason else ()))
        if rpm < units.convert(motor.reach(voltage), "rpm", units.ANGULAR_SPEED):
            section.put("initial_speed", text)
    return rate


def _in_rpm(answer: Answer) -> float:
    return answer.value / units.factor("rpm", units.ANGULAR_SPEED)


def _duration(rpm: float, settling_time: float) -> float:
    """A run's length, s: some turns, and long enough for the law to learn before metrics are taken."""
    turns, learning = RUN_TURNS * 60 / rpm, SETTLING_FACTOR * settling_time + LAST_LEAST
    return float(math.ceil(min(max(SHORTEST_RUN, turns, learning), LONGEST_RUN)))


def _trace_rate(rate: int, duration: float, fastest: float) -> float:
    """Rows a second: the current loop's rate over a whole number, enough for waves of `fastest` Hz."""
    most, least = min(TRACE_RATE_MOST, ROWS_MOST / duration), max(TRACE_RATE_LEAST, ROWS_IN_WAVE * fastest)
    rates = [rate // n for n in range(1, rate + 1) if rate % n == 0]
    few = next((rate for rate in rates if rate <= most), rates[-1])
    return few if few >= least else min((rate for rate in rates if rate >= least), default=rates[0])


def _controllers(sheet: Sheet, feedbacks: Feedbacks, base: tuple[int, str] | None) -> None:
    pi = sheet.section("[controller.pi]")
    pi.put("law", "pi")
    pi.put("label", "PI")
    pi.put("baseline", True)
    learner = sheet.section("[controller.harmonic]")
    learner.put("law", "harmonic")
    learner.put("label", "Harmonic")
    rules = {"pi": '{ rule = "phase-margin", phase_margin = "60 deg" }', "harmonic": '{ rule = "auto" }'}
    for name, section in (("pi", pi), ("harmonic", learner)):
        if name in feedbacks:
            kp, ki = feedbacks[name]
            section.put("kp", kp, "for a slower loop than by the rule, since the sensor's edges come rarely")
            section.put("ki", ki)
        else:
            section.put_text("tuning", rules[name])
    if base is not None:
        learner.put("base", *base)


def _metrics(sheet: Sheet, motor: MotorFacts, rpm: float, duration: float, rows: float) -> None:
    turn = 60 / rpm
    whole = turn * max(1, math.ceil(min(LAST_LEAST, duration * LAST_SHARE) / turn))
    last = whole if whole <= 0.5 * duration else duration * LAST_SHARE
    entries: list[tuple[str, str, str | None, str]] = [
        ("speed_ripple", "ripple-rms", "omega_m", "rpm"),
        ("mean_speed", "mean", "omega_m", "rpm"),
        ("torque_ripple", "ripple-rms", "tau_motor", "mN*m"),
        ("copper_loss", "copper-loss", None, "mW"),
    ]
    for name, kind, signal, unit in entries:
        section = _metric(sheet, name, kind, signal, last)
        section.put("unit", unit)
        if name == "mean_speed":
            section.put("better", "none")
    orders = [order for order in sorted(motor.orders) if ORDER_ROWS * order < rows * turn]
    if last >= turn * (1 - 1e-9) and orders:
        section = _metric(sheet, "speed_order", "order", "omega_m", LAST_MARGIN * last)
        section.put("order", orders[:4])
        section.put("frame", "mechanical")
        section.put("unit", "rpm")


def _metric(sheet: Sheet, name: str, kind: str, signal: str | None, last: float) -> Section:
    section = sheet.section("[[metric]]")
    section.put("name", name)
    section.put("kind", kind)
    if signal:
        section.put("signal", signal)
    section.put("last", f"{last:.9g} s")
    return section
