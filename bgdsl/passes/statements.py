"""Statements of models: loops unrolled, conditions decided, bonds handed to `connect`, equations and assertions made scalar.

Input        the statements of a class, in the context of an instance
Output       ir.graph.SignalEquation, Check, and an element's Law
Establishes  every equation is between scalars
Reports      BG270 variable without equation, BG271 variable with two, BG272 sides of different size, BG258 an element's equations
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from bgdsl.diagnostics import Code
from bgdsl.expr import leaves
from bgdsl.ir.graph import Check, Element, Law, Origin, Port, Signal, SignalEquation, scalar_names
from bgdsl.passes.claims import attribute, claimed_value
from bgdsl.passes.connect import connect
from bgdsl.passes.elaborate import evaluate, evaluate_now, evaluate_scalar, iterations
from bgdsl.passes.names import head
from bgdsl.passes.parameters import spread, unit_of
from bgdsl.passes.parts import ArrayPart, Build, Context, Fault, Instance, PortPart, Reported, SignalPart
from bgdsl.passes.shapes import entries, shape_of, shown_shape
from bgdsl.passes.values import kind_of
from bgdsl.syntax import ast

EQUATIONS_OF_ELEMENT = Code("BG258", "an element has too many or too few equations")
NO_EQUATION = Code("BG270", "a variable has no equation")
TWO_EQUATIONS = Code("BG271", "a variable has two equations")
SIDES = Code("BG272", "the sides of an equation differ in size")
MEANINGLESS = Code("BG273", "a statement has no meaning here")


@dataclass(slots=True)
class Lines:
    """What the statements of all instances came to; equations wait until every bond is known."""

    waiting: list[tuple[ast.Statement, Context, bool]] = field(default_factory=list)
    equations: list[SignalEquation] = field(default_factory=list)
    initial: list[SignalEquation] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    laws: dict[str, list[Law]] = field(default_factory=dict)
    defined: dict[str, SignalEquation] = field(default_factory=dict)


def walk(instance: Instance, lines: Lines) -> None:
    """Make the instance's bonds, and put its equations on the waiting list."""
    for initial, statements in ((False, instance.cls.statements), (True, instance.cls.initial)):
        for statement, scope in statements:
            _attempt(statement, instance.context(scope), initial, lines)


def _attempt(statement: ast.Statement, context: Context, initial: bool, lines: Lines) -> None:
    try:
        _walk_one(statement, context, initial, lines)
    except Fault as fault:
        context.build.fault(fault, context.path)
    except Reported:
        pass


def _walk_one(statement: ast.Statement, context: Context, initial: bool, lines: Lines) -> None:
    match statement:
        case ast.BondChain():
            if initial:
                raise Fault(MEANINGLESS, "a bond is no initial equation", statement.span, "", helps=("put it into the `equation` section",))
            connect(statement, context)
        case ast.For():
            for turn in iterations(statement.iterators, context):
                for inner in statement.body:
                    _attempt(inner, turn, initial, lines)
        case ast.IfStatement():
            for inner in _branch(statement, context):
                _attempt(inner, context, initial, lines)
        case _:
            lines.waiting.append((statement, context, initial))


def _branch(statement: ast.IfStatement, context: Context) -> Sequence[ast.Statement]:
    for condition, body in statement.branches:
        if evaluate_now(condition, context):
            return body
    return statement.otherwise


# ------------------------------------------------------------------------------------------------------------ equations


def settle_lines(lines: Lines, build: Build) -> None:
    """Evaluate what waited."""
    for statement, context, initial in lines.waiting:
        try:
            match statement:
                case ast.Equation():
                    _equation(statement, context, initial, lines)
                case ast.Assertion():
                    _assertion(statement, context, lines)
                case _:
                    raise AssertionError(statement)
        except Fault as fault:
            build.fault(fault, context.path)
        except Reported:
            pass


def _assertion(statement: ast.Assertion, context: Context, lines: Lines) -> None:
    message = evaluate(statement.message, context)
    condition = evaluate_scalar(statement.condition, context)
    if not isinstance(message, str):
        raise Fault(MEANINGLESS, "the message of an assertion is a string", statement.message.span, "")
    lines.checks.append(Check(condition, message, Origin(context.path, statement.span)))


def _equation(statement: ast.Equation, context: Context, initial: bool, lines: Lines) -> None:
    left, right = evaluate(statement.left, context), evaluate(statement.right, context)
    if shape_of(left) != shape_of(right) or kind_of(left) != "number" or kind_of(right) != "number":
        raise Fault(
            SIDES,
            f"the left side is {shown_shape(shape_of(left))}, the right side {shown_shape(shape_of(right))}",
            statement.span,
            "both sides of an equation have one size",
            others=[(statement.left.span, shown_shape(shape_of(left))), (statement.right.span, shown_shape(shape_of(right)))],
        )
    origin = Origin(context.path, statement.span)
    instance = context.instance
    assert instance is not None
    made = [SignalEquation(a, b, origin) for a, b in zip(entries(left), entries(right), strict=True)]
    if initial:
        lines.initial += made
    elif instance.cls.is_element and not _defines_signal(statement.left, instance):
        lines.laws.setdefault(instance.path, []).extend(Law(e.left, e.right, origin) for e in made)
    else:
        lines.equations += made
        for equation in made:
            _note_definition(equation, lines, context.build)


