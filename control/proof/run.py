#!/usr/bin/env python3
"""Proves the control library with Frama-C/Eva: control/proof/run.py [--jobs N] [--stale] [NAME ...].

Each run is one harness with its sizes; the table says what was proven. Fails on any alarm, on a property
that is not proven, and where a deliberately broken law is not caught. A green run leaves its stamp in
proven.txt; with --stale only those run whose stamp is not that of the files at hand. PROOF.md explains it.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import stamps
from verdict import Result, must_alarm, verdict

CONTROL = Path(__file__).resolve().parents[1]
PROVEN = CONTROL / "proof" / "proven.txt"

EVA = [
    "-eva", "-eva-no-print", "-eva-no-show-progress", "-eva-slevel", "8", "-eva-auto-loop-unroll", "24",
    "-eva-partition-history", "1", "-eva-split-return", "auto", "-eva-domains", "equality",
    # every bit pattern is a number to compute with; what an integer can't hold is an alarm
    "-warn-special-float", "none", "-warn-signed-overflow", "-warn-signed-downcast", "-warn-invalid-bool",
    # the Cortex-M4's sizes: 32-bit int, long and pointers
    "-machdep", "gcc_x86_32",
]  # fmt: skip

PARTS = {
    "leaves": "angle modulation polynomial",
    "foc": "range angle square_root foc",
    "current_reference": "range square_root current_reference",
    "dead_time": "range dead_time",
    "microstepping": "range angle microstepping",
    "sensors": "encoder speed_timed angle_observer hall low_pass",
    "monitor": "range angle monitor",
    "quality": "range square_root quality",
    "drive": "range angle square_root foc monitor quality guard drive",
    "pi": "law range pi speed_pi",
    "pi_ilc": "law angle pi memory delay_line range pi_ilc",
    "robust_ilc": "law angle memory delay_line range robust_ilc",
    "anti_cogging": "law range angle pi anti_cogging",
    "pi_afc": "law range angle pi pi_afc",
    "harmonic": "law range angle pi harmonic",
    "space_position": "law angle memory delay_line range space_position",
    "space_speed": "law angle memory delay_line range space_speed",
    "trial": "law angle feedforward polynomial zero_phase trial_guard trial_observer trial trial_basis",
    "map_store": "map map_store crc32",
}

# Stems of the laws, by their rows in laws.def. A law that is in no table below has what most have.
LAWS_DEF = (CONTROL / "src" / "cogless" / "laws.def").read_text()
LAWS = re.findall(r"^CGL_LAW\w*\([^,]+, (\w+),", LAWS_DEF, re.MULTILINE)


def parts_of(law: str) -> str:
    """The sources that a law needs: its own, and those of all headers that it includes.

    Not the guard's, which the drive calls around a law, nor real.c, in whose place view.h stands.
    """
    stems, waiting = {"guard", "real"}, [law]
    while waiting:
        stem = waiting.pop()
        files = [CONTROL / "src" / "cogless" / f"{stem}{end}" for end in (".c", ".h")]
        text = "".join(path.read_text() for path in files if path.is_file())
        stems.add(stem)
        waiting += set(re.findall(r'^#include "(\w+)\.h"', text, re.MULTILINE)) - stems
    others = sorted(stems - {"guard", "real", law})
    sources = [stem for stem in others if (CONTROL / "src" / "cogless" / f"{stem}.c").is_file()]
    return " ".join([*sources, law])


PARTS |= {law: parts_of(law) for law in LAWS if law not in PARTS}

# Functions whose paths are kept apart further than others': those whose answer says what is valid.
PRECISE = """
    is_in_range cgl_out_of_range is_valid cgl_foc_bad_field cgl_monitor_bad_field cgl_quality_bad_field
    cgl_drive_bad_field cgl_law_bad_field cgl_own_feedback_bad_field
    cgl_pi_bad_field cgl_adrc_bad_field cgl_memory_bad_field cgl_pi_ilc_bad_field
    cgl_robust_ilc_bad_field cgl_anti_cogging_bad_field cgl_pi_afc_bad_field
    cgl_harmonic_bad_field cgl_space_position_bad_field cgl_space_speed_bad_field
    cgl_map_is_valid cgl_pi_init cgl_adrc_init cgl_memory_init cgl_pi_ilc_init cgl_robust_ilc_init
    cgl_anti_cogging_init cgl_pi_afc_init cgl_harmonic_init
    cgl_delay_is_valid cgl_space_position_init cgl_space_speed_init
    cgl_encoder_init cgl_hall_init cgl_low_pass_init cgl_low_pass_retune cgl_angle_observer_init
    cgl_angle_observer_retune cgl_speed_timed_init
    cgl_feedforward_init cgl_zero_phase_init cgl_trial_init cgl_trial_reset learn learn_guarded correct step
    cgl_trial_step cgl_trial_drive_step cgl_space_speed_step cgl_space_position_step cgl_robust_ilc_step
    follow learned_current learn_on repeat cgl_memory_step find_time find_angle cgl_delay_step write_bytes
    check_step check_mark take_entries smaller slow_orders sum_of_orders cgl_pi_afc_step cgl_harmonic_step
