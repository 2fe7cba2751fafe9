"""Whether a slower feedback helps as the design predicts if a position sensor's counts come too rarely.

    python benchmarks/slow_feedback.py --cases 30 --seed 5

Random gimbals turn so slowly that the rotor coasts from count to count. The two numbers of each line are the
ripple with the slower feedback over the ripple without it, predicted and simulated.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from cogless import StudyError, changed, load
from cogless.design import warnings
from cogless.design.gentler import slower_feedback
from cogless.run.simulate import simulate
from cogless.study import Study

GIMBAL = """title = "A gimbal"
[motor]
pole_pairs = 7
slots = 12
R_s = "10 ohm"
L_d = "3.5 mH"
L_q = "3.5 mH"
K_t = "0.25 N*m/A"
[mechanics]
inertia = "4e-5 kg*m^2"
[drive]
rates = { current_loop = "20 kHz", speed_loop = "4 kHz" }
current_loop = { bandwidth = "800 Hz", current_limit = "1 A" }
inverter = { bus_voltage = "12 V" }
position_sensor = { kind = "absolute", bits = 14 }
[scenario.slow]
duration = "4 s"
reference = "1 rpm"
[controller.pi]
law = "pi"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
"""


def drawn(gimbal: Study, random: np.random.Generator) -> Study:
    """The gimbal with random pole pairs, bits, inertia, rate, cogging, speed; StudyError: no such drive."""
    pole_pairs = int(random.choice([1, 2, 4, 7, 11, 21]))
    speed = f"{10 ** random.uniform(-0.7, 1.8):.6g} rpm"
    wave = {
        "order": int(random.choice([6, 12, 24, 84, 2 * pole_pairs])),
        "torque": f"{10 ** random.uniform(-4.3, -2):.6g} N*m",
    }
    return changed(
        gimbal,
        {
            "motor.pole_pairs": pole_pairs,
            "motor.cogging": [wave],
            "drive.position_sensor.bits": int(random.integers(10, 17)),
            "drive.rates.speed_loop": str(random.choice(["1 kHz", "2 kHz", "4 kHz"])),
            "mechanics.inertia": f"{10 ** random.uniform(-5.3, -3.3):.6g} kg*m^2",
            "scenario.slow.reference": speed,
            "scenario.slow.initial_speed": speed,
        },
    )


def ripple(study: Study) -> float:
    """RMS of the speed's error in the second half of the run, rad/s."""
    trace = simulate(study, "slow", "pi").trace
    error = (trace["omega_m"] - trace["omega_ref"])[len(trace) // 2 :]
    return float(np.sqrt(np.mean(error**2)))


def ratios(study: Study) -> tuple[float, float] | None:
    """Ripple with the slower feedback over that without it, predicted and simulated; None: no case."""
    before = warnings._edges(study, "pi", "slow")
    if before is None or before.enough or warnings._snapping(study, "pi", "slow"):
        return None
    change = slower_feedback(study, "pi", warnings.SPEED_RESERVE * before.factor)
    slower = changed(study, change or {})
    after = warnings._edges(slower, "pi", "slow")
    if after is None or warnings._snapping(slower, "pi", "slow"):
        return None
    return after.ripple / before.ripple, ripple(slower) / ripple(study)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=30)
    parser.add_argument("--seed", type=int, default=5)
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gimbal.toml"
        path.write_text(GIMBAL, encoding="utf-8")
        gimbal = load(path)
        assert isinstance(gimbal, Study)
        cases: list[tuple[float, float]] = []
        while len(cases) < arguments.cases:
            case = _ratios_or_none(gimbal, random)
            cases += [case] if case else []
    for predicted, simulated in sorted(cases):
        advised = "advised" if predicted <= warnings.LESS_BY_FEEDBACK else ""
        print(f"{predicted:5.2f} {simulated:5.2f}  {advised}")
    print(f"simulated over predicted, at most: {max(b / a for a, b in cases if a > 0.2):.2f} above 0.2")


def _ratios_or_none(gimbal: Study, random: np.random.Generator) -> tuple[float, float] | None:
    try:
        return ratios(drawn(gimbal, random))
    except StudyError:  # such as an inertia for which no gains have this phase margin
        return None


if __name__ == "__main__":
    main()
