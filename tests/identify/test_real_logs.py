"""Logs of real drives whose inertia an independent calculation tells; skipped where they are not at hand."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from cogless.identify import config, findings, voltage
from cogless.identify.command import identified
from cogless.identify.log import load_logs
from cogless.identify.result import Estimate

LOGS = Path(__file__).parents[2].parent / "shared/data/real_logs"
BESIDE = Path(__file__).parents[3] / "../shared/data/real_logs"
LAAS = """
columns = { t = "Time", theta = "Position", i_q = "Iq" }
motor = { pole_pairs = 12, R_s = "0.5 ohm", L_d = "0.2 mH", L_q = "0.2 mH", K_t = "0.03 N*m/A" }
[drive]
rates = { current_loop = "1 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "100 Hz", current_limit = "5 A" }
inverter = { bus_voltage = "20 V" }
position_sensor = { kind = "encoder", lines = 5000, speed_method = "M" }
"""
ODRIVE = """
columns = { t = "t", theta = { name = "pos", unit = "count" }, i_q = "iq", part = "run" }
motor = { pole_pairs = 7, R_s = "0.1 ohm", L_d = "0.1 mH", L_q = "0.1 mH", K_t = "0.06 N*m/A" }
[drive]
rates = { current_loop = "8 kHz", speed_loop = "8 kHz" }
current_loop = { bandwidth = "1 kHz", current_limit = "60 A" }
inverter = { bus_voltage = "24 V" }
position_sensor = { kind = "encoder", lines = 2048, speed_method = "M" }
"""


def files_of(name: str, columns: str, folder: Path) -> tuple[Path, Path]:
    """The log and the file of its columns."""
    packed = next((at / f"{name}.csv.gz" for at in (LOGS, BESIDE) if (at / f"{name}.csv.gz").is_file()), None)
    if packed is None:
        pytest.skip(f"{name}: the real log is not beside the repository")
    path = folder / f"{name}.csv"
    path.write_bytes(gzip.decompress(packed.read_bytes()))
    (folder / "id.toml").write_text(columns, "utf-8")
    return path, folder / "id.toml"


def of_log(name: str, columns: str, folder: Path) -> Estimate:
    """What a log tells by itself."""
    path, known = files_of(name, columns, folder)
    return identified([path], known, lambda what, share: None).estimate


@pytest.mark.parametrize(
    ("name", "columns", "inertia", "unsure"),
    [("laas_acc_current", LAAS, 1.91e-4, 0.0), ("odrive_spinups_4", ODRIVE, 3.74e-3, 0.36e-3)],
)
def test_inertia_of_a_real_drive_is_that_of_an_independent_calculation(
    name: str, columns: str, inertia: float, unsure: float, tmp_path: Path
) -> None:
    """J/K_t, A s^2/rad, of a wide kernel's regression, and of an impulse balance without any kernel.

    Both drives are rigid, but above 20 Hz errors of the angle exceed the motion.
    """
    estimate = of_log(name, columns, tmp_path)
    assert not [line for line in estimate.remarks if "is not one rigid body" in line]
    told = estimate.values["j"]
    assert abs(told.value - inertia) < told.error + unsure
    assert told.error < 0.08 * inertia


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("laas_acc_current", LAAS.replace('"Iq"', '"Iq", omega = "Velocity", u_q = "Uq"')),
        ("odrive_spinups_4", ODRIVE.replace('"iq"', '"iq", i_q_ref = "iq_set"')),
    ],
)
def test_no_unit_of_a_real_drive_is_called_wrong(name: str, columns: str, tmp_path: Path) -> None:
    path, of_columns = files_of(name, columns, tmp_path)
    known = config.load(of_columns)
    used, remarks = findings.usable(known, load_logs([path], known))
    voltage.require_units(known, used)
    assert used and not [line for line in remarks if "exchanged" in line]
