"""Rules of style that no other tool counts: python tests/style.py prints each place that breaks one.

A rule is a function of all files; what it yields are places, "file:line name". tests/test_style.py holds
how many there may be.
"""

from __future__ import annotations

import ast
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1] / "src" / "cogless"

# Words that say nothing of a value: name what it holds.
VAGUE_NAMES = frozenset(
    {
        "found", "told", "made", "said", "kept", "wanted", "known", "given", "shown", "held", "here", "there",
        "each", "both", "about", "left", "beside",
    }
)  # fmt: skip
VAGUE_FUNCTIONS = VAGUE_NAMES | {"of", "at", "within", "over", "rows", "lines", "text", "words"}
ALIASES = frozenset({"Array", "Real", "Reals", "Complex", "Pair", "Place", "Progress", "All", "Row"})
POSITIONAL_MOST = 5  # arguments of a class
FRAGMENT_WORDS = 5  # a longer comment after code may be a sentence
SMALL_FILE_LINES = 40

FRAGMENT = re.compile(r"^(of|as|in|that|with|by|from|for|at|to|both|each|else|which|who|what|such)\b")
COMMENT_AFTER_CODE = re.compile(r"\S.*  # (.*)$")
STUDIES = re.compile(r"\b(Study|TrialStudy|TrialResults)\b")
KIND_OF_STUDY = re.compile(r"""\.kind [!=]= ["'](speed|trials)["']""")
LAWS = re.compile(
    r"\b(Pi|Adrc|PiIlc|PiAfc|Harmonic|RobustIlc|AntiCogging|Space\w+|Learning|Feedback|OwnLaw|PythonLaw"
    r"|LibraryLaw|Startable|LearnsWhileRunning|TrialLaw|FilteredLaw|\w+Ilc|Memory|STOPPING)\b"
)
FROM_C = re.compile(r"= .*#.*\bCGL_\w+|#.*control/src/cogless/\w+\.[ch]\)?$")
UNIT_FACTOR = re.compile(r"30 / math\.pi|math\.pi / 30|180 / (np|math)\.pi|2 \* (np|math)\.pi\b")
TAKES_TEXT_APART = ("partition", "rpartition", "removeprefix", "splitlines", "startswith")


@dataclass(frozen=True)
class File:
    """A Python file of the product."""

    name: str
    text: str

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.text)

    @cached_property
    def nodes(self) -> list[ast.AST]:
        return list(ast.walk(self.tree))

    def place(self, node: ast.AST, name: str = "") -> str:
        line: int = getattr(node, "lineno", 0)
        return f"{self.name}:{line} {name}".rstrip()

    @property
    def stem(self) -> str:
        return Path(self.name).stem

    def constants(self) -> Iterator[tuple[ast.Name, ast.expr]]:
        """The module's assignments to names in capitals."""
        for node in self.tree.body:
            pairs: list[tuple[ast.expr, ast.expr]] = []
            if isinstance(node, ast.Assign):
                for target in node.targets:
                    if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                        pairs += zip(target.elts, node.value.elts, strict=False)
                    else:
                        pairs.append((target, node.value))
            elif isinstance(node, ast.AnnAssign) and node.value is not None:
                pairs.append((node.target, node.value))
            for target, value in pairs:
                if isinstance(target, ast.Name) and len(target.id) > 1:
                    yield target, value

    def matching(self, pattern: re.Pattern[str]) -> Iterator[str]:
        """Places of the lines in which the pattern is."""
        for number, line in enumerate(self.text.splitlines(), 1):
            if pattern.search(line):
                yield f"{self.name}:{number}"

    def type_tests(self, kinds: re.Pattern[str]) -> Iterator[str]:
        """Calls of isinstance with such a class."""
        for node in self.nodes:
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
                continue
            if node.func.id == "isinstance" and kinds.search(ast.unparse(node.args[1])):
                yield self.place(node)


Files = Sequence[File]
Rule = Callable[[Files], Iterator[str]]


def source_files(folder: Path = SOURCE) -> list[File]:
    """All files of the product."""
    return [
        File(path.relative_to(folder).as_posix(), path.read_text(encoding="utf-8"))
        for path in sorted(folder.rglob("*.py"))
    ]


def constant_with_several_values(files: Files) -> Iterator[str]:
    """A constant's name has one value."""
    values: dict[str, set[str]] = defaultdict(set)
    for file in files:
        for target, value in file.constants():
            if target.id.isupper():
                values[target.id].add(ast.unparse(value))
    yield from (name for name, several in values.items() if len(several) > 1)


def number_of_one_word(files: Files) -> Iterator[str]:
    """A number's constant has two words or more: GRID_POINTS. The factor of a unit bears the unit's name."""
    for file in files:
        if file.name == "units.py":
            continue
        for target, value in file.constants():
            number = isinstance(value, ast.BinOp) or (
                isinstance(value, ast.Constant) and not isinstance(value.value, str)
            )
            if target.id.isupper() and "_" not in target.id and number:
                yield file.place(target, target.id)


