"""The rig that tries the guard on random drives in C: it runs, and its drives show what the guard is for."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HARMFUL, GROWN = 1.25, 100.0  # times the ripple of the feedback alone


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    program = tmp_path_factory.mktemp("rig") / "guard_drives"
    sources = sorted((ROOT / "control/src/cogless").glob("*.c"))
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-I", ROOT / "control/src"]
    subprocess.run(
        [compiler, *flags, ROOT / "benchmarks/guard_drives.c", *sources, "-lm", "-o", program], check=True
    )
    return program


def drive(rig, number):
    out = subprocess.run([rig, "4711", "400", str(number), str(number)], check=True, capture_output=True)
    found = re.search(r"end +([\d.]+).* free ([\d.]+)", out.stdout.decode())
    assert found is not None
    return [float(x) for x in found.groups()]


def test_a_law_that_grows_a_hundredfold_ends_as_its_feedback(rig):
    end, unguarded = drive(rig, 39)
    assert unguarded > GROWN and end < HARMFUL


def test_a_law_that_helps_helps_with_the_guard_too(rig):
    end, unguarded = drive(rig, 29)
    assert unguarded < 0.1 and end < 0.1
