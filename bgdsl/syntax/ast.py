"""The syntax tree of `.bg` text: what was written, with the place of every node, and nothing about what it means.

Nodes are frozen and compare by content; `span` is left out of equality, so `parse(print(tree)) == tree` can be asserted.
(So never key a dictionary by a node: key it by `id` or by a path.)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from bgdsl.source import Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A node of the tree; where it stands takes no part in equality."""

    span: Span = field(compare=False, repr=False)


# ---------------------------------------------------------------------------------------------------------- expressions


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


# -------------------------------------------------------------------------------------------------------- modifications


@dataclass(frozen=True, slots=True)
class Modifier(Node):
    """`each final name.sub[2](nested) = value`. In `q(start = 1)` the modifier `q` has only `nested`."""

    name: Reference
    nested: tuple[Argument, ...] = ()
    value: Expression | None = None
    each: bool = False
    final: bool = False


@dataclass(frozen=True, slots=True)
class Redeclaration(Node):
    """`redeclare Class[dims] name[subscripts](arguments)`, among modifications or as an item of a model: another class for a
    component, or for the chosen elements of an array of them. As an item it is never `each`, and its span covers the semicolon."""

    type: TypeName
    name: str
    subscripts: tuple[Expression, ...] = ()
    arguments: tuple[Argument, ...] = ()
    each: bool = False
    final: bool = False
    comment: str | None = None


Argument = Modifier | Redeclaration


# --------------------------------------------------------------------------------------------------------- declarations


@dataclass(frozen=True, slots=True)
class TypeName(Node):
    """A class name with the dimensions of a vector kind: `J1[3]`, `MTF[3, 3]`, `mechanics.rigid.RigidBody`."""

    name: Reference
    dims: tuple[Expression, ...] = ()


@dataclass(frozen=True, slots=True)
class Declarator(Node):
    """One declared name: `cyl[6](rod(m = 6.4)) = binding if cond "comment"`."""

    name: str
    dims: tuple[Expression, ...] = ()
    arguments: tuple[Argument, ...] = ()
    value: Expression | None = None
    condition: Expression | None = None
    comment: str | None = None


Prefix = Literal["parameter", "constant", "input", "output", "open", "final", "replaceable", "protected", "port in", "port out"]


@dataclass(frozen=True, slots=True)
class Declaration(Node):
    """`prefixes Type[dims] a(...), b(...);`; the span covers the semicolon."""

    prefixes: tuple[Prefix, ...]
    type: TypeName
    declarators: tuple[Declarator, ...]


@dataclass(frozen=True, slots=True)
class Extends(Node):
    """`extends Base(p = 2);`"""

    base: Reference
    arguments: tuple[Argument, ...] = ()


@dataclass(frozen=True, slots=True)
class Experiment(Node):
    """`experiment NAME extends BASE(stopTime = 1, mA = 12) "comment";`"""

    name: str
    base: str | None
    arguments: tuple[Argument, ...]
    comment: str | None = None


@dataclass(frozen=True, slots=True)
class Annotation(Node):
    """`annotation(reduced(source = "engine.bg", ...));`: data for tools, with no meaning for the model."""

    arguments: tuple[Argument, ...]


# ----------------------------------------------------------------------------------------------------------- statements


@dataclass(frozen=True, slots=True)
class Arrow(Node):
    """A bond sign: vector for `=>`, and the asserted stroke, at the `tail` (`|->`) or at the `head` (`->|`)."""

    vector: bool
    stroke: Literal["tail", "head"] | None = None

    @property
    def text(self) -> str:
        sign = "=>" if self.vector else "->"
        return {None: sign, "tail": "|" + sign, "head": sign + "|"}[self.stroke]


@dataclass(frozen=True, slots=True)
class BondChain(Node):
    """`name: a -> b -> c, d;` where `ends` is ((a), (b), (c, d)): only the last may be a fan; one arrow between two ends."""

    name: str | None
    ends: tuple[tuple[Reference, ...], ...]
    arrows: tuple[Arrow, ...]
    comment: str | None = None


@dataclass(frozen=True, slots=True)
class Equation(Node):
    """`left = right;`"""

    left: Expression
    right: Expression
    comment: str | None = None


@dataclass(frozen=True, slots=True)
class For(Node):
    """`for i in 1:6, j in 1:2 loop ... end for;`"""

    iterators: tuple[Iterator, ...]
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class IfStatement(Node):
    """`if c then ... elseif d then ... else ... end if;` with parameter conditions."""

    branches: tuple[tuple[Expression, tuple[Statement, ...]], ...]
    otherwise: tuple[Statement, ...] = ()


@dataclass(frozen=True, slots=True)
class Assertion(Node):
    """`assert(condition, "message");` in a model: checked at every accepted step and at the start."""

    condition: Expression
    message: Expression


