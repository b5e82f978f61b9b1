"""Elements with their laws: which parameter or law was given, and what it is.

Input        ElementPart, all parts of the model being made
Output       ir.graph.Element
Establishes  each element has exactly the laws of its kind; scalar and vector values are parameters of the flat model, matrices
             stay expressions so that their structural zeros are seen
Reports      BG250 value missing, BG251 contradictory, BG252 a constant kind reads variables, BG253 wrong size of a value,
             BG257 a law in other variables than its kind's; and what `law_checks` reports
"""

from __future__ import annotations

from functools import cache

from bgdsl.diagnostics import Code
from bgdsl.expr import ZERO, Expr, add, leaves, param
from bgdsl.ir.elements import Kind, component
from bgdsl.ir.graph import Element, Law, Port, scalar_names
from bgdsl.passes.claims import attribute, check_final, check_targets, claimed_value, nested
from bgdsl.passes.law_checks import Rows, check_rows
from bgdsl.passes.names import UNKNOWN_TARGET
from bgdsl.passes.parameters import given_numbers, spread, unit_of
from bgdsl.passes.parts import Build, Claim, ElementPart, Fault, ParameterPart, Reported
from bgdsl.passes.shapes import Value, entries, leaves_of, shape_of, shown_shape, unknowns_of, vector
from bgdsl.passes.values import diagonal, full, kind_of
from bgdsl.source import Span
from bgdsl.syntax import ast

MISSING = Code("BG250", "an element's value is missing")
BOTH = Code("BG251", "an element is given two values that exclude each other")
MODULATED = Code("BG252", "an element of a constant kind reads what changes")
VALUE_SIZE = Code("BG253", "an element's value has the wrong size")
WRONG_LAW = Code("BG257", "a law is written in variables that its kind does not relate")

LAWS = {"C": ("e", "q"), "I": ("f", "p"), "R": ("e", "f")}
"""The variables that the law of a kind relates; a nonlinear law gives one of them."""

STARTS = {"C": ("q", "e"), "I": ("p", "f")}

_TARGETS = {name: frozenset(names) for name, names in {
    "Se": ("e",), "Sf": ("f",), "MSe": ("e",), "MSf": ("f",),
    "I": ("I", "f", "p", "parasitic"), "C": ("C", "k", "e", "q", "parasitic"), "R": ("R", "G", "e", "f", "parasitic"),
    "TF": ("m", "T"), "MTF": ("m", "T"), "GY": ("r", "G"), "MGY": ("r", "G"), "EJS": ("G",),
}.items()}  # fmt: skip


# ------------------------------------------------------------------------------------------------------- what was given


def settle(build: Build, part: ElementPart) -> None:
    """Find the parameter or law that was given, once, and make it a parameter of the flat model if it is one."""
    if part.settled:
        return
    part.settled = True
    kind = part.kind
    check_targets(build, part.claims, _TARGETS[kind.name], lambda: f"{kind.article} {kind.name}", part.sized)
    name, claim = _given(part)
    if name not in kind.parameters:
        part.law = (name, claim)
        return
    value = claimed_value(claim)
    if kind_of(value) != "number" or isinstance(claim[0].value, ast.Boolean):
        what = "a truth value" if kind_of(value) == "number" else f"a {kind_of(value)}"
        raise Fault(VALUE_SIZE, f"`{name}` of {kind.article} {kind.name} is a number, this is {what}", claim[0].span, what)
    _check_constant(part, name, value, claim[0].span)
    part.parameters[name] = _as_parameter(build, part, name, value, claim)


