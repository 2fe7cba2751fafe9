"""What `cogless design` says of learning, compared with long runs of random drives.

    python benchmarks/criterion.py [--cases 300] [--seed 1] [--write]

Each case is a drive drawn at random: motor, rates, sensor, gains, memory, speed, load, and often a plant
that differs from what the controller assumes. A case runs for 60 s with learning, and for 60 s with the same
feedback without learning. If design says that learning grows, the runs last until it would have grown, at
most 20 minutes. A run is worse if the true speed's error ends above 1.25 times that of the feedback, or if
the error rises to more than 1.25 times in the second half, and again in a run four times as long. --write
puts the table into docs/theory/learning.md.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import cogless
from cogless.design.speed_loop import gains
from cogless.design.verdict import Verdict, judged, verdict
from cogless.run.simulate import simulate
from cogless.study import Study

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "docs"))
import marked  # noqa: E402

PAGE = HERE.parent / "docs" / "theory" / "learning.md"
WORSE = 1.25  # ratio to the feedback's error
WINDOWS, BEGUN = 6, 2.0  # windows of a run; s, the start-up that is left out
SHORTEST, LONGEST = 60.0, 1200.0  # s, length of a run
LONGER = 4  # factor on the length of a run whose error still rises
SHOWS = 1e4  # factor by which learning that is said to grow would grow in the run
ROWS = {
    "settles": "settles",
    "hedged": "settles, with a reservation",
    "may grow": "may grow, may be unstable",
    "may be unstable": "may grow, may be unstable",
    "grows": "grows, unstable",
    "unstable": "grows, unstable",
    "feedback unstable": "grows, unstable",
    "rests": "learns nothing",
}
Changes = dict[str, Any]


def q(value: float, unit: str) -> str:
    """A quantity as a study's text: number and unit."""
    return f"{value!r} {unit}"


