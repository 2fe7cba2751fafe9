"""VESC: 50 rows a second of mean currents beside momentary angles, as VESC Tool writes them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import cogless
from drives.drive_bench import RATE, TURN, Plant, play, profile

from cogless.drives.vesc import read_logs

PLANT = Plant(inertia=2e-4, coulomb=6e-3, viscous=1e-4)
PAIRS = 7
XML = f"""<?xml version="1.0" encoding="UTF-8"?>
<MCConfiguration>
    <l_current_max>20</l_current_max>
    <foc_current_kp>0.45</foc_current_kp>
    <foc_current_ki>800</foc_current_ki>
    <foc_f_zv>25000</foc_f_zv>
    <foc_motor_l>0.00045</foc_motor_l>
    <foc_motor_r>0.8</foc_motor_r>
    <foc_motor_flux_linkage>{PLANT.K_t / 1.5 / PAIRS}</foc_motor_flux_linkage>
    <si_motor_poles>{2 * PAIRS}</si_motor_poles>
</MCConfiguration>
"""
POLL = RATE // 50
HEADINGS = ["ms_today", "input_voltage", "current_motor", "d_axis_current", "q_axis_current", "erpm"]
HEADINGS += ["duty_cycle", "encoder_position", "fault_code"]


def motions() -> dict[str, list[tuple[float, float]]]:
    ramp, top = 2.0, 60.0
    up = [(k * ramp, top * (-1) ** k) for k in range(9)]
    speeds = [
        (0.0, 5.0),
        (6.0, 5.0),
        (7.0, -5.0),
        (13.0, -5.0),
        (14.0, 40.0),
        (20.0, 40.0),
        (22.0, -40.0),
        (28.0, -40.0),
    ]
    return {"accel": up, "speeds": speeds}


def run(points: list[tuple[float, float]]) -> dict[str, np.ndarray]:
    reference = profile(points)
    integral = 0.0

    def law(t: float, phi: float, omega: float) -> float:
        nonlocal integral
        error = reference(t)[1] - omega
        integral += 0.9 / RATE * error
        return 0.15 * error + integral

    return play(PLANT, law, points[-1][0], points[0][1])


def log(made: dict[str, np.ndarray], path: Path, encoder: bool = True, start: float = 86_399_000.0) -> Path:
    """The log of a PC that begins a second before midnight; six digits, a semicolon at each line's end."""
    lines = [";".join(HEADINGS) + ";"]
    rows = range(POLL, len(made["t"]), POLL)
    for k in rows:
        mean = float(np.mean(made["i"][k - POLL : k]))
        angle = np.degrees(made["phi"][k]) % 360 if encoder else 0
        erpm = made["omega"][k] * 60 / TURN * PAIRS
        stamp = (start + round(1e3 * made["t"][k])) % 86_400_000
        row = (24.0, abs(mean), 0.0, mean, erpm, 0.1, angle, 0)
        lines.append(";".join([f"{stamp:.0f}", *(f"{value:.6g}" for value in row)]) + ";")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def crawl() -> dict[str, Any]:
    return run([(0.0, 1.5), (20.0, 1.5), (21.0, -1.5), (41.0, -1.5)])


@pytest.fixture(scope="module")
def runs() -> dict[str, Any]:
    return {name: run(points) for name, points in motions().items()}


