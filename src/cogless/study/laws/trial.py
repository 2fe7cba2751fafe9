"""Controllers of a study of trials, one class per `law`, and the settings for their design."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, Self

from pydantic import Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from cogless import units
from cogless.study.laws.law import Base
from cogless.study.laws.own import LibraryLaw, PythonLaw
from cogless.study.table import LawFrequency, Many, Quantity, Table, invalid

if TYPE_CHECKING:
    import numpy as np

Ends = Literal["even", "odd"]
Weight = Many[float] | Many[Many[float]]


class SignalFilter(Table):
    """A Butterworth low-pass, run forwards and backwards after each trial, so that it has no phase shift."""

    cutoff: LawFrequency  # Hz
    """Frequency at which the forward and the backward pass of the filter together have the gain one half. It
    must be below half the sampling rate."""
    order: Annotated[int, Field(ge=1, le=4)] = 2
    """Order of the Butterworth filter, which runs once in each direction."""
    ends: Ends = "even"
    """How the filter continues the signal beyond both ends of the trial. `even`: mirrored in time; the filter
    then never raises the RMS of the signal. `odd`, as in SciPy's filtfilt: also mirrored about the value at
    the end. This keeps a slope at the ends, but amplifies noise there."""


class QFilter(SignalFilter):
    """The filter of a law that learns with a single gain."""

    acts_on: Literal["error", "signal"] = "error"
    """Signal that is filtered between two trials. `error`: the error, before the law learns from it.
    `signal`: the whole learned signal."""


class StudyOfTrials(Protocol):
    """The parts of a study that the checks of a law of trials use."""

    @property
    def period(self) -> float: ...
    @property
    def states(self) -> int: ...
    @property
    def design(self) -> DesignSettings: ...


class TrialLaw(Base):
    """The keys that every law of trials has."""

    learned_limit: Annotated[float, Field(gt=0, le=1e12)] = 1e6
    """Largest magnitude of the learned signal $v$. In `state-ilc` and `observer-ilc`, $v$ has the unit of the
    plant's input; in `trial-ilc` and `norm-optimal`, that of the reference."""
    basis_functions: bool = False
    """True: if the reference changes, the learned signal [changes with
    it](/guide/trial-studies.md#a-motion-that-changes)."""
    guard: bool = True
    """True: [the guard](/laws/trial.md#the-guard) takes back learning that leaves more error than the
    feedback alone."""

    of_trials: ClassVar[bool] = True
    # design settings that the law has under another name: setting -> key of the law
    DESIGN_KEYS: ClassVar[dict[str, str]] = {"static_gain": "N"}

    @property
    def design_settings(self) -> dict[str, Any]:
        """Settings of the law's design that aren't given by a key of the same name."""
        return {}

    def check_trials(self, study: StudyOfTrials, name: str) -> None:
        """Refuse keys that do not suit the study, in which the law is the controller `name`."""

    @property
    def row(self) -> str:
        return "trial"

    @property
    def learns_from_trials(self) -> bool:
        return bool(getattr(self, "learning", True))


class FilteredLaw(TrialLaw):
    """A law of trials that learns with a single gain, and may have a Q filter."""

    TRIAL_FEEDBACK: ClassVar[str] = "K_s"
    SHIFTS_ON_PAGE: ClassVar[bool] = False  # whether a live page has a slider for `shift`

    q_filter: QFilter | Literal["auto", "none"] | None = None
    """Filter that acts between two trials. `"auto"`: [the design
    chooses](/theory/trial-design.md#shift-and-filter-together) the filter. `"none"`: no filter. Default of
    `trial-ilc`: `"auto"`; but no filter if you give a number for `shift`, or `K_3` without `shift`. Default
    of `state-ilc`: no filter."""
    shift: Annotated[int, Field(ge=1, le=65_534)] | Literal["auto"] | None = None
    """Number of samples by which the error lies after the learned signal $v$ that it corrects: sample $p$ of
    $v$ learns from the error at $p$ + `shift`. A loop with more lag needs a larger shift. Default: `"auto"`
    if the filter is `"auto"`, otherwise [the relative degree](/theory/trial-design.md)."""

    @property
    def choice(self) -> tuple[QFilter | Literal["auto"] | None, int | Literal["auto"] | None]:
        """Filter and shift; "auto": the design chooses; None: no filter, and the relative degree as shift."""
        return None if self.q_filter == "none" else self.q_filter, self.shift

    @property
    def design_settings(self) -> dict[str, Any]:
        q, shift = self.choice
        if isinstance(q, QFilter):
            return {"shift": shift, **_filter_settings(q), "filtered": q.acts_on}
        return {"shift": shift} if q is None else {"shift": shift, "cutoff": q}

    def check_trials(self, study: StudyOfTrials, name: str) -> None:
        if isinstance(self.q_filter, QFilter):
            _check_cutoff(study, self.q_filter.cutoff, name, "q_filter")


