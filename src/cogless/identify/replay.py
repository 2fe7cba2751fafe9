"""Play the logs on cogless's own engine, with the drive's own controller, and correct what that tells.

A closed loop biases the regression: the controller answers steps of the angle, and currents are held between
samples. Simulated logs have the same bias, and their truth is known. So the difference is taken off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cogless.errors import StudyError
from cogless.identify import described
from cogless.identify.config import Identification
from cogless.identify.estimate import OTHERS, Progress, coefficients, fitted, settled, with_values
from cogless.identify.log import Log
from cogless.identify.result import Estimate
from cogless.identify.weak_form import Model, Name
from cogless.results.trace import Trace
from cogless.run.simulate import rollout
from cogless.study import Study
from cogless.study.base import Source
from cogless.study.reading import checked

ROUNDS = 2
OFF = 0.01  # relative difference of a log's rate from one that divides the current loop's


def played(made: Estimate, jobs: int = 1) -> dict[str, Trace]:
    """The simulated trace of each log that can be played, by its name, at its rate or twice that.

    StudyError: the study isn't valid, or a run failed.
    """
    logs = described.replayable(made)
    tables = described.study(made)
    studies, names = [], []
    for log in logs:
        rate = _rate(made, log)
        if rate is None:
            continue
        name = described.scenario_name(log)
        one = {**tables, "scenario": {name: tables["scenario"][name]}, "trace": {"rate": f"{rate:.9g} Hz"}}
        one["metric"] = []
        found = checked(Source(Path(made.known.path), one))
        assert isinstance(found, Study)
        studies.append(found)
        names.append((log.name, log.rule.controller))
    results = [
        rollout([study], [f"*/{controller or next(iter(study.controller))}"], jobs=jobs)[0]
        for study, (_, controller) in zip(studies, names, strict=True)
    ]
    return {name: result.runs[0].trace for (name, _), result in zip(names, results, strict=True)}


def _rate(made: Estimate, log: Log) -> float | None:
    """A rate of rows that divides the current loop's; None if the log's doesn't.

    It is twice the log's where that divides it, too: for currents that are logged in the middle of a row.
    """
    loop = made.known.drive.rates.current_loop
    every = max(1, round(loop * log.dt))
    if abs(loop / every * log.dt - 1) >= OFF:
        return None
    return loop / every * (1 if every % 2 else 2)


def simulated_log(made: Estimate, log: Log, trace: Trace, late: int = 0) -> Log:
    """A trace as the drive would have logged it; `late`: currents half a row later, where it has those."""
    step = max(1, round(log.dt / trace.period))
    late *= step - 1
    offset = 0.5 * made.known.step if made.known.angle_offset is None else made.known.angle_offset
    signals = {
        "theta": np.unwrap(trace["theta_measured"])[::step] + offset,
        "omega": trace["omega_measured"][::step],
    }
    for name in ("i_q", "i_d"):
        if name == "i_q" or (name in log and name in trace):
            x = trace[name]
            signals[name] = np.concatenate((x[:1].repeat(late), x[: len(x) - late]))[::step]
    return Log(log.name, log.rule, step * trace.period, signals, (slice(0, len(signals["theta"])),))


def refined(made: Estimate, progress: Progress) -> tuple[Estimate, dict[str, Trace]]:
    """The estimate without the bias that its own simulation shows, and the simulated traces.

    It stays as it is where a log of a turning motor can't be played.
    """
    moving = [log.name for log in made.logs if log.dt]
    first = made
    if "j" not in made.values or made.fit is None:
        return made, {}
    traces: dict[str, Trace] = {}
    for n in range(ROUNDS):
        progress(f"simulation {n + 1}", n / ROUNDS)
        try:
            traces = played(made)
        except StudyError as error:
            said = f"The logs could not be simulated ({error}); errors of the closed loop are not corrected."
            return replace(first, remarks=(*first.remarks, said)), {}
        if set(traces) != set(moving):
            without = ", ".join(sorted(set(moving) - set(traces)))
            said = (
                f"No simulation of {without}: without its reference and controller in the file of columns, "
                "errors of the closed loop (delay, steps of the angle) are not corrected."
            )
            return replace(first, remarks=(*first.remarks, said)), traces
        logs, later = (
            [simulated_log(made, log, traces[log.name], late) if log.dt else log for log in made.logs]
            for late in (0, 1)
        )
        made = _corrected(first, made, logs, later if n == ROUNDS - 1 else [])
    return made, traces


def _corrected(
    first: Estimate, made: Estimate, simulated: Sequence[Log], later: Sequence[Log] = ()
) -> Estimate:
    """The first estimate less the bias that these simulated logs show; `made`: what they are simulated with.

    `later`: the same with currents half a row later, which real logs may have or not.
    """
    known, real, truth = first.known, first.model, _truth(made)
    played = settled(known, simulated, replace(real, delay=0.0, error={}))

    def unbiased(factor: float) -> dict[Name, float]:
        measured = coefficients(known, first.logs, real, factor)
        biased = coefficients(known, simulated, played, factor)
        return {
            name: value - (biased[name] - truth[name] if name in truth else 0.0)
            for name, value in measured.items()
        }

    corrected = with_values(
        first,
        unbiased(1.0),
        [unbiased(factor) for factor in OTHERS],
        fitted(known, simulated, played),
        _moved(known, simulated, later, played),
    )
    kept = {key: value for key, value in corrected.values.items() if key in first.values}
    if "delay" in kept:  # a current that is held looks the same wherever in its period it is logged
        held = 0.5 / (known.drive.rates.speed_loop or known.drive.rates.current_loop)
        delay = kept["delay"]
        kept["delay"] = replace(delay, error=float(np.hypot(delay.error, held)))
    orders = {wave.order for wave in first.cogging}
    cogging = tuple(wave for wave in corrected.cogging if wave.order in orders)
    return replace(corrected, values=kept, cogging=cogging)


def _moved(
    known: Identification, simulated: Sequence[Log], later: Sequence[Log], played: Model
) -> dict[Name, float]:
    """What the coefficients move by if currents are logged half a row later, without the delay itself."""
    if not later:
        return {}
    before = coefficients(known, simulated, played)
    after = coefficients(known, later, settled(known, later, replace(played, delay=0.0, error={})))
    return {name: after[name] - value for name, value in before.items() if name != ("delay",)}


def _truth(made: Estimate) -> dict[Name, float]:
    """Coefficients that the simulation has; it logs without delay, and has no offset of i_q.

    Those of what is left out of the motor are 0.
    """
    truth: dict[Name, float] = {(key,): 0.0 for key in ("b", "c", "delay", "offset")}
    truth |= {(key,): made.values[key].value for key in ("j", "b", "c") if key in made.values}
    truth |= {("load", name): value.value for name, value in made.loads.items()}
    for kind, orders in (("cogging", made.model.cogging), ("ripple", made.model.ripple)):
        truth |= {(kind, order, part): 0.0 for order in orders for part in "cs"}
    for kind, waves in (("cogging", made.cogging), ("ripple", made.ripple), ("encoder", made.encoder)):
        for wave in waves:
            truth[kind, wave.order, "c"] = wave.size.value * float(np.sin(wave.phase.value))
            truth[kind, wave.order, "s"] = wave.size.value * float(np.cos(wave.phase.value))
    return truth
