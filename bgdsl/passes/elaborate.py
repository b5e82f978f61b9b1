"""Evaluate expressions of the tree to values: names resolved, arrays unrolled, functions inlined.

Input        ast.Expression, Context
Output       `expr.Expr`, a string, a table's name, or an object array of these
Establishes  the result reads parameters and variables by their flat scalar names only
Reports      BG230 unknown name, BG231 misfit; its neighbours `evaluation`, `references`, `inline` and `values` report theirs
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from bgdsl.diagnostics import did_you_mean
from bgdsl.expr import Expr, add, const, table
from bgdsl.passes import functions
from bgdsl.passes.evaluation import (
    EVALUATORS,
    INDEX,
    describe,
    evaluate,
    evaluate_integer,
    evaluate_now,
    evaluate_scalar,
    iterations,
    position,
    select,
)
from bgdsl.passes.functions import BUILT_INS, wrong
from bgdsl.passes.inline import inline
from bgdsl.passes.parts import NO_VALUE, UNKNOWN_NAME, Context, Fault
from bgdsl.passes.rates import total_derivative
from bgdsl.passes.references import evaluate_reference
from bgdsl.passes.shapes import LARGEST_ARRAY, TableName, Value, array_of, shape_of
from bgdsl.passes.values import MISFIT, choose, elementwise, join_matrix, negate, operate, stack
from bgdsl.syntax import ast

# ------------------------------------------------------------------------------------------------------------ operators


def _number(node: ast.Number, context: Context) -> Value:
    if math.isinf(node.value):
        raise Fault(NO_VALUE, f"`{node.text}` is larger than any number here", node.span, "about 1.8e308 is the largest")
    return const(node.value)


def _boolean(node: ast.Boolean, context: Context) -> Value:
    return const(node.value)


def _string(node: ast.String, context: Context) -> Value:
    return node.value


def _binary(node: ast.Binary, context: Context) -> Value:
    """Long chains lean to the left; they are walked with a loop."""
    spine = []
    left: ast.Expression = node
    while isinstance(left, ast.Binary):
        spine.append(left)
        left = left.left
    value = evaluate(left, context)
    for step in reversed(spine):
        if step.operator in ("and", "or") and isinstance(value, Expr) and value.is_const and bool(value.data) == (step.operator == "or"):
            continue
        value = operate(step.operator, value, evaluate(step.right, context), step.span)
    return value


def _unary(node: ast.Unary, context: Context) -> Value:
    return negate(evaluate(node.operand, context), node.operator, node.span)


def _if(node: ast.If, context: Context) -> Value:
    decided: list[tuple[Expr, Value]] = []
    last: Value = None
    for condition, branch in node.branches:
        test = evaluate_scalar(condition, context)
        if test.is_const:
            if test.data:
                last = evaluate(branch, context)
                break
            continue
        decided.append((test, evaluate(branch, context)))
    else:
        last = evaluate(node.otherwise, context)
    for test, value in reversed(decided):
        last = choose(test, value, last, node.span)
    return last


def _array(node: ast.Array, context: Context) -> Value:
    return stack([evaluate(item, context) for item in node.items], node.span)


def _matrix(node: ast.Matrix, context: Context) -> Value:
    return join_matrix([[evaluate(item, context) for item in row] for row in node.rows], node.span)


def _range(node: ast.Range, context: Context) -> Value:
    numbers = range_numbers(node, context)
    return array_of([const(number) for number in numbers], (len(numbers),))


def range_numbers(node: ast.Range, context: Context) -> list[float]:
    start, stop = evaluate_now(node.start, context), evaluate_now(node.stop, context)
    step = 1.0 if node.step is None else evaluate_now(node.step, context)
    if step == 0:
        raise Fault(INDEX, "the step of a range cannot be zero", node.span, "")
    if not abs((stop - start) / step) < LARGEST_ARRAY:
        raise Fault(INDEX, f"a range from {start:g} to {stop:g} by {step:g} is too long", node.span, f"at most {LARGEST_ARRAY} numbers")
    count = max(0, int((stop - start) / step + 1e-9) + 1) if (stop - start) / step >= 0 else 0
    return [start + i * step for i in range(count)]


def _comprehension(node: ast.Comprehension, context: Context) -> Value:
    if node.function is None:
        return _nested_array(node, node.iterators, context)
    items = [evaluate(node.body, inner) for inner in iterations(node.iterators, context)]
    match node.function:
        case "sum":
            if items and shape_of(items[0]):
                return elementwise(lambda *terms: add(terms), *items)
            return add(items)
        case "product" | "min" | "max" if items or node.function == "product":
            return functions.call(node.function, [array_of(items, (len(items),))], node.span, context)
        case _:
            raise wrong(f"`{node.function}` is no reduction, or runs over nothing", node.span, "", "use sum, product, min or max")


def _nested_array(node: ast.Comprehension, iterators: Sequence[ast.Iterator], context: Context) -> Value:
    """As in Modelica, the last iterator runs fastest over the first dimension's entries: `{... for i in .., j in ..}` is [j][i]."""
    if not iterators:
        return evaluate(node.body, context)
    *outer, last = iterators
    return stack([_nested_array(node, outer, inner) for inner in iterations((last,), context)], node.span)


