"""`cogless new` as a user meets it: what it prints, what it asks, and one line for a mistake."""

import io
import math
import re
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import cogless
from drafts import request

from cogless import units
from cogless.cli.new import _answer_lines, _ranking_lines
from cogless.cli.terminal import program
from cogless.design.answers import Answer, answer_of
from cogless.starter import AtSpeed, Effect, Outcome, Ranking, Settings, draft, parse_speeds
from cogless.starter.sheet import Guess
from cogless.study import load

SHORT = ("--motor", "gm5208", "--drive", "generic", "--encoder", "as5048")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def unranked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the runs that rank the guesses."""
    monkeypatch.setattr(sys.modules["cogless.cli.new"], "_show_ranking", lambda *_: None)


def test_it_writes_a_study_and_says_what_matters_and_what_is_next(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = cogless(capsys, "new", "my_motor", *SHORT)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0] == "Wrote my_motor.toml."
    begin = lines.index("") + 1
    assert lines[begin].startswith("At 20 r/min the PI leaves ") and lines[begin + 1].endswith(" r/min.")
    assert "Three guesses matter most. Measure or look up first:" in lines
    assert [line[:4] for line in lines if line.startswith("  ") and line[2:3].isdigit()] == [
        "  1.",
        "  2.",
        "  3.",
    ]
    assert lines[-2:] == ["Next: cogless run my_motor", "  or: cogless live my_motor"]
    code, out, _ = cogless(capsys, "run", "my_motor", "--only", "slow/pi", "--no-limits", "-o", "results")
    assert code == 0 and "speed ripple: PI " in out
    assert load("my_motor").title == "My motor"


GUIDE = (Path(__file__).parents[2] / "docs" / "guide" / "new.md").read_text(encoding="utf-8")


def test_the_guide_shows_what_comes_out(capsys: pytest.CaptureFixture[str]) -> None:
    commands = re.findall(r"^    cogless (new .*)$", GUIDE, re.MULTILINE)
    output = re.search(r"```text\n(.*?)```", GUIDE, re.DOTALL)
    example = re.search(r"```toml\n(.*?)```", GUIDE, re.DOTALL)
    assert output is not None and example is not None
    assert cogless(capsys, *shlex.split(commands[0])) == (0, output[1], "")
    assert example[1] in Path("my_motor.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("line", re.findall(r"^    cogless new (.*)$", GUIDE, re.MULTILINE)[1:])
def test_the_other_commands_of_the_guide_write_a_study(
    unranked: None, capsys: pytest.CaptureFixture[str], line: str
) -> None:
    arguments = shlex.split(line)
    assert cogless(capsys, "new", *arguments)[0] == 0
    assert load(arguments[0]).controller.keys() == {"pi", "harmonic"}


def test_a_file_is_replaced_by_force_only(unranked: None, capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.toml").write_text("mine", encoding="utf-8")
    line = "mine.toml: the file exists: expected a new name, or --force to replace the file\n"
    for name in ("mine", "mine.toml"):
        assert cogless(capsys, "new", name, *SHORT) == (2, "", line)
    assert Path("mine.toml").read_text(encoding="utf-8") == "mine"
    assert cogless(capsys, "new", "mine", *SHORT, "--force")[0] == 0
    assert load("mine").title == "Mine"


def test_a_shipped_studys_name_is_written_with_its_ending(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = cogless(capsys, "new", "gimbal", *SHORT)
    assert out.splitlines()[-2] == "Next: cogless run gimbal.toml"


def test_it_says_why_a_speed_is_not_held(capsys: pytest.CaptureFixture[str]) -> None:
    numbers = ("--pole-pairs", 4, "--torque-constant", 0.5, "--resistance", 1.5, "--bits", 17, "--speed", 600)
    code, out, _ = cogless(capsys, "new", "fast", *numbers, "--drive", "generic")
    text = " ".join(out.split())
    assert (
        code == 0
        and "With these numbers the learning law harmonic does not hold 600 r/min: the mean speed is " in text
    )
    assert "its reference of 600 rpm needs more than the bus voltage" in text
    assert max(map(len, out.splitlines())) <= 80


def test_it_names_a_number_that_is_unusual_where_the_speed_is_not_held(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """With an inertia of the class the speed is held. The resistance is only 3 % beyond its range."""
    numbers = ("--pole-pairs", 7, "--kv", 30, "--resistance", 12.5, "--current-limit", 1, "--speed", 30)
    motor = (
        "--motor",
        "gimbal",
        *numbers,
        "--bus-voltage",
        15,
        "--drive",
        "simplefoc",
        "--encoder",
        "as5048",
    )
    _, out, _ = cogless(capsys, "new", "light", *motor, "--inertia", "12 g*cm^2")
    text = " ".join(out.split())
    assert "harmonic does not hold 30 r/min" in text
    assert "No guess, at either end of its range, makes harmonic hold this speed." in text
    says = "Check first what is unusual for such a motor: --inertia 12 g*cm^2 (usual: 162 to 540 g*cm^2)."
    assert says in text and "--resistance" not in text
    _, out, _ = cogless(capsys, "new", "usual", *motor, "--inertia", "200 g*cm^2")
    assert "does not hold" not in out and "unusual" not in out


def outcome(ripple: float, why: str = "", uneven: bool = False) -> Outcome:
    """A run's answer; ripple in r/min."""
    return Outcome(ripple=ripple * math.pi / 30, why=why, uneven=uneven)


