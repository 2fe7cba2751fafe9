"""Names that a controller gets in C."""

from __future__ import annotations

import re


def identifier(controller: str) -> str:
    """The controller's name as a C name: pi_ilc for "pi-ilc"."""
    name = re.sub(r"[^0-9A-Za-z]+", "_", controller).strip("_")
    begins_well = name[:1].isalpha() and not name.lower().startswith("cgl_")  # that is the library's
    return name if begins_well else f"my_{name}".rstrip("_")


def stem(name: str) -> str:
    """Name of the controller's header and source without suffix.

    The ending _controller avoids clashes: the library has files named like laws, and some build tools put all
    objects into one folder.
    """
    return f"{name}_controller"
