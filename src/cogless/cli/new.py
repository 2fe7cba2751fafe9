"""`new`: a first study of one's own motor, by flags or by questions."""

from __future__ import annotations

import shlex
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, cast

import typer

from cogless.cli.completion import complete_part
from cogless.cli.options import CORES
from cogless.cli.terminal import program, share_progress
from cogless.errors import StudyError
from cogless.lines import warn

if TYPE_CHECKING:
    from cogless.design.answers import Answer
    from cogless.starter import AtSpeed, Draft, Effect, Outcome, Ranking, Request, Settings
    from cogless.starter.part_catalogue import Kind
    from cogless.study import Study

LINE_COLUMNS = 80
SHOWN_EFFECTS = 3
HARD_SPACE = "\xa0"
Text = str | None

QUESTIONS: dict[str, tuple[Kind, str, str]] = {
    "motor": ("motors", "Which motor is most like yours?", "own"),
    "drive": ("drives", "Which drive?", "generic"),
    "encoder": ("encoders", "Which position sensor?", "as5047"),
}
EXAMPLES = {"motor": "gimbal", "drive": "generic", "encoder": "as5047"}  # The three fit each other.


def _name(flag: str, help: str) -> Any:
    kind, *_ = QUESTIONS[flag.removeprefix("--")]
    return typer.Option(
        flag, metavar="NAME", help=help, show_default=False, autocompletion=complete_part(kind)
    )