class TrialIlc(FilteredLaw):
    """State feedback with integral action, feedforward and trial-to-trial learning (Mandra 2019, Fig. 1)."""

    TRIAL_GAIN: ClassVar[str] = "K_3"
    SHIFTS_ON_PAGE: ClassVar[bool] = True

    law: Literal["trial-ilc"]
    """State feedback with integral action, feedforward and learning from trial to trial."""
    acts_on: Literal["input-and-integrator", "input"] = "input-and-integrator"
    """Where the learned signal $v$ is added. `"input-and-integrator"`: to the input and to the integrator of
    the feedback. `"input"`: only to the input; the integrator then [works against what is
    learned](/studies/mandra2019.md#why-the-simplified-structure-is-slow)."""
    integral: bool = True
    """True: the feedback has an integrator of the error."""
    learning: bool = True
    """True: the law learns. False: the learned signal $v$ remains zero."""
    feedforward: bool = True
    """True: the law has a [dynamic feedforward](/theory/trial-design.md#feedforward) of the reference."""
    K_s: Many[float] | None = None
    """Gains of the state feedback: one for each state, then one for the integrator. `cogless design`
    certifies given gains. Default: the design computes the gains."""
    N: float | None = None
    """[Gain](/theory/trial-design.md#feedforward) from the learned signal to the input. Default: the design
    computes it."""
    K_3: float | None = None
    """Learning gain. Default: the design computes it. If `shift` or `q_filter` is `"auto"`, the design
    chooses them for the gain that it computes, even if you give another `K_3`."""

    @property
    def choice(self) -> tuple[QFilter | Literal["auto"] | None, int | Literal["auto"] | None]:
        """Filter and shift as of FilteredLaw, but "auto" without a given `q_filter`, `shift` and `K_3`.

        If one of them is "auto", the other is also "auto" unless it is given.
        """
        q_filter, shift = super().choice
        silent = self.q_filter is None and shift is None and self.K_3 is None
        if self.q_filter is None and (silent or shift == "auto"):
            q_filter = "auto"
        if shift is None and q_filter == "auto":
            shift = "auto"
        return q_filter, shift

    @property
    def design_settings(self) -> dict[str, Any]:
        return {"structure": self.acts_on, **super().design_settings}

    def check_trials(self, study: StudyOfTrials, name: str) -> None:
        _check_state_gains(study, self, name)
        super().check_trials(study, name)


class StateIlc(FilteredLaw):
    """The older law (3) of Mandra 2019: it corrects the last trial's input, and has no feedforward."""

    TRIAL_GAIN: ClassVar[str] = "K_ilc"
    TRIAL_FEEDBACK: ClassVar[str] = "K_stab"
    DESIGN_KEYS: ClassVar[dict[str, str]] = {"K_s": "K_stab", "K_3": "K_ilc"}

    law: Literal["state-ilc"]
    """State feedback and learning from trial to trial, without integral action and feedforward: [the older
    law (3)](/theory/trial-design.md#the-older-law-3) of Mandra 2019."""
    K_stab: Many[float] | None = None
    """Gains of the state feedback, one for each state. Default: the design computes them."""
    K_ilc: float | None = None
    """Learning gain. Default: the design computes it."""

    @property
    def design_settings(self) -> dict[str, Any]:
        # the prediction for this law takes no account of `basis_functions`
        parts = {"structure": "input", "integral": False, "feedforward": False, "basis_functions": False}
        return {"kind": "state", **parts, "K_s": self.K_stab, "K_3": self.K_ilc, **super().design_settings}

    def check_trials(self, study: StudyOfTrials, name: str) -> None:
        n = study.states
        if self.K_stab is not None and len(self.K_stab) != n:
            raise invalid(f"expected {n} numbers, one for each state", "controller", name, "K_stab")
        super().check_trials(study, name)


