"""Tables that compare Mandra's published values with ours, for docs/studies/mandra2019.md.

    cogless run mandra2019 -o results/mandra2019
    python docs/mandra2019_tables.py --write results/mandra2019/results.json

Without --write the tables are printed. The published values are in this file. Gains are those of
`cogless design`. Trials and errors come from results.json. The variations are run here (a minute).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from marked import Blocks, Metrics, main, metrics_of, number, table
from numpy.typing import NDArray

import cogless
from cogless.design.trials.trial_summary import summary, to_dict
from cogless.study import TrialStudy

STEP = 2 * math.pi / 2**14  # of the resolver, rad
STARTS, TRIALS = (1, 31, 61, 91), 500
PHASES = ("start", "31: load", "61: inertia", "91: all three")
LABELS = {
    "ilc": "Fig. 1",
    "ilc-input": "into the input only",
    "ilc-no-integral": "no integral action",
    "no-ilc": "no learning",
}
OBSERVER = {"ilc": "Fig. 1", "observer": "observer"}
# Trials to the floor after the load change: published ones, and those of an independent reproduction.
PUBLISHED = {"ilc": ("4", "2 to 5"), "ilc-input": ("14", "19 to 22")}

Errors = NDArray[np.float64]


def designed() -> dict[str, Any]:
    study = cogless.load("mandra2019")
    assert isinstance(study, TrialStudy)
    return to_dict(study, summary(study))


def gains(design: Mapping[str, Any]) -> list[str]:
    """The results of `cogless design` against the paper's."""
    ilc = design["controllers"]["ilc"]
    rows = [
        ["vertices", "6 of 8 corners", str(len(design["plant"]["vertices"]))],
        ["$K_s$ (39)", "-99.4484, -0.9270, 1.3916", _list(ilc["K_s"], 4)],
        ["$N$", "99.4484", f"{ilc['N']:.4f}"],
        ["$K_3$", "0.6942", f"{ilc['K_3']:.4f}"],
    ]
    return table(["", "paper", "ours"], rows)


def _list(values: Sequence[float], decimals: int) -> str:
    return ", ".join(f"{value:.{decimals}f}" for value in values)


def count(value: float | None) -> str:
    return "never" if value is None or not math.isfinite(value) else f"{value:.0f}"


def trials(metrics: Metrics) -> list[str]:
    """The number of trials after each change until the RMS error is at two resolver steps."""
    rows = []
    for name, label in LABELS.items():
        ours = metrics["table-1", name]["trials_to_floor"]
        rows.append([label, *PUBLISHED.get(name, ("-", "-")), *(count(n) for n in ours)])
    return table(["", "31: paper", "31: reproduction", *PHASES], rows)


def to_floor(rms: Errors, floor: float) -> str:
    """The number of trials after the load change until the RMS is at the floor, in resolver steps."""
    below = np.flatnonzero(rms[30:60] <= floor * STEP)
    return str(below[0] + 1) if len(below) else "never"


def observer(metrics: Metrics) -> list[str]:
    """Fig. 1 and the law with an observer: trials to the floor, first errors in resolver steps."""
    rows = []
    for name, label in OBSERVER.items():
        here = metrics["table-1", name]
        rows.append([f"{label}: trials to the floor", *(count(n) for n in here["trials_to_floor"])])
        rows.append([f"{label}: first trial, RMS", *(number(x / STEP) for x in here["first_error_rad"])])
    return table(["resolver steps", *PHASES], rows)


def run(changes: Mapping[str, Any], controllers: Sequence[str]) -> list[Any]:
    study = cogless.load("mandra2019", changes)
    return list(cogless.run_study(study, [f"table-1/{name}" for name in controllers], jobs=2).runs)


def variations() -> list[str]:
    """Trials to the floor after the load change, for variations of the structure into the input only."""
    here = "controller.ilc-input"
    cases: list[tuple[str, dict[str, Any]]] = [
        ("as shipped", {}),
        ("ideal sensor", {"drive.position_sensor": {"kind": "ideal"}}),
        ("filter on the signal", {f"{here}.q_filter.acts_on": "signal"}),
        ("$K_3$ = 1.2", {f"{here}.K_3": 1.2}),
    ]
    rows = []
    for text, changes in cases:
        (found,) = run(changes, ["ilc-input"])
        rms = np.array(found.metrics["error_rms_rad"])
        moved = changes.get(f"{here}.K_3", 0.6942) * 99.4484 / 1.3916
        rows.append([text, f"{moved:.1f}", *(to_floor(rms, floor) for floor in (2.0, 6.0))])
    return table(["", "samples a trial", "to 2 steps", "to 6 steps"], rows)


def real_loop() -> list[str]:
    """Results with real current loops, and with a longer window over which the speed is averaged."""
    cases: list[tuple[str, dict[str, Any]]] = [("ideal", {})]
    for bandwidth in ("800 Hz", "400 Hz"):
        changes = {
            "drive.current_loop": {"bandwidth": bandwidth, "current_limit": "30 A"},
            "drive.inverter": {"bus_voltage": "560 V", "computation_delay": 1},
        }
        cases.append((bandwidth, changes))
    cases.append(("ideal, speed window of 3 ms", {"drive.position_sensor.window": 24}))
    rows = []
    for text, changes in cases:
        found = {r.controller: r.metrics for r in run(changes, ["ilc", "no-ilc"])}
        ilc, alone = found["ilc"], found["no-ilc"]
        floor = ", ".join(count(n) for n in ilc["trials_to_floor"])
        settled = [f"{ilc['final_error_rad'][k] / STEP:.2f}" for k in (1, 3)]
        rows.append([text, floor, *settled, f"{alone['first_error_rad'][1] / STEP:.1f}"])
    head = [
        "current loop",
        "Fig. 1: trials to the floor",
        "31 to 60, steps",
        "91 to 500, steps",
        "no learning, 31, steps",
    ]
    return table(head, rows)


def blocks(path: Path) -> Blocks:
    metrics, design = metrics_of(path), designed()
    return {
        "gains": gains(design),
        "trials": trials(metrics),
        "observer": observer(metrics),
        "variations": variations(),
        "real-loop": real_loop(),
    }


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "mandra2019.md", blocks)
