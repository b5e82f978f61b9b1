"""Values of parameters: bindings evaluated, overrides applied, types and bounds checked, circles found.

Input        ParameterPart
Output       the same with `values`, `low`, `high`, `unit`; finally `ir.graph.Parameter`
Establishes  values read other parameters only, and no parameter depends on itself
Reports      BG240 no value, BG241 circle, BG242 out of bounds, BG243 a parameter reads a variable, BG244 wrong type of value,
             BG220 unknown override
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from bgdsl.diagnostics import Code, did_you_mean
from bgdsl.expr import ONE, Expr, const, param
from bgdsl.ir.graph import Parameter, scalar_names
from bgdsl.passes.claims import attribute, chosen_entries, claimed_value
from bgdsl.passes.elaborate import evaluate_integer
from bgdsl.passes.names import UNKNOWN_TARGET
from bgdsl.passes.parts import CYCLE, NO_VALUE, Build, Claim, Fault, ParameterPart, Reported
from bgdsl.passes.shapes import Value, array_of, entries, leaves_of, parameters_of, shape_of, shown_shape, unknowns_of
from bgdsl.passes.values import kind_of
from bgdsl.source import Span
from bgdsl.syntax import ast

BOUNDS = Code("BG242", "a parameter is out of its bounds")
VARIABLE = Code("BG243", "a parameter reads a variable")
TYPE = Code("BG244", "a value is of the wrong type or size")


def evaluate_parameter(build: Build, part: ParameterPart) -> None:
    """Fill in the part's values. A failure is reported once and leaves it `failed`."""
    if part.state == "open":
        raise Fault(CYCLE, f"`{part.name}` depends on itself", part.origin.span, "its value needs its own value")
    if part.state != "new":
        return
    part.state = "open"
    try:
        _bind(build, part)
        part.state = "done"
    except Fault as fault:
        part.state, part.values = "failed", None
        build.fault(fault, part.origin.path)
    except Reported:
        part.state, part.values = "failed", None


def _bind(build: Build, part: ParameterPart) -> None:
    value, span = _binding(build, part)
    if part.open_shape:
        _settle_shape(part, value, span)
    elif shape_of(value) != part.shape:
        raise Fault(
            TYPE,
            f"`{part.name}` is {shown_shape(part.shape)}, its value is {shown_shape(shape_of(value))}",
            span,
            shown_shape(shape_of(value)),
            others=[(part.origin.span, "declared here")],
        )
    wanted = {"String": "string", "Table": "table"}.get(part.type, "number")
    if kind_of(value) != wanted and entries(value):
        raise Fault(
            TYPE, f"`{part.name}` is a {part.type}, its value is a {kind_of(value)}", span, "", others=[(part.origin.span, "declared here")]
        )
    _check_truth(part, span)
    if wanted != "number":
        part.value = value
        part.values = ()
        return
    part.values = entries(value)
    for item in part.values:
        for leaf in unknowns_of(item):
            raise _reads_variable(part, leaf, span)
    _attributes(part)
    if part.fixed and all(build.parameter_of(name)[0].constant for item in part.values for name in parameters_of(item)):
        part.value, part.constant = _folded(part, value), True
    elif part.value is None:
        part.value = leaves_of(param, part.name, part.shape)
    if part.type == "Integer":
        _check_whole(build, part, span)


def _folded(part: ParameterPart, value: Value) -> Value:
    """What reading a constant gives: its numbers. An entry with a unit keeps its name unless it is zero, so that `1*F` with a
    lever arm of 1 m does not lose the metre before units are checked."""
    assert part.values is not None
    if all(item.is_const for item in part.values) and part.unit in ("", "1"):
        return value
    named = entries(leaves_of(param, part.name, part.shape) if part.shape else param(part.name))
    kept = [item if item.is_zero else name for item, name in zip(part.values, named, strict=True)]
    return array_of(kept, part.shape) if part.shape else kept[0]


def _check_truth(part: ParameterPart, span: Span) -> None:
    """A truth value is no number: `true` for a Boolean, `1` for an Integer or a Real."""
    written = next((entry.value for entry, _, _ in part.claims if entry.value is not None), None)
    wrong = ast.Number if part.type == "Boolean" else ast.Boolean
    if isinstance(written, wrong) and part.member is not None:
        what = "a number" if wrong is ast.Number else "a truth value"
        others = [(part.origin.span, "declared here")]
        raise Fault(TYPE, f"`{part.name}` is a {part.type}, its value is {what}", span, what, others=others)


