"""Base of both kinds of study: the methods that callers use with any study, and the tables that all have.

Tables for `cogless calibrate`: parameters of a study to fit, and target values of metrics.

Tables `[vary]` and `[tune]`: how a study's values spread over an ensemble, and which gains to choose.

Units in which speeds and angles are shown: a user who wrote rpm in his study reads rpm.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from cogless import units
from cogless.study.laws.law import Base
from cogless.study.mechanics import Belt
from cogless.study.metric import Conditions, Metric
from cogless.study.table import Frequency, Key, Line, Many, Quantity, StudyKeys, Table, dotted_keys, invalid
from cogless.units import ANGLE, ANGULAR_SPEED, Dimension, UnitError, factor, unit_of


class FitParameter(Table):
    """A parameter to fit: a dotted key of the study, or of one scenario's overrides.

    Initial value and bounds are texts with a unit, or numbers in the unit that the study uses at this key.
    """

    key: str
    """Dotted key of the value to fit, such as `mechanics.inertia`."""
    scenario: str | None = None
    """Name of a scenario. The fitted value then applies only in this scenario, as an entry of its `override`.
    Default: the value applies in all scenarios."""
    initial: str | float | None = None
    """Value at which the fit starts. Default: the value in the study."""
    lower: str | float | None = None
    """Lower bound of the fitted value: a text with a unit, or a number in the unit of the value in the study.
    Default: no bound."""
    upper: str | float | None = None
    """Upper bound of the fitted value, written like `lower`. Default: no bound."""


class Target(Table):
    """The value that a metric should have in a run; a list for kind "order" and in studies of trials."""

    scenario: str
    """Scenario of the run whose metric should have the target value."""
    controller: str
    """Controller of the run whose metric should have the target value."""
    metric: str
    """Name of the metric that should have the target value."""
    value: Any
    """Target value of the metric, with a unit. For a metric of kind `order`: a list with one value for each
    order. In a study of trials: a list with one value for each trial; for the kinds `first-rms`, `final-rms`
    and `trials-to-floor`, one value for each phase (the trials from one of the `changes` to the next)."""
    weight: Annotated[float, Field(gt=0)] = 1.0
    """Factor by which the fit multiplies the relative deviation of the metric from `value`."""

    def values(self, metric: Metric, count: int) -> tuple[float, ...]:
        """The target values in SI. Refuses another number of values than `count`, and an invalid value."""
        targets = self.value if isinstance(self.value, list) else [self.value]
        if len(targets) != count:
            raise invalid(f"expected {count} values", "value")
        quantity = Quantity(metric.dimension, bare=not metric.dimension.unit)
        return tuple(quantity.read(value) for value in targets)


class Calibration(Table):
    """A fit of parameters by least squares of the relative deviations from the targets."""

    parameters: Many[FitParameter]
    """Values of the study that `cogless calibrate` fits."""
    targets: Many[Target]
    """Measured values that the metrics of the fitted study should have."""

    @field_validator("parameters", "targets")
    @classmethod
    def _some(cls, value: tuple[Any, ...]) -> tuple[Any, ...]:
        if not value:
            raise invalid("expected one or more")
        return value


SPREAD_FORMS = ("uniform", "log", "normal", "corners", "list")
Number = str | float | int  # a text with a unit or with %, or a plain number


class Distribution(Table):
    """How a value spreads: one of these forms.

    One number is a deviation from the study's own value, two are limits; each is a text with the key's unit,
    or with % of the study's value.
    """

    uniform: Number | Many[Number] | None = None
    """All values between two limits are equally likely. `"20 %"` or `"1 mH"`: the limits lie this far below
    and above the study's value. `["1 mH", "3 mH"]`: the limits. `["-10 %", "20 %"]`: the limits lie 10 %
    below and 20 % above the study's value."""
    log: Number | Many[Number] | None = None
    """The logarithm of the value is uniformly distributed between two limits. One number, such as `"50 %"`:
    the limits are the study's value divided by 1.5 and multiplied by 1.5. Two numbers: the limits."""
    normal: Number | Many[Number] | None = None
    """The value is normally distributed, cut off at three standard deviations. One number: the standard
    deviation; the mean is the study's value. Two numbers: mean and standard deviation."""
    corners: Number | Many[Number] | None = None
    """The value is one of two limits, both equally likely. The limits are written as for `uniform`. If
    several keys have `corners`, all combinations of their limits occur."""
    list: Many[Any] | None = None
    """The value is one of the listed values, all equally likely. A listed value is a number, a text, or
    whatever else the key takes."""

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if len([form for form in SPREAD_FORMS if getattr(self, form) is not None]) != 1:
            raise invalid(f'expected one of {", ".join(SPREAD_FORMS)}, such as uniform = "20 %"')
        form, value = self.form
        if isinstance(value, tuple) and form != "list" and len(value) != 2:
            raise invalid("expected one number or two numbers", form)
        if value == ():
            raise invalid("expected one or more", form)
        return self

    @property
    def form(self) -> tuple[str, Any]:
        """The form that is given, and its value."""
        name = next(form for form in SPREAD_FORMS if getattr(self, form) is not None)
        return name, getattr(self, name)


