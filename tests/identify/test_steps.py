"""Steps from filtered rows to causes, in closed form: what is taken out, errors, torques of an order."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.commissioned import MOTORS

from cogless.identify import causes, estimate, findings, voltage
from cogless.identify.causes import DEAD_TIME, ENCODER, GAIN, RIPPLE
from cogless.identify.config import LogRule
from cogless.identify.estimate import _taken_out, _without, whole, with_values
from cogless.identify.log import Log
from cogless.identify.orders import found_orders, gains
from cogless.identify.regression import Fit, _blocks, _noise, solved
from cogless.identify.result import Estimate, Value, wave_of
from cogless.identify.sessions import _own, sessions
from cogless.identify.steady import Steady
from cogless.identify.weak_form import Model, Name, Rows
from cogless.study.drive import Drive
from cogless.study.motor import Motor

MODEL = Model(
    cogging=(6, 24),
    ripple=(24,),
    encoder=(1, 2),
    columns=frozenset({"j", "b", "c", "offset", "delay"}),
    delay=1e-3,
    error={1: (0.01, 0.02)},
)


def fit_of(values: dict[Name, float], errors: float = 0.0, **more: Any) -> Fit:
    count = len(values)
    made = {"inflation": np.ones(count), "parts": np.zeros((0, count)), **more}
    numbers, own = np.array(list(values.values())), np.full(count, errors)
    return Fit(tuple(values), numbers, own, blocks=(), noise={}, without={}, **made)


# --- what is left out, and what is taken out


@pytest.mark.parametrize(
    ("name", "changed", "untold"),
    [
        (("j",), {"columns": {"b", "c", "offset", "delay"}}, set()),
        (("b",), {"columns": {"j", "c", "offset", "delay"}}, {("c", 0)}),
        (("offset",), {"columns": {"j", "b", "c", "delay"}}, {("c", 0)}),
        (("delay",), {"columns": {"j", "b", "c", "offset"}, "delay": 0.0}, {("j", 0)}),
        (("cogging", 6, "s"), {"cogging": (24,)}, {("j", 0), ("cogging", 6), ("cogging", 24)}),
        (("ripple", 24, "c"), {"ripple": ()}, {("cogging", 24)}),
        (("encoder", 1, "c"), {"encoder": (2,), "error": {}}, set()),
        (("encoder", 2, "c"), {"encoder": (1,)}, set()),
    ],
)
def test_what_takes_the_place_of_a_column_that_is_left_out_is_not_told(
    name: Name, changed: dict[str, Any], untold: set[tuple[str, int]]
) -> None:
    assert _without(replace(MODEL, untold=frozenset({("b", 0)})), name) == replace(
        MODEL, **changed, untold=frozenset({("b", 0), *untold})
    )


def found(j: float) -> Fit:
    return fit_of(
        {
            ("j",): j,
            ("delay",): 0.5e-3,
            **{("cogging", n, part): n / 100 for n in (6, 24) for part in "cs"},
            ("encoder", 1, "c"): 2e-4,
            ("encoder", 1, "s"): -4e-4,
            ("encoder", 2, "c"): 0.0,
            ("encoder", 2, "s"): 6e-4,
        }
    )


def test_delay_and_sensor_s_error_add_up_to_what_is_out_already() -> None:
    """The sensor's error shows as a torque, so it is divided by the inertia."""
    made = _taken_out(MODEL, found(2e-3))
    assert (made.delay, made.j) == (1.5e-3, 2e-3)
    assert made.error[1] == pytest.approx((0.01 + 0.1, 0.02 - 0.2)) and made.error[2] == pytest.approx(
        (0.0, 0.3)
    )
    assert made.waves == {6: (0.06, 0.06), 24: (0.24, 0.24)}
    none = _taken_out(MODEL, found(0.0))  # an inertia that is none tells no error
    assert (none.delay, none.error, none.waves) == (1.5e-3, MODEL.error, {})
    values = whole(MODEL, found(2e-3))
    assert values["delay",] == 1.5e-3 and values["cogging", 24, "s"] == 0.24
    assert [values["encoder", 1, part] for part in "cs"] == pytest.approx([0.11, -0.18])
    assert [values["encoder", 2, part] for part in "cs"] == pytest.approx([0.0, 0.3])


