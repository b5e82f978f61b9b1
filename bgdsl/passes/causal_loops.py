"""What each junction's variable depends on without passing an integrator: causal loops, and where a variable comes from.

Two nodes a junction: its variable (2 j), and the sum of what its terms bring, that its determiner receives (2 j + 1).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence

from bgdsl.ir.scalar import ScalarGraph
from bgdsl.passes.blocks import strong_components

Graph = list[list[int]]


def dependence(
    scalar: ScalarGraph, determiner: Sequence[int], alike: Sequence[bool], algebraic: Sequence[bool], surplus: Collection[int] = ()
) -> Graph:
    """For every node the nodes it is computed from.

    determiner: -1 where there is none; algebraic: for every one-port term, does it give out a function of what it receives at
    the same instant (a resistor, a user element)? surplus: terms of two-ports whose relation is a constraint: they bring an
    unknown that depends on nothing.
    """
    graph: Graph = [[] for _ in range(2 * len(scalar.junctions))]
    for term in scalar.terms:
        j, t = term.junction, term.index
        chosen = determiner[j] == t
        if term.other is None:
            if algebraic[t]:
                graph[2 * j + (not chosen)].append(2 * j + chosen)
            continue
        if t in surplus:
            continue
        far = scalar.terms[term.other].junction
        if chosen:
            graph[2 * j].append(2 * far + alike[t])
        else:
            graph[2 * j + 1].append(2 * far + (not alike[t]))
    return graph


def reachable(graph: Graph, starts: Iterable[int]) -> Iterator[int]:
    """The nodes that the start nodes are computed from, themselves included, nearest first."""
    seen = dict.fromkeys(starts)
    queue = list(seen)
    for node in queue:
        yield node
        queue += (before for before in dict.fromkeys(graph[node]) if before not in seen)
        seen.update(dict.fromkeys(graph[node]))


def causal_loops(graph: Graph) -> tuple[tuple[int, ...], ...]:
    """The junctions of each causal loop."""
    loops = (nodes for nodes in strong_components(graph) if len(nodes) > 1 or nodes[0] in graph[nodes[0]])
    return tuple(tuple(sorted({node // 2 for node in nodes})) for nodes in sorted(loops))