def answer(learned: Outcome, baseline: Outcome, design: Answer | None = None) -> str:
    study = load(Path(__file__).parents[2] / "examples" / "my_motor.toml")
    at_speeds = {"slow": AtSpeed(learned=learned, baseline=baseline)}
    return " ".join(_answer_lines(study, Ranking(at_speeds=at_speeds, effects=()), {"slow": design}))


def test_on_either_side_of_the_limit_of_a_held_speed_the_same_is_said() -> None:
    just, not_quite = outcome(5, uneven=True), outcome(5, "the rotor turns in jerks", uneven=True)
    texts = {answer(outcome(0.2), baseline) for baseline in (just, not_quite)}
    assert texts == {
        "At 30 r/min the PI leaves 5 r/min of ripple (rms) in jerks, the learning law harmonic 0.2 r/min."
    }
    both = answer(outcome(2, uneven=True), just)
    assert (
        "the PI leaves 5 r/min of ripple (rms) in jerks, the learning law harmonic 2 r/min in jerks." in both
    )
    lost = answer(outcome(0.2), outcome(5, "the mean speed is 30 % of the reference"))
    assert (
        "the PI does not hold the speed (the mean speed is 30 % of the reference), the learning law harmonic"
        in lost
    )


def test_where_the_pi_alone_holds_the_speed_it_is_said_with_why_learning_is_not_worth_it() -> None:
    vain = Answer("not worth it", "not worth it: the law learns order 1, but the torque has only order 2")
    text = answer(outcome(9, "the rotor turns in jerks", uneven=True), outcome(0.6), vain)
    assert text == (
        "With these numbers the learning law harmonic does not hold 30 r/min: the rotor turns in jerks. The "
        "PI holds it, with 0.6 r/min of ripple (rms). By calculation learning is not worth it: the law "
        "learns order 1, but the torque has only order 2."
    )


