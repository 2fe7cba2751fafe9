"""What each law tells of itself: whether, from when and over what it learns, and its gains."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import pytest
from pydantic import TypeAdapter

from cogless.study.drive import AnyCurrentLoop, StarBelief
from cogless.study.laws import Controller
from cogless.study.laws.law import LawLoop

POLE_PAIRS = 4
BY_HAND = {"kp": 0.1, "ki": 2.0}
LATER = {"learning_start": "3 s"}
PI_ILC = {"law": "pi-ilc", **BY_HAND, **LATER, "gain": 0.5}
ROBUST = {"law": "robust-ilc", **LATER, "b": 2, "c": 3, "g": 1, "eta": 5, "q": 7, "beta_1": 1, "beta_2": 11,
          "gamma": 1}  # fmt: skip
AFC = {"law": "pi-afc", **BY_HAND, **LATER, "gain": 1, "orders": [6, 12]}
HARMONIC = {"law": "harmonic", **BY_HAND, **LATER}
POSITION = {"law": "space-position", "k_theta": 5, "k_omega": 0.1, "mu_alpha": 5.0, **LATER}
SPEED = {"law": "space-speed", "k": 0.1, "eta_bar": 1.0, "mu_alpha": 5.0, **LATER}
TABLE = {"law": "anti-cogging", **BY_HAND, "calibration": {"speed": 2.0, "position_gain": 20}}
OWN = {"law": "python", "object": "law.py:Law", **LATER}
LIBRARY = {"law": "library", "library": "law.so", **LATER}
MAP = {"start": {"map": "a.bin"}}
# what a law tells unless its row says otherwise: it learns from 3 s on, over the rotor's angle
LEARNS = {"learns": True, "learned": True, "learns_from": 3.0, "holds_position": False, "by_rotor": True,
          "unit": 1.0, "linear": None, "ratio": 1}  # fmt: skip
NEVER = {**LEARNS, "learns": False, "learned": False, "learns_from": 0.0}
TURN = {"revolutions": Fraction(1), "over_angle": True}


def law(table: dict[str, Any]) -> Any:
    return TypeAdapter(Controller).validate_python(table)


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ({"law": "pi", **BY_HAND}, NEVER),
        ({"law": "adrc", "b": 1, "omega_c": 1, "omega_o": 1}, NEVER),
        (TABLE, {**NEVER, "learned": True}),
        (PI_ILC, {**LEARNS, **TURN, "learning_gain": (0.5, 0.0)}),
        ({**PI_ILC, "period": "electrical", "memory": "time"},
            {**LEARNS, "ratio": 4, "revolutions": Fraction(1, 4), "over_angle": False}),
        (ROBUST, {**LEARNS, **TURN, "unit": -2.0, "linear": (4.0, 7.5), "learning_gain": (38.5, 115.5)}),
        (AFC, {**LEARNS, **TURN, "cells": 24, "q_half_width": 0}),
        (HARMONIC, {**LEARNS, **TURN}),
        ({**HARMONIC, "position": True, "k_theta": 1}, {**LEARNS, **TURN, "holds_position": True}),
        (POSITION, {**LEARNS, "holds_position": True, "by_rotor": False, "ratio": 4, "over_angle": True,
            "revolutions": Fraction(1, 4), "channels": 1}),
        ({**POSITION, "index": "rotor", "frame": "mechanical", "mu_beta": 1, "memory": "delay",
          "period": {"of": "mechanical", "turns": 3, "parts": 2}},
            {**LEARNS, "holds_position": True, "over_angle": False, "revolutions": Fraction(3, 2),
             "channels": 2}),
        ({**POSITION, "learning": False},
            {**NEVER, "learns_from": 1e18, "holds_position": True, "by_rotor": False, "ratio": 4}),
        ({**SPEED, "mu_h": 1}, {**LEARNS, "linear": (0.1, 0.0), "channels": 3}),
        (OWN, {**NEVER, "learns_from": 3.0, "code": "law.py"}),
        ({**OWN, "learning": True, "position": True}, {**LEARNS, "holds_position": True}),
        ({**OWN, **MAP}, {**NEVER, "learned": True, "learns_from": 3.0}),
        (LIBRARY, {**NEVER, "learns_from": 3.0, "code": "law.so"}),
        ({**LIBRARY, "learning": True}, LEARNS),
    ],
)  # fmt: skip
def test_what_a_law_tells_of_itself(table: dict[str, Any], told: dict[str, Any]) -> None:
    one = law(table)
    found = {
        name: getattr(one, name)(POLE_PAIRS) if name in ("ratio", "revolutions") else getattr(one, name)
        for name in told
    }
    assert found == told


def test_numbers_with_a_unit_are_si_for_a_law_of_one_s_own() -> None:
    as_they_are = {"c": "red", "d": "1 rpn", "e": True}
    params = {"a": "3 mA", "b": [1, "60 rpm", "x"], **as_they_are}
    si = {"a": pytest.approx(3e-3), "b": [1, pytest.approx(2 * math.pi), "x"], **as_they_are}
    assert law({**OWN, "params": params}).arguments == si
    assert law({**LIBRARY, "params": [1.5, "3 mA"]}).numbers == pytest.approx([1.5, 3e-3])


@pytest.mark.parametrize(
    ("table", "told"),
    [
        (POSITION, {"parts": 1}),
        ({**POSITION, "period": {"parts": 3}}, {"parts": 3}),
        ({**POSITION, "frame": "mechanical", "period": {"parts": 3}}, {"parts": 12}),  # of the law's angle
        ({**SPEED, "mu_h": 1, "period": {"of": "mechanical", "turns": 3}, "memory": "delay", "k_pp": 8,
          "delay_method": "inversion", "alpha_limit": 1, "beta_limit": 2, "cells": 512, "q_half_width": 3},
            {"turns": 3, "kind": "CGL_MEMORY_DELAY", "channels": 3, "limit": (1.0, 2.0, None), "k_pp": 8.0,
             "method": "CGL_DELAY_INVERSION", "cells": 512, "q_half_width": 3}),
    ],
)  # fmt: skip
def test_the_memory_of_a_law_over_the_angle(table: dict[str, Any], told: dict[str, Any]) -> None:
    usual = {
        "kind": "CGL_MEMORY_ANGLE", "channels": 1, "cells": 1024, "turns": 1, "parts": 1, "q_half_width": 5,
        "lead": 0, "forgetting": 1.0, "limit": (None,), "method": "CGL_DELAY_ODE", "k_pp": 10.0,
    }  # fmt: skip
    loop = LawLoop(current_rate=15_000, divider=15, current_limit=3.0, pole_pairs=POLE_PAIRS)
    assert law(table).memory_config(loop) == {**usual, **told}
    assert loop.ts == pytest.approx(1e-3) and loop.samples(12.4e-3) == 12


def test_a_loop_s_gains_are_given_or_by_its_bandwidth_or_none_of_an_ideal_one() -> None:
    belief = StarBelief(R_s=2.0, L_d=3e-3, L_q=5e-3, psi_f=0.1)
    limit, w = {"current_limit": "3 A"}, 2 * math.pi * 800
    for loop, told in (
        ({"kp": "7 V/A", "ki": "9 V/A/s"}, (7, 9, 7, 9)),
        ({"bandwidth": "800 Hz"}, (w * 3e-3, w * 2, w * 5e-3, w * 2)),
        ({"kind": "ideal"}, (0, 0, 0, 0)),
    ):
        gains = TypeAdapter(AnyCurrentLoop).validate_python({**limit, **loop}).gains(belief)
        assert gains == pytest.approx(dict(zip(("kp_d", "ki_d", "kp_q", "ki_q"), told, strict=True)))


def test_a_commissioning_run_goes_an_eighth_of_a_turn_further_each_way() -> None:
    run = law({**TABLE, "calibration": {"speed": 2.0, "position_gain": 20, "revolutions": 3}}).calibration
    assert run.duration == pytest.approx(2 * 3.125 * 2 * math.pi / 2.0)
