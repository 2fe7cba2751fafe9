"""Load what a law begins with: a map that was learned before, or a table of current or torque."""

from __future__ import annotations

from typing import Any

import numpy as np

from cogless.errors import StudyError
from cogless.maps import start, stored_map
from cogless.maps.stored_map import CURRENT, MapError, StoredMap
from cogless.study import Study
from cogless.study.controller import Startable
from cogless.study.start import Start


def starting_map(study: Study, controller: str, law: Startable, drive: Any) -> start.Reals:
    """The entries of a law's map at the start of a run, (channels, cells).

    `drive`: the engine's, with this law. StudyError: the file is no map, or nothing that fits the law.
    """
    given = law.start
    assert given is not None
    key, name = ("table", given.table) if given.map is None else ("map", given.map)
    where = f'{study.source.path}: controller.{controller}.start.{key}: "{name}": '
    own = drive.stored(drive.start())
    if own is None:
        raise StudyError(f"{where}expected none, since the memory is over time")
    try:
        found = _of_table(study, given) if given.map is None else _newest(study, given.map)
        return start.entries(found, own, law.unit)
    except MapError as error:
        raise StudyError(f"{where}{error}") from None


def _newest(study: Study, name: str) -> StoredMap:
    path = study.source.path.parent / name
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
