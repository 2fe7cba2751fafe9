"""The page of an identification where a log is finer than its picture, and where sessions differ."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from report.curves import curves

from cogless.identify.config import LogRule
from cogless.identify.log import Log
from cogless.identify.result import Value
from cogless.identify.sessions import Session
from cogless.report import identified, svg
from cogless.results.trace import Trace


def log_of(rows, dt, **signals):
    made = {name: np.broadcast_to(np.asarray(x, dtype=float), rows) for name, x in signals.items()}
    return Log("one.csv", LogRule(file="*"), dt, made, (slice(0, rows),))


def trace_of(rows, period, **signals):
    time = period * np.arange(rows)
    return Trace(
        ("time", *signals), ("s", *("" for _ in signals)), np.column_stack([time, *signals.values()])
    )


def test_a_replay_of_many_rows_is_drawn_with_fewer_points():
    """Every third one of 3000. A signal that is constant is drawn at the bottom, and has no ratio."""
    x = np.linspace(0.0, 1.0, 3000)
    trace = trace_of(3000, 1 / 3000, i_q=x)
    page = identified._overlay(log_of(3000, 1 / 3000, i_q=x), trace, "i_q", "i_q")
    for _, line in curves(page):
        right = svg.PAGE_WIDTH - svg.RIGHT_MARGIN
        assert line[:, 0] == pytest.approx(np.linspace(svg.LEFT_EDGE, right, 1001)[:-1], abs=0.06)
        high = svg.LOW_EDGE - svg.TOP_EDGE
        assert line[:, 1] == pytest.approx(svg.LOW_EDGE - high * x[::3], abs=0.06)
    assert "one.csv: 1 s of i_q (A). Standard deviation, simulated / measured: 1.00" in page
    still = identified._overlay(log_of(20, 0.1, i_q=0.0), trace_of(20, 0.1, i_q=np.zeros(20)), "i_q", "i_q")
    assert "simulated / measured: nan" in still
    assert {y for _, line in curves(still) for y in line[:, 1]} == {svg.LOW_EDGE}
    assert [len(line) for _, line in curves(still)] == [10, 10]


def test_a_simulated_run_coarser_than_its_log_is_drawn_too():
    page = identified._overlay(log_of(20, 0.1, i_q=0.0), trace_of(7, 0.3, i_q=np.ones(7)), "i_q", "i_q")
    assert [len(line) for _, line in curves(page)] == [7, 7]


def test_what_was_played_has_a_key_and_a_picture_of_each_signal(monkeypatch):
    log, alone = log_of(20, 0.1, i_q=0.0, omega=1.0), log_of(20, 0.1, omega=1.0)
    trace = trace_of(20, 0.1, i_q=np.ones(20), omega_measured=np.ones(20))
    for logs, names in (([log], ["omega (rad/s)", "i_q (A)"]), ([alone], ["omega (rad/s)"])):
        monkeypatch.setattr(identified.described, "replayable", lambda made, logs=logs: logs)
        page = identified._replays(SimpleNamespace(estimate=None, traces={log.name: trace}))
        assert page.startswith(
            '<p class="note"><span class="key" style="--colour:var(--c0)">measured</span> '
            '<span class="key" style="--colour:var(--c2)">simulated</span></p><div class="panels">'
        )
        assert re.findall(r"<header>one.csv: 1 s of (.*?)\.", page) == names
    assert identified._replays(SimpleNamespace(estimate=None, traces={})) == ""


def test_a_session_has_its_friction_and_its_offset_as_far_as_they_are_told(monkeypatch):
    c, offset = Value(0.25, 0.01), Value(-0.13, 0.02)
    found = (Session("a <b>", ("one.csv", "two.csv"), {"c": c, "offset": offset}), Session("b", ("x",), {}))
    monkeypatch.setattr(identified, "sessions", lambda made: found)
    rows = re.findall(r"<tr>(.*?)</tr>", identified._sessions(None))
    assert [re.findall(r"<t[hd]>(.*?)</t[hd]>", row) for row in rows] == [
        ["Session", "logs", "friction over K_t", "offset of i_q"],
        ["a &lt;b&gt;", "one.csv, two.csv", "0.25 +- 0.01 A", "-0.13 +- 0.02 A"],
        ["b", "x", "not known", "not known"],
    ]
    monkeypatch.setattr(identified, "sessions", lambda made: ())
    assert identified._sessions(None) == ""
