"""Propagation of causality over a scalar graph: one determiner at each junction, two-ports pass it on.

A term's value is 1 (it determines its junction's variable), 0 (it does not) or -1 (open). Three rules make implications:
a determined junction's other terms are 0 (`taken`); the last open term of an undetermined junction is 1 (`last`); the two
ends of a bond or two-port are equal or opposite (`far`). Each term is set once and each junction settled once, so the whole
is linear in the number of terms.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Literal

from bgdsl.ir.causal import Reason
from bgdsl.ir.scalar import ScalarGraph


@dataclass(frozen=True, slots=True)
class Conflict:
    """`over`: `term` would be a second determiner of its junction; `under`: its junction has no open term left;
    `clash`: `term`'s far end demands the opposite of what it is. reason: why the term would be that."""

    kind: Literal["over", "under", "clash"]
    junction: int
    term: int | None
    reason: Reason | None


def ends_alike(scalar: ScalarGraph) -> list[bool]:
    """For every term with a far end: are both ends determiners or neither (True), or exactly one (False)?

    An odd number of relations turns flow-in/effort-out at one end into the same kind of junction at the other.
    """
    related = {relation.term for relation in scalar.relations}
    return [term.other is None or ((term.index in related) == (term.other in related)) for term in scalar.terms]


class Assignment:
    """The values of all terms so far, with reasons. Mutable; `mark` and `undo` go back to an earlier point."""

    def __init__(self, scalar: ScalarGraph):
        self.scalar = scalar
        self.junction = [term.junction for term in scalar.terms]
        self.other = [-1 if term.other is None else term.other for term in scalar.terms]
        self.alike = ends_alike(scalar)
        self.value = [-1] * len(scalar.terms)
        self.reason: list[Reason] = [Reason("none")] * len(scalar.terms)
        self.determiner = [-1] * len(scalar.junctions)
        self.open = [len(at) for at in scalar.terms_at]
        self.trail: list[int] = []
        self.free: set[int] = set()
        """Junctions that are to have no determiner."""
        self.settled: set[tuple[int, int]] = set()
        """Demands (term, value) of far ends that are not met, a constraint having taken their place."""
        self._queue: deque[int] = deque()

    def set(self, term: int, value: int, reason: Reason) -> Conflict | None:
        """Give an open term a value and put it in the queue; what it already has is fine; else the conflict."""
        if self.value[term] == value:
            return None
        j = self.junction[term]
        if self.value[term] >= 0:
            kind: Literal["over", "clash"] = "over" if value and self.determiner[j] >= 0 else "clash"
            return Conflict(kind, j, term, reason)
        if value and self.determiner[j] >= 0:
            return Conflict("over", j, term, reason)
        self.value[term] = value
        self.reason[term] = reason
        self.open[j] -= 1
        if value:
            self.determiner[j] = term
        self.trail.append(term)
        self._queue.append(term)
        return None

    def propagate(self) -> Conflict | None:
        """Follow all implications of what is in the queue; stop at the first conflict, leaving the rest in the queue."""
        while self._queue:
            conflict = self._follow(self._queue[0])
            if conflict is not None:
                return conflict
            self._queue.popleft()
        return None

    def _follow(self, term: int) -> Conflict | None:
        """The implications of one term. Following it again after a conflict was settled does no harm."""
        j, value, far = self.junction[term], self.value[term], self.other[term]
        wanted = value if self.alike[term] else 1 - value
        if far >= 0 and self.value[far] != wanted and (far, wanted) not in self.settled:
            conflict = self.set(far, wanted, Reason("far", term))
            if conflict is not None:
                return conflict
        if self.determiner[j] == term:
            self._take(j)
        elif self.determiner[j] < 0 and j not in self.free:
            return self._last(j)
        return None

    def _take(self, j: int) -> None:
        """All other terms of a determined junction are no determiners."""
        if self.open[j]:
            taken = Reason("taken", self.determiner[j])
            for t in self.scalar.terms_at[j]:
                if self.value[t] < 0:
                    self.set(t, 0, taken)

    def _last(self, j: int) -> Conflict | None:
        """Where one term of an undetermined junction is open, it has to be the determiner; where none is, there is a conflict."""
        if self.open[j] == 0:
            return Conflict("under", j, None, None)
        if self.open[j] == 1:
            last = next(t for t in self.scalar.terms_at[j] if self.value[t] < 0)
            return self.set(last, 1, Reason("last"))
        return None

    def mark(self) -> int:
        """The present point, for `undo`."""
        return len(self.trail)

    def undo(self, mark: int) -> None:
        """Forget everything set since the mark, and what is in the queue."""
        self._queue.clear()
        while len(self.trail) > mark:
            term = self.trail.pop()
            j = self.junction[term]
            self.value[term] = -1
            self.reason[term] = Reason("none")
            self.open[j] += 1
            if self.determiner[j] == term:
                self.determiner[j] = -1

    def attempt(self, term: int, value: int, reason: Reason) -> Conflict | None:
        """Set an open term and follow the implications; on a conflict everything is as before."""
        mark = self.mark()
        conflict = self.set(term, value, reason) or self.propagate()
        if conflict is not None:
            self.undo(mark)
        return conflict

    def replace(self, term: int, reason: Reason) -> None:
        """Make this term its junction's determiner in place of the present one."""
        j = self.junction[term]
        if self.value[term] < 0:
            self.open[j] -= 1
        self.value[term], self.reason[term] = 1, reason
        self.determiner[j] = term
        self._queue.append(term)

    def drop(self, term: int) -> None:
        """Make a term no determiner, whatever it was; its junction may be left undetermined (then put it into `free`)."""
        j = self.junction[term]
        if self.value[term] < 0:
            self.open[j] -= 1
            self.trail.append(term)
            self._queue.append(term)
        self.value[term] = 0
        if self.determiner[j] == term:
            self.determiner[j] = -1