def _number(flag: str, help: str) -> Any:
    return typer.Option(flag, metavar="NUMBER", help=help, show_default=False, rich_help_panel="Numbers")


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="File of the study, with or without .toml.")],
    motor: Annotated[
        Text,
        _name(
            "--motor",
            "Class of your motor: gimbal, drone, direct-drive, hub, servo, spindle, nema17, nema23, own. Or "
            "the name of a motor in `cogless list`.",
        ),
    ] = None,
    drive: Annotated[
        Text, _name("--drive", "Drive of the motor: generic, moteus, odrive, vesc, simplefoc, stepper.")
    ] = None,
    encoder: Annotated[
        Text,
        _name(
            "--encoder",
            "Position sensor: as5047, as5048, as5600, ma732, mt6701, absolute, incremental, hall.",
        ),
    ] = None,
    pole_pairs: Annotated[
        Text, _number("--pole-pairs", "Half the number of magnets around the rotor.")
    ] = None,
    magnets: Annotated[
        Text, typer.Option("--magnets", hidden=True, help="Refused: --pole-pairs is the flag.")
    ] = None,
    slots: Annotated[Text, _number("--slots", "Number of slots (teeth) of the stator.")] = None,
    kv: Annotated[Text, _number("--kv", "No-load speed per volt of the supply, in r/min per V.")] = None,
    torque_constant: Annotated[
        Text, _number("--torque-constant", "Torque per ampere of a phase (peak, not rms), in N*m/A.")
    ] = None,
    back_emf: Annotated[
        Text,
        _number("--back-emf", "Rms voltage between two terminals per speed, such as '33 mV/rpm'."),
    ] = None,
    resistance: Annotated[
        Text,
        _number(
            "--resistance",
            "Resistance between two terminals, in ohm, or of one phase: '0.28 ohm/phase'. Step motor: of one "
            "coil.",
        ),
    ] = None,
    inductance: Annotated[
        Text,
        _number(
            "--inductance",
            "Inductance between two terminals, in mH, or of one phase: '0.55 mH/phase'. Step motor: of one "
            "coil.",
        ),
    ] = None,
    inertia: Annotated[Text, _number("--inertia", "Inertia of rotor and load together, in kg*m^2.")] = None,
    load_inertia: Annotated[
        Text,
        _number(
            "--load-inertia",
            "Inertia of the load alone, in kg*m^2, usually at most 10 times the rotor's inertia, which is "
            "then a guess.",
        ),
    ] = None,
    rated_current: Annotated[
        Text,
        _number(
            "--rated-current",
            "Continuous current of a phase (peak), in A, or rms, such as '2 A rms'. Step motor: of one coil.",
        ),
    ] = None,
    rated_torque: Annotated[Text, _number("--rated-torque", "Continuous torque, in N*m.")] = None,
    holding_torque: Annotated[
        Text, _number("--holding-torque", "Holding torque of a step motor, in N*m.")
    ] = None,
    detent_torque: Annotated[
        Text, _number("--detent-torque", "Torque needed to turn a step motor without current, in N*m.")
    ] = None,
    step_angle: Annotated[
        Text, _number("--step-angle", "Angle of a full step of a step motor, in deg.")
    ] = None,
    cogging: Annotated[
        Text,
        _number(
            "--cogging", "Cogging torque of all orders together: half of the peak-to-peak value, in N*m."
        ),
    ] = None,
    friction: Annotated[Text, _number("--friction", "Friction torque while the rotor turns, in N*m.")] = None,
    bits: Annotated[Text, _number("--bits", "Number of bits of an absolute encoder.")] = None,
    cpr: Annotated[
        Text, _number("--cpr", "Counts per revolution of an incremental encoder, 4 times its lines (PPR).")
    ] = None,
    bus_voltage: Annotated[Text, _number("--bus-voltage", "Voltage of the supply, in V.")] = None,
    current_limit: Annotated[
        Text,
        _number(
            "--current-limit", "Largest phase current of the drive (peak), in A, or rms, such as '9 A rms'."
        ),
    ] = None,
    current_rate: Annotated[
        Text, _number("--current-rate", "Rate of the current loop, usually that of the PWM, in Hz.")
    ] = None,
    speed_rate: Annotated[Text, _number("--speed-rate", "Rate of the speed loop, in Hz.")] = None,
    speed: Annotated[
        list[str] | None, _number("--speed", "A speed that matters to you, in r/min. Repeatable.")
    ] = None,
    load: Annotated[Text, _number("--load", "Constant load torque, in N*m.")] = None,
    page: Annotated[
        bool,
        typer.Option("--live", help="Also write NAME-live.html, the page of `cogless live`, and open it."),
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace the file of the study if it exists.")
    ] = False,
) -> None:
    """Write a first study of your motor, and say which guesses in this study matter most.

    Give the numbers that you know, with a unit or in the unit that is named below. On a terminal, cogless
    asks for the most important numbers that you left out.

    All other numbers are guesses. The file marks each guess, and gives its range and the reason for it.
    """
    options = locals()  # the arguments above, by name
    from cogless.starter.request import NUMBERS

    if magnets is not None:
        raise StudyError(f"--magnets: expected --pole-pairs, half the number of magnets{_half(magnets)}")
    flags = [flag for flag in NUMBERS if flag != "speed"]
    texts = {flag: text for flag in flags if (text := options[flag.replace("-", "_")]) is not None}
    path = _path(name, force)
    request = _request({"motor": motor, "drive": drive, "encoder": encoder}, texts, speed or [])
    study, drafted = _write(request, path)
    print(f"Wrote {path}.")
    for line in drafted.remarks:
        print("\n".join(_wrapped(line, "", "  ")))
    for line in _guess_lines(drafted.guessed):
        print(line)
    _show_ranking(study, drafted, path)
    if page:
        from cogless.cli.studies import live

        live(str(path), own_motor=_has_own_words(study), jobs=CORES)


def _half(magnets: str) -> str:
    count = int(magnets) if magnets.isascii() and magnets.isdigit() else 0
    return f": --pole-pairs {count // 2}" if count and count % 2 == 0 else ""


def _path(name: str, force: bool) -> Path:
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    if not path.stem or path.is_dir():
        raise StudyError(f"{name}: expected a name of a study, such as my_motor")
    if path.exists() and not force:
        raise StudyError(f"{path}: the file exists: expected a new name, or --force to replace the file")
    return path


# what is asked


