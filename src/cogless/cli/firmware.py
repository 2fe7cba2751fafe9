"""`export` and `pil`: a controller as C, as an FMU, and on an emulated processor."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from cogless.cli.options import ControllerOption, ScenarioOption, SetOption, StudyArgument, output_option
from cogless.cli.study import command_line, load
from cogless.cli.tables import print_warnings
from cogless.cli.terminal import new_console, share_progress
from cogless.errors import StudyError

DIFFERENT = 1


def export(
    study: StudyArgument,
    controller: ControllerOption,
    to: Annotated[str, typer.Option("--to", metavar="c|fmu", help="What to write.", show_default=False)],
    output: Annotated[
        Path,
        output_option("For c a new or empty folder, or an earlier export."),
    ],
    scenario: ScenarioOption = None,
    changes: SetOption = None,
) -> None:
    """Write a controller for firmware (c), or for other simulators (fmu).

    c: its constants, the code, a self-test, an example. The folder appears whole or not at all. What the
    self-test repeats is the beginning of the scenario.

    fmu: the controller, and the drive in the scenario as its plant, each for FMI 2.0 and 3.0 (co-simulation),
    built by your C and C++ compilers (CC and CXX).
    """
    if to == "fmu":
        from cogless.export.fmu import write_fmus
        from cogless.export.prepared import first_scenario

        loaded = load(study, changes)
        with new_console(stderr=True).status("Compiling"):
            written = write_fmus(loaded, controller, scenario, output)
        for path in written:
            print(f"FMU: {path}")
        print_warnings(loaded, [(first_scenario(loaded, controller, scenario), controller)])
        return
    if to != "c":
        raise StudyError(f'--to: "{to}": expected c or fmu')
    from cogless.export.c.command import export_c

    options = ["--controller", controller, "--to", to, *(["--scenario", scenario] if scenario else [])]
    options += ["-o", str(output)]
    command = command_line("export", study, changes, options)
    loaded = load(study, changes)
    subject = export_c(
        loaded, controller, output, scenario, command, lambda size: print(f"Size: {size}", flush=True)
    )
    print(f"Export: {output / 'README.md'}")
    print_warnings(loaded, [(subject.scenario, controller)])


def pil(
    study: StudyArgument,
    controller: ControllerOption,
    scenario: ScenarioOption = None,
    ticks: Annotated[
        int,
        typer.Option(
            "--ticks", min=1, metavar="N", help="Current-loop periods, at most those of the scenario."
        ),
    ] = 100_000,
    compiler: Annotated[
        str | None,
        typer.Option("--compiler", metavar="gcc|zig", help="Which one.", show_default="gcc if it is there"),
    ] = None,
    changes: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Run the exported controller on an emulated Cortex-M4F, closed with the simulated plant.

    Compares every output of every period, and what was learned, with the simulation, bit for bit; counts
    instructions, stack, flash and RAM. Exit code 1 where anything differs.
    """
    from cogless.export.prepared import first_scenario
    from cogless.pil import toolchain
    from cogless.pil.compare import compare
    from cogless.pil.processor import require
    from cogless.pil.table import lines

    if compiler not in (None, "gcc", "zig"):
        raise StudyError(f'--compiler: "{compiler}": expected gcc or zig')
    loaded, tools = load(study, changes), toolchain.find(compiler)
    require()
    where = first_scenario(loaded, controller, scenario)
    with share_progress(f"{where}/{controller}") as progress:
        found = compare(loaded, controller, where, ticks, tools, progress)
    if as_json:
        print(json.dumps(dataclasses.asdict(found), indent=2, ensure_ascii=False))
    else:
        for line in lines(found):
            print(line)
    print_warnings(loaded, [(where, controller)])
    if found.difference is not None:
        sys.exit(DIFFERENT)
