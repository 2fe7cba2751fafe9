"""A table over one revolution: what is read, its harmonics, and one line for each kind of mistake."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
from pydantic_core import PydanticCustomError

from cogless import units
from cogless.study.csv_table import finite, quoted_cells, read

ERROR = {"error": units.ANGLE}
WAVES = {1: (0.3, 0.4), 3: (0.1, -2.0), 17: (0.02, 1.5)}  # order: amplitude, phase


def waves(angle: np.ndarray) -> np.ndarray:
    return 0.05 + sum(a * np.sin(n * angle + phase) for n, (a, phase) in WAVES.items())


def written(
    folder: Path, degrees: np.ndarray, heading: str = "angle [deg],error [deg]", scale: float = 1.0
) -> Path:
    path = folder / "table.csv"
    rows = zip(degrees, scale * waves(np.radians(degrees)), strict=True)
    path.write_text("\n".join([heading, *(f"{float(a)!r},{float(e)!r}" for a, e in rows)]))
    return path


@pytest.mark.parametrize("ends", [359.5, 360.0])
def test_angles_and_values_are_si_and_the_end_is_the_start(tmp_path: Path, ends: float) -> None:
    degrees = np.arange(0.0, ends + 0.1, 0.5)
    table = read(written(tmp_path, degrees), ERROR)
    assert len(table.angle) == 720
    assert table.name == "error"
    assert table.angle == pytest.approx(np.radians(np.arange(720) / 2))
    assert table.value == pytest.approx(np.radians(waves(np.array(table.angle))))


@pytest.mark.parametrize(
    ("heading", "unit", "columns"),
    [
        ("angle [deg],torque [mN*m]", 1e-3, {"torque": units.TORQUE}),
        ("angle_deg,current_mA", 1e-3, {"torque": units.TORQUE, "current": units.CURRENT}),
        ("Angle (deg), Torque (N*m)", 1.0, {"torque": units.TORQUE}),
    ],
)
def test_the_heading_names_column_and_unit(
    tmp_path: Path, heading: str, unit: float, columns: dict[str, units.Dimension]
) -> None:
    table = read(written(tmp_path, np.arange(0, 360, 1.0), heading), columns)
    assert table.name in heading.lower()
    assert table.value == pytest.approx(unit * waves(np.array(table.angle)))


def test_other_columns_are_left_alone(tmp_path: Path) -> None:
    rows = [f"{n},{10 * n},x,{math.sin(math.radians(10 * n))}" for n in range(36)]
    (tmp_path / "t.csv").write_text("\n".join(["sample,angle [deg],note,error [rad]", *rows, ""]))
    assert read(tmp_path / "t.csv", ERROR).harmonics(2)[1] == pytest.approx((1.0, 0.0), abs=1e-12)


def test_harmonics_of_equal_spacing_are_exact(tmp_path: Path) -> None:
    found = read(written(tmp_path, np.arange(30.0, 390.0, 2.0)), ERROR).harmonics(20)
    assert found[0] == pytest.approx((math.radians(0.05), math.pi / 2))
    for order, (amplitude, phase) in enumerate(found[1:], start=1):
        wanted = WAVES.get(order)
        assert amplitude == pytest.approx(math.radians(wanted[0]) if wanted else 0.0, abs=1e-14)
        assert wanted is None or phase == pytest.approx(wanted[1], abs=1e-11)


def test_harmonics_of_unequal_spacing_are_those_of_a_spline(tmp_path: Path) -> None:
    even = np.arange(0.0, 360.0, 0.5)
    table = read(written(tmp_path, 5 + even + 0.2 * np.sin(np.radians(7 * even))), ERROR)
    assert len(table.harmonics(359)) == 360
    for order, (amplitude, phase) in enumerate(table.harmonics(20)[1:], start=1):
        # a cubic spline of step h loses about (n h)^4 / 720 of order n
        wanted = WAVES.get(order, (0.0, phase))
        assert amplitude == pytest.approx(math.radians(wanted[0]), abs=2e-7)
        assert phase == pytest.approx(wanted[1], abs=1e-3)


def test_no_harmonics_beyond_half_the_points(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="below 18"):
        read(written(tmp_path, np.arange(0.0, 360.0, 10.0)), ERROR).harmonics(18)


def lines_of(degrees: list[float], values: list[float]) -> str:
    return "\n".join(["angle [deg],error [deg]", *(f"{a},{e}" for a, e in zip(degrees, values, strict=True))])


WHOLE = [10.0 * n for n in range(36)]
SINE = [round(math.sin(math.radians(a)), 6) for a in WHOLE]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", 'line 1: "": expected one column such as "error [deg]"'),
        ("angle [deg],speed [rpm]\n",
            'line 1: "angle [deg],speed [rpm]": expected one column such as "error [deg]"'),
        ("error [deg]\n", 'line 1: "error [deg]": expected one column such as "angle [deg]"'),
        ("angle [deg],error\n", 'line 1: "error": expected a unit, too, such as "error [deg]"'),
        ("angle [deg],error [N]\n",
            'line 1: "error [N]": expected a unit of an angle, such as "error [rad]"'),
        ("angle [grad],error [deg]\n",
            'line 1: "angle [grad]": expected a unit of an angle, such as "angle [rad]"'),
        ("angle [deg],error [deg]\n0,1\n", "1 lines of numbers: expected 8 or more in a revolution"),
        ("angle [deg],error [deg]\n0,1\n1,nan\n", 'line 3: "nan": expected a finite error'),
        ("angle [deg],error [deg]\n0,1\n1,x\n", 'line 3: "x": expected a number'),
        ("angle [deg],error [deg]\n0,1\n1\n", 'line 3: "1": expected 2 columns'),
        *((f"angle [deg]{between}error [deg]\n",
            f'line 1: "angle [deg]{between}error [deg]": expected commas between columns, '
            "and decimal points in numbers")
          for between in (";", "\t")),
        ("angle [deg],error [deg]\n0,00,0,0000\n",
            'line 2: "0,00,0,0000": expected 2 columns, and decimal points in numbers'),
        ('angle [deg],error [deg]\n0,"0,01"\n', 'line 2: "0,01": expected a number with a decimal point'),
        ("angle [deg],error [deg]\n5,1\n\n5,1\n", 'line 4: "5": expected an angle above that of the previous '
                                                  'line'),
        (lines_of([0.0, *WHOLE], [0.0, *SINE]),
            'line 3: "0.0": expected an angle above that of the previous line'),
        (lines_of([*WHOLE, 370.0], [*SINE, 0.1]),
            "line 38: 370 deg after the first line: expected one revolution at most"),
        (lines_of(WHOLE[:20] + WHOLE[27:], SINE[:20] + SINE[27:]),
            "line 21: the next angle comes after 80 deg: expected at most 50 deg, 5 times the usual spacing"),
        (lines_of(WHOLE[:29], [0.0] * 29),
            "line 30: the next angle comes after 80 deg: expected at most 50 deg, 5 times the usual spacing"),
        (lines_of(WHOLE, [0.01 * a for a in WHOLE]),
            "line 37: the error jumps from the last line to the first, "
            "35 times as far as anywhere else: expected a whole revolution"),
        (lines_of([*WHOLE, 360.0], [*SINE, 0.6]),
            "line 38: the error jumps from the last line to the first, "),
    ],
)  # fmt: skip
def test_a_mistake_names_its_line(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(PydanticCustomError) as error:
        read(tmp_path / "t.csv", ERROR)
    assert str(error.value).startswith(problem)


@pytest.mark.parametrize("huge", [1e9, -1e9, math.inf])
def test_a_number_of_a_table_is_below_a_thousand_million(huge: float) -> None:
    assert finite("x", 999_999_999.0, "error", "line 2: ") == 999_999_999.0
    with pytest.raises(PydanticCustomError, match='line 2: "x": expected a finite error'):
        finite("x", huge, "error", "line 2: ")


def test_a_cell_is_quoted_in_forty_characters() -> None:
    assert quoted_cells(40 * "x") == f'"{40 * "x"}"' and quoted_cells(41 * "x") == f'"{37 * "x"}..."'


def test_a_file_that_is_missing_or_none_is_told(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    for name in ("none.csv", "pipe.csv"):  # the pipe is not waited for
        with pytest.raises(PydanticCustomError, match=f"expected a readable file at .*{name}"):
            read(tmp_path / name, ERROR)