class _Question(NamedTuple):
    """A question, its default, and a function that takes the answer or raises a StudyError."""

    text: str
    default: str
    take: Callable[[str], Any]


def asks() -> bool:
    """Whether stdin is a terminal, so that the user can be asked."""
    return sys.stdin.isatty()


def _ask(flag: str, question: _Question) -> Any:
    """Ask until the answer is valid, and return what `take` makes of the answer."""
    while True:
        answer = typer.prompt(question.text, default=question.default)
        try:
            return question.take(answer)
        except StudyError as error:
            print("\n".join(_wrapped(error.text_without(f"--{flag}"))))


def _request(
    chosen: Mapping[str, str | None], texts: Mapping[str, str], speed_texts: Sequence[str]
) -> Request:
    from cogless.starter.request import Request, check_name, parse_number, parse_speeds

    numbers = {flag: parse_number(flag, text) for flag, text in texts.items()}
    speeds = parse_speeds(speed_texts)
    chosen_parts = {
        "motor": chosen["motor"] or _motor_by(numbers),
        "drive": chosen["drive"] or ("generic" if "current-rate" in numbers else None),
        "encoder": chosen["encoder"] or _encoder_by(numbers),
    }
    for flag, name in chosen_parts.items():
        if name is not None:
            check_name(flag, QUESTIONS[flag][0], name)
    if not asks():
        _check_complete(chosen_parts, numbers)
    motor = _part("motor", chosen_parts["motor"])
    if asks():
        _ask_motor(motor, numbers)
    drive, encoder = _part("drive", chosen_parts["drive"]), _part("encoder", chosen_parts["encoder"])
    if asks() and not speeds:
        text = "Speed that matters to you, in r/min (several: 5, 40)"
        speeds = _ask_unless("speed", text, "slow", lambda answer: parse_speeds([answer])) or ()
    if speeds:
        numbers["speed"] = speeds[0]
    return Request(motor=motor, drive=drive, encoder=encoder, numbers=numbers, faster=speeds[1:])


def _part(flag: str, name: str | None) -> str:
    """`name`, or if it is None, the name of a part of the catalogue that the user chooses."""
    from cogless.starter.request import check_name, names

    if name is not None:
        return name
    kind, text, default = QUESTIONS[flag]
    choices = names(kind)
    width = max(map(len, choices))
    room = LINE_COLUMNS - width - 4
    for choice, description in choices.items():
        print(f"  {choice:<{width}}  {textwrap.shorten(description, room, placeholder=' ...')}")
    question = _Question(text, default, lambda answer: check_name(flag, kind, answer))
    return str(_ask(flag, question))


def _check_complete(chosen_parts: Mapping[str, str | None], numbers: Mapping[str, Any]) -> None:
    """Raise StudyError if options are missing that no guess can replace, with an example of each."""
    own = _needed_numbers(numbers) if chosen_parts["motor"] == "own" else {}
    examples = {flag: EXAMPLES[flag] for flag, name in chosen_parts.items() if name is None}
    examples |= own
    if examples:
        words = " ".join(f"--{flag} {example}" for flag, example in examples.items())
        missing = ", ".join(f"--{flag}" for flag in examples)
        raise StudyError(
            f"{missing}: missing: expected values such as {words}; {program()} new --help lists all"
        )


def _motor_by(numbers: Mapping[str, Any]) -> str | None:
    """The motor's class that follows from the given numbers alone; None if none does."""
    if "holding-torque" in numbers:
        return "nema17" if numbers["holding-torque"].value <= NEMA17_MOST else "nema23"
    return "own" if {"pole-pairs", *CONSTANTS} & numbers.keys() else None


CONSTANTS = {"kv", "torque-constant", "back-emf"}
NEMA17_MOST = 0.8  # N*m, largest holding torque of a step motor of 42 mm


def _encoder_by(numbers: Mapping[str, Any]) -> str | None:
    if "bits" in numbers:
        return "absolute"
    return "incremental" if "cpr" in numbers else None


