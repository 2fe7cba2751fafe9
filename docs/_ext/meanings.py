"""What each key of a study means: the string below its field in the model.

    kp: SpeedGain | None = None
    \"\"\"Proportional gain.\"\"\"

Python drops such strings, so that they cost a study nothing; they are read from the source. A model has the
meanings of its bases, and its own for a field that it declares anew.
"""

from __future__ import annotations

import ast
import functools
import inspect
import sys

from cogless.study.table import Table


@functools.cache
def of_module(name: str) -> dict[str, dict[str, str]]:
    """The strings below the fields of each class of a module: class -> key -> meaning."""
    found: dict[str, dict[str, str]] = {}
    for node in ast.parse(inspect.getsource(sys.modules[name])).body:
        if isinstance(node, ast.ClassDef):
            found[node.name] = {}
            for field, below in zip(node.body, node.body[1:], strict=False):
                if (
                    isinstance(field, ast.AnnAssign)
                    and isinstance(field.target, ast.Name)
                    and isinstance(below, ast.Expr)
                    and isinstance(below.value, ast.Constant)
                    and isinstance(below.value.value, str)
                ):
                    found[node.name][field.target.id] = " ".join(below.value.value.split())
    return found


def owner(model: type[Table], key: str) -> type[Table]:
    """The model or base that declares a key."""
    return next(c for c in model.__mro__ if key in inspect.get_annotations(c))


def meanings(model: type[Table]) -> dict[str, str]:
    """The meaning of each key of a model, "" for one that has none."""
    texts: dict[str, str] = {}
    for key in model.model_fields:
        places = model.__mro__[model.__mro__.index(owner(model, key)) :]
        own = (of_module(c.__module__).get(c.__name__, {}).get(key) for c in places if issubclass(c, Table))
        texts[key] = next(filter(None, own), "")
    return texts
