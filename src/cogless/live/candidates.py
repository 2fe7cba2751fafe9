"""Keys of a study that a page might change.

In a study of speed these are gains, and the motion, plant and sensors of each scenario. In a study of trials
these are the keys of learning, and the load and plant of each phase.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, cast, get_args, get_origin

from cogless import units
from cogless.design.trials.from_study import design_study, retuned, uncertain_plant
from cogless.live.description import blobs, page_runs, why_not
from cogless.report.phases import groups, phases
from cogless.run.simulate import Pair
from cogless.study import AnyStudy, Study, TrialStudy, for_scenario
from cogless.study.base import Kind
from cogless.study.drive import IdealCurrentLoop
from cogless.study.laws.trial import FilteredLaw, QFilter
from cogless.study.linear_plant import LinearPlant
from cogless.study.reading import Changes, changed
from cogless.study.table import Quantity


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A key that a page might change.

    `key`: as in `--set`. `label`: the page's name for the key. `low`, `high`: the slider's ends, in `unit`.
    `least`, `most`: limits of the input field. `start`: the study's value. `factor`: from `unit` to SI.
    `whole`: only whole numbers. `elsewhere`: the key also changes runs of other scenarios than `scenario`.
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
    stops: tuple[float, ...] = ()  # the only values that the key may have, if any
    elsewhere: bool = False

    def study_value(self, value: float) -> Any:
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
            for scenario, controller in page_runs(study)
            if (self.elsewhere or self.scenario in (None, scenario)) and self.controller in (None, controller)
        ]


def shortest(value: float) -> str:
    """The shortest text that reads back as the value; a page writes the same."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


COGGING_ORDERS = 12  # number of the motor's orders that have keys
# Keys of motor, load and drive: group, name, and the slider's ends as shares of the study's value; the ends
# of bits are numbers. An override changes these keys (in trials not those of the drive), so the controller
# does not know the change.
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
        for n in range(COGGING_ORDERS)
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
# Lines of an encoder: the stops of their key.
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
# Keys of a reference, with the slider's ends as shares of the study's value.
OF_REFERENCE = (
    ("speed", 0.1, 3.0),
    ("ramp", 0.2, 3.0),
    ("offset", 0.1, 3.0),
    ("amplitude", 0.0, 2.0),
    ("frequency", 0.3, 3.0),
)
# Keys of a controller that are no gains: they stay as they are.
NO_GAINS = {"label", "baseline", "law", "seed", "memory", "period"}


# Keys of one's own motor. The controller is designed for their values.
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
CURRENT_LIMIT = "drive.current_loop.current_limit"
YOURS = "Your motor"
FIELD_WIDTH = 100.0  # ratio of an input field's limits to the slider's ends
POLE_PAIRS_MOST, ORDER_MOST = 40.0, 400.0  # the upper ends of the two sliders


def candidates(study: Study, for_own_motor: bool = False) -> Iterator[Candidate]:
    """The keys that a page might change, in order of precedence; keys.py finds the numbers that each sets.

    `for_own_motor`: the motor's values change in the study itself, so the controller is designed for them.
    Else an override of the scenario changes them, and the controller does not know.
    """
    if for_own_motor:
        yield from of_motor(study)
    yield from _of_limit(study)
    for name in dict.fromkeys(controller for _, controller in page_runs(study)):
        yield from _of_controller(study, name)
    for scenario in dict.fromkeys(scenario for scenario, _ in page_runs(study)):
        yield from _of_scenario(study, scenario, for_own_motor)


def _of_limit(study: Study) -> Iterator[Candidate]:
    """The key of the current limit, which is the same in all scenarios and which the controllers know."""
    owner, last, value = looked_up(study, study.source.tables, CURRENT_LIMIT)
    if value is not None and owner is not None:
        yield from key_candidate(
            CURRENT_LIMIT, CURRENT_LIMIT, "Load and motion", owner, last, value, (0.2, 2.0)
        )


def of_motor(study: Study) -> Iterator[Candidate]:
    """The keys of one's own motor and its load. Each of them changes all runs."""
    for key in MOTOR:
        owner, last, value = looked_up(study, study.source.tables, key)
        if value is None or owner is None:
            continue
        span = {"pole_pairs": (1.0, POLE_PAIRS_MOST, ""), "order": (1.0, ORDER_MOST, "")}.get(
            str(last), (0.3, 3.0)
        )
        yield from key_candidate(key, key.partition(".")[2], YOURS, owner, last, value, span)


