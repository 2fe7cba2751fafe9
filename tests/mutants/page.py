"""The page on which code with marks notes that it runs: COGLESS_HITS, shared with the processes that a test
starts; switch.h is the same for C and C++."""

from __future__ import annotations

import os
from mmap import mmap

from mutants.switched import PAGE


def _opened() -> mmap:
    path = os.environ.get("COGLESS_HITS")
    if path is None:
        return mmap(-1, PAGE)
    with open(path, "r+b") as file:
        return mmap(file.fileno(), PAGE)


page = _opened()