# --- errors


def test_what_a_loop_does_to_both_logs_is_in_no_error() -> None:
    """With the same blocks the differences of both logs count; else the errors of both add up."""
    rng = np.random.default_rng(0)
    common, own = rng.normal(size=(12, 1)), rng.normal(size=(12, 1))
    real = fit_of({("j",): 1.0}, 0.3, parts=common + own)
    error = real.beside(("j",), fit_of({("j",): 1.0}, parts=common))
    assert error == pytest.approx(math.sqrt(11 / 12 * np.sum((own - own.mean()) ** 2)))
    for other in (fit_of({("j",): 1.0}, parts=common[:7]), fit_of({("b",): 1.0}, parts=common)):
        assert real.beside(("j",), other) == pytest.approx(0.3 * math.sqrt(2))


@pytest.fixture
def rows() -> Rows:
    """A hundred rows of two columns, one with noise, and what they leave of y: 0.5 rms."""
    rng = np.random.default_rng(1)
    columns, left = rng.normal(size=(100, 2)), np.where(np.arange(100) % 2, 0.5, -0.5)
    y = columns @ [2.0, -1.0] + left
    noise = np.column_stack((np.full(100, 0.01), np.zeros(100)))
    log: Any = SimpleNamespace(name="a")
    return Rows(log, (("b",), ("j",)), columns, y, noise, np.zeros(100), np.zeros(100), np.arange(100.0))


def test_a_log_s_noise_is_what_its_fit_leaves(rows: Rows) -> None:
    names: tuple[Name, ...] = (("j",), ("c",), ("b",))
    blocks = _blocks(rows, names, 24)
    assert [block.rows for block in blocks] == [10] * 10  # of ten rows or more
    assert [block.rows for block in _blocks(rows, names, 3)] == [34, 33, 33]
    values = np.array([-1.0, 7.0, 2.0])  # of j, of c which is not there, and of b
    assert _noise(blocks, values) == pytest.approx(0.5)
    exact = replace(rows, y=rows.columns @ [2.0, -1.0], noise=0 * rows.noise)
    blocks = _blocks(exact, names, 24)
    assert solved(blocks, 3) == pytest.approx([-1.0, 0.0, 2.0])
    assert _noise(blocks, values) == pytest.approx(1e-6 * math.sqrt(np.mean(exact.y**2)), rel=1e-3)
    steps = sum(block.matrix for block in _blocks(rows, names, 24))[2, 2]
    assert steps == pytest.approx(
        np.sum(rows.columns[:, 0] ** 2) - 100 * 0.01
    )  # without the noise of its steps


@pytest.mark.parametrize(("count", "parts"), [(200, 12), (59, 11), (10, 2)])
def test_a_session_s_own_friction_is_what_its_rows_have_beyond_the_fit(count: int, parts: int) -> None:
    """Its error is twice the jackknife error of its rows' mean, with blocks of five rows or more."""
    log: Any = SimpleNamespace(name="a")
    noise = np.random.default_rng(2).normal(0, 0.1, count)
    ones = np.ones((count, 1))
    rows = Rows(log, (("c",),), ones, 0.7 + noise, 0 * ones, noise, noise, noise)
    made: Any = SimpleNamespace(fit=fit_of({("c",): 0.5, ("offset",): 0.1}))
    own = _own(made, [rows])
    assert list(own) == ["c"] and own["c"].value == pytest.approx(0.7 + noise.mean())
    means = [np.delete(noise, left).mean() for left in np.array_split(np.arange(count), parts)]
    assert own["c"].error == pytest.approx(2 * math.sqrt(parts - 1) * np.std(means))
    few = replace(rows, columns=ones[:9], y=rows.y[:9])
    assert _own(made, [replace(rows, columns=0 * ones)]) == {} == _own(made, []) == _own(made, [few])


def test_one_session_has_nothing_to_be_compared_with() -> None:
    """Logs that are in none are in no other."""
    logs = [SimpleNamespace(rule=SimpleNamespace(session=name)) for name in ("warm", None, "warm")]
    assert sessions(of_motor(fit_of({("c",): 0.5}), logs=logs)) == ()


# --- torques of an order


