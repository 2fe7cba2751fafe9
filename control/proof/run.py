#!/usr/bin/env python3
"""Proves the control library with Frama-C/Eva: control/proof/run.py [--jobs N] [NAME ...].

Each run is one harness with its sizes; the table says what was proven. Fails on any alarm, on a property
that is not proven, and where a deliberately broken law is not caught. PROOF.md says what all this means.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCES = HERE.parent / "src"
LIMIT = 1200  # s, of one run

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
    "foc": "range angle foc",
    "dead_time": "range dead_time",
    "sensors": "encoder speed_timed angle_observer hall low_pass",
    "monitor": "range angle monitor",
    "quality": "range quality",
    "drive": "range angle foc monitor quality guard drive",
    "pi": "law range pi speed_pi",
    "adrc": "law range adrc",
    "pi_ilc": "law angle pi memory delay_line range pi_ilc",
    "robust_ilc": "law angle memory delay_line range robust_ilc",
    "anti_cogging": "law range angle pi anti_cogging",
    "pi_afc": "law range angle pi pi_afc",
    "harmonic": "law range angle pi harmonic",
    "space_position": "law angle memory delay_line range space_position",
    "space_speed": "law angle memory delay_line range space_speed",
    "trial": "law angle feedforward polynomial zero_phase trial_observer trial",
    "map_store": "map map_store crc32",
}

# Functions whose paths are kept apart further than others': those whose answer says what is valid.
PRECISE = """
    is_valid cgl_map_is_valid cgl_pi_init cgl_adrc_init cgl_memory_init cgl_pi_ilc_init cgl_robust_ilc_init
    cgl_anti_cogging_init cgl_pi_afc_init cgl_harmonic_init
    cgl_delay_is_valid cgl_space_position_init cgl_space_speed_init
    cgl_encoder_init cgl_hall_init cgl_low_pass_init cgl_low_pass_retune cgl_angle_observer_init
    cgl_angle_observer_retune cgl_speed_timed_init
    cgl_feedforward_init cgl_zero_phase_init cgl_trial_init cgl_trial_reset cgl_trial_end correct step
    cgl_trial_step cgl_trial_drive_step cgl_space_speed_step cgl_space_position_step cgl_robust_ilc_step
    follow learn_on repeat cgl_memory_step find_time find_angle cgl_delay_step write_bytes check_step
    check_mark take_entries smaller cgl_pi_afc_step cgl_harmonic_step
