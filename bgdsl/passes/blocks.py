"""Strong components of a directed graph, in the order in which they can be evaluated.

Input        for each node the nodes it reads
Output       components as tuples of nodes
Establishes  a component comes after every other component that it reads; nodes keep their numeric order inside one
Reports      nothing

Tarjan's algorithm with an explicit stack, linear in nodes and edges.
"""

from __future__ import annotations

from collections.abc import Sequence


def strong_components(reads: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    """The strong components of the graph with an edge from each node to every node it reads, read ones first."""
    n = len(reads)
    index = [-1] * n
    low = [0] * n
    open_ = bytearray(n)
    trail: list[int] = []
    found: list[tuple[int, ...]] = []
    count = 0
    for root in range(n):
        if index[root] >= 0:
            continue
        work = [(root, 0)]
        while work:
            node, k = work.pop()
            if k == 0:
                index[node] = low[node] = count
                count += 1
                trail.append(node)
                open_[node] = 1
            after = reads[node]
            if k > 0:
                low[node] = min(low[node], low[after[k - 1]])
            while k < len(after):
                child = after[k]
                k += 1
                if index[child] < 0:
                    work.append((node, k))
                    work.append((child, 0))
                    break
                if open_[child]:
                    low[node] = min(low[node], index[child])
            else:
                if low[node] == index[node]:
                    found.append(_close(node, trail, open_))
    return found


def _close(root: int, trail: list[int], open_: bytearray) -> tuple[int, ...]:
    members = []
    while True:
        node = trail.pop()
        open_[node] = 0
        members.append(node)
        if node == root:
            return tuple(sorted(members))