def _end(node: ast.End, context: Context) -> Value:
    if context.locals and "end" in context.locals:
        return context.locals["end"]
    raise Fault(UNKNOWN_NAME, "`end` has a meaning inside an index only", node.span, "")


def _subscripted(node: ast.Subscripted, context: Context) -> Value:
    return select(evaluate(node.value, context), node.subscripts, node.span, context)


# ---------------------------------------------------------------------------------------------------------------- calls


def _call(node: ast.Call, context: Context) -> Value:
    name = node.function.text
    if len(node.function.parts) == 1:
        match name:
            case "der":
                return _der(node, context)
            case "table":
                return context.build.make_table(node, context)
    held = _table_named(node, context)
    if held is not None:
        if len(node.arguments) != 1 or node.named:
            raise wrong(f"table `{name}` takes one argument", node.span)
        return elementwise(lambda x: table(held.name, x), evaluate(node.arguments[0], context))
    found = context.build.names.find_dotted(node.function, context.scope)
    match found.node if found is not None else None:
        case ast.ShortFunction() | ast.LongFunction() as definition:
            assert found is not None
            assert found.scope is not None
            return inline(definition, node, Context(context.build, None, found.scope), context)
    if name in BUILT_INS:
        if node.named:
            raise wrong(f"`{name}` takes no named arguments", node.span)
        return functions.call(name, [evaluate(argument, context) for argument in node.arguments], node.span, context)
    known = [*BUILT_INS, "der", "table", *(n for n in context.build.names.visible(context.scope))]
    raise Fault(UNKNOWN_NAME, f"unknown function `{name}`", node.function.span, "not found", helps=did_you_mean(name, known))


def _table_named(node: ast.Call, context: Context) -> TableName | None:
    """The table that the called name stands for, if it is one."""
    first = node.function.parts[0].name
    instance = context.instance
    if context.locals is not None and first in context.locals:
        value = context.locals[first]
    elif instance is not None and (first in instance.cls.members or first in instance.bonds):
        value = evaluate(node.function, context)
    else:
        return None
    if isinstance(value, TableName):
        return value
    raise wrong(f"`{node.function.text}` is no function", node.span, describe(value), "only functions and tables can be called")


def _der(node: ast.Call, context: Context) -> Value:
    if len(node.arguments) != 1 or node.named:
        raise wrong("`der` takes one argument", node.span)
    return elementwise(lambda x: total_derivative(x, node.span, context), evaluate(node.arguments[0], context))


def _colon(node: ast.Colon, context: Context) -> Value:
    raise Fault(MISFIT, "`:` stands for a whole dimension inside an index only", node.span, "")


EVALUATORS |= {
    ast.Number: _number,
    ast.String: _string,
    ast.Boolean: _boolean,
    ast.Colon: _colon,
    ast.End: _end,
    ast.Reference: evaluate_reference,
    ast.Call: _call,
    ast.Subscripted: _subscripted,
    ast.Unary: _unary,
    ast.Binary: _binary,
    ast.If: _if,
    ast.Range: _range,
    ast.Array: _array,
    ast.Comprehension: _comprehension,
    ast.Matrix: _matrix,
}

__all__ = ["evaluate", "evaluate_integer", "evaluate_now", "evaluate_scalar", "iterations", "position", "select"]
