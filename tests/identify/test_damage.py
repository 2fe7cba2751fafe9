"""Damaged logs of every kind end in a result or a line; `damage.py` makes and reads them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("damage.py")


@pytest.mark.skipif(sys.platform != "linux", reason="memory of a process is bounded as Linux does")
def test_damaged_logs_end_in_a_result_or_in_one_line() -> None:
    """COGLESS_DAMAGED_LOGS: how many, with a fresh seed; else 60, always the same."""
    count = os.environ.get("COGLESS_DAMAGED_LOGS")
    seed = int.from_bytes(os.urandom(4)) if count else 1
    scale = "1" if count else "16"
    command = [sys.executable, SCRIPT, "--cases", count or "60", "--seed", str(seed), "--scale", scale]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, ""), f"seed {seed}:\n{ended.stdout}{ended.stderr}"
