"""A study as a live page: one offline HTML file with engine and control laws inside, as WebAssembly."""

from pathlib import Path

from cogless.errors import StudyError
from cogless.files import replacing
from cogless.live import page
from cogless.live.blobs import held, left_out
from cogless.study import AnyStudy

__all__ = ["left_out", "render", "write"]


def render(study: AnyStudy, command: str, told: bool = False) -> str:
    """The page as one HTML text. `command`: the one that runs the study.

    `told`: for one's own motor: its values are changed in the study, so the controller is told, too.

    StudyError: a study that has only laws that a page can't hold; no WebAssembly engine.
    """
    if not held(study):
        raise StudyError(
            f"{study.source.path}: live: expected a controller that a page can hold: {left_out(study)[0]}"
        )
    return page.render(study, command, told)


def write(study: AnyStudy, path: Path, command: str, told: bool = False) -> None:
    """Write the page; if this fails, no incomplete file is left. StudyError as in `render`."""
    text = render(study, command, told)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
