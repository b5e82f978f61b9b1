"""Regions of a bond graph: the places that bonds and junctions join without a transformer, gyrator or user element between.

Effort means the same everywhere in a region, and so does flow: one domain, one unit each. A place is one component of a
junction or of an element's port, so that a vector junction may carry unlike components (two velocities and a spin).
"""

from __future__ import annotations

from bgdsl.ir.graph import BondGraph, End


class Regions:
    """Union-find over the places of a graph. Every place starts as a region of its own; `join` unites two."""

    __slots__ = ("_parents", "_places")

    def __init__(self, graph: BondGraph):
        self._places: dict[tuple[str, int], int] = {}
        count = 0
        for junction in graph.junctions:
            self._places[junction.name, 0] = count
            count += junction.size or 1
        for element in graph.elements:
            for k, port in enumerate(element.ports):
                self._places[element.name, k] = count
                count += port.width
        self._parents = list(range(count))

    @property
    def count(self) -> int:
        """How many places there are."""
        return len(self._parents)

    def place(self, node: str, port: int = 0, component: int = 0) -> int:
        """The number of a place (components from 0)."""
        return self._places[node, port] + component

    def at(self, end: End) -> list[int]:
        """The places of a bond's end, one a component."""
        first, components = self._places[end.node, end.port], end.components
        return [first + components[0]] if len(components) == 1 else [first + i for i in components]

    def find(self, place: int) -> int:
        """The place that stands for the region of this one."""
        parents = self._parents
        while parents[place] != place:
            parents[place] = place = parents[parents[place]]
        return place

    def join(self, one: int, other: int) -> int:
        """Unite the regions of two places; the place that stands for the result."""
        one, other = sorted((self.find(one), self.find(other)))
        self._parents[other] = one
        return one


def joined_regions(graph: BondGraph) -> Regions:
    """The regions that the graph's bonds make."""
    regions = Regions(graph)
    for bond in graph.bonds:
        for tail, head in zip(regions.at(bond.tail), regions.at(bond.head), strict=True):
            regions.join(tail, head)
    return regions
