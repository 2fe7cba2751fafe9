"""How exact `cogless identify` is for motors drawn at random, simulated by a plant that is not cogless's.

    OPENBLAS_NUM_THREADS=1 python benchmarks/identify.py --seeds 1 2 3
    OPENBLAS_NUM_THREADS=1 python benchmarks/identify.py --seeds 1 --rate 200 --jitter 0.3 --every-key


Each seed draws a motor of each of eight kinds, with six logs. A line for each motor names the values that are
off or left out. The table has a row for each kind of value: how many there are, how many identify gives, how
many are within the goal and within their own interval, the median interval, and the median of deviation over
interval. An order that the motor doesn't have counts as false if it is larger than a twentieth of the motor's
largest order, or of the friction if the motor has no cogging.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import identify_plant as plant
import numpy as np

from cogless.errors import StudyError
from cogless.identify import plan
from cogless.identify.command import identified
from cogless.identify.result import Estimate, Value, Wave

GOALS = {  # relative; the delay in s, phases in rad
    "inertia": 0.01,
    "Coulomb": 0.01,
    "viscous": 0.05,
    "delay": 5e-5,
    "cogging": 0.03,
    "cogging phase": math.radians(2),
    "K_t ripple": 0.05,
    "K_t phase": math.radians(5),
    "encoder": 0.05,
    "encoder phase": math.radians(5),
}
MAIN_SHARE = 0.05  # share of the largest order


@dataclass
class Tally:
    """A kind of value: how many there are, and deviation and interval of each that identify gives."""

    wanted: int = 0
    off: list[float] = field(default_factory=list)
    error: list[float] = field(default_factory=list)

    def add(self, off: float, error: float) -> None:
        self.off.append(off)
        self.error.append(error)

    def line(self, kind: str) -> str:
        off, error = np.abs(self.off), np.array(self.error)
        within, inside = int(np.sum(off <= GOALS[kind])), int(np.sum(off <= error))
        if not len(off):
            return f"{kind:14} {self.wanted:4} {0:5}"
        return (
            f"{kind:14} {self.wanted:4} {len(off):5} {within:6} {inside:6}  {np.median(error):9.2g} "
            f"{np.median(off / error):6.2f}"
        )


@dataclass
class Score:
    """The result for all motors. `main`: number of motors whose largest order identify gives.

    `false`: motors with false orders above MAIN_SHARE. `small`: motors with false orders of any size.
    """

    tallies: dict[str, Tally] = field(default_factory=lambda: defaultdict(Tally))
    motors: int = 0
    main: int = 0
    false: list[str] = field(default_factory=list)
    small: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def lines(self) -> list[str]:
        kinds = [kind for kind in GOALS if kind in self.tallies]
        whole = [self.tallies[kind] for kind in kinds]
        off, error = (np.abs([x for t in whole for x in getattr(t, name)]) for name in ("off", "error"))
        count, share = sum(t.wanted for t in whole), off / np.maximum(error, 1e-300)
        goal = sum(int(np.sum(np.abs(self.tallies[kind].off) <= GOALS[kind])) for kind in kinds)
        return [
            f"{'':14} {'of':>4} {'told':>5} {'within':>6} {'inside':>6}  {'interval':>9} {'median':>6}",
            *(self.tallies[kind].line(kind) for kind in kinds),
            f"{'all':14} {count:4} {len(off):5} {goal:6} {int(np.sum(share <= 1)):6}  {'':9} "
            f"{np.median(share) if len(share) else math.nan:6.2f}",
            f"main order {self.main} of {self.motors}; false orders in {len(self.false)} motors "
            f"({'; '.join(self.false)}), of any size in {len(self.small)}; "
            f"{self.seconds / max(1, self.motors):.1f} s a motor",
        ]


def compared(motor: plant.Motor, made: Estimate | None, score: Score) -> list[str]:
    """Add a motor's values to the score; returns a text for each value that is off or missing."""
    said: list[str] = []

    def add(kind: str, name: str, off: float, error: float) -> None:
        score.tallies[kind].add(off, error)
        if abs(off) > error:
            said.append(f"{kind}{name} {off:+.3g} +- {error:.2g}")

    def single(kind: str, got: Value | None, true: float, relative: bool = True) -> None:
        score.tallies[kind].wanted += 1
        if got is None:
            said.append(f"no {kind}")
            return
        whole = abs(true) if relative else 1.0
        add(kind, "", (got.value - true) / whole, got.error / whole)

    def add_wave(kind: str, phase: str, got: Wave | None, factor: float, true: plant.Wave) -> None:
        order, size, angle = true
        score.tallies[kind].wanted += 1
        score.tallies[phase].wanted += 1
        if got is None:
            said.append(f"no {kind} {order}")
            return
        add(kind, f" {order}", got.size.value * factor / size - 1, got.size.error * factor / size)
        turned = (got.phase.value - angle + math.pi) % (2 * math.pi) - math.pi
        add(phase, f" {order}", turned, got.phase.error)

    values = {} if made is None else made.values
    torque = motor.K_t
    for key, kind, true in (("j", "inertia", motor.inertia), ("c", "Coulomb", motor.coulomb)):
        single(kind, values[key].times(torque) if key in values else None, true)
    single("viscous", values["b"].times(torque) if "b" in values else None, motor.viscous)
    single("delay", values.get("delay"), motor.delay, relative=False)
    kinds = ("cogging", "ripple", "encoder")
    by_kind: dict[str, Sequence[Wave]] = {} if made is None else {kind: getattr(made, kind) for kind in kinds}
    orders = {kind: {w.order: w for w in waves} for kind, waves in by_kind.items()}
    largest = max((size for _, size, _ in motor.cogging), default=0.0)
    own = {order for order, _, _ in motor.cogging}
    for true in motor.cogging:
        if true[1] > MAIN_SHARE * largest:
            add_wave("cogging", "cogging phase", orders.get("cogging", {}).get(true[0]), torque, true)
        if true[1] == largest and true[0] in orders.get("cogging", {}):
            score.main += 1
    for true in motor.flux:
        add_wave("K_t ripple", "K_t phase", orders.get("ripple", {}).get(true[0]), 1.0, true)
    for true in motor.encoder:
        add_wave("encoder", "encoder phase", orders.get("encoder", {}).get(true[0]), 1.0, true)
    least = MAIN_SHARE * (largest or motor.coulomb)
    others = [w for w in by_kind.get("cogging", ()) if w.order not in {*own, motor.poles}]
    false = [wave.order for wave in others if wave.size.value * torque > least]
    if false:
        score.false.append(f"{motor.kind} {false}")
    small = [f"{w.order} ({w.size.value * torque / motor.coulomb:.1%} of the friction)" for w in others]
    if small:
        score.small.append(motor.kind)
        said.append(f"false cogging {', '.join(small)}")
    score.motors += 1
    return said


