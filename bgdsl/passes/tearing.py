"""Tear a directed graph: few nodes whose removal leaves no cycle, and the order of the rest.

Input        for each node of one strong component the nodes it reads (by number), and nodes that have to be torn
Output       the torn nodes; the others in an order in which each reads only torn and earlier ones
Establishes  no cycle is left
Reports      nothing

Levy and Low's reductions: a node with no reader or nothing to read lies on no cycle; one with a single reader or a single
source is bypassed; one that reads itself has to be torn. Where no reduction applies, the node with most cycles through it
(in-degree times out-degree) is torn. On reducible graphs the result is the smallest possible.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from heapq import heapify, heappop, heappush


def tear(reads: Sequence[Iterable[int]], forced: Iterable[int] = ()) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """(torn nodes in numeric order, other nodes in evaluation order)."""
    torn = feedback_nodes(reads, forced)
    return tuple(sorted(torn)), evaluation_order(reads, torn)


def feedback_nodes(reads: Sequence[Iterable[int]], forced: Iterable[int] = ()) -> set[int]:
    """Nodes whose removal leaves no cycle; `forced` ones are among them."""
    sources = [set(after) for after in reads]
    readers: list[set[int]] = [set() for _ in reads]
    for node, after in enumerate(sources):
        for source in after:
            readers[source].add(node)
    torn = set(forced)
    alive = bytearray([1]) * len(sources)
    todo = list(range(len(sources)))

    def remove(node: int) -> None:
        alive[node] = 0
        for source in sources[node]:
            readers[source].discard(node)
        for reader in readers[node]:
            sources[reader].discard(node)
        todo.extend(sources[node] | readers[node])

    def bypass(node: int) -> None:
        before, after = sources[node], readers[node]
        remove(node)
        for source in before:
            readers[source] |= after
        for reader in after:
            sources[reader] |= before

    for node in torn:
        remove(node)
    heap: list[tuple[int, int]] | None = None
    while True:
        while todo:
            node = todo.pop()
            if not alive[node]:
                continue
            if node in sources[node]:
                torn.add(node)
                remove(node)
            elif min(len(sources[node]), len(readers[node])) <= 1:
                bypass(node)
            elif heap is not None:
                heappush(heap, (-len(sources[node]) * len(readers[node]), node))
        if heap is None:
            heap = [(-len(sources[node]) * len(readers[node]), node) for node in range(len(sources)) if alive[node]]
            heapify(heap)
        node = _most_cycles(heap, alive, sources, readers)
        if node < 0:
            return torn
        torn.add(node)
        remove(node)


def _most_cycles(heap: list[tuple[int, int]], alive: bytearray, sources: list[set[int]], readers: list[set[int]]) -> int:
    """The live node with the greatest product of degrees, or -1; entries whose degrees have changed since are put back."""
    while heap:
        weight, node = heappop(heap)
        if not alive[node]:
            continue
        now = -len(sources[node]) * len(readers[node])
        if now == weight:
            return node
        heappush(heap, (now, node))
    return -1


def evaluation_order(reads: Sequence[Iterable[int]], torn: set[int]) -> tuple[int, ...]:
    """The nodes that are not torn, each after those it reads."""
    waiting = [0] * len(reads)
    readers: list[list[int]] = [[] for _ in reads]
    for node, after in enumerate(reads):
        if node not in torn:
            for source in set(after) - torn:
                waiting[node] += 1
                readers[source].append(node)
    ready = [node for node in range(len(reads)) if node not in torn and not waiting[node]]
    heapify(ready)
    order = []
    while ready:
        node = heappop(ready)
        order.append(node)
        for reader in readers[node]:
            waiting[reader] -= 1
            if not waiting[reader]:
                heappush(ready, reader)
    assert len(order) + len(torn) == len(reads), "a cycle is left"
    return tuple(order)
