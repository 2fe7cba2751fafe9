"""Find and read a study, by file or shipped name, with its datasheet, changes and scenario overrides.

Of a variant of a study, only the changed parts are validated; all others are taken over. A `Remark` is a
sentence on a study, with the changes that it advises: the tests apply each change and run the study again.
"""

from __future__ import annotations

import copy
import os
import re
import tomllib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from itertools import compress
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError, create_model

from cogless import units
from cogless.errors import StudyError
from cogless.files import check_utf8, reason, shipped
from cogless.study import checks, trial_checks
from cogless.study.base import Source, StudyBase
from cogless.study.datasheet import replaced_by, replaced_by_any
from cogless.study.mechanics import Mechanics
from cogless.study.messages import MISSING, Problem, dotted, look_up, problems, study_error, toml_text
from cogless.study.motor import Motor
from cogless.study.speed_study import Study
from cogless.study.table import Key, Table, perhaps
from cogless.study.trial_study import Hardware, TrialStudy, is_trial_study

Check = Callable[[Any], None]
AStudy = TypeVar("AStudy", bound=StudyBase)


def reused(new: Any, old: Any, validated: Any) -> Any:
    """The tables `new`, with each part that is equal in `old` replaced by its model from `validated`."""
    if isinstance(validated, Table):
        if alike(new, old):
            return validated
        if isinstance(new, dict) and isinstance(old, dict):
            return {
                key: reused(value, old.get(key, MISSING), getattr(validated, key, None))
                for key, value in new.items()
            }
    elif isinstance(validated, Mapping) and isinstance(new, dict) and isinstance(old, dict):
        return {key: reused(value, old.get(key, MISSING), validated.get(key)) for key, value in new.items()}
    elif isinstance(validated, tuple) and validated and isinstance(validated[0], Table) and alike(new, old):
        return validated
    elif isinstance(validated, tuple) and isinstance(new, list) and isinstance(old, list):
        same = len(new) == len(old) == len(validated)
        return [reused(*parts) for parts in zip(new, old, validated, strict=True)] if same else new
    return new


def alike(new: Any, old: Any) -> bool:
    """Whether two values of a file are the same; 1, 1.0 and true are not."""
    if new is old:
        return True
    if type(new) is not type(old):
        return False
    if isinstance(new, dict):
        if list(new) != list(old):
            return False
        return all([value is old[key] or alike(value, old[key]) for key, value in new.items()])
    if isinstance(new, list):
        return len(new) == len(old) and all(map(alike, new, old))
    return bool(new == old)


def derived(like: AStudy, tables: dict[str, Any], checks: tuple[Check, ...], folder: Path) -> AStudy:
    """A copy of the study `like` with these tables in place of its own.

    ValueError: the tables are wrong. Validate the whole study for the error message.
    """
    before = like.source.tables
    differ = [key for key, table in tables.items() if not alike(table, before.get(key, MISSING))]
    if not before.keys() <= tables.keys():
        raise ValueError("a table is gone")
    parts = {key: _new(tables[key], before.get(key, MISSING), getattr(like, key, None)) for key in differ}
    model = _tables_model(type(like), tuple(sorted(differ)))
    validated = model.model_validate(parts, context={"folder": folder})
    updates = {key: _whole(getattr(validated, key), tables[key], getattr(like, key)) for key in differ}
    study = like.model_copy(update=updates)
    study._made = {}
    for check in checks:
        check(study)
    return study


def _new(new: Any, old: Any, validated: Any) -> Any:
    """A table with its unchanged parts reused; of all scenarios or controllers only the changed ones."""
    if isinstance(validated, Mapping) and isinstance(new, dict) and isinstance(old, dict):
        differ = [name for name in new if not alike(new[name], old.get(name, MISSING))]
        return {name: reused(new[name], old.get(name, MISSING), validated.get(name)) for name in differ}
    return reused(new, old, validated)


def _whole(validated: Any, new: Any, validated_whole: Any) -> Any:
    """Complete what `_new` left out: return all scenarios or controllers, in the order of the file."""
    if isinstance(validated_whole, Mapping) and isinstance(new, dict):
        return {name: validated[name] if name in validated else validated_whole[name] for name in new}
    return validated


