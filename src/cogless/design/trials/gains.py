"""Design of a trial controller from an uncertain plant and weights: its gains, and their certificate.

docs/laws/trial.md has the law, docs/theory/trial-design.md the design of each `kind`:

    robust         Mandra 2019, Fig. 1: (9) to (13), (32) to (35), (41)
    state          the older law (3), by the same inequalities, without integral action
    norm-optimal   the feedback of `robust`, and v <- v + L e instead of v <- v + K_3 e(p + shift)
    observer       feedback from an observed error, learning of the missing input: trial_observer.py

All structures share K_s, N, the feedforward and K_3, as in the paper: design them once with `design_gains`
and pass them to `design_trial` for each structure. K_3 is designed for Fig. 1. For a controller without
integral action there are two cases. If Q weighs the integrator, the feedback is designed with it, and K_2 is
then set to zero. If Q doesn't, the feedback is designed without the integrator.

Norm-optimal learning in lifted form: docs/theory/trial-design.md#norm-optimal-learning.

Over a trial the nominal closed loop from v to y is a lower triangular Toeplitz matrix G of its impulse
response. The update is v_{k+1} = v_k + L e_k with L = (G^T G + q I)^-1 G^T, where q is the weight of v's
change relative to the error's weight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cogless.design.trials.certificate import GROWTH_ROUNDING, Certificate, Gains, Structure, Update, certify
from cogless.design.trials.feedforward import Feedforward, dynamic, static_gain
from cogless.design.trials.learning_filter import JUDGED_TRIALS, Bench, Choice, learning_filters
from cogless.design.trials.learning_gain import LearningGain, learning_gain
from cogless.design.trials.model import DesignError, Discretisation, Model, Real
from cogless.design.trials.polytope import UncertainPlant
from cogless.design.trials.prediction import Conditions, Prediction, predict, random_loops
from cogless.design.trials.quantisation import Steps, steps
from cogless.design.trials.random_errors import Amplification, amplification
from cogless.design.trials.response import (
    FACTOR_ROUNDING,
    PROPOSED_FACTOR_MOST,
    Bundle,
    Filter,
    Filtered,
    Loop,
    TrialMap,
    best_gain,
    better_shift,
    butterworth,
    padded,
    workable_cutoff,
)
from cogless.design.trials.state_feedback import StateFeedback, guaranteed_cost
from cogless.design.trials.trial_observer import (
    OBSERVER_SHIFT,
    ObserverGains,
    design_observer,
    highest_cutoff,
    inverse,
)
from cogless.errors import StudyError
from cogless.study.reading import Changes, Remark


def impulse_response(loop: Loop, samples: int) -> Real:
    """Impulse response C A^(p-1) B at the samples p = 0 .. samples - 1; it is zero at p = 0."""
    out, x = np.zeros(samples), loop.B[:, 0]
    for p in range(1, samples):
        out[p] = loop.C @ x
        x = loop.A @ x
    return out


def lifted(loop: Loop, samples: int) -> Real:
    """The lifted closed loop: the Toeplitz matrix G (samples, samples)."""
    from scipy.linalg import toeplitz

    return np.asarray(toeplitz(impulse_response(loop, samples), np.zeros(samples)))


def norm_optimal(loop: Loop, samples: int, ratio: float) -> Real:
    """L (samples, samples); `ratio` is the weight of v's change divided by the weight of the error."""
    from scipy.linalg import cho_factor, cho_solve

    G = lifted(loop, samples)
    normal = G.T @ G
    normal[np.diag_indices(samples)] += ratio
    return np.asarray(
        cho_solve(cho_factor(normal, overwrite_a=True, check_finite=False), G.T, check_finite=False)
    )


Ends = Literal["even", "odd"]
Kind = Literal["robust", "state", "norm-optimal", "observer"]


NO_K_3 = ("q_filter", "shift", "K_3")  # keys of errors after which the feedback can be kept, without a K_3
CUTOFF_SHARE = 0.97  # an advised cutoff is this share of the largest one, because it is rounded
WEIGHT_DECADES = 12  # number of powers of ten that are tried as a weight
AUTOMATIC: Changes = {"q_filter": "auto", "shift": "auto"}  # the design chooses both, and K_3
BY_FREQUENCY = (
    "K_3 was chosen by the frequency response. From one trial to the next it multiplies the error, at its "
    "worst frequency, by"
)
LOW_PASS = "expected a zero-phase low-pass filter on the learned signal"


