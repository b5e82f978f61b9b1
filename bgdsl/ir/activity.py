"""Activities: how much power each scalar term moved over a run, and how that compares within its junction.

Energies in joules (`integral of |e f| dt`); `rho` is a fraction of the largest activity at the same junction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bgdsl.expr import Expr
from bgdsl.source import Span


@dataclass(frozen=True, slots=True)
class Integrands:
    """What a run has to integrate so that activities can be told.

    expressions: non-negative, each once. power[t], square[t]: which of them is |power| and conjugate squared of term t; None
    where that is identically zero, or (square) was not asked for.
    """

    expressions: tuple[Expr, ...]
    power: tuple[int | None, ...]
    square: tuple[int | None, ...]


@dataclass(frozen=True, slots=True)
class TermActivity:
    """One term at one junction. `index` is its place in `ScalarGraph.terms`; `name` reads well and is unique at its junction.

    activity: J. rho: activity over the junction's largest. strength: root of the integral of the conjugate squared (an effort at
    a 1-junction, a flow at a 0-junction) over the window, relative to the largest there; NaN where it was not measured.
    """

    index: int
    name: str
    bond: str
    entry: tuple[int, int] | None
    element: str | None
    activity: float
    rho: float
    strength: float
    parasitic: bool
    span: Span


@dataclass(frozen=True, slots=True)
class JunctionActivity:
    """A scalar junction: its merged name, its kind, its largest activity (J) and its terms in their order."""

    index: int
    name: str
    kind: Literal[0, 1]
    max_activity: float
    terms: tuple[TermActivity, ...]


@dataclass(frozen=True, slots=True)
class ElementActivity:
    """A storage, a resistor or a user element: its activity (J) and its share of the total of all of them."""

    name: str
    kind: str
    activity: float
    index: float


@dataclass(frozen=True, slots=True)
class ActivityReport:
    """Every term's activity over `window` (s); `error` bounds the quadrature error relative to the largest activity."""

    model: str
    experiment: str | None
    window: tuple[float, float]
    junctions: tuple[JunctionActivity, ...]
    elements: tuple[ElementActivity, ...]
    error: float = 0.0

    def term(self, index: int) -> TermActivity:
        """The record of one term by its place in the scalar graph."""
        return self.by_index()[index]

    def by_index(self) -> dict[int, TermActivity]:
        """Every term's record by its place in the scalar graph."""
        return {term.index: term for junction in self.junctions for term in junction.terms}
