"""`diagnose` names the fault, and its size, in logs of a plant apart from the engine with one fault each."""

from __future__ import annotations

import gzip
import math
import shutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest
from identify import bench
from identify.commissioned import write

from cogless.identify import diagnosis, plan
from cogless.identify.advice import advice_of
from cogless.identify.diagnosis import Diagnosis
from cogless.identify.waves import standing_waves

Logs = dict[str, dict[str, np.ndarray]]


def diagnosed(logs: Logs, tables: Mapping[str, Any] | None = None) -> Diagnosis:
    folder = Path(mkdtemp())
    paths = write(folder, plan.to_toml(dict(tables or bench.columns())), logs)
    return diagnosis.diagnosed(paths, folder / "id.toml", lambda what, share: None)


def of_case(case: str, *names: str) -> Logs:
    logs = bench.logs()[case]
    return {name: logs[name] for name in names or logs}


@cache
def whole(case: str) -> Diagnosis:
    logs = of_case(case)
    if case == "offset":
        logs = {**logs, "off": bench.phase_offsets(case)}
    return diagnosed(logs, bench.columns(bench.CASES[case].counts))


def shares(made: Diagnosis) -> dict[str, float]:
    """Share of each cause in the square of all logs' ripple."""
    squares = {log: size**2 for log, size in made.whole.items()}
    names = {name for log in made.whole for name in made.causes(log)}
    every = {name: sum(made.causes(log).get(name, 0.0) * x for log, x in squares.items()) for name in names}
    return {name: value / sum(squares.values()) for name, value in every.items()}


@pytest.mark.parametrize(
    ("case", "cause", "orders"),
    [
        ("cogging", "cogging", {30, 18}),
        ("neighbours", "cogging", {9, 10}),
        ("encoder", "encoder", {1, 2}),
        ("encoder 2p", "encoder", {10}),
        ("offset", "current offset", {5}),
        ("gain", "current gain", {10}),
        ("dead time", "dead time", {30}),
    ],
)
def test_the_only_cause_has_nine_tenths_of_the_ripple_or_more(
    case: str, cause: str, orders: set[int]
) -> None:
    """Other causes are higher orders of the same fault, noise, or not named."""
    made = whole(case)
    assert diagnosis.answer(made).startswith(f"Most of the ripple is {cause}: ")
    told = shares(made)
    assert told[cause] > 0.9
    assert sum(told.values()) == pytest.approx(1, abs=0.02)
    assert sum(share for name, share in told.items() if name != cause and " or " not in name) < 0.05
    large = {each.order for each in made.orders if each.share > 0.2}
    assert large == orders
    assert {each.confidence for each in made.orders if each.share > 0.2} == {"sure"}


@pytest.mark.parametrize("case", ["cogging", "neighbours", "encoder", "encoder 2p", "offset", "gain"])
@pytest.mark.parametrize("log", ["slow", "fast", "odd", "drives"])
def test_the_ripple_is_the_rotor_s_own(case: str, log: str) -> None:
    """The speed comes from the angle's counts, with more noise, and the encoder has an error."""
    made, signals = whole(case), bench.logs()[case][log]
    # the slow log has one whole turn in each direction
    turns = [slice(1000, 3000), slice(5600, 7600)] if log == "slow" else [slice(500, None)]
    true, logged = (
        math.sqrt(np.mean([np.var(signals[name][rows]) for rows in turns]))
        for name in ("true_omega", "omega")
    )
    if true > 0.02:
        assert made.motion(f"{log}.npz") == pytest.approx(true, rel=0.05)
    noise = 1 - (made.whole[f"{log}.npz"] / logged) ** 2
    assert made.noise(f"{log}.npz") == pytest.approx(max(0.0, noise), abs=0.051)


