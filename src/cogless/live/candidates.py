"""Keys of a study that a page might change: gains, and of each scenario its motion, plant and sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_origin

from cogless import units
from cogless.live.blobs import held
from cogless.run.simulate import Pair
from cogless.study import AnyStudy, Study, for_scenario
from cogless.study.table import Quantity


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A key that a page might change.

    `key`: as in `--set`; `label`: what the page calls it. `low`, `high`: of its slider, in `unit`.
    `least`, `most`: what its field takes. `start`: the study's value. `factor`: from `unit` to SI.
    `whole`: only whole numbers. `elsewhere`: it moves numbers of other scenarios' runs, too.
    """

    key: str
    label: str
    group: str
    unit: str
    factor: float
    start: float
    low: float
    high: float
    least: float
    most: float
    scenario: str | None = None
    controller: str | None = None
    whole: bool = False
    stops: tuple[float, ...] = ()  # the only values that it may have
    elsewhere: bool = False

    def text(self, value: float) -> Any:
        """The value as it stands in a study."""
        number: Any = round(value) if self.whole else value
        return f"{shortest(value)} {self.unit}" if self.unit else number

    def si(self, value: float) -> float:
        """The value in SI, rounded as units.parse rounds it."""
        return float(shortest(value)) * self.factor if self.unit else value

    def pairs(self, study: AnyStudy) -> list[Pair]:
        """The runs that the key can change."""
        return [
            (scenario, controller)
            for scenario, controller in held(study)
            if (self.elsewhere or self.scenario in (None, scenario)) and self.controller in (None, controller)
        ]


