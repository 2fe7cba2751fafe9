"""The command line as a user meets it: tables, files, exit codes, one line for a mistake."""

import inspect
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
import synthetic
import trial_studies
from commands import cogless, forked

import cogless as cogless_package
import studies
from cogless.__main__ import _flushed
from cogless.catalogue import catalogue, show
from cogless.cli import app, logs, terminal
from cogless.cli import printed as printing
from cogless.results import Results
from cogless.run import carry_out, side_by_side
from cogless.study import Study, load
from cogless.study.laws import AnyController
from cogless.study.laws.trial import AnyTrialController

ZERO = """
class Zero:
    def step(self, inputs):
        return 0.0
"""
TOUCHES = """
import time
from pathlib import Path

class Touches:
    def step(self, inputs):
        Path(__file__).with_name("begun").touch()
        pass
        return 0.0
"""


# run


def test_run_prints_the_verdict_and_writes_everything(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    code, out, err = cogless(capsys, "run", studies.write(tmp_path), "-o", folder)
    assert (code, err) == (0, "")
    assert {path.name for path in folder.iterdir()} == {"results.json", "traces.nc", "report.html"}
    lines = out.splitlines()
    assert lines[0] == "low" and lines[1].startswith("At 60 rpm, fair leaves ")
    title = next(line for line in lines if line.startswith("speed ripple"))
    pi, fair = lines[lines.index(title) + 1 :][:2]
    assert title.split()[-1] == "rpm" and pi.endswith("baseline") and fair.endswith(" times less")
    assert "x)" not in out and "*" not in out and "chattering" not in out
    assert lines[-4] == "All metrics: in the report, or here with --all."
    assert lines[-3] == f"Report: {folder / 'report.html'}" and lines[-2].startswith("Next: ")
    results = json.loads((folder / "results.json").read_text())
    assert [(run["scenario"], run["controller"]) for run in results["runs"]] == [
        ("low", "pi"),
        ("low", "fair"),
        ("step", "pi"),
        ("step", "fair"),
    ]


def test_run_prints_all_metrics_if_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = cogless(capsys, "run", studies.write(tmp_path), "--all", "-o", tmp_path / "out")
    lines = out.splitlines()
    assert code == 0 and lines[1].startswith("At 60 rpm, fair leaves ")
    ripple = next(line for line in lines if line.startswith("speed ripple [rpm]"))
    assert "x)" in ripple and ripple.count("*") == 1
    assert "* best; (x) times the value of pi" in lines and "--all" not in out


def test_a_scenario_without_a_metric_has_no_empty_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    only = ("--only", "low/*", "--set", "metric.0.scenarios=['step']", "--set", "metric.1.scenarios=['step']")
    code, out, _ = cogless(capsys, "run", studies.write(tmp_path), *only, "-o", tmp_path / "out")
    assert code == 0
    assert [line.strip() for line in out.splitlines() if line][:2] == ["low", "No metric."]
    assert out.count("\n\n") == 1 and "Report: " in out


@pytest.mark.parametrize("text", [studies.BASE, trial_studies.LINEAR])
def test_a_study_without_metrics_is_told_one_to_paste(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    path = studies.write(tmp_path, text[: text.index("[[metric]]")])
    (first, *_), (name, *_) = load(path).scenario, load(path).controller
    only = ("--only", f"{first}/{name}", "-o", tmp_path / "out")
    code, out, _ = cogless(capsys, "run", path, *only)
    pasted = out[out.index("[[metric]]") : out.index("Report: ")]
    assert code == 0 and f"add a metric to {path}, such as:\n\n[[metric]]" in out
    path.write_text(f"{path.read_text()}\n{pasted}")
    code, out, _ = cogless(capsys, "run", path, *only)
    assert code == 0 and load(path).metric[0].name in out and "No metric." not in out


def test_run_warns_of_what_design_says_diverges(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--only", "low/fair", "--only", "step/fair", "--set", "controller.fair.law=pi-ilc")
    study = (studies.write(tmp_path), "--set", "controller.fair.gain=9")
    code, _, err = cogless(capsys, "run", *study, *options, "-o", tmp_path)
    assert code == 0
    said = "controller.fair: unstable with the feedback that learning adds, at 500 Hz; learning settles with "
    assert err.splitlines()[-1].startswith(f"Warning: {said}")
    assert err.count("Warning: ") == 3  # and both scenarios are too short to learn in


def test_run_one_with_changes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = studies.write(tmp_path)
    arguments = ("--only", "low/pi", "--set", "controller.pi.kp=0.03", "--set", "title=Stiffer", "--plots")
    code, out, _ = cogless(capsys, "run", study, "-o", tmp_path, *arguments)
    assert code == 0
    assert "fair" not in out
    results = json.loads((tmp_path / "results.json").read_text())
    assert (results["title"], len(results["runs"])) == ("Stiffer", 1)
    assert list(tmp_path.glob("low-*.png"))


def test_run_goes_into_results_by_default(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Into a folder of the file's name. Two folders' study.toml go into folders of theirs, also if both
    folders have one name, as where two drives' logs were identified."""
    for folder, name in (("found", "mine"), ("found", "study"), ("try", "study"), ("try/found", "study")):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        studies.write(tmp_path / folder).rename(tmp_path / folder / f"{name}.toml")
    monkeypatch.chdir(tmp_path)
    for study, name in (
        ("found/study.toml", "found"),
        ("try/study.toml", "try"),
        ("try/found/study.toml", "try-found"),
        ("found/mine.toml", "mine"),
    ):
        code, out, _ = cogless(capsys, "run", study, "--only", "low/pi")
        assert code == 0
        assert f"Report: {Path('results', name, 'report.html')}" in out.splitlines()
        assert (Path("results") / name / "results.json").exists()


def test_a_mistake_is_one_line_and_exit_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = studies.write(tmp_path, studies.BASE.replace('inertia = "2.5e-4 kg*m^2"', "inertia = 2.5e-4"))
    code, out, err = cogless(capsys, "run", study, "-o", tmp_path / "out")
    assert (code, out) == (2, "")
    assert err == (
        f'{study}: mechanics.inertia: 0.00025: expected a text with a unit, such as "0.00025 kg*m^2"\n'
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["run", "nowhere.toml"], "nowhere.toml: no such study: expected a file, or one of the shipped "
                                  "studies: "),
        (["run", "FOLDER"], "FOLDER: is a directory: expected a study file"),
        (["run", "STUDY", "--set", "motor.datasheet=none"],
            'STUDY: motor.datasheet: "none": no such datasheet: expected a file, or one of the shipped '
            'motors: '),
        (["run", "STUDY", "--set", "controller.p.kp=1"],
            "STUDY: controller.p.kp: 1: expected one of the controllers pi, fair"),
        (["run", "STUDY", "--set", "scenario.lo.duration_=1"],
            "STUDY: scenario.lo.duration_: 1: expected one of the scenarios low, step"),
        (["run", "STUDY", "--set", 'metric.0.window=["1 s"]'],
            'STUDY: metric.0.window: ["1 s"]: expected 2 values'),
        (["run", "STUDY", "--set", 'metric.0.window=["1 s", "2 s", "3 s"]'],
            'STUDY: metric.0.window: ["1 s", "2 s", "3 s"]: expected 2 values'),
        (["run"], "Missing argument 'STUDY'. See cogless run --help."),
        (["fly"], "No such command 'fly'. See cogless --help."),
        (["runn"], "No such command 'runn'. Did you mean 'run'? See cogless --help."),
        (["export", "STUDY", "--controller", "pi"], "Missing option '--to'. See cogless export --help."),
        (["export", "STUDY", "--controller", "pi", "--to", "x", "-o", "y"], '--to: "x": expected c or fmu'),
        (["run", ""], '"": is a directory: expected a study file'),
        (["run", "STUDY", "-o", ""], "Invalid value for '--output' / '-o': \"\": expected a path. See "),
        (["map", "m", "--csv="], "Invalid value for '--csv': \"\": expected a path. See cogless map --help."),
        (["run", "x" * 5000], f'"{"x" * 56}...: no such study: '),
        (["run", "STUDY", "--set", "title=\udcff"], '--set: "title=\\udcff": expected UTF-8'),
        (["run", "STUDY", "--set", "seed=1\nseed=2"], r'STUDY: seed: "1\nseed=2": expected a whole number'),
        (["run", "STUDY", "--set", "kp"], '--set: "kp": expected KEY=VALUE, such as controller.pi.kp=0.02'),
        (["run", "STUDY", "--fast"], "No such option: --fast"),
        (["run", "STUDY", "--only", "a/b"], 'STUDY: --only: "a/b": expected SCENARIO/CONTROLLER of low/pi, '),
        (["calibrate", "STUDY"], "STUDY: calibration: missing: expected a table with parameters and targets"),
    ],
)  # fmt: skip
def test_a_wrong_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], line: str
) -> None:
    study = str(studies.write(tmp_path))
    places = {"STUDY": study, "FOLDER": str(tmp_path)}
    code, out, err = cogless(capsys, *(places.get(word, word) for word in arguments))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.replace(study, "STUDY").replace(str(tmp_path), "FOLDER").startswith(line)


