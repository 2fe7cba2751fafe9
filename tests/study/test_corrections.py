"""Messages that name the right text. The tests write that text, and check the study."""

import math
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

import studies
from cogless.design.auto import load
from cogless.errors import StudyError
from cogless.run.simulate import runs_of, simulate
from cogless.study.position_sensor import Counted

MY_MOTOR = Path(__file__).parents[2] / "examples" / "my_motor.toml"


def refused(study: str | Path, changes: dict[str, Any] | None = None) -> str:
    """The message on a study, without the file's name in front."""
    return studies.refusal(load, study, changes).removeprefix(f"{Path(study).name}: ")


def written(message: str) -> dict[str, Any]:
    """The tables of the text that a message advises to write, such as "lines = 2048"."""
    (text,) = re.findall(r"\w+ = (?:\{.*?\}|\w+)", message)
    return tomllib.loads(text)


# --- names


@pytest.mark.parametrize(
    ("name", "near"),
    [("uomodir", "uomodri"), ("uomodri.toml", "uomodri"), ("liu-2018", "liu2018"), ("hubmotor", "hub-motor")],
)
def test_the_name_of_a_shipped_study_is_told_that_was_probably_meant(name: str, near: str) -> None:
    message = refused(name)
    assert message.startswith("no such study: expected a file, or one of the shipped studies: arena, ")
    assert message.endswith(f', perhaps "{near}"')
    assert load(near).name == near


def test_a_file_beside_it_may_be_meant_too(tmp_path: Path) -> None:
    (tmp_path / "my_motor.toml").write_text(MY_MOTOR.read_text(encoding="utf-8"), encoding="utf-8")
    for name in ("my_moter.toml", "my_moter", "mymotor.toml"):
        assert refused(tmp_path / name).endswith(', perhaps "my_motor.toml"')
    assert load(tmp_path / "my_motor").source.path == tmp_path / "my_motor.toml"
    assert "perhaps" not in refused(tmp_path / "something-else.toml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"motor.datasheet": "uomodir"},
            'motor.datasheet: "uomodir": no such datasheet: expected a file, or one of the shipped motors: '
            'gm5208, '
            'hoverboard, krishnamurthy2003, liu2018, mandra2019, uomodri, perhaps "uomodri"'),
        ({"controller.harmonik.base": 6},
            'controller.harmonik.base: 6: expected one of the controllers pi, harmonic, perhaps "harmonic"'),
        ({"scenario.slwo.duration": "3 s"}, None),
        ({"scenario.slwo.load": "3 N*m"},
            'scenario.slwo.load: "3 N*m": expected one of the scenarios slow, perhaps "slow"'),
        ({"scenario.slow.controllers": ["harmonik"]},
            'scenario.slow.controllers.0: "harmonik": expected one of "pi", "harmonic", perhaps "harmonic"'),
        ({"metric.0.scenarios": ["slwo"]},
            'metric.0.scenarios: ["slwo"]: expected one of "slow", perhaps "slow"'),
        ({"controller.pi.law": "harmonik"},
            'controller.pi.law: "harmonik": expected one of "pi", "adrc", "pi-ilc", "robust-ilc", '
            '"anti-cogging", "space-position", "space-speed", "pi-afc", "harmonic", "microstepping", '
            '"python", "library", perhaps "harmonic"'),
    ],
)  # fmt: skip
def test_a_name_within_a_study_is_told_that_was_probably_meant(
    changes: dict[str, Any], message: str | None
) -> None:
    found = refused(MY_MOTOR, changes)
    if message is None:
        assert "perhaps" not in found  # a scenario of its own, which lacks its reference
    else:
        assert found == message


@pytest.mark.parametrize(
    ("pattern", "near"),
    [
        ("slow/harmonix", "slow/harmonic"),
        ("slow/po", "slow/pi"),
        ("slow", "slow/*"),
        ("harmonic", "*/harmonic"),
    ],
)
def test_the_run_that_was_probably_meant(pattern: str, near: str) -> None:
    study = load(MY_MOTOR)
    with pytest.raises(StudyError, match=f'perhaps "{re.escape(near)}"$'):
        runs_of(study, [pattern])
    assert runs_of(study, [near])


# --- a datasheet's words


