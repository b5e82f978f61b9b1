"""What a file is made of: models and elements, functions, types, domains, tests, imports."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from bgdsl.syntax.ast.declarations import Annotation, Argument, Declaration, Declarator, Experiment, Extends, Redeclaration, TypeName
from bgdsl.syntax.ast.expressions import Expression, Iterator, Node, Reference
from bgdsl.syntax.ast.statements import Section


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
