"""Faults of a scenario in words: what failed, and how each controller responded."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from cogless.report.comparison import speed_unit
from cogless.report.markup import number
from cogless.report.panels import varies
from cogless.report.speed_tracking import missed
from cogless.report.verdicts import Paragraph, ScenarioVerdict, times
from cogless.results import Results, Run
from cogless.results.fault_response import Fault, Response, faults_in, ripple, without_faults
from cogless.units import ANGULAR_SPEED, factor

OVERSHOOT_MOST = 1.05  # largest current / its limit; more than a current loop's usual overshoot
# Ripple after a fault / usual ripple, above which it is worse: the usual ripple changes by a tenth per turn.
WORSE_RATIO = 1.25
RIPPLE_SHARE_LEAST = 1e-4  # share of the speed; a smaller ripple is not called worse
SPEED_SPREAD_MOST = 0.05  # largest relative difference of speeds at which two ripples are compared
UNBROKEN = r"(?<=\d) (?=(m?s|A|of \d)\b)| (?=\(rpm)"  # spaces at which a line must not break
FAULTS_SHOWN = 3  # largest number of faults in a scenario's verdict; results.json has all


def account(results: Results, runs: Sequence[Run]) -> ScenarioVerdict | None:
    """The verdict on a scenario's faults and their effects; None if it has no faults.

    Its `tone` is the best that the scenario's overall tone may be; "better" doesn't limit that.
    """
    runs = [run for run in runs if run.faults]
    if not runs:
        return None
    faults = [response.fault for response in runs[0].faults]
    words = [f"{_seconds(fault.time)}: {what(fault)}" for fault in faults]
    parts = [
        Paragraph(
            words[place] if len(faults) > 1 else "",
            [(run.controller, _sentence(results, run, run.faults[place])) for run in runs],
        )
        for place in range(min(FAULTS_SHOWN, len(faults)))
    ]
    more = len(faults) - FAULTS_SHOWN
    if more > 0:
        others = "One more fault is" if more == 1 else f"{more} more faults are"
        parts.append(Paragraph(f"{others} in results.json.", []))
    broke = words[0] if len(faults) == 1 else f"{len(faults)} faults, the first at {words[0]}"
    tone, outcome = _outcome(results, runs)
    return ScenarioVerdict(runs[0].scenario, tone, f"{broke}. {outcome}".rstrip(), [], parts)


def what(fault: Fault) -> str:
    """A fault in words, such as "position sensor stuck for 0.5 s"."""
    lasts = "to the end" if fault.lasting else f"for {_seconds(fault.end - fault.time)}"
    return f"{' and '.join(fault.words)} {lasts}"


def spans(
    results: Results, runs: Sequence[Run], start: float, end: float
) -> list[tuple[Fault, float, float]]:
    """Each fault with start and end, s, of the time to show: a little before it to a turn or more after."""
    of_faults = []
    for place, fault in enumerate(faults_in(results.study, runs[0].scenario)):
        if not start <= fault.time < end:
            continue
        length = fault.end - fault.time
        before = runs[0].faults[place].before if place < len(runs[0].faults) else None
        turn = before[1] - before[0] if before else 0.2
        turn = min(turn, max(1.0, 5 * length))
        since, until = fault.time - max(0.3 * length, 0.25 * turn), fault.end + max(length, turn)
        of_faults.append((fault, max(start, since), min(end, until)))
    return of_faults


def _outcome(results: Results, runs: Sequence[Run]) -> tuple[str, str]:
    """The tone, and sentences on controllers that exceeded the limit, lost the speed or have more ripple."""
    over, lost, worse = [], [], []
    judged, cases = 0, sum(len(run.faults) for run in runs)
    for run in runs:
        label = results.study.label(run.controller)
        peak = max(run.faults, key=_limit_ratio)
        if _limit_ratio(peak) > OVERSHOOT_MOST:
            current = (
                f"{number(peak.largest_current or 0.0)} A"
                if math.isfinite(_limit_ratio(peak))
                else "no number"
            )
            over.append(f"{label} {current} (limit {peak.current_limit:.3g} A)")
        how = next((text for response in run.faults if (text := _lost(results, run, response))), None)
        if how is not None:
            lost.append(f"{label} ({how})")
            continue
        ratios = [_times_usual(results, run, response) for response in run.faults]
        ratios_known = [ratio for ratio in ratios if ratio is not None]
        judged += len(ratios_known)
        if max(ratios_known, default=0.0) > WORSE_RATIO:
            worse.append(f"{label} {times(max(ratios_known))}")
    twin = _twin(results, runs[0])
    than = "without the fault" if twin else "before"
    sentences = [
        f"{effect}: {', '.join(whose)}."
        for effect, whose in (
            ("The current exceeds its limit", over),
            ("Afterwards the speed is not held", lost),
            (f"Afterwards there is more ripple than {than}", worse),
        )
        if whose
    ]
    if sentences:
        return "worse" if over or lost else "even", " ".join(sentences)
    usual = f"Afterwards the ripple is about the same as {'without the fault' if twin else 'before'}"
    if judged == cases:
        return "better", f"{usual}."
    return "even", f"{usual}, where this can be judged." if judged else ""


def _sentence(results: Results, run: Run, response: Response) -> str:
    """A controller's response, as "check trips after 80 ms (angle stuck); output safe for 0.43 s; ..."."""
    unit, how = speed_unit(results), _lost(results, run, response)
    states = {
        "output safe": response.safe,
        "learning paused": response.not_learning or 0.0,
        "output at its limit": response.saturated,
    }
    parts = [
        _noticed(run, response),
        *(f"{name} for {_seconds(lasted)}" for name, lasted in states.items() if lasted),
        f"speed off by up to {_speed(response.largest_error, unit)} {unit}",
        f"afterwards {how}" if how else _ripples(results, run, response),
    ]
    if response.largest_current is not None:
        current = number(response.largest_current)
        parts.append(f"largest current {current} A (limit {response.current_limit:.3g} A)")
    return re.sub(UNBROKEN, "\N{NO-BREAK SPACE}", "; ".join(part for part in parts if part)) + "."


