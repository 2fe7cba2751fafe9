"""What a sweep costs per variant: CPU time and peak memory of its processes, some of which are killed.

    python benchmarks/sweep.py -n 10000 --workers 2 --kill 0.5
    python benchmarks/sweep.py -n 10000 --workers 3 --kill 0.3 0.6 --dask
    python benchmarks/sweep.py -n 1000000 --pretend

`--dask`: a scheduler and workers of one thread, each a process. `--kill`: the busiest worker process gets
SIGKILL at these shares of the sweep. `--pretend`: every task returns the first task's rows at once, so that
only the command's own bookkeeping takes time. The digest of sweep.parquet depends only on `-n`, except with
`--pretend`.
"""

from __future__ import annotations

import argparse
import hashlib
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import psutil

import cogless
from cogless.ensemble import sweep as sweeping
from cogless.ensemble import sweep_table
from cogless.report import sweep_report

STUDY = Path(__file__).with_name("sweep.toml")
LOOK_PERIOD = 0.1  # s
SCHEDULER_WAIT = 60.0  # s for the cluster to answer


class Processes:
    """Processes by role; CPU time and peak memory of each and of its children."""

    def __init__(self) -> None:
        self.roots: dict[str, psutil.Process] = {}
        self.seen: dict[tuple[int, float], tuple[str, float, float]] = {}

    def start(self, role: str, *command: str) -> psutil.Popen:
        self.roots[role] = process = psutil.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        return process

    def look(self) -> None:
        for role, root in self.roots.items():
            try:
                for process in (root, *root.children(recursive=True)):
                    status = Path(f"/proc/{process.pid}/status").read_text()
                    peak = int(status.partition("VmHWM:")[2].split()[0]) / 1e3
                    times = process.cpu_times()
                    name = role.rstrip("0123456789") + ("" if process.pid == root.pid else "'s child")
                    key = process.pid, process.create_time()
                    self.seen[key] = name, times.user + times.system, peak
            except (psutil.Error, OSError, IndexError):  # it has just ended
                continue

    def report(self, count: int) -> None:
        for role in dict.fromkeys(name for name, _, _ in self.seen.values()):
            own = [(cpu, peak) for name, cpu, peak in self.seen.values() if name == role]
            cpu, peak = sum(cpu for cpu, _ in own), max(peak for _, peak in own)
            print(f"{role:20s}{len(own):3d} {cpu:8.1f} s of CPU, {peak:5.0f} MB at most")
        whole = sum(cpu for _, cpu, _ in self.seen.values())
        print(f"{1e3 * whole / count:.2f} ms of CPU a variant")


def cluster(processes: Processes, folder: Path, workers: int) -> str:
    """Start a Dask cluster and return its scheduler's address."""
    from distributed import Client

    file = folder / "scheduler.json"
    run = (sys.executable, "-m", "distributed.cli")
    options = ("--no-dashboard", "--scheduler-file", str(file))
    processes.start("scheduler", run[0], run[1], f"{run[2]}.dask_scheduler", "--port", "0", *options)
    for number in range(workers):
        processes.start(
            f"nanny{number}",
            *(run[0], run[1], f"{run[2]}.dask_worker", *options),
            *("--nthreads", "1", "--local-directory", str(folder / f"worker-{number}")),
        )
    begun = time.monotonic()
    while not file.exists() and time.monotonic() - begun < SCHEDULER_WAIT:
        time.sleep(LOOK_PERIOD)
    with Client(scheduler_file=str(file)) as client:
        client.wait_for_workers(workers)
        return str(client.scheduler.address)


def sweep(count: int, workers: int, kills: list[float], dask: bool) -> None:
    """Sweep with these workers, and print what each process took."""
    processes = Processes()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        out, journal = folder / "out", folder / "out" / "journal.jsonl"
        try:
            at = ("--dask", cluster(processes, folder, workers)) if dask else ("-j", str(workers))
            command = (sys.executable, "-m", "cogless", "sweep", str(STUDY), "-n", str(count), "-o", str(out))
            client = processes.start("command", *command, *at)
            begun = time.monotonic()
            while client.poll() is None:
                processes.look()
                lines = journal.read_bytes().count(b"\n") if kills and journal.exists() else 0
                if kills and lines * sweeping.TASK_VARIANTS > kills[0] * count:
                    leader = processes.roots["nanny0" if dask else "command"]
                    victim = max(leader.children(recursive=True), key=lambda child: child.cpu_times().user)
                    victim.kill()
                    print(f"killed a worker at {kills.pop(0):.0%}")
                time.sleep(LOOK_PERIOD)
            print(f"{time.monotonic() - begun:.0f} s, exit code {client.returncode}")
            digest = hashlib.sha256((out / "sweep.parquet").read_bytes()).hexdigest()
        finally:
            for role, process in processes.roots.items():
                if role != "command":
                    process.terminate()
                process.wait()
    processes.report(count)
    print(f"sweep.parquet {digest[:12]}")


class Pretender(Executor):
    """An executor that returns the first task's rows for every task."""

    def __init__(self) -> None:
        self.rows: list[Any] = []

    def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        self.rows = self.rows or work(*arguments, **named)
        future: Future[Any] = Future()
        future.set_result([[list(row) for row in rows] for rows in self.rows[: len(arguments[1])]])
        return future


def pretend(count: int) -> None:
    """Print what each step of the command's own work takes."""
    begun = time.process_time()

    def step(name: str) -> None:
        nonlocal begun
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        print(f"{name:10s}{time.process_time() - begun:8.1f} s of CPU, {peak:5.0f} MB at most until here")
        begun = time.process_time()

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        planned = sweeping.plan(cogless.load(STUDY), count)
        step("plan")
        for name in ("run", "go on"):
            finished = sweeping.run(planned, folder, Pretender())
            step(name)
        assert finished is not None
        sweep_table.write(finished, folder / "sweep.parquet")
        step("table")
        sweep_report.write(finished, folder / "report.html", lambda settings, pair: "")
        step("report")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("-n", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kill", type=float, nargs="*", default=[])
    parser.add_argument("--dask", action="store_true")
    parser.add_argument("--pretend", action="store_true")
    options = parser.parse_args()
    if options.pretend:
        pretend(options.n)
    else:
        sweep(options.n, options.workers, sorted(options.kill), options.dask)


if __name__ == "__main__":
    main()