def part(log: Log, speed: float, load: float = 0.5) -> Steady:
    rows = np.arange(len(log))
    return Steady(log, rows, log["theta"], np.full(len(log), speed), speed, math.copysign(load, speed), 1.0)


def turning(speed: float, rows: int = 4000, **signals: Any) -> Log:
    theta = speed * 1e-4 * np.arange(rows)
    made = {"theta": theta, "i_q": 0 * theta, **signals}
    return Log("a", LogRule(file="*"), 1e-4, made, (slice(0, rows),))


def of_motor(fit: Fit | None = None, **more: Any) -> Any:
    """A servo with four pole pairs."""
    study = MOTORS["servo"]
    known = SimpleNamespace(
        motor=Motor.model_validate(study["motor"]), drive=Drive.model_validate(study["drive"])
    )
    return SimpleNamespace(known=known, fit=fit, **{"model": MODEL, "logs": (), "left_out": (), **more})


@pytest.mark.parametrize(("order", "cause"), [(24, RIPPLE), (8, GAIN)])
def test_ripple_acts_by_the_current_and_cogging_by_itself(order: int, cause: str) -> None:
    """c cos + s sin is the real part of (c - j s) e^(j theta); twice a standard error is one at 95 %."""
    sizes = {
        ("cogging", order, "c"): 0.3,
        ("cogging", order, "s"): 0.4,
        ("ripple", order, "c"): 0.01,
        ("ripple", order, "s"): -0.02,
    }
    model = Model(cogging=(order,), ripple=(order,))
    made = of_motor(fit_of(sizes, 0.1), model=model)
    waves = causes.disturbances(made, part(turning(-30.0), -30.0), order)
    assert waves == {
        "cogging": (0.3 - 0.4j, pytest.approx(2 * math.hypot(0.1, 0.1))),
        cause: (pytest.approx(0.5 * (0.01 + 0.02j)), pytest.approx(0.5 * 2 * math.hypot(0.1, 0.1))),
    }


def test_a_sensor_s_error_acts_as_what_would_move_the_rotor_so() -> None:
    """By inertia and the square of the order's frequency, with what is taken out already."""
    sizes = {("j",): 2e-3, ("encoder", 2, "c"): 1e-4, ("encoder", 2, "s"): 2e-4}
    made = of_motor(fit_of(sizes, 1e-5), model=Model(encoder=(2,), error={2: (0.1, -0.2)}))
    ((name, (wave, error)),) = causes.disturbances(made, part(turning(30.0), 30.0), 2).items()
    assert name == ENCODER
    assert wave == pytest.approx(-(60.0**2) * (1e-4 - 2e-4j + 2e-3 * (0.1 + 0.2j)))
    assert error == pytest.approx(60.0**2 * 2 * math.hypot(1e-5, 1e-5))


def test_how_the_current_leaves_its_reference_at_order_6p() -> None:
    """In each part its own wave, beside a reference that is followed within rows in the same way in both."""
    rng, parts, waves = np.random.default_rng(5), [], [0.03 - 0.04j, 0.05 + 0.01j]
    for speed, wave in zip((30.0, -20.0), waves, strict=True):
        reference = np.cumsum(rng.normal(0, 0.01, 4000))
        followed = np.convolve(reference, [0.5, 0.3, 0.2])[:4000]
        theta = speed * 1e-4 * np.arange(4000)
        current = followed + (wave * np.exp(24j * theta)).real + rng.normal(0, 1e-4, 4000)
        parts.append(part(turning(speed, i_q_ref=reference, i_q=current), speed))
    told = causes.tracking(of_motor(), [*parts, part(turning(10.0), 10.0)])
    assert list(told) == [id(each) for each in parts]
    for each, wave in zip(parts, waves, strict=True):
        value, error = told[id(each)]
        assert abs(value - wave) < 2 * error < 1e-4
        assert error == pytest.approx(2 * 1e-4 * math.hypot(1, 1) * math.sqrt(2 / 3996), rel=0.1)
    assert causes.tracking(of_motor(), [part(turning(10.0), 10.0)]) == {}


