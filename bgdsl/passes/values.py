"""Arithmetic of values: scalars, vectors and matrices of expressions, with Modelica's rules of shape.

`a*b` is the matrix product or the scalar product of vectors; `.*` works entry by entry; `+` and `-` want equal shapes.
Sums and products keep structural zeros: an entry that is identically zero is `expr.ZERO`.
Reports      BG231 operands do not fit together
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from bgdsl.diagnostics import Code
from bgdsl.expr import ONE, ZERO, Expr, add, const, if_else, not_, relation
from bgdsl.passes.parts import Fault
from bgdsl.passes.shapes import TableName, Value, array_of, entries, shape_of, shown_shape
from bgdsl.source import Span

MISFIT = Code("BG231", "operands do not fit together")

Array = np.ndarray[Any, Any]


def kind_of(value: Value) -> str:
    """`number`, `string` or `table`: what the entries of a value are."""
    first = next(iter(value.flat), ZERO) if isinstance(value, np.ndarray) else value
    if isinstance(first, str):
        return "string"
    return "table" if isinstance(first, TableName) else "number"


def misfit(operator: str, left: Value, right: Value, span: Span, *helps: str) -> Fault:
    """The fault of an operator between values that do not go together."""
    return Fault(
        MISFIT,
        f"`{operator}` does not fit {_shown(left)} and {_shown(right)}",
        span,
        f"{_shown(left)} {operator} {_shown(right)}",
        helps=helps,
    )


def _shown(value: Value) -> str:
    kind = kind_of(value)
    return shown_shape(shape_of(value)) if kind == "number" else f"a {kind}"


def elementwise(function: Callable[..., Expr], *values: Value) -> Value:
    """`function` entry by entry; scalars go with every entry."""
    shape = next((v.shape for v in values if isinstance(v, np.ndarray)), None)
    if shape is None:
        return function(*values)
    columns = [v.flat if isinstance(v, np.ndarray) else [v] * int(np.prod(shape)) for v in values]
    return array_of([function(*row) for row in zip(*columns, strict=True)], shape)


def _power(a: Expr, b: Expr) -> Expr:
    return a**b


_SCALAR: dict[str, Callable[[Expr, Expr], Expr]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "^": _power,
    "==": lambda a, b: relation("eq", a, b),
    "<>": lambda a, b: relation("ne", a, b),
    "<": lambda a, b: relation("lt", a, b),
    "<=": lambda a, b: relation("le", a, b),
    ">": lambda a, b: relation("lt", b, a),
    ">=": lambda a, b: relation("le", b, a),
    "and": lambda a, b: relation("and", a, b),
    "or": lambda a, b: relation("or", a, b),
}


def operate(operator: str, left: Value, right: Value, span: Span) -> Value:
    """left operator right."""
    if isinstance(left, Expr) and isinstance(right, Expr):
        return _SCALAR[operator.removeprefix(".")](left, right)
    if kind_of(left) != "number" or kind_of(right) != "number":
        return _strings(operator, left, right, span)
    a, b = shape_of(left), shape_of(right)
    match operator:
        case ".+" | ".-" | ".*" | "./" | ".^":
            if a and b and a != b:
                raise misfit(operator, left, right, span)
            return elementwise(_SCALAR[operator[1:]], left, right)
        case "+" | "-":
            if a != b:
                helps = (f"to add a scalar to every entry write `.{operator}`",) if not a or not b else ()
                raise misfit(operator, left, right, span, *helps)
            return elementwise(_SCALAR[operator], left, right)
        case "*":
            return _product(left, right, span)
        case "/":
            if b:
                raise misfit(operator, left, right, span, "write `solve(A, b)` for inv(A) b, or `./` to divide entry by entry")
            return elementwise(_SCALAR["/"], left, right)
        case "^":
            return _matrix_power(left, right, span)
        case _:
            raise misfit(operator, left, right, span, "compare entry by entry")


def _strings(operator: str, left: Value, right: Value, span: Span) -> Value:
    if isinstance(left, str) and isinstance(right, str):
        match operator:
            case "+":
                return left + right
            case "==":
                return const(left == right)
            case "<>":
                return const(left != right)
            case _:
                pass
    raise misfit(operator, left, right, span)


def _product(left: Value, right: Value, span: Span) -> Value:
    a, b = shape_of(left), shape_of(right)
    if not a or not b:
        return elementwise(_SCALAR["*"], left, right)
    if len(a) > 2 or len(b) > 2 or a[-1] != b[0]:
        raise misfit("*", left, right, span, "`*` is the matrix product; write `.*` to multiply entry by entry")
    return matmul(left, right)


def matmul(left: Array, right: Array) -> Value:
    """The product of two arrays of one or two dimensions; structural zeros stay."""
    rows = left.reshape(1, -1) if left.ndim == 1 else left
    columns = right.reshape(-1, 1) if right.ndim == 1 else right
    made = np.empty((rows.shape[0], columns.shape[1]), dtype=object)
    for i, row in enumerate(rows):
        for j in range(columns.shape[1]):
            made[i, j] = add(x * y for x, y in zip(row, columns[:, j], strict=True))
    if left.ndim == 1:
        made = made[0]
    if right.ndim == 1:
        made = made.reshape(made.shape[:-1]) if made.ndim > 1 else made[0]
    return made


def _matrix_power(left: Value, right: Value, span: Span) -> Value:
    shape = shape_of(left)
    count = right.data if isinstance(right, Expr) and right.is_const else -1.0
    if len(shape) != 2 or shape[0] != shape[1] or count < 0 or not float(count).is_integer():
        raise misfit("^", left, right, span, "write `.^` to raise entry by entry")
    result: Value = identity(shape[0])
    for _ in range(int(count)):
        result = matmul(result, left)
    return result


def identity(n: int) -> Array:
    """The n x n identity."""
    return array_of([ONE if i == j else ZERO for i in range(n) for j in range(n)], (n, n))


def full(shape: tuple[int, ...], value: Any) -> Array:
    """An array of one value throughout."""
    return array_of([value] * int(np.prod(shape, dtype=int)), shape)


def diagonal(items: Value) -> Array:
    """The square matrix with these entries on its diagonal."""
    values = entries(items)
    n = len(values)
    return array_of([values[i] if i == j else ZERO for i in range(n) for j in range(n)], (n, n))


def negate(value: Value, operator: str, span: Span) -> Value:
    """`-x`, `+x` or `not x`."""
    if kind_of(value) != "number":
        raise Fault(MISFIT, f"`{operator}` does not fit {_shown(value)}", span, _shown(value))
    match operator:
        case "-" | ".-":
            return elementwise(lambda x: -x, value)
        case "not":
            return elementwise(not_, value)
        case _:
            return value


def choose(condition: Expr, yes: Value, no: Value, span: Span) -> Value:
    """if condition then yes else no, entry by entry."""
    if shape_of(yes) != shape_of(no) or kind_of(yes) != "number" or kind_of(no) != "number":
        if yes is no or (isinstance(yes, str | TableName) and yes == no):
            return yes
        raise Fault(MISFIT, f"the branches are {_shown(yes)} and {_shown(no)}", span, "both must be alike")
    return elementwise(lambda a, b: if_else(condition, a, b), yes, no)


def stack(items: list[Value], span: Span) -> Array:
    """`{a, b, c}`: one more dimension in front."""
    shapes = {shape_of(item) for item in items}
    if len(shapes) > 1:
        shown = " and ".join(sorted(shown_shape(shape) for shape in shapes))
        raise Fault(MISFIT, f"the entries of an array must be alike, these are {shown}", span, "entries of different shapes")
    _check_kinds(items, span)
    inner = shapes.pop() if shapes else ()
    return array_of([entry for item in items for entry in entries(item)], (len(items), *inner))


def _check_kinds(items: Iterable[Value], span: Span) -> None:
    if len({kind_of(item) for item in items}) > 1:
        raise Fault(MISFIT, "the entries of an array must be alike, these are numbers and strings", span, "entries of different kinds")


def join_matrix(rows: list[list[Value]], span: Span) -> Array:
    """`[a, b; c, d]`: blocks side by side, then one over the other; a vector is a column."""
    _check_kinds((item for row in rows for item in row), span)
    made = []
    for row in rows:
        blocks = [_block(value, span) for value in row]
        if len({block.shape[0] for block in blocks}) > 1:
            raise Fault(MISFIT, "the blocks of one row of a matrix differ in height", span, "")
        made.append(np.concatenate(blocks, axis=1))
    if len({block.shape[1] for block in made}) > 1:
        widths = ", ".join(str(block.shape[1]) for block in made)
        raise Fault(MISFIT, f"the rows of a matrix differ in length ({widths})", span, "rows of different lengths")
    return np.concatenate(made, axis=0)


def _block(value: Value, span: Span) -> Array:
    match shape_of(value):
        case ():
            return array_of([value], (1, 1))
        case (n,):
            return np.asarray(value.reshape(n, 1))
        case (_, _):
            return np.asarray(value)
        case shape:
            raise Fault(MISFIT, f"{shown_shape(shape)} cannot be a block of a matrix", span, "")
