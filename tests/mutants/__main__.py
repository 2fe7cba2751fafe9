"""Judges mutants: builds each in a copy of the tree, and runs tests until one fails."""

from __future__ import annotations

import argparse
import json
import signal
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from threading import Lock
from time import monotonic
from typing import Any
from zlib import crc32

from mutants.change import Change
from mutants.draw import drawn
from mutants.hits import noted, with_probes
from mutants.order import files_for, function_at, those_of
from mutants.tree import Tree

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "build" / "mutants"
Hits = dict[tuple[str, int], list[str]]  # tests by file and position


class Log:
    """Log of judged mutants, one line each, so that an interrupted run can be continued.

    A killed mutant's entry is valid as long as its source file is unchanged; that of a survivor only as long
    as the tests are unchanged, too.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.lock = path, Lock()
        self.tests = crc32(b"".join(test.read_bytes() for test in sorted((ROOT / "tests").rglob("*.py"))))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
        self.known = [json.loads(line) for line in path.read_text().splitlines()]

    def judged(self, mutant: dict[str, Any]) -> dict[str, Any] | None:
        for entry in reversed(self.known):
            if mutant.items() <= entry.items():
                return None if entry["outcome"] == "survived" and entry["tests"] != self.tests else entry
        return None

    def add(self, entry: dict[str, Any]) -> dict[str, Any]:
        with self.lock, self.path.open("a") as file:
            file.write(json.dumps({**entry, "tests": self.tests}) + "\n")
        return entry


def hits(places: list[tuple[str, int]], tree: Tree, jobs: int, log: Log) -> Hits:
    """Tests that execute the statements at these places (file, position), those in functions of Python.

    This runs all tests once. The answer is kept for as long as code and tests are unchanged.
    """
    texts = {file: (ROOT / file).read_text() for file, _ in places if file.endswith(".py")}
    kept = FOLDER / f"hits-{crc32(repr((log.tests, places, texts)).encode())}.json"
    if not kept.exists():
        probed: list[int] = []
        for file, text in texts.items():
            here = {n: place for n, (other, place) in enumerate(places) if other == file}
            with_calls, numbers = with_probes(text, here)
            tree.write(file, with_calls)
            probed += numbers
        found = tree.hits(jobs)
        for file, text in texts.items():
            tree.write(file, text)
        kept.write_text(json.dumps([[*places[n], noted(found, n)] for n in probed]))
    return {(file, place): tests for file, place, tests in json.loads(kept.read_text())}


def judge(
    draw: Iterator[tuple[str, Change]], free: SimpleQueue[Tree], log: Log, executed: Hits
) -> dict[str, Any]:
    """Judge the first mutant of a draw that compiles to other code than the original."""
    tree, begin = free.get(), monotonic()
    try:
        for file, change in draw:
            text = (ROOT / file).read_text()
            mutant = {
                "file": file, "line": change.line(text), "change": change.described(text),
                "place": change.start, "source": crc32(text.encode()),
            }  # fmt: skip
            known = log.judged(mutant)
            if known is None and tree.takes(file, change.applied(text)):
                function = function_at(file, text, change.start)
                files = files_for(ROOT, file, function)
                verdict = tree.judge(file, those_of(files, executed.get((file, change.start), [""])))
                known = log.add({**mutant, **verdict._asdict(), "seconds": round(monotonic() - begin)})
            tree.write(file, text)
            if known is not None and known["outcome"] != "none":
                told(known)
                return known
            if known is None:
                log.add({**mutant, "outcome": "none"})
        raise SystemExit("no more mutants to draw")
    finally:
        free.put(tree)


def told(entry: dict[str, Any]) -> None:
    by = f" by {entry['by']}" if entry["by"] else ""
    place = f"{entry['file']}:{entry['line']}"
    line = f"{entry['outcome']}{by} in {entry['seconds']} s\n    {place}: {entry['change']}\n"
    print(line, end="", flush=True)  # in one call, since other threads print, too


def main() -> None:
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--jobs", type=int, default=2, help="mutants at a time, each in a copy of its own")
    parser.add_argument("paths", nargs="*", help="only in these files or folders")
    asked = parser.parse_args()

    def draws() -> list[Iterator[tuple[str, Change]]]:
        return drawn(ROOT, asked.paths, asked.count, asked.seed)

    log = Log(FOLDER / "log.jsonl")
    free: SimpleQueue[Tree] = SimpleQueue()
    with ThreadPoolExecutor(asked.jobs) as pool:
        trees = list(pool.map(lambda n: Tree(ROOT, FOLDER / str(n)), range(asked.jobs)))
        for tree in trees:
            free.put(tree)
        try:
            firsts = [next(draw) for draw in draws()]
            executed = hits([(file, change.start) for file, change in firsts], trees[0], asked.jobs, log)
            entries = list(pool.map(lambda draw: judge(draw, free, log, executed), draws()))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for tree in trees:
                tree.stop()
            raise

    trees[0].build()
    noticing = sorted({e["by"] for e in entries if e["by"].startswith("tests/")})
    wrong = trees[0].failing(noticing) if noticing else []
    counts = Counter(entry["outcome"] for entry in entries)
    noticed = len(entries) - counts["survived"]
    share = f"{noticed / len(entries):.0%}, {counts['time-out']} by time-out"
    print(f"\n{noticed} of {len(entries)} noticed, {share}")
    for entry in entries:
        if entry["outcome"] == "survived":
            print(f"{entry['file']}:{entry['line']}: {entry['change']}")
    if wrong:
        raise SystemExit("these tests fail without a mutant: " + ", ".join(wrong))


if __name__ == "__main__":
    main()
