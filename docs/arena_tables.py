"""Tables of the arena for docs/studies/arena.md: scores, costs, and the ripple on each plant.

cogless run arena --limits -o results/arena
python docs/arena_tables.py --write results/arena/results.json
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from marked import Blocks, main, number, table
from pil_tables import CASES, LAW_ALONE
from pil_tables import PAGE as COSTS

import cogless
from cogless.ensemble.arena_scores import RPM, SCORE_COLUMNS, Scores
from cogless.results.limits import AND, CAUSES
from cogless.run.suspects import LONGER_FACTOR
from cogless.study.toml import toml

ON_PAGE = {name: column for name, column in SCORE_COLUMNS.items() if name not in ("orders", "copper_loss")}
SHOWN = ("table", "pi-afc", "harmonic")  # laws whose ripple is shown on each plant
NAMED = 2  # causes in `limits`
GROWN = 1.05  # times the ripple at the end of learning: more is growth; the bar's own differs by 1 %


def costs() -> dict[str, tuple[str, str]]:
    """Instructions (mean, of the law) and RAM in bytes of each law, from the guide's table; the first case
    counts.
    """
    rows = _rows(COSTS.read_text(encoding="utf-8"), "costs")
    found: dict[str, tuple[str, str]] = {}
    for name, study, _, controller, changes in CASES:
        law = getattr(cogless.load(study, changes).controller[controller], "law", "")
        if name in rows:
            found.setdefault(law, (rows[name][LAW_ALONE].split(" / ")[0], rows[name]["RAM"]))
    return found


def _rows(page: str, block: str) -> dict[str, dict[str, str]]:
    """The rows of a generated table: first cell -> heading -> cell."""
    text = re.search(rf"<!-- begin {block} -->\n(.*?)<!-- end", page, re.DOTALL)
    assert text is not None
    cells = [[c.strip() for c in line.strip("| ").split("|")] for line in text[1].splitlines() if "|" in line]
    head, _, *rows = cells
    return {row[0]: dict(zip(head, row, strict=True)) for row in rows}


def main_table(scores: Scores) -> list[str]:
    known, rows = costs(), []
    best = {column: scores.winners(column) for column in ON_PAGE}
    for law in scores.laws:
        cells = [
            scores.unscored(column, law) if score is None else _cell(score, law in best[column])
            for column in ON_PAGE
            for score in [scores.score(column, law)]
        ]
        spent = known.get(scores.content["laws"][law]["law"], ("-", "-"))
        rows.append([scores.label(law), *cells, *spent, str(scores.met(law))])
    head = ["law", *(c.title for c in ON_PAGE.values()), "instructions", "RAM", "plants"]
    return table(head, rows)


def _cell(value: float, bold: bool) -> str:
    text = number(value) if math.isfinite(value) else "∞"
    return f"**{text}**" if bold else text


def growth(scores: Scores) -> list[str]:
    """A line for each law whose ripple an hour later is higher than once it had learned."""
    found = []
    for plant, law in product(scores.plants, scores.laws):
        late = scores.value("after_hour", plant, law)
        early = scores.value("ripple", plant, law, scores.seeds[:1])
        if late is not None and early is not None and late > GROWN * early:
            found.append(f"- {scores.label(law)} on {plant}: {number(late / early)} times")
    return found or ["- none"]


def plant_table(scores: Scores) -> list[str]:
    """What each plant is, the ripple on it of the bar and of `SHOWN`, and its best law."""
    value, column = partial(scores.value, "ripple"), SCORE_COLUMNS["ripple"]
    shown = (scores.bar, *SHOWN)
    rows = []
    for plant in scores.plants:
        about = str(scores.content["plants"][plant]["about"])
        best = scores.best(partial(value, plant))[:1]
        found = [value(plant, law) for law in (*shown, *best)]
        cells = ["-" if left is None else number(left / column.scale) for left in found]
        cells += [f"{scores.label(best[0])}: {cells.pop()}" if best else "-"]
        rows.append([f"`{plant}`", f"{about[0].upper()}{about[1:]}", *cells])
    return table(["plant", "what it is", *map(scores.label, shown), "best law"], rows)


def limit_table(content: Mapping[str, Any], scores: Scores) -> list[str]:
    """Rows with the best law of a plant, what limits it and what helps most, all from runs.

    Plants without a change that helps are left out.
    """
    rows = []
    for found in content["limits"]:
        shares = {each["cause"]: each["share"] for each in found["causes"]}
        causes = [f"{_cause(name)} ({100 * shares[name]:.0f} %)" for name in found["named"][:NAMED]] or [
            "no single one"
        ]
        helps = [
            f"{_set(each['set'])} leaves {number(each['value'] / RPM)}" for each in found["helps"].values()
        ]
        if helps:
            left = number(found["value"] / RPM)
            rows.append(
                [found["plant"], scores.label(found["law"]), left, "; ".join(causes), "; ".join(helps)]
            )
    return table(["plant", "least ripple", "r/min", "what limits it", "what would help"], rows)


def _cause(name: str) -> str:
    return " and ".join(CAUSES[each] for each in name.split(AND))


def _set(changes: Mapping[str, Any]) -> str:
    """Changes in the notation of `--set`; for a longer run, words on the time to learn."""
    if any(key.endswith(".duration") for key in changes):
        return f"{LONGER_FACTOR} times as long to learn"
    return f"`{', '.join(f'{key} = {toml(value)}' for key, value in changes.items())}`"


def blocks(path: Path) -> Blocks:
    content = json.loads(path.read_text(encoding="utf-8"))
    scores = Scores(content)
    return {
        "scores": main_table(scores),
        "hour": growth(scores),
        "plants": plant_table(scores),
        "limits": limit_table(content, scores),
    }


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "arena.md", blocks)
