"""Base of a study's tables: frozen models that refuse unknown keys, and quantities with a unit."""

from __future__ import annotations

import difflib
import math
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, ErrorDetails, InitErrorDetails, PydanticCustomError, core_schema

from cogless import units
from cogless.units import Dimension

Key = tuple[str | int, ...]
T = TypeVar("T")


def _as_made(value: Any, validate: ValidatorFunctionWrapHandler) -> Any:
    """Take over the validated tables of another study, which are in a tuple; a file has lists."""
    is_made = isinstance(value, tuple) and bool(value) and isinstance(value[0], Table)
    return value if is_made else validate(value)


# An array of a study file. TOML has only lists, so here a list is accepted for a tuple in spite of `strict`.
Many = Annotated[tuple[T, ...], Field(strict=False), WrapValidator(_as_made)]


def invalid(expected: str, *key: str | int, value: Any = None) -> PydanticCustomError:
    """Make the error of a validator: what was expected, at which key within the table that it validates.

    `value`: shown in the message if the file has nothing at that key.
    """
    return PydanticCustomError("study", "{expected}", {"expected": expected, "key": key, "value": value})


def excluded(key: str | Key, by: str | Key, since: str = "", instead: str = "") -> PydanticCustomError:
    """Make the error of a key that another key, `by`, excludes, with what to do about it.

    `since`: the reason; by default that `by` is given. `instead`: the change, other than deleting `key`, that
    ends the conflict; by default to delete `by`. Both keys are within the table that the validator checks.
    """
    path, other = (part if isinstance(part, tuple) else (part,) for part in (key, by))
    since, ways = since or f"{other[-1]} is given", instead or f"delete {other[-1]}"
    expected = f"expected no such key, since {since}: delete {path[-1]}, or {ways}"
    context = {"expected": expected, "key": path, "by": other, "either": ways.startswith("delete")}
    return PydanticCustomError("study", "{expected}", context)


def check_one(table: Table, keys: Sequence[str], expected: str, at: str = "") -> None:
    """Refuse a table with none of these keys, or with two. `at`: the key that is missing if none is there."""
    present = [key for key in keys if getattr(table, key) not in (None, ())]
    if len(present) > 1:
        raise excluded(present[1], present[0])
    if not present:
        raise invalid(expected, at, value="missing") if at else invalid(expected)


class Table(BaseModel):
    """A table of a study file."""

    # built at first use: to list laws, or to run a study of speed, few of the models are needed
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        """The full table for a value in short form, such as a text in place of a table."""
        return data

    IN_PLACE: ClassVar[dict[str, str]] = {}  # a newcomer's word, in lower case -> key of this table

    @classmethod
    def other_word(cls, key: str, value: Any) -> str | None:
        """The expectation for an unknown key that another word replaces; None for other unknown keys."""
        word = cls.IN_PLACE.get(key.lower())
        return f'expected the key "{word}" instead' if word else None

    @model_validator(mode="wrap")
    @classmethod
    def _keys(cls, data: Any, validate: ModelWrapValidatorHandler[Self]) -> Self:
        """Report all mistakes of a table at once: wrong keys and wrong values.

        Conditions between several keys are checked only if each key is right by itself.
        """
        if isinstance(data, cls):  # a part of another study
            return data
        data = cls.spelled_out(data)
        if not isinstance(data, dict):
            raise invalid(f"expected a table with the keys {', '.join(cls.model_fields)}")
        if _field_names(cls) >= data.keys() and _required(cls) <= data.keys():
            return validate(data)
        wrong = _wrong_keys(cls, data)
        try:
            validate({key: value for key, value in data.items() if key in cls.model_fields})
        except ValidationError as error:
            errors = error.errors(include_url=False)
            wrong += [_again(d) for d in errors if d["loc"] and d["loc"][0] in data]
        raise ValidationError.from_exception_data(cls.__name__, wrong)


@cache  # model_fields itself takes a microsecond
def _field_names(table: type[Table]) -> frozenset[str]:
    return frozenset(table.model_fields)


@cache
def _required(table: type[Table]) -> frozenset[str]:
    return frozenset(key for key, field in table.model_fields.items() if field.is_required())


TAGS = ("kind", "law")  # keys whose value says which keys a table has
KINDS_NAMED = 4  # largest number of kinds that a message names


def _wrong_keys(table: type[Table], data: dict[str, Any]) -> list[InitErrorDetails]:
    """Errors for unknown keys, and for missing keys unless an unknown key looks like their misspelling."""
    keys = list(table.model_fields)
    near = {key: _meant(key, keys) for key in data if key not in keys}
    errors = [
        _of_another_kind(table, key, data)
        or invalid(table.other_word(key, data[key]) or _suggestion(meant, keys), key, value="unknown key")
        for key, meant in near.items()
    ]
    meant_by_any = {name for meant in near.values() for name in meant}
    meant_by_any |= {
        name for key in near for name in keys if f'"{name}"' in (table.other_word(key, data[key]) or "")
    }
    for key, field in table.model_fields.items():
        if field.is_required() and key not in data and key not in meant_by_any:
            errors.append(invalid(f"expected {_expected_value(key, field)}", key, value="missing"))
    return [InitErrorDetails(type=error, input=data) for error in errors]


