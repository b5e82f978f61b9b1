"""The working data of flattening: the parts that an instance is made of, while they are being made.

These are private to the flattening passes (`flatten` and its neighbours); what leaves them is `ir.graph.BondGraph`.
A part is made when it is first asked for, so declarations may stand in any order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import Expr, Table, evaluate
from bgdsl.ir.elements import Kind
from bgdsl.ir.graph import Instance as FlatInstance
from bgdsl.ir.graph import Origin, SignalEquation, scalar_names
from bgdsl.passes.modifications import Modification
from bgdsl.passes.names import Class, Member, Names, Resolved, Scope
from bgdsl.passes.shapes import Value, parameters_of, unknowns_of
from bgdsl.source import Span

UNKNOWN_NAME = Code("BG230", "unknown name")
STRUCTURAL = Code("BG233", "a value that shapes the model is not known at compile time")
CYCLE = Code("BG241", "parameters depend on each other in a circle")
NO_VALUE = Code("BG240", "a parameter has no value")


class Fault(Exception):  # noqa: N818 (a finding, not a failure)
    """A finding that ends the work on one thing (a parameter, a statement); the caller reports it and goes on with the next."""

    def __init__(
        self,
        code: Code,
        message: str,
        span: Span,
        label: str = "",
        *,
        others: Iterable[tuple[Span, str]] = (),
        notes: Iterable[str] = (),
        helps: Iterable[str] = (),
    ):
        super().__init__(message)
        self.code, self.message, self.span, self.label = code, message, span, label
        self.others, self.notes, self.helps = tuple(others), tuple(notes), tuple(helps)


class Reported(Exception):  # noqa: N818
    """Something that this needs was found wrong and has been reported."""


@dataclass(slots=True, eq=False)
class Context:
    """Where an expression is evaluated: the instance it belongs to (None in functions), the scope of its text, and local names."""

    build: Build
    instance: Instance | None
    scope: Scope
    locals: Mapping[str, Value] | None = None

    def with_locals(self, names: Mapping[str, Value]) -> Context:
        return Context(self.build, self.instance, self.scope, {**self.locals, **names} if self.locals else names)

    @property
    def path(self) -> str:
        return self.instance.path if self.instance is not None else ""


Index = tuple[tuple[int, int], ...]
"""Positions (from 0, with the size of their dimension) that a modification without `each` is still to be indexed with."""

Claim = tuple[Modification, Context, Index]
"""A modification with the context of its author. A thing's claims are ordered: the outermost, which wins, first."""


@dataclass(slots=True, eq=False)
class ParameterPart:
    """A parameter or constant. `value`: what reading it gives (leaves, or the values of a constant); `values`: its binding,
    row-major, once evaluated."""

    name: str
    type: str
    shape: tuple[int, ...]
    member: Member | None
    claims: tuple[Claim, ...]
    origin: Origin
    constant: bool = False
    structural: bool = False
    value: Value = None
    values: tuple[Expr, ...] | None = None
    unit: str = ""
    comment: str = ""
    low: tuple[Expr, ...] | None = None
    high: tuple[Expr, ...] | None = None
    open_shape: bool = False
    nominal: bool = False
    state: Literal["new", "open", "done", "failed"] = "new"

    @property
    def fixed(self) -> bool:
        """Whether nothing can change it: a constant, or declared or modified as final. Then plain numbers are read as such."""
        return self.constant or any(entry.final for entry, _, _ in self.claims)


@dataclass(slots=True, eq=False)
class SignalPart:
    """A Real whose value changes along a run."""

    name: str
    shape: tuple[int, ...]
    member: Member
    claims: tuple[Claim, ...]
    origin: Origin
    value: Value
    role: str = "algebraic"
    output: bool = False

    def scalars(self) -> tuple[str, ...]:
        return scalar_names(self.name, self.shape)


@dataclass(slots=True, eq=False)
class JunctionPart:
    """A 0- or 1-junction; `size` is None where it is scalar."""

    name: str
    kind: int
    size: int | None
    open: bool
    origin: Origin
    comment: str = ""
    joined: dict[int, int] = field(default_factory=dict)


@dataclass(slots=True, eq=False)
class ElementPart:
    """A primitive; `sizes` are those of its ports, written at `sized`; `joined` maps (port, component) to the bond there."""

    name: str
    kind: Kind
    sizes: tuple[int | None, ...]
    member: Member
    claims: tuple[Claim, ...]
    origin: Origin
    sized: Span
    comment: str = ""
    joined: dict[tuple[int, int], RawBond] = field(default_factory=dict)
    parameters: dict[str, Value] = field(default_factory=dict)
    settled: bool = False
    broken: bool = False
    law: tuple[str, Claim] | None = None


