"""What the certificate of the law `harmonic` says, compared with runs of drives that it doesn't know.

    python benchmarks/harmonic.py [--cases 200] [--seed 1]

Each case is a motor of the shipped studies at a random speed. The controller doesn't know that inertia and
torque constant are 50 % less to 50 % more. In some cases it also doesn't know a sample of delay, 5 % ripple
of the torque constant, an eccentric encoder, switched PWM, or a fault. A case runs for 12 s with the law,
with and without the guard, and with the same feedback alone. The certificate counts as a warning if it is
not fine, or if a sample is late and orders act that don't converge with a late sample. A case went wrong if
without the guard it ends with more than 1.25 times the speed error of its feedback.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from criterion import Changes, Draw, q

import cogless
from cogless.design.laws.harmonic import certificate
from cogless.run.simulate import simulate
from cogless.study import Study, changed

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "docs"))
import marked  # noqa: E402

RPM = math.pi / 30
WORSE = 1.25
BEGIN, DURATION = 1.0, 12.0  # s: start of learning, end of the run
LAST = 2.0  # s, the end of the run that counts
TURNS, TIME = 20.0, 5.0  # turns; s: the guard's promise
LAW = {"law": "harmonic", "tuning": {"rule": "auto"}}
# study, scenario, lowest and highest speed in r/min, inertia, key of the torque constant, its value and unit
MOTORS = (
    ("uomodri", "1-rev-s", 10.0, 300.0, 6e-6, "motor.kv", 300.0, "rpm/V"),
    ("liu2018", "60-rpm", 40.0, 900.0, 3e-4, "motor.K_t", 0.41, "N*m/A"),
)
FAULTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("none", {}),
    ("angle missing", {"kind": "angle-missing", "time": "4 s", "duration": "50 ms"}),
)


def case(seed: int, number: int) -> tuple[str, str, Changes, dict[str, Any]]:
    """A study, its scenario, the changes that make this case of it, and facts for the table."""
    d = Draw(seed, number)
    name, scenario, low, high, inertia, key, value, unit = d.one(*MOTORS)
    speed, plain = d.log(low, high), cogless.load(name)
    assert isinstance(plain, Study)
    J, K_t, late = d.uniform(0.5, 1.5), d.uniform(0.5, 1.5), d.chance(0.5)
    told = 1 / K_t if unit == "rpm/V" else K_t
    untold: Changes = {"mechanics.inertia": q(J * inertia, "kg*m^2"), key: q(value * told, unit)}
    if late:
        untold["drive.bus.delay_command"] = q(1 / plain.drive.rates.outer_loop, "s")
    if d.chance(0.5):
        untold["motor.torque_ripple"] = [{"order": 6 * plain.motor.pole_pairs, "percent": 5.0}]
    eccentric = d.one(0.0, 0.2, 0.5)
    if eccentric:
        untold["drive.position_sensor.eccentricity"] = q(eccentric, "deg")
    if d.chance(0.25):
        untold["drive.inverter.kind"] = "switched"
    fault, table = d.one(*FAULTS)
    changes: Changes = {
        "drive.guard": True,
        "controller.law": {**LAW, "learning_start": q(BEGIN, "s")},
        f"scenario.{scenario}.reference": q(speed, "rpm"),
        f"scenario.{scenario}.initial_speed": q(speed, "rpm"),
        f"scenario.{scenario}.duration": q(DURATION, "s"),
        f"scenario.{scenario}.override": untold,
        f"scenario.{scenario}.faults": [table] if table else [],
        f"scenario.{scenario}.controllers": [*plain.controllers_in(scenario), "law"],
    }
    if name == "uomodri":
        changes["metric"] = []  # liu2018 keeps its metrics, by which it is calibrated
    about = {"study": name, "speed": speed, "J": J, "K_t": K_t, "late": late, "eccentric": eccentric}
    return name, scenario, changes, about | {"fault": fault}


def error(study: Study, scenario: str) -> np.ndarray:
    """The true speed error, rad/s, a value for each ms."""
    trace = simulate(study, scenario, "law").trace
    rows = round(1e-3 / (trace.time[1] - trace.time[0]))
    return np.asarray(trace["omega_m"] - trace["omega_ref"])[::rows]


def judge(seed: int, number: int) -> dict[str, Any]:
    """Run one case: what the certificate says, and how the runs end."""
    name, scenario, changes, about = case(seed, number)
    study = cogless.load(name, changes)
    assert isinstance(study, Study)
    said = certificate(study, "law")
    warned = not said.fine or any(about["late"] and each.late < each.acting for each in said.speeds)
    last = slice(-round(1000 * LAST), None)
    without = error(changed(study, {"controller.law.learning_start": "1e6 s"}), scenario)
    bare = error(changed(study, {"drive.guard": False}), scenario)
    guarded = error(study, scenario)
    return {
        "case": number,
        **about,
        "warned": warned,
        "bare": float(np.std(bare[last]) / np.std(without[last])),
        "guarded": float(np.std(guarded[last]) / np.std(without[last])),
        "above": _longest(guarded, without, about["speed"] * RPM),
    }


def _longest(error: np.ndarray, without: np.ndarray, omega: float) -> bool:
    """Whether the error is above the feedback's for longer than the guard promises, by windows of turns."""
    turn = 2 * math.pi / omega
    window = round(1000 * turn * max(1, math.ceil(0.25 / turn)))
    begin = round(1000 * BEGIN)
    pieces = (x[begin : len(x) - (len(x) - begin) % window].reshape(-1, window) for x in (error, without))
    a, b = (piece.std(axis=1) for piece in pieces)
    bad = np.concatenate([[0], a > WORSE * b, [0]]).astype(int)
    edges = np.flatnonzero(np.diff(bad))
    longest = max((int(y - x) for x, y in zip(edges[::2], edges[1::2], strict=True)), default=0)
    return longest * window / 1000 > max(TIME, TURNS * turn)


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Markdown: a row for each thing that the certificate says, with how the runs ended."""
    lines = []
    for title, warned in (("converges", False), ("an order is turned", True)):
        some = [row for row in rows if row["warned"] is warned]
        wrong = sum(row["bare"] > WORSE for row in some)
        guarded = sum(row["guarded"] > WORSE for row in some)
        above = sum(row["above"] for row in some)
        median = f"{np.median([row['bare'] for row in some]):.2f}" if some else "-"
        lines.append([title, *map(str, (len(some), len(some) - wrong, wrong, guarded, above)), median])
    head = ["certificate", "cases", "fine", "ends above 1.25", "with the guard", "beyond its claim", "median"]
    return marked.table(head, lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    with ThreadPoolExecutor(arguments.jobs) as pool:
        rows = list(pool.map(lambda number: judge(arguments.seed, number), range(arguments.cases)))
    for row in rows:
        if row["above"] or (row["bare"] > WORSE) is not row["warned"]:
            shown = {k: f"{v:.3g}" if isinstance(v, float) else v for k, v in row.items()}
            print(*(f"{k} {v}" for k, v in shown.items()))
    lines = [*table(rows), "", f"{len(rows)} drives, seed {arguments.seed}."]
    print(*lines, sep="\n")


if __name__ == "__main__":
    main()
