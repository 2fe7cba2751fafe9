"""Choose gains: CMA-ES over an ensemble, then a check on variants that the search has not seen.

Every setting is run on the same variants, with the same seeds, so that luck makes no difference between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cogless.design.kinds import DESIGNS
from cogless.ensemble import judge
from cogless.ensemble.search import Settings, opened
from cogless.ensemble.sweep import TASK_VARIANTS, needed, variant_rows
from cogless.ensemble.sweep_table import Column, Sweep, columns, gathered
from cogless.ensemble.variants import SEED, Ensemble, Reader, draw, seeds, tried
from cogless.ensemble.workers import Workers, pack, run_all
from cogless.errors import StudyError
from cogless.results.trace import Array
from cogless.run.simulate import Pair, runs_of
from cogless.study import AnyStudy, changed
from cogless.study.base import Tune
from cogless.study.messages import MISSING, toml_text
from cogless.study.metric import result_name
from cogless.study.reading import split
from cogless.study.table import perhaps

DECADE_RATIO = 10.0  # a range is searched by ratios if high / low is at least this
FRESH_VARIANTS = 4  # variants of the check, per variant of the search
NOMINAL_SEEDS = 16  # variants that check the nominal plant; only their noise differs
TuneProgress = Callable[[str, int, int, float], None]  # subject, tried, budget, best value


@dataclass(frozen=True)
class Knob:
    """A value to choose, within a range; the search sees a share of the range, 0 to 1."""

    key: str
    unit: str
    low: float
    high: float
    start: float
    whole: bool = False  # takes whole numbers only

    @property
    def by_ratio(self) -> bool:
        return self.low > 0 and self.high >= DECADE_RATIO * self.low

    def value_at(self, share: float) -> Any:
        """The value at a share of the range, as it stands in a study's file."""
        if self.by_ratio:
            value = self.low * (self.high / self.low) ** share
        else:
            value = self.low + (self.high - self.low) * share
        return self._written(value if self.whole else float(f"{value:.4g}"))

    @property
    def start_text(self) -> Any:
        return self._written(self.start)

    @property
    def start_share(self) -> float:
        if self.by_ratio:
            return math.log(self.start / self.low) / math.log(self.high / self.low)
        return (self.start - self.low) / (self.high - self.low)

    def _written(self, value: float) -> Any:
        if self.whole:
            return round(value)
        return f"{value!r} {self.unit}" if self.unit else value


@dataclass(frozen=True, eq=False)
class Subject:
    """Keys that are tuned together: those of one controller, or all keys if one belongs to no controller."""

    name: str
    knobs: Sequence[Knob]
    pairs: Sequence[Pair]


@dataclass(frozen=True)
class Score:
    """How good a setting is: the smaller the better.

    `violation`: sum of the relative misses of limits. `value`: the metric that is minimised, relative to the
    first setting's. `growth`: what the function `growth` returns.
    """

    violation: float
    value: float
    growth: float = 0.0

    @property
    def missed(self) -> float:
        """The violation of limits plus the growth of learning; 0 for a setting that is allowed."""
        return self.violation + self.growth

    @property
    def order(self) -> tuple[float, float]:
        return self.missed, self.value


@dataclass(frozen=True, eq=False)
class Tuned:
    """The outcome for one subject, judged on fresh variants."""

    subject: Subject
    values: Mapping[str, Any]  # the best values by dotted key
    before: Score
    after: Score
    sweep_before: Sweep
    sweep_after: Sweep

    @property
    def adopted(self) -> bool:
        """Whether the found values are better."""
        return self.after.order < self.before.order

    @property
    def chosen(self) -> Mapping[str, Any]:
        """The values to use: the found ones if they are better, else none."""
        return self.values if self.adopted else {}


