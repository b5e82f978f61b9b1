"""Does every junction still have something that determines it, once terms are dropped? If not, the largest one comes back.

Input        ScalarGraph, ActivityReport, Decision
Output       Decision    with the terms that had to come back in `reinstated`
Establishes  no variable is left undetermined that the full model determined
Reports      nothing

The balances, laws, relations and signal equations are matched with the unknowns they are to give; what alternating
paths reach from an unmatched unknown is not determined (the underdetermined part of Dulmage and Mendelsohn).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from bgdsl.expr import Expr, leaves, var
from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.condition import Decision, settle


def reinstate(scalar: ScalarGraph, report: ActivityReport, decision: Decision, structure: Structure | None = None) -> Decision:
    """The decision with the largest dropped term given back to every junction that would be left undetermined. structure: of the
    graph, for those that ask often."""
    if not decision.dropped:
        return decision
    structure = structure or Structure(scalar)
    activity = {term.index: term.activity for junction in report.junctions for term in junction.terms}
    while True:
        gone = gone_elements(scalar, decision)
        lost = structure.undetermined(decision.dropped, gone) - structure.before
        back = {_largest(scalar, decision, j, activity) for j in lost} - {None}
        if not back:
            return decision
        decision = settle(scalar, decision.without(t for t in sorted(back, key=str) if t is not None))


def gone_elements(scalar: ScalarGraph, decision: Decision) -> frozenset[str]:
    """The one-ports that are removed with their dropped terms."""
    touched = (scalar.terms[t] for t in decision.dropped)
    return frozenset(t.element for t in touched if t.element is not None and t.other is None) - decision.observers


def _largest(scalar: ScalarGraph, decision: Decision, j: int, activity: dict[int, float]) -> int | None:
    """The largest term dropped at a junction; if none was dropped there, of those dropped at its neighbours' ends."""
    at = [t for t in scalar.terms_at[j] if t in decision.dropped]
    if not at:
        far = (scalar.terms[t].other for t in scalar.terms_at[j])
        at = [t for t in far if t is not None and t in decision.dropped]
    return max(at, key=lambda t: (activity.get(t, 0.0), -t), default=None)


class Structure:
    """Which unknowns each equation reads. before: the junctions that the whole model leaves undetermined."""

    def __init__(self, scalar: ScalarGraph):
        self.scalar = scalar
        self.columns: dict[str, int] = {}
        graph = scalar.graph
        self.known = {state for element in graph.elements for state in element.states}
        self.known |= {name for s in graph.signals if s.role in ("state", "input") for name in s.scalars()}
        self.expanded: dict[str, tuple[int, ...]] = {}
        self.terms = [self.unknowns((term.conjugate,)) for term in scalar.terms]
        self.own = [self.unknowns((var(j.variable),)) for j in scalar.junctions]
        self.fixed = [self.unknowns((r.left, r.right)) for r in scalar.relations]
        self.fixed += [self.unknowns((e.left, e.right)) for e in graph.equations]
        self.laws = [(element.name, self.unknowns((law.left, law.right))) for element in graph.elements for law in element.laws]
        self.before = self.undetermined(frozenset(), frozenset())

    def unknowns(self, roots: Iterable[Expr]) -> tuple[int, ...]:
        found: dict[int, None] = {}
        for leaf in leaves(roots):
            found.update(dict.fromkeys(self.expand(leaf.data)))
        return tuple(found)

    def expand(self, name: str) -> tuple[int, ...]:
        """The unknowns that a variable stands for."""
        if name in self.expanded:
            return self.expanded[name]
        if name in self.known:
            result: tuple[int, ...] = ()
        elif name in self.scalar.aliases:
            found: dict[int, None] = {}
            for leaf in leaves((self.scalar.aliases[name],)):
                found.update(dict.fromkeys(self.expand(leaf.data)))
            result = tuple(found)
        else:
            result = (self.columns.setdefault(name, len(self.columns)),)
        self.expanded[name] = result
        return result

    def rows(self, dropped: frozenset[int], gone: frozenset[str]) -> Iterator[tuple[int, ...]]:
        for at in self.scalar.terms_at:
            yield tuple({c for t in at if t not in dropped for c in self.terms[t]})
        yield from self.fixed
        yield from (row for name, row in self.laws if name not in gone)

    def undetermined(self, dropped: frozenset[int], gone: frozenset[str]) -> set[int]:
        """The junctions whose variable, or one of whose conjugates, nothing determines."""
        rows = list(self.rows(dropped, gone))
        free = underdetermined(rows, len(self.columns))
        found = set()
        for j, columns in enumerate(self.own):
            ends = [t for at in self.scalar.terms_at[j] for t in (at, self.scalar.terms[at].other)]
            kept = any(t is not None and t not in dropped for t in ends)
            if kept and any(c in free for c in columns):
                found.add(j)
        return found


def underdetermined(rows: Sequence[tuple[int, ...]], width: int) -> set[int]:
    """The columns that a maximum matching leaves free, and those that alternating paths reach from them."""
    import numpy as np
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import maximum_bipartite_matching

    pointers = np.cumsum([0, *(len(row) for row in rows)])
    indices = np.array([c for row in rows for c in row], dtype=np.int32)
    matrix = csr_matrix((np.ones(len(indices), dtype=np.int8), indices, pointers), shape=(len(rows), width))
    column_of = maximum_bipartite_matching(matrix, perm_type="column").tolist()
    readers: list[list[int]] = [[] for _ in range(width)]
    for r, row in enumerate(rows):
        for c in row:
            readers[c].append(r)
    reached = set(range(width)) - {c for c in column_of if c >= 0}
    stack = list(reached)
    while stack:
        for r in readers[stack.pop()]:
            c = column_of[r]
            if c >= 0 and c not in reached:
                reached.add(c)
                stack.append(c)
    return reached
