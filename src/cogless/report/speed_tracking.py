"""Whether a controller held the speed. One that did not is never called the best in a metric.

The module also finds in which time spans each state of a controller was active.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cogless.control_library import NOTICED, SAFE_OUTPUT, Status
from cogless.report.charts import Lane, LaneRun
from cogless.report.markup import number, place
from cogless.report.verdicts import listed
from cogless.results import AnyResults, Results, Run
from cogless.results.fault_response import faults_in
from cogless.results.held_speed import Miss, speed_miss
from cogless.results.windows import late
from cogless.study.base import spoken_unit
from cogless.study.reading import Remark
from cogless.units import ANGULAR_SPEED, factor

SPANS_MOST = 300  # largest number of time spans of a state in a run; beyond it, short gaps are closed
STATE_TIME_LEAST = 0.1  # s; without faults a state that is active for less has no lane
ALL_ROWS = slice(None)
TRACKING_ROWS = 1 << 18  # rows that are read at a time: all rows of an hour would take gigabytes
STATE_LANES: dict[int, str] = {
    SAFE_OUTPUT: "safe output",
    **{int(bit): name for bit, name in NOTICED.items()},
    Status.SATURATED: "at its limit (current or voltage)",
    Status.FROZEN: "not learning",
    Status.OUTLIER: "error far beyond the usual",
    Status.GUARDED: "learning held back by the guard",
}


def strip(results: Results, runs: Sequence[Run]) -> list[Lane]:
    """A lane for each state that is active in some run: the state's name, and each run's time spans.

    Without faults, a state that lasts less than STATE_TIME_LEAST in every run has no lane.
    """
    least = 0.0 if faults_in(results.study, runs[0].scenario) else STATE_TIME_LEAST
    lanes = []
    for bits, name in STATE_LANES.items():
        able = [
            run for run in runs if bits != Status.FROZEN or results.study.controller[run.controller].learned
        ]
        by_place = {place(results, run): spans_of_run for run in able if (spans_of_run := spans(run, bits))}
        if any(sum(to - since for since, to in spans_of_run) >= least for spans_of_run in by_place.values()):
            drawn = [
                LaneRun(controller, [t for span in by_place[controller] for t in span])
                for controller in sorted(by_place)
            ]
            lanes.append(Lane(name, drawn))
    return lanes


def active(run: Run, bits: int, rows: slice = ALL_ROWS) -> NDArray[np.bool_]:
    """The rows in which a state was active; none where the status isn't recorded."""
    first, last, _ = rows.indices(len(run.trace))
    is_active = np.zeros(max(last - first, 0), dtype=bool)
    for at in range(first, last, TRACKING_ROWS) if "status" in run.trace else ():
        status = run.trace.part("status", slice(at, min(at + TRACKING_ROWS, last)))
        is_active[at - first :][: len(status)] = (
            np.where(np.isfinite(status), status, 0).astype(int) & bits
        ) > 0
    return is_active


def spans(run: Run, bits: int, rows: slice = ALL_ROWS) -> list[tuple[float, float]]:
    """Start and end times, s, of the spans in which a state was active; at most SPANS_MOST."""
    is_active, time, period = active(run, bits, rows), run.trace.time[rows], run.trace.period
    edges = np.flatnonzero(np.diff(is_active, prepend=False, append=False))
    from_, to = time[edges[::2]], time[edges[1::2] - 1] + period
    gap = 2 * period
    while len(from_) > SPANS_MOST:
        wide = from_[1:] - to[:-1] > gap
        from_, to = from_[np.concatenate(([True], wide))], to[np.concatenate((wide, [True]))]
        gap *= 2
    return [(round(float(a), 6), round(float(b), 6)) for a, b in zip(from_, to, strict=True)]


MAJORITY_SHARE = 0.5  # share of the rows
MONITOR_EFFECTS = {
    Status.OFF: "has the output off",
    Status.ANGLE_LOST: "doesn't believe the measured speed",
}
MONITORED_SHARE = 0.1  # share of the rows; an effect of the monitor in fewer rows is not reported
STOPPED_SHARE = 0.05  # share of the mean reference; a rotor that is ever slower has stopped
LIMIT_NOTE = ", at the limit of current or voltage"


def missed(run: Run, rows: slice, unit: str) -> str | None:
    """How the speed missed its reference, such as "mean 0 of 60 rpm"; None if it was held."""
    speed = speed_miss(run, rows)
    return None if speed is None else miss_words(speed, run, rows, unit)


def miss_words(speed: Miss, run: Run, rows: slice, unit: str) -> str:
    """How the speed missed its reference, in words.

    The words also say what the monitor did, or else that most of the second half of the rows was at a limit.
    """
    status = active(run, Status.SATURATED, rows)
    limited = np.mean(status[len(status) // 2 :]) > MAJORITY_SHARE
    return _off_words(speed, unit) + (_monitored(run, rows) or (LIMIT_NOTE if limited else ""))


def seen_to_stop(results: AnyResults, run: Run, remark: Remark) -> str:
    """A warning that the rotor stops, corrected by whether it did stop in the last part of the run."""
    assert isinstance(results, Results)
    rows, stop = late(results, run), remark.stop
    if stop is None or not len(run.trace.time[rows]):
        return remark.text
    reference, speed = (run.trace.part(name, rows) for name in ("omega_ref", "omega_m"))
    slowest, unit = float(np.min(speed * np.sign(reference))), spoken_unit(results.study, ANGULAR_SPEED)
    if not slowest > STOPPED_SHARE * float(np.mean(np.abs(reference))):
        return remark.text.replace(stop.claim, f"in {run.scenario} the rotor stopped")
    least = f"{number(slowest / factor(unit, ANGULAR_SPEED))} {unit}"
    evenly = f"in {run.scenario} the rotor did not stop, its slowest speed was {least}"
    return remark.text.replace(f"{stop.claim}{stop.remedy}", evenly)


def _monitored(run: Run, rows: slice) -> str:
    """What the monitor did in these rows, by which checks and since when; "" if it did little."""
    for bits, effect in MONITOR_EFFECTS.items():
        acting = active(run, bits, rows)
        if not len(acting) or np.mean(acting) < MONITORED_SHARE:
            continue
        checks = [
            f"{name}, status bit {bit.value}"
            for bit, name in NOTICED.items()
            if active(run, bit, rows)[acting].any()
        ]
        since = float(run.trace.time[int(np.argmax(active(run, bits)))])
        share, why = 100 * np.mean(acting), f": {listed(checks)}" if checks else ""
        return f" (the monitor {effect} {share:.0f} % of the time, first at {since:.3g} s{why})"
    return ""


def _off_words(speed: Miss, unit: str) -> str:
    if speed.kind == "infinite":
        return "speed not finite"
    value, target = (x / factor(unit, ANGULAR_SPEED) for x in (speed.value, speed.target))
    if speed.kind == "mean":
        return f"mean {value:.4g} of {target:.4g} {unit}"
    return f"error {number(value)} {unit} rms, reference {number(target)} {unit} rms"
