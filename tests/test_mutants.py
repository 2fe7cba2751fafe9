"""The mutants that `make mutants` draws: where they are and what they say, on a few lines."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from mutants import c_code, python_code
from mutants.blocks import block_at, blocks_of, marked
from mutants.change import Change, other_numbers
from mutants.draw import drawn, sources
from mutants.order import files_for, function_at
from mutants.seen import Seen
from mutants.switched import PAGE, culprits, switched
from mutants.tree import Tree, Verdict

ROOT = Path(__file__).parents[1]


def made(changes: list[Change], text: str) -> set[str]:
    """What they make of a text of one line."""
    return {c.applied(text).strip() for c in changes}


def of_python(line: str) -> set[str]:
    text = f"def f(a, b):\n    {line}\n"
    return {t.removeprefix("def f(a, b):\n    ") for t in made(python_code.changes(text), text)}


def of_c(line: str) -> set[str]:
    text = f"int f(int a)\n{{\n    {line}\n}}\n"
    found = made(c_code.changes(text), text)
    return {t.removeprefix("int f(int a)\n{\n    ").removesuffix("\n}") for t in found}


def test_numbers_keep_their_notation() -> None:
    assert list(other_numbers("3")) == ["4", "0", "6"]
    assert list(other_numbers("0.5")) == ["1.5", "0.0", "1.0"]
    assert list(other_numbers("16U")) == ["17U", "0U", "32U"]
    assert list(other_numbers("0x0F")) == ["0x10", "0x0", "0x1e"]
    assert list(other_numbers("1e-3f")) == ["1.001f", "0.0f", "0.002f"]
    assert list(other_numbers("1'000")) == ["1001", "0", "2000"]
    assert list(other_numbers("0")) == ["1"]


def test_python() -> None:
    assert of_python("return (a) + b  # a - b") == {"return (a) - b  # a - b", "return None  # a - b"}
    assert of_python("é = a < b or 'and'") == {"é = a <= b or 'and'", "é = a < b and 'and'"}
    assert of_python("x.y = max(a, b)") == {"pass", "x.y = min(a, b)"}
    assert of_python("if np.floor(a): f()") == {
        "if np.ceil(a): f()", "if not (np.floor(a)): f()", "if np.floor(a): pass",
    }  # fmt: skip
    assert of_python("yield True if a else 0.5") == {
        "yield False if a else 0.5", "yield True if not (a) else 0.5", "yield True if a else 1.5",
        "yield True if a else 0.0", "yield True if a else 1.0",
    }  # fmt: skip
    assert of_python("b -= 2 * a") == {"b += 2 * a", "b -= 2 / a", *(f"b -= {k} * a" for k in (3, 0, 4))}
    for alike in ('"""a + 1"""', "raise E(1 + a)", "assert a == 1", 'x = f"{a + 1}"', "x: Literal[1] = a",
                  'x = "a" + b', "x = a"):  # fmt: skip
        assert of_python(alike) == set(), alike


def test_c() -> None:
    assert of_c("return a + 1; // a - 1") == {
        "return a - 1; // a - 1", "return a + 2; // a - 1", "return a + 0; // a - 1",
        "return 0; // a - 1", "return {}; // a - 1",
    }  # fmt: skip
    assert of_c("if (a && b(c)) x->y = std::min(a, b);") == {
        "if (a || b(c)) x->y = std::min(a, b);", "if (!(a && b(c))) x->y = std::min(a, b);",
        "if (a && b(c)) x->y = std::max(a, b);", "if (a && b(c)) ;",
    }  # fmt: skip
    assert of_c("*x = g(a <= b, true);") == {";", "*x = g(a < b, true);", "*x = g(a <= b, false);"}
    assert of_c("for (int n = 0; n < a; ++n) f(n);") == {
        "for (int n = 1; n < a; ++n) f(n);", "for (int n = 0; n <= a; ++n) f(n);",
        "for (int n = 0; n < a; ++n) ;",
    }  # fmt: skip
    for alike in ('throw Error("a + 1" + std::to_string(2));', "const cgl_foc *const p = q;", "/* a < 1 */",
                  "#define K 3", "std::vector<double> v(a);", "static_assert(a == 1);",
                  "x::T t{a};"):  # fmt: skip
        assert of_c(alike) == set(), alike


def test_every_mutant_of_python_is_a_program() -> None:
    text = (ROOT / "src/cogless/results/trace.py").read_text()
    changes = python_code.changes(text)
    assert len(changes) > 50
    for change in changes[::3]:  # neighbours change one place
        ast.parse(change.applied(text))


def test_a_draw_is_spread_over_the_lines_and_always_the_same() -> None:
    def first(seed: int) -> list[tuple[str, Change]]:
        return [next(draw) for draw in drawn(ROOT, ["control/src", "simulator/load.hpp"], 20, seed)]

    one = first(1)
    assert one == first(1) != first(2)
    assert len({file for file, _ in one}) > 10
    assert all(file.startswith("control/src/") or file == "simulator/load.hpp" for file, _ in one)


def test_those_tests_come_first_that_are_about_it() -> None:
    for file, of, first in (
        ("src/cogless/results/metrics.py", "def overshoot", "tests/results/test_metrics.py"),
        ("control/src/cogless/quality.c", "set_bounds(cgl_quality", "tests/control/test_control_quality.py"),
        ("simulator/open_bridge.hpp", "let_through(const", "tests/simulator/test_open_bridge.py"),
    ):
        text = (ROOT / file).read_text()
        function = function_at(file, text, text.index(of) + 200)
        assert function == of.removeprefix("def ").partition("(")[0]
        assert files_for(ROOT, file, function)[0] == first


MARKED = '''"""A module."""
from __future__ import annotations

LIMIT = 1

def sign(x, least=0):
    """A function."""
    if x < least:
        return (
            -LIMIT)
    elif x == 0:
        return 0
    return [k for k in (1,)][0]
'''


TESTS = """import subprocess
import sys

