"""All control laws that a speed study can use. A law's model is found because its file is in this folder.

A model is a class with a key `law` of one word. Laws of the control library come in the order of laws.def,
then a user's own laws. Laws of trials are not included: for these, the module `trial` has its own union.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Annotated, Union, get_args

from pydantic import Field

from cogless.control_library import C_LAWS
from cogless.study.laws.law import Base


def law_name(model: type[Base]) -> str | None:
    """The word of a model's key `law`; None for a base class of laws."""
    field = model.model_fields.get("law")
    return None if field is None else str(get_args(field.annotation)[0])


def _models() -> list[type[Base]]:
    """The models of all laws of speed studies, in order."""
    models: dict[str, type[Base]] = {}
    for file in iter_modules(__path__):
        for value in vars(import_module(f"{__name__}.{file.name}")).values():
            name = law_name(value) if isinstance(value, type) and issubclass(value, Base) else None
            if name is not None and not value.of_trials:
                models[name] = value
    order = [*C_LAWS, *models]
    return [models[name] for name in sorted(models, key=order.index)]


if TYPE_CHECKING:
    AnyController = Base
else:
    AnyController = Union[tuple(_models())]  # noqa: UP007
Controller = Annotated[AnyController, Field(discriminator="law")]
