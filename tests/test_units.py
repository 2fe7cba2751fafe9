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
        ("60", units.ANGULAR_SPEED, 'expected a unit, too, such as "60 rpm"'),
        (19 * "1", units.ANGULAR_SPEED, f'expected a unit, too, such as "{19 * "1"} rpm"'),
        (20 * "1", units.ANGULAR_SPEED, 'expected a unit, too, such as "1 rpm"'),
        ("60 rpn", units.ANGULAR_SPEED,
            'expected an angular speed, such as "1 rpm"; the unit "rpn" is not known'),
        ("0,35 ohm", units.RESISTANCE, 'expected a decimal point in place of the comma, such as "1.5 ohm"'),
        *(
            (
                f"1 {wrong}",
                units.RESISTANCE,
                f'expected a resistance, such as "1 ohm"; the unit "{wrong}" is not known{perhaps}',
            )
            for wrong, perhaps in (
                ("OHM", ', perhaps "ohm"'),
                ("MOHM", ', perhaps "Mohm"'),
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
        ("1 __import__('os')", units.TIME,
            'expected a time, such as "1 s"; the unit "__import__(\'os\')" is not known'),
    ],
)  # fmt: skip
def test_wrong_texts_say_what_was_expected(text: str, dimension: units.Dimension, expected: str) -> None:
    with pytest.raises(UnitError) as error:
        parse(text, dimension)
    assert str(error.value) == expected


INCH, OUNCE, POUND, WEIGHT = 0.0254, 0.028349523125, 0.45359237, 9.80665  # m, kg, kg, N of a kilogram
# What datasheets write, by what it is of; SI from the definitions of inch, ounce, pound and gravity.
OF_DATASHEETS = {
    units.INERTIA: {
        1e-7: "gcm2, g*cm2, gcm^2, gcm², g·cm², g.cm2, g-cm^2, g cm^2, g*cm**2",
        1e-4: "kgcm2, kg*cm2, kgcm^2, kg-cm^2, kg.cm²",
        1e-9: "gmm2, g*mm2",
        1.0: "kgm2, kg.m2, kg-m^2, N*m*s^2, Nms2",
        OUNCE * INCH**2: "oz*in^2, oz-in^2, ozin2, oz in^2",
        POUND * INCH**2: "lb*in^2, lb-in2, lbs*in^2",
        OUNCE * WEIGHT * INCH: "oz*in*s^2, oz-in-s^2, oz-in-s2, ozins2, ozf*in*s^2",
        POUND * WEIGHT * INCH: "lb*in*s^2, in-lb-s2, lbf*in*s^2",
        WEIGHT * 1e-2: "kgf*cm*s^2, kg*cm*s^2, kgf.cm.s²",
    },
    units.TORQUE: {
        OUNCE * WEIGHT * INCH: "oz*in, ozin, oz-in, in-oz, inoz, ozf*in, oz in, oz·in",
        POUND * WEIGHT * INCH: "lb*in, in*lb, lb-in, lbin, inlb, lbf*in, in-lbs",
        POUND * WEIGHT * 12 * INCH: "lb*ft, ft-lb, lbft, lbf-ft",
        WEIGHT * 1e-2: "kg*cm, kg-cm, kgcm, kgf*cm, kgf.cm, kgfcm",
        WEIGHT * 1e-5: "g*cm, gcm, gf*cm, gf-cm",
        1e-3: "mNm, mN*m, mN.m, mN-m, mN·m, Nmm, N*mm",
        1e-2: "Ncm, N*cm, N-cm, cNm, cN*m",
        1.0: "Nm, N.m, N-m, N m",
        1e-7: "dyn*cm",
    },
    units.TORQUE_CONSTANT: {
        OUNCE * WEIGHT * INCH: "oz-in/A, oz*in/A, ozin/A",
        WEIGHT * 1e-2: "kg-cm/A, kgcm/A",
        1e-3: "mNm/A, mN.m/A",
        1e-2: "Ncm/A",
    },
    units.VISCOUS_FRICTION: {
        OUNCE * WEIGHT * INCH / (1000 * math.pi / 30): "oz-in/krpm, oz*in/krpm, ozin/kRPM",
        1.0: "Nms, Nms/rad, N.m.s/rad, Nm/(rad/s)",
    },
    units.BACK_EMF_CONSTANT: {30e-3 / math.pi: "V/krpm, V/kRPM, mV/rpm", 1e-3: "mVs/rad, mV.s/rad, mV-s/rad"},
    units.SPEED_CONSTANT: {math.pi / 30: "rpm/V, RPM/V, r/min/V"},
    units.ANGULAR_SPEED: {math.pi / 30: "rpm, RPM, r/min", 2 * math.pi: "rev/s, rps"},
    units.ANGLE: {math.pi / 180: "deg, °", math.pi / 10800: "arcmin", math.pi / 648000: "arcsec"},
    units.RESISTANCE: {1e-3: "mOhm, mohm, mΩ", 1.0: "Ohm, ohm, Ω"},
    units.INDUCTANCE: {1e-6: "uH, µH, μH"},
    units.TEMPERATURE: {1.0: "°C, degC"},
    # a frequency in rad/s is 2 pi times that in Hz; a gain per time has no angle
    units.FREQUENCY: {1 / (2 * math.pi): "rad/s", 1 / 60: "rpm", 1.0: "Hz, rev/s"},
    units.RATE: {1.0: "rad/s, 1/s, s^-1"},
}


