"""Klipper's ramps from simulated printers, by the command line: what a correction leaves, and its errors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from printer.printer_bench import FILE, PROBE, SIGNS, TRAVEL, ramp_records, write_klipper_logs
from printer.printer_plant import (
    STEP,
    Axes,
    accelerations,
    closed_form,
    constant_speed,
    derivative,
    random_axes,
    ripple_rms,
    sampled,
    static_orders,
)
from scipy.integrate import solve_ivp

from cogless.drives.klipper import write_runs
from cogless.errors import StudyError
from cogless.printer.axis import Axis, read_axis
from cogless.printer.moves import Move, ramp
from cogless.printer.ramps import (
    HIDDEN_PACE,
    Blocks,
    blocks,
    check_wavelength,
    find_start,
    identify_ramps,
    other_causes,
    ringing_modes,
    tooth_way,
)
from cogless.printer.records import Run

COUNT = 2
AXES = random_axes(COUNT, 1)
SPEEDS = np.array([0.016, 0.03, 0.045, 0.07, 0.12, 0.2])


@pytest.fixture(scope="module")
def records() -> dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]:
    return ramp_records(AXES, COUNT)


@pytest.fixture
def axis_file(tmp_path: Path) -> Path:
    path = tmp_path / "printer.toml"
    path.write_text(FILE)
    return path


def coefficients(path: Path, direction: str) -> dict[int, complex]:
    waves = json.loads(path.read_text())[direction]
    return {w["order"]: w["magnitude_rad"] * np.exp(1j * w["phase_rad"]) for w in waves}


def ripple_ratio(axes: Axes, lane: int, corrections: dict[str, dict[int, complex]]) -> float:
    """The ripple that a correction of both directions leaves, as a share, rms over SPEEDS."""
    signed = np.concatenate([sign * SPEEDS for sign in SIGNS.values()])
    lanes = axes.take(np.full(2 * len(signed), lane))
    by_order = {
        n: np.concatenate([np.zeros(len(signed)), *(np.full(len(SPEEDS), corrections[d][n]) for d in SIGNS)])
        for n in (1, 2, 4)
    }
    rms = ripple_rms(lanes, np.tile(signed, 2), by_order)
    before, after = rms[: len(signed)], rms[len(signed) :]
    return float(np.sqrt(np.sum(after**2) / np.sum(before**2)))


def test_the_plant_is_that_of_another_integration() -> None:
    axes, way = AXES.take(np.array([0])), constant_speed(np.array([0.05]))
    t, values = accelerations(axes, way, {}, 0.4, every=1)
    start = np.array([way(0)[0] / axes.radius, 0, way(0)[0], 0])

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        return derivative(axes, state[:, None], axes.teeth / axes.radius * way(time))[:, 0]

    exact = solve_ivp(slope, (0, 0.4), start, rtol=1e-9, atol=1e-12, t_eval=t, method="DOP853", max_step=STEP)
    a = np.array([slope(time, state)[3] for time, state in zip(t, exact.y.T, strict=True)])
    assert values[:, 0] == pytest.approx(a, abs=2e-3 * np.max(np.abs(a)))


def test_closed_forms_of_the_errors_are_those_of_balanced_torques() -> None:
    for direction in (1, -1):
        closed = closed_form(AXES, direction, 0.05)
        for lane in range(COUNT):
            exact = static_orders(AXES, lane, direction, {}, 0.05)
            assert all(abs(exact[n] - closed[n][lane]) < 0.003 for n in exact)


def test_ramps_take_the_ripple_out(
    records: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]],
    axis_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rng, ratios, misses = np.random.default_rng(5), [], []
    for lane, noise in enumerate((0.1, 0.2)):
        logs = write_klipper_logs(tmp_path, records, lane, rng, noise)
        out_folder = tmp_path / f"found{lane}"
        code, out, err = cogless(
            capsys, "identify", *logs, "--drive", "klipper", "--drive-config", axis_file, "-o", out_folder
        )
        assert (code, err) == (0, "") and "Friction, if order 4 comes from the detent" in out
        results = {d: coefficients(out_folder / "correction.json", d) for d in SIGNS}
        for direction, sign in SIGNS.items():
            psi = static_orders(AXES, lane, sign, {}, 0.1)
            misses += [abs(results[direction][n] + psi[n]) for n in psi]
        # The phases of order 4 tell friction, since these motors have no third harmonic.
        friction = AXES.rail * AXES.radius + AXES.rotor_friction + AXES.viscous * 0.1 / AXES.radius
        angle = -np.angle(results["forward"][4] / results["backward"][4]) / 8
        assert angle * AXES.holding[lane] == pytest.approx(friction[lane], rel=0.2)
        ratios.append(ripple_ratio(AXES, lane, results))
    assert max(misses) < 0.006 and np.median(misses) < 0.0015
    assert np.mean(ratios) < 0.11 and max(ratios) < 0.2


@pytest.mark.parametrize(
    ("same", "line"),
    [
        (("probe", "plain"), "plain-1.csv: expected a printer whose SET_PHASE_CORRECTION acts"),
        (("backward", "forward"), "forward-plain-1.csv: expected a run in each direction"),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_run_that_is_not_what_its_name_says_is_one_line(
    noise: float,
    same: tuple[str, str],
    line: str,
    records: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]],
    axis_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Ramps whose probe does not act, and a second run forward that is named backward."""
    one, other = same
    wrong = {
        (d, k): records[d.replace(one, other), k.replace(one, other)]  # as it was recorded in truth
        for d, k in records
    }
    logs = write_klipper_logs(tmp_path, wrong, 0, np.random.default_rng(6), noise)
    logs = [path for path in logs if path.stem.endswith("-1")]
    out = ["-o", tmp_path / "found"]
    code, _, err = cogless(capsys, "identify", *logs, "--drive", "klipper", "--drive-config", axis_file, *out)
    assert (code, err.count("\n")) == (2, 1) and line in err


