"""What a trial controller makes of a scenario, by linear simulation of its plants, before anything is run.

The certificate is for any error. A scenario has a particular error at each plant, from its reference, start
and load. Where the filter or the trial's ends keep learning from some of this error, the sum may end above
what the feedback alone leaves. So the scenario itself is tried: at each corner one trial of the feedback is
simulated, and from its error d the errors of all trials follow as R_k d (response.py), phase after phase with
what was learned before.

What differs at random from trial to trial is added as a mean square (random_errors.py). The last plant is the
one that the scenario simulates, phase by phase, if that is within the design's ranges.

The prediction has the sensor's delay and, as noise, its steps (quantisation.py). It has neither other noise,
nor the current loop, nor friction that isn't viscous, nor the limit: `peak` says what the input would need.

`carried` moves what was learned for one reference to another, as trial_basis.h of the control library does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cogless.design.trials.certificate import Gains
from cogless.design.trials.model import Model, Real
from cogless.design.trials.quantisation import Steps
from cogless.design.trials.random_errors import Disturbances, Loops, random_errors
from cogless.design.trials.response import TrialMap
from cogless.design.trials.trial_observer import ObserverGains, observer_gains

PIVOT_LEAST = 1e-3  # share of a function's sum of squares that must be independent of earlier functions


def functions(reference: Real) -> Real:
    """Basis functions, as columns (samples, 5): a constant, acceleration, speed, the speed's sign, jerk."""
    whole = np.concatenate([reference[:1], reference, np.repeat(reference[-1:], 2)])
    steps = np.diff(whole)
    earlier, speed, later = steps[:-2], steps[1:-1], steps[2:]
    columns = (np.ones(len(speed)), (later - earlier) / 2, speed, np.sign(speed), later - 2 * speed + earlier)
    return np.array(columns).T


def carried(v: Real, old: Real, new: Real, n: float, k_2: float) -> Real:
    """v (plants, samples), moved from the old reference to the new one.

    `n`: gain from v to the input. `k_2`: gain of the integral that v acts through, 0 without one. Where the
    law can't move v, v is returned as it is.
    """
    if n == 0 or not 0 <= k_2 / n < 2:
        return v
    before, after = functions(old), functions(new)
    w = n * v + k_2 * (np.cumsum(v, axis=1) - v)
    from scipy.signal import lfilter  # its import takes longer than a run

    theta = _least_squares(before, w)
    change = theta[:, 1:] @ (after - before)[:, 1:].T
    # n d(p) + k_2 (d(0) + .. + d(p - 1)) = change(p)
    return v + np.asarray(lfilter([1.0, -1.0], [n, k_2 - n], change, axis=1))


def _least_squares(columns: Real, w: Real) -> Real:
    """Coefficients (plants, functions), 0 for a function that follows from those before it."""
    chosen: list[int] = []
    for i, column in enumerate(columns.T):
        rest = column
        if chosen:
            basis, _ = np.linalg.qr(columns[:, chosen])
            rest = column - basis @ (basis.T @ column)
        if rest @ rest > PIVOT_LEAST * (column @ column):
            chosen.append(i)
    theta = np.zeros((len(w), columns.shape[1]))
    size = np.linalg.norm(columns[:, chosen], axis=0)
    theta[:, chosen] = np.linalg.lstsq(columns[:, chosen] / size, w.T, rcond=None)[0].T / size
    return theta


PHASE_TRIALS = 80  # largest number of trials that are computed of a phase; later ones are like the last
FINAL_TRIALS = 10  # last trials of a phase, at most half of it: their largest RMS is its final error
FLOOR_RATIO = 1.1  # error / final error; below this a trial is at the floor
STILL_FALLS = 0.98  # last error / that FINAL_TRIALS before; below this the error still falls
ERROR_ROUNDING = 1e-3  # share of the feedback's error; less is rounding, or what the last trials still change


@dataclass(frozen=True)
class Conditions:
    """One phase of a scenario: one trial's reference and load, and how many trials it has."""

    reference: Real  # (samples,), or (samples, plants)
    load: Real  # likewise, in the unit of the input
    start: Real  # (n,), the plant's state at the first sample, or (plants, n)
    trials: int
    plant: Model | None = None  # exactly sampled, where it is known and within the design's ranges
    random: Disturbances | None = None  # what differs from trial to trial


