"""Text with units to SI and back."""

import math
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogless import units
from cogless.units import UnitError, convert, format, number_in, parse, unit_of

SPEEDS = ["rpm", "r/min", "rev/s", "rad/s", "deg/s", "krpm"]


@pytest.mark.parametrize(
    ("text", "dimension", "si"),
    [
        ("60 rpm", units.ANGULAR_SPEED, 2 * math.pi),
        ("60 r/min", units.ANGULAR_SPEED, 2 * math.pi),
        ("1 rev/s", units.ANGULAR_SPEED, 2 * math.pi),
        ("6.28 rad/s", units.ANGULAR_SPEED, 6.28),
        ("-30 deg", units.ANGLE, -math.pi / 6),
        ("15 kHz", units.FREQUENCY, 15000.0),
        ("0.015 A/rpm", units.SPEED_GAIN, 0.015 * 30 / math.pi),
        ("1 A/(rad/s)", units.SPEED_GAIN, 1.0),
        ("0.3 A/rpm/s", units.SPEED_INTEGRAL_GAIN, 0.3 * 30 / math.pi),
        ("3900 rpm/s/A", units.CURRENT_TO_ACCELERATION, 3900 * math.pi / 30),
        ("500 rpm/s", units.ANGULAR_ACCELERATION, 500 * math.pi / 30),
        ("3 1/s^2", units.RATE_PER_TIME, 3.0),
        ("180 1/s", units.RATE, 180.0),
        ("4 mN*m", units.TORQUE, 0.004),
        ("4 mNm", units.TORQUE, 0.004),
        ("138 g*cm^2", units.INERTIA, 1.38e-5),
        ("2.5e-4kg*m**2", units.INERTIA, 2.5e-4),
        ("210 uH", units.INDUCTANCE, 210e-6),
        ("210 µH", units.INDUCTANCE, 210e-6),
        ("15.42 Ω", units.RESISTANCE, 15.42),
        ("68 mWb", units.FLUX_LINKAGE, 0.068),
        ("1 V*s", units.FLUX_LINKAGE, 1.0),
        ("1e4 V/A/s", units.CURRENT_INTEGRAL_GAIN, 1e4),
        ("2 N*m*s", units.VISCOUS_FRICTION, 2.0),
        ("2 N*m*s/rad", units.VISCOUS_FRICTION, 2.0),
        ("  .5  ms ", units.TIME, 0.0005),
    ],
)
def test_texts_become_si(text: str, dimension: units.Dimension, si: float) -> None:
    assert parse(text, dimension) == pytest.approx(si, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "dimension", "expected"),
    [
        ("60", units.ANGULAR_SPEED, 'expected a unit too, such as "60 rpm"'),
        (19 * "1", units.ANGULAR_SPEED, f'expected a unit too, such as "{19 * "1"} rpm"'),
        (20 * "1", units.ANGULAR_SPEED, 'expected a unit too, such as "1 rpm"'),
        ("1 Hz", units.ANGULAR_SPEED, 'expected an angular speed, such as "1 rpm"'),
        ("1 1/s", units.ANGULAR_SPEED, 'expected an angular speed, such as "1 rpm"'),
        ("1 rad/s", units.FREQUENCY, 'expected a frequency, such as "1 Hz"'),
        (
            "60 rpn",
            units.ANGULAR_SPEED,
            'expected an angular speed, such as "1 rpm"; the unit "rpn" is not known',
        ),
        (
            "0,35 ohm",
            units.RESISTANCE,
            'expected a decimal point in place of the comma, such as "1.5 ohm"',
        ),
        *(
            (
                f"1 {wrong}",
                units.RESISTANCE,
                f'expected a resistance, such as "1 ohm"; the unit "{wrong}" is not known{perhaps}',
            )
            for wrong, perhaps in (
                ("Ohm", ', perhaps "ohm"'),
                ("MOhm", ', perhaps "Mohm"'),
                ("mOHM", ', perhaps "mohm"'),
                ("QOhm", ""),
            )
        ),
        ("nan A", units.CURRENT, 'expected a number and a unit, such as "1 A"'),
        ("inf A", units.CURRENT, 'expected a number and a unit, such as "1 A"'),
        ("1e999 A", units.CURRENT, 'expected a finite number with a unit, such as "1 A"'),
        ("", units.TIME, 'expected a number and a unit, such as "1 s"'),
        ("1 s^99", units.TIME, 'expected a time, such as "1 s"; the unit "s^99" is not known'),
        ("1 s/0", units.TIME, 'expected a time, such as "1 s"; the unit "s/0" is not known'),
        ("1 s)", units.TIME, 'expected a time, such as "1 s"; the unit "s)" is not known'),
        (
            "1 __import__('os')",
            units.TIME,
            'expected a time, such as "1 s"; the unit "__import__(\'os\')" is not known',
        ),
    ],
)
def test_wrong_texts_say_what_was_expected(text: str, dimension: units.Dimension, expected: str) -> None:
    with pytest.raises(UnitError) as error:
        parse(text, dimension)
    assert str(error.value) == expected