def vague_local(files: Files) -> Iterator[str]:
    """A value is named by its noun. A field may be a key of a file (`about`) or a member in C (`held`)."""
    for file in files:
        classes = (node for node in file.nodes if isinstance(node, ast.ClassDef))
        fields = {id(part.target) for one in classes for part in one.body if isinstance(part, ast.AnnAssign)}
        for node in file.nodes:
            stored = isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            if stored and node.id in VAGUE_NAMES and id(node) not in fields:
                yield file.place(node, node.id)


def vague_argument(files: Files) -> Iterator[str]:
    """An argument is named by its noun."""
    for file in files:
        for node in file.nodes:
            if isinstance(node, ast.arg) and node.arg in VAGUE_NAMES:
                yield file.place(node, node.arg)


def vague_function(files: Files) -> Iterator[str]:
    """A function is a verb or what it returns."""
    for file in files:
        for node in file.nodes:
            if isinstance(node, ast.FunctionDef) and node.name.strip("_") in VAGUE_FUNCTIONS:
                yield file.place(node, node.name)


def many_positional_arguments(files: Files) -> Iterator[str]:
    """Many arguments of a class go by keyword."""
    for file in files:
        for node in file.nodes:
            if isinstance(node, ast.Call) and len(node.args) > POSITIONAL_MOST:
                name = ast.unparse(node.func).split(".")[-1]
                if name[:1].isupper():
                    yield file.place(node, name)


def fragment_of_a_comment(files: Files) -> Iterator[str]:
    """A comment is a sentence or a unit."""
    for file in files:
        for number, line in enumerate(file.text.splitlines(), 1):
            comment = COMMENT_AFTER_CODE.search(line)
            if comment is None or "noqa" in line:
                continue
            if FRAGMENT.match(comment[1]) and len(comment[1].split()) <= FRAGMENT_WORDS:
                yield f"{file.name}:{number} {comment[1]}"


def alias_defined_again(files: Files) -> Iterator[str]:
    """An alias of a type stands once."""
    homes: dict[str, list[str]] = defaultdict(list)
    for file in files:
        for target, _ in file.constants():
            if target.id in ALIASES:
                homes[target.id].append(file.place(target, target.id))
    yield from (place for places in homes.values() for place in places[1:])


def type_test_of_a_study(files: Files) -> Iterator[str]:
    """A kind of study answers for itself. Only the file that reads both kinds tells them apart."""
    for file in files:
        if file.name != "study/reading.py":
            yield from file.type_tests(STUDIES)


def comparison_of_a_kind_of_study(files: Files) -> Iterator[str]:
    """What differs by kind of study is a method of the study, or an entry of a room's table."""
    for file in files:
        yield from file.matching(KIND_OF_STUDY)


def type_test_of_a_law(files: Files) -> Iterator[str]:
    """A law answers for itself. Only the files of a law's rules, which know it, tell its variants apart."""
    for file in files:
        if not file.name.startswith("design/laws/"):
            yield from file.type_tests(LAWS)


def message_taken_apart(files: Files) -> Iterator[str]:
    """What is needed of an error is a field of it, not a part of its text; errors.py parts texts."""
    for file in files:
        if file.name == "errors.py":
            continue
        for node in file.nodes:
            takes_apart = isinstance(node, ast.Attribute) and node.attr in TAKES_TEXT_APART
            if takes_apart and "str(error)" in ast.unparse(node):
                yield file.place(node)


def number_copied_from_c(files: Files) -> Iterator[str]:
    """A number of the control library is read from its headers."""
    for file in files:
        yield from file.matching(FROM_C)


def unit_factor_written_out(files: Files) -> Iterator[str]:
    """Factors of units come from units.py."""
    for file in files:
        yield from file.matching(UNIT_FACTOR)


def file_name_used_again(files: Files) -> Iterator[str]:
    """A file's name stands for one subject; a law's keys and its design bear its name."""
    names = Counter(
        file.stem for file in files if file.stem != "__init__" and not file.name.startswith("design/laws/")
    )
    yield from (name for name, count in names.items() if count > 1)


def small_file(files: Files) -> Iterator[str]:
    """A file follows a subject, not a function; a law is one, however short."""
    for file in files:
        of_a_law = file.name.startswith(("study/laws/", "design/laws/"))
        if file.text.count("\n") <= SMALL_FILE_LINES and "__" not in file.name and not of_a_law:
            yield file.name


RULES: tuple[Rule, ...] = (
    constant_with_several_values, number_of_one_word, vague_local, vague_argument, vague_function,
    many_positional_arguments, fragment_of_a_comment, alias_defined_again, type_test_of_a_study,
    comparison_of_a_kind_of_study, type_test_of_a_law, message_taken_apart, number_copied_from_c,
    unit_factor_written_out, file_name_used_again, small_file,
)  # fmt: skip


def main() -> None:
    """Prints every place, rule by rule."""
    files = source_files()
    for rule in RULES:
        places = list(rule(files))
        print(f"{len(places)} {rule.__name__}: {rule.__doc__}", *places, sep="\n    ")


if __name__ == "__main__":
    main()
