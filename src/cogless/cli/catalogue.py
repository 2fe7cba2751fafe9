"""`list`: what is shipped."""

from __future__ import annotations


def list_() -> None:
    """List the shipped studies and motors, and the control laws."""
    from cogless.catalogue import show

    show()