@dataclass(frozen=True, kw_only=True)
class TrialSettings:
    """Settings of a trial controller's design; n is the number of the plant's states without integrator."""

    samples: int  # alpha, samples/trial
    Q: ArrayLike  # (n + 1, n + 1), or (n, n) for a feedback that is designed without integral action
    R: float
    gamma: ArrayLike  # initial state whose cost is bounded, sized as Q
    f: ArrayLike  # initial change of the state from trial to trial (31), sized as Q
    g: float  # initial error (31)
    kind: Kind = "robust"
    structure: Structure = "input-and-integrator"
    integral: bool = True
    learning: bool = True
    feedforward: bool = True  # dynamic
    inverted: Discretisation = "exact"  # sampling of the nominal plant that it inverts; exact only if known
    cutoff: float | Literal["auto"] | None = None  # of the zero-phase filter, Hz; None: no filter
    filter_order: int = 2
    ends: Ends = "even"  # reflection by which the filter continues the trial
    filtered: Filtered = "error"  # the filter acts on the error e, or on the signal v + K_3 e
    K_s: ArrayLike | None = None  # gains given here are certified, not designed; sized as Q
    N: float | None = None
    K_3: float | None = None
    # v(p) learns from e(p + shift), samples; None: the relative degree
    shift: int | Literal["auto"] | None = None
    pole: float | None = None  # of kind observer; None: by its rule
    basis_functions: bool = False  # what was learned moves along with a changed reference
    limit: float | None = None  # bounds the input, in its unit
    change_weight: float = 1e-2  # for norm-optimal learning: weight of v's change; the error's is 1

    @property
    def chooses(self) -> bool:
        """Whether the design chooses the shift or the filter."""
        return "auto" in (self.shift, self.cutoff)

    @property
    def filter_acts_on(self) -> Filtered:
        """What is filtered: a filter that the design chooses acts on the signal."""
        return "signal" if self.cutoff == "auto" else self.filtered


@dataclass(frozen=True)
class TrialGains:
    """Gains that controllers of all structures share."""

    K_s: Real
    integral: bool  # K_s has a gain for the integrator
    N: float
    feedforward: Feedforward | None
    K_3: float | None  # None if learning doesn't use it, or if none exists
    no_K_3: DesignError | None  # why no K_3 exists
    feedback: StateFeedback | None  # None if K_s was given
    learning: LearningGain | None  # None if K_3 was given, or wasn't found by (35)
    notes: tuple[Remark, ...]  # of the feedback; their cures have the names of settings as keys
    observer: ObserverGains | None = None  # of kind observer, in place of K_s
    cutoff: float | None = None  # Hz, of kind observer or chosen by the design; a chosen None is no filter
    shift: int | None = None  # samples; None: none was chosen
    learning_notes: tuple[Remark, ...] = ()  # of K_3, for the laws that learn with it


@dataclass(frozen=True, kw_only=True)
class TrialParameters:
    """All parameters of a trial law."""

    kind: Kind
    K_1: Real  # (n,)
    K_2: float
    N: float
    C: Real  # (n,)
    through_integrator: bool
    feedforward: Feedforward | None
    K_3: float
    shift: int
    q_filter: Filter | None
    filtered: Filtered
    learning_matrix: Real | None  # (samples, samples), instead of K_3, shift and a filter on the error
    gains: TrialGains
    no_K_3: StudyError | None = None  # why no K_3 exists for a law that needs it: it doesn't run

    @property
    def learns(self) -> bool:
        """Whether the law learns from trial to trial."""
        return bool(self.K_3) or self.learning_matrix is not None


