"""Play the logs on cogless's own engine, with the drive's own controller, and correct what that tells.

Whatever biases the regression in a closed loop - steps of the angle that the controller answers, currents
that are held between samples - biases it in the same way on simulated logs, whose truth is known. The
difference is taken off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cogless.errors import StudyError
from cogless.identify import described
from cogless.identify.estimate import OTHERS, Progress, coefficients, fitted, settled, with_values
from cogless.identify.log import Log
from cogless.identify.result import Estimate
from cogless.identify.weak_form import Name
from cogless.results.trace import Trace
from cogless.run.simulate import rollout
from cogless.study import Study
from cogless.study.base import Source
from cogless.study.reading import checked

ROUNDS = 2
OFF = 0.01  # relative difference of a log's rate from one that divides the current loop's


def played(made: Estimate, jobs: int = 1) -> dict[str, Trace]:
    """The simulated trace of each log that can be played, by its name, at the log's rate.

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
    """A rate of rows that divides the current loop's and is the log's; None if there is none."""
    loop = made.known.drive.rates.current_loop
    rate = loop / max(1, round(loop * log.dt))
    return rate if abs(rate * log.dt - 1) < OFF else None


def simulated_log(made: Estimate, log: Log, trace: Trace) -> Log:
    """A trace as the drive would have logged it."""
    offset = 0.5 * made.known.step if made.known.angle_offset is None else made.known.angle_offset
    signals = {
        "theta": np.unwrap(trace["theta_measured"]) + offset,
        "omega": trace["omega_measured"],
        "i_q": trace["i_q"],
    }
    signals |= {name: trace[name] for name in ("i_d",) if name in log and name in trace}
    return Log(log.name, log.rule, trace.period, signals, (slice(0, len(trace)),))


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
        logs = [simulated_log(made, log, traces[log.name]) if log.dt else log for log in made.logs]
        made = _corrected(first, made, logs)
    return made, traces


def _corrected(first: Estimate, made: Estimate, simulated: Sequence[Log]) -> Estimate:
    """The first estimate less the bias that these logs show, which are simulated with the present one."""
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
    )
    kept = {key: value for key, value in corrected.values.items() if key in first.values}
    if "delay" in kept:  # a current that is held looks the same wherever in its period it is logged
        held = 0.5 / (known.drive.rates.speed_loop or known.drive.rates.current_loop)
        delay = kept["delay"]
        kept["delay"] = replace(delay, error=float(np.hypot(delay.error, held)))
    orders = {wave.order for wave in first.cogging}
    cogging = tuple(wave for wave in corrected.cogging if wave.order in orders)
    return replace(corrected, values=kept, cogging=cogging)


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