@pytest.mark.parametrize(
    ("sensor", "message", "counts"),
    [
        ({"kind": "encoder", "cpr": 8192}, '"lines", a quarter of the counts: lines = 2048', 8192),
        ({"kind": "encoder", "CPR": 4000}, '"lines", a quarter of the counts: lines = 1000', 4000),
        ({"kind": "encoder", "counts": 400}, '"lines", a quarter of the counts: lines = 100', 400),
        ({"kind": "encoder", "ppr": 2048}, '"lines", the pulses of one channel: lines = 2048', 8192),
        (
            {"kind": "encoder", "cpr": 2501},
            '"lines": a quarter of the counts, or the number of cycles: lines = 2501',
            10004,
        ),
        ({"kind": "absolute", "cpr": 16384}, '"positions" in place of bits: positions = 16384', 16384),
        ({"kind": "encoder", "cpr": "many"}, '"lines", a quarter of the counts: lines = cpr / 4', None),
    ],
)
def test_counts_and_pulses_of_a_datasheet_say_how_they_are_written(
    sensor: dict[str, Any], message: str, counts: int | None
) -> None:
    (word,) = sensor.keys() - {"kind"}
    value = '"many"' if counts is None else sensor[word]
    found = refused(MY_MOTOR, {"drive.position_sensor": sensor})
    expected = f"drive.position_sensor.{word}: {value}: expected {message}"
    missing = "drive.position_sensor: expected either bits, such as 14, or positions, such as 10000"
    assert found in (expected, f"{expected}\n{missing}")
    if counts is not None:
        own = {"kind": sensor["kind"], **written(found)}
        position_sensor = load(MY_MOTOR, {"drive.position_sensor": own}).drive.position_sensor
        assert isinstance(position_sensor, Counted) and position_sensor.counts == counts


@pytest.mark.parametrize(
    ("word", "text"),
    [("kv", "23.4 rpm/V"), ("K_e_line_to_line_peak", f"{1 / (23.4 * math.pi / 30):.5f} V*s/rad")],
)
def test_a_torque_constant_of_block_commutation_is_to_be_deleted(
    tmp_path: Path, word: str, text: str
) -> None:
    """K_t kv = 1 is of two phases at a time. A sine of the same back-EMF between lines makes sqrt(3)/2 of it.

    Three phases with the peak current I and the peak back-EMF E / sqrt(3) of a phase in step: power over
    speed is 3/2 I E / sqrt(3) = sqrt(3)/2 E I.
    """
    magnet = 'psi_f = "68 mWb"'
    both = studies.BASE.replace(magnet, f'K_t = "0.408 N*m/A"\n{word} = "{text}"')
    why = (
        "K_t = 1/kv holds for block commutation, but with sinusoidal currents K_t is sqrt(3)/2 of 1/kv: "
        "delete K_t"
    )
    path = studies.write(tmp_path, both)
    assert refused(path) == f'motor.{word}: "{text}": expected K_t and {word} to agree within 5%; {why}'
    study = load(studies.write(tmp_path, studies.BASE.replace(magnet, f'{word} = "{text}"')))
    assert study.K_t == pytest.approx(0.408 * math.sqrt(3) / 2, rel=2e-3)


def test_a_bandwidth_in_rad_s_is_one_of_hz_times_two_pi() -> None:
    """The whole study is the same, to its last number."""
    in_hz = load(MY_MOTOR, {"drive.current_loop.bandwidth": "800 Hz"})
    in_rad = load(MY_MOTOR, {"drive.current_loop.bandwidth": f"{800 * math.tau!r} rad/s"})
    assert in_rad.drive.current_loop.bandwidth == pytest.approx(800, rel=1e-15)
    assert in_rad.drive.rates == in_hz.drive.rates


def test_units_of_datasheets_are_taken_in_a_study() -> None:
    """Inertia in grams or ounces and cogging in ounces give the same motor."""
    study = load(MY_MOTOR, {"mechanics.inertia": "400 gcm2", "motor.cogging.0.torque": "0.56645 oz-in"})
    other = load(MY_MOTOR, {"mechanics.inertia": "2.18699 oz*in^2"})
    assert study.mechanics.inertia == pytest.approx(4e-5) == pytest.approx(other.mechanics.inertia, rel=1e-5)
    assert study.motor.star().cogging[0].torque == pytest.approx(4e-3, rel=1e-4)


# --- what a study lacks


