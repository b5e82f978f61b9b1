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


def partitions(scalar: ScalarGraph, needs: Dependencies, ignored: Collection[Edge] = ()) -> Partitions:
    """The partitions of a model whose dependencies are `needs`, edges in `ignored` left out."""
    gone = set(ignored)
    edges = [edge for edge in needs.edges if edge not in gone]
    component = strong_components(needs.size, [(edge.source, edge.reader) for edge in edges])
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


def strong_components(size: int, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """The component of each node, numbered so that an edge never leads to a smaller number (Tarjan, without recursion).

    Components that no edge orders are numbered by their smallest node.
    """
    successors: list[list[int]] = [[] for _ in range(size)]
    for source, reader in pairs:
        successors[source].append(reader)
    index = [-1] * size
    low = [0] * size
    on_stack = [False] * size
    found = [-1] * size
    stack: list[int] = []
    counter = components = 0
    for root in range(size - 1, -1, -1):
        if index[root] >= 0:
            continue
        work = [(root, 0)]
        while work:
            node, i = work.pop()
            if i == 0:
                index[node] = low[node] = counter
                counter += 1
                stack.append(node)
                on_stack[node] = True
            deeper = False
            for k in range(i, len(successors[node])):
                after = successors[node][k]
                if index[after] < 0:
                    work.append((node, k + 1))
                    work.append((after, 0))
                    deeper = True
                    break
                if on_stack[after]:
                    low[node] = min(low[node], index[after])
            if deeper:
                continue
            if low[node] == index[node]:
                while True:
                    member = stack.pop()
                    on_stack[member] = False
                    found[member] = components
                    if member == node:
                        break
                components += 1
            if work:
                low[work[-1][0]] = min(low[work[-1][0]], low[node])
    return [components - 1 - c for c in found]
