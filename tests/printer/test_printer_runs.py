"""Prusa's runs at a constant speed, of which only sizes are known; and logs that can't be used."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from printer.printer_bench import FILE, PROBE, SIGNS, prusa_lines, write_klipper_logs
from printer.printer_plant import order_sizes, random_axes, static_orders, study_axes

from cogless.drives.klipper import log_name, log_text
from cogless.drives.klipper import write_runs as klipper_files
from cogless.drives.prusa import identify_runs
from cogless.drives.prusa import write_runs as prusa_files
from cogless.errors import StudyError
from cogless.printer.axis import read_axis
from cogless.printer.corrections import Answer
from cogless.printer.magnitudes import check_speed, inverse_answer, quiet_speed

AXES = random_axes(2, 4)


@pytest.fixture
def axis_file(tmp_path: Path) -> Path:
    path = tmp_path / "printer.toml"
    path.write_text(FILE)
    return path


@pytest.fixture(scope="module")
def lines() -> list[str]:
    return prusa_lines(AXES, 0, [0.04], np.random.default_rng(3))


def identify(
    capsys: pytest.CaptureFixture[str], axis_file: Path, logs: list[Path], drive: str = "prusa"
) -> tuple[int, str, str]:
    folder = axis_file.parent / "found"
    return cogless(capsys, "identify", *logs, "--drive", drive, "--drive-config", axis_file, "-o", folder)


def test_sizes_alone_give_the_correction(
    lines: list[str], axis_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "serial.log"
    log.write_text("echo:start\nok\n" + "\nok\n".join(lines) + "\n")
    code, out, err = identify(capsys, axis_file, [log])
    assert (code, err) == (0, "") and "Next: cogless table" in out and "--to prusa" in out
    contents = json.loads((tmp_path / "found" / "correction.json").read_text())
    assert contents["current_A_rms"] == 0.8 and contents["torque_N_m"] == pytest.approx(0.236)
    for direction, sign in SIGNS.items():
        psi = static_orders(AXES, 0, sign, {}, 0.04)
        for wave in contents[direction]:
            c = wave["magnitude_rad"] * np.exp(1j * wave["phase_rad"])
            n = wave["order"]
            assert abs(c + psi[n]) < min(0.3 * abs(psi[n]) + 0.0015, 2 * wave["error_rad"])


def test_a_resonant_speed_is_refused_and_the_advised_one_is_not(axis_file: Path) -> None:
    axis = read_axis(axis_file)
    for resonance in (40.0, 62.0, 80.0):
        for order in (1, 2, 4):
            speed = resonance * axis.wavelength / order
            with pytest.raises(StudyError) as refused:
                check_speed(axis, speed, [resonance, 228.0], "printer.speeds")
            better = quiet_speed(axis, [resonance, 228.0], speed)
            assert better is not None and f"such as {1e3 * better:.0f} mm/s" in str(refused.value)
            check_speed(axis, better, [resonance, 228.0], "printer.speeds")


def test_a_resonance_that_nobody_named_is_heard(
    axis_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    axes = random_axes(1, 4)
    k_m = axes.teeth * axes.holding[0] / axes.radius**2
    lower = np.sqrt(1 / (1 / axes.belt[0] + 1 / k_m) / axes.mass[0]) / (2 * np.pi)
    log = tmp_path / "serial.log"
    log.write_text("\n".join(prusa_lines(axes, 0, [8e-4 * lower / 2], np.random.default_rng(1))) + "\n")
    code, _, err = identify(capsys, axis_file, [log])
    assert (code, err.count("\n")) == (2, 1) and "order 2 is at" in err and "expected another speed" in err


def test_the_report_has_the_ripple_over_the_speed(
    axis_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Runs at one speed tell the ripple at others, off the resonances, as the independent axis shows it."""
    axes, log = study_axes(1), tmp_path / "serial.log"
    log.write_text("\n".join(prusa_lines(axes, 0, [0.04], np.random.default_rng(1))) + "\n")
    correction = identify_runs([log], read_axis(axis_file))
    ripple, chosen = correction.ripple["forward"], slice(4, None, 7)
    speeds = np.concatenate([one.speeds[chosen] for one in ripple.values()])
    waves = {m: np.repeat([0, c], len(speeds)) for m, c in correction.orders("forward").items()}
    sizes = order_sizes(axes, np.tile(speeds, 2), waves).reshape(2, len(ripple), -1, 8)
    for k, (n, one) in enumerate(ripple.items()):
        assert one.speeds[-1] == pytest.approx(0.16 / n) and one.speeds[0] == pytest.approx(0.02 / n)
        cut = one.before > 0.99 * np.max(one.before)  # near the resonance at 62 Hz
        assert 4 < np.count_nonzero(cut) < 14
        assert np.all(np.abs(n * one.speeds[cut] / 8e-4 / 62 - 1) < 0.2)
        before, after = sizes[:, k, :, n - 1]
        cut, shown, left = cut[chosen], one.before[chosen], one.after[chosen]
        assert shown[~cut] == pytest.approx(before[~cut], rel=0.25)
        assert np.any(cut) and np.all(before[cut] > shown[cut])
        assert np.all(after[~cut] < left[~cut])
    code, _, err = identify(capsys, axis_file, [log])
    assert (code, err) == (0, "")
    page = (tmp_path / "found" / "report.html").read_text("utf-8")
    titles = re.findall(r'aria-label="Order (\d) (\w+), a stripe every', page)
    assert titles == [(str(n), direction) for direction in SIGNS for n in PROBE]
    assert "a rotor that the magnetic field holds like a spring" in page


