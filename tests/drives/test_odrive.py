"""ODrive: captures of both firmwares, made by a stand-in of its controller, and its map."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import cogless
from drives.drive_bench import RATE, RUNS, TURN, Plant, Tracker, play, profile
from drives.odrive_files import OLD, old_csv

PLANT = Plant()
ENCODER_ZERO = -0.8  # rad: pos_estimate where the rotor is at 0
NEW = {
    "axis0.config.motor.pole_pairs": 7,
    "axis0.config.motor.torque_constant": PLANT.K_t,
    "axis0.config.motor.phase_resistance": 0.8,
    "axis0.config.motor.phase_inductance": 0.00045,
    "axis0.config.motor.current_soft_max": 8.0,
    "axis0.config.motor.current_control_bandwidth": 1000.0,
}
GOALS = (("j", PLANT.inertia, 0.01), ("c", PLANT.coulomb, 0.01), ("b", PLANT.viscous, 0.05))
NEW_PATHS = ("pos_estimate", "vel_estimate", "motor.foc.Iq_measured")


def run(points: list[tuple[float, float]]) -> dict[str, np.ndarray]:
    """A P controller of the position over a PI of the speed; the torque becomes a current by its constant."""
    reference, tracker = profile(points), Tracker(8192, 1000 / TURN)
    pos_gain, vel_gain, vel_integrator_gain = (
        20.0,
        2.2e-3 * TURN,
        0.03 * TURN,
    )  # 1/s, N m per turn/s, per turn
    integral, start = 0.0, None
    rows = []

    def law(t: float, phi: float, omega: float) -> float:
        nonlocal integral, start
        angle, speed = tracker.step(phi + ENCODER_ZERO, omega)
        position, velocity = angle / TURN, speed / TURN
        start = position if start is None else start
        wanted, feed = (value / TURN for value in reference(t))
        error = feed + pos_gain * (start + wanted - position) - velocity
        integral += vel_integrator_gain / RATE * error
        rows.append((position, velocity))
        return (vel_gain * error + integral) / PLANT.K_t

    made = play(PLANT, law, points[-1][0], points[0][1])
    position, velocity = np.array(rows).T
    current = made["i"] + 2e-3 * np.random.default_rng(4).standard_normal(len(position))
    return {"t": made["t"], "position": position, "velocity": velocity, "Iq": current}


@pytest.fixture(scope="module")
def captures() -> dict[str, dict[str, np.ndarray]]:
    return {name: run(points) for name, points in RUNS.items()}


def new_npz(made: dict[str, np.ndarray], path: Path, unit: str) -> Path:
    every = 5
    cycles = (np.round(8000 / RATE * np.arange(0, len(made["t"]), every)) + 77_000).astype(np.int64)
    stamps = cycles if unit == "cycles" else cycles * 125_000
    columns = {"timestamps": stamps}
    for name, key in zip(NEW_PATHS, ("position", "velocity", "Iq"), strict=True):
        columns[f"axis0.{name}"] = made[key][::every]
    np.savez(path, **columns)
    return path


def logs_toml(path: Path) -> Path:
    """What was asked for in each log."""
    rules = []
    for name, points in RUNS.items():
        profile_text = ", ".join(f'["{t} s", "{v} rad/s"]' for t, v in points)
        rules.append(f'[[log]]\nfile = "{name}.*"\nreference = {{ profile = [{profile_text}] }}\n')
    path.write_text("\n".join(rules))
    return path


def test_its_own_law_tells_how_late_its_currents_are(
    captures: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """P of the position over PI of the speed, played by cogless with the gains of the configuration."""
    config, rules = tmp_path / "config.json", logs_toml(tmp_path / "logs.toml")
    loop = {"pos_gain": 20.0, "vel_gain": 2.2e-3 * TURN, "vel_integrator_gain": 0.03 * TURN}
    axis = {**OLD, "encoder": {"config": {"cpr": 8192, "bandwidth": 1000.0}}, "controller": {"config": loop}}
    config.write_text(json.dumps({"axis0": axis}))
    logs = [old_csv(made, tmp_path / f"{name}.csv") for name, made in captures.items()]
    delays = []
    for options in ([], ["--config", rules]):
        command = ["identify", *logs, "--drive-config", config, *options, "-o", tmp_path / "found"]
        code, out, err = cogless(capsys, *command)
        assert (code, err) == (0, "")
        assert ("could not be simulated" in out, "Not simulated: " in out) == (False, not options)
        rule = (
            "needs its reference (from logs.toml of identify --plan --drive odrive: give --config logs.toml)"
        )
        assert (rule in out) == (not options) and "[[log]]" not in out
        delays.append(json.loads((tmp_path / "found" / "identified.json").read_text())["values"]["delay"])
    for delay in delays:  # The logs alone tell it as well: rows are 2 ms apart, the true one is 0.
        assert abs(delay["value"]) < 1.2 * delay["error"] < 3e-4, delays
    assert delays[1]["error"] < delays[0]["error"], "the law and the logs together tell it better"


def true_current(angle: np.ndarray) -> np.ndarray:
    return PLANT.holding(angle - ENCODER_ZERO)


@pytest.mark.parametrize("form", ["0.5", "0.6 ns", "0.6 cycles"])
def test_captures_tell_the_motor(
    form: str, captures: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"axis0": OLD} if form == "0.5" else NEW))
    if form == "0.5":
        logs = [old_csv(made, tmp_path / f"{name}.csv") for name, made in captures.items()]
    else:
        logs = [new_npz(made, tmp_path / f"{name}.npz", form.split()[1]) for name, made in captures.items()]
    folder = tmp_path / "found"
    code, out, err = cogless(capsys, "identify", *logs, "--drive-config", config, "-o", folder)
    assert (code, err) == (0, "")
    assert f"its first lines are those of ODrive, a capture of firmware {form[:3]}" in out
    values = json.loads((folder / "identified.json").read_text())["values"]
    for key, truth, goal in GOALS:  # one of twenty intervals of 95 % may miss, a goal may not
        off = abs(values[key]["value"] - truth / PLANT.K_t)
        assert off < max(1.2 * values[key]["error"], goal * truth / PLANT.K_t), key
    # it takes no table, so the next command writes one for code of one's own
    (following,) = (line for line in out.splitlines() if line.startswith("Next: "))
    assert following == f"Next: cogless table {folder} --to csv -o FILE"
    words = following.removeprefix("Next: cogless ").replace("FILE", str(tmp_path / "table.csv")).split()
    code, _, err = cogless(capsys, *words)
    assert (code, err) == (0, "")
    degrees, current = np.loadtxt(tmp_path / "table.csv", delimiter=",", skiprows=1).T
    truth = true_current(np.radians(degrees))
    assert np.std(current - truth) < 0.1 * np.std(truth)
    code, _, err = cogless(capsys, "table", folder, "--to", "odrive")
    assert (
        code == 2
        and "--to: odrive: takes no table: firmware 0.5 allows reading its map, but not writing it" in err
    )


def test_its_map_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Value i stands at i/3600; a map made from one side has friction in its mean."""
    config, source = tmp_path / "config.json", tmp_path / "map.txt"
    config.write_text(json.dumps({"axis0": OLD}))
    places = TURN / 3600 * np.arange(3600)
    source.write_text("\n".join(f"{PLANT.K_t * v + 0.5 * PLANT.coulomb:.9g}" for v in true_current(places)))
    options = ["--from", "odrive", "--drive-config", config, "--to", "csv", "-o", tmp_path / "table.csv"]
    code, _, err = cogless(capsys, "table", source, *options)
    assert (code, err) == (0, "")
    degrees, current = np.loadtxt(tmp_path / "table.csv", delimiter=",", skiprows=1).T
    assert current == pytest.approx(true_current(np.radians(degrees)), abs=0.003)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"torque_constant": 0},
            "axis0.motor.config.torque_constant: 0: expected a torque constant above zero",
        ),
        ({"phase_resistance": math.nan}, "axis0.motor.config.phase_resistance: nan: expected the resistance"),
        ({"pole_pairs": None}, "axis0.motor.config.pole_pairs: None: expected a number of pole pairs"),
    ],
)
def test_a_configuration_that_does_not_fit_is_one_line(
    change: dict[str, Any],
    message: str,
    captures: dict[str, Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    config = tmp_path / "config.json"
    motor = {"config": {**OLD["motor"]["config"], **change}}
    config.write_text(json.dumps({"axis0": {**OLD, "motor": motor}}))
    log = old_csv(captures["accel"], tmp_path / "accel.csv")
    code, _, err = cogless(capsys, "identify", log, "--drive-config", config, "-o", tmp_path / "out")
    assert code == 2 and message in err and err.count("\n") == 1


def test_files_that_do_not_fit_are_one_line(
    captures: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = old_csv(captures["accel"], tmp_path / "accel.csv")
    config, other = tmp_path / "config.json", tmp_path / "other.csv"
    config.write_text(json.dumps({"axis1": OLD}))
    other.write_text(log.read_text().replace("axis0.", "axis1."))
    untimed = tmp_path / "untimed.csv"
    untimed.write_text(log.read_text().replace("t,", "x,", 1))
    new = tmp_path / "new.json"
    new.write_text(json.dumps(NEW))
    cases = {
        (
            log,
            "--drive-config",
            new,
        ): f"{new}: a configuration of firmware 0.6: expected the configuration of the drive "
        f"that recorded {log}, with firmware 0.5",
        (log,): f"{log}: a log of ODrive: expected --drive-config FILE with the JSON",
        (log, "--drive-config", config): f"{config}: axis0.motor.config.current_lim or",
        (log, other, "--drive-config", config): f"{log}: axes 0, 1: expected the logs of one axis",
        (untimed, "--drive-config", config): f"{untimed}: expected one column of the time",
        (
            log,
            "--drive",
            "moteus",
            "--drive-config",
            config,
        ): f"{log}: its first lines are those of ODrive, a capture of firmware 0.5: expected",
        (log, "--drive-config", other): f"{other}: not readable as JSON: expected the JSON of odrivetool",
    }
    for arguments, message in cases.items():
        code, _, err = cogless(capsys, "identify", *arguments, "-o", tmp_path / "out")
        assert code == 2 and message in err and err.count("\n") == 1, err


def test_a_map_that_is_on_is_told(
    captures: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "config.json"
    on = {"config": {"anticogging": {"pre_calibrated": True, "anticogging_enabled": True}}}
    config.write_text(json.dumps({"axis0": {**OLD, "controller": on}}))
    log = old_csv(captures["accel"], tmp_path / "accel.csv")
    code, out, _ = cogless(capsys, "identify", log, "--drive-config", config, "-o", tmp_path / "out")
    assert code == 0 and f"{config}: its anti-cogging map is on" in out


DATA = next((path for up in Path(__file__).parents if (path := up / "shared" / "data").is_dir()), None)


def test_spin_ups_of_a_real_odrive_tell_its_inertia(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """J/K_t is 3.74e-3 +- 0.36e-3 A s^2/rad by an impulse balance, without derivative and kernel.

    Its counts are turned into turns, as the API has them, with one file a run.
    """
    pytest.importorskip("cogless.identify.jackknife", reason="needs the balance with instruments")
    if DATA is None:
        pytest.skip("the real log is not beside the repository")
    rows: dict[str, list[str]] = {}
    with gzip.open(DATA / "real_logs" / "odrive_spinups_4.csv.gz", "rt") as file:
        assert next(file).strip() == "run,t,pos,iq_set,iq"
        for line in file:
            name, t, position, _, current = line.strip().split(",")
            rows.setdefault(name, []).append(f"{t},{float(position) / 8192:.9f},{current}")
    heading = "t,axis0.encoder.pos_estimate,axis0.motor.current_control.Iq_measured"
    logs = [tmp_path / f"run{name}.csv" for name in rows]
    for path, lines in zip(logs, rows.values(), strict=True):
        path.write_text("\n".join([heading, *lines]) + "\n")
    config = tmp_path / "config.json"
    motor = {**OLD["motor"]["config"], "current_lim": 60.0}
    config.write_text(json.dumps({"axis0": {**OLD, "motor": {"config": motor}}}))
    code, _, err = cogless(capsys, "identify", *logs, "--drive-config", config, "-o", tmp_path / "found")
    assert (code, err) == (0, "")
    inertia = json.loads((tmp_path / "found" / "identified.json").read_text())["values"]["j"]
    assert abs(inertia["value"] - 3.74e-3) < 0.36e-3 + inertia["error"] and inertia["error"] < 0.3e-3
