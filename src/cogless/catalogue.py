"""Catalogue for `cogless list`: shipped studies and motors, and the laws that a controller can have."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from pathlib import Path

from cogless.files import shipped
from cogless.lines import print_text

OF_LAWS = re.compile(r"law: Literal|AnyController")
LAW = re.compile(r"law: Literal\['(.+?)'\]")


def catalogue() -> dict[str, dict[str, str]]:
    """Entries of the catalogue: heading -> name -> description in one line."""
    laws, unions = _models()
    return {
        "Studies": {name: _title(path) for name, path in shipped("studies").items()},
        "Motors": {name: _first_comment(path) for name, path in shipped("motors").items()},
        "Control laws": dict(laws[model] for model in unions["AnyController"]),
        "Control laws of trials": dict(laws[model] for model in unions["AnyTrialController"]),
    }


def show() -> None:
    """Print the catalogue."""
    bold, plain = ("\033[1m", "\033[0m") if sys.stdout.isatty() else ("", "")
    for heading, entries in catalogue().items():
        print(f"{bold}{heading}{plain}")
        width = max((len(name) for name in entries), default=0)
        for name, description in entries.items():
            print_text(f"{name:<{width}}  {description}", "  ", " " * (width + 4))


def _models() -> tuple[dict[str, tuple[str, str]], dict[str, list[str]]]:
    """Laws: model -> name and description; and the models of each union of laws, in its order.

    Read from the source: importing the models takes longer than all else that the command does.
    """
    laws: dict[str, tuple[str, str]] = {}
    unions: dict[str, list[str]] = {}
    for path in (Path(__file__).parent / "study" / "laws").glob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.parse(text).body if OF_LAWS.search(text) else ():
            source = ast.unparse(node)
            law = LAW.search(source)
            if isinstance(node, ast.ClassDef) and law:
                laws[node.name] = (law[1], _first_line(ast.get_docstring(node) or ""))
            elif isinstance(node, ast.Assign):
                name, *members = re.findall(r"\w+", source)
                unions[name] = members
    return laws, unions


def _title(path: Path) -> str:
    return str(tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""))


def _first_comment(path: Path) -> str:
    first = _first_line(path.read_text(encoding="utf-8"))
    return first.lstrip("# ").rstrip() if first.startswith("#") else ""


def _first_line(text: str) -> str:
    return text.partition("\n")[0]
