"""All control laws that a speed study can use, including laws for position."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cogless.study.adrc import Adrc
from cogless.study.controller import AntiCogging, LibraryLaw, Pi, PiIlc, PythonLaw, RobustIlc
from cogless.study.harmonic import Harmonic
from cogless.study.pi_afc import PiAfc
from cogless.study.space_controller import SpacePosition, SpaceSpeed

AnyController = (
    Pi
    | Adrc
    | PiIlc
    | PiAfc
    | Harmonic
    | RobustIlc
    | AntiCogging
    | SpacePosition
    | SpaceSpeed
    | PythonLaw
    | LibraryLaw
)
Controller = Annotated[AnyController, Field(discriminator="law")]
