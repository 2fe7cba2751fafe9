"""Tables that compare Liu's published values with ours, for docs/studies/liu2018.md.

    cogless run liu2018 -o results/liu2018
    python docs/liu2018_tables.py --write results/liu2018/results.json

Without --write the tables are printed. The published values are in this file. Our values come from
results.json, except that robust ILC without some of its terms is run here (seconds).
"""

from __future__ import annotations

from pathlib import Path

from marked import RPM, Blocks, Metrics, main, metrics_of, number, table

import cogless

LABELS = {"pi": "PI", "pi-fair": "PI, fair", "pi-ilc": "PI-ILC", "robust-ilc": "Robust ILC"}

# Tables II, IV and VII: for each controller the amplitudes of orders 1, 2 and 6 of the speed, r/min.
HARMONICS: dict[str, tuple[str, dict[str, tuple[float, float, float]]]] = {
    "II": (
        "900-rpm",
        {"pi": (2.49, 0.20, 0.89), "pi-ilc": (0.35, 0.10, 0.83), "robust-ilc": (0.18, 0.13, 0.60)},
    ),
    "IV": (
        "60-rpm",
        {"pi": (1.25, 1.38, 4.87), "pi-ilc": (1.14, 0.725, 1.92), "robust-ilc": (0.87, 0.72, 0.46)},
    ),
    "VII": (
        "60-rpm-78-load",
        {"pi": (1.52, 2.89, 6.98), "pi-ilc": (1.27, 2.60, 4.85), "robust-ilc": (0.93, 1.62, 2.49)},
    ),
}

# Table VIII: for each row (PI-ILC, robust ILC).
STEPS: dict[str, tuple[str, dict[str, tuple[float, float]]]] = {
    "VIII": (
        "900-rpm-step",
        {
            "maximum speed fluctuation [r/min]": (38, 20),
            "speed adjustment time [s]": (0.7, 0.38),
            "overshoot in i_q [A]": (0.65, 0.18),
        },
    ),
}
STEP_METRICS = {
    "maximum speed fluctuation [r/min]": ("dip_rad_s", RPM),
    "speed adjustment time [s]": ("settling_s", 1.0),
    "overshoot in i_q [A]": ("current_overshoot_A", 1.0),
}


def harmonics(metrics: Metrics, name: str) -> list[str]:
    """Table II, IV or VII; each value's ratio to PI's is in brackets."""
    scenario, published = HARMONICS[name]

    def ours(controller: str) -> list[float] | None:
        values = metrics.get((scenario, controller), {}).get("speed_order_rad_s")
        return values and [value / RPM for value in values]

    base = ours("pi")
    rows = []
    for controller, label in LABELS.items():
        mine = ours(controller)
        cells = [label]
        for k in range(3):
            paper = published.get(controller)
            cells.append(_with_ratio(paper and paper[k], published["pi"][k], controller))
            cells.append(_with_ratio(mine and mine[k], base and base[k], controller))
        rows.append(cells)
    head = ["r/min", *(text for n in (1, 2, 6) for text in (f"{n}: paper", f"{n}: ours"))]
    return table(head, rows)


def _with_ratio(value: float | None, base: float | None, controller: str) -> str:
    if value is None:
        return "-"
    digits = 3 if value >= 0.01 else 2
    ratio = f" ({value / base:.2f})" if base and controller != "pi" else ""
    return number(value, digits) + ratio


def steps(metrics: Metrics, name: str) -> list[str]:
    """Table VIII: the response to a load step."""
    scenario, published = STEPS[name]
    rows = []
    for title, (ilc, robust) in published.items():
        metric, scale = STEP_METRICS[title]
        cells = [title]
        for controller, paper in (("pi", None), ("pi-fair", None), ("pi-ilc", ilc), ("robust-ilc", robust)):
            if controller in ("pi-ilc", "robust-ilc"):
                cells.append(number(paper))
            values = metrics[scenario, controller]
            cells.append("never" if values[metric] is None else number(values[metric] / scale))
        rows.append(cells)
    head = [
        "",
        "PI: ours",
        "PI, fair: ours",
        "PI-ILC: paper",
        "PI-ILC: ours",
        "robust: paper",
        "robust: ours",
    ]
    return table(head, rows)


def beyond(metrics: Metrics) -> list[str]:
    """Law (29) with a lead of 2 ms, as `cogless design` proposes it, against the other controllers."""
    labels = {**LABELS, "pi-ilc-lead": "PI-ILC with a lead of 2 ms"}
    rows = []
    for controller, label in labels.items():
        found = [
            metrics.get((scenario, controller), {}) for scenario in ("60-rpm", "60-rpm-78-load", "900-rpm")
        ]
        if not all(found):
            continue
        rows.append([label, *(number(values["speed_ripple_rad_s"] / RPM) for values in found)])
    return table(["rms, r/min", "60 r/min", "60 r/min, 78 %", "900 r/min"], rows)


def without(metrics: Metrics) -> list[str]:
    """Results of robust ILC with some of its terms switched off."""
    study = cogless.load("liu2018")
    off = {
        "as published": {},
        "no learning, no adaptation ($q = \\gamma = 0$)": {
            "controller.robust-ilc.q": 0.0,
            "controller.robust-ilc.gamma": 0.0,
        },
        "no relay ($g = 0$)": {"controller.robust-ilc.g": 0.0},
    }
    scenarios = ("60-rpm", "60-rpm-78-load", "60-rpm-step")
    rows = []
    for text, changes in off.items():
        variant = cogless.changed(study, changes)
        found = cogless.run_study(variant, [f"{scenario}/robust-ilc" for scenario in scenarios], jobs=2)
        by_scenario = {run.scenario: run.metrics for run in found.runs}
        empty, loaded = (by_scenario[scenario]["speed_order_rad_s"] for scenario in scenarios[:2])
        orders = [number(value / RPM) for value in (*empty, loaded[-1])]
        rows.append([text, *orders, number(by_scenario["60-rpm-step"]["dip_rad_s"] / RPM)])
    head = [*(f"no load: {n}" for n in (1, 2, 6)), "78 %: 6", "dip [r/min]"]
    return table(["60 r/min, orders in r/min", *head], rows)


def blocks(path: Path) -> Blocks:
    metrics = metrics_of(path)
    return {
        **{f"table-{name}": harmonics(metrics, name) for name in HARMONICS},
        **{f"table-{name}": steps(metrics, name) for name in STEPS},
        "without": without(metrics),
        "beyond": beyond(metrics),
    }


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "liu2018.md", blocks)