def _of_another_kind(table: type[Table], key: str, data: dict[str, Any]) -> PydanticCustomError | None:
    """The error of a key that other kinds of this table have; None: no kind has it, or there is only one."""
    tag = next((tag for tag in TAGS if tag in table.model_fields), None)
    others = [kind for kind in _kinds_beside(table) if key in kind.model_fields]
    if tag is None or not others:
        return None
    fields = [kind.model_fields[tag].annotation for kind in others if tag in kind.model_fields]
    names = [f'"{name}"' for field in fields for name in get_args(field)]
    named = f"{tag} = {' or '.join(names)}" if len(names) <= KINDS_NAMED else f"a {tag} that takes {key}"
    return excluded(key, tag, f'{tag} = "{data[tag]}"', f"set {named}" if names else f"delete {tag}")


@cache
def _kinds_beside(table: type[Table]) -> tuple[type[Table], ...]:
    """The other tables that a study may have in this table's place."""
    fields = (field for holder in _below(Table) for field in holder.model_fields.values())
    unions = (tuple(_tables_in(field.annotation)) for field in fields)
    return tuple(dict.fromkeys(t for kinds in unions if table in kinds for t in kinds if t is not table))


def _below(table: type[Table]) -> Iterator[type[Table]]:
    for inner in table.__subclasses__():
        yield inner
        yield from _below(inner)


def _tables_in(annotation: Any) -> Iterator[type[Table]]:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        yield annotation
    for inner in get_args(annotation):
        yield from _tables_in(inner)


def _expected_value(key: str, field: FieldInfo) -> str:
    """What is expected at a key that is missing: the field's example, or what its type says."""
    quantity = next((entry for entry in field.metadata if isinstance(entry, Quantity)), None)
    if quantity:
        return quantity.expectation.removeprefix("expected ")
    return f"one, such as {field.examples[0]}" if field.examples else _sort(key, field.annotation)


def _sort(key: str, of: Any) -> str:
    """What a type takes, in words; of several types the first."""
    origin, inner = get_origin(of), get_args(of)
    if origin in (Annotated, Union, UnionType):
        return _sort(key, inner[0])
    if origin is Literal:
        return one_of(inner).removeprefix("expected ")
    if origin is dict:
        return f"a table [{key}.NAME]" if _sort(key, inner[1]).startswith("a table") else "a table"
    if origin is tuple:
        return "an array"
    if isinstance(of, type) and issubclass(of, Table):
        needed = [name for name in of.model_fields if name in _required(of)]
        return f"a table with {', '.join(needed)}, ..."
    return {int: "a whole number", float: "a number", str: "a text"}.get(of, "a value")


def _again(details: ErrorDetails) -> InitErrorDetails:
    """Convert an error that pydantic reported, so that it can be raised again."""
    context = details.get("ctx", {})
    own = PydanticCustomError("study", "{expected}", context) if details["type"] == "study" else None
    return InitErrorDetails(
        type=own or details["type"], loc=details["loc"], input=details["input"], ctx=context
    )


# SI: from LEAST to MOST, single precision holds each number, and the product and quotient of any two
MAGNITUDE_LEAST, MAGNITUDE_MOST = 1e-15, 1e15


def check_sizes(table: Table, *above: str) -> None:
    """Refuse numbers that become zero or infinite in a control law, which computes in single precision."""
    for key in type(table).model_fields:
        value = getattr(table, key)
        if isinstance(value, Table):
            check_sizes(value, *above, key)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and number and not MAGNITUDE_LEAST <= abs(number) <= MAGNITUDE_MOST:
                size = f"{MAGNITUDE_LEAST:g} to {MAGNITUDE_MOST:g} in SI units"
                raise invalid(f"expected a size that single precision holds, {size}", *above, key)


RANGE = {"single": (1.2e-38, 3.4e38), "double": (2.3e-308, 1.7e308)}


def check_precision(table: Table, precision: str, *above: str, terms: int = 1) -> None:
    """Refuse numbers that the controller's number type can't hold, or whose sum of `terms` would overflow."""
    smallest, largest = RANGE[precision]
    most = largest / terms
    for key in table.__class__.model_fields:
        value = getattr(table, key)
        if isinstance(value, float) and value and not smallest <= abs(value) <= most:
            expected = f"expected 0, or from {smallest:.1e} to {most:.1e}"
            raise invalid(f"{expected} in {precision} precision", *above, key)