"""
PRECISE_FUNCTIONS = PRECISE.split() + [
    f"cgl_{law}_{part}" for law in LAWS if f"cgl_{law}_init" not in PRECISE for part in ("bad_field", "init")
]

EXTRA = {
    "map_store": ["-no-warn-invalid-bool"]
}  # whether the law learns is read from the caller, as volatile

DOUBLE = {"COGLESS_DOUBLE": ""}
LIMITED = {"LIMIT": "3.0"}
TIME = {"KIND": "CGL_MEMORY_TIME"}
DELAY = {"KIND": "CGL_MEMORY_DELAY"}
ORDERS = {"ORDERS": "3"}
WORDS = {"COGLESS_DOUBLE": "double", "KIND": "kind", "Q_HALF_WIDTH": "q", "SAMPLES": "samples"}


@dataclass(frozen=True)
class Run:
    """One harness with its sizes, which must raise no alarm."""

    harness: str
    defines: dict[str, str]

    @property
    def name(self) -> str:
        words = [WORDS.get(key, key.lower()) + (f"={v}" if v else "") for key, v in self.defines.items()]
        return " ".join([self.harness, *words]).replace("CGL_MEMORY_", "").lower()

    @property
    def parts(self) -> list[str]:
        return [f"src/cogless/{part}.c" for part in PARTS[self.harness].split()]

    @property
    def sources(self) -> list[str]:
        return ["proof/view.h", f"proof/{self.harness}.c", *self.parts]

    @contextmanager
    def folder(self) -> Iterator[Path]:
        """Where its files are, as those of control/."""
        yield CONTROL

    def command(self, folder: Path) -> list[str]:
        """Frama-C's; relative to the folder, so that no path of a machine is in it."""
        defines = [f"-D{key}" + (f"={value}" if value else "") for key, value in self.defines.items()]
        flags = " ".join(["-Isrc", "-Iproof", "-include proof/view.h", *defines])
        return [
            "frama-c", *EVA, *paths_of(self.parts, folder), *EXTRA.get(self.harness, []),
            f"-cpp-extra-args={flags}", f"proof/{self.harness}.c", *self.parts,
        ]  # fmt: skip

    def stamp(self, version: str) -> str:
        with self.folder() as folder:
            return stamps.stamp(self.command(folder), self.sources, folder, version)

    def prove(self) -> Result:
        with self.folder() as folder:
            return verdict(self.name, self.command(folder), folder)


@dataclass(frozen=True)
class Mutant(Run):
    """A run with one line of the library broken, in a copy: it must raise an alarm."""

    file: str
    line: str
    broken: str

    @property
    def name(self) -> str:
        return f"broken {self.file}: {self.harness}"

    @contextmanager
    def folder(self) -> Iterator[Path]:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            for file in stamps.files_read(self.sources, CONTROL):
                (folder / file).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(CONTROL / file, folder / file)
            path = folder / "src" / "cogless" / self.file
            text = path.read_text()
            if text.count(self.line) != 1:
                sys.exit(f"control/proof/run.py: the mutant of {self.file} does not fit now: {self.line}")
            path.write_text(text.replace(self.line, self.broken))
            yield folder

    def prove(self) -> Result:
        return must_alarm(super().prove())


def sizes(cells: int, q: int) -> dict[str, str]:
    return {"CELLS": str(cells), "Q_HALF_WIDTH": str(q)}


MAP = sizes(8, 1)

RUNS = [  # the longest first
    Run("harmonic", ORDERS), Run("harmonic", ORDERS | LIMITED),
    Run("robust_ilc", MAP),
    Run("map_store", sizes(3, 0) | {"CHANNELS": "2", "BUFFER": "32"} | LIMITED),
    Run("space_position", MAP | LIMITED | {"CHANNELS": "1"}), Run("drive", {}),
    Run("pi_ilc", MAP), Run("pi_ilc", MAP | LIMITED), Run("pi_ilc", MAP | TIME),
    Run("robust_ilc", MAP | TIME | LIMITED),
    Run("space_position", MAP | DELAY | LIMITED | {"CHANNELS": "1"}),
    Run("space_speed", MAP | LIMITED | {"CHANNELS": "1"}),
    Run("space_speed", MAP | DELAY | {"CHANNELS": "1"}),
    Run("anti_cogging", sizes(8, 0)), Run("anti_cogging", sizes(8, 0) | LIMITED),
    Run("pi_afc", ORDERS), Run("pi_afc", ORDERS | LIMITED),
    Run("trial", {"SAMPLES": "4", "ORDER": "0", "ODD": "0", "TAPS": "0"}),
    Run("trial", {"SAMPLES": "8", "ORDER": "1", "ODD": "0", "TAPS": "3"} | LIMITED),
    Run("trial", {"SAMPLES": "8", "ORDER": "1", "ODD": "1", "TAPS": "3"} | LIMITED),
    Run("monitor", {}), Run("monitor", DOUBLE), Run("quality", {}), Run("quality", DOUBLE),
    Run("foc", {}), Run("foc", DOUBLE), Run("dead_time", {}), Run("dead_time", DOUBLE),
    Run("current_reference", {}), Run("current_reference", LIMITED),
    Run("current_reference", LIMITED | DOUBLE),
    Run("microstepping", {}), Run("microstepping", LIMITED), Run("microstepping", DOUBLE),
    Run("sensors", {}), Run("sensors", DOUBLE),
    Run("leaves", {}), Run("leaves", DOUBLE),
    Run("pi", {}), Run("pi", LIMITED), Run("pi", DOUBLE),
]  # fmt: skip
RUNS += [
    Run(law, defines)
    for law in LAWS
    if law not in {run.harness for run in RUNS}
    for defines in ({}, LIMITED, DOUBLE)
]