def scored(
    seeds: Sequence[int], rate: float, jitter: float, every_key: bool, cogging: bool, kinds: Sequence[str]
) -> Score:
    """Draw, log and identify motors of these kinds for each seed; prints a line for each."""
    score = Score()
    for seed in seeds:
        random = np.random.default_rng(seed)
        motors = [plant.drawn(kind, random, cogging) for kind in plant.KINDS]
        motors = [motor for motor in motors if motor.kind in kinds]
        for motor, raw in zip(motors, plant.simulated(motors, seed), strict=True):
            logs = {
                name: plant.rows_of(signals, motor, rate, jitter, seed + n)
                for n, (name, signals) in enumerate(raw.items())
            }
            begin, made = time.process_time(), None
            with tempfile.TemporaryDirectory() as folder:
                paths = plant.write(Path(folder), logs, plan.to_toml(plant.columns(motor, every_key)))
                try:
                    made = identified(paths, Path(folder) / "id.toml", lambda what, share: None).estimate
                except StudyError as error:
                    print(*str(error).splitlines()[:2], sep="\n")
            score.seconds += time.process_time() - begin
            said = compared(motor, made, score)
            print(f"{seed} {motor.kind:8} {'; '.join(said)}", flush=True)
    return score


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--rate", type=float, default=1000.0, help="rows a second")
    parser.add_argument("--jitter", type=float, default=0.0, help="of the rows' distance")
    parser.add_argument("--every-key", action="store_true", help="a law in the file of columns")
    parser.add_argument("--no-cogging", action="store_true", help="motors without cogging and ripple of K_t")
    parser.add_argument("--kinds", nargs="+", default=list(plant.KINDS), choices=list(plant.KINDS))
    options = parser.parse_args()
    score = scored(
        options.seeds, options.rate, options.jitter, options.every_key, not options.no_cogging, options.kinds
    )
    print(*score.lines(), sep="\n")


if __name__ == "__main__":
    main()