@pytest.mark.parametrize(
    ("said", "words", "line"),
    [
        ("Odd.", ["run", "x"], "Odd. See cogless run --help.\n"),
        ("Odd?", ["--verbose", "run"], "Odd? See cogless --help.\n"),
        ("", ["run"], ""),
    ],
)
def test_a_mistake_that_names_no_command_points_to_the_help_of_the_first_word(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    said: str,
    words: list[str],
    line: str,
) -> None:
    class OddError(Exception):
        def format_message(self) -> str:
            return said

    def wrong() -> None:
        raise OddError

    monkeypatch.setattr("cogless.__main__._command", wrong)
    assert cogless(capsys, *words) == (2, "", line)


def test_a_whole_controller_may_be_added(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changes = [f"--set=controller.new.{pair}" for pair in ("kp=0.02", "ki=0.3", "law=pi")]
    code, out, _ = cogless(capsys, "run", studies.write(tmp_path), "-o", tmp_path, "--only=low/new", *changes)
    assert code == 0
    assert re.match(r"At 60 rpm, speed ripple: new [\d.]+ rpm\.$", out.splitlines()[1])


def test_a_controller_that_stalls_gets_no_star(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "law.py").write_text(ZERO, encoding="utf-8")
    text = studies.BASE.replace('initial_speed = "60 rpm"\n', "", 1).replace('kind = "order"', 'kind = "rms"')
    text = text.replace('order = [1, 2, 6]\nframe = "electrical"\n', "").replace('"4 mN*m"', '"0.4 mN*m"')
    text += '[controller.mine]\nlaw = "python"\nobject = "law.py:Zero"\n'
    study = studies.write(tmp_path, text)
    named = ("--set", "controller.pi.label=PI [red]", "--set", "controller.mine.label=[b]Mine")  # no markup
    code, out, _ = cogless(capsys, "run", study, "-o", tmp_path, "--only", "low/*", "--all", *named)
    assert code == 0
    said = out.splitlines()
    assert any(line.split() == ["PI", "[red]", "fair", "[b]Mine"] for line in said)
    assert any(line.startswith("[b]Mine ") and line.endswith("did not hold the speed") for line in said)
    rows = [line.rstrip() for line in said if line.startswith("speed") and "[rpm]" in line]
    assert len(rows) == 2
    assert all(row.endswith(" !") and row.count("*") == 1 for row in rows)
    assert "! [b]Mine did not hold the speed in speed, 0.3 to 0.4 s: mean 0 of 60 rpm" in said
    assert "* best; (x) times the value of PI [red]" in said
    report = (tmp_path / "report.html").read_text()
    assert "[b]Mine did not hold the speed in speed, 0.3 to 0.4 s: mean 0 of 60 rpm" in report
    _, out, _ = cogless(capsys, "run", study, "-o", tmp_path, "--only", "low/mine")
    assert "no controller holds the speed from 0.1 to 0.3 s: mine mean 0 of 60 rpm." in out
    assert out.count("mean 0 of 60 rpm") == 1


def test_a_directory_that_cannot_be_written_is_found_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cogless.run.simulate.run_study", lambda *_: pytest.fail("ran"))
    (tmp_path / "file").touch()
    code, _, err = cogless(capsys, "run", studies.write(tmp_path), "-o", tmp_path / "file" / "out")
    assert code == 2
    assert err == f"{tmp_path / 'file' / 'out'}: not a directory: expected a directory that can be written\n"


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no /proc here")
def test_where_nothing_can_be_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The system says "no such file or directory", of what was to be made."""
    code, _, err = cogless(capsys, "run", studies.write(tmp_path), "-o", "/proc/cogless-x")
    assert code == 2
    assert err == "/proc/cogless-x: can't be made there: expected a directory that can be written\n"


def test_a_controller_that_returns_nan_leaves_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    law = 'class Law:\n    def step(self, i):\n        return float("nan") if i.time > 0.1 else 0.0\n'
    (tmp_path / "law.py").write_text(law, encoding="utf-8")
    text = studies.BASE + '[controller.mine]\nlaw = "python"\nobject = "law.py:Law"\n'
    study = studies.write(tmp_path, text)
    code, out, err = cogless(capsys, "run", study, "-o", tmp_path, "--only", "low/*")
    assert code == 2
    assert err.startswith(f"{study}: controller.mine: scenario low at 0.101 s: returned nan")
    assert "Report:" in out
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["interrupted"] is True
    assert [run["controller"] for run in results["runs"]] == ["pi", "fair"]


def test_a_defect_is_a_traceback_a_line_that_asks_to_report_it_and_what_is_finished(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def measure(study: Study, scenario: str, trace: Any) -> dict[str, Any]:
        if scenario == "step":
            raise ValueError("of cogless itself")
        return {}

    monkeypatch.setattr(carry_out, "measure", measure)
    code, out, err = cogless(
        capsys, "run", studies.write(tmp_path), "-o", tmp_path / "out", "--only", "*/pi", "--no-limits"
    )
    assert code == 1 and "Report:" in out
    lines = err.splitlines()
    assert lines[0] == "Traceback (most recent call last):" and "ValueError: of cogless itself" in lines
    assert lines[-1].startswith("This is a defect of cogless, not a mistake of yours. Please report it")
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["interrupted"] is True
    assert [run["scenario"] for run in results["runs"]] == ["low"]


def test_an_order_that_no_run_yields_keeps_the_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    swing = 'scenario.low.reference={offset="0 rpm", amplitude="60 rpm", frequency="10 Hz"}'
    study = studies.write(tmp_path)
    options = ("--plots", "--all", "--only=low/*", "--set", swing)
    code, out, err = cogless(capsys, "run", study, "-o", tmp_path, *options)
    assert (code, err) == (0, "")
    row = next(line for line in out.splitlines() if line.startswith("speed: order 1 (electrical) ["))
    assert row.count("less than one turn") == 2 and "*" not in row
    results = json.loads((tmp_path / "results.json").read_text())
    assert [run["metrics"]["speed_rad_s"] for run in results["runs"]] == [[None] * 3] * 2
    assert "less than one turn" in (tmp_path / "report.html").read_text()


# A shell's background jobs ignore Ctrl-C, and so would what they start.
HEARS = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
COMMAND = [sys.executable, "-c", HEARS + "from cogless.__main__ import main; main()"]
WAITS = {
    "steps": "pass",  # and is asked to stop between two
    "sleeps": "time.sleep(600)",
    "spins": "while True: pass",
    "catches all": "while True:\n            try: time.sleep(600)\n            except BaseException: pass",
}


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
@pytest.mark.parametrize(
    ("how", "presses", "request_to_end"),
    [
        *((how, 1, signal.SIGINT) for how in WAITS),
        ("sleeps", 2, signal.SIGINT),
        ("steps", 1, signal.SIGTERM),
        ("sleeps", 2, signal.SIGTERM),
    ],
)
def test_ctrl_c_keeps_finished_runs(
    tmp_path: Path, how: str, presses: int, request_to_end: signal.Signals
) -> None:
    (tmp_path / "law.py").write_text(TOUCHES.replace("pass", WAITS[how]), encoding="utf-8")
    text = studies.BASE.replace('duration = "0.3 s"', 'duration = "1 h"')
    text = text.replace('controllers = ["pi", "fair"]', 'controllers = ["mine", "pi"]')
    text = text.replace('reference = "60 rpm"\n', 'reference = "60 rpm"\ncontrollers = ["pi", "fair"]\n', 1)
    text += '[controller.mine]\nlaw = "python"\nobject = "law.py:Touches"\n[trace]\nrate = "1 kHz"\n'
    study, folder = studies.write(tmp_path, text), tmp_path / "out"
    run = forked(tmp_path, "run", study, "-o", folder, "--jobs=1")
    until = time.monotonic() + 60
    while not (tmp_path / "begun").exists() and run.runs() and time.monotonic() < until:
        time.sleep(0.02)
    begun = time.monotonic()
    for _ in range(presses):
        run.send(request_to_end)
        time.sleep(0.1)
    assert run.end() == 130
    assert time.monotonic() - begun < 10  # a second to give up, and what writing takes
    assert run.err == f"Interrupted: kept 2 of 4 runs (low/pi, low/fair), written to {folder}.\n"
    results = json.loads((folder / "results.json").read_text())
    assert results["interrupted"] is True
    assert {path.name for path in folder.iterdir()} == {"results.json", "traces.nc", "report.html"}


def own_law(folder: Path, init: str, step: str) -> Path:
    """A study with a law in Python whose init and step also do this, in one of its two runs."""
    law = f"class Law:\n    def __init__(self):\n        {init}\n"
    law += f"    def step(self, inputs):\n        {step}\n        return 0.0\n"
    (folder / "law.py").write_text(f"import os\n\n{law}")
    text = studies.BASE.replace('controllers = ["pi", "fair"]', 'controllers = ["pi", "own"]')
    text += '[controller.own]\nlaw = "python"\nobject = "law.py:Law"\n[trace]\nrate = "1 kHz"\n'
    return studies.write(folder, text)


@pytest.mark.skipif(os.name != "posix", reason="forks")
@pytest.mark.parametrize("call", ["exit(0)", "os._exit(0)", "raise SystemExit(0)"])
@pytest.mark.parametrize("at", ["init", "step"])
def test_a_law_that_exits_fails_and_ends_nothing_else(tmp_path: Path, call: str, at: str) -> None:
    init, step = (call, "pass") if at == "init" else ("pass", call)
    study, folder = own_law(tmp_path, init, step), tmp_path / "out"
    text = study.read_text().replace('controllers = ["pi", "own"]', 'controllers = ["pi", "fair", "own"]')
    study.write_text(text)
    run = forked(tmp_path, "run", study, "-o", folder, "--jobs=1", "--no-limits")
    assert run.end() == 2
    where = f"{study}: controller.own"
    if at == "init":  # it is made before the first run
        expected = "expected a class that takes the controller's params"
        assert run.err == f'{where}.object: "law.py:Law": law.py line 5: calls exit(0): {expected}\n'
        assert not folder.exists()
    else:
        assert re.fullmatch(rf"{where}: scenario \w+ at 0 s: law.py line 7: calls exit\(0\).*\n", run.err)
        results = json.loads((folder / "results.json").read_text())
        assert {each["controller"] for each in results["runs"]} == {"pi", "fair"}


@pytest.mark.skipif(os.name != "posix", reason="forks")
@pytest.mark.parametrize(("init", "step"), [("os.chdir('/')", "pass"), ("pass", "os.chdir('/')")])
def test_a_law_that_changes_the_directory_loses_nothing(tmp_path: Path, init: str, step: str) -> None:
    """Results, the study's files and the old set are where they were named from when the command began."""
    own_law(tmp_path, init, step)
    for seed in (1, 2):
        words = ("run", "study.toml", "-o", "out", "--jobs=1", "--no-limits", f"--set=seed={seed}")
        run = forked(tmp_path, *words, first=partial(os.chdir, tmp_path))
        assert (run.end(), run.err) == (0, "")
        results = json.loads((tmp_path / "out" / "results.json").read_text())
        assert results["seed"] == seed
        assert {each["controller"] for each in results["runs"]} == {"pi", "fair", "own"}
        assert "Report: out/report.html" in run.out


EXITS = """
#include "cogless/plugin.h"
#include <stdlib.h>
uint32_t cogless_plugin_version(void) { return COGLESS_PLUGIN_VERSION; }
size_t cogless_plugin_state_size(void) { return 1; }
int cogless_plugin_init(void *s, const double *p, size_t n, double ts)
{
    (void)s; (void)p; (void)ts;
    if (n == 1) exit(0);
    return 0;
}
void cogless_plugin_step(void *s, const cogless_plugin_input *in, cogless_plugin_output *out)
{
    (void)s; (void)out;
    if (in->time > 0.01) exit(0);
}
"""


@pytest.mark.skipif(os.name != "posix", reason="builds a library")
@pytest.mark.parametrize("params", [[], [1]])
def test_a_library_that_exits_says_so(tmp_path: Path, params: list[int]) -> None:
    """Nothing can go on in that process, but it doesn't end as if all was well."""
    study = own_law(tmp_path, "pass", "pass")
    (tmp_path / "law.c").write_text(EXITS)
    include = Path(cogless_package.__file__).parent / "include"
    flags = ["-std=c99", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", f"-I{include}"]
    subprocess.run(["cc", *flags, "law.c", "-o", "law.so"], cwd=tmp_path, check=True)
    library = f'law = "library"\nlibrary = "law.so"\nparams = {params}'
    study.write_text(study.read_text().replace('law = "python"\nobject = "law.py:Law"', library))
    ended = subprocess.run([*COMMAND, "run", study, "-o", tmp_path / "out"], capture_output=True, text=True)
    why = "called exit: expected a law that lets the command go on"
    assert (ended.returncode, ended.stderr) == (2, f"{tmp_path / 'law.so'}: {why}\n")


WRITING = "Interrupted: cogless is writing the results. Press Ctrl-C again to stop at once without results.\n"


@pytest.mark.skipif(os.name != "posix", reason="sends signals")
@pytest.mark.parametrize("request_to_end", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("presses", [1, 2])
def test_a_request_to_end_while_results_are_written(
    tmp_path: Path, request_to_end: signal.Signals, presses: int
) -> None:
    """The first waits until they are; a second one ends the command at once, and the old set stays."""
    from cogless import report

    def slowly(*arguments: Any) -> None:
        (tmp_path / "writing").touch()
        end = time.monotonic() + (0.5 if presses == 1 else 60)
        while time.monotonic() < end:
            time.sleep(0.02)
        write(*arguments)

    def patched() -> None:
        report.write = slowly

    write, folder = report.write, tmp_path / "out"
    words = ("run", studies.write(tmp_path), "--only=low/*", "--set=trace.rate=1 kHz", "-o", folder)
    assert forked(tmp_path, *words, "--set=seed=1").end() == 0
    run = forked(tmp_path, *words, "--set=seed=2", first=patched)
    until = time.monotonic() + 60
    while not (tmp_path / "writing").exists() and run.runs() and time.monotonic() < until:
        time.sleep(0.02)
    begun = time.monotonic()
    for _ in range(presses):
        run.send(request_to_end)
        time.sleep(0.2)
    assert run.end() == 130 and time.monotonic() - begun < 10
    kept = f"Interrupted: kept 2 of 2 runs (low/pi, low/fair), written to {folder}.\n"
    assert run.err == WRITING + (kept if presses == 1 else "Interrupted.\n")
    results = json.loads((folder / "results.json").read_text())
    assert results["seed"] == (2 if presses == 1 else 1) and results["interrupted"] is False
    assert {path.name for path in folder.iterdir()} == {"results.json", "traces.nc", "report.html"}


def test_traces_written_beside_the_report_are_those_written_before_it(tmp_path: Path) -> None:
    """With one job the files are written one after the other."""
    words = ("run", studies.write(tmp_path), "--only=low/*", "--set=trace.rate=1 kHz", "-o")
    for jobs in ("1", "2"):
        command = [*COMMAND, *map(str, words), str(tmp_path / jobs), f"--jobs={jobs}"]
        subprocess.run(command, check=True, capture_output=True)
    one, two = ({path.name: path.read_bytes() for path in (tmp_path / jobs).iterdir()} for jobs in "12")
    assert one.keys() == {"results.json", "traces.nc", "report.html"} and one == two


@pytest.mark.skipif(os.name != "posix", reason="sends signals")
def test_a_request_to_end_at_any_moment_says_what_is_kept(tmp_path: Path) -> None:
    chance = random.Random(36)
    words = ("run", studies.write(tmp_path), "--only=low/*", "--set=trace.rate=1 kHz", "--jobs=1", "-o")
    begun = time.monotonic()
    assert forked(tmp_path, *words, tmp_path / "whole").end() == 0
    whole = time.monotonic() - begun
    for number in range(int(os.environ.get("COGLESS_KILLS", "4"))):
        folder = tmp_path / str(number)
        run = forked(tmp_path, *words, folder)
        time.sleep(whole * chance.uniform(0.2, 1.0))
        run.send(chance.choice([signal.SIGINT, signal.SIGTERM]))
        code, told = run.end(), run.err.removeprefix(WRITING)
        runs = json.loads((folder / "results.json").read_text())["runs"] if folder.exists() else []
        names = ", ".join(f"{each['scenario']}/{each['controller']}" for each in runs)
        where = f" ({names}), written to {folder}" if runs else ", nothing written"
        kept = f"Interrupted: kept {len(runs)} of 2 runs{where}.\n"
        ends = [(130, kept), (0, "")]
        if len(runs) != 1:  # before anything was kept, or when all was written and printed
            ends.append((130, "Interrupted.\n"))
        assert (code, told) in ends


def test_ctrl_c_after_the_end_changes_nothing() -> None:
    """Python's own end may take a second."""
    pressed = "import atexit, os, signal; atexit.register(os.kill, os.getpid(), signal.SIGINT); "
    ended = subprocess.run([*COMMAND[:2], pressed + COMMAND[2], "list"], capture_output=True)
    assert (ended.returncode, ended.stderr) == (0, b"") and ended.stdout


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_ctrl_c_between_the_command_and_pythons_end_changes_nothing(tmp_path: Path) -> None:
    def pressed() -> bool:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(60)  # the signal is handled within
        return False

    def patched() -> None:
        pressed_once = iter([pressed])
        side_by_side.left_behind = lambda: next(pressed_once, lambda: False)()

    run = forked(tmp_path, "list", first=patched)
    assert (run.end(), run.err) == (0, "") and run.out


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
@pytest.mark.parametrize("command", [["list"], ["run", "--help"]])
def test_ctrl_c_ends_a_command_whose_output_nobody_reads(command: list[str]) -> None:
    reads, writes = os.pipe()
    os.set_blocking(writes, False)
    with pytest.raises(BlockingIOError):
        while True:
            os.write(writes, b" " * 1024)
    os.set_blocking(writes, True)
    with subprocess.Popen([*COMMAND, *command], stdout=writes, stderr=subprocess.PIPE, text=True) as run:
        until = time.monotonic() + 60
        while run.poll() is None and time.monotonic() < until:
            time.sleep(0.5)
            run.send_signal(signal.SIGINT)
        run.kill()
        assert run.stderr is not None and "Traceback" not in run.stderr.read()
    assert run.returncode == 130
    for end in (reads, writes):
        os.close(end)


# where there is no room


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_behind_stdout(tmp_path: Path) -> None:
    study = studies.write(tmp_path)
    with Path("/dev/full").open("w") as full:
        listed = subprocess.run([*COMMAND, "list"], stdout=full, stderr=subprocess.PIPE)
        assert (listed.returncode, listed.stderr) == (2, b"output: no space left on device\n")
        for words in (["run", study, "--only=low/pi", "-o", tmp_path / "out"], ["design", study, "--json"]):
            run = forked(tmp_path, *words, first=lambda: os.dup2(full.fileno(), 1))
            assert (run.end(), run.err) == (2, "output: no space left on device\n")


NO_ROOM = OSError(28, "No space left on device")


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (NO_ROOM, 0, "output: no space left on device\n"),
        (NO_ROOM, 2, ""),  # a mistake is told already
        (BrokenPipeError(), 0, ""),  # as behind `| head`
    ],
)
def test_output_that_cannot_be_written_is_exit_2(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: OSError, code: int, said: str
) -> None:
    class Full:
        place = os.open(os.devnull, os.O_WRONLY)

        def flush(self) -> None:
            raise error

        def fileno(self) -> int:
            return self.place

    monkeypatch.setattr(sys, "stdout", Full())
    assert _flushed(code) == 2
    monkeypatch.setattr(sys, "stdout", None)  # a program without a console has none
    assert _flushed(code) == code
    monkeypatch.undo()
    assert capsys.readouterr().err == said


@pytest.mark.skipif(os.name != "posix", reason="limits a file's size")
def test_results_that_have_no_room_are_printed_nevertheless(tmp_path: Path) -> None:
    """First the traces don't fit, then the report; the set that was there stays, whole."""
    import resource

    out = tmp_path / "out"
    words = ("run", studies.write(tmp_path), "--only=low/pi", "--set=trace.rate=1 kHz", "-o", out)
    assert forked(tmp_path, *words).end() == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    for room, file in ((1000, "traces.nc"), (40_000, "traces.nc"), (100_000, "report.html")):
        limited = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (room, room))
        run = forked(tmp_path, *words, "--set=seed=5", first=limited)
        assert run.end() == 2
        assert re.fullmatch(rf"{out / file}: [^\n]*: expected a file that can be written\n", run.err)
        assert "speed ripple" in run.out and "Report:" not in run.out
        assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_an_interrupt_before_the_first_run_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(study: Study, *_: object, **__: object) -> Results:
        return Results(study, [], interrupted=True)

    monkeypatch.setattr("cogless.run.simulate.run_study", interrupted)
    folder = tmp_path / "out"
    code, out, err = cogless(capsys, "run", studies.write(tmp_path), "-o", folder)
    assert (code, out, err) == (130, "", "Interrupted: kept 0 of 4 runs, nothing written.\n")
    assert not folder.exists() or not list(folder.iterdir())


