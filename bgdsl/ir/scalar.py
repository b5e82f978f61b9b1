"""The scalar normal form: every vector opened, touching junctions of one kind merged, each term of each balance on its own.

Causality, equations, activity and conditioning all work on this form. An entry T[i,j] of a matrix transformer that is not
identically zero is a scalar transformer from the 1-junction of component j of port 1 to the 0-junction of component i of
port 2; entries of matrix gyrators and of Euler junction structures are scalar gyrators between two 1-junctions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bgdsl.expr import Expr
from bgdsl.ir.graph import BondGraph, Origin


@dataclass(frozen=True, slots=True)
class ScalarJunction:
    """`variable` is the common flow of a 1-junction or the common effort of a 0-junction.

    name: that of the first merged junction component (`v[2]`), or of the element port that made it where two elements are
    bonded directly or a matrix has more than one entry there (`arm.p2[1]`). members: every junction component merged into
    it, as (junction name, component from 0). aliases: variables equal to `variable` (of merged junctions, of element ports).
    """

    name: str
    kind: Literal[0, 1]
    variable: str
    members: tuple[tuple[str, int], ...]
    origin: Origin


@dataclass(frozen=True, slots=True)
class Term:
    """One term of one junction's balance: sum over terms of sign x conjugate = 0.

    The power it brings into the junction is sign x common x conjugate, common being the junction's variable.
    conjugate: effort at a 1-junction, flow at a 0-junction. A bond between a 0- and a 1-junction needs no variable of its
    own: its conjugate at either end is the other junction's variable; an entry's is the modulus times that.
    bond, component: the flat bond (and its component, from 0, or None) that brings it here; "" for a bond that only the
    opening of a matrix made. element: the element it belongs to or leads to (None for a plain bond between junctions),
    port: that element's port here; entry: (row, column) from 0 in a matrix. other: index of the term at the far end of the
    same bond or two-port, None at an element's only junction.
    """

    index: int
    junction: int
    sign: Literal[1, -1]
    conjugate: Expr
    bond: str
    component: int | None
    element: str | None
    port: int
    entry: tuple[int, int] | None
    other: int | None
    parasitic: bool
    origin: Origin


@dataclass(frozen=True, slots=True)
class ScalarGraph:
    """`terms_at[j]` are the indices of the terms of junction j. `aliases` maps every junction or bond or port variable of the
    flat graph that is no unknown of its own (`v.f[2]`, `arm.p1.f[1]`, `b4.e`) to its value in terms of the unknowns."""

    graph: BondGraph
    junctions: tuple[ScalarJunction, ...]
    terms: tuple[Term, ...]
    terms_at: tuple[tuple[int, ...], ...]
    aliases: dict[str, Expr]

    def verify(self) -> None:
        """Assert: each term is listed at its junction once, far ends point at each other, no two touching junctions of one kind."""
        assert sorted(t for at in self.terms_at for t in at) == list(range(len(self.terms)))
        for term in self.terms:
            assert term.index in self.terms_at[term.junction]
            if term.other is not None:
                far = self.terms[term.other]
                assert far.other == term.index
                if term.element is None:
                    assert self.junctions[far.junction].kind != self.junctions[term.junction].kind
