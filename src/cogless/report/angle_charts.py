"""Charts of laws that learn in angle, and sentences on learning that becomes unstable.

The charts show errors and learned current over the angle, period by period; the learning factor over
frequency, marked where a run's current grew; and, as a Bode plot, the sensitivity of the speed to a torque
that repeats, with learning on and off.

The sentences say which frequency grows in a run, and since when the baseline is better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from cogless import units
from cogless.design.closed_loop import Linear
from cogless.design.law_rules import feedback_of
from cogless.design.learning_loop import LearningLoop, plants, sensitivity
from cogless.design.margins import Complex, Real
from cogless.design.speed_loop import speed_loop
from cogless.design.verdict import in_scenario, judged, loop_type
from cogless.errors import StudyError
from cogless.report.charts import Grown, OverAngle, OverFrequency, Series
from cogless.report.comparison import pretty, speed_unit
from cogless.report.markup import place
from cogless.report.panels import errors, in_angle, learned_terms, periods
from cogless.report.verdicts import EQUAL_DIFFERENCE, called
from cogless.results import Results, Run
from cogless.results.trace import Array
from cogless.study import Study
from cogless.units import TURN

PERIOD_CELLS = 360  # steps of angle in a period
PERIODS_SHOWN = 5  # periods that a chart shows

PERIODS_NOTE = (
    "Each curve is one period of the angle over which the law learns. Faint curves are early periods, full "
    "curves are late ones. Learning can remove what is the same in all curves. The learned current is the "
    "sum of all parts that the law has learned."
)


def over_angle(results: Results, runs: Sequence[Run]) -> list[OverAngle]:
    """Charts over the angle, for each controller that learns in angle: its errors and its learned current."""
    return [chart for run in runs for chart in _charts(results, run)]


def _charts(results: Results, run: Run) -> list[OverAngle]:
    turns, law = periods(results, run), in_angle(results, run)
    if turns is None or law is None:
        return []
    begun = turns[min(run.trace.window(0.0, law.learns_from).stop, len(turns) - 1)]
    chosen = _chosen(float(begun), float(turns[-1]))
    if not chosen or np.any(np.diff(turns) < 0):  # the rotor turns back: no function of the angle
        return []
    learned = np.sum([run.trace[name] for name in learned_terms(results, run)], axis=0)
    drawn = [(e.title, e.displayed(run.trace), e.quantity, e.unit) for e in errors(results, [run])]
    return [
        OverAngle(
            title=f"{title} over {law.period_words}: {results.study.label(run.controller)}",
            x="angle within the period (°)",
            angle=np.linspace(0, 360, PERIOD_CELLS + 1).tolist(),
            quantity=quantity,
            unit=pretty(unit),
            series=[
                Series(
                    controller=place(results, run),
                    label=f"period {k + 1}",
                    fade=0.25 + 0.75 * i / max(1, len(chosen) - 1),
                    values=_on_angle_grid(turns, x, k),
                )
                for i, k in enumerate(chosen)
            ],
        )
        for title, x, quantity, unit in [*drawn, ("Learned current", learned, "current", "A")]
    ]


def _chosen(begun: float, end: float) -> list[int]:
    """Periods to draw: the last whole one without learning, and some after it, more early than late ones."""
    first, last = max(0, int(begun) - 1), int(end + 1e-6) - 1
    if last < first:
        return []
    steps = np.geomspace(1, last - first + 1, PERIODS_SHOWN) - 1
    return sorted({first + round(step) for step in steps})


def _on_angle_grid(turns: Array, x: Array, period: int) -> Array:
    """x over the period with this number, on the common grid of angles."""
    rows = slice(max(0, int(np.searchsorted(turns, period)) - 1), int(np.searchsorted(turns, period + 1)) + 1)
    return np.asarray(np.interp(period + np.linspace(0, 1, PERIOD_CELLS + 1), turns[rows], x[rows]))


SENSITIVITY_POINTS = 400  # frequencies of a curve
DECADES = (0.1, 0.45)  # lowest frequency / turns per second at the top speed; highest / sample rate
DRAWN_MAGNITUDE_LEAST = 1e-4  # smaller magnitudes are drawn as this

SENSITIVITY_NOTE = (
    "The share of a disturbance that is left in the speed at each frequency, by the linear model of cogless "
    "design at the scenario's fastest speed. Above 0 dB the controller makes this frequency worse. Full "
    "curves: a disturbance that repeats with the angle, after learning has settled. Fainter curves: learning "
    "off. Faintest curves: with learning, a disturbance midway between two repeating frequencies, which "
    "learning amplifies."
)


def bode(results: Results, runs: Sequence[Run]) -> list[OverFrequency]:
    """Charts of magnitude and phase over frequency; empty if no controller has a linear model."""
    turn = results.study.scenario[runs[0].scenario].top_reference / TURN
    plant = speed_loop(results.study, runs[0].scenario)
    low = DECADES[0] * (turn or 1.0)
    f = np.geomspace(low, max(10 * low, DECADES[1] / plant.period), SENSITIVITY_POINTS)
    grid, *responses = plants(plant)
    P_omega, P_theta = (np.interp(f, grid, response) for response in responses)
    curves: list[tuple[int, str, float, Complex]] = []
    for run in runs:
        feedback, where = _feedback(results, run, TURN * turn), place(results, run)
        if feedback is not None:
            off = sensitivity(plant, feedback, TURN * f, P_omega, P_theta)
            loop, learns = _loop(results, run), bool(learned_terms(results, run))
            curves.append((where, "off" if learns else "", 0.55 if learns else 1.0, off))
            if loop is not None:
                curves.append((where, "on", 1.0, off * _remaining_share(loop, f, 0.0)))
                curves.append((where, "between", 0.25, off * _remaining_share(loop, f, 0.5)))
    charts = [
        ("Sensitivity, magnitude", "magnitude", "dB", _decibels),
        ("Sensitivity, phase", "phase", "°", _degrees),
    ]
    return [
        OverFrequency(
            title=title,
            x="frequency (Hz)",
            quantity=quantity,
            unit=unit,
            frequency=f,
            series=[
                Series(controller=where, label=label, fade=fade, values=in_unit(S))
                for where, label, fade, S in curves
            ],
        )
        for title, quantity, unit, in_unit in charts
        if curves
    ]


def _feedback(results: Results, run: Run, omega_m: float) -> Linear | None:
    with suppress(StudyError):
        return feedback_of(results.study, run.controller, omega_m)
    return None


def _remaining_share(loop: LearningLoop, f: Real, offset: float) -> Complex:
    """The share of a disturbance that learning leaves, smooth over f; NaN where nothing is learned.

    The curve goes through the share at each learned frequency, or `offset` of the way to the next one.
    """
    count = int(loop.highest / loop.periods_per_second)
    learned = np.arange(1, count + 1) if loop.orders is None else loop.orders
    at = (learned + offset) * loop.periods_per_second
    if not len(at):
        return np.full(len(f), np.nan + 0j)
    remaining = np.interp(f, at, loop.share_left(at))
    return np.where((f >= at[0]) & (f <= at[-1]), remaining, np.nan)


def _decibels(S: Complex) -> Real:
    return np.asarray(20 * np.log10(np.maximum(np.abs(S), DRAWN_MAGNITUDE_LEAST)))


def _degrees(S: Complex) -> Real:
    return np.asarray(np.rad2deg(np.angle(S)))


def _loop(results: Results, run: Run) -> LearningLoop | None:
    """The run's learning loop at its fastest judged speed; None if its learning has no such model."""
    if loop_type(results.study, run.controller) is not None:
        with suppress(StudyError):
            loops = judged(results.study, run.scenario, run.controller)
            return loops[-1] if loops else None
    return None


