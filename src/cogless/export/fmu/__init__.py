"""Functional mock-up units of a study: the controller, and the whole drive, for FMI 2.0 and FMI 3.0."""

from __future__ import annotations

import tempfile
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from cogless.export.fmu import xml
from cogless.export.fmu.build import COMPILERS, OPTIONS, binary, compiler, link, objects, pack
from cogless.export.fmu.controller import controller_unit
from cogless.export.fmu.cpp import variables_c
from cogless.export.fmu.drive import drive_unit
from cogless.export.fmu.unit import Unit, asset, texts
from cogless.export.prepared import first_scenario, prepare
from cogless.export.sources import licence
from cogless.files import versions, writable
from cogless.study import AnyStudy

HERE = Path(__file__).parents[1]
SHARED = ("fmu.h", "fmu.c")
VERSIONS = (2, 3)


def write_fmus(study: AnyStudy, controller: str, scenario: str | None, folder: Path) -> list[Path]:
    """Write CONTROLLER-controller and CONTROLLER-drive, each for FMI 2.0 and 3.0, into `folder`.

    Where a bus is between law and drive, the drive alone: a controller is law and current loop in one.
    `scenario`: the one that the drive simulates, default the first that has the controller. StudyError: an
    unknown name, a law without a C form, no compiler.
    """
    run = prepare(study, first_scenario(study, controller, scenario), controller)
    for language in COMPILERS:
        compiler(language)
    with writable(folder):
        units = [drive_unit(run)] if run.has_bus else [controller_unit(run), drive_unit(run)]
        contents = [made for unit in units for made in _fmus(unit)]
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
                about=unit.about,
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
    """Write these sources and compile them; by name of the source, the path of its object file."""
    for name, text in texts.items():
        target = place / "sources" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
    names = [name for name in texts if name.endswith((".c", ".cpp"))]
    made = objects([place / "sources" / name for name in names], place / "objects")
    return dict(zip(names, made, strict=True))


def _contents(version: int, built: _Built) -> dict[str, bytes]:
    """The files of an FMU, by their path in it."""
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
    """Sources of one version of the standard: its functions and its headers."""
    name = f"fmi{version}.c"
    return texts((HERE / "fmi").glob(f"fmi{version}*.h")) | {name: asset(name)}
