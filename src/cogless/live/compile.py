"""Compile the engine and the control laws to WebAssembly: `python compile.py SOURCES FOLDER [CACHE]`.

SOURCES contains control/src and simulator. A module that CACHE holds for the same sources is not compiled
again. The file needs only the standard library and ziglang, so the build of a wheel can run it, too.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

# The engine's sources that a page needs. drive.cpp and plant_steps.cpp include all of the plant.
ENGINE = ("web.cpp", "config.cpp", "trial_config.cpp", "linear_trials.cpp", "drive.cpp", "plant_steps.cpp")
# The native module is also compiled without contraction, so both round numbers in the same way. All browsers
# have these features since 2021. They save a fifth of the time: a double becomes an integer without checks.
FEATURES = ("-mbulk-memory", "-mnontrapping-fptoint", "-msign-ext")
FLAGS = ("-target", "wasm32-wasi", "-O2", "-ffp-contract=off", "-fno-sanitize=all", *FEATURES)
NAMES = {"single": "engine_single.wasm", "double": "engine_double.wasm"}


class CompileError(Exception):
    """The compiler's first error."""


def compiled(sources: Path, target: Path, precision: str) -> None:
    """Write the module with control laws in "single" or "double" precision.

    CompileError: the sources don't compile.
    """
    library, simulator = sources / "control" / "src", sources / "simulator"
    defines = ["-DCOGLESS_DOUBLE"] if precision == "double" else []
    common = [*FLAGS, *defines, f"-I{library}", f"-I{simulator}"]
    c = ["cc", *common, "-std=c99"]
    # an exception only has to reach the host; web.cpp defines the functions that a throw calls
    cpp = ["c++", *common, "-fexceptions", "-std=c++20"]
    jobs = [(c, path) for path in sorted((library / "cogless").glob("*.c"))]
    jobs = [(cpp, simulator / name) for name in ENGINE] + jobs
    with tempfile.TemporaryDirectory() as temporary, ThreadPoolExecutor(os.cpu_count()) as pool:
        objects = [str(Path(temporary) / f"{path.name}.o") for _, path in jobs]
        commands = [[*how, "-c", str(path), "-o", at] for (how, path), at in zip(jobs, objects, strict=True)]
        list(pool.map(_zig, commands))
        linked = Path(temporary) / "engine.wasm"
        _zig([*cpp, "-mexec-model=reactor", "-s", "-Wl,--gc-sections", *objects, "-o", str(linked)])
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(linked.read_bytes())


def _zig(arguments: list[str]) -> None:
    command = [sys.executable, "-m", "ziglang", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = done.stderr.splitlines() or [f"exit {done.returncode}"]
        raise CompileError(next((line for line in lines if "error" in line), lines[0]))


def cached(cache: Path, sources: Path, precision: str) -> Path:
    """The path in a cache of the module that these sources and options give. The file may not exist yet."""
    digest = hashlib.sha256(" ".join(FLAGS).encode())
    for path in _files(sources):
        digest.update(path.relative_to(sources).as_posix().encode() + b"\0" + path.read_bytes())
    return cache / f"{digest.hexdigest()[:16]}-{NAMES[precision]}"


def _files(sources: Path) -> Iterator[Path]:
    for folder in ("control/src", "simulator"):
        yield from sorted(path for path in (sources / folder).rglob("*") if path.is_file())


def main(sources: Path, folder: Path, cache: Path | None = None) -> None:
    """Write the modules of both precisions into a folder, and missing ones into the cache."""
    for precision, name in NAMES.items():
        module = cached(cache, sources, precision) if cache else folder / name
        if not (cache and module.is_file()):
            unfinished = module.with_suffix(f".{os.getpid()}")
            compiled(sources, unfinished, precision)
            unfinished.replace(module)
        if cache:
            shutil.copyfile(module, folder / name)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