def _given(part: ElementPart) -> tuple[str, Claim]:
    kind = part.kind
    known = (*kind.parameters, *(name for name in LAWS.get(kind.name, ()) if name not in kind.parameters))
    for entry, author, index in part.claims:
        found = [name for name in known if name in entry.nested and entry.nested[name].value is not None]
        if len(found) > 1:
            first, second = (entry.nested[name] for name in found[:2])
            raise Fault(
                BOTH,
                f"`{part.name}` is given both `{found[0]}` and `{found[1]}`",
                second.span,
                "and this",
                others=[(first.span, "this")],
                helps=("give one of them; a law may read any parameter of the model under its own name",),
            )
        if found:
            if len(part.claims) > 1:
                said = [other.nested[name] for other, _, _ in part.claims for name in known if name in other.nested]
                check_final(said, found[0])
            inner = entry.nested[found[0]]
            return found[0], (inner, author, () if inner.each else index)
    if any(name not in _TARGETS[kind.name] for entry, _, _ in part.claims for name in entry.nested):
        raise Reported  # what was meant to be the value has another name
    wanted = " or ".join(f"`{name} = ...`" for name in kind.parameters)
    law = LAWS.get(kind.name)
    raise Fault(
        MISSING,
        f"{kind.name} `{part.name}` has no value",
        part.member.span,
        f"{wanted} is missing",
        helps=(f"write `{kind.name} {part.member.name}({kind.parameters[0]} = ...)`{f', or a law `{law[0]} = ...`' if law else ''}",),
    )


def _check_constant(part: ElementPart, name: str, value: Value, span: Span) -> None:
    """Kinds without modulation read parameters (sources: and time) only."""
    kind = part.kind
    if kind.modulated or kind.name == "R":
        return
    for item in entries(value):
        for leaf in unknowns_of(item):
            if leaf.op == "time" and kind.name in ("Se", "Sf"):
                continue
            what = "time" if leaf.op == "time" else f"`{leaf.data}`"
            if kind.name in ("I", "C"):
                law = "f = p/..." if kind.name == "I" else "e = q/..."
                helps = (f"a storage that changes is written as a law: `{kind.name} {part.member.name}({law})`",)
            else:
                helps = (f"use the modulated kind: `M{kind.name} {part.member.name}({name} = ...)`",)
            raise Fault(
                MODULATED, f"{kind.name} `{part.name}` reads {what}, which changes during a run", span, f"reads {what}", helps=helps
            )


def _as_parameter(build: Build, part: ElementPart, name: str, value: Value, claim: Claim) -> Value:
    """A scalar or vector value over parameters becomes a parameter of the flat model; its leaves are returned."""
    path = f"{part.name}.{name}"
    if len(shape_of(value)) > 1 or any(unknowns_of(item) for item in entries(value)):
        return value
    made = ParameterPart(path, "Real", shape_of(value), None, (claim,), part.origin, state="done")
    made.values = _overridden(build, path, made.shape, entries(value), part.member.span)
    if claim[0].nested:
        made.unit = unit_of((claim,), made.shape)
        made.low = spread(attribute((claim,), "min"), made.shape, claim[0].span, "min")
        made.high = spread(attribute((claim,), "max"), made.shape, claim[0].span, "max")
    made.comment = ""
    build.parameters[path] = made
    made.value = leaves_of(param, path, made.shape) if made.shape else param(path)
    return made.value


def _overridden(build: Build, path: str, shape: tuple[int, ...], values: tuple[Expr, ...], span: Span) -> tuple[Expr, ...]:
    """The values of an element's parameter, or what was set from outside in place of all or of single ones."""
    overrides = build.overrides
    if path in overrides:
        build.used.add(path)
        values = given_numbers(overrides[path], path, shape, span)
    if not overrides or not shape:
        return values
    names = scalar_names(path, shape)
    single = {name: given_numbers(overrides[name], name, (), span)[0] for name in names if name in overrides}
    build.used |= single.keys()
    return tuple(single.get(name, value) for name, value in zip(names, values, strict=True))


def element_parameter(build: Build, part: ElementPart, name: str, span: Span) -> Value:
    """What reading `spring.k` gives."""
    settle(build, part)
    if name in part.parameters:
        return part.parameters[name]
    given = next(iter(part.parameters), None)
    helps = (f"it is given by `{given}`",) if given else ("it is given by a law",)
    raise Fault(MISSING, f"`{part.name}` is not given by `{name}`", span, "", others=[(part.member.span, "declared here")], helps=helps)


# ------------------------------------------------------------------------------------------------------------- elements