def test_no_traces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Those of an earlier run go, too: they would be of other results."""
    words = ("run", studies.write(tmp_path), "--only", "low/pi", "-o", tmp_path / "out")
    assert cogless(capsys, *words)[0] == 0
    assert cogless(capsys, *words, "--no-traces")[0] == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"results.json", "report.html"}


def test_a_study_s_own_code_is_named_and_may_be_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing of the file runs: it would leave a trace."""
    mine = '[controller.mine]\nlaw = "python"\nobject = "mine.py:Mine"\n'
    study = studies.write(tmp_path, studies.BASE + mine)
    (tmp_path / "mine.py").write_text(
        "open(__file__ + '.ran', 'w').close()\nclass Mine:\n    def step(self, i): return 0.0\n"
    )
    words = ("run", study, "--only", "low/*", "-o", tmp_path / "out")
    line = (
        f'{study}: controller.mine.law: "python": expected a law without code of your own, since --no-code '
        "is given\n"
    )
    for command in (words, ("sweep", study), ("tune", study), ("calibrate", study)):
        assert cogless(capsys, *command, "--no-code") == (2, "", line)
    assert not (tmp_path / "mine.py.ran").exists()
    code, out, _ = cogless(capsys, *words)
    assert code == 0 and out.startswith(f"Code: controller.mine runs {tmp_path / 'mine.py'}.\n")


