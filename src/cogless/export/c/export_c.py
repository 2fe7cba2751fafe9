"""Write the folder of `cogless export --to c`.

Results of `cogless design` for one controller, as names and texts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cogless.c_layout import Layout, control_layout
from cogless.control_library import C_LAWS, MICROSTEPPING
from cogless.export import sources
from cogless.export.c.coils import microstepping_texts
from cogless.export.c.parts import motion_parts
from cogless.export.c.self_test import awkward
from cogless.export.c.subject import Subject, identifier, study_hash
from cogless.export.c.texts import texts
from cogless.export.prepared import Prepared, Recording, first_scenario, prepare_whole, record
from cogless.files import versions
from cogless.study import AnyStudy


def figures(study: AnyStudy, scenario: str, controller: str) -> tuple[list[tuple[str, str]], list[str]]:
    """Results (name, value with its unit) named and ordered as in `cogless design --json`, and the verdict.

    The verdict: statements on whether learning works; none for a law that learns nothing.
    """
    from cogless.design.kinds import DESIGNS

    table, verdict = DESIGNS[study.kind].figures(study, scenario, controller)
    return list(_flat(table)), verdict


def _flat(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield (dotted name, text) for each value of nested tables, without empty ones (null, empty list)."""
    for key, value in table.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict) and value.keys() >= {"value", "unit"}:
            note = f" ({value['note']})" if "note" in value else ""
            yield name, f"{_value_text(value['value'])} {value['unit']}".rstrip() + note
        elif isinstance(value, dict):
            yield from _flat(value, f"{name}.")
        elif value is not None and value != [] and value != "":
            yield name, _value_text(value)


def _value_text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        return ", ".join(_value_text(item) for item in value)
    return " ".join(str(value).split()).replace("*/", "* /")


# Length of the self-test: TEST_TICKS current-loop periods, or LAW_STEPS periods of the law if these are
# longer, so that the law does something; at most MOST_TICKS periods, which fit a microcontroller's flash.
TEST_TICKS, LAW_STEPS, MOST_TICKS = 400, 80, 2000


def export_c(
    study: AnyStudy,
    controller: str,
    target: Path,
    scenario: str | None = None,
    command: str = "",
    announce: Callable[[str], None] = lambda _: None,
) -> Subject:
    """Write a controller as C, completely or not at all, and return the data of the export.

    `scenario`: scenario in which the self-test is recorded; default: the first that has the controller.
    `command`: the command line that made the export, for its README. `announce` is called with a text on the
    size of the files before they are written, if there is a learning matrix. StudyError: the export can't be
    made or written.
    """
    sources.check(target)
    prepared = prepare_whole(study, first_scenario(study, controller, scenario), controller)
    subject = subject_of(prepared, command)
    recording = record(prepared, self_test_ticks(subject, prepared))
    manifest = {
        "study": study.name,
        "sha256": study_hash(study),
        "scenario": subject.scenario,
        "controller": controller,
        "law": subject.law.name,
        "version": versions()["cogless"],
    }
    written = contents(subject, prepared, recording)
    if subject.learning_matrix is not None:
        announce(sources.size(written, subject.learning_matrix.nbytes))
    sources.write(target, written, manifest)
    return subject


def self_test_ticks(subject: Subject, prepared: Prepared) -> int:
    """Number of current-loop periods that the self-test repeats."""
    return min(max(TEST_TICKS, LAW_STEPS * subject.divider), MOST_TICKS, prepared.ticks)


def subject_of(prepared: Prepared, command: str = "") -> Subject:
    """Collect the data for the exported files: study, gains, layout of the C structs, verdict."""
    drive, controller = prepared.description["drive"], prepared.description["controller"]
    law, matrix = C_LAWS.get(controller["law"], MICROSTEPPING), controller.get("learning_matrix")
    assert prepared.study.drive is not None
    layout = control_layout(prepared.study.drive.precision)
    stored = prepared.drive.stored(prepared.start())
    numbers, verdict = figures(prepared.study, prepared.scenario, prepared.controller)
    return Subject(
        study=prepared.study,
        scenario=prepared.scenario,
        controller=prepared.controller,
        name=identifier(prepared.controller),
        law=law,
        layout=layout,
        drive_config=layout.decode("cgl_drive_config", drive["control"]),
        law_config=layout.decode(law.config, controller["config"]),
        dead_time_config=_part(layout, drive, "dead_time"),
        current_reference_config=_part(layout, drive, "current_reference"),
        encoder_table_config=_part(layout, drive, "encoder_table"),
        rate=round(prepared.rate),
        memory_length=len(prepared.memory),
        map=None if stored is None else np.shape(stored["values"]),
        learning_matrix=None if matrix is None else np.asarray(matrix, prepared.memory.dtype).ravel(),
        figures=numbers,
        verdict=verdict,
        command=command,
    )


def _part(layout: Layout, drive: dict[str, Any], name: str) -> dict[str, Any] | None:
    """The decoded configuration of an optional part of the drive; None if the drive lacks this part."""
    return layout.decode(f"cgl_{name}_config", drive[name]) if name in drive else None


def contents(subject: Subject, prepared: Prepared, recording: Recording) -> dict[str, bytes]:
    """Contents of the exported files, by their path in the folder."""
    if not subject.has_drive:
        written = microstepping_texts(subject, prepared, recording)
        return sources.with_library(written, sources.closure(subject.parts))
    motion = recording.begun[0][1] if recording.begun else None
    stretches = awkward(subject, prepared, motion)
    written = texts(subject, recording, prepared.memory, stretches)
    parts = [*subject.parts, *motion_parts(subject)]
    names = {*sources.closure(parts), *(sources.store() if subject.map else ())}
    return sources.with_library(written, names - subject.unused)