class Evaluation:
    """Runs settings of a subject over an ensemble, and scores them."""

    def __init__(self, study: AnyStudy, subject: Subject, ensemble: Ensemble, workers: Workers) -> None:
        assert study.tune is not None
        self.study, self.tune, self.subject = study, study.tune, subject
        self.ensemble, self.workers = ensemble, workers
        self.parcel, self.columns = pack(study), columns(study)
        self.scales: Array | None = None

    def sweeps(self, candidates: Sequence[Mapping[str, Any]]) -> list[Sweep]:
        """Run each candidate (values by key) on all variants; returns a sweep for each."""
        count = self.ensemble.count
        changes = [self.ensemble.changes(v) | dict(c) for c in candidates for v in range(count)]
        chunks = [changes[at : at + TASK_VARIANTS] for at in range(0, len(changes), TASK_VARIANTS)]
        tasks = [(self.parcel, chunk, self.subject.pairs) for chunk in chunks]
        rows_of_task: dict[int, Any] = {}
        run_all(
            self.workers,
            variant_rows,
            range(len(tasks)),
            tasks.__getitem__,
            rows_of_task.__setitem__,
            needed(self.study),
        )
        in_order = [row for number in range(len(chunks)) for row in rows_of_task[number]]
        return [
            gathered(self.study, self.ensemble, self.subject.pairs, in_order[at : at + count])
            for at in range(0, len(in_order), count)
        ]

    def scores(self, candidates: Sequence[Mapping[str, Any]]) -> list[Score]:
        """Scores of candidates; the values are relative to the first candidate that is ever scored."""
        return [self.score(sweep, c) for sweep, c in zip(self.sweeps(candidates), candidates, strict=True)]

    def score(self, sweep: Sweep, candidate: Mapping[str, Any]) -> Score:
        index = self.columns.index(column_of(self.study, self.tune.minimise, "minimise"))
        scores = np.array([self._statistic(judge.badness(sweep, p, index)) for p, _ in self._taken(index)])
        if self.scales is None:
            usable = np.isfinite(scores) & (scores != 0)
            self.scales = np.where(usable, np.abs(scores), 1.0)
        violation = 0.0
        for hold in self.tune.hold:
            place = self.columns.index(column_of(self.study, hold.metric, "hold"))
            limit = hold_limit(self.study, self.columns[place], hold.limit)
            for pair, _ in self._taken(place):
                edge = judge.quantile(judge.badness(sweep, pair, place), hold.share)
                violation += max(0.0, (edge - limit) / (abs(limit) or 1.0))
        grows = growth(changed(self.study, candidate), {name for _, name in self.subject.pairs})
        return Score(violation, float(np.mean(scores / self.scales)), grows)

    def _taken(self, index: int) -> list[tuple[int, Pair]]:
        """The runs in whose scenarios a metric is taken, each with its index among the subject's pairs."""
        metric = self.columns[index].metric
        return [
            (place, pair)
            for place, pair in enumerate(self.subject.pairs)
            if metric.applies_in(pair[0], self.study.scenario[pair[0]])
        ]

    def _statistic(self, bad: Array) -> float:
        over = self.tune.over
        if over == "worst":
            return float(np.max(bad))
        if isinstance(over, float):
            return judge.quantile(bad, over)
        return float(np.mean(bad))


def tune(
    study: AnyStudy, folder: Path, workers: Workers, progress: TuneProgress | None = None
) -> list[Tuned]:
    """Tune a study as its [tune] says. A killed tuning goes on from the journals in `folder`.

    `progress` is called with the subject, the number of settings tried, the budget, and the best value so
    far as a multiple of the first. StudyError: a mistake in [tune] or [vary], a journal of another study.
    """
    report = progress or (lambda *of: None)
    search_over, fresh = ensembles(study)
    return [
        _tuned(
            Evaluation(study, subject, search_over, workers),
            Evaluation(study, subject, fresh, workers),
            folder / journal_name(subject),
            report,
        )
        for subject in subjects(study)
    ]


def journal_name(subject: Subject) -> str:
    """Name of the journal in which a search keeps what it has tried."""
    return f"{subject.name}.tune"


def _tuned(searched: Evaluation, check: Evaluation, path: Path, progress: TuneProgress) -> Tuned:
    study, subject, budget = searched.study, searched.subject, searched.tune.budget
    start = {knob.key: knob.start_share for knob in subject.knobs}
    identity = {"study": pack(study).digest[:16], "keys": list(start)}
    with opened(path, identity, start, study.seed) as search:
        searched.scores([_values(subject, start)])  # scored first: all other values are relative to it
        best = search.run(
            lambda many: [_penalised(s) for s in searched.scores([_values(subject, one) for one in many])],
            budget,
            lambda tried, value: progress(subject.name, tried, budget, value),
        )
    values = _values(subject, best)
    first = _values(subject, start)
    before, after = check.sweeps([first, values])
    return Tuned(
        subject=subject,
        values=values,
        before=check.score(before, first),
        after=check.score(after, values),
        sweep_before=before,
        sweep_after=after,
    )


