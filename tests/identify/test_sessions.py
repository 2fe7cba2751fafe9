"""Friction and offset of each session come out, and a difference is told once."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.commissioned import write
from identify.fits import fit_of, of_motor
from identify.test_traps import shortened

from cogless.identify import config
from cogless.identify.balance import Rows
from cogless.identify.estimate import estimate
from cogless.identify.log import load_logs
from cogless.identify.sessions import _own, sentences, sessions

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
    made = estimate(known, load_logs(paths, known), lambda what, share: None)
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
    assert sessions(estimate(known, load_logs(paths, known), lambda what, share: None)) == ()


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
