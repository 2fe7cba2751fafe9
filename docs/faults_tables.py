"""The table of ripple and current for each fault, for docs/studies/faults.md.

cogless run faults -o results/faults
python docs/faults_tables.py --write results/faults/results.json
"""

from __future__ import annotations

from pathlib import Path

from marked import RPM, Blocks, main, metrics_of, number, table

import cogless

LEARNING = ("pi-ilc", "robust-ilc")
RIPPLE = "ripple_after_rad_s"


def blocks(path: Path) -> Blocks:
    study, metrics = cogless.load("faults"), metrics_of(path)
    rows = []
    for scenario in study.scenario:
        left = [number(metrics[scenario, law][RIPPLE] / RPM) for law in LEARNING]
        current = max(metrics[scenario, law]["largest_current_A"] for law in study.controller)
        rows.append([scenario, *left, number(current)])
    return {"ripple": table(["", *map(study.label, LEARNING), "largest current [A]"], rows)}


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "faults.md", blocks)
