"""`export` writes a controller as C or FMU, `pil` runs it on an emulated processor, `map` shows maps."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from cogless.cli.options import (
    ControllerOption,
    ScenarioOption,
    SetOption,
    StudyArgument,
    chosen,
    command_line,
    load,
    output_option,
    place,
)
from cogless.cli.printed import print_warnings
from cogless.cli.terminal import new_console, share_progress
from cogless.errors import StudyError
from cogless.lines import print_text

EXIT_DIFFERENT = 1


def export(
    study: StudyArgument,
    to: Annotated[
        str,
        typer.Option("--to", metavar="c|fmu", help="Form of the export: C code or FMUs.", show_default=False),
    ],
    output: Annotated[
        Path,
        output_option("Folder for the export. With --to c it must be new, empty, or from an earlier export."),
    ],
    controller: ControllerOption = None,
    scenario: ScenarioOption = None,
    changes: SetOption = None,
) -> None:
    """Write a controller as C code for firmware, or as FMUs for other simulators.

    With --to c: code and constants of the controller, a self-test and an example. The self-test repeats the
    beginning of the scenario. For a linear plant, and for the law microstepping, the code contains the law
    without a drive.

    With --to fmu: one FMU of the controller alone, and one of the whole drive in the scenario, which contains
    the controller. Each FMU is for FMI 2.0 and 3.0 (co-simulation). Your C and C++ compilers build the FMUs;
    the environment variables CC and CXX name them.
    """
    from cogless.export.prepared import first_scenario

    if to == "fmu":
        from cogless.export.fmu import write_fmus

        loaded = load(study, changes)
        controller = chosen(loaded, controller)
        with new_console(stderr=True).status("Compiling"):
            written = write_fmus(loaded, controller, scenario, output)
        for path in written:
            print(f"FMU: {path}")
        print_warnings(loaded, [(first_scenario(loaded, controller, scenario), controller)])
        return
    if to != "c":
        raise StudyError(f'--to: "{to}": expected c or fmu')
    from cogless.export.c.export_c import export_c
    from cogless.export.c.linear import export_linear

    loaded = load(study, changes)
    controller = chosen(loaded, controller)
    options = ["--controller", controller, "--to", to, *(["--scenario", scenario] if scenario else [])]
    options += ["-o", str(output)]
    command = command_line("export", study, changes, options)

    def announce(size: str) -> None:
        print_text(f"Size: {size}.")
        sys.stdout.flush()

    if loaded.drive is None:
        export_linear(loaded, controller, output, scenario, command, announce)
    else:
        export_c(loaded, controller, output, scenario, command, announce)
    print(f"Export: {output / 'README.md'}")
    print_warnings(loaded, [(first_scenario(loaded, controller, scenario), controller)])


def pil(
    study: StudyArgument,
    controller: ControllerOption = None,
    scenario: ScenarioOption = None,
    ticks: Annotated[
        int,
        typer.Option(
            "--ticks",
            min=1,
            metavar="N",
            help="Number of current-loop periods to run, at most as many as the scenario has.",
        ),
    ] = 100_000,
    compiler: Annotated[
        str | None,
        typer.Option(
            "--compiler",
            metavar="gcc|zig",
            help="Cross compiler that builds the controller for the Cortex-M4F.",
            show_default="gcc if installed, else zig",
        ),
    ] = None,
    changes: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the comparison as JSON.")] = False,
) -> None:
    """Run a controller on an emulated Cortex-M4F, in closed loop with the simulated motor.

    Compares all outputs of each period, and all learned values, with those of the simulation, bit for bit.
    Counts instructions, stack, flash and RAM. The exit code is 1 if a value differs.
    """
    from cogless.export.prepared import first_scenario
    from cogless.pil import toolchain
    from cogless.pil.compare import NAME_COLUMNS, compare, comparison_lines
    from cogless.pil.processor import require

    if compiler not in (None, "gcc", "zig"):
        raise StudyError(f'--compiler: "{compiler}": expected gcc or zig')
    loaded, tools = load(study, changes), toolchain.find(compiler)
    require()
    controller = chosen(loaded, controller)
    where = first_scenario(loaded, controller, scenario)
    with share_progress(f"{where}/{controller}") as progress:
        comparison = compare(loaded, controller, where, ticks, tools, progress)
    if as_json:
        print(json.dumps(dataclasses.asdict(comparison), indent=2, ensure_ascii=False))
    else:
        for line in comparison_lines(comparison):
            print_text(line, others=" " * NAME_COLUMNS)
    print_warnings(loaded, [(where, controller)])
    if comparison.difference is not None:
        sys.exit(EXIT_DIFFERENT)


def map_(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="A stored map, or a dump of flash that contains stored maps."),
    ],
    csv: Annotated[
        Path | None,
        typer.Option(
            "--csv",
            parser=place,
            metavar="FILE",
            help="Write the entries of the newest map to this file, as CSV. If the file is -, print the "
            "entries.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output_option("Write only the newest map to this file, without the rest of the dump.", "FILE"),
    ] = None,
    motor: Annotated[
        str | None,
        typer.Option(
            "--motor",
            metavar="ID",
            help="Identity of the motor in the map that --output writes: the number that your firmware gives "
            "to its motor, such as 0x1F2E3D4C.",
        ),
    ] = None,
) -> None:
    """Show the learned maps in a file from firmware: the motor and content of each, or why it is not valid.

    The newest map is the one that firmware would load. The exit code is 2 if no map is valid.
    """
    from cogless.maps import stored_map
    from cogless.maps.stored_map import identity, map_lines, to_csv

    if motor is not None and output is None:
        raise StudyError("--motor: expected --output, too")
    places = stored_map.read(file)
    newest = stored_map.newest(places)
    if newest is None:
        raise StudyError(f"{file}: " + "; ".join(f"at byte {place.offset}: {place.map}" for place in places))
    stored, to_screen = newest.map, str(csv) == "-"
    if csv is not None and not to_screen:
        stored_map.write(csv, to_csv(stored).encode())
    if output is not None:
        motor_identity = stored.motor if motor is None else identity(motor)
        stored_map.write(output, bytes(dataclasses.replace(stored, motor=motor_identity)))
    if to_screen:
        print(to_csv(stored), end="")
    else:
        print_text("\n".join(map_lines(places, newest)))
