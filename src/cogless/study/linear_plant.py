"""A linear plant for studies of trials: matrices with uncertain parameters, or matrices at each vertex.

x' = A x + B (u - d), y = C x        continuous
x(p+1) = A x(p) + B (u(p) - d(p))    discrete

x: states, u: input, d: load (disturbance of the input), y: output. The law sees x with the plant's noise.

Entries of A and B may be texts of arithmetic over named parameters, such as "-B / J". No other code is run.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from cogless import units
from cogless.control_library import C_LAWS, whole_number
from cogless.study.metric import OF_LINEAR_PLANTS
from cogless.study.table import Duration, Many, Table, excluded, invalid

OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
}
TEXT_LENGTH_MOST = 200  # characters


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
        raise ExpressionError(f"expected a formula that can be computed ({error})") from None
    if not math.isfinite(value):
        raise ExpressionError("expected a finite value")
    return value


def _tree(text: str) -> ast.expr:
    try:
        if len(text) > TEXT_LENGTH_MOST:
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
                names = ", ".join(values) or "there are none"
                raise ExpressionError(f'expected only known parameters ({names}), not "{name}"')
            return values[name]
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
            return -_value(inner, values) if isinstance(sign, ast.USub) else _value(inner, values)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            return OPERATORS[type(op)](_value(left, values), _value(right, values))
    raise ExpressionError('expected arithmetic of + - * / ** over parameters, such as "-B / J"')


TRIAL_STATES = whole_number("CGL_TRIAL_STATES")

Entry = str | float
Rows = Many[Many[float]]


class Parameter(Table):
    """A physical parameter of the plant: known, or within a range."""

    value: float | None = None
    """Nominal value of the parameter. Default: the middle of its `range`."""
    range: tuple[float, float] | None = Field(default=None, strict=False)
    """Smallest and largest value of the parameter. Default: its `value` is known exactly."""

    @classmethod
    def spelled_out(cls, data: Any) -> Any:
        if isinstance(data, list):
            return {"range": data}
        return data if isinstance(data, dict) else {"value": data}

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.range is None and self.value is None:
            raise invalid("expected the key value, range or both")
        if self.range is not None and self.range[1] < self.range[0]:
            raise invalid("expected a range from the smallest to the largest value", "range")
        if self.range is not None and self.value is not None:
            low, high = self.range
            if not low <= self.value <= high:
                raise invalid(f"expected a value within the range, {low:g} to {high:g}", "value")
        return self

    @property
    def nominal(self) -> float:
        """The value for which the feedforward is designed, and which trials have without an override."""
        if self.value is not None:
            return self.value
        assert self.range is not None
        return sum(self.range) / 2


class PlantVertex(Table):
    """Matrices at one vertex of the set of possible plants, as numbers."""

    A: Rows
    """Matrix $A$ of the plant at this corner, as rows of numbers."""
    B: Many[float]
    """Vector $B$ of the plant at this corner, one number for each state."""


class LinearPlant(Table):
    """A linear plant with one input and one output, sampled with `period`."""

    model: Literal["continuous", "discrete"] = "continuous"
    """Whether $A$ and $B$ describe a `continuous` or a `discrete` plant. A continuous plant is simulated
    exactly at its samples."""
    period: Duration  # s
    """Time between two samples of a trial."""
    A: Many[Many[Entry]] | None = None
    """Matrix $A$ as rows of numbers or formulas. A formula computes with the parameters in `parameter`, by `+
    - * / **`, such as `"-B / J"`."""
    B: Many[Entry] | None = None
    """Vector $B$: one number or formula for each state."""
    C: Many[float]
    """Matrix $C$: one row with a number for each state."""
    parameter: dict[str, Parameter] = Field(default={})
    """Parameters in the formulas of $A$ and $B$, by name. Each is a number, the range `[smallest, largest]`
    in which it is constant but unknown, or a table with `value` and `range`."""
    vertex: Many[PlantVertex] = ()
    """Corners of the set of possible plants, with numbers only. They replace `A`, `B` and `parameter`. The
    nominal plant is the mean of all corners."""
    states: Many[str] | None = None
    """Names of the states in tables and report. Default: x_1, x_2, ..."""
    input_limit: Annotated[float, Field(gt=0, le=1e12)] = 1e6
    """Largest magnitude of the plant's input $u$."""
    noise: Many[Annotated[float, Field(ge=0, le=1e12)]] | None = None
    """Standard deviation of the white noise on each measured state, such as `[1e-5, 0]`. Only the law gets
    noisy states: metrics and traces have the true states. Default: no noise."""
    load_noise: Annotated[float, Field(ge=0, le=1e12)] = 0.0
    """Standard deviation of the white noise on the disturbance $d$, in the unit of the input $u$."""

    @model_validator(mode="after")
    def _shapes(self) -> Self:
        if self.A is not None and self.vertex:
            raise excluded("vertex", "A", instead="delete A and B")
        if (self.A is None) != (self.B is None) or (self.A is None) == (not self.vertex):
            raise invalid(
                "expected either A and B, or vertex", "A", value="missing" if self.A is None else None
            )
        n = len(self.C)
        if not 1 <= n <= TRIAL_STATES:
            raise invalid(f"expected 1 to {TRIAL_STATES} numbers, one for each state", "C")
        if self.A is not None and self.B is not None:
            self._check_shape(self.A, self.B)
            self._check_names()
            self.matrices_at({})
        for index, vertex in enumerate(self.vertex):
            self._check_shape(vertex.A, vertex.B, "vertex", index)
        if self.vertex and self.parameter:
            raise excluded("parameter", "vertex", "vertex gives numbers", "give A and B in place of vertex")
        if self.states is not None and len(self.states) != n:
            raise invalid(f"expected {n} names, one for each state", "states")
        if self.noise is not None and len(self.noise) != n:
            raise invalid(f"expected {n} numbers, one for each state", "noise")
        return self

    def _check_shape(self, A: Sequence[Sequence[Any]], B: Sequence[Any], *key: str | int) -> None:
        n = len(self.C)
        if len(A) != n or any(len(row) != n for row in A):
            raise invalid(f"expected {n} rows of {n} numbers, as many as C has", *key, "A")
        if len(B) != n:
            raise invalid(f"expected {n} numbers, as many as C has", *key, "B")

    def _check_names(self) -> None:
        assert self.A is not None and self.B is not None
        entries: dict[tuple[str | int, ...], Entry] = {("B", i): entry for i, entry in enumerate(self.B)}
        entries |= {("A", i, j): entry for i, row in enumerate(self.A) for j, entry in enumerate(row)}
        for key, entry in entries.items():
            try:
                unknown = names(entry) - self.parameter.keys() if isinstance(entry, str) else set()
            except ExpressionError as error:
                raise invalid(str(error), *key) from None
            if unknown:
                all_parameters = ", ".join(self.parameter) or "none"
                expected = f'expected only known parameters ({all_parameters}), not "{min(unknown)}"'
                raise invalid(expected, *key)

    @property
    def signals(self) -> dict[str, units.Dimension]:
        """All signals of the plant in trials; they have no unit."""
        return linear_signals(len(self.C))

    def matrices_at(self, parameters: Mapping[str, float]) -> tuple[list[list[float]], list[float]]:
        """A and B for these parameter values; parameters that are left out are nominal.

        For a plant of vertices: A and B of vertex number parameters["vertex"], from 1, else the mean of all.
        """
        if self.vertex:
            number = parameters.get("vertex")
            chosen = self.vertex if number is None else (self.vertex[int(number) - 1],)
            import numpy as np

            A_, B_ = (np.mean([getattr(v, key) for v in chosen], axis=0) for key in ("A", "B"))
            return A_.tolist(), B_.tolist()
        values = {name: p.nominal for name, p in self.parameter.items()} | dict(parameters)
        A, B = self.A or (), self.B or ()
        rows = [[_number(e, values, "A", i, j) for j, e in enumerate(row)] for i, row in enumerate(A)]
        return rows, [_number(entry, values, "B", i) for i, entry in enumerate(B)]

    @property
    def state_noise(self) -> tuple[float, ...]:
        """Standard deviation of the noise on each measured state."""
        return self.noise or (0.0,) * len(self.C)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.states or tuple(f"x_{i + 1}" for i in range(len(self.C)))


def _number(entry: Entry, values: Mapping[str, float], *key: str | int) -> float:
    try:
        return evaluate(entry, values) if isinstance(entry, str) else float(entry)
    except ExpressionError as error:
        at = ", ".join(f"{name} = {value:g}" for name, value in values.items())
        raise invalid(f"{error} at {at}", *key) from None


def linear_signals(states: int) -> dict[str, units.Dimension]:
    """All signals of a linear plant with so many states, in trials; they have no unit."""
    own = (term.signal for term in C_LAWS["trial"].terms)
    names = (*OF_LINEAR_PLANTS, *own, "learned", "status")
    return dict.fromkeys((*names, *(f"x_{i + 1}" for i in range(states))), units.NONE)
