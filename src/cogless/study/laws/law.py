"""Keys that laws share: tuning, the loop around a law, learning, and the map that a law starts from.

A controller of a study is a table whose key `law` names the control law.

A law that learns over the angle can start from a map that was learned before, or from a table.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, Self, get_args

from pydantic import (
    Field,
    PrivateAttr,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_validator,
)

from cogless import units
from cogless.control_library import C_LAWS
from cogless.study.csv_table import OverAngle, read
from cogless.study.table import (
    CurrentBound,
    FileName,
    LawSpeed,
    Line,
    PhaseMargin,
    Quantity,
    RateGain,
    SpeedGain,
    SpeedIntegralGain,
    StartTime,
    Table,
    check_one,
    check_sizes,
    excluded,
    invalid,
)
from cogless.units import TURN

if TYPE_CHECKING:
    from cogless.study.drive import Drive
    from cogless.study.motor import AnyMotor
    from cogless.study.scenario import Scenario

TABLE_COLUMNS = {"current": units.CURRENT, "torque": units.TORQUE}
StartFile = Annotated[Line, FileName(), Field(min_length=1)]  # relative to the study


class Start(Table):
    """A stored map, or a table of current or torque over a revolution as CSV."""

    # in the format of control/SPEC.md, as `cogless run` writes and firmware saves
    map: StartFile | None = None
    """File of [a stored map](/guide/stored-maps.md#start-a-run-from-a-map) from which the law starts; the
    path is relative to the study. Give `map` or `table`."""
    table: StartFile | None = None
    """CSV file of a current or torque over the rotor's angle, [with units in its first
    line](/guide/stored-maps.md#a-foreign-table), from which the law starts. The path is relative to the
    study. Give `map` or `table`."""
    frame: Literal["mechanical", "electrical"] = "mechanical"
    """Whether the angle in the file of `table` is mechanical or electrical."""
    sign: Literal["holding", "cogging"] | None = None
    """Meaning of the values in the file of `table`. `"holding"`: current or torque that holds the rotor
    against the motor's own torque. `"cogging"`: the motor's own torque. Required with `table`."""
    _over_angle: OverAngle | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        check_one(self, ("map", "table"), 'expected either map = "FILE.bin" or table = "FILE.csv"')
        if self.table is not None and self.sign is None:
            meaning = (
                '"holding" for values that hold the rotor against the motor\'s own torque, "cogging" for '
                "that torque itself"
            )
            raise invalid(f"expected {meaning}", "sign", value="missing")
        for key in ("frame", "sign"):
            if self.map is not None and key in self.model_fields_set:
                raise excluded(key, "map", "the stored map contains it", "give table in place of map")
        return self

    @model_validator(mode="after")
    def _readable(self, info: ValidationInfo) -> Self:
        # pydantic calls this again if a changed study takes over the validated table
        if self.table is not None and info.context and self._over_angle is None:
            self._over_angle = read(info.context["folder"] / self.table, TABLE_COLUMNS, "table")
        return self

    @property
    def over_angle(self) -> OverAngle:
        """The table as read: a current, A, or a torque, N*m."""
        assert self._over_angle is not None
        return self._over_angle


class Tuning(Table):
    """A rule that computes the feedback's gains (cogless.design.speed_loop), and as auto all others too.

    cogless.design.auto describes auto; keys that the study gives stay as they are.
    """

    rule: Literal["phase-margin", "auto"]
    """`phase-margin`: [computes the gains of the feedback](/laws/pi.md#tuning-by-phase-margin) from the key
    `phase_margin`. `auto`: [computes all numbers of the law](/laws/auto.md) that the controller's table
    leaves out."""
    phase_margin: PhaseMargin = math.radians(45)  # rad
    """Phase margin of the feedback, from 20 to 80 deg (0.3 to 1.45 rad). The rule `phase-margin` requires
    this key; the rule `auto` takes 45 deg by default."""

    @property
    def is_auto(self) -> bool:
        """Whether the rule computes all of the law's numbers."""
        return self.rule == "auto"

    @field_validator("phase_margin", mode="wrap")
    @classmethod
    def _range(cls, value: Any, read: ValidatorFunctionWrapHandler) -> float:
        margin: float = read(value)
        low, high = 0.3, 1.45
        if not low < margin < high:
            bare = "" if isinstance(value, str) else "; a plain number is in rad"
            near = f', perhaps "{value:g} deg"' if bare and low < math.radians(value) < high else ""
            raise invalid(f'expected a phase margin from "20 deg" to "80 deg"{bare}{near}')
        return margin

    @model_validator(mode="after")
    def _check_tuning(self) -> Self:
        if not self.is_auto and "phase_margin" not in self.model_fields_set:
            raise invalid('expected a phase margin, such as "60 deg"', "phase_margin", value="missing")
        return self


@dataclass(frozen=True)
class LawLoop:
    """Data of the drive that a law's C configuration needs."""

    current_rate: int  # Hz, of the current loop
    divider: int  # current-loop periods per period of the law
    current_limit: float  # A
    pole_pairs: int

    @property
    def ts(self) -> float:
        """Period of the law, s."""
        return 1 / self.current_rate * self.divider

    def bounded(self, limit: float | None) -> float:
        """A law's own limit of a current, A, but at most the drive's limit; None: the drive's limit."""
        return self.current_limit if limit is None else min(limit, self.current_limit)

    def samples(self, time: float) -> int:
        """Convert a time in s to a number of periods of the law."""
        return round(time * (self.current_rate / self.divider))


class AutoTuning(Tuning):
    """The rule auto alone."""

    rule: Literal["auto"]
    """`auto`: [computes all numbers of the law](/laws/auto.md) that the controller's table leaves out."""


def unit_within(annotations: list[Any]) -> str:
    """The SI unit of the first quantity in a field's annotations; "" if there is none."""
    for entry in annotations:
        unit = entry.dimension.unit if isinstance(entry, Quantity) else unit_within(list(get_args(entry)))
        if unit or isinstance(entry, Quantity):
            return unit
    return ""


class StudyOfLaws(Protocol):
    """The parts of a speed study that the checks of a law use."""

    @property
    def motor(self) -> AnyMotor: ...
    @property
    def drive(self) -> Drive: ...
    @property
    def scenario(self) -> Mapping[str, Scenario]: ...
    def scenarios_of(self, controller: str) -> list[str]: ...


SETTLING_TURNS = 1 / 8  # revolutions that a commissioning run turns in each direction before it records


class Commissioning(Table):
    """The slow run, forwards and backwards, that fills an anti-cogging table."""

    speed: LawSpeed  # rad/s
    """Speed at which the rotor turns in the calibration run."""
    revolutions: Annotated[int, Field(ge=1, le=100)] = 1
    """Number of revolutions that the calibration run records in each direction."""
    position_gain: RateGain  # 1/s
    """Speed per angle error with which the rotor follows its reference angle in the calibration run."""

    @property
    def duration(self) -> float:
        """Duration of the commissioning run, s."""
        return 2 * (self.revolutions + SETTLING_TURNS) * TURN / self.speed


class Base(Table):
    """A controller: the keys that every law has.

    What differs between laws is asked here, and each answer has a default: that of a law which learns nothing
    and needs nothing. A law overrides what it does otherwise. What follows from a study's numbers is asked of
    the law's rules in the design (cogless.design.law_rules).
    """

    label: Line | None = None
    """Name of the controller in tables and report. Default: its name in the study."""
    baseline: bool = False
    """True: this controller is the baseline. Tables and report show the values of the other controllers as
    ratios to those of the baseline. Only one controller may be the baseline. Default: the first controller of
    the study."""

    if TYPE_CHECKING:
        law: str  # name of the law; each law declares this as its first own key

    # keys that the rule auto gives (cogless.design.auto), with placeholder values until the rule gives them
    AUTOMATIC: ClassVar[dict[str, Any]] = {}
    # keys of the learning gains: the larger a gain, the faster the law learns
    LEARNING_GAINS: ClassVar[tuple[str, ...]] = ()
    TRIAL_GAIN: ClassVar[str] = ""  # key of the single gain by which the law learns from trials
    TRIAL_FEEDBACK: ClassVar[str] = ""  # key of the feedback gains, for a law with such a single gain
    TRIAL_RULE_KEYS: ClassVar[tuple[str, ...]] = ()  # keys that a rule gives, for a law without a single gain
    BY_MATRIX: ClassVar[bool] = False  # whether it learns from trials by a matrix of all pairs of samples
    # text after "expected" in the error for a law that has no map to start from
    NEEDS: ClassVar[str] = "no start, since the memory is over time"
    NO_C_FORM: ClassVar[str] = ""  # why the law can't be exported as C; "": it can
    NO_DRIVE: ClassVar[bool] = False  # whether the exported C has no drive around the law
    NOT_ON_PAGE: ClassVar[str] = ""  # why a live page can't run the law; "": it can

    # whether this is a law of trials, whose study designs all of the law's numbers
    of_trials: ClassVar[bool] = False
    # whether the law may learn during a run, from the key `learning_start` on
    learns_while_running: ClassVar[bool] = False
    # whether the law learns functions of the angle, which hold at every speed
    learns_functions: ClassVar[bool] = False
    # whether the law has no feedback
    open_loop: ClassVar[bool] = False
    # whether the law learns all orders of the motor by itself
    learns_every_order: ClassVar[bool] = False

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        tuning = data.get("tuning") if isinstance(data, dict) else None
        is_auto = isinstance(tuning, dict) and tuning.get("rule") == "auto"
        return {**cls.AUTOMATIC, **data} if is_auto else data

    def c_config(self, loop: LawLoop) -> dict[str, Any]:
        """The members of the law's C configuration by name.

        The law's gains from a tuning rule and its default limits must be filled in already. Only laws of the
        control library have a C configuration.
        """
        raise NotImplementedError(self.law)

    def check(self, study: StudyOfLaws, name: str) -> None:
        """Refuse keys that do not suit the study, in which the law is the controller `name`.

        Also called for the study of each scenario that has overrides.
        """

    def check_speeds(self, study: StudyOfLaws, name: str) -> None:
        """Refuse keys that suit the speed of none of the scenarios in which the law runs."""

    @property
    def rule(self) -> Tuning | None:
        """The law's tuning rule; None if all gains are given."""
        rule: Tuning | None = getattr(self, "tuning", None)
        return rule

    @property
    def is_auto(self) -> bool:
        """Whether the law's tuning rule is `auto`."""
        return self.rule is not None and self.rule.is_auto

    @property
    def given_pi(self) -> tuple[float, float] | None:
        """kp [A*s/rad] and ki [A/rad] of the law's PI, if keys give them; None without a PI or by a rule."""
        return None

    @property
    def has_pi(self) -> bool:
        """Whether the law's feedback is a PI with the keys `kp` and `ki`."""
        return False

    @property
    def code(self) -> str | None:
        """The user's file, relative to the study, whose code runs; None for a law of the control library."""
        return None

    @property
    def python_class(self) -> str | None:
        """File and class of a user's law in Python, as "file.py:Class"; None for all others."""
        return None

    @property
    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of `python_class`."""
        return {}

    def own_code(self, folder: Path, drive: Mapping[str, Any]) -> dict[str, Any]:
        """Entries of the engine's description of a user's library; {} for other laws.

        `folder`: of the study. `drive`: numbers of the drive that the library gets.
        """
        return {}

    @property
    def begins_with(self) -> Start | None:
        """The stored map or table with which the law's map starts a run; None: the map starts empty."""
        return None

    @property
    def commissioning(self) -> Commissioning | None:
        """The run that fills the law's table before the first run; None if there is none."""
        return None

    @property
    def row(self) -> str:
        """The law's name in laws.def."""
        return self.law

    @property
    def c_struct(self) -> str:
        """C type of the law's configuration."""
        return C_LAWS[self.row].config

    @property
    def unrecorded(self) -> frozenset[str]:
        """Signals of laws.def that the law does not have with its keys as they are."""
        return frozenset()

    @property
    def terms(self) -> frozenset[str]:
        """Names of the recorded parts of the law's output."""
        if self.row not in C_LAWS:
            return frozenset()
        return frozenset(term.signal for term in C_LAWS[self.row].terms) - self.unrecorded

    @property
    def uses_path(self) -> bool:
        """Whether the law follows the reference's angle, so that this angle and its error are recorded."""
        return self.holds_position

    @property
    def needs_slots(self) -> bool:
        """Whether the law needs the key `slots` of the motor."""
        return False

    @property
    def missing_feedback(self) -> str | None:
        """The feedback key that is zero while the law learns, so that the guard can't compare; else None."""
        return None

    @property
    def by_order(self) -> bool:
        """Whether the law's memory holds amplitudes of orders, and no cells over a period."""
        return self.row in C_LAWS and C_LAWS[self.row].by_order

    def revolutions(self, pole_pairs: int) -> Fraction | None:
        """Length of the learned period in mechanical revolutions; None: nothing is learned over a period."""
        return None

    @property
    def period_words(self) -> str:
        """The learned period in words, for a law that learns functions of the angle."""
        return ""

    @property
    def rests_below(self) -> float | None:
        """Speed below which learning pauses, rad/s; None: the law has no such key."""
        return None

    def functions_learned(self, accelerates: bool) -> int:
        """How many functions of the angle the law learns. `accelerates`: whether the reference does."""
        return 1

    @property
    def uses_acceleration(self) -> bool:
        """Whether the law learns a function that acts with the acceleration."""
        return False

    def unit_of(self, key: str) -> str:
        """SI unit of a key of the law; "" if the key has no unit."""
        field = type(self).model_fields[key]
        return unit_within([*field.metadata, *get_args(field.annotation)])

    @property
    def idle_keys(self) -> frozenset[str]:
        """Keys that have no effect with the other keys as they are."""
        return frozenset()

    @property
    def learns(self) -> bool:
        """Whether the law learns during a run."""
        return False

    @property
    def learns_from_trials(self) -> bool:
        """Whether the law learns from trial to trial."""
        return False

    @property
    def learned(self) -> bool:
        """Whether a part of the law's output is learned, in this run or before."""
        return self.learns

    @property
    def learns_from(self) -> float:
        """Time from which the law may learn, s."""
        return 0.0

    @property
    def holds_position(self) -> bool:
        """Whether the law also controls the position."""
        return False

    @property
    def linear(self) -> tuple[float, float] | None:
        """kp [A*s/rad] and ki [A/rad] of the speed feedback without learning; None if keys don't fix them."""
        return None

    @property
    def by_rotor(self) -> bool:
        """Whether the law learns over the rotor's angle; if not, over the reference's angle."""
        return True

    @property
    def unit(self) -> float:
        """The entry of the law's memory that results in a current of 1 A."""
        return 1.0

    def ratio(self, pole_pairs: int) -> int:
        """Factor from the mechanical angle to the angle over which the law learns."""
        return 1

    @model_validator(mode="after")
    def _sizes(self) -> Self:
        check_sizes(self)
        return self


class Feedback(Base):
    """A speed PI controller: kp and ki, or the rule that computes them."""

    kp: SpeedGain | None = None  # A*s/rad
    """Proportional gain of the PI: current per speed error. Give `kp` and `ki`, or `tuning`."""
    ki: SpeedIntegralGain | None = None  # A/rad
    """Integral gain of the PI: current per integral of the speed error. Give `kp` and `ki`, or `tuning`."""
    tuning: Tuning | None = None
    """Rule that computes `kp` and `ki`. The rule `auto` also computes the law's other numbers."""

    @property
    def has_pi(self) -> bool:
        return True

    @property
    def given_pi(self) -> tuple[float, float] | None:
        return None if self.kp is None or self.ki is None else (self.kp, self.ki)

    @model_validator(mode="after")
    def _gains_or_rule(self) -> Self:
        gains = [key for key in ("kp", "ki") if getattr(self, key) is not None]
        # kp and ki may also be given with the rule auto, which then finds the other numbers
        if gains and self.tuning is not None and not self.tuning.is_auto:
            raise excluded("tuning", gains[0], instead=f"delete {' and '.join(gains)}")
        if len(gains) == 1 or not (gains or self.tuning):
            margin = '{ rule = "phase-margin", phase_margin = "60 deg" }'
            rule = '{ rule = "auto" }' if self.learns else margin
            raise invalid(f"expected either kp and ki or tuning, such as {rule}")
        return self

    def pi_config(self, loop: LawLoop) -> dict[str, Any]:
        """Members of the C struct cgl_pi_config."""
        return {"kp": self.kp, "ki": self.ki, "limit": loop.current_limit}


MAP_CELLS_MOST = 65_535
LINE_SAMPLES_MOST = 1 << 24  # samples of the longest delay line
FEWEST_SAMPLES = 4  # least samples per learned period; the lead may be at most the period / FEWEST_SAMPLES
Cells = Annotated[int, Field(ge=4, le=LINE_SAMPLES_MOST)]


def check_cells(cells: int, q_half_width: int, line: bool) -> None:
    """Check that a memory isn't too large and is longer than its Q filter.

    `line`: whether the memory is a delay line; if not, it is a map.
    """
    if not line and cells > MAP_CELLS_MOST:
        raise invalid(f"expected at most {MAP_CELLS_MOST} cells, the most of a map", "cells")
    if 2 * q_half_width + 2 > cells:
        raise invalid(f"expected a filter that fits into the {cells} cells of the memory", "q_half_width")


class Startable(Base):
    """A law whose map over the angle can be one that was learned before."""

    start: Start | None = None
    """Map that the law has at the start of the run because it was learned before. Default: an empty map. To
    take such a map, a Python class of your own needs the methods `learned_map` and `load_map`; a library of
    your own needs the functions `cogless_plugin_learned_map` and `cogless_plugin_load_map`."""

    @property
    def begins_with(self) -> Start | None:
        return self.start


class LearnsWhileRunning(Startable):
    """A law that learns during the run, from a time on."""

    learning_start: StartTime = 0.0  # s
    """Time of the run at which learning starts."""

    learns_while_running: ClassVar[bool] = True

    @property
    def learns(self) -> bool:
        return True

    @property
    def learns_from(self) -> float:
        return self.learning_start


class Memory(Protocol):
    """A memory over a period of the angle, as the design judges it."""

    @property
    def learning_start(self) -> float: ...
    @property
    def cells(self) -> int: ...
    @property
    def q_half_width(self) -> int: ...
    @property
    def over_angle(self) -> bool:
        """Whether the memory is over the angle; if not, it is a delay line over time."""

    @property
    def by_order(self) -> bool: ...
    def revolutions(self, pole_pairs: int) -> Fraction:
        """Length of the learned period in mechanical revolutions."""


class Learning(LearnsWhileRunning):
    """The memory of an iterative learning law."""

    memory: Literal["time", "angle"] = "angle"
    """Where the law stores the learned current ([comparison](/laws/memory.md#by-angle-or-by-time)).
    `"angle"`: in a map over the rotor's angle. `"time"`: in a delay line over time."""
    period: Literal["electrical", "mechanical"] = "mechanical"
    """Period after which the ripple repeats: an electrical or a mechanical revolution."""
    cells: Cells = 1024
    """With `memory = "angle"`: number of entries of the map in a period, at most 65535. With `"time"`:
    largest number of speed-loop samples that a period may have."""
    forgetting: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the learned current that is kept from one period to the next. 1: nothing is forgotten."""
    q_half_width: Annotated[int, Field(ge=0)] = 0
    """Half width of the [Q filter](/laws/memory.md#q-filter-and-forgetting), which averages each entry of the
    memory with this many entries on each side. 0: no Q filter."""
    lead: StartTime = 0.0  # s
    """Time from a current to the speed error that it causes. The present error corrects the memory's entry
    that acted this long ago. The time is rounded to speed-loop samples, at most a quarter of `cells`."""
    limit: CurrentBound | None = None  # A
    """Largest magnitude of the learned current. Default: `current_limit` of the drive."""

    @property
    def over_angle(self) -> bool:
        """Whether the memory is a map over the angle; if not, it is a delay line over time."""
        return self.memory == "angle"

    def revolutions(self, pole_pairs: int) -> Fraction:
        """Length of the learned period in mechanical revolutions."""
        return Fraction(1, self.ratio(pole_pairs))

    @property
    @abstractmethod
    def learning_gain(self) -> tuple[float, float]:
        """Learning gains on the speed error and its integral, like a PI's kp [A*s/rad] and ki [A/rad]."""

    @property
    def learns_by_switching(self) -> bool:
        """Whether the law also learns by a switching term, faster than a small-signal model says."""
        return False

    def ratio(self, pole_pairs: int) -> int:
        return pole_pairs if self.period == "electrical" else 1

    @model_validator(mode="after")
    def _cells_fit(self) -> Self:
        check_cells(self.cells, self.q_half_width, self.memory == "time")
        return self

    def check(self, study: StudyOfLaws, name: str) -> None:
        """Check that the lead is at most a quarter of the memory."""
        longest = self.cells // 4 / study.drive.rates.outer_loop
        if self.lead > longest * (1 + 1e-9):
            expected = f"expected at most {longest:.6g} s, the time of cells/4 samples of the speed loop"
            raise invalid(expected, "controller", name, "lead")

    def check_speeds(self, study: StudyOfLaws, name: str) -> None:
        """Check that the law can learn at the top speed of at least one of its scenarios.

        There the learned period must hold enough samples, fit into the memory, and be at least FEWEST_SAMPLES
        times the lead.
        """
        rate, per_turn = study.drive.rates.outer_loop, self.ratio(study.motor.pole_pairs)
        speeds = [study.scenario[key].top_speed for key in study.scenarios_of(name)]
        samples = [rate * TURN / (per_turn * speed) for speed in speeds if speed > 0]
        if not samples:
            return
        longest = max(samples)
        if self.memory == "time" and min(samples) > self.cells:
            expected = (
                f"expected at least {math.ceil(min(samples))} cells: a period has so many samples of the "
                "speed loop"
            )
            raise invalid(expected, "controller", name, "cells", value=self.cells)
        if longest < FEWEST_SAMPLES:
            expected = (
                f"expected a longer period: at top speed this one has {longest:.3g} samples of the speed "
                f"loop, but needs {FEWEST_SAMPLES}"
            )
            raise invalid(expected, "controller", name, "period", value=self.period)
        quarter = longest / FEWEST_SAMPLES / rate
        if self.lead > quarter * (1 + 1e-9):
            expected = f"expected at most {quarter:.6g} s, a quarter of a period at top speed"
            raise invalid(expected, "controller", name, "lead")

    def memory_config(self, loop: LawLoop) -> dict[str, Any]:
        """Members of the C struct cgl_memory_config."""
        assert self.limit is not None
        return {
            "kind": f"CGL_MEMORY_{self.memory.upper()}",
            "channels": 1,
            "cells": self.cells,
            "turns": 1,
            "parts": self.ratio(loop.pole_pairs),
            "q_half_width": self.q_half_width,
            "lead": loop.samples(self.lead),
            "forgetting": self.forgetting,
            "limit": [abs(self.unit) * loop.bounded(self.limit)],
            "method": "CGL_DELAY_ODE",
            "k_pp": 0.0,
        }
