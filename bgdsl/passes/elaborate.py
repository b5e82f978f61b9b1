"""Evaluate expressions of the tree to values: names resolved, arrays unrolled, functions inlined.

Input        ast.Expression, Context
Output       `expr.Expr`, a string, a table's name, or an object array of these
Establishes  the result reads parameters and variables by their flat scalar names only
Reports      BG230 unknown name, BG231 misfit, BG232 index out of range, BG235 recursive function, BG236 not readable,
             BG237 absent component
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from bgdsl.diagnostics import Code, did_you_mean
from bgdsl.expr import TIME, ZERO, Expr, add, const, derivative, leaves, substitute, table, topological, var
from bgdsl.ir.graph import Origin, SignalEquation
from bgdsl.passes import functions
from bgdsl.passes.functions import ARGUMENTS, BUILT_INS, CONSTANTS, wrong
from bgdsl.passes.names import head
from bgdsl.passes.parts import (
    CYCLE,
    UNKNOWN_NAME,
    Absent,
    ArrayPart,
    Broken,
    Context,
    ElementPart,
    Fault,
    Instance,
    JunctionPart,
    ParameterPart,
    PortPart,
    RawBond,
    Reported,
    SignalPart,
    TableName,
    Unfinished,
    Value,
    array_of,
    entries,
    shape_of,
    shown_shape,
    vector,
)
from bgdsl.passes.values import MISFIT, choose, elementwise, full, join_matrix, matmul, negate, operate, stack
from bgdsl.source import Span
from bgdsl.syntax import ast

INDEX = Code("BG232", "an index is out of range")
RECURSIVE = Code("BG235", "a function calls itself")
UNREADABLE = Code("BG236", "a thing has no such value")
ABSENT = Code("BG237", "a component is used that its condition leaves out")


def evaluate(node: ast.Expression, context: Context) -> Value:
    """The value of an expression; Fault where it has none."""
    return _EVALUATORS[type(node)](node, context)


def evaluate_scalar(node: ast.Expression, context: Context) -> Expr:
    value = evaluate(node, context)
    if not isinstance(value, Expr):
        raise Fault(MISFIT, "a single number is wanted here", node.span, _describe(value))
    return value


def evaluate_now(node: ast.Expression, context: Context) -> float:
    """The number that an expression over parameters is; those parameters become structural."""
    if type(node) is ast.Number:
        return node.value
    return context.build.number(evaluate_scalar(node, context), node.span)


def evaluate_integer(node: ast.Expression, context: Context) -> int:
    number = evaluate_now(node, context)
    if not float(number).is_integer():
        raise Fault(INDEX, f"a whole number is wanted here, this is {number:g}", node.span, "not whole")
    return int(number)


def _describe(value: Value) -> str:
    if isinstance(value, str):
        return "a string"
    return "a table" if isinstance(value, TableName) else shown_shape(shape_of(value))


# ------------------------------------------------------------------------------------------------------------ operators


def _number(node: ast.Number, context: Context) -> Value:
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
    count = max(0, int((stop - start) / step + 1e-9) + 1) if (stop - start) / step >= 0 else 0
    return [start + i * step for i in range(count)]


def iterations(iterators: Sequence[ast.Iterator], context: Context) -> Iterator[Context]:
    """The contexts of every turn of (nested) iterators."""
    if not iterators:
        yield context
        return
    first, rest = iterators[0], iterators[1:]
    over = evaluate(first.over, context)
    if isinstance(over, Expr):
        raise Fault(MISFIT, "an iterator runs over a range or a vector", first.over.span, "a scalar", helps=("write `1:n`",))
    for item in over:
        yield from iterations(rest, context.with_locals({first.name: item}))


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


# -------------------------------------------------------------------------------------------------------------- indices


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
        raise Fault(INDEX, "an index is a whole number or a vector of them", subscript.span, _describe(value))
    return [_checked(context.build.number(entry, subscript.span), size, subscript.span) for entry in value]


def _checked(number: float, size: int, span: Span) -> int:
    if not float(number).is_integer():
        raise Fault(INDEX, f"an index is a whole number, this is {number:g}", span, "not whole")
    if not 1 <= number <= size:
        allowed = f"1 to {size}" if size > 1 else "1" if size else "none, it is empty"
        raise Fault(INDEX, f"index {number:g} is out of range", span, f"allowed: {allowed}")
    return int(number) - 1


def _end(node: ast.End, context: Context) -> Value:
    if context.locals and "end" in context.locals:
        return context.locals["end"]
    raise Fault(UNKNOWN_NAME, "`end` has a meaning inside an index only", node.span, "")


def select(value: Value, subscripts: Sequence[ast.Expression], span: Span, context: Context) -> Value:
    """value[subscripts]; fewer subscripts than dimensions leave the rest whole."""
    if not subscripts:
        return value
    shape = shape_of(value)
    if len(subscripts) > len(shape):
        raise Fault(INDEX, f"{len(subscripts)} subscripts on {_describe(value)}", span, _describe(value))
    for axis in range(len(subscripts) - 1, -1, -1):
        value = value.take(position(subscripts[axis], shape[axis], context), axis=axis)
    return value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value


def _subscripted(node: ast.Subscripted, context: Context) -> Value:
    return select(evaluate(node.value, context), node.subscripts, node.span, context)


# ---------------------------------------------------------------------------------------------------------------- names


def _reference(node: ast.Reference, context: Context) -> Value:
    parts = node.parts
    first = parts[0]
    if context.locals is not None and first.name in context.locals:
        if len(parts) > 1:
            raise Fault(UNKNOWN_NAME, f"`{first.name}` has no parts", node.span, "")
        return select(context.locals[first.name], first.subscripts, node.span, context)
    instance = context.instance
    if instance is not None:
        part = instance.part(first.name)
        if part is None:
            part = instance.bonds.get(first.name)
        if part is not None:
            return read(part, node, 0, context)
    if first.name == "time" and len(parts) == 1:
        return TIME
    text = node.text
    if text in CONSTANTS:
        return const(CONSTANTS[text])
    outer = _enclosing_constant(node, context)
    if outer is not None:
        return outer
    raise unknown_name(first.name, node.span, context)


def _enclosing_constant(node: ast.Reference, context: Context) -> Value | None:
    """A constant of a class around this one; classes see those of the classes that they are written in."""
    scope = context.scope.outer
    while scope is not None and len(node.parts) == 1:
        around = context.build.names.bodies.get(id(scope))
        member = around.members.get(node.parts[0].name) if around is not None else None
        if member is not None and "constant" in member.prefixes and member.declarator.value is not None:
            value = evaluate(member.declarator.value, Context(context.build, None, scope))
            return select(value, node.parts[0].subscripts, node.span, context)
        scope = scope.outer
    return None


def unknown_name(name: str, span: Span, context: Context) -> Fault:
    known = {*(context.locals or ()), "time", "pi"}
    where = "here"
    if context.instance is not None:
        known |= {*context.instance.cls.members, *context.instance.bonds}
        where = f"in `{context.instance.cls.name}`"
    helps = did_you_mean(name, sorted(known))
    if name in BUILT_INS:
        helps = (f"`{name}` is a function: write `{name}(...)`",)
    elif name in ("e", "f", "p", "q"):
        helps = (f"`{name}` is an element's own variable inside its law, as in `R r(e = a*f*abs(f))`; elsewhere write `element.{name}`",)
    return Fault(UNKNOWN_NAME, f"unknown name `{name}`", span, f"not found {where}", helps=helps)


def read(part: Any, node: ast.Reference, i: int, context: Context) -> Value:
    """The value of what `part`, named by the i-th step of the reference, and the steps after it stand for."""
    step = node.parts[i]
    if isinstance(part, ArrayPart):
        return _read_array(part, node, i, context)
    if type(part) is ParameterPart or type(part) is SignalPart:
        if i + 1 < len(node.parts):
            raise Fault(UNKNOWN_NAME, f"`{step.name}` has no `{node.parts[i + 1].name}`", node.span, f"`{step.name}` is a value")
        value = part.value
        if value is None and isinstance(part, ParameterPart):
            value = context.build.parameter_value(part)
        return select(value, step.subscripts, node.span, context) if step.subscripts else value
    if isinstance(part, Broken):
        raise Reported
    if isinstance(part, Unfinished):
        raise Fault(
            CYCLE, f"`{part.name}` depends on itself", part.span, "its size or condition needs itself", others=[(node.span, "by this")]
        )
    if isinstance(part, Absent):
        raise Fault(
            ABSENT,
            f"`{part.name}` is not there: its condition is false",
            node.span,
            "used here",
            others=[(part.span, "left out by its condition")],
            helps=("put what uses it under the same condition",),
        )
    if step.subscripts and not (isinstance(part, JunctionPart | PortPart) and part.size is not None):
        raise Fault(INDEX, f"`{step.name}` is no array", node.span, "it takes no subscripts")
    if isinstance(part, Instance):
        return _read_instance(part, node, i, context)
    return _read_power(part, node, i, context)


def _read_array(part: ArrayPart, node: ast.Reference, i: int, context: Context) -> Value:
    """One component of an array of components, or a slice of them: an array of what each of them gives."""
    step = node.parts[i]
    subscripts = step.subscripts
    n = len(part.shape)
    chosen = [position(subscripts[k], size, context) if k < len(subscripts) else list(range(size)) for k, size in enumerate(part.shape)]
    inner = replace(node, parts=(*node.parts[:i], replace(step, subscripts=subscripts[n:]), *node.parts[i + 1 :]))
    if all(isinstance(where, int) for where in chosen):
        return read(part.items[int(np.ravel_multi_index(chosen, part.shape))], inner, i, context)
    axes = [[where] if isinstance(where, int) else where for where in chosen]
    values = [read(part.items[int(np.ravel_multi_index(spot, part.shape))], inner, i, context) for spot in _product(axes)]
    shape = tuple(len(axis) for axis, where in zip(axes, chosen, strict=True) if not isinstance(where, int))
    rest = shape_of(values[0]) if values else ()
    return array_of([entry for value in values for entry in entries(value)], (*shape, *rest))


def _product(axes: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    spots: list[tuple[int, ...]] = [()]
    for axis in axes:
        spots = [(*spot, k) for spot in spots for k in axis]
    return spots


def _read_instance(part: Instance, node: ast.Reference, i: int, context: Context) -> Value:
    if i + 1 == len(node.parts):
        raise Fault(UNREADABLE, f"`{node.text}` is a {part.cls.node.kind}, not a value", node.span, "name one of its variables")
    name = node.parts[i + 1].name
    found = part.part(name)
    if found is None:
        found = part.bonds.get(name)
    if found is None:
        raise Fault(
            UNKNOWN_NAME,
            f"`{part.cls.name}` has no `{name}`",
            node.parts[i + 1].span,
            "not found",
            others=[(head(part.cls.node.span), f"`{part.cls.name}` is defined here")],
            helps=did_you_mean(name, sorted({*part.cls.members, *part.bonds})),
        )
    member = part.cls.members.get(name)
    if member is not None and member.hidden:
        raise Fault(
            UNREADABLE, f"`{name}` of `{part.cls.name}` is protected", node.parts[i + 1].span, "", others=[(member.span, "declared here")]
        )
    return read(found, node, i + 1, context)


def _read_power(part: Any, node: ast.Reference, i: int, context: Context) -> Value:
    """A variable of a junction, an element, a port or a bond."""
    rest = [step.name for step in node.parts[i + 1 :]]
    value: Value = None
    match part:
        case JunctionPart():
            value = _junction_value(part, rest, node)
        case ElementPart():
            value = _element_value(part, rest, node, context)
        case PortPart():
            value = _port_value(part, rest, node, context)
        case RawBond() if rest and rest[0] in ("e", "f", "power") and len(rest) == 1:
            value = _pair_value(part.name, part.size, rest[0])
            context.build.renamed = True
    if value is None:
        what, known = _readable(part)
        raise Fault(
            UNREADABLE,
            f"{what} `{'.'.join(step.name for step in node.parts[: i + 1])}` has no {f'`{rest[0]}`' if rest else 'value of its own'}",
            node.span,
            f"it has {', '.join(f'`.{name}`' for name in known)}",
            helps=did_you_mean(rest[0], known) if rest else (),
        )
    for step in node.parts[i:]:
        value = select(value, step.subscripts, node.span, context)
    return value


def _readable(part: Any) -> tuple[str, tuple[str, ...]]:
    match part:
        case JunctionPart(kind=kind):
            return f"{kind}-junction", ("ef"[kind],)
        case ElementPart(kind=kind):
            names = ("p1.e", "p1.f", "p2.e", "p2.f") if kind.ports == 2 else (*kind.own, "power", *(("energy",) if kind.inward else ()))
            return f"{kind.name} element", (*names, *part.parameters)
        case PortPart():
            return "port", ("e", "f", "power")
        case _:
            return "bond", ("e", "f", "power")


def _pair_value(name: str, size: int | None, letter: str) -> Value:
    if letter != "power":
        return vector(f"{name}.{letter}", size)
    effort, flow = vector(f"{name}.e", size), vector(f"{name}.f", size)
    return effort * flow if size is None else matmul(effort, flow)


def _junction_value(part: JunctionPart, rest: list[str], node: ast.Reference) -> Value | None:
    letter = "ef"[part.kind]
    if rest == [letter]:
        return vector(f"{part.name}.{letter}", part.size)
    if rest == ["fe"[part.kind]]:
        other = "flow" if part.kind == 0 else "effort"
        raise Fault(
            UNREADABLE,
            f"a {part.kind}-junction has no common {other}",
            node.span,
            f"`{node.parts[-2].name}` is a {part.kind}-junction: read its `.{letter}`",
            notes=(f"each bond at a {part.kind}-junction has its own {other}",),
            helps=(f"name a bond, `b: ... -> ...;`, and read `b.{rest[0]}`, or read an element's",),
        )
    return None


def _element_value(part: ElementPart, rest: list[str], node: ast.Reference, context: Context) -> Value | None:
    kind = part.kind
    if kind.ports == 2 and len(rest) == 2 and rest[0] in ("p1", "p2"):
        name, letter = rest
        if letter in ("e", "f", "power"):
            return _pair_value(f"{part.name}.{name}", part.sizes[int(name[1]) - 1], letter)
        return None
    if len(rest) != 1:
        return None
    if kind.ports == 1:
        if rest[0] in ("e", "f", "power"):
            return _pair_value(part.name, part.sizes[0], rest[0])
        if rest[0] == kind.state:
            return vector(f"{part.name}.{kind.state}", part.sizes[0])
        if rest[0] == "energy" and kind.inward:
            return var(f"{part.name}.energy")
    if rest[0] in kind.parameters:
        return context.build.element_parameter(part, rest[0], node.span)
    return None


def _port_value(part: PortPart, rest: list[str], node: ast.Reference, context: Context) -> Value | None:
    if len(rest) != 1 or rest[0] not in ("e", "f", "power"):
        return None
    if not part.owner.cls.is_element:
        context.build.renamed = True
    return _pair_value(part.name, part.size, rest[0])


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
            return _inline(definition, node, Context(context.build, None, found.scope), context)
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
    raise wrong(f"`{node.function.text}` is no function", node.span, _describe(value), "only functions and tables can be called")


def _inline(definition: ast.ShortFunction | ast.LongFunction, node: ast.Call, inner: Context, outer: Context) -> Value:
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
        return array_of(rows, mapped)
    finally:
        build.calls.pop()


def _inputs(definition: ast.ShortFunction | ast.LongFunction) -> list[ast.Declarator]:
    if isinstance(definition, ast.ShortFunction):
        return list(definition.inputs)
    return [d for declaration in definition.declarations if "input" in declaration.prefixes for d in _declarators(declaration)]


def _declarators(declaration: ast.Declaration) -> list[ast.Declarator]:
    """The declarators with the dimensions of their type put in front of their own."""
    return [replace(d, dims=(*d.dims, *declaration.type.dims)) for d in declaration.declarators]


def _arguments(
    definition: ast.ShortFunction | ast.LongFunction, inputs: Sequence[ast.Declarator], node: ast.Call, outer: Context
) -> dict[str, Value]:
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
    definition: ast.ShortFunction | ast.LongFunction,
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


def _check_argument(
    definition: ast.ShortFunction | ast.LongFunction, item: ast.Declarator, value: Value, node: ast.Call, context: Context
) -> None:
    shape = shape_of(value)
    wanted = tuple(None if isinstance(dim, ast.Colon) else evaluate_integer(dim, context) for dim in item.dims)
    if len(shape) != len(wanted) or any(w is not None and w != n for w, n in zip(wanted, shape, strict=True)):
        shown = "x".join(":" if w is None else str(w) for w in wanted)
        raise Fault(
            ARGUMENTS,
            f"argument `{item.name}` of `{definition.name}` is {_describe(value)}, not {f'of size {shown}' if wanted else 'a scalar'}",
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
        raise Fault(INDEX, f"{len(step.subscripts)} subscripts on {_describe(old)}", step.span, "")
    axes = [position(step.subscripts[k], size, context) if k < len(step.subscripts) else list(range(size)) for k, size in enumerate(shape)]
    target = tuple(len(axis) for axis in axes if not isinstance(axis, int))
    if shape_of(value) != target:
        raise Fault(MISFIT, f"{_describe(value)} is assigned to {shown_shape(target)}", statement.span, "")
    new = old.copy()
    spots = _product([[axis] if isinstance(axis, int) else axis for axis in axes])
    for spot, entry in zip(spots, entries(value), strict=True):
        new[spot] = entry
    return new


# ----------------------------------------------------------------------------------------------------------- derivative


def _der(node: ast.Call, context: Context) -> Value:
    if len(node.arguments) != 1 or node.named:
        raise wrong("`der` takes one argument", node.span)
    return elementwise(lambda x: total_derivative(x, node.span, context), evaluate(node.arguments[0], context))


def total_derivative(x: Expr, span: Span, context: Context) -> Expr:
    """d/dt of an expression, by the chain rule."""
    if x.op == "var":
        return _der_leaf(x.data, span, context)
    terms = [derivative(x, leaf) * _der_leaf(leaf.data, span, context) for leaf in leaves((x,))]
    if any(node.op == "time" for node in topological((x,))):
        clock = var("time")
        (renamed,) = substitute((x,), {TIME: clock})
        (slope,) = substitute((derivative(renamed, clock),), {clock: TIME})
        terms.append(slope)
    return add(terms) if terms else ZERO


def _der_leaf(name: str, span: Span, context: Context) -> Expr:
    """The derivative of a variable: `der(x)` of a signal; a storage's displacement has its flow, its momentum its effort."""
    base, bracket, index = name.partition("[") if name not in context.build.nodes else (name, "", "")
    nodes = context.build.nodes
    if isinstance(nodes.get(name.rpartition("[")[0] if name.endswith("]") else name), SignalPart):
        return var(f"der({name})")
    owner, _, letter = base.rpartition(".")
    if not isinstance(nodes.get(owner), ElementPart) and name.endswith("]"):
        base, bracket, index = name.rpartition("[")
        owner, _, letter = base.rpartition(".")
    part = nodes.get(owner)
    if isinstance(part, ElementPart):
        match letter:
            case "q" | "p":
                return var(f"{owner}.{'fe'[letter == 'p']}{bracket}{index}")
            case "energy":
                power = _pair_value(owner, part.sizes[0], "power")
                assert isinstance(power, Expr)
                return power
            case _:
                pass
    return _rate(name, span, context)


def _rate(name: str, span: Span, context: Context) -> Expr:
    """The rate of a junction's, element's or bond's variable: that of an auxiliary signal that equals it."""
    build = context.build
    if name not in build.rates:
        made = build.rates[name] = f"rate#{len(build.rates) + 1}"
        origin = Origin(context.path, span)
        build.solved.append((made, (), origin))
        build.extra.append(SignalEquation(var(made), var(name), origin))
    return var(f"der({build.rates[name]})")


def _colon(node: ast.Colon, context: Context) -> Value:
    raise Fault(MISFIT, "`:` stands for a whole dimension inside an index only", node.span, "")


_EVALUATORS: dict[type, Callable[[Any, Context], Value]] = {
    ast.Number: _number,
    ast.String: _string,
    ast.Boolean: _boolean,
    ast.Colon: _colon,
    ast.End: _end,
    ast.Reference: _reference,
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
