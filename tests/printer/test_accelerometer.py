"""The accelerometer of a study: its samples, and the way from a run's logs by identify to a corrected run."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import cogless
from printer.printer_bench import FILE, SIGNS
from printer.printer_plant import closed_form, study_axes
from trial_studies import DRIVE

from cogless.drives.accelerometer import samples
from cogless.drives.klipper import read_samples
from cogless.errors import StudyError
from cogless.printer.records import probe
from cogless.results import Run
from cogless.results.trace import Trace
from cogless.run.simulate import simulate
from cogless.study import load
from cogless.study.mechanics import Accelerometer, Belt

RATE, SWING, FREQUENCY, RADIUS = 20_000, 2e-5, 60.0, 0.04 / (2 * np.pi)
PAGE = Path(__file__).parents[2] / "docs" / "guide" / "printers.md"
SENSOR = "mechanics.belt.accelerometer"


def belt(**keys: Any) -> Belt:
    return Belt(
        pulley_teeth=20, mass="0.5 kg", resonance="75 Hz", accelerometer=Accelerometer(axis="y", **keys)
    )


def swinging() -> Run:
    """A carriage on a sine of 20 um, for two seconds."""
    t, omega = np.arange(2 * RATE + 1) / RATE, 2 * np.pi * FREQUENCY
    speed = SWING * omega * np.cos(omega * t) / RADIUS
    return Run("a", "b", Trace(("time", "omega_load"), ("s", "rad/s"), np.column_stack([t, speed])))


def test_samples_are_the_acceleration_of_the_carriage() -> None:
    times, values = samples(belt(), swinging(), 0, 1)
    omega = 2 * np.pi * FREQUENCY
    true = -SWING * omega**2 * np.sin(omega * times)
    assert values[:, 1] == pytest.approx(true, abs=2e-3 * SWING * omega**2)
    assert np.all(values[:, 0] == 0) and np.all(values[:, 2] == 9.80665)
    assert np.diff(times) == pytest.approx(1 / 3200, rel=1e-9) and 0 <= times[0] < 1 / 3200
    assert times[-1] > 2 - 1.01 / 3200


def test_noise_steps_clock_and_beginning_differ_from_log_to_log_and_follow_from_the_seed() -> None:
    sensor = belt(noise="0.5 m/s^2", resolution="0.04 m/s^2", rate_error=0.02, late="0.5 s", rate="1.6 kHz")
    logs = [samples(sensor, swinging(), 7, number) for number in range(1, 41)]
    omega = 2 * np.pi * FREQUENCY
    rest = np.concatenate([a[:, 1] + SWING * omega**2 * np.sin(omega * t) for t, a in logs])
    assert np.std(rest) == pytest.approx(np.hypot(0.5, 0.04 / np.sqrt(12)), rel=0.01)
    assert np.mean(rest) == pytest.approx(0, abs=0.01)
    beside = np.concatenate([a[:, [0, 2]] - [0, 9.80665] for _, a in logs])
    assert np.std(beside, axis=0) == pytest.approx([0.5, 0.5], rel=0.01)
    steps = np.concatenate([a for _, a in logs]) / 0.04
    assert np.max(np.abs(steps - np.round(steps))) < 1e-9
    rates = np.array([1 / np.mean(np.diff(t)) for t, _ in logs]) / 1600
    starts = np.array([t[0] for t, _ in logs])
    assert 0.98 <= np.min(rates) < 0.985 and 1.015 < np.max(rates) <= 1.02
    assert 0 <= np.min(starts) < 0.06 and 0.44 < np.max(starts) < 0.502
    assert np.array_equal(samples(sensor, swinging(), 7, 3)[1], logs[2][1])
    assert not np.array_equal(samples(sensor, swinging(), 8, 3)[0], logs[2][0])


def test_a_run_is_the_same_with_a_sensor_on_its_carriage() -> None:
    study = {"scenario.20-mm-s.duration": "0.3 s", "metric": []}
    sensor = {f"{SENSOR}.axis": "x", f"{SENSOR}.rate": "1 kHz"}
    one, other = (simulate(load("printer", {**study, **more}), "20-mm-s", "table") for more in ({}, sensor))
    assert one.trace.names == other.trace.names and np.array_equal(one.trace.data, other.trace.data)


@pytest.mark.parametrize(
    ("name", "changes", "line"),
    [
        (
            "printer",
            {f"{SENSOR}.axis": "x"},
            f"{SENSOR}.rate: 3200 Hz: expected at most 1000 Hz, or trace.rate of 12800 Hz or more",
        ),
        (
            "printer-ramps",
            {f"{SENSOR}.late": "1.6 s"},
            f'{SENSOR}.late: "1.6 s": expected less than 1.6 s, half the shortest run',
        ),
        ("printer-ramps", {f"{SENSOR}.axis": "z"}, f'{SENSOR}.axis: "z": expected "x" or "y"'),
        (
            "printer-ramps",
            {f"{SENSOR}.noise": "0.1 A"},
            f'{SENSOR}.noise: "0.1 A": expected an acceleration, such as "1 m/s^2"',
        ),
        (
            "printer-ramps",
            {
                "scenario.forward-plain": {"duration": "1 s", "reference": "1 rpm", "controllers": ["probe"]},
                "controller.plain-probe": {"law": "microstepping", "current": "0.8 A"},
            },
            f"{SENSOR}: expected other names of scenarios or controllers: two runs have the log "
            '"forward-plain-probe"',
        ),
        ("printer-ramps", {f"{SENSOR}.logs": 0}, f"{SENSOR}.logs: 0: expected a number of 1 or more"),
    ],
)
def test_a_wrong_sensor_is_one_line(name: str, changes: dict[str, Any], line: str) -> None:
    with pytest.raises(StudyError) as refused:
        load(name, changes)
    assert str(refused.value).endswith(f": {line}")


def command(*words: object) -> str:
    done = subprocess.run([sys.executable, "-m", "cogless", *map(str, words)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.fixture(scope="module")
def closed_loop(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    """The words of the guide: the folder, what the run of the ramps printed, and what identify printed."""
    folder = tmp_path_factory.mktemp("ramps")
    (folder / "printer.toml").write_text(FILE)
    ran = command("run", "printer-ramps", "-o", folder / "ramps")
    logs = sorted((folder / "ramps" / "accelerometer").iterdir())
    words = ["--drive", "klipper", "--drive-config", folder / "printer.toml", "-o", folder / "found"]
    return folder, ran, command("identify", *logs, *words)


def test_the_logs_of_a_run_are_found_in_its_folder(closed_loop: tuple[Path, str, str]) -> None:
    folder, ran, _ = closed_loop
    place = folder / "ramps" / "accelerometer"
    assert f"\nAccelerometer: {place}\n" in ran
    names = {f"cogless-x-{d}-{k}-{n}.csv" for d in SIGNS for k in ("plain", "probe") for n in (1, 2, 3)}
    assert {path.name for path in place.iterdir()} == names
    listed = json.loads((folder / "ramps" / "results.json").read_text())["files"]
    assert {f"accelerometer/{name}" for name in names} <= set(listed)
    # The carriage's way, twice differentiated, is what a log without noise has.
    study = load("printer-ramps", {f"{SENSOR}.noise": "0 m/s^2", f"{SENSOR}.resolution": "0 m/s^2"})
    run, sensor = simulate(study, "forward", "plain"), study.belt("forward")
    assert sensor is not None
    times, quiet = samples(sensor, run, study.seed, 1)
    way, t = RADIUS * run.trace["theta_load"], run.trace.time
    twice = np.interp(times, t[1:-1], np.diff(way, 2) / np.diff(t)[0] ** 2)
    assert quiet[:, 0] == pytest.approx(twice, abs=0.02 * np.max(np.abs(twice)))
    logged, noisy = read_samples(place / "cogless-x-forward-plain-1.csv", (1.0, 0.0))
    assert logged == pytest.approx(times, abs=1e-6)
    assert np.std(noisy - quiet[:, 0]) == pytest.approx(np.hypot(0.1, 0.0392 / np.sqrt(12)), rel=0.03)


def test_the_probe_of_the_study_is_the_one_of_the_macro() -> None:
    law: Any = load("printer-ramps").controller["probe"]
    for waves in (law.correction.forward, law.correction.backward):
        found = {wave.order: wave.magnitude * np.exp(1j * wave.phase) for wave in waves}
        assert found == pytest.approx(probe())


def test_from_the_study_s_logs_to_a_study_with_little_ripple(
    closed_loop: tuple[Path, str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Coefficients against the closed forms of the study's errors, and the ripple that the guide names."""
    folder, _, found = closed_loop
    assert "Friction, if order 4 comes from the detent" in found
    contents = json.loads((folder / "found" / "correction.json").read_text())
    for direction, sign in SIGNS.items():
        psi = closed_form(study_axes(1), sign, 0.1)
        for wave in contents[direction]:
            c = wave["magnitude_rad"] * np.exp(1j * wave["phase_rad"])
            assert abs(c + psi[wave["order"]][0]) < wave["error_rad"] + 0.003
    change = f"controller.table.correction={{ file = '{folder / 'found' / 'correction.json'}' }}"
    code, _, err = cogless(capsys, "run", "printer", "--set", change, "-o", folder / "corrected")
    assert (code, err) == (0, "")
    runs = json.loads((folder / "corrected" / "results.json").read_text())["runs"]
    ripple = {(run["scenario"], run["controller"]): run["metrics"]["carriage_ripple_m"] for run in runs}
    scenarios = dict.fromkeys(scenario for scenario, _ in ripple)
    assert all(ripple[s, "table"] < 0.15 * ripple[s, "plain"] for s in scenarios)
    row = re.search(r"^\| identified from the study's logs \|(.*)\|$", PAGE.read_text("utf-8"), re.MULTILINE)
    assert row is not None
    figures = [1e-6 * float(cell) for cell in row[1].split("|")]
    assert figures == pytest.approx([ripple[s, "table"] for s in scenarios], rel=0.06)  # two digits


def test_a_study_of_trials_refuses_a_sensor(tmp_path: Path) -> None:
    path = tmp_path / "move.toml"
    carriage = '[mechanics.belt]\npulley_teeth = 20\nmass = "1 g"\nresonance = "75 Hz"\n'
    path.write_text(DRIVE + carriage + '[mechanics.belt.accelerometer]\naxis = "x"\n')
    with pytest.raises(StudyError) as refused:
        load(path)
    assert str(refused.value).startswith(f"{path}: {SENSOR}: ")
    assert str(refused.value).endswith("expected no such key in a study of trials: delete accelerometer")


def test_the_ramps_are_of_the_study_printer_s_axis() -> None:
    """The correction that they tell is used in the study printer."""
    ramps, printer = (load(name).source.tables for name in ("printer-ramps", "printer"))
    own = {**ramps["mechanics"], "belt": {**ramps["mechanics"]["belt"]}}
    del own["belt"]["accelerometer"]
    assert own == printer["mechanics"]
    assert [ramps[table] for table in ("motor", "drive")] == [printer[table] for table in ("motor", "drive")]
