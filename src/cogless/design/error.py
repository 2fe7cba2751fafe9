"""The error of a design: what it needs and did not get, in one line."""

from __future__ import annotations

from cogless.errors import StudyError


class DesignError(StudyError):
    """A design that cannot be made, or a solution that does not hold.

    `key` names the setting that is at fault: `state_weight`, `range.inertia`, `vertex`, ...; "" for none.
    """

    def __init__(self, message: str, key: str = "") -> None:
        super().__init__(message)
        self.key = key
