"""The sections of a study that describe the motor, and what the other sections need of it."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

from cogless import units
from cogless.files import shipped
from cogless.starter.amounts import amount, digits, span
from cogless.starter.motor_rules import (
    COGGING_PHASES,
    KV_TO_TORQUE,
    Known,
    Sized,
    cogging_orders,
    half_peak_to_peak,
    layouts_for,
    peak_of_coil,
    sized,
)
from cogless.starter.part_catalogue import Figure, Part, named_motors, parts
from cogless.starter.request import Answer, Request, RequestError
from cogless.starter.sheet import Guess, Section, Sheet, because
from cogless.study.motor import AnyMotor, StarMotor, teeth_of

LOAD_FACTOR = 3.0  # inertia with a load that nobody stated / that of the rotor, at most
OTHER_LAYOUTS = 3  # other layouts that the study tries, at most
# Answers on the magnet -> functions from the answer to K_t, and from K_t to the answer, all SI.
MAGNET_CONSTANTS: dict[str, tuple[Callable[[float], float], Callable[[float], float]]] = {
    "torque-constant": (lambda constant: constant, lambda constant: constant),
    "kv": (lambda kv: KV_TO_TORQUE / kv, lambda constant: KV_TO_TORQUE / constant),
    "back-emf": (lambda emf: math.sqrt(1.5) * emf, lambda constant: constant / math.sqrt(1.5)),
}
MAGNET_WORDS = {"kv": "kv", "torque-constant": "K_t", "back-emf": "K_e_line_to_line_rms"}
TORQUE_DIGITS = 4  # digits of the torque of a part of the cogging
DETENT_ORDER = 4  # electrical order of the detent torque of a step motor with two phases


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

    def reach(self, voltage: float) -> float:
        """The speed without load at a bus voltage, rad/s."""
        return (KV_TO_TORQUE if self.phases == 3 else 1.0) * voltage / self.size.torque_constant


def class_of(request: Request) -> Part:
    named = named_motors().get(request.motor)
    name = named["class"] if named else request.motor
    motors = parts("motors")
    if name not in motors:  # a shipped motor that the catalogue does not know
        name = "nema23" if datasheet_tables(request.motor).get("kind") == "step" else "own"
    return motors[name]


def datasheet_tables(name: str) -> dict[str, Any]:
    """The datasheet of a shipped motor; empty for a class."""
    path = shipped("motors").get(name)
    return tomllib.loads(path.read_text(encoding="utf-8")) if path else {}


def put_motor(sheet: Sheet, request: Request, part: Part) -> MotorFacts:
    """Write the sections of a motor with three phases, and return its facts."""
    tables = datasheet_tables(request.motor)
    facts, named = _star(request, tables), named_motors().get(request.motor, {})
    size = sized(part, facts)
    section = sheet.section("[motor]")
    if tables:
        section.put("datasheet", request.motor)
    (slots, poles), others = _layout(request, part, tables)
    amplitudes = _amplitudes(request, part, size.torque, (slots, poles))
    cogs = "cogging" not in tables
    if "pole_pairs" not in tables or "pole-pairs" in request.numbers:
        stated = "pole-pairs" in request.numbers
        section.put("pole_pairs", poles // 2, *(() if stated else (_pole_pairs_guess(others, poles, part),)))
    if "slots" not in tables or "slots" in request.numbers:
        stated = "slots" in request.numbers
        section.put("slots", slots, *(() if stated else (_slots_guess(others, named, slots),)))
    if others and cogs:
        sheet.guesses.append(_layout_variants(others, (slots, poles), part, amplitudes, request))
    _magnet(sheet, section, request, part, tables)
    _winding(sheet, section, request, part, tables, size)
    if cogs:
        _cogging(sheet, request, part, amplitudes, (slots, poles))
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
        limit_reason=_limit_reason(request) or named.get("guess") or part["rated_torque"].reason,
    )


def _limit_reason(request: Request) -> str:
    """How the continuous current of a motor with three phases follows from the answers; "" if it does not."""
    if "rated-current" in request.numbers:
        return "the rated current, a peak value of a phase"
    return "rated torque over torque constant" if "rated-torque" in request.numbers else ""


def _star(request: Request, tables: Mapping[str, Any]) -> Known:
    """What the request and the datasheet say of a motor with three phases."""
    stated = [
        of(request.numbers[word].value)
        for word, (of, _) in MAGNET_CONSTANTS.items()
        if word in request.numbers
    ]
    constant = stated[0] if stated else None
    between = request.between_terminals("resistance")
    resistance = None if between is None else between.value / 2
    named = named_motors().get(request.motor, {})
    current, torque = request.value("rated-current"), request.value("rated-torque")
    if tables:
        star: StarMotor = TypeAdapter(AnyMotor).validate_python(dict(tables)).star()
        constant = constant or star.K_t
        resistance = resistance or star.R_s
        if current is None and torque is None:
            current = units.parse(named["rated_current"], units.CURRENT)
    if constant is None and torque and current:
        constant = torque / current
    return Known(torque_constant=constant, resistance=resistance, torque=torque, current=current)


def _layout(
    request: Request, part: Part, tables: Mapping[str, Any]
) -> tuple[tuple[int, int], list[tuple[int, int]]]:
    """Slots and poles, and other such pairs that the motor may have; no others if its slots are known.

    The slots of a shipped motor are a guess, too, unless its datasheet has them.
    """
    named = named_motors().get(request.motor, {})
    pole_pairs = int(request.value("pole-pairs") or tables.get("pole_pairs") or 0)
    slots = int(request.value("slots") or tables.get("slots") or named.get("slots") or 0)
    first, *others = layouts_for(part, pole_pairs or None)
    if not slots:
        return first, others[:OTHER_LAYOUTS]
    poles = next((p for s, p in part.layouts if s == slots), first[1])
    layout = slots, 2 * pole_pairs or poles
    if "slots" in request.numbers or "slots" in tables:
        return layout, []
    return layout, [other for other in (first, *others) if other != layout][:OTHER_LAYOUTS]


def _pole_pairs_guess(others: list[tuple[int, int]], poles: int, part: Part) -> str:
    other_pole_pairs = _alternatives([other // 2 for _, other in others], poles // 2)
    table = part.table["layouts"]
    return f"guess: {other_pole_pairs} is possible, too; {table.get('source') or table['guess']}"


def _slots_guess(others: list[tuple[int, int]], named: Mapping[str, Any], slots: int) -> str:
    other_slots = _alternatives([other for other, _ in others], slots)
    if named.get("slots"):
        return f"guess: {other_slots} is possible, too; the shipped study of this motor has {slots}"
    equal = f"with {slots} slots the phases are equal, as in most motors"
    return f"guess: {other_slots} is possible, too; {equal}"


def _alternatives(numbers: list[int], chosen: int) -> str:
    """Other numbers than the one that is chosen, as in "15, 20 or 23"."""
    *first, last = dict.fromkeys(str(n) for n in numbers if n != chosen) or ["another number"]
    return f"{', '.join(first)} or {last}" if first else last


def _magnet(sheet: Sheet, section: Section, request: Request, part: Part, tables: Mapping[str, Any]) -> None:
    words = [name for name in MAGNET_WORDS if name in request.numbers]
    for name in words:
        section.put(MAGNET_WORDS[name], request.numbers[name].text)
    if len(words) == 1:
        sheet.remarks.append(_magnet_remark(words[0], request.numbers[words[0]]))
    if words or tables:
        return
    torque, current = request.numbers.get("rated-torque"), request.numbers.get("rated-current")
    if torque and current:
        text = amount(torque.value / current.value, units.TORQUE_CONSTANT)
        section.put("K_t", text, note="rated torque over rated current")
        return
    sheet.guess(section, "kv", part["kv"], units.SPEED_CONSTANT, path="motor", name="speed per volt")


def _magnet_remark(word: str, answer: Answer) -> str:
    """The other constants of the magnet that follow from the one that is given."""
    to_torque, _ = MAGNET_CONSTANTS[word]
    constant = to_torque(answer.value)
    kv = units.convert(KV_TO_TORQUE / constant, "rpm/V", units.SPEED_CONSTANT)
    torque = f"torque constant {amount(constant, units.TORQUE_CONSTANT)} (per ampere of a phase, peak)"
    speed = f"Kv {digits(kv)} r/min per V"
    follow = {"kv": [torque], "torque-constant": [speed]}.get(word, [torque, speed])
    return f"--{word} {answer.text}: {', '.join(follow)}."


def _winding(
    sheet: Sheet,
    section: Section,
    request: Request,
    part: Part,
    tables: Mapping[str, Any],
    size: Sized,
) -> None:
    """Write resistance and inductance between two terminals."""
    stated = []
    for key, name, factor, dimension in (
        ("resistance_line_to_line", "resistance", size.resistance_factor, units.RESISTANCE),
        ("inductance_line_to_line", "inductance", size.inductance_factor, units.INDUCTANCE),
    ):
        if (between := request.between_terminals(name)) is not None:
            of_a_phase = amount(between.value / 2, dimension)
            section.put(key, between.text, note=f"{of_a_phase} per phase")
            stated.append(f"{between.text} between two terminals = {of_a_phase} per phase")
        elif not tables:
            figure = adapted(part[name].scaled(2 * factor), is_same_size(factor))
            resistance = request.between_terminals("resistance")
            if name == "inductance" and resistance is not None:
                ratio = size.time_factor / part["resistance"].typical
                figure = part[name].scaled(ratio * resistance.value)
                figure = because(
                    figure, "usual L / R of this class of motors, times (torque / usual torque)^(2/3)"
                )
            sheet.guess(section, key, figure, dimension, path="motor", name=f"{name} between two terminals")
    if stated:
        sheet.remarks.append(f"Winding: {'; '.join(stated)}.")


def is_same_size(factor: float) -> bool:
    return math.isclose(factor, 1.0, rel_tol=1e-6)


def adapted(figure: Figure, same: bool) -> Figure:
    return (
        figure
        if same
        else because(figure, f"usual in this class of motors ({figure.reason}), scaled to this motor's size")
    )


def _shares(part: Part, layout: tuple[int, int]) -> dict[str, Figure]:
    """The parts of a layout's cogging, as shares of the rated torque."""
    shares = {key: part[key] for key in COGGING_PHASES if key in part.figures}
    factor = math.gcd(*layout) / math.gcd(*part.layouts[0])
    if factor != 1:
        slots, poles = layout
        divisor = f"the greatest common divisor of {slots} slots and {poles} poles"
        reason = f"{shares['cogging'].reason}; in proportion to {divisor}"
        shares["cogging"] = because(shares["cogging"].scaled(factor), reason)
    return shares


