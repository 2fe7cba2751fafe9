"""Run every variant of an ensemble, on workers of any kind, and keep what is finished.

The journal of a sweep or a search keeps the finished chunks, so that an interrupted one goes on.

A journal is a file of lines, each written in one go: first the identity of the sweep or search, then a line
for each finished chunk. A line is the CRC-32 of a JSON text in eight hex digits, a space, and that text. A
damaged line isn't used, so that its chunk runs again.

This module also has the work of one task, which runs in any process or machine: `variant_rows`.
"""

from __future__ import annotations

import fcntl
import json
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from io import RawIOBase
from pathlib import Path
from typing import Any

from cogless.ensemble.sweep_table import Row, Sweep, columns, gathered
from cogless.ensemble.variants import Ensemble, draw
from cogless.ensemble.workers import Parcel, Workers, executor_workers, pack, run_all, unpacked
from cogless.errors import StudyError
from cogless.files import no_device, no_link, reason, versions
from cogless.lines import warn
from cogless.results import AnyResults
from cogless.run.simulate import Pair, RunError, rollout, runs_of
from cogless.study import AnyStudy, changed

Chunk = int
CHECKSUM_BYTES = 9  # bytes at the start of a line: checksum and space


class Journal:
    """An open journal. `finished`: by chunk its rows, of a sweep as `variant_rows` returns them."""

    def __init__(self, path: Path, file: RawIOBase, finished: dict[Chunk, Any]) -> None:
        self.path, self.finished = path, finished
        self._file = file

    def add(self, chunk: Chunk, rows: Any) -> None:
        """Keep a finished chunk. StudyError: the file can't be written, such as on a full disk."""
        _append(self.path, self._file, [chunk, rows])
        self.finished[chunk] = rows


@contextmanager
def opened(path: Path, identity: Mapping[str, Any]) -> Iterator[Journal]:
    """Open the journal of the sweep with this `identity`; create it if there is none.

    StudyError: the file belongs to another sweep, another process writes to it, or it can't be written.
    """
    try:
        no_link(path)
        no_device(path)
        file = open(path, "a+b", buffering=0)  # noqa: SIM115
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StudyError(f"{path}: in use: expected no other command that writes here") from None
        file.seek(0)
        content = file.read()
        lines = _whole_lines(content)
        begun = lines or not _line(identity).startswith(content)
        finished = _read(path, lines, identity) if begun else {}
        file.truncate(sum(len(line) + 1 for line in lines))  # drops a line that a kill cut off
        if not begun:
            _append(path, file, identity)
        yield Journal(path, file, finished)


def read(path: Path, identity: Mapping[str, Any]) -> dict[Chunk, Any]:
    """The finished chunks of a journal, read without a lock: no process may still write to it."""
    try:
        no_device(path)
        content = path.read_bytes()
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a shard's file") from error
    return _read(path, _whole_lines(content), identity)


def _whole_lines(content: bytes) -> list[bytes]:
    """The complete lines, without line ends; a kill may have left the last line incomplete."""
    return content.split(b"\n")[:-1]


def _append(path: Path, file: RawIOBase, value: Any) -> None:
    """Write a line at once. The file has no buffer: a failed write would be repeated when it is closed."""
    line = memoryview(_line(value))
    try:
        while line:
            line = line[file.write(line) :]
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from error


def _line(value: Any) -> bytes:
    text = json.dumps(value, separators=(",", ":")).encode()
    return _checksum(text) + text + b"\n"


def _checksum(text: bytes) -> bytes:
    return b"%08x " % zlib.crc32(text)


def _value(line: bytes) -> Any:
    """The value in a line; None if the line is damaged."""
    text = line[CHECKSUM_BYTES:]
    try:
        return json.loads(text) if line.startswith(_checksum(text)) else None
    except (ValueError, RecursionError):
        return None


