"""Equations as MathML, which docutils makes when the docs are built: pages need no network and no script."""

from __future__ import annotations

import html
import re
import xml.etree.ElementTree as ET
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

log = logging.getLogger(__name__)

SPACE = "{http://www.w3.org/1998/Math/MathML}"
ACCENTS = set("\u02c6\u02d9\u02c9\u02dc\u00a8\u00af^~")
ET.register_namespace("", SPACE[1:-1])


def repaired(mathml: str) -> str:
    """The MathML with corrections of what docutils 0.22 gets wrong."""
    text = re.sub(r"&(?!lt;|gt;|amp;|#)\w+;", lambda entity: html.unescape(entity[0]), mathml)
    root = ET.fromstring(text.replace("<mo>'</mo>", "<mo>\u2032</mo>"))
    for element in root.iter():
        name = element.tag.removeprefix(SPACE)
        if (
            name == "munderover" and (element[2].text or "") in ACCENTS
        ):  # docutils puts the subscript of an accented letter under it
            letter, below, accent = element
            over = ET.Element(f"{SPACE}mover", {"accent": "true"})
            over.extend([letter, accent])
            element[:] = [over, below]
            name, element.tag = "msub", f"{SPACE}msub"
        if name == "msub" and element[0].tag == f"{SPACE}munder":  # the text of an underbrace, put under it
            name, element.tag = "munder", f"{SPACE}munder"
        if name in ("msub", "msubsup"):
            join_words(element[1])
        bars = [child for child in element if child.tag == f"{SPACE}mo" and child.text == "|"]
        pair = len(element) > 1 and bars and element[0] in bars and element[-1] in bars
        for bar in bars:  # of absolute values
            bar.attrib |= {"lspace": "0", "rspace": "0", "stretchy": "true" if pair else "false"}
    return ET.tostring(root, encoding="unicode")


def join_words(row: ET.Element) -> None:
    """Joins adjacent letters of a subscript to one word, such as "ref"."""
    before = None
    for child in list(row):
        letter = child.tag == f"{SPACE}mi" and (child.text or "").isascii()
        if letter and before is not None:
            before.text = (before.text or "") + (child.text or "")
            row.remove(child)
        else:
            before = child if letter else None


def converted(node: nodes.Element, block: bool) -> str:
    if re.search(r"\\t?frac(?!\{)", node.astext()):  # docutils would read "32" as one number
        log.warning("equation %r: \\frac without braces", node.astext(), location=node)
    try:
        return repaired(tex2mathml(node.astext(), as_block=block))
    except MathError as error:
        log.warning("equation %r: %s", node.astext(), error, location=node)
        return ""


def visit_inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(converted(node, block=False))
    raise nodes.SkipNode


def visit_block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{converted(node, block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, Any]:
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