def _needed_numbers(numbers: Mapping[str, Any]) -> dict[str, str]:
    """{flag: example} of the missing numbers that a command must give of a motor of class "own"."""
    needed = {"pole-pairs": "7", "kv": "80", "resistance": "0.5"}
    if CONSTANTS & numbers.keys() or {"rated-torque", "rated-current"} <= numbers.keys():
        del needed["kv"]
    return {flag: example for flag, example in needed.items() if flag not in numbers}


STAR_QUESTIONS = {
    "pole-pairs": "Pole pairs (half the number of magnets)",
    "slots": "Slots (teeth of the stator)",
    "kv": "Kv in r/min per V, or torque constant such as 0.1 N*m/A",
    "resistance": "Resistance between two terminals, in ohm",
    "cogging": "Cogging torque, half of peak to peak, in N*m",
    "inertia": "Inertia of rotor and load together, in kg*m^2",
}
# Asked of "own", whose class says least. In other classes with three phases both ends of the guess change the
# ripple that harmonic leaves by at most a sixth.
OWN_QUESTIONS = {"inductance": "Inductance between two terminals, in mH"}
STEP_QUESTIONS = {
    "holding-torque": "Holding torque, in N*m",
    "rated-current": "Rated current of a coil, in A",
    "resistance": "Resistance of a coil, in ohm",
    "inductance": "Inductance of a coil, in mH",  # both ends of the guess may double the ripple
    "inertia": STAR_QUESTIONS["inertia"],
}


def _ask_motor(motor: str, numbers: dict[str, Any]) -> None:
    """Ask for the numbers that a class of motors leaves most open. The default of each is its guess."""
    from cogless.starter import motor_guesses
    from cogless.starter.part_catalogue import parts
    from cogless.starter.request import parse_number

    part = parts("motors").get(motor)
    if part is None:  # a shipped motor has a datasheet
        return
    questions = STAR_QUESTIONS if part.layouts else STEP_QUESTIONS
    for flag, text in (questions | (OWN_QUESTIONS if motor == "own" else {})).items():
        guess = motor_guesses(motor, numbers).get(flag)
        if guess is None or flag in numbers or (flag == "inertia" and "load-inertia" in numbers):
            continue
        take = _constant if flag == "kv" else lambda answer, flag=flag: (flag, parse_number(flag, answer))
        pair = _ask_unless(flag, text, f"guess: {guess}", take)
        numbers.update([] if pair is None else [pair])


def _constant(text: str) -> tuple[str, Any]:
    """An answer's flag and value. Its unit says whether it is a torque constant, a back-EMF or a Kv."""
    from cogless.starter.request import RequestError, parse_number

    for flag in ("torque-constant", "back-emf"):
        with suppress(RequestError):
            if text.strip()[-1:].isalpha():
                return flag, parse_number(flag, text)
    return "kv", parse_number("kv", text)


def _ask_unless(flag: str, text: str, default: str, take: Callable[[str], Any]) -> Any:
    """Ask, and return what `take` makes of the answer; None if the answer is the default."""
    question = _Question(text, default, lambda answer: None if answer == default else take(answer))
    return _ask(flag, question)


# what is written and said


def _write(request: Request, path: Path) -> tuple[Study, Draft]:
    from cogless.files import replacing
    from cogless.starter import draft

    drafted = draft(request, _title(path), path)
    for line in drafted.doubts:
        warn(line)
    with replacing(path) as temporary:
        temporary.write_text(drafted.text, encoding="utf-8")
    from cogless.study import Study, load

    return cast(Study, load(path)), drafted


def _guess_lines(guessed: Mapping[str, str]) -> list[str]:
    """The guessed values: by their flags, then those that only the file sets, by their keys."""
    lines = []
    heads = {True: "Not given, so guessed:", False: "Guesses without an option, to be changed in the file:"}
    for has_flag, head in heads.items():
        entries = [f"{label} {text}" for label, text in guessed.items() if label.startswith("--") is has_flag]
        # Hard spaces keep a label and its value in one line.
        text = ", ".join(entry.replace(" ", HARD_SPACE) for entry in entries)
        if entries:
            lines += [line.replace(HARD_SPACE, " ") for line in _wrapped(f"{head} {text}.", "", "  ")]
    return lines


