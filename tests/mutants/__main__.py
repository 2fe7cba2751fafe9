"""Judges mutants: builds each in a copy of the tree, and runs tests until one fails."""

from __future__ import annotations

import argparse
import json
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path
from queue import SimpleQueue
from threading import Lock
from time import monotonic
from typing import Any, NamedTuple
from zlib import crc32

from mutants.change import Change
from mutants.draw import drawn
from mutants.hits import noted, seconds, with_probes
from mutants.order import LIKELY, files_for, function_at, others_of, those_of
from mutants.switched import culprits, switched
from mutants.tree import Tree

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "build" / "mutants"
Mutant = tuple[str, Change]  # file, and what is changed in it


class Noted(NamedTuple):
    """What one run of all tests shows."""

    hits: dict[tuple[str, int], list[str]]  # tests by file and position
    seconds: dict[str, float]  # by test file
    failing: list[str]  # tests that fail beside mutants which none chose: what compiles for other processors


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
    """Build mutants of C and C++ as one, the first of each draw that compiles; which those are, by number,
    and the numbers of those that have to be built alone."""
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


def noted_of(mutants: dict[int, Mutant], tree: Tree, jobs: int, log: Log) -> Noted:
    """Tests that execute the statements of these mutants of Python within functions, and the functions of
    those of C and C++ that are built together.

    This runs all tests once. The answer is kept for as long as code and tests are unchanged.
    """
    places = {n: (file, change.start) for n, (file, change) in mutants.items()}
    texts = {file: (ROOT / file).read_text() for file, _ in places.values()}
    kept = FOLDER / f"noted-{crc32(repr((log.tests, places, texts)).encode())}.json"
    if not kept.exists():
        probed = {n for n, (file, _) in places.items() if not file.endswith(".py")}
        for file, text in texts.items():
            if file.endswith(".py"):
                here = {n: start for n, (other, start) in places.items() if other == file}
                with_calls, numbers = with_probes(text, here)
                tree.write(file, with_calls)
                probed |= numbers
        folder, failing = tree.hits(jobs)
        for file, text in texts.items():
            if file.endswith(".py"):
                tree.write(file, text)
        tree.install_python()
        found = [[*places[n], noted(folder, n)] for n in sorted(probed)]
        kept.write_text(json.dumps([found, seconds(folder), failing]))
    found, spent, failing = json.loads(kept.read_text())
    return Noted({(file, place): tests for file, place, tests in found}, spent, failing)


def described(file: str, change: Change) -> dict[str, Any]:
    text = (ROOT / file).read_text()
    return {
        "file": file, "line": change.line(text), "change": change.described(text),
        "place": change.start, "source": crc32(text.encode()),
    }  # fmt: skip


def judge_beside(
    number: int, mutant: Mutant, free: SimpleQueue[Tree], log: Log, turns: list[list[str]]
) -> dict[str, Any]:
    """Judge a mutant of Python, or one of those that are built together, by these tests; what they do not
    notice is not settled yet."""
    entry = described(*mutant)
    known = log.judged(entry)
    if known is not None and known["outcome"] in ("killed", "time-out"):
        told(known)
        return known
    (file, change), tree, begin = mutant, free.get(), monotonic()
    text = (ROOT / file).read_text()
    try:
        if not file.endswith(".py"):
            tree.chosen = number
        elif not tree.takes(file, change.applied(text)):
            return {**entry, "outcome": "none", "by": ""}
        verdict = tree.judge(file, turns)
    finally:
        tree.chosen = 0
        if file.endswith(".py"):
            tree.write(file, text)
            tree.install_python()
        free.put(tree)
    entry |= {**verdict._asdict(), "seconds": round(monotonic() - begin)}
    told(entry)
    return entry


def judge_alone(
    draw: Iterator[Mutant], free: SimpleQueue[Tree], log: Log, run: Noted, passed: Mutant | None
) -> dict[str, Any]:
    """Judge the first mutant of a draw that compiles to other code than the original. `passed`: one that the
    tests which run beside other mutants did not notice."""
    tree, begin = free.get(), monotonic()
    try:
        for file, change in draw:
            text = (ROOT / file).read_text()
            mutant = described(file, change)
            known = None if (file, change) == passed else log.judged(mutant)
            if known is None and tree.takes(file, change.applied(text)):
                turns = [run.failing] if (file, change) == passed else [_likely_first((file, change))]
                verdict = tree.judge(file, turns, (file, change) != passed)
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


def remaining(mutant: Mutant, run: Noted) -> list[list[str]]:
    """Tests beside the likely ones that may notice a mutant."""
    (file, change), files = mutant, _likely_first(mutant)
    executing = run.hits.get((file, change.start), [""] if file.endswith(".py") else [])
    if file.endswith(".py"):
        return those_of(files, executing)
    return [others_of(files, executing, run.seconds)]


def _likely_first(mutant: Mutant) -> list[str]:
    file, change = mutant
    return files_for(ROOT, file, function_at(file, (ROOT / file).read_text(), change.start))


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
            firsts = {n: next(draw) for n, draw in draws.items()}
            draws = {n: chain([firsts[n]], draw) for n, draw in draws.items()}
            compiled = {n: draws[n] for n, (file, _) in firsts.items() if not file.endswith(".py")}
            mutants, alone = together(compiled, trees)
            switchable = {n: mutant for n, mutant in mutants.items() if n not in alone}
            left = {n: mutant for n, mutant in firsts.items() if n not in compiled} | switchable
            entries: dict[int, dict[str, Any]] = {}

            def judged(turns: Callable[[Mutant], list[list[str]]]) -> None:
                """Judge those that are left; what only notices that there are mutants is avoided from then
                on."""
                again, passed = dict(left), set[int]()
                while again:
                    some = [(n, mutant, free, log, turns(mutant)) for n, mutant in again.items()]
                    new = dict(zip(again, pool.map(lambda one: judge_beside(*one), some), strict=True))
                    passed |= {n for n, entry in new.items() if entry["outcome"] in ("survived", "none")}
                    by = {entry["by"] for entry in new.values() if entry["by"].startswith("tests/")}
                    wrong = trees[0].failing(sorted(by)) if by else []
                    for tree in trees:
                        tree.avoided += wrong
                    again = {n: again[n] for n, entry in new.items() if entry["by"] in wrong}
                    for n in new.keys() - again.keys() - passed:
                        entries[n] = log.add(new[n])
                        del left[n]

            judged(lambda mutant: [_likely_first(mutant)[:LIKELY]])
            run = Noted({}, {}, trees[0].avoided)
            if left:
                run = noted_of(left, trees[0], asked.jobs, log)
                for tree in trees:
                    tree.avoided = list(run.failing)
                judged(lambda mutant: remaining(mutant, run))
            originals = {file: (ROOT / file).read_text() for file, _ in mutants.values()}
            list(pool.map(lambda tree: tree.plain(originals), trees))
            trees[0].avoided = []
            really = trees[0].failing(run.failing) if run.failing else []
            for tree in trees:
                tree.avoided = really
            run = run._replace(failing=[test for test in run.failing if test not in really])
            again = [n for n in firsts if n not in entries]

            def one(n: int) -> dict[str, Any]:
                draw = chain([mutants[n]], draws[n]) if n in mutants else draws[n]
                return judge_alone(draw, free, log, run, left.get(n))

            entries |= zip(again, pool.map(one, again), strict=True)
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