def shortest(value: float) -> str:
    """The shortest text that reads back as the value; a page writes the same."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


# Keys of the drive and of what it turns. An override changes them, so the controller is not told. Each has
# its group, its name, and the ends of its slider as shares of the study's value.
PLANT = (
    ("Load and motion", "mechanics.inertia", 0.3, 3.0),
    ("Load and motion", "mechanics.coulomb_friction", 0.0, 3.0),
    ("Load and motion", "mechanics.viscous_friction", 0.0, 3.0),
    ("Load and motion", "mechanics.breakaway_friction", 1.0, 3.0),
    ("Load and motion", "mechanics.load_side.inertia", 0.3, 3.0),
    ("Load and motion", "mechanics.load_side.stiffness", 0.3, 3.0),
    ("Load and motion", "mechanics.load_side.damping", 0.0, 3.0),
    *(
        ("Motor", f"motor.cogging.{n}.{word}", 0.0, 3.0)
        for n in range(4)
        for word in ("current", "torque", "torque_peak_to_peak")
    ),
    *(
        ("Motor", f"motor.torque_ripple.{n}.{word}", 0.0, 3.0)
        for n in range(2)
        for word in ("percent", "percent_peak_to_peak")
    ),
    *(("Motor", f"motor.flux_harmonics.{n}.{word}", 0.0, 3.0) for n in range(3) for word in "dq"),
    *(
        ("Motor", f"motor.{word}", 0.5, 2.0)
        for word in ("R_s", "resistance_line_to_line", "L_d", "L_q", "inductance_line_to_line")
    ),
    *(("Motor", f"motor.{word}", 0.7, 1.3) for word in ("psi_f", "K_t", "kv")),
    ("Sensors", "drive.current_sensors.noise", 0.0, 5.0),
    ("Sensors", "drive.current_sensors.bits", 8.0, 16.0),
    ("Sensors", "drive.position_sensor.lines", 0.0, 0.0),
    ("Sensors", "drive.position_sensor.bits", 8.0, 20.0),
    ("Sensors", "drive.position_sensor.latency", 0.0, 3.0),
    ("Sensors", "drive.position_sensor.eccentricity", 0.0, 3.0),
    *(("Sensors", f"drive.current_sensors.offset.{n}", -3.0, 3.0) for n in range(3)),
    *(("Sensors", f"drive.current_sensors.gain_error.{n}", -3.0, 3.0) for n in range(3)),
    ("Inverter", "drive.inverter.dead_time", 0.0, 4.0),
    ("Inverter", "drive.inverter.bus_voltage", 0.5, 1.5),
)
LINES = (
    64,
    100,
    128,
    200,
    256,
    360,
    500,
    512,
    600,
    1000,
    1024,
    1250,
    2000,
    2048,
    2500,
    3600,
    4096,
    5000,
    8192,
    10000,
)
OF_REFERENCE = (
    ("speed", 0.1, 3.0),
    ("ramp", 0.2, 3.0),
    ("offset", 0.1, 3.0),
    ("amplitude", 0.0, 2.0),
    ("frequency", 0.3, 3.0),
)
# Keys of a controller that are no gains: they stay as they are.
NO_GAINS = {"label", "baseline", "law", "seed", "memory", "period"}


# Keys of one's own motor, of which the controller is told.
MOTOR = (
    "motor.pole_pairs",
    "motor.resistance_line_to_line",
    "motor.inductance_line_to_line",
    "motor.kv",
    "mechanics.inertia",
    "mechanics.coulomb_friction",
    "motor.cogging.0.order",
    "motor.cogging.0.torque",
    "motor.cogging.1.order",
    "motor.cogging.1.torque",
    "drive.inverter.bus_voltage",
)
YOURS = "Your motor"
WIDE = 100.0  # what a field takes, as a share of the slider's ends
PAIRS, ORDERS = 40.0, 400.0  # most pole pairs, highest order


def candidates(study: Study, told: bool = False) -> Iterator[Candidate]:
    """The keys that a page might change, those of controllers first; keys.py finds where each lands.

    `told`: the motor's keys are the study's, of which the controller is told, in place of overrides.
    """
    if told:
        yield from of_motor(study)
    for name in dict.fromkeys(controller for _, controller in held(study)):
        yield from _of_controller(study, name)
    for scenario in dict.fromkeys(scenario for scenario, _ in held(study)):
        yield from _of_scenario(study, scenario, told)


def of_motor(study: Study) -> Iterator[Candidate]:
    """The keys of the motor and what it turns, with all runs to change."""
    for key in MOTOR:
        owner, last, value = looked_up(study, study.source.tables, key)
        if value is None or owner is None:
            continue
        span = {"pole_pairs": (1.0, PAIRS, ""), "order": (1.0, ORDERS, "")}.get(str(last), (0.3, 3.0))
        yield from made(key, key.partition(".")[2], YOURS, owner, last, value, span)


def _of_controller(study: Study, name: str) -> Iterator[Candidate]:
    law, table = study.controller[name], study._source.tables["controller"][name]
    for key, value in table.items():
        where = f"controller.{quoted(name)}.{key}"
        if key == "tuning" and "phase_margin" in value:
            yield from made(
                f"{where}.phase_margin",
                "tuning.phase_margin",
                name,
                getattr(law, "tuning", None),
                "phase_margin",
                value["phase_margin"],
                (25, 75, "deg"),
                controller=name,
            )
        elif key not in NO_GAINS and isinstance(value, int | float | str) and not isinstance(value, bool):
            yield from made(where, key, name, law, key, value, (0.0, 3.0), controller=name)
    if law.learns and "learning_start" not in table and hasattr(law, "learning_start"):
        key = f"controller.{quoted(name)}.learning_start"
        longest = max(study.scenario[scenario].duration for scenario, other in held(study) if other == name)
        yield from made(
            key,
            "learning_start",
            name,
            law,
            "learning_start",
            "0 s",
            (0.0, longest, "s"),
            controller=name,
        )


def _of_scenario(study: Study, scenario: str, told: bool) -> Iterator[Candidate]:
    here, where = for_scenario(study, scenario), f"scenario.{quoted(scenario)}"
    tables = here._source.tables
    own, experiment = tables["scenario"][scenario], here.scenario[scenario]
    yield from made(
        f"{where}.duration",
        "duration",
        "Load and motion",
        experiment,
        "duration",
        own["duration"],
        (0.1, 2.0),
        scenario=scenario,
    )
    reference = own["reference"]
    if isinstance(reference, str):
        yield from made(
            f"{where}.reference",
            "reference",
            "Load and motion",
            experiment.reference,
            "speed",
            reference,
            (0.1, 3.0),
            scenario=scenario,
        )
    elif isinstance(reference, dict):
        for key, low, high in OF_REFERENCE:
            if key in reference:
                yield from made(
                    f"{where}.reference.{key}",
                    f"reference.{key}",
                    "Load and motion",
                    experiment.reference,
                    key,
                    reference[key],
                    (low, high),
                    scenario=scenario,
                )
    load = own.get("load")
    if load is None or isinstance(load, str):
        full = 0.5 * study.K_t * here.drive.current_loop.current_limit
        given = load or tables["mechanics"].get("load", "0 N*m")
        if isinstance(given, str):
            reach = float(f"{full:.2g}") / (units.factor(units.unit_of(given), units.TORQUE) or 1)
            yield from made(
                f"{where}.load",
                "load",
                "Load and motion",
                here.mechanics.load,
                "torque",
                given,
                (-reach, reach, units.unit_of(given)),
                scenario=scenario,
            )
    for group, key, low, high in PLANT:
        owner, last, value = looked_up(here, tables, key)
        if told and (key.startswith("motor.") or key in MOTOR):
            continue
        if value is not None and owner is not None:
            yield from made(
                _overriding(where, own, key),
                key,
                group,
                owner,
                last,
                value,
                (low, high),
                scenario=scenario,
            )


def _overriding(where: str, own: Mapping[str, Any], key: str) -> str:
    return f'{where}.override."{key}"'


def looked_up(here: AnyStudy, tables: Any, key: str) -> tuple[Any, str | int, Any]:
    """The model that holds a key, the key's last part, and its value in the file; None if not there."""
    owner: Any = here
    parts = [int(part) if part.isdigit() else part for part in key.split(".")]
    for n, part in enumerate(parts):
        if n < len(parts) - 1 and not (
            isinstance(part, str) and isinstance(parts[n + 1], int) and n == len(parts) - 2
        ):
            try:
                owner = owner[part] if isinstance(part, int) else getattr(owner, part)
            except (AttributeError, IndexError, KeyError, TypeError):
                return None, part, None
        if tables is not None:
            try:
                tables = tables[part]
            except (KeyError, IndexError, TypeError):
                tables = None
    return owner, parts[-1] if isinstance(parts[-1], str) else str(parts[-2]), tables