def test_a_position_s_error_is_recorded_with_what_the_message_says() -> None:
    metric = {"metric.0.signal": "theta_error", "metric.0.unit": "deg"}
    message = refused(MY_MOTOR, metric)
    expected = "expected another signal, or a controller such as harmonic with position = true"
    assert message == f'metric.0.signal: "theta_error": {expected}'
    own = {f"controller.harmonic.{key}": value for key, value in written(message).items()}
    study = load(MY_MOTOR, {**metric, **own, "scenario.slow.duration": "3 s", "metric.0.last": "1 s"})
    run = simulate(study, "slow", "harmonic")
    assert 0 < run.metrics["speed_ripple_rad"] < math.radians(1)


TABLE = {"law": "anti-cogging", "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}}


def test_a_table_that_nothing_fills_shows_what_to_paste() -> None:
    """Each of the two fills a table that takes most of the ripple."""
    message = refused(MY_MOTOR, {"controller.table": TABLE})
    assert message == (
        'controller.table: expected calibration = { speed = "6 rpm", position_gain = "20 1/s" }, '
        'tuning = { rule = "auto" } or a start'
    )
    pasted = [tomllib.loads(text) for text in re.findall(r"\w+ = \{.*?\}", message)]
    assert [list(table) for table in pasted] == [["calibration"], ["tuning"]]
    for table in pasted:
        study = load(MY_MOTOR, {"controller.table": {**TABLE, **table}})
        ripples = {n: simulate(study, "slow", n).metrics["speed_ripple_rad_s"] for n in ("pi", "table")}
        assert ripples["table"] < 0.2 * ripples["pi"]


def test_a_table_is_filled_once() -> None:
    filled = {
        **TABLE,
        "calibration": {"speed": "6 rpm", "position_gain": "20 1/s"},
        "start": {"map": "stored.map"},
    }
    message = refused(MY_MOTOR, {"controller.table": filled})
    expected = "expected no such key, since calibration is given: delete start, or delete calibration"
    assert message == f"controller.table.start: {expected}"


# --- a newcomer's file


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("[scenario.slow]", "[scenario]",
            'scenario.duration: "6 s": expected a table with a name, such as [scenario.slow]'),
        ('reference = "30 rpm"', 'speed = "30 rpm"',
            'scenario.slow.speed: "30 rpm": expected the key "reference" instead'),
        ('kind = "absolute", bits = 17', "bits = 17",
            'drive.position_sensor.kind: missing: expected a kind of sensor, such as "encoder"'),
        ('law = "harmonic"', "", "controller.harmonic.law: missing: expected a law that cogless list shows"),
        ('law = "pi"', "law = pi", ': "law = pi": expected a text in quotes, or a number without a unit'),
        ("[[metric]]", "[metric]", ": expected an array of tables, written as [[metric]]"),
        ('order = 84, torque = "4 mN*m"', 'order = 84, amplitude = "4 mN*m"',
            'motor.cogging.0.amplitude: "4 mN*m": expected the key "torque" instead'),
        ('current_limit = "1.5 A"', 'max_current = "1.5 A"',
            'drive.current_loop.max_current: "1.5 A": expected the key "current_limit" instead'),
        ('bus_voltage = "24 V"', 'voltage = "24 V"',
            'drive.inverter.voltage: "24 V": expected a known key, perhaps "bus_voltage"'),
        ('coulomb_friction = "3 mN*m"', 'friction = "3 mN*m"',
            'mechanics.friction: "3 mN*m": expected a known key, perhaps "viscous_friction" or '
            '"coulomb_friction" or "breakaway_friction" or "friction_harmonics" or "friction_table"'),
    ],
)  # fmt: skip
def test_a_newcomer_s_mistake_is_told_with_what_makes_the_study_right(
    tmp_path: Path, right: str, wrong: str, message: str
) -> None:
    """The message names the words that a correct file has."""
    text = MY_MOTOR.read_text(encoding="utf-8")
    assert right in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(right, wrong, 1), encoding="utf-8")
    with pytest.raises(StudyError) as error:
        load(path)
    first = str(error.value).splitlines()[0].removeprefix(f"{path}: ")
    assert first.endswith(message) and (first == message or message.startswith(":"))
    words = [
        word for word in re.findall(r"[\w-]+|\[\[", right) if word not in re.findall(r"[\w-]+|\[\[", wrong)
    ]
    assert "law" in right or "kind" in right or all(word in message for word in words)
    path.write_text(text, encoding="utf-8")
    load(path)