def _read(path: Path, lines: list[bytes], identity: Mapping[str, Any]) -> dict[Chunk, Any]:
    has = _value(lines[0]) if lines else None
    if not isinstance(has, dict):
        expected = "expected a file that this command has written"
        if lines and lines[0].startswith(b"{"):
            expected = "was written by an earlier cogless, without checksums: expected another directory"
        raise StudyError(f"{path}: not readable: {expected}")
    different = next((key for key in identity if has.get(key) != identity[key]), None)
    if different is not None:
        difference = (
            f"{identity[different]}, which this command has" if different != "study" else "the same study"
        )
        where = f"{path}: {different}: {has.get(different)}"
        raise StudyError(f"{where}: expected {difference}, or another directory")
    finished: dict[Chunk, Any] = {}
    for number, line in enumerate(lines[1:], 2):
        match _value(line):
            case [int(chunk), list(rows)]:
                finished[chunk] = rows
            case _:
                warn(f"{path}: line {number} is damaged and not used")
    return finished


class Ended(Exception):  # noqa: N818, it isn't an error
    """Ctrl-C reached a worker."""


def variant_rows(
    parcel: Parcel, changes: Sequence[Mapping[str, Any]], pairs: Sequence[Pair]
) -> list[list[Row]]:
    """Run these variants: for each, in order, one row per pair of scenario and controller."""
    study = unpacked(parcel)
    metrics = columns(study)
    variants = [_variant_or_reason(study, of_variant) for of_variant in changes]
    errors: Sequence[Mapping[Pair, StudyError]] = []
    valid = [variant for variant in variants if not isinstance(variant, str)]
    try:
        results: Sequence[AnyResults] = rollout(
            valid, ["/".join(pair) for pair in pairs], jobs=1, keep_traces=False
        )
        if any(rows_of_variants.interrupted for rows_of_variants in results):
            raise Ended
    except RunError as error:
        results, errors = error.all_results, error.all_errors
    finished = zip(results, errors or [{}] * len(valid), strict=True)
    rows_of_variants = []
    for variant in variants:
        if isinstance(variant, str):
            rows_of_variants.append([_failed_row(len(metrics), variant) for _ in pairs])
            continue
        of_variant, failed = next(finished)
        runs = {(run.scenario, run.controller): run.metrics for run in of_variant.runs}
        rows_of_variants.append(
            [
                _failed_row(len(metrics), _error_text(variant, failed[pair]))
                if pair in failed
                else [*(column.number_in(runs[pair]) for column in metrics), None]
                for pair in pairs
            ]
        )
    return rows_of_variants


def needed(study: AnyStudy) -> str:
    """What a task needs to end, for a message: enough memory, and own laws that don't end the process."""
    own = [
        f"controller.{name} not to end the process ({study.source.folder / law.code})"
        for name, law in study.controller.items()
        if law.code is not None
    ]
    return f"{', '.join(own)}, or enough memory" if own else "enough memory for it"


def _failed_row(columns: int, why: str) -> Row:
    return [*[None] * columns, why]


def _variant_or_reason(study: AnyStudy, changes: Mapping[str, Any]) -> AnyStudy | str:
    """The study of a variant, or the text of the error if the study refuses the changes."""
    try:
        return changed(study, changes)
    except StudyError as error:
        return _error_text(study, error)


def _error_text(study: AnyStudy, error: StudyError) -> str:
    """The error without the folder of the study, which differs between machines."""
    return str(error).replace(str(study.source.path), study.source.path.name)


SHARD_NUMBER = re.compile("[1-9][0-9]{0,8}")
TASK_VARIANTS = 16  # variants of a task: enough to run in lock step, few to lose with a worker

SweepProgress = Callable[[int], None]


