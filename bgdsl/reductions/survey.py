"""What of the author's junctions, vectors and matrices is left in a part, before anything is written.

Input        ScalarGraph, Part
Output       Survey
Establishes  a junction's component is kept where a term acts at it, or where it joins two that are kept; a vector or a matrix is whole
             where every component and every entry is there and acts both ways
Reports      nothing
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, field

from bgdsl.expr import leaves
from bgdsl.ir.graph import Bond, Element, End, Junction
from bgdsl.ir.scalar import ScalarGraph, Term
from bgdsl.reductions.part import Part

Vertex = tuple[str, int] | int
"""A junction's component, or the scalar junction that an element's port makes."""

_MATRICES = ("MTF", "TF", "MGY", "GY", "EJS")


@dataclass(slots=True, eq=False)
class Survey:
    """kept: the places of each scalar junction that are written, the first of them for reading. joined: bonds between places of one
    junction, tail first. whole: junctions and elements that stay vectors or matrices."""

    scalar: ScalarGraph
    part: Part
    elements: dict[str, Element]
    junctions: dict[str, Junction]
    bonds: dict[str, Bond]
    member_of: dict[tuple[str, int], int]
    brought: dict[tuple[str, int, int], tuple[str, int, End]]
    kept: dict[int, list[Vertex]] = field(default_factory=dict)
    joined: list[tuple[Vertex, Vertex]] = field(default_factory=list)
    whole: set[str] = field(default_factory=set)
    torn: set[str] = field(default_factory=set)
    """Elements of which a term is in another part."""

    def seat(self, term: Term) -> Vertex:
        """The place at which a term acts: the author's junction that its bond ends at, else the one that its element makes."""
        if term.element is not None and (term.modulus is not None or term.other is None):
            _, c, far = self.brought[term.element, term.port, term.spot]
            vertex = (far.node, far.components[c])
        else:
            bond = self.bonds[term.bond]
            end = bond.tail if term.sign < 0 else bond.head
            vertex = (end.node, end.components[term.component or 0])
        return vertex if self.member_of.get(vertex) == term.junction else term.junction

    def acts(self, term: Term) -> bool:
        """Is the term written?"""
        return term.junction in self.part.junctions and term.index not in self.part.dropped and term.element not in self.part.gone

    def is_tied(self, element: Element) -> bool:
        """Are the components of a vector element tied together by its laws, so that it must stay whole?"""
        if element.kind == "field" or element.ports[0].size is None:
            return False
        own = {element.ports[0].variable(element.name, x, i): i for x in "efpq" for i in range(element.ports[0].width)}
        return any(len({own[leaf.data] for leaf in leaves((law.left, law.right)) if leaf.data in own}) > 1 for law in element.laws)

    def far_vertex(self, element: str, port: int, i: int) -> Vertex | None:
        """The author's junction at an element's port, None if there is none."""
        _, c, far = self.brought[element, port, i]
        return (far.node, far.components[c]) if far.node in self.junctions else None


def survey(scalar: ScalarGraph, part: Part) -> Survey:
    """What is left."""
    graph = scalar.graph
    elements = {element.name: element for element in graph.elements}
    found = Survey(
        scalar,
        part,
        elements,
        {junction.name: junction for junction in graph.junctions},
        {bond.name: bond for bond in graph.bonds},
        {member: j for j in part.junctions for member in scalar.junctions[j].members},
        {
            (end.node, end.port, i): (bond.name, c, far)
            for bond in graph.bonds
            for end, far in ((bond.tail, bond.head), (bond.head, bond.tail))
            for c, i in enumerate(end.components)
            if end.node in elements
        },
    )
    _keep(found)
    _whole_junctions(found)
    _whole_elements(found)
    return found


