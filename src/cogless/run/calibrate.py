"""Fit parameters of a study to target values of its metrics, such as ripple amplitudes from a published
table.

The fit minimizes the squares of the relative deviations with scipy's trust-region solver. Each evaluation
runs the study.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cogless import units
from cogless.errors import StudyError
from cogless.results.metrics import Value, result_name
from cogless.run.simulate import run_study
from cogless.study import AnyStudy, changed
from cogless.study.base import FitParameter
from cogless.study.messages import MISSING, look_up, toml_text
from cogless.study.metric import Metric
from cogless.study.reading import split

# Relative steps for numerical derivatives. There is one fit per step, each from the best point so far. An
# encoder makes metrics uneven: large steps find the valley, small ones its lowest point.
DERIVATIVE_STEPS = (0.3, 0.1, 0.02)
FIT_TOLERANCE = 1e-4  # relative change of the parameters that ends a fit
EVALUATIONS_MOST = 20  # evaluations of each fit, without those for derivatives

FitProgress = Callable[[int, float], None]


@dataclass(frozen=True)
class Fitted:
    """A fitted parameter: key, and values before and after the fit, as texts in the study's own unit."""

    key: str
    before: str
    after: str

    @property
    def toml(self) -> str:
        """A line for the study's file, or for --set."""
        return f"{self.key} = {self.after}"


@dataclass(frozen=True)
class Residual:
    """A target value and the value that the fitted study gives, both SI."""

    scenario: str
    controller: str
    metric: str
    part: float | None  # the order, or the number of the trial or phase, from 1
    target: float
    got: float


@dataclass(frozen=True)
class Fit:
    """Outcome of a fit.

    `deviation`: RMS of the relative deviations. `settled`: whether the last fit converged. `interrupted`:
    Ctrl-C ended the fit, so these are the best values so far.
    """

    parameters: tuple[Fitted, ...]
    residuals: tuple[Residual, ...]
    deviation: float
    settled: bool
    study: AnyStudy
    interrupted: bool = False


@dataclass(frozen=True)
class _Knob:
    """A parameter as the solver sees it: its value is x times `scale`."""

    key: str
    unit: str
    start: float
    scale: float
    lower: float
    upper: float

    def study_value(self, x: float) -> str | float:
        number = float(f"{x * self.scale:.6g}")
        return f"{number!r} {self.unit}" if self.unit else number


