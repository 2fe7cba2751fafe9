"""The page's metrics against cogless's, on random traces: at rest, reversing, diverged, sparse, and short."""

import math

import numpy as np
import pytest
from node import NO_NODE, run_node

from cogless import load
from cogless.errors import StudyError
from cogless.live.live_page import _metric
from cogless.results.metrics import METRIC_FUNCTIONS, evaluate
from cogless.results.trace import Trace
from cogless.study.metric import (
    AT_AN_EVENT,
    CARRIAGE_ORDERS,
    EACH_PHASE,
    OF_A_CARRIAGE,
    SIGNAL_DIMENSIONS,
    WITH_A_BAND,
    Conditions,
    Metric,
)

pytestmark = pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)

CASES = 60  # traces
METRICS = 40  # of each trace
CARRIAGE_RADIUS = 6.4e-3  # m/rad
SIGNALS = ("omega_m", "omega_error", "i_q", "i_amplitude", "i_d", "theta_m", "omega_measured", "tau_motor")
NAMES = ("time", "theta_m", "omega_m", "omega_ref", "i_d", "i_q", "i_q_ref", "i_d_ref", "theta_load")
OF_DRIVES = sorted(METRIC_FUNCTIONS.keys() - set(EACH_PHASE))
ORDERS = (1.0, 2.0, 8.0, 2.5, 0.5, 1 / 3, 0.33333, 2.0005, 1.999)
# Each value with what JSON has no word for.
COMPUTE = """
const numbers = { nan: NaN, inf: Infinity, "-inf": -Infinity };
const number = (x) => (x === null ? "never" : Number.isFinite(x) ? x : `${x}`);
const told = (x) => (x === undefined ? "missing" : Array.isArray(x) ? x.map(number) : number(x));
const { Trace, evaluate, ofPhases } = liveMetrics;
return given.map(({ names, rows, metrics, about, trials }) => {
  const all = Float64Array.from(rows.flat().map((x) => numbers[x] ?? x));
  if (trials) return metrics.map((m) => told(ofPhases(m, all, about.starts)));
  const trace = new Trace({ rows: all, count: rows.length, columns: names.length, names });
  return metrics.map((m) => told(evaluate(m, trace, about)));
});
"""


def speed_of(draw, time):
    """A speed over time, and its reference, rad/s."""
    end, level = time[-1] or 1.0, draw.choice([-12.0, 3.0, 40.0])
    return [
        lambda: (level + 0 * time, level + 0 * time),
        lambda: (0 * time, level + 0 * time),  # it stays at rest
        lambda: (level * np.clip(3 * time / end - 1, 0, 1), level * (time > end / 3)),  # it starts from rest
        lambda: (level * np.cos(7 * time / end), level * np.cos(7 * time / end + 0.1)),  # it reverses
        lambda: (level * np.exp(-5 * time / end), 0 * time),  # it stops, often within a revolution
    ][draw.integers(5)]()


def random_trace(draw):
    count = int(draw.choice([1, 2, 3, 7, 50, 1001, 2500]))
    period = float(draw.choice([1e-3, 5e-4, 1 / 3000, 0.0123]))
    time = np.arange(count) * period
    speed, reference = speed_of(draw, time)
    theta = np.cumsum(speed) * period * draw.choice([1.0, 20.0])
    omega = speed + 0.4 * np.sin(8 * theta) + draw.choice([0.0, 0.05]) * draw.standard_normal(count)
    current = 0.5 + 0.2 * np.sin(8 * theta + 1)
    columns = [time, theta, omega, reference, 0.01 * current, current, np.round(current, 2), 0 * time]
    columns.append(theta + 1e-3 * np.sin(8 * theta))
    data = np.column_stack(columns)
    row, column = int(draw.integers(count)), int(draw.integers(1, len(NAMES)))
    if draw.random() < 0.2:  # it diverges
        data[row:, [1, 2, 3, 4, 5, 8]] = np.nan
    elif draw.random() < 0.2:  # one value is missing
        data[row, column] = np.nan
    return Trace(NAMES, tuple("s" if name == "time" else "" for name in NAMES), data)


def random_metric(draw, end, events):
    """A table of a metric, with an own choice of window, event, mean and frame."""
    kind = str(draw.choice(OF_DRIVES))
    signal = str(draw.choice(SIGNALS))
    table = {"name": "m", "kind": kind, "frame": str(draw.choice(["mechanical", "electrical"]))}
    unit = SIGNAL_DIMENSIONS[signal].unit
    if kind == "carriage-ripple":
        signal = str(draw.choice(OF_A_CARRIAGE))
    if kind not in ("copper-loss", "chattering"):
        table["signal"] = signal
    if kind == "order":
        table["order"] = [float(order) for order in draw.choice(ORDERS, draw.integers(1, 4), replace=False)]
    if kind in AT_AN_EVENT:
        table["event"] = f"{draw.choice(events)!s} s"
    else:
        first = float(draw.uniform(-0.2, 1.1) * end)
        window = [
            f"{max(first, 0):.7g} s",
            f"{max(first, 0) + draw.choice([1e-5, 0.3, 2.0]) * end + 1e-6:.7g} s",
        ]
        table |= [{}, {"last": f"{draw.uniform(0.01, 1.2) * end + 1e-5:.6g} s"}, {"window": window}][
            draw.integers(3)
        ]
    if kind in WITH_A_BAND:
        table["band"] = f"{draw.choice([1e-9, 0.05, 0.5, 15.0])} {unit}"
    if kind == "time-to-learn" or (kind in AT_AN_EVENT and draw.random() < 0.5):
        table["smooth"] = f"{draw.choice([1, 2, 7, 15, 29, 31, 33, 500])} ms"
    return Metric.model_validate(table)