def _keep(found: Survey) -> None:
    """The places that are needed: leaves of the trees of like junctions at which nothing acts fall, one after the other."""
    attached: dict[Vertex, int] = defaultdict(int)
    at: dict[int, dict[Vertex, None]] = defaultdict(dict)
    for term in found.scalar.terms:
        if found.acts(term):
            vertex = found.seat(term)
            attached[vertex] += 1
            at[term.junction].setdefault(vertex)
    edges = list(_like_bonds(found))
    near: dict[Vertex, list[int]] = defaultdict(list)
    for k, edge in enumerate(edges):
        for end in edge:
            near[end].append(k)
            at[found.member_of[end]].setdefault(end)
    degree = {vertex: len(of) for vertex, of in near.items()}
    alive = [True] * len(edges)
    bare = [vertex for vertex in near if degree[vertex] == 1 and not attached[vertex]]
    while bare:
        for k in near[bare.pop()]:
            if alive[k]:
                alive[k] = False
                for end in edges[k]:
                    degree[end] -= 1
                    if degree[end] == 1 and not attached[end]:
                        bare.append(end)
    found.joined += [edge for k, edge in enumerate(edges) if alive[k]]
    for j, vertices in at.items():
        order: dict[Vertex, int] = {member: k for k, member in enumerate(found.scalar.junctions[j].members)}
        there = [v for v in vertices if attached[v] or degree.get(v)]
        found.kept[j] = sorted(there, key=lambda v: order.get(v, len(order)))


def _like_bonds(found: Survey) -> Iterator[tuple[tuple[str, int], tuple[str, int]]]:
    for inner in found.scalar.inner:
        if inner.junction in found.part.junctions and not inner.loop:
            bond, c = found.bonds[inner.bond], inner.component or 0
            if bond.tail.node in found.junctions and bond.head.node in found.junctions:
                yield (bond.tail.node, bond.tail.components[c]), (bond.head.node, bond.head.components[c])


def _whole_junctions(found: Survey) -> None:
    there: dict[str, int] = defaultdict(int)
    for vertices in found.kept.values():
        for vertex in vertices:
            if not isinstance(vertex, int):
                there[vertex[0]] += 1
    found.whole |= {name for name, count in there.items() if count == found.junctions[name].size}


def _whole_elements(found: Survey) -> None:
    cut: set[str] = set(found.part.gone)
    terms: dict[str, int] = defaultdict(int)
    for term in found.scalar.terms:
        if term.element is not None:
            terms[term.element] += 1
            if not found.acts(term):
                cut.add(term.element)
            if term.junction not in found.part.junctions:
                found.torn.add(term.element)
    kept = {vertex for vertices in found.kept.values() for vertex in vertices}
    for element in found.elements.values():
        if element.name in cut or element.name not in terms or element.ports[0].size is None:
            continue
        if element.kind in _MATRICES or (element.kind != "field" and not found.is_tied(element) and _plain(element)):
            found.whole.add(element.name)
    _join_matrices(found, kept)


def _join_matrices(found: Survey, kept: Container[Vertex | None]) -> None:
    """A matrix stays one if every bond at it leads to a junction that is there, or to another matrix that stays one."""
    waiting = [name for name in found.whole if name in found.elements and found.elements[name].kind in _MATRICES]
    while waiting:
        name = waiting.pop()
        fars = [(found.far_vertex(name, k, i), found.brought[name, k, i][2].node) for k, i in _spots(found.elements[name])]
        if name in found.whole and not all(
            vertex in kept or (vertex is None and node in found.whole and found.elements[node].kind in _MATRICES) for vertex, node in fars
        ):
            found.whole.discard(name)
            waiting += [node for vertex, node in fars if vertex is None and node in found.whole]


def _spots(element: Element) -> Iterable[tuple[int, int]]:
    return ((k, i) for k, port in enumerate(element.ports) for i in range(port.width))


def _plain(element: Element) -> bool:
    """Is a one-port's law linear, or given for one variable without its own letters?"""
    if element.linear is not None:
        return True
    own = {element.ports[0].variable(element.name, x, i) for x in "efpq" for i in range(element.ports[0].width)}
    lefts = {law.left.data.rpartition(".")[2].partition("[")[0] for law in element.laws if law.left.op == "var"}
    return len(lefts) == 1 and not any(leaf.data in own for law in element.laws for leaf in leaves((law.right,)))
