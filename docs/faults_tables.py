"""The table of ripple and current for each fault, for docs/studies/faults.md.

cogless run faults -o results/faults
python docs/faults_tables.py --write results/faults/results.json
"""

from __future__ import annotations

from pathlib import Path

from marked import RPM, Blocks, main, metrics_of, number, table

import cogless

LEARNING = ("pi-ilc", "robust-ilc")
RIPPLE = {"ripple_after_rad_s": "2.5 s after", "ripple_later_rad_s": "10.5 s after"}


def blocks(path: Path) -> Blocks:
    study, metrics = cogless.load("faults"), metrics_of(path)
    rows = []
    for scenario in study.scenario:
        left = [number(metrics[scenario, law][name] / RPM) for law in LEARNING for name in RIPPLE]
        current = max(metrics[scenario, law]["largest_current_A"] for law in study.controller)
        rows.append([scenario, *left, number(current)])
    after, later = RIPPLE.values()
    head = [text for law in LEARNING for text in (f"{study.label(law)}: {after}", later)]
    return {"ripple": table(["", *head, "largest current [A]"], rows)}


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "faults.md", blocks)
