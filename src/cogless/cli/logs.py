"""`identify` and `diagnose`: find a motor's parameters and the causes of its ripple in a drive's logs."""

from __future__ import annotations

import json
import shlex
import sys
import tomllib
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from cogless.cli.completion import complete_study
from cogless.cli.options import load, output_option
from cogless.cli.printers import identify_axis, plan_runs, printer_adapter
from cogless.cli.terminal import new_console, program
from cogless.errors import StudyError
from cogless.lines import print_text


def percent(share: float) -> str:
    """The share of a step that is done, as text such as ", 40%"; empty at zero."""
    return f", {share:.0%}" if share else ""


def identify(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="LOG...", help="Logs: CSV (gz), NPZ, Parquet, MAT, MDF4, traces.nc."),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            metavar="FILE",
            help="TOML file with the meaning of the logs' columns, known values of the motor, and each log's "
            "kind, such as an acceleration.",
        ),
    ] = None,
    drive: Annotated[
        str | None,
        typer.Option(
            "--drive",
            metavar="NAME",
            help="Drive that wrote the logs, by its name in `cogless drives`. The file of --config then "
            "needs no columns.",
        ),
    ] = None,
    drive_config: Annotated[
        Path | None,
        typer.Option(
            "--drive-config",
            metavar="FILE",
            help="File with the configuration of the drive, such as a dump that the drive wrote.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output_option("Directory of the results. Default: results/identified, with --plan results/plan."),
    ] = None,
    plan: Annotated[
        str | None,
        typer.Option(
            "--plan",
            metavar="STUDY",
            autocompletion=complete_study,
            help="Write a plan of the motions to record, for the motor of this study (name or file).",
        ),
    ] = None,
    plots: Annotated[
        bool, typer.Option("--plots", help="Also write orders.png, a picture of the orders.")
    ] = False,
) -> None:
    """Find a motor's inertia, friction, cogging and K_t ripple in the logs of its drive.

    If the logs are those of an accelerometer on an axis of a printer, find the correction of the ripple of
    this axis's step motor.

    Writes motor.toml, a study.toml that you can run, an anti-cogging table, and report.html. If the logs do
    not show a value, the command leaves this value out, and says what to record for it.
    """
    from cogless.results.folder import locked_folder, new_set

    printer = printer_adapter(drive)
    if plan is not None:
        if logs or config is not None:
            first_log = "--config" if not logs else str(logs[0])
            raise StudyError(
                f"identify: --plan {plan}: expected neither logs nor --config, but got {first_log}: "
                "a plan says what to record; identify the logs afterwards"
            )
        output = output or Path("results/plan")
        if printer is not None:
            plan_runs(printer, Path(plan), output)
            return
        from cogless.drives.registry import own_law, script_files
        from cogless.identify import plan as planning
        from cogless.identify import rehearsal

        study = load(plan, None)
        scripts = script_files(study, drive, drive_config) if drive is not None else {}
        law = own_law(drive, drive_config) if drive is not None else {}
        with locked_folder(output, ["study.toml", "id.toml", *scripts]):
            with new_set(output) as stage:
                planning.write(study, stage)
                for name, text in scripts.items():
                    (stage / name).write_text(text, "utf-8")
            print(f"Study: {output / 'study.toml'}")
            if scripts:
                print(f"Script: {output / next(iter(scripts))}. Its first lines say how to start it.")
            else:
                print(f"Columns: {output / 'id.toml'}")
            for line in _motions(output / "study.toml", bool(scripts)):
                print_text(line, others="  ")
            sys.stdout.flush()
            with new_console(stderr=True).status("Rehearsing") as status:
                expected = rehearsal.expected(
                    output, lambda what, share: status.update(f"Rehearsing: {what}"), law
                )
        under = f" under {drive}'s own law with the gains of {drive_config}" if law else ""
        print(f"Expected results, from simulated logs of this motor{under}:")
        for line in expected:
            print_text(line, others="  ")
        if lowered := planning.lowered(study):
            print_text(f"! {lowered}")
        words = _identify_words(output, drive, drive_config, scripts)
        print(f"Next: {program()} {shlex.join(['identify', *words])} {_log_words(scripts)}")
        return
    if not logs:
        raise StudyError(
            "identify: expected logs with --config FILE or --drive NAME, or --plan STUDY without logs"
        )
    output = output or Path("results/identified")
    if printer is not None:
        if config is not None:
            raise StudyError(
                f"identify: --drive {drive} --config {config}: expected --drive-config FILE with a "
                "table [printer] instead of --config"
            )
        identify_axis(printer, logs, drive_config, output)
        return
    from cogless.drives.adapter import FRAME_FILE
    from cogless.drives.predicted_ripple import LAW_FILE, place_law
    from cogless.drives.registry import prepare
    from cogless.identify import command, write
    from cogless.report import identified as report

    names = ["identified.json", "motor.toml", "study.toml", "cogging.csv", "cogging.bin", "report.html"]
    if config is not None and drive is None and drive_config is None:
        of_drive, identified = None, partial(command.identified, logs, config)
    else:
        of_drive = prepare(logs, drive, drive_config, config)
        identified = partial(command.identified_logs, of_drive.identification, of_drive.logs)
        names += [FRAME_FILE, LAW_FILE.name]
        for line in of_drive.remarks:
            print(line)
    with locked_folder(output, [*names, *(["orders.png"] if plots else [])]):
        with new_console(stderr=True).status("Identifying") as status:
            result = identified(lambda what, share: status.update(f"Identifying: {what}{percent(share)}"))
        with new_set(output) as stage:
            if of_drive is not None:
                (stage / FRAME_FILE).write_text(of_drive.frame.to_json(), "utf-8")
            write.write_all(result.estimate, stage)
            if of_drive is not None and of_drive.identification.controller:
                place_law(stage)
            report.write_report(result, stage / "report.html")
            if plots:
                report.write_plot(result.estimate, stage / "orders.png")
    for line in command.value_lines(result.estimate):
        print_text(line, others="  ")
    _print_remarks(result.estimate.left_out, result.estimate.remarks)
    print()
    runs = "j" in result.estimate.values
    if runs:
        print(f"Study: {output / 'study.toml'}")
    print(f"Report: {output / 'report.html'}")
    commands = []
    if of_drive is not None and of_drive.frame.zero and result.estimate.cogging:
        words = ["table", str(output), "--to", of_drive.frame.drive if of_drive.takes_table else "csv", "-o"]
        commands.append(f"{program()} {shlex.join(words)} FILE")
    if runs:
        commands.append(f"{program()} {shlex.join(['run', str(output / 'study.toml')])}")
    else:
        commands.append(f"{program()} identify --plan STUDY, which says what to record")
    for number, text in enumerate(commands):
        print(f"{'  or' if number else 'Next'}: {text}")


