"""Whether a certified controller ends with a larger error than its own feedback: random axes in trials.

    python benchmarks/trials.py [--cases 200] [--seed 1] [--floors]

Each case is an axis drawn at random: inertia within 30 %, torque constant within 5 %, rates, a sensor of 10
to 20 bits, up to a sample of latency, the same start offset in each trial, a current limit that may be too
low for the motion, and from one trial on a payload and a load step. Each law is compared with the same
controller with learning = false. A phase is worse if the RMS of the true error over its second half is above
1.05 times the feedback's, or if the errors of more than five trials in a row are.
docs/laws/trial.md has the result.

--floors instead compares how many trials the error takes to its floor, predicted and in the run, for
certified controllers: in how many phases these differ by at most 30 % or a trial. A trial in which the law's
guard runs the feedback alone, to compare, doesn't count.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import cogless
from cogless.design.trials.gains import TrialDesign
from cogless.design.trials.prediction import trials_to_floor
from cogless.errors import StudyError
from cogless.results import Run
from cogless.study import TrialStudy, load
from cogless.study.position_sensor import Resolver

WORSE = 1.05  # times the feedback's error
TRIALS_WORSE = 5  # trials in a row that may be worse
CHANGE, TRIALS = 41, 80  # trial of the change; number of trials
NEAR_SHARE = 0.3  # share of the run's trials to the floor
FINE_BITS = 15  # bits from which a sensor's rounding is smaller than what most laws leave
LAWS = {
    "trial-ilc, auto": {"law": "trial-ilc"},
    "trial-ilc": {"law": "trial-ilc", "q_filter": "error"},
    "trial-ilc, signal": {"law": "trial-ilc", "q_filter": "signal"},
    "norm-optimal": {"law": "norm-optimal"},
    "observer-ilc": {"law": "observer-ilc"},
}


def axis(rng: np.random.Generator) -> tuple[str, float]:
    """A study of one axis without controllers, and the cutoff for its learning filter, Hz."""
    period = float(rng.choice([0.001, 0.002, 0.0025]))
    samples = int(rng.integers(150, 300))
    J, K_t = 10 ** rng.uniform(-5, -3), 10 ** rng.uniform(-1.5, 0)
    B = J * 10 ** rng.uniform(-0.5, 1)
    low, high = 0.7 * J, 1.3 * J
    start, end = J * rng.uniform(0.7, 1.3), J * rng.uniform(0.7, 1.3)
    angle, moved = rng.uniform(0.5, 6), samples * period * rng.uniform(0.4, 0.8)
    acceleration = 5.78 * angle / moved**2
    need = acceleration * 1.3 * J / K_t + B * 1.88 * angle / moved / K_t
    limit = need * float(rng.choice([0.85, 1.5, 3.0, 10.0], p=[0.15, 0.15, 0.3, 0.4]))
    load = rng.uniform(-0.3, 0.3) * need * K_t
    offset = float(rng.choice([0.0, 0.01, 0.02])) * rng.uniform(0.2, 1.0)
    latency = float(rng.choice([0.0, 0.25, 1.0], p=[0.5, 0.3, 0.2])) * period
    bits = int(rng.integers(10, 21))
    bandwidth = rng.uniform(0.1, 0.35) / period / 5
    q = 1 / (0.01 * angle) ** 2
    duration = samples * period
    sensor = f'kind = "resolver", bits = {bits}, window = {round(4000 * period)}, latency = "{latency!r} s"'
    rest, arrived = 0.05 * duration, 0.05 * duration + moved
    points = f'["0 s", "0 rad"], ["{rest!r} s", "0 rad"], ["{arrived!r} s", "{angle!r} rad"]'
    steps, payload = f'[[{samples // 3}, "{load!r} N*m"]]', f'"mechanics.inertia" = "{end!r} kg*m^2"'
    text = f"""
title = "An axis"
seed = {int(rng.integers(1 << 30))}
[motor]
pole_pairs = 3
R_s = "1 ohm"
L_d = "1 mH"
L_q = "1 mH"
K_t = "{K_t!r} N*m/A"
[mechanics]
inertia = "{start!r} kg*m^2"
viscous_friction = "{B!r} N*m*s/rad"
[drive]
rates = {{ current_loop = "8 kHz", position_loop = "{1 / period:g} Hz" }}
current_loop = {{ kind = "ideal", current_limit = "{limit!r} A" }}
position_sensor = {{ {sensor} }}
[design]
state_weight = [{q * need**2!r}, {1e-3 * q * (need * moved / 10) ** 2!r}, {q * need**2 / 5000!r}]
input_weight = 1.0
initial_state = [0.01, 0, 0]
[design.range]
"mechanics.inertia" = ["{low!r} kg*m^2", "{high!r} kg*m^2"]
"motor.K_t" = ["{0.95 * K_t!r} N*m/A", "{1.05 * K_t!r} N*m/A"]
[scenario.move]
duration = "{duration!r} s"
trials = {TRIALS}
initial_angle = "{offset!r} rad"
reference = [{points}]
changes = [{{ trial = {CHANGE}, load_steps = {steps}, override = {{ {payload} }} }}]
[[metric]]
name = "error"
kind = "rms"
signal = "theta_error"
"""
    return text, bandwidth


def controllers(law: dict[str, str], bandwidth: float) -> str:
    """The law, and the same controller without learning."""
    q = (
        f'q_filter = {{ cutoff = "{bandwidth!r} Hz", acts_on = "{law["q_filter"]}" }}'
        if "q_filter" in law
        else ""
    )
    learned = f'[controller.learned]\nlaw = "{law["law"]}"\n{q}\n'
    same = "trial-ilc" if law["law"] == "norm-optimal" else law["law"]
    return learned + f'[controller.feedback]\nlaw = "{same}"\nlearning = false\n'


def judged(run: Run, feedback: Run) -> Iterator[tuple[float, int]]:
    """For each phase: the last half's error over the feedback's, and the most trials in a row above it."""
    for begin, end in ((0, CHANGE - 1), (CHANGE - 1, TRIALS)):
        mine, base = (np.asarray(r.metrics["error_rad"], dtype=float)[begin:end] for r in (run, feedback))
        half = len(mine) // 2
        ratio = float(np.sqrt(np.mean(mine[half:] ** 2) / np.mean(base[half:] ** 2)))
        most = now = 0
        for above in ~(mine <= WORSE * base):
            now = now + 1 if above else 0
            most = max(most, now)
        yield (ratio if np.isfinite(ratio) else np.inf), most


def case(rng: np.random.Generator, folder: Path) -> Iterator[tuple[str, bool, str, float, int]]:
    """For each law: name, certified or not, why not designed, worst phase's ratio, trials in a row above."""
    text, bandwidth = axis(rng)
    for name, law in LAWS.items():
        path = folder / "study.toml"
        path.write_text(text + controllers(law, bandwidth), encoding="utf-8")
        try:
            results = cogless.run_study(load(path))
            runs = {run.controller: run for run in results.runs}
            if "learned" not in runs or "feedback" not in runs:
                yield name, False, "not designed", 0.0, 0
                continue
        except StudyError as error:
            yield name, False, str(error).rpartition("toml: ")[2], 0.0, 0
            continue
        phases = list(judged(runs["learned"], runs["feedback"]))
        design = runs["learned"].design
        assert isinstance(design, TrialDesign)
        certified = design.certified
        yield name, certified, "", max(ratio for ratio, _ in phases), max(most for _, most in phases)


