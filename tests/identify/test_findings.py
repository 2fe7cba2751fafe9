"""What differs from log to log is told."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.fits import fit_of

from cogless.identify import findings
from cogless.identify.balance import Model, Rows
from cogless.identify.config import LogRule


def rows_with(name: str, friction: float, wave: complex, session: str | None = None, **log: Any) -> Rows:
    """Six hundred rows of a log over whole turns, with its own friction and wave of order 6."""
    rule = LogRule(file="*", session=session)
    own: Any = SimpleNamespace(**{"name": name, "dt": 1e-3, "kind": "", "rule": rule, **log})
    theta = 2 * math.pi / 100 * np.arange(600)
    columns = np.column_stack((np.ones(600), np.cos(6 * theta), np.sin(6 * theta)))
    y = columns @ [friction, wave.real, wave.imag] + np.random.default_rng(len(name)).normal(0, 1e-3, 600)
    names = (("c",), ("cogging", 6, "c"), ("cogging", 6, "s"))
    return Rows(own, names, columns, y, {}, theta, theta, theta)


def told(*rows: Rows, c: float = 0.5, delay_error: float = 0.0) -> tuple[list[str], list[str]]:
    """What is said of these logs, and what is left out. `c`: friction of all together."""
    left: list[str] = []
    waves = {("cogging", n, part): size for n, size in ((12, 0.1), (6, 0.3)) for part in "cs"}
    fit = fit_of({("c",): c, **waves, ("cogging", 6, "s"): 0.0})
    return findings.between_logs(rows, fit, Model(cogging=(12, 6)), left, delay_error), left


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
    assert told(one, other, c=0.0) == told(one, other, c=-0.1) == ([], [])  # no friction
    for log in ({"kind": "load"}, {"dt": 0.0}):
        assert told(one, rows_with("ccc", 0.7, 0.3, **log)) == ([], [])
    named = rows_with("a", 0.45, 0.3, "cold"), rows_with("ccc", 0.7, 0.3, "warm")
    assert told(*named) == ([], []) and told(named[0], rows_with("ccc", 0.7, 0.3)) != ([], [])


def test_a_wave_that_an_unknown_delay_turns_is_no_slip_of_the_index() -> None:
    """The rotor turns on within the delay's error, in each log by its own speed (here 19 rad/s)."""
    apart = rows_with("bb", 0.5, 0.3 * complex(math.cos(0.5), math.sin(0.5)))
    first = rows_with("a", 0.5, 0.4)
    speed = float(np.median(first.omega))
    assert told(apart, first)[1] != []
    assert told(apart, first, delay_error=0.2 / (6 * speed))[1] == []
    assert told(apart, first, delay_error=0.05 / (6 * speed))[1] != []


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
            f"bb: the phase of order 6 differs by {math.degrees(turn):.0f} deg from that in a, so the "
            f"rotor's angle is shifted by {math.degrees(abs(turn)) / 6:.2g} deg or more. Either the "
            "encoder's index has slipped, or the encoder takes the position at switch-on as zero; find the "
            "index before each log."
        ]
        * turned
    )
    larger = rows_with("bb", 0.5, 1.2 * complex(math.cos(turn), math.sin(turn)))  # no slip changes a size
    said, left = told(larger, first)
    assert left == ["Cogging is left out, since its place differs between the logs."] * turned
    assert not any("index" in line for line in said) and len(said) == len(left)
    hidden = rows_with("bb", 0.5, 1e-3 * complex(math.cos(turn), math.sin(turn)))  # within its noise
    assert told(hidden, first) == ([], [])


def test_a_log_that_shows_an_order_in_one_place_alone_has_no_place_for_it() -> None:
    """A twelfth of its rows: what the fit leaves there may be anything else, and is no noise."""
    once = rows_with("bb", 0.5, 0.3j)
    for shown, turned in ((slice(0, 50), False), (slice(0, 600), True)):
        hidden = np.ones(600, dtype=bool)
        hidden[shown] = False
        columns = once.columns.copy()
        columns[hidden, 1:] *= 1e-3
        rows = replace(once, columns=columns, y=once.y - (once.columns - columns) @ [0.0, 0.0, 0.3])
        assert bool(told(rows_with("a", 0.5, 0.4), rows)[0]) == turned


def test_a_log_s_own_coefficients_have_three_times_their_error() -> None:
    """They are the fit's, moved by what it leaves of the log's rows. If rows tell nothing, both are zero."""
    rows = rows_with("a", 0.45, 0.3 + 0.1j)
    fit = fit_of({("c",): 0.5, ("cogging", 6, "c"): 0.2, ("cogging", 6, "s"): 0.0})
    waves = (("cogging", 6, "c"), ("cogging", 6, "s"))
    assert findings._own([rows], fit, (("c",),))[0] == pytest.approx(0.45, abs=1e-3)
    wave, error = findings._own([rows, rows], fit, waves)
    assert wave == pytest.approx(0.3 + 0.1j, abs=1e-3)
    left = np.std(rows.y - rows.columns @ [0.5, wave.real, wave.imag])
    assert error == pytest.approx(3 * left / math.sqrt(1200 / 2), rel=0.5)  # by twelve parts
    alone = replace(rows, columns=np.where(np.arange(600)[:, None] < 50, rows.columns, 0.0))
    assert findings._own([alone], fit, waves)[1] == math.inf  # the others tell nothing
    rows.columns[:, 2] = rows.columns[:, 1]
    assert findings._own([rows], fit, waves) == (0j, 0.0)
