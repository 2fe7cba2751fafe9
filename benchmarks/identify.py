"""How right `cogless identify` is, on motors drawn at random and their planned logs.

    python benchmarks/identify.py [MOTORS]

Prints a line for each motor, the largest deviations by kind of value, and the share of values whose interval
at 95 % holds the truth. 20 motors have more than 200 values, and take some minutes.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from cogless.identify import plan
from cogless.identify.command import identified
from cogless.results.trace import write_netcdf
from cogless.run.simulate import rollout
from cogless.study import Study, load

Random = np.random.Generator
KINDS = {  # pole pairs, R_s, L, K_t, J, friction as a share of the limit's torque, current limit, counts
    "gimbal": (7, 5.0, 2e-3, 0.08, 8e-5, 0.02, 3.0, 16_384),
    "servo": (4, 0.8, 2e-3, 0.3, 5e-4, 0.01, 10.0, 10_000),
    "drone": (12, 0.53, 2.1e-4, 0.0276, 6e-6, 0.013, 4.0, 4_096),
    "hub": (15, 0.2, 4e-4, 0.5, 6e-3, 0.01, 20.0, 8_192),
    "fine": (10, 1.5, 1e-3, 0.12, 1e-4, 0.02, 5.0, 2**18),
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
            "inverter": {"bus_voltage": "48 V"},
            "position_sensor": {"kind": "encoder", "lines": counts // 4, "speed_method": "M"},
            "current_sensors": {"noise": f"{2e-3 * limit:.3g} A", "bits": 12, "range": f"{2 * limit} A"},
        },
        "scenario": {"one": {"duration": "1 s", "reference": "1 rev/s"}},
        "controller": {"pi": {"law": "pi", "tuning": {"rule": "phase-margin", "phase_margin": "60 deg"}}},
        "metric": [{"name": "speed_ripple", "kind": "ripple-rms", "signal": "omega_m"}],
    }


def compared(tables: dict[str, Any], folder: Path) -> list[tuple[str, float, float]]:
    """Kind of value, relative deviation from the truth, and deviation over the stated error at 95 %."""
    (folder / "motor.toml").write_text(plan.text(tables), encoding="utf-8")
    truth = load(folder / "motor.toml")
    assert isinstance(truth, Study)
    plan.write(truth, folder)
    (results,) = rollout([load(folder / "study.toml")], jobs=1)
    write_netcdf(folder / "traces.nc", results.runs)
    made = identified([folder / "traces.nc"], folder / "id.toml", lambda what, share: None).estimate
    found: list[tuple[str, float, float]] = []

    def add(kind: str, got: float, error: float, true: float) -> None:
        found.append((kind, (got - true) / (abs(true) or 1.0), (got - true) / error))

    star, mechanics = truth.motor.star(), truth.mechanics
    for key, kind, true in (
        ("j", "inertia", mechanics.inertia),
        ("c", "Coulomb", mechanics.coulomb_friction),
        ("b", "viscous", mechanics.viscous_friction),
    ):
        if key in made.values:
            value = made.values[key].times(made.K_t)
            add(kind, value.value, value.error, true)
    if "delay" in made.values:
        add("delay (s)", made.values["delay"].value, made.values["delay"].error, 0.0)
    waves = {wave.order: wave for wave in made.cogging}
    for cogging in star.cogging:
        wave = waves.get(cogging.order)
        if wave is not None:
            add("cogging", wave.size.value * made.K_t, wave.size.error * made.K_t, cogging.torque or 0.0)
            turn = (wave.phase.value - cogging.phase + math.pi) % (2 * math.pi) - math.pi
            found.append(("phase (rad)", turn, turn / wave.phase.error))
        else:
            print(f"  order {cogging.order} is left out: {'; '.join(made.left_out) or 'not found'}")
    for order in waves.keys() - {cogging.order for cogging in star.cogging}:
        print(f"  false order {order}")
    for wave in made.ripple:
        if wave.order == 6 * star.pole_pairs:
            add("K_t ripple", wave.size.value, wave.size.error, star.flux_harmonics[0].d / star.psi_f)
    return found


def main() -> None:
    count, random = int(sys.argv[1]) if len(sys.argv) > 1 else 20, np.random.default_rng(0)
    everything: list[tuple[str, float, float]] = []
    for n in range(count):
        kind = list(KINDS)[n % len(KINDS)]
        with tempfile.TemporaryDirectory() as folder:
            found = compared(drawn(kind, random), Path(folder))
        everything += found
        print(
            f"{n + 1:3} {kind:8}", *(f"{what} {100 * off:+.2f} %" for what, off, _ in found[:3]), flush=True
        )
    for what in dict.fromkeys(what for what, *_ in everything):
        offs, z = zip(*((off, z) for of, off, z in everything if of == what), strict=True)
        inside, worst = 100 * np.mean(np.abs(z) <= 1), max(map(abs, offs))
        print(f"{what:12} {len(offs):4} values, off by at most {worst:.2g}, {inside:.0f} % in the interval")
    inside = 100 * np.mean([abs(z) <= 1 for *_, z in everything])
    print(f"{len(everything)} values, {inside:.1f} % in their intervals")


if __name__ == "__main__":
    main()
