"""Functional mock-up units of a study: the controller, and the whole drive, for FMI 2.0 and FMI 3.0.

Compile and link an FMU's sources with the user's compiler, and pack the FMU.
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from cogless.errors import StudyError
from cogless.export.fmu import xml
from cogless.export.fmu.fmus import controller_unit, drive_unit
from cogless.export.fmu.variables import Unit, asset, texts, variables_c
from cogless.export.prepared import first_scenario, prepare
from cogless.export.sources import licence
from cogless.files import replacing, versions, writable
from cogless.study import AnyStudy

# The same options as for the simulator, so that numbers are rounded in the same way.
OPTIONS = ("-O2", "-fno-tree-vectorize", "-ffp-contract=off")
LANGUAGE_COMPILERS = {"C": ("CC", ("cc", "gcc", "clang")), "C++": ("CXX", ("c++", "g++", "clang++"))}
STANDARDS = {"C": "-std=c99", "C++": "-std=c++20"}
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # date of all files in an FMU, so that equal FMUs are equal files


def compiler(language: str) -> list[str]:
    """The command that starts a compiler for "C" or "C++", as words; StudyError if there is none."""
    variable, names = LANGUAGE_COMPILERS[language]
    chosen = shlex.split(os.environ.get(variable, ""))
    for command in [chosen] if chosen else [[name] for name in names]:
        if shutil.which(command[0]):
            return command
    expected = f"{', '.join(names)} on the PATH, or {variable} set"
    if chosen:
        expected = f"{variable}={chosen[0]} on the PATH"
    raise StudyError(f"export --to fmu: no {language} compiler: expected {expected}")


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


HERE = Path(__file__).parents[1]
SHARED = ("fmu.h", "fmu.c")
VERSIONS = (2, 3)


def write_fmus(study: AnyStudy, controller: str, scenario: str | None, folder: Path) -> list[Path]:
    """Write CONTROLLER-controller and CONTROLLER-drive, each for FMI 2.0 and 3.0, into `folder`.

    If a bus is between law and drive, only the drive is written, since the FMU of a controller is law and
    current loop in one. `scenario`: scenario that the drive simulates; default: the first that has the
    controller. Returns the paths. StudyError: an unknown name, a law without a C form, no compiler.
    """
    where = first_scenario(study, controller, scenario)
    if (law := study.controller[controller]).NO_DRIVE:
        raise StudyError(
            f'{study.source.path}: controller.{controller}.law: "{law.law}": has no drive around it: '
            "expected a law of a drive; `cogless export --to c` writes the law alone"
        )
    run = prepare(study, where, controller)
    for language in LANGUAGE_COMPILERS:
        compiler(language)
    with writable(folder):
        units = [drive_unit(run)] if run.has_bus else [controller_unit(run), drive_unit(run)]
        contents = [content for unit in units for content in _fmus(unit)]
        for name, files in contents:
            pack(folder / name, files)
    return [folder / name for name, _ in contents]


@dataclass(frozen=True)
class _Built:
    description: xml.Description
    sources: Mapping[str, str]  # name in sources/ -> text
    library: bytes


def _fmus(unit: Unit) -> Iterator[tuple[str, dict[str, bytes]]]:
    """Yield name and files of a unit's two FMUs. Code that both FMI versions share is compiled once."""
    token = str(uuid.uuid5(uuid.NAMESPACE_URL, repr((sorted(unit.sources.items()), unit.variables))))
    shared = dict(unit.sources) | {name: asset(name) for name in SHARED}
    shared["variables.c"] = variables_c(unit.variables, token, unit.rate)
    sources = {version: shared | _adapter(version) for version in VERSIONS}
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        compiled = _compiled(dict(pair for texts in sources.values() for pair in texts.items()), place)
        for version in VERSIONS:
            listed = sorted(compiled.keys() & sources[version].keys())
            library = place / binary(version, unit.identifier)
            link([compiled[name] for name in listed], library, unit.language)
            description = xml.Description(
                identifier=unit.identifier,
                name=unit.name,
                summary=unit.description,
                tool=f"cogless {versions()['cogless']}",
                token=token,
                rate=unit.rate,
                stop_time=unit.stop_time,
                variables=unit.variables,
                sources=listed,
            )
            built = _Built(description, sources[version], library.read_bytes())
            yield f"{unit.name}-fmi{version}.fmu", _contents(version, built)


def _compiled(texts: Mapping[str, str], place: Path) -> dict[str, Path]:
    """Write these sources and compile them; returns {name of the source: path of the object file}."""
    for name, text in texts.items():
        target = place / "sources" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
    names = [name for name in texts if name.endswith((".c", ".cpp"))]
    object_files = objects([place / "sources" / name for name in names], place / "objects")
    return dict(zip(names, object_files, strict=True))


def _contents(version: int, built: _Built) -> dict[str, bytes]:
    """The files of an FMU: {path in the FMU: contents}."""
    description = built.description
    contents = {f"sources/{name}": text.encode() for name, text in built.sources.items()}
    contents[binary(version, description.identifier)] = built.library
    contents["documentation/licenses/cogless.txt"] = licence().read_bytes()
    contents["documentation/licenses/fmi.txt"] = (HERE / "fmi" / "LICENSE").read_bytes()
    if version == 2:
        contents["modelDescription.xml"] = xml.fmi2(description)
    else:
        contents["modelDescription.xml"] = xml.fmi3(description)
        contents["sources/buildDescription.xml"] = xml.build3(description, " ".join(OPTIONS))
    return contents


def _adapter(version: int) -> dict[str, str]:
    """Sources for one version of FMI: the C file with its functions, and the standard's headers."""
    name = f"fmi{version}.c"
    return texts((HERE / "fmi").glob(f"fmi{version}*.h")) | {name: asset(name)}
