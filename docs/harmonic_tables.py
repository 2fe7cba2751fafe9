"""Table of what the law `harmonic` reaches with a wrong model, for docs/laws/harmonic.md.

python docs/harmonic_tables.py            print the table
python docs/harmonic_tables.py --write    put it into the page
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from marked import RPM, number, replaced, table

import cogless
from cogless.run.simulate import simulate

PAGE = Path(__file__).parent / "laws" / "harmonic.md"
LAWS: dict[str, Any] = {
    "controller.harmonic": {"law": "harmonic", "tuning": {"rule": "auto"}},
    "controller.same": {"law": "pi", "tuning": {"rule": "phase-margin", "phase_margin": "45 deg"}},
}
WINDOW, BELOW, LAST = 0.25, 1.0, 4.0  # s, r/min, s
Case = tuple[str, str, str, dict[str, Any]]  # name, study, scenario, changes


def untold(scenario: str, **changes: Any) -> dict[str, Any]:
    """Changes of one scenario that its controllers aren't told."""
    key = f"scenario.{scenario}.override"
    return {key: {name.replace("__", "."): value for name, value in changes.items()}}


ECC = "drive__position_sensor__eccentricity"
WRONG: list[Case] = [
    ("as it is", "uomodri", "1-rev-s", {}),
    ("J half", "uomodri", "1-rev-s", untold("1-rev-s", mechanics__inertia="3.0e-6 kg*m^2")),
    ("J 1.5 times", "uomodri", "1-rev-s", untold("1-rev-s", mechanics__inertia="9.0e-6 kg*m^2")),
    ("K_t half", "uomodri", "1-rev-s", untold("1-rev-s", motor__kv="600 rpm/V")),
    ("K_t 1.5 times", "uomodri", "1-rev-s", untold("1-rev-s", motor__kv="200 rpm/V")),
    ("a sample of delay", "uomodri", "1-rev-s", untold("1-rev-s", drive__bus__delay_command="0.2 ms")),
    ("the same at 240 r/min", "uomodri", "fast", untold("fast", drive__bus__delay_command="0.2 ms")),
    ("0.5 deg of eccentricity", "uomodri", "1-rev-s", untold("1-rev-s", **{ECC: "0.5 deg"})),
    ("0.5 deg at 240 r/min", "uomodri", "fast", untold("fast", **{ECC: "0.5 deg"})),
    ("0.5 deg, uomodri-varying", "uomodri-varying", "varying", untold("varying", **{ECC: "0.5 deg"})),
    ("0.2 deg, Liu, 60 r/min", "liu2018", "60-rpm", untold("60-rpm", **{ECC: "0.2 deg"})),
    ("0.2 deg, Liu, 900 r/min", "liu2018", "900-rpm", untold("900-rpm", **{ECC: "0.2 deg"})),
    ("no cogging", "uomodri", "1-rev-s", untold("1-rev-s", motor__cogging=[])),
]  # fmt: skip


def changed(case: Case) -> cogless.Study:
    """A case's study, with the laws added."""
    _, study, scenario, changes = case
    here = cogless.load(study).scenario[scenario].controllers
    chosen = {f"scenario.{scenario}.controllers": [*here, "harmonic", "same"]} if here else {}
    made = cogless.load(study, {**LAWS, **chosen, **changes})
    assert isinstance(made, cogless.Study)
    return made


def measured(case: Case, name: str) -> tuple[float, float | None]:
    """The rms speed error over the last 4 s, r/min, and the time until it is below 1 r/min in 1/4 s, s."""
    trace = simulate(changed(case), case[2], name).trace
    time, error = np.asarray(trace["time"]), np.asarray(trace["omega_m"] - trace["omega_ref"]) / RPM
    rest = error[time >= time[-1] - LAST]
    constant = np.ptp(trace["omega_ref"]) == 0
    left = float(np.std(rest) if constant else np.sqrt(np.mean(rest**2)))
    window = round(WINDOW / (time[1] - time[0]))
    parts = error[: len(error) // window * window].reshape(-1, window).std(axis=1)
    below = np.flatnonzero(parts < BELOW)
    return left, (WINDOW * (int(below[0]) + 1) if len(below) else None)


def wrong() -> list[str]:
    rows = []
    for case in WRONG:
        (without, _), (left, time) = measured(case, "same"), measured(case, "harmonic")
        rows.append([case[0], number(without, 2), number(left, 2), number(time, 3)])
        print(*rows[-1], file=sys.stderr, flush=True)
    return table(["rms, r/min", "same PI", "harmonic", "s to 1 r/min"], rows)


def main() -> None:
    blocks = {"wrong": wrong()}
    if "--write" in sys.argv:
        PAGE.write_text(replaced(PAGE.read_text(encoding="utf-8"), blocks), encoding="utf-8")
    for name, lines in blocks.items():
        print(f"## {name}\n", *lines, "", sep="\n")


if __name__ == "__main__":
    main()
