"""Motors drawn at random, and their logs, simulated by a plant that uses nothing of cogless.

The rotor's balance is integrated at 10 kHz by the midpoint rule, for all logs of all motors at once. The
drive's law computes the current's reference at 1 kHz, from the counts of an encoder with an error. The
current follows its reference by a first-order lag. The logged current has offsets, noise and the steps of
12 bits, and is logged later than the angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Wave = tuple[int, float, float]  # order, size, phase: size sin(order theta + phase)
TURN = 2 * math.pi
STEP = 1e-4  # s
LAW = 10  # steps in a sample of the law
LATEST = 20  # most steps by which currents are logged late
LAG = 3e-4  # s, time constant of the current loop
SPEED_FILTER = 2e-3  # s, time constant of the law's speed filter
SPEED_BANDWIDTH = TURN * 8  # rad/s
SECONDS = 8.0  # s, length of a log
BITS = 12  # bits of the current's converter, whose range is plus or minus twice the limit
RAMP_CURRENT = 0.15  # share of the current limit that accelerates
STILL = 0.02  # rad/s; at smaller speeds friction is proportional to the speed
KINDS: dict[str, dict[str, Any]] = {
    "gimbal": {"poles": 11, "K_t": 0.08, "J": 8e-5, "friction": 4e-3, "limit": 3.0, "counts": 16_384,
               "orders": (24, 66, 22), "speeds": (0.4, 3.0)},
    "servo": {"poles": 4, "K_t": 0.3, "J": 5e-4, "friction": 3e-2, "limit": 10.0, "counts": 10_000,
              "orders": (24, 12, 48), "speeds": (0.5, 8.0)},
    "drone": {"poles": 7, "K_t": 0.0276, "J": 6e-6, "friction": 1.4e-3, "limit": 4.0, "counts": 4_096,
              "orders": (84, 12, 42), "speeds": (1.0, 12.0)},
    "hub": {"poles": 15, "K_t": 0.5, "J": 6e-3, "friction": 0.1, "limit": 20.0, "counts": 8_192,
            "orders": (30, 27, 90), "speeds": (0.3, 2.5)},
    "stepper": {"poles": 50, "K_t": 0.3, "J": 4e-5, "friction": 1.2e-2, "limit": 2.0, "counts": 65_536,
                "orders": (200, 100, 4), "speeds": (0.3, 2.0), "sizes": (0.5, 0.3, 0.3)},
    "spindle": {"poles": 3, "K_t": 0.2, "J": 3e-4, "friction": 2e-2, "limit": 8.0, "counts": 20_000,
                "orders": (36, 6, 18), "speeds": (1.0, 12.0)},
    "wheel": {"poles": 8, "K_t": 0.025, "J": 1e-5, "friction": 1.5e-3, "limit": 3.0, "counts": 8_192,
              "orders": (48, 16, 9), "speeds": (0.5, 5.0), "stribeck": 0.3},
    "gear": {"poles": 5, "K_t": 0.12, "J": 1e-4, "friction": 1e-2, "limit": 5.0, "counts": 2**18,
             "orders": (60, 12, 10), "speeds": (0.4, 4.0), "angle_friction": 0.25},
}  # fmt: skip
SIZES = (1.3, 0.6, 0.3)  # cogging torques over the friction


@dataclass(frozen=True)
class Motor:
    """A motor and its drive, SI.

    `flux`: ripple of K_t, relative. `offset`: error of i_q, whose order is the pole pairs, A. `table`:
    current that the law adds, A.
    """

    kind: str
    poles: int
    K_t: float
    inertia: float
    coulomb: float
    viscous: float
    stribeck: float  # N*m, extra friction at rest
    stribeck_speed: float  # rad/s
    friction_waves: tuple[Wave, ...]  # shares of the friction
    cogging: tuple[Wave, ...]
    flux: tuple[Wave, ...]
    encoder: tuple[Wave, ...]  # rad
    offset: Wave
    late: int  # steps
    counts: int
    limit: float
    noise: float  # A rms
    speeds: tuple[float, float]  # slow and fast, rev/s
    table: tuple[Wave, ...] = ()

    @property
    def delay(self) -> float:
        """Time by which i_q is logged late, s."""
        return self.late * STEP


@dataclass(frozen=True)
class Run:
    """A log's reference, (s, rad/s), and its load, N*m."""

    name: str
    points: tuple[tuple[float, float], ...]
    load: float = 0.0