# the others


def test_design_shows_gains_and_margins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = studies.write(tmp_path)
    code, out, _ = cogless(capsys, "design", study)
    assert code == 0
    block = out[out.index("fair (pi, phase-margin)\n") :].splitlines()[1:3]
    assert [line.split()[0] for line in block] == ["margins", "gains"]
    assert "phase 60 deg at " in block[0] and "kp " in block[1] and "A/rpm" in block[1]
    code, out, _ = cogless(capsys, "design", study, "--long")
    fair = next(line for line in out.splitlines() if line.startswith("fair"))
    assert code == 0 and "phase-margin" in fair and "60.0 deg" in fair and "A/rpm" in fair
    code, out, _ = cogless(
        capsys, "design", study, "--json", "--set", "controller.fair.tuning.phase_margin=45"
    )
    design = json.loads(out)["controllers"]["fair"]
    assert design["margins"]["phase_margin_rad"] == pytest.approx(0.7853981634)
    assert design["gains"]["kp"]["unit"] == "A*s/rad"


def test_list_says_of_each_law_what_its_model_says() -> None:
    """The command reads the source, without the models."""
    listed = catalogue()
    for heading, union in (("Control laws", AnyController), ("Control laws of trials", AnyTrialController)):
        models = get_args(union)
        laws = [get_args(model.model_fields["law"].annotation)[0] for model in models]
        told = [(model.__doc__ or "").partition("\n")[0] for model in models]
        assert list(listed[heading].items()) == list(zip(laws, told, strict=True))


