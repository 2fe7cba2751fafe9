"""Versions of the software that computes the numbers."""

from __future__ import annotations

import platform
from functools import cache


@cache
def versions() -> dict[str, str]:
    """Versions of cogless, Python and NumPy, which compute the numbers."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        cogless = version("cogless")
    except PackageNotFoundError:
        cogless = "not installed"
    return {"cogless": cogless, "python": platform.python_version(), "numpy": version("numpy")}