@cache
def _tables_model(model: type[StudyBase], keys: tuple[str, ...]) -> type[Table]:
    """A model of some of a study's tables; ValueError: a study has no such table."""
    if not set(keys) <= model.model_fields.keys():
        raise ValueError("an unknown table")
    fields: dict[str, Any] = {
        key: (model.model_fields[key].annotation, model.model_fields[key]) for key in keys
    }
    return create_model("Part", __base__=Table, **fields)


Changes = Mapping[str, Any]
AnyStudy = Study | TrialStudy
Model = TypeVar("Model", bound=Table)
Made = TypeVar("Made")
DEPTH_MOST = 32  # levels of tables and arrays
LONGEST_NAME = 1000  # characters of a path in a message
# tomllib needs time and memory that grow with the square of the number of a key's parts.
KEY_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
LONG_KEY = re.compile(rf"""(?<![\w."'-])(?:{KEY_PART}\.[ \t]*){{{DEPTH_MOST}}}{KEY_PART}""", re.ASCII)
AT_LINE = re.compile(r"Invalid value \(at line (\d+), ")
LIST_INDEX = re.compile(r"\d{1,9}", re.ASCII)


def load(study: str | Path, changes: Changes | None = None) -> AnyStudy:
    """Read a study by path or shipped name. StudyError lists its mistakes, one per line.

    `changes` replace values by dotted key, such as {"controller.pi.kp": 0.02}. A plain number takes the unit
    of the text that it replaces.
    """
    path = find(study, "studies", "study")
    tables = read(path)
    if is_arena(tables):
        raise StudyError(f"{path}: is an arena: expected a study, since only cogless run takes an arena")
    changes = dict(changes or {})
    if "motor.datasheet" in changes:
        _apply(f"{path}: ", tables, {"motor.datasheet": changes.pop("motor.datasheet")})
    source = with_datasheet(path, tables)
    _check_names(path, source.tables, changes)
    _apply(f"{path}: ", source.tables, changes)
    return checked(_marked(_replaced(source, source.tables, changes), changes))


def changed(study: AStudy, changes: Changes) -> AStudy:
    """A copy of the study with `changes`: new values by dotted key, as in `load`.

    Only the parts of the study that the changes touch are validated again.
    """
    tables = _overridden(study.source, changes)
    of_its_kind = checked(_replaced(study.source, tables, changes), study)
    assert isinstance(of_its_kind, type(study))
    return of_its_kind


def with_tables(study: AStudy, tables: dict[str, Any]) -> AStudy:
    """A study of the same kind and source with other tables."""
    of_its_kind = checked(replace(study.source, tables=tables))
    assert isinstance(of_its_kind, type(study))
    return of_its_kind


def for_scenario(study: Study, scenario: str) -> Study:
    """The study with a scenario's overrides applied and without the other scenarios.

    If the scenario has no overrides, the function returns the study itself.
    """
    return study.in_scenario(scenario)


def _in_scenario(study: Study, like: Study | None, scenario: str) -> Study:
    experiment = study.scenario[scenario]
    if not experiment.override:
        return study
    prefix = f"scenario.{scenario}.override: "
    tables = _overridden(study.source, experiment.override, prefix)
    tables["scenario"] = {scenario: tables["scenario"][scenario]}
    taken = [metric.applies_in(scenario, experiment) for metric in study.metric]
    tables["metric"] = [
        {key: value for key, value in metric.items() if key != "scenarios"}
        if "scenarios" in metric
        else metric
        for metric in compress(tables.get("metric", []), taken)
    ]
    tables.pop("calibration", None)
    before = None if like is None else like._scenarios.get(scenario)
    return _validated(Study, _marked(_replaced(study.source, tables), experiment.override), prefix, before)


def parse_change(text: str) -> tuple[str, Any]:
    """Key and value of the text KEY=VALUE of a `--set` option; a VALUE that isn't valid TOML is a string.

    An empty VALUE becomes None, which deletes the key.
    """
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise StudyError(f"--set: {toml_text(text)}: expected KEY=VALUE, such as controller.pi.kp=0.02")
    if not text.isprintable() and any("\ud800" <= character <= "\udfff" for character in text):
        raise StudyError(f"--set: {toml_text(text)}: expected UTF-8")
    if not value.strip():
        return key.strip(), None
    try:
        parsed = _toml(f"value = {value}")
    except ValueError:
        parsed = {}
    return key.strip(), parsed["value"] if len(parsed) == 1 else value.strip()


