"""`cogless live`, `cogless run --live` and what they refuse."""

import subprocess
import sys
import webbrowser
from pathlib import Path

import live_studies
import pytest
from commands import cogless
from node import NO_ENGINE

import studies
from cogless.errors import StudyError
from cogless.files import control_sources
from cogless.live import compile, engine

SMALL = f"""title = "Two laws"
{studies.IDEAL}
[scenario]
step = {{ duration = "0.1 s", reference = "60 rpm" }}
[controller]
pi = {{ law = "pi", kp = "0.01 A/rpm", ki = "0.1 A/rpm/s" }}
[controller.mine]
law = "python"
object = "law.py:Zero"
label = "Mine"
"""
METRIC = """
[[metric]]
name = "ripple"
kind = "ripple-rms"
signal = "omega_m"
last = "1 s"
"""
LEFT_OUT = "Left out of the page: Mine: its law is your own code, which the page doesn't run."
needs = pytest.mark.skipif(bool(NO_ENGINE), reason=NO_ENGINE)


def small(folder):
    """A study's file, beside its law in Python."""
    (folder / "law.py").write_text("class Zero:\n    def step(self, i):\n        return 0.0\n")
    return studies.write(folder, SMALL)


@needs
def test_the_page_is_written_where_it_is_asked_for(capsys, tmp_path):
    study = live_studies.study(tmp_path).source.path
    code, out, _ = cogless(capsys, "live", study, "-o", tmp_path / "page.html")
    assert (code, out) == (0, f"Page: {tmp_path / 'page.html'}\n")
    assert f"cogless run {study}" in (tmp_path / "page.html").read_text(encoding="utf-8")


@needs
@pytest.mark.parametrize(
    ("terminal", "display", "option", "times"),
    [(True, ":0", (), 1), (True, ":0", ("--no-open",), 0), (True, "", (), 0), (False, ":0", (), 0)],
)
def test_the_page_opens_on_a_desktop(monkeypatch, capsys, tmp_path, terminal, display, option, times):
    """Not where the output is no terminal, nor where there is no display."""
    addresses = []
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    page = tmp_path / "my page.html"
    code, out, _ = cogless(capsys, "live", small(tmp_path), "--no-limits", *option, "-o", page)
    assert (code, addresses) == (0, [page.as_uri()] * times) and page.is_file()
    assert out == f"Page: {page}\n" + f"Address: {page.as_uri()}\n" * times


