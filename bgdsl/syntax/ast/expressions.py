"""What is written where a value is meant, and what a node of the tree is."""

from __future__ import annotations

from dataclasses import dataclass, field

from bgdsl.source import Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A node of the tree; where it stands takes no part in equality."""

    span: Span = field(compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Number(Node):
    """`1`, `0.5`, `1e-3`; `text` is the spelling, which the printer keeps; an integer has neither point nor exponent."""

    value: float
    text: str = field(compare=False)

    @property
    def is_integer(self) -> bool:
        return self.text.isdigit()


@dataclass(frozen=True, slots=True)
class String(Node):
    """Text between double quotes, escapes resolved."""

    value: str


@dataclass(frozen=True, slots=True)
class Boolean(Node):
    """`true` or `false`."""

    value: bool


@dataclass(frozen=True, slots=True)
class Colon(Node):
    """A bare `:` as a subscript: the whole of that dimension."""


@dataclass(frozen=True, slots=True)
class End(Node):
    """`end` inside a subscript (the last index), or as a time in a test (`r.x(end)`)."""


@dataclass(frozen=True, slots=True)
class Part(Node):
    """One step of a dotted name, with its subscripts: `cyl[2]`."""

    name: str
    subscripts: tuple[Expression, ...] = ()


@dataclass(frozen=True, slots=True)
class Reference(Node):
    """A dotted name: `crank.inertia.p[1]`."""

    parts: tuple[Part, ...]

    @property
    def text(self) -> str:
        """The name without subscripts."""
        return ".".join(part.name for part in self.parts)


@dataclass(frozen=True, slots=True)
class Call(Node):
    """`f(x, y, k = 2)`; also `der(x)`, `table("file", x = "angle", ...)` and, in tests, `r.vA.f(end)`."""

    function: Reference
    arguments: tuple[Expression, ...]
    named: tuple[tuple[str, Expression], ...] = ()


@dataclass(frozen=True, slots=True)
class Subscripted(Node):
    """Subscripts on something that is not a name: `f(x)[1]`."""

    value: Expression
    subscripts: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Unary(Node):
    """`-`, `+` or `not`."""

    operator: str
    operand: Expression


@dataclass(frozen=True, slots=True, eq=False)
class Binary(Node):
    """`+ - * / ^ .+ .- .* ./ .^ == <> < <= > >= and or`; in tests also `+-`. Chains lean left, `(a + b) + c`, and may be long:
    whoever follows `left` does so with a loop."""

    operator: str
    left: Expression
    right: Expression

    def __eq__(self, other: object) -> bool:
        one, twin = self, other
        while isinstance(twin, Binary):
            if one is twin:
                return True
            if one.operator != twin.operator or one.right != twin.right:
                return False
            if not isinstance(one.left, Binary):
                return one.left == twin.left
            one, twin = one.left, twin.left
        return False

    def __hash__(self) -> int:
        return hash((self.operator, self.right))


@dataclass(frozen=True, slots=True)
class If(Node):
    """`if c then a elseif d then b else e`."""

    branches: tuple[tuple[Expression, Expression], ...]
    otherwise: Expression


@dataclass(frozen=True, slots=True)
class Range(Node):
    """`start:stop` or `start:step:stop`."""

    start: Expression
    step: Expression | None
    stop: Expression


@dataclass(frozen=True, slots=True)
class Iterator(Node):
    """`i in 1:6`; several iterators of one loop are nested, the first outermost."""

    name: str
    over: Expression


@dataclass(frozen=True, slots=True)
class Array(Node):
    """`{a, b, c}`."""

    items: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Comprehension(Node):
    """`{f(i) for i in 1:3}` with function None, or a reduction `sum(f(i) for i in 1:3)`."""

    function: str | None
    body: Expression
    iterators: tuple[Iterator, ...]


@dataclass(frozen=True, slots=True)
class Matrix(Node):
    """`[1, 0; 0, 1]`."""

    rows: tuple[tuple[Expression, ...], ...]


Expression = (
    Number | String | Boolean | Colon | End | Reference | Call | Subscripted | Unary | Binary | If | Range | Array | Comprehension | Matrix
)
