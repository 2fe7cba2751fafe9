"""Controllers of a user: find the Python class or shared library, create the object, report where it
failed.

A user's own law may ask for numbers of the drive, from which a rule can compute its gains.
"""

from __future__ import annotations

import importlib.util
import inspect
import os
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from cogless.errors import StudyError
from cogless.study import AnyStudy


@dataclass(frozen=True, kw_only=True)
class KnownDrive:
    """A drive as its controller knows it, without the overrides of a scenario; SI units.

    The fields are those of `cogless_plugin_drive` in plugin.h.
    """

    pole_pairs: int
    phases: int  # 2 or 3
    slots: int  # slots of the stator; 0: the study doesn't have the number
    R_s: float  # ohm, of a phase
    L_d: float  # H
    L_q: float  # H
    psi_f: float  # Wb
    torque_constant: float  # N*m/A, of i_q
    inertia: float  # kg*m^2, of rotor and load
    current_limit: float  # A
    current_bandwidth: float  # rad/s, of the current loop; 0: it is ideal
    current_period: float  # s
    delay: float  # s, from sampling to the middle of the period in which the voltage acts; 0: ideal


def known_drive(study: AnyStudy) -> KnownDrive:
    """The drive as the study's controllers know it."""
    motor, mechanics, drive = study.motor, study.mechanics, study.drive
    assert motor is not None and mechanics is not None and drive is not None
    star, period = motor.star(), 1 / drive.rates.current_loop
    belief = drive.belief.resolved(star)
    return KnownDrive(
        pole_pairs=motor.pole_pairs,
        phases=star.phases,
        slots=getattr(motor, "slots", None) or 0,
        R_s=belief.R_s,
        L_d=belief.L_d,
        L_q=belief.L_q,
        psi_f=belief.psi_f,
        torque_constant=star.power_factor * motor.pole_pairs * belief.psi_f,
        inertia=mechanics.stiff.inertia,
        current_limit=drive.largest_torque_current(star),
        current_bandwidth=drive.current_loop.gains(belief)["kp_q"] / belief.L_q,
        current_period=period,
        delay=0.0 if drive.ideal else drive.advance * period,
    )


RETURNS = "step() returns i_q_ref or (i_d_ref, i_q_ref)"
LOADING = threading.RLock()  # guards sys.path and sys.modules, which all threads share
NOT_A_NUMBER = "std::bad_cast"  # the engine's message about a returned value that isn't as RETURNS says


def make_law(study: AnyStudy, name: str) -> Any | None:
    """Create a new object of a Python controller; None for others. StudyError: no file, class or step()."""
    controller = study.controller[name]
    if controller.code is None:
        return None
    if controller.python_class is None:
        _find(study, f"controller.{name}.library", controller.code)
        return None
    class_name = controller.python_class.rpartition(":")[2]
    path = _find(study, f"controller.{name}.object", controller.code, controller.python_class)
    where = f'{study.source.path}: controller.{name}.object: "{controller.python_class}"'
    with _reporting(
        where, path, "expected a file that loads; it may import installed modules, or files next to it"
    ):
        module = _module(path.resolve())
    maker = getattr(module, class_name, None)
    if maker is None:
        raise StudyError(f"{where}: expected {path.name} to define {class_name}")
    drive = known_drive(study)
    with _reporting(where, path, "expected a class that takes the controller's params"):
        law = maker(**controller.arguments, **({"drive": drive} if _takes_drive(maker) else {}))
    if not callable(getattr(law, "step", None)):
        raise StudyError(f"{where}: expected a class with a method step(inputs)")
    return law


def _takes_drive(maker: Any) -> bool:
    """Whether a class has an argument `drive`."""
    try:
        return "drive" in inspect.signature(maker).parameters
    except (TypeError, ValueError):  # not a class, or a class written in C
        return False


@contextmanager
def _reporting(where: str, path: Path, expected: str) -> Iterator[None]:
    try:
        yield
    except BaseException as error:
        if not is_failure(error):
            raise
        raise StudyError(f"{where}: {describe(error, path)}: {expected}") from error