def test_learning_that_is_not_worth_it_at_a_faster_speed_only_keeps_its_guesses(tmp_path: Path) -> None:
    """At 30 r/min harmonic leaves less than its feedback, at 3,000 r/min the sensor's error is all."""
    servo = request("servo", "generic", "absolute", bits=20, speed=30)
    path = tmp_path / "mine.toml"
    made = draft(replace(servo, faster=parse_speeds(["3000"])), "Mine", path)
    path.write_text(made.text, encoding="utf-8")
    study = load(path)
    verdicts = [answer_of(study, "harmonic", scenario) for scenario in study.scenario]
    assert [found and found.verdict for found in verdicts] == ["yes", "not worth it"]
    small, large = (Effect(guess=made.guesses[0], scenario=scenario, nominal=outcome(0.3),
                           outcomes={"more": outcome(ripple)})
                    for scenario, ripple in (("at_30_rpm", 0.6), ("at_3000_rpm", 9)))  # fmt: skip
    at_speeds = {
        "at_30_rpm": AtSpeed(learned=outcome(0.3), baseline=outcome(2)),
        "at_3000_rpm": AtSpeed(learned=outcome(9), baseline=outcome(5, "the speed isn't finite")),
    }
    ranking = Ranking(at_speeds=at_speeds, effects=(large, small))
    lines = _ranking_lines(study, ranking, Settings(), path, ())
    assert lines[1:4] == [
        "Ripple (rms) with a PI, and with the learning law harmonic:",
        "  at 30 r/min: PI 2 r/min, harmonic 0.3 r/min",
        "  at 3000 r/min: PI does not hold the speed (the speed isn't finite), harmonic 9",
    ]
    text = " ".join(" ".join(lines).split())
    assert (
        "By calculation learning is not worth it: at 3000 rpm learning leaves " in text
        and "it: at 30 rpm" not in text
    )
    assert "One guess matters most. Measure or look up first:" in lines
    assert "at 30 r/min harmonic leaves 0.3 to 0.6 r/min" in text
    without_guesses = " ".join(_ranking_lines(study, replace(ranking, effects=()), Settings(), path, ()))
    assert "guess" not in without_guesses.lower()
    worse = {"at_30_rpm": AtSpeed(learned=outcome(2.5), baseline=outcome(2))}
    both = " ".join(
        _ranking_lines(study, Ranking(at_speeds=at_speeds | worse, effects=()), Settings(), path, ())
    )
    assert "At 30 r/min learning does not help: harmonic leaves more ripple than the PI." in " ".join(
        both.split()
    )
    assert "does not help" not in text


def test_where_a_run_is_partly_chance_the_range_of_its_seeds_is_printed() -> None:
    study = load(Path(__file__).parents[2] / "examples" / "my_motor.toml")

    def seeded(*outcomes: Outcome) -> Outcome:
        return replace(outcomes[0], of_seeds=outcomes[1:])

    nominal = seeded(outcome(0.5), outcome(0.8), outcome(0.6))
    lost = seeded(*[outcome(40, "the rotor turns in jerks")] * 3)
    small = seeded(outcome(0.2), outcome(0.1), outcome(0.3))
    at_speeds = {"slow": AtSpeed(learned=outcome(0.5), baseline=outcome(2))}

    def printed(*variants: Outcome) -> list[str]:
        effects = tuple(
            Effect(
                guess=Guess(key=f"key.{n}", name=f"name {n}", span="1 to 2", variants={}),
                scenario="slow",
                nominal=nominal,
                outcomes={"1 mN*m": variant},
            )
            for n, variant in enumerate(variants)
        )
        chance = {"slow": nominal}
        ranking = Ranking(at_speeds=at_speeds, effects=effects, duration=12.0, seeds=(0, 1, 2), chance=chance)
        return _ranking_lines(study, ranking, Settings(), Path("mine.toml"), ())

    clear, unclear = printed(lost, small), printed(seeded(outcome(0.2), outcome(0.55), outcome(0.4)))
    begin = clear.index("The ripple at 30 r/min is partly chance: with the seeds 0, 1 and 2, runs of 12 s")
    assert clear[begin + 1 :][:8] == [
        "of harmonic leave 0.5 to 0.8 r/min.",
        "",
        "Two guesses matter, as runs of 12 s show. Measure or look up first:",
        "  1. name 0, 1 to 2 (key.0): with 1 mN*m the speed is not held, with any seed:",
        "     the rotor turns in jerks",
        "  2. name 1, 1 to 2 (key.1): harmonic leaves 0.1 to 0.3 r/min with 1 mN*m, 0.5",
        "     to 0.8 r/min with the guessed value",
        "",
    ]
    text = " ".join(" ".join(unclear).split())
    assert "leave 0.5 to 0.8 r/min. No guess, at an end of its range, clearly changes it by more." in text
    assert "matter" not in text


