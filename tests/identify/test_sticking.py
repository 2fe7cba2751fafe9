"""A rotor that sticks: the friction of a rotor that stands has a value of its own.

The plant is not the engine: Coulomb friction that holds the rotor exactly, viscous friction, two waves of
cogging, and a PI speed loop at 1 kHz on a filtered difference of counts. Units are SI.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from identify.commissioned import write

from cogless.identify import command, config, plan
from cogless.identify.estimate import estimate_motor
from cogless.identify.log import load_logs
from cogless.identify.result import Estimate

TURN = 2 * math.pi
K_T, INERTIA, COULOMB, VISCOUS = 0.04, 3e-5, 4e-3, 3e-5
COGGING = ((15, 6e-3, 0.7), (49, 3e-3, -1.2))  # sin(order theta + phase)
COUNTS, PERIOD, SUBSTEPS = 1 << 14, 1e-3, 10
KP, KI, FILTERED = 0.04, 0.5, 0.7  # A s/rad, A/rad; of a speed that stays from a row to the next
SWEEP = [(0, 0), (0.4, 40), (1.3, -40), (2.2, 40), (3.1, -40), (4.0, 40), (4.4, 0)]


def both_ways(v: float) -> list[tuple[float, float]]:
    return [(0, 0), (0.2, v), (4.6, v), (5.0, -v), (9.4, -v), (9.6, 0)]


def log(points: list[tuple[float, float]], seed: int, start: float) -> dict[str, np.ndarray]:
    """Rows of the law of a rotor that these speeds, rad/s at s, are asked of."""
    t = PERIOD * np.arange(round(points[-1][0] / PERIOD))
    theta, omega, integral, speed, before = start, 0.0, 0.0, 0.0, None
    h, rows = PERIOD / SUBSTEPS, np.empty((len(t), 2))
    for row, reference in enumerate(np.interp(t, *np.array(points).T)):
        seen = math.floor(theta / TURN * COUNTS) * TURN / COUNTS
        speed = FILTERED * speed + (1 - FILTERED) * (seen - (seen if before is None else before)) / PERIOD
        before = seen
        integral += KI * PERIOD * (reference - speed)
        current = KP * (reference - speed) + integral
        for _ in range(SUBSTEPS):
            torque = K_T * current + sum(size * math.sin(n * theta + phase) for n, size, phase in COGGING)
            torque -= VISCOUS * omega
            if omega == 0 and abs(torque) <= COULOMB:
                continue
            way = math.copysign(1, omega or torque)
            after = omega + h / INERTIA * (torque - way * COULOMB)
            omega = after if after * way > 0 else 0.0
            theta += h * omega
        rows[row] = seen, current
    noise = 2e-3 * np.random.default_rng(seed).standard_normal(len(t))
    return {"t": t, "theta": rows[:, 0], "i_q": rows[:, 1] + noise}


def identified(folder: Path) -> Estimate:
    tables: dict[str, Any] = {
        "columns": {
            "t": {"name": "t"},
            "theta": {"name": "theta", "unit": "rad"},
            "i_q": {"name": "i_q", "unit": "A"},
        },
        "motor": {"pole_pairs": 7, "R_s": "1 ohm", "L_d": "1 mH", "L_q": "1 mH", "K_t": f"{K_T} N*m/A"},
        "drive": {
            "rates": {"current_loop": "1 kHz", "speed_loop": "1 kHz"},
            "current_loop": {"kind": "ideal", "current_limit": "4 A"},
            "position_sensor": {"kind": "absolute", "bits": 14},
        },
    }
    logs = {"slow": both_ways(0.3 * TURN), "fast": both_ways(2.1 * TURN), "sweep": SWEEP}
    written = {name: log(points, seed, 0.3 + seed) for seed, (name, points) in enumerate(logs.items())}
    still = np.diff(written["slow"]["theta"]) == 0
    assert np.mean(still) > 0.3
    paths = write(folder, plan.to_toml(tables), written)
    identification = config.load(folder / "id.toml")
    return command.standing_out(
        estimate_motor(identification, load_logs(paths, identification), lambda what, share: None)
    )


def test_a_rotor_that_stands_in_a_third_of_a_log_tells_its_friction_where_it_slips(tmp_path: Path) -> None:
    """With one friction for all rows the error of the Coulomb friction is .33 %, and that of b 2.5 %."""
    made = identified(tmp_path)
    for key, truth, share in (("j", INERTIA, 5e-3), ("c", COULOMB, 3e-3), ("b", VISCOUS, 0.022)):
        value = made.values[key]
        assert max(abs(value.value * K_T / truth - 1), value.error * K_T / truth) < share, (key, value)
    assert [wave.order for wave in made.cogging] == [n for n, _, _ in COGGING]
    for wave, (_, size, _) in zip(made.cogging, COGGING, strict=True):
        assert max(abs(wave.size.value * K_T / size - 1), wave.size.error * K_T / size) < 0.04, wave