def test_a_back_emf_that_ripples_as_the_torque_does_is_no_dead_time() -> None:
    """It drives a current against it through L s^2 + (R + kp) s + ki over s; the rest is the inverter's."""
    made, w = of_motor(), 30.0
    one = part(turning(w), w)
    ripple = 0.5 * (0.02 + 0.01j)
    known: causes.Phasors = {RIPPLE: (ripple, 0.001)}
    causes._dead_time(made, one, 24, (0.3 + 0.1j, 0.01), known)
    s, kp, ki = 24j * w, 2 * math.pi * 500 * 2e-3, 2 * math.pi * 500 * 0.8
    emf = -4 * w * 0.05 * (0.02 + 0.01j) * s / (2e-3 * s**2 + (0.8 + kp) * s + ki)
    assert known[RIPPLE] == (pytest.approx(ripple + emf), 0.001)
    assert known[DEAD_TIME] == (pytest.approx(0.3 + 0.1j - emf), 0.01)
    alone: causes.Phasors = {}
    causes._dead_time(made, one, 24, (0.3 + 0.1j, 0.01), alone)
    assert alone == {DEAD_TIME: (0.3 + 0.1j, 0.01)}
    causes._dead_time(made, one, 24, (0.003 + 0.004j, 0.006), none := dict[str, tuple[complex, float]]())
    assert none == {}  # within its error


def test_the_disturbance_of_an_order_is_what_inertia_and_friction_leave_of_the_current() -> None:
    """j dw/dt + b w = i + D, for a wave of the speed; a current that is held may be half a row off."""
    w, order, size = 30.0, 24, 0.4
    t = 1e-4 * np.arange(20_000)
    theta = w * t + size / (order * w) * np.sin(order * w * t)  # a speed of size cos(order w t) more
    current = 0.05 * np.sin(order * w * t)
    log = turning(w, 20_000, theta=theta, i_q=current)
    made = of_motor(fit_of({("j",): 2e-3, ("b",): 0.1}), model=Model())
    measured, blurred = causes._measured(made, part(log, w), order)
    wanted = (1j * order * w * 2e-3 + 0.1) * size + 0.05j
    assert measured == pytest.approx(wanted, rel=2e-3)
    assert blurred == pytest.approx(0.05 * order * w * 1e-4 / 2, rel=1e-2)


# --- the voltage


def test_k_t_and_r_come_out_of_the_voltage_of_steady_parts() -> None:
    """u = R i + K_e w + 0.4 V of a dead time, by the current's sign, at four speeds and two currents."""
    logs = []
    for n, (speed, current) in enumerate(
        [(10.0, 0.5), (10.0, 2.0), (-20.0, -0.5), (30.0, 1.0), (-30.0, -2.0)]
    ):
        log = turning(speed, 20_000, i_q=np.full(20_000, current))
        u_q = 0.9 * log["i_q"] + 0.21 * speed + 0.4 * np.sign(current)
        logs.append(replace(log, name=str(n), signals={**log.signals, "u_q": np.broadcast_to(u_q, 20_000)}))
    known = of_motor().known
    told = voltage.told(known, logs)
    assert told is not None
    k_t, r = told
    assert k_t.value == pytest.approx(0.21 * 0.3 / (4 * 0.05)) and k_t.error == pytest.approx(
        0.01 * k_t.value
    )
    assert r.value == pytest.approx(0.9) and r.error == pytest.approx(0.009)
    assert voltage.told(known, logs[:3]) is None  # too few for three unknowns
    assert voltage.told(known, [logs[0]] * 2 + [logs[1]] * 2) is None  # at one speed


def test_what_the_voltage_leaves_unexplained_is_in_the_errors() -> None:
    """By Student's t of two degrees of freedom, 4.303 at 95 %, as of five parts for three unknowns."""
    speeds, currents = np.array([10.0, 10.0, -20.0, 30.0, -30.0]), np.array([0.5, 2.0, -0.5, 1.0, -2.0])
    columns = np.column_stack((speeds, currents, np.sign(currents)))
    left = np.linalg.svd(columns)[0][:, 3]  # what no unknown explains
    logs = []
    for n, u_q in enumerate(columns @ [0.21, 0.9, 0.4] + left):
        log = turning(speeds[n], 20_000, i_q=np.full(20_000, currents[n]), u_q=np.full(20_000, u_q))
        logs.append(replace(log, name=str(n)))
    told = voltage.told(of_motor().known, logs)
    assert told is not None
    spread = 4.30265 * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)) / 2)
    by_k_t = 0.3 / (4 * 0.05)
    assert told[0].error == pytest.approx(by_k_t * math.hypot(spread[0], 0.0021), rel=1e-4)
    assert told[1].error == pytest.approx(math.hypot(spread[1], 0.009), rel=1e-4)


