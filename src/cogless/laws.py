"""Controllers of a user: find the Python class or the library, make the object, say where it failed."""

from __future__ import annotations

import importlib.util
import threading
import traceback
from pathlib import Path
from typing import Any

from cogless.errors import StudyError
from cogless.study import Study
from cogless.study.controller import LibraryLaw, PythonLaw

RETURNS = "step() returns i_q_ref or (i_d_ref, i_q_ref)"
NOT_A_NUMBER = "std::bad_cast"  # what the engine says of a value that it can't use


def make_law(study: Study, name: str) -> Any | None:
    """A fresh object of a python controller, else None. StudyError: no file, no class, no step()."""
    controller = study.controller[name]
    if isinstance(controller, LibraryLaw):
        _find(study, f"controller.{name}.library", controller.library)
    if not isinstance(controller, PythonLaw):
        return None
    file, _, class_name = controller.object.rpartition(":")
    path = _find(study, f"controller.{name}.object", file, controller.object)
    where = f'{study.source.path}: controller.{name}.object: "{controller.object}"'
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
    except (Exception, SystemExit) as error:
        cause = describe(error, path)
        raise StudyError(f"{where}: {cause}: expected a class that takes the controller's params") from error
    if not callable(getattr(law, "step", None)):
        raise StudyError(f"{where}: expected a class with a method step(inputs)")
    return law


def law_file(study: Study, name: str) -> Path | None:
    """The file of a python controller."""
    controller = study.controller[name]
    if not isinstance(controller, PythonLaw):
        return None
    return study.source.path.parent / controller.object.rpartition(":")[0]


def is_failure(error: BaseException) -> bool:
    """Whether an exception is a law's own; a KeyboardInterrupt in the main thread is Ctrl-C."""
    if isinstance(error, KeyboardInterrupt):
        return threading.current_thread() is not threading.main_thread()
    return isinstance(error, Exception | SystemExit)


def describe(error: BaseException, path: Path | None) -> str:
    """An exception in one line, with the line of the user's file that it came from."""
    message = " ".join(str(error).split())
    if message in (NOT_A_NUMBER, RETURNS):
        return f"{path.name}: {RETURNS}" if path else RETURNS
    kind = "" if isinstance(error, RuntimeError) and message else f"{type(error).__name__}: "
    return f"{_line(error, path)}{kind}{message}".rstrip(": ") + _fields(error)


def _line(error: BaseException, path: Path | None) -> str:
    """The last line of the user's file that an exception passed through."""
    frames = traceback.extract_tb(error.__traceback__) if path else []
    lines = [f.lineno for f in frames if path and Path(f.filename).resolve() == path.resolve()]
    return f"{path.name} line {lines[-1]}: " if path and lines else ""


def _fields(error: BaseException) -> str:
    """The fields of a law's inputs, after a wrong one."""
    inputs = error.obj if isinstance(error, AttributeError) else None
    if type(inputs).__name__ != "LawInput":
        return ""
    return f": expected one of {', '.join(name for name in vars(type(inputs)) if not name.startswith('_'))}"


def _find(study: Study, key: str, file: str, shown: str | None = None) -> Path:
    """A file of the user's, relative to the study."""
    path = study.source.path.parent / file
    if not path.is_file():
        raise StudyError(f'{study.source.path}: {key}: "{shown or file}": expected a file at {path}')
    return path
