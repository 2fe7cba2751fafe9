"""Write a study from a request: motor, mechanics, drive, sensor, a scenario, two controllers, metrics.

Every number that the request lacks is a guess of the catalogue or of `motor_rules`, and is marked so in the
file. docs/guide/new.md says how the numbers are chosen.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

from pydantic import TypeAdapter

from cogless import units
from cogless.design.warnings import slow_warning
from cogless.files import shipped
from cogless.starter.amounts import amount, exact_rate
from cogless.starter.motor_rules import (
    KV_TO_TORQUE,
    Known,
    Sized,
    cogging_orders,
    layouts_for,
    peak_of_coil,
    sized,
)
from cogless.starter.part_catalogue import Figure, Part, named_motors, parts
from cogless.starter.request import Request, RequestError
from cogless.starter.sensor_choice import (
    COUNTS_PER_SECOND,
    HALL_EDGES_PER_SECOND,
    fit_observer,
    put_sensor,
    sensor_counts,
    with_sensor,
)
from cogless.starter.sheet import Guess, Section, Sheet, because, origin, round_125
from cogless.study import Study
from cogless.study.mechanics import Mechanics
from cogless.study.motor import AnyMotor, StarMotor
from cogless.study.numerics import OVERMODULATED, no_load_speed, steps_needed, voltage_reach
from cogless.study.reading import checked, put, with_datasheet

Feedbacks = Mapping[str, tuple[str, str]]  # kp and ki by controller

COGGING_FREQUENCY = 40.0  # Hz, of the main order at the speed that is chosen
VOLTAGE_SHARE = 0.5  # of the speed without load that the chosen speed may be
SPEED_ROUNDS = 3  # of raising a speed at which the rotor snaps
SPEED_PERIODS = 5  # of the current loop in one of the speed loop, where a whole rate allows
SPEED_RATE_MOST = 6000.0  # Hz, that leaves a processor time for a law that learns
BANDWIDTH_SHARE = 1 / 25  # bandwidth over the rate of the current loop
RUN_TURNS = 6  # of the rotor in a run
SHORTEST_RUN, LONGEST_RUN = 6.0, 60.0  # s
LAST_SHARE = 1 / 3  # of the run, in which metrics are taken, at most
LAST_LEAST = 2.0  # s, likewise, at least
ROWS_MOST, ROWS_IN_WAVE = 300_000, 4
TRACE_RATE_LEAST, TRACE_RATE_MOST = 500.0, 5000.0  # Hz
ORDER_ROWS = 2.2  # in a wave of an order that a metric tells
CONVERTER_BITS = 12  # each current sensor has such a converter
LOAD_FACTOR = 3.0  # times the guessed rotor's inertia, for a load that nobody stated of
SLOT_PHASE, POLE_PHASE = "40 deg", "110 deg"  # any: parts of the cogging do not begin together
DETENT_ORDER = 4  # electrical, of a step motor with two phases
OTHER_LAYOUTS = 3
STEPS_IN_A_PERIOD = 4  # a period is an electrical revolution
MAGNET_WORDS = {"kv": "kv", "torque-constant": "K_t", "back-emf": "K_e_line_to_line_rms"}


@dataclass(frozen=True, kw_only=True)
class Draft:
    """The text of a study, and its guesses."""

    text: str
    guesses: tuple[Guess, ...]

    @property
    def tables(self) -> dict[str, Any]:
        return tomllib.loads(self.text)


@dataclass(frozen=True, kw_only=True)
class MotorFacts:
    """What the other sections need of the motor, SI."""

    part: Part
    size: Sized
    phases: int
    pole_pairs: int
    main_order: int
    orders: tuple[int, ...]
    limit: float  # A, peak of a phase, that the motor bears all day
    limit_is_guess: bool
    limit_reason: str


def draft(request: Request, title: str, path: Path) -> Draft:
    """The study of a request; `path`: where it will be.

    RequestError: an answer that does not go with the others. StudyError: the study of these numbers is
    refused. A speed that nobody asked for is raised until the rotor does not snap from detent to detent.
    """
    speed = None
    for _ in range(SPEED_ROUNDS):
        composed = _fitted(partial(_composed, request, title, speed), path)
        speed = None if "speed" in request.numbers else turning_speed(_study(composed, path))
        if speed is None:
            break
    return composed


def _fitted(compose: Callable[[int, Feedbacks], Draft], path: Path) -> Draft:
    """The study with the integration steps, the speed method and the feedbacks that suit it."""
    steps = _integration_steps(compose(1, {}), path)
    composed = compose(steps, {})
    change = fit_observer(_study(composed, path))
    composed = _observed(composed, change)
    feedbacks = slower_feedbacks(_study(composed, path))
    return _observed(compose(steps, feedbacks), change) if feedbacks else composed


def _observed(composed: Draft, change: dict[str, str]) -> Draft:
    return replace(composed, text=with_sensor(composed.text, change)) if change else composed


def _integration_steps(composed: Draft, path: Path) -> int:
    """Steps of the plant in a period of the current loop, enough for each guess in its range."""
    changes: list[Mapping[str, Any]] = [{}]
    changes += (change for guess in composed.guesses for change in guess.variants.values())
    return max(_steps(composed.tables, change, path) for change in changes)


def _steps(tables: dict[str, Any], change: Mapping[str, Any], path: Path) -> int:
    for key, value in change.items():
        put(tables, key, value)
    tables = with_datasheet(path, tables).tables
    (scenario,) = tables["scenario"].values()
    star = TypeAdapter(AnyMotor).validate_python(tables["motor"]).star()
    voltage = units.parse(tables["drive"]["inverter"]["bus_voltage"], units.VOLTAGE)
    most = OVERMODULATED * no_load_speed(voltage, star, star.psi_f)
    return steps_needed(
        star,
        Mechanics.model_validate(tables["mechanics"]),
        min(most, units.parse(scenario["reference"], units.ANGULAR_SPEED)),
        units.parse(tables["drive"]["rates"]["current_loop"], units.FREQUENCY),
    )


def slower_feedbacks(study: Study) -> Feedbacks:
    """Gains that the design advises where a sensor's edges come too rarely: controller -> kp and ki."""
    slower = {}
    for name in study.controller:
        remark = slow_warning(study, name)
        for change in remark.cures if remark is not None else ():
            table = change.get(f"controller.{name}")
            gains = table if isinstance(table, dict) else _gains_in(change, name)
            if "kp" in gains and "ki" in gains:
                slower[name] = (str(gains["kp"]), str(gains["ki"]))
                break
    return slower