@dataclass(frozen=True)
class Shard:
    """A part of a sweep: the chunks `index`, `index` + `of`, `index` + 2 `of`, ... counted from 0."""

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
    identity: Mapping[str, Any]  # written into the journal, to tell this sweep from others

    @property
    def chunks(self) -> int:
        return -(-self.ensemble.count // TASK_VARIANTS)

    def part(self, shard: Shard) -> range:
        """The chunks of a shard."""
        return range(shard.index, self.chunks, shard.of)

    def variants(self, shard: Shard) -> int:
        """Number of variants of a shard."""
        return sum(map(self.size, self.part(shard)))

    def size(self, chunk: int) -> int:
        """Number of variants of a chunk."""
        return min(self.ensemble.count - chunk * TASK_VARIANTS, TASK_VARIANTS)

    def changes(self, chunk: int) -> list[dict[str, Any]]:
        """The changes of the study, by dotted key, for each variant of a chunk."""
        first = chunk * TASK_VARIANTS
        return [self.ensemble.changes(variant) for variant in range(first, first + self.size(chunk))]

    def for_shards(self, shard: Shard) -> dict[str, Any]:
        """The identity in a shard's journal; several shards also depend on the number of variants."""
        return {**self.identity, **({"variants": self.ensemble.count} if shard.of > 1 else {})}


def plan(study: AnyStudy, count: int, only: Sequence[str] | None = None) -> Plan:
    """Plan a sweep of `count` variants. StudyError: no [vary], a mistake there, no such run, no metric."""
    pairs = runs_of(study, only)
    if not columns(study):
        raise StudyError(f"{study.source.path}: metric: missing: expected one or more metrics to compare")
    ensemble = draw(study, count)
    identity = {
        "study": pack(study).digest[:16],
        "version": versions()["cogless"],
        "runs": ["/".join(pair) for pair in pairs],
        "first": ensemble.changes(0),
    }
    return Plan(study, ensemble, pairs, identity)


def run(
    planned: Plan,
    folder: Path,
    workers: Workers | Executor,
    shard: Shard | None = None,
    progress: SweepProgress | None = None,
) -> Sweep | None:
    """Run a sweep, or go on with one; returns None for a shard, since `merge` puts all shards together.

    `folder`: an existing folder for the journal. `progress` is called with the number of finished variants,
    including those of an earlier call. StudyError: a journal of another sweep, a worker that keeps dying.
    """
    part = shard or Shard()
    chunks = planned.part(part)
    with opened(folder / part.file, planned.for_shards(part)) as journal:
        report = progress or (lambda variants: None)
        # the last chunk of an earlier, smaller sweep may be too short: it runs again
        remaining = [c for c in chunks if len(journal.finished.get(c, ())) < planned.size(c)]
        done = planned.variants(part) - sum(map(planned.size, remaining))
        report(done)

        def finished(chunk: int, finished: Any) -> None:
            nonlocal done
            journal.add(chunk, finished)
            done += len(finished)
            report(done)

        parcel = pack(planned.study)

        def arguments(chunk: int) -> Sequence[Any]:
            return parcel, planned.changes(chunk), planned.pairs

        at = workers if isinstance(workers, Workers) else executor_workers(workers)
        run_all(at, variant_rows, remaining, arguments, finished, needed(planned.study))
        return None if part.of > 1 else _gathered(planned, journal.finished)


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
        chunks = read(path, planned.for_shards(shard))
        expected_chunks = planned.part(shard)
        if not set(expected_chunks) <= set(chunks):
            raise StudyError(
                f"{path}: {len(chunks)} of {len(expected_chunks)} chunks: expected a finished shard: repeat "
                "the command that began it, which does the other chunks"
            )
        finished |= chunks
    return _gathered(planned, finished)


def _gathered(planned: Plan, finished: Mapping[int, Any]) -> Sweep:
    in_order = (row for chunk in range(planned.chunks) for row in finished[chunk])
    # the journal may have more rows, from an earlier, larger sweep
    of_this = (row for row, _ in zip(in_order, range(planned.ensemble.count), strict=False))
    return gathered(planned.study, planned.ensemble, planned.pairs, of_this)
