"""Files of the maps that a study's runs have learned, as firmware stores them: one file per run."""

from __future__ import annotations

from pathlib import Path

from cogless.maps.stored_map import write
from cogless.results.runs import AnyResults


def write_all(results: AnyResults, folder: Path) -> None:
    """Write folder/SCENARIO/CONTROLLER.bin for each run that has a map."""
    for run in results.runs:
        if run.map is not None:
            path = folder / run.scenario / f"{run.controller}.bin"
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path, bytes(run.map))
