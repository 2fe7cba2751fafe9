"""Tables of the arena for docs/studies/arena.md: who wins each column, what it costs, and every plant.

cogless run arena --limits -o results/arena
python docs/arena_tables.py --write results/arena/results.json
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from marked import Blocks, main, number, table
from pil_tables import CASES
from pil_tables import PAGE as COSTS

import cogless
from cogless.ensemble.arena_scores import COLUMNS, RPM, Scores
from cogless.live.toml import text
from cogless.results.limits import AND, CAUSES
from cogless.run.causes import LONGER

TRIAL_COLUMNS = {
    "trials_to_floor": "trials to the floor, after each change",
    "first_error_rad": "first error [mrad]",
    "final_error_rad": "settled error [mrad]",
}
LEARNED_ON = 0.95  # times the bar: more ripple than that is no win of a law that learns
GROWN = 1.05  # times the ripple at the end of learning: more is growth; the bar's own differs by 1 %
LOSES = 1.02  # times the bar: worse than it


def costs() -> dict[str, tuple[str, str]]:
    """Instructions (mean, of the law) and RAM in bytes of each law, from the guide's tables; the first case
    counts.
    """
    page = COSTS.read_text(encoding="utf-8")
    rows = {name: _rows(page, name) for name in ("time", "memory")}
    found: dict[str, tuple[str, str]] = {}
    for name, study, _, controller, changes in CASES:
        law = getattr(cogless.load(study, changes).controller[controller], "law", "")
        if name in rows["time"] and name in rows["memory"]:
            found.setdefault(law, (rows["time"][name]["law"].split(" / ")[0], rows["memory"][name]["RAM"]))
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
    best = {column: scores.winners(column) for column in COLUMNS}
    for law in scores.laws:
        cells = [
            scores.unscored(column, law) if score is None else _cell(score, law in best[column])
            for column in COLUMNS
            for score in [scores.score(column, law)]
        ]
        spent = known.get(scores.content["laws"][law]["law"], ("-", "-"))
        rows.append([scores.label(law), *cells, *spent, str(scores.met(law))])
    head = ["law", *(c.title for c in COLUMNS.values()), "instructions", "RAM", "plants"]
    return table(head, rows)


def _cell(value: float, bold: bool) -> str:
    text = number(value) if math.isfinite(value) else "∞"
    return f"**{text}**" if bold else text


def winner_table(scores: Scores) -> list[str]:
    """The winner of each column, and where it is worse than the bar: its price."""
    known, rows = costs(), []
    for column, about in COLUMNS.items():
        winners = scores.winners(column)
        if not winners:
            continue
        law = winners[0]
        score = scores.score(column, law)
        dearer = [
            f"{COLUMNS[other].title} {number(value)} times"
            for other in COLUMNS
            if (value := scores.score(other, law)) is not None and value > LOSES
        ]
        lost = _lost(scores, column, law)
        instructions, ram = known.get(scores.content["laws"][law]["law"], ("-", "-"))
        price = [f"{instructions} instructions, {ram} bytes", *dearer, *lost]
        equals = ", ".join(scores.label(other) for other in winners[1:])
        name = scores.label(law) + (f" (as good: {equals})" if equals else "")
        rows.append(
            [about.title, name, f"{number(score)}", _better_on_fewer(scores, column, law), "; ".join(price)]
        )
    return table(
        ["column", "winner", "times the bar", "better on fewer plants", "what the winner costs"], rows
    )


def _better_on_fewer(scores: Scores, column: str, winner: str) -> str:
    """Laws that stayed away from some plants and beat the winner of a column on those that both were on."""
    found = []
    for law in scores.laws:
        both = [p for p in scores.plants if scores.ratio(column, p, law) is not None]
        ratios = [[scores.ratio(column, p, each) or math.inf for p in both] for each in (law, winner)]
        own, other = (math.prod(each) ** (1 / max(1, len(both))) for each in ratios)
        if 0 < len(both) < scores.met(winner) and own * LOSES < other:
            found.append(f"{scores.label(law)} ({number(own)} to {number(other)} on {len(both)})")
    return ", ".join(found) or "-"


def _lost(scores: Scores, column: str, law: str) -> list[str]:
    """The plants on which the winner of a column is worse than the bar there."""
    lost = [p for p in scores.plants if (r := scores.ratio(column, p, law)) is not None and r > LOSES]
    return [f"loses to the bar on {', '.join(lost)}"] if lost else []


def losers(scores: Scores) -> list[str]:
    """A line for each law that learns: where its ripple is no lower than the bar's."""
    found = []
    for law in scores.laws:
        worse = [
            f"{plant} ({number(ratio)})"
            for plant in scores.plants
            if law != scores.bar
            and (ratio := scores.ratio("ripple", plant, law)) is not None
            and ratio > LEARNED_ON
        ]
        if worse:
            found.append(f"- {scores.label(law)}: {', '.join(worse)}")
    return found or ["- none"]


def growth(scores: Scores) -> list[str]:
    """A line for each law whose ripple an hour later is higher than once it had learned."""
    found = []
    for plant, law in product(scores.plants, scores.laws):
        late = scores.value("after_hour", plant, law)
        early = scores.value("ripple", plant, law, scores.seeds[:1])
        if late is not None and early is not None and late > GROWN * early:
            found.append(f"- {scores.label(law)} on {plant}: {number(late / early)} times")
    return found or ["- none"]


