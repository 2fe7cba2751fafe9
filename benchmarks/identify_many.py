"""How long `cogless identify` takes, and how much memory, for 16 logs of 20,000 rows.

    OPENBLAS_NUM_THREADS=1 python benchmarks/identify_many.py

The logs are simulated: a servo of benchmarks/identify_planned.py at eight speeds, with four accelerations
and four loads, each for 20 s at 1 kHz. Each step is printed with the processor time until then.
"""

from __future__ import annotations

import math
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import identify_planned as benchmark
import numpy as np

from cogless.identify import plan
from cogless.identify.command import identified
from cogless.study import Study

SECONDS = 20.02  # s; the log drops some rows at its start for the currents' delay
SPEEDS = (0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 4.0, 6.0)  # shares of the study's own speed
planned = plan.scenarios


def scenarios(study: Study, law: str) -> tuple[dict[str, Any], float]:
    """Sixteen scenarios in place of the six of `plan`, and the rate that `plan` gives."""
    own, rate = planned(study, law)
    loads = [made["load"] for made in own.values() if "load" in made]
    v = next(iter(study.scenario.values())).top_reference or 2 * math.pi

    def profile(*points: tuple[float, float]) -> dict[str, Any]:
        told = [[f"{t:.6g} s", f"{v * x:.6g} rad/s"] for t, x in points]
        return {"duration": f"{SECONDS} s", "reference": {"profile": told}}

    def both_ways(speed: float) -> dict[str, Any]:
        made = profile((0, speed), (9.8, speed), (10.2, -speed), (SECONDS, -speed))
        return {**made, "initial_speed": f"{v * speed:.6g} rad/s"}

    made = {f"speed-{n}": ("constant-speed", both_ways(speed)) for n, speed in enumerate(SPEEDS)}
    for n in range(4):
        sweeps = [(0.5 + 0.8 * k, (3.0 + n) * (-1) ** k) for k in range(24)]
        made[f"acceleration-{n}"] = "acceleration", profile((0, 0), *sweeps)
        made[f"load-{n}"] = "load", both_ways(0.25 * (1 + n // 2)) | {"load": loads[n % 2]}
    plan.SCENARIO_KINDS.update({name: kind for name, (kind, _) in made.items()})
    return {name: scenario for name, (_, scenario) in made.items()}, rate


def recorded(folder: Path) -> tuple[Sequence[Path], Path]:
    """The simulated logs, and the file that names their columns."""
    plan.scenarios = scenarios
    random = np.random.default_rng(5)
    of = benchmark.recorded(benchmark.drawn("servo", random), folder, random)
    return of.logs, of.columns


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        with ProcessPoolExecutor(1, get_context("spawn")) as simulates:  # its memory is no part of identify's
            logs, columns = simulates.submit(recorded, Path(folder)).result()
        rows = [len(np.load(path)["time"]) for path in logs]
        print(f"{len(rows)} logs of {min(rows)} rows")
        begun = time.process_time()

        def progress(what: str, share: float) -> None:
            print(f"{time.process_time() - begun:6.1f} s  {what} {share:.0%}", flush=True)

        identified(logs, columns, progress)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    print(f"{time.process_time() - begun:.1f} s of processor time, at most {memory:.0f} MB")


if __name__ == "__main__":
    main()