def test_what_the_voltage_says_of_k_t_and_of_the_unit_of_the_current() -> None:
    """The servo's K_t is 0.3 N m/A; copper has sqrt(2) times its resistance 105 K warmer."""
    known = of_motor().known
    known.motor = known.motor.model_copy(update={"R_s": 2.0})
    agreed = voltage._of_k_t(known, Value(0.309, 0.01))
    assert isinstance(agreed, voltage.Agreement)
    assert agreed == "The voltage says K_t = 0.309 +- 0.01 N*m/A, as the file of columns has it (0.3)."
    ends = ": all torques are in proportion to it; correct motor.K_t (per rms ampere it is K_t_rms) or kv."
    for value, begins in ((0.315, "K_t = 0.315"), (0.285, "K_t = 0.285"), (-0.3, "K_t = -0.3")):
        said = voltage._of_k_t(known, Value(value, 0.01))
        assert said == f"The voltage says {begins} +- 0.01 N*m/A; the file of columns has 0.3{ends}"
        assert not isinstance(said, voltage.Agreement)
    for value in (0.3 * math.sqrt(2), 0.3 / math.sqrt(2)):
        said = voltage._of_k_t(known, Value(value, 0.004))
        assert said.endswith(f"; they differ by sqrt(2), the factor between rms and peak{ends}")
    assert voltage._of_r(known, Value(2.7, 0.13)) == [
        "The voltage says R = 2.7 +- 0.13 ohm, sqrt(2) times that of the file of columns (2): i_q looks like "
        "rms amperes, unless the winding is 105 K warmer; multiply it by sqrt(2), and with it all torques."
    ]
    assert voltage._of_r(known, Value(2.7, 0.12)) == []  # 2.83 is not within its error
    assert voltage._of_r(known, Value(2.83, 0.282)) and not voltage._of_r(known, Value(2.83, 0.284))


# --- orders that a fit leaves


def left_over(turns: int, *waves: tuple[int, float], noise: float = 0.0, name: str = "a") -> Rows:
    """1000 rows, 6 ms apart, of a 6 ms kernel: what it leaves of waves of these orders in `turns`."""
    theta = 2 * math.pi * turns / 1000 * np.arange(1000)
    speed = theta[1] / 6e-3
    y = noise * np.random.default_rng(7).normal(size=1000)
    for order, size in waves:
        y = y + size * math.exp(-0.5 * (order * speed * 6e-3) ** 2) * np.cos(order * theta + 0.3)
    log: Any = SimpleNamespace(name=name, dt=1e-3)
    none = np.zeros((1000, 0))
    return Rows(log, (), none, y, none, theta, np.full(1000, speed), np.arange(1000.0))


def empty(**noise: float) -> Fit:
    return replace(fit_of({}), noise=noise)


def test_an_order_explains_its_wave_as_the_kernel_leaves_it_at_each_speed() -> None:
    """All of what is of it, none of what it is not; nothing where the kernel leaves a thirtieth at most."""
    both = [left_over(2, (7, 0.3)), left_over(10, (7, 0.3), name="b")]
    share, counts = gains(both, empty(a=0.1, b=0.02), 6e-3)
    assert share[6] == pytest.approx(1.0, rel=1e-6) and share[[5, 7, 13]] == pytest.approx(0.0, abs=1e-6)
    assert counts == pytest.approx(np.full(400, 2 * 1000 / (2 * math.sqrt(math.pi))))
    two, _ = gains([left_over(2, (7, 0.3), (11, 0.1))], empty(a=1.0), 6e-3, 100)
    sizes = np.array([0.3, 0.1]) * np.exp(-0.5 * (np.array([7, 11]) * 2 * math.pi * 2 / 1000) ** 2)
    assert len(two) == 100 and two[[6, 10]] == pytest.approx(sizes**2 / np.sum(sizes**2), rel=1e-5)
    fast, _ = gains([left_over(10, (40, 0.1), (44, 10.0))], empty(a=1.0), 6e-3)
    assert fast[39] > 0 and not fast[43:].any()


