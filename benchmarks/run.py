"""How fast cogless is: `make bench`. README.md says what is measured, and how it is kept fair."""

from __future__ import annotations

import json
import math
import os
import shutil
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import plain_drive
from numpy.typing import NDArray

import cogless
from cogless import _simulator_f32 as native
from cogless.c_layout import control_layout
from cogless.design.trials.from_study import design_study
from cogless.run.drive_config import engine_config
from cogless.run.simulate import rollout
from cogless.run.trial_config import engine_config as trial_config
from cogless.study import Study, TrialStudy

HERE = Path(__file__).parent
BUILD = HERE.parent / "build"
STUDY = HERE / "study.toml"

# the versions that were tested
PACKAGES = {
    "motulator": ["motulator==0.18.0", "motulator-export==0.11.0"],
    "gem": ["gym-electric-motor==3.0.3"],
}
PYTHON_VARIABLE = "COGLESS_BENCH_PYTHON"
PYTHONS = ["python3.12", "python3.13", "python3.14", "python3"]

# the yardstick's fastest portable flags; gcc 12 makes it slower by vectorising
YARDSTICK_FLAGS = ["-std=c99", "-O3", "-fno-tree-vectorize", "-ffp-contract=off"]

ROUNDS = 25  # alternating repetitions of runs of a tenth of a second
COMPETITOR_ROUNDS = 3  # alternating repetitions of runs of seconds
TICKS = 300_000  # 20 s of the drive with ripple

# with sensors so fine, rounding flips no count, and two right programs follow the same path
FINE_SENSORS = {"drive.position_sensor.lines": 1_000_000, "drive.current_sensors.bits": 24}

# least speed of a tick in step with others / speed of a tick alone, by instruction set and law
LANE_BARS = {"avx512": {"pi-ilc": 2.5, "harmonic": 2.0}, "avx2": {"pi-ilc": 2.2, "harmonic": 2.0}}
LANE_TICKS = 2000  # ticks of one timed piece
LANE_ROUNDS = 100  # pieces of each kernel, in turns; the fastest counts

Signal = NDArray[np.float64]

missed: list[str] = []


# ---- printing ----


def heading(text: str) -> None:
    print(f"\n{text}\n{'-' * len(text)}", flush=True)


def report(what: str, value: str, bar: str = "", passed: bool | None = None) -> None:
    """One line of the table; `passed` None: informative only."""
    verdict = "" if passed is None else "pass" if passed else "MISS"
    if passed is False:
        missed.append(what.strip())
    print(f"{what:<58}{value:>16}   {bar:<12}{verdict}".rstrip(), flush=True)


# ---- the drive with ripple and learning, against the yardstick ----


def ripple_config(changes: dict[str, Any]) -> dict[str, Any]:
    """The engine's description of study.toml's drive, with PI and learning over the angle."""
    study = cogless.load(STUDY, {"drive.guard": False, **changes})  # the yardstick has no guard
    return engine_config(study, "low-speed", "pi-ilc")


def yardstick_parameters(config: dict[str, Any]) -> str:
    """The same drive as the yardstick's "name value" pairs."""
    motor, mechanics, drive = config["motor"], config["mechanics"], config["drive"]
    sensors, layout = drive["current_sensors"], control_layout("single")
    control = layout.decode("cgl_drive_config", drive["control"])
    law = layout.decode("cgl_pi_ilc_config", config["controller"]["config"])
    values: dict[str, float] = {
        **{name: motor[name] for name in ("pole_pairs", "R_s", "L_d", "L_q", "psi_f")},
        **{name: mechanics[name] for name in ("inertia", "viscous_friction", "coulomb_friction")},
        **{name: control["foc"][name] for name in ("kp_d", "ki_d", "kp_q", "ki_q", "current_limit")},
        "speed_divider": control["divider"],
        **{name: law["pi"][name] for name in ("kp", "ki")},
        "load": config["load"]["torque"],
        "bus_voltage": drive["inverter"]["bus_voltage"],
        "dead_time": drive["inverter"]["dead_time"],
        "counts": drive["position_sensor"]["counts"],
        "adc_range": sensors["range"],
        "adc_bits": sensors["bits"],
        "tick_rate": drive["current_rate"],
        "speed_reference": config["reference"]["speed"],
        "initial_speed": config["initial_speed"],
        "ilc_gain": law["gain"],
        **{f"ilc_{name}": law["memory"][name] for name in ("forgetting", "cells")},
        "ilc_limit": law["memory"]["limit"][0],
        "ticks": TICKS,
    }
    for n, flux in enumerate(motor["flux_harmonics"]):
        values |= {f"flux_order[{n}]": flux["order"], f"flux_d[{n}]": flux["d"], f"flux_q[{n}]": flux["q"]}
    for n, cogging in enumerate(motor["cogging"]):
        values |= {f"cogging_{key}[{n}]": cogging[key] for key in ("order", "torque", "phase")}
    for n in range(3):
        values |= {f"{key}[{n}]": sensors[key][n] for key in ("offset", "gain_error")}
    return "".join(f"{name} {value!r}\n" for name, value in values.items()) + "end\n"