@dataclass(frozen=True)
class PhasePrediction:
    """Of each plant: RMS of the error in each trial, and the largest input, each with learning and without.

    The inputs are without the random part. The RMS that a position sensor's steps leave is kept apart, since
    it is only an estimate of their size.
    """

    learned: Real  # (plants, trials)
    feedback: Real  # (plants,)
    peak: Real  # (plants,), |u| in the last trial
    feedback_peak: Real  # (plants,), |u| without learning
    random: Real  # (plants,), RMS of the part of the last trial's error that differs from trial to trial
    feedback_random: Real  # (plants,), the same without learning
    steps: Real  # (plants,), RMS that the sensor's steps leave in the last trial
    feedback_steps: Real  # (plants,), the same without learning
    trials: int  # trials of the phase; `learned` has PHASE_TRIALS at most
    steps_count: bool = True  # whether `share` counts the steps; False: not in the certificate

    @property
    def trials_to_floor(self) -> tuple[int | None, ...]:
        """For each plant, the trial from which the error stays at its floor; None: it isn't there yet."""
        rows = self.with_steps
        falls = rows[:, -1] < STILL_FALLS * rows[:, -_final_trials(rows)]
        ends_early = self.trials > rows.shape[1]
        return tuple(
            None if ends_early and falling else trials_to_floor(row)
            for row, falling in zip(rows, falls, strict=True)
        )

    @property
    def with_steps(self) -> Real:
        """(plants, trials): RMS over each trial with learning, and with what the sensor's steps leave."""
        return np.asarray(np.hypot(self.learned, self.steps[:, None]))

    @property
    def share(self) -> float:
        """The last trial's RMS / the feedback's, of the worst plant, with what the steps leave of both."""
        learned, feedback = self.learned[:, -1], self.feedback
        if self.steps_count:
            learned, feedback = np.hypot(learned, self.steps), np.hypot(feedback, self.feedback_steps)
        return float(np.max(learned / np.maximum(feedback, 1e-300)))


@dataclass(frozen=True)
class Prediction:
    """A scenario's phases at each plant."""

    labels: tuple[str, ...]  # names of the plants
    phases: tuple[PhasePrediction, ...]

    @property
    def trials_to_floor(self) -> tuple[int | None, ...]:
        """For each phase, trials to the floor at the simulated plant; None: more than were tried."""
        return tuple(phase.trials_to_floor[-1] for phase in self.phases)

    @property
    def floor(self) -> tuple[float, ...]:
        """The final error of each phase at the simulated plant: the largest RMS of its last FINAL_TRIALS."""
        rows = [phase.with_steps[-1] for phase in self.phases]
        return tuple(float(np.max(row[-_final_trials(row) :])) for row in rows)

    @property
    def share(self) -> float:
        """How much of the feedback's error is left at the end of a phase, of the worst plant and phase."""
        return max(phase.share for phase in self.phases)

    @property
    def worst_phase(self) -> int:
        """The number, from 0, of the phase with the largest share."""
        return int(np.argmax([phase.share for phase in self.phases]))

    @property
    def ends_above(self) -> bool:
        """Whether some phase ends above the feedback's error at some plant."""
        return not self.share <= 1 + ERROR_ROUNDING

    def beyond(self, limit: float) -> tuple[str, float] | None:
        """The plant that needs the most input and how much; None if all stay within the limit."""
        peaks = np.max([np.maximum(phase.peak, phase.feedback_peak) for phase in self.phases], axis=0)
        k = int(np.argmax(peaks))
        return (self.labels[k], float(peaks[k])) if peaks[k] > limit else None


