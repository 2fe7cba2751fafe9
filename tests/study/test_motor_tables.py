"""Cogging and back-EMF from tables, against the harmonics that they were made of: sign, frame, unit."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import studies
from cogless.run.drive_config import engine_config
from cogless.run.simulate import simulate
from cogless.study.motor import Motor, StarMotor

WINDING = {"pole_pairs": 4, "R_s": "1 ohm", "L_d": "1 mH", "L_q": "1 mH"}
COGGING = [(24, 4e-3, 0.3), (72, 1e-3, -1.0), (9, 5e-4, 2.0)]  # order, N*m, rad
POINTS = 720
TORQUE = "angle [deg],torque [mN*m]"
Angles = np.ndarray


def table(
    folder: Path, of: Callable[[Angles], Angles], heading: str = TORQUE, scale: float = 1e3
) -> dict[str, Any]:
    angle = np.arange(POINTS) * 360 / POINTS
    value = scale * of(np.radians(angle))
    rows = [f"{a!r},{v!r}" for a, v in zip(angle.tolist(), value.tolist(), strict=True)]
    (folder / "table.csv").write_text("\n".join([heading, *rows]), encoding="utf-8")
    return {"file": str(folder / "table.csv"), "frame": "mechanical"}


def cogging(theta: Angles) -> Angles:
    return np.asarray(sum(T * np.sin(n * theta + phase) for n, T, phase in COGGING))


def star(table_: dict[str, Any], key: str = "cogging_table", **keys: Any) -> StarMotor:
    magnet = {} if key == "back_emf_table" else {"K_t": "0.5 N*m/A"}
    return Motor.model_validate({**WINDING, **magnet, key: table_, **keys}).star()


def torque_of(motor: StarMotor, theta: Angles) -> Angles:
    return np.asarray(sum((c.torque or 0.0) * np.sin(c.order * theta + c.phase) for c in motor.cogging))


THETA = np.linspace(0, 2 * math.pi, 997)


def test_a_cogging_table_is_the_harmonics_that_it_was_made_of(tmp_path: Path) -> None:
    motor = star({**table(tmp_path, cogging), "sign": "on-rotor", "peak_to_peak": "10.2 mN*m"})
    assert {c.order for c in motor.cogging} == {24, 72, 9}
    assert torque_of(motor, THETA) == pytest.approx(cogging(THETA), abs=1e-15)


@pytest.mark.parametrize(("share", "orders"), [(0.0199, [24]), (0.0202, [24, 72])])
def test_waves_of_less_than_two_percent_are_left_out(tmp_path: Path, share: float, orders: list[int]) -> None:
    def cogs(theta: Angles) -> Angles:
        return np.asarray(5e-3 * (np.sin(24 * theta) + share * np.sin(72 * theta)))

    given = {**table(tmp_path, cogs), "sign": "on-rotor"}
    assert [c.order for c in star(given).cogging] == orders
    named = star({**given, "orders": [72]})  # which says that the others are none of it
    assert [(c.order, c.torque) for c in named.cogging] == [(72, pytest.approx(5e-3 * share))]


def test_a_holding_current_is_the_opposite_torque_over_the_torque_constant(tmp_path: Path) -> None:
    of = table(tmp_path, lambda theta: -cogging(theta) / 0.5, "angle [deg],current [mA]")
    motor = star({**of, "sign": "holding"})
    assert torque_of(motor, THETA) == pytest.approx(cogging(THETA), abs=1e-15)


def test_a_table_over_an_electrical_revolution(tmp_path: Path) -> None:
    of = table(tmp_path, lambda theta_e: 3e-3 * np.sin(6 * theta_e + 0.1))
    motor = star({**of, "frame": "electrical", "sign": "on-rotor"})
    assert torque_of(motor, THETA) == pytest.approx(3e-3 * np.sin(24 * THETA + 0.1), abs=1e-15)


def test_named_orders_leave_the_rest_out(tmp_path: Path) -> None:
    motor = star({**table(tmp_path, cogging), "sign": "on-rotor", "orders": [24, 9]})
    assert [c.order for c in motor.cogging] == [9, 24]
    left = cogging(THETA) - torque_of(motor, THETA)
    assert left == pytest.approx(1e-3 * np.sin(72 * THETA - 1.0), abs=1e-15)


# One motor's flux linkage in its rotor's frame, by harmonics
PSI_F, FLUX = 0.05, [(6, 2e-3, 1e-3, 0.3, -0.2), (12, 5e-4, 3e-4, 0.0, 0.1), (3, 1e-3, 4e-4, -0.5, 0.7)]


def linkage(theta_e: Angles) -> np.ndarray:
    """Flux linkage of the magnets in phase a."""
    psi_d = PSI_F + sum(d * np.cos(h * theta_e + phase) for h, d, _, phase, _ in FLUX)
    psi_q = sum(q * np.sin(h * theta_e + phase) for h, _, q, _, phase in FLUX)
    return np.asarray(np.cos(theta_e) * psi_d - np.sin(theta_e) * psi_q)


def phase_voltage(theta_e: Angles, speed: float = 10.0) -> Angles:
    """Back-EMF of phase a by central differences of the linkage."""
    h = 1e-4
    near, far = (linkage(theta_e + k * h) - linkage(theta_e - k * h) for k in (1, 2))
    return np.asarray(4 * speed * (8 * near - far) / (12 * h))


def flux_of(motor: StarMotor, theta_e: Angles) -> tuple[Angles, Angles]:
    psi_d = motor.psi_f + sum(f.d * np.cos(f.order * theta_e + f.d_phase) for f in motor.flux_harmonics)
    psi_q = sum(f.q * np.sin(f.order * theta_e + f.q_phase) for f in motor.flux_harmonics)
    return np.asarray(psi_d), np.asarray(psi_q)


EMF = {"frame": "electrical", "speed": "10 rad/s"}
VOLTS = ("angle [deg],voltage [V]", 1.0)


@pytest.mark.parametrize("between", ["phase", "line-to-line"])
@pytest.mark.parametrize("shift", [0.0, 1.1])
def test_a_back_emf_table_is_the_flux_that_it_was_made_of(tmp_path: Path, between: str, shift: float) -> None:
    """Wherever the table's angle begins. The linkage has orders 5 and 7, 11 and 13, 2 and 4 in phase a."""

    def voltage(angle: Angles) -> Angles:
        a = phase_voltage(angle + shift)
        triplen = 0.5 * np.sin(3 * angle)  # alike in all phases
        return a + triplen if between == "phase" else a - phase_voltage(angle + shift - 2 * np.pi / 3)

    motor = star({**table(tmp_path, voltage, *VOLTS), **EMF, "between": between}, "back_emf_table")
    expected = (
        PSI_F + sum(d * np.cos(h * THETA + phase) for h, d, _, phase, _ in FLUX),
        sum(q * np.sin(h * THETA + phase) for h, _, q, _, phase in FLUX),
    )
    assert motor.psi_f == pytest.approx(PSI_F, rel=1e-9)
    left_out = 0.02 * phase_voltage(THETA).std() / 40 * math.sqrt(2)
    for found, wanted in zip(flux_of(motor, THETA), expected, strict=True):
        assert found == pytest.approx(wanted, abs=left_out)
    every = {**table(tmp_path, voltage, *VOLTS), **EMF, "between": between, "orders": [2, 4, 5, 7, 11, 13]}
    for found, wanted in zip(flux_of(star(every, "back_emf_table"), THETA), expected, strict=True):
        assert found == pytest.approx(wanted, abs=1e-10)