@dataclass(frozen=True, kw_only=True)
class TrialDesign(TrialParameters):
    """All parameters of a trial law, and their certificate."""

    certificate: Certificate
    notes: tuple[Remark, ...]
    beyond: tuple[str, ...] = ()  # warnings of simulated values outside the ranges of the design
    prediction: Prediction | None = None  # of the scenario; None if the loop is unstable
    limit: float | None = None  # bounds the input, in its unit
    amplify: Callable[[], Amplification] | None = field(default=None, compare=False, repr=False)

    @cached_property
    def amplification(self) -> Amplification | None:
        """What learning makes of errors that don't repeat; None without it, or if a loop is unstable."""
        return self.amplify() if self.amplify is not None else None

    @property
    def certified(self) -> bool:
        """Whether learning never ends above the feedback, as far as the models know.

        That is: the loop is stable and no frequency grows from trial to trial, at all plants that the
        certificate covers; and tried on the scenario itself, at each corner, the error ends no higher than
        without learning, and the input stays within its limit.
        """
        part, prediction = self.certificate.deciding, self.prediction
        return (
            part.stable
            and part.learning is not None
            and part.learning.monotone
            and not self.beyond
            and prediction is not None
            and not prediction.ends_above
            and self.over_limit is None
        )

    @property
    def over_limit(self) -> tuple[str, float] | None:
        """The plant that needs most input and how much, if that is above the limit; None otherwise."""
        if self.prediction is None or self.limit is None:
            return None
        return self.prediction.beyond(self.limit)


def design_gains(plant: UncertainPlant, settings: TrialSettings) -> TrialGains:
    """Feedback, feedforward, and the learning gain or the reason why there is none.

    DesignError: the design fails for another reason.
    """
    n = plant.order
    _check(plant, settings)
    if settings.kind == "observer":
        return _observer_gains(plant, settings)
    Q, gamma, f = (np.asarray(value, dtype=float) for value in (settings.Q, settings.gamma, settings.f))
    integral = len(Q) > n and settings.kind != "state"
    size = n + integral
    if settings.kind == "state":
        Q, gamma, f = Q[:n, :n], gamma[:n], f[:n]
    notes = [Remark(plant.note)] if plant.note else []
    feedback = None
    if settings.K_s is None:
        feedback = guaranteed_cost(plant, Q, settings.R, gamma, integral)
        K_s = feedback.K_s
    else:
        K_s = np.asarray(settings.K_s, dtype=float).ravel()
        if K_s.shape != (size,) or not np.all(np.isfinite(K_s)):
            raise DesignError(f"K_s: expected {size} finite numbers")
    N = settings.N
    if N is None:
        N = 1.0 if settings.kind == "state" else static_gain(plant.nominal, plant.C, K_s[:n])
    forward = settings.feedforward and settings.kind != "state"
    inverted = plant.exact_nominal if settings.inverted == "exact" else None
    ahead = dynamic((inverted or plant.nominal).plant, plant.C, K_s[:n]) if forward else None
    K_3, learned, no_K_3 = settings.K_3, None, None
    choice: Choice | None = None
    note: Remark | None = None
    if needs_K_3(settings) and (K_3 is None or settings.chooses):
        law = _law(K_s, n, N, integral, settings.kind != "state")
        try:
            if settings.chooses:
                bench = _bench(plant, law, settings)
                choice = _chosen(plant, law, settings, bench)
                K_3, note = choice.K_3 if K_3 is None else K_3, _choice_note(bench, choice)
            else:
                K_3, learned, note = _learning_gain(plant, law, settings, f)
        except DesignError as error:
            if error.key not in NO_K_3:
                raise
            no_K_3 = error
    of_learning = (note,) if note is not None else ()
    gains = TrialGains(
        K_s=K_s,
        integral=integral,
        N=N,
        feedforward=ahead,
        K_3=K_3,
        no_K_3=no_K_3,
        feedback=feedback,
        learning=learned,
        notes=tuple(notes),
    )
    gains = replace(gains, learning_notes=of_learning)
    return gains if choice is None else replace(gains, shift=choice.shift, cutoff=choice.cutoff)


def needs_K_3(settings: TrialSettings) -> bool:
    """Whether the law learns with the gain K_3."""
    return settings.learning and settings.kind != "norm-optimal"


