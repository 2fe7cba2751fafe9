"""The verdict: a few sentences a scenario, from its numbers alone, whichever way they fall."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.report.comparison import Line, compare, number, pretty
from cogless.results import Results, Run
from cogless.units import ANGULAR_SPEED, convert

SAME = 0.02  # relative difference that isn't called one
COST = 0.01  # a metric that gets worse by less isn't called a cost


@dataclass(frozen=True)
class Verdict:
    """`tone`: "better" where a law that learns is the best, "worse" where the baseline is, else "even"."""

    scenario: str
    tone: str
    headline: str
    details: Sequence[str]


def verdicts(results: Results, speed_unit: str) -> list[Verdict]:
    """One for each scenario that has runs and metrics."""
    return [v for scenario in results.scenarios if (v := _verdict(results, scenario, speed_unit)) is not None]


def _verdict(results: Results, scenario: str, speed_unit: str) -> Verdict | None:
    lines = [line for line in compare(results, scenario) if line.better == "lower"]
    runs = [run for run in results.runs if run.scenario == scenario]
    baseline = results.study.baseline
    line = _decisive(lines, baseline)
    if line is None:
        return None
    label = {name: results.study.label(name) for name in results.study.controller}
    where = _place(runs[0], speed_unit)
    others = [c for c, v in line.values.items() if c != baseline and v is not None]
    others.sort(key=lambda c: (line.values[c], c))
    if line.values.get(baseline) is None or not others:
        parts = ", ".join(f"{label[c]} {line.text(c)}" for c in line.values)
        return Verdict(
            scenario, "even", f"{where}, {line.quantity}: {parts}.", ["There is nothing to compare."]
        )
    best = others[0]
    ratio = _ratio(line, best, baseline)
    base = f"{label[baseline]} ({line.text(baseline)})"
    if ratio < 1 - SAME:
        learns = results.study.controller[best].law != "pi"
        tone = "better" if learns else "even"
        headline = f"{where}, {label[best]} {_has(line, best)}, {_less(ratio)} {base}."
    elif ratio <= 1 + SAME:
        tone = "even"
        headline = f"{where}, all are alike: {label[best]} {_has(line, best)}, {base}."
    else:
        tone = "worse"
        headline = (
            f"{where}, no controller beats {label[baseline]}: it {_has(line, baseline)}; "
            f"the next, {label[best]}, {line.text(best)} ({_change(ratio)})."
        )
    details = [
        _without_learning(results, line, best, label),
        _costs(lines, line, best, baseline, label),
        _rest(line, others[1:], baseline, label),
        *_never(lines, label),
    ]
    return Verdict(scenario, tone, headline, [sentence for sentence in details if sentence])


def _has(line: Line, controller: str) -> str:
    """What a controller does, such as "leaves 0.46 rpm of speed order 6 (electrical)"."""
    if line.kind == "dip":
        return f"is thrown off by {line.text(controller)} ({line.quantity})"
    return f"leaves {line.text(controller)} of {line.quantity}"


def _decisive(lines: Sequence[Line], baseline: str) -> Line | None:
    """What the verdict is about: the baseline's strongest order, else a dip, a ripple, the first metric."""
    lines = [line for line in lines if line.kind != "mean"]  # it may be negative
    first = next((line.name for line in lines if line.kind == "order"), None)
    orders = [line for line in lines if line.name == first and line.values.get(baseline) is not None]
    if orders:
        return max(orders, key=lambda line: line.values[baseline] or 0.0)
    dips = [line for line in lines if line.kind == "dip"]
    ripples = [line for line in lines if line.kind in ("ripple-rms", "peak-to-peak")]
    return next(iter([*dips, *ripples, *lines]), None)


def _place(run: Run, speed_unit: str) -> str:
    """ "At 60 rpm" where the reference stays constant, else "In the scenario's name"."""
    reference = run.trace["omega_ref"][len(run.trace) // 4 :]
    if len(reference) == 0 or np.ptp(reference) > 1e-6 * max(1e-9, float(np.max(np.abs(reference)))):
        return f"In {run.scenario}"
    speed = convert(float(reference[-1]), speed_unit, ANGULAR_SPEED)
    return f"At {speed:.4g} {pretty(speed_unit)}"


def _without_learning(results: Results, line: Line, best: str, label: dict[str, str]) -> str:
    """The fair bar: the winner beside the best feedback that doesn't learn, unless that's the baseline."""
    laws = {name: c.law for name, c in results.study.controller.items()}
    plain = [c for c, v in line.values.items() if laws[c] == "pi" and v is not None]
    if laws[best] == "pi":
        learning = [c for c, v in line.values.items() if laws[c] != "pi" and v is not None]
        if not learning:
            return ""
        nearest = min(learning, key=lambda c: line.values[c] or 0.0)
        return (
            f"{label[best]} doesn't learn; the best that does is {label[nearest]} with {line.text(nearest)}."
        )
    rival = min(plain, key=lambda c: line.values[c] or 0.0, default=None)
    if rival is None or rival == results.study.baseline:
        return ""
    ratio = line.ratio(rival, best)
    if ratio is None:
        return ""
    if ratio <= 1 + SAME:
        return f"The best without learning, {label[rival]}, does about as well ({line.text(rival)})."
    return (
        f"That is {_times(ratio)} less than the best without learning, {label[rival]} ({line.text(rival)})."
    )


def _costs(lines: Sequence[Line], decisive: Line, best: str, baseline: str, label: dict[str, str]) -> str:
    """Which other metrics get worse with the winner, and by how much."""
    costs, compared = [], 0
    for line in lines:
        ratio = line.ratio(best, baseline)
        if line is decisive or ratio is None:
            continue
        compared += 1
        if ratio > 1 + COST:
            more = f"+{100 * (ratio - 1):.0f} %" if ratio < 2 else f"{_times(ratio)} the"
            costs.append(f"{more} {line.quantity} ({line.text(best)})")
    if not compared:
        return ""
    if not costs:
        return f"None of the {compared} other numbers gets worse."
    return f"{label[best]} costs {_listed(costs)}."


def _rest(line: Line, others: Sequence[str], baseline: str, label: dict[str, str]) -> str:
    """The other controllers, in one sentence."""
    parts = []
    for controller in others:
        parts.append(
            f"{label[controller]} {line.text(controller)} ({_change(_ratio(line, controller, baseline))})"
        )
    return f"The others against {label[baseline]}: {_listed(parts)}." if parts else ""


def _never(lines: Sequence[Line], label: dict[str, str]) -> list[str]:
    sentences = []
    for line in lines:
        unsettled = [label[c] for c, v in line.values.items() if v is None]
        if line.kind == "settling" and unsettled:
            sentences.append(f"In {line.quantity}, {_listed(unsettled)} never settled.")
    return sentences


def _ratio(line: Line, controller: str, baseline: str) -> float:
    """A controller's value over the baseline's; infinite where only the baseline has nothing."""
    mine, base = line.values[controller] or 0.0, line.values[baseline] or 0.0
    return mine / base if base else math.inf if mine else 1.0


def _less(ratio: float) -> str:
    return f"{_times(1 / ratio)} less than" if ratio else "against"


def _change(ratio: float) -> str:
    if abs(ratio - 1) <= SAME:
        return "as much"
    if ratio < 1:
        return f"{_times(1 / ratio)} less" if ratio else "nothing left"
    return f"worse: {_times(ratio)} as much" if math.isfinite(ratio) else "worse"


def _times(ratio: float) -> str:
    return f"{number(ratio) if ratio < 100 else f'{ratio:.0f}'} times"


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
