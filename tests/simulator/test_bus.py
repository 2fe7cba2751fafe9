"""A bus between drive and law: what the law sees and what the drive gets, from the law's equation."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine import merged, run

import studies
from cogless.run.drive_config import engine_config

KP = 0.1
# the rotor swings with its load; a P law without memory, so that each command tells what it was made of
SWINGS: dict[str, Any] = {
    "mechanics": {"inertia": 1e-3},
    "load": {"harmonics": [{"order": 3, "torque": 0.1, "phase": 0.2}]},
    "controller": {"config": {"kp": KP, "ki": 0.0}},
    "drive": {"ideal_current": True},
    "reference": {"kind": "sine", "offset": 10.0, "amplitude": 3.0, "frequency": 0.7311},
}


def bus(
    measured: float = 0.0, command: float = 0.0, jitter: float = 0.0, quantum: float = 0.0
) -> dict[str, float]:
    return {"delay_measured": measured, "delay_command": command, "jitter": jitter, "quantum": quantum}


def over(seconds: float = 0.5, **settings: Any) -> dict[str, np.ndarray]:
    change = {key: settings.pop(key) for key in ("seed", "controller") if key in settings}
    return run(merged(SWINGS, {**change, "drive": {"bus": bus(**settings)}}), seconds)


def test_a_bus_without_delay_changes_no_bit() -> None:
    plain, through = run(SWINGS, 0.3), over(0.3)
    assert all(np.array_equal(plain[name], through[name]) for name in plain)


@pytest.mark.parametrize(
    ("measured", "command", "back", "ahead"),
    [(1e-3, 0.0, 10, 0), (0.0, 1e-3, 0, 10), (2e-3, 3e-4, 20, 3), (2.1e-4, 2.5e-3, 3, 25)],
)
def test_delays_shift_what_the_law_sees_and_what_the_drive_gets(
    measured: float, command: float, back: int, ahead: int
) -> None:
    x = over(measured=measured, command=command)
    steps = np.arange(30, (len(x["time"]) - ahead) // 10) * 10  # ticks of the law
    asked = KP * (x["omega_ref"][steps] - x["omega_m"][steps - back])
    assert x["i_q_ref"][steps + ahead] == pytest.approx(asked, rel=1e-12)
    held = steps[steps + ahead + 9 < len(x["time"])] + ahead
    assert np.array_equal(x["i_q_ref"][held], x["i_q_ref"][held + 9])
    assert np.ptp(asked) > 0.1


def test_a_quantum_rounds_the_command() -> None:
    x = over(quantum=0.25)
    steps = np.arange(0, len(x["time"]), 10)
    asked = KP * (x["omega_ref"][steps] - x["omega_m"][steps])
    assert np.array_equal(x["i_q_ref"][steps], 0.25 * np.round(asked / 0.25))
    assert len(np.unique(x["i_q_ref"])) > 2


def test_jitter_is_between_its_limits_and_of_the_seed() -> None:
    """Each command tells which sample it was made of and when."""
    first, again, other = (over(command=5e-4, jitter=2e-3, seed=seed) for seed in (1, 1, 2))
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["i_q_ref"], other["i_q_ref"])
    sent, back = np.arange(20, 470)[:, None] * 10, np.arange(41)[None, :]
    asked = KP * (first["omega_ref"][sent] - first["omega_m"][sent - back])
    found = []
    for n in np.flatnonzero(np.diff(first["i_q_ref"])) + 1:
        step, age = np.nonzero(np.abs(asked - first["i_q_ref"][n]) < 1e-12)
        if len(step) == 1:
            found.append((step[0], n - sent[step[0], 0], age[0]))
    steps, late, age = np.array(found).T
    assert len(steps) > 350
    assert np.all(np.diff(steps) > 0)  # nothing overtakes
    assert (late.min(), late.max()) == (6, 25)
    assert (age.min(), age.max()) == (1, 20)
    assert age.mean() == pytest.approx(10.5, abs=1.0)


def test_noise_of_the_sensors_is_the_same_beside_a_bus() -> None:
    noise = {"current_sensors": {"noise": 0.1}, "bus": bus(jitter=1e-3)}
    heavy = {"mechanics": {"inertia": 1e6}, "controller": {"config": {"kp": 0.0, "ki": 0.0}}}
    without = {key: value for key, value in noise.items() if key != "bus"}
    one, other = (run({**heavy, "drive": drive}, 0.1) for drive in (noise, without))
    assert np.array_equal(one["i_q"], other["i_q"])
    assert np.ptp(one["i_q"]) > 0


def test_a_studys_bus_reaches_the_engine(tmp_path: Path) -> None:
    said = {"delay_measured": "1 ms", "delay_command": "2 ms", "jitter": "0.1 ms", "quantum": "3 mA"}
    config = engine_config(studies.study(tmp_path, {"drive.bus": said}), "low", "pi")
    assert config["drive"]["bus"] == pytest.approx(bus(1e-3, 2e-3, 1e-4, 3e-3))