@settings(max_examples=50)
@given(st.floats(-1e6, 1e6), st.sampled_from(SPEEDS))
def test_a_shown_value_reads_back(value: float, unit: str) -> None:
    text = format(value, unit, units.ANGULAR_SPEED, digits=17)
    assert parse(text, units.ANGULAR_SPEED) == pytest.approx(value, rel=1e-14, abs=1e-300)


@settings(max_examples=50)
@given(st.floats(-1e9, 1e9), st.sampled_from(SPEEDS), st.sampled_from(SPEEDS))
def test_units_of_a_dimension_convert_into_each_other(number: float, here: str, there: str) -> None:
    si = parse(f"{number!r} {here}", units.ANGULAR_SPEED)
    assert number_in(f"{number!r} {here}", there) == pytest.approx(
        convert(si, there, units.ANGULAR_SPEED), rel=1e-12, abs=1e-300
    )


@settings(max_examples=50)
@given(st.text(max_size=20))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        assert math.isfinite(parse(text, units.TORQUE))
    except UnitError as error:
        assert str(error).startswith("expected ")


def test_every_dimension_knows_its_own_units() -> None:
    dimensions = [value for value in vars(units).values() if isinstance(value, units.Dimension)]
    assert len(dimensions) > 20
    for dimension in dimensions:
        if dimension.unit:
            assert units.factor(dimension.unit, dimension) == 1.0
            assert units.factor(dimension.example or dimension.unit, dimension) > 0
        for also in dimension.also:
            assert units.factor(also, dimension) == 1.0


def test_the_unit_of_a_text() -> None:
    assert unit_of("0.015 A/rpm") == "A/rpm"
    assert unit_of("averaged") == ""


def test_another_dimension_has_no_number() -> None:
    with pytest.raises(UnitError, match='expected a number with a unit like "A"'):
        number_in("1 s", "A")


def test_a_text_of_any_dimension_is_si() -> None:
    """SI counts in kilograms, so that a gram is a thousandth."""
    assert units.in_si("3 mN*m") == pytest.approx(3e-3) and units.in_si("3 A") == 3.0
    assert units.in_si("2 kg*cm^2") == pytest.approx(2e-4) and units.in_si("5 g/s^2") == pytest.approx(5e-3)
    assert units.is_known("rpm") and not units.is_known("rpn")
    for text, told in (("a lot", "a number and a unit"), ("3 rpn", 'a known unit, not "rpn"')):
        with pytest.raises(UnitError, match=f"^expected {told}$"):
            units.in_si(text)
    with pytest.raises(UnitError, match=r'^expected a number with a unit like "A"$'):
        number_in("a lot", "A")


def test_importing_cogless_loads_neither_pint_nor_pydantic() -> None:
    heavy = "('pint', 'pydantic', 'scipy', 'matplotlib')"
    code = f"import sys, cogless; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


FROM_THREADS = """
from concurrent.futures import ThreadPoolExecutor
from cogless.units import ANGULAR_SPEED, INERTIA, TORQUE, parse

asked = [("60 rpm", ANGULAR_SPEED), ("2 rad/s", ANGULAR_SPEED), ("3 mN*m", TORQUE), ("1 kg*cm^2", INERTIA)]
with ThreadPoolExecutor(8) as pool:
    print(len(set(pool.map(lambda each: parse(*each), asked * 8))))
"""


def test_threads_may_be_the_first_to_ask() -> None:
    """Studies are loaded side by side in scripts, in a process that has not seen a unit yet."""
    for _ in range(3):
        ran = subprocess.run([sys.executable, "-c", FROM_THREADS], capture_output=True, text=True)
        assert (ran.stdout, ran.stderr) == ("4\n", "")
