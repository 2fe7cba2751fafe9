"""The error of a design: what it needs and did not get, in one line."""

from __future__ import annotations

from cogless.errors import StudyError


class DesignError(StudyError):
    """A design that cannot be made, or a solution that does not hold; begins with its `key` and a colon."""

    @property
    def key(self) -> str:
        """The setting that is at fault: `state_weight`, `range.inertia`, `vertex`, ..."""
        return str(self).partition(":")[0]
