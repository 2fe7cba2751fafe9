"""Keys of the law "PI" in a study."""

from __future__ import annotations

from typing import Any, Literal

from cogless.study.laws.law import Feedback, LawLoop


class Pi(Feedback):
    """Proportional-integral speed control."""

    law: Literal["pi"]
    """PI speed control."""

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        return self.pi_config(loop)
