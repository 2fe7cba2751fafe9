"""`live`: a page that runs a study in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cogless.cli.options import SetOption, StudyArgument, output_option
from cogless.cli.study import command_line, load
from cogless.cli.terminal import new_console
from cogless.errors import say


def live(
    study: StudyArgument,
    output: Annotated[
        Path | None,
        output_option("The page.", "FILE", show_default="STUDY-live.html"),
    ] = None,
    own_motor: Annotated[
        bool,
        typer.Option("--own-motor", help="Fields for the motor, of which the controller is told, too."),
    ] = False,
    changes: SetOption = None,
) -> None:
    """Write a page that runs a study in the browser: turn a gain, and see the ripple follow.

    One HTML file with the engine and the control laws inside. It needs no network and no installation.
    """
    from cogless.live import left_out, write

    loaded = load(study, changes)
    path = output or Path(f"{loaded.name}-live.html")
    with new_console(stderr=True).status("Making the page"):
        write(loaded, path, command_line("run", study, changes, []), told=own_motor)
    for line in left_out(loaded):
        say(f"Left out of the page: {line}")
    print(f"Page: {path}")
