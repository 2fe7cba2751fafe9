"""Margins of loops in closed form, what is said of a current loop, and what `harmonic` says of itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cogless.design.law_rules import Gain
from cogless.design.laws.harmonic import Certificate, Certified, delay_of
from cogless.design.margins import UNSTABLE, Complex, Margins, Real, finite, margins_of, root
from cogless.design.speed_loop import CurrentLoop, IdealLoop, SoftShaft, SpeedLoop, pi_response, weakness
from cogless.design.summary import CurrentLoopDesign
from cogless.design.warnings import loop_warnings, told_apart
from cogless.study.drive import Belief
from cogless.study.laws.harmonic import Learner
from cogless.study.motor import StepMotor

T = 1e-3


def delayed(K: float, delay: int):
    """K / (z - 1), `delay` samples late."""

    def response(w: Real) -> Complex:
        z = np.exp(1j * w * T)
        return np.asarray(K / (z - 1) * z**-delay)

    return response


@pytest.mark.parametrize("K", [0.1, 0.5, 1.2])
def test_an_integrator_without_delay_has_its_margins_in_closed_form(K: float) -> None:
    """|L| = K / (2 sin wT/2); the pole 1 - K leaves the circle at K = 2, at half the sampling rate."""
    found = margins_of(delayed(K, 0), T, 1)
    half = math.asin(K / 2)
    assert found.stable and found.crossover == pytest.approx(2 * half / T)
    assert found.phase_margin == pytest.approx(math.pi / 2 - half)
    assert found.gain_margin == pytest.approx(2 / K)
    assert found.phase_crossover == pytest.approx(math.pi / T)


@pytest.mark.parametrize("K", [0.1, 0.5])
def test_with_a_sample_of_delay_its_gain_is_at_most_one(K: float) -> None:
    """1 + L has z^2 - z + K = 0, whose poles pass exp(j pi / 3) at K = 1."""
    found = margins_of(delayed(K, 1), T, 1)
    half = math.asin(K / 2)
    assert found.crossover == pytest.approx(2 * half / T)
    assert found.phase_margin == pytest.approx(math.pi / 2 - 3 * half)
    assert found.gain_margin == pytest.approx(1 / K)
    assert found.phase_crossover == pytest.approx(math.pi / 3 / T)
    assert margins_of(delayed(1.01, 1), T, 1) == UNSTABLE
    assert margins_of(delayed(0.99, 1), T, 1).stable
    assert not margins_of(delayed(2.01, 0), T, 1).stable


def test_a_loop_below_one_has_no_crossover() -> None:
    found = margins_of(lambda w: 0.5 * np.exp(-1j * w * T), T, 0)
    assert found.stable and math.isnan(found.crossover) and math.isnan(found.phase_margin)
    assert found.gain_margin == pytest.approx(2.0) and found.phase_crossover == pytest.approx(math.pi / T)
    assert (finite(math.nan), finite(math.inf), finite(2.0)) == (None, None, 2.0)


def test_a_resonance_between_the_points_is_seen_where_it_is_told() -> None:
    """A pole pair of the width 1e-4 rad/s at 100 rad/s, whose peak turns around -1."""

    def response(w: Real) -> Complex:
        s = 1j * w
        return np.asarray(0.01 / s + 1e-3 * s / (s**2 - 2e-4 * s + 1e4))  # an unstable mode

    near = 100.0 + 1e-4 * np.linspace(-500, 500, 2001)
    assert margins_of(response, T, 1).stable  # it is missed
    assert not margins_of(response, T, 1, near).stable


def test_roots_by_halves() -> None:
    assert root(lambda x: x**2 - 2, 0.0, 2.0) == pytest.approx(math.sqrt(2), rel=1e-15)
    assert root(lambda x: 2 - x**2, 0.0, 2.0) == pytest.approx(math.sqrt(2), rel=1e-15)


def test_a_pi_sums_from_its_first_sample_on() -> None:
    w = np.array([10.0, 500.0])
    z = np.exp(1j * w * T)
    assert pi_response(w, T, 0.2, 3.0) == pytest.approx(0.2 + 3.0 * T / (1 - 1 / z))
    assert pi_response(w, T, 0.2, 0.0) == pytest.approx([0.2, 0.2])


def test_a_current_loop_is_exact_for_a_held_voltage() -> None:
    """Below all rates it is (kp + ki / s) / (R + s L); without resistance the winding integrates."""
    loop = CurrentLoop(kp=3.0, ki=50.0, R=2.0, L=1e-3, period=1e-4, delay=1)
    w = np.array([0.1, 1.0])
    assert loop.response(w) == pytest.approx((3.0 + 50.0 / (1j * w)) / (2.0 + 1e-3j * w), rel=1e-3)
    z = np.exp(1j * np.array([3000.0]) * 1e-4)
    free = replace(loop, R=0.0, delay=2)
    assert free.response(np.array([3000.0])) == pytest.approx((3.0 + 50e-4 / (z - 1)) * 0.1 / (z - 1) / z**2)
    assert loop.margins().stable and free.margins().stable
    assert weakness(loop.margins()) is None
    assert weakness(UNSTABLE) == "is unstable"
    assert weakness(Margins(True, 1.0, math.radians(29.94), 2.0, 1.0)) == "has only 29.9 deg"
    assert weakness(Margins(True, 1.0, math.radians(30.01), 2.0, 1.0)) is None


def test_axes_that_are_alike_are_one_in_warnings() -> None:
    weak = Margins(True, 1.0, math.radians(20), 2.0, 1.0)
    gains = {"kp": Gain(1.0, "V/A")}
    q = CurrentLoopDesign(gains, weak, weakness(weak))
    assert told_apart({}) == {} and told_apart({"q": q, "d": q}) == {"current loop": q}
    assert loop_warnings({"q": q, "d": q}) == [
        "drive.current_loop: the current loop has only 20.0 deg of phase margin"
    ]
    d = CurrentLoopDesign(gains, UNSTABLE, weakness(UNSTABLE))
    assert loop_warnings({"q": q, "d": d}) == [
        "drive.current_loop: the current loop, q has only 20.0 deg of phase margin",
        "drive.current_loop: the current loop, d is unstable, and so is every speed loop around it",
    ]
    other = replace(q, gains={"kp": Gain(2.0, "V/A")})
    assert list(told_apart({"q": q, "d": other})) == ["current loop, q", "current loop, d"]
    fine = replace(q, weakness=None)
    assert loop_warnings({"q": fine, "d": fine}) == []


def test_a_soft_shaft_swings_as_two_masses_do() -> None:
    shaft = SoftShaft(inertia=2e-3, load_inertia=3e-3, stiffness=200.0, damping=0.0)
    assert shaft.antiresonance == pytest.approx(math.sqrt(200 / 3e-3))
    assert shaft.resonance == pytest.approx(math.sqrt(200 * 5e-3 / 6e-6))
    parallel = 6e-6 / 5e-3
    assert shaft.damping_in_design == pytest.approx(2e-6 * math.sqrt(200 * parallel))
    assert replace(shaft, damping=0.1).damping_in_design == 0.1
    rates = shaft.rates(50.0)
    d = shaft.damping_in_design
    assert rates[1] == pytest.approx(np.array([50 * 5e-3, -d, -200, d, 200, 0]) / 2e-3)
    assert rates[3] == pytest.approx(-np.array([0, -d, -200, d, 200, 0]) / 3e-3)
    assert rates[2].tolist() == [0, 1, 0, 0, 0, 0] and rates[4].tolist() == [0, 0, 0, 1, 0, 0]
    damped = replace(shaft, damping=0.1)
    near = damped.near(1e-3)
    assert len(near) == 2 * 601
    assert near[300] == pytest.approx(shaft.antiresonance) and near[901] == pytest.approx(shaft.resonance)
    assert near[301] - near[300] == pytest.approx(0.01 * 0.1 / (2 * 3e-3))
    assert near[902] - near[901] == pytest.approx(0.01 * 0.1 / (2 * parallel))
    folded = damped.near(0.02)  # half the sampling rate is 157 rad/s
    assert 0 < folded[300] < math.pi / 0.02
    assert math.cos(folded[300] * 0.02) == pytest.approx(math.cos(shaft.antiresonance * 0.02))


def test_what_the_current_is_late_by() -> None:
    """An ideal loop is late by the bus alone; another as a lag is, less half of its own period."""
    ideal = SpeedLoop(b=100.0, steps=10, window=0, current=IdealLoop(1e-4), delay=3e-4)
    assert delay_of(ideal) == 3e-4
    lag = CurrentLoop(kp=1e-3 * 500, ki=2.0 * 500, R=2.0, L=1e-3, period=1e-5, delay=0)  # 500 rad/s
    w = 1.3 / 1e-3  # where an order turns by 1.3 rad in a period of the law
    found = delay_of(replace(ideal, steps=100, current=lag)) - 3e-4
    assert found == pytest.approx(math.atan(w / 500) / w, rel=0.01)


def certificate(**changes: object) -> Certificate:
    numbers = {"b": 1e3, "delay": 1e-4, "step": 0.0, "rate": 20.0, "rate_min": 0.5}
    learner = Learner(**numbers, base=6, bends=0, orders=8, fast=2, held=())
    speeds = (
        Certified(omega_m=2 * math.pi, acting=42, gamma=0.391, late=36, held_orders=(), rate=2.0, most=5.061),
        Certified(
            omega_m=20 * math.pi, acting=12, gamma=0.5, late=6, held_orders=(24, 30), rate=7.0, most=None
        ),
    )
    plain = Certificate(learner, 1e-3, speeds, 100 * math.pi, None)
    return replace(plain, **changes)


def test_a_certificate_in_one_line() -> None:
    learner = certificate().learner
    assert certificate().in_words() == (
        "learns orders 6, 12, ..., 48; at 60 rpm orders up to 42, with a learning rate of 2 1/s at first. "
        "Together they settle with rates below 5.06 1/s. If K_t/J is 50 % wrong, they still converge "
        "(least Re Gamma: 0.39; must be above 0). If a sample of delay is not in the model, orders up to "
        "36 converge; at 600 rpm orders up "
        "to 12, except 2 orders from 24 to 30, with a learning rate of 7 1/s at first. Together they settle "
        "with any rate. If K_t/J is 50 % wrong, they still converge (least Re Gamma: 0.50; must be above "
        "0). If "
        "a sample of delay is not in the model, orders up to 6 converge; "
        "learns up to 3000 rpm"
    )
    assert (
        certificate(speeds=()).in_words()
        == "not judged: all references are too slow, since even a wave of order 48 advances by less than "
        "0.001 rad "
        "a sample"
    )
    one = (
        Certified(
            omega_m=2 * math.pi, acting=42, gamma=0.391, late=36, held_orders=(24,), rate=2.0, most=None
        ),
    )
    bands = replace(learner, held=(math.tau * 0.1, math.tau * 0.2, math.tau * 0.3, math.tau * 0.4))
    more = certificate(speeds=one, learner=bands, straight=math.pi)
    assert more.in_words() == (
        "learns orders 6, 12, ..., 48; at 60 rpm orders up to 42, except 24, with a learning rate of 2 1/s "
        "at first. Together they settle with any rate. If K_t/J is 50 % wrong, they still converge (least "
        "Re Gamma: 0.39; must be above 0). If a sample of delay is not in the model, orders up to 36 "
        "converge; learns no order of a frequency from 100 to "
        "200 or from 300 to 400 Hz; learns up to 3000 rpm; learns an eccentric sensor's error up to 30 rpm"
    )
    bad = Certified(omega_m=2 * math.pi, acting=42, gamma=0.0, late=36, held_orders=(), rate=2.0, most=None)
    turned = certificate(speeds=(bad,)).in_words()
    assert "any rate. If K_t/J is 50 % wrong, they may not all converge (least Re Gamma: 0.00; " in turned
    unsure = certificate(speeds=(replace(bad, late=0),)).in_words()
    assert (
        "If a sample of delay is not in the model, the lowest order may not converge; learns up to" in unsure
    )
    good = replace(bad, gamma=0.1)
    for speeds, fine in (
        ((good,), True),
        ((good, bad), False),
        ((replace(good, most=2.0),), False),
        ((replace(good, most=2.1), good), True),
    ):
        assert certificate(speeds=speeds).fine == fine


def test_a_step_motor_is_believed_as_it_is_written() -> None:
    """Its values are those of its two phases: no star and delta."""
    values = {"teeth": 50, "R_s": 1.0, "L_0": 7e-4, "L_1": 1e-4, "L_m": (2e-3,), "L_f": (), "i_f": 1.0}
    star = StepMotor.model_construct(kind="step", datasheet=None, **values).star()
    belief = Belief.model_validate({"R_s": "2 ohm", "L_d": "3 mH", "psi_f": "5 mWb"}).resolved(star)
    assert (belief.R_s, belief.L_d, belief.psi_f) == pytest.approx((2.0, 3e-3, 5e-3))
    assert belief.L_q == star.L_q == pytest.approx(6e-4)
