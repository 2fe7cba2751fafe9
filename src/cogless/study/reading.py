"""Find and read a study: its file or a shipped name, its datasheet, changes to it, overrides."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

import cogless
from cogless import units
from cogless.errors import StudyError
from cogless.study.base import Source
from cogless.study.checks import applies
from cogless.study.explain import MISSING, Problem, dotted, look_up, problems, shown, study_error
from cogless.study.mechanics import Mechanics
from cogless.study.motor import Motor
from cogless.study.study import Study
from cogless.study.table import Key, Table
from cogless.study.trial_study import Hardware, TrialStudy, is_trial_study

Changes = Mapping[str, Any]
AnyStudy = Study | TrialStudy
AStudy = TypeVar("AStudy", Study, TrialStudy)
Model = TypeVar("Model", bound=Table)
MAGNET = {"psi_f", "K_t", "kv"}  # three ways to say the same: one given replaces the others


def load(study: str | Path, changes: Changes | None = None) -> AnyStudy:
    """Read a study by path or shipped name; StudyError says what is wrong in one line.

    `changes` replace values by dotted key, such as {"controller.pi.kp": 0.02}. A number put where the study
    has a text with a unit takes that unit.
    """
    path = find(study, "studies", "study")
    tables = read(path)
    changes = dict(changes or {})
    if "motor.datasheet" in changes:
        put(tables, "motor.datasheet", changes.pop("motor.datasheet"))
    source = _with_datasheet(path, tables)
    _check_names(path, source.tables, changes)
    _apply(source.tables, changes)
    return _checked(source)


def changed(study: AStudy, changes: Changes) -> AStudy:
    """The same study with other values at some dotted keys, as in `load`."""
    tables = copy.deepcopy(study.source.tables)
    _apply(tables, changes)
    of_its_kind = _checked(_replaced(study.source, tables))
    assert isinstance(of_its_kind, type(study))
    return of_its_kind


def for_scenario(study: Study, scenario: str) -> Study:
    """The study as it is within a scenario: with its overrides, and without the other scenarios."""
    here = study.scenario[scenario]
    if not here.override:
        return study
    tables = copy.deepcopy(study.source.tables)
    _apply(tables, here.override)
    tables["scenario"] = {scenario: tables["scenario"][scenario]}
    taken = [applies(metric, scenario, here) for metric in study.metric]
    tables["metric"] = [
        {key: value for key, value in metric.items() if key != "scenarios"}
        for metric in compress(tables.get("metric", []), taken)
    ]
    tables.pop("calibration", None)
    return _validated(Study, _replaced(study.source, tables), f"scenario.{scenario}.override: ")


def parse_change(text: str) -> tuple[str, Any]:
    """Key and value of a `--set KEY=VALUE`; a VALUE that is no TOML is a text."""
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise StudyError(f"--set: {shown(text)}: expected KEY=VALUE, such as controller.pi.kp=0.02")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def shipped(room: str) -> dict[str, Path]:
    """What comes with cogless, by name. `room`: "studies" or "motors"."""
    folders = [Path(folder) / room for folder in cogless.__path__]
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def find(name: str | Path, room: str, what: str, beside: Path | None = None, where: str = "") -> Path:
    """The file of a shipped name or of a path, relative to the folder `beside`. `where`: who names it."""
    known = shipped(room)
    if str(name) in known:
        return known[str(name)]
    path = (beside or Path()) / name
    if path.is_file():
        return path
    named = f"{where}{shown(str(name)) if where else name}: "
    if path.is_dir():
        raise StudyError(f"{named}is a directory: expected a {what} file")
    expected = f"expected a file, or one of the shipped: {', '.join(known) or 'none'}"
    raise StudyError(f"{named}no such {what}: {expected}")


def read(path: Path) -> dict[str, Any]:
    """The tables of a TOML file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"{path}: not readable as TOML: {error}") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise StudyError(f"{path}: {reason}: expected a readable TOML file") from None


def put(tables: dict[str, Any], key: str, value: Any) -> None:
    """Put a value at a dotted key, making tables on the way; a number takes the unit of what it replaces."""
    path = split(key)
    inner: Any = tables
    for depth, part in enumerate(path[:-1]):
        found = look_up(inner, (part,))
        if found is MISSING and isinstance(inner, dict):
            found = inner[part] = {}
        elif isinstance(found, str):
            # A short form, such as reference = "60 rpm", has no keys of its own.
            raise StudyError(f"{key}: {shown(value)}: expected a table at {dotted(path[: depth + 1])}")
        inner = found
    last = path[-1]
    old = look_up(inner, (last,))
    if isinstance(inner, dict) or old is not MISSING:
        inner[last] = with_unit(value, old)
    else:
        raise StudyError(f"{key}: {shown(value)}: expected a key of the study, or an index of its array")