def drawn(kind: str, random: np.random.Generator, cogging: bool = True) -> Motor:
    """A random motor of a kind. `cogging` False: without cogging, and without ripple of K_t."""
    table = KINDS[kind]

    def about(value: float, spread: float) -> float:
        return value * math.exp(random.uniform(-spread, spread))

    def angle() -> float:
        return random.uniform(-math.pi, math.pi)

    poles, friction = table["poles"], about(table["friction"], 0.5)
    slow, fast = table["speeds"]
    torque = about(table["K_t"], 0.2)
    waves = tuple(
        (order, friction * size * random.uniform(0.6, 1.4), angle())
        for order, size in zip(table["orders"], table.get("sizes", SIZES), strict=True)
    )
    flux = ((6 * poles, random.uniform(0.01, 0.04), angle()),)
    stribeck, waved = table.get("stribeck", 0.0), table.get("angle_friction", 0.0)
    return Motor(
        kind=kind,
        poles=poles,
        K_t=torque,
        inertia=about(table["J"], 0.5),
        coulomb=friction,
        viscous=friction * random.uniform(0.2, 0.6) / (TURN * fast),
        stribeck=friction * stribeck,
        stribeck_speed=1.5 * TURN * slow,
        friction_waves=((1, waved, angle()), (2, waved / 2, angle())) if waved else (),
        cogging=waves if cogging else (),
        flux=flux if cogging else (),
        encoder=((1, math.radians(random.uniform(0.05, 0.3)), angle()),),
        offset=(poles, 4e-3 * table["limit"] * random.uniform(0.2, 1.0), angle()),
        late=int(random.integers(0, LATEST)),
        counts=table["counts"],
        limit=table["limit"],
        noise=1e-3 * table["limit"],
        speeds=(slow * random.uniform(0.8, 1.25), fast * random.uniform(0.8, 1.25)),
    )


def runs(motor: Motor) -> tuple[Run, ...]:
    """The logs that a user is asked for: slow both ways, ramps, fast each way, loads of both signs."""
    slow, fast = (TURN * speed for speed in motor.speeds)
    half = SECONDS / 2
    ramp = max(0.15, motor.inertia * fast / (RAMP_CURRENT * motor.limit * motor.K_t))
    ramps, at, sign = [(0.0, 0.0)], 0.0, 1.0
    while at < SECONDS:
        at += ramp * (1 if at == 0 else 2)
        ramps.append((at, sign * fast))
        sign = -sign
    load = 0.25 * motor.limit * motor.K_t
    return (
        Run("slow", ((0.0, slow), (half, slow), (half + 0.3, -slow))),
        Run("accel", tuple(ramps)),
        Run("fast", ((0.0, fast), (half, fast), (half + 0.3, -fast))),
        Run("middle", ((0.0, 2.5 * slow), (half, 2.5 * slow), (half + 0.3, -2.5 * slow))),
        Run("drives", ((0.0, 1.5 * slow),), load),
        Run("brakes", ((0.0, 1.5 * slow),), -load),
    )


Raw = dict[str, dict[str, Array]]  # by log and signal, a row for each step


def simulated(motors: Sequence[Motor], seed: int = 0, chosen: Sequence[str] = ()) -> list[Raw]:
    """The logs of each motor; `chosen`: names of runs, or all."""
    pairs = [(m, run) for m in motors for run in runs(m) if not chosen or run.name in chosen]
    lanes = _integrated(pairs, np.random.default_rng(seed))
    made: list[Raw] = [{} for _ in motors]
    for k, (motor, run) in enumerate(pairs):
        made[motors.index(motor)][run.name] = {name: x[:, k].copy() for name, x in lanes.items()}
    return made