def _gains_in(change: Mapping[str, Any], name: str) -> dict[str, Any]:
    begin = f"controller.{name}."
    return {key.removeprefix(begin): value for key, value in change.items() if key.startswith(begin)}


def _study(drafted: Draft, path: Path) -> Study:
    return cast(Study, checked(with_datasheet(path, drafted.tables)))


def turning_speed(study: Study) -> float | None:
    """The speed, r/min, from which on the rotor turns, if it snaps at the study's; None if it turns."""
    ((name, scenario),) = study.scenario.items()
    speeds = [0.0]
    for controller in study.controller:
        remark = slow_warning(study, controller)
        for change in remark.cures if remark is not None else ():
            reference = change.get(f"scenario.{name}.reference")
            if isinstance(reference, str):
                speeds.append(units.parse(reference, units.ANGULAR_SPEED))
    faster = max(speeds) / units.factor("rpm", units.ANGULAR_SPEED)
    most = VOLTAGE_SHARE * voltage_reach(study) / units.factor("rpm", units.ANGULAR_SPEED)
    if max(speeds) <= scenario.top_reference or faster > most:
        return None
    return min(
        up for up in (round_125(faster), round_125(1.5 * faster), round_125(2 * faster)) if up >= faster
    )


def _composed(request: Request, title: str, faster: float | None, steps: int, feedbacks: Feedbacks) -> Draft:
    """The study; `faster`: its speed, r/min, in place of the one that suits the cogging."""
    part = _class_of(request)
    drive = parts("drives")[request.drive]
    _check_fit(request, part, drive)
    sheet = Sheet()
    motor = _motor(sheet, request, part) if part.layouts else _step_motor(sheet, request, part)
    _mechanics(sheet, request, motor)
    sensor = parts("encoders")[request.encoder]
    voltage = _voltage(request, motor, drive)
    speed = _speed(request, motor, sensor, voltage.typical)
    if faster is not None:
        speed = faster, "the slowest at which the rotor does not snap from detent to detent"
    current_rate = _drive(sheet, request, motor, drive, voltage, steps)
    put_sensor(sheet, request, sensor, drive)
    rows = _scenario(sheet, request, motor, speed, current_rate, voltage.typical)
    _controllers(sheet, feedbacks)
    _metrics(sheet, motor, speed[0], rows)
    return Draft(text=sheet.file_text(_head(title, request)), guesses=tuple(sheet.guesses))