def _amplitudes(request: Request, part: Part, torque: float, layout: tuple[int, int]) -> dict[str, Figure]:
    """Amplitudes of the parts of the cogging, N*m.

    A stated cogging is half of peak to peak of the sum of all parts. It is split in the proportions of the
    class. The class gives a range for each share of the orders that tolerances cause. Splits with the least
    and with the largest of these shares give the range of each amplitude.
    """
    total, shares = request.value("cogging"), _shares(part, layout)
    if total is None:
        return {key: share_of(figure, torque) for key, figure in shares.items()}
    splits = [_split(total, shares, layout, end) for end in ("typical", "low", "high")]
    text = request.numbers["cogging"].text
    reason = (
        f"{text} is half of peak to peak of all orders together; this order has the share that is usual in "
        "this class of motors"
    )
    return {
        key: Figure(
            typical=splits[0][key],
            low=min(split[key] for split in splits),
            high=max(split[key] for split in splits),
            reason=reason,
            is_guess=True,
        )
        for key in splits[0]
    }


def _split(total: float, shares: Mapping[str, Figure], layout: tuple[int, int], end: str) -> dict[str, float]:
    """Amplitudes of a cogging's parts, N*m. The sum of the parts has `total` as its half of peak to peak.

    `end`: which value of the shares that tolerances cause: "low", "typical" or "high".
    """
    orders = cogging_orders(*layout)
    ratios = {key: getattr(shares[key], "typical" if key == "cogging" else end) for key in orders}
    scale = total / half_peak_to_peak(ratios, orders)
    return {key: scale * ratio for key, ratio in ratios.items()}