def _title(path: Path) -> str:
    words = path.stem.replace("_", " ").replace("-", " ").strip() or path.stem
    return words[0].upper() + words[1:]


def _show_ranking(study: Study, drafted: Draft, path: Path) -> None:
    from cogless.starter import Settings, holding_settings, rank

    with share_progress("Trying the guesses") as report:
        ranking = rank(study, drafted.guesses, report, SHOWN_EFFECTS)
    settings = holding_settings(study, ranking.lost) if ranking.lost else Settings()
    for line in _ranking_lines(study, ranking, settings, path, drafted.unusual):
        print(line)


def _ranking_lines(
    study: Study, ranking: Ranking, settings: Settings, path: Path, unusual: Sequence[str]
) -> list[str]:
    """The command's report on a ranking, in lines of at most LINE_COLUMNS columns.

    `settings`: what was tried at speeds that are not held. `unusual`: numbers that such a motor seldom has,
    shown if a speed is not held or the motion is uneven.
    """
    from cogless.design.answers import answer_of

    designs = {scenario: answer_of(study, "harmonic", scenario) for scenario in ranking.at_speeds}
    outcomes = [at.learned for at in ranking.at_speeds.values()]
    lines = ["", *_answer_lines(study, ranking, designs)]
    if unusual and any(answer.uneven or not answer.holds for answer in outcomes):
        lines += _wrapped(f"Check first what is unusual for such a motor: {', '.join(unusual)}.")
    lines += _settings_lines(study, settings, path)
    # Effects on harmonic's ripple don't matter where learning is not worth it.
    effects = ranking.largest([name for name in designs if not _is_worthless(designs[name])])[:SHOWN_EFFECTS]
    if ranking.hopeless:
        speeds = _speeds(study, ranking.hopeless) if len(designs) > 1 else "this speed"
        lines += ["", *_wrapped(f"No guess, at either end of its range, makes harmonic hold {speeds}.")]
    clear_at = {effect.scenario for effect in effects}
    for scenario, outcome in ranking.chance.items():
        if not outcome.never_holds and not _is_worthless(designs[scenario]):
            lines += ["", *_wrapped(_chance_text(study, ranking, scenario, scenario in clear_at))]
    if effects:
        count = {1: "One guess matters", 2: "Two guesses matter", 3: "Three guesses matter"}[len(effects)]
        of_runs = f", as runs of {ranking.duration:.2g} s show" if ranking.duration else ""
        most = "" if any(effect.nominal.of_seeds for effect in effects) else " most"
        lines += ["", f"{count}{most}{of_runs}. Measure or look up first:"]
    for place, effect in enumerate(effects, 1):
        head = f"{place}. {effect.guess.name}, {effect.guess.span} ({effect.guess.key}):"
        where = f"at {_speeds(study, [effect.scenario])} " if len(designs) > 1 else ""
        lines += _wrapped(f"{head} {where}{_effect_text(effect)}", "  ", "     ")
    return [
        *lines,
        "",
        *_wrapped(f"Next: {program()} run {_called(path)}"),
        *_wrapped(f"  or: {program()} live {_called(path)}"),
    ]


def _chance_text(study: Study, ranking: Ranking, scenario: str, is_clear: bool) -> str:
    """How much a speed's ripple differs between seeds. `is_clear`: a guess changes it by more."""
    runs = f"runs of {ranking.duration:.2g} s" if ranking.duration else "runs"
    first, second, third = ranking.seeds
    text = (
        f"The ripple at {_speeds(study, [scenario])} is partly chance: with the seeds {first}, {second} and "
        f"{third}, {runs} of harmonic leave {_ripples(ranking.chance[scenario])}."
    )
    return text if is_clear else f"{text} No guess, at an end of its range, clearly changes it by more."