ERROR_WINDOW = 2.0  # s, length of the windows in which errors are compared
LINE_GROWTH_RATIO = 5.0  # amplitude / amplitude early in learning, above which it has grown
LINE_SHARE = 5e-3  # a spectral line below this share of i_q's RMS is ignored
SPECTRUM_ROWS = 2048  # trace rows per spectrum


def growth(results: Results, run: Run) -> float | None:
    """The frequency, Hz, of the spectral line of i_q that grew since learning began; None if no line grew.

    The line is taken from the first window in which it shows, because limits affect it later. It has to be
    larger, by the factor `LINE_GROWTH_RATIO`, than all lines within an octave of it when learning began and
    in the baseline's run.
    """
    law = in_angle(results, run)
    trace = run.trace
    if law is None:
        return None
    begun = trace.window(0.0, law.learns_from + float(getattr(law, "ramp", 0.0))).stop
    rows = min(SPECTRUM_ROWS, (len(trace) - begun) // 4)
    if rows < 64:
        return None
    before = _spectrum(trace["i_q"][begun : begun + rows])
    floor = LINE_SHARE * float(np.sqrt(np.mean(trace["i_q"][:begun] ** 2) + np.sum(before**2) / 2))
    base = (r for r in results.runs if (r.scenario, r.controller) == (run.scenario, results.study.baseline))
    plain = [x for r in base if r is not run for x in _parts(r.trace["i_q"], begun, rows)]
    usual = _octave_maximum(np.max([before, *map(_spectrum, plain)], axis=0))
    for x in _parts(trace["i_q"], begun + rows, rows):
        after = _spectrum(x)
        grown = (after > LINE_GROWTH_RATIO * usual) & (after > floor)
        if np.any(grown):
            return float(np.argmax(np.where(grown, after, 0.0)) / (rows * trace.period))
    return None


def _parts(x: Array, first: int, rows: int) -> list[Array]:
    return [x[k : k + rows] for k in range(first, len(x) - rows + 1, rows)]


def _octave_maximum(amplitudes: Array) -> Array:
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
    """The time, s, since when each controller that learns in angle is worse than the baseline to the end."""
    runs = [run for run in runs if len(run.trace) > 1]
    base = next((run for run in runs if run.controller == results.study.baseline), None)
    if base is None:
        return {}
    learning = [run for run in runs if run is not base and in_angle(results, run)]
    since = {r.controller: worse_since(r, base, errors(results, [r])[0].signal) for r in learning}
    return {name: time for name, time in since.items() if time is not None}


def worse_since(run: Run, other: Run, signal: str) -> float | None:
    """The time, s, from which a run's error stays above another's, by more than the share `EQUAL_DIFFERENCE`.

    None if the error isn't above at the end, or is above from the beginning.
    """
    mine, base = _errors(run, signal), _errors(other, signal)
    count = min(len(mine), len(base))
    worse = ~(mine[:count] <= (1 + EQUAL_DIFFERENCE) * base[:count])  # NaN is worse
    if count < 3 or not worse[-1] or np.all(worse):
        return None
    return float((1 + np.flatnonzero(~worse)[-1]) * ERROR_WINDOW)


def _errors(run: Run, signal: str) -> Array:
    """Peak-to-peak values of a signal in successive windows; an incomplete last window is left out."""
    rows = round(ERROR_WINDOW / run.trace.period) if run.trace.period else 0
    x = run.trace[signal]
    whole = len(x) // rows if rows else 0
    return np.asarray(np.ptp(x[: whole * rows].reshape(whole, -1), axis=1)) if whole else np.zeros(0)


def sentences(results: Results, runs: Sequence[Run], worse: Mapping[str, float]) -> list[str]:
    """Sentences on controllers that got worse while learning in angle, and whether that was predicted.

    `worse`: the result of `worsened`.
    """
    study, lines = results.study, []
    for run in runs:
        name, line = run.controller, growth(results, run)
        if in_angle(results, run) is None:
            continue
        grows = _expected(study, name, run.scenario)
        rising = f"grows at {line:.0f} Hz" if line is not None else ""
        if name in worse:
            label = f"{called(study, name)} gets worse with time: until {worse[name]:.0f} s it is"
            than = f"{label} no worse than {called(study, study.baseline)}"
            cause = f"; its current {rising}" if rising else ""
            lines.append(f"{than}, then it is worse{cause}{_foreseen_words(grows)}.")
        elif rising and grows:
            lines.append(f"The current of {called(study, name)} {rising}{_foreseen_words(grows)}.")
    return lines


def _expected(study: Study, name: str, scenario: str) -> str | None:
    """What cogless design says of a law's growth in a scenario; "" if it foresees none, None if unknown."""
    try:
        forecast = in_scenario(study, name, scenario)
    except StudyError:
        return None
    if forecast is None or forecast.kind == "rests":
        return None
    if forecast.kind != "settles":
        return forecast.short()
    return forecast.passing.in_words(forecast.unit) if forecast.passing else ""


def _foreseen_words(grows: str | None) -> str:
    if grows is None:
        return ""
    return f", as cogless design says ({grows})" if grows else ", which cogless design does not foresee"


CRITERION_POINTS = 600  # frequencies of a curve

CRITERION_NOTE = (
    "The factor by which each period of learning changes what was learned, at each frequency, by the model "
    "of cogless design. Below one, learning settles; above one, what was learned grows. Full curves: "
    "at the scenario's fastest speed. Faint curves: at the slowest speed that is judged. All curves are for "
    "constant speed. An upright line marks a frequency that grew in the run: the q current has more of it "
    "late in learning than when learning began. A trace shows frequencies up to half its rate."
)


def criterion(results: Results, runs: Sequence[Run]) -> list[OverFrequency]:
    """The chart of learning factors over frequency, on a common grid; empty if no law learns in angle."""
    loops: list[tuple[Run, LearningLoop, float]] = []
    for run in runs:
        if in_angle(results, run):
            with suppress(StudyError):
                ends = judged(results.study, run.scenario, run.controller)
                loops += [(run, loop, 1.0 if loop is ends[-1] else 0.4) for loop in ends]
    if not loops:
        return []
    lowest = min(loop.frequencies[0] for _, loop, _ in loops)
    f = np.geomspace(lowest, max(loop.frequencies[-1] for _, loop, _ in loops), CRITERION_POINTS)
    series = [
        Series(
            controller=place(results, run),
            label=units.format(loop.omega_m, speed_unit(results), units.ANGULAR_SPEED, digits=3),
            fade=fade,
            values=np.where(f <= loop.highest, loop.factor(f), np.nan),
        )
        for run, loop, fade in loops
    ]
    marks = [
        Grown(place(results, run), grown)
        for run in runs
        if (grown := growth(results, run))  # on a log axis
    ]
    labels = {"title": "Factor per period", "x": "frequency (Hz)", "quantity": "factor", "unit": ""}
    return [OverFrequency(**labels, frequency=f, series=series, marks=marks)]