def share_of(figure: Figure, torque: float) -> Figure:
    low, high = (f"{100 * end:.3g}" for end in (figure.low, figure.high))
    reason = f"{low} to {high} % of the rated torque {amount(torque, units.TORQUE)}: {figure.reason}"
    return because(figure.scaled(torque), reason)


def _cogging(
    sheet: Sheet, request: Request, part: Part, amplitudes: Mapping[str, Figure], layout: tuple[int, int]
) -> None:
    slots, poles = layout
    why = {
        "cogging": f"least common multiple of {slots} slots and {poles} poles",
        "slot_cogging": "the number of slots: what uneven magnets add",
        "pole_cogging": "the number of poles: what uneven slots add",
    }
    is_stated, orders = "cogging" in request.numbers, cogging_orders(slots, poles)
    for place, (key, order) in enumerate(orders.items()):
        section = sheet.section("[[motor.cogging]]")
        section.put("order", order, note=why[key])
        figure = amplitudes[key]
        if figure.typical == 0:
            section.put("torque", "0 N*m")
        elif is_stated:
            text = span(figure.low, figure.high, units.TORQUE)
            section.put("torque", _torque_text(figure.typical), f"guess: {text}; {figure.reason}")
        else:
            path = f"motor.cogging.{place}"
            name = f"cogging, {order} waves a turn"
            sheet.guess(section, "torque", figure, units.TORQUE, path=path, name=name)
        if place:
            section.put("phase", _phase(key), note="arbitrary")
    if not is_stated:
        torques = {key: figure.typical for key, figure in amplitudes.items()}
        sheet.answers["cogging"] = amount(half_peak_to_peak(torques, orders), units.TORQUE)
    if is_stated and amplitudes["cogging"].typical:
        sheet.guesses.append(_split_variants(request, part, amplitudes["cogging"], layout))
        parts_text = ", ".join(
            f"{amount(amplitudes[key].typical, units.TORQUE)} of order {order}"
            for key, order in orders.items()
        )
        total = request.numbers["cogging"].text
        sheet.remarks.append(f"Cogging: {total}, half of peak to peak of the sum of {parts_text}.")