def test_an_answer_that_is_no_mass_on_a_belt_gives_no_ripple() -> None:
    """Two resonances give back their own; a third one between the frequencies gives none."""
    f = np.array([30.0, 50.0, 60.0, 100.0, 120.0, 200.0])
    two = 1 / np.abs((1 - (f / 75) ** 2) * (1 - (f / 240) ** 2))
    fit = inverse_answer(Answer(f, two))
    assert fit is not None
    assert fit[0] == pytest.approx(1 / 75**2 + 1 / 240**2) and fit[1] == pytest.approx((75 * 240) ** -2)
    assert inverse_answer(Answer(f, two / np.abs(1 - (f / 110) ** 2))) is None


def backward(text: str) -> bool:
    return text.startswith("cogless-run x backward")


def edited(lines: list[str], change: Callable[[list[str]], list[str]]) -> str:
    return "\n".join(change(list(lines))) + "\n"


def without_backward(lines: list[str]) -> list[str]:
    result, skipping = [], False
    for line in lines:
        skipping = backward(line) or (skipping and not line.startswith("cogless-run"))
        if not skipping:
            result.append(line)
    return result


def at_rest(lines: list[str]) -> list[str]:
    """The same with the carriage at rest: noise alone."""
    rng = np.random.default_rng(8)
    rows = (re.fullmatch(r"(\d+), (.*), 0.02, 9.81", line) for line in lines)
    return [
        line if row is None else f"{row[1]}, {rng.normal(0, 0.1):.4f}, 0.02, 9.81"
        for line, row in zip(lines, rows, strict=True)
    ]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (at_rest, "is lost in noise at 40 mm/s: expected"),
        (lambda lines: ["ok"], 'no whole run, from its line "cogless-run"'),
        (without_backward, "no backward run: expected runs in both directions"),
        (
            lambda lines: [x.replace("sample freq: 1", "sample freq: 0.1") for x in lines],
            "expected the accelerometer's rate in Hz",
        ),
        (lambda lines: [x.replace("sample freq: ", "sample freq: nan") for x in lines], "sample freq: nan"),
        (lambda lines: [x.replace("run x", "run y") for x in lines], "of motor y: expected motor x"),
        (
            lambda lines: [x.replace("40.0000 mm/s", "400.0000 mm/s") for x in lines],
            "expected a lower speed",
        ),
        (lambda lines: lines[:90] + lines[-1:], "expected 200 or more"),
        (
            lambda lines: [
                f"{k}, 39.24, 0, 9.8" if "." in x and ", " in x else x for k, x in enumerate(lines)
            ],
            "the end of its range",
        ),
    ],
)
def test_a_wrong_run_is_one_line(
    change: Callable[[list[str]], list[str]],
    line: str,
    lines: list[str],
    axis_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = tmp_path / "serial.log"
    log.write_text(edited(lines, change))
    code, out, err = identify(capsys, axis_file, [log])
    assert (code, out, err.count("\n")) == (2, "", 1) and line in err


def rest_logs(folder: Path, rate: float = 3200, level: float = 0.0, duration: float = 3.0) -> list[Path]:
    """Logs of noise alone, named as the macro names them."""
    rng, paths = np.random.default_rng(1), []
    for direction in SIGNS:
        for kind in ("plain", "probe"):
            path = folder / f"adxl345-{log_name('x', direction, kind, 1)}.csv"
            t = np.arange(0, duration, 1 / rate)
            a = 1e3 * rng.normal(0, 0.1, len(t)) if not level else np.full(len(t), level)
            path.write_text(log_text(t + 5, np.column_stack([1e-3 * a, 0 * a, 0 * a])))
            paths.append(path)
    return paths


def gap(text: str) -> str:
    rows = text.splitlines()
    return "\n".join(rows[:2000] + rows[4000:]) + "\n"


@pytest.mark.parametrize(
    ("options", "change", "line"),
    [
        ({}, None, "expected the move that --plan writes"),
        ({"duration": 1.0}, None, "expected the whole move of 2 s"),
        ({"rate": 200}, None, "200 samples a second: expected 800 or more"),
        ({"level": 156906.0}, None, "the end of its range"),
        ({}, gap, "without a sample"),
        ({}, lambda text: text[:-20], "line 9601: the file is cut here: expected the whole file"),
        ({}, lambda text: text + "5", "line 9602: the file is cut here: expected the whole file"),
        ({}, lambda text: text + text.splitlines()[-1] + "\n", "line 9602: the time does not grow"),
        ({}, lambda text: text.replace("#time", "time"), 'its first line is not "#time,'),
        ({}, lambda text: text.replace(",0.000000\n", "\n", 1), "line 2: expected four finite numbers"),
        ({}, lambda text: "#time,accel_x,accel_y,accel_z\n", "0 samples"),
    ],
)
def test_a_wrong_ramp_is_one_line(
    options: dict[str, float],
    change: Callable[[str], str] | None,
    line: str,
    axis_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    paths = rest_logs(tmp_path, **options)
    if change is not None:
        paths[0].write_text(change(paths[0].read_text()))
    code, out, err = identify(capsys, axis_file, paths, "klipper")
    assert (code, out, err.count("\n")) == (2, "", 1) and line in err


def test_ramps_without_a_partner_or_a_direction_are_refused(
    axis_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = rest_logs(tmp_path)
    assert "no backward run" in identify(capsys, axis_file, paths[:2], "klipper")[2]
    alone = identify(capsys, axis_file, [paths[0]], "klipper")[2]
    assert ': its second log is missing: expected a file of the same name, but with "probe"' in alone
    other = tmp_path / "other.csv"
    other.write_text(paths[0].read_text())
    unnamed = identify(capsys, axis_file, [other], "klipper")[2]
    assert "the file's name does not say which run it holds" in unnamed


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('step_angle = "1.8 deg"', 'step_angle = "1.7 deg"', "printer.step_angle"),
        ('travel = "200 mm"', 'travel = "200"', "printer.travel"),
        ("pulley_teeth = 20", "", "printer.pulley_teeth"),
        ('rated_current = "2 A"', "", "printer.holding_torque"),
        ('motor = "x"', 'motor = "z"', "printer.motor"),
        ("[printer]", "[print]", "print"),
    ],
)
def test_a_wrong_axis_is_one_line(
    old: str, new: str, line: str, axis_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    axis_file.write_text(FILE.replace(old, new))
    for drive in ("klipper", "prusa"):
        code, out, err = cogless(
            capsys, "identify", "--plan", axis_file, "--drive", drive, "-o", tmp_path / "plan"
        )
        assert (code, out) == (2, "") and line in err.splitlines()[0]


def test_a_plan_that_can_t_be_played_is_refused(
    axis_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    axis_file.write_text(FILE + 'speeds = ["25 mm/s"]\nresonances = ["62 Hz"]\n')
    code, _, err = cogless(
        capsys, "identify", "--plan", axis_file, "--drive", "prusa", "-o", tmp_path / "plan"
    )
    assert code == 2 and err.startswith(f"{axis_file}: printer.speeds: 25 mm/s: order 2 is at 62 Hz")
    axis_file.write_text(FILE.replace('travel = "200 mm"', 'travel = "30 mm"'))
    code, _, err = cogless(
        capsys, "identify", "--plan", axis_file, "--drive", "prusa", "-o", tmp_path / "plan"
    )
    assert code == 2 and err.startswith(f"{axis_file}: printer.travel: 30 mm: expected 56 mm or more")


def test_a_corexy_motor_goes_along_a_diagonal(axis_file: Path) -> None:
    axis_file.write_text(FILE + 'kinematics = "corexy"\n')
    axis = read_axis(axis_file)
    assert axis.wavelength == pytest.approx(8e-4 / np.sqrt(2))
    assert axis.direction == pytest.approx((np.sqrt(0.5), np.sqrt(0.5)))
    assert "G1 X161.4214 Y241.4214" in klipper_files(axis)["cogless_ramps.cfg"]
    # A turn of one motor moves the belt by 40 mm and the carriage by 28.3 mm.
    rate = 0.04 / (0.04 * np.sqrt(0.5))
    assert f"M974 X F{rate:.6f}" in prusa_files(axis)["cogless_runs.gcode"]


def test_klipper_logs_have_all_names_of_the_macro(axis_file: Path, tmp_path: Path) -> None:
    records = {
        (d, k): (np.arange(0, 2.2, 1e-3), np.zeros((2200, 1))) for d in SIGNS for k in ("plain", "probe")
    }
    logs = write_klipper_logs(tmp_path, records, 0, np.random.default_rng(0), 0.1)
    text = klipper_files(read_axis(axis_file))["cogless_ramps.cfg"]
    assert all(f"NAME={log.stem.removeprefix('adxl345-')}\n" in text for log in logs)
    assert text.count("ACCELEROMETER_MEASURE NAME=") == len(logs)
