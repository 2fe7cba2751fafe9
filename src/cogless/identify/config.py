"""The file of columns: it describes the columns and kinds of a drive's logs, the motor and the drive."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, ValidationError, ValidationInfo, field_validator, model_validator

from cogless import units
from cogless.study.drive import Drive
from cogless.study.laws import Controller
from cogless.study.messages import problems, study_error
from cogless.study.motor import Motor
from cogless.study.position_sensor import Counted
from cogless.study.reading import read, with_datasheet
from cogless.study.reference import Reference
from cogless.study.table import Angle, Line, Many, Table, invalid, one_of
from cogless.units import Dimension

Kind = Literal[
    "hold",  # current that holds the rotor at each angle, at rest
    "slow-sweep",
    "constant-speed",
    "acceleration",
    "coast-down",
    "load",  # a load that is constant within the log, and not known
    "bridge-off",  # the motor carries no current; the phase currents show the offsets of their sensors
    "table-on",  # an anti-cogging table is on; i_q includes the table's current
]
COUNT = "count"  # a unit of the angle: a count of the position sensor
SIGNALS: dict[str, Dimension] = {
    "t": units.TIME,
    "theta": units.ANGLE,
    "omega": units.ANGULAR_SPEED,
    "i_q": units.CURRENT,
    "i_q_ref": units.CURRENT,
    "i_d": units.CURRENT,
    "i_a": units.CURRENT,
    "i_b": units.CURRENT,
    "i_c": units.CURRENT,
    "u_q": units.VOLTAGE,
    "torque": units.TORQUE,
    "direction": units.NONE,
    "part": units.NONE,  # each of its values is a log of its own, named FILE#VALUE
}


def _unit_factor(unit: str, dimension: Dimension) -> float:
    """Factor to SI from a unit, or from a number with a unit such as "125 us". UnitError: neither of them."""
    number_and_unit = units.NUMBER_AND_UNIT.fullmatch(unit)
    if number_and_unit is None or number_and_unit[2].startswith("/"):  # "1/s" is a unit
        return units.factor(unit, dimension)
    factor = units.parse(unit, dimension)
    if not 0 < factor < math.inf:
        raise units.UnitError(f'expected a unit, or a number above 0 with a unit, not "{unit}"')
    return factor


class Column(Table):
    """A column of the logs: heading, the files that have it (default: all), unit (default: SI), -1 as `sign`
    where it counts backwards, and a factor."""

    name: str = Field(examples=['"time"'])
    files: Many[str] = ("*",)  # * and ? stand for any letters
    unit: str = ""
    sign: Literal[1, -1] = 1
    scale: Annotated[float, Field(gt=0)] = 1.0  # such as sqrt(2) of rms amperes
    mean: bool = False  # of i_q: each value is the mean since the row before

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        if isinstance(data, str):
            return {"name": data}
        if isinstance(data, Mapping) and isinstance(data.get("files"), str):
            return {**data, "files": [data["files"]]}
        return data

    def is_in(self, file: str) -> bool:
        """Whether a file of this name has the column."""
        return any(fnmatchcase(file, pattern) for pattern in self.files)


class LogRule(Table):
    """What is known of the files whose names match."""

    file: str  # * and ? stand for any letters
    kind: Kind | None = None
    session: Line | None = None  # of one warm-up, or of one day
    reference: Reference | None = None  # of the controller in the log
    controller: str | None = None  # one of the file's


COLUMNS_REPLAY_RULE = "a table [[log]] in the --config file that names its reference and controller"


class Identification(Table):
    """What a drive's logs hold. Motor, drive and controllers are described as in a study."""

    title: Line = "A motor from its drive's logs"
    columns: Mapping[str, Column]
    motor: Motor
    drive: Drive
    controller: Mapping[str, Controller] = {}
    log: Many[LogRule] = ()
    angle_offset: Angle | None = None  # rad, added to theta; default: half a count, since counts round down
    _path: Path = PrivateAttr(default=Path())
    _described_in: str = PrivateAttr(default="")
    _replay_rule: str = PrivateAttr(default=COLUMNS_REPLAY_RULE)
    _tables: dict[str, Any] = PrivateAttr(default_factory=dict)

    @property
    def described_in(self) -> str:
        """The name that messages give to what describes the motor and the drive."""
        return self._described_in or self._path.name

    @property
    def replay_rule(self) -> str:
        """The condition on which a log can be replayed, for messages."""
        return self._replay_rule

    @field_validator("columns")
    @classmethod
    def _check_columns(cls, columns: Mapping[str, Column]) -> Mapping[str, Column]:
        for key, column in columns.items():
            if key not in SIGNALS:
                raise invalid(one_of(SIGNALS), key)
            if column.unit in ("", COUNT if key == "theta" else ""):
                continue
            try:
                _unit_factor(column.unit, SIGNALS[key])
            except units.UnitError as error:
                raise invalid(str(error), key, "unit") from None
        if "t" not in columns and "theta" not in columns:
            raise invalid('expected the headings of the columns, such as t = "time_s"')
        return columns

    @field_validator("controller")
    @classmethod
    def _of_the_library(
        cls, controller: Mapping[str, Controller], info: ValidationInfo
    ) -> Mapping[str, Controller]:
        for name, law in controller.items():
            if law.code is not None and name not in (info.context or {}).get("laws", ()):
                raise invalid(
                    "expected a law of cogless, not code of your own, since each log is simulated many times",
                    name,
                    "law",
                )
        return controller

    @model_validator(mode="after")
    def _counted(self) -> Identification:
        column = self.columns.get("theta")
        if column is not None and column.unit == COUNT and not self.counts:
            raise invalid("expected a drive.position_sensor with counts", "columns", "theta", "unit")
        if self.drive.current_reference is not None:
            raise invalid(
                "expected no such key, since the torque is taken from i_q alone: delete current_reference",
                "drive",
                "current_reference",
            )
        for index, rule in enumerate(self.log):
            if rule.controller is not None and rule.controller not in self.controller:
                raise invalid(one_of(self.controller), "log", index, "controller")
        return self

    @property
    def counts(self) -> int:
        """Counts of the position sensor per revolution; 0: no steps are known."""
        sensor = self.drive.position_sensor
        return sensor.counts if isinstance(sensor, Counted) else 0

    @property
    def step(self) -> float:
        """Smallest step of the measured angle, rad; 0: none is known."""
        return SIGNALS_TURN / self.counts if self.counts else 0.0

    def tells_error(self, order: int) -> bool:
        """Whether the file says that the position sensor has an error of this order."""
        sensor = self.drive.position_sensor
        return isinstance(sensor, Counted) and (
            sensor.error_table is not None or any(part["order"] == order for part in sensor.orders)
        )

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self._path

    @property
    def tables(self) -> dict[str, Any]:
        """The file's tables as read, with texts of units, the datasheet merged in."""
        return self._tables

    def factor(self, signal: str) -> float:
        """The factor that converts a number of this signal's column to SI."""
        column = self.columns[signal]
        factor = column.sign * column.scale
        if column.unit == COUNT:
            return factor * self.step
        return factor * (_unit_factor(column.unit, SIGNALS[signal]) if column.unit else 1.0)

    def rule(self, file: str) -> LogRule:
        """The first rule that matches the name of a file, or an empty rule."""
        return next((rule for rule in self.log if fnmatchcase(file, rule.file)), LogRule(file="*"))


SIGNALS_TURN = 6.283185307179586  # rad


def load(path: Path) -> Identification:
    """Read the file. StudyError lists its mistakes, one per line."""
    return from_tables(path, read(path))


def from_tables(
    path: Path,
    tables: dict[str, Any],
    laws: Collection[str] = (),
    described_in: str = "",
    replay_rule: str = "",
) -> Identification:
    """The tables of a file of columns, validated. `path`: the file of the tables, which a StudyError names.

    `laws`: controllers that may be laws in Python; any other is refused, since its code would run without
    the user's knowledge. `described_in`, `replay_rule`: for messages, as in the properties of these names.
    """
    source = with_datasheet(path, tables)
    try:
        context = {"folder": path.parent, "checks": (), "laws": laws}
        identification = Identification.model_validate(source.tables, context=context)
    except ValidationError as error:
        raise study_error([problem.line(path) for problem in problems(error, source.tables)]) from None
    identification._path, identification._tables = path, source.tables
    identification._described_in = described_in
    identification._replay_rule = replay_rule or identification._replay_rule
    return identification
