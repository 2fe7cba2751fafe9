"""Table of uomodri's speed ripple with learned orders and with a learned map, for docs/laws/pi-afc.md.

python docs/afc_tables.py            print the table
python docs/afc_tables.py --write    put it into the page

The study has the same change (`:set:`) as the page's figure.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from marked import RPM, number, replaced, table

import cogless
from cogless.study.reading import changes_from

PAGE = Path(__file__).parent / "laws" / "pi-afc.md"
CONTROLLERS = ("pi", "pi-ilc", "pi-afc")
SCENARIOS = {"slow": "0.25", "1-rev-s": "1", "fast": "4"}
SENSORS: dict[str, dict[str, Any]] = {
    "as in the study": {},
    "without dead time": {"drive.inverter.dead_time": "0 s"},
}


def figure_changes(law: str) -> dict[str, Any]:
    """The change of the study that the figure on a law's page has in its option `:set:`."""
    page = (PAGE.parent / f"{law}.md").read_text(encoding="utf-8")
    found = re.search(r"^:set: (.*)$", page, re.MULTILINE)
    assert found is not None
    return changes_from([found[1]])


def rows() -> list[list[str]]:
    made = []
    for text, changes in SENSORS.items():
        study = cogless.load("uomodri", {**changes, **figure_changes(PAGE.stem)})
        only = [f"{scenario}/{name}" for scenario in SCENARIOS for name in CONTROLLERS]
        metrics = {(r.scenario, r.controller): r.metrics for r in cogless.run_study(study, only).runs}
        for scenario, speed in SCENARIOS.items():
            ripple = [metrics[scenario, name]["speed_ripple_rad_s"] for name in CONTROLLERS]
            made.append([text, speed, *(number(value / RPM, 2) for value in ripple)])
    return made


def main() -> None:
    lines = table(["", "rev/s", *(f"{law}, rms" for law in ("PI", "PI-ILC", "PI-AFC"))], rows())
    if "--write" in sys.argv:
        PAGE.write_text(replaced(PAGE.read_text(encoding="utf-8"), {"afc": lines}), encoding="utf-8")
    else:
        print(*lines, sep="\n")


if __name__ == "__main__":
    main()