def design_trial(
    plant: UncertainPlant, settings: TrialSettings, gains: TrialGains | None = None
) -> TrialDesign:
    """Designs a whole controller and its certificate.

    `gains` that were designed for another structure can be reused; if None, they are designed here. Raises
    DesignError if the design fails.
    """
    parameters, law, update = _parameters(plant, settings, gains or design_gains(plant, settings))
    sampled_exactly = (
        plant.discretisation == "exact" and not plant.sensor.at_once
    )  # The certificate then has one row: the plants as the law gets them.
    certified = plant.as_held if parameters.gains.observer or sampled_exactly else plant
    loop = parameters.gains.observer or law
    certificate = certify(
        certified, loop, update, parameters.q_filter, settings.filter_acts_on, settings.samples
    )
    of_learning = parameters.gains.learning_notes if needs_K_3(settings) else ()
    of_certificate = _warnings(certified, loop, certificate, update, settings, parameters.q_filter)
    notes = (*parameters.gains.notes, *of_learning, *of_certificate)
    return TrialDesign(**vars(parameters), certificate=certificate, notes=notes)


def scenario_prediction(
    plant: UncertainPlant, settings: TrialSettings, gains: TrialGains, phases: Sequence[Conditions]
) -> Prediction:
    """The prediction for a scenario, at each corner, the nominal and the simulated plant.

    The plants are exactly sampled if that is known. DesignError as `design_trial`.
    """
    parameters, law, update = _parameters(plant, settings, gains)
    held_plant, loop = plant.as_held, gains.observer or law
    models, labels = _corners(held_plant)
    simulated = [phase.plant for phase in phases if phase.plant is not None]
    if len(simulated) == len(phases):
        models, labels = [*models, held_plant.nominal], (*labels, "the simulated plant")
    trial = _trial_map(models, loop, update, parameters, plant.C, settings.samples)
    f = parameters.feedforward
    ahead = None if f is None else (f.num, f.den, f.preview)
    remains = _steps_of_phases(plant, models, loop, update, parameters, phases)
    return predict(models, labels, plant.C, loop, trial, ahead, phases, remains, settings.basis_functions)


def _steps_of_phases(
    plant: UncertainPlant,
    models: Sequence[Model],
    loop: Gains | ObserverGains,
    update: Update | None,
    parameters: TrialParameters,
    phases: Sequence[Conditions],
) -> list[Steps]:
    """What the sensor's steps leave at the end of each phase; the last model is that of the phase."""
    fixed = models[:-1]
    of_all = steps(
        [*fixed, *(phase.plant or models[-1] for phase in phases)],
        plant.C,
        loop,
        update,
        parameters.q_filter,
        parameters.filtered,
        sensor=plant.sensor,
        period=plant.period,
        trials=np.cumsum([phase.trials for phase in phases]).tolist(),
    )
    rows = [[*range(len(fixed)), len(fixed) + index] for index in range(len(phases))]
    return [
        Steps(of_all.feedback[row], of_all.learned[row][:, [k]], plant.sensor.certified)
        for k, row in enumerate(rows)
    ]


def random_amplification(plant: UncertainPlant, settings: TrialSettings, gains: TrialGains) -> Amplification:
    """What learning makes of errors that don't repeat, at the corners and the nominal plant."""
    parameters, law, update = _parameters(plant, settings, gains)
    loop = gains.observer or law
    models, labels = _corners(plant.as_held)
    trial = _trial_map(models, loop, update, parameters, plant.C, settings.samples)
    return amplification(labels, random_loops(models, plant.C, loop, trial))


def _corners(plant: UncertainPlant) -> tuple[list[Model], tuple[str, ...]]:
    return [*plant.vertices, plant.nominal], (*plant.labels, "the nominal plant")


def _trial_map(
    models: Sequence[Model],
    loop: Gains | ObserverGains,
    update: Update | None,
    parameters: TrialParameters,
    C: Real,
    samples: int,
) -> TrialMap:
    return TrialMap(
        loops=[loop.closed(model, C) for model in models],
        K_3=update.K_3 if update is not None else 0.0,
        shift=parameters.shift,
        q_filter=parameters.q_filter,
        filtered=parameters.filtered,
        samples=samples,
        matrix=parameters.learning_matrix,
    )


def trial_parameters(plant: UncertainPlant, settings: TrialSettings, gains: TrialGains) -> TrialParameters:
    """A controller's parameters from its gains, without a certificate. DesignError as `design_trial`."""
    return _parameters(plant, settings, gains)[0]


