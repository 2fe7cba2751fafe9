"""All control laws that a speed study can use, including laws for position."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cogless.study.laws.adrc import Adrc
from cogless.study.laws.anti_cogging import AntiCogging
from cogless.study.laws.harmonic import Harmonic
from cogless.study.laws.own import LibraryLaw, PythonLaw
from cogless.study.laws.periodic import PiIlc, RobustIlc
from cogless.study.laws.pi import Pi
from cogless.study.laws.pi_afc import PiAfc
from cogless.study.laws.space import SpacePosition, SpaceSpeed

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
