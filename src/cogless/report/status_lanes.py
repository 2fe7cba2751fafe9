"""The controllers' status over time: in which time spans each state was active."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless.report.palette import place
from cogless.results import Results, Run
from cogless.results.fault_response import faults_in
from cogless.results.status import NOTICED, SAFE, Status

MOST = 300  # largest number of time spans of a state in a run; beyond it, short gaps are closed
MOMENT = 0.1  # s; without faults shorter states are not worth a lane
ALL = slice(None)
BLOCK = 1 << 18  # rows that are looked at together: those of an hour would take gigabytes
STATES: dict[int, str] = {
    SAFE: "safe output",
    **{int(bit): name for bit, name in NOTICED.items()},
    Status.SATURATED: "at its limit (current or voltage)",
    Status.FROZEN: "not learning",
    Status.OUTLIER: "error far beyond the usual",
    Status.GUARDED: "learning held back by the guard",
}


def strip(results: Results, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """A lane for each state that is active in some run: its name, each run's spans.

    Without faults, states that last less than a moment in every run have none.
    """
    least = 0.0 if faults_in(results.study, runs[0].scenario) else MOMENT
    lanes = []
    for bits, name in STATES.items():
        able = [
            run for run in runs if bits != Status.FROZEN or results.study.controller[run.controller].learned
        ]
        held = {place(results, run): found for run in able if (found := spans(run, bits))}
        if any(sum(to - since for since, to in found) >= least for found in held.values()):
            drawn = [
                {"controller": controller, "spans": [t for span in held[controller] for t in span]}
                for controller in sorted(held)
            ]
            lanes.append({"name": name, "runs": drawn})
    return lanes


def active(run: Run, bits: int, rows: slice = ALL) -> NDArray[np.bool_]:
    """The rows in which a state was active; none where the status isn't recorded."""
    first, last, _ = rows.indices(len(run.trace))
    held = np.zeros(max(last - first, 0), dtype=bool)
    for at in range(first, last, BLOCK) if "status" in run.trace else ():
        status = run.trace.part("status", slice(at, min(at + BLOCK, last)))
        held[at - first :][: len(status)] = (np.where(np.isfinite(status), status, 0).astype(int) & bits) > 0
    return held


def spans(run: Run, bits: int, rows: slice = ALL) -> list[tuple[float, float]]:
    """Start and end times, s, of the spans in which a state was active; at most MOST."""
    held, time, period = active(run, bits, rows), run.trace.time[rows], run.trace.period
    edges = np.flatnonzero(np.diff(held, prepend=False, append=False))
    from_, to = time[edges[::2]], time[edges[1::2] - 1] + period
    gap = 2 * period
    while len(from_) > MOST:
        wide = from_[1:] - to[:-1] > gap
        from_, to = from_[np.concatenate(([True], wide))], to[np.concatenate((wide, [True]))]
        gap *= 2
    return [(round(float(a), 6), round(float(b), 6)) for a, b in zip(from_, to, strict=True)]