@dataclass(slots=True, eq=False)
class PortPart:
    """A port: `inside` and `outside` map a component to the bond there and its position in it."""

    name: str
    out: bool
    domain: str
    size: int | None
    owner: Instance
    member: Member
    origin: Origin
    position: int = 0
    inside: dict[int, tuple[RawBond, int]] = field(default_factory=dict)
    outside: dict[int, tuple[RawBond, int]] = field(default_factory=dict)


@dataclass(slots=True, eq=False)
class RawBond:
    """One bond as a statement wrote it, before ports are fused away; then `flat` maps its components to fused bonds and theirs."""

    name: str
    size: int | None
    tail: EndPoint
    head: EndPoint
    stroke: Any
    origin: Origin
    named: bool = False
    flat: dict[int, tuple[str, int | None]] = field(default_factory=dict)


EndPoint = tuple[Any, int, Sequence[int]]
"""(part, port index, components) of one end of a raw bond."""


@dataclass(slots=True, eq=False)
class ArrayPart:
    """An array of components, row-major."""

    name: str
    shape: tuple[int, ...]
    items: tuple[Any, ...]


@dataclass(slots=True, eq=False)
class Absent:
    """A component whose condition is false."""

    name: str
    span: Span


@dataclass(slots=True, eq=False)
class Broken:
    """A component that could not be made; the reason has been reported."""

    name: str


@dataclass(slots=True, eq=False)
class Unfinished:
    """A component that is being made: whoever asks for it now closes a circle."""

    name: str
    span: Span


Layer = tuple[dict[str, Modification], Context, Index]
"""Modifications of an instance's members by one author."""


@dataclass(slots=True, eq=False)
class Instance:
    """An instance of a model or element. `layers`: what is said about its members from outside, outermost first."""

    path: str
    cls: Class
    layers: tuple[Layer, ...]
    build: Build
    declared: Origin | None
    comment: str = ""
    outer: Instance | None = None
    parts: dict[str, Any] = field(default_factory=dict)
    bonds: dict[str, RawBond] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    contexts: dict[int, Context] = field(default_factory=dict)

    def context(self, scope: Scope) -> Context:
        """The context of the instance's own text, written in `scope` (its class's or a base's)."""
        found = self.contexts.get(id(scope))
        if found is None:
            found = self.contexts[id(scope)] = Context(self.build, self, scope)
        return found

    @property
    def shown(self) -> str:
        """The instance in messages: by its class; one of an array, which may differ from the others, by its index too."""
        return f"`{self.path}`, a `{self.cls.name}`," if self.path.endswith("]") else f"`{self.cls.name}`"

    def child(self, name: str) -> str:
        return f"{self.path}.{name}" if self.path else name

    def part(self, name: str) -> Any:
        """The member of that name, made now if it has not been asked for yet; None if there is none."""
        found = self.parts.get(name)
        if found is None and name in self.cls.members:
            found = self.build.make(self, self.cls.members[name])
        return found


