"""Ten hours of every law that learns: no mean drifts between memory and integral.

The drive is a few lines of C apart from the simulator. tests/control/ten_hours.c says what happens to it.
"""

import subprocess
from pathlib import Path

import pytest
from control_library import SOURCE
from kept import kept, version

from cogless.control_library import C_LAWS

PROGRAM = Path(__file__).with_name("ten_hours.c")
FLAGS = ["-std=c99", "-O2", "-D_DEFAULT_SOURCE", "-ffp-contract=off", f"-I{SOURCE}"]
OWNED = [  # the mean is an integral's
    "pi-ilc",
    "pi-ilc by time",
    "pi-ilc with a lead",
    "robust-ilc",
    "space-position",
    "space-position by rotor",
    "pi-afc",
    "harmonic",
    "anti-cogging",
]
IN_THE_MAP = ["robust-ilc alone", "space-speed", "space-position handed over by rotor"]  # there is no other


@pytest.fixture(scope="module")
def program() -> Path:
    sources = sorted((SOURCE / "cogless").glob("*.c"))

    def compiled(made: Path) -> None:
        subprocess.run(["cc", *FLAGS, "-o", made, PROGRAM, *sources, "-lm"], check=True)

    files = [PROGRAM, *sorted((SOURCE / "cogless").iterdir())]
    return kept("ten-hours.run", [version("cc"), *FLAGS], files, compiled)


def seen(program: Path, law: str) -> dict[str, float]:
    done = subprocess.run([program, law], capture_output=True, text=True, check=True)
    return {name: float(value) for name, value in map(str.split, done.stdout.splitlines())}


def test_every_law_with_a_memory_is_here() -> None:
    learning = {law.name for law in C_LAWS.values() if law.length is not None}
    assert learning == {law.split(" ")[0] for law in (*OWNED, *IN_THE_MAP, "trial")}


@pytest.mark.parametrize("law", OWNED + IN_THE_MAP)
def test_ten_hours_leave_the_drive_as_it_was_in_its_first_minute(law: str, program: Path) -> None:
    """After ten hours a dropout or a muting guard throws the rotor no further than in the first minute.

    In torque mode a law gives a current only if its map has the mean, without an integral. That current is
    the load's at the speed at which it was learned, and not larger at other speeds.
    """
    drive = seen(program, law)
    load = drive["load_current"]
    assert 0.024 < load < 0.026  # 0.01 N m by 0.4 N m/A
    for name in ("ripple", "muted", "dropout"):
        assert drive[f"late_{name}"] < 1.05 * drive[f"early_{name}"], name
    if law in OWNED:
        assert abs(drive["torque_current"]) < 0.03 * load
    else:
        assert drive["torque_current"] == pytest.approx(load, rel=0.03)
    if law != "pi-ilc by time":  # at another speed than its reference's a line repeats its last value
        slow = (-0.03, 0.03) if law in OWNED else (0.5, 1.03)
        assert slow[0] * load < drive["slow_torque_current"] < slow[1] * load


def test_trials_have_one_memory_of_their_mean(program: Path) -> None:
    """The integral begins each trial at 0."""
    trials = seen(program, "trial")
    assert max(trials["early_error"], trials["late_error"]) < 0.002  # two steps of its sensor
    assert trials["late_mean"] == pytest.approx(trials["early_mean"], abs=0.01)