def _torque_text(torque: float) -> str:
    return amount(torque, units.TORQUE, count=TORQUE_DIGITS)


def _phase(key: str) -> str:
    return f"{COGGING_PHASES[key]:g} deg"


def _waves(torques: Mapping[str, float], layout: tuple[int, int]) -> list[dict[str, Any]]:
    """The parts of a cogging as the study has them. `torques`: amplitudes, N*m."""
    return [
        {
            "order": order,
            "torque": _torque_text(torques[key]),
            **({"phase": _phase(key)} if place else {}),
        }
        for place, (key, order) in enumerate(cogging_orders(*layout).items())
    ]


def _split_variants(request: Request, part: Part, main: Figure, layout: tuple[int, int]) -> Guess:
    """A guess with two variants: the same cogging in all, with more and with less of it in the main order."""
    shares, total = _shares(part, layout), request.numbers["cogging"].value
    variants = {
        label: {"motor.cogging": _waves(_split(total, shares, layout, end), layout)}
        for label, end in (("even magnets and slots", "low"), ("uneven magnets and slots", "high"))
    }
    return Guess(
        key="motor.cogging.0.torque",
        name=f"part of the cogging with {cogging_orders(*layout)['cogging']} waves a turn",
        span=span(main.low, main.high, units.TORQUE),
        variants=variants,
    )


def _layout_variants(
    others: list[tuple[int, int]],
    layout: tuple[int, int],
    part: Part,
    amplitudes: Mapping[str, Figure],
    request: Request,
) -> Guess:
    """A guess with variants: the motor with other slots than `layout`, or with other slots and poles."""
    variants, total = {}, request.value("cogging")
    for slots, poles in others:
        if total is None:
            torques = {key: figure.typical for key, figure in amplitudes.items()}
            torques["cogging"] *= math.gcd(slots, poles) / math.gcd(*layout)
        else:
            torques = _split(total, _shares(part, (slots, poles)), (slots, poles), "typical")
        change: dict[str, Any] = {"motor.slots": slots, "motor.cogging": _waves(torques, (slots, poles))}
        label = f"{slots} slots"
        if poles != layout[1]:
            change["motor.pole_pairs"] = poles // 2
            label += f" and {poles} poles"
        variants[label] = change
    instead = f"{' or '.join(variants)} in place of {layout[0]}"
    return Guess(key="motor.slots", name="number of slots", span=instead, variants=variants)


def put_inertia(sheet: Sheet, section: Section, request: Request, motor: MotorFacts) -> None:
    """Write the inertia of rotor and load into the section of the mechanics."""
    if "inertia" in request.numbers:
        section.put("inertia", request.numbers["inertia"].text)
        return
    factor = motor.size.inertia_factor
    rotor = adapted(motor.part["inertia"].scaled(factor), is_same_size(factor))
    load = request.value("load-inertia")
    with_load = Figure(
        typical=rotor.typical + (load or 0.0),
        low=rotor.low + (load or 0.0),
        high=rotor.high + load if load is not None else LOAD_FACTOR * rotor.high,
        reason=f"the rotor {'without a load' if load is None else 'and your load'}: {rotor.reason}",
        is_guess=True,
    )
    sheet.guess(section, "inertia", with_load, units.INERTIA, path="mechanics", name="inertia")