def find(name: str | Path, room: str, what: str, folder: Path | None = None, where: str = "") -> Path:
    """Find a file by shipped name, or by path relative to the folder `folder`.

    `room`: folder of shipped files. `what`: kind of file. `where`: file and key that name it, for messages.
    """
    shipped_files = shipped(room)
    if str(name) in shipped_files:
        return shipped_files[str(name)]
    path = (folder or Path()) / name
    check_utf8(path, f"a {what} file")
    plain = not where and 0 < len(str(name)) <= LONGEST_NAME
    named = f"{where}{name if plain else toml_text(str(name))}: "
    with suppress(OSError):  # a name that is too long
        if path.is_file():
            return path
        if path.name and (named_file := path.with_name(f"{path.name}.toml")).is_file():
            return named_file
        if path.is_dir():
            raise StudyError(f"{named}is a directory: expected a {what} file")
    expected = f"expected a file, or one of the shipped {room}: {', '.join(shipped_files) or 'none'}"
    raise StudyError(
        f"{named}no such {what}: {expected}{perhaps(path.name, [*shipped_files, *_beside_it(path)])}"
    )


def _beside_it(path: Path) -> list[str]:
    """The names of TOML files in a path's folder."""
    try:
        return sorted(file.name for file in path.parent.glob("*.toml"))
    except OSError:
        return []