def predict(
    models: Sequence[Model],
    labels: Sequence[str],
    C: Real,
    law: Gains | ObserverGains,
    trial: TrialMap,
    ahead: tuple[Real, Real, int] | None,
    phases: Sequence[Conditions],
    remains: Sequence[Steps],
    basis_functions: bool = False,
) -> Prediction:
    """The prediction for these plants.

    `trial`: learning at the same plants, in their order. `ahead`: numerator, denominator and preview of the
    feedforward. The last plant is that of each phase, if that is known. `remains`: what the sensor's steps
    leave at the end of each phase. `basis_functions`: what was learned moves along with a changed reference.
    """
    plants = [list(models)]
    for phase in phases:
        plants.append([*models[:-1], phase.plant or plants[-1][-1]])
    rows = [model for of_phase in plants[1:] for model in of_phase]
    together = _together(phases, len(models))
    f = np.array([feedforward(ahead, phase.reference) for phase in phases]).repeat(len(models), axis=0).T
    rest = np.zeros((len(rows), trial.samples))
    errors, lessons, inputs = (
        np.split(of_rows, len(phases)) for of_rows in simulated(rows, C, law, together, f, rest)
    )
    v = rest[: len(models)]
    last_v, learned, randoms = [], [], []
    for index, phase in enumerate(phases):
        if basis_functions and index:
            integral = law.K_2 if isinstance(law, Gains) and law.through_integrator else 0.0
            n = law.N if isinstance(law, Gains) else 1.0
            v = carried(v, phases[index - 1].reference, phase.reference, n, integral)
        trial = replace(trial, loops=[*trial.loops[:-1], law.closed(plants[index + 1][-1], C)])
        loops = random_loops(plants[index + 1], C, law, trial)
        added = trial.correction(lessons[index])
        rms = []
        for _ in range(min(phase.trials, PHASE_TRIALS)):
            last = v
            rms.append(_rms(errors[index] - loops.position.output(v)))
            v = trial.recall(v) - trial.correction(trial.output(v)) + added
        last_v.append(last)
        learned.append(np.array(rms).T)
        none = np.zeros(len(models)), np.zeros(learned[-1].shape)
        randoms.append(none if phase.random is None else random_errors(loops, phase.random, len(rms)))
    _, _, learned_u = simulated(rows, C, law, together, f, np.concatenate(last_v))
    peaks = np.split(np.abs(learned_u).max(axis=1), len(phases))
    predictions = [
        PhasePrediction(
            learned=np.hypot(learned[index], np.sqrt(random)),
            feedback=np.hypot(_rms(errors[index]), np.sqrt(alone)),
            peak=peaks[index],
            feedback_peak=np.abs(inputs[index]).max(axis=1),
            random=np.sqrt(random[:, -1]),
            feedback_random=np.sqrt(alone),
            steps=remains[index].learned[:, 0],
            feedback_steps=remains[index].feedback,
            trials=phase.trials,
            steps_count=remains[index].count,
        )
        for index, (phase, (alone, random)) in enumerate(zip(phases, randoms, strict=True))
    ]
    return Prediction(tuple(labels), tuple(predictions))


def _together(phases: Sequence[Conditions], plants: int) -> Conditions:
    """The conditions of all phases for one call of `simulated`, with so many plants for each."""
    reference, load, start = (
        np.array([getattr(phase, name) for phase in phases]).repeat(plants, axis=0)
        for name in ("reference", "load", "start")
    )
    return Conditions(reference.T, load.T, start, 1)


def trials_to_floor(errors: Real) -> int | None:
    """The trial, counted from 1, from which the RMS of a phase's trials stays within FLOOR_RATIO of the end.

    None if there is no such trial: the errors aren't finite.
    """
    above = np.flatnonzero(~(errors <= FLOOR_RATIO * np.max(errors[-_final_trials(errors) :])))
    first = int(above[-1]) + 2 if len(above) else 1
    return first if first <= len(errors) else None


