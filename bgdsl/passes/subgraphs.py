"""Partitions: strongly connected components of the dependencies, in an order in which each reads earlier ones only.

Input        Dependencies, edges that do not count (frozen signals)
Output       Partitions
Establishes  every node is in one partition; no partition reads a later one; each has a storage of its own
Reports      nothing

What has no storage (a signal, a group of junctions that only passes on) joins the last partition that it reads, or
the first one that reads it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from bgdsl.ir.partition import Dependencies, Edge, Partition, Partitions, Passed
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.passes.blocks import strong_components


def partitions(scalar: ScalarGraph, needs: Dependencies, ignored: Collection[Edge] = ()) -> Partitions:
    """The partitions of a model whose dependencies are `needs`, edges in `ignored` left out where they close a loop. What nothing
    depends on, an output say, closes none: it goes with what it reads."""
    whole = ordered_components(needs.size, [(edge.source, edge.reader) for edge in needs.edges]) if ignored else ()
    gone = {edge for edge in ignored if whole[edge.source] == whole[edge.reader]}
    edges = [edge for edge in needs.edges if edge not in gone]
    component = ordered_components(needs.size, [(edge.source, edge.reader) for edge in edges])
    number = _numbered(needs, edges, component)
    drivers: dict[int, set[int]] = {k: set() for k in range(max(number, default=-1) + 1)}
    passed: dict[Passed, None] = {}
    for edge in edges:
        source, reader = number[edge.source], number[edge.reader]
        if source != reader:
            drivers[reader].add(source)
            passed[Passed(edge.variable, source, reader)] = None
    states = _states(scalar)
    found = tuple(_partition(scalar, needs, k, number, sorted(drivers[k]), states) for k in drivers)
    return Partitions(found, tuple(number), tuple(sorted(passed, key=lambda p: (p.source, p.reader, p.variable))))


def _partition(
    scalar: ScalarGraph, needs: Dependencies, k: int, number: Sequence[int], drivers: Sequence[int], states: Mapping[int, list[str]]
) -> Partition:
    nodes = [node for node, own in enumerate(number) if own == k]
    junctions = tuple(node for node in nodes if node < needs.junctions)
    signals = tuple(needs.signals[node - needs.junctions] for node in nodes if node >= needs.junctions)
    integrated = {name for s in scalar.graph.signals if s.role == "state" for name in s.scalars()}
    own = [state for node in junctions for state in states.get(node, ())] + [name for name in signals if name in integrated]
    return Partition(k, junctions, signals, tuple(own), tuple(drivers))


def _states(scalar: ScalarGraph) -> dict[int, list[str]]:
    """The storage states at each junction."""
    elements = {element.name: element for element in scalar.graph.elements}
    found: dict[int, list[str]] = {}
    for term in scalar.terms:
        if term.element is not None and term.other is None and (states := elements[term.element].states):
            found.setdefault(term.junction, []).append(states[term.spot] if term.spot < len(states) else states[0])
    return found


def _numbered(needs: Dependencies, edges: Sequence[Edge], component: Sequence[int]) -> list[int]:
    """The partition of every node, from components numbered in topological order."""
    count = max(component, default=-1) + 1
    real = [False] * count
    for node in needs.storing:
        real[component[node]] = True
    number = [-1] * count
    for k, c in enumerate(c for c in range(count) if real[c]):
        number[c] = k
    sources: list[set[int]] = [set() for _ in range(count)]
    readers: list[set[int]] = [set() for _ in range(count)]
    for edge in edges:
        source, reader = component[edge.source], component[edge.reader]
        if source != reader:
            sources[reader].add(source)
            readers[source].add(reader)
    for c in range(count):  # what has no storage follows what it reads
        if not real[c]:
            number[c] = max((number[s] for s in sources[c]), default=-1)
    for c in reversed(range(count)):  # what reads nothing that has one goes to its first reader
        if number[c] < 0:
            number[c] = min((number[r] for r in readers[c] if number[r] >= 0), default=-1)
    return [max(0, number[c]) for c in component]


def ordered_components(size: int, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """The strong component of each node, numbered so that no edge (source, reader) leads to a smaller number.

    Searched backwards, from the last node and from source to reader: what no edge orders stays in the order of the nodes.
    """
    last = size - 1
    readers: list[list[int]] = [[] for _ in range(size)]
    for source, reader in pairs:
        readers[last - source].append(last - reader)
    found = [-1] * size
    for number, component in enumerate(reversed(strong_components(readers))):
        for node in component:
            found[last - node] = number
    return found
