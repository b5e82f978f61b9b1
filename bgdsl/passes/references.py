"""Names in expressions: what a dotted name stands for, and what reading it gives.

Output       the value of a parameter, signal or table; the variables of junctions, elements, ports and bonds
Reports      BG230 unknown name, BG236 not readable, BG237 absent component
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from bgdsl.diagnostics import Code, did_you_mean
from bgdsl.expr import TIME, const, var
from bgdsl.passes.evaluation import (
    INDEX,
    evaluate,
    position,
    select,
)
from bgdsl.passes.functions import BUILT_INS, CONSTANTS
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
    Unfinished,
)
from bgdsl.passes.shapes import Value, array_of, entries, shape_of, shown_shape, vector
from bgdsl.passes.values import matmul
from bgdsl.source import Span
from bgdsl.syntax import ast

UNREADABLE = Code("BG236", "a thing has no such value")
ABSENT = Code("BG237", "a component is used that its condition leaves out")


def evaluate_reference(node: ast.Reference, context: Context) -> Value:
    """What a name stands for where the context stands: a local, a parameter, a variable, a power, or an array of them."""
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
    """The fault of a name that is not there, with the closest one that is."""
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
    values = [read(part.items[int(np.ravel_multi_index(spot, part.shape))], inner, i, context) for spot in spots(axes)]
    shape = tuple(len(axis) for axis, where in zip(axes, chosen, strict=True) if not isinstance(where, int))
    rest = shape_of(values[0]) if values else ()
    for value, spot in zip(values, spots(axes), strict=True):
        if shape_of(value) != rest:
            raise _differing(part, node, i, (rest, shape_of(value)), (next(iter(spots(axes))), spot))
    return array_of([entry for value in values for entry in entries(value)], (*shape, *rest))


def _differing(
    part: ArrayPart,
    node: ast.Reference,
    i: int,
    shapes: tuple[tuple[int, ...], tuple[int, ...]],
    where: tuple[tuple[int, ...], tuple[int, ...]],
) -> Fault:
    """The finding that what the elements of an array give cannot be put into one array."""
    first, other = (f"`{part.name}[{','.join(str(k + 1) for k in spot)}]`" for spot in where)
    name = ".".join(step.name for step in node.parts[i + 1 :])
    return Fault(
        INDEX,
        f"`{name}` is not of one size in the elements of `{part.name}`",
        node.span,
        f"of {first} it is {shown_shape(shapes[0])}, of {other} {shown_shape(shapes[1])}",
        helps=("read one element, or those that are alike",),
    )


def spots(axes: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    """Every combination of one index from each axis, row-major."""
    return list(product(*axes))


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
            f"{part.shown} has no `{name}`",
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
            value = pair_value(part.name, part.size, rest[0])
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


def pair_value(name: str, size: int | None, letter: str) -> Value:
    """A pair's effort, flow or power by its name and letter: `e`, `f` or `power`."""
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
            return pair_value(f"{part.name}.{name}", part.sizes[int(name[1]) - 1], letter)
        return None
    if len(rest) != 1:
        return None
    if kind.ports == 1:
        if rest[0] in ("e", "f", "power"):
            return pair_value(part.name, part.sizes[0], rest[0])
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
    return pair_value(part.name, part.size, rest[0])
