"""Whether learning becomes unstable in a run: which frequency grows, since when the baseline is better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cogless.design.verdict import verdict
from cogless.errors import StudyError
from cogless.report.comparison import SAME
from cogless.report.packing import Array
from cogless.report.paths import errors, in_angle
from cogless.report.verdict import called
from cogless.results import Results, Run
from cogless.study import Study

WINDOW = 2.0  # s, length of the windows in which errors are compared
GREW = 5.0  # amplitude / amplitude early in learning, above which it has grown
SHARE = 5e-3  # of i_q's RMS: a smaller spectral line is ignored
SEGMENT = 2048  # trace rows per spectrum


def growth(results: Results, run: Run) -> float | None:
    """The frequency, Hz, of the spectral line of i_q that grew since learning began; None if no line grew.

    The line is taken from the first window in which it shows, because limits affect it later. It has to be
    larger, by the factor `GREW`, than all lines within an octave of it when learning began and in the
    baseline's run.
    """
    law = in_angle(results, run)
    trace = run.trace
    if law is None:
        return None
    begun = trace.window(0.0, law.learning_start + float(getattr(law, "ramp", 0.0))).stop
    rows = min(SEGMENT, (len(trace) - begun) // 4)
    if rows < 64:
        return None
    before = _spectrum(trace["i_q"][begun : begun + rows])
    floor = SHARE * float(np.sqrt(np.mean(trace["i_q"][:begun] ** 2) + np.sum(before**2) / 2))
    base = (r for r in results.runs if (r.scenario, r.controller) == (run.scenario, results.study.baseline))
    plain = [x for r in base if r is not run for x in _parts(r.trace["i_q"], begun, rows)]
    usual = _about(np.max([before, *map(_spectrum, plain)], axis=0))
    for x in _parts(trace["i_q"], begun + rows, rows):
        after = _spectrum(x)
        grown = (after > GREW * usual) & (after > floor)
        if np.any(grown):
            return float(np.argmax(np.where(grown, after, 0.0)) / (rows * trace.period))
    return None


def _parts(x: Array, first: int, rows: int) -> list[Array]:
    return [x[k : k + rows] for k in range(first, len(x) - rows + 1, rows)]


def _about(amplitudes: Array) -> Array:
    """The largest amplitude within an octave of each line: a motor's spectral lines move with its speed."""
    return np.array([np.max(amplitudes[k // 2 : 2 * k + 2]) for k in range(len(amplitudes))])


def _spectrum(x: Array) -> Array:
    """Amplitudes of x's spectral lines, without the trend from first to last value; zero if not finite.

    The first three lines are zero: over these, Hann's window spreads a drift.
    """
    if not np.all(np.isfinite(x)):
        return np.zeros(len(x) // 2 + 1)
    window = np.hanning(len(x))
    straight = np.linspace(x[0], x[-1], len(x))
    amplitudes = np.asarray(2 * np.abs(np.fft.rfft((x - straight) * window)) / window.sum())
    amplitudes[:3] = 0.0
    return amplitudes


def worsened(results: Results, runs: Sequence[Run]) -> dict[str, float]:
    """Controllers that learn in angle and are worse than the baseline to the end: since when, s."""
    runs = [run for run in runs if len(run.trace) > 1]
    base = next((run for run in runs if run.controller == results.study.baseline), None)
    if base is None:
        return {}
    learning = [run for run in runs if run is not base and in_angle(results, run)]
    since = {r.controller: worse_since(r, base, errors(results, [r])[0].signal) for r in learning}
    return {name: time for name, time in since.items() if time is not None}


def worse_since(run: Run, other: Run, signal: str) -> float | None:
    """The time, s, from which a run's error stays above another's, by more than the share `SAME`.

    None if the error isn't above at the end, or is above from the beginning.
    """
    mine, base = _errors(run, signal), _errors(other, signal)
    count = min(len(mine), len(base))
    worse = ~(mine[:count] <= (1 + SAME) * base[:count])  # NaN is worse
    if count < 3 or not worse[-1] or np.all(worse):
        return None
    return float((1 + np.flatnonzero(~worse)[-1]) * WINDOW)


def _errors(run: Run, signal: str) -> Array:
    """Peak-to-peak values of a signal in successive windows; an incomplete last window is left out."""
    rows = round(WINDOW / run.trace.period) if run.trace.period else 0
    x = run.trace[signal]
    whole = len(x) // rows if rows else 0
    return np.asarray(np.ptp(x[: whole * rows].reshape(whole, -1), axis=1)) if whole else np.zeros(0)


def sentences(results: Results, runs: Sequence[Run], worse: Mapping[str, float]) -> list[str]:
    """Sentences on controllers that got worse while learning in angle, and whether that was predicted.

    `worse`: the result of `worsened`.
    """
    study, found = results.study, []
    for run in runs:
        name, line = run.controller, growth(results, run)
        if in_angle(results, run) is None:
            continue
        grows = _expected(study, name)
        rising = f"grows at {line:.0f} Hz" if line is not None else ""
        if name in worse:
            label = f"Worse with time: {called(study, name)}"
            than = f"{label} is no worse than {called(study, study.baseline)} until {worse[name]:.0f} s"
            cause = f"; its current {rising}" if rising else ""
            found.append(f"{than}, then worse{cause}{_said(grows)}.")
        elif rising and grows:
            found.append(f"The current of {called(study, name)} {rising}{_said(grows)}.")
    return found


def _expected(study: Study, name: str) -> str | None:
    """What cogless design says of a law that doesn't settle; "" if it settles, None if that isn't known."""
    try:
        found = verdict(study, name)
    except StudyError:
        return None
    if found is None or found.kind == "rests":
        return None
    if found.kind != "settles":
        return found.short()
    return found.passing.words(found.unit) if found.passing else ""


def _said(grows: str | None) -> str:
    if grows is None:
        return ""
    return f", as cogless design says ({grows})" if grows else ", which cogless design does not foresee"
