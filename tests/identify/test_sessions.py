"""Friction and offset of each session come out, and a difference is told once."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.commissioned import write
from identify.fits import fit_of, of_motor
from identify.test_traps import shortened

from cogless.identify import config
from cogless.identify.balance import LADDER, Rows
from cogless.identify.estimate import estimate_motor
from cogless.identify.log import load_logs
from cogless.identify.sessions import sentences, sessions

MORE = 0.04  # A of friction in the other session
K_t, COULOMB = 0.3, 30e-3  # N m/A, N m


def test_each_session_has_its_friction(tmp_path):
    text, logs = shortened()
    fast = logs["fast"]
    direction = np.sign(np.gradient(fast["theta"]))
    logs = {**logs, "fast": {**fast, "i_q": fast["i_q"] + MORE * direction}}
    for name in logs:
        session = "warm" if name == "fast" else "cold"
        text = text.replace(f'file = "{name}.npz"', f'file = "{name}.npz"\nsession = "{session}"')
    paths = write(tmp_path, text, logs)
    known = config.load(tmp_path / "id.toml")
    made = estimate_motor(known, load_logs(paths, known), lambda what, share: None)
    cold, warm = sessions(made)
    assert (cold.name, warm.name) == ("cold", "warm") and warm.logs == ("fast.npz",)
    apart = warm.values["c"].value - cold.values["c"].value
    assert apart == pytest.approx(MORE, rel=0.3)
    (said,) = [line for line in sentences((cold, warm)) if "friction" in line]
    assert "A in cold" in said and "A in warm" in said
    assert not any(line.startswith("Sessions differ: friction") for line in made.remarks)


def test_without_names_there_are_no_sessions(tmp_path):
    text, logs = shortened()
    paths = write(tmp_path, text, logs)
    known = config.load(tmp_path / "id.toml")
    assert sessions(estimate_motor(known, load_logs(paths, known), lambda what, share: None)) == ()


def rows_of_session(name: str, speed: float, friction: float, count: int, seed: int) -> Rows:
    """Rows of a log that turns both ways at a speed, rad/s; the viscous friction is 0.01 A s/rad."""
    noise = np.random.default_rng(seed).normal(0, 0.02, count)
    way = np.repeat([1.0, -1.0], [count // 2, count - count // 2])
    rule = SimpleNamespace(session=name)
    log: Any = SimpleNamespace(name=f"{name} {speed}", rule=rule, kind="", dt=1e-3)
    names = (("b",), ("c",), ("offset",))
    columns = np.column_stack((speed * way, way, np.ones(count)))
    y = columns @ [0.01, friction, 0.003] + noise
    zero = np.zeros((len(LADDER), count))
    return Rows(log, names, columns, y, {}, noise, speed * way, np.arange(count), zero)


def test_a_session_s_own_friction_is_fitted_with_what_all_sessions_share() -> None:
    """A viscous friction that takes a part of the difference would be wrong in every session."""
    frictions = {"cold": 0.5, "warm": 0.3}
    runs = [("cold", 5.0), ("cold", 40.0), ("warm", 40.0)]
    off, errors = [], []
    for seed in range(40):
        rows = [rows_of_session(n, v, frictions[n], 400, 3 * seed + k) for k, (n, v) in enumerate(runs)]
        logs = [each.log for each in rows]
        made: Any = SimpleNamespace(rows=rows, logs=logs, fit=fit_of({("c",): 0.4}), instrument=5)
        for session in sessions(made):
            assert session.logs == tuple(log.name for log in logs if log.name.startswith(session.name))
            off.append(session.values["c"].value - frictions[session.name])
            errors.append(session.values["c"].error)
            assert abs(session.values["offset"].value - 0.003) < 3 * session.values["offset"].error
    assert 0.88 < np.mean(np.abs(off) < errors) <= 1.0
    assert np.median(errors) < 4 * np.std(off)


def test_one_session_has_nothing_to_be_compared_with() -> None:
    """Logs that are in none are in no other."""
    logs = [SimpleNamespace(rule=SimpleNamespace(session=name)) for name in ("warm", None, "warm")]
    assert sessions(of_motor(fit_of({("c",): 0.5}), logs=logs)) == ()