def side_by_side(study: AnyStudy, tuned: Sequence[Tuned]) -> Sweep:
    """One sweep of each controller before and after tuning, over the fresh variants.

    The sweep's study has the tuned controllers as copies, named NAME-tuned.
    """
    named = {name: f"{name}-tuned" for one in tuned for _, name in one.subject.pairs}
    copies: dict[str, Any] = {}
    for one in tuned:
        of_subject = changed(study, one.values)
        for _, name in one.subject.pairs:
            table = {k: v for k, v in of_subject.source.tables["controller"][name].items() if k != "baseline"}
            copies[f'controller."{named[name]}"'] = {**table, "label": f"{study.label(name)} tuned"}
    pairs = [
        (s, renamed(c)) for one in tuned for renamed in (str, named.__getitem__) for s, c in one.subject.pairs
    ]
    values = [sweep.values for one in tuned for sweep in (one.sweep_before, one.sweep_after)]
    first = tuned[0].sweep_before
    both_sides = changed(study, copies)
    return Sweep(
        study=both_sides,
        ensemble=first.ensemble,
        pairs=pairs,
        columns=first.columns,
        values=np.concatenate(values, axis=1),
        errors={},
    )


def outcome_lines(tuned: Tuned) -> list[str]:
    """The outcome as lines of text: the score on fresh variants, and each value before and after."""
    name, before, after = tuned.subject.name, tuned.before, tuned.after
    changes = [
        f"{knob.key} = {toml_text(tuned.values[knob.key])}  # was {toml_text(knob.start_text)}"
        for knob in tuned.subject.knobs
    ]
    count = tuned.sweep_after.ensemble.count
    worth = f"{name}: now {100 * after.value:.1f} % of the value before, over {count} fresh variants"
    if before.violation or after.violation:
        worth += (
            f"; it was beyond the limits by {100 * before.violation:.1f} %, and is now by "
            f"{100 * after.violation:.1f} % (sum, in % of each limit)"
        )
    if not tuned.adopted:
        worth += "; this is not better, so the values stay as they were"
    return [worth, *changes]


def _values(subject: Subject, settings: Settings) -> dict[str, Any]:
    """Values by key; a value at its start is exactly as in the study."""
    return {
        knob.key: knob.start_text
        if math.isclose(settings[knob.key], knob.start_share, rel_tol=1e-12)
        else knob.value_at(settings[knob.key])
        for knob in subject.knobs
    }


def growth(study: AnyStudy, controllers: Iterable[str]) -> float:
    """By how much learning grows in a period, as design forecasts it: the factor minus 1, or 1 if there is no
    factor; 0 if learning settles, or if the forecast isn't sure. Short runs don't show such growth.

    The largest growth of these controllers; 0 for studies of trials.
    """
    forecast = DESIGNS[study.kind].forecast
    verdicts = [verdict for name in controllers if (verdict := forecast(study, name)) is not None]
    sure = [
        verdict_now
        for verdict_now in verdicts
        if verdict_now.kind in ("grows", "unstable", "feedback unstable")
    ]
    return max(
        (verdict_now.worst.factor - 1 if verdict_now.worst else 1.0 for verdict_now in sure), default=0.0
    )


def _penalised(score: Score) -> float:
    """One number for the search, which only compares. A missed limit makes it worse than any other score."""
    most = 1e6
    if score.missed > 0:
        return most * (1 + min(score.missed, most))
    return min(score.value, most)


def ensembles(study: AnyStudy) -> tuple[Ensemble, Ensemble]:
    """Two ensembles: the variants of the search, and fresh variants for the check."""
    options = _tune_table(study)
    if options.over == "nominal":
        return Ensemble((), {}, 1), Ensemble((), {SEED: seeds(study, NOMINAL_SEEDS, fresh=1)}, NOMINAL_SEEDS)
    return draw(study, options.variants), draw(study, FRESH_VARIANTS * options.variants, fresh=1)


