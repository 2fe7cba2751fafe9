"""Tables of ripple and current for each fault and controller, for docs/studies/faults.md.

cogless run faults -o results/faults
python docs/faults_tables.py --write results/faults/results.json
"""

from __future__ import annotations

from pathlib import Path

from marked import RPM, Blocks, main, metrics_of, number, table

import cogless

METRICS = {  # name in results.json: (column heading, SI value of the unit)
    "ripple_before_rad_s": ("before", RPM),
    "ripple_after_rad_s": ("2.5 s after", RPM),
    "ripple_later_rad_s": ("10.5 s after", RPM),
    "largest_current_A": ("largest current [A]", 1.0),
}


def blocks(path: Path) -> Blocks:
    study, metrics = cogless.load("faults"), metrics_of(path)
    found = {}
    for controller in study.controller:
        rows = []
        for scenario in study.scenario:
            values = metrics[scenario, controller]
            rows.append([scenario, *(number(values[name] / scale) for name, (_, scale) in METRICS.items())])
        found[controller] = table([study.label(controller), *(text for text, _ in METRICS.values())], rows)
    return found


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "faults.md", blocks)
