"""Load what a law begins with: a map that was learned before, or a table of current or torque."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from cogless.errors import StudyError
from cogless.maps import learned_map, stored_map
from cogless.maps.stored_map import CURRENT, MapError, StoredMap
from cogless.run.own_law import describe, is_failure, law_file
from cogless.study import Study
from cogless.study.controller import OwnLaw, Startable
from cogless.study.start import Start


def starting_map(study: Study, controller: str, law: Startable, drive: Any) -> learned_map.Reals:
    """The entries of a law's map at the start of a run, (channels, cells).

    `drive`: the engine's, with this law. StudyError: the file is no map, or nothing that fits the law, or
    that a user's law takes.
    """
    given = law.start
    assert given is not None
    key, name = ("table", given.table) if given.map is None else ("map", given.map)
    where = f'{study.source.path}: controller.{controller}.start.{key}: "{name}": '
    try:
        with _law_failures(study, controller, where):
            state = drive.start()
            own = drive.stored(state)
        if own is None:
            needs = law.NEEDS if isinstance(law, OwnLaw) else "none, since the memory is over time"
            raise MapError(f"expected {needs}")
        found = _of_table(study, given) if given.map is None else _newest(study, given.map)
        entries = learned_map.entries(found, own, law.unit)
        if isinstance(law, OwnLaw):
            with _law_failures(study, controller, where):
                drive.load_map(state, entries)  # it may refuse it: before the first run
        return entries
    except MapError as error:
        raise StudyError(f"{where}{error}") from None


@contextmanager
def _law_failures(study: Study, controller: str, where: str) -> Iterator[None]:
    """Turn any exception of a user's law into a StudyError that begins with `where`."""
    try:
        yield
    except BaseException as error:
        if not isinstance(study.controller[controller], OwnLaw) or not is_failure(error):
            raise
        raise StudyError(f"{where}{describe(error, law_file(study, controller))}") from error


def _newest(study: Study, name: str) -> StoredMap:
    path = study.source.folder / name
    if not path.is_file():
        raise MapError(f"expected a file at {path}")
    found = stored_map.read(path)
    newest = stored_map.newest(found)
    if newest is None:
        raise MapError(str(found[0].map))
    return newest.map


def _of_table(study: Study, given: Start) -> StoredMap:
    """The table as the map of a current over its revolution."""
    table = given.over_angle
    cells, parts = len(table.angle), study.motor.pole_pairs if given.frame == "electrical" else 1
    amplitude, phase = np.transpose(table.harmonics((cells - 1) // 2))
    spectrum = amplitude / 2 * np.exp(1j * (phase - np.pi / 2))
    spectrum[0] *= 2
    current = np.fft.irfft(spectrum, cells) * cells
    if table.name == "torque":
        current /= study.K_t
    if given.sign == "cogging":
        current = -current
    return StoredMap(current.astype(np.float32), (CURRENT,), (float(np.max(np.abs(current))),), parts=parts)