def plant_tables(scores: Scores) -> list[str]:
    lines: list[str] = []
    for plant in scores.plants:
        laws = [law for law in scores.laws if scores.value("ripple", plant, law) is not None]
        columns = {c: about for c, about in COLUMNS.items() if scores.value(c, plant, scores.bar) is not None}
        rows = []
        for law in laws:
            cells = []
            for column, about in columns.items():
                best = scores.best(partial(scores.value, column, plant), laws)
                value = scores.value(column, plant, law)
                text = "-" if value is None else "never" if math.isinf(value) else number(value / about.scale)
                cells.append(f"**{text}**" if law in best else text)
            rows.append([scores.label(law), *cells])
        head = ["law", *(f"{c.title} [{c.unit}]" for c in columns.values())]
        lines += [f"### {plant}", "", f"{_sentence(scores, plant)}", "", *table(head, rows), ""]
    return lines[:-1]


def _sentence(scores: Scores, plant: str) -> str:
    about = str(scores.content["plants"][plant]["about"])
    away = [
        f"{scores.label(each['law'])} ({each['why']})"
        for each in scores.content["absent"]
        if each["plant"] == plant
    ]
    bar = f" {scores.label(scores.bar)} isn't on it, so it is in no score." if plant in scores.barless else ""
    stays = f" Not on it: {', '.join(away)}." if away else ""
    return f"{about[0].upper()}{about[1:]}.{bar}{stays}"


def trial_tables(content: Mapping[str, Any]) -> list[str]:
    """Laws of trials, in each phase of their study: the mean over seeds; instructions of a sample."""
    known, lines = costs(), []
    for name, about in content["arena_trials"].items():
        runs = [run for run in content["trials"] if run["trials"] == name]
        columns = list(runs[0]["metrics"]) if runs else []
        laws = {run["law"]: (run["label"], run["kind"]) for run in runs}
        values = {
            (law, column): [
                _mean([run["metrics"][column][phase] for run in runs if run["law"] == law])
                for phase in range(len(runs[0]["metrics"][column]))
            ]
            for law in laws
            for column in columns
        }
        rows = []
        for law, (label, kind) in laws.items():
            cells = []
            for column in columns:
                worst = {each: max(values[each, column]) for each in laws}
                text = ", ".join(_trial_cell(column, x) for x in values[law, column])
                won = math.isfinite(worst[law]) and worst[law] <= 1.02 * min(worst.values())
                cells.append(f"**{text}**" if won else text)
            rows.append([label, *cells, known.get(kind, ("-", "-"))[0]])
        head = [TRIAL_COLUMNS.get(column, column) for column in columns]
        lines += [f"### {name}", "", f"{about[0].upper()}{about[1:]}.", ""]
        lines += [*table(["law", *head, "instructions"], rows), ""]
    return lines[:-1]


def limit_table(content: Mapping[str, Any], scores: Scores) -> list[str]:
    """Rows with the best law of each plant, what limits it and what helps most, all from runs."""
    rows = []
    for found in content["limits"]:
        shares = {each["cause"]: each["share"] for each in found["causes"]}
        causes = [f"{_cause(name)} ({100 * shares[name]:.0f} %)" for name in found["named"]] or [
            "no single one"
        ]
        helps = [
            f"{_set(each['set'])} leaves {number(each['value'] / RPM)}" for each in found["helps"].values()
        ]
        left = number(found["value"] / RPM)
        rows.append(
            [found["plant"], scores.label(found["law"]), left, "; ".join(causes), "; ".join(helps) or "-"]
        )
    return table(["plant", "least ripple", "r/min", "what limits it", "what would help"], rows)


def _cause(name: str) -> str:
    return " and ".join(CAUSES[each] for each in name.split(AND))


def _set(changes: Mapping[str, Any]) -> str:
    """Changes in the notation of `--set`; for a longer run, words on the time to learn."""
    if any(key.endswith(".duration") for key in changes):
        return f"{LONGER} times as long to learn"
    return f"`{', '.join(f'{key} = {text(value)}' for key, value in changes.items())}`"


def _mean(values: Sequence[float | None]) -> float:
    return sum(math.inf if value is None else value for value in values) / len(values)


def _trial_cell(column: str, value: float) -> str:
    if math.isinf(value):
        return "never"
    return f"{1e3 * value:.2f}" if column.endswith("_rad") else f"{value:.3g}"


def seeds(scores: Scores) -> list[str]:
    changing = scores.unsteady()
    count = len(scores.seeds)
    if not changing:
        return [f"No column's winner changes over {count} seeds."]
    lines = [f"Of {len(COLUMNS)} columns, {len(changing)} change their winner over {count} seeds:", ""]
    for column, each in changing.items():
        named = ", ".join(f"{scores.label(laws[0])} with seed {seed}" for seed, laws in each.items() if laws)
        lines.append(f"- {COLUMNS[column].title}: {named}")
    return lines


def blocks(path: Path) -> Blocks:
    content = json.loads(path.read_text(encoding="utf-8"))
    scores = Scores(content)
    return {
        "scores": main_table(scores),
        "winners": winner_table(scores),
        "losers": losers(scores),
        "hour": growth(scores),
        "seeds": seeds(scores),
        "plants": plant_tables(scores),
        "limits": limit_table(content, scores),
        "trials": trial_tables(content),
    }


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "arena.md", blocks)
