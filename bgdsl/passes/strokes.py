"""Causal strokes of flat bonds, from the determiners of scalar junctions; and what an asserted stroke demands of them.

Effort acts on a 0-junction along the bond that determines it, and away from a 1-junction there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

from bgdsl.ir.causal import CausalGraph
from bgdsl.ir.elements import component
from bgdsl.ir.graph import Bond, BondGraph, End
from bgdsl.ir.scalar import InnerBond, ScalarGraph, Term

Side = Literal["tail", "head"]
_FAR: dict[Side, Side] = {"tail": "head", "head": "tail"}
_ARROWS = {("tail", True): "|->", ("head", True): "->|", ("tail", False): "|=>", ("head", False): "=>|"}


def bond_strokes(scalar: ScalarGraph, determiner: Sequence[int | None], determines: Sequence[bool]) -> dict[str, tuple[Side, ...]]:
    """For every flat bond the end, per component, on which the effort acts."""
    found: dict[str, list[Side]] = {bond.name: ["head"] * bond.width for bond in scalar.graph.bonds}
    for term in _outer_terms(scalar):
        found[term.bond][term.component or 0] = _side(scalar, term, determines[term.index])
    for inner in scalar.inner:
        chosen = determiner[inner.junction]
        beyond = chosen is not None and inner.start <= chosen < inner.stop
        found[inner.bond][inner.component or 0] = _inner_side(scalar, inner, beyond)
    return {name: tuple(sides) for name, sides in found.items()}


def _outer_terms(scalar: ScalarGraph) -> Iterator[Term]:
    """Terms such that the last one for a bond is the bond's own: entries first, which may share the bond of a matrix port."""
    yield from (term for term in scalar.terms if term.is_two_port)
    yield from (term for term in scalar.terms if not term.is_two_port)


def _side(scalar: ScalarGraph, term: Term, determines: bool) -> Side:
    here: Side = "head" if term.sign > 0 else "tail"
    return here if determines == (scalar.junctions[term.junction].kind == 0) else _FAR[here]


def _inner_side(scalar: ScalarGraph, inner: InnerBond, beyond: bool) -> Side:
    return inner.side if beyond == (scalar.junctions[inner.junction].kind == 1) else _FAR[inner.side]


def demands(scalar: ScalarGraph) -> Iterator[tuple[Bond, tuple[tuple[int, int], ...]]]:
    """For every asserted stroke of a bond component: the (term, value) pairs that honour it."""
    asserted = {bond.name: bond for bond in scalar.graph.bonds if bond.stroke is not None}
    if not asserted:
        return
    found: dict[tuple[str, int], tuple[tuple[int, int], ...]] = {}
    for term in _outer_terms(scalar):
        if term.bond in asserted:
            wanted = _side(scalar, term, True) == asserted[term.bond].stroke
            found[term.bond, term.component or 0] = ((term.index, int(wanted)),)
    for inner in scalar.inner:
        if inner.bond in asserted and not inner.loop:
            beyond = _inner_side(scalar, inner, True) == asserted[inner.bond].stroke
            others = (t for t in scalar.terms_at[inner.junction] if (inner.start <= t < inner.stop) != beyond)
            found[inner.bond, inner.component or 0] = tuple((t, 0) for t in others)
    for bond in asserted.values():
        for c in range(bond.width):
            yield bond, found.get((bond.name, c), ())


Shape = tuple[str, int | None]
"""How an end is written and its size, None for a scalar."""


def strokes_text(causal: CausalGraph) -> str:
    """Every flat bond in the language's own notation with its strokes; a vector bond whose components differ, per component."""
    graph = causal.scalar.graph
    shapes = _shapes(graph)
    return "\n".join(line for bond in graph.bonds for line in _lines(shapes, bond, causal.strokes[bond.name]))


def _shapes(graph: BondGraph) -> dict[tuple[str, int], Shape]:
    """Of every junction and every port (name, index)."""
    shapes: dict[tuple[str, int], Shape] = {(j.name, 0): (j.name, j.size) for j in graph.junctions}
    for element in graph.elements:
        for k, port in enumerate(element.ports):
            named = element.kind == "field" and port.name
            shapes[element.name, k] = (f"{element.name}.{port.name}" if named else element.name, port.size)
    return shapes


def _lines(shapes: Mapping[tuple[str, int], Shape], bond: Bond, sides: tuple[Side, ...]) -> Iterator[str]:
    tail, head = shapes[bond.tail.node, bond.tail.port], shapes[bond.head.node, bond.head.port]
    if len(set(sides)) <= 1:
        arrow = _ARROWS[sides[0] if sides else "head", bond.size is None]
        yield f"{bond.name}: {_whole(tail, bond.tail)} {arrow} {_whole(head, bond.head)};"
        return
    for c, side in enumerate(sides):
        yield f"{component(bond.name, c)}: {_one(tail, bond.tail, c)} {_ARROWS[side, True]} {_one(head, bond.head, c)};"


def _one(shape: Shape, end: End, c: int) -> str:
    name, size = shape
    return component(name, end.components[c] if size is not None else None)


def _whole(shape: Shape, end: End) -> str:
    """`v`, `v[2]`, `v[2:3]`, `lever`, `q1.b`: a bond's end as it is written."""
    name, size = shape
    if size is None or end.components == tuple(range(size)):
        return name
    first, last = end.components[0], end.components[-1]
    if len(end.components) == 1:
        return component(name, first)
    if end.components == tuple(range(first, last + 1)):
        return f"{name}[{first + 1}:{last + 1}]"
    return f"{name}[{{{', '.join(str(i + 1) for i in end.components)}}}]"