"""

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
    harness: str
    defines: dict[str, str]

    @property
    def name(self) -> str:
        words = [WORDS.get(key, key.lower()) + (f"={v}" if v else "") for key, v in self.defines.items()]
        return " ".join([self.harness, *words]).replace("CGL_MEMORY_", "").lower()


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
    Run("trial", {"SAMPLES": "4", "ORDER": "0", "TAPS": "0"}),
    Run("trial", {"SAMPLES": "8", "ORDER": "1", "TAPS": "3"} | LIMITED),
    Run("monitor", {}), Run("monitor", DOUBLE), Run("quality", {}), Run("quality", DOUBLE),
    Run("foc", {}), Run("foc", DOUBLE), Run("dead_time", {}), Run("dead_time", DOUBLE),
    Run("sensors", {}), Run("sensors", DOUBLE),
    Run("leaves", {}), Run("leaves", DOUBLE),
    Run("adrc", {}), Run("adrc", LIMITED), Run("adrc", DOUBLE),
    Run("pi", {}), Run("pi", LIMITED), Run("pi", DOUBLE),
]  # fmt: skip

# What a proof that proves anything must catch: file, what is there, what is broken, harness.
MUTANTS = [
    ("pi.c", "return cgl_clamped(pi->proportional + pi->integral + ff, config->limit);",
     "return pi->proportional + pi->integral + ff;", Run("pi", LIMITED)),
    ("duties.h", "duty[2] = CGL_R(0.5) + cgl_clamp_here(part[2], CGL_R(0.5));",
     "duty[2] = CGL_R(0.5) + part[2];", Run("foc", {})),
    ("foc.c", "cgl_is_angle(in->theta_e) && ", "", Run("foc", {})),  # NaN gets through to a conversion
    ("pi_afc.c", "    return cgl_clamp(sum, config->limit);", "    return sum;",
     Run("pi_afc", ORDERS | LIMITED)),
    ("memory.c", "head = head < m ? head + 1U : 0U;", "head = head <= m ? head + 1U : 0U;",
     Run("pi_ilc", MAP)),
]  # fmt: skip


@dataclass(frozen=True)
class Result:
    run: str
    alarms: list[str]
    output: str
    seconds: float
    finished: bool


def paths_of(files: list[str]) -> list[str]:
    """For Eva, which wants no function that is not there, and numbers static ones of the same name."""
    text = "".join(Path(file).read_text() for file in files)
    found = ["main:60"]
    for function in PRECISE.split():
        definitions = re.findall(rf"^[a-zA-Z].* \*?{function}\([^;]*$", text, re.MULTILINE)
        found += [f"{function}{f'_{n - 1}' if n else ''}:60" for n in range(len(definitions))]
    return ["-eva-slevel-function", ",".join(found)]


def limit_work() -> None:
    """Processor time, so that a loaded machine proves as much as an idle one."""
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))


def prove(run: Run, sources: Path = SOURCES) -> Result:
    """One analysis by Eva."""
    files = [str(sources / "cogless" / f"{part}.c") for part in PARTS[run.harness].split()]
    defines = [f"-D{key}" + (f"={value}" if value else "") for key, value in run.defines.items()]
    flags = " ".join([f"-I{sources}", f"-I{HERE}", f"-include {HERE}/view.h", *defines])
    command = [
        "frama-c", *EVA, *paths_of(files), *EXTRA.get(run.harness, []),
        f"-cpp-extra-args={flags}", str(HERE / f"{run.harness}.c"), *files,
    ]  # fmt: skip
    begin = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit_work, check=False)
    if done.returncode == -signal.SIGXCPU:
        return Result(run.name, [f"not finished after {LIMIT} s of processor time"], "", LIMIT, False)
    seconds = time.monotonic() - begin
    text = done.stdout + done.stderr
    found = re.findall(r"\[eva:alarm\] (.*?)(?=\n\S|\Z)", text, re.DOTALL)
    alarms = [" ".join(alarm.split()) for alarm in found]
    finished = done.returncode == 0 and "ANALYSIS SUMMARY" in text
    if not finished:
        alarms.append(next((line for line in text.splitlines() if "rror" in line), "Frama-C failed"))
    missing = re.findall(r"Neither code nor \S+ for function (\w+)", text)
    alarms += [f"no code of {name}, and so no proof" for name in missing]
    degenerate = re.search(r"(\d+) (?:error|degeneration)s? +(\d+) warning", text)
    if finished and degenerate and degenerate[1] != "0":
        alarms.append(f"Eva: {degenerate[0]}")
    return Result(run.name, alarms, output_of(text), seconds, finished)


def output_of(text: str) -> str:
    """The hull of what Eva knows of the outputs that a harness shows."""
    shown = re.findall(r"Frama_C_show_each_output:\s*(.*)", text)
    numbers = [float(number) for line in shown for number in re.findall(r"-?\d[\d.e+-]*", line)]
    if not numbers:
        return "-"
    if any("NaN" in line or "inf" in line for line in shown):
        return "any"
    low, high = min(numbers), max(numbers)
    return "finite" if high > 3.4e38 else f"[{low:g}, {high:g}]"


def prove_mutant(mutant: tuple[str, str, str, Run]) -> Result:
    """The harness with one line of the library broken: it must raise an alarm."""
    file, there, broken, run = mutant
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(SOURCES / "cogless", Path(folder) / "cogless")
        path = Path(folder) / "cogless" / file
        text = path.read_text()
        if text.count(there) != 1:
            sys.exit(f"control/proof/run.py: the mutant of {file} does not fit any more: {there}")
        path.write_text(text.replace(there, broken))
        result = prove(run, Path(folder))
    caught = result.finished and bool(result.alarms)
    problems = [] if caught else ["the broken law was not caught"]
    output = f"{len(result.alarms)} caught"
    return Result(f"broken {file}: {run.harness}", problems, output, result.seconds, True)


def check_view() -> None:
    """That view.h says the same as real.h, for every bit pattern of a float."""
    with tempfile.TemporaryDirectory() as folder:
        for flags in ([], ["-DCOGLESS_DOUBLE"]):
            program = str(Path(folder) / "view_check")
            compile_it = ["cc", "-std=c99", "-O2", "-ffp-contract=off", *flags, f"-I{SOURCES}", f"-I{HERE}",
                          "-include", str(HERE / "view.h"), str(HERE / "view_check.c"),
                          str(SOURCES / "cogless" / "angle.c"), "-o", program]  # fmt: skip
            subprocess.run(compile_it, check=True)
            subprocess.run([program], check=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help="only harnesses of these names")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    if shutil.which("frama-c") is None:
        print("make proof needs frama-c (Debian: frama-c-base)", file=sys.stderr)
        return 2
    begin = time.monotonic()
    chosen = [run for run in RUNS if not arguments.names or run.harness in arguments.names]
    mutants = [mutant for mutant in MUTANTS if not arguments.names or mutant[3].harness in arguments.names]
    check_view()
    print(f"{'law':52} {'alarms':>6}  {'output':24} {'seconds':>7}")
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        results = [pool.submit(prove, run) for run in chosen]
        results += [pool.submit(prove_mutant, mutant) for mutant in mutants]
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