def _motions(plan: Path, by_script: bool) -> list[str]:
    """Lines on a plan's motions and how long each takes; a second line on those that a script can't play."""
    study = load(str(plan), None)
    texts = {name: f"{name} ({scenario.duration:.3g} s)" for name, scenario in study.scenario.items()}
    tables = study.source.tables["scenario"]
    loaded = [name for name in texts if by_script and "load" in tables[name]]
    lines = [f"Record: {', '.join(text for name, text in texts.items() if name not in loaded)}."]
    if loaded:
        lines.append(
            f"Not in the script, since they need a load: {', '.join(texts[name] for name in loaded)}."
        )
    return lines


def _log_words(scripts: Mapping[str, str]) -> str:
    """The logs that a script writes, as words of a command; "LOG..." if the user names the logs."""
    from cogless.drives.registry import LOGS_NAME

    rules = tomllib.loads(scripts[LOGS_NAME])["log"] if scripts else []
    names = [rule["file"] for rule in rules]
    return shlex.join(names) if names and not any("*" in name for name in names) else "LOG..."


def _identify_words(
    output: Path, drive: str | None, drive_config: Path | None, scripts: Collection[str]
) -> list[str]:
    """The options with which the logs of a plan are identified. `scripts`: files written for the drive."""
    from cogless.drives.registry import LOGS_NAME
    from cogless.drives.simplefoc_sketch import MONITOR_NAME

    if drive is None:
        return ["--config", str(output / "id.toml")]
    own = output / MONITOR_NAME if MONITOR_NAME in scripts else drive_config or "DUMP"
    return ["--drive", drive, "--drive-config", str(own), "--config", str(output / LOGS_NAME)]


def diagnose(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG...", help="Logs: CSV (gz), NPZ, Parquet, MAT, MDF4, traces.nc."),
    ],
    config: Annotated[
        Path,
        typer.Option(
            "--config",
            metavar="FILE",
            help="TOML file with the meaning of the logs' columns, known values of the motor, and each log's "
            "kind, such as an acceleration.",
        ),
    ],
    output: Annotated[
        Path | None,
        output_option(
            "Directory for diagnosis.json and report.html. Without -o, the command writes no files."
        ),
    ] = None,
) -> None:
    """Say what causes the ripple in the logs of a drive.

    Prints, for each order of the ripple at the speed and load of each log, the shares of cogging, K_t ripple,
    dead time, offset and gain of the current sensors, encoder and mechanics, and how certain each share is.
    """
    from cogless.identify import diagnosis

    with new_console(stderr=True).status("Diagnosing") as status:
        result = diagnosis.diagnosed(
            logs, config, lambda what, share: status.update(f"Diagnosing: {what}{percent(share)}")
        )
    for line in diagnosis.answer_lines(result):
        print_text(line, others="  ")
    _print_remarks((), result.remarks)
    if output is not None:
        from cogless.report import diagnosed as report
        from cogless.results.folder import locked_folder, new_set

        with locked_folder(output), new_set(output) as stage:
            (stage / "diagnosis.json").write_text(
                json.dumps(diagnosis.to_dict(result), indent=2, ensure_ascii=False) + "\n", "utf-8"
            )
            report.write_report(result, stage / "report.html")
        print(f"Report: {output / 'report.html'}")


def _print_remarks(left_out: Sequence[str], remarks: Sequence[str]) -> None:
    """Print what the logs don't show, then problems, both marked with !, then notes on what agrees."""
    from cogless.identify.voltage import Agreement

    groups: dict[str, list[str]] = {
        "Not in these logs": [f"! {line}" for line in left_out],
        "Problems": [f"! {line}" for line in remarks if not isinstance(line, Agreement)],
        "Notes": [line for line in remarks if isinstance(line, Agreement)],
    }
    for heading, lines in groups.items():
        if lines:
            print(f"\n{heading}:")
        for line in lines:
            print_text(line, others="  ")