def _parameters(
    plant: UncertainPlant, settings: TrialSettings, gains: TrialGains
) -> tuple[TrialParameters, Gains, Update | None]:
    _check(plant, settings)
    if gains.no_K_3 is not None and needs_K_3(settings):
        raise gains.no_K_3
    n, shift = plant.order, OBSERVER_SHIFT if gains.observer else _shift(plant, settings, gains)
    integral = gains.integral and settings.integral
    through = settings.structure == "input-and-integrator" and integral and settings.learning
    law = _law(gains.K_s, n, gains.N, integral, through)
    normal = settings.kind == "norm-optimal" and settings.learning
    cutoff = gains.cutoff if gains.observer or settings.cutoff == "auto" else settings.cutoff
    q_filter = None
    if cutoff is not None and settings.learning and (settings.filter_acts_on == "signal" or not normal):
        q_filter = butterworth(cutoff, settings.filter_order, plant.period, settings.ends == "odd")
    K_3 = gains.K_3 or 0.0
    update, matrix = None, None
    if normal:
        # for a fair comparison, with the model that is closest to the drive
        nominal = law.closed(plant.exact_nominal or plant.nominal, plant.C)
        if nominal.radius >= 1:
            late = "" if plant.sensor.at_once else ", whose state the feedback gets late"
            raise DesignError(f"K_s: expected feedback that is stable at the nominal plant{late}")
        matrix = norm_optimal(nominal, settings.samples, settings.change_weight)
        update = Update(shift, 0.0, settings.change_weight, nominal, matrix)
    elif settings.learning and K_3:
        update = Update(shift, K_3)
    parameters = TrialParameters(
        kind=settings.kind,
        K_1=law.K_1,
        K_2=law.K_2,
        N=law.N,
        C=plant.C,
        through_integrator=through,
        feedforward=gains.feedforward if settings.feedforward else None,
        K_3=K_3 if update is not None and not normal else 0.0,
        shift=shift,
        q_filter=q_filter,
        filtered=settings.filter_acts_on,
        learning_matrix=matrix,
        gains=gains,
    )
    return parameters, law, update


def _shift(plant: UncertainPlant, settings: TrialSettings, gains: TrialGains | None = None) -> int:
    """The shift in samples: given, chosen, or the relative degree."""
    shift = gains.shift if settings.shift == "auto" and gains is not None else settings.shift
    return shift if isinstance(shift, int) else plant.relative_degree


def _observer_gains(plant: UncertainPlant, settings: TrialSettings) -> TrialGains:
    """The gains of kind observer: K_s is zero, and K_3 one."""
    observer = design_observer(plant, settings.pole, settings.limit)
    cutoff = settings.cutoff
    if not isinstance(cutoff, float):
        cutoff = highest_cutoff(plant, observer, settings.filter_order)
    ahead = inverse(plant) if settings.feedforward else None
    notes = (Remark(plant.note),) if plant.note else ()
    none = np.zeros(plant.order)
    return TrialGains(
        K_s=none,
        integral=False,
        N=1.0,
        feedforward=ahead,
        K_3=1.0,
        no_K_3=None,
        feedback=None,
        learning=None,
        notes=notes,
        observer=observer,
        cutoff=cutoff,
    )


def _law(K_s: Real, n: int, N: float, integral: bool, through: bool) -> Gains:
    return Gains(K_s[:n], float(K_s[n]) if integral else 0.0, N, through, integral)


def _learning_gain(
    plant: UncertainPlant, law: Gains, settings: TrialSettings, f: Real
) -> tuple[float, LearningGain | None, Remark | None]:
    """K_3 by (35). It is found by frequency response if (35) gives none, or if the shift isn't r."""
    r = plant.relative_degree
    shift = _shift(plant, settings)
    loops = _stable_loops(plant, law)
    try:
        if shift != r:
            line = f"shift: {shift}: no gain shrinks the error at every frequency; {LOW_PASS}"
            raise DesignError(line)
        solution = learning_gain(loops, law.closed(plant.nominal, plant.C), r, f, settings.g)
        return solution.K_3, solution, Remark(solution.note) if solution.note else None
    except DesignError as error:
        if error.key not in ("q_filter", "shift"):
            raise
        _check_sign(plant, law, settings)
        exact = [law.closed(m, plant.C) for m in plant.exact_vertices or ()]
        everywhere = padded([*loops, *(loop for loop in exact if loop.radius < 1)])
        by_frequency = _by_frequency(everywhere, plant, settings, shift)
        if by_frequency is not None:
            K_3, note = by_frequency
            return K_3, None, note
        end, *cures = _together(plant, law, settings)
        raise DesignError(f"{error}{end}").advising(*cures) from None