def _answer_lines(study: Study, ranking: Ranking, designs: Mapping[str, Answer | None]) -> list[str]:
    """What the runs show at each speed, and why: a paragraph for one speed, a line each for several."""
    reasons = _reasons(study, ranking, designs)
    if len(ranking.at_speeds) == 1:
        ((scenario, at),) = ranking.at_speeds.items()
        return _wrapped(" ".join([_sentence(_speeds(study, [scenario]), at), *reasons]))
    lines = _wrapped("Ripple (rms) with a PI, and with the learning law harmonic:")
    for scenario, at in ranking.at_speeds.items():
        pi, learned = _result(at.baseline, at.baseline.uneven), _result(at.learned)
        text = f"at {_speeds(study, [scenario])}: PI {pi}, harmonic {learned}"
        lines += _wrapped(text, "  ", "    ")
    return [*lines, *(line for reason in reasons for line in _wrapped(reason))]


def _sentence(speed: str, at: AtSpeed) -> str:
    if not at.learned.holds:
        text = f"With these numbers the learning law harmonic does not hold {speed}: {at.learned.why}."
        if at.baseline.holds:
            text += f" The PI holds it, with {_rpm(at.baseline.ripple)} of ripple (rms)."
        return text
    before = f"the PI leaves {_rpm(at.baseline.ripple)} of ripple (rms){_jerks(at.baseline)}"
    if not (at.baseline.holds or at.baseline.uneven):
        before = f"the PI does not hold the speed ({at.baseline.why})"
    return f"At {speed} {before}, the learning law harmonic {_result(at.learned)}."


def _result(answer: Outcome, uneven: bool = False) -> str:
    """The ripple of a run, or why it does not hold the speed. `uneven`: jerks are said with their ripple."""
    if answer.holds or uneven:
        return f"{_rpm(answer.ripple)}{_jerks(answer)}"
    return f"does not hold the speed ({answer.why})"


def _reasons(study: Study, ranking: Ranking, designs: Mapping[str, Answer | None]) -> list[str]:
    """Sentences on why a speed is not held or held unevenly, and on what the design doubts."""
    learned = {scenario: at.learned for scenario, at in ranking.at_speeds.items()}
    warned = [
        scenario
        for scenario, answer in learned.items()
        if (answer.uneven if answer.holds else not _is_worthless(designs[scenario]))
    ]
    texts: dict[str, list[str]] = {}  # sentence without its speeds -> scenarios
    for scenario, design in designs.items():
        if design is not None and _is_worthless(design):
            texts.setdefault(f"by calculation learning is {design.words}.", []).append(scenario)
            continue
        if design is not None and design.doubt and learned[scenario].holds:
            texts.setdefault(f"another run may leave more: {design.doubt}.", []).append(scenario)
        if _harms(ranking.at_speeds[scenario]):
            texts.setdefault("learning does not help: harmonic leaves more ripple than the PI.", []).append(
                scenario
            )
    sentences = [
        text[0].upper() + text[1:]
        if len(scenarios) == len(designs) or " rpm" in text  # the design's own words have the speed
        else f"At {_speeds(study, scenarios)} {text}"
        for text, scenarios in texts.items()
    ]
    return [*_why_not(study, warned), *sentences]


def _harms(at: AtSpeed) -> bool:
    """Whether both laws hold the speed and the PI leaves less ripple than the law that learns."""
    return at.learned.holds and at.baseline.holds and at.baseline.ripple < at.learned.ripple


def _is_worthless(design: Answer | None) -> bool:
    return design is not None and design.verdict == "not worth it"


