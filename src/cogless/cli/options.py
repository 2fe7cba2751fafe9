"""Options that several commands share, and functions that load the study of a command line."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cogless.cli.completion import (
    complete_change,
    complete_controller,
    complete_run,
    complete_scenario,
    complete_study,
)
from cogless.errors import StudyError
from cogless.lines import print_text, say

if TYPE_CHECKING:
    from cogless.study import AnyStudy

COMMON_NAME = "study"  # stem of the study files that several commands write
CORES = os.cpu_count() or 1


def place(text: str) -> Path:
    """The path of an output. An empty text, as of an unset shell variable, is refused.

    Its path would be the current folder.
    """
    if not text:
        raise typer.BadParameter('"": expected a path')
    return Path(text)


def output_option(help: str, metavar: str = "DIR", show_default: bool | str = True) -> Any:
    """The option -o of a command."""
    return typer.Option("--output", "-o", parser=place, metavar=metavar, help=help, show_default=show_default)


StudyArgument = Annotated[
    str,
    typer.Argument(
        metavar="STUDY",
        help="A study file, or the name of a shipped study.",
        autocompletion=complete_study,
    ),
]

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        autocompletion=complete_change,
        help="Change a value of the study, such as controller.pi.kp=0.02. A number without a unit has the "
        "unit of the value in the study's file. KEY= without a value deletes the key.",
    ),
]

JobsOption = Annotated[
    int,
    typer.Option(
        "--jobs",
        "-j",
        min=1,
        help="Number of parallel runs.",
        show_default="one per core",
        metavar="N",
    ),
]

ControllerOption = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="NAME",
        help="Name of the controller in the study. Required.",
        show_default=False,
        autocompletion=complete_controller,
    ),
]

ScenarioOption = Annotated[
    str | None,
    typer.Option(
        "--scenario",
        metavar="NAME",
        help="Name of the scenario in which the controller runs.",
        autocompletion=complete_scenario,
        show_default="the first scenario that has the controller",
    ),
]

LimitsOption = Annotated[
    bool | None,
    typer.Option(
        "--limits/--no-limits",
        help="Find out what limits the best run of each scenario, by one or two dozen further runs.",
        show_default="on, unless the runs take long or run your own code",
    ),
]

OnlyOption = Annotated[
    list[str] | None,
    typer.Option(
        "--only",
        metavar="SCENARIO/CONTROLLER",
        help="Run only these pairs of scenario and controller. * stands for any text, ? for any character. "
        "Repeatable.",
        autocompletion=complete_run,
    ),
]

OutputOption = Annotated[
    Path | None,
    output_option(
        "Directory for the results.",
        show_default="results/NAME; NAME is that of the study's file, or of its folder if it is study.toml",
    ),
]

DaskOption = Annotated[
    str | None,
    typer.Option(
        "--dask",
        metavar="ADDRESS",
        help="Run on the Dask cluster with this address, such as tcp://node1:8786.",
    ),
]

NoCodeOption = Annotated[
    bool,
    typer.Option(
        "--no-code", help="Refuse a study that runs code from files of its own (Python or a library)."
    ),
]


def results_folder(path: Path) -> Path:
    """Default folder for the results of the study in a file."""
    return Path("results") / results_name(path)


def results_name(path: Path) -> str:
    """The name of a study's results: the stem of its file, or for a study.toml the name of its folder.

    If the folder is below the current one, its whole path from there is in the name, so that names differ.
    """
    if path.stem != COMMON_NAME:
        return path.stem
    folder, start = path.resolve().parent, Path.cwd()
    between = folder.relative_to(start).parts if folder.is_relative_to(start) else ()
    return "-".join(between) or folder.name or COMMON_NAME


def command_line(name: str, study: str, changes: list[str] | None, options: list[str]) -> str:
    """The whole command line, quoted for a shell."""
    return shlex.join(["cogless", *command_words(name, study, changes, options)])


def command_words(name: str, study: str, changes: list[str] | None, options: list[str]) -> list[str]:
    """The words of a command line after the program."""
    sets = [word for change in changes or () for word in ("--set", change)]
    return [name, study, *options, *sets]


def load(study: str, changes: list[str] | None) -> AnyStudy:
    from cogless.design.auto import load
    from cogless.study.reading import changes_from, check_deletions

    values = changes_from(changes or ())
    deleted = check_deletions(study, values)
    loaded = load(study, values)
    for key in deleted:
        say(f"Deleted for this command: {key}")
    return loaded


def chosen(study: AnyStudy, controller: str | None) -> str:
    """The controller of the command line; StudyError, with the study's controllers, if it is missing."""
    if controller is None:
        raise StudyError(f"--controller: missing: expected one of {', '.join(study.controller)}")
    return controller


def to_run(study: str, changes: list[str] | None, no_code: bool) -> AnyStudy:
    """Load a study that is to be run, and print which code of its own it would run."""
    loaded = load(study, changes)
    path = loaded.source.path
    name_code(path, "controller", loaded.controller, no_code, lambda code: str(path.parent / code))
    return loaded


def name_code(
    path: Path, table: str, laws: Mapping[str, Any], no_code: bool, path_of: Callable[[str], str]
) -> None:
    """Print which files of code these laws run, or refuse them. `path_of`: path of a file that a law has."""
    for name, law in laws.items():
        if law.code is not None:
            if no_code:
                where = f'{path}: {table}.{name}.law: "{law.law}"'
                raise StudyError(
                    f"{where}: expected a law without code of your own, since --no-code is given"
                )
            print_text(f"Code: {table}.{name} runs {path_of(law.code)}.")
