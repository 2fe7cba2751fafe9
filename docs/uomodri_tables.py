"""The table of uomodri's ripple and copper loss by controller and speed, for docs/studies/uomodri.md.

cogless run uomodri -o results/uomodri
python docs/uomodri_tables.py --write results/uomodri/results.json
"""

from __future__ import annotations

from pathlib import Path

from marked import RPM, Blocks, main, metrics_of, number, table

import cogless

SCENARIOS = {"slow": "0.25 rev/s", "1-rev-s": "1 rev/s", "fast": "4 rev/s"}
ORDER = 72
METRICS = {  # name in results.json: (row heading, SI value of the unit)
    "speed_order_rad_s": (f"order {ORDER} [r/min]", RPM),
    "speed_ripple_rad_s": ("speed ripple, rms [r/min]", RPM),
    "copper_loss_W": ("copper loss [mW]", 1e-3),
}


def blocks(path: Path) -> Blocks:
    study, metrics = cogless.load("uomodri"), metrics_of(path)
    orders = next(m.order for m in study.metric if m.name == "speed_order") or ()
    place = orders.index(ORDER)
    rows = []
    for name, (text, scale) in METRICS.items():
        for scenario, speed in SCENARIOS.items():
            found = [metrics[scenario, c][name] for c in study.controller]
            values = [v[place] if isinstance(v, list) else v for v in found]
            rows.append([f"{speed}: {text}", *(number(v / scale) for v in values)])
    return {"ripple": table(["", *map(study.label, study.controller)], rows)}


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "uomodri.md", blocks)
