"""What every variable of the flat graph is in terms of the scalar one.

Input        the nodes of the flat graph with their groups, the terms made of them
Output       flat variable -> expression, for those that are no unknowns themselves
Establishes  each junction, port and bond variable of the flat graph is an unknown or an alias
Reports      nothing
"""

from __future__ import annotations

from collections.abc import Iterator

from bgdsl.expr import ZERO, Expr, add, var
from bgdsl.ir.elements import component
from bgdsl.ir.scalar import Term
from bgdsl.passes.scalar_nodes import Kind, Opening, Place


def make_aliases(work: Opening, groups: list[list[int]], terms: list[Term]) -> dict[str, Expr]:
    """The value of every junction, port and bond variable of the flat graph that is no unknown."""
    nodes = work.nodes
    aliases: dict[str, Expr] = {}
    common = [var(nodes[group[0]].variable) for group in groups]
    for group in groups:
        for number in group:
            aliases[nodes[number].variable] = common[nodes[number].group]
    conjugates: dict[Place, list[Expr]] = {}
    for node in nodes:
        for offset, proto in enumerate(node.protos):
            if proto.place is not None and (proto.entry is not None or proto.pair is None):
                conjugates.setdefault(proto.place, []).append(terms[node.start + offset].conjugate)
    for place, number in work.seat.items():
        node = nodes[number]
        aliases[work.variable(place, "ef"[node.kind])] = common[node.group]
        aliases[work.variable(place, "fe"[node.kind])] = add(conjugates.get(place, ()))
    aliases.update(_bond_values(work, common, terms))
    return {name: value for name, value in aliases.items() if not (value.op == "var" and value.data == name)}


def _bond_values(work: Opening, common: list[Expr], terms: list[Term]) -> Iterator[tuple[str, Expr]]:
    """Effort and flow of every bond component, positive from tail to head."""
    for number, node in enumerate(work.nodes):
        kind, here = node.kind, common[node.group]
        for offset, proto in enumerate(node.protos):
            if proto.entry is None or work.own.get(proto.place or (-1, 0, 0)) != number:
                yield from _bond_pair(work, proto.bond, proto.component, kind, here, terms[node.start + offset].conjugate)
        if node.via is not None:
            _, b, c, _ = node.via
            yield from _bond_pair(work, b, c, kind, here, node.carried)
    for number, b, c in work.loops:
        node = work.nodes[number]
        yield from _bond_pair(work, b, c, node.kind, common[node.group], ZERO)


def _bond_pair(work: Opening, b: int, c: int, kind: Kind, common: Expr, conjugate: Expr) -> Iterator[tuple[str, Expr]]:
    bond = work.graph.bonds[b]
    shown = None if bond.size is None else c
    effort, flow = (conjugate, common) if kind else (common, conjugate)
    yield component(f"{bond.name}.e", shown), effort
    yield component(f"{bond.name}.f", shown), flow