class Together(Table):
    """Keys whose values are correlated: the correlation of each pair, behind every distribution."""

    keys: Many[str]
    """Two or more keys of `[vary]` whose values are correlated."""
    correlation: Annotated[float, Field(ge=-1, le=1)]
    """Correlation of each pair of these keys. For $n$ keys it must be at least $-1/(n - 1)$. Each key keeps
    its own distribution. Exactly, this is the correlation of the normally distributed numbers from which the
    values are computed (Gaussian copula)."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if len(self.keys) < 2 or len(set(self.keys)) < len(self.keys):
            raise invalid("expected two or more different keys", "keys")
        least = -1 / (len(self.keys) - 1)
        if self.correlation < least:
            expected = (
                f"expected {least:.3g} or more: {len(self.keys)} values can't all have a "
                "lower correlation with each other"
            )
            raise invalid(expected, "correlation")
        return self


class Vary(Table):
    """How an ensemble spreads around the study: a distribution for each dotted key."""

    keys: dict[str, Distribution] = Field(default={})
    """Distribution of each [dotted key](/guide/study-file.md#rules) that varies. Write the dotted keys
    directly into `[vary]`, without the word `keys`: `mechanics.inertia = { uniform = "20 %" }`."""
    together: Many[Together] = ()
    """Groups of keys whose values are correlated. Default: all keys vary independently."""
    seeds: bool = False
    """True: each variant has other random numbers, for example its own sensor noise. False: all variants have
    the study's `seed`."""

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        own = {key: data[key] for key in ("together", "seeds") if key in data}
        return {"keys": _flat({key: data[key] for key in data if key not in own}), **own}

    @model_validator(mode="after")
    def _check_groups(self) -> Self:
        taken: set[str] = set()
        for index, group in enumerate(self.together):
            for place, key in enumerate(group.keys):
                if key not in self.keys:
                    raise invalid(f"expected one of {', '.join(self.keys)}", "together", index, "keys", place)
                if key in taken:
                    expected = "expected a key that is in no other group of vary.together"
                    raise invalid(expected, "together", index, "keys", place)
                taken.add(key)
        if not self.keys and not self.seeds:
            raise invalid("expected one or more keys that vary, or seeds = true", "keys", value="missing")
        return self


class Hold(Table):
    """What must hold of the tuned controllers: a metric's limit, in at least this share of the variants."""

    metric: str
    """Name of the metric that has a limit. For a metric of kind `order` add the order: `NAME.72` is order
    72."""
    limit: Number
    """Limit of this metric, with a unit: the largest allowed value, or the smallest one if higher values of
    the metric are better."""
    share: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the variants in which a tuned controller must keep the limit of the metric."""


class Tune(Table):
    """Gains to choose for each controller by itself, and what is best, over the ensemble or the study."""

    keys: dict[str, Many[Number]]
    """For each dotted key to tune, the lower and the upper limit of the search, with a unit. A limit in % is
    a deviation from the study's value: `["-50 %", "100 %"]`. The search begins at the study's value, which
    must lie between the limits."""
    minimise: str
    """Name of the metric to minimise. If higher values of this metric are better, it is maximised. For a
    metric of kind `order` add the order: `NAME.72` is order 72."""
    over: Literal["mean", "worst", "nominal"] | Annotated[float, Field(gt=0, lt=1)] = "mean"
    """Which value of the metric is minimised. `mean` or `worst`: the mean or the worst value of all variants
    in the ensemble. A share such as 0.9: the value that 90 % of the variants reach or improve on. `nominal`:
    the value of the study itself, without an ensemble."""
    hold: Many[Hold] = ()
    """Limits of metrics that each tuned controller must keep. Default: no limits."""
    scenarios: Many[str] | None = None
    """Scenarios in which the metrics are computed for tuning. Default: all scenarios in which the tuned
    controller runs."""
    variants: Annotated[int, Field(ge=1)] = 32
    """Number of random variants of the study ([ensemble](/guide/ensembles.md)) on which each set of gains is
    tried."""
    budget: Annotated[int, Field(ge=2)] = 200
    """Number of sets of gains that are tried for each controller."""

    @field_validator("keys", mode="before")
    @classmethod
    def _dotted(cls, keys: Any) -> Any:
        return _flat(keys)

    @field_validator("keys")
    @classmethod
    def _ranges(cls, keys: dict[str, tuple[Number, ...]]) -> dict[str, tuple[Number, ...]]:
        for key, limits in keys.items():
            if len(limits) != 2:
                raise invalid("expected two limits", key)
        if not keys:
            raise invalid("expected one or more")
        return keys


def _flat(keys: Any) -> Any:
    """Distributions or ranges by dotted key; a value that isn't a table is returned unchanged."""
    return dotted_keys(keys, _holds_more) if isinstance(keys, dict) else keys


def _holds_more(_key: str, value: Any) -> bool:
    """Whether a value is a table of distributions or ranges, and not itself a distribution."""
    return (
        isinstance(value, dict)
        and all(isinstance(inner, dict | list) for inner in value.values())
        and not any(form in value for form in SPREAD_FORMS)
    )


K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


class Assumption(Table):
    """Something that the study's author had to assume, and the reason."""

    about: str
    """What the assumption is about: a key of the study, or a phrase."""
    reason: str
    """Why the author of the study made this assumption."""


@dataclass(frozen=True)
class Source:
    """Source of a study: path of the file, tables as read (values as texts with units), datasheet path.

    `directory`: absolute folder of the file, since a law may change the process's working directory.
    `changes`: the keys that `--set` changed, or in a scenario's own tables the keys of its override.
    """

    path: Path
    tables: dict[str, Any]
    datasheet: Path | None = None
    own_motor_keys: frozenset[str] = frozenset()  # keys of [motor] set in the study, not by the datasheet
    directory: Path | None = None
    changes: frozenset[Key] = frozenset()

    @property
    def folder(self) -> Path:
        """The folder to which paths in the study are relative."""
        return self.directory or self.path.parent


class TraceSettings(Table):
    """Settings of the trace, the signals recorded in a run."""

    rate: Frequency | None = None  # Hz
    """Number of rows of the trace per second. It must be the rate of the current loop divided by a whole
    number. With a switched inverter, in a study without trials, it may also be [a multiple of this
    rate](/theory/inverter.md#between-samples). Default: the rate of the current loop; in a study of trials,
    one row per sample. A row takes 8 bytes for each of about 20 signals: 10 min at 1 kHz take 100 MB."""
    file_rate: Frequency = 1000.0  # Hz
    """Largest number of rows per second that are written to `traces.nc`. A study of trials writes all rows of
    its trace."""
    energy: bool = False
    """True: the trace also contains the [energies](/theory/plant.md#energy) that the inverter delivers, that
    copper, friction and load take, and that the motor stores."""


Kind = Literal["speed", "trials"]  # keys of the tables PLANS, DESIGNS, SECTIONS and PAGES


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Duration and rates of a run in ticks. A tick is a current-loop period or a linear plant's sample."""

    ticks: int
    rate: float  # ticks per second
    divider: int  # ticks per sample of the law
    decimation: int  # ticks per row of the trace
    rows_per_period: int = 1  # rows of the trace per tick, where there are several


class StudyBase(Table):
    """Tables that speed studies and studies of trials have in common, and what each kind answers for itself.

    A kind implements the abstract methods. A room that treats the kinds differently has a table by `kind`.
    """

    kind: ClassVar[Kind]
    outer_loop: ClassVar[str]  # the key of drive.rates that the kind needs
    overridable: ClassVar[tuple[str, ...]]  # tables whose keys a scenario may override
    signal_kinds: ClassVar[frozenset[str]] = frozenset()  # signals.def's properties that all runs have

    title: Line
    """Title of the study and of its report, in one line."""
    seed: Annotated[int, Field(ge=0, lt=2**64)] = 0
    """Seed of all random numbers: sensor noise, bus jitter, and deviations from trial to trial."""
    description: str = ""
    """Text that the report shows below the study's title."""
    assumption: Many[Assumption] = ()
    """Assumptions that the author of the study had to make. The report lists them."""
    trace: TraceSettings = TraceSettings()
    """Which rows and signals of each run are recorded (the trace)."""
    scenario: Mapping[str, Any]
    controller: Mapping[str, Base]
    metric: Many[Metric] = ()
    """Metrics that are computed from each run, each in a table `[[metric]]`."""
    calibration: Calibration | None = None
    """Values that [`cogless calibrate`](/guide/calibrate.md) fits, and the measured values of the metrics."""
    vary: Annotated[Vary, StudyKeys()] | None = None
    """Keys whose values vary in an [ensemble](/guide/ensembles.md), and the distributions of these values."""
    tune: Tune | None = None
    """Gains that [`cogless tune`](/guide/ensembles.md#tune) chooses, and the metric that it minimises."""
    _source: Source = PrivateAttr()
    _made: dict[Hashable, Any] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _consistent(self, info: ValidationInfo) -> Self:
        """Run the checks that concern several tables; the module `reading` passes them in the context."""
        for check in info.context["checks"] if info.context else ():
            check(self)
        return self

    @property
    def source(self) -> Source:
        """The file and the tables that this study was read from."""
        assert self.__pydantic_private__ is not None  # self._source would take ten times as long
        source: Source = self.__pydantic_private__["_source"]
        return source

    def once(self, make: Callable[[Self, K], T], of: K) -> T:
        """Return make(self, of). The first call computes the value and keeps it, since this takes long."""
        key = (make, of)
        if key not in self._made:
            self._made[key] = make(self, of)
        value: T = self._made[key]
        return value

    def take(self, make: Callable[[Self, K], T], of: K, like: Self) -> None:
        """Let `once` return the value of the study `like` here. Both studies must have the same value."""
        self._made[make, of] = like.once(make, of)

    @property
    def name(self) -> str:
        """The file's name without suffix."""
        return self._source.path.stem

    @property
    def baseline(self) -> str:
        """Name of the baseline controller: ratios in tables are relative to its values."""
        marked = [name for name, controller in self.controller.items() if controller.baseline]
        return marked[0] if marked else next(iter(self.controller))

    def label(self, controller: str) -> str:
        """Name of a controller as shown in tables and report."""
        return self.controller[controller].label or controller

    def controllers_in(self, scenario: str) -> tuple[str, ...]:
        """Names of the controllers that run in a scenario."""
        chosen = self.scenario[scenario].controllers
        return tuple(self.controller) if chosen is None else tuple(chosen)

    def scenarios_of(self, controller: str) -> list[str]:
        """Names of the scenarios that a controller runs in."""
        return [name for name in self.scenario if controller in self.controllers_in(name)]

    def metrics_in(self, scenario: str) -> tuple[Metric, ...]:
        """The metrics that are evaluated in a scenario."""
        return tuple(m for m in self.metric if m.applies_in(scenario, self.scenario[scenario]))

    @property
    def rows_per_period(self) -> int:
        """Rows of the trace per period of the current loop; also 1 if a row is for several periods."""
        return 1

    @property
    @abstractmethod
    def precision(self) -> str:
        """The precision of the control laws: "single" or "double"."""

    @property
    @abstractmethod
    def file_rate(self) -> float:
        """Rows per second of traces.nc at most, Hz."""

    @property
    @abstractmethod
    def own_signals(self) -> dict[str, Dimension] | None:
        """All signals of a linear plant; None for a drive, whose signals are in signals.def."""

    @property
    @abstractmethod
    def example_metric(self) -> dict[str, str]:
        """A metric that suits any study of the kind."""

    @abstractmethod
    def timing(self, scenario: str) -> Timing:
        """Number of ticks in a run, ticks per second, per sample of the law and per trace row."""

    @abstractmethod
    def when(self, scenario: str, tick: int) -> str:
        """The time of a tick, or the trial of a tick, as text that continues a message."""

    @abstractmethod
    def conditions(self, scenario: str) -> Conditions:
        """Data of a scenario that metrics need besides a trace."""

    def belt(self, scenario: str) -> Belt | None:
        """The belt that pulls a carriage in a scenario; None without a belt, and in a study of trials."""
        return None

    @abstractmethod
    def values_of(self, metric: Metric, scenario: str) -> int:
        """Number of values of a metric: one, one per order, per phase or per trial."""

    @abstractmethod
    def columns_of(self, metric: Metric) -> list[tuple[int | None, str]]:
        """Index and name of each value of a metric, for a table of many runs; index None: the last value."""

    @abstractmethod
    def scenario_facts(self, scenarios: Iterable[str]) -> dict[str, Any]:
        """Entries of results.json about scenarios, in addition to the runs."""


SPOKEN = (ANGULAR_SPEED, ANGLE)
UNIT_TABLES = ("scenario", "drive")  # tables whose units describe a run, unlike a motor's or a controller's


def spoken_unit(study: StudyBase, dimension: Dimension) -> str:
    """Unit in which to show a quantity: an angle or a speed as in the study, others in SI.

    For an angle or a speed it is the unit of the first metric of this dimension, else of the first such
    quantity in the scenarios or the drive, else the SI unit.
    """
    if dimension not in SPOKEN:
        return dimension.unit
    metrics = (m.unit for m in study.metric if m.unit and m.dimension == dimension)
    texts = (unit_of(text) for room in UNIT_TABLES for text in _texts(study.source.tables.get(room)))
    return next(metrics, None) or next((u for u in texts if u and _fits(u, dimension)), dimension.unit)


def speed_text(study: StudyBase, omega_m: float, digits: int = 4) -> str:
    """Magnitude of a speed as a text, in the unit that the study uses. `omega_m`: in rad/s."""
    unit = spoken_unit(study, ANGULAR_SPEED)
    rounded = float(f"{units.convert(abs(omega_m), unit, ANGULAR_SPEED):.{digits}g}")
    return f"{rounded:g} {unit}"  # with one digit: 200 rpm, and not 2e+02


def _texts(value: Any) -> Iterator[str]:
    """Every string in a table, including the tables and lists within it."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list | tuple):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _texts(inner)


def _fits(unit: str, dimension: Dimension) -> bool:
    try:
        return bool(factor(unit, dimension))
    except UnitError:
        return False
