"""Entry point: runs a command and gives its exit code."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import traceback
from typing import NoReturn

from cogless.errors import EXIT_DEFECT, EXIT_INTERRUPTED, EXIT_WRONG, StudyError
from cogless.files import reason
from cogless.interrupts import REQUESTS, end_as_by_ctrl_c
from cogless.lines import say

REPORT = (
    "This is a defect of cogless, not a mistake of yours. Please report it to the maintainers, with the "
    "lines above, what `cogless --version` prints, and the study."
)


def main() -> None:
    """Entry point. A user's mistake prints a line on stderr and exits with 2; Ctrl-C exits with 130.

    A defect prints its traceback and a line that asks to report it, and exits with 1.
    """
    code: int | None = None
    try:
        code = _code()
        code = _flushed(code)
        _end(code)
    except KeyboardInterrupt:  # Ctrl-C came before the command began or after it had ended.
        if code is None:
            say("Interrupted.")
        _end(EXIT_INTERRUPTED if code is None else code)


def _end(code: int) -> NoReturn:
    """End the process; in tests, which call `main`, raise SystemExit."""
    from cogless.run.side_by_side import left_behind

    if left_behind():
        os._exit(code)  # sys.exit would stop threads within the engine, and crash
    for request in REQUESTS:  # All is done, but Python's end takes a while: Ctrl-C is ignored then.
        atexit.register(signal.signal, request, signal.SIG_IGN)
    sys.exit(code)


def _code() -> int:
    """Run the command and return its exit code."""
    end_as_by_ctrl_c()
    try:
        code = _command()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    except StudyError as error:
        say(str(error))
        return EXIT_WRONG
    except KeyboardInterrupt:
        say("Interrupted.")
        return EXIT_INTERRUPTED
    except OSError as error:
        say(f"{error.filename or 'output'}: {reason(error)}")
        return EXIT_WRONG
    except Exception as error:
        if not hasattr(error, "format_message"):  # not an exception of typer
            traceback.print_exc()
            say(REPORT)
            return EXIT_DEFECT
        line = str(error.format_message()).rstrip(".")
        if line:
            named = " ".join(["cogless", *(word for word in sys.argv[1:2] if not word.startswith("-"))])
            line += _metavar(str(getattr(error, "option_name", "")))
            command = getattr(getattr(error, "ctx", None), "command_path", named)
            say(f"{line}{'' if line.endswith('?') else '.'} See {command} --help.")
        return EXIT_WRONG
    if code == EXIT_INTERRUPTED:  # typer returns this after Ctrl-C in a command
        say("Interrupted.")
    return code if isinstance(code, int) else 0


def _metavar(option: str) -> str:
    """An addition to a line that says what value an option of this command takes; "" if that is not known."""
    import typer

    from cogless.cli import app

    named = getattr(typer.main.get_command(app), "commands", {}).get("".join(sys.argv[1:2]))
    metavar = next((p.metavar for p in getattr(named, "params", ()) if option and option in p.opts), None)
    return f": expected {option} {metavar}" if metavar else ""


def _command() -> object:
    """Run the command; SystemExit or an exception if it fails."""
    if sys.argv[1:] == ["list"]:  # typer and pydantic load for twice as long as the list takes
        from cogless.catalogue import show

        show()
        return 0
    import typer

    from cogless.cli import app

    try:
        return app(prog_name="cogless", standalone_mode=False)
    except typer.Abort:
        raise KeyboardInterrupt from None


def _flushed(code: int) -> int:
    """Flush stdout and return the exit code.

    It is `code`, EXIT_WRONG if the flush fails (full disk), or EXIT_INTERRUPTED if Ctrl-C ends the flush
    (nobody reads the pipe).
    """
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except KeyboardInterrupt:
        _drop_stdout()
        return EXIT_INTERRUPTED
    except OSError as error:
        _drop_stdout()
        # BrokenPipeError: the reader closed the pipe, and needs no message.
        if code != EXIT_WRONG and not isinstance(error, BrokenPipeError):
            say(f"output: {reason(error)}")
        return EXIT_WRONG
    return code


def _drop_stdout() -> None:
    """Let Python's flush at exit write to nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
