"""Can a constraint be met? One that reads nothing but sources is true or false whatever the states are: an error.

Reports      BG401, BG402, BG403 (see `causal_errors`)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bgdsl.diagnostics import Reporter
from bgdsl.ir.causal import Constrained
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.passes.causal_errors import sources_only
from bgdsl.passes.causal_loops import Graph
from bgdsl.passes.causal_story import Story
from bgdsl.passes.propagation import Assignment


@dataclass(frozen=True, slots=True)
class ConstraintCheck:
    """The check of all constraints of one finished assignment; `graph` is its dependence graph."""

    story: Story
    state: Assignment
    graph: Graph
    constrained: Mapping[tuple[int, int | None], Constrained]
    report: Reporter

    @property
    def scalar(self) -> ScalarGraph:
        return self.state.scalar

    def check_all(self) -> None:
        """Every constraint must be about more than what sources give. (Where a variable is a state, it is.)"""
        for place in self.constrained.values():
            if not place.velocity:
                self.check(place)

    def check(self, place: Constrained) -> None:
        """Search what the constraint reads; stop at the first thing that can give way."""
        far = -1 if place.term is None else self.state.other[place.term]
        if far >= 0 and self.state.alike[far] and self.state.value[far] == 0:
            return  # both relations of the two-port are constraints, and each has the other's multiplier
        parents = dict.fromkeys(self.origins(place), -1)
        queue = list(parents)
        found: dict[int, int] = {}
        for node in queue:
            if self.reads_multiplier(node, place):
                return
            for t in self.brought(node):
                if not self.story.is_source(self.scalar.terms[t]):
                    return
                found.setdefault(t, node)
            for before in self.graph[node]:
                if before not in parents:
                    parents[before] = node
                    queue.append(before)
        if place.source is not None and place.term is not None:
            found = {place.term: -1, **found}
        ways = [self.way(place, parents, source, node) for source, node in list(found.items())[:2]]
        sources_only(self.story, self.report, place, [self.scalar.terms[t] for t in found], ways)

    def reads_multiplier(self, node: int, place: Constrained) -> bool:
        """Does another constraint's multiplier enter at this node?"""
        j, summed = divmod(node, 2)
        present = self.state.determiner[j]
        if not summed:
            return j != place.junction if present < 0 else self.is_surplus(present, place)
        return any(t != present and self.is_surplus(t, place) for t in self.scalar.terms_at[j])

    def is_surplus(self, t: int, besides: Constrained) -> bool:
        """Does this term belong to a two-port whose relation is another constraint?"""
        far = self.state.other[t]
        return any((self.state.junction[end], end) in self.constrained for end in (t, far) if far >= 0 and besides.term not in (t, far))

    def origins(self, place: Constrained) -> list[int]:
        """The nodes of the dependence graph that a constraint reads."""
        if place.term is None:
            return [2 * place.junction + 1]
        far = self.scalar.terms[place.term].other
        beyond = [] if far is None else [2 * self.scalar.terms[far].junction + self.state.alike[place.term]]
        return [2 * place.junction, *beyond]

    def brought(self, node: int) -> list[int]:
        """The one-port terms that give a value to this node: the determiner, or all others."""
        j, summed = divmod(node, 2)
        present = self.state.determiner[j]
        terms = [t for t in self.scalar.terms_at[j] if t != present] if summed else [present] if present >= 0 else []
        return [t for t in terms if self.scalar.terms[t].other is None]

    def way(self, place: Constrained, parents: dict[int, int], source: int, node: int) -> list[int]:
        """The terms from a constrained junction to a source that it depends on."""
        way = [source]
        while node >= 0 and (before := parents[node]) >= 0:
            there = node // 2
            here = before // 2
            link = (t for t in self.scalar.terms_at[here] if self.state.other[t] >= 0 and self.state.junction[self.state.other[t]] == there)
            way += [t for t in (next(link, None),) if t is not None]
            node = before
        if place.term is not None and node >= 0 and node // 2 != place.junction:
            way.append(place.term)
        return way[::-1]
