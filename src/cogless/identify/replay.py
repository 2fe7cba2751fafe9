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
from cogless.identify.estimate import Progress, refit
from cogless.identify.log import Log
from cogless.identify.regression import Fit
from cogless.identify.result import Estimate, Value, Wave, wave_of
from cogless.identify.weak_form import Model, Name
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
        model = replace(made.model, delay=0.0, error={})
        fit, model = refit(made.known, logs, model)
        made = _corrected(first, made, fit, model)
    return made, traces


def _corrected(first: Estimate, made: Estimate, fit: Fit, model: Model) -> Estimate:
    """The first estimate less the bias of the simulation of the present one."""
    assert first.fit is not None

    def told(truth: float, found: float, was: Value) -> Value:
        bias = found - truth
        error = float(np.hypot(np.sqrt(2) * was.error, 0.1 * bias))  # the simulation has its own noise
        return Value(was.value - bias, error)

    def got(name: Name) -> float:
        if name[0] != "encoder":
            return fit[name]
        return model.error[int(name[1])]["cs".index(str(name[2]))] + fit[name] / fit["j",]

    values = dict(first.values)
    for key in values:
        if (key,) not in fit or key == "c_hold":
            continue
        told_now = model.delay + fit[key,] if key == "delay" else fit[key,]
        values[key] = told(_truth(made, key), told_now, first.values[key])

    def waves(kind: str, here: Sequence[Wave], started: Sequence[Wave]) -> tuple[Wave, ...]:
        out = []
        for now, was in zip(here, started, strict=True):
            parts = []
            for part, function in (("c", np.sin), ("s", np.cos)):
                name = (kind, now.order, part)
                if name not in fit:
                    return tuple(started)
                truth = now.size.value * float(function(now.phase.value))
                start = was.size.value * float(function(was.phase.value))
                error = float(
                    np.hypot(
                        was.size.error * function(was.phase.value),
                        was.size.value
                        * was.phase.error
                        * (np.cos if part == "c" else np.sin)(was.phase.value),
                    )
                )
                parts.append(told(truth, got(name), Value(start, error)))
            out.append(wave_of(now.order, *parts))
        return tuple(out)

    return replace(
        first,
        values=values,
        cogging=waves("cogging", made.cogging, first.cogging),
        encoder=waves("encoder", made.encoder, first.encoder),
        ripple=waves("ripple", made.ripple, first.ripple),
    )


def _truth(made: Estimate, key: str) -> float:
    """The value that the simulation has; it logs without delay, and has no offset of i_q."""
    return 0.0 if key in ("delay", "offset") else made.values[key].value
