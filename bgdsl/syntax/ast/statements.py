"""What is written in the equation sections of a class."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bgdsl.syntax.ast.expressions import Expression, Iterator, Node, Reference


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
