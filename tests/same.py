"""Keeps the outputs of cogless for its studies and examples, and shows which of them a change alters.

    make keep    before the change: writes them into build/same/kept
    make same    after it: writes them again, and fails where a byte differs

Outputs are results.json, hashes of the traces, the report, `design`, exports in C, the page and all help.
Each value of each study is also replaced by wrong ones, and the line that refuses it is kept.
Versions and the names of runs are left out.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import hashlib
import io
import json
import multiprocessing
import os
import re
import shutil
import sys
import tomllib
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any
from unittest import mock

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "build" / "same"
WORK = FOLDER / "work"  # what commands write; its path stands in their output
COLUMNS = 80
LINES_SHOWN = 6  # of each file that differs
WRONG_VALUES = (-1, 1e30, "nonsense", {})
# Run ids, SHA-256 and versions depend on when, where and by which release a file is written. A page's own
# hashes are those of its scripts, which are left out, too.
ACCIDENTS = re.compile(
    r"(?<!\.)\b[0-9a-f]{16}\b|\b[0-9a-f]{64}\b|\bsha256-[\w+/]{43}="
    r'|"(?:cogless|python|numpy|version)": *"[^"]*"'
)


def studies() -> dict[str, Path]:
    """Each shipped study and example that runs, by name; an arena takes longer than all of them."""
    files = [*sorted((ROOT / "studies").glob("*.toml")), *sorted((ROOT / "examples").glob("*.toml"))]
    return {path.stem: path for path in files if "scenario" in tomllib.loads(path.read_text())}


def commands() -> list[str]:
    """Names of all commands of cogless."""
    from cogless.cli import app

    return sorted(command.name or command.callback.__name__ for command in app.registered_commands)


def output_of(*arguments: object) -> str:
    """What a command prints, its errors after it, and its exit code."""
    from cogless.__main__ import main

    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["cogless", *map(str, arguments)]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as end:
            err.write(f"exit code {end.code}\n")
    return out.getvalue() + err.getvalue()


def without_accidents(text: str) -> str:
    return ACCIDENTS.sub("#", text).replace(str(ROOT), "ROOT")


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(without_accidents(text))


def embedded_data(page: Path) -> str:
    """The data of a page, a value a line, and its text without scripts and styles, an element a line."""
    html = page.read_text()
    block = re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL)
    text = re.sub(r"<(script|style)\b.*?</\1>", "", html, flags=re.DOTALL)
    data = json.dumps(json.loads(block.group(1)), indent=0, sort_keys=True) if block else ""
    return data + "\n" + re.sub(r"(?=<)", "\n", text)


def trace_hashes(path: Path) -> str:
    """SHA-256 of each signal's numbers, run by run."""
    import netCDF4

    lines = []

    def walk(group: Any, name: str) -> None:
        for key, variable in sorted(group.variables.items()):
            digest = hashlib.sha256(variable[:].tobytes()).hexdigest()[:12]
            lines.append(f"{name}/{key} {variable.shape} {digest}\n")
        for key, child in sorted(group.groups.items()):
            walk(child, f"{name}/{key}")

    with netCDF4.Dataset(path) as file:
        walk(file, "")
    return "".join(lines)


def keys(tables: Any, path: tuple[str, ...] = ()) -> Iterator[str]:
    """The dotted key of each value in a study's tables."""
    if isinstance(tables, dict):
        for key, value in tables.items():
            yield from keys(value, (*path, key))
    elif isinstance(tables, list) and tables and isinstance(tables[0], dict):
        for index, value in enumerate(tables):
            yield from keys(value, (*path, str(index)))
    else:
        yield ".".join(path)


def refusals(study: Path) -> str:
    """One line for each wrong value of each key: how the study is refused with it, or that it is not."""
    from cogless import StudyError, load

    lines = []
    for key in keys(tomllib.loads(study.read_text())):
        for value in WRONG_VALUES:
            try:
                load(study, {key: value})
                line = "taken"
            except StudyError as error:
                line = str(error)
            except Exception as error:  # a fault of cogless; it is kept like an answer, so that it is seen
                line = f"{type(error).__name__}: {error}"
            lines.append(f"{key} = {value!r}: {line}\n")
    return "".join(lines)


def keep_study(name: str, study: Path, folder: Path) -> None:
    """Writes what all commands make of one study."""
    import cogless

    work = WORK / name
    write(folder / name / "run.txt", output_of("run", study, "-o", work, "-j", 1))
    if (work / "results.json").exists():
        write(folder / name / "results.json", (work / "results.json").read_text())
        write(folder / name / "traces.txt", trace_hashes(work / "traces.nc"))
        write(folder / name / "report.txt", embedded_data(work / "report.html"))
    write(folder / name / "design.txt", output_of("design", study))
    write(folder / name / "design.json", output_of("design", study, "--json"))
    page = work / "live.html"
    write(folder / name / "live.txt", output_of("live", study, "-o", page))
    if page.exists():
        write(folder / name / "live-data.txt", embedded_data(page))
    for controller in cogless.load(study).controller:
        c_folder = work / controller
        write(
            folder / name / controller / "export.txt",
            output_of("export", study, "--controller", controller, "--to", "c", "-o", c_folder),
        )
        for path in sorted(c_folder.rglob("*")):
            if path.is_file():
                write(folder / name / controller / path.relative_to(c_folder), path.read_text())
    write(folder / name / "refusals.txt", refusals(study))
    shutil.rmtree(work, ignore_errors=True)


def keep(folder: Path, jobs: int) -> None:
    """Writes all outputs into `folder`, in place of what is there."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    context = multiprocessing.get_context("spawn")  # a study's threads don't survive a fork
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        tasks = {pool.submit(keep_study, name, path, folder): name for name, path in studies().items()}
        for task in as_completed(tasks):
            task.result()
            print(tasks[task], flush=True)
    write(folder / "help" / "cogless.txt", output_of("--help"))
    write(folder / "help" / "list.txt", output_of("list"))
    for command in commands():
        write(folder / "help" / f"{command}.txt", output_of(command, "--help"))
    shutil.rmtree(WORK, ignore_errors=True)


def differences(kept: Path, now: Path) -> dict[str, list[str]]:
    """Lines that differ, with - and +, of each file that is another, missing or new."""
    names = {
        str(path.relative_to(root)) for root in (kept, now) for path in root.rglob("*") if path.is_file()
    }
    unequal = {}
    for name in sorted(names):
        before, after = (
            (root / name).read_text().splitlines() if (root / name).exists() else [] for root in (kept, now)
        )
        if before != after:
            lines = difflib.unified_diff(before, after, n=0, lineterm="")
            unequal[name] = [line for line in lines if not line.startswith(("---", "+++", "@@"))]
    return unequal


def compare(kept: Path, now: Path) -> int:
    unequal = differences(kept, now)
    for name, lines in unequal.items():
        print(f"{name}: {len(lines)} lines differ")
        for line in lines[:LINES_SHOWN]:
            print("  " + line[:150])
    print(f"{len(unequal)} files differ" if unequal else "the same")
    return bool(unequal)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("keep", "compare"))
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    os.environ["COLUMNS"] = str(COLUMNS)
    kept, now = FOLDER / "kept", FOLDER / "now"
    if arguments.what == "keep":
        keep(kept, arguments.jobs)
        return 0
    if not kept.exists():
        parser.error(f"{kept}: expected what `make keep` wrote before the change")
    keep(now, arguments.jobs)
    return compare(kept, now)


if __name__ == "__main__":
    sys.exit(main())
