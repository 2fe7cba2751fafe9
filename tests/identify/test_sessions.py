"""Friction and offset of each session come out, and a difference is told once."""

from __future__ import annotations

import numpy as np
import pytest
from identify.commissioned import write
from identify.test_traps import shortened

from cogless.identify import config
from cogless.identify.estimate import estimate
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