def test_list_names_the_laws(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = cogless(capsys, "list")
    assert code == 0
    assert [line for line in out.splitlines() if not line.startswith(" ")] == [
        "Studies",
        "Motors",
        "Control laws",
        "Control laws of trials",
    ]
    assert "  trial-ilc     State feedback with integral action" in out
    assert "  robust-ilc      Robust iterative learning" in out


def test_list_tells_titles_and_first_comments(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In columns as wide as the longest name, under headings that a terminal shows in bold."""
    texts = {"studies/one": 'title = "First"', "studies/longer": "seed = 1"}
    texts |= {"motors/m": "# Of a maker \nR_s = 1", "motors/n": "R_s = 1"}
    for name, text in texts.items():
        path = tmp_path / f"{name}.toml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr("cogless.__path__", [str(tmp_path)])
    monkeypatch.setattr("cogless.catalogue._laws", dict)
    show()
    plain = capsys.readouterr().out
    assert plain.splitlines() == [
        "Studies", "  longer", "  one     First", "Motors", "  m  Of a maker", "  n",
        "Control laws", "Control laws of trials",
    ]  # fmt: skip
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    show()
    assert capsys.readouterr().out.startswith("\x1b[1mStudies\x1b[0m\n  longer")


HEAVY = [
    "dask", "jinja2", "matplotlib", "netCDF4", "numpy", "pandas", "pint", "pydantic", "pyarrow", "rich",
    "scipy", "scipy.stats", "typer", "xarray",
]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "needed"),
    [
        (["list"], []),
        (["--help"], ["typer", "rich"]),
        (["design", "uomodri"], ["numpy", "pydantic", "typer", "rich"]),
        (["run", "study.toml", "--no-limits"], ["numpy", "pydantic", "typer", "rich", "netCDF4"]),
    ],
)
def test_a_command_loads_no_heavy_package_that_it_does_not_need(
    arguments: list[str], needed: list[str], tmp_path: Path
) -> None:
    studies.write(tmp_path, studies.BASE)
    code = f"import atexit, sys; sys.argv = ['cogless', *{arguments}]; from cogless.__main__ import main\n"
    code += (
        f"atexit.register(lambda: print([m for m in {HEAVY} if m in sys.modules], file=sys.stderr)); main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert set(eval(done.stderr.strip().splitlines()[-1])) <= set(needed) and done.stdout.strip()


def test_calibrate_prints_lines_for_the_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    calibration = """
[calibration]
parameters = [ {key = "motor.cogging.0.torque", lower = "0 mN*m"} ]
targets = [ {scenario = "low", controller = "pi", metric = "speed_ripple", value = "1 rpm"} ]
"""
    code, out, err = cogless(capsys, "calibrate", studies.write(tmp_path, studies.BASE + calibration))
    assert (code, err) == (0, "")
    assert any(line.split()[:2] == ["low/pi", "speed_ripple"] for line in out.splitlines())
    assert 'motor.cogging.0.torque = "' in out


def test_an_interrupted_calibration_prints_the_best_so_far(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from cogless.run import calibrate as room
    from cogless.run.simulate import run_study

    made: list[object] = []

    def interrupted(study: object, only: object, jobs: int) -> object:
        made.append(only)
        if len(made) > 3:
            raise KeyboardInterrupt
        return run_study(study, only, jobs=jobs)

    monkeypatch.setattr(room, "run_study", interrupted)
    calibration = """
[calibration]
parameters = [ {key = "motor.cogging.0.torque", lower = "0 mN*m"} ]
targets = [ {scenario = "low", controller = "pi", metric = "speed_ripple", value = "1 rpm"} ]
"""
    code, out, err = cogless(capsys, "calibrate", studies.write(tmp_path, studies.BASE + calibration))
    assert (code, err) == (130, "Interrupted.\n")
    assert "# interrupted; deviation of the best fit so far: " in out
    assert 'motor.cogging.0.torque = "' in out


@pytest.mark.parametrize("settled", [True, False])
def test_calibrate_says_how_far_the_fit_is_off_and_what_it_changed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, settled: bool
) -> None:
    from cogless import load
    from cogless.run import calibrate as room

    path = studies.write(tmp_path)
    fitted = room.Fitted("mechanics.inertia", '"1 g*m^2"', '"2 g*m^2"')
    residual = room.Residual("low", "pi", "speed_ripple", None, 0.2, 0.25)
    fit = room.Fit((fitted,), (residual,), 0.012345, settled, load(path))
    monkeypatch.setattr(room, "calibrate", lambda study, progress, jobs: fit)
    code, out, err = cogless(capsys, "calibrate", path)
    said = f"{path}: calibration: the fit did not settle: expected parameters that change the metrics\n"
    assert (code, err) == ((0, "") if settled else (2, said))
    *lines, blank, _, row = out.splitlines()
    assert row.split() == ["low/pi", "speed_ripple", "1.91", "rpm", "2.387", "rpm", "+25.0", "%"]
    assert blank == "" and lines == [
        "# deviation of the fit: 1.23 % (rms of all targets)",
        'mechanics.inertia = "2 g*m^2"  # was "1 g*m^2"',
    ]


@pytest.mark.parametrize("lowered", ["The plan's speeds end at 100 rpm.", ""])
def test_a_plan_says_what_is_to_be_expected_and_where_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, lowered: str
) -> None:
    from cogless.identify import plan, rehearsal

    def write(study: Study, stage: Path) -> None:
        (stage / "study.toml").write_text(study.source.path.read_text("utf-8"), "utf-8")

    def rehearsed(folder: Path, progress: object, law: object) -> list[str]:
        assert (folder / "study.toml").is_file()  # before the rehearsal, which takes minutes
        return expected

    monkeypatch.setattr(plan, "write", write)
    monkeypatch.setattr(plan, "lowered", lambda study: lowered)
    expected = ["J  2e-4 kg*m^2", "! no friction"]
    monkeypatch.setattr(rehearsal, "expected", rehearsed)
    study, folder = studies.write(tmp_path), tmp_path / "plan"
    code, out, err = cogless(capsys, "identify", "--plan", study, "-o", folder)
    assert (code, err) == (0, "")
    motions = ", ".join(f"{name} ({s.duration:.3g} s)" for name, s in load(study).scenario.items())
    assert out.splitlines() == [
        f"Study: {folder / 'study.toml'}",
        f"Columns: {folder / 'id.toml'}",
        f"Record: {motions}.",
        "Expected results, from simulated logs of this motor:",
        "J  2e-4 kg*m^2",
        "! no friction",
        *([f"! {lowered}"] if lowered else []),
        f"Next: cogless identify --config {folder / 'id.toml'} LOG...",
    ]


@pytest.mark.parametrize(
    ("beside", "got"), [(["a.csv", "b.csv"], "a.csv"), (["--config", "id.toml"], "--config")]
)
def test_a_plan_takes_no_logs(capsys: pytest.CaptureFixture[str], beside: list[str], got: str) -> None:
    code, out, err = cogless(capsys, "identify", *beside, "--plan", "motor.toml")
    assert (code, out) == (2, "")
    assert err == (
        f"identify: --plan motor.toml: expected neither logs nor --config, but got {got}: "
        "a plan says what to record; identify the logs afterwards\n"
    )


@pytest.mark.parametrize("given", [[], ["--config", "id.toml"]])
def test_identify_takes_logs_and_what_is_known(capsys: pytest.CaptureFixture[str], given: list[str]) -> None:
    code, out, err = cogless(capsys, "identify", *given)
    assert (code, out, err) == (
        2,
        "",
        "identify: expected logs with --config FILE or --drive NAME, or --plan STUDY without logs\n",
    )


def test_an_interrupt_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(study: object) -> object:
        raise KeyboardInterrupt

    monkeypatch.setattr("cogless.design.speed_blocks.summary", interrupted)
    assert cogless(capsys, "design", studies.write(tmp_path)) == (130, "", "Interrupted.\n")


def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = cogless(capsys, "--version")
    assert code == 0 and out.startswith("cogless ")
    for command in ("run", "design", "list", "calibrate"):
        code, out, _ = cogless(capsys, command, "--help")
        assert code == 0 and f"Usage: cogless {command}" in out


def test_no_help_text_loses_words_to_markup() -> None:
    """A word in brackets would be taken for markup, and not be shown."""
    for command in app.registered_commands:
        assert "[" not in (inspect.getdoc(command.callback) or ""), command.callback


LOW = """\
low-speed
At 60 rpm, PI-ILC leaves 1.57 rpm of speed ripple, 7.52 times less than PI as published (11.8 rpm).

speed ripple, 8 to 10 s   rpm
PI as published          11.8  baseline
PI re-tuned              5.17  2.28 times less
PI-ILC                   1.57  7.52 times less

"""
LOW_METRICS = """\
                                          PI as published        PI re-tuned             PI-ILC
speed orders: order 1 (electrical) [rpm]            0.900     0.500 (0.556x)   0.100 (0.111x) *
speed orders: order 2 (electrical) [rpm]            0.400     0.200 (0.500x)  0.0600 (0.150x) *
speed orders: order 6 (electrical) [rpm]             4.80      1.90 (0.396x)  0.461 (0.0960x) *
speed ripple [rpm]                                   11.8      5.17 (0.438x)    1.57 (0.133x) *
torque ripple [mN·m]                                 6.07       6.07 (1.00x)       6.07 (1.00x)
copper loss [W]                                   0.00497    0.00497 (1.00x)    0.00497 (1.00x)
chattering [mA]                                      2.95       2.95 (1.00x)       2.95 (1.00x)

"""
LOW_COST = "Of the other metrics compared, none is clearly worse with PI-ILC than with PI as published.\n\n"
STEP = """\
step-on
At 60 rpm, PI re-tuned deviates by up to 48.3 rpm (dip), 1.51 times less than PI as published (73.0 rpm).

dip, 2 to 4 s     rpm
PI as published  73.0  baseline
PI re-tuned      48.3  1.51 times less
PI-ILC           56.4  1.29 times less

"""
STEP_METRICS = """\
                 PI as published      PI re-tuned           PI-ILC
copper loss [W]             48.4     48.4 (1.00x)     48.4 (1.00x)
chattering [mA]             3.52     3.52 (1.00x)     3.52 (1.00x)
dip [rpm]                   73.0  48.3 (0.661x) *    56.4 (0.772x)
settling [s]               never            never           1.36 *

"""
STEP_COST = (
    "Of the other metrics compared, none is clearly worse with PI re-tuned than with PI as published.\n\n"
)
MARKS = "* best; (x) times the value of PI as published\n"
REST = "All metrics: in the report, or here with --all.\n"


def test_results_as_they_are_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = synthetic.results(synthetic.study(tmp_path), rate=5000)

    def printed(results: Results, every_metric: bool = False) -> str:
        printing.print_results(results, every_metric)
        return capsys.readouterr().out

    assert printed(results) == LOW + LOW_COST + STEP + STEP_COST + REST
    every = LOW + LOW_METRICS + LOW_COST + STEP + STEP_METRICS + STEP_COST + MARKS
    assert printed(results, every_metric=True) == every
    low = [run for run in results.runs if run.scenario == "low-speed"]
    without_bar = printed(replace(results, runs=low[1:]), every_metric=True)
    assert re.search(r"speed ripple \[rpm\] +5\.17 +1\.57 \*\n", without_bar)
    assert without_bar.endswith("\n* best\n")
    alone = "low-speed\nAt 60 rpm, speed ripple: PI as published 11.8 rpm.\n\n"
    assert printed(replace(results, runs=low[:1])) == alone + REST.replace("11", "7")
    metrics = printed(replace(results, runs=low[:1]), every_metric=True)
    assert re.search(r"\nspeed ripple \[rpm\] +11\.8\n", metrics)
    assert "best" not in metrics  # no marks to explain


def test_progress_is_shown_as_shares_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    bars: list[Any] = []
    new_bar = terminal.new_bar
    monkeypatch.setattr(terminal, "new_bar", lambda *columns: bars.append(new_bar(*columns)) or bars[-1])

    def told() -> list[tuple[str, float, float | None]]:
        return [(task.description, task.completed, task.total) for task in bars[-1].tasks]

    with terminal.run_progress(3) as runs:
        runs("low", "pi", 0.5)
        runs("low", "ilc", 0.25)
        assert told() == [("low/ilc", 0.75, 3)]
        runs("low", "pi", 1.0)
        assert told() == [("low/pi", 1.25, 3)]
    with terminal.variant_progress(40) as variants:
        variants(16)
        assert told() == [("", 16, 40)]
    with terminal.tune_progress() as tuned:
        tuned("pi", 5, 20, 0.98765)
        tuned("ilc", 1, 20, 1.0)
        tuned("pi", 6, 20, 0.5)
        assert told() == [("pi: 50 % of the start", 6, 20), ("ilc: 100 % of the start", 1, 20)]
    with terminal.share_progress("low/pi") as share:
        share(0.3)
        assert told() == [("low/pi", 0.3, 1.0)]
    assert all(bar.disable and bar.live.transient for bar in bars)  # no terminal
    assert terminal.new_console().width == 240
    assert (logs.percent(0.0), logs.percent(0.256)) == ("", ", 26%")


def test_a_flag_asks_for_what_is_not_done_without_it() -> None:
    """Such as to refuse a study's own code, or to write pictures."""
    parameters = [
        (command.callback.__name__, name, each.default)
        for command in app.registered_commands
        if command.callback is not None
        for name, each in inspect.signature(command.callback).parameters.items()
    ]
    refusing = {command for command, name, default in parameters if name == "no_code" and default is False}
    assert refusing == {"run", "sweep", "tune", "calibrate"}
    assert [one for one in parameters if one[2] is True] == []


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["run", "no.toml", "-j"], "'--jobs' / '-j'"),
        (["sweep", "no.toml", "-n"], "'-n'"),
        (["pil", "no.toml", "--controller", "pi", "--ticks"], "'--ticks'"),
    ],
)
def test_counts_begin_with_one(capsys: pytest.CaptureFixture[str], words: list[str], option: str) -> None:
    code, out, err = cogless(capsys, *words, 0)
    assert (code, out) == (2, "") and err.startswith(f"Invalid value for {option}: ")
    code, out, err = cogless(capsys, *words, 1)
    assert (code, out) == (2, "") and err.startswith("no.toml: no such study: ")