def test_neighbouring_orders_have_a_half_of_the_ripple() -> None:
    """Both torques are equal. The expected waves are least squares on the plant's true speed."""
    made, signals = whole("neighbours"), bench.logs()["neighbours"]["drives"]
    found = {each.order: each for each in made.orders_of("drives.npz")}
    theta, omega = signals["theta"][1000:], signals["true_omega"][1000:]
    waves = np.exp(1j * np.outer(theta, (9, 10)))
    columns = np.hstack([waves.real, waves.imag, np.ones((len(theta), 1))])
    true = np.linalg.lstsq(columns, omega, rcond=None)[0]
    for k, order in enumerate((9, 10)):
        assert found[order].ripple == pytest.approx(math.hypot(true[k], true[2 + k]) / math.sqrt(2), rel=0.02)
        assert found[order].share == pytest.approx(0.5, abs=0.03)


def test_an_error_of_order_2p_is_no_torque_and_no_slipped_index() -> None:
    made = whole("encoder 2p")
    assert not any("index" in line or "cannot be told apart" in line for line in made.remarks)
    for each in made.orders:
        if each.share < 0.01:
            continue
        (cause, *_) = each.causes
        assert (each.order, cause.name) == (10, "encoder") and cause.error < 0.1


def test_one_speed_does_not_tell_an_error_of_order_2p_and_says_so() -> None:
    """The advised logs, a second speed and an acceleration, decide."""
    made = diagnosed(of_case("encoder 2p", "fast"))
    (each,) = [each for each in made.orders if each.share > 0.1]
    assert each.causes[0].name == "cogging or current gain or encoder"
    assert each.confidence == "cannot be told apart"
    (said,) = [
        line for line in advice_of(made.remarks) if line.startswith("Order 10: from one speed, an error")
    ]
    assert said.cures == ({"record.kind": ("constant-speed", "acceleration")},)
    again = diagnosed(of_case("encoder 2p", "fast", "drives", "sweep", "slow"))
    assert not any("from one speed, an error" in line for line in again.remarks)
    assert {each.causes[0].name for each in again.orders if each.share > 0.1} == {"encoder"}


