"""Tables of the docs that are made from the code, so that they are always up to date.

`study-table`: the keys of one table of a study, the required ones first, from its model (meanings.py). There
is a warning, which `make docs` treats as an error, for a key without a meaning, and for a model without a
directive. With `:shared:` the keys are those of a base of several models, and their tables refer to it.

    ```{study-table} drive.Rates
    :at: drive.rates
    ```

`command`: arguments and options of a command. `metric-signals`, `trial-signals`: every signal with its unit.
`learning-factor`: the table of docs/learning_factor.py. On the pages guide/metrics and guide/trial-studies,
each kind of metric must have a heading, and nothing else may have such a heading.
"""

from __future__ import annotations

import importlib
import re
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin

from docutils import nodes
from docutils.parsers.rst import Directive, directives
from docutils.statemachine import StringList
from meanings import meanings, owner
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from sphinx.util import logging

from cogless.study.speed_study import Study
from cogless.study.table import Quantity, Table
from cogless.study.trial_study import TrialStudy

# The note on a page that its tables are missing on GitHub.
UNBUILT = re.compile(r"^\*Without `make docs`.*?\*\n\n", re.MULTILINE | re.DOTALL)
OWN_LAWS = "cogless.study.laws.own"
log = logging.getLogger(__name__)


def models_of(model: type[Table]) -> set[type[Table]]:
    """A model and every model used in its fields, at any depth."""
    found: set[type[Table]] = set()

    def visit(entry: Any) -> None:
        if isinstance(entry, type) and issubclass(entry, Table):
            if entry not in found:
                found.add(entry)
                for field in entry.model_fields.values():
                    visit(field.annotation)
        else:
            for inner in get_args(entry):
                visit(inner)

    visit(model)
    return found


def bounds(metadata: list[Any]) -> str:
    """The limits of a number as text, such as ", 4 to 65535" or ", above 0"."""
    limits = {
        name: getattr(m, name) for m in metadata for name in ("gt", "ge", "lt", "le") if hasattr(m, name)
    }
    if "ge" in limits and "le" in limits:
        return f", {limits['ge']} to {limits['le']}"
    if "gt" in limits and "le" in limits:
        return f", above {limits['gt']} to {limits['le']}"
    words = {"gt": "above", "ge": "from", "lt": "below", "le": "to"}
    return "".join(f", {words[name]} {value}" for name, value in limits.items())


def kind(annotation: Any, metadata: list[Any] = ()) -> str:  # type: ignore[assignment]
    """How a value of this type is written: text with a quantity's unit, choices, or a plain type."""
    for entry in metadata:
        if isinstance(entry, Quantity):
            unit = entry.dimension.unit.replace("*", "·").replace("^2", "²")
            sign = {"": "", ">": ", above 0", ">=": ", from 0"}[entry.sign]
            return f"text in {unit}{sign}" if unit else f"number{sign}"
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return kind(inner[0], list(inner[1:]))
    if origin in (Union, UnionType):
        kinds = [kind(part, metadata) for part in inner if part is not NoneType]
        return " or ".join(dict.fromkeys(kinds))
    if origin is Literal:
        return ", ".join(f'`"{choice}"`' if isinstance(choice, str) else f"`{choice}`" for choice in inner)
    if origin is tuple:
        if len(inner) == 2 and inner[1] is Ellipsis:
            return f"array of: {kind(inner[0])}"
        first = kind(inner[0])
        same = all(kind(part) == first for part in inner)
        return f"array of {len(inner)}: " + (first if same else ", ".join(kind(part) for part in inner))
    if origin is dict:
        return f"table of: {kind(inner[1])}" if inner[1] is not Any else "table"
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return f"[{annotation.__name__}](#{anchor(annotation)})"
    plain = {str: "text", int: "whole number", float: "number", bool: "`true`, `false`"}.get(
        annotation, "any"
    )
    return plain + bounds(list(metadata))


def full_name(model: type[Table]) -> str:
    """A model's name in a `study-table`, with its module: two modules may have a table of the same name."""
    return f"{model.__module__.removeprefix('cogless.study.')}.{model.__name__}"


def anchor(model: type[Table]) -> str:
    return f"study-{full_name(model).lower().replace('.', '-').replace('_', '-')}"