def dotted_keys(
    tables: dict[str, Any], inside: Callable[[str, Any], bool] | None = None, above: str = ""
) -> dict[str, Any]:
    """Flatten nested tables to dotted keys.

    TOML reads mechanics.inertia as {"mechanics": {"inertia": x}}; this becomes {"mechanics.inertia": x}.

    `inside`: whether the table at a dotted key is flattened, rather than kept as a value; by default only the
    outermost tables are flattened. An empty table is always a value: a table with its defaults. `above`: the
    dotted key above `tables`, with a dot at its end.
    """
    inside = inside or (lambda key, value: "." not in key and isinstance(value, dict))
    flat: dict[str, Any] = {}
    for key, value in tables.items():
        name = above + key
        nested = value != {} and inside(name, value)
        flat |= dotted_keys(value, inside, f"{name}.") if nested else {name: value}
    return flat


def nearest(key: str, names: Sequence[str]) -> str | None:
    """The known key that an unknown one was probably meant to be; None if none is similar."""

    def plain(name: str) -> str:
        return name.lower().replace("_", "")

    near = difflib.get_close_matches(key, names, n=1)
    return next(iter(near), None) or next((name for name in names if plain(name) == plain(key)), None)


def perhaps(name: str, names: Iterable[str]) -> str:
    """The end of a message on an unknown name: the nearest known name, or "" if none is near."""
    near = nearest(name, list(names))
    return f', perhaps "{near}"' if near else ""


def _meant(key: str, names: Sequence[str]) -> list[str]:
    """The known keys that an unknown one may stand for.

    The unknown key may begin or end known keys (L begins L_d, friction ends coulomb_friction). If there are
    none, only the nearest known key is returned.
    """
    whole = [name for name in names if name.startswith(f"{key}_") or name.endswith(f"_{key}")]
    near = nearest(key, names)
    return whole or ([near] if near else [])


def _suggestion(near: Sequence[str], names: Sequence[str]) -> str:
    perhaps = " or ".join(f'"{name}"' for name in near)
    return f"expected a known key, perhaps {perhaps}" if near else f"expected one of {', '.join(names)}"


@dataclass(frozen=True)
class Quantity:
    """Pydantic annotation: a text with a unit becomes an SI float.

    `sign`: "" for any number, ">" for above zero, ">=" for zero or more. `bare`: a plain number in SI is also
    accepted, as in controllers' tables.
    """

    dimension: Dimension
    sign: str = ""
    bare: bool = False

    @property
    def expectation(self) -> str:
        sort = {"": "", ">": " above zero", ">=": " of zero or more"}[self.sign]
        if not self.dimension.unit:
            return f"expected {self.dimension.name}{sort}"
        return f"expected {self.dimension.name}{sort}, such as {self.dimension.sample(1)}"

    def read(self, value: Any) -> float:
        """The SI value; raises an error that says what was expected."""
        if isinstance(value, str) and self.dimension.unit:
            try:
                number = units.parse(value, self.dimension)
            except units.UnitError as error:
                raise invalid(str(error)) from None
        elif isinstance(value, bool) or not isinstance(value, int | float):
            raise invalid(self.expectation)
        elif not self.bare:
            raise invalid(
                f"expected a text with a unit, such as {self.dimension.sample(_sample_number(value))}"
            )
        else:
            number = float(value)
        below = number < 0 or (self.sign == ">" and number == 0)
        if not math.isfinite(number) or (self.sign and below):
            raise invalid(self.expectation)
        return number

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)


def _sample_number(value: float) -> str:
    return str(value) if math.isfinite(value) else "1"


def _line(text: str) -> str:
    """Refuse control characters: XML can't hold them, and a message is one line."""
    if any(unicodedata.category(c) == "Cc" or c in "\ufffe\uffff" for c in text):
        raise invalid("expected one line, without control characters")
    return text


@dataclass(frozen=True)
class FileName:
    """Annotation: a text that names a file, relative to the study.

    `with_name`: the text is FILE:NAME. `room`: folder of shipped files, one of which the text may name.
    """

    with_name: bool = False
    room: str = ""


@dataclass(frozen=True)
class StudyKeys:
    """Annotation: a table of other values for the study, by dotted keys of the study."""


Line = Annotated[str, AfterValidator(_line)]
File = Annotated[str, FileName()]
Datasheet = Annotated[str, FileName(room="motors")]
Override = Annotated[dict[str, Any], StudyKeys()]