def _final_trials(errors: Real) -> int:
    return max(1, min(FINAL_TRIALS, int(errors.shape[-1]) // 2))


def random_loops(models: Sequence[Model], C: Real, law: Gains | ObserverGains, trial: TrialMap) -> Loops:
    """The loops of these plants for errors that differ from trial to trial; `trial` as of `predict`."""
    position = TrialMap(
        loops=[law.position(m, C) for m in models],
        K_3=trial.K_3,
        shift=trial.shift,
        q_filter=None,
        filtered="error",
        samples=trial.samples,
    )

    def respond(reference: Real, load: Real, start: Real, probes: int) -> tuple[Real, Real]:
        rows = [model for model in models for _ in range(probes)]
        rest = np.zeros((len(rows), trial.samples))
        conditions = Conditions(reference, load, start, 1)
        error, lesson, _ = simulated(rows, C, law, conditions, np.zeros(trial.samples), rest)
        return error, lesson

    K_1 = law.K_1 if isinstance(law, Gains) else np.zeros(len(C))
    return Loops(respond, trial, position, C, K_1)


def feedforward(ahead: tuple[Real, Real, int] | None, reference: Real) -> Real:
    """f(p) of (41): the reference rests before its first and after its last sample."""
    samples = len(reference)
    f = np.zeros(samples)
    if ahead is None:
        return f
    num, den, preview = ahead
    rest = float(np.sum(num) / np.sum(den)) * reference[0]
    places = np.arange(samples)[:, None] + preview - np.arange(len(num))
    for p, taps in enumerate(reference[np.clip(places, 0, samples - 1)]):
        before = [f[p - j] if p >= j else rest for j in range(1, len(den))]
        f[p] = num @ taps - float(np.dot(den[1:], before))
    return f


def simulated(
    models: Sequence[Model],
    C: Real,
    law: Gains | ObserverGains,
    phase: Conditions,
    f: Real,
    v: Real,
) -> tuple[Real, Real, Real]:
    """One trial of each plant with v: the error, what is learned from, and the input; (plants, samples).

    The start and each sample of the reference, the load and f are of all plants or have one value per plant.
    """
    A, B = np.array([m.A for m in models]), np.array([m.B[:, 0] for m in models])
    starts = np.broadcast_to(phase.start, (len(models), phase.start.shape[-1]))
    x = np.array([model.started(start) for model, start in zip(models, starts, strict=True)])
    view = models[0].view
    true, seen = models[0].output(C), C @ view
    error, u = np.zeros_like(v), np.zeros_like(v)
    psi = np.zeros(len(models))
    observer = _Observer(law, len(models)) if isinstance(law, ObserverGains) else None
    lesson = np.zeros_like(v)
    weights = law.K_1 @ view if isinstance(law, Gains) else None
    for p in range(v.shape[1]):
        error[:, p] = phase.reference[p] - x @ true
        e = phase.reference[p] - x @ seen
        if observer is not None:
            feedback, lesson[:, p] = observer.step(e)
            observer.act(feedback)
            u[:, p] = feedback + f[p] + v[:, p]
        else:
            assert isinstance(law, Gains)
            lesson[:, p] = e
            u[:, p] = x @ weights + law.K_2 * psi + f[p] + law.N * v[:, p]
            if law.integral:
                psi = psi + e + (v[:, p] if law.through_integrator else 0.0)
        x = np.einsum("kij,kj->ki", A, x) + B * (u[:, p] - phase.load[p])[:, None]
    return error, lesson, u


class _Observer:
    """The observer of the law, for several plants."""

    def __init__(self, gains: ObserverGains, plants: int) -> None:
        self._g = gains.response
        self._l, self._k = observer_gains(gains.pole)
        self._x = np.zeros((plants, 3))
        self._before: list[Real] = []
        self._acted = [np.zeros(plants)] * 2

    def step(self, e: Real) -> tuple[Real, Real]:
        """The whole feedback, and r of two samples ago."""
        if not self._before:
            self._x[:, 0] = e
            self._before = [e] * 3
        self._x = self._x + self._l * (e - self._x[:, 0])[:, None]
        b = self._before
        missing = self._acted[1] + (e - b[0] - b[1] + b[2]) / (2 * self._g)
        self._before = [e, b[0], b[1]]
        return (self._x[:, :2] @ self._k + self._x[:, 2]) / self._g, missing

    def act(self, feedback: Real) -> None:
        """Goes on to the next sample with this feedback."""
        push = self._x[:, 2] - self._g * feedback
        s = self._x[:, 1]
        self._x = np.stack([self._x[:, 0] + s + push / 2, s + push, self._x[:, 2]], axis=1)
        self._acted = [feedback, self._acted[0]]


def _rms(rows: Real) -> Real:
    return np.asarray(np.sqrt(np.mean(rows**2, axis=1)))