def _reads_variable(part: ParameterPart, leaf: Expr, span: Span) -> Fault:
    what = "time" if leaf.op == "time" else f"variable `{leaf.data}`"
    return Fault(
        VARIABLE,
        f"parameter `{part.name}` reads {what}",
        span,
        "changes during a run",
        helps=(f"declare it as a variable: `Real {part.name.rpartition('.')[2]} = ...;`",) if part.member is not None else (),
    )


def _binding(build: Build, part: ParameterPart) -> tuple[Value, Span]:
    """The value and where it is written: an override, else the outermost claim's."""
    if part.name in build.overrides:
        build.used.add(part.name)
        return _overridden(build, part, _lifted(build.overrides[part.name], part)), part.origin.span
    pieces: list[Claim] = []
    for claim in part.claims:
        entry = claim[0]
        pieces.append(claim)
        if entry.value is not None:
            value = claimed_value(claim)
            if part.shape and part.member is None and not shape_of(value):
                value = array_of([value] * int(np.prod(part.shape)), part.shape)
            for piece in reversed(pieces):
                value = _replaced(value, piece)
            return _overridden(build, part, value), entry.value.span
    if build.part and not part.constant and part.type in ("Real", "Integer", "Boolean"):
        part.nominal = True
        return _nominal(part), part.origin.span
    raise Fault(
        NO_VALUE,
        f"parameter `{part.name}` has no value",
        part.origin.span,
        "declared without a value",
        helps=("give it one here, or where it is used: `... (" + part.name.rpartition(".")[2] + " = 1)`",),
    )


def _nominal(part: ParameterPart) -> Value:
    """What stands for a value that the users of a part will give: 1."""
    if part.open_shape and part.member is not None:
        dims = (*part.member.declarator.dims, *part.member.declaration.type.dims)
        return array_of([ONE], (1,) * len(dims))
    return array_of([ONE] * int(np.prod(part.shape)), part.shape) if part.shape else ONE


def _lifted(value: Any, part: ParameterPart) -> Value:
    """A value from outside (numbers, truth values, strings, nested tuples of them)."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool | int | float | np.number):
        return const(float(value))
    numbers = _numbers(value)
    if numbers is None:
        raise Fault(TYPE, f"`{_as_written(value)}` is no array of numbers for `{part.name}`", part.origin.span, "declared here")
    return array_of([const(number) for number in numbers.flat], numbers.shape)


def _numbers(value: Any) -> np.ndarray[Any, Any] | None:
    """A number or nested sequences of numbers as an array; None for anything else, and for rows of unequal lengths."""
    try:
        found = np.asarray(value)
    except ValueError:
        return None
    return found.astype(float) if found.dtype.kind in "bif" else None


def given_numbers(value: Any, name: str, shape: tuple[int, ...], span: Span) -> tuple[Expr, ...]:
    """A value from outside as the entries of an array of this shape; one number fills it."""
    numbers = _numbers(value)
    if numbers is None or numbers.shape not in ((), shape):
        wanted = shown_shape(shape) if shape else "a number"
        raise Fault(TYPE, f"`{name}` is {wanted}, its value is `{_as_written(value)}`", span, "declared here")
    return tuple(const(number) for number in np.broadcast_to(numbers, shape).flat)


def _as_written(value: Any) -> str:
    """A value from outside in the language's notation."""
    if isinstance(value, tuple | list):
        return f"{{{', '.join(map(_as_written, value))}}}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _overridden(build: Build, part: ParameterPart, value: Value) -> Value:
    """Overrides of single entries: `gain[1]`."""
    shape = shape_of(value)
    if not build.overrides or not shape:
        return value
    changed = value.copy()
    for i, name in enumerate(scalar_names(part.name, shape)):
        if name in build.overrides:
            build.used.add(name)
            (changed.flat[i],) = given_numbers(build.overrides[name], name, (), part.origin.span)
    return changed


def _replaced(value: Value, claim: Claim) -> Value:
    """The value with what a claim says of single entries; the first of two that say something of one entry holds."""
    if not claim[0].parts:
        return value
    changed = value.copy() if shape_of(value) else value
    for spot, new in chosen_entries(claim, shape_of(value)):
        changed[spot] = new
    return changed


def _settle_shape(part: ParameterPart, value: Value, span: Span) -> None:
    """`Real r[:]` takes the size of its value."""
    shape = shape_of(value)
    assert part.member is not None
    dims = (*part.member.declarator.dims, *part.member.declaration.type.dims)
    if len(dims) != len(shape):
        raise Fault(TYPE, f"`{part.name}` has {len(dims)} dimensions, its value is {shown_shape(shape)}", span, "")
    author = part.claims[0][1] if part.claims else None
    for dim, size in zip(dims, shape, strict=True):
        if not isinstance(dim, ast.Colon) and author is not None and evaluate_integer(dim, author) != size:
            raise Fault(TYPE, f"`{part.name}` has another size than its value, {shown_shape(shape)}", span, "")
    part.shape = shape
    part.structural |= 0 in shape  # an empty array matters by its size alone
    part.value = None


