"""Which tests execute which code: one run of all tests, with marks in all code (mutants.blocks).

Kept by test file for as long as that file, what tests share, and the code are unchanged.
"""

from __future__ import annotations

import json
from pathlib import Path
from zlib import crc32

from mutants.blocks import block_at, blocks_of, marked
from mutants.change import Change
from mutants.draw import sources
from mutants.order import files_for, function_at, importers, in_order
from mutants.tree import Tree

Marks = dict[str, tuple[int, float]]  # by test: bits of the marks that it passed, seconds


class Seen:
    def __init__(self, root: Path) -> None:
        self.root = root
        self.texts = {file: (root / file).read_text() for file in sources(root, [])}
        self.numbers: dict[str, int] = {}  # a file's first mark
        count = 0
        for file, text in self.texts.items():
            self.numbers[file] = count
            count += len(blocks_of(file, text))
        self.tests: Marks = {}
        self.imported = 0  # bits of the marks that importing tests passes
        self.beside: list[str] = []  # tests that fail beside marks in C: what compiles for other processors
        self.failing: list[str] = []  # those of them that fail without any, too

    def look(self, tree: Tree, jobs: int, kept: Path) -> None:
        """Run the tests of files that changed since they were noted in `kept`; `tree`: without mutants."""
        shared = [p for p in sorted((self.root / "tests").rglob("*.py")) if not p.name.startswith("test_")]
        shared = [p for p in shared if p.parent.name != "mutants"]
        state = crc32(repr([self.texts, *(p.read_bytes() for p in shared)]).encode())
        now = {
            p.relative_to(self.root).as_posix(): crc32(p.read_bytes())
            for p in sorted((self.root / "tests").rglob("test_*.py"))
        }
        before = json.loads(kept.read_text()) if kept.exists() else {}
        if before.get("state") != state:
            before = {"files": {}, "imported": "0", "tests": {}, "beside": [], "failing": []}
        valid = {file for file, crc in before["files"].items() if now.get(file) == crc}

        def still(names: list[str]) -> list[str]:
            return [name for name in names if name.partition("::")[0] in valid]

        noted = ((test, before["tests"][test]) for test in still(before["tests"]))
        self.tests = {test: (int(bits, 16), seconds) for test, (bits, seconds) in noted}
        self.beside, self.failing = still(before["beside"]), still(before["failing"])
        self.imported = int(before["imported"], 16)
        if wanted := sorted(now.keys() - valid):
            self._run(tree, jobs, wanted)
        tests = {test: (f"{bits:x}", seconds) for test, (bits, seconds) in self.tests.items()}
        new = {"state": state, "files": now, "imported": f"{self.imported:x}", "tests": tests}
        kept.write_text(json.dumps({**new, "beside": self.beside, "failing": self.failing}))

    def _run(self, tree: Tree, jobs: int, files: list[str]) -> None:
        with_marks = {file: marked(file, text, self.numbers[file]) for file, text in self.texts.items()}
        for file, text in with_marks.items():
            tree.write(file, text)
        if said := tree.build():
            raise RuntimeError(said)
        beside = self._noted(tree, jobs, files)
        for file, text in self.texts.items():
            if not file.endswith(".py"):
                tree.write(file, text)
        if said := tree.build():
            raise RuntimeError(said)
        self.beside += beside
        if beside:
            self.failing += self._noted(tree, jobs, beside)
        tree.plain({file: text for file, text in self.texts.items() if file.endswith(".py")})

    def _noted(self, tree: Tree, jobs: int, tests: list[str]) -> list[str]:
        folder, failing = tree.hits(jobs, tests)
        for line in (folder / "tests").read_text().splitlines():
            bits, seconds, test = line.split(" ", 2)
            if test:
                old = self.tests.get(test, (0, 0.0))
                self.tests[test] = old[0] | int(bits, 16), old[1] + float(seconds)
            else:
                self.imported |= int(bits, 16)
        return failing

    def turns(self, file: str, change: Change) -> list[list[str]]:
        """Tests for a mutant: those that execute its block; then all others of their files, since a test may
        judge what another one has run.

        What importing executes is judged by the tests that execute anything of its file or of files that
        import it, if there are any; else by all.
        """
        text = self.texts[file]
        block = block_at(file, text, change.start)
        bits = 0 if block is None else (1 << self.numbers[file] + block) & ~self.imported
        if not bits:
            for other in [file, *importers(file, self.texts)]:
                count = len(blocks_of(other, self.texts[other]))
                bits |= ((1 << count) - 1) << self.numbers[other]
        first = {test: seconds for test, (marks, seconds) in self.tests.items() if marks & bits}
        first = first or {test: seconds for test, (_, seconds) in self.tests.items()}
        likely = files_for(self.root, file, function_at(file, text, change.start))
        of_them = {test.partition("::")[0] for test in first}
        others = {
            test: seconds for test, (_, seconds) in self.tests.items()
            if test not in first and test.partition("::")[0] in of_them
        }  # fmt: skip
        return [in_order(some, likely) for some in (first, others)]
