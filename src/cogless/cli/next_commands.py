"""The commands that `cogless run` suggests at its end: only such as work with the study."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

from cogless import lines as text_lines
from cogless.cli.options import command_words
from cogless.cli.terminal import program
from cogless.errors import StudyError
from cogless.files import shipped
from cogless.results import AnyResults, Results
from cogless.study import Study

COMMANDS_MOST = 2  # suggested commands
FIRMWARE = "firmware"  # folder of the suggested export
GOES_ON = " \\"  # end of a line after which a command goes on


def next_lines(results: AnyResults, study: str, changes: list[str] | None) -> list[str]:
    """At most `COMMANDS_MOST` commands. `study`, `changes`: of the command that made the results."""
    lines: list[str] = []
    for words, comment in islice(_commands(results, study, [*(changes or ())]), COMMANDS_MOST):
        command = _broken(f"{'  or' if lines else 'Next'}: {program()}", words)
        if comment and len(f"{command[-1]}  # {comment}") <= _columns():
            command[-1] += f"  # {comment}"
        elif comment:
            command.append(f"    # {comment}")
        lines += command
    return lines


def _columns() -> float:
    return text_lines.terminal_columns() or math.inf


def _broken(start: str, words: Sequence[str]) -> list[str]:
    """A command in lines that fit the terminal, and are one command for a shell."""
    lines, columns = [start], _columns()
    for word in map(shlex.quote, words):
        if len(f"{lines[-1]} {word}{GOES_ON}") > columns:
            lines[-1] += GOES_ON
            lines.append("   ")
        lines[-1] += f" {word}"
    return lines


def _commands(results: AnyResults, study: str, changes: list[str]) -> Iterator[tuple[list[str], str]]:
    """Words of commands, with comments: hold a lost speed, export the best law, make a table."""
    from cogless.report import best_controller
    from cogless.study.toml import toml

    if not isinstance(results, Results):
        return
    cures = [cure for limited in results.limits.values() if (cure := limited.holding) is not None]
    for cure in cures[:1]:
        sets = [f"{key}={toml(value)}" for key, value in cure.changes.items()]
        yield command_words("run", study, [*changes, *sets], []), ""
    best = best_controller(results)
    if best is not None and _exports(results, best):
        options = ["--controller", best, "--to", "c", "-o", FIRMWARE]
        yield command_words("export", study, changes, options), ""
    if study not in shipped("studies"):
        yield from _table_commands(results.study, study, changes)


def _table_commands(study: Study, name: str, changes: list[str]) -> Iterator[tuple[list[str], str]]:
    """The next command towards a table of currents in the study's drive; none if the drive takes none.

    `name`: the study in the command line. With `changes` no plan is suggested, since it would ignore them.
    """
    if study.drive.make is None:
        yield ["drives"], "drives that take a table of currents"
        return
    from cogless.drives.registry import ADAPTERS, script_files

    drive = ADAPTERS.get(study.drive.make)
    if drive is None:  # a board of one's own, which runs the exported C
        return
    try:
        has_plan = not changes and bool(script_files(study, drive.name, None))
    except StudyError:
        has_plan = False
    takes = drive.write is not None
    if has_plan:
        where = drive.title if takes else "code of your own"
        remark = f"a script that records logs, for a table of currents in {where}"
        yield ["identify", "--plan", name, "--drive", drive.name], remark
    elif takes:
        yield ["drives"], f"logs and tables that cogless reads and writes for {drive.title}"


def _exports(results: Results, controller: str) -> bool:
    """Whether the controller's export as C succeeds."""
    from cogless.export import sources
    from cogless.export.prepared import first_scenario, prepare_whole

    try:
        sources.check(Path(FIRMWARE))
        prepare_whole(results.study, first_scenario(results.study, controller), controller)
    except StudyError:
        return False
    return True
