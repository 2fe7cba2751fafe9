"""An identification that is killed leaves the files of one run."""

import os
import random
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from commands import forked
from damage import DRIVE

ID = '[columns]\nt = "t"\ntheta = "theta"\ni_q = "i_q"\n' + DRIVE
SIGNALS = ("SIGKILL", "SIGTERM", "SIGINT")


def write_log(path: Path) -> None:
    """A rotor of 2e-4 kg m^2 that turns at 3 revolutions a second, in both directions in turns."""
    t = np.arange(12_000) / 1000
    omega = 6 * np.pi * np.clip(3 * np.sin(np.pi * t), -1, 1)
    theta = np.cumsum(omega) / 1000
    torque = 2e-4 * np.gradient(omega, t) + 5e-3 * np.tanh(omega) + 2e-3 * np.sin(8 * theta)
    noise = 1e-3 * np.random.default_rng(0).normal(size=len(t))
    np.savez(path, t=t, theta=theta, i_q=torque / 0.3 + noise)


@pytest.mark.skipif(os.name != "posix", reason="sends signals")
@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_killed_at_random_moments_the_files_are_those_of_one_run(tmp_path: Path, command: str) -> None:
    """COGLESS_KILLS: how many times. All files are written by one run, and nothing else stays."""
    write_log(tmp_path / "a.npz")
    (tmp_path / "id.toml").write_text(ID)
    out, chance = tmp_path / "out", random.Random(13)
    words = (command, tmp_path / "a.npz", "--config", tmp_path / "id.toml", "-o", out)
    begun = time.monotonic()
    assert forked(tmp_path, *words).end() == 0
    whole, names = time.monotonic() - begun, sorted(path.name for path in out.iterdir())
    starts = [0]
    for _ in range(int(os.environ.get("COGLESS_KILLS", "3"))):
        starts.append(time.time_ns())
        run = forked(tmp_path, *words)
        time.sleep(whole * chance.uniform(0.3, 1.1))
        run.send(signal.Signals[chance.choice(SIGNALS)])
        assert run.end() in (0, -signal.SIGKILL, -signal.SIGTERM, 130)
        files = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
        runs = {sum(start <= at for start in starts) for name, at in files.items() if name in names}
        assert set(names) <= files.keys() and len(runs) == 1
    assert forked(tmp_path, *words).end() == 0
    assert sorted(path.name for path in out.iterdir()) == names
