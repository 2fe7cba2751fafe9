"""Scores of an arena from its results.json: each law against the reference law, column by column.

The reference law is called the bar. A law's score in a column is the geometric mean over plants of its value
divided by the bar's. Each value is the mean over seeds. A plant on which a law was not run does not count in
that law's score; `met` is the number of plants on which the law ran.

This module also writes results.json and builds the table for the terminal.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cogless.ensemble.arena import HOUR, TOLD_CASE, UNTOLD, ArenaResults
from cogless.files import replacing, versions
from cogless.results.limits import Limits
from cogless.results.metrics import Value
from cogless.results.results_json import as_json
from cogless.units import RPM

if TYPE_CHECKING:
    from rich.table import Table

Content = Mapping[str, Any]  # the content of results.json
LEAST_TIME = 1e-3  # s; a shorter time counts as this
EVEN_RATIO = 1.02  # a law counts as equal to the best up to this ratio of their values


@dataclass(frozen=True)
class Column:
    """A column of the arena.

    `metric`: name in results.json; amplitudes of several orders count as one rms. `cases`: the worst value
    over these cases counts. `never`: the plant's key whose time counts if an event never occurs.
    """

    title: str
    metric: str
    unit: str
    scale: float  # one unit in SI
    cases: tuple[str, ...] = (TOLD_CASE,)
    never: str | None = None


SCORE_COLUMNS = {
    "ripple": Column("ripple", "ripple_rad_s", "r/min", RPM),
    "orders": Column("orders", "orders_rad_s", "r/min", RPM),
    "dip": Column("dip", "dip_rad_s", "r/min", RPM),
    "settling": Column("settling", "settling_s", "s", 1.0, never="hold"),
    "time_to_learn": Column("time to learn", "time_to_learn_s", "s", 1.0, never="learn"),
    "copper_loss": Column("copper loss", "copper_loss_W", "W", 1.0),
    "chattering": Column("chattering", "chattering_A", "A", 1.0),
    "after_fault": Column("after a fault", "after_fault_rad_s", "r/min", RPM),
    "wrong_model": Column("wrong model", "ripple_rad_s", "r/min", RPM, cases=UNTOLD),
    "after_hour": Column("after an hour", "after_hour_rad_s", "r/min", RPM, cases=(HOUR,)),
}


@dataclass(frozen=True)
class Scores:
    """The scores of one results.json."""

    content: Content

    @cached_property
    def _values(self) -> dict[tuple[str, str, str, int], Mapping[str, Any]]:
        return {(r["plant"], r["case"], r["law"], r["seed"]): r["metrics"] for r in self.content["runs"]}

    @cached_property
    def _before(self) -> dict[tuple[str, str], float]:
        return {(entry["plant"], entry["law"]): entry["s"] for entry in self.content["before"]}

    @property
    def plants(self) -> list[str]:
        return list(self.content["plants"])

    @property
    def laws(self) -> list[str]:
        return list(self.content["laws"])

    @property
    def seeds(self) -> list[int]:
        return list(self.content["seeds"])

    @property
    def bar(self) -> str:
        return str(self.content["bar"])

    def label(self, law: str) -> str:
        return str(self.content["laws"][law]["label"])

    def of_seed(self, column: str, plant: str, law: str, seed: int) -> float | None:
        """A law's value on a plant, SI. Infinite: never reached, or not finite. None: the law wasn't run."""
        definition = SCORE_COLUMNS[column]
        values = []
        for case in definition.cases:
            metrics = self._values.get((plant, case, law, seed))
            if metrics is None or definition.metric not in metrics:
                return None
            before = self._before.get((plant, law), 0.0) if column == "time_to_learn" else 0.0
            values.append(before + _number(metrics[definition.metric]))
        return max(values)

    def value(self, column: str, plant: str, law: str, seeds: Iterable[int] | None = None) -> float | None:
        """A law's value on a plant as the mean over seeds; infinite if any seed's value is infinite."""
        first = SCORE_COLUMNS[column].cases[0]
        run = {seed for where, case, _, seed in self._values if (where, case) == (plant, first)}
        of_seeds = [
            self.of_seed(column, plant, law, seed)
            for seed in (self.seeds if seeds is None else seeds)
            if seed in run
        ]
        numbers = [value for value in of_seeds if value is not None]
        return sum(numbers) / len(numbers) if len(numbers) == len(of_seeds) and numbers else None

    def ratio(self, column: str, plant: str, law: str) -> float | None:
        """A law's value over the bar's; None if either wasn't run.

        A time that is never reached counts as the time that was available.
        """
        of = (self.value(column, plant, name) for name in (law, self.bar))
        counts = [None if value is None else self._counted(column, plant, value) for value in of]
        return counts[0] / counts[1] if counts[0] is not None and counts[1] else None

    def _counted(self, column: str, plant: str, value: float) -> float | None:
        never = SCORE_COLUMNS[column].never
        if never is not None:
            return max(LEAST_TIME, min(value, float(self.content["plants"][plant][never])))
        return value

    def met(self, law: str) -> int:
        """The number of plants on which a law was run."""
        return sum(self.value("ripple", plant, law) is not None for plant in self.plants)

    @property
    def barless(self) -> list[str]:
        """The plants on which some law was run but the bar was not: they count in no score."""
        on = [p for p in self.plants if any(self.value("ripple", p, law) is not None for law in self.laws)]
        return [p for p in on if self.value("ripple", p, self.bar) is None]

    def unscored(self, column: str, law: str) -> str:
        """Why a law has no score in a column, in two words."""
        return "no bar" if any(self.value(column, p, law) is not None for p in self.plants) else "not run"

    def score(self, column: str, law: str) -> float | None:
        """Geometric mean of the ratios over plants; infinite if a ratio is; None if there is no ratio."""
        ratios = [r for p in self.plants if (r := self.ratio(column, p, law)) is not None]
        if not ratios or math.inf in ratios:
            return math.inf if ratios else None
        return math.exp(sum(math.log(max(r, 1e-9)) for r in ratios) / len(ratios))

    def best(self, value: Callable[[str], float | None], among: Sequence[str] | None = None) -> list[str]:
        """The laws whose value is at most EVEN_RATIO times the least one; the best first."""
        values = {law: v for law in (among or self.laws) if (v := value(law)) is not None and v < math.inf}
        order = sorted(values, key=lambda law: values[law])
        return [law for law in order if values[law] <= EVEN_RATIO * values[order[0]]]

    def winners(self, column: str) -> list[str]:
        """The laws with the best score of a column. Each has a value on every plant where the bar has one."""
        plants = [p for p in self.plants if self.value(column, p, self.bar) is not None]
        everywhere = [law for law in self.laws if all(self.value(column, p, law) is not None for p in plants)]
        return self.best(lambda law: self.score(column, law), everywhere)


def _number(value: float | list[float | None] | None) -> float:
    """A metric's value as one number, of amplitudes the rms; infinite if never reached, or not finite."""
    if isinstance(value, list):
        return math.hypot(*(math.inf if x is None else x / math.sqrt(2) for x in value))
    return math.inf if value is None else float(value)


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
        "arena_trials": {name: trials.about for name, trials in arena.trials.items()},
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