class NormOptimalIlc(TrialLaw):
    """Learning by a whole matrix from the error over a trial, optimal for the nominal plant."""

    BY_MATRIX: ClassVar[bool] = True
    NOT_ON_PAGE: ClassVar[str] = (
        "its learning matrix, with one number for each pair of samples, is too large for a page"
    )

    law: Literal["norm-optimal"]
    """Norm-optimal learning: a matrix computes the correction from the error of the whole trial."""
    acts_on: Literal["input-and-integrator", "input"] = "input-and-integrator"
    """Where the learned signal $v$ is added. `"input-and-integrator"`: to the input and to the integrator of
    the feedback. `"input"`: only to the input."""
    integral: bool = True
    """True: the feedback has an integrator of the error."""
    feedforward: bool = True
    """True: the law has a [dynamic feedforward](/theory/trial-design.md#feedforward) of the reference."""
    K_s: Many[float] | None = None
    """Gains of the state feedback: one for each state, then one for the integrator. Default: the design
    computes them."""
    N: float | None = None
    """[Gain](/theory/trial-design.md#feedforward) from the learned signal to the input. Default: the design
    computes it."""
    q_filter: SignalFilter | None = (
        None  # on the learned signal: a weight of the signal itself over frequency
    )
    r"""Filter $Q$ on the learned signal $v$, so that $v \leftarrow Q\,(v + L e)$ with the error $e$ and the
    learning matrix $L$. Above its cut-off, the law forgets what it has learned
    ([why](/theory/trial-design.md#a-weight-of-the-signal-itself)). Default: no filter."""
    change_weight: Annotated[float, Field(gt=0)] = 0.01
    """Weight of the change of the learned signal $v$ from trial to trial, relative to the weight of the
    error. With a larger weight the law learns more slowly and tolerates a worse model."""

    @property
    def design_settings(self) -> dict[str, Any]:
        own = {} if self.q_filter is None else {**_filter_settings(self.q_filter), "filtered": "signal"}
        return {"kind": "norm-optimal", "structure": self.acts_on, **own}

    def check_trials(self, study: StudyOfTrials, name: str) -> None:
        _check_state_gains(study, self, name)
        if self.q_filter is not None:
            _check_cutoff(study, self.q_filter.cutoff, name, "q_filter")


class ObserverIlc(TrialLaw):
    """Feedback from an observed error, and learning of the input that was missing; all gains by a rule."""

    law: Literal["observer-ilc"]
    """Feedback from [an observer, and learning of the missing
    input](/laws/trial.md#learning-the-missing-input)."""
    learning: bool = True
    """True: the law learns. False: the learned signal $v$ remains zero."""
    feedforward: bool = True
    """True: the law adds the input that the nominal plant needs to follow the reference."""
    pole: Annotated[float, Field(ge=0.0, lt=1.0)] | None = (
        None  # of observer and feedback; default: by the rule
    )
    """Pole of observer and feedback, from 0 to below 1; a smaller pole is faster. Default: [a
    rule](/theory/trial-design.md#learning-the-missing-input) computes it."""
    cutoff: LawFrequency | None = None
    """Cut-off frequency of the filter on the learned signal $v$. Default: [a
    rule](/theory/trial-design.md#learning-the-missing-input) computes it."""
    ends: Ends = "even"
    """How the filter continues the learned signal beyond both ends of the trial. `even`: mirrored in time;
    the filter then never raises the RMS of the signal. `odd`, as in SciPy's filtfilt: also mirrored about the
    value at the end. This keeps a slope at the ends, but amplifies noise there."""

    TRIAL_RULE_KEYS: ClassVar[tuple[str, ...]] = ("cutoff", "pole")

    @property
    def design_settings(self) -> dict[str, Any]:
        return {"kind": "observer", "structure": "input", "integral": False, "filtered": "signal"}

    def check_trials(self, study: StudyOfTrials, name: str) -> None:
        if self.cutoff is not None:
            _check_cutoff(study, self.cutoff, name)


def _filter_settings(q: SignalFilter) -> dict[str, Any]:
    return {"cutoff": q.cutoff, "filter_order": q.order, "ends": q.ends}


def _check_cutoff(study: StudyOfTrials, cutoff: float, *path: str) -> None:
    if cutoff >= 0.5 / study.period:
        expected = f"expected less than half the sampling rate, {0.5 / study.period:g} Hz"
        raise invalid(expected, "controller", *path, "cutoff")


def _check_state_gains(study: StudyOfTrials, law: TrialIlc | NormOptimalIlc, name: str) -> None:
    """Refuse a number of gains, or else of state weights, that doesn't suit states and integrator."""
    n = study.states
    whole = f"expected {n + 1} numbers: one for each state, and one for the integrator"
    if law.K_s is not None and len(law.K_s) not in ((n + 1,) if law.integral else (n, n + 1)):
        raise invalid(whole, "controller", name, "K_s")
    if law.K_s is None and law.integral and len(study.design.state_weight) == n:
        raise invalid(f'{whole} of controller "{name}"', "design", "state_weight")


AnyTrialController = TrialIlc | StateIlc | NormOptimalIlc | ObserverIlc | PythonLaw | LibraryLaw
TrialController = Annotated[AnyTrialController, Field(discriminator="law")]