class Draw:
    """Random choices of one case."""

    def __init__(self, seed: int, case: int) -> None:
        self.rng = np.random.default_rng([seed, case])

    def log(self, low: float, high: float) -> float:
        return float(math.exp(self.rng.uniform(math.log(low), math.log(high))))

    def uniform(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def one(self, *choices: Any) -> Any:
        return choices[int(self.rng.integers(len(choices)))]

    def chance(self, share: float) -> bool:
        return bool(self.rng.uniform() < share)


def drive(d: Draw, K_t: float, b: float, rate: int, divider: int) -> Changes:
    """Motor, mechanics and drive."""
    pole_pairs = d.one(2, 4, 5, 7, 11, 14)
    R, tau = d.log(0.2, 8.0), d.log(4e-4, 3e-3)
    torque = K_t * d.log(0.02, 0.4)
    cogging = [
        {"order": order, "torque": q(torque * share, "N*m"), "phase": q(d.uniform(-3, 3), "rad")}
        for order, share in ((2 * pole_pairs, 0.3), (6 * pole_pairs, 1.0), (12 * pole_pairs, 0.2))
    ]
    sensor: Changes = {"kind": "ideal"}
    kind = d.uniform(0, 1)
    if kind > 0.8:
        sensor = {"kind": "resolver", "bits": d.one(12, 14, 16), "window": d.one(1, 4, 16)}
    elif kind > 0.2:
        method = d.one("M", "MT")
        sensor = {"kind": "encoder", "lines": round(d.log(500, 16384)), "speed_method": method}
    flux = []
    if d.chance(0.25):
        psi = K_t / 1.5 / pole_pairs
        flux = [{"order": 6, "d": q(psi * d.uniform(0, 0.03), "Wb"), "q": q(psi * d.uniform(0, 0.05), "Wb")}]
    return {
        "drive.guard": False,  # the guard would stop learning that grows
        "drive.rates.integration_steps": 4,
        "motor.pole_pairs": pole_pairs,
        "motor.R_s": q(R, "ohm"),
        "motor.L_d": q(R * tau, "H"),
        "motor.L_q": q(R * tau, "H"),
        "motor.K_t": q(K_t, "N*m/A"),
        "motor.cogging": cogging,
        "motor.flux_harmonics": flux,
        "mechanics.inertia": q(K_t / b, "kg*m^2"),
        "mechanics.coulomb_friction": q(K_t * d.one(0.0, d.log(0.005, 0.1)), "N*m"),
        "mechanics.viscous_friction": q(K_t * d.one(0.0, d.log(1e-4, 1e-3)), "N*m*s/rad"),
        "mechanics.load": q(K_t * d.one(0.0, d.uniform(0, 1)), "N*m"),
        "drive.rates.current_loop": q(rate, "Hz"),
        "drive.rates.speed_loop": q(rate // divider, "Hz"),
        "drive.current_loop.bandwidth": q(min(d.log(200, 1500), rate / 15), "Hz"),
        "drive.inverter.computation_delay": d.one(0, 1),
        "drive.position_sensor": sensor,
        "drive.current_sensors.noise": q(d.one(0.0, d.log(1e-3, 0.03)), "A"),
    }


def told_wrong(d: Draw, inertia: float, K_t: float) -> Changes:
    """The scenario's random overrides of the plant, which the controller doesn't know."""
    override: Changes = {}
    if d.chance(0.4):
        override["mechanics.inertia"] = q(inertia * d.log(0.4, 2.5), "kg*m^2")
    if d.chance(0.25):
        override["motor.K_t"] = q(K_t * d.log(0.6, 1.6), "N*m/A")
    if d.chance(0.15):
        override["drive.inverter.computation_delay"] = 1
    return override


def memory(d: Draw, omega: float, rate: float) -> Changes:
    """The memory's keys of a law that learns by time or angle."""
    period = d.one("electrical", "mechanical")
    kind = d.one("angle", "angle", "time")
    fields: Changes = {"memory": kind, "period": period, "learning_start": "0.5 s"}
    cells = d.one(64, 128, 256, 512, 1024, 2048, 4096)
    if kind == "time":
        cells = min(65535, math.ceil(1.1 * 2 * math.pi / omega * rate) + 4)
    width = d.one(0, 0, 1, 2, 3, 5, 8)
    fields |= {"cells": cells, "q_half_width": min(width, (cells - 1) // 2)}
    fields["forgetting"] = d.one(1.0, 1.0, 1.0, d.uniform(0.8, 0.999))
    fields["lead"] = q(d.one(0, 0, 0, 0, *range(1, 9)) / rate, "s")
    return fields


def case(seed: int, number: int) -> Changes:
    """The changes of benchmarks/criterion.toml that give the study of a case."""
    d = Draw(seed, number)
    K_t, b = d.log(0.02, 0.6), d.log(500, 20000)
    current_rate, divider = d.one(8000, 10000, 16000, 20000), d.one(1, 2, 4, 5, 8, 10, 16)
    changes, rate = drive(d, K_t, b, current_rate, divider), current_rate // divider
    omega = d.log(1.0, 60.0)
    margin = {"rule": "phase-margin", "phase_margin": f"{d.uniform(35, 70):.4g} deg"}
    pi = {"law": "pi", "tuning": margin}
    study = cogless.load(HERE / "criterion.toml", {**changes, "controller.law": pi})
    kp, _ = gains(study, "law")
    name = d.one("pi-ilc", "pi-ilc", "robust-ilc", "space-position", "space-speed")
    if name == "pi-ilc":
        law: Changes = {"law": name, "tuning": margin, "gain": q(kp * d.log(0.03, 3.0), "A*s/rad")} | memory(
            d, omega, rate
        )
    elif name == "robust-ilc":
        linear, believed = b * kp / 2, b * d.log(0.8, 1.25)
        law = {"law": name, "b": q(believed, "rad/s^2/A"), "q": 1.0, "beta_1": "0 rad/s^2"}
        law |= {"c": q(linear, "1/s"), "eta": q(linear, "1/s")}
        law |= {"beta_2": q(2 * linear * d.log(0.03, 2.0), "1/s"), "gamma": "0 1/s^2"}
        law["g"] = q(d.one(0.0, b * d.log(1e-3, 0.05)), "rad/s^2")
        law |= memory(d, omega, rate)
    else:
        parts = d.one("electrical", "mechanical")
        law = {"law": name, "period": {"of": parts}, "cells": d.one(128, 256, 512, 1024, 4096)}
        law |= {"q_half_width": d.one(0, 1, 3, 5, 8, 12), "learning_start": "0.5 s", "memory": "map"}
        mu = kp * d.log(0.03, 2.0)
        if name == "space-position":
            law |= {"tuning": margin, "frame": "mechanical", "mu_alpha": mu * omega}
        else:
            law |= {"k": q(kp, "A*s/rad"), "eta_bar": q(0.9 * omega, "rad/s"), "mu_alpha": mu * omega}
    changes["controller.law"] = law
    override = told_wrong(d, K_t / b, K_t)
    scenario: Changes = {
        "duration": "60 s",
        "reference": q(omega, "rad/s"),
        "initial_speed": q(omega, "rad/s"),
        "override": override,
    }
    if d.chance(0.2):
        swing = omega * d.uniform(0.05, 0.5)
        scenario["reference"] = {
            "offset": q(omega, "rad/s"),
            "amplitude": q(swing, "rad/s"),
            "frequency": q(d.log(0.05, 0.5), "Hz"),
        }
    changes["scenario.run"] = scenario
    changes["trace.rate"] = q(next(r for r in (1000, 2000) if current_rate % r == 0), "Hz")
    return changes


def off(law: Changes) -> Changes:
    """The changes that switch a law's learning off."""
    if law["law"].startswith("space"):
        return {"controller.law.learning": False}
    return {"controller.law.learning_start": "1e6 s"}


def errors(study: Study) -> list[float]:
    """Standard deviation of the true speed's error in each of WINDOWS windows, rad/s."""
    trace = simulate(study, "run", "law").trace
    ends = np.linspace(0.0, float(trace.time[-1]), WINDOWS + 1)
    error = trace["omega_m"] - trace["omega_ref"]
    windows = [trace.window(max(a, BEGUN), b) for a, b in pairwise(ends.tolist())]
    return [float(np.std(error[rows])) for rows in windows]


def lasting(found: Verdict, study: Study) -> float:
    """How long a case has to run to show what design says of it, s."""
    if found.kind != "grows" or found.worst is None:
        return SHORTEST
    loop = judged(study, "run", "law")[0]
    needed = math.log(SHOWS) / math.log(found.worst.factor) / loop.periods_per_second
    return min(max(SHORTEST, needed), LONGEST)


def judge(seed: int, number: int) -> Changes:
    """One case: what design says, and what the runs do."""
    try:
        config = case(seed, number)
        study = cogless.load(HERE / "criterion.toml", config)
        found = verdict(study, "law")
        assert isinstance(study, Study) and found is not None
        first = lasting(found, study)
        for time in (first, LONGER * first):  # an error that still rises may settle later
            study = cogless.changed(study, {"scenario.run.duration": f"{time!r} s"})
            learned = errors(study)
            rising = learned[-3] < learned[-2] < learned[-1] and learned[-1] > WORSE * learned[-3]
            if not rising:
                break
        without = errors(cogless.changed(study, off(config["controller.law"])))
    except cogless.StudyError as error:
        return {"case": number, "error": str(error)}
    worse = learned[-1] > WORSE * without[-1] or rising
    hedged = found.kind == "settles" and not found.fine
    row = "settles, with a reservation" if hedged else ROWS.get(found.kind, found.kind)
    return {
        "case": number,
        "row": row,
        "worse": worse,
        "law": config["controller.law"]["law"],
        "said": found.in_words(),
        "ratio": found.ratio,
        "time": time,
        "learned": learned,
        "without": without,
        "config": config,
    }


def table(found: Sequence[Changes]) -> list[str]:
    """Markdown: a row for each thing that design said, a column for each outcome of a run."""
    counts = Counter((each["row"], each["worse"]) for each in found)
    rows = [
        [row, str(counts[row, False] + counts[row, True]), str(counts[row, False]), str(counts[row, True])]
        for row in dict.fromkeys(ROWS.values())
        if counts[row, False] + counts[row, True]
    ]
    return marked.table(["`cogless design` says", "cases", "no worse", "worse"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the table into the theory page")
    parser.add_argument("--out", type=Path, help="all cases as JSON")
    arguments = parser.parse_args()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        rows = list(pool.map(lambda number: judge(arguments.seed, number), range(arguments.cases)))
    if arguments.out:
        arguments.out.write_text(json.dumps(rows), encoding="utf-8")
    found = [row for row in rows if "error" not in row]
    lines = [*table(found), "", f"{len(found)} drives, seed {arguments.seed}."]
    for row in found:
        if (row["row"], row["worse"]) in (("settles", True), ("grows, unstable", False)):
            print(f"case {row['case']}, {row['law']}: {row['said']}; {row['learned']}, {row['without'][-1]}")
    print(*lines, sep="\n")
    if arguments.write:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(marked.replaced(text, {"criterion": lines}), encoding="utf-8")


if __name__ == "__main__":
    main()