def read(path: Path) -> dict[str, Any]:
    """Read the tables of a TOML file."""
    try:
        return _toml(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as error:
        encoding = "UTF-16" if error.object[:2] in (BOM_UTF16_LE, BOM_UTF16_BE) else "not UTF-8"
        raise StudyError(f"{path}: {encoding}: expected a TOML file in UTF-8") from None
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected a readable TOML file") from None
    except ValueError as error:
        raise StudyError(f"{path}: not readable as TOML: {error}") from None


def _toml(text: str) -> dict[str, Any]:
    """Parse a TOML text to tables; ValueError says in one line why it can't be read."""
    too_deep = f"expected at most {DEPTH_MOST} levels of tables and arrays"
    long = LONG_KEY.search(text)
    if long:
        line = text.count("\n", 0, long.start()) + 1
        raise ValueError(f"expected keys of at most {DEPTH_MOST} parts (at line {line})")
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{error}{_unquoted(text, str(error))}") from None
    except RecursionError:
        raise ValueError(too_deep) from None
    level: list[Any] = [tables]
    for _ in range(DEPTH_MOST + 1):
        level = [inner for outer in level for inner in (outer.values() if isinstance(outer, dict) else outer)]
        level = [inner for inner in level if isinstance(inner, dict | list)]
    if level:
        raise ValueError(too_deep)
    return tables


def _unquoted(text: str, message: str) -> str:
    """The end of a message on a value that isn't TOML: the line, and the usual mistake."""
    place = AT_LINE.match(message)
    if place is None:
        return ""
    line = text.splitlines()[int(place.group(1)) - 1].strip()
    return f": {toml_text(line)}: expected a text in quotes, or a number without a unit"


def put(tables: dict[str, Any], key: str, value: Any) -> None:
    """Set the value at a dotted key, and create missing tables on the way; None deletes the key.

    A plain number takes the unit of the text that it replaces.
    """
    path = split(key)
    if value is None:
        _delete(tables, path)
        return
    inner: Any = tables
    for depth, part in enumerate(path[:-1]):
        value_there = look_up(inner, (part,))
        if value_there is MISSING and isinstance(inner, dict):
            value_there = inner[str(part)] = {}
        elif isinstance(value_there, str):
            # A short form such as reference = "60 rpm" is a text, which has no keys.
            raise StudyError(
                f"{key}: {toml_text(value)}: expected a table at {dotted(path[: depth + 1])}, not a text"
            )
        elif isinstance(inner, list) and value_there is MISSING:
            raise StudyError(f"{key}: {toml_text(value)}: {_index_hint(inner, path[:depth])}")
        inner = value_there
    last = path[-1]
    old = look_up(inner, (last,))
    if isinstance(inner, dict):
        inner[str(last)] = with_unit(value, old)
    elif old is not MISSING:
        inner[last] = with_unit(value, old)
    elif isinstance(inner, list):
        raise StudyError(f"{key}: {toml_text(value)}: {_index_hint(inner, path[:-1])}")
    else:
        raise StudyError(f"{key}: {toml_text(value)}: expected a key of the study")


def _delete(tables: dict[str, Any], path: Key) -> None:
    inner, last = look_up(tables, path[:-1]), path[-1]
    if look_up(inner, (last,)) is not MISSING:
        del inner[str(last) if isinstance(inner, dict) else last]


def _index_hint(array: list[Any], key: Key) -> str:
    """The indices that an array has, as text for a message about a wrong index."""
    last = f" to {len(array) - 1}" if len(array) > 1 else ""
    return f"expected an index of {dotted(key)}, 0{last}" if array else f"{dotted(key)} is empty"


@lru_cache(maxsize=1024)
def split(key: str) -> Key:
    """Parts of a dotted key. Whole numbers become list indices; a part with dots is in double quotes."""
    parts: list[str | int] = []
    for index, piece in enumerate(key.split('"')):
        if index % 2:
            parts.append(piece)
        else:
            parts += [int(part) if LIST_INDEX.fullmatch(part) else part for part in piece.split(".") if part]
    if not parts:
        raise StudyError(f"{toml_text(key)}: expected a dotted key, such as controller.pi.kp")
    if len(parts) > DEPTH_MOST:
        raise StudyError(f"{toml_text(key)}: expected a key of at most {DEPTH_MOST} parts")
    return tuple(parts)


def with_unit(value: Any, old: Any) -> Any:
    """The new value; a plain number becomes a text with the unit of the text that it replaces."""
    if isinstance(value, list) and isinstance(old, list) and old:
        return [with_unit(item, old[min(index, len(old) - 1)]) for index, item in enumerate(value)]
    bare = isinstance(value, int | float) and not isinstance(value, bool)
    unit = units.unit_of(old) if isinstance(old, str) else ""
    return f"{value!r} {unit}" if bare and unit else value


def _apply(where: str, tables: dict[str, Any], changes: Changes) -> None:
    """Change values. `where`: the file and the place that an error names."""
    for key, value in changes.items():
        parts = split(key)
        _own(tables, parts[:-1])
        motor = tables.get("motor")
        if len(parts) == 2 and parts[0] == "motor" and isinstance(motor, dict) and value is not None:
            for other in replaced_by(str(parts[1])):
                motor.pop(other, None)
        try:
            put(tables, key, value)
        except StudyError as error:
            raise StudyError(f"{where}{error}") from None


def _own(tables: dict[str, Any], path: Key) -> None:
    """Replace tables and arrays on the way to a key by copies; the originals may be another study's."""
    inner: Any = tables
    for part in path:
        value_there = look_up(inner, (part,))
        if not isinstance(value_there, dict | list):
            return
        place = str(part) if isinstance(inner, dict) else part
        inner[place] = copy.copy(value_there)
        inner = inner[place]


def _overridden(source: Source, changes: Changes, prefix: str = "") -> dict[str, Any]:
    """A copy of a study's tables with `changes`. `prefix`: the changes' place in the file, for messages."""
    tables = dict(source.tables)
    _apply(f"{source.path}: {prefix}", tables, changes)
    return tables


def _check_names(path: Path, tables: dict[str, Any], changes: Changes) -> None:
    """Refuse a change to an unknown controller or scenario, unless the changes define it as a whole."""
    for table, needed in (("controller", "law"), ("scenario", "duration")):
        defined = tables.get(table)
        for key, value in changes.items():
            parts = split(key)
            if (
                not isinstance(defined, dict)
                or parts[0] != table
                or len(parts) < 3
                or str(parts[1]) in defined
            ):
                continue
            if f"{table}.{parts[1]}.{needed}" not in changes:
                expected = (
                    f"expected one of the {table}s {', '.join(defined)}{perhaps(str(parts[1]), defined)}"
                )
                raise StudyError(f"{path}: {key}: {toml_text(value)}: {expected}")


def with_datasheet(path: Path, tables: dict[str, Any]) -> Source:
    motor = tables.get("motor")
    if not isinstance(motor, dict) or not isinstance(motor.get("datasheet"), str):
        return Source(path, tables, directory=path.parent.absolute())
    where = f"{path}: motor.datasheet: "
    sheet = find(motor["datasheet"], "motors", "datasheet", path.parent, where)
    fields = read(sheet)
    said_here = replaced_by_any(motor)
    fields = {
        key: _relative_to_study(sheet, path, value) for key, value in fields.items() if key not in said_here
    }
    tables = {**tables, "motor": {**fields, **motor}}
    return Source(path, tables, sheet, frozenset(motor), path.parent.absolute())


def _relative_to_study(sheet: Path, study: Path, value: Any) -> Any:
    """A datasheet's value, with files that are named relative to the study and not to the datasheet."""
    if not isinstance(value, dict):
        return value
    value = {key: _relative_to_study(sheet, study, inner) for key, inner in value.items()}
    if isinstance(value.get("file"), str):
        value["file"] = os.path.relpath(sheet.parent / value["file"], study.parent)
    return value


def _replaced(source: Source, tables: dict[str, Any], changes: Iterable[str] = ()) -> Source:
    """The source with other tables. Motor keys in `changes` no longer count as keys of the datasheet."""
    in_motor = [tuple(map(str, key[1:2])) for key in map(split, changes) if key[0] == "motor"]
    datasheet = None if () in in_motor else source.datasheet
    own = source.own_motor_keys.union(*in_motor)
    return replace(source, tables=tables, datasheet=datasheet, own_motor_keys=own)


def _marked(source: Source, changes: Changes) -> Source:
    """The source, which says which keys were changed, for messages."""
    return replace(source, changes=frozenset(map(split, changes)))


def checked(source: Source, like: StudyBase | None = None) -> AnyStudy:
    """The study of these tables, validated; StudyError lists its mistakes, one per line.

    `like`: a study with mostly the same tables; its unchanged parts are taken over.
    """
    if is_trial_study(source.tables):
        trials = _validated(TrialStudy, source)
        trials._hardware = _of_each(trials.scenario, partial(_hardware, trials))
        return trials
    before = like if isinstance(like, Study) else None
    study = _validated(Study, source, like=before)
    study._scenarios = _of_each(study.scenario, partial(_in_scenario, study, before))
    return study


def speed_study(study: AnyStudy, refusal: str = "") -> Study:
    """Return the study as a study of speed. StudyError with the text `refusal`: it is a study of trials."""
    if isinstance(study, Study):
        return study
    raise StudyError(refusal or f"{study.source.path}: expected a study of speed")


def trial_study(study: AnyStudy, refusal: str) -> TrialStudy:
    """Return the study as a study of trials. StudyError with the text `refusal`: it is a study of speed."""
    if isinstance(study, TrialStudy):
        return study
    raise StudyError(refusal)


def _of_each(scenarios: Iterable[str], make: Callable[[str], Made]) -> dict[str, Made]:
    """Call `make` for each scenario; a single StudyError lists the mistakes of all scenarios."""
    by_scenario: dict[str, Made] = {}
    lines: list[str] = []
    for name in scenarios:
        try:
            by_scenario[name] = make(name)
        except StudyError as error:
            lines += error.mistakes
    if lines:
        raise study_error(lines)
    return by_scenario


def _hardware(study: TrialStudy, scenario: str) -> tuple[Hardware, ...]:
    """Motor, mechanics and load of a drive in each phase, checked; empty for a linear plant."""
    of_phases: list[Hardware] = []
    for index, (_, conditions) in enumerate(study.scenario[scenario].phases if study.plant is None else ()):
        at = f".changes.{index - 1}" if index else ""
        prefix = f"scenario.{scenario}{at}.override: "
        source = _replaced(study.source, _overridden(study.source, conditions.override or {}, prefix))
        motor = _part(Motor, "motor", source, prefix)
        mechanics = _part(Mechanics, "mechanics", source, prefix)
        of_phases.append(Hardware(motor, mechanics, conditions.load or mechanics.load))
    return tuple(of_phases)


def _part(model: type[Model], key: str, source: Source, prefix: str) -> Model:
    try:
        return model.model_validate(source.tables[key], context={"folder": source.folder})
    except ValidationError as error:
        mistakes = [replace(p, key=(key, *p.key)) for p in problems(error, source.tables[key])]
        raise _error(mistakes, source, prefix) from None


def _validated(model: type[AStudy], source: Source, prefix: str = "", like: AStudy | None = None) -> AStudy:
    tables, folder, checks = source.tables, source.folder, _checks(model, bool(prefix))
    if like is not None:
        with suppress(ValueError):  # validation of the whole study, below, raises the error with its message
            study = derived(like, tables, checks, folder)
            study._source = source
            return study
    try:
        study = model.model_validate(tables, context={"folder": folder, "checks": checks})
    except ValidationError as error:
        raise _error(problems(error, source.tables), source, prefix) from None
    study._source = source
    return study


def _checks(model: type[Table], one_scenario: bool) -> tuple[Callable[[Any], None], ...]:
    if model is TrialStudy:
        return trial_checks.TRIAL_CHECKS
    return checks.SPEED_CHECKS if one_scenario else (*checks.SPEED_CHECKS, *checks.WHOLE)


def _error(mistakes: list[Problem], source: Source, prefix: str) -> StudyError:
    return study_error([_line(problem, source, prefix) for problem in mistakes])


def _line(problem: Problem, source: Source, prefix: str) -> str:
    """Message about a mistake, with the file that has it: the study or its datasheet."""
    key = problem.key
    in_datasheet = source.datasheet and not prefix and key[:1] == ("motor",) and len(key) > 1
    if in_datasheet and source.datasheet and key[1] not in source.own_motor_keys:
        return replace(problem, key=key[1:]).line(source.datasheet)
    return problem.line(source.path, prefix) + _origins(problem, source, prefix)


def _origins(problem: Problem, source: Source, prefix: str) -> str:
    """Where a key and the key that excludes it come from, and how to delete the file's; "" if alike."""
    key, by = problem.key, problem.by
    if by is None or look_up(source.tables, by) is MISSING:
        return ""
    of_key, of_other = (_is_changed(source, path) for path in (key, by))
    if of_key == of_other:
        return ""
    change = "the override" if prefix else "--set"
    own, other = (change if changed else "the file" for changed in (of_key, of_other))
    origins = f"; {key[-1]} is from {own}, {by[-1]} from {other}"
    if of_key and not problem.either:
        return origins
    of_file = by if of_key else key
    if prefix:
        return f"{origins}: write all of table {dotted(of_file[:-1])} except {of_file[-1]} into the override"
    return f"{origins}: add --set {dotted(of_file)}= to delete {of_file[-1]}"


def _is_changed(source: Source, key: Key) -> bool:
    """Whether `--set`, or a scenario's override, gave the value at a key, or a table around or within it."""
    path = tuple(map(str, key))
    changes = (tuple(map(str, change)) for change in source.changes)
    return any(change[: len(path)] == path[: len(change)] for change in changes)


def changes_from(texts: Iterable[str]) -> dict[str, Any]:
    """All `--set KEY=VALUE` options of a command line as a dict; of equal keys the last counts."""
    return dict(parse_change(text) for text in texts)


def check_deletions(study: str | Path, changes: Changes) -> list[str]:
    """The keys that `--set KEY=` deletes; StudyError: the study or its datasheet has no such key."""
    deleted = [key for key, value in changes.items() if value is None]
    path = find(study, "studies", "study")
    tables = with_datasheet(path, read(path)).tables if deleted else {}
    for key in deleted:
        if look_up(tables, split(key)) is MISSING:
            raise StudyError(
                f"{path}: {key}: missing: expected a key of the file, since --set {key}= deletes it"
            )
    return deleted


def is_arena(tables: dict[str, Any]) -> bool:
    """Whether a file's tables describe an arena rather than a study."""
    plants = tables.get("plant")
    return "law" in tables and isinstance(plants, dict) and "motor" not in tables


@dataclass(frozen=True)
class Stop:
    """What a remark's text says of a rotor that stops: `claim`, and at the end `remedy`, which may be ""."""

    scenario: str
    claim: str
    remedy: str = ""


@dataclass(frozen=True)
class Remark:
    """One line on a study, which begins with the key that the line is about."""

    text: str
    cures: tuple[Changes, ...] = ()  # advised changes: values by dotted key; each change helps by itself
    stop: Stop | None = None  # for a remark that a rotor stops

    def __str__(self) -> str:
        return self.text

    def with_key(self, key: str) -> Remark:
        """The same remark with a key in front."""
        return replace(self, text=f"{key}: {self.text}")

    def cured(self, study: AStudy) -> Iterator[AStudy]:
        """The study with one advised change at a time. StudyError: the study refuses the change."""
        return (changed(study, cure) for cure in self.cures)
