"""Compile and link an FMU's sources with the user's compiler, and pack the FMU."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from cogless.errors import StudyError
from cogless.files import replacing

# The same options as for the simulator, so that numbers are rounded in the same way.
OPTIONS = ("-O2", "-fno-tree-vectorize", "-ffp-contract=off")
COMPILERS = {"C": ("CC", ("cc", "gcc", "clang")), "C++": ("CXX", ("c++", "g++", "clang++"))}
STANDARDS = {"C": "-std=c99", "C++": "-std=c++20"}
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # so that equal FMUs are equal files


def compiler(language: str) -> list[str]:
    """The command of a compiler for "C" or "C++"; StudyError if there is none."""
    variable, names = COMPILERS[language]
    chosen = shlex.split(os.environ.get(variable, ""))
    for command in [chosen] if chosen else [[name] for name in names]:
        if shutil.which(command[0]):
            return command
    expected = f"{variable}={chosen[0]}" if chosen else f"{', '.join(names)}, or {variable} set,"
    raise StudyError(f"export --to fmu: no {language} compiler: expected {expected} on the PATH")


def objects(sources: Iterable[Path], folder: Path) -> list[Path]:
    """Compile each source once, into `folder`, and return the object files.

    StudyError: the first error of the compiler.
    """
    folder.mkdir(parents=True, exist_ok=True)
    jobs = []
    for source in sources:
        language = "C" if source.suffix == ".c" else "C++"
        target = folder / f"{source.stem}{source.suffix[1:]}.o"
        flags = [STANDARDS[language], *OPTIONS, "-fPIC", "-fvisibility=hidden", "-c", "-o", str(target)]
        jobs.append(([*compiler(language), *flags, str(source)], target))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for done, (command, _) in zip(pool.map(_run, (command for command, _ in jobs)), jobs, strict=True):
            if done.returncode != 0:
                raise _failed(command[-1], done)
    return [target for _, target in jobs]


def link(parts: Sequence[Path], library: Path, language: str) -> None:
    """Link objects to a shared library that exports only the functions of the FMI standard.

    The C++ runtime is linked statically if possible, since the program that loads the FMU may have an older
    one.
    """
    library.parent.mkdir(parents=True, exist_ok=True)
    command = [*compiler(language), "-shared", "-o", str(library), *map(str, parts)]
    inside: list[str] = []
    if sys.platform == "linux":
        exports = library.with_suffix(".map")
        exports.write_text("{ global: fmi2*; fmi3*; local: *; };\n", encoding="utf-8")
        command += [f"-Wl,--version-script={exports}", "-ldl", "-lm"]
        inside = ["-static-libgcc", "-static-libstdc++"] if language == "C++" else []
    done = _run([*command, *inside])
    if done.returncode != 0 and inside:
        done = _run(command)
    if done.returncode != 0:
        raise _failed(library.name, done)


def binary(version: int, identifier: str) -> str:
    """Path of the binary for this platform within an FMU."""
    system = {"linux": ("linux64", "linux", "so"), "darwin": ("darwin64", "darwin", "dylib")}
    if sys.platform not in system:
        raise StudyError(f"export --to fmu: {sys.platform}: expected Linux or macOS")
    folder2, name, ending = system[sys.platform]
    machine = {"arm64": "aarch64", "amd64": "x86_64"}.get(platform.machine(), platform.machine())
    return f"binaries/{folder2 if version == 2 else f'{machine}-{name}'}/{identifier}.{ending}"


def pack(path: Path, contents: Mapping[str, bytes]) -> None:
    """Write an FMU, a ZIP archive, completely or not at all."""
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as fmu:
        for name in sorted(contents):
            entry = zipfile.ZipInfo(name, LONG_AGO)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            fmu.writestr(entry, contents[name])


def _run(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _failed(what: str, done: subprocess.CompletedProcess[str]) -> StudyError:
    lines = done.stderr.strip().splitlines() or [f"exit {done.returncode}"]
    worst = next((line for line in lines if "error" in line), lines[0])
    return StudyError(f"export --to fmu: {Path(what).name} does not compile: {worst}")