def _noticed(run: Run, response: Response) -> str:
    if response.noticed_after is None:
        brief = response.fault.end - response.fault.time < 2 * run.trace.period
        return "" if brief else "no check trips"
    at_once = response.noticed_after <= 1.5 * run.trace.period
    when = "at once" if at_once else f"after {_seconds(response.noticed_after)}"
    return f"check trips {when} ({', '.join(response.noticed)})"


def _ripples(results: Results, run: Run, response: Response) -> str:
    unit, after = speed_unit(results), response.ripple_after
    twin = _without(results, run, response) if after is not None else None
    by_name = {"before": response.ripple_before, "after": after, "without the fault": twin}
    parts = [f"{_speed(value, unit)} {name}" for name, value in by_name.items() if value is not None]
    return f"ripple {', '.join(parts)} ({unit})" if parts else ""


def _speed(value: float, unit: str) -> str:
    return number(value / factor(unit, ANGULAR_SPEED)) if math.isfinite(value) else "not finite"


def _limit_ratio(response: Response) -> float:
    """The largest current divided by its limit; infinite if the current isn't finite."""
    current = response.largest_current
    if current is None:
        return 0.0
    return current / response.current_limit if math.isfinite(current) else math.inf


def _lost(results: Results, run: Run, response: Response) -> str | None:
    """The speed after the fault in words, if it isn't held at its reference; otherwise None."""
    if response.after is None or not len(run.trace):
        return None
    return missed(run, run.trace.window(*response.after), speed_unit(results))


def _times_usual(results: Results, run: Run, response: Response) -> float | None:
    """The ripple after a fault divided by that without the fault; None if unknown.

    If there is no run without the fault, it is divided by the ripple before the fault at the same speed.
    """
    after, usual = response.ripple_after, _without(results, run, response)
    if after is None or response.after is None or not len(run.trace):
        return None
    speed = run.trace["omega_ref"]
    late = speed[run.trace.window(*response.after)]
    if usual is None and response.before is not None:
        early = speed[run.trace.window(*response.before)]
        around = np.concatenate((early, late))
        alike = not varies(early) and np.ptp(around) <= SPEED_SPREAD_MOST * np.max(np.abs(around))
        usual = response.ripple_before if alike else None
    if usual is None or not math.isfinite(after):
        return None
    if after <= RIPPLE_SHARE_LEAST * float(np.mean(np.abs(late))):
        return 1.0
    return after / usual if usual else math.inf


def _twin(results: Results, run: Run) -> Run | None:
    """The run of the same controller in the scenario without faults; None if there is none."""
    name = without_faults(results.study, run.scenario)
    alike = (r for r in results.runs if (r.scenario, r.controller) == (name, run.controller) and len(r.trace))
    return next(alike, None)


def _without(results: Results, run: Run, response: Response) -> float | None:
    twin = _twin(results, run)
    return ripple(twin.trace, response.after) if twin is not None else None


def _seconds(time: float) -> str:
    """A time as text, such as "80 ms" or "0.43 s"."""
    if 0 < time < 0.0995:
        return f"{1e3 * time:.3g} ms"
    return f"{time:.3g} s" if time < 1000 else f"{time:.0f} s"
