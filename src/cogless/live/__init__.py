"""A study as a live page: one offline HTML file with engine and control laws inside, as WebAssembly."""

from collections.abc import Mapping
from pathlib import Path

from cogless.errors import StudyError
from cogless.files import replacing
from cogless.live import engine, live_page
from cogless.live.candidates import PAGE_KEYS
from cogless.live.description import left_out, page_runs
from cogless.live.live_page import NO_LIMITS
from cogless.study import AnyStudy

__all__ = ["check", "left_out", "render", "write"]


def check(study: AnyStudy) -> None:
    """Raise StudyError if a page can hold no law of the study, or if no WebAssembly engine is installed."""
    if not page_runs(study):
        raise StudyError(
            f"{study.source.path}: live: expected a controller that can run in a page: {left_out(study)[0]}"
        )
    engine.module(study.precision)


def render(
    study: AnyStudy, command: str, for_own_motor: bool = False, limits: Mapping[str, str] = NO_LIMITS
) -> str:
    """The page as one HTML text. `command`: the command that runs the study.

    `for_own_motor`: make a page for one's own motor; the motor's values change in the study itself, so the
    controllers change with them.
    `limits`: by scenario, what limits its best run; the page shows this until a value is changed.

    StudyError as in `check`.
    """
    check(study)
    study, pins = PAGE_KEYS[study.kind].pinned(study)
    return live_page.render(study, command, for_own_motor, limits, pins)


def write(
    study: AnyStudy,
    path: Path,
    command: str,
    for_own_motor: bool = False,
    limits: Mapping[str, str] = NO_LIMITS,
) -> None:
    """Write the page; if this fails, no incomplete file is left. StudyError as in `check`."""
    text = render(study, command, for_own_motor, limits)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
