"""Controllers against metrics: one line a number, in display units, best marked, ratio to the baseline.

The report's table, the verdict and the terminal's table all come from here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from cogless.metrics import result_name
from cogless.results import Results
from cogless.units import factor

QUANTITIES = {
    "omega_m": "speed",
    "omega_error": "speed error",
    "omega_measured": "measured speed",
    "theta_m": "angle",
    "tau_e": "electric torque",
    "tau_motor": "motor torque",
    "tau_load": "load torque",
    "i_q_ref": "current reference",
    "i_d": "d current",
    "i_q": "q current",
    "i_a": "phase current",
    "i_b": "phase current",
    "i_c": "phase current",
    "i_amplitude": "current",
}


@dataclass(frozen=True)
class Line:
    """One number of each controller in a scenario; values in `unit`, None: never (or not finite)."""

    name: str
    kind: str
    signal: str | None
    order: float | None
    frame: str
    better: str
    unit: str
    values: Mapping[str, float | None]

    @property
    def title(self) -> str:
        """Such as "speed ripple" or "speed orders: order 6 (electrical)"."""
        words = self.name.replace("_", " ").replace("-", " ")
        return words if self.order is None else f"{words}: order {self.order:g} ({self.frame})"

    @property
    def quantity(self) -> str:
        """What is measured, for a sentence: "speed order 6 (electrical)"."""
        if self.order is None:
            return self.name.replace("_", " ").replace("-", " ")
        signal = QUANTITIES.get(self.signal or "", self.signal)
        return f"{signal} order {self.order:g} ({self.frame})"

    @property
    def best(self) -> set[str]:
        """Controllers with the best value; empty where none is better than another."""
        if self.better not in ("lower", "higher") or len(self.values) < 2:
            return set()
        sign = 1 if self.better == "lower" else -1
        ranks = {name: math.inf if v is None else sign * v for name, v in self.values.items()}
        top = min(ranks.values())
        best = {name for name, rank in ranks.items() if math.isclose(rank, top, rel_tol=1e-9)}
        return best if len(best) < len(ranks) else set()

    def ratio(self, controller: str, baseline: str) -> float | None:
        """A controller's value over the baseline's; None where that says nothing."""
        value, base = self.values.get(controller), self.values.get(baseline)
        if value is None or base is None or base == 0 or self.better == "none" or value / base < 0:
            return None
        return value / base

    def text(self, controller: str) -> str:
        """A controller's value with its unit, "never", or "" where there is none."""
        if controller not in self.values:
            return ""
        value = self.values[controller]
        return "never" if value is None else f"{number(value)} {self.unit}".rstrip()


def compare(results: Results, scenario: str) -> list[Line]:
    """The lines of a scenario, in the study's order of metrics; an order metric has a line for each order."""
    runs = [run for run in results.runs if run.scenario == scenario]
    lines = []
    for metric in results.study.metrics_in(scenario):
        name = result_name(metric)
        values = {run.controller: run.metrics[name] for run in runs if name in run.metrics}
        if not values:
            continue
        unit = metric.unit or metric.dimension.unit
        scale = factor(unit, metric.dimension) if metric.unit else 1.0
        orders = list(metric.order or ()) if metric.kind == "order" else [None]
        for place, order in enumerate(orders):
            column = {c: v[place] if isinstance(v, list) else v for c, v in values.items()}
            shown = {c: v / scale if v is not None and math.isfinite(v) else None for c, v in column.items()}
            lines.append(
                Line(
                    metric.name,
                    metric.kind,
                    metric.signal,
                    order,
                    metric.frame,
                    metric.better,
                    pretty(unit),
                    shown,
                )
            )
    return lines


def factor_text(ratio: float) -> str:
    """A ratio for a table, such as 0.096, 1.03 or 250 times, with the sign of multiplication."""
    if ratio < 0.1:
        return f"\u00d7\u202f{ratio:.2g}"
    return f"\u00d7\u202f{ratio:.2f}" if ratio < 100 else f"\u00d7\u202f{ratio:.0f}"


def pretty(unit: str) -> str:
    """A unit as it is printed: "N·m"."""
    return unit.replace("*", "·").replace("^2", "²").replace("ohm", "Ω")


def number(value: float) -> str:
    """Three significant digits, without an exponent where it stays readable."""
    if value == 0 or not 1e-4 <= abs(value) < 1e6:
        return f"{value:.3g}"
    digits = max(0, 2 - math.floor(math.log10(abs(value)) + 1e-9))
    return f"{value:.{digits}f}"
