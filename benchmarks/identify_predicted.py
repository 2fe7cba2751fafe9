"""How well the study that `cogless identify` writes predicts the ripple of a log that identify has not seen.

    OPENBLAS_NUM_THREADS=1 python benchmarks/identify_predicted.py --seeds 1 2 3

Motors and logs are those of `identify_plant.py`, whose plant and law are not cogless's. The log at the middle
speed is not given to identify. At this speed the plant runs under its law, without and with the identified
table of currents. The study that identify writes runs in the engine at this speed, with a PI of the same
gains, without and with the map that identify writes. A line for each motor has the ripple of the measured
speed in the plant, r/min rms, and the predicted ripple over this one.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import identify_plant as plant
import numpy as np

from cogless import load, run_study
from cogless.identify import described, plan, write
from cogless.identify.command import identified
from cogless.identify.result import Estimate
from cogless.units import RPM

KEPT = "middle"
WINDOW = (1.5, 4.0)  # s: here the kept-out log is at its first speed, and the law has settled
GOALS = {"without": 0.1, "with": 0.2}  # relative


def ripple(signal: np.ndarray, period: float) -> float:
    """Rms of a speed in WINDOW, without its mean, r/min."""
    return float(np.std(signal[round(WINDOW[0] / period) : round(WINDOW[1] / period)])) / RPM


def measured(motor: plant.Motor, seed: int) -> float:
    (raw,) = plant.simulated([motor], seed, [KEPT])
    every = plant.LAW
    return ripple(raw[KEPT]["omega"][::every], plant.LAW * plant.STEP)


def predicted(estimate: Estimate, motor: plant.Motor, folder: Path) -> dict[str, float]:
    """The ripple without and with the table, by the study that identify writes."""
    write.write_all(estimate, folder)
    speed = 2.5 * motor.speeds[0]
    gain = plant.SPEED_BANDWIDTH * motor.inertia / motor.K_t
    law: dict[str, Any] = {
        "kp": f"{gain} A*s/rad",
        "ki": f"{gain * plant.SPEED_BANDWIDTH / 4} A/rad",
    }
    tables = described.study(estimate)
    tables["drive"]["speed_filter"] = f"{1 / (plant.TURN * plant.SPEED_FILTER)} Hz"
    tables["scenario"] = {
        "kept": {
            "duration": f"{WINDOW[1]} s",
            "reference": f"{speed} rev/s",
            "initial_speed": f"{speed} rev/s",
        }
    }
    tables["metric"] = [
        {"name": "speed_ripple", "kind": "ripple-rms", "signal": "omega_measured", "last": "2 s"}
    ]
    tables["controller"] = {"without": {"law": "pi", **law}}
    if estimate.cogging:
        tables["controller"]["with"] = {
            "law": "anti-cogging",
            **law,
            "start": {"map": "cogging.bin"},
            "cells": 1024,
        }
    (folder / "predicted.toml").write_text(plan.to_toml(tables), "utf-8")
    study = load(folder / "predicted.toml")
    runs = run_study(study).runs
    return {run.controller: ripple(run.trace["omega_measured"], run.trace.period) for run in runs}


def motors_of(seed: int) -> list[plant.Motor]:
    random = np.random.default_rng(seed)
    return [plant.drawn(kind, random) for kind in plant.KINDS]


def compared(seed: int, motor: plant.Motor, raw: plant.Raw, rate: float) -> tuple[Estimate, dict[str, float]]:
    """The estimate, and predicted over measured ripple without and with the table."""
    logs = {
        name: plant.rows_of(signals, motor, rate, 0.0, seed + n)
        for n, (name, signals) in enumerate(raw.items())
        if name != KEPT
    }
    with tempfile.TemporaryDirectory() as folder:
        paths = plant.write(Path(folder), logs, plan.to_toml(plant.columns(motor)))
        estimate = identified(paths, Path(folder) / "id.toml", lambda what, share: None).estimate
        ripples = predicted(estimate, motor, Path(folder))
    table = tuple((w.order, -w.size.value, w.phase.value) for w in estimate.cogging)
    plants = {"without": measured(motor, seed), "with": measured(replace(motor, table=table), seed)}
    ratios = {name: ripples[name] / plants[name] for name in ripples}
    texts = (f"{name} {plants[name]:8.3g} r/min, predicted {ratios[name]:5.2f}" for name in ratios)
    print(f"{seed} {motor.kind:8} {'; '.join(texts)}", flush=True)
    return estimate, ratios


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--rate", type=float, default=1000.0, help="rows a second")
    options = parser.parse_args(arguments)
    ratios = [
        compared(seed, motor, raw, options.rate)[1]
        for seed in options.seeds
        for motor, raw in zip(motors_of(seed), plant.simulated(motors_of(seed), seed), strict=True)
    ]
    for name, goal in GOALS.items():
        off = [abs(one[name] - 1) for one in ratios if name in one]
        print(
            f"{name} the table: {sum(x <= goal for x in off)} of {len(off)} within {goal:.0%}, "
            f"median {np.median(off):.1%}"
        )


if __name__ == "__main__":
    main()
