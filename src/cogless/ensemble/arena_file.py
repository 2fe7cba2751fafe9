"""The file of an arena: plants that are taken from studies, and the laws that compete on each plant."""

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
    """Gains of a speed PI, chosen by hand for a plant for which no rule gives them."""

    kp: SpeedGain  # A*s/rad
    ki: SpeedIntegralGain  # A/rad


class ArenaPlant(Table):
    """A plant: a scenario of a study, and what happens in it."""

    study: str  # a shipped one, or a path relative to the arena's file
    scenario: str
    about: Line = ""
    changes: dict[str, Any] = Field(default={})  # study's values by dotted key; the laws know them, too
    reference: Any = None  # replaces the scenario's reference
    feedback: GivenFeedback | None = None  # replaces each law's own; a law without a PI doesn't run
    begin: Duration  # s, from the start until learning begins
    learn: Duration  # s, from `begin` until the load's step
    window: Duration  # s, end of `learn`: ripple, loss and chattering are measured in it
    hold: Duration  # s, from the step to its end, from there to a fault, and from there to the run's end
    load: Torque  # N*m, height of the step
    smooth: Duration  # s, a period of the strongest ripple: the response to the step is averaged over it
    band: AngularSpeedMagnitude  # rad/s, the response has settled when it stays within this
    hour: bool = False  # also run it for an hour
    target: AngularSpeedMagnitude  # rad/s, rms of the speed error below which a law has learned

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
    """A study of trials; its own controllers compete in its scenarios."""

    study: str  # a shipped one, or a path relative to the arena's file
    about: Line = ""
    changes: dict[str, Any] = Field(default={})  # study's values by dotted key

    @field_validator("changes")
    @classmethod
    def _dotted(cls, changes: dict[str, Any]) -> dict[str, Any]:
        return dotted_keys(changes, lambda key, value: isinstance(value, dict))


class Arena(Table):
    """A validated arena. Made by `arena_of`."""

    title: Line
    description: str = ""
    seeds: Many[Annotated[int, Field(ge=0, lt=2**32)]] = (0,)  # give noise and initial angle
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
        """The laws' tables as in the file, with absolute paths of the users' files that they name."""
        return {
            name: {key: self.user_file(value) if key in USERS else value for key, value in table.items()}
            for name, table in self._laws.items()
        }

    def user_file(self, path: str) -> str:
        """A user's file as an absolute path: from the arena's folder, or else from where the command runs."""
        path_here = self._path.parent.resolve() / path
        exists = Path(str(path_here).rpartition(":")[0] or path_here).exists()
        return str(path_here if exists else Path(path).resolve())

    @property
    def bar(self) -> str:
        """Name of the law by which all laws are measured."""
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