# What a proof that proves anything must catch: harness, file, the line that is there, and how it is broken.
MUTANTS = [
    Mutant("pi", LIMITED, "pi.c", "return cgl_clamped(pi->proportional + pi->integral + ff, config->limit);",
           "return pi->proportional + pi->integral + ff;"),
    Mutant("foc", {}, "duties.h", "duty[2] = CGL_R(0.5) + cgl_clamp(part[2], CGL_R(0.5));",
           "duty[2] = CGL_R(0.5) + part[2];"),
    Mutant("foc", {}, "foc.c", "cgl_is_angle(in->theta_e) && ", ""),  # NaN gets through to a conversion
    Mutant("pi_afc", ORDERS | LIMITED, "pi_afc.c", "    return cgl_clamp(sum, limit);",
           "    return sum;"),
    Mutant("pi_ilc", MAP, "memory.c", "head = head < m ? head + 1U : 0U;",
           "head = head <= m ? head + 1U : 0U;"),
]  # fmt: skip


def paths_of(files: list[str], folder: Path) -> list[str]:
    """For Eva, which wants no function that is not there, and numbers static ones of the same name."""
    text = "".join((folder / file).read_text() for file in files)
    found = ["main:60"]
    for function in PRECISE_FUNCTIONS:
        definitions = re.findall(rf"^[a-zA-Z].* \*?{function}\([^;]*$", text, re.MULTILINE)
        found += [f"{function}{f'_{n - 1}' if n else ''}:60" for n in range(len(definitions))]
    return ["-eva-slevel-function", ",".join(found)]


def check_view() -> None:
    """That view.h says the same as real.h, for every bit pattern of a float."""
    with tempfile.TemporaryDirectory() as folder:
        for flags in ([], ["-DCOGLESS_DOUBLE"]):
            program = str(Path(folder) / "view_check")
            compile_it = ["cc", "-std=c99", "-O2", "-ffp-contract=off", *flags, "-Isrc", "-Iproof",
                          "-include", "proof/view.h", "proof/view_check.c", "src/cogless/angle.c",
                          "-o", program]  # fmt: skip
            subprocess.run(compile_it, cwd=CONTROL, check=True)
            subprocess.run([program], check=True)


NAMES = {run.name for run in [*RUNS, *MUTANTS]}


class Proven:
    """The table of those that were green, written after each of them, so that a run that is stopped keeps
    what it proved."""

    def __init__(self) -> None:
        self.version = subprocess.run(
            ["frama-c", "-version"], capture_output=True, text=True, check=True
        ).stdout.strip()
        self.table = stamps.read(PROVEN)
        self.lock = threading.Lock()

    def holds(self, run: Run) -> bool:
        return self.table.get(run.name) == run.stamp(self.version)

    def prove(self, run: Run) -> Result:
        """Stamped if it is green, and if its files are those that it began with."""
        begun = run.stamp(self.version)
        result = run.prove()
        with self.lock:
            if result.alarms or run.stamp(self.version) != begun:
                self.table.pop(run.name, None)
            else:
                self.table[run.name] = begun
            stamps.write(PROVEN, {name: self.table[name] for name in self.table.keys() & NAMES})
        return result


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="only harnesses of these names")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--stale", action="store_true", help="only those without a valid stamp")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.names) - PARTS.keys())
    if unknown:
        parser.error(f"no harness has the name {unknown[0]}; there are {', '.join(sorted(PARTS))}")
    if shutil.which("frama-c") is None:
        print("make proof needs frama-c (Debian: frama-c-base)", file=sys.stderr)
        return 2
    begin = time.monotonic()
    check_view()
    proven = Proven()
    chosen = [run for run in [*RUNS, *MUTANTS] if not arguments.names or run.harness in arguments.names]
    if arguments.stale:
        every, chosen = chosen, [run for run in chosen if not proven.holds(run)]
        print(f"{len(every) - len(chosen)} of {len(every)} have not changed since they were proven")
    print(f"{'law':52} {'alarms':>6}  {'output':24} {'seconds':>7}")
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        results = [pool.submit(proven.prove, run) for run in chosen]
        for future in results:
            result = future.result()
            count = len(result.alarms)
            print(f"{result.run:52} {count:6}  {result.output:24} {result.seconds:7.1f}", flush=True)
            failed += bool(result.alarms)
            for alarm in result.alarms[:8]:
                print(f"    {alarm}")
    print(f"{len(results)} runs, {failed} failed, {time.monotonic() - begin:.0f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
