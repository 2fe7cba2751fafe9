"""Frama-C/Eva's verdict on one harness. A stamp covers this file: another way to judge makes all stale."""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
import time
from dataclasses import dataclass, replace
from pathlib import Path

LIMIT = 1200  # s, of one run


@dataclass(frozen=True)
class Result:
    run: str
    alarms: list[str]
    output: str
    seconds: float
    finished: bool


def limit_work() -> None:
    """Processor time, so that a loaded machine proves as much as an idle one."""
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))


def verdict(name: str, command: list[str], folder: Path) -> Result:
    """One analysis by Eva; the command's paths are relative to the folder."""
    begin = time.monotonic()
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "PWD": str(folder)},  # Frama-C believes PWD
        capture_output=True, text=True, preexec_fn=limit_work, check=False,
    )  # fmt: skip
    if done.returncode == -signal.SIGXCPU:
        return Result(name, [f"not finished after {LIMIT} s of processor time"], "", LIMIT, False)
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
    return Result(name, alarms, output_of(text), seconds, finished)


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


def must_alarm(result: Result) -> Result:
    """Of a broken law: that it raises no alarm is what is wrong with it."""
    caught = result.finished and bool(result.alarms)
    problems = [] if caught else ["the broken law was not caught"]
    return replace(result, alarms=problems, output=f"{len(result.alarms)} caught", finished=True)
