"""Tables that compare Verrelli's published values with ours, for docs/studies/verrelli2016.md.

    cogless run verrelli2016 -o results/verrelli2016
    python docs/verrelli2016_tables.py --write results/verrelli2016/results.json

Without --write the tables are printed. The values for section 5 come from results.json. Section 4 and the
other phase margins are run here (a minute).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from marked import Blocks, Metrics, main, metrics_of, number, table

import cogless
from cogless.design.closed_loop import position_margins
from cogless.design.laws.space_bounds import feedback_at, position_gains
from cogless.design.speed_loop import speed_loop

LABELS = {
    "pi": "PI, as published",
    "fair": "PI, fair",
    "printed": "printed scheme",
    "filtered": "filtered map",
    "filtered-fair": "filtered map on the fair PI",
}
SHORT, LONG = "twelve-seconds", "two-minutes"
BEFORE_AND_AFTER = ("speed_before_rad_s", "speed_after_rad_s", "angle_before_rad", "angle_after_rad")
TIMES = (20, 30, 120)
MARGINS = (30, 45, 60)


def section_5(metrics: Metrics) -> list[str]:
    """Errors, peak to peak and electrical, before and after learning began, and the largest current."""
    rows = [
        ["paper", "0.72", "0.081", "0.03", "0.006", "-"],
        ["reproduction, printed scheme", "0.805", "0.0716", "0.0387", "0.0105", "below 9"],
    ]
    for controller, label in LABELS.items():
        found = metrics[SHORT, controller]
        rows.append([label, *(number(found[name]) for name in (*BEFORE_AND_AFTER, "current_peak_A"))])
    head = ["speed, 3 to 5 s", "8 to 10 s", "angle, 3 to 5 s", "8 to 10 s", "largest i_q [A]"]
    return table(["peak to peak, electrical [rad/s], [rad]", *head], rows)


def two_minutes(metrics: Metrics) -> list[str]:
    """The speed error, peak to peak over the two seconds before each of `TIMES`."""
    rows = []
    for controller, label in LABELS.items():
        found = metrics[LONG, controller]
        rows.append([label, *(number(found[f"speed_{t}_s_rad_s"]) for t in TIMES)])
    return table(["speed, peak to peak, electrical [rad/s]", *(f"{t} s" for t in TIMES)], rows)


def margins() -> list[str]:
    """The fair PI at other phase margins, without learning and as the feedback of the filtered map."""
    rows = []
    for margin in (None, *MARGINS):
        name, changes = (
            ("fair", {"controller.fair.tuning.phase_margin": f"{margin} deg"}) if margin else ("pi", {})
        )
        study = cogless.load("verrelli2016", changes)
        gains = position_gains(study, name)
        crossover = position_margins(speed_loop(study), feedback_at(study, name, 0.0)).crossover
        (run,) = cogless.run_study(study, [f"{SHORT}/{name}"]).runs
        label = f"{margin}°" if margin else "as published"
        speed, angle = (str(number(run.metrics[k])) for k in ("speed_after_rad_s", "angle_after_rad"))
        learned = "-"
        if margin:
            key = "controller.filtered-fair"
            more = {f"{key}.tuning.phase_margin": f"{margin} deg", f"{key}.mu_alpha": 50 * gains[1]}
            learner = cogless.load("verrelli2016", more)
            (other,) = cogless.run_study(learner, [f"{SHORT}/filtered-fair"]).runs
            learned = number(other.metrics["speed_after_rad_s"])
        rows.append([label, f"{crossover / (2 * np.pi):.0f}", speed, angle, learned])
    errors = ("speed, 8 to 10 s [rad/s]", "angle, 8 to 10 s [rad]", "speed with learning [rad/s]")
    return table(["PI", "crossover [Hz]", *errors], rows)


def section_4() -> list[str]:
    """The angle error in some turns of the arm."""
    study = cogless.load("verrelli2016-position")
    found = {run.controller: run.metrics for run in cogless.run_study(study, jobs=2).runs}
    rows = []
    for metric, text in (("first_turn", "first turn"), ("turn_4", "turn 4"), ("turn_40", "turn 40")):
        rows.append([text, *(_plain(found[name][f"angle_{metric}_rad"]) for name in study.controller)])
    return table(["rad", *(study.label(name) for name in study.controller)], rows)


def varying() -> list[str]:
    """The speed ripple in the two studies of PMSMs at varying speed."""
    rows: dict[str, list[str]] = {}
    for name in ("uomodri-varying", "liu2018-varying"):
        study = cogless.load(name)
        for run in cogless.run_study(study, jobs=2).runs:
            found = number(run.metrics["speed_ripple_rad_s"])
            rows.setdefault(study.label(run.controller), []).append(found)
    return table(
        ["speed ripple, rms [rad/s]", "`uomodri-varying`", "`liu2018-varying`"],
        [[label, *cells] for label, cells in rows.items()],
    )


def _plain(value: float) -> str:
    return f"{value:.2e}" if abs(value) < 1e-3 else number(value)


def blocks(path: Path) -> Blocks:
    metrics = metrics_of(path)
    return {
        "section-5": section_5(metrics),
        "two-minutes": two_minutes(metrics),
        "margins": margins(),
        "varying": varying(),
        "section-4": section_4(),
    }


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "verrelli2016.md", blocks)