@pytest.mark.parametrize(("log", "cause"), [
    ("odd", "too fast for the rows"),  # order 90 is shown as 11.26, which is no order
    ("drives", "cogging or current gain or encoder or too fast for the rows"),  # and here as order 10
])  # fmt: skip
def test_an_order_beyond_the_rows_is_not_called_absent(log: str, cause: str) -> None:
    """100 rows a second are too few for the cogging of slots and poles; the advised rate shows it."""
    every = 10
    seldom = {log: {key: x[::every] for key, x in bench.logs()["beyond"][log].items()}}
    made = diagnosed(seldom)
    verdict = (
        ", which cannot be told apart here" if " or " in cause else ", so the logs show it as a slower wave"
    )
    assert diagnosis.answer(made).startswith(f"Most of the ripple is {cause}{verdict}: ")
    assert made.causes(f"{log}.npz")[cause] > 0.9
    speed = bench.RUNS[log].points[0][1] / bench.TURN
    (said,) = [line for line in advice_of(made.remarks) if "cannot be seen" in line]
    assert f"its rows show orders up to {math.floor(100 / speed / 2)} at {speed:.3g} rev/s" in said
    assert "90 of this motor cannot be seen" in said and "absent" not in said
    rate = said.cures[0]["record.rate"]
    assert 1000 // math.ceil(rate) >= 2
    more = {log: {key: x[:: 1000 // math.ceil(rate)] for key, x in bench.logs()["beyond"][log].items()}}
    again = diagnosed(more)
    assert not any("cannot be seen: its wave" in line for line in again.remarks)
    (each,) = [each for each in again.orders if each.share > 0.5]
    assert each.order == 90
    slower = bench.steady(said.cures[1]["record.speed"] / bench.TURN, 6.0)
    (turned,) = bench.simulated([(bench.CASES["beyond"], slower)])
    slow = diagnosed({log: {key: x[::every] for key, x in turned.items()}})
    assert not any("cannot be seen: its wave" in line for line in slow.remarks)
    assert max(slow.orders, key=lambda found: found.share).order == 90
    assert again.whole[f"{log}.npz"] == pytest.approx(
        np.std(bench.logs()["beyond"][log]["true_omega"][500:]), rel=0.1
    )


def test_nothing_moves_that_is_only_counted() -> None:
    """A rotor at a steady speed: counts, folded by the rows, are no orders, at any speed and for any "
    "count."""
    for speed in (3.1, 6.2831853, 12.566, 25.13):
        for counts in (4096, 16_384, 1 << 18):
            step = 2 * math.pi / counts
            t = 1e-3 * np.arange(6000)
            theta = np.floor((speed * t + 0.01 * np.sin(1.3 * t)) / step) * step
            assert standing_waves(theta, 1e-3, step).orders == (), (speed, counts)


def test_an_eccentric_log_is_steady_and_every_log_has_its_line() -> None:
    """9.5 degrees at 2.1 rev/s: the measured speed is off by 16 %, the rotor's own is not."""
    t = 1e-3 * np.arange(4000)
    turned = 2.1 * bench.TURN * t
    theta = turned + math.radians(9.5) * np.sin(turned + 0.3)
    step = bench.TURN / bench.COUNTS
    eccentric = {"t": t, "theta": np.floor(theta / step) * step, "omega": np.gradient(theta, t)}
    logs = {**of_case("cogging"), "eccentric": eccentric, "off": bench.phase_offsets("cogging")}
    made = diagnosed(logs)
    assert {each.order for each in made.orders_of("eccentric.npz") if each.share > 0.1} == {1}
    assert set(made.whole) | set(made.uses) == {f"{name}.npz" for name in logs}
    assert set(made.uses) == {"sweep.npz", "off.npz"}
    printed = diagnosis.answer_lines(made)
    for name in logs:
        assert any(line.startswith((f"{name}.npz: ", f"{name}.npz (")) for line in printed)


DATA = next(
    (path for path in (up / "shared" / "data" for up in Path(__file__).parents) if path.is_dir()),
    Path("none"),
)
COLUMNS = """
[columns]
t = "t_s"
theta = "theta_rad"
omega = "omega_rad_s"
i_q = "iq_A"
part = { name = "comp_on", files = "speed*" }
[motor]
pole_pairs = 12
slots = 18
R_s = "0.53 ohm"
L_d = "210 uH"
L_q = "210 uH"
kv = "300 rpm/V"
[drive]
rates = { current_loop = "40 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "1 kHz", current_limit = "4 A" }
inverter = { bus_voltage = "24 V" }
position_sensor = { kind = "encoder", lines = 5000, speed_method = "M" }
[[log]]
file = "*#1"
kind = "table-on"
"""


@pytest.mark.skipif(not DATA.is_dir(), reason="the public logs are not beside this clone")
def test_a_real_motor_of_18_slots_and_24_poles_has_multiples_of_6_alone() -> None:
    """Its cogging can have no other: the greatest common divisor of slots and poles. 72 is the largest."""
    folder = Path(mkdtemp())
    with gzip.open(DATA / "real_logs" / "laas_acc_current.csv.gz", "rt") as file:
        table = np.genfromtxt(file, delimiter=",", names=True)
    names = {"t_s": "Time", "theta_rad": "Position", "omega_rad_s": "Velocity", "iq_A": "Iq"}
    np.savez(folder / "acceleration.npz", **{to: table[name] for to, name in names.items()})
    shutil.copy(DATA / "laas_anti_cogging" / "speed_test1_500Hz.csv.gz", folder / "speed.csv.gz")
    (folder / "id.toml").write_text(COLUMNS)
    logs = [folder / "acceleration.npz", folder / "speed.csv.gz"]
    made = diagnosis.diagnosed(logs, folder / "id.toml", lambda what, share: None)
    for part in ("speed.csv.gz#0", "speed.csv.gz#1"):
        orders = [each.order for each in made.orders_of(part) if each.share > 0.01]
        assert orders[0] == 72
        assert {order % 6 for order in orders} == {0}, (part, orders)
    assert {each.order for each in made.orders_of("speed.csv.gz#0") if each.share > 0.01} >= {72, 144, 36}
