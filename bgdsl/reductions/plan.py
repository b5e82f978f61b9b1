"""From dropped terms to what has to be rewritten: bonds to cut, two-ports to split, elements to remove.

Input        ScalarGraph, Decision
Output       Plan        every dropped term in exactly one change, keyed by flat bonds and elements
Establishes  a change needs no other one: each can be written where its statement stands
Reports      nothing
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from bgdsl.ir.graph import Bond, BondGraph, Element
from bgdsl.ir.scalar import ScalarGraph, Term
from bgdsl.reductions.condition import Decision

Action = Literal["tail", "head", "both"]
"""Which end of a bond lost its term."""


@dataclass(frozen=True, slots=True)
class Cut:
    """Components of a flat bond between junctions (or between a junction and a matrix port) that change: by component (from 0),
    what was dropped, and the terms at (tail, head)."""

    bond: Bond
    actions: Mapping[int, Action]
    terms: Mapping[int, tuple[int, int]]


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry of a two-port: its terms at port 1 and port 2 (of an EJS: at row and column), and which of them are dropped."""

    row: int
    column: int
    terms: tuple[int, int]
    dropped: tuple[bool, bool]

    @property
    def two_way(self) -> bool:
        return not any(self.dropped)

    @property
    def gone(self) -> bool:
        return all(self.dropped)


@dataclass(frozen=True, slots=True)
class Split:
    """A transformer, gyrator or Euler structure some of whose entries are no longer two-way. All its entries are listed."""

    element: Element
    entries: tuple[Entry, ...]


@dataclass(frozen=True, slots=True)
class Removal:
    """A one-port (or user element) with dropped terms. gone: all of it goes; else it is driven as an observer where they were: at
    the `spots`, as (port, component)."""

    element: Element
    gone: bool
    terms: tuple[int, ...]
    spots: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything that changes, in the order of the flat graph."""

    cuts: tuple[Cut, ...]
    splits: tuple[Split, ...]
    removals: tuple[Removal, ...]
    junctions: tuple[str, ...]
    """Junctions that lost all their terms."""

    @property
    def empty(self) -> bool:
        return not (self.cuts or self.splits or self.removals)


def plan(scalar: ScalarGraph, decision: Decision) -> Plan:
    """The changes that delete the decision's dropped terms."""
    graph = scalar.graph
    touched = [scalar.terms[t] for t in sorted(decision.dropped)]
    return Plan(
        _cuts(scalar, decision, [t for t in touched if t.other is not None and not t.is_two_port]),
        _splits(scalar, decision, {t.element for t in touched if t.is_two_port}),
        _removals(graph, decision, [t for t in touched if t.other is None]),
        _bare(scalar, decision),
    )


def _bare(scalar: ScalarGraph, decision: Decision) -> tuple[str, ...]:
    left: dict[str, bool] = defaultdict(lambda: True)
    for junction, at in zip(scalar.junctions, scalar.terms_at, strict=True):
        for name, _ in junction.members:
            ends = [t for here in at for t in (here, scalar.terms[here].other) if t is not None]
            left[name] = left[name] and bool(ends) and all(t in decision.dropped for t in ends)
    return tuple(junction.name for junction in scalar.graph.junctions if left[junction.name])


def _cuts(scalar: ScalarGraph, decision: Decision, touched: list[Term]) -> tuple[Cut, ...]:
    actions: dict[str, dict[int, Action]] = defaultdict(dict)
    terms: dict[str, dict[int, tuple[int, int]]] = defaultdict(dict)
    for term in touched:
        assert term.other is not None
        # a bond leaves the junction at its tail: its term there has the sign -1
        tail, head = (term.index, term.other) if term.sign < 0 else (term.other, term.index)
        at_tail, at_head = tail in decision.dropped, head in decision.dropped
        component = term.component or 0
        actions[term.bond][component] = "both" if at_tail and at_head else "tail" if at_tail else "head"
        terms[term.bond][component] = (tail, head)
    return tuple(Cut(bond, actions[bond.name], terms[bond.name]) for bond in scalar.graph.bonds if bond.name in actions)


def _splits(scalar: ScalarGraph, decision: Decision, names: set[str | None]) -> tuple[Split, ...]:
    entries: dict[str, list[Entry]] = defaultdict(list)
    for term in scalar.terms:
        if not term.is_two_port or term.element not in names or term.other is None:
            continue
        assert term.element is not None
        far = scalar.terms[term.other]
        if (term.port, term.spot, term.index) > (far.port, far.spot, far.index):
            continue
        row, column = term.entry or (0, 0)
        if term.port == far.port:  # an Euler structure: the pair by the components of its one port
            row, column = term.spot, far.spot
        dropped = (term.index in decision.dropped, far.index in decision.dropped)
        entries[term.element].append(Entry(row, column, (term.index, far.index), dropped))
    return tuple(Split(element, tuple(entries[element.name])) for element in scalar.graph.elements if element.name in entries)


def _removals(graph: BondGraph, decision: Decision, touched: list[Term]) -> tuple[Removal, ...]:
    terms: dict[str, list[Term]] = defaultdict(list)
    for term in touched:
        assert term.element is not None
        terms[term.element].append(term)
    return tuple(
        Removal(
            element,
            element.name not in decision.observers,
            tuple(term.index for term in terms[element.name]),
            tuple((term.port, term.spot) for term in terms[element.name]),
        )
        for element in graph.elements
        if element.name in terms
    )