def split(key: str) -> Key:
    """The parts of a dotted key; whole numbers are indices; parts with dots stand in double quotes."""
    parts: list[str | int] = []
    for index, piece in enumerate(key.split('"')):
        if index % 2:
            parts.append(piece)
        else:
            parts += [int(part) if part.isdecimal() else part for part in piece.split(".") if part]
    if not parts:
        raise StudyError(f"{shown(key)}: expected a dotted key, such as controller.pi.kp")
    return tuple(parts)


def with_unit(value: Any, old: Any) -> Any:
    """The value, with the unit of the text it replaces where it is a bare number."""
    if isinstance(value, list) and isinstance(old, list) and old:
        return [with_unit(item, old[min(index, len(old) - 1)]) for index, item in enumerate(value)]
    bare = isinstance(value, int | float) and not isinstance(value, bool)
    unit = units.unit_of(old) if isinstance(old, str) else ""
    return f"{value!r} {unit}" if bare and unit else value


def _apply(tables: dict[str, Any], changes: Changes) -> None:
    for key, value in changes.items():
        parts = split(key)
        if len(parts) == 2 and parts[0] == "motor" and parts[1] in MAGNET and "motor" in tables:
            for other in MAGNET - {str(parts[1])}:
                tables["motor"].pop(other, None)
        put(tables, key, value)


def _check_names(path: Path, tables: dict[str, Any], changes: Changes) -> None:
    """A change of a value must not make a controller or scenario; only one of all its values may."""
    for table, needed in (("controller", "law"), ("scenario", "duration")):
        known = tables.get(table)
        for key, value in changes.items():
            parts = split(key)
            if not isinstance(known, dict) or parts[0] != table or len(parts) < 3 or parts[1] in known:
                continue
            if f"{table}.{parts[1]}.{needed}" not in changes:
                expected = f"expected a {table} of {', '.join(known)}"
                raise StudyError(f"{path}: {key}: {shown(value)}: {expected}")


def _with_datasheet(path: Path, tables: dict[str, Any]) -> Source:
    motor = tables.get("motor")
    if not isinstance(motor, dict) or not isinstance(motor.get("datasheet"), str):
        return Source(path, tables)
    where = f"{path}: motor.datasheet: "
    sheet = find(motor["datasheet"], "motors", "datasheet", path.parent, where)
    fields = read(sheet)
    if MAGNET & motor.keys():
        fields = {key: value for key, value in fields.items() if key not in MAGNET}
    return Source(path, {**tables, "motor": {**fields, **motor}}, sheet, frozenset(motor))


def _replaced(source: Source, tables: dict[str, Any]) -> Source:
    return Source(source.path, tables, source.datasheet, source.own_motor_keys)


def _checked(source: Source) -> AnyStudy:
    if is_trial_study(source.tables):
        trials = _validated(TrialStudy, source)
        trials._hardware = {name: _hardware(trials, name) for name in trials.scenario}
        return trials
    study = _validated(Study, source)
    for scenario in study.scenario:
        for_scenario(study, scenario)
    return study


def _hardware(study: TrialStudy, scenario: str) -> tuple[Hardware, ...]:
    """A drive's motor, mechanics and load in each phase, checked; none of a linear plant."""
    found: list[Hardware] = []
    for index, (_, here) in enumerate(study.scenario[scenario].phases if study.plant is None else ()):
        tables = copy.deepcopy(study.source.tables)
        _apply(tables, here.override or {})
        at = f".changes.{index - 1}" if index else ""
        source, prefix = _replaced(study.source, tables), f"scenario.{scenario}{at}.override: "
        motor = _part(Motor, "motor", source, prefix)
        mechanics = _part(Mechanics, "mechanics", source, prefix)
        found.append(Hardware(motor, mechanics, here.load or mechanics.load))
    return tuple(found)


def _part(model: type[Model], key: str, source: Source, prefix: str) -> Model:
    try:
        return model.model_validate(source.tables[key])
    except ValidationError as error:
        found = [replace(p, key=(key, *p.key)) for p in problems(error, source.tables[key])]
        raise _error(found, source, prefix) from None


def _validated(model: type[AStudy], source: Source, prefix: str = "") -> AStudy:
    try:
        context = {"folder": source.path.parent, "one_scenario": bool(prefix)}
        study = model.model_validate(source.tables, context=context)
    except ValidationError as error:
        raise _error(problems(error, source.tables), source, prefix) from None
    study._source = source
    return study


def _error(found: list[Problem], source: Source, prefix: str) -> StudyError:
    key = found[0].key
    in_datasheet = source.datasheet and not prefix and key[:1] == ("motor",) and len(key) > 1
    if in_datasheet and source.datasheet and key[1] not in source.own_motor_keys:
        inner = Problem(key[1:], found[0].value, found[0].expected)
        return study_error([inner, *found[1:]], source.datasheet)
    return study_error(found, source.path, prefix)


def changes_from(texts: Iterable[str]) -> dict[str, Any]:
    """All `--set KEY=VALUE` of a command line; a later one wins."""
    return dict(parse_change(text) for text in texts)
