"""Files of the maps that a study's runs have learned, as firmware stores them: one file per run."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from cogless.maps.stored_map import write
from cogless.results.runs import AnyResults
from cogless.study.checks import NAME


def write_all(results: AnyResults, folder: Path) -> None:
    """Write folder/SCENARIO/CONTROLLER.bin for each run that has a map."""
    for run in results.runs:
        if run.map is not None:
            path = _file(folder, run.scenario, run.controller)
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path, bytes(run.map))


def remove_all(runs: Iterable[tuple[str, str]], folder: Path) -> None:
    """Remove the files that `write_all` wrote for these runs (scenario, controller), and folders left
    empty."""
    for scenario, controller in runs:
        path = _file(folder, scenario, controller)
        path.unlink(missing_ok=True)
        for place in (path.parent, folder):
            with suppress(OSError):  # not empty, or not there
                place.rmdir()


def _file(folder: Path, scenario: str, controller: str) -> Path:
    return folder / scenario / f"{controller}.bin"


def runs_that_learned(path: Path) -> list[tuple[str, str]]:
    """Pairs (scenario, controller) of the runs in a results.json that learned a map or a trial's signal.

    Empty if the file is missing or can't be read.
    """
    try:
        runs = json.loads(path.read_text(encoding="utf-8"))["runs"]
        names = [(run["scenario"], run["controller"]) for run in runs if run["memory"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [pair for pair in names if all(isinstance(name, str) and NAME.fullmatch(name) for name in pair)]