def test_a_setting_that_holds_a_speed_is_printed_with_its_command_and_what_did_not_help() -> None:
    study = load(Path(__file__).parents[2] / "examples" / "my_motor.toml")
    lost = AtSpeed(learned=outcome(40, "the rotor turns in jerks"), baseline=outcome(50, "it stops"))
    ranking = Ranking(at_speeds={"slow": lost}, effects=())
    rate = {"drive.rates.speed_loop": "20 kHz"}
    settings = Settings(changes=rate, outcomes={"slow": outcome(2.4)}, vain=["an observer", "a slower loop"])
    lines = _ranking_lines(study, ranking, settings, Path("mine.toml"), ())
    begin = lines.index("", 1)
    assert lines[begin + 1 : begin + 5] == [
        'With drive.rates.speed_loop = "20 kHz" harmonic holds 30 r/min: it leaves 2.4',
        "r/min of ripple (rms). If your drive can do this, try:",
        "  cogless run mine --set 'drive.rates.speed_loop=\"20 kHz\"'",
        "Tried in vain: an observer, a slower loop.",
    ]
    nothing = Settings(vain=["an observer", "a slower loop"])
    assert "Tried in vain: an observer, a slower loop." in _ranking_lines(
        study, ranking, nothing, Path("mine.toml"), ()
    )


MOTORS = "gimbal, drone, direct-drive, hub, servo, spindle, own, nema17, nema23"
DRIVES = "generic, moteus, odrive, vesc, simplefoc, stepper"
ENCODERS = "as5047, as5048, as5600, ma732, mt6701, absolute, incremental, hall"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--motor gimbal --drive odrv --encoder hall",
         f'--drive: "odrv": expected one of {DRIVES}, perhaps "odrive"'),
        ("--motor gimbal --drive odrive --encoder mt6710",
         f'--encoder: "mt6710": expected one of {ENCODERS}, perhaps "mt6701"'),
        ("--pole-pairs 7 --drive odrv", f'--drive: "odrv": expected one of {DRIVES}, perhaps "odrive"'),
        ("--motor nema17 --drive moteus --encoder hall",
         '--drive: "moteus": expected one of generic, simplefoc, stepper, since a step motor has two phases; '
         "for a motor with three give another --motor, such as servo"),
        ("--motor gimbal --drive stepper --encoder hall",
         '--drive: "stepper": expected one of generic, moteus, odrive, vesc, simplefoc, '
         "since the motor has three phases"),
        ("--motor gimbal --drive odrive --encoder as5047 --cpr 4000",
         '--cpr: "4000": expected no such option, unless the encoder is incremental'),
        ("--motor gimbal --drive odrive --encoder hall --bits 14",
         '--bits: "14": expected no such option, unless the encoder is absolute'),
        ("--motor uomodri --drive odrive --encoder as5047 --cogging 0.01",
         '--cogging: "0.01 N*m": expected no such option, since the datasheet of uomodri has it'),
        ("--motor krishnamurthy2003 --drive stepper --encoder as5047 --holding-torque 1",
         '--holding-torque: "1 N*m": expected no such option, since the datasheet of krishnamurthy2003 has '
         'it'),
        ("--magnets 40", "--magnets: expected --pole-pairs, half the number of magnets: --pole-pairs 20"),
        ("--kv 300V", '--kv: "300V": expected a speed per voltage, such as "1 rpm/V"'),
        ("--kv fast", '--kv: "fast": expected a number in rpm/V, or with its unit, such as "1 rpm/V"'),
        ("--kv -3", '--kv: "-3": expected more than zero'),
        ("--inertia 0", '--inertia: "0": expected more than zero'),
        ("--pole-pairs 1.5", '--pole-pairs: "1.5": expected a whole number from 1 to 1000'),
        ("--bits 30", '--bits: "30": expected a whole number from 2 to 24'),
        ("--cpr 1001", '--cpr: "1001": expected a multiple of 4, since each line gives four counts'),
        ("--motor gimbal --drive moteus --encoder as5047 --bus-voltage 60",
         '--bus-voltage: "60 V": expected 10 to 44 V, the range of moteus'),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(capsys: pytest.CaptureFixture[str], arguments: str, message: str) -> None:
    assert cogless(capsys, "new", "mine", *arguments.split()) == (2, "", f"{message}\n")
    assert not Path("mine.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "missing"),
    [
        ("", "motor drive encoder"),
        ("--motor gimbal --drive odrive", "encoder"),
        ("--motor gimbal --cpr 4000", "drive"),
        ("--kv 270 --resistance 0.04 --drive vesc --encoder hall", "pole-pairs"),
        ("--motor own --drive odrive --encoder hall", "pole-pairs kv resistance"),
        ("--pole-pairs 7 --current-rate 10000", "encoder kv resistance"),
        ("--pole-pairs 7 --drive odrive --encoder hall --rated-torque 1 --rated-current 2", "resistance"),
    ],
)
def test_all_that_is_missing_is_in_one_line_whose_examples_are_enough(
    unranked: None, capsys: pytest.CaptureFixture[str], arguments: str, missing: str
) -> None:
    code, out, err = cogless(capsys, "new", "mine", *arguments.split())
    assert (code, out, err.count("\n")) == (2, "", 1)
    begin = ", ".join(f"--{flag}" for flag in missing.split())
    line = re.fullmatch(
        rf"{begin}: missing: expected values such as (.*); cogless new --help lists all\n", err
    )
    assert line is not None, err
    assert re.findall(r"--([a-z-]+)", line[1]) == missing.split()
    assert cogless(capsys, "new", "mine", *arguments.split(), *line[1].split())[0] == 0