def default(field: FieldInfo) -> str:
    """The default as it is written in TOML; for a quantity in SI units."""
    if field.is_required() or field.default is PydanticUndefined:
        return "required"
    value = field.default
    if isinstance(value, Table):
        return "its defaults"
    if value is None or value == {} or value == ():
        return ""
    unit = next((m.dimension.unit for m in field.metadata if isinstance(m, Quantity)), "")
    text = {True: "true", False: "false"}.get(value, value) if isinstance(value, bool) else value
    if isinstance(value, float):
        text = f"{value:.12g}"
    if isinstance(value, tuple):
        text = "[" + ", ".join(f"{v:g}" for v in value) + "]"
    return f'`"{text}"`' if isinstance(value, str) else f"`{text}`" + (f" {unit}" if unit else "")


class Parsed(Directive):
    """A directive whose content is generated as Markdown and then parsed."""

    def parse(self, lines: list[str]) -> list[nodes.Node]:
        node = nodes.container()
        self.state.nested_parse(
            StringList(lines, source=self.state.document.current_source), self.content_offset, node
        )
        return node.children


class StudyTable(Parsed):
    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {"at": directives.unchanged, "shared": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        module, _, name = self.arguments[0].rpartition(".")
        model = getattr(importlib.import_module(f"cogless.study.{module}"), name)
        env = self.state.document.settings.env
        env.cogless_documented = env.cogless_documented | {full_name(model)}
        shared: dict[type[Table], str] = env.cogless_shared
        texts = meanings(model)
        for key in (key for key, text in texts.items() if not text):
            log.warning("%s: the key %s has no meaning", self.arguments[0], key)
        own = {k: f for k, f in model.model_fields.items() if owner(model, k) not in shared}
        place = f"Keys of {self.options['shared']}:" if "shared" in self.options else ""
        if "at" in self.options:
            place = f"In `{self.options['at']}`:"
        lines = [f"({anchor(model)})=", "", place, ""]
        lines += ["| key | value | default | meaning |", "| --- | --- | --- | --- |"]
        for key, field in sorted(own.items(), key=lambda item: not item[1].is_required()):
            value = kind(field.annotation, field.metadata)
            lines.append(f"| `{key}` | {value} | {default(field)} | {texts[key]} |")
        bases = dict.fromkeys(owner(model, key) for key in model.model_fields if key not in own)
        if bases:
            links = ", ".join(f"[{shared[base]}](#{anchor(base)})" for base in bases)
            lines += ["", f"It also has the keys of {links}."]
        if "shared" in self.options:
            shared[model] = self.options["shared"]
        parts = self.parse(lines)
        for table in (table for part in parts for table in part.findall(nodes.table)):
            table["classes"].append("keys")  # on a phone each row is a block: docs.css
        return parts


class Command(Parsed):
    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        import typer.main

        from cogless.cli import app

        commands = typer.main.get_command(app)
        command = commands.commands[self.arguments[0]]  # type: ignore[attr-defined]
        words = [p.metavar or p.name.upper() for p in command.params if p.param_type_name == "argument"]
        lines = [f"    cogless {' '.join([self.arguments[0], '[OPTIONS]', *words])}", ""]
        lines += ["| option | meaning | default |", "| --- | --- | --- |"]
        for p in command.params:
            if p.param_type_name != "option" or "--help" in p.opts:
                continue
            value = "" if getattr(p, "is_flag", False) else f" {p.metavar or p.name.upper()}"
            names = ", ".join(f"`{name}{value}`" for name in sorted(p.opts, key=len))
            shown = getattr(p, "show_default", None)
            lines.append(f"| {names} | {p.help} | {shown if isinstance(shown, str) else ''} |")
        return self.parse([*lines, ""])


class LearningFactor(Parsed):
    """Arguments: STUDY CONTROLLER "SPEED" ORDERS, as for docs/learning_factor.py."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        import shlex

        import learning_factor

        command = f"python docs/learning_factor.py {self.arguments[0]}"
        return self.parse(
            [f"    {command}", "", *learning_factor.from_arguments(shlex.split(self.arguments[0]))]
        )


class MetricSignals(Parsed):
    def run(self) -> list[nodes.Node]:
        from cogless.control_library import C_LAWS
        from cogless.signals import DERIVED
        from cogless.study.metric import SIGNAL_DIMENSIONS

        laws = {"python": (), "library": ()} | {law.name: law.terms for law in C_LAWS.values()}
        terms = {term.signal for law in C_LAWS.values() for term in law.terms}
        by_unit: dict[str, list[str]] = {}
        for name, dimension in SIGNAL_DIMENSIONS.items():
            if name not in terms:
                mark = f"`{name}`" + ("\\*" if name in DERIVED else "")
                by_unit.setdefault(dimension.unit or "bits", []).append(mark)
        lines = ["| unit | signals |", "| --- | --- |"]
        lines += [f"| {unit.replace('*', '·')} | {', '.join(names)} |" for unit, names in by_unit.items()]
        lines += ["", "| law | terms, A |", "| --- | --- |"]
        for law, parts in laws.items():
            names = [f"`{term.signal}`" + (f" ({term.unit})" if term.unit != "A" else "") for term in parts]
            lines.append(f"| `{law}` | {', '.join(names) or 'none'} |")
        return self.parse(lines)


class TrialSignals(Parsed):
    def run(self) -> list[nodes.Node]:
        from cogless.signals import DERIVED, dimensions
        from cogless.study.linear_plant import linear_signals

        ideal, laws = ("trials", "trial_law"), ["trial"]
        by_unit: dict[str, list[str]] = {}
        for name, dimension in dimensions((*ideal, "electrical", "three_phases"), laws).items():
            dagger = "" if name in dimensions(ideal, laws) else "†"
            mark = f"`{name}`" + ("\\*" if name in DERIVED else "") + dagger
            by_unit.setdefault(dimension.unit or "bits", []).append(mark)
        lines = ["| of a drive, unit | signals |", "| --- | --- |"]
        lines += [f"| {unit.replace('*', '·')} | {', '.join(names)} |" for unit, names in by_unit.items()]
        plain = [f"`{name}`" + ("\\*" if name in DERIVED else "") for name in linear_signals(0)]
        lines += ["", "| of a linear plant |", "| --- |", f"| {', '.join(plain)}, `x_1`, `x_2`, ... |"]
        return self.parse(lines)


def check(app: Any, env: Any) -> None:
    """Warns of models without a study-table, and of kinds of metric and headings that don't match."""
    from cogless.results.metrics import METRIC_FUNCTIONS
    from cogless.study.metric import EACH_PHASE, EACH_TRIAL

    wanted = {full_name(model) for kind in (Study, TrialStudy) for model in models_of(kind)}
    for name in sorted(wanted - getattr(env, "cogless_documented", set())):
        log.warning("guide: no study-table for the model %s", name)
    of_trials = {*EACH_TRIAL, *EACH_PHASE}
    for page, kinds in (("metrics", METRIC_FUNCTIONS.keys() - EACH_PHASE), ("trial-studies", of_trials)):
        text = (env.srcdir / "guide" / f"{page}.md").read_text(encoding="utf-8")
        headings = set(re.findall(r"^### `([a-z-]+)`$", text, re.MULTILINE))
        for name in sorted(kinds ^ headings):
            log.warning(
                "guide/%s: %s is %s", page, name, "not told" if name in kinds else "no kind of metric"
            )


def other_laws(app: Any, page: str, source: list[str]) -> None:
    """Write the laws that a page does not name where it leaves room; remove its note on missing tables.

    Such room is a line `laws/{others}` in a list of pages, and `{other-laws}` among the keys of controllers.
    """
    from cogless.study.laws import AnyController, law_name

    models = {law_name(model): model for model in get_args(AnyController) if model.__module__ != OWN_LAWS}
    text = UNBUILT.sub("", source[0])
    paths = "".join(f"laws/{name}\n" for name in models if f"\nlaws/{name}\n" not in text)
    tables = "\n\n".join(
        f"## {name}\n\n[The law](../laws/{name}.md).\n\n"
        f'```{{study-table}} {full_name(model)}\n:at: controller.NAME, law = "{name}"\n```'
        for name, model in models.items()
        if full_name(model) not in text
    )
    source[0] = text.replace("laws/{others}\n", paths).replace("{other-laws}", tables)


def forget(app: Any, env: Any, added: set[str], changed: set[str], removed: set[str]) -> list[str]:
    """Pages that Sphinx has to build again each time: they depend on code, which Sphinx does not watch."""
    env.cogless_documented, env.cogless_shared = set(), {}
    pages = ("guide/trial-studies", "guide/command-line", "guide/metrics", "theory/learning")
    return [page for page in sorted(env.found_docs) if page in pages or page.startswith("reference/")]


def setup(app: Any) -> dict[str, Any]:
    app.add_directive("study-table", StudyTable)
    app.add_directive("command", Command)
    app.add_directive("metric-signals", MetricSignals)
    app.add_directive("trial-signals", TrialSignals)
    app.add_directive("learning-factor", LearningFactor)
    app.connect("source-read", other_laws)
    app.connect("env-get-outdated", forget)
    app.connect("env-check-consistency", check)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
