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

from collections.abc import Iterable, Iterator, Sequence
from heapq import heapify, heappop, heappush


def tear(reads: Sequence[Iterable[int]], forced: Iterable[int] = ()) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """(torn nodes in numeric order, other nodes in evaluation order)."""
    torn = feedback_nodes(reads, forced)
    return tuple(sorted(torn)), evaluation_order(reads, torn)


def feedback_nodes(reads: Sequence[Iterable[int]], forced: Iterable[int] = ()) -> set[int]:
    """Nodes whose removal leaves no cycle; `forced` ones are among them."""
    left = _Left(reads)
    torn = set(forced)
    for node in torn:
        left.remove(node)
    heap: list[tuple[int, int]] | None = None
    while True:
        for node in left.touched():
            if left.reads_itself(node):
                torn.add(node)
                left.remove(node)
            elif left.is_thread(node):
                left.bypass(node)
            elif heap is not None:
                heappush(heap, (left.weight(node), node))
        if heap is None:
            heap = [(left.weight(node), node) for node in range(len(left.sources)) if left.alive[node]]
            heapify(heap)
        node = _most_cycles(heap, left)
        if node < 0:
            return torn
        torn.add(node)
        left.remove(node)


class _Left:
    """What is left of a graph while nodes are taken out of it: the sources and the readers of each live node."""

    def __init__(self, reads: Sequence[Iterable[int]]) -> None:
        self.sources = [set(after) for after in reads]
        self.readers: list[set[int]] = [set() for _ in reads]
        for node, after in enumerate(self.sources):
            for source in after:
                self.readers[source].add(node)
        self.alive = bytearray([1]) * len(self.sources)
        self.todo = list(range(len(self.sources)))

    def touched(self) -> Iterator[int]:
        """The live nodes whose neighbours have changed, until no more do."""
        while self.todo:
            node = self.todo.pop()
            if self.alive[node]:
                yield node

    def reads_itself(self, node: int) -> bool:
        return node in self.sources[node]

    def is_thread(self, node: int) -> bool:
        """Whether the node can be bypassed without adding edges."""
        return min(len(self.sources[node]), len(self.readers[node])) <= 1

    def weight(self, node: int) -> int:
        """Through how many pairs of neighbours cycles may run, negative."""
        return -len(self.sources[node]) * len(self.readers[node])

    def remove(self, node: int) -> None:
        self.alive[node] = 0
        for source in self.sources[node]:
            self.readers[source].discard(node)
        for reader in self.readers[node]:
            self.sources[reader].discard(node)
        self.todo.extend(self.sources[node] | self.readers[node])

    def bypass(self, node: int) -> None:
        """Remove the node and let its readers read what it reads."""
        before, after = self.sources[node], self.readers[node]
        self.remove(node)
        for source in before:
            self.readers[source] |= after
        for reader in after:
            self.sources[reader] |= before


def _most_cycles(heap: list[tuple[int, int]], left: _Left) -> int:
    """The live node with the greatest product of degrees, or -1; entries whose degrees have changed since are put back."""
    while heap:
        weight, node = heappop(heap)
        if not left.alive[node]:
            continue
        now = left.weight(node)
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