def test_a_back_emf_table_over_a_mechanical_revolution(tmp_path: Path) -> None:
    """What differs between the pole pairs is left out."""

    def voltage(theta: Angles) -> Angles:
        return np.asarray(phase_voltage(4 * theta) + 1e-3 * np.sin(theta))

    of = table(tmp_path, voltage, *VOLTS)
    emf = {**of, **EMF, "frame": "mechanical", "between": "phase"}
    assert star(emf, "back_emf_table").psi_f == pytest.approx(PSI_F, rel=1e-9)


def test_tables_in_a_study(tmp_path: Path) -> None:
    """A table and the same harmonics give the same run; a motor's own file is beside it."""
    table(tmp_path, cogging)
    sheet = studies.BASE.partition("[motor]")[2].partition("[mechanics]")[0].partition("cogging")[0]
    (tmp_path / "motors").mkdir()
    (tmp_path / "table.csv").rename(tmp_path / "motors" / "table.csv")
    measured = '[cogging_table]\nfile = "table.csv"\nframe = "mechanical"\nsign = "on-rotor"\n'
    (tmp_path / "motors" / "m.toml").write_text(sheet + measured, encoding="utf-8")
    before, after = studies.BASE.partition("[motor]")[0], studies.BASE.partition("[mechanics]")[2]
    text = f'{before}[motor]\ndatasheet = "motors/m.toml"\n[mechanics]{after}'
    one = studies.study(tmp_path, {}, text)
    harmonics = [{"order": n, "torque": f"{T!r} N*m", "phase": f"{p!r} rad"} for n, T, p in COGGING]
    other = studies.study(tmp_path, {"motor.cogging": harmonics})
    orders = [h["order"] for h in engine_config(one, "low", "pi")["motor"]["cogging"]]
    assert orders == [9, 24, 72]
    x, y = (simulate(study, "low", "pi").trace for study in (one, other))
    assert x["tau_cogging"] == pytest.approx(y["tau_cogging"], abs=1e-9)
    assert x["omega_m"] == pytest.approx(y["omega_m"], abs=1e-6)


