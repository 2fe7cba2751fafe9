"""Judges mutants: builds each in a copy of the tree, and runs tests until one fails."""

from __future__ import annotations

import argparse
import json
import signal
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path
from queue import SimpleQueue
from threading import Lock
from time import monotonic
from typing import Any
from zlib import crc32

from mutants.change import Change
from mutants.draw import drawn
from mutants.seen import Seen
from mutants.switched import culprits, switched
from mutants.tree import Tree

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "build" / "mutants"
Mutant = tuple[str, Change]  # file, and what is changed in it


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


def together(draws: dict[int, Iterator[Mutant]], trees: list[Tree]) -> tuple[dict[int, Mutant], set[int]]:
    """Build mutants of C and C++ together, of each draw the first that compiles. Returns them by number, and
    the numbers of those that have to be built alone."""
    current = {n: next(draw) for n, draw in draws.items()}
    while True:
        lines = {}
        for file in {file for file, _ in current.values()}:
            here = {n: change for n, (other, change) in current.items() if other == file}
            text, lines[file] = switched((ROOT / file).read_text(), here)
            for tree in trees:
                tree.write(file, text)
        said = trees[0].build()
        wrong = {n for file in lines for n in culprits(said, file, lines[file])}
        if not said:
            break
        if not wrong:
            raise RuntimeError(said)
        for n in wrong:
            draw = draws[n]
            file, _ = current[n]
            current[n] = next(draw)
            for tree in trees:
                tree.write(file, (ROOT / file).read_text())
    for tree in trees:
        if said := tree.build():
            raise RuntimeError(said)
        if not tree.passes_beside_c():
            raise RuntimeError(tree.said)
    return current, current.keys() - {n for some in lines.values() for n in some.values()}


def described(file: str, change: Change) -> dict[str, Any]:
    text = (ROOT / file).read_text()
    return {
        "file": file, "line": change.line(text), "change": change.described(text),
        "place": change.start, "source": crc32(text.encode()),
    }  # fmt: skip


def judge_beside(
    number: int, mutant: Mutant, free: SimpleQueue[Tree], log: Log, seen: Seen
) -> dict[str, Any] | None:
    """Judge one of the mutants that are built together; None if no test that can run beside them notices."""
    entry = described(*mutant)
    known = log.judged(entry)
    if known is None:
        tree, begin = free.get(), monotonic()
        try:
            while True:
                tree.chosen = number
                verdict = tree.judge(mutant[0], seen.turns(*mutant))
                tree.chosen = 0
                wrong = tree.failing([verdict.by]) if verdict.by.startswith("tests/") else []
                if not wrong:
                    break
                seen.beside += wrong  # this test fails with any mutants in the build, not by this one
        finally:
            tree.chosen = 0
            free.put(tree)
        if verdict.outcome == "survived":
            return None
        known = log.add({**entry, **verdict._asdict(), "seconds": round(monotonic() - begin)})
    told(known)
    return known


def judge_alone(
    draw: Iterator[Mutant], free: SimpleQueue[Tree], log: Log, seen: Seen, passed: Mutant | None = None
) -> dict[str, Any]:
    """Judge the first mutant of a draw that compiles to other code than the original. `passed`: one that the
    tests which run beside other mutants did not notice."""
    tree, begin = free.get(), monotonic()
    try:
        for file, change in draw:
            text = (ROOT / file).read_text()
            mutant = described(file, change)
            known = log.judged(mutant)
            if known is None and tree.takes(file, change.applied(text)):
                again = (file, change) == passed
                alone = [test for test in seen.beside if test not in seen.failing]
                turns = [alone] if again else seen.turns(file, change)
                verdict = tree.judge(file, turns, not again)
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

    draws = dict(enumerate(drawn(ROOT, asked.paths, asked.count, asked.seed), start=1))
    log = Log(FOLDER / "log.jsonl")
    free: SimpleQueue[Tree] = SimpleQueue()
    with ThreadPoolExecutor(asked.jobs) as pool:
        trees = list(pool.map(lambda n: Tree(ROOT, FOLDER / str(n)), range(asked.jobs)))
        for tree in trees:
            free.put(tree)
        try:
            trees[0].plain({})
            seen = Seen(ROOT)
            seen.look(trees[0], asked.jobs, FOLDER / "seen.json")
            for tree in trees:
                tree.plain({})
                tree.avoided = seen.failing
            firsts = {n: next(draw) for n, draw in draws.items()}
            draws = {n: chain([firsts[n]], draw) for n, draw in draws.items()}
            compiled = {n: draws[n] for n, (file, _) in firsts.items() if not file.endswith(".py")}

            mutants: dict[int, Mutant] = {}  # those that are built together
            lonely: set[int] = set()  # and of them those that cannot be

            def alone(n: int) -> dict[str, Any]:
                draw = chain([mutants[n]], draws[n]) if n in mutants else draws[n]
                return judge_alone(draw, free, log, seen, None if n in lonely else mutants.get(n))

            python = [n for n in draws if n not in compiled]
            entries = dict(zip(python, pool.map(alone, python), strict=True))
            mutants, lonely = together(compiled, trees)
            for tree in trees:
                tree.avoided = seen.beside  # the same list, which grows
            some = [n for n in mutants if n not in lonely]
            beside = pool.map(lambda n: judge_beside(n, mutants[n], free, log, seen), some)
            entries |= {n: entry for n, entry in zip(some, beside, strict=True) if entry is not None}
            originals = {file: (ROOT / file).read_text() for file, _ in mutants.values()}
            for tree in trees:
                tree.plain(originals)
                tree.avoided = seen.failing
            left = [n for n in compiled if n not in entries]
            entries |= zip(left, pool.map(alone, left), strict=True)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for tree in trees:
                tree.stop()
            raise

    trees[0].install_python()
    noticing = sorted({e["by"] for e in entries.values() if e["by"].startswith("tests/")})
    wrong = trees[0].failing(noticing) if noticing else []
    counts = Counter(entry["outcome"] for entry in entries.values())
    noticed = len(entries) - counts["survived"]
    share = f"{noticed / len(entries):.0%}, {counts['time-out']} by time-out"
    print(f"\n{noticed} of {len(entries)} noticed, {share}")
    rooms = Counter(Path(entry["file"]).parts[0] for entry in entries.values())
    print("drawn: " + ", ".join(f"{count} in {room}" for room, count in sorted(rooms.items())))
    for entry in entries.values():
        if entry["outcome"] == "survived":
            print(f"{entry['file']}:{entry['line']}: {entry['change']}")
    if wrong:
        raise SystemExit("these tests fail without a mutant: " + ", ".join(wrong))


if __name__ == "__main__":
    main()
