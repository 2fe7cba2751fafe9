"""Turn pydantic's errors into lines that a person can read: `FILE: key: VALUE: expected ...`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cogless.errors import StudyError
from cogless.study.table import Key, perhaps
from cogless.study.toml import quoted
from cogless.study.toml import toml as toml

MISSING = object()
MOST_TOLD = 20  # largest number of mistakes in one message

# Messages for pydantic's own checks, by type of error; pydantic's context fills in the braces.
EXPECTED = {
    "int_type": "expected a whole number",
    "int_from_float": "expected a whole number",
    "float_type": "expected a number",
    "finite_number": "expected a finite number",
    "string_type": "expected a text",
    "bool_type": "expected true or false",
    "dict_type": "expected a table",
    "model_attributes_type": "expected a table",
    "tuple_type": "expected an array",
    "missing": "expected {length} values",
    "too_long": "expected {max_length} values",
    "greater_than": "expected a number above {gt:g}",
    "greater_than_equal": "expected a number of {ge:g} or more",
    "less_than": "expected a number below {lt}",
    "less_than_equal": "expected a number of {le:g} or less",
    "too_short": "expected {min_length} or more",
    "union_tag_invalid": "expected one of {expected_tags}",
    "union_tag_not_found": "expected a key that says what kind of table this is",
    "literal_error": "expected {expected}",
}
OF_WORDS, WORDS = ("union_tag_invalid", "literal_error"), re.compile(r'"([^"]+)"')
ONE_OF = 'expected one of "'
MISSING_KINDS = {
    "law": "expected a law that cogless list shows",
    "position_sensor": 'expected a kind of sensor, such as "encoder"',
    "faults": 'expected a kind of fault, such as "angle-missing"',
}
ARRAYS_OF_TABLES = (("metric",), ("assumption",))
NAMED_TABLES = {"scenario": "slow", "controller": "pi"}  # tables of named tables, each with a sample name
PATTERNS = {
    r"^.+\.py:\w+$": 'expected a file and a class, such as "my_law.py:MyLaw"',
    r"^[A-Za-z][A-Za-z0-9_]*$": "expected a name of letters, digits and _",
}


@dataclass(frozen=True)
class Problem:
    """One mistake: its key, the value at that key, and what was expected.

    `by`: a key that excludes the key. `either`: without `by` the key would be right.
    """

    key: Key
    value: str
    expected: str
    by: Key | None = None
    either: bool = False

    def line(self, file: Path | str, prefix: str = "") -> str:
        """The line to print. `prefix`: text in front of the key."""
        key = prefix + dotted(self.key)
        return ": ".join(part for part in (str(file), key, self.value, self.expected) if part)


def dotted(key: Key) -> str:
    """A key as `--set` takes it, with list indices as numbers."""
    return ".".join(quoted(part) if _in_quotes(part) else part for part in map(str, key))


def _in_quotes(part: str) -> bool:
    return not part or "." in part or not part.isprintable()


def toml_text(value: Any) -> str:
    """A value as written in TOML, shortened to 60 characters."""
    text = toml(value)
    return text if len(text) <= 60 else text[:57] + "..."


def problems(error: ValidationError, tables: Any) -> list[Problem]:
    """Pydantic's errors in these tables as problems, one per key, in the order of the file."""
    errors = error.errors(include_url=False, include_input=False)
    # Pydantic reports every missing index of a short array; the last index gives the length that is needed.
    lengths = {d["loc"][:-1]: int(d["loc"][-1]) + 1 for d in errors if d["type"] == "missing"}
    first = {d["loc"][:-1]: d for d in reversed(errors) if d["type"] == "missing"}
    own_errors = [d for d in errors if d["type"] != "missing" or first[d["loc"][:-1]] is d]
    by_key: dict[Key, list[Problem]] = {}
    for details in own_errors:
        problem = _problem(details, tables, lengths.get(details["loc"][:-1]))
        by_key.setdefault(problem.key, []).append(problem)
    return [_either(by_key[key]) for key in sorted(by_key, key=lambda key: _place(key, tables))]


