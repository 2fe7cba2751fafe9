"""Cogging, friction and inertia of a motor from two records, as motors/uomodri.toml got them.

    python examples/identify_cogging.py FOLDER

FOLDER holds the measurements of github.com/heitor-andrade/laas_anti_cogging (BSD-3-Clause) in two files:
static_holding_current.csv (theta_rad, iq_A, dir: the current that holds the rotor, over one revolution in
both directions) and speed_test1_500Hz.csv.gz (t_s, theta_rad, omega_rad_s, iq_A, comp_on).
"""

from __future__ import annotations

import argparse
import gzip
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cogless.results.metrics import order_amplitudes

ORDERS = (72, 18, 12, 144, 24, 36, 54, 90)  # of the mechanical revolution
Array = NDArray[np.float64]


def record(path: Path, names: set[str]) -> Array:
    """The rows of a CSV, which may be packed, as a structured array.

    ValueError: columns that are missing, or values that are no numbers. OSError: it can't be read.
    """
    with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as file:
        lines = file.read().splitlines()
    if not names <= {name.strip() for name in "".join(lines[:1]).split(",")}:
        raise ValueError(f"{path}: expected the columns {', '.join(sorted(names))}")
    data = np.atleast_1d(np.genfromtxt(lines, delimiter=",", names=True))
    if len(data) < 100 or not all(np.isfinite(data[name]).all() for name in names):
        raise ValueError(f"{path}: expected 100 or more rows of numbers")
    return data


def waves(theta: Array) -> Array:
    """Sine and cosine of every order, a column each."""
    return np.column_stack([wave(n * theta) for n in ORDERS for wave in (np.sin, np.cos)])


def holding_current(folder: Path) -> tuple[float, dict[int, tuple[float, float]]]:
    """Coulomb part [A], and amplitude [A] and phase [rad] of i = amplitude sin(order theta + phase) by order.

    Least squares over both directions. Cogging pushes the other way: its phase is half a turn further.
    """
    data = record(folder / "static_holding_current.csv", {"theta_rad", "iq_A", "dir"})
    columns = np.column_stack([np.ones(len(data)), data["dir"], waves(data["theta_rad"])])
    fit = np.linalg.lstsq(columns, data["iq_A"], rcond=None)[0]
    sines, cosines = fit[2::2], fit[3::2]
    shape = zip(np.hypot(sines, cosines), np.arctan2(cosines, sines), strict=True)
    return float(fit[1]), dict(zip(ORDERS, shape, strict=True))


def inertia_over_torque_constant(folder: Path, compensated: bool, rows: int) -> float:
    """J / K_t [A s^2/rad], from i_q = J / K_t d omega/dt + B / K_t omega + friction + cogging(theta).

    Integrated over windows of so many rows of 2 ms, so no speed need be differentiated; cogging is
    fitted along, since it differs from the holding current's while the rotor moves.
    """
    names = {"t_s", "theta_rad", "omega_rad_s", "iq_A", "comp_on"}
    data = record(folder / "speed_test1_500Hz.csv.gz", names)
    data = data[data["comp_on"] == compensated]
    t, theta, omega = data["t_s"], data["theta_rad"], data["omega_rad_s"]

    def change(x: Array) -> Array:
        return (x[rows:] - x[:-rows])[:: max(1, rows // 2)]

    def integral(x: Array) -> Array:
        return change(np.concatenate(([0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t)))))

    friction = np.tanh(omega / 0.2)  # the sign, without the noise at standstill
    columns = [change(omega), change(theta), integral(friction), *(integral(w) for w in waves(theta).T)]
    return float(np.linalg.lstsq(np.column_stack(columns), integral(data["iq_A"]), rcond=None)[0][0])


def logged_speed(folder: Path, compensated: bool) -> tuple[float, float, float]:
    """Mean, standard deviation and amplitude of order 72 of the logged speed, rad/s."""
    data = record(folder / "speed_test1_500Hz.csv.gz", {"theta_rad", "omega_rad_s", "comp_on"})
    data = data[data["comp_on"] == compensated]
    theta, omega = np.unwrap(data["theta_rad"]), data["omega_rad_s"]
    (amplitude,) = order_amplitudes(theta, omega, [72], 12, electrical=False)
    return float(np.mean(omega)), float(np.std(omega)), amplitude


def main() -> None:
    arguments = argparse.ArgumentParser(
        description="Cogging, friction and inertia of a motor from two records."
    )
    arguments.add_argument(
        "folder", type=Path, help="where static_holding_current.csv and speed_test1_500Hz.csv.gz are"
    )
    try:
        identify(arguments.parse_args().folder)
    except (OSError, EOFError, ValueError) as error:
        arguments.exit(2, f"{error}\n")


def identify(folder: Path) -> None:
    """Print what the records in this folder tell."""
    coulomb, shape = holding_current(folder)
    print(f"Coulomb friction {coulomb:.4f} A")
    for order, (amplitude, phase) in shape.items():
        turned = (np.degrees(phase) + 360.0) % 360.0 - 180.0
        print(f"cogging order {order:4d}: {amplitude:.4f} A, phase {turned:7.1f} deg")
    found = [
        inertia_over_torque_constant(folder, compensated, rows)
        for compensated in (False, True)
        for rows in (2, 3, 5, 8, 12, 20)
    ]
    print(f"J / K_t {np.median(found):.2e} A s^2/rad ({min(found):.2e} to {max(found):.2e})")
    for compensated in (False, True):
        mean, std, order_72 = logged_speed(folder, compensated)
        how = "with" if compensated else "without"
        print(f"speed {how} a table: mean {mean:.2f}, std {std:.2f}, order 72 {order_72:.2f} rad/s")


if __name__ == "__main__":
    main()
