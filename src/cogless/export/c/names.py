"""Names of a controller in C."""

from __future__ import annotations

import re


def identifier(controller: str) -> str:
    """The controller's name as a C name: pi_ilc for "pi-ilc"."""
    name = re.sub(r"[^0-9A-Za-z]+", "_", controller).strip("_")
    begins_well = name[:1].isalpha() and not name.lower().startswith("cgl_")  # those are the library's
    return name if begins_well else f"my_{name}".rstrip("_")


def stem(name: str) -> str:
    """File name of the controller's two files, without ending.

    The library has files that are called like laws, and some build tools put all objects into one folder.
    """
    return f"{name}_controller"
