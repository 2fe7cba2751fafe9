"""Logs of each kind add what they should: coast-down, torque sensor, table on, a clock that is off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from identify.commissioned import MOTORS, commissioned
from identify.test_traps import INERTIA, changed, shortened, told

K_T, COULOMB, VISCOUS = 0.3, 30e-3, 1e-3  # of the servo
COUNT = 2 * np.pi / 10_000  # rad


def with_kind(text: str, file: str, kind: str) -> str:
    """The file of columns with a rule for a file, before the others."""
    return text.replace("[[log]]", f'[[log]]\nfile = "{file}.npz"\nkind = "{kind}"\n\n[[log]]', 1)


def coasting(speed: float) -> dict[str, np.ndarray]:
    """The servo without current from a speed, rad/s, down to a fifth of it; its angle in counts."""
    rate, drag = VISCOUS / INERTIA, COULOMB / VISCOUS
    end = np.log((abs(speed) + drag) / (0.2 * abs(speed) + drag)) / rate
    t = np.arange(0, end, 1e-3)
    turned = (abs(speed) + drag) * (1 - np.exp(-rate * t)) / rate - drag * t
    return {"t": t, "theta": np.floor(np.sign(speed) * turned / COUNT) * COUNT}


def test_a_coast_down_tells_friction_without_a_current(tmp_path):
    text, logs = shortened()
    fewer = {"acceleration": logs["acceleration"], "down": coasting(60.0), "up": coasting(-60.0)}
    text = with_kind(with_kind(text, "down", "coast-down"), "up", "coast-down")
    made = told(tmp_path, text, fewer)
    assert made.values["j"].times(K_T).value == pytest.approx(INERTIA, rel=0.02)
    assert made.values["c"].times(K_T).value == pytest.approx(COULOMB, rel=0.03)
    assert made.values["b"].times(K_T).value == pytest.approx(VISCOUS, rel=0.05)


def test_a_torque_sensor_takes_the_load_out(tmp_path):
    text, logs = shortened()
    load = 2.0 * K_T  # N m, of the planned log
    loaded = commissioned("servo", late=1)[1]["load-forwards"]
    part = {key: x[1000:5000] for key, x in loaded.items()}
    text = text.replace("[columns]", '[columns]\ntorque = "torque"')
    made = told(tmp_path, text, {**logs, "load-forwards": {**part, "torque": np.full(4000, load)}})
    assert made.loads == {}
    assert made.values["c"].times(K_T).value == pytest.approx(COULOMB, rel=0.02)


def test_a_log_with_the_table_on_tells_the_same_cogging(tmp_path):
    text, logs = shortened()
    made = told(tmp_path, with_kind(text, "one-speed", "table-on"), logs)
    (strongest,) = [wave for wave in made.cogging if wave.order == 24]
    assert strongest.size.value * K_T == pytest.approx(20e-3, rel=0.03)


def test_a_bridge_that_is_off_lets_the_order_of_the_pole_pairs_be_told(tmp_path):
    text, logs = shortened()
    theta = logs["one-speed"]["theta"]
    offsets = (0.03, -0.02, 0.0)
    wave = -2 / 3 * sum(o * np.sin(4 * theta - k * 2 * np.pi / 3) for k, o in enumerate(offsets))
    wrong = changed(logs, "one-speed", i_q=logs["one-speed"]["i_q"] + wave)
    off = {"t": logs["one-speed"]["t"], "theta": theta}
    off |= {name: np.full(len(theta), o) for name, o in zip(("i_a", "i_b", "i_c"), offsets, strict=True)}
    text = with_kind(text, "off", "bridge-off")
    text = text.replace("[columns]", '[columns]\ni_a = "i_a"\ni_b = "i_b"\ni_c = "i_c"')
    for name in ("fast", "acceleration"):
        turned = 4 * logs[name]["theta"]
        wave = -2 / 3 * sum(o * np.sin(turned - k * 2 * np.pi / 3) for k, o in enumerate(offsets))
        wrong = changed(wrong, name, i_q=logs[name]["i_q"] + wave)
    made = told(tmp_path, text, {**wrong, "off": off})
    assert any("With the bridge off the phase currents show 30, -20, 0 mA" in line for line in made.remarks)
    assert 4 not in {wave.order for wave in made.cogging}
    assert made.values["b"].times(K_T).value == pytest.approx(VISCOUS, rel=0.05)  # though a hand turned it
    assert not any("Sessions differ" in line for line in made.remarks)


def test_a_clock_that_is_off_shows_as_a_delay(tmp_path):
    text, logs = shortened()
    late = {
        name: {key: np.interp(log["t"] - 3e-4, log["t"], x) if key[0] == "i" else x for key, x in log.items()}
        for name, log in logs.items()
    }
    (here, there) = (tmp_path / "a", tmp_path / "b")
    here.mkdir(), there.mkdir()
    before, after = told(here, text, logs), told(there, text, late)
    moved = after.values["delay"].value - before.values["delay"].value
    assert moved == pytest.approx(3e-4, abs=5e-5)


def test_two_speeds_without_a_load_need_the_acceleration_log_that_is_advised(tmp_path):
    """What is told of two speeds, each in one direction, holds the truth; the advised log tells the rest."""
    text, logs = commissioned("servo", late=1)
    assert 6 * MOTORS["servo"]["motor"]["pole_pairs"] == 24
    steady = {"slow": slice(500, 7500), "one-speed": slice(500, 3500)}
    unloaded = {name: {key: x[rows] for key, x in logs[name].items()} for name, rows in steady.items()}
    made = told(Path(tmp_path), text, unloaded)
    assert made.ripple == () and "j" not in made.values
    for key, truth in (("b", VISCOUS), ("c", COULOMB)):
        value = made.values.get(key)
        assert value is None or abs(value.value * K_T - truth) < value.error * K_T, key
    assert any("add an acceleration log" in line for line in made.left_out)
    whole = told(Path(tmp_path), text, {**unloaded, "acceleration": logs["acceleration"]})
    inertia = whole.values["j"].times(K_T)
    assert abs(inertia.value - INERTIA) < max(inertia.error, 0.01 * INERTIA)
    (strongest,) = [wave for wave in whole.cogging if wave.order == 24]
    assert abs(strongest.size.value * K_T - 20e-3) < max(strongest.size.error * K_T, 0.03 * 20e-3)
