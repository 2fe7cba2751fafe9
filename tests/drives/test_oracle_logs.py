"""Logs that the simulator makes under a firmware's law tell the motor; the table goes back into that law."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from commands import cogless
from drives import oracle, test_vesc
from drives.drive_bench import RATE, TURN, Plant
from drives.oracle import motions, played, ripples
from drives.oracle_logs import FIRMWARES, ODRIVE_GAINS, SIMPLEFOC_GAINS

from cogless.drives.firmware_laws import ODRIVE_CELLS

PLANT = Plant()
JOINT_ERROR = 1.35  # 2.64 over 1.96 standard deviations: six values at once lie within it in 95 %


def check_values(folder: Path, plant: Plant = PLANT) -> None:
    """Inertia, friction and cogging, each within its error; as many orders as stand out."""
    values = json.loads((folder / "identified.json").read_text())
    for key, truth in (("j", plant.inertia), ("c", plant.coulomb), ("b", plant.viscous)):
        entry = values["values"][key]
        assert abs(entry["value"] - truth / plant.K_t) < JOINT_ERROR * entry["error"], (key, entry)
    sizes = {n: size for n, size, _ in plant.cogging}
    for part in values["cogging"]:
        error = JOINT_ERROR * part["amplitude_error"]
        assert abs(part["amplitude_N_m"] - sizes[part["order"]]) < error, part


def cogging_orders(folder: Path) -> set[int]:
    return {part["order"] for part in json.loads((folder / "identified.json").read_text())["cogging"]}


@pytest.fixture(scope="module", params=["simplefoc", "odrive"])
def bench(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """The drive, and the folder of its logs and its configuration."""
    drive, folder = request.param, tmp_path_factory.mktemp(request.param)
    FIRMWARES[drive].write(folder)
    return drive, folder


def own_law(drive: str, current: np.ndarray) -> dict[str, object]:
    """The firmware's law with the current at evenly spaced angles, A, as its table."""
    if drive == "simplefoc":
        return oracle.law("SimpleFoc", **SIMPLEFOC_GAINS, entries=current.tolist())
    return oracle.law("Odrive", **ODRIVE_GAINS, cells=(PLANT.K_t * current).tolist())


def test_logs_of_the_oracle_give_a_table_for_the_oracle(
    bench: tuple[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """ODrive takes no table from outside, but its law has one: the CSV's currents become its torques."""
    drive, folder = bench
    firmware, logs, found = FIRMWARES[drive], sorted(folder.glob("*.csv")), tmp_path / "found"
    configuration = folder / firmware.configuration
    code, _, err = cogless(
        capsys, "identify", *logs, "--drive", drive, "--drive-config", configuration, "-o", found
    )
    assert (code, err) == (0, "")
    check_values(found)  # SimpleFOC's slow run sticks: the rotor stands in a quarter of its rows
    assert cogging_orders(found) == {n for n, _, _ in PLANT.cogging}
    table = tmp_path / firmware.table
    code, _, err = cogless(capsys, "table", found, "--to", firmware.form, "-o", table)
    assert (code, err) == (0, "")
    places = TURN / ODRIVE_CELLS * (np.arange(ODRIVE_CELLS) + (0.5 if drive == "odrive" else 0.0))
    true = PLANT.holding(places)
    laws = {"none": firmware.law(""), "true": own_law(drive, true), "mine": firmware.law(table.read_text())}
    left = ripples(laws, firmware.speed_rate)
    assert left["true"] < 0.1 * left["none"], left
    assert left["mine"] < 1.5 * left["true"], left


def test_logs_of_vesc_give_inertia_and_friction(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its rows show no order of cogging at these speeds, and it takes no table."""
    gains = {"law": "pi", "kp": "0.15 A*s/rad", "ki": "0.9 A/rad"}
    logs = []
    for run in played(motions(test_vesc.motions()), {"pi": gains}, plant=test_vesc.PLANT):
        turned = np.unwrap(run.trace["theta_m"])
        log = {"t": np.arange(len(turned)) / RATE, "phi": turned}
        log |= {"omega": run.trace["omega_m"], "i": run.trace["i_q"]}
        logs.append(test_vesc.log(log, tmp_path / f"{run.scenario}.csv"))
    config, found = tmp_path / "motor.xml", tmp_path / "found"
    config.write_text(test_vesc.XML)
    code, out, err = cogless(
        capsys, "identify", *logs, "--drive", "vesc", "--drive-config", config, "-o", found
    )
    assert (code, err) == (0, "") and "50 rows a second of mean currents" in out
    check_values(found, test_vesc.PLANT)
    assert not cogging_orders(found)
