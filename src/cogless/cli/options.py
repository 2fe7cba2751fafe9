"""Options that several commands share."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

CORES = os.cpu_count() or 1


def place(text: str) -> Path:
    """The path of an output. An empty one, as of an unset shell variable, would be the current folder."""
    if not text:
        raise typer.BadParameter('"": expected a path')
    return Path(text)


def output_option(help: str, metavar: str = "DIR", show_default: bool | str = True) -> Any:
    """The option -o of a command."""
    return typer.Option("--output", "-o", parser=place, metavar=metavar, help=help, show_default=show_default)


StudyArgument = Annotated[
    str, typer.Argument(metavar="STUDY", help="A study file, or the name of a shipped study.")
]

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a value, such as controller.pi.kp=0.02. A number takes the unit that stands there.",
    ),
]

JobsOption = Annotated[
    int, typer.Option("--jobs", "-j", min=1, help="Runs at a time.", show_default="one a core", metavar="N")
]

ControllerOption = Annotated[
    str, typer.Option("--controller", metavar="NAME", help="A controller of the study.", show_default=False)
]

ScenarioOption = Annotated[
    str | None,
    typer.Option(
        "--scenario",
        metavar="NAME",
        help="Where it runs.",
        show_default="the first scenario that has the controller",
    ),
]

LimitsOption = Annotated[
    bool | None,
    typer.Option(
        "--limits/--no-limits",
        help="Find what limits each scenario's best run, by about a dozen further runs.",
        show_default="unless the runs are long or run own code",
    ),
]

OnlyOption = Annotated[
    list[str] | None,
    typer.Option("--only", metavar="SCENARIO/CONTROLLER", help="Only this run; * and ? match. Repeatable."),
]

OutputOption = Annotated[
    Path | None,
    output_option("Where results go.", show_default="results/STUDY"),
]

DaskOption = Annotated[
    str | None,
    typer.Option("--dask", metavar="ADDRESS", help="Run on a Dask cluster, such as tcp://node1:8786."),
]

NoCodeOption = Annotated[
    bool,
    typer.Option("--no-code", help="Refuse a study that brings its own code, in Python or a library."),
]