Angle = Annotated[float, Quantity(units.ANGLE)]
AngularSpeed = Annotated[float, Quantity(units.ANGULAR_SPEED)]
AngularAcceleration = Annotated[float, Quantity(units.ANGULAR_ACCELERATION, ">")]
AngleMagnitude = Annotated[float, Quantity(units.ANGLE, ">=")]
Span = Annotated[float, Quantity(units.ANGLE, ">")]
AngularSpeedMagnitude = Annotated[float, Quantity(units.ANGULAR_SPEED, ">=")]
Time = Annotated[float, Quantity(units.TIME, ">=")]
Duration = Annotated[float, Quantity(units.TIME, ">")]
Frequency = Annotated[float, Quantity(units.FREQUENCY, ">")]
Current = Annotated[float, Quantity(units.CURRENT)]
CurrentMagnitude = Annotated[float, Quantity(units.CURRENT, ">=")]
CurrentLimit = Annotated[float, Quantity(units.CURRENT, ">")]
Voltage = Annotated[float, Quantity(units.VOLTAGE, ">")]
VoltageMagnitude = Annotated[float, Quantity(units.VOLTAGE, ">=")]
Torque = Annotated[float, Quantity(units.TORQUE)]
TorqueMagnitude = Annotated[float, Quantity(units.TORQUE, ">=")]
PositiveTorque = Annotated[float, Quantity(units.TORQUE, ">")]
Resistance = Annotated[float, Quantity(units.RESISTANCE, ">=")]
InductanceAmplitude = Annotated[float, Quantity(units.INDUCTANCE)]
PositiveCurrent = Annotated[float, Quantity(units.CURRENT, ">")]
Inductance = Annotated[float, Quantity(units.INDUCTANCE, ">")]
FluxLinkage = Annotated[float, Quantity(units.FLUX_LINKAGE, ">")]
FluxAmplitude = Annotated[float, Quantity(units.FLUX_LINKAGE)]
TorqueConstant = Annotated[float, Quantity(units.TORQUE_CONSTANT, ">")]
BackEmfConstant = Annotated[float, Quantity(units.BACK_EMF_CONSTANT, ">")]
SpeedConstant = Annotated[float, Quantity(units.SPEED_CONSTANT, ">")]
Temperature = Annotated[float, Quantity(units.TEMPERATURE)]
TemperatureCoefficient = Annotated[float, Quantity(units.TEMPERATURE_COEFFICIENT)]
ThermalResistance = Annotated[float, Quantity(units.THERMAL_RESISTANCE, ">")]
HeatCapacity = Annotated[float, Quantity(units.HEAT_CAPACITY, ">")]
Inertia = Annotated[float, Quantity(units.INERTIA, ">")]
Stiffness = Annotated[float, Quantity(units.STIFFNESS, ">")]
Length = Annotated[float, Quantity(units.LENGTH, ">")]
BeltStiffness = Annotated[float, Quantity(units.BELT_STIFFNESS, ">")]
CarriageMass = Annotated[float, Quantity(units.MASS, ">")]
Force = Annotated[float, Quantity(units.FORCE, ">=")]
AccelerationMagnitude = Annotated[float, Quantity(units.ACCELERATION, ">=")]
ViscousFriction = Annotated[float, Quantity(units.VISCOUS_FRICTION, ">=")]
CurrentGain = Annotated[float, Quantity(units.CURRENT_GAIN, ">=")]
CurrentIntegralGain = Annotated[float, Quantity(units.CURRENT_INTEGRAL_GAIN, ">=")]

# Rule for plain numbers: in controllers' tables they are in SI; everywhere else a unit is required.
SpeedGain = Annotated[float, Quantity(units.SPEED_GAIN, ">=", bare=True)]
SpeedIntegralGain = Annotated[float, Quantity(units.SPEED_INTEGRAL_GAIN, ">=", bare=True)]
CurrentToAcceleration = Annotated[float, Quantity(units.CURRENT_TO_ACCELERATION, ">", bare=True)]
RateGain = Annotated[float, Quantity(units.RATE, ">=", bare=True)]
RateGainPerTime = Annotated[float, Quantity(units.RATE_PER_TIME, ">=", bare=True)]
AccelerationGain = Annotated[float, Quantity(units.ANGULAR_ACCELERATION, ">=", bare=True)]
LawSpeed = Annotated[float, Quantity(units.LAW_SPEED, ">", bare=True)]
LawFrequency = Annotated[float, Quantity(units.FREQUENCY, ">", bare=True)]
CurrentBound = Annotated[float, Quantity(units.CURRENT, ">", bare=True)]
StartTime = Annotated[float, Quantity(units.TIME, ">=", bare=True)]
PhaseMargin = Annotated[float, Quantity(units.ANGLE, ">", bare=True)]
NumberGain = Annotated[float, Field(ge=0)]


def one_of(names: Iterable[str]) -> str:
    """The text of an error: "expected one of", followed by these names."""
    quoted_names = ", ".join(f'"{name}"' for name in names)
    return f"expected one of {quoted_names}"