Statement = BondChain | Equation | For | IfStatement | Assertion


@dataclass(frozen=True, slots=True)
class Section(Node):
    """`equation` or `initial equation` with its statements."""

    initial: bool
    statements: tuple[Statement, ...]


# ---------------------------------------------------------------------------------------------------------- definitions


@dataclass(frozen=True, slots=True)
class Model(Node):
    """`model` or `element`: declarations, nested classes and sections in the order written."""

    kind: Literal["model", "element"]
    name: str
    comment: str | None
    items: tuple[ModelItem, ...]
    sections: tuple[Section, ...]


@dataclass(frozen=True, slots=True)
class Assign(Node):
    """`y := expr;` (or `y = expr;`) in an algorithm."""

    target: Reference
    value: Expression


@dataclass(frozen=True, slots=True)
class ForAssign(Node):
    """A `for` loop of an algorithm."""

    iterators: tuple[Iterator, ...]
    body: tuple[AlgorithmStatement, ...]


AlgorithmStatement = Assign | ForAssign


@dataclass(frozen=True, slots=True)
class ShortFunction(Node):
    """`function f(x, y[3]) = expr;`"""

    name: str
    inputs: tuple[Declarator, ...]
    body: Expression
    comment: str | None = None


@dataclass(frozen=True, slots=True)
class LongFunction(Node):
    """Modelica's form: `input`, `output`, `protected` declarations and one `algorithm` section."""

    name: str
    comment: str | None
    declarations: tuple[Declaration, ...]
    algorithm: tuple[AlgorithmStatement, ...]


@dataclass(frozen=True, slots=True)
class TypeDefinition(Node):
    """`type Stiffness = Real(unit = "N/m", min = 0);`"""

    name: str
    type: TypeName
    arguments: tuple[Argument, ...]
    comment: str | None = None


@dataclass(frozen=True, slots=True)
class DomainVariable(Node):
    """`effort Real p(unit = "Pa");` of a domain."""

    role: Literal["effort", "flow"]
    name: str
    arguments: tuple[Argument, ...] = ()
    comment: str | None = None


@dataclass(frozen=True, slots=True)
class Domain(Node):
    """`domain Acoustic "..." effort Real p(unit = "Pa"); flow Real u(unit = "m3/s"); end Acoustic;`"""

    name: str
    comment: str | None
    variables: tuple[DomainVariable, ...]


@dataclass(frozen=True, slots=True)
class RunStatement(Node):
    """`run r = Lever(RA = 0) experiment kick for 10 interval 0.1 tolerance 1e-9 method "rk45";`

    `run r = csv("file.csv");` reads a reference file: then `model` is `csv` and `file` its path.
    """

    name: str
    model: Reference
    arguments: tuple[Argument, ...] = ()
    experiment: str | None = None
    options: tuple[tuple[str, Expression], ...] = ()
    file: str | None = None


@dataclass(frozen=True, slots=True)
class TestAssertion(Node):
    """`assert condition;`, where a comparison may have a tolerance: `a == b +- 1e-4` or `+- 2 %` (relative of the wanted value)."""

    condition: Expression
    tolerance: Expression | None = None
    relative: bool = False
    message: str | None = None


@dataclass(frozen=True, slots=True)
class ExpectError(Node):
    """`expect error BG401 in Model(p = 1);`: compiling that model must report the code."""

    code: str
    model: Reference
    arguments: tuple[Argument, ...] = ()


TestStatement = RunStatement | TestAssertion | ExpectError


@dataclass(frozen=True, slots=True)
class Test(Node):
    """`test "name" ... end;`"""

    name: str
    statements: tuple[TestStatement, ...]


@dataclass(frozen=True, slots=True)
class Import(Node):
    """`import a.b.C;` is path (a, b) with names ((C, C)); `import M = a.b.C;` has names ((C, M)); `{A, B}` has several."""

    path: tuple[str, ...]
    names: tuple[tuple[str, str], ...]


Definition = Model | ShortFunction | LongFunction | TypeDefinition | Domain | Test
ModelItem = (
    Declaration
    | Redeclaration
    | Extends
    | Experiment
    | Annotation
    | Import
    | Model
    | ShortFunction
    | LongFunction
    | TypeDefinition
    | Domain
)


@dataclass(frozen=True, slots=True)
class Comment(Node):
    """A `//` or `/* */` comment with its signs; it stands in no other node."""

    text: str


@dataclass(frozen=True, slots=True)
class File(Node):
    """One `.bg` file: imports and definitions in the order written, and its comments by position."""

    items: tuple[Import | Definition, ...]
    comments: tuple[Comment, ...] = field(default=(), compare=False)