def words(value):
    """A value as COMPUTE says it."""
    if isinstance(value, list):
        return [words(x) for x in value]
    return (
        "never"
        if value is None
        else value
        if math.isfinite(value)
        else "NaN"
        if value != value
        else "Infinity"
    )


def by_python(metric, trace, conditions):
    try:
        return words(evaluate(metric, trace, conditions))
    except StudyError as error:
        return "missing" if "signal" in str(error) else "NaN"  # such as a window without a row


def rows_of_json(data):
    return [[x if math.isfinite(x) else str(x) for x in row] for row in data.tolist()]


def case(draw):
    trace = random_trace(draw)
    end = float(trace.time[-1]) or 1.0
    events = sorted(round(float(share) * end, 6) for share in draw.uniform(0.0, 1.0, 2))
    about = {"pole_pairs": int(draw.choice([1, 4, 7])), "R_s": 0.7, "power_factor": 1.5, "events": events}
    about["speed_period"] = float(draw.choice([1e-3, 2e-3, 1e-2]))
    about["pwm_period"] = float(draw.choice([0.0, 16 * trace.period, 33 * trace.period, 8e-3]))
    return trace, about, [random_metric(draw, end, events) for _ in range(METRICS)]


def of_belt(metric):
    """A metric of a page whose study has a belt, which that of these tests has not."""
    belt = {"radius": CARRIAGE_RADIUS, "carriage_orders": CARRIAGE_ORDERS}
    return metric | belt if metric["kind"] == "carriage-ripple" else metric


def same(page, report):
    if isinstance(report, list):
        return len(page) == len(report) and all(map(same, page, report))
    if isinstance(page, str) or isinstance(report, str):
        return page == report
    return page == pytest.approx(report, rel=1e-9, abs=1e-10)


def test_random_metrics_of_random_traces(tmp_path):
    draw, study = np.random.default_rng(39), load("uomodri")
    cases = [case(draw) for _ in range(CASES)]
    given = [
        {
            "names": list(NAMES),
            "rows": rows_of_json(trace.data),
            "about": about,
            "metrics": [of_belt(_metric(study, "slow", metric)) for metric in metrics],
        }
        for trace, about, metrics in cases
    ]
    page = run_node(tmp_path, ("metrics.js",), COMPUTE, given)
    reports = [
        [
            by_python(
                metric,
                trace,
                Conditions(**{**about, "events": tuple(about["events"])}, carriage_radius=CARRIAGE_RADIUS),
            )
            for metric in metrics
        ]
        for trace, about, metrics in cases
    ]
    differ = [
        (metric.model_dump(exclude_none=True), len(trace), about, mine, theirs)
        for (trace, about, metrics), mines, of_report in zip(cases, page, reports, strict=True)
        for metric, mine, theirs in zip(metrics, mines, of_report, strict=True)
        if not same(mine, theirs)
    ]
    assert not differ, "\n".join(map(str, differ[:40])) + f"\n{len(differ)} differ"
    values = [value for report in reports for value in report]
    assert {metric.kind for _, _, metrics in cases for metric in metrics} == set(OF_DRIVES)
    assert {"never", "NaN", "missing"} <= {value for value in values if isinstance(value, str)}
    assert sum(not isinstance(value, str) for value in values) > len(values) / 3


def test_random_phases_of_random_trials(tmp_path):
    draw, study = np.random.default_rng(40), load("uomodri")
    given, reports = [], []
    for _ in range(60):
        trials, samples = int(draw.integers(1, 14)), int(draw.integers(1, 5))
        starts = sorted({1, *(int(n) for n in draw.integers(1, trials + 1, draw.integers(0, 4)))})
        error = draw.standard_normal((trials, samples)) * 0.7 ** np.arange(trials)[:, None]
        if draw.random() < 0.3:
            error[draw.integers(trials), 0] = np.nan
        tables = [
            {"kind": "first-rms"},
            {"kind": "final-rms"},
            {"kind": "trials-to-floor", "floor": "0.2 rad"},
        ]
        metrics = [Metric.model_validate({"name": "m", "signal": "theta_error", **table}) for table in tables]
        trace = Trace(
            ("time", "theta_error"), ("s", "rad"), np.column_stack([np.arange(error.size), error.ravel()])
        )
        conditions = Conditions(trials=trials, starts=tuple(starts))
        reports.append([by_python(metric, trace, conditions) for metric in metrics])
        listed = [_metric(study, "slow", metric) for metric in metrics]
        rms = np.sqrt(np.mean(error**2, axis=1, keepdims=True))
        about = {"starts": starts}
        given.append({"rows": rows_of_json(rms), "metrics": listed, "about": about, "trials": trials})
    page = run_node(tmp_path, ("metrics.js",), COMPUTE, given)
    assert all(map(same, page, reports)), [
        pair for pair in zip(page, reports, strict=True) if not same(*pair)
    ][:5]