def floors(cases: int, seed: int) -> Iterator[tuple[str, bool, int, int | None, int | None]]:
    """For each certified law and phase: name, no latency, bits, trials to the floor as predicted and run."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "study.toml"
        for number in range(cases):
            text, bandwidth = axis(np.random.default_rng([seed, number]))
            for name, law in LAWS.items():
                path.write_text(text + controllers(law, bandwidth), encoding="utf-8")
                try:
                    study = load(path)
                    runs = {run.controller: run for run in cogless.run_study(study, ["*/learned"]).runs}
                except StudyError:
                    continue
                design = runs["learned"].design if "learned" in runs else None
                if design is None or design.prediction is None or not design.certified:
                    continue
                assert isinstance(study, TrialStudy) and study.drive is not None
                sensor, errors = study.drive.position_sensor, runs["learned"].metrics["error_rad"]
                assert isinstance(sensor, Resolver)
                phases = ((0, CHANGE - 1), (CHANGE - 1, TRIALS))
                for (begin, end), predicted in zip(phases, design.prediction.trials_to_floor, strict=True):
                    own = np.asarray(errors, dtype=float)[begin:end]
                    alone = 1 + np.flatnonzero(own[1:] > 0.9 * own[0]) if begin else []
                    yield (
                        name,
                        not sensor.latency,
                        sensor.bits,
                        predicted,
                        trials_to_floor(np.delete(own, alone)),
                    )


def print_floors(cases: int, seed: int) -> None:
    """Print a table: for each law, how many phases of all have a prediction that is near the run."""
    near: dict[str, Counter[str]] = {name: Counter() for name in LAWS}
    for name, prompt, bits, predicted, needed in floors(cases, seed):
        known = predicted is not None and needed is not None
        right = known and abs(predicted - needed) <= max(1, NEAR_SHARE * needed)
        kind = ("no latency" if prompt else "latency") + (", fine" if bits >= FINE_BITS else ", coarse")
        near[name][kind] += right
        near[name][f"{kind}: all"] += 1
    kinds = ("no latency, fine", "no latency, coarse", "latency, fine", "latency, coarse")
    print(f"| law | {' | '.join(kinds)} |", "|---" * (len(kinds) + 1) + "|", sep="\n")
    for name, count in near.items():
        cells = (f"{count[kind]} of {count[kind + ': all']}" for kind in kinds)
        print(f"| {name} | {' | '.join(cells)} |")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", action="store_true", help="a line for each case that is worse")
    parser.add_argument(
        "--floors", action="store_true", help="compare predicted trials to the floor with runs"
    )
    options = parser.parse_args()
    if options.floors:
        print_floors(options.cases, options.seed)
        return
    counts: dict[str, Counter[str]] = {name: Counter() for name in LAWS}
    worst: dict[str, float] = dict.fromkeys(LAWS, 0.0)
    with TemporaryDirectory() as folder:
        for number in range(options.cases):
            rng = np.random.default_rng([options.seed, number])
            for name, certified, why, ratio, most in case(rng, Path(folder)):
                count: Any = counts[name]
                count["cases"] += 1
                count["not designed"] += bool(why)
                if why:
                    continue
                kind = "certified" if certified else "others"
                count[kind] += 1
                count[f"{kind} that end above"] += ratio > WORSE
                count[f"{kind} above for long"] += most > TRIALS_WORSE
                if certified:
                    worst[name] = max(worst[name], ratio)
                if options.each and ratio > WORSE:
                    print(number, name, kind, f"{ratio:.3g}", most, flush=True)
    columns = (
        "certified",
        "certified that end above",
        "certified above for long",
        "others",
        "others that end above",
        "others above for long",
        "not designed",
    )
    print(f"| law | {' | '.join(columns)} | worst of the certified |")
    print("|---" * (len(columns) + 2) + "|")
    for name in LAWS:
        cells = " | ".join(str(counts[name][column]) for column in columns)
        print(f"| {name} | {cells} | {worst[name]:.3g} |")


if __name__ == "__main__":
    main()
