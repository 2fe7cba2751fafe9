"""A motor of either kind, synchronous or step motor, according to its key `kind`; default: synchronous."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Tag

from cogless.study.motor import Motor
from cogless.study.step_motor import StepMotor


def _kind(data: Any) -> str:
    return str(data.get("kind", "pmsm") if isinstance(data, dict) else getattr(data, "kind", "pmsm"))


AnyMotor = Annotated[Annotated[Motor, Tag("pmsm")] | Annotated[StepMotor, Tag("step")], Discriminator(_kind)]
