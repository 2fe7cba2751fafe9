"""What each law tells of itself: whether, from when and over what it learns, and its gains."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import pytest
from pydantic import TypeAdapter

from cogless.study.laws import Controller

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
# what they tell unless told otherwise here: a law that learns from 3 s on, over the rotor's angle
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


def test_a_commissioning_run_goes_an_eighth_of_a_turn_further_each_way() -> None:
    run = law({**TABLE, "calibration": {"speed": 2.0, "position_gain": 20, "revolutions": 3}}).calibration
    assert run.duration == pytest.approx(2 * 3.125 * 2 * math.pi / 2.0)
