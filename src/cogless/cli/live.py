"""`live`: a page that runs a study in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cogless.cli.limits import sentences, with_limits
from cogless.cli.options import CORES, JobsOption, LimitsOption, SetOption, StudyArgument, output_option
from cogless.cli.study import command_line, load
from cogless.cli.terminal import new_console, run_progress
from cogless.errors import say

if TYPE_CHECKING:
    from cogless.study import AnyStudy


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
    limits: LimitsOption = None,
    jobs: JobsOption = CORES,
    changes: SetOption = None,
) -> None:
    """Write a page that runs a study in the browser: turn a gain, and see the ripple follow.

    One HTML file with the engine and the control laws inside. It needs no network and no installation.
    """
    from cogless.live import check, left_out, write

    loaded = load(study, changes)
    check(loaded)
    path = output or Path(f"{loaded.name}-live.html")
    texts = {} if own_motor else _limits(loaded, limits, jobs)
    with new_console(stderr=True).status("Making the page"):
        write(loaded, path, command_line("run", study, changes, []), told=own_motor, limits=texts)
    for line in left_out(loaded):
        say(f"Left out of the page: {line}")
    print(f"Page: {path}")


def _limits(study: AnyStudy, wanted: bool | None, jobs: int) -> dict[str, str]:
    """Sentences on what limits the best run, by scenario. They take runs of the whole study."""
    from cogless.live.blobs import held
    from cogless.report import is_quick
    from cogless.run.simulate import RunError, run_study
    from cogless.study import Study

    if not isinstance(study, Study) or wanted is False:
        return {}
    pairs = [pair for pair in held(study) if wanted or is_quick(study, *pair)]
    if not pairs:
        return {}
    try:
        with run_progress(len(pairs)) as progress:
            results = run_study(study, ["/".join(pair) for pair in pairs], progress, jobs)
    except RunError:  # the page shows that run's failure
        return {}
    return sentences(with_limits(results, wanted, jobs, None))