def _stable_loops(plant: UncertainPlant, law: Gains) -> list[Loop]:
    """The closed loops at the vertices; DesignError if one is unstable."""
    loops = [law.closed(m, plant.C) for m in plant.vertices]
    for label, loop in zip(plant.labels, loops, strict=True):
        if loop.radius >= 1:
            raise DesignError(
                f"K_s: expected feedback that is stable at {label}; its largest pole is {loop.radius:.4g}"
            )
    return loops


def _chosen(plant: UncertainPlant, law: Gains, settings: TrialSettings, bench: Bench) -> Choice:
    """Shift, cut-off and K_3 by learning_filter.py; DesignError if nothing works."""
    _stable_loops(plant, law)
    choice = next(learning_filters(bench), None)
    if choice is None:
        _check_sign(plant, law, settings)
        raise DesignError(
            "q_filter: with every shift, filter and K_3 the error grows at some frequency, or near the "
            "trial's beginning or end; expected a feedback with less lag"
        )
    return choice


def _choice_note(bench: Bench, choice: Choice) -> Remark:
    passes = "no filter" if choice.cutoff is None else f"a filter of {choice.cutoff:.3g} Hz"
    return Remark(
        f"the design chose shift = {choice.shift}, {passes} and K_3 together. After {JUDGED_TRIALS} trials, "
        f"at the worst corner of the parameters' ranges, {100 * bench.share_left(choice):.2g} % of the "
        "error is left that a load step causes"
    )


def other_choices(plant: UncertainPlant, settings: TrialSettings, gains: TrialGains) -> Iterator[TrialGains]:
    """The same gains with other shifts, filters and K_3 than those chosen, the best first."""
    law = _law(gains.K_s, plant.order, gains.N, gains.integral, settings.kind != "state")
    bench = _bench(plant, law, settings)
    for choice in learning_filters(bench):
        if (choice.shift, choice.cutoff) != (gains.shift, gains.cutoff):
            K_3 = choice.K_3 if settings.K_3 is None else settings.K_3
            notes = (_choice_note(bench, choice),)
            yield replace(gains, K_3=K_3, shift=choice.shift, cutoff=choice.cutoff, learning_notes=notes)


def _bench(plant: UncertainPlant, law: Gains, settings: TrialSettings) -> Bench:
    """The loops of a feedback.

    The exactly sampled models are judged if they are known and all their loops are stable, else the design's.
    """

    def stable(models: Sequence[Model]) -> list[Loop]:
        return [loop for loop in (law.closed(m, plant.C) for m in models) if loop.radius < 1]

    held_plant = plant.as_held
    judged = [*held_plant.vertices, held_plant.nominal]
    if len(stable(judged)) < len(judged):
        judged = [*plant.vertices, plant.nominal]
    learning = [law.closed(m, plant.C) for m in judged]
    loaded = [
        Loop(loop.A, np.pad(m.B, ((0, len(loop.A) - m.order), (0, 0))), loop.C)
        for m, loop in zip(judged, learning, strict=True)
    ]
    design, exact = plant.random
    return Bench(
        learning=learning,
        loaded=loaded,
        others=stable([*plant.vertices, plant.nominal]),
        drawn=stable([*design, *(exact or ())]),
        least_shift=plant.relative_degree,
        period=plant.period,
        samples=settings.samples,
        order=settings.filter_order,
        shift=plant.relative_degree if settings.shift is None else settings.shift,
        cutoff=settings.cutoff,
        filtered=settings.filter_acts_on,
        odd=settings.ends == "odd",
    )


