"""Table of the ripple that knowledge and learning leave on the bench, for docs/studies/on-the-bench.md.

cogless run on-the-bench -o results/on-the-bench
python docs/on_the_bench_tables.py --write results/on-the-bench/results.json
"""

from __future__ import annotations

from pathlib import Path

from marked import RPM, Blocks, main, metrics_of, number, table

import cogless

METRICS = {  # name in results.json: what the row adds to the scenario's name
    "ripple_at_first_rad_s": "first",
    "speed_ripple_rad_s": "last",
    "speed_ripple_as_measured_rad_s": "last, as measured",
}
ONLY = {"first": "as-known", "last, as measured": "eccentric"}  # the one scenario with such a row


def blocks(path: Path) -> Blocks:
    study, metrics = cogless.load("on-the-bench"), metrics_of(path)
    rows = []
    for scenario in study.scenario:
        for name, text in METRICS.items():
            if ONLY.get(text, scenario) != scenario:
                continue
            found = [metrics.get((scenario, c), {}).get(name) for c in study.controller]
            values = ["-" if value is None else number(value / RPM, 2) for value in found]
            rows.append([f"{scenario}, {text}", *values])
    return {"ripple": table(["rms, r/min", *(study.label(c) for c in study.controller)], rows)}


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "on-the-bench.md", blocks)