@dataclass(slots=True, eq=False)
class Build:
    """Everything one flattening gathers, in the order in which it is found."""

    names: Names
    report: Reporter
    overrides: Mapping[str, Any]
    make: Callable[[Instance, Member], Any]
    evaluate_parameter: Callable[[ParameterPart], None]
    element_parameter: Callable[[ElementPart, str, Span], Value]
    make_table: Callable[[Any, Context], Value]
    instances: list[Instance] = field(default_factory=list)
    flat_instances: list[FlatInstance] = field(default_factory=list)
    parts: list[tuple[Any, Instance]] = field(default_factory=list)
    parameters: dict[str, ParameterPart] = field(default_factory=dict)
    raws: list[RawBond] = field(default_factory=list)
    tables: dict[str, Table] = field(default_factory=dict)
    table_keys: dict[tuple[Any, ...], str] = field(default_factory=dict)
    solved: list[tuple[str, tuple[int, ...], Origin]] = field(default_factory=list)
    rates: dict[str, str] = field(default_factory=dict)
    extra: list[SignalEquation] = field(default_factory=list)
    numbers: dict[str, float] = field(default_factory=dict)
    shared: dict[tuple[int, int], tuple[Any, Any, Value]] = field(default_factory=dict)
    redeclared: dict[int, tuple[Any, Resolved | None]] = field(default_factory=dict)
    calls: list[Any] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    reported: set[tuple[Any, ...]] = field(default_factory=set)
    checked: dict[int, Any] = field(default_factory=dict)
    nodes: dict[str, Any] = field(default_factory=dict)
    circular: set[str] = field(default_factory=set)
    renamed: bool = False
    part: bool = False

    def fault(self, fault: Fault, path: str = "") -> None:
        """Report a finding once, however many instances make it; the first is named."""
        key = (fault.code.number, id(fault.span.source), fault.span.start, fault.span.end)
        if key in self.reported:
            return
        self.reported.add(key)
        notes = (*fault.notes, f"in `{path}`") if path else fault.notes
        self.report.add(fault.code, fault.message, fault.span, fault.label, others=fault.others, notes=notes, helps=fault.helps)

    def parameter_value(self, part: ParameterPart) -> Value:
        """What reading a parameter gives that has no leaves of its own: a constant's values, a string, a table."""
        self.evaluate_parameter(part)
        if part.state == "failed" or part.value is None:
            raise Reported
        return part.value

    # -------------------------------------------------------------------------------------------- structural values

    def parameter_of(self, scalar: str) -> tuple[ParameterPart, int]:
        """The parameter to which a scalar name belongs, and the position of the entry."""
        part = self.parameters.get(scalar)
        if part is not None:
            return part, 0
        base, _, indices = scalar[:-1].rpartition("[")
        part = self.parameters[base]
        position = 0
        for index, size in zip(indices.split(","), part.shape, strict=True):
            position = position * size + int(index) - 1
        return part, position

    def number(self, root: Expr, span: Span, *, structural: bool = True) -> float:
        """The value of an expression over parameters, now. Marks those parameters as structural, if it is to shape the model."""
        if root.op == "const":
            return float(root.data)
        for leaf in unknowns_of(root):
            raise Fault(
                STRUCTURAL,
                f"`{'time' if leaf.op == 'time' else leaf.data}` is not known at compile time",
                span,
                "has to be known when the model is compiled",
                notes=("sizes, indices, conditions of components and loop bounds may read parameters and constants only",),
            )
        values = {name: self._entry(name) for name in parameters_of(root)}
        if structural:
            for name in values:
                self._mark(name)
        try:
            return evaluate(root, values, tables=self.tables)
        except (ArithmeticError, ValueError) as problem:
            raise Fault(STRUCTURAL, f"this cannot be evaluated: {_why(problem)}", span, "has no value") from None

    def _entry(self, name: str) -> float:
        """The number that a scalar parameter is; what it depends on is evaluated first, with an explicit stack."""
        stack = [name]
        opened: dict[str, None] = {}
        while stack:
            top = stack[-1]
            if top in self.numbers:
                stack.pop()
                continue
            if top in self.circular:
                raise Reported
            part, position = self.parameter_of(top)
            self.evaluate_parameter(part)
            if part.values is None:
                raise Reported
            root = part.values[position]
            missing = [leaf for leaf in parameters_of(root) if leaf not in self.numbers]
            if missing:
                opened[top] = None
                again = next((leaf for leaf in missing if leaf in opened), None)
                if again is not None:
                    names = list(opened)
                    raise circle_fault(self, names[names.index(again) :])
                stack += missing
                continue
            opened.pop(top, None)
            stack.pop()
            try:
                self.numbers[top] = evaluate(root, self.numbers, tables=self.tables)
            except (ArithmeticError, ValueError) as problem:
                raise Fault(NO_VALUE, f"parameter `{top}` has no value: {_why(problem)}", part.origin.span, "evaluated here") from None
            if not math.isfinite(self.numbers[top]):
                raise Fault(NO_VALUE, f"parameter `{top}` has no finite value: {self.numbers[top]:g}", part.origin.span, "evaluated here")
        return self.numbers[name]

    def _mark(self, name: str) -> None:
        """Mark a parameter and everything it is made of as structural."""
        stack = [name]
        while stack:
            part, _ = self.parameter_of(stack.pop())
            if not part.structural:
                part.structural = True
                stack += [leaf for value in part.values or () for leaf in parameters_of(value)]


def circle_fault(build: Build, circle: Sequence[str]) -> Fault:
    """The finding that these parameters depend on each other, each on the next."""
    build.circular.update(circle)
    parts = [build.parameter_of(name)[0] for name in circle]
    chain = " -> ".join(f"`{name}`" for name in (*circle, circle[0]))
    return Fault(
        CYCLE,
        f"parameters depend on each other: {chain}",
        parts[0].origin.span,
        f"`{circle[0]}` needs `{circle[1 % len(circle)]}`",
        others=[(part.origin.span, f"which needs `{circle[(i + 2) % len(circle)]}`") for i, part in enumerate(parts[1:])],
        helps=("give one of them a value of its own",),
    )


def _why(problem: Exception) -> str:
    """What stopped an evaluation, in the user's words."""
    match problem:
        case ZeroDivisionError():
            return "it divides by zero"
        case OverflowError():
            return "it grows beyond what a number holds"
        case ValueError() if str(problem).startswith("math"):
            return "a root, a logarithm or an arc function is asked for a value that it does not have"
        case _:
            return str(problem)
