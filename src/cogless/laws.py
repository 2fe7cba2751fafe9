"""Controllers written in Python by a user: find the class, make the object, say where it failed."""

from __future__ import annotations

import importlib.util
import traceback
from pathlib import Path
from typing import Any

from cogless.errors import StudyError
from cogless.study import Study
from cogless.study.controller import PythonLaw


def make_law(study: Study, name: str) -> Any | None:
    """A fresh object of a python controller, else None. StudyError: no file, no class, no step()."""
    controller = study.controller[name]
    if not isinstance(controller, PythonLaw):
        return None
    path, class_name = _place(study, controller)
    where = f'{study.source.path}: controller.{name}.object: "{controller.object}"'
    if not path.is_file():
        raise StudyError(f"{where}: expected a file at {path}")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        maker = getattr(module, class_name, None)
        if maker is None:
            raise StudyError(f"{where}: expected {path.name} to define {class_name}")
        law = maker(**controller.params)
    except StudyError:
        raise
    except Exception as error:
        cause = describe(error, path)
        raise StudyError(f"{where}: {cause}: expected a class that takes the controller's params") from error
    if not callable(getattr(law, "step", None)):
        raise StudyError(f"{where}: expected a class with a method step(inputs)")
    return law


def law_file(study: Study, name: str) -> Path | None:
    """The file of a python controller."""
    controller = study.controller[name]
    return _place(study, controller)[0] if isinstance(controller, PythonLaw) else None


def describe(error: BaseException, path: Path | None) -> str:
    """An exception in one line, with the line of the user's file that it came from."""
    message = " ".join(str(error).split())
    frames = [f for f in traceback.extract_tb(error.__traceback__) if path and Path(f.filename) == path]
    place = f"{path.name} line {frames[-1].lineno}: " if path and frames else ""
    kind = "" if isinstance(error, RuntimeError) and message else f"{type(error).__name__}: "
    return f"{place}{kind}{message}".rstrip(": ")


def _place(study: Study, controller: PythonLaw) -> tuple[Path, str]:
    file, _, class_name = controller.object.rpartition(":")
    return study.source.path.parent / file, class_name
