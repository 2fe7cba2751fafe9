"""Whether the guard keeps learning from hurting: random configurations against the same feedback.

    python benchmarks/guard.py [--cases 200] [--seed 1] [--off] [--write]

Each case is a drive and a learning law drawn at random, most of them bad: learning gains of a tenth to twenty
times the feedback's own, leads wrong by up to four samples, a computation delay, an inertia and a torque
constant that the controller doesn't know, speeds up to the limit, changing speeds and load steps. Each case
runs twice: with learning, and with the same feedback without learning. A window is whole turns of the
reference in at least 0.25 s, but at most 5 s. A window is bad if the speed error's standard deviation (its
rms, if the rotor does not turn with the reference) is more than 1.25 times that of the feedback in the same
window, for the true speed and for the measured one. The claim: bad windows in a row last at most 20 turns or
5 s, whichever is longer. --off: without the guard. --write puts the table into docs/laws/guard.md.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from criterion import Changes, Draw, drive, q, told_wrong

import cogless
from cogless.design.speed_loop import gains
from cogless.run.simulate import simulate
from cogless.study import Study

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "docs"))
import marked  # noqa: E402

PAGE = HERE.parent / "docs" / "laws" / "guard.md"
WORSE = 1.25  # ratio to the feedback's error
TURNS, TIME = 20.0, 5.0  # turns; s: the claim
SHORTEST, LONGEST = 0.25, 5.0  # s, length of a window
STALLED = 0.5  # share of the reference; with a larger mean error the rotor does not turn with it
BEGUN = 0.5  # s, the start-up left out
DURATION, SHORT = 40.0, 20.0  # s, a run; SHORT if 20 turns take less than 5 s, or more than DURATION
STEPS = (2, 4, 8, 16)  # integration steps in a period; the fewest that the study accepts are used
LAWS = ("pi-ilc", "robust-ilc", "space-speed", "pi-afc")


def memory(d: Draw, slowest: float, rate: float) -> Changes:
    """The memory's keys of a law that learns by time or angle, with a lead wrong by up to four samples."""
    kind = d.one("angle", "angle", "time")
    fields: Changes = {"memory": kind, "period": d.one("electrical", "mechanical")}
    cells = d.one(64, 128, 256, 512, 1024, 2048, 4096)
    if kind == "time":
        cells = min(65535, math.ceil(1.1 * 2 * math.pi / slowest * rate) + 4)
    fields |= {"cells": cells, "q_half_width": min(d.one(0, 0, 1, 2, 3, 5, 8), (cells - 1) // 2)}
    fields["forgetting"] = d.one(1.0, 1.0, 1.0, d.uniform(0.8, 0.999))
    fields["lead"] = q(min(d.one(0, 0, 1, 2, 3, 4, 5, 6), cells // 4) / rate, "s")
    return fields


def reference(d: Draw, omega: float, duration: float) -> tuple[str, Any, list[tuple[float, float]]]:
    """A constant speed, or one that changes by steps: its kind, the key, and its points."""
    kind = d.one("steady", "steady", "steady", "speeds", "load")
    if kind != "speeds":
        return kind, q(omega, "rad/s"), [(0.0, omega), (duration, omega)]
    points, time, speed = [(0.0, omega)], 0.0, omega
    while time < 0.75 * duration:
        time += d.uniform(0.15, 0.3) * duration
        ramp = d.log(0.02, 1.0)
        points.append((time, speed))
        speed = omega * d.log(0.3, 1.0)
        points.append((time + ramp, speed))
    return kind, [[q(t, "s"), q(w, "rad/s")] for t, w in points], [*points, (duration + time, speed)]


def case(seed: int, number: int, steps: int) -> tuple[Changes, dict[str, Any]]:
    """The changes of benchmarks/criterion.toml that give the study of a case, and facts for the table."""
    d = Draw(seed, number)
    K_t, b = d.log(0.02, 0.6), d.log(500, 20000)
    current_rate, divider = d.one(8000, 8000, 10000, 20000), d.one(4, 5, 8, 10, 16)
    changes, rate = drive(d, K_t, b, current_rate, divider), current_rate // divider
    omega = d.log(0.5, 300.0)
    changes["drive.inverter.bus_voltage"] = q(d.log(1.2, 6.0) * math.sqrt(3) * omega * K_t / 1.5 + 5.0, "V")
    changes["drive.inverter.computation_delay"] = 0
    changes["drive.rates.integration_steps"] = steps
    margin = {"rule": "phase-margin", "phase_margin": f"{d.uniform(35, 70):.4g} deg"}
    study = cogless.load(
        HERE / "criterion.toml", {**changes, "controller.law": {"law": "pi", "tuning": margin}}
    )
    kp, _ = gains(study, "law")
    name, gain = d.one(*LAWS), kp * d.log(0.1, 20.0)
    duration = DURATION if TIME < TURNS * 2 * math.pi / omega < DURATION else SHORT
    kind, asked, points = reference(d, omega, duration)
    slowest = min(speed for _, speed in points)
    if name == "pi-ilc":
        law: Changes = {"tuning": margin, "gain": q(gain, "A*s/rad")} | memory(d, slowest, rate)
    elif name == "robust-ilc":
        linear, believed = b * kp / 2, b * d.log(0.8, 1.25)
        law = {"b": q(believed, "rad/s^2/A"), "q": 1.0, "gamma": "0 1/s^2"}
        law |= {"c": q(linear, "1/s"), "eta": q(linear, "1/s"), "beta_2": q(gain * b, "1/s")}
        law["beta_1"] = q(d.one(0.0, 0.0, b * d.log(1e-3, 0.05)), "rad/s^2")
        law["g"] = q(d.one(0.0, b * d.log(1e-3, 0.05)), "rad/s^2")
        law |= memory(d, slowest, rate)
    elif name == "pi-afc":
        orders = sorted({changes["motor.pole_pairs"] * k for k in (d.one(1, 2), 6, 12)})
        law = {"tuning": margin, "gain": q(gain * d.log(1.0, 100.0), "A/rad"), "orders": orders}
        law["lead"] = q(d.one(0, 0, 1, 2, 3, 4, 5, 6) / rate, "s")
    else:
        law = {"period": {"of": d.one("electrical", "mechanical")}, "cells": d.one(128, 256, 512, 1024, 4096)}
        law |= {"q_half_width": d.one(0, 1, 3, 5, 8, 12), "memory": "map", "k": q(kp, "A*s/rad")}
        law |= {"eta_bar": q(d.log(0.5, 10.0) * omega, "rad/s"), "mu_alpha": gain * omega}
    law["learning_start"] = q(d.one(0.0, 0.0, 2.0), "s")
    changes["controller.law"] = {"law": name, **law}
    override = told_wrong(d, K_t / b, K_t)
    if d.chance(0.5):
        override["mechanics.inertia"] = q(K_t / b * d.log(0.5, 2.0), "kg*m^2")
        override["motor.K_t"] = q(K_t * d.log(0.5, 2.0), "N*m/A")
    if d.chance(0.5):
        override["drive.inverter.computation_delay"] = 1
    scenario: Changes = {
        "duration": f"{duration!r} s",
        "reference": {"profile": asked} if kind == "speeds" else asked,
        "initial_speed": q(omega * d.one(1.0, 1.0, 0.0), "rad/s"),
        "override": override,
    }
    if kind == "load":
        low, high = 0.0, K_t * d.uniform(0.3, 1.5)
        times = np.cumsum([d.uniform(2.0, 12.0) for _ in range(10)])
        scenario["events"] = [
            {"time": q(float(t), "s"), "load": q(low if n % 2 else high, "N*m")}
            for n, t in enumerate(times)
            if t < duration
        ]
    changes["scenario.run"] = scenario
    changes["trace.rate"] = q(next(r for r in (2000, 1600, 1000) if current_rate % r == 0), "Hz")
    about = {
        "law": name,
        "kind": kind,
        "omega": omega,
        "points": points,
        "duration": duration,
        "memory": law.get("memory", "orders"),
    }
    return changes, about


def loaded(seed: int, number: int, guard: bool) -> tuple[Changes, dict[str, Any], Study]:
    """One case and its study, with the fewest steps of integration that the study accepts."""
    for steps in STEPS:
        try:
            changes, about = case(seed, number, steps)
            return changes, about, cogless.load(HERE / "criterion.toml", {**changes, "drive.guard": guard})
        except cogless.StudyError as error:
            if "integration_steps" not in str(error):
                raise
    raise cogless.StudyError(f"case {number}: more than {STEPS[-1]} steps of integration")


def boundaries(points: Sequence[tuple[float, float]], end: float) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the windows, s, and the number of turns of the reference at each end."""
    times, speeds = (np.array(x) for x in zip(*points, strict=True))
    t = np.arange(BEGUN, end, 0.002)
    turned = np.cumsum(np.interp(t, times, speeds)) * 0.002 / 2 / math.pi
    ends = [0]
    while True:
        first = ends[-1]
        soonest = np.searchsorted(t, t[first] + SHORTEST)
        if soonest >= len(t):
            break
        turns = max(1.0, math.ceil(turned[soonest] - turned[first] - 0.01))
        last = min(np.searchsorted(turned, turned[first] + turns), np.searchsorted(t, t[first] + LONGEST))
        if last >= len(t):
            break
        ends.append(int(last))
    return t[ends], turned[ends]


def errors(study: Study, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each window: `ripple` of the true speed error; of the measured error and of its mean over two
    samples, rad/s; and the share of the window in which the guard acted."""
    trace = simulate(study, "run", "law").trace
    time, reference = trace.time, trace["omega_ref"]
    true, seen = trace["omega_m"] - reference, trace["omega_measured"] - reference
    mean = (seen + np.concatenate(([seen[0]], seen[:-1]))) / 2
    edges = np.searchsorted(time, ends)
    held = (np.nan_to_num(trace["status"]).astype(int) & 2048) > 0
    pairs = list(pairwise(edges))
    stalled = [abs(np.mean(true[a:b])) > STALLED * np.mean(reference[a:b]) for a, b in pairs]
    return (
        np.array([ripple(true[a:b], rests) for (a, b), rests in zip(pairs, stalled, strict=True)]),
        np.array(
            [
                [ripple(x[a:b], rests) for x in (seen, mean)]
                for (a, b), rests in zip(pairs, stalled, strict=True)
            ]
        ),
        np.array([np.mean(held[a:b]) for a, b in pairs]),
    )


def ripple(error: np.ndarray, stalled: np.bool_) -> float:
    """RMS of the error without its mean; of the whole error if the rotor does not turn with the reference."""
    return float(np.sqrt(np.mean((error - (0.0 if stalled else np.mean(error))) ** 2)))


def spans(bad: np.ndarray, ends: np.ndarray, turns: np.ndarray) -> list[tuple[float, float, float]]:
    """Bad windows in a row: start, s, how long, s, and how many turns."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], bad.astype(int), [0]))))
    return [
        (float(ends[a]), float(ends[b] - ends[a]), float(turns[b] - turns[a]))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def judge(seed: int, number: int, guard: bool) -> dict[str, Any]:
    """Run one case: how far its error is above the feedback's, and for how long."""
    try:
        changes, about, study = loaded(seed, number, guard)
        ends, turns = boundaries(about["points"], about["duration"] - 0.1)
        true, seen, held = errors(study, ends)
        law = changes["controller.law"]
        never = {"learning": False} if law["law"].startswith("space") else {"learning_start": "1e6 s"}
        without, without_seen, _ = errors(
            cogless.changed(study, {f"controller.law.{key}": value for key, value in never.items()}), ends
        )
    except cogless.StudyError as error:
        return {"case": number, "error": str(error)}
    ratio, ratio_seen = (
        true / np.maximum(without, 1e-12),
        np.max(seen / np.maximum(without_seen, 1e-12), axis=1),
    )
    bad = (ratio > WORSE) & (ratio_seen > WORSE)
    found = spans(bad, ends, turns)
    beyond = [span for span in found if span[1] > TIME and span[2] > TURNS]
    last = len(ratio) - max(1, len(ratio) // 6)
    return {
        "case": number,
        **about,
        "points": None,
        "beyond": beyond,
        "beyond_true": [
            span for span in spans(ratio > WORSE, ends, turns) if span[1] > TIME and span[2] > TURNS
        ],
        "share": float(np.sum(np.diff(ends)[bad]) / (ends[-1] - ends[0])),
        "end": float(np.median(ratio[last:])),
        "end_seen": float(np.median(ratio_seen[last:])),
        "worst": float(np.max(np.minimum(ratio, ratio_seen))),
        "first": next((span for span in found), None),
        "held": float(np.mean(held)),
        "config": changes["controller.law"],
        "ratios": [round(float(r), 3) for r in ratio],
        "ratios_seen": [round(float(r), 3) for r in ratio_seen],
        "helds": [round(float(r), 2) for r in held],
        "ends": [round(float(r), 2) for r in ends],
    }


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Markdown: a row for each law, and one for all laws."""
    lines = []
    for name in (*LAWS, "all"):
        some = [row for row in rows if name in (row["law"], "all")]
        if not some:
            continue
        lines.append(
            [
                name,
                str(len(some)),
                str(sum(bool(row["beyond"]) for row in some)),
                str(sum(row["end"] > WORSE and row["end_seen"] > WORSE for row in some)),
                str(sum(row["end"] < 0.8 for row in some)),
                f"{np.mean([row['share'] for row in some]):.1%}".replace("%", " %"),
                f"{np.median([row['worst'] for row in some]):.3g}, {max(row['worst'] for row in some):.3g}",
            ]
        )
    head = [
        "law",
        "cases",
        "beyond the claim",
        "end above 1.25",
        "end below 0.8",
        "time above 1.25",
        "worst window: median, most",
    ]
    return marked.table(head, lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--off", action="store_true", help="without the guard")
    parser.add_argument("--write", action="store_true", help="put the table into the guard's page")
    parser.add_argument("--out", type=Path, help="all cases as JSON")
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.cases)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        rows = list(pool.map(lambda number: judge(arguments.seed, number, not arguments.off), numbers))
    if arguments.out:
        arguments.out.write_text(json.dumps(rows), encoding="utf-8")
    found = [row for row in rows if "error" not in row]
    for row in found:
        if row["beyond"]:
            print(
                f"case {row['case']}, {row['law']}, {row['memory']}, {row['kind']}, "
                f"{row['omega']:.3g} rad/s: "
                f"{row['beyond'][0]}, end {row['end']:.3g}, worst {row['worst']:.3g}"
            )
    lines = [*table(found), "", f"{len(found)} drives, seed {arguments.seed}."]
    print(*lines, sep="\n")
    if arguments.write:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(marked.replaced(text, {"guard": lines}), encoding="utf-8")


if __name__ == "__main__":
    main()
