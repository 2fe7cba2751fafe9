"""Mutants of C and C++, made from the tokens of the code; the compiler decides which are valid."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise, takewhile
from typing import NamedTuple

from mutants.change import OPPOSITE, Change, other_numbers

_TOKEN = re.compile(
    r"""(?P<skip>//[^\n]*|/\*.*?\*/|^[ \t]*\#(?:[^\n]*\\\n)*[^\n]*
        |R"(?P<raw>\w*)\(.*?\)(?P=raw)"|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])+')
      |(?P<number>0[xX][0-9a-fA-F]+[uUlL]*|(?:\d[\d']*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?[uUlLfF]*)
      |(?P<word>[A-Za-z_]\w*)
      |(?P<op><<=|>>=|->|\+\+|--|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|<<|>>|::|[^\s])""",
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)
_BINARY = {"+", "-", "*", "/", "<", "<=", ">", ">=", "==", "!=", "&&", "||", "+=", "-=", "*=", "/="}
# Statements that begin with these can't be left out; those of _TEXTS aren't changed at all.
_TEXTS = {"throw", "static_assert", "assert", "using", "template"}
_KEPT = {"return", "if", "for", "while", "do", "switch", "case", "default", "break", "continue", "goto"}
_KEPT |= {"else", "typedef", "struct", "class", "enum", "namespace"} | _TEXTS
_SCOPES = {"namespace", "class", "struct", "union", "enum", "extern"}
_BEFORE_BODY = {")", "}", "const", "noexcept", "override", "final", "mutable"}
_AFTER_NAMES = {"=", "+=", "-=", "*=", "/=", "|=", "&=", "^=", "(", "{", "[", "++", "--"}


class Token(NamedTuple):
    kind: str
    text: str
    start: int

    @property
    def end(self) -> int:
        return self.start + len(self.text)


def changes(text: str) -> list[Change]:
    """Every mutant of a file, and some that do not compile."""
    tokens = [
        Token(found.lastgroup or "", found[0], found.start())
        for found in _TOKEN.finditer(text)
        if found["skip"] is None
    ]
    spared = set(_spared(tokens))
    return [c for c in _changes(text, tokens) if c.start not in spared]


def functions(text: str) -> list[tuple[int, int]]:
    """Begin and end of the text within the braces of each function that is no constant expression."""
    tokens = [
        Token(found.lastgroup or "", found[0], found.start())
        for found in _TOKEN.finditer(text)
        if found["skip"] is None
    ]
    found, n, head = [], 0, 0  # head: where the declaration begins whose brace is looked for
    while n < len(tokens):
        sign = tokens[n].text if tokens[n].kind == "op" else ""
        if sign == "{":
            words = {token.text for token in tokens[head:n]}
            if words & _SCOPES and not ("(" in words and tokens[n - 1].text in _BEFORE_BODY):
                head = n + 1
            else:
                last = _closing(tokens, n)
                if tokens[n - 1].text in _BEFORE_BODY and "(" in words:
                    if "constexpr" not in words:
                        found.append((tokens[n].end, tokens[last].start))
                    head = last + 1
                n = last
        elif sign in (";", "}") or (sign == ":" and tokens[n - 1].text in ("public", "private", "protected")):
            head = n + 1
        n += 1
    return found


def _changes(text: str, tokens: list[Token]) -> Iterator[Change]:
    for n, token in enumerate(tokens):
        match token.kind:
            case "number":
                for other in other_numbers(token.text):
                    yield Change(token.start, token.end, other)
            case "word" if token.text in OPPOSITE and token.text not in ("and", "or"):
                yield Change(token.start, token.end, OPPOSITE[token.text])
            case "word" if token.text == "if" and tokens[n + 1].text == "(":
                last = _closing(tokens, n + 1)
                condition = text[tokens[n + 1].end : tokens[last].start]
                yield Change(tokens[n + 1].end, tokens[last].start, f"!({condition})")
            case "op" if token.text in _BINARY and text[token.start - 1] == " " and text[token.end] in " \n":
                yield Change(token.start, token.end, OPPOSITE[token.text])
            case _:
                pass
    yield from _statements(tokens)


def _statements(tokens: list[Token]) -> Iterator[Change]:
    """Mutants that leave out an assignment or a call, or return 0 or {} instead of a value."""
    for n, token in enumerate(tokens):
        before = tokens[n - 1].text if n else "}"
        if before == ")":
            opening = _opening(tokens, n - 1)
            begins = tokens[opening - 1].text in ("if", "for", "while")
        else:
            begins = before in (";", "{", "}", "else")
        if not begins or (token.kind == "op" and token.text not in ("*", "(", "++", "--")):
            continue
        last = _until_semicolon(tokens, n)
        if last is None:
            continue
        inside = tokens[n:last]
        if token.text == "return":
            if len(inside) > 1 and [t.text for t in inside[1:]] not in (["0"], ["{", "}"]):
                for nothing in ("0", "{}"):
                    yield Change(inside[1].start, inside[-1].end, nothing)
        elif token.text not in _KEPT and not _declares(inside):
            yield Change(token.start, inside[-1].end, "")


def _declares(statement: list[Token]) -> bool:
    """Whether a statement is a declaration: it has two words before any "=", with no dot or "->" in
    between."""
    head = list(takewhile(lambda token: token.text not in _AFTER_NAMES, statement))
    words = [n for n, token in enumerate(head) if token.kind == "word"]
    between = [{t.text for t in head[a + 1 : b]} for a, b in pairwise(words)]
    return any(not signs & {".", "->", "::"} for signs in between)


def _spared(tokens: list[Token]) -> Iterator[int]:
    """Start of each token in statements that only report errors or name types, which aren't changed."""
    n = 0
    while n < len(tokens):
        if tokens[n].text in _TEXTS:
            while n < len(tokens) and tokens[n].text not in (";", "{"):
                yield tokens[n].start
                n += 1
        n += 1


def _until_semicolon(tokens: list[Token], n: int) -> int | None:
    """Index of the semicolon that ends the statement at token n; None if a bracket ends first."""
    depth = 0
    for last in range(n, len(tokens)):
        sign = tokens[last].text if tokens[last].kind == "op" else ""
        depth += (sign in ("(", "[", "{")) - (sign in (")", "]", "}"))
        if depth < 0:
            return None
        if depth == 0 and sign == ";":
            return last if last > n else None
        if depth == 0 and sign == "}" and (last + 1 == len(tokens) or tokens[last + 1].text != ";"):
            return None
    return None


def _closing(tokens: list[Token], n: int) -> int:
    """Index of the bracket that closes the one at token n."""
    opens, closes = tokens[n].text, {"(": ")", "{": "}"}[tokens[n].text]
    depth = 0
    for last in range(n, len(tokens)):
        depth += (tokens[last].text == opens) - (tokens[last].text == closes)
        if depth == 0:
            return last
    raise ValueError("a bracket without its end")


def _opening(tokens: list[Token], n: int) -> int:
    depth = 0
    for first in range(n, -1, -1):
        depth += (tokens[first].text == ")") - (tokens[first].text == "(")
        if depth == 0:
            return first
    raise ValueError("a bracket without its beginning")
