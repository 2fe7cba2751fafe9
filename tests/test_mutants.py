"""The mutants that `make mutants` draws: where they are and what they say, on a few lines."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from mutants import c_code, hits, python_code
from mutants.change import Change, other_numbers
from mutants.draw import drawn
from mutants.order import files_for, function_at, others_of, those_of
from mutants.switched import culprits, switched

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
    text = (ROOT / "src/cogless/results/metrics.py").read_text()
    changes = python_code.changes(text)
    assert len(changes) > 50
    for change in changes[::7]:  # neighbours change one place
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


PROBED = """LIMIT = 1

def sign(x):
    if x < 0:
        return (
            -LIMIT)
    elif x == 0:
        return 0
    return [k for k in (1,)][0]
"""


def test_what_executes_a_statement_is_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    places = dict(
        enumerate(PROBED.index(text) for text in ("= 1", "x < 0", "-LIMIT", "x == 0", "k for", "0\n    r"))
    )
    text, probed = hits.with_probes(PROBED, places)
    assert probed == {1, 2, 3, 4, 5}  # the first is outside of functions
    monkeypatch.setattr(hits, "FOLDER", tmp_path)
    names: dict[str, Any] = {}
    exec(compile(text, "probed", "exec"), names)
    for x, expected in ((-2, -1), (0, 0), (3, 1)):
        monkeypatch.setenv("PYTEST_CURRENT_TEST", f"tests/test_a.py::test[{x} b] (call)")
        assert names["sign"](x) == expected
    every = {f"tests/test_a.py::test[{x} b]" for x in (-2, 0, 3)}
    found = {number: set(hits.noted(tmp_path, number)) for number in probed}
    assert found[1] == found[3] == every  # before an elif stands the probe of its if
    assert [found[n] for n in (2, 5, 4)] == [{f"tests/test_a.py::test[{x} b]"} for x in (-2, 0, 3)]
    assert hits.noted(tmp_path, 0) == []


def test_only_the_files_of_those_that_execute_it_are_run() -> None:
    files = [f"tests/test_{n}.py" for n in range(9)]
    some = ["tests/test_1.py::a", "tests/test_8.py::b", "tests/test_1.py::c"]
    assert those_of(files[::-1], some) == [
        [some[1], some[0], some[2]],
        ["tests/test_8.py", "tests/test_1.py"],
    ]
    assert those_of(files, []) == [[], []]
    first, others = those_of(files, [""])
    assert first + others == files
    assert those_of(files, ["", *some]) == [some[:1] + some[2:] + some[1:2], files]


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
    """None of them by default; the others beside it; and what ran is on the page."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    text = "int sign(int x)\n{\n    if (x < 0) {\n        return -1;\n    }\n    return x > 0;\n}\n"
    text += '#include <stdio.h>\nint main(void)\n{\n    printf("%d%d%d", sign(-1), sign(0), sign(1));\n}\n'
    less, more = text.index("x < 0") + 2, text.index("x > 0") + 2
    changes = {3: Change(less, less + 1, "<="), 8: Change(more, more + 1, ">="), 9: Change(0, 3, "long")}
    source, page = tmp_path / "sign.c", tmp_path / "page"
    both, lines = switched(text, changes)
    source.write_text(both)
    assert set(lines.values()) == {3, 8}  # the other is in no function
    assert re.search(r"\)\s*\{.*?\n\}", both, re.DOTALL)[0].count("return x >") == 3  # type: ignore[index]
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror"]
    subprocess.run(["cc", *strict, source, "-o", tmp_path / "sign"], check=True)
    for number, says in (("", "-101"), ("3", "-1-11"), ("8", "-111"), ("9", "-101")):
        page.write_bytes(bytes(4096))
        chosen = {**os.environ, "COGLESS_MUTANT": number, "COGLESS_HITS": str(page)}
        done = subprocess.run([tmp_path / "sign"], env=chosen, capture_output=True, text=True, check=True)
        assert done.stdout == says
        assert [n for n, mark in enumerate(page.read_bytes()) if mark] == [3, 8]
    wrong, lines = switched(text, {5: Change(less, less + 1, "=<"), 6: Change(more, more + 1, ">=")})
    source.write_text(wrong)
    done = subprocess.run(["cc", "-c", source, "-o", tmp_path / "x.o"], capture_output=True, text=True)
    assert culprits(done.stderr, "sign.c", lines) == {5}


def test_the_rest_of_the_files_come_by_what_they_take() -> None:
    files = [f"tests/test_{n}.py" for n in range(9)]
    some = [f"tests/test_{n}.py::a" for n in (1, 6, 7, 8)]
    assert others_of(files, some, {"tests/test_6.py": 3.0, "tests/test_7.py": 1.0}) == [
        "tests/test_8.py",
        "tests/test_7.py",
        "tests/test_6.py",
    ]


def test_the_command_tells_what_it_takes() -> None:
    command = [sys.executable, "-m", "mutants", "--help"]
    done = subprocess.run(command, cwd=ROOT / "tests", capture_output=True, text=True, check=True)
    assert all(word in done.stdout for word in ("--seed", "--count", "--jobs", "paths"))