def test_a_motor_in_the_mirror_has_the_conjugate_correction(
    records: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]], axis_file: Path
) -> None:
    """Where u' = -u, phi' = -phi(-u') has the conjugate coefficients, and forward is backward."""
    axis, rng = read_axis(axis_file), np.random.default_rng(4)
    samples = [
        sampled(*(x if x.ndim == 1 else x[:, 0] for x in records["forward", k]), rng, 3200, start=-0.1)
        for k in ("plain", "probe")
    ]
    forward = [Run("f", "forward", t, a, c) for (t, a), c in zip(samples, ({}, PROBE), strict=True)]
    mirrored = {n: np.conj(c) for n, c in PROBE.items()}
    backward = [Run("b", "backward", t, a, c) for (t, a), c in zip(samples, ({}, mirrored), strict=True)]
    c = identify_ramps(axis, [(forward[0], forward[1])]).coefficients
    d = identify_ramps(axis, [(backward[0], backward[1])]).coefficients
    assert all(abs(d[n].value - np.conj(c[n].value)) < 1e-6 for n in PROBE)
    assert all(abs(d[n].value - c[n].value) > 1e-4 for n in PROBE)


def probed_blocks(
    records: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]], lane: int, noise: float, axis: Axis
) -> list[list[tuple[Blocks, Blocks]]]:
    """Three pairs of forward ramps, in blocks of the axis's wavelength and of twice this."""
    rng = np.random.default_rng(lane)
    runs = [
        [
            Run(kind, "forward", *sampled(t, values[:, lane], rng, 3200, noise), {})
            for kind in ("plain", "probe")
            for t, values in (records["forward", kind],)
        ]
        for _ in range(3)
    ]
    move = ramp(axis)
    modes = ringing_modes(runs[0][0], 0.0, move, axis.wavelength)
    return [
        [(blocks(a, 0.0, move, length, modes), blocks(b, 0.0, move, length, modes)) for a, b in runs]
        for length in (axis.wavelength, 2 * axis.wavelength)
    ]


