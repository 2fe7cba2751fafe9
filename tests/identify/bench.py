"""A drive in a few lines of NumPy, apart from the project's engine. Its faults and their shares are known.

Many drives run at the same time, one in each column. The motor has ten poles and nine slots. Its current loop
is a PI on the measured current. The speed loop runs at 1 kHz; its speed is a difference of counts. Units are
SI.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

TURN = 2 * math.pi
POLES, SLOTS, COUNTS = 5, 9, 16_384  # pole pairs, slots, counts of a turn
K_T, R_S, L_S = 0.05, 1.0, 1e-3  # N m/A, ohm, H
INERTIA, COULOMB, VISCOUS = 2e-5, 2e-3, 2e-5  # kg m^2, N m, N m s/rad
PSI_F = K_T / (1.5 * POLES)  # Wb
BUS, CURRENT_LIMIT = 24.0, 4.0  # V, A
STEP, EVERY = 2e-4, 5  # s, integration step; number of them in a step of the speed loop and in a row
CURRENT_BANDWIDTH, SPEED_BANDWIDTH = TURN * 150, TURN * 20  # rad/s
SWITCHED = 0.05  # A, half of the current's ripple: within it a leg loses voltage in proportion
THIRDS = TURN / 3 * np.arange(3)[:, None]


@dataclass(frozen=True)
class Drive:
    """The faults of a drive. Waves are (order, size, phase): size sin(order theta + phase)."""

    cogging: tuple[tuple[int, float, float], ...] = ()  # N m
    flux: tuple[tuple[int, float, float], ...] = ()  # share of K_t
    encoder: tuple[tuple[int, float, float], ...] = ()  # rad
    offsets: tuple[float, float, float] = (0.0, 0.0, 0.0)  # A, of the phases
    gains: tuple[float, float, float] = (0.0, 0.0, 0.0)  # relative gain errors of the phases
    dead_voltage: float = 0.0  # V, loss of a bridge leg, against its current
    counts: int = COUNTS
    noise: float = 2e-3  # A, of i_q
    friction: float = COULOMB  # N m


@dataclass(frozen=True)
class Run:
    """Speeds over time, rad/s by s, and a load, N m against the rotation."""

    points: tuple[tuple[float, float], ...]
    load: float = 0.0
    driven: bool = True  # False: the current makes no torque, so the rotor coasts

    @property
    def duration(self) -> float:
        return self.points[-1][0]


def both_ways(turns_per_second: float, time: float) -> Run:
    speed = TURN * turns_per_second
    return Run(((0, speed), (time, speed), (time + 0.4, -speed), (2 * time + 0.4, -speed)))


def steady(turns_per_second: float, time: float, load: float = 0.0) -> Run:
    return Run(((0, TURN * turns_per_second), (time, TURN * turns_per_second)), load)


RUNS = {
    "slow": both_ways(0.5, 4.2),
    "fast": steady(4.0, 3.0),
    "both": both_ways(4.0, 2.0),
    "odd": steady(1.27, 4.0),
    "drives": steady(1.0, 4.0, 0.05),
    "brakes": steady(1.0, 4.0, -0.05),
    "sweep": Run(((0, 3), (0.4, 40), (1.2, -40), (2, 40), (2.8, -40), (3.6, 40), (4.4, -40), (4.8, 3))),
}


def waves(terms: Sequence[Sequence[tuple[int, float, float]]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Orders, sizes and phases as arrays with a column for each drive."""
    most = max((len(each) for each in terms), default=0)
    padded = [[*each, *[(0, 0.0, 0.0)] * (most - len(each))] for each in terms]
    made = np.array(padded, dtype=float).reshape(len(terms), most, 3)
    return made[:, :, 0].T, made[:, :, 1].T, made[:, :, 2].T