import pytest
from a import sign

@pytest.mark.parametrize("x, expected", [(-2, -1), (0, 0), (3, 1)])
def test(x, expected):
    assert sign(x) == expected and sign.__doc__ == "A function."

def test_elsewhere():
    subprocess.run([sys.executable, "-c", "from a import sign; sign(-1)"], check=True)
"""


@pytest.mark.parametrize("workers", ["0", "1"])
def test_the_tests_that_execute_a_block_are_noted(tmp_path: Path, workers: str) -> None:
    """A function's head belongs to its body, the condition of an elif to what is around."""
    where = ("LIMIT = 1", "least=0", "x < least", "-LIMIT", "x == 0", "0\n    r", "k for")
    blocks = [block_at("a.py", MARKED, MARKED.index(text)) for text in where]
    assert blocks == [None, 0, 0, 1, 0, 2, 0]
    text = marked("a.py", MARKED, 40)
    assert "_cogless_page" not in text.partition('"""A function."""')[0].partition("LIMIT = 1")[2]
    (tmp_path / "a.py").write_text(text)
    tests = tmp_path / "tests"
    shutil.copytree(ROOT / "tests/mutants", tests / "mutants", ignore=shutil.ignore_patterns("__pycache__"))
    (tests / "test_a.py").write_text(TESTS)
    (tests / "conftest.py").write_text("import a\n")  # before most hooks
    (tmp_path / "hits").mkdir()
    command = [sys.executable, "-m", "pytest", "-q", "-p", "mutants.hits", "-p", "no:cacheprovider"]
    command += ["-p", "xdist", "-n", workers, "tests/test_a.py"]
    both = {
        **os.environ,
        "PYTHONPATH": f"{tmp_path}{os.pathsep}{tests}",
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
    }
    done = subprocess.run(command, cwd=tmp_path, env=both, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    lines = [line.split(" ", 2) for line in (tmp_path / "hits/tests").read_text().splitlines()]
    assert [(int(bits, 16), test.partition("::")[2]) for bits, _, test in lines] == [
        (0, ""), (0b011 << 40, "test[-2--1]"), (0b101 << 40, "test[0-0]"), (0b001 << 40, "test[3-1]"),
        (0b011 << 40, "test_elsewhere"),
    ]  # fmt: skip


def test_all_code_can_be_marked() -> None:
    """And every fourth file of Python compiles then."""
    count = 0
    for n, file in enumerate(sources(ROOT, [])):
        text = (ROOT / file).read_text()
        if file.endswith(".py") and n % 4 == 0:
            compile(marked(file, text, count), file, "exec")
        count += len(blocks_of(file, text))
    assert 4000 < count < PAGE


def test_first_those_that_execute_a_mutant_then_the_others_of_their_files(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What importing executes: those that execute anything of the file, or of those that import it."""
    few = ["src/cogless/results", "src/cogless/run"]
    monkeypatch.setattr("mutants.seen.sources", lambda root, wanted: sources(root, [*wanted, *few]))
    seen = Seen(ROOT)
    file = "src/cogless/results/metrics.py"
    text, first = seen.texts[file], seen.numbers[file]

    def turns(place: str) -> list[list[str]]:
        start = text.index(place)
        return seen.turns(file, Change(start, start + 1, "x"))

    def bit(of: str, place: str) -> int:
        block = block_at(of, seen.texts[of], seen.texts[of].index(place))
        assert block is not None
        return 1 << seen.numbers[of] + block

    inside = bit(file, "last = values[phase]")
    ran = "src/cogless/run/carry_out.py"
    assert "import metrics" in seen.texts[ran] or "results.metrics" in seen.texts[ran]
    seen.tests = {
        "tests/b.py::slow": (inside, 9.0), "tests/b.py::other": (1 << first + 9, 1.0),
        "tests/a.py::quick": (inside, 1.0), "tests/c.py::other": (0, 0.1),
        "tests/d.py::runs": (1 << seen.numbers[ran], 20.0),
        "tests/results/test_metrics.py::likely": (inside, 30.0),
    }  # fmt: skip
    likely = "tests/results/test_metrics.py::likely"
    assert turns("last = values[phase]") == [
        [likely, "tests/a.py::quick", "tests/b.py::slow"],
        ["tests/b.py::other"],
    ]
    anything = [likely, "tests/a.py::quick", "tests/b.py::slow", "tests/b.py::other", "tests/d.py::runs"]
    assert turns("SETTLED_SHARE = 1") == [anything, []]
    seen.imported = inside
    assert turns("last = values[phase]") == [anything, []]
    seen.tests = {"tests/c.py::other": (0, 0.1)}
    assert turns("last = values[phase]") == [["tests/c.py::other"], []]


BROKEN_IMPORT = """collecting ... collected 0 items / 2 errors

=========================== short test summary info ============================
ERROR tests/live/test_engine.py - cogless.errors.StudyError: ...
ERROR  - _pytest.main.Failed: stopping after 1 failures
ERROR: found no collectors for tests/live/test_engine.py::test_it
"""


def test_a_mutant_that_breaks_an_import_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """pytest calls it a wrong use; a test that isn't there is one."""
    tree = object.__new__(Tree)
    tree.avoided = []
    monkeypatch.setattr(Tree, "_tested", lambda self, *tests: (4, BROKEN_IMPORT))
    assert tree.judge("src/x.py", [["a"]]) == Verdict("killed", "tests/live/test_engine.py")
    monkeypatch.setattr(Tree, "_tested", lambda self, *tests: (4, "ERROR: not found: tests/a.py::test_gone"))
    with pytest.raises(RuntimeError, match="test_gone"):
        tree.judge("src/x.py", [["a"]])


SHAPES = """struct Shape {
    int a = 1 + 2;
    explicit Shape(int n) : a(n), b{n} { a += 1; }
    int area() const { return a * b; }
    int b;
};
namespace inner {
constexpr int twice(int n) { return 2 * n; }
int sum(const int *x, int count)
{
    int total = 0;
    for (int n = 0; n < count; ++n) {
        total += x[n];
    }
    return total;
}
}
"""


def test_the_bodies_of_functions_are_found() -> None:
    """Of those that run; neither a type, nor a namespace, nor what a compiler calls."""
    found = [SHAPES[begins:closes].strip() for begins, closes in c_code.functions(SHAPES)]
    assert found[:2] == ["a += 1;", "return a * b;"] and len(found) == 3
    assert found[2].startswith("int total = 0;") and found[2].endswith("return total;")
    places = [c.start for c in c_code.changes((ROOT / "control/src/cogless/pi.c").read_text())]
    bodies = c_code.functions((ROOT / "control/src/cogless/pi.c").read_text())
    assert all(any(begins <= place < closes for begins, closes in bodies) for place in places)


def test_of_several_mutants_in_one_program_the_environment_chooses(tmp_path: Path) -> None:
    """None of them by default; the others beside it."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    text = "int sign(int x)\n{\n    if (x < 0) {\n        return -1;\n    }\n    return x > 0;\n}\n"
    text += '#include <stdio.h>\nint main(void)\n{\n    printf("%d%d%d", sign(-1), sign(0), sign(1));\n}\n'
    less, more = text.index("x < 0") + 2, text.index("x > 0") + 2
    changes = {3: Change(less, less + 1, "<="), 8: Change(more, more + 1, ">="), 9: Change(0, 3, "long")}
    source = tmp_path / "sign.c"
    both, lines = switched(text, changes)
    source.write_text(both)
    assert set(lines.values()) == {3, 8}  # the other is in no function
    assert re.search(r"\)\s*\{.*?\n\}", both, re.DOTALL)[0].count("return x >") == 3
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror"]
    subprocess.run(["cc", *strict, source, "-o", tmp_path / "sign"], check=True)
    for number, says in (("", "-101"), ("3", "-1-11"), ("8", "-111"), ("9", "-101")):
        chosen = {**os.environ, "COGLESS_MUTANT": number}
        done = subprocess.run([tmp_path / "sign"], env=chosen, capture_output=True, text=True, check=True)
        assert done.stdout == says
    noted = tmp_path / "page"
    noted.write_bytes(bytes(PAGE))
    source.write_text(marked("sign.c", text, 7))
    subprocess.run(["cc", *strict, source, "-o", tmp_path / "sign"], check=True)
    subprocess.run([tmp_path / "sign"], env={**os.environ, "COGLESS_HITS": str(noted)}, check=True)
    assert [n for n, mark in enumerate(noted.read_bytes()) if mark] == [7, 8]
    wrong, lines = switched(text, {5: Change(less, less + 1, "=<"), 6: Change(more, more + 1, ">=")})
    source.write_text(wrong)
    done = subprocess.run(["cc", "-c", source, "-o", tmp_path / "x.o"], capture_output=True, text=True)
    assert culprits(done.stderr, "sign.c", lines) == {5}


def test_the_command_tells_what_it_takes() -> None:
    command = [sys.executable, "-m", "mutants", "--help"]
    done = subprocess.run(command, cwd=ROOT / "tests", capture_output=True, text=True, check=True)
    assert all(word in done.stdout for word in ("--seed", "--count", "--jobs", "paths"))