def _check_sign(plant: UncertainPlant, law: Gains, settings: TrialSettings) -> None:
    """DesignError if N and the loop's gain at zero frequency differ in sign; no check without such a gain."""
    if settings.N is None or settings.kind == "state":
        return
    try:
        expected = static_gain(plant.nominal, plant.C, law.K_1)
    except DesignError:
        return
    if expected * settings.N < 0:
        side = "above" if expected > 0 else "below"
        raise DesignError(
            f"N: {settings.N:g}: expected a number {side} zero: N must have the sign of the loop's gain "
            "at zero frequency"
        )


def _together(plant: UncertainPlant, law: Gains, settings: TrialSettings) -> tuple[str, *tuple[Changes, ...]]:
    """The end of a message, and the change that it advises: a shift and a filter that are chosen together."""
    choice = _automatic(plant, law, settings)
    if choice is None:
        return ("; with this feedback no filter and shift make learning fast",)
    of = "no filter" if choice.cutoff is None else f"a filter of {choice.cutoff:.3g} Hz"
    end = f'q_filter = "auto" and shift = "auto" would choose {of} and a shift of {choice.shift}'
    return f", and a shift that suits it; {end}", dict(AUTOMATIC)


def _automatic(plant: UncertainPlant, law: Gains, settings: TrialSettings) -> Choice | None:
    """What the design chooses where a study says nothing of shift and filter; None if nothing works."""
    auto = replace(settings, shift="auto", cutoff="auto", filter_order=2, ends="even")
    return next(learning_filters(_bench(plant, law, auto)), None)


def _filter(cutoff: float, settings: TrialSettings) -> Changes:
    """A filter on the learned signal, safely below a cutoff in Hz."""
    order = settings.filter_order
    return {"q_filter": {"cutoff": f"{CUTOFF_SHARE * cutoff:.3g} Hz", "order": order, "acts_on": "signal"}}


def _by_frequency(
    loops: Sequence[Loop], plant: UncertainPlant, settings: TrialSettings, shift: int
) -> tuple[float, Remark] | None:
    """K_3 with the smallest max |F| over frequency, and a note.

    None if that is above `PROPOSED_FACTOR_MOST`.
    """
    bundle = Bundle(loops, shift)
    w = bundle.grid
    G = bundle(w)
    if settings.cutoff is None or settings.filtered != "signal":
        K_3, worst = best_gain(G)
        note = f"{BY_FREQUENCY} {worst:.4g}"
        unused = f"Rule (35) of Mandra 2019 is not used, since it is for a shift of {plant.relative_degree}"
        sentence = f"{note}. {unused}"
        return (K_3, Remark(sentence)) if worst <= PROPOSED_FACTOR_MOST else None
    assert isinstance(settings.cutoff, float)
    q_filter = butterworth(settings.cutoff, settings.filter_order, plant.period, settings.ends == "odd")
    K_3, worst = best_gain(G, q_filter.gain(w))
    if worst > PROPOSED_FACTOR_MOST:
        return None
    note = f"{BY_FREQUENCY} {worst:.4g} with the filter on the learned signal"
    better = better_shift(loops, plant.relative_degree, q_filter, shift, settings.samples)
    if better is None:
        return K_3, Remark(note)
    now, other, then = better
    note += f", and near the trial's beginning or end by {now:.2g}; shift = {other} gives {then:.2g}"
    return K_3, Remark(note, ({"shift": other},))


