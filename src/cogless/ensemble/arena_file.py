"""An arena: plants of other studies, and the laws that meet on each of them, by one line each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, PrivateAttr, ValidationError, field_validator, model_validator

from cogless.study.laws import Controller
from cogless.study.messages import problems, study_error
from cogless.study.table import (
    AngularSpeedMagnitude,
    Duration,
    Line,
    Many,
    SpeedGain,
    SpeedIntegralGain,
    Table,
    Torque,
    dotted_keys,
    invalid,
)

USERS = ("object", "library")  # keys that name a user's file


class GivenFeedback(Table):
    """A speed PI by hand, for a plant whose feedback no rule gives."""

    kp: SpeedGain  # A*s/rad
    ki: SpeedIntegralGain  # A/rad


class ArenaPlant(Table):
    """A plant: a scenario of a study, and what happens in it."""

    study: str  # a shipped one, or a path relative to the arena's file
    scenario: str
    about: Line = ""
    changes: dict[str, Any] = Field(default={})  # values by dotted key, which the laws know, too
    reference: Any = None  # instead of the scenario's
    feedback: GivenFeedback | None = None  # instead of each law's own; laws without a PI stay away
    begin: Duration  # s, from the start until learning begins
    learn: Duration  # s, from then until the load's step
    window: Duration  # s, at the end of it, in which ripple, loss and chattering are measured
    hold: Duration  # s, that the step lasts, and then the time until a fault, and from it to the end
    load: Torque  # N*m, the step
    smooth: Duration  # s, a period of the strongest ripple: the response to the step is averaged over it
    band: AngularSpeedMagnitude  # rad/s, in which the response has settled
    hour: bool = False  # also run it for an hour
    target: AngularSpeedMagnitude  # rad/s, rms of the speed error with which it counts as learned

    @field_validator("changes")
    @classmethod
    def _dotted(cls, changes: dict[str, Any]) -> dict[str, Any]:
        return dotted_keys(changes, lambda key, value: isinstance(value, dict))

    @model_validator(mode="after")
    def _check_window(self) -> Self:
        if self.window > self.learn:
            raise invalid("expected a time within learn", "window")
        return self


class ArenaTrials(Table):
    """A study of trials, whose own controllers meet in its scenarios."""

    study: str  # a shipped one, or a path relative to the arena's file
    about: Line = ""
    changes: dict[str, Any] = Field(default={})  # of the study, by dotted key

    @field_validator("changes")
    @classmethod
    def _dotted(cls, changes: dict[str, Any]) -> dict[str, Any]:
        return dotted_keys(changes, lambda key, value: isinstance(value, dict))


class Arena(Table):
    """A validated arena. Made by `arena_of`."""

    title: Line
    description: str = ""
    seeds: Many[Annotated[int, Field(ge=0, lt=2**32)]] = (0,)  # of sensors' noise, and of the first angle
    plant: Annotated[dict[str, ArenaPlant], Field(min_length=1)]
    law: Annotated[dict[str, Controller], Field(min_length=1)]
    trials: dict[str, ArenaTrials] = Field(default={})
    _path: Path = PrivateAttr()
    _laws: dict[str, dict[str, Any]] = PrivateAttr()

    @model_validator(mode="after")
    def _one_bar(self) -> Self:
        if len([law for law in self.law.values() if law.baseline]) != 1:
            raise invalid("expected a law with baseline = true, by which all others are measured", "law")
        return self

    @property
    def path(self) -> Path:
        """The arena's file."""
        return self._path

    @property
    def name(self) -> str:
        """The file's name without suffix."""
        return self._path.stem

    @property
    def laws(self) -> dict[str, dict[str, Any]]:
        """The laws as in the file, with what they name by path found from anywhere."""
        return {
            name: {key: self.user_file(value) if key in USERS else value for key, value in table.items()}
            for name, table in self._laws.items()
        }

    def user_file(self, path: str) -> str:
        """A user's file, which is beside the arena's, or else where the command runs."""
        path_here = self._path.parent.resolve() / path
        exists = Path(str(path_here).rpartition(":")[0] or path_here).exists()
        return str(path_here if exists else Path(path).resolve())

    @property
    def bar(self) -> str:
        """Name of the law by which all are measured."""
        return next(name for name, law in self.law.items() if law.baseline)

    def label(self, law: str) -> str:
        """Name of a law as shown."""
        return self.law[law].label or law


def arena_of(path: Path, tables: dict[str, Any]) -> Arena:
    """The arena of these tables, validated; StudyError lists its mistakes, one per line."""
    try:
        arena = Arena.model_validate(tables, context={"folder": path.parent})
    except ValidationError as error:
        raise study_error([problem.line(path) for problem in problems(error, tables)]) from None
    arena._path, arena._laws = path, tables["law"]
    return arena
