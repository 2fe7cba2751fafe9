"""What `cogless design` finds of one controller, as lines of text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cogless.study import AnyStudy, TrialStudy


def figures(study: AnyStudy, scenario: str, controller: str) -> list[tuple[str, str]]:
    """(name, value with its unit) in the order and by the names of `cogless design --json`."""
    if isinstance(study, TrialStudy):
        from cogless.design.from_study import design_study
        from cogless.design.trial_summary import design_dict

        designs = design_study(study, [(scenario, controller)])
        return list(_flat(design_dict(designs[scenario, controller])))
    from cogless.design.summary import to_dict

    found = to_dict(study)
    loop = {f"current_loop.{axis}": entry for axis, entry in found["current_loop"].items()}
    return [*_flat(loop), *_flat(found["controllers"][controller])]


def _flat(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Dotted names; what there is not (null, an empty list) is left out."""
    for key, value in table.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict) and value.keys() >= {"value", "unit"}:
            note = f" ({value['note']})" if "note" in value else ""
            yield name, f"{_text(value['value'])} {value['unit']}".rstrip() + note
        elif isinstance(value, dict):
            yield from _flat(value, f"{name}.")
        elif value is not None and value != [] and value != "":
            yield name, _text(value)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        return ", ".join(_text(item) for item in value)
    return " ".join(str(value).split()).replace("*/", "* /")