def _head(title: str, request: Request) -> list[str]:
    return [
        f"# By `cogless new`: motor {request.motor}, drive {request.drive}, encoder {request.encoder}.",
        '# A line with "guess:" has a range and a reason. Replace what you know.',
        f"title = {_quoted(title)}",
    ]


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _class_of(request: Request) -> Part:
    named = named_motors().get(request.motor)
    name = named["class"] if named else request.motor
    motors = parts("motors")
    if name not in motors:  # a shipped motor that the catalogue does not know
        name = "nema23" if _sheet_tables(request.motor).get("kind") == "step" else "own"
    return motors[name]


def _sheet_tables(name: str) -> dict[str, Any]:
    """The datasheet of a shipped motor; empty for a class."""
    path = shipped("motors").get(name)
    return tomllib.loads(path.read_text(encoding="utf-8")) if path else {}


def _check_fit(request: Request, part: Part, drive: Part) -> None:
    phases = 3 if part.layouts else 2
    if phases not in drive.table["phases"]:
        fitting = [name for name, other in parts("drives").items() if phases in other.table["phases"]]
        kind = "a step motor has two phases" if phases == 2 else "the motor has three phases"
        raise RequestError("drive", request.drive, f"expected one of {', '.join(fitting)}, since {kind}")
    wrong = (
        ("slots", "kv", "back-emf", "pole-pairs")
        if phases == 2
        else ("holding-torque", "detent-torque", "step-angle")
    )
    for name in wrong:
        if name in request.numbers:
            which = "three phases" if phases == 2 else "two phases, a step motor"
            raise RequestError(
                name, request.numbers[name].text, f"expected none, unless the motor has {which}"
            )


# the motor


