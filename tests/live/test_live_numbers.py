"""The page's metrics against cogless's, on one trace."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from node import NO_NODE, run_node

from cogless import load
from cogless.live.live_page import _metric
from cogless.report.order_charts import order_spectrum
from cogless.report.speed_tracking import missed
from cogless.results.held_speed import (
    JERKS_RATIO,
    LOST_SPEED_RATIO,
    MEAN_ERROR_MOST,
    ONE_WAY,
    REST_ERROR_MOST,
)
from cogless.results.metrics import METRIC_FUNCTIONS, evaluate, result_name, window_of
from cogless.results.trace import Trace
from cogless.results.windows import rows_of
from cogless.study.metric import TURN_SHORTFALL_MOST, Conditions, Metric

pytestmark = pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)

NAMES = {
    "time": "s",
    "theta_m": "rad",
    "omega_m": "rad/s",
    "omega_ref": "rad/s",
    "i_d": "A",
    "i_q": "A",
    "i_q_ref": "A",
}
ABOUT = {"pole_pairs": 4, "R_s": 0.7, "power_factor": 1.5, "speed_period": 1e-3, "events": [0.8, 1.5]}
WINDOWS = ({"window": ["0.3 s", "1.2 s"]}, {"last": "0.5 s"}, {})
COMPUTE = """
const all = Float64Array.from(given.rows.flat().map((x) => (x === null ? NaN : x)));
const { Trace, evaluate, kinds } = liveMetrics, { rows, names, metrics, about } = given;
const trace = new Trace({ rows: all, count: rows.length, columns: names.length, names });
return { kinds, values: metrics.map((m) => evaluate(m, trace, about)) };
"""


def trace(reverses=False):
    """Two seconds of a speed with ripple and a step; once with a reversal."""
    time = np.arange(2000) * 1e-3
    rng = np.random.default_rng(7)
    speed = 12.0 * (np.cos(2.5 * time) if reverses else 1.0) + 3.0 * (time > 0.8) * np.exp(-(time - 0.8) * 9)
    theta = np.cumsum(speed) * 1e-3
    omega = speed + 0.4 * np.sin(8 * theta) + 0.1 * np.cos(2.5 * theta) + 0.01 * rng.standard_normal(2000)
    current = 0.5 + 0.2 * np.sin(8 * theta + 1)
    columns = [
        time, theta, omega, speed * 0 + 12.0, 0.01 * current, current,
        current + 0.01 * rng.standard_normal(2000),
    ]  # fmt: skip
    return Trace(tuple(NAMES), tuple(NAMES.values()), np.column_stack(columns))


def metrics():
    """Each kind, in several windows and frames."""
    for n, window in enumerate(WINDOWS):
        for kind in ("peak-to-peak", "rms", "ripple-rms", "three-sigma", "ripple-ratio", "mean", "maximum"):
            for signal in ("omega_m", "omega_error", "i_amplitude"):
                yield {"name": f"{kind[0]}{n}", "kind": kind, "signal": signal, **window}
        for frame, orders in (("mechanical", [8, 2.5]), ("electrical", [2, 1])):
            yield {
                "name": f"o{n}",
                "kind": "order",
                "signal": "omega_m",
                "order": orders,
                "frame": frame,
                **window,
            }
        yield {"name": f"c{n}", "kind": "copper-loss", **window}
        yield {"name": f"h{n}", "kind": "chattering", **window}
    yield {"name": "e", "kind": "rms", "signal": "omega_m", "frame": "electrical"}
    for event in ("0.8 s", "1.5 s"):
        for smooth in ({}, {"smooth": "50 ms"}):
            yield {"name": "d", "kind": "dip", "event": event, **smooth}
            yield {"name": "s", "kind": "settling", "event": event, "band": "1 rad/s", **smooth}
            for signal in ("i_q", "omega_m", "omega_error"):
                yield {"name": "v", "kind": "overshoot", "event": event, "signal": signal, **smooth}
    for band in ("0.1 rad/s", "1.5 rad/s", "9 rad/s", "90 rad/s"):
        yield {"name": "t", "kind": "time-to-learn", "signal": "omega_error", "smooth": "31 ms", "band": band}
    yield {"name": "x", "kind": "exceeds", "signal": "omega_m", "band": "0.6 rad/s"}
    yield {"name": "y", "kind": "exceeds", "signal": "i_q", "band": "1 A"}


def flat(value):
    return [math.nan if x is None else x for x in (value if isinstance(value, list) else [value])]


@pytest.mark.parametrize("reverses", [False, True])
def test_each_kind_in_each_window(tmp_path, reverses):
    study, ran = load("uomodri"), trace(reverses)
    all_of = [Metric.model_validate(table) for table in metrics()]
    rows = [[None if math.isnan(x) else x for x in row] for row in ran.data.tolist()]
    listed = [_metric(study, "slow", metric) for metric in all_of]
    given = {"names": list(NAMES), "rows": rows, "metrics": listed, "about": ABOUT}
    made = run_node(tmp_path, ("metrics.js",), COMPUTE, given)
    conditions = Conditions(**{**ABOUT, "events": tuple(ABOUT["events"])})
    for metric, value in zip(all_of, made["values"], strict=True):
        wanted = evaluate(metric, ran, conditions)
        assert flat(value) == pytest.approx(flat(wanted), rel=1e-9, abs=1e-12, nan_ok=True), result_name(
            metric
        )
    of_trials = {"first-rms", "final-rms", "trials-to-floor"}
    assert set(made["kinds"]) == METRIC_FUNCTIONS.keys() - of_trials


@pytest.mark.parametrize("short", [9e-4, 6e-4, 2e-4, -2e-4, 1.1e-3])
@pytest.mark.parametrize(("frame", "order"), [("mechanical", 8), ("electrical", 2)])
def test_a_window_may_be_a_hair_short_of_a_whole_revolution(tmp_path, short, frame, order):
    """In 20,001 rows a revolution two rows are far less than the thousandth that is forgiven."""
    theta = (
        2
        * np.pi
        * (1 - short)
        * np.linspace(0, 1, 20_001)
        / (ABOUT["pole_pairs"] if frame == "electrical" else 1)
    )
    time, omega = np.arange(20_001) * 1e-4, 12 + 1.5 * np.cos(8 * theta)
    ran = Trace(("time", "theta_m", "omega_m"), ("s", "rad", "rad/s"), np.column_stack([time, theta, omega]))
    metric = Metric.model_validate(
        {"name": "o", "kind": "order", "signal": "omega_m", "order": [order], "frame": frame}
    )
    given = {
        "names": list(ran.names),
        "rows": ran.data.tolist(),
        "metrics": [_metric(load("uomodri"), "slow", metric)],
        "about": ABOUT,
    }
    (page,) = run_node(tmp_path, ("metrics.js",), COMPUTE, given)["values"]
    report = evaluate(metric, ran, Conditions(**{**ABOUT, "events": ()}))
    assert flat(page) == pytest.approx(flat(report), rel=1e-9, nan_ok=True)
    assert np.isfinite(report[0]) == (short < TURN_SHORTFALL_MOST)
    if short < TURN_SHORTFALL_MOST:
        assert report[0] == pytest.approx(1.5, rel=2e-3)
    spectrum = order_spectrum(theta, omega, 12, ABOUT["pole_pairs"])
    if short > TURN_SHORTFALL_MOST:  # of a mechanical revolution the electrical ones before are left
        assert spectrum is None if frame == "electrical" else np.isnan(spectrum[1])
    else:
        assert spectrum[8] == pytest.approx(1.5, rel=2e-3) and np.isnan(spectrum[1]) == (
            frame == "electrical"
        )


JUDGED = """
const { Trace, judged } = liveMetrics, { names, about, times, metrics } = given;
const trace = new Trace({ rows: Float64Array.from(times), count: times.length, columns: 1, names });
return metrics.map((m, n) => judged(m, given.beside[n], trace, about));
"""


@pytest.mark.parametrize("events", [(), (0.8, 1.5), (0.8, 1.99, 1.9902)])
def test_a_metric_is_judged_over_the_rows_of_the_report(tmp_path, events):
    """Its window, else from its event to the row before the next, else as far as spectra go."""
    time = np.arange(2000) * 1e-3
    ran = Trace(("time",), ("s",), time[:, np.newaxis])
    rms, order = {"kind": "rms", "signal": "omega_m"}, {"kind": "order", "signal": "omega_m", "order": [8]}
    dip = {"kind": "dip", "signal": "omega_m"}
    metrics = [
        Metric.model_validate({"name": f"m{n}", **table})
        for n, table in enumerate(
            [
                rms,
                {**rms, "last": "0.5 s"},
                {**rms, "window": ["0.3 s", "1.2 s"]},
                order,
                {**order, "last": "1 s"},
            ]
            + [{**dip, "event": f"{event} s"} for event in events]
        )
    ]
    study = load("uomodri")
    listed = [_metric(study, "slow", metric) for metric in metrics]
    beside = [listed, *([one] for one in listed[1:])]
    about = {**ABOUT, "events": list(events)}
    given = {"names": ["time"], "times": time.tolist(), "about": about, "metrics": listed, "beside": beside}
    page = run_node(tmp_path, ("metrics.js",), JUDGED, given)
    for n, (metric, mine) in enumerate(zip(metrics, page, strict=True)):
        in_study = SimpleNamespace(
            metrics_in=lambda _, n=n: metrics if n == 0 else [metrics[n]],
            scenario={"slow": SimpleNamespace(events=[SimpleNamespace(time=event) for event in events])},
        )
        run = SimpleNamespace(trace=ran, scenario="slow")
        rows = rows_of(SimpleNamespace(study=in_study), metric, run)
        assert mine == [rows.start, rows.stop], metric
        if metric.event is not None or metric.span(2.0) is not None:
            assert rows == ran.window(*window_of(metric, ran, events))
    assert page[0] == page[4]  # the window of the last order metric


MISSED = """
const { Trace, missed } = liveMetrics, { names, about, traces } = given;
const count = given.traces[0].length, columns = names.length;
const of = (rows) => new Trace({ rows: Float64Array.from(rows.flat()), count, columns, names });
return traces.map((rows) => missed([0, count], of(rows), about.tracking));
"""


def test_a_speed_that_was_not_held_is_said_as_in_the_report(tmp_path):
    time = np.arange(2000) * 1e-3
    steady, swing, rest = (12.0 + 0 * time, 8.0 * np.cos(9 * time), 0 * time)
    stood = [(steady, rest), (steady, 0.9 * steady), (swing, rest), (rest, swing), (swing, -swing)]
    held = [
        (steady, 0.97 * steady),
        (steady, steady * (time > 0.9)),
        (swing, 0.8 * swing),
        (rest, 0.01 * swing),
    ]
    pairs = [np.column_stack([time, *pair]) for pair in stood + held]
    names = {name: unit for name, unit in NAMES.items() if name in ("time", "omega_ref", "omega_m")}
    order = ("time", "omega_ref", "omega_m")
    tracking = {
        "far": MEAN_ERROR_MOST,
        "jerks": JERKS_RATIO,
        "lost": LOST_SPEED_RATIO,
        "drift": REST_ERROR_MOST,
        "one_way": ONE_WAY,
    }
    given = {
        "names": order,
        "about": {"events": [], "tracking": tracking},
        "traces": [x.tolist() for x in pairs],
    }
    found = run_node(tmp_path, ("metrics.js",), MISSED, given)
    for n, (rows, mine) in enumerate(zip(pairs, found, strict=True)):
        ran = Trace(order, tuple(names[name] for name in order), rows)
        told = missed(SimpleNamespace(trace=ran), slice(None), "rad/s")
        assert (mine is None) == (told is None) == (n >= len(stood))
        if mine and mine["kind"] == "mean":
            assert told == f"mean {mine['got']:.4g} of {mine['wanted']:.4g} rad/s"
    given["about"]["tracking"]["torque"] = [1.5, 3.0]  # an outer loop's current acts in a part of these rows
    assert run_node(tmp_path, ("metrics.js",), MISSED, given) == [None] * len(pairs)
    given["about"]["tracking"]["torque"] = [2.5, 3.0]
    assert run_node(tmp_path, ("metrics.js",), MISSED, given) == found
