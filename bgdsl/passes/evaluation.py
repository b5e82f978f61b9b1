"""How expressions are evaluated: one function for each kind of node, found by the node's type.

`elaborate` fills the table; the modules that evaluate parts of expressions (`references`, `inline`) stand between.
Reports      BG232 index out of range
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from bgdsl.diagnostics import Code, counted
from bgdsl.expr import Expr, const
from bgdsl.passes.parts import Context, Fault
from bgdsl.passes.shapes import TableName, Value, shape_of, shown_shape
from bgdsl.passes.values import MISFIT
from bgdsl.source import Span
from bgdsl.syntax import ast

INDEX = Code("BG232", "an index is out of range")

EVALUATORS: dict[type, Callable[[Any, Context], Value]] = {}
"""What evaluates a node of each type."""


def evaluate(node: ast.Expression, context: Context) -> Value:
    """The value of an expression; Fault where it has none."""
    return EVALUATORS[type(node)](node, context)


def evaluate_scalar(node: ast.Expression, context: Context) -> Expr:
    """The value of an expression that has to be a single number."""
    value = evaluate(node, context)
    if not isinstance(value, Expr):
        raise Fault(MISFIT, "a single number is wanted here", node.span, describe(value))
    return value


def evaluate_now(node: ast.Expression, context: Context) -> float:
    """The number that an expression over parameters is; those parameters become structural."""
    if type(node) is ast.Number and node.is_integer:
        return node.value
    return context.build.number(evaluate_scalar(node, context), node.span)


def evaluate_integer(node: ast.Expression, context: Context) -> int:
    """The value, known now, of an expression that has to be a whole number."""
    number = evaluate_now(node, context)
    if not float(number).is_integer():
        raise Fault(INDEX, f"a whole number is wanted here, this is {number:g}", node.span, "not whole")
    return int(number)


def describe(value: Value) -> str:
    """What a value is, in words."""
    if isinstance(value, str):
        return "a string"
    return "a table" if isinstance(value, TableName) else shown_shape(shape_of(value))


def iterations(iterators: Sequence[ast.Iterator], context: Context) -> Iterator[Context]:
    """The contexts of every turn of (nested) iterators."""
    if not iterators:
        yield context
        return
    first, rest = iterators[0], iterators[1:]
    over = evaluate(first.over, context)
    if not isinstance(over, np.ndarray):
        raise Fault(MISFIT, "an iterator runs over a range or a vector", first.over.span, describe(over), helps=("write `1:n`",))
    for item in over:
        yield from iterations(rest, context.with_locals({first.name: item}))


def position(subscript: ast.Expression, size: int, context: Context) -> int | list[int]:
    """A subscript as positions from 0: one, or a list for `:` and ranges."""
    match subscript:
        case ast.Number(value=value) if subscript.is_integer:
            return _checked(value, size, subscript.span)
        case ast.Colon():
            return list(range(size))
        case ast.Reference(parts=(ast.Part(name=name, subscripts=()),)) if context.locals and name in context.locals:
            value = context.locals[name]
        case _:
            value = evaluate(subscript, context.with_locals({"end": const(size)}))
    if isinstance(value, Expr):
        return _checked(context.build.number(value, subscript.span), size, subscript.span)
    if len(shape_of(value)) != 1:
        raise Fault(INDEX, "an index is a whole number or a vector of them", subscript.span, describe(value))
    return [_checked(context.build.number(entry, subscript.span), size, subscript.span) for entry in value]


def _checked(number: float, size: int, span: Span) -> int:
    if not float(number).is_integer():
        raise Fault(INDEX, f"an index is a whole number, this is {number:g}", span, "not whole")
    if not 1 <= number <= size:
        allowed = f"1 to {size}" if size > 1 else "1" if size else "none, it is empty"
        raise Fault(INDEX, f"index {number:g} is out of range", span, f"allowed: {allowed}")
    return int(number) - 1


def select(value: Value, subscripts: Sequence[ast.Expression], span: Span, context: Context) -> Value:
    """value[subscripts]; fewer subscripts than dimensions leave the rest whole."""
    if not subscripts:
        return value
    shape = shape_of(value)
    if len(subscripts) > len(shape):
        raise Fault(INDEX, f"{counted(len(subscripts), 'subscript')} on {describe(value)}", span, describe(value))
    for axis in range(len(subscripts) - 1, -1, -1):
        value = value.take(position(subscripts[axis], shape[axis], context), axis=axis)
    return value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