def _module(path: Path) -> ModuleType:
    """Load the file as a new module. Modules that the file imports from its own folder are new, too."""
    name = f"cogless_law_{path.stem}_{hash(path):x}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError("not a .py file")
    module = importlib.util.module_from_spec(spec)
    folder = str(path.parent)
    with LOADING:
        before = set(sys.modules)
        sys.modules[name] = module  # dataclasses look up their annotations' names here
        sys.path.insert(0, folder)
        try:
            spec.loader.exec_module(module)
        finally:
            with suppress(ValueError):
                sys.path.remove(folder)
            # Forget these modules: another study may have a helper of the same name.
            for other in set(sys.modules) - before - {name}:
                if _is_beside(sys.modules[other], other, path.parent):
                    del sys.modules[other]
    return module


def _is_beside(module: ModuleType, name: str, folder: Path) -> bool:
    """Whether a module was loaded from this folder itself, not from a virtual environment within it."""
    places = [getattr(module, "__file__", None), *getattr(module, "__path__", ())]
    file = next((Path(place).resolve() for place in places if place), None)
    if file is None or not file.is_relative_to(folder):
        return False
    return file.relative_to(folder).parts[0].partition(".")[0] == name.partition(".")[0]


def law_file(study: AnyStudy, name: str) -> Path | None:
    """The file of a Python controller; None for other controllers."""
    controller = study.controller[name]
    if controller.python_class is None or controller.code is None:
        return None
    return study.source.folder / controller.code


def _raise_exit(status: int) -> NoReturn:
    raise SystemExit(status)


@contextmanager
def no_exit() -> Iterator[None]:
    """Let os._exit raise SystemExit as sys.exit does, so that a law that calls it fails and ends no process.

    This changes os._exit for all threads, so use it only in a process of a command or of a worker.
    """
    before, os._exit = os._exit, _raise_exit
    try:
        yield
    finally:
        os._exit = before


def is_failure(error: BaseException) -> bool:
    """Whether an exception is a failure of the law. A KeyboardInterrupt in the main thread is Ctrl-C, and no
    failure."""
    if isinstance(error, KeyboardInterrupt):
        return threading.current_thread() is not threading.main_thread()
    return True


def describe(error: BaseException, path: Path | None) -> str:
    """An exception as text in one line, with the number of the line in the user's file that raised it."""
    message = " ".join(str(error).split())
    if message in (NOT_A_NUMBER, RETURNS):
        return f"{path.name}: {RETURNS}" if path else RETURNS
    if isinstance(error, AttributeError) and type(error.obj).__name__ == "LawInput":
        message = _unknown_field(message, type(error.obj))
    line = _line(error, path)
    if isinstance(error, SystemExit):
        return f"{line}calls exit({message})"
    of_engine = isinstance(error, RuntimeError) or (type(error) is ValueError and not line)
    kind = "" if of_engine and message else f"{type(error).__name__}: "
    return f"{line}{kind}{message}".rstrip(": ")


def _line(error: BaseException, path: Path | None) -> str:
    """File name and the last line of the user's file in an exception's traceback; "" if there is none."""
    frames = traceback.extract_tb(error.__traceback__) if path else []
    lines = [f.lineno for f in frames if path and Path(f.filename).resolve() == path.resolve()]
    return f"{path.name} line {lines[-1]}: " if path and lines else ""


def _unknown_field(message: str, inputs: type) -> str:
    """The message about an unknown field of a law's inputs, with the valid fields added.

    Python 3.13 names the class with its module, which is removed.
    """
    fields = ", ".join(name for name in vars(inputs) if not name.startswith("_"))
    return f"{message.replace(f'{inputs.__module__}.', '')}: expected one of {fields}"


def _find(study: AnyStudy, key: str, file: str, value: str | None = None) -> Path:
    """Path of a user's file. `file`: relative to the study. StudyError: there is no such file."""
    path = study.source.folder / file
    if not path.is_file():
        raise StudyError(f'{study.source.path}: {key}: "{value or file}": expected a file at {path}')
    return path
