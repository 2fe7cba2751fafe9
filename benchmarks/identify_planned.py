"""How exact `cogless identify` is on planned logs of motors drawn at random, simulated by cogless.

    python benchmarks/identify_planned.py [MOTORS] [SEED]

The drives have errors that no user enters: offsets and gain errors of the current sensors, dead time, an
eccentric encoder, currents that are logged late. The output has a line for each motor, with each value beyond
its bound or its interval. Then it has for each kind of value the largest deviation, how many are within the
bound, and how many intervals at 95 % hold the truth. A value that is left out counts as a miss; if a motor is
refused, all its values do. 20 motors have more than 200 values, and take some minutes.
"""

from __future__ import annotations

import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cogless import units
from cogless.errors import StudyError
from cogless.identify import plan
from cogless.identify.command import identified
from cogless.identify.result import Estimate, Value, Wave
from cogless.results.trace import Trace
from cogless.run.simulate import rollout
from cogless.study import Study, load
from cogless.study.drive import Drive
from cogless.study.motor import StarMotor

Random = np.random.Generator
KINDS = {  # pole pairs, R_s, L, K_t, J, friction as a share of the limit's torque, current limit, counts
    "gimbal": (7, 5.0, 2e-3, 0.08, 8e-5, 0.02, 3.0, 16_384),
    "servo": (4, 0.8, 2e-3, 0.3, 5e-4, 0.01, 10.0, 10_000),
    "drone": (12, 0.53, 2.1e-4, 0.0276, 6e-6, 0.013, 4.0, 4_096),
    "hub": (15, 0.2, 4e-4, 0.5, 6e-3, 0.01, 20.0, 8_192),
    "fine": (10, 1.5, 1e-3, 0.12, 1e-4, 0.02, 5.0, 2**18),
    "stepper": (50, 1.5, 3e-3, 0.3, 6e-6, 0.02, 2.0, 65_536),
}
RATE = 10_000  # Hz, rate of the simulated logs; the plan says how many of these rows are logged
LATEST = 20  # most rows, at RATE, by which currents are logged late
BOUNDS = {
    "inertia": 0.01,
    "Coulomb": 0.01,
    "viscous": 0.05,
    "delay (s)": 5e-5,
    "cogging": 0.03,
    "phase (rad)": math.radians(2),
    "K_t ripple": 0.05,
    "encoder": 0.05,
    "load": 0.02,
}