def simulated(pairs: Sequence[tuple[Drive, Run]]) -> list[dict[str, np.ndarray]]:
    """The log of each drive in its run, with a row for each step of the speed loop."""
    drives, runs = [drive for drive, _ in pairs], [run for _, run in pairs]
    cogging, flux, encoder = (
        waves([getattr(d, name) for d in drives]) for name in ("cogging", "flux", "encoder")
    )
    offsets, gains = (np.array([getattr(d, name) for d in drives]).T for name in ("offsets", "gains"))
    dead = np.array([d.dead_voltage for d in drives])
    load = np.array([run.load for run in runs])
    step_angle = TURN / np.array([d.counts for d in drives])
    noise = np.array([d.noise for d in drives])
    friction = np.array([d.friction for d in drives])
    driven = np.array([run.driven for run in runs], dtype=float)
    random = np.random.default_rng(1)
    kp, ki = CURRENT_BANDWIDTH * L_S, CURRENT_BANDWIDTH * R_S
    speed_kp = SPEED_BANDWIDTH * INERTIA / K_T
    speed_ki = speed_kp * SPEED_BANDWIDTH / 4

    def sines(of: tuple[np.ndarray, ...], theta: np.ndarray) -> np.ndarray:
        return np.sum(of[1] * np.sin(of[0] * theta + of[2]), axis=0)

    def phases(theta: np.ndarray) -> np.ndarray:
        return np.sin(POLES * theta - THIRDS)

    def measured_current(i: np.ndarray, theta: np.ndarray) -> np.ndarray:
        park = phases(theta)
        return 2 / 3 * np.sum(((1 + gains) * i * park - offsets) * park, axis=0)

    def slope(state: np.ndarray, i_ref: np.ndarray) -> np.ndarray:
        theta, omega, i, z = state
        park = phases(theta)
        lost = -2 / 3 * dead * np.sum(np.clip(-i * park / SWITCHED, -1, 1) * park, axis=0)
        error = i_ref - 2 / 3 * np.sum(((1 + gains) * i * park - offsets) * park, axis=0)
        magnet = 1 + sines(flux, theta)
        torque = (
            K_T * magnet * i * driven
            + sines(cogging, theta)
            - load
            - VISCOUS * omega
            - friction * np.tanh(omega / 0.02)
        )
        voltage = kp * error + z
        return np.array(
            [
                omega,
                torque / INERTIA,
                (voltage - R_S * i - lost - K_T / 1.5 * magnet * omega) / L_S,
                ki * error,
            ]
        )

    times = [np.array([t for t, _ in run.points], dtype=float) for run in runs]
    speeds = [np.array([v for _, v in run.points], dtype=float) for run in runs]
    rows = round(max(run.duration for run in runs) / (STEP * EVERY))
    t = STEP * EVERY * np.arange(rows)
    reference = np.array([np.interp(t, x, y) for x, y in zip(times, speeds, strict=True)]).T
    state = np.zeros((4, len(pairs)))
    state[1] = reference[0]
    state[0] = 0.3
    state[2] = (friction * np.sign(state[1]) + VISCOUS * state[1] + load) / K_T
    state[3] = R_S * state[2] + K_T / 1.5 * state[1]
    integral = state[2].copy()

    def angle() -> np.ndarray:
        return np.floor((state[0] + sines(encoder, state[0])) / step_angle) * step_angle

    before = angle() - STEP * EVERY * state[1]
    log = np.zeros((rows, 6, len(pairs)))
    for row in range(rows):
        theta = angle()
        omega = (theta - before) / (STEP * EVERY)
        before = theta
        error = reference[row] - omega
        integral = integral + STEP * EVERY * speed_ki * error
        i_ref = np.clip(speed_kp * error + integral, -CURRENT_LIMIT, CURRENT_LIMIT)
        i_seen = measured_current(state[2], state[0]) + noise * random.standard_normal(len(pairs))
        u = kp * (i_ref - i_seen) + state[3]
        log[row] = theta, omega, i_seen, i_ref, u, state[1]
        for _ in range(EVERY):
            a = slope(state, i_ref)
            b = slope(state + 0.5 * STEP * a, i_ref)
            c = slope(state + 0.5 * STEP * b, i_ref)
            d = slope(state + STEP * c, i_ref)
            state = state + STEP / 6 * (a + 2 * b + 2 * c + d)
    names = ("theta", "omega", "i_q", "i_q_ref", "u_q", "true_omega")
    return [
        {"t": t[:count].copy(), **{name: log[:count, n, k].copy() for n, name in enumerate(names)}}
        for k, run in enumerate(runs)
        for count in [round(run.duration / (STEP * EVERY))]
    ]


CASES: Mapping[str, Drive] = {
    "cogging": Drive(cogging=((30, 2e-3, 0.5), (18, 0.8e-3, 1.0))),
    "neighbours": Drive(cogging=((9, 1.5e-3, 0.5), (10, 1.5e-3, -1.0))),
    "encoder": Drive(encoder=((1, math.radians(0.6), 0.4), (2, math.radians(0.3), 2.0))),
    "encoder 2p": Drive(encoder=((10, math.radians(0.15), 0.4),)),
    "offset": Drive(offsets=(0.06, -0.04, 0.0)),
    "gain": Drive(gains=(0.04, -0.04, 0.0)),
    "dead time": Drive(dead_voltage=0.5, counts=1 << 18),
    "beyond": Drive(cogging=((90, 1.5e-3, 0.3),)),
}


@cache
def logs() -> dict[str, dict[str, dict[str, np.ndarray]]]:
    """The logs of all cases, by case and run."""
    pairs = [(drive, run) for drive in CASES.values() for run in RUNS.values()]
    made = iter(simulated(pairs))
    return {case: {name: next(made) for name in RUNS} for case in CASES}


def columns(counts: int = COUNTS) -> dict[str, Any]:
    """Tables of the file of columns: what a user of these drives knows."""
    return {
        "columns": {
            name: name for name in ("t", "theta", "omega", "i_q", "i_q_ref", "u_q", "i_a", "i_b", "i_c")
        },
        "motor": {
            "pole_pairs": POLES,
            "slots": SLOTS,
            "R_s": f"{R_S} ohm",
            "L_d": f"{L_S} H",
            "L_q": f"{L_S} H",
            "K_t": f"{K_T} N*m/A",
        },
        "drive": {
            "rates": {"current_loop": "10 kHz", "speed_loop": "1 kHz"},
            "current_loop": {"bandwidth": "150 Hz", "current_limit": f"{CURRENT_LIMIT} A"},
            "inverter": {"bus_voltage": f"{BUS} V"},
            "position_sensor": {"kind": "encoder", "lines": counts // 4, "speed_method": "M"},
        },
        "log": [{"file": f"{name}*", "kind": "load"} for name in ("drives", "brakes")]
        + [{"file": "off*", "kind": "bridge-off"}],
    }


def phase_offsets(case: str) -> dict[str, np.ndarray]:
    """A log of a case's rotor at rest with the bridge off."""
    t = STEP * EVERY * np.arange(400)
    offsets = zip(("i_a", "i_b", "i_c"), CASES[case].offsets, strict=True)
    return {"t": t, "theta": 1e-3 * t, **{name: np.full(len(t), x) for name, x in offsets}}
