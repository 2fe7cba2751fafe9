"""The exception of a design; its message says in one line which input was expected."""

from __future__ import annotations

from cogless.errors import StudyError


class DesignError(StudyError):
    """A design can't be made, or its solution fails the check. The message begins with `key` and a colon."""

    @property
    def key(self) -> str:
        """The name of the setting at fault, such as `state_weight`, `range.inertia` or `vertex`."""
        return str(self).partition(":")[0]