def _defines_signal(left: ast.Expression, instance: Instance) -> bool:
    """Whether the left side of an element's equation is a variable declared there, or its derivative."""
    if isinstance(left, ast.Call) and left.function.text == "der" and left.arguments:
        left = left.arguments[0]
    return isinstance(left, ast.Reference) and isinstance(instance.part(left.parts[0].name), SignalPart)


def _note_definition(equation: SignalEquation, lines: Lines, build: Build) -> None:
    if equation.left.op != "var":
        return
    name = equation.left.data
    old = lines.defined.get(name)
    if old is not None:
        raise Fault(
            TWO_EQUATIONS,
            f"`{name}` has two equations",
            equation.origin.span,
            "the second",
            others=[(old.origin.span, "the first")],
            helps=("a variable is given once, by its declaration or by one equation",),
        )
    lines.defined[name] = equation


# -------------------------------------------------------------------------------------------------------------- signals


def declared_equation(part: SignalPart, lines: Lines, build: Build) -> None:
    """`Real y = 2*x;` is an equation."""
    claim = next((claim for claim in part.claims if claim[0].value is not None), None)
    if claim is None:
        return
    value = claimed_value(claim)
    span = claim[0].value.span if claim[0].value is not None else part.origin.span
    if shape_of(value) != part.shape or kind_of(value) != "number":
        what = shown_shape(shape_of(value)) if kind_of(value) == "number" else f"a {kind_of(value)}"
        raise Fault(
            SIDES,
            f"`{part.name}` is {shown_shape(part.shape)}, its value is {what}",
            span,
            what,
            others=[(part.origin.span, "declared here")],
        )
    part.role = "algebraic"
    for left, right in zip(entries(part.value), entries(value), strict=True):
        equation = SignalEquation(left, right, part.origin)
        lines.equations.append(equation)
        _note_definition(equation, lines, build)


def make_signal(part: SignalPart, read: set[str]) -> Signal:
    """The signal; it is a state if some equation reads its derivative."""
    scalars = scalar_names(part.name, part.shape)
    role = part.role
    if any(f"der({name})" in read for name in scalars):
        if role == "input":
            raise Fault(
                MEANINGLESS,
                f"the derivative of input `{part.name}` is not known",
                part.origin.span,
                "an input",
                helps=("make it an input of its own",),
            )
        role = "state"
    starts = None
    unit = ""
    if any(entry.nested for entry, _, _ in part.claims):
        starts = spread(attribute(part.claims, "start"), part.shape, part.origin.span, "start")
        unit = unit_of(part.claims, part.shape)
    comment = part.member.declarator.comment or ""
    return Signal(part.name, part.shape, role, part.origin, starts, part.output, unit, comment)  # type: ignore[arg-type]


def check_defined(part: SignalPart, signal: Signal, read: set[str], lines: Lines, build: Build) -> None:
    """A variable that no equation mentions has no value."""
    if signal.role == "input":
        return
    missing = [
        name
        for name in signal.scalars()
        if name not in lines.defined and f"der({name})" not in lines.defined and not _mentioned(name, read)
    ]
    if missing:
        shown = f"`{missing[0]}`" if len(missing) == 1 else f"`{part.name}`"
        build.fault(
            Fault(
                NO_EQUATION,
                f"variable {shown} has no equation",
                part.origin.span,
                "declared here",
                helps=(
                    f"give it one: `{part.member.name} = ...;` or `der({part.member.name}) = ...;`, or declare it `parameter` or `input`",
                ),
            ),
            part.origin.path,
        )


def _mentioned(name: str, read: set[str]) -> bool:
    return name in read or f"der({name})" in read


def names_read(equations: Sequence[SignalEquation]) -> set[str]:
    """Every variable that the equations mention, on either side."""
    return {leaf.data for leaf in leaves(side for equation in equations for side in (equation.left, equation.right))}


# ------------------------------------------------------------------------------------------------------------- elements


def make_field(instance: Instance, lines: Lines) -> Element:
    """A user's element with its ports and laws."""
    ports = tuple(Port(_local(part, instance), part.size, not part.out, part.domain) for part in ports_of(instance))
    laws = tuple(lines.laws.get(instance.path, ()))
    wanted = sum(port.width for port in ports)
    if len(laws) != wanted and instance.build.report.errors:
        raise Reported  # perhaps one of those that failed
    if len(laws) != wanted:
        raise Fault(
            EQUATIONS_OF_ELEMENT,
            f"element `{instance.cls.name}` has {len(laws)} equations between its ports, {wanted} are wanted",
            head(instance.cls.node.span),
            "one for each port (and component)",
            helps=("an equation of an element relates the efforts and flows of its ports",),
        )
    origin = instance.declared or Origin("", instance.cls.node.span)
    return Element(instance.path, "field", ports, origin, laws, comment=instance.comment)


def _local(part: PortPart, instance: Instance) -> str:
    return part.name[len(instance.path) + 1 :]


def ports_of(instance: Instance) -> Iterator[PortPart]:
    """The ports of an element, arrays of ports opened, in order; each is given its position."""
    position = 0
    for name in instance.cls.members:
        part = instance.part(name)
        for item in part.items if isinstance(part, ArrayPart) else (part,):
            if isinstance(item, PortPart):
                item.position = position
                position += 1
                yield item
