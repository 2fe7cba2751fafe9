"""Fits, logs and steady parts made by hand, with which the steps of an estimate are tested."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from identify.commissioned import MOTORS

from cogless.identify.balance import Model, Name
from cogless.identify.config import COLUMNS_REPLAY_RULE, LogRule
from cogless.identify.jackknife import Fit
from cogless.identify.log import Log
from cogless.identify.steady import Steady
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
    made = {"normal": np.eye(count), "freedom": np.full(count, 30.0), "noise": {}, **more}
    numbers, own = np.array(list(values.values())), np.full(count, errors)
    return Fit(tuple(values), numbers, own, 2 * own, covariance=np.diag(own**2), **made)


def part(log: Log, speed: float, load: float = 0.5) -> Steady:
    rows = np.arange(len(log))
    return Steady(log, rows, log["theta"], speed, math.copysign(load, speed))


def turning(speed: float, rows: int = 4000, **signals: Any) -> Log:
    theta = speed * 1e-4 * np.arange(rows)
    made = {"theta": theta, "i_q": 0 * theta, **signals}
    return Log("a", LogRule(file="*"), 1e-4, made, (slice(0, rows),))


def of_motor(fit: Fit | None = None, **more: Any) -> Any:
    """A servo with four pole pairs."""
    study = MOTORS["servo"]
    known = SimpleNamespace(
        motor=Motor.model_validate(study["motor"]),
        drive=Drive.model_validate(study["drive"]),
        described_in="id.toml",
        replay_rule=COLUMNS_REPLAY_RULE,
    )
    return SimpleNamespace(
        identification=known, fit=fit, **{"model": MODEL, "logs": (), "left_out": (), "offsets": None, **more}
    )