def calibrate(study: AnyStudy, progress: FitProgress | None = None, jobs: int = 1) -> Fit:
    """Fit the parameters in the study's [calibration]; only the runs that its targets name are simulated.

    `progress` is called with the number of evaluations and the smallest deviation so far. Ctrl-C ends the fit
    early: the best values so far are returned, with `interrupted` set. StudyError: no calibration, a key that
    holds no number, a metric without a value.
    """
    if study.calibration is None:
        raise StudyError(
            f"{study.source.path}: calibration: missing: expected a table with parameters and targets"
        )
    knobs = [_knob(study, index, parameter) for index, parameter in enumerate(study.calibration.parameters)]
    metrics_of: dict[str, dict[str, Value]] = {}
    evaluations = 0

    best = np.array([k.start / k.scale for k in knobs])
    least = math.inf

    def deviations(x: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal evaluations, best, least
        residuals = _residuals(_with(study, knobs, x), metrics_of, jobs)
        weighted = np.array(_relative(study, residuals))
        deviation = float(np.sqrt(np.mean(weighted**2)))
        if deviation < least:
            best, least = x.copy(), deviation
        evaluations += 1
        if progress is not None:
            progress(evaluations, least)
        return weighted

    start = best
    bounds = np.array([k.lower / k.scale for k in knobs]), np.array([k.upper / k.scale for k in knobs])
    settled = interrupted = False
    try:
        for step in DERIVATIVE_STEPS:
            steps = np.full(len(knobs), step)
            fit = least_squares(
                deviations,
                best,
                bounds=bounds,
                diff_step=steps,
                xtol=FIT_TOLERANCE,
                max_nfev=EVALUATIONS_MOST,
            )
            settled = fit.status > 0
    except KeyboardInterrupt:
        if not math.isfinite(least):
            raise  # no evaluation is done, so there is no result
        settled, interrupted = False, True
    fitted = _with(study, knobs, best)
    parameters = tuple(
        Fitted(k.key, toml_text(k.study_value(s)), toml_text(k.study_value(x)))
        for k, s, x in zip(knobs, start, best, strict=True)
    )
    residuals = tuple(_residuals(fitted, metrics_of, jobs))
    return Fit(
        parameters=parameters,
        residuals=residuals,
        deviation=least,
        settled=settled,
        study=fitted,
        interrupted=interrupted,
    )


def _deciding_tables(study: AnyStudy, scenario: str, controller: str) -> str:
    """Text of all tables that decide a run's metrics: the study's tables without other scenarios and
    controllers."""
    tables = {key: table for key, table in study.source.tables.items() if key != "calibration"}
    for table, name in (("scenario", scenario), ("controller", controller)):
        tables[table] = {name: tables[table][name]}
    return json.dumps(tables, sort_keys=True, default=str)


def _with(study: AnyStudy, knobs: list[_Knob], x: NDArray[np.float64]) -> AnyStudy:
    return changed(study, {knob.key: knob.study_value(value) for knob, value in zip(knobs, x, strict=True)})


def _knob(study: AnyStudy, index: int, parameter: FitParameter) -> _Knob:
    key, tables = parameter.key, study.source.tables
    try:
        present = look_up(tables, split(key))
    except StudyError as error:
        raise StudyError(f"{study.source.path}: calibration.parameters.{index}.key: {error}") from None
    if parameter.scenario is not None:
        own = look_up(tables, ("scenario", parameter.scenario, "override", key))
        present = present if own is MISSING else own
        key = f'scenario.{parameter.scenario}.override."{key}"'
    initial = present if parameter.initial is None else parameter.initial
    unit = units.unit_of(present if isinstance(present, str) else initial if isinstance(initial, str) else "")

    def number(field: str, value: object) -> float:
        if isinstance(value, str) and unit:
            try:
                return units.number_in(value, unit)
            except units.UnitError as error:
                raise wrong(field, value, str(error)) from None
        if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        raise wrong(field, value, "expected a key of the study that holds a number or a text with a unit")

    def wrong(field: str, value: object, expected: str) -> StudyError:
        text = "missing" if value is MISSING else toml_text(value)
        return StudyError(f"{study.source.path}: calibration.parameters.{index}.{field}: {text}: {expected}")

    start = number("key" if parameter.initial is None else "initial", initial)
    lower = -math.inf if parameter.lower is None else number("lower", parameter.lower)
    upper = math.inf if parameter.upper is None else number("upper", parameter.upper)
    if not lower <= start <= upper or lower == upper:
        raise wrong("initial", initial, "expected a value between lower and upper")
    width = upper - lower if math.isfinite(upper - lower) else 1.0
    return _Knob(key, unit, start, abs(start) or width, lower, upper)


def _residuals(study: AnyStudy, metrics_of: dict[str, dict[str, Value]], jobs: int) -> list[Residual]:
    """Targets and values of this study's metrics.

    `metrics_of`: metrics of earlier runs, by the text of their tables. Such a run isn't repeated.
    """
    assert study.calibration is not None
    pairs = dict.fromkeys((target.scenario, target.controller) for target in study.calibration.targets)
    names = {pair: _deciding_tables(study, *pair) for pair in pairs}
    missing = ["/".join(pair) for pair, name in names.items() if name not in metrics_of]
    if missing:
        results = run_study(study, missing, jobs=jobs)
        if results.interrupted:
            raise KeyboardInterrupt
        metrics_of |= {names[run.scenario, run.controller]: dict(run.metrics) for run in results.runs}
    residuals = []
    for target in study.calibration.targets:
        metric = _metric(study, target.scenario, target.metric)
        value = metrics_of[names[target.scenario, target.controller]].get(result_name(metric))
        got = value if isinstance(value, list) else [math.nan if value is None else value]
        places = metric.order or (range(1, len(got) + 1) if isinstance(value, list) else (None,))
        for part, target_value, number in zip(places, target.values(metric, len(got)), got, strict=True):
            if not math.isfinite(number):
                place = f"{target.scenario}/{target.controller}"
                raise StudyError(f"{study.source.path}: calibration: {target.metric} of {place} has no value")
            residuals.append(
                Residual(
                    scenario=target.scenario,
                    controller=target.controller,
                    metric=target.metric,
                    part=part,
                    target=target_value,
                    got=number,
                )
            )
    return residuals


def _metric(study: AnyStudy, scenario: str, name: str) -> Metric:
    return next(metric for metric in study.metrics_in(scenario) if metric.name == name)


def _relative(study: AnyStudy, residuals: list[Residual]) -> list[float]:
    """Weighted relative deviations from the targets.

    Each deviation is divided by the magnitude of its target; all deviations of a list by the list's largest
    magnitude. Where that magnitude is zero, nothing is divided.
    """
    assert study.calibration is not None
    sizes: dict[tuple[str, str, str], float] = {}
    for r in residuals:
        place = (r.scenario, r.controller, r.metric)
        sizes[place] = max(sizes.get(place, 0.0), abs(r.target))
    weights = {(t.scenario, t.controller, t.metric): t.weight for t in study.calibration.targets}
    return [
        weights[r.scenario, r.controller, r.metric]
        * (r.got - r.target)
        / (sizes[r.scenario, r.controller, r.metric] or 1.0)
        for r in residuals
    ]


def residual_rows(fit: Fit) -> list[tuple[str, str, str, str, str]]:
    """Rows of a table: run, metric, target, value and deviation, in display units."""
    rows = []
    for r in fit.residuals:
        metric = _metric(fit.study, r.scenario, r.metric)
        unit = metric.unit or metric.dimension.unit
        expected, got = (units.format(value, unit, metric.dimension, digits=4) for value in (r.target, r.got))
        share = f"{100 * (r.got / r.target - 1):+.1f} %" if r.target else ""
        name = r.metric if r.part is None else f"{r.metric} {r.part:g}"
        rows.append((f"{r.scenario}/{r.controller}", name, expected, got, share))
    return rows
