"""Evaluate arithmetic in a study: texts such as "-B / J" over named parameters. No other code is run."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping

OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
}
LONGEST = 200  # characters


class ExpressionError(ValueError):
    """A text that isn't arithmetic or has no value; the message starts with "expected"."""


def names(text: str) -> set[str]:
    """Names of the parameters in an expression; ExpressionError if it isn't arithmetic."""
    return {node.id for node in ast.walk(_tree(text)) if isinstance(node, ast.Name)}


def evaluate(text: str, values: Mapping[str, float]) -> float:
    """Value of an expression; ExpressionError: unknown name, division by zero, or a value that isn't
    finite."""
    try:
        value = _value(_tree(text), values)
    except (ArithmeticError, ValueError) as error:
        if isinstance(error, ExpressionError):
            raise
        raise ExpressionError(f"expected a value, not one that fails ({error})") from None
    if not math.isfinite(value):
        raise ExpressionError("expected a finite value")
    return value


def _tree(text: str) -> ast.expr:
    try:
        if len(text) > LONGEST:
            raise ValueError
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ExpressionError('expected arithmetic over parameters, such as "-B / J"') from None


def _value(node: ast.expr, values: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name(id=name):
            if name not in values:
                known = ", ".join(values) or "none are given"
                raise ExpressionError(f'expected known parameters ({known}), not "{name}"')
            return values[name]
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
            return -_value(inner, values) if isinstance(sign, ast.USub) else _value(inner, values)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            return OPERATORS[type(op)](_value(left, values), _value(right, values))
    raise ExpressionError('expected arithmetic of + - * / ** over parameters, such as "-B / J"')
