"""The scalar normal form: every vector opened, touching junctions of one kind merged, each term of each balance on its own.

Causality, equations, activity and conditioning all work on this form. An entry T[i,j] of a matrix transformer that is not
identically zero is a scalar transformer from the 1-junction of component j of port 1 to the 0-junction of component i of
port 2; entries of matrix gyrators and of Euler junction structures are scalar gyrators between two 1-junctions.

Unknowns are one common variable a junction (`ScalarJunction.variable`) and the conjugates that nothing else expresses
(`ScalarGraph.unknowns`): one for each port of a one-port or user element, and for a scalar transformer or gyrator (m, r its
modulus; 1 and 2 the junctions at its ports, x1 and x2 their variables) what this table says:

    between           conjugate at port 1   conjugate at port 2   own unknowns      relations
    TF   1 and 0      m x2                  m x1
    TF   1 and 1      m p2.e                p2.e                  p2.e              x2 = m x1
    TF   0 and 0      p1.f                  m p1.f                p1.f              x1 = m x2
    TF   0 and 1      p1.f                  p2.e                  p1.f, p2.e        x2 = m p1.f,  x1 = m p2.e
    GY   1 and 1      r x2                  r x1
    GY   1 and 0      r p2.f                p2.f                  p2.f              x2 = r x1
    GY   0 and 1      p1.f                  r p1.f                p1.f              x1 = r x2
    GY   0 and 0      p1.f                  p2.f                  p1.f, p2.f        x1 = r p2.f,  x2 = r p1.f

So nothing is divided by a modulus. Equations are the junction balances, the elements' laws and the relations: as many as unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from bgdsl.expr import Expr
from bgdsl.ir.graph import BondGraph, Origin


@dataclass(frozen=True, slots=True)
class ScalarJunction:
    """`variable` is the common flow of a 1-junction or the common effort of a 0-junction.

    name: that of the first merged junction component (`v[2]`), or of the element port that made it where two elements are
    bonded directly or a matrix has more than one entry there (`arm.p2[1]`). members: every junction component merged into
    it, as (junction name, component from 0); empty where an element port made it.
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
    bond, component: the flat bond (and its component from 0, None for a scalar bond) that brings it here. Every entry at a
    port component names the one bond of that port component.
    element: the element it belongs to or leads to (None for a plain bond between junctions); port: that element's port here;
    entry: (row, column) from 0 in a matrix modulus, None for a scalar two-port, for a one-port, and for the bond from a
    junction to the junction that a matrix port made (there `element` is the matrix, `entry` None, and both ends are listed).
    modulus: of a two-port's term: conjugate here = modulus x far side's variable in the multiplying direction, else None.
    other: index of the term at the far end of the same bond or two-port, None at an element's only junction.
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
    modulus: Expr | None = None
    spot: int = 0
    """The component (from 0) of the element's port."""
    weight: Expr | None = None
    """A factor of the term in this balance and nowhere else: a parameter with which a run deletes it (`passes/weights.py`)."""

    @property
    def balanced(self) -> Expr:
        """The conjugate as the balance counts it."""
        return self.conjugate if self.weight is None else self.weight * self.conjugate

    @property
    def is_two_port(self) -> bool:
        """Does it lead through a transformer or gyrator (entry)?"""
        return self.modulus is not None


@dataclass(frozen=True, slots=True)
class Relation:
    """left = right: what a scalar transformer or gyrator demands beside its conjugates (see the module's table).

    `left` is a junction's variable; `term` is the two-port's term at that junction: if causality makes it that junction's
    determiner, the relation assigns `left`.
    """

    left: Expr
    right: Expr
    element: str
    term: int
    origin: Origin


@dataclass(frozen=True, slots=True)
class InnerBond:
    """A bond (component) between merged junctions: it is no term of the balance.

    The terms with indices from `start` to `stop` (exclusive) are those beyond its `side` end: what it brings to the other end is
    their sum. (The terms of a junction have consecutive indices.)
    `loop`: it closes a loop of like junctions, so that its share is not determined; it counts as carrying none.
    """

    bond: str
    component: int | None
    junction: int
    side: Literal["tail", "head"]
    start: int
    stop: int
    loop: bool = False


@dataclass(frozen=True, slots=True)
class ScalarGraph:
    """`terms_at[j]` are the indices of the terms of junction j. `aliases` maps every junction, element port and bond variable of
    the flat graph that is no unknown of its own (`v.f[2]`, `arm.p1.f[1]`, `b4.e`) to its value in terms of the unknowns.

    unknowns: the conjugates that are unknowns of their own, in order; the junctions' variables come beside them.
    """

    graph: BondGraph
    junctions: tuple[ScalarJunction, ...]
    terms: tuple[Term, ...]
    terms_at: tuple[tuple[int, ...], ...]
    aliases: Mapping[str, Expr]
    relations: tuple[Relation, ...] = ()
    unknowns: tuple[str, ...] = ()
    inner: tuple[InnerBond, ...] = ()

    def verify(self) -> None:
        """Assert: each term is listed at its junction once, far ends point at each other, no two touching junctions of one kind,
        and no variable is both an unknown and an alias."""
        assert sorted(t for at in self.terms_at for t in at) == list(range(len(self.terms)))
        for index, term in enumerate(self.terms):
            assert term.index == index
            assert term.index in self.terms_at[term.junction]
            if term.other is not None:
                far = self.terms[term.other]
                assert far.other == term.index
                if not term.is_two_port:
                    assert self.junctions[far.junction].kind != self.junctions[term.junction].kind
        own = {junction.variable for junction in self.junctions} | set(self.unknowns)
        assert len(own) == len(self.junctions) + len(self.unknowns), "two unknowns have one name"
        assert own.isdisjoint(self.aliases)
