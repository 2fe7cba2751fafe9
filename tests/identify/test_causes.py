"""What acts at an order: torques, the sensor, the current, a back-EMF, in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from identify.fits import fit_of, of_motor, part, turning

from cogless.identify import causes
from cogless.identify.balance import Model
from cogless.identify.causes import (
    COGGING,
    DEAD_TIME,
    ENCODER,
    GAIN,
    MECHANICS,
    OFFSET,
    RIPPLE,
    UNEXPLAINED,
    Cause,
)
from cogless.identify.estimate import CURES


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


def shares(
    monkeypatch: pytest.MonkeyPatch, order: int, measured: complex, known: causes.Phasors, **more: Any
) -> dict[str, tuple[float, float]]:
    """Each cause's share of an order and its error; the order is `measured` up to 0.05 A."""
    turned = 3e-3 * np.arange(4000)
    one = part(turning(30.0, theta=turned + 1e-3 * np.sin(order * turned)), 30.0)
    monkeypatch.setattr(causes, "_measured", lambda made, part, order: (measured, 0.05))
    monkeypatch.setattr(causes, "disturbances", lambda made, part, order: dict(known))
    responses = {id(one): (0.1 + 0j, 0.03)} if more.pop("follows", False) else {}
    found = causes._attributed(of_motor(**more), one, order, responses)
    return {cause.name: (cause.share, cause.error) for cause in found.causes}


def test_what_is_left_of_an_order_is_not_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    """Except for what the measurement may be off by; that is in the error of every cause."""
    known: causes.Phasors = {COGGING: (0.3 + 0j, 0.02)}
    told = shares(monkeypatch, 24, 0.4 + 0j, known)
    assert told == {
        COGGING: pytest.approx((0.3 / 0.35, math.hypot(0.02, 0.05) / 0.35)),
        UNEXPLAINED: pytest.approx((0.05 / 0.35, 0.05 / 0.35)),
    }
    assert shares(monkeypatch, 24, 0.34 + 0j, known)[UNEXPLAINED][0] == 0.0
    guessed = {"cogging or K_t ripple or dead time or encoder": (1.0, 0.5)}
    assert shares(monkeypatch, 24, 0.4 + 0j, {}) == shares(monkeypatch, 24, 0j, {}) == guessed


def test_dead_time_is_of_order_6p_and_an_offset_of_the_pole_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither is in what the fit knows. Without anything that it knows, they have to be half of the order."""
    known: causes.Phasors = {COGGING: (0.3 + 0j, 0.0)}
    assert DEAD_TIME in shares(monkeypatch, 24, 0.3 + 0j, known, follows=True)
    assert DEAD_TIME not in shares(monkeypatch, 24, 0.3 + 0j, known)
    assert DEAD_TIME not in shares(monkeypatch, 12, 0.3 + 0j, known, follows=True)
    off = (0.03, -0.06, 0.03)
    wave = -2j / 3 * (0.03 - 0.06 * np.exp(-2j * math.pi / 3) + 0.03 * np.exp(-4j * math.pi / 3))
    told = shares(monkeypatch, 4, 0.3 + 0j, known, offsets=off)
    assert told[OFFSET][0] == pytest.approx(float((wave / (0.3 + wave)).real))
    assert OFFSET not in shares(monkeypatch, 4, 0.3 + 0j, known)
    assert OFFSET not in shares(monkeypatch, 8, 0.3 + 0j, known, offsets=off)
    for left, guessed in ((0.05 + 0.9 * abs(wave), False), (0.05 + 1.2 * abs(wave), True)):
        told = shares(monkeypatch, 4, left * wave / abs(wave), {}, offsets=off)
        assert (OFFSET not in told) == guessed


def test_a_torque_may_be_of_what_no_log_tells_apart() -> None:
    for order, more, name in (
        (4, {}, "cogging or current offset"),
        (4, {"offsets": (0.0, 0.0, 0.0)}, COGGING),
        (24, {}, COGGING),
        (24, {"left_out": (CURES["ripple"].format(24),)}, "cogging or K_t ripple or dead time"),
        (2, {}, MECHANICS),
        (3, {}, COGGING),
    ):
        assert causes._cogging(of_motor(**more), order) == name


def test_an_order_has_its_share_of_the_ripple() -> None:
    """The share is of the ripple's square, and at most one. A wave's rms is its amplitude over sqrt 2."""
    turned = -3e-3 * np.arange(20_000)
    waves = [(24, 0.3), (7, 0.1)]
    theta = turned + sum(size / (n * 30) * np.sin(n * turned) for n, size in waves)
    one = part(turning(-30.0, theta=theta), -30.0)
    small, large = Cause(ENCODER, 0.2, 0.1), Cause(COGGING, 0.8, 0.1)
    found = causes.order_causes(one, 24, [small, large])
    assert (found.log, found.speed, found.load, found.order) == ("a", 30.0, -0.5, 24)
    assert (found.ripple, found.share) == pytest.approx((0.3 / math.sqrt(2), 0.9), rel=5e-3)
    assert found.causes == (large, small) and found.measured == 0.0


def test_an_error_of_the_encoder_is_measurement_and_moves_the_rotor_by_the_controller() -> None:
    """An error of 0.01 rad moves the rotor by half of itself, backwards: a fifth of the squares is motion."""
    turned = 3e-3 * np.arange(20_000)
    moved = replace(
        part(turning(30.0, theta=turned - 5e-3 * np.sin(2 * turned)), 30.0), error={2: complex(0.0, -0.01)}
    )
    found = causes.order_causes(moved, 2, [Cause(ENCODER, 0.9, 0.1), Cause(COGGING, 0.1, 0.1)])
    assert found.measured == pytest.approx(0.8, rel=1e-3)
    assert found.ripple == pytest.approx(60 * math.hypot(0.01, 5e-3) / math.sqrt(2), rel=1e-3)
    assert [(cause.name, cause.share) for cause in found.causes] == [
        (ENCODER, pytest.approx(0.98, rel=1e-3)),
        (COGGING, pytest.approx(0.02, rel=2e-2)),
    ]