def test_orders_are_found_the_strongest_first_from_a_tenth_of_it_on() -> None:
    fit = empty(a=1.0)
    rows = [left_over(2, (7, 0.3), (11, 0.4), noise=0.1)]
    assert found_orders(rows, fit, 6e-3, ()) == [11, 7]
    assert found_orders(rows, fit, 6e-3, (11,)) == [7] and found_orders(rows, fit, 6e-3, (), 1) == [11]
    assert found_orders([left_over(2, (11, 0.4), (7, 0.14))], fit, 6e-3, ()) == [11, 7]
    assert found_orders([left_over(2, (11, 0.4), (7, 0.12))], fit, 6e-3, ()) == [11]
    assert found_orders([left_over(2, (20, 0.09), noise=0.1)], fit, 6e-3, ()) == [20]
    assert found_orders([left_over(2, noise=0.1)], fit, 6e-3, ()) == []


@pytest.mark.parametrize(("beyond", "found"), [(1.001, [7]), (0.999, [])])
def test_an_order_is_found_where_chance_would_find_one_of_400_in_a_hundred_logs(
    beyond: float, found: list[int]
) -> None:
    """Two of v + 2 independent values explain a share s of all by chance with (1 - s)^(v / 2)."""
    v = 1000 / (2 * math.sqrt(math.pi)) - 2
    share = beyond * (1 - (0.01 / 400) ** (2 / v))
    widths = np.exp(-0.5 * (np.array([7, 11]) * 2 * math.pi * 2 / 1000) ** 2)
    small, large = np.sqrt([share, 1 - share]) / widths
    rows = [left_over(2, (7, small), (11, large))]
    assert found_orders(rows, empty(a=1.0), 6e-3, (11,)) == found


# --- what differs from log to log


def rows_with(name: str, friction: float, wave: complex, session: str | None = None, **log: Any) -> Rows:
    """Six hundred rows of a log over whole turns, with its own friction and wave of order 6."""
    rule = LogRule(file="*", session=session)
    own: Any = SimpleNamespace(**{"name": name, "dt": 1e-3, "kind": "", "rule": rule, **log})
    theta = 2 * math.pi / 100 * np.arange(600)
    columns = np.column_stack((np.ones(600), np.cos(6 * theta), np.sin(6 * theta)))
    y = columns @ [friction, wave.real, wave.imag] + np.random.default_rng(len(name)).normal(0, 1e-3, 600)
    names = (("c",), ("cogging", 6, "c"), ("cogging", 6, "s"))
    return Rows(own, names, columns, y, 0 * columns, theta, theta, theta)


def told(*rows: Rows) -> tuple[list[str], list[str]]:
    """What is said of these logs, and what is left out."""
    left: list[str] = []
    fit = fit_of({("c",): 0.5, ("cogging", 6, "c"): 0.3, ("cogging", 6, "s"): 0.0})
    return findings.between_logs(rows, fit, Model(cogging=(6,)), left), left


def test_friction_that_differs_by_a_fifth_is_told() -> None:
    """Of turning logs whose load is known, and where no two sessions have names."""
    one, alike, other = rows_with("a", 0.45, 0.3), rows_with("bb", 0.545, 0.3), rows_with("ccc", 0.555, 0.3)
    assert told(one, alike) == ([], [])
    assert told(other, one) == (
        [
            "Sessions differ: friction 0.45 A in a and 0.555 A in ccc; identify each session by itself, or "
            "warm the motor up first."
        ],
        [],
    )
    for log in ({"kind": "load"}, {"dt": 0.0}):
        assert told(one, rows_with("ccc", 0.7, 0.3, **log)) == ([], [])
    named = rows_with("a", 0.45, 0.3, "cold"), rows_with("ccc", 0.7, 0.3, "warm")
    assert told(*named) == ([], []) and told(named[0], rows_with("ccc", 0.7, 0.3)) != ([], [])


