"""Files of the maps that a study's runs have learned, as firmware stores them: one file per run."""

from __future__ import annotations

from pathlib import Path

from cogless.maps.stored_map import write_map
from cogless.results.runs import AnyResults


def name(scenario: str, controller: str) -> str:
    """The file of a run's map, within the folder of maps."""
    return f"{scenario}/{controller}.bin"


def write_all(results: AnyResults, folder: Path) -> None:
    """Write folder/SCENARIO/CONTROLLER.bin for each run that has a map."""
    for run in results.runs:
        if run.map is not None:
            path = folder / name(run.scenario, run.controller)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_map(path, bytes(run.map))