def subjects(study: AnyStudy) -> list[Subject]:
    """The groups of keys that are tuned together: one group for each controller.

    There is only one group if any key belongs to no controller. StudyError: a mistake in [tune].
    """
    options, path = _tune_table(study), study.source.path
    column_of(study, options.minimise, "minimise")
    for hold in options.hold:
        hold_limit(study, column_of(study, hold.metric, "hold"), hold.limit)
    knobs: dict[str, list[Knob]] = {}
    for key, limits in options.keys.items():
        parts = split(key)
        name = str(parts[1]) if parts[0] == "controller" and len(parts) > 2 else ""
        knobs.setdefault(name, []).append(_knob(study, key, limits))
    if "" in knobs:
        joint = [knob for of in knobs.values() for knob in of]
        named = [name for name in knobs if name] or list(study.controller)
        return [Subject("all", joint, _pairs(study, options, named))]
    for name in knobs:
        if name not in study.controller:
            expected = f"expected one of {', '.join(study.controller)}{perhaps(name, study.controller)}"
            raise StudyError(f"{path}: tune.keys: controller.{name}: {expected}")
    return [Subject(name, of, _pairs(study, options, [name])) for name, of in knobs.items()]


def _pairs(study: AnyStudy, options: Tune, controllers: Sequence[str]) -> list[Pair]:
    for scenario in options.scenarios or ():
        if scenario not in study.scenario:
            expected = f"expected one of {', '.join(study.scenario)}{perhaps(scenario, study.scenario)}"
            raise StudyError(f"{study.source.path}: tune.scenarios: {toml_text(scenario)}: {expected}")
    chosen = options.scenarios or tuple(study.scenario)
    metric = column_of(study, options.minimise, "minimise").metric
    pairs = [pair for pair in runs_of(study) if pair[1] in controllers and pair[0] in chosen]
    if not any(metric.applies_in(s, study.scenario[s]) for s, _ in pairs):
        expected = f"expected a metric of a scenario in which {', '.join(controllers)} runs"
        raise StudyError(f"{study.source.path}: tune.minimise: {toml_text(options.minimise)}: {expected}")
    return pairs


def _knob(study: AnyStudy, key: str, limits: tuple[Any, ...]) -> Knob:
    reader = Reader(study, key, ("tune", "keys", key), limits)
    if reader.nominal is MISSING:
        tried(study, "tune.keys", {key: limits[0]})
        raise reader.wrong("expected a key that has a value in the study, from which tuning begins")
    low, high = reader.range()
    start = reader.middle()
    if not low <= start <= high:
        raise reader.wrong(
            f"expected a range that contains the study's own value, {toml_text(reader.nominal)}"
        )
    return Knob(key=key, unit=reader.unit, low=low, high=high, start=start, whole=reader.whole)


def column_of(study: AnyStudy, name: str, where: str) -> Column:
    """The column of a metric that [tune] names. StudyError: no such metric, or it has several columns."""
    by_name = {column.spoken: column for column in columns(study)}
    by_name |= {column.name: column for column in columns(study)}
    if name not in by_name:
        names = [column.spoken for column in columns(study)]
        expected = f"expected one of {', '.join(names) or 'none'}{perhaps(name, names)}"
        raise StudyError(f"{study.source.path}: tune.{where}: {toml_text(name)}: {expected}")
    return by_name[name]


def hold_limit(study: AnyStudy, column: Column, limit: Any) -> float:
    """A limit of [tune] in SI, negated if higher is better."""
    from cogless.study.table import Quantity

    dimension = column.metric.dimension
    try:
        si = Quantity(dimension, bare=not dimension.unit).read(limit)
    except ValueError as error:
        where = f"{study.source.path}: tune.hold: {result_name(column.metric)}"
        raise StudyError(f"{where}: {toml_text(limit)}: {error}") from None
    return -si if column.metric.better_direction == "higher" else si


def _tune_table(study: AnyStudy) -> Tune:
    if study.tune is None:
        expected = "expected a table with keys, minimise, ..."
        raise StudyError(f"{study.source.path}: tune: missing: {expected}")
    return study.tune
