"""`map`: learned maps as firmware stores them."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from cogless.cli.options import output_option, place
from cogless.errors import StudyError


def map_(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A stored map, or a dump of flash with some in it.")
    ],
    csv: Annotated[
        Path | None,
        typer.Option(
            "--csv",
            parser=place,
            metavar="FILE",
            help="Write the newest map's entries, a row each; - prints.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output_option("Write the newest map, alone.", "FILE"),
    ] = None,
    motor: Annotated[
        str | None,
        typer.Option("--motor", metavar="ID", help="What is written is for this motor, such as 0x1F2E3D4C."),
    ] = None,
) -> None:
    """Show learned maps as firmware stores them: whose they are, what is in them, or why they are not valid.

    The newest map is the one that firmware would load. Exit 2 if none is valid.
    """
    from cogless.maps import stored_map
    from cogless.maps.map_table import identity, lines, to_csv

    if motor is not None and output is None:
        raise StudyError("--motor: expected --output too")
    found = stored_map.read(file)
    newest = stored_map.newest(found)
    if newest is None:
        raise StudyError(f"{file}: " + "; ".join(f"at byte {place.offset}: {place.map}" for place in found))
    stored, to_screen = newest.map, str(csv) == "-"
    if csv is not None and not to_screen:
        stored_map.write(csv, to_csv(stored).encode())
    if output is not None:
        wanted = stored.motor if motor is None else identity(motor)
        stored_map.write(output, bytes(dataclasses.replace(stored, motor=wanted)))
    print(to_csv(stored) if to_screen else "\n".join(lines(found, newest)), end="" if to_screen else "\n")