@pytest.mark.parametrize("noise", [0.1, 1.0])
@pytest.mark.parametrize(
    ("change", "cures"),
    [
        (("pulley_teeth = 20", "pulley_teeth = 10"), ({"pulley_teeth": 20}, {"step_angle": "3.6 deg"})),
        (("pulley_teeth = 20", "pulley_teeth = 40"), ({"pulley_teeth": 20}, {"step_angle": "0.9 deg"})),
        (("1.8 deg", "0.9 deg"), ({"pulley_teeth": 40}, {"step_angle": "1.8 deg"})),
        (("1.8 deg", "3.6 deg"), ({"pulley_teeth": 10}, {"step_angle": "1.8 deg"})),
    ],
)
def test_a_wavelength_that_is_wrong_by_2_is_told_by_the_probe(
    change: tuple[str, str],
    cures: tuple[dict[str, object], ...],
    noise: float,
    records: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]],
    axis_file: Path,
) -> None:
    """The motor's own orders map onto each other, but the probe has three only. Each cure is right."""
    right = read_axis(axis_file)
    axis_file.write_text(FILE.replace(*change))
    wrong = read_axis(axis_file)
    for lane in range(COUNT):
        assert check_wavelength("a.csv", right, *probed_blocks(records, lane, noise, right)) == ""
        with pytest.raises(StudyError) as refused:
            check_wavelength("a.csv", wrong, *probed_blocks(records, lane, noise, wrong))
        assert refused.value.cures == tuple({f"printer.{k}": v for k, v in cure.items()} for cure in cures)
        for key, value in (item for cure in refused.value.cures for item in cure.items()):
            line = f"{key} = {json.dumps(value)}"
            assert line in str(refused.value).split("expected ")[1] and "\n" not in str(refused.value)
            changes = {key.removeprefix("printer."): value}
            kept = [row for row in axis_file.read_text().splitlines() if row.split(" = ")[0] not in changes]
            cured = axis_file.with_name("cured.toml")
            cured.write_text("\n".join([*kept, line.removeprefix("printer.")]))
            assert read_axis(cured).wavelength == pytest.approx(right.wavelength)


def test_noise_that_hides_the_probe_hides_a_wrong_wavelength(
    records: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]], axis_file: Path
) -> None:
    axis = read_axis(axis_file)
    assert check_wavelength("a.csv", axis, *probed_blocks(records, 0, 30.0, axis)) == HIDDEN_PACE


def test_a_belt_tooth_is_told_from_the_motor(
    records: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]], axis_file: Path
) -> None:
    axis = read_axis(axis_file)
    move = ramp(axis)
    t, values = records["forward", "plain"]
    times, a = sampled(t, values[:, 0], np.random.default_rng(6), 3200)
    omega = 2 * np.pi * move.speed_at(times) / 2e-3
    tooth = 4e-6 * omega**2 * np.sin(2 * np.pi * move.position_at(times) / 2e-3)
    for extra, size in ((0.0 * tooth, 0.0), (tooth, 4e-6)):
        way, doubt = tooth_way(Run("a", "forward", times, a + extra, {}), 0.0, move, axis)
        assert (way > doubt) == bool(size) and way == pytest.approx(size, abs=1.5e-6)
        remarks = other_causes(axis, Run("a", "forward", times, a + extra, {}), 0.0, (62.0,))
        assert "62 Hz" in remarks[0] and any("the belt's teeth" in line for line in remarks) == bool(size)


def test_a_ramp_is_the_macro_s_move(axis_file: Path) -> None:
    axis = read_axis(axis_file)
    move = ramp(axis)
    text = write_runs(axis)["cogless_ramps.cfg"]
    assert f"ACCEL={1e3 * move.acceleration:.3f}" in text and "G1 X220.0000 Y100.0000 F12000.0" in text
    t = np.linspace(0, move.duration, 20001)
    assert move.position_at(t)[-1] == pytest.approx(TRAVEL)
    assert np.gradient(move.position_at(t), t) == pytest.approx(move.speed_at(t), abs=1e-4)
    trapezoid = Move(0.1, 0.05, 1.0)
    t = np.linspace(0, trapezoid.duration, 20001)
    assert np.gradient(trapezoid.position_at(t), t) == pytest.approx(trapezoid.speed_at(t), abs=1e-3)


def test_the_start_of_a_ramp_is_found_where_one_resonance_is_loud(axis_file: Path) -> None:
    """Where it rings at one speed, blocks beside that explain much of their own energy at a wrong start."""
    axis, axes, rng = read_axis(axis_file), random_axes(12, 7).take(np.array([0])), np.random.default_rng(3)
    records, starts = ramp_records(axes, 1), []
    for direction in SIGNS:
        t, values = records[direction, "plain"]
        for _ in range(10):
            rate, start = 3200 * rng.uniform(0.99, 1.01), -rng.uniform(0.4, 0.7)
            times, x = sampled(t, values[:, 0], rng, rate, 0.1, start=start, end=t[-1] + 0.3)
            starts.append(find_start(Run("ramp", direction, times, x, {}), ramp(axis), axis.wavelength))
    assert np.max(np.abs(starts)) < 0.01