# Parameters of a drive for which `design.range` may give a range.
UNCERTAIN = {
    "mechanics.inertia": Quantity(units.INERTIA, ">"),
    "mechanics.viscous_friction": Quantity(units.VISCOUS_FRICTION, ">="),
    "motor.K_t": Quantity(units.TORQUE_CONSTANT, ">"),
}


class DesignSettings(Table):
    """Settings of the design by LMIs: weights, initial conditions, ranges of a drive's parameters."""

    discretisation: Literal["euler", "exact"] | None = None
    """How the design converts continuous models to sampled ones. `exact`: with a zero-order hold. `euler`: by
    Euler's method. Default ([why](/theory/trial-design.md#the-plant-as-a-polytope)): `euler` for the
    inequalities that give the gains, `exact` for the feedforward."""
    sensor: bool = True
    """True: what `cogless design` proves and predicts takes the real sensor into account: its latency, speed
    method and steps, and the delay of a bus ([how](/theory/trial-design.md#the-sensor)). So does the rule of
    `observer-ilc`. False: all this assumes an ideal sensor, but the predicted errors still include the
    steps."""
    state_weight: Weight
    """Weight $Q$ of [the cost (8)](/theory/trial-design.md#state-feedback-with-a-guaranteed-cost), a positive
    definite matrix, given by its diagonal or by its rows. The last entry is for the integrator. Without this
    entry, every `trial-ilc` and `norm-optimal` must have `integral = false`."""
    input_weight: Annotated[float, Field(gt=0)]
    """Weight $R$ of the input in [the cost
    (8)](/theory/trial-design.md#state-feedback-with-a-guaranteed-cost)."""
    initial_state: Many[float]
    r"""State $\gamma$ from which a trial starts in [the
    cost](/theory/trial-design.md#state-feedback-with-a-guaranteed-cost) that the design minimises: one number
    for each state, and one for the integrator if `state_weight` has it."""
    initial_change: Many[float] | None = None
    """Difference between the initial states of two successive trials, $f$ in (31) of Mandra 2019: as many
    numbers as in `initial_state`. The design chooses [the learning
    gain](/theory/trial-design.md#learning-as-a-repetitive-process) $K_3$ that bounds the error best with this
    difference. Default: the value of `initial_state`. Give zeros if all trials start alike, even with an
    offset: $K_3$ then has the smallest [factor per trial](/theory/trial-design.md#the-certificate) at the
    worst frequency."""
    initial_error: Annotated[float, Field(gt=0)] = 0.1
    """Error of the first trial, for which the design chooses [the learning
    gain](/theory/trial-design.md#learning-as-a-repetitive-process) $K_3$: the number $g$ of (31) in Mandra
    2019."""
    range: dict[str, tuple[float, float]] = Field(default={})  # of a drive's parameters, as in UNCERTAIN
    """Ranges of the drive's uncertain parameters, `[smallest, largest]` by dotted key. Possible keys are
    `"mechanics.inertia"`, `"mechanics.viscous_friction"` and `"motor.K_t"`."""

    @field_validator("range", mode="before")
    @classmethod
    def _ranges(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        return {key: _range(key, ends) for key, ends in data.items()}

    @property
    def Q(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """The state weight as a matrix."""
        import numpy as np

        weight = np.asarray(self.state_weight, dtype=float)
        return np.diag(weight) if weight.ndim == 1 else weight

    @model_validator(mode="after")
    def _sizes(self) -> Self:
        import numpy as np

        rows = [row for row in self.state_weight if isinstance(row, tuple)]
        if rows and (len(rows) != len(self.state_weight) or any(len(r) != len(rows) for r in rows)):
            raise invalid("expected the diagonal, or as many rows as columns", "state_weight")
        size = len(self.state_weight)
        for key in ("initial_state", "initial_change"):
            start = getattr(self, key)
            if start is not None and len(start) != size:
                raise invalid(f"expected {size} numbers, as many as state_weight has rows", key)
        if not any(self.initial_state):
            raise invalid("expected a number other than zero", "initial_state")
        Q = self.Q
        if not np.allclose(Q, Q.T, rtol=1e-9) or np.linalg.eigvalsh(Q)[0] <= 0:
            raise invalid("expected a positive definite weight", "state_weight")
        return self


def _range(key: str, ends: Any) -> tuple[float, ...]:
    if key not in UNCERTAIN:
        raise invalid(f"expected one of {', '.join(UNCERTAIN)}", key)
    if not isinstance(ends, list) or len(ends) != 2:
        raise invalid("expected the smallest and the largest value", key)
    values = []
    for index, end in enumerate(ends):
        try:
            values.append(UNCERTAIN[key].read(end))
        except PydanticCustomError as error:
            raise invalid(error.message(), key, index) from None
    if values[1] < values[0]:
        raise invalid("expected a range from the smallest to the largest value", key)
    return tuple(values)
