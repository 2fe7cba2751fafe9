"""Tables for the guide: what each law costs on a Cortex-M4F, and whether it computes the simulation's values.

python docs/pil_tables.py            print the tables; exit 1 where anything differs from the simulation
python docs/pil_tables.py --write    put them into docs/guide/microcontroller.md

`make pil` does the latter. Studies in double precision are run in single precision here, like on the
processor, and all that learns has its guard.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from afc_tables import figure_changes
from marked import replaced, table

from cogless import load
from cogless.control_library import C_LAWS
from cogless.export.prepared import first_scenario
from cogless.pil.compare import Comparison, compare
from cogless.pil.processor import require
from cogless.pil.toolchain import find
from cogless.study.reading import changes_from

PAGE = Path(__file__).parent / "guide" / "microcontroller.md"
TICKS = 100_000
SINGLE = {"drive.precision": "single"}
AUTO = {"law": "harmonic", "tuning": {"rule": "auto"}}
GUARDED = {"drive.guard": True}  # the study shows laws as they are printed
SLOW = {"scenario.60-rpm.reference": "30 rpm", "scenario.60-rpm.initial_speed": "30 rpm"}
FIVE, MOTORS = "`harmonic`, five orders", "`harmonic`, all orders of `uomodri`"
MOTEUS = 888  # instructions of its period in position mode with a table
Case = tuple[str, str, str | None, str, dict[str, Any]]
# For each case: name, study, scenario (None: the first), controller, changes of the study.
CASES: list[Case] = [
    ("`pi`", "liu2018", None, "pi", {}),
    ("`adrc`", "uomodri", None, "adrc", figure_changes("adrc")),
    ("`pi-ilc`, map at 30 r/min", "liu2018", "60-rpm", "pi-ilc", GUARDED | SLOW),
    ("`pi-ilc`, map at 900 r/min", "liu2018", "900-rpm", "pi-ilc", GUARDED),
    ("`pi-ilc`, by time", "liu2018-varying", None, "time", {}),
    ("`robust-ilc`, map at 30 r/min", "liu2018", "60-rpm", "robust-ilc", GUARDED | SLOW),
    ("`robust-ilc`, map at 900 r/min", "liu2018", "900-rpm", "robust-ilc", GUARDED),
    ("`anti-cogging`", "uomodri", None, "table", {}),
    ("`pi-afc`, thirteen orders", "uomodri", None, "pi-afc", figure_changes("pi-afc")),
    (MOTORS, "uomodri", None, "harmonic", {"controller.harmonic": AUTO}),
    (FIVE, "uomodri", None, "harmonic", {"controller.harmonic": {**AUTO, "base": 80}}),
    ("`space-speed`, map", "verrelli2016-speed", None, "learning", SINGLE),
    ("`space-position`, map", "verrelli2016", None, "filtered", SINGLE),
    ("`space-position`, by delay", "verrelli2016", None, "printed", SINGLE),
    ("`trial-ilc`", "mandra2019", None, "ilc", {}),
    ("`observer-ilc`", "mandra2019", None, "observer", {}),
    ("`microstepping`", "printer", None, "table", SINGLE),
]
RUN_FIGURE = re.compile(r"^```{run-figure} (\S+) (.+)\n(?::set: (.*))?", re.MULTILINE)


def cases() -> list[Case]:
    """CASES, and behind them the run of the first figure of each law that has no case there."""
    named = {load(study, changes).controller[name].row for _, study, _, name, changes in CASES}
    return CASES + [(law, *first_figure(law)) for law in C_LAWS if law not in named]


def first_figure(law: str) -> tuple[str, str | None, str, dict[str, Any]]:
    """Study, scenario, controller and changes of the law's run in the first figure on its page."""
    page = (PAGE.parents[1] / "laws" / f"{law}.md").read_text(encoding="utf-8")
    figure = RUN_FIGURE.search(page)
    assert figure is not None, f"docs/laws/{law}.md has no run-figure"
    study, runs, change = figure.groups()
    changes = changes_from([change] if change else [])
    laws = {name: controller.row for name, controller in load(study, changes).controller.items()}
    parted = (run.rpartition("/") for run in runs.split())
    scenario, _, name = next(parts for parts in parted if laws[parts[2]] == law)
    return study, scenario or None, name, changes


OTHERS = {"foc", "modulation", "drive", "monitor", "quality", "guard", "real"}  # sources that are no law's
LAW_ALONE = "law alone"


def measured(case: Case) -> Comparison:
    _, study, scenario, controller, changes = case
    loaded = load(study, changes)
    return compare(loaded, controller, first_scenario(loaded, controller, scenario), TICKS, find("gcc"))


def law_alone(by_source: Mapping[str, float]) -> float:
    """Instructions of the law and its memory, without current loop, checks and other code around it."""
    return sum(
        n for source, n in by_source.items() if source not in OTHERS and not source.endswith("_controller")
    )


def cost_table(results: dict[str, Comparison]) -> list[str]:
    head = ["law", "whole period", LAW_ALONE, "flash", "RAM", "stack"]
    rows = []
    for name, r in results.items():
        mean, most = (law_alone(by) for by in (r.by_source_with_law, r.most_by_source_with_law))
        sizes = (f"{n:,}" for n in (r.flash, r.ram, r.stack))
        with_law = f"{r.with_law.mean:.0f} / {r.with_law.most}"
        rows.append([name, with_law, f"{mean:.0f} / {most:.0f}", *sizes])
    return table(head, rows)


def scale(results: dict[str, Comparison]) -> str:
    """How long a period with `harmonic` takes beside one of moteus."""
    five, motors = (f"{results[name].with_law.mean / MOTEUS:.1f}" for name in (FIVE, MOTORS))
    return (
        f"A period of the moteus firmware took {MOTEUS} instructions. A period in which `harmonic` runs "
        f"takes {five} times as many with five orders, and {motors} times as many with all orders of "
        "`uomodri`."
    )


def main() -> None:
    require()
    all_cases = cases()
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(measured, all_cases))
    results = {case[0]: one for case, one in zip(all_cases, found, strict=True)}
    blocks = {
        "costs": cost_table(results),
        "scale": [scale(results)],
        "compiler": [f"The code is compiled by {found[0].compiler} with `-O2`."],
    }
    if "--write" in sys.argv:
        PAGE.write_text(replaced(PAGE.read_text(encoding="utf-8"), blocks), encoding="utf-8")
    else:
        for name, lines in blocks.items():
            print(f"## {name}\n", *lines, "", sep="\n")
    for name, one in results.items():
        if (d := one.difference) is not None:
            sys.exit(f"{name}: differs in period {d.tick}: {d.field}")


if __name__ == "__main__":
    main()