def test_a_misspelled_motor_is_told_that_was_meant(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = cogless(capsys, "new", "mine", "--motor", "gm5280")
    assert (code, out) == (2, "")
    assert err.startswith(f'--motor: "gm5280": expected one of {MOTORS}, gm5208, ')
    assert err.endswith(', perhaps "gm5208"\n') and err.count("\n") == 1


def scripted(monkeypatch: pytest.MonkeyPatch, *answers: str) -> None:
    """Someone at a terminal who gives these answers."""
    monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{answer}\n" for answer in answers)))
    monkeypatch.setattr(sys.modules["cogless.cli.new"], "asks", lambda: True)


def test_questions_at_a_terminal(
    unranked: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripted(
        monkeypatch,
        "own",
        "11",
        "",
        "nothing",
        "58",
        "5.6 ohm",
        "",
        "",
        "",
        "odriv",
        "odrive",
        "absolute",
        "30",
    )
    code, out, err = cogless(capsys, "new", "asked")
    assert (code, err) == (0, "")
    assert "Which motor is most like yours? [own]: " in out
    assert '"nothing": expected a number in rpm/V, or with its unit, such as "1 rpm/V"' in out
    assert f'"odriv": expected one of {DRIVES}, perhaps "odrive"' in " ".join(out.split())
    assert max(map(len, out.replace("]: ", "]: \n").splitlines())) <= 80
    tables: dict[str, Any] = load("asked").source.tables
    inductance = tables["motor"]["inductance_line_to_line"]
    assert f"Inductance between two terminals, in mH [guess: {inductance}]: " in out
    assert f"--slots 24, --inductance {inductance}, " in " ".join(out.split())
    assert tables["motor"]["pole_pairs"] == 11 and tables["motor"]["kv"] == "58 rpm/V"
    assert tables["motor"]["resistance_line_to_line"] == "5.6 ohm"
    assert tables["drive"]["rates"]["current_loop"] == "8 kHz"
    assert tables["scenario"]["slow"]["reference"] == "30 rpm"


def test_a_motor_of_ones_own_may_have_a_torque_constant_and_an_inductance(
    unranked: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripted(monkeypatch, "own", "8", "", "33.5 mN*m/A", "0.573", "", "", "0.6", "generic", "as5047", "30")
    assert cogless(capsys, "new", "asked")[0] == 0
    motor = load("asked").source.tables["motor"]
    assert motor["K_t"] == "33.5 mN*m/A" and "kv" not in motor
    assert motor["inductance_line_to_line"] == "0.6 mH"


def test_slots_and_inertia_are_asked_and_not_known_they_are_guessed(
    unranked: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """18 slots and 16 poles have 144 waves of cogging a turn, 12 slots have 48."""
    begin, end = ("own", "8"), ("generic", "as5047", "30")
    for name, slots, inertia in (("unknown", "", ""), ("known", "12", "120 g*cm^2")):
        scripted(monkeypatch, *begin, slots, "33.5 mN*m/A", "0.573", "", inertia, "", *end)
        code, out, _ = cogless(capsys, "new", name)
        tables = load(name).source.tables
        guess = tables["mechanics"]["inertia"]
        assert code == 0 and "Slots (teeth of the stator) [guess: 18]: " in out
        printed = " ".join(out.split())
        if inertia:
            assert tables["motor"]["slots"] == 12 and tables["motor"]["cogging"][0]["order"] == 48
            assert guess == inertia and "--slots" not in printed and "--inertia" not in printed
        else:
            assert tables["motor"]["slots"] == 18 and tables["motor"]["cogging"][0]["order"] == 144
            assert f"Inertia of rotor and load together, in kg*m^2 [guess: {guess}]: " in out
            assert "--slots 18, " in printed and f"--inertia {guess}, " in printed


def test_beside_an_inertia_of_the_load_that_of_all_is_not_asked(
    unranked: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripted(monkeypatch, "nema17", "0.4 N*m", "1.7", "1.5", "2.8", "stepper", "as5047", "20")
    code, out, _ = cogless(capsys, "new", "asked", "--load-inertia", "60 g*cm^2")
    assert code == 0 and "Inertia" not in out


def test_of_a_step_motor_the_inductance_is_asked_and_the_detent_torque_is_not(
    unranked: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripted(monkeypatch, "nema17", "0.4 N*m", "1.7", "1.5", "2.8", "", "stepper", "as5047", "20")
    _, out, _ = cogless(capsys, "new", "asked")
    assert load("asked").source.tables["motor"]["L_0"] == "2.8 mH"
    guessed = " ".join(out.split()).partition("Not given, so guessed: ")[2].partition(".\u0020In")[0]
    flags = re.findall(r"--([a-z-]+) ", guessed)
    assert flags == [
        "step-angle", "inertia", "detent-torque", "friction", "bus-voltage", "current-rate", "speed-rate"
    ]  # fmt: skip


def test_an_inertia_of_rotor_and_load_takes_no_load_beside_it(capsys: pytest.CaptureFixture[str]) -> None:
    motor = ("--pole-pairs", 7, "--kv", 80, "--resistance", 0.5, "--drive", "generic", "--encoder", "as5047")
    both = ("--inertia", "92.5 g*cm^2", "--load-inertia", "60 g*cm^2")
    code, _, err = cogless(capsys, "new", "slider", *motor, *both)
    assert code == 2 and err.strip() == (
        '--load-inertia: "60 g*cm^2": expected no such option, since --inertia is that of rotor and load '
        "together: add the two"
    )


def test_each_question_has_a_default_which_is_a_guess_like_all_others(
    unranked: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripted(monkeypatch, *[""] * 12)
    code, out, _ = cogless(capsys, "new", "plain")
    assert code == 0
    motor = load("plain").source.tables["motor"]
    listed = dict(re.findall(r"--([a-z-]+) ([^,]+?)(?=, |\. Guesses)", " ".join(out.split())))
    assert listed["pole-pairs"] == str(motor["pole_pairs"]) == "7"
    assert listed["kv"] == motor["kv"] == "80 rpm/V"
    assert listed["resistance"] == motor["resistance_line_to_line"] == "0.46 ohm"
    assert listed["inductance"] == motor["inductance_line_to_line"] == "0.46 mH"
    for question in ("magnets) [guess: 7]", "N*m/A [guess: 80 rpm/V]", "ohm [guess: 0.46 ohm]"):
        assert question in out
    lines = Path("plain.toml").read_text(encoding="utf-8").splitlines()
    for key in ("pole_pairs", "kv", "resistance_line_to_line"):
        place = next(n for n, line in enumerate(lines) if line.startswith(f"{key} = "))
        comment = next(line for line in reversed(lines[:place]) if not line.startswith("#   "))
        assert comment.startswith("# guess: "), key


def test_the_guesses_given_by_their_flags_make_the_same_study(
    unranked: None, capsys: pytest.CaptureFixture[str]
) -> None:
    """All but the cogging, whose sum is divided in another way than the class's parts."""
    own = ("--pole-pairs", 7, "--kv", 80, "--resistance", 0.5, "--drive", "generic", "--encoder", "as5047")
    _, out, _ = cogless(capsys, "new", "first", *own)
    first = load("first").source.tables
    text = " ".join(out.split())
    guessed = text.partition("Not given, so guessed: ")[2].partition(
        ". Guesses without an option, to be changed in the file:"
    )
    listed = dict(re.findall(r"--([a-z-]+) ([^,]+)", guessed[0]))
    cogging = listed.pop("cogging")
    assert {"inertia", "friction", "slots", "inductance", "bus-voltage", "current-limit"} < listed.keys()
    flags = [word for flag, value in listed.items() for word in (f"--{flag}", value)]
    assert cogless(capsys, "new", "second", *own, *flags)[0] == 0
    assert load("second").source.tables == first | {"title": "Second"}
    waves = first["motor"]["cogging"]
    sizes = [units.parse(wave["torque"], units.TORQUE) for wave in waves]
    phases = [units.parse(wave.get("phase", "0 deg"), units.ANGLE) for wave in waves]
    angles = np.linspace(0, math.tau, 50_001)
    total = sum(
        size * np.sin(wave["order"] * angles + phase)
        for wave, size, phase in zip(waves, sizes, phases, strict=True)
    )
    assert units.parse(cogging, units.TORQUE) == pytest.approx(float(np.ptp(total)) / 2, rel=0.01)
    keys = dict(re.findall(r"([a-z_.0-9]+) ([^,]+?)(?:, |\.$|\. |\.\Z)", guessed[2] + " "))
    assert keys["drive.inverter.dead_time"] == first["drive"]["inverter"]["dead_time"]
    errors = first["drive"]["position_sensor"]["error"]
    assert keys["drive.position_sensor.error.1.amplitude"] == errors[1]["amplitude"]


@pytest.mark.parametrize(
    ("flag", "number", "says"),
    [
        # The peak between two terminals is sqrt(3) psi p w, the torque per peak ampere 1.5 p psi.
        ("kv", "60", "--kv 60 rpm/V: torque constant 0.138 N*m/A (per ampere of a phase, peak)."),
        ("torque-constant", "0.138", "--torque-constant 0.138 N*m/A: Kv 59.9 r/min per V."),
        ("back-emf", "33 mV/rpm", "--back-emf 33 mV/rpm: torque constant 0.386 N*m/A (per ampere of a phase, "
                                  "peak), Kv 21.4 r/min per V."),
    ],
)  # fmt: skip
def test_the_other_constants_of_the_magnet_are_printed(
    unranked: None, capsys: pytest.CaptureFixture[str], flag: str, number: str, says: str
) -> None:
    motor = ("--pole-pairs", 7, "--resistance", 0.5, "--drive", "generic", "--encoder", "as5047")
    _, out, _ = cogless(capsys, "new", "mine", *motor, f"--{flag}", number)
    assert says in " ".join(out.split())


def test_the_current_limit_of_a_step_motor_is_explained(
    unranked: None, capsys: pytest.CaptureFixture[str]
) -> None:
    step = ("--holding-torque", 0.45, "--drive", "stepper", "--encoder", "as5047", "--speed", 60)
    _, out, _ = cogless(capsys, "new", "step", *step, "--rated-current", 1.7)
    why = (
        "sqrt(2) times the rated 1.7 A of a coil; while the motor turns, each coil has a sine with this "
        "peak, whose rms value is 1.7 A"
    )
    assert f"Current limit: 2.4 A = {why}." in " ".join(out.split())
    text = " ".join(Path("step.toml").read_text(encoding="utf-8").replace("#", "").split())
    assert f'the motor\'s continuous current: {why} current_limit = "2.4 A"' in text


def test_numbers_alone_tell_the_kind_of_motor_and_sensor(
    unranked: None, capsys: pytest.CaptureFixture[str]
) -> None:
    step = ("--holding-torque", 0.45, "--rated-current", 1.5, "--drive", "stepper", "--cpr", 4000)
    assert cogless(capsys, "new", "step", *step)[0] == 0
    assert "motor nema17, drive stepper, encoder incremental" in Path("step.toml").read_text(encoding="utf-8")
    own = ("--pole-pairs", 7, "--kv", 80, "--resistance", 1, "--current-rate", 20_000, "--bits", 16)
    assert cogless(capsys, "new", "own", *own)[0] == 0
    assert "motor own, drive generic, encoder absolute" in Path("own.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(("motor", "own_fields"), [(SHORT, False), (("--motor", "gimbal", *SHORT[2:]), True)])
def test_live_makes_the_page(
    unranked: None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    motor: tuple[str, ...],
    own_fields: bool,
) -> None:
    called: list[tuple[str, bool]] = []

    def live(study: str, *, own_motor: bool, jobs: int) -> None:
        called.append((study, own_motor))

    monkeypatch.setattr(sys.modules["cogless.cli.studies"], "live", live)
    assert cogless(capsys, "new", "mine", *motor, "--live")[0] == 0
    assert called == [("mine.toml", own_fields)]


def test_questions_of_a_class(
    unranked: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Pole pairs, slots, torque constant, resistance, cogging and inertia.

    Each default is the class's typical value for the answers so far: 0.36 ohm for 16 rpm/V, which are
    0.517 N*m/A, become (0.95 / 0.517)^2 times as much.
    """
    answers = ("hub", "20", "", "0.95 N*m/A", "0.28 ohm/phase", "0.3", "", "vesc", "as5048", "20, 40")
    scripted(monkeypatch, *answers)
    code, out, err = cogless(capsys, "new", "asked")
    assert (code, err) == (0, "")
    for question in (
        "Pole pairs (half the number of magnets) [guess: 15]: ",
        "Kv in r/min per V, or torque constant such as 0.1 N*m/A [guess: 16 rpm/V]: ",
        "Resistance between two terminals, in ohm [guess: 1.22 ohm]: ",
        "Cogging torque, half of peak to peak, in N*m [guess: ",
    ):
        assert question in out
    assert "Inductance between two terminals, in mH [guess" not in out
    motor = load("asked").source.tables["motor"]
    assert (motor["pole_pairs"], motor["K_t"], motor["resistance_line_to_line"]) == (
        20, "0.95 N*m/A", "0.56 ohm"
    )  # fmt: skip
    assert [*load("asked").scenario] == ["at_20_rpm", "at_40_rpm"]


@pytest.mark.parametrize(("on_path", "expected"), [(False, "./bin/cogless"), (True, "cogless")])
def test_the_next_command_is_called_as_this_one_was(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, on_path: bool, expected: str
) -> None:
    script = tmp_path / "bin" / "cogless"
    script.parent.mkdir()
    script.write_text("#!/bin/sh\n", encoding="utf-8")
    script.chmod(0o755)
    monkeypatch.setenv("PATH", str(script.parent) if on_path else "")
    for called in ("./bin/cogless", str(script)):
        monkeypatch.setattr(sys, "argv", [called, "new", "mine"])
        assert program().removeprefix("./") == expected.removeprefix("./")
    monkeypatch.setattr(sys, "argv", ["./bin/cogless", "new", "mine"])
    assert program() == expected
