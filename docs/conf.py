"""Sphinx configuration: `make docs` builds this folder into docs/_build."""

import sys
from pathlib import Path

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
