"""User functions, inlined where they are called.

Input        a function's definition, a call
Output       the value of its (first) output
Reports      BG234 wrong arguments, BG235 recursive function
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bgdsl.diagnostics import Code, counted, did_you_mean
from bgdsl.passes.evaluation import (
    INDEX,
    describe,
    evaluate,
    evaluate_integer,
    iterations,
    position,
)
from bgdsl.passes.functions import ARGUMENTS
from bgdsl.passes.parts import UNKNOWN_NAME, Context, Fault
from bgdsl.passes.references import spots
from bgdsl.passes.shapes import Value, array_of, entries, shape_of, shown_shape
from bgdsl.passes.values import MISFIT, full
from bgdsl.syntax import ast

RECURSIVE = Code("BG235", "a function calls itself")

Definition = ast.ShortFunction | ast.LongFunction


def inline(definition: Definition, node: ast.Call, inner: Context, outer: Context) -> Value:
    """The value of the call; `inner` is where the definition stands, `outer` where the call does."""
    build = outer.build
    if any(definition is other for other in build.calls):
        names = [other.name for other in build.calls]
        raise Fault(
            RECURSIVE,
            f"function `{definition.name}` calls itself: {' -> '.join([*names[names.index(definition.name) :], definition.name])}",
            node.span,
            "this call closes the circle",
            helps=("functions are inlined: write a loop with a constant range instead",),
        )
    inputs = _inputs(definition)
    arguments = _arguments(definition, inputs, node, outer)
    build.calls.append(definition)
    try:
        mapped = _mapped_shape(inputs, arguments)
        if mapped is None:
            return _run(definition, inputs, arguments, node, inner)
        columns = {name: value.flat if shape_of(value) == mapped else [value] * int(np.prod(mapped)) for name, value in arguments.items()}
        rows = [_run(definition, inputs, dict(zip(columns, row, strict=True)), node, inner) for row in zip(*columns.values(), strict=True)]
        inside = shape_of(rows[0]) if rows else ()  # of what the function gives for one entry
        return array_of([entry for row in rows for entry in entries(row)], (*mapped, *inside))
    finally:
        build.calls.pop()


def _inputs(definition: Definition) -> list[ast.Declarator]:
    if isinstance(definition, ast.ShortFunction):
        return list(definition.inputs)
    return [d for declaration in definition.declarations if "input" in declaration.prefixes for d in _declarators(declaration)]


def _declarators(declaration: ast.Declaration) -> list[ast.Declarator]:
    """The declarators with the dimensions of their type put in front of their own."""
    return [replace(d, dims=(*d.dims, *declaration.type.dims)) for d in declaration.declarators]


def _arguments(definition: Definition, inputs: Sequence[ast.Declarator], node: ast.Call, outer: Context) -> dict[str, Value]:
    names = [item.name for item in inputs]
    others = [(definition.span, f"`{definition.name}` is defined here")]
    if len(node.arguments) > len(inputs):
        raise Fault(
            ARGUMENTS, f"`{definition.name}` takes {len(inputs)} arguments, not {len(node.arguments)}", node.span, "too many", others=others
        )
    given = {item.name: evaluate(argument, outer) for item, argument in zip(inputs, node.arguments, strict=False)}
    for name, argument in node.named:
        if name not in names or name in given:
            problem = "is given twice" if name in given else "is no argument"
            raise Fault(
                ARGUMENTS, f"`{name}` {problem} of `{definition.name}`", argument.span, "", others=others, helps=did_you_mean(name, names)
            )
        given[name] = evaluate(argument, outer)
    missing = [item.name for item in inputs if item.name not in given and item.value is None]
    if missing:
        raise Fault(ARGUMENTS, f"`{definition.name}` needs argument `{missing[0]}`", node.span, "missing", others=others)
    return given


def _mapped_shape(inputs: Sequence[ast.Declarator], arguments: dict[str, Value]) -> tuple[int, ...] | None:
    """A function of scalars may be given arrays: it is applied to each entry. The shape of those arrays, or None."""
    shapes = {shape_of(arguments[item.name]) for item in inputs if not item.dims and item.name in arguments} - {()}
    if len(shapes) == 1 and not any(item.dims for item in inputs):
        return shapes.pop()
    return None


def _run(
    definition: Definition,
    inputs: Sequence[ast.Declarator],
    arguments: dict[str, Value],
    node: ast.Call,
    inner: Context,
) -> Value:
    names: dict[str, Value] = {}
    context = Context(inner.build, None, inner.scope, names)
    for item in inputs:
        names[item.name] = arguments[item.name] if item.name in arguments else evaluate(item.value, context)  # type: ignore[arg-type]
        _check_argument(definition, item, names[item.name], node, context)
    if isinstance(definition, ast.ShortFunction):
        return evaluate(definition.body, context)
    outputs = []
    for declaration in definition.declarations:
        if "input" in declaration.prefixes:
            continue
        for item in _declarators(declaration):
            shape = tuple(evaluate_integer(dim, context) for dim in item.dims)
            names[item.name] = evaluate(item.value, context) if item.value is not None else full(shape, None) if shape else None
            if "output" in declaration.prefixes:
                outputs.append(item)
    _execute(definition.algorithm, names, context)
    if not outputs:
        raise Fault(
            ARGUMENTS,
            f"function `{definition.name}` has no output",
            definition.span,
            "nothing to return",
            helps=("declare `output Real y;`",),
        )
    result = names[outputs[0].name]
    if result is None or any(entry is None for entry in entries(result)):
        raise Fault(ARGUMENTS, f"`{definition.name}` never assigns all of `{outputs[0].name}`", outputs[0].span, "not assigned")
    return result


def _check_argument(definition: Definition, item: ast.Declarator, value: Value, node: ast.Call, context: Context) -> None:
    shape = shape_of(value)
    wanted = tuple(None if isinstance(dim, ast.Colon) else evaluate_integer(dim, context) for dim in item.dims)
    if len(shape) != len(wanted) or any(w is not None and w != n for w, n in zip(wanted, shape, strict=True)):
        shown = "x".join(":" if w is None else str(w) for w in wanted)
        raise Fault(
            ARGUMENTS,
            f"argument `{item.name}` of `{definition.name}` is {describe(value)}, not {f'of size {shown}' if wanted else 'a scalar'}",
            node.span,
            "in this call",
            others=[(item.span, "declared here")],
        )


def _execute(statements: Sequence[ast.AlgorithmStatement], names: dict[str, Value], context: Context) -> None:
    for statement in statements:
        if isinstance(statement, ast.ForAssign):
            for turn in iterations(statement.iterators, context):
                loop = {item.name: (turn.locals or {})[item.name] for item in statement.iterators}
                hidden = {name: names[name] for name in loop if name in names}
                names.update(loop)
                _execute(statement.body, names, context)
                for name in loop:
                    del names[name]
                names.update(hidden)
            continue
        step = statement.target.parts[0]
        if step.name not in names or len(statement.target.parts) > 1:
            raise Fault(UNKNOWN_NAME, f"`{statement.target.text}` is no variable of this function", statement.target.span, "not declared")
        value = evaluate(statement.value, context)
        names[step.name] = _assigned(names[step.name], step, value, statement, context) if step.subscripts else value


def _assigned(old: Value, step: ast.Part, value: Value, statement: ast.Assign, context: Context) -> Value:
    """The array with the entries that the subscripts name replaced."""
    shape = shape_of(old)
    if len(step.subscripts) > len(shape):
        raise Fault(INDEX, f"{counted(len(step.subscripts), 'subscript')} on {describe(old)}", step.span, "")
    axes = [position(step.subscripts[k], size, context) if k < len(step.subscripts) else list(range(size)) for k, size in enumerate(shape)]
    target = tuple(len(axis) for axis in axes if not isinstance(axis, int))
    if shape_of(value) != target:
        raise Fault(MISFIT, f"{describe(value)} is assigned to {shown_shape(target)}", statement.span, "")
    new = old.copy()
    places = spots([[axis] if isinstance(axis, int) else axis for axis in axes])
    for spot, entry in zip(places, entries(value), strict=True):
        new[spot] = entry
    return new