@dataclass(frozen=True)
class Outcome:
    ns_per_tick: float  # CPU time
    theta_m: float  # at the last row, rad
    omega_m: float  # standard deviation in the second half: rad/s
    i_q: float  # A
    tau_e: float  # N m
    tau_cogging: float  # N m


def run_cogless(config: dict[str, Any], ticks: int, decimation: int) -> tuple[float, dict[str, Signal]]:
    """CPU time per tick in ns, and the trace by signal."""
    drive = native.Drive(config, None)
    state = drive.start()
    recorder = native.Recorder(drive, decimation)
    start = time.process_time()
    drive.advance(state, recorder, ticks)
    elapsed = time.process_time() - start
    rows = recorder.take()
    return elapsed / ticks * 1e9, {name: rows[:, n] for n, (name, _) in enumerate(drive.signals)}


def outcome(ns_per_tick: float, trace: dict[str, Signal]) -> Outcome:
    ripple = {name: trace[name] for name in ("omega_m", "i_q", "tau_e", "tau_cogging")}
    deviations = {name: float(signal[len(signal) // 2 :].std()) for name, signal in ripple.items()}
    return Outcome(ns_per_tick, float(trace["theta_m"][-1]), **deviations)


def build_yardstick() -> Path:
    compiler = os.environ.get("CC", "cc").split()
    program = BUILD / "benchmarks" / "yardstick"
    program.parent.mkdir(parents=True, exist_ok=True)
    command = [*compiler, *YARDSTICK_FLAGS, str(HERE / "yardstick.c"), "-lm", "-o", str(program)]
    subprocess.run(command, check=True)
    return program


def run_yardstick(program: Path, parameters: str) -> Outcome:
    result = subprocess.run([program], input=parameters, capture_output=True, text=True, check=True)
    return Outcome(**json.loads(result.stdout))


def check_same_job(ours: Outcome, theirs: Outcome, angle: float, ripple: float) -> None:
    """Exit unless the final angles agree within `angle` (rad), and the ripple within `ripple` (relative)."""
    close = abs(ours.theta_m - theirs.theta_m) < angle
    for name in ("omega_m", "i_q", "tau_e", "tau_cogging"):
        close &= abs(getattr(ours, name) / getattr(theirs, name) - 1) < ripple
    if not close:
        sys.exit(f"cogless and the yardstick do not do the same job: {ours}, {theirs}")


def engine() -> None:
    heading(f"Engine: ripple physics and learning on, {TICKS} ticks, {ROUNDS} alternating rounds")
    program = build_yardstick()
    averaged, switched = ripple_config({}), ripple_config({"drive.inverter.kind": "switched"})
    decimation = cogless.load(STUDY).drive.rates.divider

    def yardstick_run(config: dict[str, Any]) -> Outcome:
        return run_yardstick(program, yardstick_parameters(config))

    def our_run(config: dict[str, Any], ticks: int = TICKS) -> Outcome:
        return outcome(*run_cogless(config, ticks, decimation))

    fine = ripple_config(FINE_SENSORS)
    check_same_job(our_run(fine), yardstick_run(fine), angle=1e-4, ripple=1e-3)
    yardstick, ours, pwm = [], [], []
    for n in range(ROUNDS):
        if n % 2 == 0:  # the two take turns at running first
            yardstick.append(yardstick_run(averaged))
        ours.append(our_run(averaged))
        if n % 2 == 1:
            yardstick.append(yardstick_run(averaged))
        pwm.append(our_run(switched, TICKS // 10))
    check_same_job(ours[-1], yardstick[-1], angle=0.01, ripple=0.05)
    ns, yardstick_ns, pwm_ns = (
        statistics.median(run.ns_per_tick for run in runs) for runs in (ours, yardstick, pwm)
    )
    ratios = [a.ns_per_tick / b.ns_per_tick for a, b in zip(ours, yardstick, strict=True)]
    low, ratio, high = statistics.quantiles(ratios, n=4)
    report("yardstick (hand-written C)", f"{yardstick_ns:.0f} ns/tick")
    report("cogless, averaged inverter", f"{ns:.0f} ns/tick")
    report("    against the yardstick, pair by pair", f"{ratio:.2f} times", "<= 1.05", ratio <= 1.05)
    report("    half of the pairs lie within", f"{low:.2f} to {high:.2f}")
    report("    current-loop ticks a second", f"{1e9 / ns:.3g}", "> 1e6", ns < 1000)
    report("cogless, switched PWM", f"{pwm_ns:.0f} ns/tick")
    switched_ratio = statistics.median(b.ns_per_tick / a.ns_per_tick for a, b in zip(ours, pwm, strict=True))
    report(
        "    against the averaged inverter", f"{switched_ratio:.2f} times", "<= 2.4", switched_ratio <= 2.4
    )


# ---- the plain drive, against other simulators ----


def plain_config() -> dict[str, Any]:
    """study.toml without ripple, friction and sensors, with the plain drive's numbers."""
    d = plain_drive
    changes = {
        "motor.pole_pairs": d.POLE_PAIRS,
        "motor.R_s": f"{d.R_S!r} ohm",
        "motor.L_d": f"{d.L_D!r} H",
        "motor.L_q": f"{d.L_Q!r} H",
        "motor.psi_f": f"{d.PSI_F!r} Wb",
        "motor.flux_harmonics": [],
        "motor.cogging": [],
        "mechanics": {"inertia": f"{d.INERTIA!r} kg*m^2", "load": f"{d.LOAD_TORQUE!r} N*m"},
        "drive.rates.current_loop": f"{d.TICK_RATE} Hz",
        "drive.rates.speed_loop": f"{d.TICK_RATE} Hz",
        "drive.current_loop.bandwidth": f"{d.CURRENT_BANDWIDTH / (2 * math.pi)!r} Hz",
        "drive.current_loop.current_limit": f"{d.CURRENT_LIMIT!r} A",
        "drive.inverter.bus_voltage": f"{d.BUS_VOLTAGE!r} V",
        "drive.inverter.dead_time": "0 us",
        "drive.position_sensor": {"kind": "ideal"},
        "drive.current_sensors": {},
        "scenario.low-speed": {"duration": "10 s", "reference": f"{d.SPEED_REFERENCE!r} rad/s"},
        "controller.pi": {"law": "pi", "kp": d.SPEED_KP, "ki": d.SPEED_KI},
    }
    return engine_config(cogless.load(STUDY, changes), "low-speed", "pi")


def plain_cogless() -> float:
    """CPU time per tick in ns, every tick recorded; the mean of enough runs for a coarse clock."""
    runs = [run_cogless(plain_config(), plain_drive.TICKS, 1) for _ in range(20)]
    last = runs[-1][1]
    plain_drive.check("cogless", last["omega_m"][-1], last["i_q"][-1])
    return statistics.mean(ns for ns, _ in runs)


def find_python() -> str | None:
    """A Python that motulator-export accepts, 3.12 or later."""
    code = "import sys; sys.exit(sys.version_info < (3, 12))"
    for name in (os.environ.get(PYTHON_VARIABLE), sys.executable, *PYTHONS):
        program = shutil.which(name) if name else None
        if program and subprocess.run([program, "-c", code], capture_output=True).returncode == 0:
            return program
    return None


def environment(name: str, python: str) -> Path:
    """The Python of a virtual environment with one competitor; made once."""
    folder = BUILD / "bench-venvs" / name
    inside = folder / ("Scripts/python.exe" if sysconfig.get_platform().startswith("win") else "bin/python")
    stamp = folder / "packages.txt"
    packages = PACKAGES[name]
    if not (stamp.exists() and stamp.read_text().split() == packages):
        print(f"installing {' and '.join(packages)} ...", flush=True)
        subprocess.run([python, "-m", "venv", "--clear", folder], check=True, capture_output=True, text=True)
        install = [inside, "-m", "pip", "install", "-q", "--disable-pip-version-check", *packages]
        subprocess.run(install, check=True, capture_output=True, text=True)
        stamp.write_text("\n".join(packages))
    return inside


def run_competitor(python: Path, script: str) -> dict[str, float]:
    command = [python, HERE / script]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    measured: dict[str, float] = json.loads(result.stdout.splitlines()[-1])
    return measured


def reason(error: Exception) -> str:
    """The last line that a failed program wrote."""
    wrote = error.stderr if isinstance(error, subprocess.CalledProcessError) else ""
    return wrote.strip().splitlines()[-1] if wrote and wrote.strip() else str(error)


@dataclass(frozen=True)
class Competitor:
    name: str
    environment: str
    script: str
    bar: float
    also: tuple[str, str] | None = None  # key and words of another number, only for information


COMPETITORS = [
    Competitor(
        "motulator-export (native C)", "motulator", "motulator_export_drive.py", 3,
        ("core_ns_per_tick", "its C loop alone, results left in C"),
    ),
    Competitor("motulator (Python)", "motulator", "motulator_drive.py", 300),
    Competitor(
        "gym-electric-motor (Euler)", "gem", "gem_drive.py", 70,
        ("default_ns_per_tick", "with its default solver, of RK4's accuracy"),
    ),
]  # fmt: skip


def compare(competitor: Competitor, python: str) -> None:
    """Alternates the competitor and cogless, and prints how many times faster cogless is."""
    inside = environment(competitor.environment, python)
    ours, theirs = [], []
    for _ in range(COMPETITOR_ROUNDS):
        theirs.append(run_competitor(inside, competitor.script))
        ours.append(plain_cogless())

    def ratio(key: str) -> float:
        return statistics.median(run[key] / own for run, own in zip(theirs, ours, strict=True))

    report(competitor.name, f"{statistics.median(run['ns_per_tick'] for run in theirs):.0f} ns/tick")
    times = ratio("ns_per_tick")
    report("    cogless is faster", f"{times:.3g} times", f">= {competitor.bar:g}", times >= competitor.bar)
    if competitor.also:
        key, what = competitor.also
        report(f"    {what}", f"{ratio(key):.3g} times")


def competitors() -> None:
    heading(
        f"Plain drive: {plain_drive.DURATION} s, every tick recorded, {COMPETITOR_ROUNDS} alternating rounds"
    )
    report("cogless", f"{statistics.median(plain_cogless() for _ in range(COMPETITOR_ROUNDS)):.0f} ns/tick")
    python = find_python()
    if python is None:
        print(f"skipped the competitors: no Python 3.12 or later; name one in {PYTHON_VARIABLE}")
        return
    for competitor in COMPETITORS:
        try:
            compare(competitor, python)
        except (OSError, subprocess.CalledProcessError, ValueError, IndexError) as error:
            print(f"skipped {competitor.name}: {reason(error)}", flush=True)


# ---- what a user waits for ----


@dataclass(frozen=True)
class Usage:
    cpu: float  # s, user and system
    memory: float  # MB, resident at most


def usage(*arguments: str | Path) -> Usage:
    """Run Python with the arguments as a separate process; returns its CPU time and memory."""
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen([sys.executable, *arguments], stdout=output, stderr=subprocess.STDOUT)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            output.seek(0)
            sys.exit(f"{' '.join(map(str, arguments))} failed:\n{output.read()}")
    scale = 1e6 if sys.platform == "darwin" else 1e3  # ru_maxrss is in bytes on macOS, else in kB
    return Usage(used.ru_utime + used.ru_stime, used.ru_maxrss / scale)


def user() -> None:
    heading("What a user waits for: CPU time of a process of its own, report and Python's start included")
    bare = statistics.median(usage("-c", "pass").cpu for _ in range(3))
    imported = statistics.median(usage("-c", "import cogless").cpu for _ in range(3)) - bare
    report("import cogless (less Python's own start)", f"{imported:.2f} s", "< 0.5", imported < 0.5)
    with tempfile.TemporaryDirectory() as folder:
        cli = ("-m", "cogless")
        command = (*cli, "run", STUDY, "-o", Path(folder) / "out")
        seconds = statistics.median(usage(*command).cpu for _ in range(3))
        report("10 s study, three controllers, with report", f"{seconds:.2f} s", "< 3", seconds < 3)
        long = ("--set", "scenario.low-speed.duration=600 s", "--only", "low-speed/pi-ilc")
        memory = usage(*command, *long).memory
        report("10 minute run, trace decimated to 1 kHz", f"{memory:.0f} MB", "< 500", memory < 500)
        seconds = statistics.median(usage(*cli, "design", "mandra2019").cpu for _ in range(3))
        report("design of trials by LMI, with certificate", f"{seconds:.2f} s", "<= 1.5", seconds <= 1.5)
        trials = (*cli, "run", "mandra2019", "-o", Path(folder) / "trials")
        seconds = statistics.median(usage(*trials).cpu for _ in range(3))
        report("500 trials of four structures, with report", f"{seconds:.2f} s", "< 10", seconds < 10)


def trials() -> None:
    heading("Trials: 500 of 1000 samples, 20 current-loop periods each, ideal current loop, resolver")
    study = cogless.load("mandra2019")
    assert isinstance(study, TrialStudy)
    design = design_study(study, [("table-1", "ilc")])["table-1", "ilc"]
    drive = native.Drive(trial_config(study, "table-1", "ilc", design))
    ticks = 500 * 1000 * 20

    def one() -> float:
        state, recorder = drive.start(), native.Recorder(drive, 20, ticks // 20)
        begun = time.process_time()
        drive.advance(state, recorder, ticks)
        return time.process_time() - begun

    seconds = statistics.median(one() for _ in range(3))
    report("one structure", f"{seconds:.2f} s", "< 2", seconds < 2)
    report("    a tick", f"{1e9 * seconds / ticks:.0f} ns")


def lane_nanoseconds(drives: list[Any]) -> dict[int | None, float]:
    """The least time of a drive's tick [ns], by kernel; key None: each drive alone."""

    def pieces(kernel: int | None) -> Iterator[float]:
        states, recorders = (
            [drive.start() for drive in drives],
            [native.Recorder(drive, 4) for drive in drives],
        )
        while True:
            begun = time.process_time()
            if kernel is None:
                for drive, state, recorder in zip(drives, states, recorders, strict=True):
                    drive.advance(state, recorder, LANE_TICKS)
            else:
                size = native.lane_kernels()[kernel][1]
                for some in (slice(first, first + size) for first in range(0, len(drives), size)):
                    native.advance_lanes(drives[some], states[some], recorders[some], LANE_TICKS, kernel)
            taken = time.process_time() - begun
            for recorder in recorders:
                recorder.take()
            yield 1e9 * taken / LANE_TICKS / len(drives)

    runs = {kernel: pieces(kernel) for kernel in (None, *range(len(native.lane_kernels())))}
    times = [{kernel: next(run) for kernel, run in runs.items()} for _ in range(LANE_ROUNDS)]
    return {kernel: min(piece[kernel] for piece in times) for kernel in runs}


def lane_ticks() -> None:
    heading("Lanes: 8 variants of uomodri in step, a tick of each; the best of many short pieces, in turns")
    base = cogless.load("uomodri", {"scenario.slow.duration": "10 s"})
    inertias = [f"{6e-6 * (0.8 + 0.05 * n)} kg*m^2" for n in range(8)]
    changes = [{"scenario.slow.override": {"mechanics.inertia": inertia}} for inertia in inertias]
    studies = [cogless.changed(base, change) for change in changes]
    for law in ("pi-ilc", "harmonic"):
        best = lane_nanoseconds([native.Drive(engine_config(study, "slow", law), None) for study in studies])
        report(f"{law} alone", f"{best[None]:.0f} ns")
        for kernel, (name, _) in enumerate(native.lane_kernels()):
            factor, bar = best[None] / best[kernel], LANE_BARS.get(name, {}).get(law)
            report(f"    {name}", f"{best[kernel]:.0f} ns")
            passed = None if bar is None else factor >= bar
            report(
                "        as many times as fast", f"{factor:.2f}", "" if bar is None else f">= {bar}", passed
            )


def lanes() -> None:
    count = 64
    heading(f"Lanes: {count} variants of uomodri's PI-ILC, 1 s each, from the changed study to its metrics")
    ripple = {"name": "speed_ripple", "kind": "ripple-rms", "signal": "omega_m", "last": "0.5 s"}
    base = cogless.load("uomodri", {"scenario.slow.duration": "1 s", "metric": [ripple]})
    inertias = [f"{6e-6 * (0.8 + 0.4 * n / count)} kg*m^2" for n in range(count)]
    changes = [{"scenario.slow.override": {"mechanics.inertia": inertia}} for inertia in inertias]

    def seconds(made: Callable[[], object]) -> float:
        begun = time.process_time()
        made()
        return time.process_time() - begun

    def variants() -> list[Study]:
        return [cogless.changed(base, change) for change in changes]

    changing = min(seconds(variants) for _ in range(3))
    report("a changed study", f"{1e3 * changing / count:.2f} ms", "<= 0.2", changing / count <= 2e-4)

    def rolled(studies: list[Study]) -> None:
        rollout(studies, ["slow/pi-ilc"], 1, keep_traces=False)

    together = min(seconds(lambda: rolled(variants())) for _ in range(3))
    alone = min(seconds(lambda: [rolled([study]) for study in variants()]) for _ in range(3))
    report("runs per core-second, in step", f"{count / together:.0f}")
    report("    alone", f"{count / alone:.0f}")


def main() -> None:
    print("CPU time, one process, one core, medians. Lower is better except where a bar says otherwise.")
    engine()
    lane_ticks()
    lanes()
    trials()
    competitors()
    user()
    print("\n" + ("missed: " + ", ".join(missed) if missed else "every bar passed"))
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
