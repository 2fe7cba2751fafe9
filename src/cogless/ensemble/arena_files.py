"""The files and the table of an arena's results."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cogless.ensemble.arena import ArenaResults
from cogless.ensemble.arena_scores import COLUMNS, Scores
from cogless.files import replacing, versions
from cogless.results.limits import Limits
from cogless.results.metrics import Value
from cogless.results.results_json import as_json

if TYPE_CHECKING:
    from rich.table import Table


def to_dict(results: ArenaResults) -> dict[str, Any]:
    """Content of results.json, in plain types; a number that isn't finite becomes null, meaning "never"."""
    arena = results.arena
    plants = {name: as_json(plant.model_dump(mode="json")) for name, plant in arena.plant.items()}
    laws = {name: {"label": arena.label(name), **as_json(table)} for name, table in arena.laws.items()}
    return {
        "study": arena.name,
        "title": arena.title,
        "version": versions()["cogless"],
        "versions": versions(),
        "seeds": list(arena.seeds),
        "bar": arena.bar,
        "plants": plants,
        "laws": laws,
        "absent": [{"plant": p, "law": law, "why": why} for (p, law), why in results.absent.items()],
        "before": [{"plant": p, "law": law, "s": time} for (p, law), time in results.before.items()],
        "settings": [
            {"plant": p, "law": law, "controller": as_json(dict(t))}
            for (p, law), t in results.settings.items()
        ],
        "limits": [_limits(plant, of) for plant, of in results.limits.items()],
        **({"interrupted": True} if results.interrupted else {}),
        "arena_trials": {name: told.about for name, told in arena.trials.items()},
        "trials": [
            {
                "trials": run.trials,
                "law": run.law,
                "label": run.label,
                "kind": run.kind,
                "seed": run.seed,
                "metrics": {n: [_plain(x) for x in values] for n, values in run.metrics.items()},
            }
            for run in results.trials
        ],
        "runs": [
            {
                "plant": run.plant,
                "case": run.case,
                "law": run.law,
                "seed": run.seed,
                "metrics": {name: _plain(value) for name, value in run.metrics.items()},
            }
            for run in results.runs
        ],
    }


def _limits(plant: str, of: Limits) -> dict[str, Any]:
    """What limits the best law on a plant: each cause's share of the ripple's square, and what helps most."""
    helps = {key: cure for key, cure in (("setting", of.setting), ("part", of.part)) if cure is not None}
    return {
        "plant": plant,
        "law": of.controller,
        "value": of.value,
        "causes": [{"cause": cause.name, "share": cause.share} for cause in of.causes],
        "named": [cause.name for cause in of.named],
        "untried": list(of.untried),
        "helps": {k: {"set": as_json(dict(c.changes)), "value": c.value} for k, c in helps.items()},
    }


def _plain(value: Value) -> float | list[float | None] | None:
    if isinstance(value, list):
        return [x if math.isfinite(x) else None for x in value]
    return value if value is not None and math.isfinite(value) else None


def write(results: ArenaResults, path: Path) -> None:
    """Write results.json, completely or not at all."""
    text = json.dumps(to_dict(results), indent=1, allow_nan=False, ensure_ascii=False)
    with replacing(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def table(results: ArenaResults) -> Table:
    """The scores: a row for each law, * for the best of a column."""
    from rich.table import Table

    scores = Scores(to_dict(results))
    found = Table(box=None, pad_edge=False, title=f"Times {scores.label(scores.bar)}, mean over plants")
    found.add_column("law")
    for column in COLUMNS.values():
        found.add_column(column.title, justify="right")
    found.add_column("plants", justify="right")
    best = {column: scores.winners(column) for column in COLUMNS}
    for law in scores.laws:
        cells = [
            scores.unscored(column, law)
            if (score := scores.score(column, law)) is None
            else f"{score:.3g}{' *' if law in best[column] else '  '}"
            for column in COLUMNS
        ]
        found.add_row(scores.label(law), *cells, str(scores.met(law)))
    if scores.barless:
        found.caption = (
            f"In no score, since {scores.label(scores.bar)} was not on it: {', '.join(scores.barless)}."
        )
    return found
