"""A proof's stamp is stale if, and only if, something changed that the proof reads."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import stat
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

CONTROL = Path(__file__).parents[2] / "control"
VERSION = "25.0 (Manganese)"
FAKE = """#!{python}
# A Frama-C of these tests: an alarm where a source says so.
import sys
from pathlib import Path
if sys.argv[1:] == ["-version"]:
    sys.exit(print({version!r}))
def append(path, line):
    with Path(path).open("a") as file:
        file.write(line + chr(10))
append({ran!r}, next(word for word in sys.argv if word.startswith("proof/")))
texts = [Path(word).read_text() for word in sys.argv if word.endswith(".c")]
if any("ALARM" in text for text in texts) or Path.cwd().name != "control":  # a copy is of a broken law
    print("[eva:alarm] x.c:1: Warning: out of bounds\\n")
if any("EDIT" in text for text in texts):
    append("src/cogless/pi.c", "int other;")
print("ANALYSIS SUMMARY")
"""


def append(path: Path, text: str) -> None:
    with path.open("a") as file:
        file.write(text)


def runner(control: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """control/proof/run.py of a copy."""
    monkeypatch.syspath_prepend(control / "proof")
    for name in ("stamps", "verdict"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    spec = importlib.util.spec_from_file_location("proof_run", control / "proof" / "run.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "proof_run", module)  # its dataclasses look for it there
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def control(tmp_path: Path) -> Path:
    for part in ("src", "proof"):
        shutil.copytree(CONTROL / part, tmp_path / "control" / part)
    return tmp_path / "control"


@pytest.fixture
def run(control: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return runner(control, monkeypatch)


def stamps(run: ModuleType, version: str = VERSION) -> dict[str, str]:
    return {each.name: each.stamp(version) for each in [*run.RUNS, *run.MUTANTS]}


def files_of(run: ModuleType, each: Any) -> set[str]:
    """Files that a run reads, relative to control/."""
    with each.folder() as folder:
        return set(run.stamps.files_read(each.sources, folder))


def test_runs_have_names_and_stamps_of_their_own(run: ModuleType) -> None:
    every = stamps(run)
    assert len(every) == len(run.RUNS) + len(run.MUTANTS) == len(set(every.values()))


def test_any_file_that_is_read_makes_a_run_stale_and_no_other_does(run: ModuleType, control: Path) -> None:
    texts = {path: path.read_text() for part in ("src", "proof") for path in (control / part).rglob("*.[ch]")}
    assert len(texts) > 70
    for each in {each.harness: each for each in run.RUNS}.values():
        before, read = each.stamp(VERSION), {control / name for name in files_of(run, each)}
        assert len(read) > 4 and read <= texts.keys()
        for path in read:
            path.write_text(texts[path] + "int other;\n")
            assert each.stamp(VERSION) != before, (each.name, path)
            path.write_text(texts[path])
        for path in texts.keys() - read:
            path.write_text(texts[path] + "int other;\n")
        assert each.stamp(VERSION) == before, each.name
        for path in texts.keys() - read:
            path.write_text(texts[path])


def test_a_comment_makes_no_proof_stale_but_an_annotation_does(run: ModuleType, control: Path) -> None:
    before = stamps(run)
    text = run.stamps.code_of(
        b'char *s = "/* not */", q = \'"\'; /* one\ntwo */ // three\n\n  //@ widen_hints x;\n/*@ y */'
    )
    assert text == b'char *s = "/* not */", q = \'"\';\n  //@ widen_hints x;\n/*@ y */'
    append(control / "src" / "cogless" / "real.h", "/* a sentence\nof two lines */\n// or one\n")
    assert stamps(run) == before
    append(control / "src" / "cogless" / "pi.c", "//@ widen_hints law.turns, 1;\n")
    assert stamps(run)["pi"] != before["pi"]


def test_a_changed_file_makes_the_proof_of_a_broken_law_stale(run: ModuleType, control: Path) -> None:
    for each in run.MUTANTS:
        before = each.stamp(VERSION)
        append(control / "src" / "cogless" / each.file, "int other;\n")
        assert each.stamp(VERSION) != before


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_what_the_compiler_reads_is_read(run: ModuleType, control: Path) -> None:
    (control / "__fc_builtin.h").touch()  # Frama-C's own
    for each in {each.harness: each for each in run.RUNS}.values():
        flags = next(word for word in each.command(control) if word.startswith("-cpp-extra-args="))
        command = ["cc", "-MM", "-I.", *flags.partition("=")[2].split(), *each.sources[1:]]
        made = subprocess.run(command, cwd=control, capture_output=True, text=True, check=True).stdout
        compilers = set(re.findall(r"(?<=\s)[\w./]+\.\w+(?=\s)", made.replace("\\\n", " ")))
        compilers = {os.path.normpath(name) for name in compilers} - {"__fc_builtin.h"}
        assert len(compilers) > 3 and compilers <= files_of(run, each), each.name


def test_a_define_makes_a_run_stale(run: ModuleType) -> None:
    for each in run.RUNS:
        for key in each.defines or {"COGLESS_DOUBLE": ""}:
            other = replace(each, defines=each.defines | {key: "7"})
            assert other.stamp(VERSION) != each.stamp(VERSION)


def test_flags_functions_sources_and_versions_make_all_stale(
    run: ModuleType, control: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = stamps(run)

    def all_differ(after: dict[str, str]) -> bool:
        return after.keys() == before.keys() and all(after[name] != before[name] for name in before)

    assert all_differ(stamps(run, "26.0 (Iron)"))
    with monkeypatch.context() as patch:
        patch.setattr(run, "EVA", [*run.EVA[:-1], "gcc_x86_64"])
        assert all_differ(stamps(run))
    with monkeypatch.context() as patch:
        patch.setattr(run, "PARTS", {name: f"crc32 {parts}" for name, parts in run.PARTS.items()})
        assert all_differ(stamps(run))
    with monkeypatch.context() as patch:
        others = [name for name in run.PRECISE_FUNCTIONS if name != "cgl_pi_init"]
        patch.setattr(run, "PRECISE_FUNCTIONS", others)
        after = stamps(run)
        assert {name for name in before if after[name] != before[name]} >= {"pi", "broken pi.c: pi"}
        assert after["leaves"] == before["leaves"]
    judge = control / "proof" / "verdict.py"
    judge.write_text(judge.read_text().replace("LIMIT = 1200", "LIMIT = 1300"))
    assert all_differ(stamps(run))
    assert stamps(run) != before


def test_another_way_to_break_the_library_makes_its_proof_stale(run: ModuleType) -> None:
    for each in run.MUTANTS:
        assert replace(each, broken=each.broken + " ;").stamp(VERSION) != each.stamp(VERSION)


def test_a_stamp_is_the_same_in_any_folder(
    run: ModuleType, control: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = stamps(run)
    moved = tmp_path / "other" / "place" / "of control"
    shutil.copytree(control, moved)
    assert stamps(runner(moved, monkeypatch)) == before


def test_an_include_whose_file_is_not_in_the_text_is_refused(run: ModuleType, control: Path) -> None:
    append(control / "src" / "cogless" / "pi.c", "#include PI_EXTRA\n")
    with pytest.raises(ValueError, match=r"^control/src/cogless/pi\.c: #include PI_EXTRA: a file's name"):
        stamps(run)


class Proof:
    """`run.py` of a copy, with a fake Frama-C whose verdict is written in the sources."""

    def __init__(self, control: Path, tmp_path: Path) -> None:
        self.control, self.log = control, tmp_path / "ran"
        self.tools = tmp_path / "tools"
        self.tools.mkdir()
        self.version(VERSION)
        # stamps don't depend on view_check.c, which compares two spellings of view.h for every float
        (control / "proof" / "view_check.c").write_text("int main(void) { return 0; }\n")

    def version(self, version: str) -> None:
        program = self.tools / "frama-c"
        program.write_text(FAKE.format(python=sys.executable, version=version, ran=str(self.log)))
        program.chmod(program.stat().st_mode | stat.S_IXUSR)

    def run(self, *words: str) -> tuple[int, list[str]]:
        """Run run.py with these words: its exit code, and the names of the harnesses that it ran."""
        self.log.write_text("")
        path = f"{self.tools}{os.pathsep}{os.environ['PATH']}"
        command = [sys.executable, str(self.control / "proof" / "run.py"), "--jobs", "1", *words]
        done = subprocess.run(command, env={**os.environ, "PATH": path}, capture_output=True, text=True)
        return done.returncode, [Path(line).stem for line in self.log.read_text().split()]

    def stamps(self) -> set[str]:
        lines = (self.control / "proof" / "proven.txt").read_text().splitlines()[1:]
        assert lines == sorted(lines, key=lambda line: line.split(maxsplit=1)[1])
        return {line.split(maxsplit=1)[1] for line in lines}

    def append(self, file: str, text: str) -> None:
        append(self.control / file, text)


@pytest.fixture
def proof(control: Path, tmp_path: Path) -> Proof:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    (control / "proof" / "proven.txt").unlink(missing_ok=True)
    return Proof(control, tmp_path)


PI, ADRC = {"pi", "pi limit=3.0", "pi double", "broken pi.c: pi"}, {"adrc", "adrc limit=3.0", "adrc double"}


def test_what_has_not_changed_is_not_proven_again(proof: Proof) -> None:
    assert proof.run("--stale", "pi", "adrc") == (0, ["pi"] * 3 + ["adrc"] * 3 + ["pi"])
    assert proof.stamps() == PI | ADRC
    assert proof.run("--stale", "pi", "adrc") == (0, [])
    proof.append("src/cogless/adrc.c", "int other;\n")
    assert proof.run("--stale", "pi", "adrc") == (0, ["adrc"] * 3)
    assert proof.run("--stale", "pi", "adrc") == (0, [])
    assert proof.run("pi") == (0, ["pi"] * 4)  # by hand all are proven
    proof.version("26.0 (Iron)")
    assert proof.run("--stale", "pi", "adrc") == (0, ["pi"] * 3 + ["adrc"] * 3 + ["pi"])


def test_a_red_proof_fails_loses_its_stamp_and_is_run_again(proof: Proof) -> None:
    assert proof.run("--stale", "pi", "adrc")[0] == 0
    proof.append("src/cogless/adrc.c", "int ALARM;\n")
    for _ in range(2):
        assert proof.run("--stale", "pi", "adrc") == (1, ["adrc"] * 3)
        assert proof.stamps() == PI


def test_a_broken_law_that_is_not_caught_has_no_stamp(proof: Proof) -> None:
    program = proof.tools / "frama-c"
    program.write_text(program.read_text().replace('print("[eva:alarm]', 'str("[eva:alarm]'))
    assert proof.run("pi") == (1, ["pi"] * 4)
    assert proof.stamps() == PI - {"broken pi.c: pi"}


def test_files_that_change_during_a_proof_leave_no_stamp(proof: Proof) -> None:
    proof.append("proof/pi.c", "int EDIT;\n")
    assert proof.run("pi", "adrc")[0] == 0
    assert proof.stamps() == ADRC | {"broken pi.c: pi"}  # of a copy, which only it changes


def test_stamps_of_runs_that_are_gone_go(proof: Proof) -> None:
    (proof.control / "proof" / "proven.txt").write_text("# about\n0123456789abcdef  gone orders=3\n")
    assert proof.run("adrc")[0] == 0
    assert proof.stamps() == ADRC


def test_a_harness_that_is_not_there_is_named(proof: Proof) -> None:
    assert proof.run("adcr") == (2, [])


def test_a_name_that_no_harness_has_is_an_error() -> None:
    command = [sys.executable, CONTROL / "proof" / "run.py", "pi", "typo"]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    assert done.returncode == 2
    assert "no harness has the name typo" in done.stderr
