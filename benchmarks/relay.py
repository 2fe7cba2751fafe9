"""The ripple of robust ILC's relay: predicted by `cogless design`, and simulated, in loops drawn at random.

python benchmarks/relay.py [--cases 60] [--seed 1]. docs/laws/robust-ilc.md has the result.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import cogless
from cogless.design.laws.periodic import switching
from cogless.study import Study

HERE = Path(__file__).parent
UNLEARNED = {"q": 0.0, "beta_1": 0.0, "beta_2": 0.0, "gamma": 0.0}


def drawn(rng: np.random.Generator) -> Study:
    """benchmarks/criterion.toml, a drive without cogging or load, under a law that doesn't learn."""
    b = float(10 ** rng.uniform(2.5, 4))
    relay = {"b": b, "g": float(10 ** rng.uniform(-1.5, 0)) * b, "c": float(rng.uniform(0, 20))}
    law = {"law": "robust-ilc", "eta": float(rng.uniform(30, 300)), **relay, **UNLEARNED}
    sensor = {"kind": "absolute", "bits": 24, "speed_method": "M"}
    changes = {
        "controller.law": law,
        "mechanics.inertia": f"{10 ** rng.uniform(-4.5, -3.5)} kg*m^2",
        "drive.rates.speed_loop": f"{rng.choice([1000, 2500, 5000])} Hz",
        "drive.current_loop.bandwidth": f"{rng.uniform(300, 1000)} Hz",
        "drive.position_sensor": {"kind": "ideal"} if rng.random() < 0.5 else sensor,
        "scenario.run.duration": "1 s",
    }
    study = cogless.load(HERE / "criterion.toml", changes)
    assert isinstance(study, Study)
    return study


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, ratios = np.random.default_rng(options.seed), []
    for _ in range(options.cases):
        study = drawn(rng)
        found = switching(study, "run", "law")
        if found is None:
            continue
        omega = cogless.run_study(study, ["run/law"]).runs[0].trace["omega_m"]
        ratios.append(float(np.std(omega[len(omega) // 2 :])) / found.ripple)
    shares = " ".join(f"{x:.2f}" for x in np.quantile(ratios, [0, 0.1, 0.5, 0.9, 1]))
    print(f"{len(ratios)} of {options.cases} loops are stable. Ripple simulated / predicted: {shares}")
    print("(least, 10 %, median, 90 %, most)")


if __name__ == "__main__":
    main()
