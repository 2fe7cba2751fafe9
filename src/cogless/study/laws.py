"""Every law that a study of speed or of a path can have, and what each records."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cogless.study.controller import AntiCogging, LibraryLaw, Pi, PiIlc, PythonLaw, RobustIlc
from cogless.study.space_controller import SPACE_TERMS, SpacePosition, SpaceSpeed

AnyController = Pi | PiIlc | RobustIlc | AntiCogging | SpacePosition | SpaceSpeed | PythonLaw | LibraryLaw
Controller = Annotated[AnyController, Field(discriminator="law")]

# What each law records besides the drive's own signals, in A.
_PI_TERMS = ("term_proportional", "term_integral")
TERMS: dict[str, tuple[str, ...]] = {
    "pi": _PI_TERMS,
    "pi-ilc": (*_PI_TERMS, "term_ilc"),
    "robust-ilc": ("term_surface", "term_switching", "term_linear", "term_f_hat", "term_r_hat"),
    "anti-cogging": (*_PI_TERMS, "term_table"),
    "python": (),
    "library": (),
    **SPACE_TERMS,
}
