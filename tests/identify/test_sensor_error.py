"""A sensor's error shows as sidebands of the cogging, in logs too slow for an acceleration of its own."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from identify.commissioned import write

from cogless.identify import config, plan
from cogless.identify.balance import Model
from cogless.identify.estimate import Logs, whole
from cogless.identify.log import load_logs

INERTIA, COULOMB, DT = 1e-4, 0.06, 1e-3  # over K_t of 1 N*m/A
COGGING = ((200, 0.03, 0.7), (100, 0.01, -1.2), (4, 0.012, 2.1))  # sin(order theta + phase)
LIMIT = 5e-5  # rad


def log(speed: float, seed: int, error: complex) -> dict[str, np.ndarray]:
    """A rotor whose speed swings, both ways; its angle is read with this error of order 1, rad."""
    t = DT * np.arange(6000)
    way, swing = np.sign(t[-1] / 2 - t), 0.3 * speed * np.sin(2 * math.pi * 0.9 * t)
    omega = way * (speed + swing)
    theta = seed + np.cumsum(omega) * DT
    current = INERTIA * np.gradient(omega, DT) + COULOMB * np.sign(omega)
    current -= sum(size * np.sin(n * theta + phase) for n, size, phase in COGGING)
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(len(t))
    return {"t": t, "theta": theta + (error * np.exp(-1j * theta)).real, "i_q": current + noise}


@pytest.mark.parametrize("size", [5e-4, 2.6e-3, 4e-3])
def test_an_error_of_the_sensor_is_told_by_its_sidebands(tmp_path: Path, size: float) -> None:
    """With 4 mrad order 200 is off by 0.8 rad; with none of the cogging known an error comes out 0.05 rad."""
    tables = {
        "columns": {key: {"name": key} for key in ("t", "theta", "i_q")},
        "motor": {"pole_pairs": 50, "R_s": "1 ohm", "L_d": "1 mH", "L_q": "1 mH", "K_t": "1 N*m/A"},
        "drive": {
            "rates": {"current_loop": "10 kHz", "speed_loop": "1 kHz"},
            "current_loop": {"kind": "ideal", "current_limit": "2 A"},
            "position_sensor": {"kind": "absolute", "bits": 20},
        },
    }
    error = size * np.exp(0.4j)
    logs = {name: log(speed, seed, error) for seed, (name, speed) in enumerate((("a", 1.5), ("b", 2.5)))}
    paths = write(tmp_path, plan.to_toml(tables), logs)
    identification = config.load(tmp_path / "id.toml")
    drive = Logs(identification, load_logs(paths, identification), lambda what, share: None)
    model = Model(cogging=(4, 100, 200), encoder=(1, 2), widths={"a": 2.5e-3, "b": 2.5e-3})
    state = drive.settled(model, 5)
    coefficients = whole(state.model, state.fit)
    told = complex(coefficients["encoder", 1, "c"], coefficients["encoder", 1, "s"])
    assert abs(told - error) < LIMIT
