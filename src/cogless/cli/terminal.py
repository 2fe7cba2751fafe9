"""The console and its progress bars."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cogless import lines as text_lines

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.progress import Progress, ProgressColumn

    from cogless.run.simulate import StudyProgress

# columns that the output has if it is no terminal: so many that lines in files and pipes are not wrapped
PIPE_COLUMNS = 240
COMMAND = "cogless"
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")  # environment variables, one of which a Linux desktop sets


def program() -> str:
    """The word that starts cogless in a command to copy: "cogless", or a path such as .venv/bin/cogless.

    The path is that of this call. It is returned if "cogless" starts nothing or another installation.
    """
    called, on_path = Path(sys.argv[0]), shutil.which(COMMAND)
    if called.name != COMMAND or called.parent == Path() or not called.exists():
        return COMMAND
    if on_path and called.samefile(on_path):
        return COMMAND
    folder = Path.cwd()
    return shlex.quote(str(called.relative_to(folder)) if called.is_relative_to(folder) else sys.argv[0])


def new_console(**options: Any) -> Console:
    from rich.console import Console

    console = Console(**options)
    return (
        console
        if console.is_terminal
        else Console(width=text_lines.terminal_columns() or PIPE_COLUMNS, **options)
    )


def print_fitted(part: RenderableType) -> None:
    """Print tables and texts. A table that is wider than the terminal is printed in parts."""
    from rich.text import Text

    from cogless.cli.fitted import fitted

    console = new_console()
    for piece in fitted(console, part):
        if isinstance(piece, Text):
            text_lines.print_text(piece.plain)
        else:
            with console.capture() as printed:
                console.print(piece, highlight=False)
            print("\n".join(line.rstrip() for line in printed.get().splitlines()))


def new_bar(*columns: ProgressColumn) -> Progress:
    """A progress bar on stderr, hidden if stderr is no terminal. `columns`: default text, bar and time."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = new_console(stderr=True)
    columns = columns or (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


@contextmanager
def run_progress(runs: int) -> Iterator[StudyProgress]:
    """Show the progress of all runs on stderr if it is a terminal; yield the function that reports it."""
    with new_bar() as bar:
        task = bar.add_task("", total=runs)
        shares: dict[tuple[str, str], float] = {}

        def report(scenario: str, controller: str, share: float) -> None:
            shares[scenario, controller] = share
            bar.update(task, completed=sum(list(shares.values())), description=f"{scenario}/{controller}")

        yield report


@contextmanager
def variant_progress(variants: int) -> Iterator[Callable[[int], None]]:
    """Show finished variants and the time left, if stderr is a terminal; yield the function that reports."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    with new_bar(
        BarColumn(), MofNCompleteColumn(), TextColumn("variants, left"), TimeRemainingColumn()
    ) as bar:
        task = bar.add_task("", total=variants)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def tune_progress() -> Iterator[Callable[[str, int, int, float], None]]:
    """Show what is tuned, its progress and the best value so far, if stderr is a terminal.

    Yields the function that reports a name, the number of tries, their budget and the best value.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    description = TextColumn("{task.description}")
    with new_bar(description, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as bar:
        tasks: dict[str, Any] = {}

        def report(name: str, tried: int, budget: int, best: float) -> None:
            if name not in tasks:
                tasks[name] = bar.add_task("", total=budget)
            bar.update(tasks[name], completed=tried, description=f"{name}: {100 * best:.3g} % of the start")

        yield report


@contextmanager
def share_progress(what: str) -> Iterator[Callable[[float], None]]:
    """Show the progress of a task, if stderr is a terminal; yield the function that takes the share done."""
    with new_bar() as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def has_desktop() -> bool:
    """Whether stdout is a terminal of a desktop, where a browser can open a window."""
    windows = sys.platform in ("win32", "darwin") or any(os.environ.get(name) for name in DISPLAYS)
    return sys.stdout.isatty() and windows


def open_page(path: Path) -> None:
    """Open a page in the browser and print its address."""
    import webbrowser

    address = path.resolve().as_uri()
    print(f"Address: {address}")
    webbrowser.open(address)