@pytest.mark.parametrize("encoder", [True, False])
def test_inertia_and_friction_come_out(
    encoder: bool, runs: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [log(made, tmp_path / f"{name}.csv", encoder) for name, made in runs.items()]
    config = tmp_path / "motor.xml"
    config.write_text(XML)
    folder = tmp_path / "found"
    code, out, err = cogless(capsys, "identify", *logs, "--drive-config", config, "-o", folder)
    assert (code, err) == (0, "")
    assert "its first lines are those of VESC, a log of real-time data" in out
    assert "50 rows a second of mean currents, at " in out
    assert ("so the phase of an order on the rotor is unknown" in out) == (not encoder)
    assert "needs its reference in the --config file and its controller, since cogless has" in out
    values = json.loads((folder / "identified.json").read_text())["values"]
    assert values["j"]["value"] == pytest.approx(PLANT.inertia / PLANT.K_t, rel=0.02)
    assert values["c"]["value"] == pytest.approx(PLANT.coulomb / PLANT.K_t, rel=0.05)
    code, _, err = cogless(capsys, "table", folder, "--to", "vesc")
    assert code == 2 and "--to: vesc: takes no table: VESC has no cogging table" in err


def test_a_quarter_of_a_turn_a_second_adds_one_order_and_costs_nothing(
    runs: dict[str, Any], crawl: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its mean currents show order 12; orders that it does not show do not take that away."""
    config = tmp_path / "motor.xml"
    config.write_text(XML)
    logs = [log(made, tmp_path / f"{name}.csv") for name, made in {**runs, "crawl": crawl}.items()]
    told = []
    for number in (2, 3):
        folder = tmp_path / f"found{number}"
        code, _, err = cogless(capsys, "identify", *logs[:number], "--drive-config", config, "-o", folder)
        assert (code, err) == (0, "")
        told.append(json.loads((folder / "identified.json").read_text()))
    for key in ("c", "b"):
        assert told[1]["values"][key]["error"] < 2 * told[0]["values"][key]["error"], key
    # With the slow log the delay is known less: 2.7 ms in place of .2. That is .16 % of the inertia, not .06.
    assert told[1]["values"]["j"]["error"] < 2e-3 * told[1]["values"]["j"]["value"]
    assert not told[0]["cogging"]
    (wave,) = told[1]["cogging"]
    order, size, _ = PLANT.cogging[0]
    assert wave["order"] == order
    assert wave["amplitude_N_m"] == pytest.approx(size, rel=0.05)


def test_means_are_laid_over_the_middle_of_their_rows(runs: dict[str, Any], tmp_path: Path) -> None:
    """Over midnight, and with more than half a turn between two rows."""
    made = runs["accel"]
    config = tmp_path / "motor.xml"
    config.write_text(XML)
    (recording,) = read_logs([log(made, tmp_path / "accel.csv")], config).recordings
    t = recording.signals["t"]
    assert np.diff(t) == pytest.approx(POLL / RATE)
    rows = np.arange(POLL, len(made["t"]), POLL)
    at = (rows[1:] + rows[:-1]) // 2
    theta, truth = recording.signals["theta"], made["phi"][at]
    # The speed changes between rows, which bends the angle by less than a milliradian.
    assert theta - theta[0] == pytest.approx(truth - truth[0], abs=0.01)
    assert np.max(np.abs(np.diff(theta))) > 1.1  # more than 60 deg a row
    means = [float(np.mean(made["i"][k - POLL : k])) for k in rows[1:]]
    assert recording.signals["i_q"] == pytest.approx(means, rel=1e-4, abs=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("<si_motor_poles>14<", "<si_motor_poles>13<"), "si_motor_poles: 13: expected an even number"),
        (("<foc_motor_r>0.8</foc_motor_r>", ""), "foc_motor_r: missing: expected the resistance"),
        (("<foc_motor_r>0.8<", "<foc_motor_r>none<"), 'foc_motor_r: "none": expected the resistance'),
        (("</MCConfiguration>", ""), "not readable as XML: no element found"),
        (("<MCConfiguration>", "<!DOCTYPE a [<!ENTITY b 'c'>]><MCConfiguration>"), "it defines entities"),
    ],
)
def test_a_configuration_that_does_not_fit_is_one_line(
    change: tuple[str, str],
    message: str,
    runs: dict[str, Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = log(runs["accel"], tmp_path / "accel.csv")
    config = tmp_path / "motor.xml"
    config.write_text(XML.replace(*change))
    code, _, err = cogless(capsys, "identify", path, "--drive-config", config, "-o", tmp_path / "out")
    assert code == 2 and f"{config}: {message}" in err and err.count("\n") == 1


@pytest.mark.parametrize("inverted", [0, 1])
def test_the_encoders_own_angle_is_that_of_the_configuration(
    inverted: int, runs: dict[str, Any], tmp_path: Path
) -> None:
    """The logged position is the encoder's, turned by m_invert_direction, less p_pid_offset."""
    config = tmp_path / "motor.xml"
    extra = f"<m_invert_direction>{inverted}</m_invert_direction><p_pid_offset>30</p_pid_offset>"
    config.write_text(XML.replace("</MCConf", extra + "</MCConf"))
    frame = read_logs([log(runs["accel"], tmp_path / "a.csv")], config).frame
    position, encoder = 75.0, 105.0 if not inverted else -105.0
    own = frame.encoder_direction * position + np.degrees(frame.encoder_shift)
    assert frame.zero and own == pytest.approx(encoder) and frame.pole_pairs == PAIRS
    for change, message in (
        ("<p_pid_ang_div>4</p_pid_ang_div>", "p_pid_ang_div is not 1: expected 1"),
        ("", ""),
    ):
        config.write_text(XML.replace("</MCConf", change + "</MCConf"))
        assert message in read_logs([tmp_path / "a.csv"], config).frame.lacking
    without = read_logs([log(runs["accel"], tmp_path / "b.csv", encoder=False)], config).frame
    assert not without.zero and "encoder_position does not turn with erpm" in without.lacking