def test_all_commands_with_jobs_run_as_many_as_there_are_cores_by_default() -> None:
    defaults = [
        each.default
        for command in app.registered_commands
        if command.callback is not None
        for name, each in inspect.signature(command.callback).parameters.items()
        if name == "jobs"
    ]
    assert defaults == [os.cpu_count()] * 5


def test_a_tuning_s_mistake_is_told_before_it_begins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cogless.ensemble.tune.tune", lambda *_: pytest.fail("ran"))
    study = studies.write(tmp_path)
    code, out, err = cogless(capsys, "tune", study, "-o", tmp_path / "out")
    assert (code, out) == (2, "") and err.startswith(f"{study}: tune: missing: expected ")


def test_cogless_alone_says_what_it_can_do(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = cogless(capsys)
    assert "Usage: cogless" in out and "diagnose" in out and "--install-completion" in out


def test_every_option_says_what_it_is_for() -> None:
    for command in app.registered_commands:
        assert command.callback is not None
        of = get_type_hints(command.callback, include_extras=True)
        said = {name: hint.__metadata__[0].help for name, hint in of.items() if name != "return"}
        assert [name for name, text in said.items() if not text or not text.endswith(".")] == [], said


@pytest.mark.parametrize(("command", "default"), [("sweep", "1000"), ("pil", "100000")])
def test_help_shows_defaults(command: str, default: str, capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = cogless(capsys, command, "--help")
    assert f"[default: {default}]" in out


def test_an_export_without_a_controller_lists_those_of_the_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = cogless(capsys, "export", "gimbal", "--to", "c", "-o", tmp_path / "c")
    expected = f"--controller: missing: expected one of {', '.join(load('gimbal').controller)}\n"
    assert (code, out, err) == (2, "", expected)