@needs
@pytest.mark.parametrize(("option", "times"), [((), 1), (("--no-limits",), 0)])
def test_the_page_has_what_limits_the_best_run_as_it_was_made(capsys, tmp_path, option, times):
    study = small(tmp_path)
    study.write_text(study.read_text() + METRIC)
    sensor = ("--set", 'drive.position_sensor={ kind = "absolute", bits = 8 }')
    longer = ("--set", "scenario.step.duration=2 s")
    code, _, _ = cogless(capsys, "live", study, *sensor, *longer, *option, "-o", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert code == 0 and page.count("What limits pi, which leaves ") == times


@needs
def test_a_run_writes_the_page_beside_its_report(capsys, tmp_path):
    study, folder = small(tmp_path), tmp_path / "out"
    code, out, error = cogless(capsys, "run", study, "--only", "step/pi", "--live", "-o", folder)
    assert code == 0 and f"Page: {folder / 'live.html'}" in out and LEFT_OUT in error
    assert {"report.html", "live.html", "results.json"} <= {path.name for path in folder.iterdir()}


@needs
def test_a_law_that_the_page_leaves_out_is_named(capsys, tmp_path):
    code, _, error = cogless(capsys, "live", small(tmp_path), "-o", tmp_path / "page.html")
    assert (code, error.splitlines()) == (0, [LEFT_OUT, "Open this page in a browser."])


@needs
def test_a_page_of_ones_own_motor_needs_it_in_a_datasheets_words(capsys, tmp_path):
    study = live_studies.study(tmp_path).source.path
    code, _, error = cogless(capsys, "live", study, "--own-motor", "-o", tmp_path / "page.html")
    words = "motor.resistance_line_to_line, motor.inductance_line_to_line, motor.kv"
    told = f"{study}: {words}: missing: expected with --own-motor, in place of R_s, L_d, L_q, psi_f\n"
    assert (code, error) == (2, told) and not (tmp_path / "page.html").exists()


@pytest.mark.parametrize("precision", ["single", "double"])
def test_the_engine_is_compiled_from_all_laws_and_rounds_as_the_native_one(tmp_path, monkeypatch, precision):
    commands = []

    def zig(arguments):
        commands.append(arguments)
        Path(arguments[arguments.index("-o") + 1]).write_bytes(b"made")

    monkeypatch.setattr(compile, "_zig", zig)
    sources = control_sources().parents[1]
    compile.compiled(sources, tmp_path / "new" / "engine.wasm", precision)
    assert (tmp_path / "new" / "engine.wasm").read_bytes() == b"made"
    *compiling, linking = commands
    assert all("-ffp-contract=off" in command and "-O2" in command for command in commands)
    assert {"-DCOGLESS_DOUBLE" in command for command in commands} == {precision == "double"}
    named = {Path(command[command.index("-c") + 1]).name: command for command in compiling}
    laws = {path.name for path in (sources / "control" / "src" / "cogless").glob("*.c")}
    assert set(named) == laws | set(compile.ENGINE)
    for name, command in named.items():
        assert (command[0], "-std=c99" in command) == (("cc", True) if name in laws else ("c++", False))
    assert linking[0] == "c++" and len([word for word in linking if word.endswith(".o")]) == len(named)


@pytest.mark.parametrize(
    ("printed", "told"),
    [
        ("a warning\na.c:1: error: no such\nmore", "a.c:1: error: no such"),
        ("one\ntwo", "one"),
        ("", "exit 3"),
    ],
)
def test_the_compilers_first_error_is_told(monkeypatch, printed, told):
    def run(command, **_):
        return subprocess.CompletedProcess(command, 3, "", printed)

    monkeypatch.setattr(compile.subprocess, "run", run)
    with pytest.raises(compile.CompileError) as error:
        compile._zig(["cc"])
    assert str(error.value) == told


def test_a_wheel_takes_the_engine_of_the_same_sources_from_a_cache(tmp_path, monkeypatch):
    """As `make dist` and `make web` share it; without a cache each wheel compiles its own."""
    made = []

    def compiled(sources, target, precision):
        made.append(precision)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(precision.encode())

    monkeypatch.setattr(compile, "compiled", compiled)
    sources, cache, folder = tmp_path / "sources", tmp_path / "cache", tmp_path / "web"
    for name in ("control/src/a.c", "simulator/b.cpp"):
        (sources / name).parent.mkdir(parents=True)
        (sources / name).write_text("int a;")
    folder.mkdir()
    for rest in [cache], [cache], []:
        compile.main(sources, folder, *rest)
        assert {path.name: path.read_text() for path in folder.iterdir()} == {
            name: precision for precision, name in compile.NAMES.items()
        }
    assert made == ["single", "double"] * 2
    (sources / "simulator" / "b.cpp").write_text("int b;")
    compile.main(sources, folder, cache)
    assert made == ["single", "double"] * 3 and len(list(cache.iterdir())) == 4


def test_the_engine_is_compiled_once_and_kept(tmp_path, monkeypatch, capsys):
    """Where it came with no wheel: as long as sources and options are the same."""
    made = []

    def compiled(sources, target, precision):
        made.append(precision)
        target.write_bytes(precision.encode())

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(engine, "package_folders", lambda: ())
    monkeypatch.setattr(engine.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(StudyError) as error:
        engine.module("double")
    assert str(error.value) == engine.NO_COMPILER and not engine.is_there("double")
    monkeypatch.setattr(engine.importlib.util, "find_spec", lambda name: name)
    monkeypatch.setattr(engine, "compiled", compiled)
    assert [engine.module("double") for _ in range(2)] == [b"double"] * 2 and made == ["double"]
    told = "live: compiling the engine for pages, once for this version: one to three minutes\n"
    assert capsys.readouterr().err == told
    assert engine.is_there("double") and not engine.is_there("single")
    (kept,) = (tmp_path / "cogless").iterdir()
    assert kept.name.endswith("-engine_double.wasm")
    monkeypatch.setattr(compile, "FLAGS", ("-O3",))
    assert not engine.is_there("double")

    def fails(*_):
        raise compile.CompileError("a.c:1: error: no")

    monkeypatch.setattr(engine, "compiled", fails)
    with pytest.raises(StudyError, match=r"^live: the engine does not compile: a\.c:1: error: no$"):
        engine.module("double")
