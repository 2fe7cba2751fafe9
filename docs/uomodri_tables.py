"""Tables of uomodri's speed ripple and other metrics by controller and speed, for docs/studies/uomodri.md.

cogless run uomodri -o results/uomodri
python docs/uomodri_tables.py --write results/uomodri/results.json
"""

from __future__ import annotations

from pathlib import Path

from marked import RPM, Blocks, Metrics, main, metrics_of, number, table

import cogless

SCENARIOS = {"slow": "0.25 rev/s", "1-rev-s": "1 rev/s", "fast": "4 rev/s"}
METRICS = {  # name in results.json: (row heading, SI value of the unit)
    "speed_ripple_rad_s": ("speed ripple, rms [r/min]", RPM),
    "torque_ripple_N_m": ("torque ripple, rms [mN·m]", 1e-3),
    "copper_loss_W": ("copper loss [mW]", 1e-3),
    "chattering_A": ("chattering [mA]", 1e-3),
}


def ripple(metrics: Metrics, scenario: str) -> list[str]:
    study = cogless.load("uomodri")
    controllers = [c for c in study.controllers_in(scenario) if (scenario, c) in metrics]
    rows = []
    orders = next(m.order for m in study.metrics_in(scenario) if m.name == "speed_order") or ()
    for place, order in enumerate(orders):
        values = [metrics[scenario, c].get("speed_order_rad_s") for c in controllers]
        rows.append([f"order {order:g} [r/min]", *(number(v[place] / RPM) if v else "-" for v in values)])
    for name, (text, scale) in METRICS.items():
        found = [metrics[scenario, c].get(name) for c in controllers]
        rows.append([text, *("-" if v is None else number(v / scale) for v in found)])
    return table([SCENARIOS[scenario], *(study.label(c) for c in controllers)], rows)


def blocks(path: Path) -> Blocks:
    metrics = metrics_of(path)
    return {scenario: ripple(metrics, scenario) for scenario in SCENARIOS}


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "uomodri.md", blocks)
