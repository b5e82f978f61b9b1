"""Terms of the scalar graph, and the relations between the two ends of a two-port.

Input        the nodes of the flat graph with their groups: like nodes joined by bonds
Output       terms in the order of their groups, relations, names of the unknowns
Establishes  each term is listed once, the two ends of a bond or of an entry know each other, each conjugate is an unknown or follows
Reports      nothing
"""

from __future__ import annotations

from bgdsl.expr import Expr, var
from bgdsl.ir.graph import Element
from bgdsl.ir.scalar import Relation, Term
from bgdsl.passes.scalar_nodes import NATURAL, Opening, Proto


def make_terms(work: Opening, groups: list[list[int]]) -> tuple[list[Term], list[Relation], list[str]]:
    """Every proto as a term, numbered along the walks of the groups, with its conjugate; `start` and `stop` of nodes are set."""
    protos: list[Proto] = []
    for group in groups:
        for number in group:
            node = work.nodes[number]
            node.start = len(protos)
            protos += node.protos
            node.stop = len(protos)
    other = _far_ends(protos)
    terms: list[Term] = []
    relations: list[Relation] = []
    unknowns: list[str] = []
    for t, proto in enumerate(protos):
        far = other[t]
        conjugate, modulus, needs = _conjugate(work, groups, proto, protos[far] if far is not None else None)
        terms.append(_term(work, t, proto, far, conjugate, modulus))
        if conjugate.op == "var" and needs:
            unknowns.append(conjugate.data)
        if proto.entry is not None and far is not None:
            relations += _relation(work, groups, t, proto, protos[far])
    return terms, relations, unknowns


def _far_ends(protos: list[Proto]) -> list[int | None]:
    other: list[int | None] = [None] * len(protos)
    waiting: dict[tuple[int, ...], int] = {}
    for t, proto in enumerate(protos):
        if proto.pair is not None:
            before = waiting.pop(proto.pair, None)
            if before is None:
                waiting[proto.pair] = t
            else:
                other[t], other[before] = before, t
    assert not waiting
    return other


def _term(work: Opening, t: int, proto: Proto, far: int | None, conjugate: Expr, modulus: Expr | None) -> Term:
    bond = work.graph.bonds[proto.bond]
    place = proto.place
    element = work.element(place) if place is not None else None
    matrix = element is not None and any(port.size is not None for port in element.ports)
    return Term(
        t,
        work.nodes[proto.node].group,
        proto.sign,
        conjugate,
        bond.name,
        None if bond.size is None else proto.component,
        element.name if element is not None else None,
        place[1] if place is not None else 0,
        proto.entry if matrix else None,
        far,
        element is not None and element.parasitic,
        bond.origins[0] if proto.sign < 0 else bond.origins[-1],
        modulus,
        place[2] if place is not None else 0,
    )


def _common(work: Opening, groups: list[list[int]], proto: Proto) -> Expr:
    """The variable of the junction that a proto is at."""
    return var(work.nodes[groups[work.nodes[proto.node].group][0]].variable)


def _conjugate(work: Opening, groups: list[list[int]], proto: Proto, far: Proto | None) -> tuple[Expr, Expr | None, bool]:
    """A proto's conjugate, its two-port's modulus, and whether the conjugate is an unknown of its own."""
    kind = work.nodes[proto.node].kind
    if proto.entry is None and far is not None:
        return _common(work, groups, far), None, False
    assert proto.place is not None
    letter = "e" if kind else "f"
    own = var(work.variable(proto.place, letter))
    if far is None or proto.entry is None:
        return own, None, True
    assert far.place is not None
    element = work.element(proto.place)
    modulus = _modulus(element, proto.entry)
    natural = NATURAL[element.kind]
    k = proto.place[1]
    here_fits = kind == natural[k]
    far_fits = work.nodes[far.node].kind == natural[far.place[1]]
    if element.kind == "EJS" or (here_fits and far_fits):
        return modulus * _common(work, groups, far), modulus, False
    if here_fits:  # the far side carries the unknown; this conjugate is the modulus times it
        return modulus * var(work.variable(far.place, _opposite(element, letter))), modulus, False
    return own, modulus, True


def _opposite(element: Element, letter: str) -> str:
    """The letter of the far side's variable that a multiplication turns into `letter` here."""
    return letter if "TF" in element.kind else "ef"[letter == "e"]


def _modulus(element: Element, entry: tuple[int, int]) -> Expr:
    modulus = element.modulus
    assert modulus is not None
    row, column = entry
    value = modulus[row][column]
    return -modulus[column][row] if element.kind == "EJS" and value.is_zero else value


def _relation(work: Opening, groups: list[list[int]], t: int, proto: Proto, far: Proto) -> list[Relation]:
    """The relation at this end of a two-port: where the end does not have its natural kind, its junction's variable is the
    modulus times the far side's variable of the same letter (a transformer) or of the other one (a gyrator)."""
    assert proto.place is not None and proto.entry is not None and far.place is not None
    element = work.element(proto.place)
    natural = NATURAL[element.kind]
    kind = work.nodes[proto.node].kind
    if element.kind == "EJS" or kind == natural[proto.place[1]]:
        return []
    letter = "ef"[kind]
    wanted = _opposite(element, letter)
    far_kind = work.nodes[far.node].kind
    source = _common(work, groups, far) if wanted == "ef"[far_kind] else var(work.variable(far.place, wanted))
    right = _modulus(element, proto.entry) * source
    return [Relation(_common(work, groups, proto), right, element.name, t, element.origin)]
