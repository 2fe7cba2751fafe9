"""Keys of the laws that a user has written, in Python or as a shared library."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, field_validator

from cogless import units
from cogless.study.laws.law import Startable
from cogless.study.table import File, FileName, Many, StartTime, invalid


class OwnLaw(Startable):
    """The keys of every controller that a user has written himself."""

    NOT_ON_PAGE: ClassVar[str] = "its law is your own code, which the page doesn't run"

    learning: bool = False
    """True: reports count this law among the learning laws. False: they count it among the laws without
    learning."""
    learning_start: StartTime = 0.0  # s
    """Time of the run at which the law's input `learn` becomes true."""
    position: bool = False
    """True: this law controls the position, so the angle error is recorded. False: it controls the speed."""

    @property
    def learns(self) -> bool:
        return self.learning

    @property
    def learned(self) -> bool:
        return self.learning or self.start is not None

    @property
    def terms(self) -> frozenset[str]:
        """The learned part. Only a run shows whether the user's law returns this part."""
        return frozenset({"term_learned"} if self.learning else ())

    @property
    def learns_from(self) -> float:
        return self.learning_start

    @property
    def holds_position(self) -> bool:
        return self.position


class PythonLaw(OwnLaw):
    """A user's class with step(inputs) -> i_q_ref or (i_d_ref, i_q_ref), A."""

    NEEDS: ClassVar[str] = "a class with the methods learned_map() and load_map(learned)"
    NO_C_FORM: ClassVar[str] = "has no C form"

    law: Literal["python"]
    """A Python class [of your own](/guide/own-controller.md)."""
    # "file.py:Class", relative to the study
    object: Annotated[
        str, Field(pattern=r"^.+\.py:\w+$", examples=['"my_law.py:MyLaw"']), FileName(with_name=True)
    ]
    """Python file and class of the law, such as `my_law.py:MyLaw`. The path of the file is relative to the
    study."""
    params: dict[str, Any] = Field(default={})
    """Keyword arguments with which cogless makes an object of the class. A number with a unit is converted to
    SI."""

    @property
    def code(self) -> str:
        """The file whose code runs, relative to the study."""
        return self.object.rpartition(":")[0]

    @property
    def python_class(self) -> str:
        return self.object

    @property
    def arguments(self) -> dict[str, Any]:
        """The params. A text that is a number with a unit becomes an SI number."""
        return {key: _si(value) for key, value in self.params.items()}


class LibraryLaw(OwnLaw):
    """A user's shared library with the documented C interface."""

    NEEDS: ClassVar[str] = "a library with cogless_plugin_learned_map and cogless_plugin_load_map"
    NO_C_FORM: ClassVar[str] = "is C of your own already"

    law: Literal["library"]
    """A shared library [of your own](/guide/own-controller.md)."""
    library: File
    """File of the shared library; its path is relative to the study."""
    params: Many[float | str] = ()
    """Numbers, with or without units, that the init function of the library receives. A number with a unit is
    converted to SI."""

    @field_validator("params")
    @classmethod
    def _numbers(cls, params: tuple[float | str, ...]) -> tuple[float | str, ...]:
        for n, value in enumerate(params):
            if isinstance(_si(value), str):
                raise invalid('expected a number, or one with a known unit, such as "0.2 A*s/rad"', n)
        return params

    @property
    def code(self) -> str:
        """The file whose code runs, relative to the study."""
        return self.library

    def own_code(self, folder: Path, drive: Mapping[str, Any]) -> dict[str, Any]:
        return {
            "library": str((folder / self.library).resolve()),
            "params": self.numbers,
            "drive": dict(drive),
        }

    @property
    def numbers(self) -> list[float]:
        """The params as SI numbers."""
        return [float(_si(value)) for value in self.params]


def _si(value: Any) -> Any:
    """The SI number for a text that is a number with a known unit; any other value unchanged."""
    if isinstance(value, list):
        return [_si(item) for item in value]
    unit = units.unit_of(value) if isinstance(value, str) else ""
    return units.in_si(value) if unit and units.is_known(unit) else value