def made(
    key: str,
    label: str,
    group: str,
    owner: Any,
    field: str | int,
    value: Any,
    span: tuple[Any, ...],
    scenario: str | None = None,
    controller: str | None = None,
) -> Iterator[Candidate]:
    """The candidate for a key, if its value is a number.

    `span`: the slider's ends, as two shares of the value, or as two numbers and their unit.
    """
    info = type(owner).model_fields.get(str(field)) if owner is not None else None
    if info is None:
        return
    quantity = next(iter(_quantities(info)), None)
    whole = quantity is None and isinstance(value, int) and not isinstance(value, bool)
    unit, factor = "", 1.0
    if isinstance(value, str):
        unit = units.unit_of(value)
        if quantity is None or not unit:
            return
        number, factor = units.number_in(value, unit), units.factor(unit, quantity.dimension)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        number = float(value)
    else:
        return
    low, high = span[:2]
    if label == "forgetting":
        low, high = 0.5, 1.0
    elif len(span) == 2 and not whole:
        if number == 0:
            return
        low = max(low, 0.1) if quantity is not None and quantity.sign == ">" else low
        low, high = sorted((low * number, high * number))
    elif len(span) == 2 and high <= 4:  # shares, not bits
        low, high = (number // 4, 4 * number) if number > 50 else (0, 2 * number + 6)
    stops = tuple(sorted({*map(float, LINES), number})) if label.endswith("position_sensor.lines") else ()
    if stops:
        low, high = stops[0], stops[-1]
    low, high = (float(round(x)) if whole else float(f"{x:.4g}") for x in (low, high))
    is_share = len(span) == 2 and not whole and not stops and label != "forgetting"
    least, most = low, high
    if is_share:
        least = low / WIDE if low > 0 else WIDE * low
        most = high / WIDE if high < 0 else WIDE * high
    yield Candidate(
        key=key,
        label=label,
        group=group,
        unit=unit,
        factor=factor,
        start=number,
        low=min(low, number),
        high=max(high, number),
        least=min(least, number),
        most=max(most, number),
        scenario=scenario,
        controller=controller,
        whole=whole,
        stops=stops,
    )


def _quantities(info: Any) -> Iterator[Quantity]:
    """Quantities within a field's annotation, the outermost first."""
    yield from (entry for entry in info.metadata if isinstance(entry, Quantity))

    def within(annotation: Any) -> Iterator[Quantity]:
        if get_origin(annotation) is Annotated:
            yield from (entry for entry in annotation.__metadata__ if isinstance(entry, Quantity))
        for inner in get_args(annotation):
            yield from within(inner)

    yield from within(info.annotation)


def quoted(name: str) -> str:
    """A part of a dotted key, in quotes if it needs them."""
    return f'"{name}"' if "." in name or name.isdigit() else name