def headline(results: ArenaResults) -> str:
    """A sentence: which laws leave the least ripple, as a multiple of the bar's; "" if that is unknown."""
    scores = Scores(to_dict(results))
    laws = scores.winners("ripple")
    score = scores.score("ripple", laws[0]) if laws else None
    if score is None:
        return ""
    labels = " and ".join(map(scores.label, laws))
    count, verb = scores.met(laws[0]), "leaves" if len(laws) == 1 else "leave"
    plants = "on one plant" if count == 1 else f"in the mean of {count} plants"
    return (
        f"{labels} {verb} the least ripple: {score:.3g} times that of {scores.label(scores.bar)}, {plants}."
    )


def table(results: ArenaResults) -> Table:
    """A table of the scores: a row for each law, with * at the best of a column."""
    from rich.table import Table

    scores = Scores(to_dict(results))
    scores_table = Table(
        box=None, pad_edge=False, title=f"Multiples of {scores.label(scores.bar)}, mean over plants"
    )
    scores_table.add_column("law")
    for column in SCORE_COLUMNS.values():
        scores_table.add_column(column.title, justify="right", no_wrap=True)
    scores_table.add_column("plants", justify="right")
    best = {column: scores.winners(column) for column in SCORE_COLUMNS}
    for law in scores.laws:
        cells = [
            scores.unscored(column, law)
            if (score := scores.score(column, law)) is None
            else f"{score:.3g}{' *' if law in best[column] else '  '}"
            for column in SCORE_COLUMNS
        ]
        scores_table.add_row(scores.label(law), *cells, str(scores.met(law)))
    if scores.barless:
        scores_table.caption = (
            f"No score counts plants without {scores.label(scores.bar)}: {', '.join(scores.barless)}."
        )
    return scores_table