def make_element(build: Build, part: ElementPart) -> Element:
    """The element in the flat graph's form."""
    settle(build, part)
    kind = part.kind
    laws: tuple[Law, ...] = ()
    modulus = linear = None
    if part.law is not None:
        laws = _nonlinear(part, *part.law)
    else:
        (name,) = part.parameters
        value = part.parameters[name]
        span = next((entry.nested[name].span for entry, _, _ in part.claims if name in entry.nested), part.member.span)
        if kind.state is None and kind.inward is False:
            laws = _source_laws(part, name, value, span)
        else:
            rows = _rows(part, name, value, span)
            check_rows(build, part, name, rows, span)
            if kind.name in LAWS:
                linear = (name, rows)
                laws = _linear_laws(part, name, rows)
            else:
                modulus = rows
    return Element(
        part.name,
        kind.name,
        _ports(kind, part.sizes),
        part.origin,
        laws,
        modulus,
        linear,
        _states(part),
        _starts(part) if any(not _LETTERS.isdisjoint(entry.nested) for entry, _, _ in part.claims) else _NO_STARTS,
        _parasitic(build, part),
        part.comment,
    )


@cache
def _ports(kind: Kind, sizes: tuple[int | None, ...]) -> tuple[Port, ...]:
    if kind.ports == 1:
        return (Port("", sizes[0], kind.inward),)
    return (Port("p1", sizes[0], True), Port("p2", sizes[1], False))


def _variables(part: ElementPart, letter: str) -> tuple[Expr, ...]:
    return entries(vector(f"{part.name}.{letter}", part.sizes[0]))


def _states(part: ElementPart) -> tuple[str, ...]:
    if part.kind.state is None:
        return ()
    base, size = f"{part.name}.{part.kind.state}", part.sizes[0]
    return (base,) if size is None else tuple(component(base, i) for i in range(size))


_LETTERS = frozenset("pqef")
_NO_STARTS: dict[str, Expr] = {}


def _starts(part: ElementPart) -> dict[str, Expr]:
    """Initial values by scalar variable; of the state or of its co-energy variable, not both."""
    found: dict[str, Expr] = {}
    first: Claim | None = None
    for letter in ("p", "q", "e", "f"):
        for claim in nested(nested(part.claims, letter), "start"):
            if letter not in STARTS.get(part.kind.name, ()):
                raise Fault(
                    UNKNOWN_TARGET,
                    f"`{letter}` of {part.kind.article} {part.kind.name} has no initial value",
                    claim[0].span,
                    "it is no state",
                )
            if first is not None:
                raise Fault(BOTH, f"`{part.name}` is given two initial values", claim[0].span, "and this", others=[(first[0].span, "this")])
            first = claim
            value = claimed_value(claim)
            size = part.sizes[0]
            if shape_of(value) not in ((), () if size is None else (size,)):
                raise Fault(VALUE_SIZE, f"the initial value of `{part.name}` is {shown_shape(shape_of(value))}", claim[0].span, "")
            given = spread(value, () if size is None else (size,), claim[0].span, "start")
            found |= {name.data: item for name, item in zip(_variables(part, letter), given or (), strict=True)}
            break
    return found


def _parasitic(build: Build, part: ElementPart) -> bool:
    value = attribute(part.claims, "parasitic") if part.kind.name in LAWS else None
    if value is None:
        return False
    if not isinstance(value, Expr) or (value.is_const and value.data not in (0.0, 1.0)):
        raise Fault(VALUE_SIZE, f"`parasitic` of `{part.name}` is true or false", part.member.span, "")
    return bool(build.number(value, part.member.span))


# ----------------------------------------------------------------------------------------------------------------- laws


def _source_laws(part: ElementPart, name: str, value: Value, span: Span) -> tuple[Law, ...]:
    size = part.sizes[0]
    shape = shape_of(value)
    if shape not in ((), () if size is None else (size,)):
        raise _wrong_size(part, name, value, span)
    values = entries(value) if shape or size is None else entries(value) * size
    return tuple(Law(left, right, part.origin) for left, right in zip(_variables(part, name), values, strict=True))


