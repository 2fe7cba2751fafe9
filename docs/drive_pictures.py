"""The speed of a motor under its drive's law, without the table and with the table that its logs give.

    python docs/drive_pictures.py DRIVE FOLDER

The motor turns under the law of cogless.drives.firmware_laws, and logs are written in the drive's format.
`cogless identify` and `cogless table` read these files only. Then the same motor, not the identified one,
turns with the table.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from cogless.report import write_plots
from cogless.units import RPM

sys.path.append(str(Path(__file__).parents[1] / "tests"))

SPEED_RPM, SECONDS = 30, 4  # two turns


def drawn(drive: str, folder: Path) -> tuple[Path, dict[str, float]]:
    """The picture, and the ripple, r/min rms, without the table ("none") and with it ("table")."""
    from drives.oracle import results
    from drives.oracle_logs import FIRMWARES

    firmware, logs = FIRMWARES[drive], folder / "logs"
    shutil.rmtree(logs, ignore_errors=True)
    logs.mkdir(parents=True)
    names = [str(path.relative_to(folder)) for path in firmware.write(logs)]
    configuration = str(Path("logs", firmware.configuration))
    cogless(folder, "identify", *names, "--drive", drive, "--drive-config", configuration, "-o", "found")
    cogless(folder, "table", "found", "--to", firmware.form, "-o", firmware.table)
    speed = f"{SPEED_RPM} rpm"
    found = results(
        {f"at-{SPEED_RPM}-rpm": {"duration": f"{SECONDS} s", "reference": speed, "initial_speed": speed}},
        {
            "none": {**firmware.law(""), "label": "without the table", "baseline": True},
            "table": {**firmware.law((folder / firmware.table).read_text()), "label": "with the table"},
        },
        firmware.speed_rate,
        title=firmware.title,
        metric=[
            {
                "name": "ripple",
                "kind": "ripple-rms",
                "signal": "omega_m",
                "unit": "rpm",
                "last": f"{SECONDS / 2} s",
            }
        ],
    )
    picture = next(path for path in write_plots(found, folder) if path.stem.endswith("revolution"))
    return picture, {run.controller: run.metrics["ripple_rad_s"] / RPM for run in found.runs}


def cogless(folder: Path, *words: str) -> None:
    """Run a command in this folder. RuntimeError: it failed."""
    done = subprocess.run(
        [sys.executable, "-m", "cogless", *words], cwd=folder, capture_output=True, text=True
    )
    if done.returncode:
        raise RuntimeError(f"cogless {' '.join(words)}: {done.stderr}")


if __name__ == "__main__":
    print(*drawn(sys.argv[1], Path(sys.argv[2])))