def study_error(lines: Sequence[str]) -> StudyError:
    """A single StudyError with all these lines, cut off after MOST_TOLD."""
    more = len(lines) - MOST_TOLD
    return StudyError("\n".join([*lines[:MOST_TOLD], *([f"and {more} more mistakes"] if more > 0 else [])]))


def _either(same: Sequence[Problem]) -> Problem:
    """Merge the problems at one key, of which pydantic reports one for each type that the key accepts."""
    first, *others = dict.fromkeys(problem.expected for problem in same)
    return replace(same[0], expected=" or ".join([first, *(o.removeprefix("expected ") for o in others)]))


def _place(key: Key, tables: Any) -> list[int]:
    """Position of a key in the file at each level, for sorting; a missing key comes last in its table."""
    place: list[int] = []
    for part in key:
        keys = list(tables) if isinstance(tables, dict) else list(range(len(tables)))
        place.append(keys.index(part) if part in keys else len(keys))
        tables = look_up(tables, (part,))
        if not isinstance(tables, dict | list):
            break
    return place


def _problem(details: Any, tables: Any, length: int | None) -> Problem:
    context = {"length": length, **details.get("ctx", {})}
    table = _existing(details["loc"], tables)
    key = table + tuple(context.get("key", ()))
    kind = details["type"]
    if kind.startswith("union_tag"):
        key = (*key, context["discriminator"].strip("'_()"))  # pydantic writes "'law'" or "_kind()"
    value = look_up(tables, key)
    absent = "missing" if kind.startswith("union_tag") else str(context.get("value") or "")
    is_present = value is not MISSING and not (kind == "study" and isinstance(value, dict))
    expected = _in_its_place(kind, key, value) or _expected(kind, context, details["msg"])
    name = value if isinstance(value, str) else absent
    of_words = kind in OF_WORDS or expected.startswith(ONE_OF)
    meant = perhaps(name, WORDS.findall(expected)) if of_words and name else ""
    by = table + tuple(context["by"]) if "by" in context else None
    return Problem(
        key, toml_text(value) if is_present else absent, expected + meant, by, context.get("either", False)
    )


def _in_its_place(kind: str, key: Key, value: Any) -> str | None:
    """The expectation for a mistake that is clear from its place in the file; None for other mistakes."""
    if kind == "union_tag_not_found":
        return next((MISSING_KINDS[part] for part in reversed(key) if part in MISSING_KINDS), None)
    if kind == "tuple_type" and (isinstance(value, dict) or key in ARRAYS_OF_TABLES):
        return f"expected an array of tables, written as [[{dotted(key)}]]"
    if len(key) == 2 and key[0] in NAMED_TABLES and value is not MISSING and not isinstance(value, dict):
        return f"expected a table with a name, such as [{key[0]}.{NAMED_TABLES[key[0]]}]"
    return None


def _expected(kind: str, context: dict[str, Any], message: str) -> str:
    if kind == "study":
        return str(context["expected"])
    if kind == "string_pattern_mismatch":
        return PATTERNS.get(context["pattern"], message)
    return EXPECTED.get(kind, message).format(**context).replace("'", '"')


def _existing(location: Key, tables: Any) -> Key:
    """The part of pydantic's location that is a key of the file; names of union members are left out."""
    key: list[str | int] = []
    for index, part in enumerate(location):
        nested = tuple(str(part).split("."))  # the file may write a dotted key of [vary] as nested tables
        if len(nested) > 1 and look_up(tables, (part,)) is MISSING and look_up(tables, nested) is not MISSING:
            key += nested
            tables = look_up(tables, nested)
            continue
        inner, after = look_up(tables, (part,)), location[index + 1 : index + 2]
        is_sibling = after and not isinstance(inner, dict | list) and look_up(tables, after) is not MISSING
        if inner is not MISSING and not is_sibling:  # a name in a union may also be a key: law = "library"
            key.append(part)
            tables = inner
    return tuple(key)


def look_up(tables: Any, key: Key) -> Any:
    """The value at a key, or MISSING."""
    for part in key:
        if isinstance(tables, dict):
            tables = tables.get(str(part), MISSING)  # a key may consist of digits, such as [scenario.60]
        elif isinstance(tables, list) and isinstance(part, int) and part < len(tables):
            tables = tables[part]
        else:
            return MISSING
    return tables