def _wrong_size(part: ElementPart, name: str, value: Value, span: Span) -> Fault:
    sizes = part.sizes
    if part.kind.ports == 2 and sizes[0] is not None:
        wanted = f"a matrix of {sizes[1]} x {sizes[0]}"
    elif sizes[0] is None:
        wanted = "a scalar"
    elif part.kind.inward:
        wanted = f"a scalar, a vector of {sizes[0]} (its diagonal) or a matrix of {sizes[0]} x {sizes[0]}"
    else:
        wanted = f"a vector of {sizes[0]}"
    return Fault(
        VALUE_SIZE,
        f"`{name}` of `{part.name}` is {shown_shape(shape_of(value))}, {wanted} is wanted",
        span,
        shown_shape(shape_of(value)),
        others=[(part.sized, "sized here")],
    )


def _rows(part: ElementPart, name: str, value: Value, span: Span) -> Rows:
    """The value as a matrix: port 2 by port 1; a scalar or vector on a square one is its diagonal."""
    columns = part.sizes[0] or 1
    height = columns if part.kind.ports == 1 else part.sizes[1] or 1
    shape = shape_of(value)
    if part.sizes[0] is None:
        if shape:
            raise _wrong_size(part, name, value, span)
        return ((value,),)
    if shape == () and height == columns:
        value = diagonal(full((columns,), value))
    elif shape == (columns,) and height == columns:
        value = diagonal(value)
    elif len(shape) == 1 and (height, columns) in ((1, shape[0]), (shape[0], 1)):
        value = value.reshape(height, columns)
    elif shape != (height, columns):
        raise _wrong_size(part, name, value, span)
    return tuple(tuple(row) for row in value)


def _is_diagonal(rows: Rows) -> bool:
    return all(entry is ZERO for i, row in enumerate(rows) for j, entry in enumerate(row) if i != j)


def _linear_laws(part: ElementPart, name: str, rows: Rows) -> tuple[Law, ...]:
    """I: f = p/I; C: e = q/C or e = k q; R: e = R f or f = G e. A full I or C relates p = I f, q = C e without being inverted."""
    letters = {"I": ("f", "p"), "C": ("e", "q"), "k": ("e", "q"), "R": ("e", "f"), "G": ("f", "e")}
    left, right = (_variables(part, letter) for letter in letters[name])
    origin = part.origin
    if name in ("I", "C"):
        if len(rows) == 1 or _is_diagonal(rows):
            return tuple(Law(left[i], right[i] / rows[i][i], origin) for i in range(len(rows)))
        left, right = right, left
    if len(rows) == 1:
        return (Law(left[0], rows[0][0] * right[0], origin),)
    return tuple(Law(left[i], add(a * x for a, x in zip(row, right, strict=True)), origin) for i, row in enumerate(rows))


def _nonlinear(part: ElementPart, name: str, claim: Claim) -> tuple[Law, ...]:
    """A law `name = expression` in the element's own variables, then in its author's names."""
    entry, author, index = claim
    size = part.sizes[0]
    own = {letter: vector(f"{part.name}.{letter}", size) for letter in part.kind.own}
    value = claimed_value((entry, author.with_locals(own), index))
    shape = () if size is None else (size,)
    if kind_of(value) != "number" or shape_of(value) != shape:
        raise _wrong_size(part, name, value, entry.span)
    related = LAWS[part.kind.name]
    foreign = {item.data: letter for letter in part.kind.own if letter not in related for item in _variables(part, letter)}
    for item in entries(value):
        for leaf in leaves((item,)):
            if leaf.data in foreign:
                raise Fault(
                    WRONG_LAW,
                    f"the law of {part.kind.article} {part.kind.name} relates `{related[0]}` and `{related[1]}`, "
                    f"this one reads `{foreign[leaf.data]}`",
                    entry.span,
                    f"reads `{foreign[leaf.data]}`",
                    helps=("put what depends on it into an element of its own",),
                )
    return tuple(Law(left, right, part.origin) for left, right in zip(_variables(part, name), entries(value), strict=True))