@pytest.mark.parametrize(
    ("dimension", "si", "unit"),
    [
        (dimension, si, unit)
        for dimension, by_si in OF_DATASHEETS.items()
        for si, listed in by_si.items()
        for unit in listed.split(", ")
    ],
)
def test_units_of_datasheets_mean_what_they_mean_there(
    dimension: units.Dimension, si: float, unit: str
) -> None:
    """Ounces, pounds, grams and kilograms are masses in an inertia, and weights in a torque."""
    assert parse(f"3 {unit}", dimension) == pytest.approx(3 * si, rel=1e-12)
    assert unit[0].isdigit() or parse(f"3{unit}", dimension) == pytest.approx(3 * si, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "dimension", "expected", "cures"),
    [
        ("1/s", units.FREQUENCY, '; the unit "1/s" may be "Hz" or "rad/s"', ("Hz", "rad/s")),
        ("1/ms", units.FREQUENCY, '; the unit "1/ms" may be "Hz" or "rad/s"', ("Hz", "rad/s")),
        ("Hz", units.RATE, '; the unit "Hz" may be "1/s" or 2 pi "rad/s"', ("1/s", "rad/s")),
        (
            "Hz",
            units.ANGULAR_SPEED,
            '; the unit "Hz" may be "rev/s", or the frequency of the current, pole_pairs times as much',
            ("rev/s",),
        ),
        ("1/s", units.ANGULAR_SPEED, '; the unit "1/s" may be "rad/s" or "rev/s"', ("rad/s", "rev/s")),
        ("oz*in", units.INERTIA, "", ()),
        ("oz*in^2", units.TORQUE, "", ()),
        ("gm", units.TORQUE, '; the unit "gm" is not known', ()),
        ("mh", units.INDUCTANCE, ', perhaps "mH"', ("mH",)),
        ("khz", units.FREQUENCY, '; the unit "khz" is not known, perhaps "kHz"', ("kHz",)),
        ("v", units.VOLTAGE, '; the unit "v" is not known, perhaps "V"', ("V",)),
        ("rpm/v", units.SPEED_CONSTANT, '; the unit "rpm/v" is not known, perhaps "rpm/V"', ("rpm/V",)),
        ("KG*cm^2", units.INERTIA, '; the unit "KG*cm^2" is not known, perhaps "kg*cm^2"', ("kg*cm^2",)),
        ("nm", units.TORQUE, ', perhaps "Nm"', ("Nm",)),
    ],
)
def test_a_unit_with_two_readings_or_other_capitals_is_refused_with_what_is_taken(
    unit: str, dimension: units.Dimension, expected: str, cures: tuple[str, ...]
) -> None:
    with pytest.raises(UnitError) as error:
        parse(f"3 {unit}", dimension)
    assert str(error.value) == f"expected {dimension.name}, such as {dimension.sample(1)}{expected}"
    for cure in cures:
        assert f'"{cure}"' in str(error.value) and parse(f"3 {cure}", dimension) > 0


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
    assert units.in_si("3 kg*cm") == pytest.approx(
        3 * 0.0980665
    )  # a torque: nobody means a mass times a length
    assert units.is_known("rpm") and not units.is_known("rpn")
    for text, told in (("a lot", "a number and a unit"), ("3 rpn", 'a known unit, not "rpn"')):
        with pytest.raises(UnitError, match=f"^expected {told}$"):
            units.in_si(text)
    with pytest.raises(UnitError, match=r'^expected a number with a unit like "A"$'):
        number_in("a lot", "A")


def test_importing_cogless_loads_nothing_that_takes_time() -> None:
    heavy = "('pydantic', 'numpy', 'scipy', 'matplotlib')"
    code = f"import sys, cogless; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


OF_PINT = (
    "m, s, A, g, K, rad, deg, turn, arcmin, arcsec, min, h, rpm, Hz, N, J, W, V, ohm, H, Wb, inch, ft, oz, "
    "lb, dyn, gf, ozf, lbf, kHz, mH, uH, µH, mWb, Mohm, meters, millinewton, kilogram, revolutions/minute, "
    "N*m, kg*m^2, g*cm**2, oz*inch^2, lb*inch**2, ozf*inch, V/rpm, rpm/V, mN*m/A, rad/s^2, 1/s, s^-1, "
    "A/(rad/s), (m/s)^2/K, V/A/s, N m s, kgf*cm*s^2, 1/(ohm*s), W*h, lbf*ft"
)


@pytest.mark.parametrize("unit", OF_PINT.split(", "))
def test_a_unit_is_worth_what_pint_says(unit: str) -> None:
    """In pint's own registry a radian is a plain number, and an ohm and a henry are what they are here."""
    pint = pytest.importorskip("pint")
    expected = pint.UnitRegistry().parse_expression(unit).to_base_units().magnitude
    assert units.in_si(f"1 {unit}") == pytest.approx(expected, rel=1e-9)


DEEP = 99 * "(" + "m" + 99 * ")"


@pytest.mark.parametrize(
    "unit", [DEEP, "lambda*rad", "(", "/m°V", "s**Wb", "m^^2", "or", "1/", "2**9**9", "kg)", "kg*", "()"]
)
def test_what_is_no_unit_is_a_user_s_mistake(unit):
    with pytest.raises(UnitError):
        parse(f"1 {unit}", units.ANGLE)