def _of_controller(study: Study, name: str) -> Iterator[Candidate]:
    law, table = study.controller[name], study._source.tables["controller"][name]
    for key, value in table.items():
        where = f"controller.{quoted(name)}.{key}"
        if key == "tuning" and "phase_margin" in value:
            yield from key_candidate(
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
            yield from key_candidate(where, key, name, law, key, value, (0.0, 3.0), controller=name)
    if law.learns and "learning_start" not in table and hasattr(law, "learning_start"):
        key = f"controller.{quoted(name)}.learning_start"
        longest = max(
            study.scenario[scenario].duration for scenario, other in page_runs(study) if other == name
        )
        yield from key_candidate(
            key,
            "learning_start",
            name,
            law,
            "learning_start",
            "0 s",
            (0.0, longest, "s"),
            controller=name,
        )


def _of_scenario(study: Study, scenario: str, for_own_motor: bool) -> Iterator[Candidate]:
    own_study, where = for_scenario(study, scenario), f"scenario.{quoted(scenario)}"
    tables = own_study._source.tables
    own, experiment = tables["scenario"][scenario], own_study.scenario[scenario]
    yield from key_candidate(
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
        yield from key_candidate(
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
                yield from key_candidate(
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
        full = 0.5 * study.K_t * own_study.drive.current_loop.current_limit
        load_value = load or tables["mechanics"].get("load", "0 N*m")
        if isinstance(load_value, str):
            reach = float(f"{full:.2g}") / (units.factor(units.unit_of(load_value), units.TORQUE) or 1)
            yield from key_candidate(
                f"{where}.load",
                "load",
                "Load and motion",
                own_study.mechanics.load,
                "torque",
                load_value,
                (-reach, reach, units.unit_of(load_value)),
                scenario=scenario,
            )
    for group, key, low, high in PLANT:
        owner, last, value = looked_up(own_study, tables, key)
        if for_own_motor and (key.startswith("motor.") or key in MOTOR):
            continue
        if value is not None and owner is not None:
            yield from key_candidate(
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


def looked_up(study_here: AnyStudy, tables: Any, key: str) -> tuple[Any, str | int, Any]:
    """The model that holds a key, the key's last name, and its value in the file; None if it is missing."""
    owner: Any = study_here
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


def key_candidate(
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
        least = low / FIELD_WIDTH if low > 0 else FIELD_WIDTH * low
        most = high / FIELD_WIDTH if high < 0 else FIELD_WIDTH * high
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
    """The quantities in a field's annotation, the outermost first."""
    yield from (entry for entry in info.metadata if isinstance(entry, Quantity))

    def quantities_in(annotation: Any) -> Iterator[Quantity]:
        if get_origin(annotation) is Annotated:
            yield from (entry for entry in annotation.__metadata__ if isinstance(entry, Quantity))
        for inner in get_args(annotation):
            yield from quantities_in(inner)

    yield from quantities_in(info.annotation)


def quoted(name: str) -> str:
    """A part of a dotted key, in quotes if it needs them."""
    return f'"{name}"' if "." in name or name.isdigit() else name


OF_TRIALS = "Trials"
SHIFT_MOST = 16  # samples: the slider of a shift reaches at least to this
WEIGHT = "input_weight of all feedback (learning gains stay)"
WEIGHT_SHARES = (0.1, 0.2, 0.5, 2.0, 5.0, 10.0)  # shares of the study's value; each gets a design


def trial_candidates(study: TrialStudy) -> Iterator[Candidate]:
    """The keys that a page might change, controllers' first; keys.py finds the numbers that each sets."""
    for name in dict.fromkeys(controller for _, controller in page_runs(study)):
        yield from _of_trial_controller(study, name)
    yield from _weight(study)
    for scenario in dict.fromkeys(scenario for scenario, _ in page_runs(study)):
        yield from _of_trial_scenario(study, scenario)
    for group, key, low, high in PLANT:
        if key.startswith("drive."):
            owner, last, value = looked_up(study, study.source.tables, key)
            if owner is not None and value is not None:
                yield from key_candidate(key, key, group, owner, last, value, (low, high))


def pinned(study: TrialStudy) -> tuple[TrialStudy, Changes]:
    """The study with the values that its designs chose for learning written into it, and these values by key.

    Then the filter, the shift and the weight each move only their own numbers, and K_3 does not change. A
    controller stays as it is if this would change a bit of its run.
    """
    pins: dict[str, Any] = {}
    for name in dict.fromkeys(controller for _, controller in page_runs(study)):
        run = next(pair for pair in page_runs(study) if pair[1] == name)
        own = _chosen(study, run)
        if own and _same_law(study, changed(study, own), run):
            pins |= own
    if not pins:
        return study, pins
    same = changed(study, pins)
    for name in study.controller:
        same.take(why_not, name, study)
    return same, pins


def _chosen(study: TrialStudy, run: Pair) -> Changes:
    """The values that a controller's design chose, by key; empty for a law without a design."""
    law, where = study.controller[run[1]], f"controller.{quoted(run[1])}"
    if not law.learns_from_trials:
        return {}
    design = design_study(study, [run])[run]
    gain, cutoff, q = law.TRIAL_GAIN, design.gains.cutoff, design.q_filter
    observer = design.gains.observer
    if observer is not None:
        chosen = {"pole": observer.pole, "cutoff": _hertz(cutoff)}
        return {f"{where}.{key}": x for key, x in chosen.items() if x and getattr(law, key) is None}
    if not gain or not design.K_3:
        return {}
    own = cast("FilteredLaw", law)
    pins: dict[str, Any] = {f"{where}.{gain}": design.K_3} if getattr(own, gain) is None else {}
    if own.SHIFTS_ON_PAGE and not isinstance(own.shift, int):
        pins[f"{where}.shift"] = design.shift
    if q is not None and cutoff and not isinstance(own.q_filter, QFilter):
        shape = {"order": len(q.b) - 1, "ends": "odd" if q.odd else "even", "acts_on": design.filtered}
        pins[f"{where}.q_filter"] = {"cutoff": _hertz(cutoff), **shape}
    return pins


def _hertz(frequency: float | None) -> str | None:
    return None if frequency is None else f"{frequency!r} Hz"


def _same_law(study: TrialStudy, other: TrialStudy, run: Pair) -> bool:
    """Whether two studies give a run the same bytes."""
    return blobs(study, *run)["run"].data == blobs(other, *run, study)["run"].data


def _of_trial_controller(study: TrialStudy, name: str) -> Iterator[Candidate]:
    """The keys of learning; each one leaves the feedback's gains as they are, or moves only these."""
    law, where = study.controller[name], f"controller.{quoted(name)}"
    if not law.learns_from_trials:
        return
    for key in law.TRIAL_RULE_KEYS:
        number = getattr(law, key)
        value = _hertz(number) if key == "cutoff" else number
        if value is not None:
            path = f"{where}.{key}"
            yield from key_candidate(path, key, name, law, key, value, (0.3, 2.0), controller=name)
    if law.TRIAL_GAIN:
        yield from _of_filtered_law(study, name, cast("FilteredLaw", law))


def _of_filtered_law(study: TrialStudy, name: str, law: FilteredLaw) -> Iterator[Candidate]:
    where = f"controller.{quoted(name)}"
    run = next(pair for pair in page_runs(study) if pair[1] == name)
    gain = law.TRIAL_GAIN
    has_gain, K_3 = getattr(law, gain) is not None, retuned(study, run, study).K_3
    # If the study says nothing of the update, the design chooses all of it, and K_3 is only a part.
    chosen = "auto" in law.choice and law.q_filter is None and law.shift is None
    if K_3 and not chosen:
        yield from key_candidate(f"{where}.{gain}", gain, name, law, gain, K_3, (0.0, 2.0), controller=name)
    q = law.q_filter
    stays = f" ({gain} stays)" if has_gain else ""
    if isinstance(q, QFilter) and (has_gain or q.acts_on == "error"):
        own = study.source.tables["controller"][name]["q_filter"]
        key, label = f"{where}.q_filter.cutoff", "q_filter.cutoff" + stays * (q.acts_on == "signal")
        yield from key_candidate(key, label, name, q, "cutoff", own["cutoff"], (0.3, 2.0), controller=name)
    if has_gain and law.SHIFTS_ON_PAGE and isinstance(law.shift, int):
        least = uncertain_plant(study).relative_degree
        span = (float(least), float(max(4 * law.shift, SHIFT_MOST)), "")
        yield from key_candidate(
            f"{where}.shift", f"shift{stays}", name, law, "shift", law.shift, span, controller=name
        )


def _weight(study: TrialStudy) -> Iterator[Candidate]:
    """The key of the input's weight, if the study gives all learning gains, so that the weight moves none."""
    laws = [
        study.controller[name] for name in dict.fromkeys(controller for _, controller in page_runs(study))
    ]
    designed = [law for law in laws if law.TRIAL_FEEDBACK and not getattr(law, law.TRIAL_FEEDBACK)]
    learning = [law for law in designed if law.learns_from_trials]
    if not designed or any(getattr(law, law.TRIAL_GAIN) is None for law in learning):
        return
    weight = study.design.input_weight
    stops = tuple(sorted({weight, *(float(f"{weight * share:.3g}") for share in WEIGHT_SHARES)}))
    key = "design.input_weight"
    for candidate in key_candidate(key, WEIGHT, OF_TRIALS, study.design, "input_weight", weight, (0.1, 10.0)):
        low, high = stops[0], stops[-1]
        yield replace(candidate, stops=stops, low=low, high=high, least=low, most=high)


def _of_trial_scenario(study: TrialStudy, scenario: str) -> Iterator[Candidate]:
    where, own = f"scenario.{quoted(scenario)}", study.source.tables["scenario"][scenario]
    experiment = study.scenario[scenario]
    fewest = float(max(experiment.starts))
    ends = (fewest, 2.0 * experiment.trials, "")
    yield from key_candidate(
        f"{where}.trials", "trials", OF_TRIALS, experiment, "trials", own["trials"], ends, scenario
    )
    yield from _of_phase(study, scenario, where, own, "")
    alone = {group.start for group in groups(phases(experiment)) if len(group.phases) == 1}
    for n, change in enumerate(own.get("changes", ())):
        if change["trial"] not in alone:
            continue  # one of a long row of similar changes, which have no sliders of their own
        yield from _of_phase(
            study, scenario, f"{where}.changes.{n}", change, f", from trial {change['trial']}"
        )
    overridden = own.get("override", {})
    if study.plant is not None:
        for name, parameter in study.plant.parameter.items():
            value = overridden.get(name, parameter.nominal)
            yield from key_candidate(
                f"{where}.override.{quoted(name)}",
                name,
                "Plant",
                parameter,
                "value",
                value,
                (0.5, 2.0),
                scenario,
            )
        return
    for group, key, low, high in PLANT:
        owner, last, value = looked_up(study, study.source.tables, key)
        if (
            not key.startswith("drive.")
            and not _unfelt(study, key)
            and owner is not None
            and value is not None
        ):
            value = overridden.get(key, value)
            yield from key_candidate(
                f'{where}.override."{key}"', key, group, owner, last, value, (low, high), scenario
            )


def _unfelt(study: TrialStudy, key: str) -> bool:
    """Whether the value has no effect because the current loop is ideal."""
    electrical = ("R_s", "L_", "resistance", "inductance")
    ideal = study.drive is not None and isinstance(study.drive.current_loop, IdealCurrentLoop)
    return ideal and key.removeprefix("motor.").startswith(electrical)


def _of_phase(
    study: TrialStudy, scenario: str, where: str, own: dict[str, Any], when: str
) -> Iterator[Candidate]:
    """The keys of a phase: its loads, and the plant's values that the phase changes."""
    experiment = study.scenario[scenario]
    for n, (_, load) in enumerate(own.get("load_steps", ())):
        key = f"{where}.load_steps.{n}.1"
        yield from key_candidate(
            key, f"load{when}", OF_TRIALS, experiment, "load_steps", load, (0.0, 2.0), scenario
        )
    if not when:
        return
    for key, value in own.get("override", {}).items():
        owner: Any = None
        last: str | int = "value"
        if isinstance(study.plant, LinearPlant):
            owner = study.plant.parameter.get(key)
        elif isinstance(key, str):
            owner, last, _ = looked_up(study, study.source.tables, key)
        if owner is not None:
            path = f'{where}.override."{key}"' if "." in key else f"{where}.override.{key}"
            yield from key_candidate(
                path, f"{key}{when}", OF_TRIALS, owner, last, value, (0.5, 2.0), scenario
            )


@dataclass(frozen=True)
class KindOfKeys:
    """What a page may change in a kind of study. `pinned`: returns what the function `pinned` returns."""

    candidates: Callable[[Any, bool], Iterator[Candidate]]
    pinned: Callable[[Any], tuple[AnyStudy, Changes]]


PAGE_KEYS: Mapping[Kind, KindOfKeys] = {
    "speed": KindOfKeys(candidates, pinned=lambda study: (study, {})),
    "trials": KindOfKeys(lambda study, _: trial_candidates(study), pinned),
}
