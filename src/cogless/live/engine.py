"""The engine as a WebAssembly module: from the package, or compiled once by ziglang and kept in a cache."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

from cogless.errors import StudyError
from cogless.files import control_sources, package_folders, replacing
from cogless.lines import say
from cogless.live.compile import NAMES, CompileError, cached, compiled

NO_COMPILER = (
    "live: this build has no engine for pages: run `make web`, or pip install 'cogless[web]', with "
    "which `cogless live` compiles the engine"
)


def module(precision: str) -> bytes:
    """The module with control laws in "single" or "double" precision.

    StudyError: the package has no module, and ziglang is not installed or can't compile one.
    """
    for folder in package_folders():
        shipped = folder / "live" / NAMES[precision]
        if shipped.is_file():
            return shipped.read_bytes()
    sources = control_sources().parents[1]
    cached_module = cached(_cache(), sources, precision)
    if not cached_module.is_file():
        if importlib.util.find_spec("ziglang") is None:
            raise StudyError(NO_COMPILER)
        say("live: compiling the engine for pages, once for this version: one to three minutes")
        cached_module.parent.mkdir(parents=True, exist_ok=True)
        with replacing(cached_module) as temporary:
            try:
                compiled(sources, temporary, precision)
            except CompileError as error:
                raise StudyError(f"live: the engine does not compile: {error}") from None
    return cached_module.read_bytes()


def is_there(precision: str) -> bool:
    """Whether the module exists, so that nothing must be compiled."""
    sources = control_sources().parents[1]
    places = [folder / "live" / NAMES[precision] for folder in package_folders()]
    return any(place.is_file() for place in (*places, cached(_cache(), sources, precision)))


def _cache() -> Path:
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "cogless"
