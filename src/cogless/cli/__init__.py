"""The commands: parse arguments, call the library, print results."""

from __future__ import annotations

import inspect
import os
from typing import Annotated

import typer

from cogless.cli.drives import drives, table
from cogless.cli.ensembles import sweep, tune
from cogless.cli.firmware import export, map_, pil
from cogless.cli.logs import diagnose, identify
from cogless.cli.new import new
from cogless.cli.printers import stripe
from cogless.cli.studies import calibrate, design, list_, live, run

__all__ = ["app"]

# The matrices of the designs are so small that several BLAS threads would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Simulate a permanent-magnet motor drive and compare the controllers that remove its torque ripple.",
)


def _version(is_asked: bool) -> None:
    if is_asked:
        from cogless.files import versions

        print(f"cogless {versions()['cogless']}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


def _paragraphs(text: str) -> str:
    """A docstring with each paragraph in one line, which the terminal then breaks at its own width."""
    return "\n\n".join(" ".join(part.split()) for part in inspect.cleandoc(text).split("\n\n"))


# in the order of `cogless --help`
for command in (
    new,
    run,
    live,
    sweep,
    tune,
    design,
    export,
    pil,
    identify,
    diagnose,
    table,
    drives,
    stripe,
    list_,
    calibrate,
    map_,
):
    app.command(command.__name__.rstrip("_"), help=_paragraphs(command.__doc__ or ""))(command)
