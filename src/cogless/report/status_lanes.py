"""The controllers' status over time: in which time spans each state was active."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cogless.report.palette import place
from cogless.results import Results, Run
from cogless.results.fault_response import faults_in
from cogless.results.status import NOTICED, SAFE, Status

MOST = 300  # largest number of time spans of a state in a run; beyond it, short gaps are closed
STATES: dict[int, str] = {
    SAFE: "safe output",
    **{int(bit): name for bit, name in NOTICED.items()},
    Status.SATURATED: "at its limit (current or voltage)",
    Status.FROZEN: "not learning",
    Status.OUTLIER: "error far beyond the usual",
    Status.GUARDED: "learning held back by the guard",
}


def strip(results: Results, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """A lane for each state that is active in some run: its name, each run's spans. Empty without faults."""
    if not faults_in(results.study, runs[0].scenario):
        return []
    lanes = []
    for bits, name in STATES.items():
        able = [
            run for run in runs if bits != Status.FROZEN or results.study.controller[run.controller].learned
        ]
        held = {place(results, run): spans for run in able if (spans := _spans(run, bits))}
        if held:
            drawn = [{"controller": controller, "spans": held[controller]} for controller in sorted(held)]
            lanes.append({"name": name, "runs": drawn})
    return lanes


def _spans(run: Run, bits: int) -> list[float]:
    """Start and end times, s, in turn, of the spans in which a state was active."""
    status = run.trace["status"]
    held = (np.where(np.isfinite(status), status, 0).astype(int) & bits) > 0
    edges = np.flatnonzero(np.diff(np.concatenate(([0], held.astype(int), [0]))))
    time, period = run.trace.time, run.trace.period
    from_, to = time[edges[::2]], time[edges[1::2] - 1] + period
    gap = 2 * period
    while len(from_) > MOST:
        wide = from_[1:] - to[:-1] > gap
        from_, to = from_[np.concatenate(([True], wide))], to[np.concatenate((wide, [True]))]
        gap *= 2
    return [round(float(t), 6) for pair in zip(from_, to, strict=True) for t in pair]
