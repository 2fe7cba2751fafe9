"""A study as a live page: one offline HTML file with engine and control laws inside, as WebAssembly."""

from pathlib import Path

from cogless.errors import StudyError
from cogless.files import replacing
from cogless.live import page
from cogless.live.blobs import held, own_laws
from cogless.study import AnyStudy, TrialStudy

__all__ = ["own_laws", "render", "write"]


def render(study: AnyStudy, command: str) -> str:
    """The page as one HTML text. `command`: the one that runs the study.

    StudyError: a study of trials, or one that has only laws of the user's own; no WebAssembly engine.
    """
    if isinstance(study, TrialStudy):
        raise StudyError(f"{study.source.path}: live: expected a study of speed, not one of trials")
    if not held(study):
        raise StudyError(f"{study.source.path}: live: expected a controller of the control library")
    return page.render(study, command)


def write(study: AnyStudy, path: Path, command: str) -> None:
    """Write the page; if this fails, no incomplete file is left. StudyError as in `render`."""
    text = render(study, command)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
