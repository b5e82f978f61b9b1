"""What leaves causality no choice: sources, two-ports whose modulus may vanish, laws of one direction.

Input        ScalarGraph
Output       terms with the value they must have (1: the term sets its junction's variable) and the reason, in the order of those three
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set

from bgdsl.ir.causal import Reason
from bgdsl.ir.graph import Element
from bgdsl.ir.scalar import ScalarGraph, Term
from bgdsl.passes.law_directions import only_direction
from bgdsl.passes.moduli import Moduli

Fact = tuple[Term, int, Reason]

Ports = Mapping[str, list[Term]]
"""The terms of each one-port and user element, by port and component."""


def ports_of(scalar: ScalarGraph) -> Ports:
    """The terms of each element that is no two-port."""
    ports: dict[str, list[Term]] = {}
    for term in scalar.terms:
        if term.other is None and term.element is not None:
            ports.setdefault(term.element, []).append(term)
    for terms in ports.values():
        terms.sort(key=lambda term: (term.port, term.spot))
    return ports


def sets(scalar: ScalarGraph, term: Term, gives_effort: bool) -> int:
    """Whether a one-port that gives out effort (or flow) here determines its junction, as a term's value."""
    return int(gives_effort == (scalar.junctions[term.junction].kind == 0))


def facts(scalar: ScalarGraph, ports: Ports, related: Set[int]) -> Iterator[Fact]:
    """All of them. `related`: the terms whose variable a relation of a two-port gives."""
    elements = {element.name: element for element in scalar.graph.elements}
    moduli = Moduli(scalar.graph)
    yield from _sources(scalar, ports)
    yield from _one_way_moduli(scalar, elements, moduli, related)
    yield from _one_way_laws(scalar, ports, moduli)


def _sources(scalar: ScalarGraph, ports: Ports) -> Iterator[Fact]:
    for element in scalar.graph.elements:
        if element.kind in ("Se", "MSe", "Sf", "MSf"):
            for term in ports[element.name]:
                yield term, sets(scalar, term, element.kind.endswith("e")), Reason("source")


def _one_way_moduli(scalar: ScalarGraph, elements: Mapping[str, Element], moduli: Moduli, related: Set[int]) -> Iterator[Fact]:
    """Two-ports that must not divide by their modulus: multiplying, an end with a relation determines, one without does not."""
    crowded = _crowded_entries(scalar, elements)
    for term in scalar.terms:
        if term.modulus is not None and (term.index in crowded or moduli.can_vanish(term.modulus)):
            yield term, int(term.index in related), Reason("modulus")


def _crowded_entries(scalar: ScalarGraph, elements: Mapping[str, Element]) -> set[int]:
    """Entries that share their row or column of a matrix with another, and all entries of Euler structures."""
    count: dict[tuple[str, int, int], int] = {}
    entries = [term for term in scalar.terms if term.is_two_port and term.element is not None and term.entry is not None]
    for term in entries:
        assert term.element is not None
        key = (term.element, term.port, term.spot)
        count[key] = count.get(key, 0) + 1
    crowded: set[int] = set()
    for term in entries:
        assert term.element is not None and term.other is not None
        if count[term.element, term.port, term.spot] > 1 or elements[term.element].kind == "EJS":
            crowded |= {term.index, term.other}
    return crowded


def _one_way_laws(scalar: ScalarGraph, ports: Ports, moduli: Moduli) -> Iterator[Fact]:
    """Ports of resistors and user elements that can only give out one of effort and flow."""
    for element in scalar.graph.elements:
        if element.kind in ("R", "field"):
            for term in ports.get(element.name, ()):
                direction = only_direction(element, term, moduli)
                if direction is not None:
                    yield term, sets(scalar, term, direction == "e"), Reason("law")
