"""The scalar graph with causality: which term determines each junction's variable, which storages keep integral causality."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from bgdsl.ir.scalar import ScalarGraph

Cause = Literal["asserted", "source", "law", "modulus", "storage", "derivative", "chosen", "promoted", "far", "taken", "last", "none"]
"""Why a term is what it is: a stroke the user asserted; a source; a law that works in one direction; a modulus that must not be
divided by; a storage's preference (or its opposite, where that cannot be had); a free choice; the junction's variable being a
state; what its far end is (`far`); another term determining the junction (`taken`); no other term being left to (`last`)."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a term is (or is not) its junction's determiner. term: the far end (`far`) or the determiner (`taken`), else None."""

    cause: Cause
    term: int | None = None


@dataclass(frozen=True, slots=True)
class Constrained:
    """A place where no explicit assignment is possible: an unknown (the multiplier) and an equation that has to hold.

    Three forms, by what is set:
    - `term` None: junction `junction` has no determiner: its variable is the multiplier, its balance the equation. `source` is
      an Sf (at a 0-junction) or Se (at a 1-junction) on it, if any. With `velocity` its variable is no multiplier but a state:
      storages in derivative causality follow it, so its balance gives its derivative.
    - `term` and `source`: that source's term at a junction determined by another: the source's law is the equation, the
      term's conjugate the multiplier.
    - `term` alone: a two-port's term: the relation at it is the equation, the two-port's own unknown the multiplier.
    """

    junction: int
    source: str | None
    term: int | None = None
    velocity: bool = False


@dataclass(frozen=True, slots=True)
class CausalGraph:
    """determiner[j]: the term that sets junction j's variable, None where it is a multiplier (see `constrained`).
    strokes[bond][component] is `tail` or `head`: the end on which the effort acts. derivative: the states (`mass.p`) in
    derivative causality with the path of terms that forces it, the storage's own term first. loops: causal loops as tuples of
    junction indices. reasons[t]: why term t is or is not a determiner.
    """

    scalar: ScalarGraph
    determiner: tuple[int | None, ...]
    strokes: Mapping[str, tuple[Literal["tail", "head"], ...]]
    derivative: Mapping[str, tuple[int, ...]]
    constrained: tuple[Constrained, ...]
    loops: tuple[tuple[int, ...], ...]
    reasons: tuple[Reason, ...] = field(default=())

    def verify(self) -> None:
        """Assert: every junction has one determiner of its own or is constrained; both ends of a two-port or bond agree."""
        terms, junctions = self.scalar.terms, self.scalar.junctions
        free = {c.junction for c in self.constrained if c.term is None}
        for j, determiner in enumerate(self.determiner):
            assert (determiner is None) == (j in free), junctions[j].name
            assert determiner is None or terms[determiner].junction == j
        surplus = {c.term for c in self.constrained if c.term is not None}
        related = {relation.term for relation in self.scalar.relations}
        determiners = set(self.determiner)
        for term in terms:
            if term.other is None:
                continue
            far = terms[term.other]
            ends = (term.index in determiners) + (far.index in determiners)
            relations = (term.index in related) + (far.index in related)
            if term.index in surplus or far.index in surplus:
                continue
            assert ends == 1 if relations == 1 else ends in (0, 2), f"{term.bond} at {junctions[term.junction].name}"
