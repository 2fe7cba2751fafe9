"""Results of `cogless design` for one controller, as lines of text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cogless.study import AnyStudy, TrialStudy


def figures(study: AnyStudy, scenario: str, controller: str) -> tuple[list[tuple[str, str]], str]:
    """Results (name, value with its unit) named and ordered as in `cogless design --json`, and the verdict.

    The verdict says in one line whether learning works; it is empty for a law that learns nothing.
    """
    if isinstance(study, TrialStudy):
        from cogless.design import trial_summary
        from cogless.design.from_study import design_study

        trial = design_study(study, [(scenario, controller)])[scenario, controller]
        return list(_flat(trial_summary.design_dict(trial))), trial_summary.words(trial)
    from cogless.design.summary import current_loop_dict, design, design_dict

    found = design(study, controller)
    loop = {f"current_loop.{axis}": entry for axis, entry in current_loop_dict(study).items()}
    return [*_flat(loop), *_flat(design_dict(found))], found.words()


def _flat(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Flatten tables to dotted names with texts; empty values (null, an empty list) are left out."""
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
