"""The share of a true error that comes from the position sensor's own error, which no law can see.

A law follows its sensor's signal. The true error E is the measured error M, which the law sees, plus the
sensor's own error S: E = M + S. The share 1 - M^2 / E^2 of E's square is attributed to S. It is nearly one if
a law follows S. If no law can follow S, as with an encoder's steps, M is larger than E, and nothing is
attributed to S.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from cogless.report.comparison import Line, runs_in
from cogless.results import Results, Run
from cogless.results.metrics import Conditions, evaluate
from cogless.study.metric import Metric
from cogless.units import factor

MOST = 0.5  # share of the square above which the sensor's error dominates
# For each true signal, the measured signal that a law sees.
SEEN = {
    "omega_m": "omega_measured",
    "omega_error": "omega_error_measured",
    "theta_m": "theta_measured",
    "theta_error": "theta_error_measured",
}
# For each kind of metric, the kind from which its share is computed: one whose squares add up.
SQUARES = {
    "rms": "rms",
    "maximum": "rms",
    "ripple-rms": "ripple-rms",
    "three-sigma": "ripple-rms",
    "peak-to-peak": "ripple-rms",
    "order": "order",
}


@dataclass(frozen=True)
class Sensor:
    """A comparison line of measured values, and the sensor's share of each true value's square."""

    seen: Line
    shares: Mapping[str, float]

    def dominates(self, controller: str) -> bool:
        """Whether most of a controller's remaining error is the sensor's own error."""
        return self.shares[controller] > MOST

    def percent(self, controller: str) -> str:
        """The sensor's share of a controller's squared value, such as "99 %"."""
        return f"{100 * self.shares[controller]:.0f} %"


def sensor(results: Results, scenario: str, line: Line) -> Sensor | None:
    """The sensor's part of a scenario's line; None if the metric has none, or a value or trace is missing."""
    metric = next((m for m in results.study.metrics_in(scenario) if m.name == line.name), None)
    if metric is None or metric.signal not in SEEN or metric.kind not in SQUARES:
        return None
    conditions, measured = Conditions.of(results.study, scenario), SEEN[metric.signal]
    seen, shares = {}, {}
    for run in runs_in(results, scenario):
        if line.values.get(run.controller) is None:
            continue
        if not len(run.trace) or measured not in run.trace:
            return None
        true, left = (
            _value(run, metric, line, signal, SQUARES[metric.kind], conditions)
            for signal in (metric.signal, measured)
        )
        if not (true > 0 and math.isfinite(true + left)):
            return None
        shares[run.controller] = 1 - (left / true) ** 2
        value = _value(run, metric, line, measured, metric.kind, conditions)
        seen[run.controller] = value / factor(line.unit, metric.dimension)
    if not shares:
        return None
    name = f"{line.name} as measured"
    return Sensor(replace(line, name=name, signal=measured, values=seen), shares)


def _value(run: Run, metric: Metric, line: Line, signal: str, kind: str, conditions: Conditions) -> float:
    """The metric's value, SI, with another signal and kind; for an order metric, at the line's order."""
    value = evaluate(metric.model_copy(update={"signal": signal, "kind": kind}), run.trace, conditions)
    if isinstance(value, list):
        return value[list(metric.order or ()).index(line.order or 0.0)]
    return math.nan if value is None else value