NOISE = np.random.default_rng(1).normal(size=POINTS)


@pytest.mark.parametrize(
    ("key", "of", "keys", "line"),
    [
        ("cogging_table", cogging, {"sign": "on-rotor", "peak": "10.2 mN*m"},
            'peak: "10.2 mN*m": expected about 0.005242 N*m, as the table has; '
            "peak and peak to peak differ by a factor of 2"),
        ("cogging_table", cogging, {"sign": "on-rotor", "current_peak": "1 A"},
            'current_peak: "1 A": expected the key "peak" instead, since the table has a torque'),
        ("cogging_table", cogging, {}, 'sign: missing: expected one of "on-rotor", "holding"'),
        ("cogging_table", cogging, {"sign": "on-rotor", "orders": [400]},
            "orders: [400]: expected orders up to 359, half the points of the table"),
        ("cogging_table", lambda theta: cogging(theta) + 4e-3, {"sign": "on-rotor"},
            'file: "table.csv": expected a mean of zero, not 1.36 times the rms: '
            "perhaps the table contains friction or an offset"),
        ("cogging_table", lambda theta: 1e-3 * NOISE, {"sign": "on-rotor"},
            'file: "table.csv": expected a table of which 48 orders or fewer hold all but 2% of the rms; '
            'this one needs '),
        ("back_emf_table", phase_voltage, {"between": "phase", "speed": "10 rad/s"},
            'file: "table.csv": line 1: "angle [deg],torque [mN*m]": '
            'expected one column such as "voltage [V]"'),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(
    tmp_path: Path, key: str, of: Callable[[Angles], Angles], keys: dict[str, Any], line: str
) -> None:
    given = {**table(tmp_path, of), "file": "table.csv", **keys}
    told = studies.refusal(studies.study, tmp_path, {f"motor.{key}": given})
    assert told.startswith(f"study.toml: motor.{key}.{line}")


@pytest.mark.parametrize(
    ("of", "keys", "line"),
    [
        (lambda theta: np.sin(4 * theta) + 1, {}, "file: expected a mean of zero, not 1.41 times the rms"),
        (np.sin, {"orders": [400]}, "orders: expected orders up to 359, half the points"),
        (lambda theta: np.sin(8 * theta), {},
            "file: expected a fundamental (order 4) of more than 10% of the rms: perhaps pole_pairs or "
            "frame"),
        (lambda theta: np.sin(4 * theta), {"speed": "0 rad/s"}, "speed: expected a speed above zero"),
        (lambda theta: np.sin(4 * theta), {"peak": "2 V"},
            "peak: expected about 1 V, as the table has; peak"),
        (lambda theta: np.sin(4 * theta), {"peak_to_peak": "3 V"}, "peak_to_peak: expected about 2 V"),
        (np.zeros_like, {}, "file: expected a fundamental (order 4) of more than 10% of the rms"),
    ],
)  # fmt: skip
def test_a_back_emf_table_that_is_not_of_this_motor(
    tmp_path: Path, of: Callable[[Angles], Angles], keys: dict[str, Any], line: str
) -> None:
    """What only shows with the motor's pole pairs is told at the table's own keys, as all else."""
    given = {**table(tmp_path, of, *VOLTS), "between": "phase", "speed": "10 rad/s", **keys}
    told = studies.refusal(studies.study, tmp_path, {"motor.psi_f": None, "motor.back_emf_table": given})
    key, _, expected = line.partition(": ")
    assert told.startswith(f"study.toml: motor.back_emf_table.{key}: ") and expected in told


@pytest.mark.parametrize(("share", "fine"), [(0.102, True), (0.1, False)])
def test_a_tenth_of_a_back_emf_table_is_the_fundamental_at_least(
    tmp_path: Path, share: float, fine: bool
) -> None:
    """Its amplitude beside that of order 5: a tenth of both together is 0.1005 of the other."""
    of = table(tmp_path, lambda theta: share * np.sin(4 * theta) + np.sin(20 * theta), *VOLTS)
    emf = {**of, "between": "phase", "speed": "1 rad/s"}
    if fine:
        assert star(emf, "back_emf_table").psi_f == pytest.approx(share / 4)
    else:
        with pytest.raises(ValueError, match=r"expected a fundamental \(order 4\)"):
            star(emf, "back_emf_table")


@pytest.mark.parametrize(("share", "fine"), [(-0.099, True), (0.099, True), (0.101, False)])
def test_the_mean_of_a_cogging_table_may_be_a_tenth_of_its_rms(
    tmp_path: Path, share: float, fine: bool
) -> None:
    of = table(tmp_path, lambda theta: np.sqrt(2) * np.sin(20 * theta) + share)
    if fine:
        assert [c.order for c in star({**of, "sign": "on-rotor"}).cogging] == [20]
    else:
        with pytest.raises(ValueError, match=r"expected a mean of zero, not 0\.101 times the rms"):
            star({**of, "sign": "on-rotor"})


@pytest.mark.parametrize(
    ("peak", "why"),
    [
        ("0.96 mN*m", None),
        ("1.04 mN*m", None),
        ("1.06 mN*m", ""),
        ("2.15 mN*m", "; peak and peak to peak differ by a factor of 2"),
        ("0.47 mN*m", "; peak and peak to peak differ by a factor of 2"),
        ("3 mN*m", ""),
    ],
)
def test_a_stated_peak_agrees_with_the_table_within_five_percent(
    tmp_path: Path, peak: str, why: str | None
) -> None:
    of = {**table(tmp_path, lambda theta: 1e-3 * np.sin(20 * theta)), "sign": "on-rotor"}
    if why is None:
        assert star({**of, "peak": peak}).cogging[0].torque == pytest.approx(1e-3)
    else:
        with pytest.raises(ValueError, match=rf"expected about 0\.001 N\*m, as the table has{why}(?!;)"):
            star({**of, "peak": peak})


def test_a_table_that_disagrees_with_the_torque_constant(tmp_path: Path) -> None:
    """The speed is given in electrical, not mechanical, or rms for peak: the factor is named."""
    of = table(tmp_path, lambda theta: phase_voltage(theta) / math.sqrt(2), *VOLTS)
    emf = {**of, **EMF, "between": "phase"}
    with pytest.raises(ValueError, match=r"within 5%; the values differ by sqrt\(2\), the factor between"):
        star(emf, "back_emf_table", K_t="0.3 N*m/A")
    assert star({**emf, "speed": "7.0711 rad/s"}, "back_emf_table", K_t="0.3 N*m/A").K_t == 0.3
