"""Mutants of Python: found in the syntax tree, made in the text, so that all other text stays the same."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

from mutants.change import OPPOSITE, Change, other_numbers

SIGNS: dict[type[ast.AST], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
SIGNS |= {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
SIGNS |= {ast.And: "and", ast.Or: "or"}
# Results don't depend on these: assertions (such as strict of zip), texts of errors, types.
LEFT_ALONE = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)
TYPES = ("annotation", "returns", "decorator_list")


def changes(text: str) -> list[Change]:
    """Every mutant of a module."""
    return list(_Sites(text).of(ast.parse(text)))


class _Sites:
    def __init__(self, text: str) -> None:
        self.text = text
        self.lines = [line.encode() for line in text.splitlines(keepends=True)]
        self.begins = [0]
        for line in self.lines:
            self.begins.append(self.begins[-1] + len(line.decode()))

    def at(self, line: int, column: int) -> int:
        """Position in the text of a place in the syntax tree, whose columns are counted in bytes."""
        return self.begins[line - 1] + len(self.lines[line - 1][:column].decode())

    def start(self, node: ast.expr | ast.stmt) -> int:
        return self.at(node.lineno, node.col_offset)

    def end(self, node: ast.expr | ast.stmt) -> int:
        return self.at(node.end_lineno or 0, node.end_col_offset or 0)

    def of(self, node: ast.AST, again: frozenset[str] = frozenset()) -> Iterator[Change]:
        """Mutants of a node and of all nodes within it. `again`: names that its function assigns more than
        once."""
        if isinstance(node, LEFT_ALONE) or (isinstance(node, ast.keyword) and node.arg == "strict"):
            return
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            return
        if isinstance(node, ast.FunctionDef):
            names = (name for name in ast.walk(node) if isinstance(name, ast.Name))
            stored = Counter(name.id for name in names if isinstance(name.ctx, ast.Store))
            again = frozenset(name for name, times in stored.items() if times > 1)
        yield from self.own(node, again)
        for name, field in ast.iter_fields(node):
            if name in TYPES:
                continue
            for child in field if isinstance(field, list) else [field]:
                if isinstance(child, ast.AST):
                    yield from self.of(child, again)

    def own(self, node: ast.AST, again: frozenset[str]) -> Iterator[Change]:
        match node:
            case ast.BinOp(left, op, right):
                if type(op) in SIGNS and not (_is_text(left) or _is_text(right)):
                    yield from self.sign(left, op, right)
            case ast.Compare(left, ops, rights):
                for a, compared, b in zip([left, *rights], ops, rights, strict=False):
                    yield from self.sign(a, compared, b)
            case ast.BoolOp(op, values):
                for a, b in pairwise(values):
                    yield from self.sign(a, op, b)
            case ast.AugAssign(target, ast.Add() | ast.Sub() | ast.Mult() | ast.Div() as op, value):
                yield from self.sign(target, op, value)
            case ast.Call(ast.Name(id=name) as called) if name in OPPOSITE:
                yield self.whole(called, OPPOSITE[name])
            case ast.Call(ast.Attribute(attr=name) as called) if name in OPPOSITE:
                yield Change(self.end(called) - len(name), self.end(called), OPPOSITE[name])
            case ast.If(test) | ast.IfExp(test):
                yield self.whole(test, f"not ({self.text[self.start(test) : self.end(test)]})")
            case ast.Constant(bool() as value):
                yield self.whole(node, str(not value))
            case ast.Constant(int() | float()):
                for other in other_numbers(self.text[self.start(node) : self.end(node)]):
                    yield self.whole(node, other)
            case ast.Return(ast.expr() as value) if self.text[self.start(value) : self.end(value)] != "None":
                yield self.whole(value, "None")
        # a name's only assignment stays: without it every test fails
        match node:
            case ast.Assign([ast.Name(id=name)]) | ast.AugAssign(ast.Name(id=name)) if name not in again:
                pass
            case ast.Assign([ast.Tuple()]):
                pass
            case ast.Assign() | ast.AugAssign() | ast.Expr(ast.Call()):
                yield self.whole(node, "pass")

    def whole(self, node: ast.expr | ast.stmt, new: str) -> Change:
        return Change(self.start(node), self.end(node), new)

    def sign(self, left: ast.expr, op: ast.AST, right: ast.expr) -> Iterator[Change]:
        """Mutants of the operator between two operands, with only brackets and comments around it."""
        sign = SIGNS.get(type(op))
        if sign is not None:
            first = self.end(left)
            between = re.sub(r"#.*", lambda c: " " * len(c[0]), self.text[first : self.start(right)])
            place = first + between.index(sign)
            yield Change(place, place + len(sign), OPPOSITE[sign])


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