def _settings_lines(study: Study, settings: Settings, path: Path) -> list[str]:
    """Which settings of the drive hold a speed that is not held, as runs show, and which do not help."""
    from cogless.design.changes import change_words
    from cogless.study.toml import toml

    lines = []
    outcomes = {name: answer for name, answer in settings.outcomes.items() if answer.holds}
    if outcomes:
        ripples = " and ".join(_rpm(answer.ripple) for answer in outcomes.values())
        text = f"With {change_words(settings.changes)} harmonic holds {_speeds(study, [*outcomes])}"
        lines += _wrapped(f"{text}: it leaves {ripples} of ripple (rms). If your drive can do this, try:")
        sets = [f"--set {shlex.quote(f'{key}={toml(value)}')}" for key, value in settings.changes.items()]
        lines.append(f"  {program()} run {_called(path)} " + " \\\n    ".join(sets))
    if settings.vain:
        lines += _wrapped(f"Tried in vain: {', '.join(settings.vain)}.")
    return ["", *lines] if lines else []


def _jerks(answer: Outcome) -> str:
    return " in jerks" if answer.uneven else ""


def _why_not(study: Study, scenarios: Sequence[str]) -> list[str]:
    """Warnings that references are beyond the drive, then those on the controller `harmonic`."""
    from cogless.design.warnings import beyond_drive, warnings
    from cogless.study import changed

    if not scenarios:
        return []
    tables = study.source.tables["scenario"]
    alone = changed(study, {"scenario": {name: tables[name] for name in scenarios}})
    remarks = [*beyond_drive(alone, scenarios), *warnings(alone, scenarios[0], "harmonic")]
    return [f"{text}." for text in dict.fromkeys(str(remark) for remark in remarks)]


def _speeds(study: Study, scenarios: Sequence[str]) -> str:
    """The speeds of scenarios, such as "5 r/min and 20 r/min"."""
    return " and ".join(_rpm(study.scenario[name].top_reference) for name in scenarios)


def _effect_text(effect: Effect) -> str:
    with_seeds = ", with each seed" if effect.nominal.of_seeds else ""
    if effect.decides:
        if effect.nominal.never_holds:
            good, outcome = next(item for item in effect.outcomes.items() if item[1].surely_holds)
            return (
                f"with {good} the speed is held{with_seeds}, and harmonic leaves "
                f"{_ripples(outcome)}{_jerks(outcome)}"
            )
        label, outcome = next(item for item in effect.outcomes.items() if item[1].never_holds)
        with_any = ", with any seed" if effect.nominal.of_seeds else ""
        return f"with {label} the speed is not held{with_any}: {outcome.why}"
    if effect.nominal.of_seeds:
        (low, least), *_, (high, largest) = effect.held_outcomes
        ends = [
            f"{_ripples(least)} with {low or 'the guessed value'}",
            f"{_ripples(largest)} with {high or 'the guessed value'}",
        ]
        return f"harmonic leaves {', '.join(ends)}"
    return f"harmonic leaves {' to '.join((_rpm(effect.ripples[0], ''), _rpm(effect.ripples[1])))}"


def _ripples(answer: Outcome) -> str:
    """The ripple of a run, or its range over the seeds."""
    low, high = (_rpm(ripple) for ripple in answer.ripple_range)
    return high if low == high else f"{low.partition(' ')[0]} to {high}"


def _rpm(speed: float, unit: str = " r/min") -> str:
    from cogless import units
    from cogless.starter.amounts import digits

    return f"{digits(units.convert(speed, 'rpm', units.ANGULAR_SPEED))}{unit}"


def _called(path: Path) -> str:
    """The study's name in a command: without .toml, unless a shipped study or a file has that name."""
    from cogless.files import shipped

    bare = path.with_suffix("")
    return str(path if str(bare) in shipped("studies") or bare.exists() else bare)


def _wrapped(text: str, first: str = "", others: str = "") -> list[str]:
    return textwrap.wrap(
        text,
        LINE_COLUMNS,
        initial_indent=first,
        subsequent_indent=others,
        break_on_hyphens=False,
        break_long_words=False,
    )


def _has_own_words(study: Study) -> bool:
    """Whether the motor table has the datasheet's keys for which a page has fields of one's own motor."""
    motor = study.source.tables["motor"]
    return all(key in motor for key in ("kv", "resistance_line_to_line", "inductance_line_to_line"))
