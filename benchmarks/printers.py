"""Random printers: how much ripple a correction leaves, and how often its error interval holds the truth.

    python benchmarks/printers.py [--count 20] [--seed 7]

The axes of tests/printer have random tolerances of coils and detent, and belts of 0.5 to 1.8 times a
stiffness. They make ramps, as Klipper records them, under noise of 0.1 to 1 m/s^2, and runs at 40 and
60 mm/s, as Prusa prints them. The ripple is the rms over speeds of 12 to 240 mm/s and both directions,
simulated. The truth is where torques balance at 0.1 m/s. The benchmark takes some minutes.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from printer.printer_bench import FILE, SIGNS, prusa_lines, ramp_records, write_klipper_logs
from printer.printer_plant import Axes, random_axes, ripple_rms, static_orders

from cogless.drives import klipper, prusa
from cogless.errors import StudyError
from cogless.printer.axis import read_axis
from cogless.printer.corrections import Correction
from cogless.printer.records import DIRECTIONS

SPEEDS = np.geomspace(0.012, 0.24, 12)  # m/s
ORDERS = (1, 2, 4)


def ripples(axes: Axes, corrections: Sequence[Correction | None]) -> np.ndarray:
    """Rms displacement of each axis over the speeds and both directions, m; all axes run at once."""
    signed = np.concatenate([sign * SPEEDS for sign in SIGNS.values()])
    count = len(corrections)
    by_order = {n: np.zeros((count, len(SIGNS), len(SPEEDS)), complex) for n in ORDERS}
    for lane, correction in enumerate(corrections):
        for k, direction in enumerate(DIRECTIONS):
            for n in ORDERS if correction is not None else ():
                by_order[n][lane, k] = correction.directions[direction][n].value
    lanes = axes.take(np.repeat(np.arange(count), len(signed)))
    rms = ripple_rms(lanes, np.tile(signed, count), {n: c.ravel() for n, c in by_order.items()})
    return np.sqrt(np.mean(rms.reshape(count, -1) ** 2, axis=1))


def show(name: str, axes: Axes, before: np.ndarray, identify: Callable[[int], Correction]) -> None:
    """Print what share of the ripple `identify` leaves, and how often its errors hold the truth."""
    inside: list[bool] = []
    corrections: list[Correction | None] = []
    for lane in range(len(before)):
        try:
            correction = identify(lane)
        except StudyError:
            corrections.append(None)
            continue
        corrections.append(correction)
        for direction in DIRECTIONS:
            psi = static_orders(axes, lane, SIGNS[direction], {}, 0.1)
            entries = correction.directions[direction]
            inside += [abs(entries[n].value + psi[n]) < entries[n].error for n in ORDERS]
    identified = np.array([correction is not None for correction in corrections])
    shares = (ripples(axes, corrections) / before)[identified]
    print(
        f"{name:<24} leaves {np.mean(shares):.3f} in the mean, {np.max(shares):.3f} at most; errors hold "
        f"{np.mean(inside):.0%}; refused {np.count_nonzero(~identified)} of {len(before)}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    axes, rng = random_axes(options.count, options.seed), np.random.default_rng(options.seed)
    noises = np.geomspace(0.1, 1.0, options.count)
    before = ripples(axes, [None] * options.count)
    records = ramp_records(axes, options.count)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "printer.toml").write_text(FILE)
        axis = read_axis(folder / "printer.toml")

        def ramps(noise: float | None) -> Callable[[int], Correction]:
            return lambda lane: klipper.identify_runs(
                write_klipper_logs(folder, records, lane, rng, noise or float(noises[lane])), axis
            )

        def runs(lane: int) -> Correction:
            log = folder / "serial.log"
            log.write_text("\n".join(prusa_lines(axes, lane, [0.04, 0.06], rng)) + "\n")
            return prusa.identify_runs([log], axis)

        show("ramps, 0.1 m/s^2", axes, before, ramps(0.1))
        show("ramps, 0.1 to 1 m/s^2", axes, before, ramps(None))
        show("sizes alone, 0.1 m/s^2", axes, before, runs)


if __name__ == "__main__":
    main()