def _motor(sheet: Sheet, request: Request, part: Part) -> MotorFacts:
    """A motor with three phases."""
    tables = _sheet_tables(request.motor)
    facts, named = _star(request, tables), named_motors().get(request.motor, {})
    size = sized(part, facts)
    section = sheet.section("[motor]")
    if tables:
        section.put("datasheet", request.motor)
    (slots, poles), others = _layout(request, part, tables)
    amplitudes = _amplitudes(request, part, size.torque, (slots, poles))
    cogs = "cogging" not in tables
    if "pole_pairs" not in tables:
        stated = "pole-pairs" in request.numbers
        section.put("pole_pairs", poles // 2, *(() if stated else (_pole_pairs_guess(others, part),)))
    if "slots" not in tables:
        stated = "slots" in request.numbers
        section.put("slots", slots, *(() if stated else (_slots_guess(others, named, poles),)))
    if others and cogs:
        sheet.guesses.append(_layout_variants(others, (slots, poles), amplitudes, request))
    _magnet(sheet, section, request, part, tables)
    _winding(sheet, section, request, part, tables, size)
    if cogs:
        _cogging(sheet, request, amplitudes, slots, poles)
        orders = cogging_orders(slots, poles)
        main, all_orders = orders["cogging"], tuple(orders.values())
    else:
        all_orders = tuple(wave["order"] for wave in tables["cogging"])
        main = all_orders[0]
    return MotorFacts(
        part=part,
        size=size,
        phases=3,
        pole_pairs=poles // 2,
        main_order=main,
        orders=all_orders,
        limit=size.current,
        limit_is_guess=not {"rated-current", "rated-torque"} & request.numbers.keys(),
        limit_reason=named.get("guess") or part["rated_torque"].reason,
    )


def _star(request: Request, tables: Mapping[str, Any]) -> Known:
    """What request and datasheet tell of a motor with three phases."""
    constant = request.value("torque-constant")
    if (kv := request.value("kv")) is not None:
        constant = KV_TO_TORQUE / kv
    if (emf := request.value("back-emf")) is not None:
        constant = math.sqrt(1.5) * emf
    between = request.value("resistance")
    resistance = None if between is None else between / 2
    named = named_motors().get(request.motor, {})
    current = request.value("rated-current")
    if tables:
        star: StarMotor = TypeAdapter(AnyMotor).validate_python(dict(tables)).star()
        constant = constant or star.K_t
        resistance = resistance or star.R_s
        current = current or units.parse(named["rated_current"], units.CURRENT)
    torque = request.value("rated-torque")
    if constant is None and torque and current:
        constant = torque / current
    return Known(torque_constant=constant, resistance=resistance, torque=torque, current=current)


def _layout(
    request: Request, part: Part, tables: Mapping[str, Any]
) -> tuple[tuple[int, int], list[tuple[int, int]]]:
    """Slots and poles, and others that the motor may have as well; none if its slots are stated."""
    named = named_motors().get(request.motor, {})
    pole_pairs = int(request.value("pole-pairs") or tables.get("pole_pairs") or 0)
    slots = int(request.value("slots") or tables.get("slots") or named.get("slots") or 0)
    first, *others = layouts_for(part, pole_pairs or None)
    if not slots:
        return first, others[:OTHER_LAYOUTS]
    poles = next((p for s, p in part.layouts if s == slots), first[1])
    return (slots, 2 * pole_pairs or poles), []


def _pole_pairs_guess(others: list[tuple[int, int]], part: Part) -> str:
    also = " or ".join(str(poles // 2) for _, poles in others) or "another number"
    table = part.table["layouts"]
    return f"guess: or {also}; {table.get('source') or table['guess']}"


def _slots_guess(others: list[tuple[int, int]], named: Mapping[str, Any], poles: int) -> str:
    if named.get("slots"):
        return f"guess: or another number that fits {poles} poles; as in the study of this motor"
    also = " or ".join(str(slots) for slots, _ in others) or "another number"
    return f"guess: or {also}; a winding that is balanced with its poles, as most motors have"


def _magnet(sheet: Sheet, section: Section, request: Request, part: Part, tables: Mapping[str, Any]) -> None:
    words = [name for name in MAGNET_WORDS if name in request.numbers]
    for name in words:
        section.put(MAGNET_WORDS[name], request.numbers[name].text)
    if words or tables:
        return
    torque, current = request.numbers.get("rated-torque"), request.numbers.get("rated-current")
    if torque and current:
        text = amount(torque.value / current.value, units.TORQUE_CONSTANT)
        section.put("K_t", text, note="rated torque over rated current")
        return
    sheet.guess(section, "kv", part["kv"], units.SPEED_CONSTANT, path="motor", name="speed per volt")


def _winding(
    sheet: Sheet,
    section: Section,
    request: Request,
    part: Part,
    tables: Mapping[str, Any],
    size: Sized,
) -> None:
    """Resistance and inductance, between two terminals."""
    for key, name, factor, dimension in (
        ("resistance_line_to_line", "resistance", size.resistance_factor, units.RESISTANCE),
        ("inductance_line_to_line", "inductance", size.inductance_factor, units.INDUCTANCE),
    ):
        if name in request.numbers:
            section.put(key, request.numbers[name].text)
        elif not tables:
            figure = _adapted(part[name].scaled(2 * factor), _same_size(factor))
            if name == "inductance" and "resistance" in request.numbers:
                ratio = size.time_factor / part["resistance"].typical
                figure = part[name].scaled(ratio * request.numbers["resistance"].value)
                figure = because(figure, "L / R of the class, scaled by the torque to the power 2/3")
            sheet.guess(section, key, figure, dimension, path="motor", name=f"{name} between two terminals")


def _same_size(factor: float) -> bool:
    return math.isclose(factor, 1.0, rel_tol=1e-6)


def _adapted(figure: Figure, same: bool) -> Figure:
    return figure if same else because(figure, f"the class's ({figure.reason}), scaled to this motor's size")


def _amplitudes(request: Request, part: Part, torque: float, layout: tuple[int, int]) -> dict[str, Figure]:
    """Amplitudes of the parts of the cogging, N*m; what is stated of the main one scales the others."""
    cogging = request.value("cogging")
    shares = {key: part[key] for key in ("cogging", "slot_cogging", "pole_cogging") if key in part.figures}
    factor = math.gcd(*layout) / math.gcd(*part.layouts[0])
    if factor != 1:
        slots, poles = layout
        reason = (
            f"{shares['cogging'].reason}; scaled by the common divisor of {slots} slots and {poles} poles"
        )
        shares["cogging"] = because(shares["cogging"].scaled(factor), reason)
    if cogging is None:
        return {key: _share(figure, torque) for key, figure in shares.items()}
    ratio = cogging / part["cogging"].typical
    others = {key: figure.scaled(ratio) for key, figure in shares.items() if key != "cogging"}
    return {
        "cogging": Figure(typical=cogging, low=cogging, high=cogging, reason="", is_guess=False),
        **{
            key: because(figure, f"{figure.reason}; its share of the main order")
            for key, figure in others.items()
        },
    }


def _share(figure: Figure, torque: float) -> Figure:
    low, high = (f"{100 * end:.3g}" for end in (figure.low, figure.high))
    reason = f"{low} to {high} % of {amount(torque, units.TORQUE)}: {figure.reason}"
    return because(figure.scaled(torque), reason)


def _cogging(
    sheet: Sheet, request: Request, amplitudes: Mapping[str, Figure], slots: int, poles: int
) -> None:
    why = {
        "cogging": f"least common multiple of {slots} slots and {poles} poles",
        "slot_cogging": "the slots: what uneven magnets add",
        "pole_cogging": "the poles: what uneven slots add",
    }
    for place, (key, order) in enumerate(cogging_orders(slots, poles).items()):
        section = sheet.section("[[motor.cogging]]")
        section.put("order", order, note=why[key])
        figure = amplitudes[key]
        if key == "cogging" and "cogging" in request.numbers:
            section.put("torque", request.numbers["cogging"].text)
        elif figure.typical == 0:
            section.put("torque", "0 N*m")
        else:
            path = f"motor.cogging.{place}"
            name = f"cogging, {order} waves a turn"
            sheet.guess(section, "torque", figure, units.TORQUE, path=path, name=name)
        if place:
            section.put("phase", (SLOT_PHASE, POLE_PHASE)[place - 1], note="any")


def _layout_variants(
    others: list[tuple[int, int]],
    layout: tuple[int, int],
    amplitudes: Mapping[str, Figure],
    request: Request,
) -> Guess:
    """The same motor with other slots, or with other slots and poles, than those of `layout`."""
    variants = {}
    for slots, poles in others:
        factor = 1.0 if "cogging" in request.numbers else math.gcd(slots, poles) / math.gcd(*layout)
        waves = [
            {
                "order": order,
                "torque": amount((1.0 if place else factor) * amplitudes[key].typical, units.TORQUE),
                **_phase(place),
            }
            for place, (key, order) in enumerate(cogging_orders(slots, poles).items())
        ]
        change: dict[str, Any] = {"motor.slots": slots, "motor.cogging": waves}
        label = f"{slots} slots"
        if "pole-pairs" not in request.numbers:
            change["motor.pole_pairs"] = poles // 2
            label += f" and {poles} poles"
        variants[label] = change
    return Guess(key="motor.slots", name="number of slots", span=" or ".join(variants), variants=variants)


def _phase(place: int) -> dict[str, str]:
    return {"phase": (SLOT_PHASE, POLE_PHASE)[place - 1]} if place else {}


def _step_motor(sheet: Sheet, request: Request, part: Part) -> MotorFacts:
    """A step motor, by what holds it and what its magnets hold without current."""
    tables = _sheet_tables(request.motor)
    section = sheet.section("[motor]")
    named = named_motors().get(request.motor, {})
    resistance = request.value("resistance")
    holding = request.value("holding-torque") or request.value("rated-torque")
    coil = request.value("rated-current")
    if tables:
        section.put("datasheet", request.motor)
        star = TypeAdapter(AnyMotor).validate_python(dict(tables)).star()
        coil = coil or units.parse(named.get("rated_current", "1 A"), units.CURRENT)
        constant = star.K_t
        size = sized(part, Known(torque_constant=constant, current=peak_of_coil(coil)))
        teeth = int(tables["teeth"])
        return _step_facts(request, part, size, teeth)
    section.put("kind", "step")
    angle = request.value("step-angle") or part["step_angle"].typical
    teeth = round(math.tau / (STEPS_IN_A_PERIOD * angle))
    if not math.isclose(teeth * STEPS_IN_A_PERIOD * angle, math.tau, rel_tol=1e-6) or not 1 <= teeth <= 1000:
        text = request.numbers["step-angle"].text
        raise RequestError("step-angle", text, "expected 360 deg over four times the teeth, such as 1.8 deg")
    stated = "step-angle" in request.numbers
    reason = () if stated else (f"guess: or 100, of 0.9 deg; {part['step_angle'].reason}",)
    section.put("teeth", teeth, *reason, note="of the rotor: 360 deg / (4 full steps)")
    usual = part["rated_current"].typical
    holding_figure, coil_value = part["rated_torque"], coil or usual
    holding_value = holding or holding_figure.typical
    size = sized(
        part,
        Known(
            torque_constant=holding_value / peak_of_coil(coil_value),
            torque=holding_value,
            current=peak_of_coil(coil_value),
        ),
    )
    for key, name, factor in (
        ("R_s", "resistance", size.resistance_factor),
        ("L_0", "inductance", size.inductance_factor),
    ):
        dimension = units.RESISTANCE if name == "resistance" else units.INDUCTANCE
        if name in request.numbers:
            section.put(key, request.numbers[name].text)
        else:
            figure = _adapted(part[name].scaled(factor), _same_size(factor))
            if name == "inductance" and resistance:
                ratio = part["inductance"].scaled(resistance / part["resistance"].typical)
                figure = because(ratio.scaled(size.time_factor), "L / R of the class, scaled")
            sheet.guess(section, key, figure, dimension, path="motor", name=f"{name} of a coil")
    section.put("i_f", "1 A", note="by definition: K_t = teeth i_f L_m1")
    _flux(sheet, section, request, part, teeth, coil)
    _detent(sheet, section, request, part, size, teeth)
    return _step_facts(request, part, size, teeth)


def _flux(
    sheet: Sheet, section: Section, request: Request, part: Part, teeth: int, coil: float | None
) -> None:
    """L_m1 from the holding torque and the rated current of a coil."""
    stated = "holding-torque" in request.numbers or "rated-torque" in request.numbers
    holding = request.value("holding-torque") or request.value("rated-torque")
    torque = part["rated_torque"]
    current = coil or part["rated_current"].typical

    def flux(value: float) -> str:
        return amount(value / peak_of_coil(current) / teeth, units.INDUCTANCE, "mH", 4)

    typical = holding or torque.typical
    formula = "holding torque / (1.414 rated current teeth)"
    if stated:
        section.put("L_m", [flux(typical)], note=formula)
        return
    ends = f"{flux(torque.low)} to {flux(torque.high)}, for a holding torque of"
    ends_text = f"{amount(torque.low, units.TORQUE)} to {amount(torque.high, units.TORQUE)}"
    section.put("L_m", [flux(typical)], f"guess: {ends} {ends_text}; {torque.reason}", note=formula)
    variants = {amount(end, units.TORQUE): {"motor.L_m": [flux(end)]} for end in (torque.low, torque.high)}
    sheet.guesses.append(Guess(key="motor.L_m", name="holding torque", span=ends_text, variants=variants))


def _detent(sheet: Sheet, section: Section, request: Request, part: Part, size: Sized, teeth: int) -> None:
    """L_f4: amplitude of the detent is 2 teeth i_f^2 L_f4."""
    detent, own = request.value("detent-torque"), request.value("cogging")
    figure = part["cogging"].scaled(size.torque)

    def coefficient(torque: float) -> str:
        return amount(torque / (2 * teeth), units.INDUCTANCE, "uH", 4)

    formula = "amplitude of the detent / (2 teeth)"
    if own is not None:
        section.put("L_f", [coefficient(own)], note=formula)
        return
    if detent is not None:
        friction = request.value("friction")
        share = detent - (friction if friction is not None else _detent_friction(part, detent).typical)
        text = "the datasheet's torque less the friction in it"
        section.put("L_f", [coefficient(max(share, 0.0))], note=f"{formula}; {text}")
        return
    ends_text = f"{amount(figure.low, units.TORQUE)} to {amount(figure.high, units.TORQUE)}"
    ends = f"{coefficient(figure.low)} to {coefficient(figure.high)}, for an amplitude of {ends_text}"
    section.put("L_f", [coefficient(figure.typical)], f"guess: {ends}; {figure.reason}", note=formula)
    variants = {
        amount(end, units.TORQUE): {"motor.L_f": [coefficient(end)]} for end in (figure.low, figure.high)
    }
    sheet.guesses.append(Guess(key="motor.L_f", name="detent torque", span=ends_text, variants=variants))


def _detent_friction(part: Part, detent: float) -> Figure:
    """The friction within a datasheet's detent torque: in the class's proportion."""
    friction, cogging = part["friction"], part["cogging"]
    share = friction.typical / (friction.typical + cogging.typical)
    ends = (share / 2, min(0.9, 1.5 * share))
    reason = "its part of what turns the motor without current, as in the class"
    return Figure(
        typical=share * detent, low=ends[0] * detent, high=ends[1] * detent, reason=reason, is_guess=True
    )


def _step_facts(request: Request, part: Part, size: Sized, teeth: int) -> MotorFacts:
    main = DETENT_ORDER * teeth
    return MotorFacts(
        part=part,
        size=size,
        phases=2,
        pole_pairs=teeth,
        main_order=main,
        orders=(main,),
        limit=size.current,
        limit_is_guess="rated-current" not in request.numbers,
        limit_reason=part["rated_torque"].reason,
    )


# mechanics


def _mechanics(sheet: Sheet, request: Request, motor: MotorFacts) -> None:
    section = sheet.section("[mechanics]")
    part, size = motor.part, motor.size
    if "inertia" in request.numbers:
        section.put("inertia", request.numbers["inertia"].text)
    else:
        rotor = _adapted(part["inertia"].scaled(size.inertia_factor), _same_size(size.inertia_factor))
        load = request.value("load-inertia")
        with_load = Figure(
            typical=rotor.typical + (load or 0.0),
            low=rotor.low + (load or 0.0),
            high=rotor.high + load if load is not None else LOAD_FACTOR * rotor.high,
            reason=f"the rotor {'without a load' if load is None else 'and your load'}: {rotor.reason}",
            is_guess=True,
        )
        sheet.guess(section, "inertia", with_load, units.INERTIA, path="mechanics", name="inertia")
    if "friction" in request.numbers:
        section.put("coulomb_friction", request.numbers["friction"].text)
    else:
        detent = request.value("detent-torque")
        friction = _share(part["friction"], size.torque) if detent is None else _detent_friction(part, detent)
        sheet.guess(section, "coulomb_friction", friction, units.TORQUE, path="mechanics", name="friction")
    if request.value("load"):
        section.put_text("load", f'{{ torque = "{request.numbers["load"].text}" }}')


# the drive


def _voltage(request: Request, motor: MotorFacts, drive: Part) -> Figure:
    """The bus voltage: as stated, or the class's within what the drive bears."""
    stated = request.value("bus-voltage")
    bears = drive["voltage"]
    if stated is not None:
        if not bears.low <= stated <= bears.high:
            text = request.numbers["bus-voltage"].text
            within = f"expected {bears.low:g} to {bears.high:g} V, which {request.drive} bears"
            raise RequestError("bus-voltage", text, within)
        return Figure(typical=stated, low=stated, high=stated, reason="", is_guess=False)
    usual = motor.part["bus_voltage"]
    typical, low, high = (min(max(v, bears.low), bears.high) for v in (usual.typical, usual.low, usual.high))
    return Figure(typical=typical, low=low, high=high, reason=usual.reason, is_guess=True)


def _speed(request: Request, motor: MotorFacts, sensor: Part, voltage: float) -> tuple[float, str]:
    """The scenario's speed, r/min, and why it was chosen; "" if it was stated."""
    if "speed" in request.numbers:
        return request.numbers["speed"].value / units.factor("rpm", units.ANGULAR_SPEED), ""
    cogs = 60 * COGGING_FREQUENCY / motor.main_order
    if sensor.table["kind"] == "hall":
        seen = 60 * HALL_EDGES_PER_SECOND / (6 * motor.pole_pairs)
    else:
        seen = 60 * COUNTS_PER_SECOND / sensor_counts(request, sensor)
    speed = max(round_125(cogs), round_125(seen))
    reach = _reach(motor, voltage)
    reason = f"slow: the main cogging order comes {motor.main_order * speed / 60:.3g} times a second"
    return min(speed, round_125(VOLTAGE_SHARE * reach)), reason


def _reach(motor: MotorFacts, voltage: float) -> float:
    """The speed without load at a bus voltage, r/min."""
    factor = KV_TO_TORQUE if motor.phases == 3 else 1.0
    return 60 / math.tau * factor * voltage / motor.size.torque_constant


def _drive(
    sheet: Sheet, request: Request, motor: MotorFacts, drive: Part, voltage: Figure, steps: int
) -> float:
    """Rates, current loop, inverter and current sensors; returns the current loop's rate, Hz."""
    current_rate, speed_rate = _rates(request, drive)
    section = sheet.section("[drive.rates]")
    for key, flag, rate in (
        ("current_loop", "current-rate", current_rate),
        ("speed_loop", "speed-rate", speed_rate),
    ):
        stated = flag in request.numbers or "current-rate" in request.numbers
        section.put(key, exact_rate(rate), *(() if stated else (origin(drive[key]),)))
    if steps > 1:
        section.put("integration_steps", steps, note="the winding's current changes fast")

    section = sheet.section("[drive.current_loop]")
    bandwidth = current_rate * BANDWIDTH_SHARE
    section.put("bandwidth", f"{bandwidth:.4g} Hz", note="a 25th of the current loop's rate")
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
    what = "what the motor bears all day"
    if not motor.limit_is_guess:
        section.put("current_limit", amount(motor.limit, units.CURRENT), note=what)
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
    """Periods of the current loop in one of the speed loop, about SPEED_PERIODS, which divide the rate."""
    least = math.ceil(rate / SPEED_RATE_MOST)
    fitting = [n for n in range(least, 41) if rate % n == 0]
    return min(fitting or [1], key=lambda n: abs(math.log(n / SPEED_PERIODS)))


# scenario, controllers, metrics


def _scenario(
    sheet: Sheet,
    request: Request,
    motor: MotorFacts,
    speed: tuple[float, str],
    current_rate: float,
    voltage: float,
) -> float:
    """Trace and scenario; returns the trace's rows a second."""
    rpm, reason = speed
    duration = _duration(rpm)
    section = sheet.section("[trace]")
    fastest = motor.main_order * rpm / 60
    rate = _trace_rate(int(current_rate), duration, fastest)
    section.put("rate", exact_rate(rate))
    section = sheet.section("[scenario.slow]")
    section.put("duration", f"{duration:g} s")
    text = request.numbers["speed"].text if "speed" in request.numbers else f"{rpm:.6g} rpm"
    section.put("reference", text, *((reason,) if reason else ()))
    if rpm < _reach(motor, voltage):
        section.put("initial_speed", text)
    return rate


def _duration(rpm: float) -> float:
    turns = RUN_TURNS * 60 / rpm
    return float(math.ceil(min(max(SHORTEST_RUN, turns), LONGEST_RUN)))


def _trace_rate(rate: int, duration: float, fastest: float) -> float:
    """Rows a second, Hz: a divisor of the current loop's rate, enough for an order of `fastest`, Hz."""
    most, least = min(TRACE_RATE_MOST, ROWS_MOST / duration), max(TRACE_RATE_LEAST, ROWS_IN_WAVE * fastest)
    rates = [rate // n for n in range(1, rate + 1) if rate % n == 0]
    few = next((rate for rate in rates if rate <= most), rates[-1])
    return few if few >= least else min((rate for rate in rates if rate >= least), default=rates[0])


def _controllers(sheet: Sheet, feedbacks: Feedbacks) -> None:
    pi = sheet.section("[controller.pi]")
    pi.put("law", "pi")
    pi.put("label", "PI")
    pi.put("baseline", True)
    learner = sheet.section("[controller.harmonic]")
    learner.put("law", "harmonic")
    learner.put("label", "PI and harmonics")
    rules = {"pi": '{ rule = "phase-margin", phase_margin = "60 deg" }', "harmonic": '{ rule = "auto" }'}
    for name, section in (("pi", pi), ("harmonic", learner)):
        if name in feedbacks:
            kp, ki = feedbacks[name]
            section.put("kp", kp, "slower than by the rule, since the sensor's edges come rarely")
            section.put("ki", ki)
        else:
            section.put_text("tuning", rules[name])


def _metrics(sheet: Sheet, motor: MotorFacts, rpm: float, rows: float) -> None:
    duration, turn = _duration(rpm), 60 / rpm
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
        section = _metric(sheet, "speed_order", "order", "omega_m", last)
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
