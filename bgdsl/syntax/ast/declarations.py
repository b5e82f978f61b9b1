"""What is written among the declarations of a class: components with their modifications, bases, experiments, annotations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bgdsl.syntax.ast.expressions import Expression, Node, Reference


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
