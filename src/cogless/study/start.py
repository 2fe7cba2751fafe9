"""What a law that learns over the angle begins with: a map that was learned before, or a table."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from cogless import units
from cogless.study.csv_table import OverAngle, read
from cogless.study.table import FileName, Line, Table, invalid

COLUMNS = {"current": units.CURRENT, "torque": units.TORQUE}
StartFile = Annotated[Line, FileName(), Field(min_length=1)]  # relative to the study


class Start(Table):
    """A stored map, or a table of current or torque over a revolution as CSV."""

    # in the format of control/SPEC.md, as `cogless run` writes and firmware saves
    map: StartFile | None = None
    table: StartFile | None = None
    frame: Literal["mechanical", "electrical"] = "mechanical"  # of the table's angle
    sign: Literal["holding", "cogging"] | None = None  # of the table
    _over_angle: OverAngle | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.map is None) == (self.table is None):
            raise invalid('expected either map = "FILE.bin" or table = "FILE.csv"')
        if self.table is not None and self.sign is None:
            meaning = (
                '"holding" if it holds the rotor against the motor\'s own torque, "cogging" if it is that'
            )
            raise invalid(f"expected {meaning}", "sign", value="missing")
        for key in ("frame", "sign"):
            if self.map is not None and key in self.model_fields_set:
                raise invalid("expected none, since a stored map tells it", key)
        return self

    @model_validator(mode="after")
    def _readable(self, info: ValidationInfo) -> Self:
        if self.table is not None and info.context:
            self._over_angle = read(info.context["folder"] / self.table, COLUMNS, "table")
        return self

    @property
    def over_angle(self) -> OverAngle:
        """The table as read: a current, A, or a torque, N*m."""
        assert self._over_angle is not None
        return self._over_angle