def _warnings(
    plant: UncertainPlant,
    law: Gains | ObserverGains,
    certificate: Certificate,
    update: Update | None,
    settings: TrialSettings,
    q_filter: Filter | None = None,
) -> list[Remark]:
    """Warnings that the error can grow along the trial or from trial to trial, with the remedy.

    The warnings are about the models that decide.
    """
    notes: list[Remark] = []
    kind, part = certificate.decides, certificate.deciding
    models = plant.vertices if kind == "design" else plant.exact_vertices or ()
    if not part.stable:
        where = f"at {part.worst}, with a pole of {part.radius:.4g}"
        notes.append(Remark(f"{kind} model: unstable along the trial {where}"))
    learning = part.learning
    if update is None or learning is None or learning.monotone:
        return notes
    note, cures = f"{kind} model: the error can grow by a factor of ", tuple[Changes, ...]()
    if learning.norm > 1 + FACTOR_ROUNDING:
        note += f"{_factor(learning.norm)} a trial at {learning.frequency:.4g} Hz"
    elif part.growth is not None and part.growth > 1 + GROWTH_ROUNDING:
        note += f"{_factor(part.growth)} a trial, near the trial's beginning or end"
    else:
        note += f"{_factor(part.phi_radius or 1.0)} a sample: this is the largest pole of trial and learning "
        note += "together, of the matrix Phi, (27) of Mandra 2019"
    if update.ratio is None:
        loops = [law.closed(m, plant.C) for m in models]
        cutoff = workable_cutoff(
            loops, update.shift, settings.filter_order, plant.period, settings.samples, update.K_3
        )
        if cutoff is not None:
            note += f"; a zero-phase low-pass filter of {cutoff:.3g} Hz or less on the learned signal "
            note, cures = f"{note}prevents it", (_filter(cutoff, settings),)
        elif isinstance(law, Gains) and settings.K_3 is None and _automatic(plant, law, settings) is not None:
            note, cures = f'{note}; q_filter = "auto" and shift = "auto" prevent it', (dict(AUTOMATIC),)
    else:
        weight = _calmer(plant, law, settings, q_filter)
        if weight is not None:
            note, cures = f"{note}; change_weight = {weight:g} prevents it", ({"change_weight": weight},)
    return [*notes, Remark(note, cures)]


def _calmer(
    plant: UncertainPlant, law: Gains | ObserverGains, settings: TrialSettings, q_filter: Filter | None
) -> float | None:
    """A weight of the change with which no error grows from trial to trial; None if none is."""
    nominal = law.closed(plant.exact_nominal or plant.nominal, plant.C)
    shift = _shift(plant, settings)
    for n in range(1, WEIGHT_DECADES):
        weight = float(f"{settings.change_weight * 10.0**n:.3g}")
        matrix = norm_optimal(nominal, settings.samples, weight)
        update = Update(shift, 0.0, weight, nominal, matrix)
        certificate = certify(plant, law, update, q_filter, settings.filter_acts_on, settings.samples)
        judged = certificate.deciding
        if judged.learning is not None and judged.learning.monotone:
            return weight
    return None


def _factor(value: float) -> str:
    """Text of a factor above one, with enough digits that it isn't rounded to one."""
    return f"1 + {value - 1:.1e}" if value - 1 < 1e-4 else f"{value:.7g}"


def _check(plant: UncertainPlant, settings: TrialSettings) -> None:
    n, r = plant.order, plant.relative_degree
    if isinstance(settings.shift, int) and settings.shift < r:
        raise DesignError(f"shift: {settings.shift}: expected {r}, the relative degree, or more")
    if isinstance(settings.shift, int) and settings.samples <= settings.shift:
        expected = f"expected less than the {settings.samples} samples"
        raise DesignError(f"shift: {settings.shift}: {expected}")
    if settings.samples <= r:
        raise DesignError(
            f"samples: {settings.samples}: expected a trial longer than the relative degree, {r}"
        )
    Q = np.asarray(settings.Q, dtype=float)
    if Q.shape not in ((n, n), (n + 1, n + 1)):
        shape = " x ".join(map(str, Q.shape))
        expected = " or ".join(f"{size} x {size}" for size in (n, n + 1))
        raise DesignError(f"state_weight: {shape}: expected {expected}")
    if settings.integral and settings.kind != "state" and len(Q) == n:
        raise DesignError(f"state_weight: expected {n + 1} x {n + 1}, with a weight for the integrator")
    for key, value in (("initial_state", settings.gamma), ("initial_change", settings.f)):
        if np.shape(value) != (len(Q),):
            raise DesignError(f"{key}: expected {len(Q)} numbers, as many as the state weight has rows")
    for key, number in (("N", settings.N), ("K_3", settings.K_3)):
        if number is not None and not np.isfinite(number):
            raise DesignError(f"{key}: expected a finite number")
    if not (np.isfinite(settings.change_weight) and settings.change_weight > 0):
        raise DesignError(f"change_weight: {settings.change_weight:g}: expected a number above zero")
    ends = 3 * (settings.filter_order + 1)
    if settings.cutoff is not None and settings.samples <= ends:
        raise DesignError(
            f"samples: {settings.samples}: expected more than {ends}, by which the filter extends the trial "
            "at each end"
        )
