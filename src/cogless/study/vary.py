"""Tables `[vary]` and `[tune]`: how a study's values spread over an ensemble, and which gains to choose."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from cogless.study.table import Many, Table, dotted_keys, invalid

FORMS = ("uniform", "log", "normal", "corners", "list")
Number = str | float | int  # a text with a unit or with %, or a plain number


class Distribution(Table):
    """How a value spreads: one of these forms.

    One number is a deviation from the study's own value, two are limits; each is a text with the key's unit,
    or with % of the study's value.
    """

    uniform: Number | Many[Number] | None = None
    log: Number | Many[Number] | None = None
    normal: Number | Many[Number] | None = None
    corners: Number | Many[Number] | None = None
    list: Many[Any] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if len([form for form in FORMS if getattr(self, form) is not None]) != 1:
            raise invalid(f'expected one of {", ".join(FORMS)}, such as uniform = "20 %"')
        form, value = self.form
        if isinstance(value, tuple) and form != "list" and len(value) != 2:
            raise invalid("expected one number, or two", form)
        if value == ():
            raise invalid("expected one or more", form)
        return self

    @property
    def form(self) -> tuple[str, Any]:
        """The form that is given, and its value."""
        name = next(form for form in FORMS if getattr(self, form) is not None)
        return name, getattr(self, name)


class Together(Table):
    """Keys whose values are correlated: the correlation of each pair, behind every distribution."""

    keys: Many[str]
    correlation: Annotated[float, Field(ge=-1, le=1)]

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if len(self.keys) < 2 or len(set(self.keys)) < len(self.keys):
            raise invalid("expected two or more different keys", "keys")
        least = -1 / (len(self.keys) - 1)
        if self.correlation < least:
            expected = f"expected {least:.3g} or more, since no {len(self.keys)} values can all be less alike"
            raise invalid(expected, "correlation")
        return self


class Vary(Table):
    """How an ensemble spreads around the study: a distribution for each dotted key."""

    keys: dict[str, Distribution] = Field(default={})  # in the file they stand in [vary] itself
    together: Many[Together] = ()
    seeds: bool = False  # each variant draws its own sensor noise

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        own = {key: data[key] for key in ("together", "seeds") if key in data}
        return {"keys": _flat({key: data[key] for key in data if key not in own}), **own}

    @model_validator(mode="after")
    def _known(self) -> Self:
        taken: set[str] = set()
        for index, group in enumerate(self.together):
            for place, key in enumerate(group.keys):
                if key not in self.keys:
                    raise invalid(f"expected one of {', '.join(self.keys)}", "together", index, "keys", place)
                if key in taken:
                    expected = "expected a key that is in no other group"
                    raise invalid(expected, "together", index, "keys", place)
                taken.add(key)
        if not self.keys and not self.seeds:
            raise invalid("expected one or more, or seeds = true", "keys", value="missing")
        return self


class Hold(Table):
    """What must hold of the tuned controllers: a metric's limit, in at least this share of the variants."""

    metric: str
    limit: Number
    share: Annotated[float, Field(gt=0, le=1)] = 1.0


class Tune(Table):
    """Gains to choose for each controller by itself, and what is best, over the ensemble or the study."""

    keys: dict[str, Many[Number]]
    minimise: str  # a metric; one of its orders or phases as NAME.72
    over: Literal["mean", "worst", "nominal"] | Annotated[float, Field(gt=0, lt=1)] = "mean"
    hold: Many[Hold] = ()
    scenarios: Many[str] | None = None  # default: all that the controller runs in
    variants: Annotated[int, Field(ge=1)] = 32  # of the ensemble
    budget: Annotated[int, Field(ge=2)] = 200  # settings that are tried, for each controller

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
    """Distributions or ranges by dotted key; what is no table stays as it is."""
    return dotted_keys(keys, _holds_more) if isinstance(keys, dict) else keys


def _holds_more(_key: str, value: Any) -> bool:
    """Whether a value is a table of distributions or ranges, and no distribution itself."""
    return (
        isinstance(value, dict)
        and all(isinstance(inner, dict | list) for inner in value.values())
        and not any(form in value for form in FORMS)
    )