def put_step_motor(sheet: Sheet, request: Request, part: Part) -> MotorFacts:
    """Write the section of a step motor, by holding torque and detent torque, and return its facts."""
    tables = datasheet_tables(request.motor)
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
        return _step_facts(request, part, size, star.pole_pairs, coil)
    section.put("kind", "step")
    if "step-angle" in request.numbers:
        section.put("step_angle", request.numbers["step-angle"].text)
    else:
        usual = part["step_angle"]
        reason = f"guess: 0.9 deg is possible, too; {usual.reason}"
        section.put("step_angle", amount(usual.typical, units.ANGLE, "deg"), reason)
    teeth = _teeth(request, part)
    holding_value = holding or part["rated_torque"].typical
    coil = coil or part["rated_current"].typical
    peak = peak_of_coil(coil)
    size = sized(part, Known(torque_constant=holding_value / peak, torque=holding_value, current=peak))
    for key, name, factor in (
        ("R_s", "resistance", size.resistance_factor),
        ("L_0", "inductance", size.inductance_factor),
    ):
        dimension = units.RESISTANCE if name == "resistance" else units.INDUCTANCE
        if name in request.numbers:
            section.put(key, request.numbers[name].text)
        else:
            figure = adapted(part[name].scaled(factor), is_same_size(factor))
            if name == "inductance" and resistance:
                ratio = part["inductance"].scaled(resistance / part["resistance"].typical)
                figure = because(
                    ratio.scaled(size.time_factor),
                    "usual L / R of this class of motors, scaled to this motor's size",
                )
            sheet.guess(section, key, figure, dimension, path="motor", name=f"{name} of a coil")
    _holding(sheet, section, request, part)
    _detent(sheet, section, request, part, size)
    return _step_facts(request, part, size, teeth, coil)


def _teeth(request: Request, part: Part) -> int:
    angle = request.value("step-angle") or part["step_angle"].typical
    teeth = teeth_of(angle)
    if not teeth:
        text = request.numbers["step-angle"].text
        raise RequestError(
            "step-angle", text, "expected 360 deg divided by four times the number of teeth, such as 1.8 deg"
        )
    return teeth


def _holding(sheet: Sheet, section: Section, request: Request, part: Part) -> None:
    """Write the holding torque, and the direct current in each phase that makes it."""
    stated = next((key for key in ("holding-torque", "rated-torque") if key in request.numbers), None)
    if stated:
        section.put("holding_torque", request.numbers[stated].text)
    else:
        sheet.guess(
            section, "holding_torque", part["rated_torque"], units.TORQUE, path="motor", name="holding torque"
        )
    if "rated-current" in request.numbers:
        section.put("rated_current", request.numbers["rated-current"].text)
    else:
        current = part["rated_current"]
        text = span(current.low, current.high, units.CURRENT)
        section.put(
            "rated_current", amount(current.typical, units.CURRENT), f"guess: {text}; {current.reason}"
        )


def _detent(sheet: Sheet, section: Section, request: Request, part: Part, size: Sized) -> None:
    """Write the detent torque's amplitude. The detent torque of a datasheet includes friction."""
    detent, friction = request.value("detent-torque"), request.value("friction")
    if "cogging" in request.numbers:
        section.put("detent_torque", request.numbers["cogging"].text)
    elif detent is not None:
        share = detent - (friction if friction is not None else detent_friction(part, detent).typical)
        note = "the datasheet's torque less the friction in it"
        section.put("detent_torque", amount(max(share, 0.0), units.TORQUE, count=TORQUE_DIGITS), note=note)
    else:
        figure = part["cogging"].scaled(size.torque)
        sheet.guess(section, "detent_torque", figure, units.TORQUE, path="motor", name="detent torque")


def detent_friction(part: Part, detent: float) -> Figure:
    """The friction in a datasheet's detent torque, in the class's proportion of friction to cogging."""
    friction, cogging = part["friction"], part["cogging"]
    share = friction.typical / (friction.typical + cogging.typical)
    ends = (share / 2, min(0.9, 1.5 * share))
    reason = (
        "friction in the torque that turns the motor without current; usual share in this class of motors"
    )
    return Figure(
        typical=share * detent, low=ends[0] * detent, high=ends[1] * detent, reason=reason, is_guess=True
    )


def _step_facts(request: Request, part: Part, size: Sized, teeth: int, coil: float) -> MotorFacts:
    """The facts of a step motor. `coil`: the rated current of a coil, A."""
    main, rated = DETENT_ORDER * teeth, amount(coil, units.CURRENT)
    return MotorFacts(
        part=part,
        size=size,
        phases=2,
        pole_pairs=teeth,
        main_order=main,
        orders=(main,),
        limit=size.current,
        limit_is_guess="rated-current" not in request.numbers,
        limit_reason=f"sqrt(2) times the rated {rated} of a coil; while the motor turns, each coil has a "
        f"sine with this peak, whose rms value is {rated}",
    )