def drawn(kind: str, random: Random) -> dict[str, Any]:
    """Tables of a study of a random motor of a kind."""
    poles, r, inductance, k_t, inertia, share, limit, counts = KINDS[kind]

    def about(value: float, spread: float = 0.5) -> float:
        return value * math.exp(random.uniform(-spread, spread))

    k_t, inertia = about(k_t, 0.2), about(inertia)
    friction = about(share) * k_t * limit
    orders = [
        6 * poles,
        *sorted(random.choice([n for n in range(6, 8 * poles) if n % poles], 2, replace=False).tolist()),
    ]
    if kind == "stepper":
        orders = [4 * poles, 2 * poles, 7]
    gains = random.uniform(-0.01, 0.01, 3)
    gains -= gains.mean()  # their mean acts like a wrong K_t, which no log of currents shows
    sensors = {
        "noise": f"{2e-3 * limit:.3g} A",
        "bits": 12,
        "range": f"{2 * limit} A",
        "offset": [f"{x:.4g} A" for x in 2e-3 * limit * random.standard_normal(3)],
        "gain_error": [round(x, 5) for x in gains.tolist()],
    }
    cogging = [
        {
            "order": int(order),
            "torque": f"{friction * size * random.uniform(0.6, 1.4):.5g} N*m",
            "phase": f"{random.uniform(-180, 180):.1f} deg",
        }
        for order, size in zip(orders, (1.5, 0.6, 0.3), strict=True)
    ]
    psi_f = k_t / (1.5 * poles)
    ripple = {
        "order": 6,
        "d": f"{psi_f * random.uniform(0.01, 0.03):.5g} Wb",
        "d_phase": f"{random.uniform(-180, 180):.1f} deg",
    }
    return {
        "title": kind,
        "motor": {
            "pole_pairs": poles,
            "R_s": f"{r} ohm",
            "L_d": f"{inductance} H",
            "L_q": f"{inductance} H",
            "K_t": f"{k_t:.6g} N*m/A",
            "cogging": cogging,
            "flux_harmonics": [ripple],
        },
        "mechanics": {
            "inertia": f"{inertia:.5g} kg*m^2",
            "coulomb_friction": f"{friction:.5g} N*m",
            "viscous_friction": f"{friction / 60 * random.uniform(0.5, 1.5):.5g} N*m*s/rad",
        },
        "drive": {
            "rates": {"current_loop": "10 kHz", "speed_loop": "1 kHz"},
            "current_loop": {"bandwidth": "500 Hz", "current_limit": f"{limit} A"},
            "inverter": {"bus_voltage": "48 V", "dead_time": f"{random.choice([0, 100, 300])} ns"},
            "position_sensor": {
                "kind": "encoder",
                "lines": counts // 4,
                "speed_method": "M",
                "eccentricity": f"{random.uniform(0.05, 0.3):.4f} deg",
                "eccentricity_phase": f"{random.uniform(-180, 180):.1f} deg",
            },
            "current_sensors": sensors,
        },
        "scenario": {"one": {"duration": "1 s", "reference": "1 rev/s"}},
        "controller": {"pi": {"law": "pi", "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}}},
        "metric": [{"name": "speed_ripple", "kind": "ripple-rms", "signal": "omega_m"}],
    }


def typed_in(tables: dict[str, Any]) -> dict[str, Any]:
    """The study as far as its user knows it: no errors of sensors, no dead time."""
    drive = {**tables["drive"], "inverter": {"bus_voltage": "48 V"}}
    sensor = drive["position_sensor"]
    drive["position_sensor"] = {key: x for key, x in sensor.items() if not key.startswith("ecc")}
    drive["current_sensors"] = {
        key: x for key, x in drive["current_sensors"].items() if key not in ("offset", "gain_error")
    }
    return {**tables, "drive": drive}


LOGGED = ("time", "theta_measured", "omega_measured", "i_q", "i_d")


def logged(trace: Trace, star: StarMotor, drive: Drive, late: int, every: int) -> dict[str, Any]:
    """The drive's log: of each `every` rows one, with angle, speed and currents that are `late` rows late."""
    theta = trace["theta_measured"]
    sensors = drive.current_sensors
    park = [star.pole_pairs * theta - third * 2 * math.pi / 3 for third in range(3)]
    phases = [
        (1 + gain) * trace[name] + offset
        for name, gain, offset in zip(("i_a", "i_b", "i_c"), sensors.gain_error, sensors.offset, strict=True)
    ]
    found = {
        "i_q": -2 / 3 * sum(i * np.sin(x) for i, x in zip(phases, park, strict=True)),
        "i_d": 2 / 3 * sum(i * np.cos(x) for i, x in zip(phases, park, strict=True)),
    }
    count = len(trace) - LATEST
    return {
        "time": trace["time"][LATEST : LATEST + count : every],
        "theta_measured": theta[LATEST : LATEST + count : every],
        "omega_measured": trace["omega_measured"][LATEST : LATEST + count : every],
        **{name: x[LATEST - late : LATEST - late + count : every] for name, x in found.items()},
    }


Compared = list[tuple[str, str, float, float]]  # kind, what, deviation from the truth, over the stated error


@dataclass(frozen=True)
class Recorded:
    """A motor and its planned logs. `late`: rows of RATE by which their currents are late."""

    truth: Study
    eccentricity: tuple[float, float]  # rad, and its phase
    logs: tuple[Path, ...]
    columns: Path
    late: int


def recorded(tables: dict[str, Any], folder: Path, random: Random) -> Recorded:
    """Simulate the planned logs of the motor of these tables."""
    (folder / "motor.toml").write_text(plan.to_toml(tables), encoding="utf-8")
    truth = load(folder / "motor.toml")
    assert isinstance(truth, Study)
    play, _ = plan.tables(truth)
    every = round(RATE / units.parse(play["trace"]["rate"], units.FREQUENCY))
    (folder / "study.toml").write_text(
        plan.to_toml({**play, "trace": {"rate": f"{RATE} Hz"}}), encoding="utf-8"
    )
    (folder / "known.toml").write_text(plan.to_toml(typed_in(tables)), encoding="utf-8")
    _, columns = plan.tables(load(folder / "known.toml"))
    columns["columns"] = {signal: name for signal, name in columns["columns"].items() if name in LOGGED}
    columns["log"] = [{**rule, "file": f"{rule['file']}.npz"} for rule in columns["log"]]
    (folder / "id.toml").write_text(plan.to_toml(columns), encoding="utf-8")
    (results,) = rollout([load(folder / "study.toml")], jobs=1)
    late, star = int(random.integers(0, LATEST)), truth.motor.star()
    paths = []
    for run in results.runs:
        paths.append(folder / f"{run.scenario}.npz")
        np.savez(paths[-1], **logged(run.trace, star, truth.drive, late, every))
    sensor = tables["drive"]["position_sensor"]
    size, phase = (
        math.radians(float(sensor[key].split()[0])) for key in ("eccentricity", "eccentricity_phase")
    )
    return Recorded(truth, (size, phase), tuple(paths), folder / "id.toml", late)


def compared(of: Recorded, made: Estimate) -> tuple[Compared, list[str]]:
    """Every value compared with the truth; and lines on orders that are not found, and identify's remarks."""
    truth, late, star = of.truth, of.late, of.truth.motor.star()
    found: Compared = []
    said: list[str] = []

    def add(kind: str, name: str, got: Value, true: float) -> None:
        found.append((kind, name, (got.value - true) / (abs(true) or 1.0), (got.value - true) / got.error))

    mechanics, known_K_t = truth.mechanics, made.K_t
    for key, kind, true in (
        ("j", "inertia", mechanics.inertia),
        ("c", "Coulomb", mechanics.coulomb_friction),
        ("b", "viscous", mechanics.viscous_friction),
    ):
        if key in made.values:
            add(kind, "", made.values[key].times(known_K_t), true)
    if "delay" in made.values:
        value, true = made.values["delay"], late / RATE
        found.append(("delay (s)", "", value.value - true, (value.value - true) / value.error))

    def wave(kind: str, got: Wave, factor: float, size: float, phase: float) -> None:
        add(kind, f"order {got.order}", got.size.times(factor), size)
        turn = (got.phase.value - phase + math.pi) % (2 * math.pi) - math.pi
        found.append(("phase (rad)", f"{kind}, order {got.order}", turn, turn / got.phase.error))

    cogging = {c.order: c for c in star.cogging}
    largest = max(abs(c.torque or 0.0) for c in star.cogging)
    for got in made.cogging:
        true_wave = cogging.pop(got.order, None)
        if true_wave is not None:
            wave("cogging", got, known_K_t, true_wave.torque or 0.0, true_wave.phase)
        elif got.size.value * known_K_t > 0.05 * largest:
            found.append(("cogging", f"order {got.order}, which is not there", math.inf, math.inf))
    said += [f"cogging of order {order} is not found" for order in cogging]
    for got in made.ripple:
        if got.order == 6 * star.pole_pairs:
            harmonic = star.flux_harmonics[0]
            wave("K_t ripple", got, 1.0, harmonic.d / star.psi_f, harmonic.d_phase + math.pi / 2)
        elif got.order != 2 * star.pole_pairs:  # gain errors give this order
            found.append(("K_t ripple", f"order {got.order}, which is not there", math.inf, math.inf))
    for got in made.encoder:
        if got.order == 1:
            wave("encoder", got, 1.0, *of.eccentricity)
        else:
            found.append(("encoder", f"order {got.order}, which is not there", math.inf, math.inf))
    said += [*made.left_out, *made.remarks]
    return found, said


def wanted(of: Recorded) -> list[tuple[str, str]]:
    """Kind and name of all values that a motor's logs should give."""
    star = of.truth.motor.star()
    waves = [
        *(("cogging", cogging.order) for cogging in star.cogging),
        ("K_t ripple", 6 * star.pole_pairs),
        ("encoder", 1),
    ]
    single = [(kind, "") for kind in ("inertia", "Coulomb", "viscous", "delay (s)")]
    sizes = [(kind, f"order {order}") for kind, order in waves]
    return [*single, *sizes, *(("phase (rad)", f"{kind}, order {order}") for kind, order in waves)]


def main() -> None:
    numbers = [int(text) for text in sys.argv[1:]]
    count, seed = (numbers + [20, 0][len(numbers) :])[:2]
    random = np.random.default_rng(seed)
    everything: Compared = []
    missed: list[str] = []
    for n in range(count):
        kind = list(KINDS)[n % len(KINDS)]
        with tempfile.TemporaryDirectory() as folder:
            of = recorded(drawn(kind, random), Path(folder), random)
            try:
                made = identified(of.logs, of.columns, lambda what, share: None).estimate
                found, said = compared(of, made)
            except StudyError as error:
                found, said = [], str(error).splitlines()
        everything += found
        out = [each for each in wanted(of) if each not in {(what, name) for what, name, *_ in found}]
        missed += [what for what, _ in out]
        print(f"{n + 1} {kind}: {len(found)} values, {len(out)} left out")
        for what, name, off, z in found:
            if abs(off) > BOUNDS[what] or abs(z) > 1:
                print(f"  {what} {name}: off by {off:.3g} of {BOUNDS[what]:.3g}, {z:.2f} of its error")
        print("".join(f"  ! {line}\n" for line in said), end="", flush=True)
    for what in dict.fromkeys([*(what for what, *_ in everything), *missed]):
        told = [(off, z) for of, _, off, z in everything if of == what]
        within = sum(abs(off) <= BOUNDS[what] for off, _ in told)
        print(
            f"{what:12} {len(told):4} told of {len(told) + missed.count(what)}, {within} within "
            f"{BOUNDS[what]:.2g}, off by at most {max((abs(off) for off, _ in told), default=0):.2g}, "
            f"{sum(abs(z) <= 1 for _, z in told)} in the interval"
        )
    inside = sum(abs(z) <= 1 for *_, z in everything)
    print(
        f"{len(everything)} values of {len(everything) + len(missed)}, {inside} in their intervals: "
        f"{100 * inside / max(1, len(everything)):.1f} %"
    )


if __name__ == "__main__":
    main()
