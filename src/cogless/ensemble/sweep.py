"""Run every variant of an ensemble, on workers of any kind, and keep what is finished."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cogless.ensemble import journal
from cogless.ensemble.columns import columns
from cogless.ensemble.executors import Workers, given, run_all
from cogless.ensemble.parcel import pack
from cogless.ensemble.sample import Ensemble, draw
from cogless.ensemble.table import Sweep, gathered
from cogless.ensemble.work import needed, rows
from cogless.errors import StudyError
from cogless.files import versions
from cogless.run.simulate import Pair, runs_of
from cogless.study import AnyStudy

SHARD_NUMBER = re.compile("[1-9][0-9]{0,8}")
CHUNK = 16  # variants of a task: enough for the engine's lock step, little to lose with a worker

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Shard:
    """A part of a sweep: chunk `index`, `index` + `of`, ... counted from 0."""

    index: int = 0
    of: int = 1

    @property
    def file(self) -> str:
        """Name of the journal's file."""
        return "journal.jsonl" if self.of == 1 else f"shard-{self.index + 1}-of-{self.of}.jsonl"


@dataclass(frozen=True, eq=False)
class Plan:
    """All that is needed to run or to merge a sweep."""

    study: AnyStudy
    ensemble: Ensemble
    pairs: Sequence[Pair]
    about: Mapping[str, Any]  # tells this sweep from others, in its journal

    @property
    def chunks(self) -> int:
        return -(-self.ensemble.count // CHUNK)

    def part(self, shard: Shard) -> range:
        """The chunks of a shard."""
        return range(shard.index, self.chunks, shard.of)

    def variants(self, shard: Shard) -> int:
        """Number of variants of a shard."""
        return sum(len(self.changes(chunk)) for chunk in self.part(shard))

    def changes(self, chunk: int) -> list[dict[str, Any]]:
        """What differs from the study, for each variant of a chunk."""
        last = min(self.ensemble.count, (chunk + 1) * CHUNK)
        return [self.ensemble.changes(variant) for variant in range(chunk * CHUNK, last)]

    def for_shards(self, shard: Shard) -> dict[str, Any]:
        """What a journal says it is; a shard also says how many variants there are, which decide its part."""
        return {**self.about, **({"variants": self.ensemble.count} if shard.of > 1 else {})}


def plan(study: AnyStudy, count: int, only: Sequence[str] | None = None) -> Plan:
    """Plan a sweep of `count` variants. StudyError: no [vary], a mistake in it, no such run, no metric."""
    pairs = runs_of(study, only)
    if not columns(study):
        raise StudyError(f"{study.source.path}: metric: missing: expected one or more to compare")
    ensemble = draw(study, count)
    about = {
        "study": pack(study).digest[:16],
        "version": versions()["cogless"],
        "runs": ["/".join(pair) for pair in pairs],
        "first": ensemble.changes(0),
    }
    return Plan(study, ensemble, pairs, about)


def run(
    planned: Plan,
    folder: Path,
    workers: Workers | Executor,
    shard: Shard | None = None,
    progress: Progress | None = None,
) -> Sweep | None:
    """Run a sweep, or go on with it; None if it is a shard, which `merge` puts together with the others.

    `folder`: an existing one, for the journal. `progress` is called with the number of finished variants,
    those of an earlier call included. StudyError: a journal of another sweep, a worker that keeps dying.
    """
    part = shard or Shard()
    wanted = planned.part(part)
    with journal.opened(folder / part.file, planned.for_shards(part)) as kept:
        report = progress or (lambda variants: None)
        # a last chunk that was shorter in an earlier, smaller sweep runs again
        left = [c for c in wanted if len(kept.finished.get(c, ())) < len(planned.changes(c))]
        done = planned.variants(part) - sum(len(planned.changes(c)) for c in left)
        report(done)

        def finished(chunk: int, found: Any) -> None:
            nonlocal done
            kept.add(chunk, found)
            done += len(found)
            report(done)

        parcel = pack(planned.study)
        tasks = {chunk: (parcel, planned.changes(chunk), planned.pairs) for chunk in left}
        at = workers if isinstance(workers, Workers) else given(workers)
        run_all(at, rows, tasks, finished, needed(planned.study))
        return None if part.of > 1 else _gathered(planned, kept.finished)


def merge(planned: Plan, folder: Path) -> Sweep:
    """Put the shards in `folder` together. StudyError: one is missing, not finished, or of another sweep."""
    first = next(iter(sorted(folder.glob("shard-*-of-*.jsonl"))), None)
    if first is None:
        raise StudyError(f"{folder}: no shards: expected files such as {Shard(0, 20).file}")
    count = first.stem.rpartition("-")[2]
    if not SHARD_NUMBER.fullmatch(count):
        raise StudyError(f"{first}: expected a name such as {Shard(0, 20).file}")
    finished: dict[int, Any] = {}
    for shard in (Shard(index, int(count)) for index in range(int(count))):
        path = folder / shard.file
        found = journal.read(path, planned.for_shards(shard))
        wanted = planned.part(shard)
        if not set(wanted) <= set(found):
            has = f"{len(found)} of {len(wanted)} chunks"
            raise StudyError(f"{path}: {has}: expected a finished shard; run it again, it goes on")
        finished |= found
    return _gathered(planned, finished)


def _gathered(planned: Plan, finished: Mapping[int, Any]) -> Sweep:
    in_order = (row for chunk in range(planned.chunks) for row in finished[chunk])
    # of an earlier, larger sweep there may be more
    of_this = (row for row, _ in zip(in_order, range(planned.ensemble.count), strict=False))
    return gathered(planned.study, planned.ensemble, planned.pairs, of_this)