def _integrated(pairs: Sequence[tuple[Motor, Run]], random: np.random.Generator) -> dict[str, Array]:
    motors, count = [motor for motor, _ in pairs], len(pairs)

    def column(name: str) -> Array:
        return np.array([getattr(motor, name) for motor in motors], dtype=float)

    groups = ("cogging", "flux", "friction_waves", "encoder", "offset", "table")
    widths = {name: max(1, *(len(_waves(m, name)) for m in motors)) for name in groups}
    edges = np.cumsum([0, *widths.values()])
    orders, sizes, phases = (np.zeros((edges[-1], count)) for _ in range(3))
    for name, first in zip(groups, edges, strict=False):
        for k, motor in enumerate(motors):
            for row, (order, size, phase) in enumerate(_waves(motor, name)):
                orders[first + row, k], sizes[first + row, k], phases[first + row, k] = order, size, phase
    part = {name: slice(a, b) for name, a, b in zip(groups, edges, edges[1:], strict=False)}
    K_t, J, coulomb, viscous = (column(name) for name in ("K_t", "inertia", "coulomb", "viscous"))
    stribeck, stribeck_speed = column("stribeck"), np.maximum(column("stribeck_speed"), 1e-9)
    limit, noise = column("limit"), column("noise")
    step_angle = TURN / column("counts")
    load = np.array([run.load for _, run in pairs])
    still = np.maximum(STILL, 4 * (coulomb + stribeck) / J * STEP)
    gain, decay, slow = SPEED_BANDWIDTH * J / K_t, math.exp(-STEP / LAG), math.exp(-LAW * STEP / SPEED_FILTER)
    rows = round(SECONDS / STEP) + LATEST
    time = STEP * np.arange(0, rows, LAW)
    reference = np.array([np.interp(time, *np.transpose(run.points)) for _, run in pairs]).T
    omega = reference[0].copy()
    theta = random.uniform(0, TURN, count)
    lagged = (coulomb * np.sign(omega) + viscous * omega + load) / K_t
    integral, asked = lagged.copy(), lagged.copy()
    counted = np.zeros(count)
    speed = omega.copy()
    names = ("theta", "i_q", "omega")
    log = {name: np.zeros((rows, count)) for name in names}
    for row in range(rows):
        waves = sizes * np.sin(orders * theta + phases)
        measured = np.floor((theta + waves[part["encoder"]].sum(0)) / step_angle) * step_angle
        if row % LAW == 0:
            moved = (measured - counted) / (LAW * STEP) if row else omega
            counted = measured
            speed = slow * speed + (1 - slow) * moved
            error = reference[row // LAW] - speed
            integral = integral + LAW * STEP * gain * SPEED_BANDWIDTH / 4 * error
            added = sizes[part["table"]] * np.sin(orders[part["table"]] * measured + phases[part["table"]])
            asked = np.clip(gain * error + integral + added.sum(0), -limit, limit)
        log["theta"][row], log["i_q"][row], log["omega"][row] = measured, lagged, speed
        middle = theta + 0.5 * STEP * omega
        after = asked + (lagged - asked) * decay
        waves = sizes * np.sin(orders * middle + phases)
        current = 0.5 * (lagged + after) - waves[part["offset"]].sum(0)
        rubbing = coulomb * (1 + waves[part["friction_waves"]].sum(0))
        rubbing = rubbing + stribeck * np.exp(-((omega / stribeck_speed) ** 2))
        torque = (
            K_t * current * (1 + waves[part["flux"]].sum(0))
            + waves[part["cogging"]].sum(0)
            - load
            - viscous * omega
            - rubbing * np.clip(omega / still, -1, 1)
        )
        omega = omega + STEP * torque / J
        theta = middle + 0.5 * STEP * omega
        lagged = after
    bit = 2 * limit / 2 ** (BITS - 1)
    log["i_q"] = bit * np.round((log["i_q"] + noise * random.standard_normal(log["i_q"].shape)) / bit)
    return log


def _waves(motor: Motor, name: str) -> tuple[Wave, ...]:
    waves: tuple[Wave, ...] = (motor.offset,) if name == "offset" else getattr(motor, name)
    return waves


def rows_of(
    raw: dict[str, Array], motor: Motor, rate: float, jitter: float, seed: int = 0
) -> dict[str, Array]:
    """A drive's log: rows at `rate`, Hz, at times off by up to `jitter` periods; its currents are late."""
    every, count = 1 / (STEP * rate), len(raw["theta"]) - LATEST
    at = every * np.arange(math.floor(count / every) - 1) + every / 2
    at = at + np.random.default_rng(seed).uniform(-jitter, jitter, len(at)) * every
    rows = LATEST + np.unique(np.clip(np.round(at).astype(int), 0, count - 1))
    return {
        "t": STEP * (rows - LATEST).astype(float),
        "theta": raw["theta"][rows],
        "omega": raw["omega"][rows],
        "i_q": raw["i_q"][rows - motor.late],
    }


def columns(motor: Motor, every_key: bool = False) -> dict[str, Any]:
    """Tables of the file of columns: what a user types in; `every_key`: also references and a law."""
    made: dict[str, Any] = {
        "columns": {"t": "t", "theta": "theta", "i_q": "i_q"},
        "motor": {
            "pole_pairs": motor.poles,
            "R_s": "1 ohm",
            "L_d": "1 mH",
            "L_q": "1 mH",
            "K_t": f"{motor.K_t:.9g} N*m/A",
        },
        "drive": {
            "rates": {"current_loop": "10 kHz", "speed_loop": "1 kHz"},
            "current_loop": {"bandwidth": "500 Hz", "current_limit": f"{motor.limit} A"},
            "inverter": {"bus_voltage": "48 V"},
            "position_sensor": {"kind": "encoder", "lines": motor.counts // 4, "speed_method": "M"},
        },
        "log": [{"file": f"{name}*", "kind": "load"} for name in ("drives", "brakes")],
    }
    if every_key:
        made["columns"]["omega"] = "omega"
        made["controller"] = {
            "pi": {"law": "pi", "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}}
        }
        kinds = {"slow": "slow-sweep", "accel": "acceleration", "fast": "constant-speed"}
        made["log"] = [
            {
                "file": f"{run.name}*",
                "kind": "load" if run.load else kinds.get(run.name, "constant-speed"),
                "controller": "pi",
                "reference": {"profile": [[f"{t:.6g} s", f"{v:.6g} rad/s"] for t, v in run.points]},
            }
            for run in runs(motor)
        ]
    return made


def write(folder: Path, logs: dict[str, dict[str, Array]], text: str) -> list[Path]:
    """The logs as .npz and the file of columns as id.toml; returns the logs' paths."""
    (folder / "id.toml").write_text(text, "utf-8")
    for name, signals in logs.items():
        np.savez(folder / f"{name}.npz", **signals)  # type: ignore[arg-type]
    return [folder / f"{name}.npz" for name in logs]