@pytest.mark.parametrize(("turn", "turned"), [(0.36, True), (0.34, False), (-0.36, True)])
def test_cogging_that_is_turned_between_logs_has_no_place(turn: float, turned: bool) -> None:
    """Against the log that shows it most clearly; by 0.35 rad of the strongest order, or more."""
    first, other = (
        rows_with("a", 0.5, 0.4),
        rows_with("bb", 0.5, 0.3 * complex(math.cos(turn), math.sin(turn))),
    )
    said, left = told(other, first)
    assert left == ["Cogging is left out, since its place differs between the logs."] * turned
    assert (
        said
        == [
            f"bb: order 6 is turned by {math.degrees(turn):.0f} deg against a, "
            f"{math.degrees(abs(turn)) / 6:.2g} deg of the rotor or more: the index has slipped, or the "
            "encoder counts from where it was switched on; find the index before each log."
        ]
        * turned
    )
    hidden = rows_with("bb", 0.5, 1e-3 * complex(math.cos(turn), math.sin(turn)))  # within its noise
    assert told(hidden, first) == ([], [])


# --- values with their errors


def test_a_value_s_error_is_of_its_fit_its_logs_its_kernels_and_its_phase() -> None:
    """Twice the larger of fit and logs, and of what other widths of the kernel move it by; then the phase.

    The sensor's error is in the fit by inertia.
    """
    waves = [(kind, n, p) for kind, n in (("cogging", 6), ("encoder", 1)) for p in "cs"]
    names: list[Name] = [("j",), ("load", "x"), *waves]
    here = {name: 0.1 * (n + 1) for n, name in enumerate(names)}
    fit = fit_of(here, 0.01)
    without = {log: fit.values + shift for log, shift in (("a", 0.0), ("b", 0.1), ("c", -0.1))}
    known: Any = None
    model = Model(cogging=(6,), encoder=(1,))
    made = Estimate(known, (), {}, (), (), (), {}, (), (), model, (), fit)
    others = [{("j",): 0.1 + 0.03}, {("j",): 0.1 - 0.04}]
    told = with_values(made, here, others, phase={("j",): 0.07})
    spread = math.sqrt((0.03**2 + 0.04**2) / 2)
    assert list(told.values) == ["j"] and told.values["j"].value == 0.1
    assert told.values["j"].error == pytest.approx(math.hypot(2 * math.hypot(0.01, spread), 0.07))
    assert told.loads == {"x": Value(0.2, 0.02)}
    assert told.cogging == (wave_of(6, *(Value(here["cogging", 6, part], 0.02) for part in "cs")),)
    (once,) = told.encoder
    assert once.size.error == pytest.approx(0.02 / 0.1)  # of both of its parts
    between = with_values(replace(made, fit=replace(fit, without=without)), here, others)
    assert between.loads["x"].error == pytest.approx(4.30265 * math.sqrt(2 / 3 * 0.02), rel=1e-4)
    untold = replace(made.model, untold=frozenset({("j", 0), ("cogging", 6)}))
    fewer = with_values(replace(made, model=untold), here, others)
    assert (fewer.values, fewer.cogging, fewer.encoder) == ({}, (), told.encoder)


@pytest.mark.parametrize(
    ("delay", "error", "said"),
    [
        (3.9e-3, 1e-3, ""),
        (4.1e-3, 1e-3, "5.1 +- 2 ms"),
        (-2.9e-3, 1e-3, ""),
        (-3.1e-3, 1e-3, "-2.1 +- 2 ms"),
        (0.0, 2.6e-3, "1 +- 5.2 ms"),
    ],
)
def test_a_delay_that_no_drive_has_is_left_out(
    monkeypatch: pytest.MonkeyPatch, delay: float, error: float, said: str
) -> None:
    """Of 1 ms that is out already, and what is found beyond it."""
    monkeypatch.setattr(estimate, "_settled", lambda known, logs, model: ([], fit_of({}), model))
    left: list[str] = []
    known: Any = None
    _, _, model = estimate._likely_delay(known, [], [], fit_of({("delay",): delay}, error), MODEL, left)
    assert (model == MODEL) == (said == "")
    if said:
        assert left == [
            f"The delay of the log comes out as {said}, which no drive has; it is left out; add an "
            "acceleration log that turns around sharply."
        ]
        assert (model.delay, model.columns) == (0.0, MODEL.columns - {"delay"})
    without = estimate._likely_delay(known, [], [], fit_of({}), MODEL, left)
    assert without[2] == MODEL