def _attributes(part: ParameterPart) -> None:
    if not any(entry.nested for entry, _, _ in part.claims):
        return
    part.unit = unit_of(part.claims, part.shape)
    part.low = spread(attribute(part.claims, "min"), part.shape, part.origin.span, "min")
    part.high = spread(attribute(part.claims, "max"), part.shape, part.origin.span, "max")


def unit_of(claims: Any, shape: tuple[int, ...]) -> str:
    """The unit that the claims give; of an array with several, none."""
    unit = attribute(claims, "unit")
    kinds = set(entries(unit)) if unit is not None else {""}
    return str(kinds.pop()) if len(kinds) == 1 else ""


def spread(value: Value | None, shape: tuple[int, ...], span: Span, what: str) -> tuple[Expr, ...] | None:
    """An attribute's values for every entry of an array: its own, or one for all."""
    if value is None:
        return None
    if kind_of(value) != "number":
        raise Fault(TYPE, f"`{what}` is a number", span, "")
    if not shape_of(value):
        return (value,) * int(np.prod(shape, dtype=int))
    if shape_of(value) != shape:
        raise Fault(TYPE, f"`{what}` is {shown_shape(shape_of(value))}, the variable is {shown_shape(shape)}", span, "declared here")
    return entries(value)


def _check_whole(build: Build, part: ParameterPart, span: Span) -> None:
    for item in part.values or ():
        if item.is_const and not float(item.data).is_integer():
            raise Fault(TYPE, f"`{part.name}` is an Integer, its value is {item.data:g}", span, "not whole")


# ------------------------------------------------------------------------------------------------------------ the result


def finish_parameters(build: Build, parts: Iterable[ParameterPart], span: Span) -> tuple[Parameter, ...]:
    """Every parameter in the flat graph's form, once circles are excluded and bounds checked."""
    kept = [part for part in parts if part.state == "done" and part.type not in ("String", "Table")]
    _check_overrides(build, span)
    if not any(part.nominal for part in kept):
        _evaluate_all(build, kept)
        for part in kept:
            _check_bounds(build, part)
    return tuple(
        Parameter(
            part.name,
            part.shape,
            part.values or (),
            part.origin,
            part.unit,
            part.comment,
            part.low,
            part.high,
            part.structural,
            part.constant,
            part.type == "Integer",
        )
        for part in kept
    )


def _check_overrides(build: Build, span: Span) -> None:
    known = [*build.parameters]
    for name in build.overrides:
        if name not in build.used:
            build.report.add(
                UNKNOWN_TARGET, f"there is no parameter `{name}` to set", span, "in this model", helps=did_you_mean(name, known)
            )


def _evaluate_all(build: Build, parts: Iterable[ParameterPart]) -> None:
    """The default of every parameter as a number, or the report of a circle."""
    for part in parts:
        for name, item in zip(scalar_names(part.name, part.shape), part.values or (), strict=True):
            if name in build.numbers:
                continue
            if item.op == "const":
                build.numbers[name] = item.data
            elif item.op == "param" and item.data in build.numbers:
                build.numbers[name] = build.numbers[item.data]
            else:
                try:
                    build.number(param(name), part.origin.span, structural=False)
                except Fault as fault:
                    build.fault(fault, part.origin.path)
                except Reported:
                    pass


def _check_bounds(build: Build, part: ParameterPart) -> None:
    for bounds, word, sign in ((part.low, "min", 1.0), (part.high, "max", -1.0)):
        if bounds is None:
            continue
        for name, bound in zip(scalar_names(part.name, part.shape), bounds, strict=True):
            try:
                limit = build.number(bound, part.origin.span, structural=False)
            except Fault as fault:
                build.fault(fault, part.origin.path)
                continue
            except Reported:
                continue
            value = build.numbers.get(name)
            if value is not None and sign * value < sign * limit:
                build.fault(
                    Fault(
                        BOUNDS,
                        f"`{name}` is {value:g}, its `{word}` is {limit:g}",
                        _value_span(part),
                        f"{value:g}",
                        others=[(part.origin.span, f"declared with {word} {limit:g}")],
                    ),
                    part.origin.path,
                )


def _value_span(part: ParameterPart) -> Span:
    return next((entry.value.span for entry, _, _ in part.claims if entry.value is not None), part.origin.span)
