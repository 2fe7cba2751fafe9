"""Every command in a terminal of 80 columns: no line is longer, no word broken, the answer comes first."""

from __future__ import annotations

import importlib.util
import io
import itertools
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import ensembles
import pytest
import trial_studies
from commands import cogless
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

import studies
from cogless import lines, load
from cogless.cli import app, completion
from cogless.cli.fitted import fitted
from cogless.files import shipped
from cogless.live import engine
from cogless.run import calibrate

COLUMNS, WIDE_COLUMNS = 80, 2000
FRAME = "─│╭╮╰╯"
TUNE = """
[tune]
minimise = "ripple"
variants = 2
budget = 4
[tune.keys]
controller.pi.kp = ["0.005 A/rpm", "0.06 A/rpm"]
"""
needs_engine = pytest.mark.skipif(not engine.is_there("single"), reason="no engine: make web")
needs_processor = pytest.mark.skipif(
    not all(map(importlib.util.find_spec, ("unicorn", "elftools", "ziglang"))),
    reason="no emulator or no cross compiler",
)
Printed = Callable[..., str]


@pytest.fixture
def printed(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Printed:
    """What a command prints at 80 columns, after the checks that hold for all."""
    monkeypatch.chdir(tmp_path)  # the paths that are printed are short

    def run(*arguments: object, repeatable: bool = True) -> str:
        printed_text = []
        for columns in (COLUMNS, WIDE_COLUMNS)[: 2 if repeatable else 1]:
            monkeypatch.setattr(lines, "terminal_columns", lambda *_, columns=columns: columns)
            monkeypatch.setenv("COLUMNS", str(columns))
            code, out, err = cogless(capsys, *arguments)
            assert code == 0, out
            printed_text.append(out + err)
        narrow = printed_text[0]
        too_long = [line for line in narrow.splitlines() if len(line) > COLUMNS and not is_a_word(line)]
        assert too_long == []
        if repeatable:
            assert words(narrow) == words(printed_text[1])  # none is broken, cut or left out
        return narrow

    return run


def is_a_word(line: str) -> bool:
    """Whether a line of a shell's command has one word, such as the value of --set, which can't be broken."""
    return line.startswith("    ") and len(shlex.split(line.removesuffix(" \\"))) == 1


def words(text: str) -> set[str]:
    return set(re.sub(f"[{FRAME}]", " ", text.replace(" \\\n", "\n")).split())


@pytest.mark.parametrize("options", [[], ["--all"]])
def test_run(printed: Printed, tmp_path: Path, options: list[str]) -> None:
    out = printed("run", studies.write(tmp_path), "-o", "out", "--no-limits", *options)
    assert out.startswith("low\nAt 60 rpm, fair leaves ") and "\nstep\nAt 60 rpm, " in out
    assert "\nReport: out/report.html\nNext: cogless export " in out


def test_run_of_long_labels(printed: Printed, tmp_path: Path) -> None:
    """Four columns of a table that fits two."""
    labels = [f"controller.{name}.label=A {name} with a long label" for name in ("pi", "fair")]
    more = [f"controller.more-{n}={{law='pi', kp='0.01 A/rpm', ki='0.{n} A/rpm/s'}}" for n in (1, 2)]
    options = [word for change in (*labels, *more) for word in ("--set", change)]
    out = printed(
        "run", studies.write(tmp_path), "-o", "out", "--only", "low/*", "--all", "--no-limits", *options
    )
    assert out.count("\nspeed ripple [rpm] ") == 2  # in each part of the table


@pytest.mark.parametrize("options", [[], ["--all"]])
def test_run_of_trials(printed: Printed, tmp_path: Path, options: list[str]) -> None:
    out = printed("run", trial_studies.write(tmp_path), "-o", "out", *options)
    headline, _, rest = out.removeprefix("move\n").partition("\n\n")
    assert headline.startswith("No controller beats ilc: it is at the floor ") and "\nilc " in rest


def test_run_says_what_limits_and_what_would_help(printed: Printed, tmp_path: Path) -> None:
    out = printed("run", studies.write(tmp_path), "-o", "out", "--only", "low/*")
    assert re.search(r"\n\nWhat limits fair, (.|\n)*\sthat\swas\stried:\s", out)


@pytest.mark.parametrize("name", ["uomodri", "liu2018", "verrelli2016", "hub-motor", "mandra2019"])
@pytest.mark.parametrize("options", [[], ["--long"]])
def test_design(printed: Printed, name: str, options: list[str]) -> None:
    out = printed("design", name, *options)
    if not options:
        answers = re.findall(r"^  settles  (yes|no|it |not judged)", out, re.MULTILINE)
        blocks = re.findall(r"\n\n(\S.*)\n  (settles|margins) ", out)
        assert blocks and len(answers) == sum(first == "settles" for _, first in blocks)


def test_calibrate(printed: Printed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = studies.write(tmp_path)
    changed = calibrate.Fitted("mechanics.inertia", '"1 g*m^2"', '"2 g*m^2"')
    residual = calibrate.Residual("low", "pi", "speed_ripple", None, 0.2, 0.25)
    fit = calibrate.Fit((changed,), (residual,) * 2, 0.012345, True, load(path))
    monkeypatch.setattr(calibrate, "calibrate", lambda study, progress, jobs: fit)
    out = printed("calibrate", path)
    assert out.startswith("# deviation of the fit: 1.23 % (rms of all targets)\nmechanics.inertia = ")


def test_sweep(printed: Printed, tmp_path: Path) -> None:
    (tmp_path / "varied.toml").write_text(ensembles.TEXT)
    out = printed("sweep", "varied.toml", "-n", 2, "-j", 1, "-o", "swept")
    assert out.startswith("low: Ripple keeps its limit in this share of 2 variants: ")


def test_tune(printed: Printed, tmp_path: Path) -> None:
    (tmp_path / "varied.toml").write_text(f"{ensembles.TEXT}{TUNE}")
    out = printed("tune", "varied.toml", "-j", 1, "-o", "tuned", repeatable=False)
    assert "tuned" in out


def test_new(printed: Printed, monkeypatch: pytest.MonkeyPatch) -> None:
    long_name = "a_motor_whose_name_is_long"
    options = ("--motor", "gm5208", "--drive", "moteus", "--encoder", "as5047", "--force")
    out = printed("new", long_name, *options)
    assert out.startswith(f"Wrote {long_name}.toml.\n") and f"\nNext: cogless run {long_name}\n" in out


@needs_processor
def test_pil(printed: Printed) -> None:
    out = printed("pil", "uomodri", "--controller", "harmonic", "--ticks", 200)
    assert "instructions" in out


@needs_engine
def test_live(printed: Printed, tmp_path: Path) -> None:
    assert f"Page: {tmp_path.name}-live.html\n" in printed("live", studies.write(tmp_path), "--no-limits")


def test_map_and_export(printed: Printed, tmp_path: Path) -> None:
    study = studies.write(tmp_path)
    change = ("--set", "controller.fair={law='harmonic', tuning={rule='auto'}, base=4}")
    printed("run", study, "-o", "out", "--no-limits", "--only", "low/fair", *change)
    assert printed("map", "out/maps/low/fair.bin").startswith("a valid map\n")
    out = printed("export", study, "--controller", "fair", "--to", "c", "-o", "firmware", *change)
    assert out.startswith("Export: firmware/README.md\n")


def test_a_table_of_a_dozen_columns_comes_in_parts_that_fit() -> None:
    """Each begins with the labels, and a mark stays with its number."""
    whole = Table("law")
    for n in range(11):
        whole.add_column(f"column-{n}", justify="right", no_wrap=True)
    for law in ("bar", "a law with a long label"):
        whole.add_row(law, *(f"{n}.25 *" for n in range(11)))
    console = Console(width=COLUMNS, file=io.StringIO())
    with console.capture() as text:
        for part in fitted(console, Group(whole, Text("A note."))):
            console.print(part)
    rows = text.get().splitlines()
    assert max(map(len, rows)) <= COLUMNS and rows[-1] == "A note."
    headings = [row.split() for row in rows if "column" in row]
    assert len(headings) > 1 and {heading[0] for heading in headings} == {"law"}
    assert [name for heading in headings for name in heading[1:]] == [f"column-{n}" for n in range(11)]
    assert text.get().count(".25 *") == 2 * 11


def test_list(printed: Printed) -> None:
    assert printed("list").startswith("Studies\n  arena ")


@pytest.mark.parametrize(
    "name", ["", *(str(command.callback.__name__).rstrip("_") for command in app.registered_commands)]
)
def test_help(printed: Printed, name: str) -> None:
    text = printed(*filter(None, [name]), "--help")
    assert f"Usage: cogless {name}".strip() in text
    prose = [line.strip() for line in text.partition("\u256d")[0].splitlines()]
    for line, after in itertools.pairwise(prose):
        broken_early = line and after and len(f" {line} {after.split()[0]} ") <= COLUMNS
        assert not broken_early, f"the terminal had room for more: {line}"


# What a shell is told to complete: the words of a line, and the completions of the last.
COMPLETIONS = {
    "cogless des": ["design"],
    "cogless run lib": [],
    "cogless run liu": ["liu2018-varying", "liu2018"],
    "cogless design dra": ["drafts/"],
    "cogless design drafts/": ["drafts/mine.toml"],
    "cogless run liu2018 --only 60-rpm/pi-ilc-l": ["60-rpm/pi-ilc-lead"],
    "cogless export liu2018 --controller pi-f": ["pi-fair"],
    "cogless pil liu2018 --scenario 60-rpm-l": ["60-rpm-long"],
    "cogless design drafts/mine.toml --controller pi": [],
    "cogless export drafts/mine.toml --controller p": ["pi"],
    "cogless export nothing.toml --controller p": [],
    "cogless run liu2018 --set controller.pi.k": ["controller.pi.kp=", "controller.pi.ki="],
    "cogless run liu2018 --set controller.pi.law=ha": ["controller.pi.law=harmonic"],
    "cogless run liu2018 --set motor.datasheet=uo": ["motor.datasheet=uomodri"],
    "cogless new mine --motor hu": ["hub"],
    "cogless new mine --drive mo": ["moteus"],
    "cogless identify --plan liu2018-": ["liu2018-varying"],
}


@pytest.mark.parametrize("line", COMPLETIONS)
def test_the_shell_completes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    (tmp_path / "drafts").mkdir()
    (tmp_path / "drafts" / "notes.txt").touch()
    studies.write(tmp_path).rename(tmp_path / "drafts" / "mine.toml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("_COGLESS_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split()) - 1))
    _, out, _ = cogless(capsys)
    assert out.split() == COMPLETIONS[line]


def test_all_names_of_a_kind_complete() -> None:
    assert completion.complete_study("") == [*shipped("studies"), *completion._files("")]
    motors = completion.complete_change(None, "motor.datasheet=")  # type: ignore[arg-type]
    assert motors == [f"motor.datasheet={name}" for name in shipped("motors")]
