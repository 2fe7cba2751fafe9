"""Sphinx configuration: `make docs` builds this folder into docs/_build."""

import re
import sys
from pathlib import Path

from sphinx.util import logging

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "_ext")]

project = "cogless"
author = "the cogless authors"
html_title = "cogless"

extensions = ["myst_parser", "sphinx.ext.autodoc", "mathml", "from_code", "figures", "blocks", "playground"]
html_math_renderer = "mathml"
exclude_patterns = ["_build"]

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["docs.css"]
myst_enable_extensions = ["dollarmath", "smartquotes"]
myst_heading_anchors = 3

default_role = "code"  # docstrings
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_inherit_docstrings = False


def read(app, page, template, context, doctree):
    """Warn where TeX stands in a page as it was written: a line of it that begins with "- " is a list's."""
    shown = re.sub(r"<(pre|code|math|script)\b.*?</\1>", "", context.get("body", ""), flags=re.DOTALL)
    if found := re.search(r".{0,40}(?:\$\\|\\[a-z]+[{_^ )]).{0,20}", shown):
        logging.getLogger(__name__).warning("TeX that was not read: %s", found[0], location=page)


def reachable(app, page, template, context, doctree):
    """Let the keyboard scroll what is wider than the page, and give the menu's headings a level."""
    scrolls = re.compile(r'<(pre|div class="(?:math|table-wrapper)[^"]*")(?=[ >])')
    context["body"] = scrolls.sub(r'<\1 tabindex="0"', context.get("body", ""))
    for name in ("furo_navigation_tree", "toctree"):
        if isinstance(context.get(name), str):
            context[name] = context[name].replace('role="heading"', 'role="heading" aria-level="2"')


def setup(app):
    app.connect("html-page-context", read)
    app.connect("html-page-context", reachable, priority=900)
