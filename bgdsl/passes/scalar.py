"""Open every vector and matrix: the scalar normal form that causality, equations and activity work on.

Input        BondGraph    every component of every port has one bond
Output       ScalarGraph  junctions of one component, terms of one bond or matrix entry each
Establishes  touching junctions of one kind are one junction; every variable of the flat graph is an unknown or an alias
Reports      BG410 junctions of one kind in a loop (warning)

A *node* is a component of a junction, or of an element's port where a junction is implied: a matrix port sums its entries
there, and two elements bonded directly meet in one. Nodes of one kind joined by a bond are merged into a *group*.
"""

from __future__ import annotations

from collections.abc import Iterator

from bgdsl.diagnostics import Code, Reporter, listed
from bgdsl.expr import Expr, add
from bgdsl.ir.elements import component
from bgdsl.ir.graph import Bond, BondGraph, Element
from bgdsl.ir.scalar import InnerBond, ScalarGraph, ScalarJunction, Term
from bgdsl.passes.scalar_aliases import make_aliases
from bgdsl.passes.scalar_nodes import NATURAL, Link, Node, Opening, Place, Proto, Sign
from bgdsl.passes.scalar_terms import make_terms

LIKE_LOOP = Code("BG410", "junctions of one kind form a loop", "warning")


def open_vectors(graph: BondGraph, report: Reporter) -> ScalarGraph:
    """The scalar normal form of a flat graph. A loop of like junctions is warned about; nothing else can go wrong here."""
    work = Opening(graph, {element.name: i for i, element in enumerate(graph.elements)})
    first_node = _make_nodes(work)
    _join_bonds(work, first_node)
    _attach_entries(work)
    groups = _merge(work)
    terms, relations, unknowns = make_terms(work, groups)
    inner = _inner_bonds(work, groups, terms, report)
    junctions = tuple(_junction(work, group) for group in groups)
    terms_at = tuple(tuple(range(work.nodes[group[0]].start, work.nodes[group[0]].stop)) for group in groups)
    aliases = make_aliases(work, groups, terms)
    return ScalarGraph(graph, junctions, tuple(terms), terms_at, aliases, tuple(relations), tuple(unknowns), tuple(inner))


# ---------------------------------------------------------------------------------------------------------------- nodes


def _make_nodes(work: Opening) -> dict[str, int]:
    """Make the nodes of junctions and of matrix ports; the first node of every junction is returned."""
    first: dict[str, int] = {}
    for junction in work.graph.junctions:
        first[junction.name] = len(work.nodes)
        for i in range(1 if junction.size is None else junction.size):
            name = component(junction.name, None if junction.size is None else i)
            work.nodes.append(Node(junction.kind, name, junction.variable(i), junction.origin, (junction.name, i)))
    meets = _reach_ports(work)
    for index, element in enumerate(work.graph.elements):
        for k in range(len(element.ports)) if element.kind in NATURAL else ():
            for i in range(element.ports[k].width):
                place = (index, k, i)
                if place not in meets or element.kind == "EJS" or len(list(_entries_at(element, k, i))) != 1:
                    work.own[place] = work.seat[place] = work.port_node(place, NATURAL[element.kind][k])
    return first


def _reach_ports(work: Opening) -> set[Place]:
    """Note the bond at every element port component; those whose bond comes from a junction are returned."""
    meets: set[Place] = set()
    for b, bond in enumerate(work.graph.bonds):
        for end, far in ((bond.tail, bond.head), (bond.head, bond.tail)):
            index = work.index.get(end.node)
            if index is not None:
                places = [(index, end.port, i) for i in end.components]
                work.brought.update({place: (b, c) for c, place in enumerate(places)})
                if far.node not in work.index:
                    meets.update(places)
    return meets


def _entries_at(element: Element, port: int, i: int) -> Iterator[tuple[int, int]]:
    """The (row, column) of the entries at component i of a port that are not identically zero."""
    modulus = element.modulus
    assert modulus is not None
    if element.kind == "EJS":
        yield from ((i, j) for j in range(len(modulus)) if j != i and not (modulus[i][j].is_zero and modulus[j][i].is_zero))
    elif port == 0:
        yield from ((row, i) for row in range(len(modulus)) if not modulus[row][i].is_zero)
    else:
        yield from ((i, column) for column in range(len(modulus[0])) if not modulus[i][column].is_zero)


# ---------------------------------------------------------------------------------------------------------------- bonds


def _join_bonds(work: Opening, first_node: dict[str, int]) -> None:
    for b, bond in enumerate(work.graph.bonds):
        ends = [(work.index.get(end.node), end) for end in (bond.tail, bond.head)]
        for c in range(bond.width):
            tail, head = (
                first_node[end.node] + end.components[c] if index is None else (index, end.port, end.components[c]) for index, end in ends
            )
            _join(work, b, c, tail, head)


def _join(work: Opening, b: int, c: int, tail: int | Place, head: int | Place) -> None:
    at_tail = tail if isinstance(tail, int) else work.own.get(tail)
    at_head = head if isinstance(head, int) else work.own.get(head)
    if at_tail is None and at_head is None:
        assert not isinstance(tail, int)
        node = work.port_node(tail, 1)
        _seat(work, node, tail, 1)
        assert not isinstance(head, int)
        _seat(work, node, head, -1)
    elif at_tail is None:
        assert not isinstance(tail, int) and at_head is not None
        _seat(work, at_head, tail, 1)
    elif at_head is None:
        assert not isinstance(head, int)
        _seat(work, at_tail, head, -1)
    elif work.nodes[at_tail].kind == work.nodes[at_head].kind:
        work.nodes[at_tail].links.append((at_head, b, c, False))
        work.nodes[at_head].links.append((at_tail, b, c, True))
    else:
        leads = next((end for end in (tail, head) if not isinstance(end, int)), None)
        work.nodes[at_tail].protos.append(Proto(at_tail, -1, b, c, leads, (b, c)))
        work.nodes[at_head].protos.append(Proto(at_head, 1, b, c, leads, (b, c)))


def _seat(work: Opening, node: int, place: Place, sign: Sign) -> None:
    """Give an element's port a term at a node that is not its own: the port itself, or the only entry it has."""
    element = work.element(place)
    assert work.port(place).inward == (sign < 0), f"the bond at {element.name} runs against its port"
    work.seat[place] = node
    if element.kind in NATURAL:
        (entry,) = _entries_at(element, place[1], place[2])
        work.nodes[node].protos.append(_entry(work, node, place, sign, entry))
    else:
        work.nodes[node].protos.append(Proto(node, sign, *work.brought[place], place))


def _attach_entries(work: Opening) -> None:
    """Attach the entries of every port component that has a node of its own."""
    for place, node in work.own.items():
        sign: Sign = -1 if work.port(place).inward else 1
        for entry in _entries_at(work.element(place), place[1], place[2]):
            work.nodes[node].protos.append(_entry(work, node, place, sign, entry))


def _entry(work: Opening, node: int, place: Place, sign: Sign, entry: tuple[int, int]) -> Proto:
    pair = (min(entry), max(entry)) if work.element(place).kind == "EJS" else entry
    return Proto(node, sign, *work.brought[place], place, (place[0], *pair), entry)


# --------------------------------------------------------------------------------------------------------------- groups


def _merge(work: Opening) -> list[list[int]]:
    """The groups of like nodes in touch, in the order of their first nodes, each as a depth-first walk from that node."""
    nodes = work.nodes
    groups: list[list[int]] = []
    for first in range(len(nodes)):
        if nodes[first].group >= 0:
            continue
        order: list[int] = []
        stack: list[tuple[int, Link | None]] = [(first, None)]
        while stack:
            number, via = stack.pop()
            node = nodes[number]
            if node.group >= 0:
                continue
            node.group, node.via = len(groups), via
            order.append(number)
            stack += [(far, (number, b, c, not at_head)) for far, b, c, at_head in reversed(node.links) if nodes[far].group < 0]
        groups.append(order)
    return groups


def _junction(work: Opening, group: list[int]) -> ScalarJunction:
    first = work.nodes[group[0]]
    members = tuple(member for n in sorted(group) if (member := work.nodes[n].member) is not None)
    return ScalarJunction(first.name, first.kind, first.variable, members, first.origin)


def _inner_bonds(work: Opening, groups: list[list[int]], terms: list[Term], report: Reporter) -> list[InnerBond]:
    """The bonds inside groups, with `stop` and `carried` of every node filled from the leaves of its group's walk."""
    inner: list[InnerBond] = []
    for g, group in enumerate(groups):
        if len(group) == 1 and not work.nodes[group[0]].links:
            continue
        below: dict[int, list[Expr]] = {number: [] for number in group}
        for number in reversed(group):
            node = work.nodes[number]
            if node.via is not None:
                at_head = node.via[3]
                brought = [_signed(terms[t], at_head) for t in range(node.start, node.start + len(node.protos))]
                node.carried = add([*brought, *(-share if at_head else share for share in reversed(below[number]))])
                parent = work.nodes[node.via[0]]
                parent.stop = max(parent.stop, node.stop)
                below[node.via[0]].append(-node.carried if at_head else node.carried)
        tree = {(via[1], via[2]) for number in group if (via := work.nodes[number].via) is not None}
        for number in group:
            node = work.nodes[number]
            if node.via is not None:
                _, b, c, at_head = node.via
                inner.append(InnerBond(*_named(work, b, c), g, "head" if at_head else "tail", node.start, node.stop))
            for _, b, c, at_head in node.links:
                if (b, c) not in tree and at_head:
                    inner.append(InnerBond(*_named(work, b, c), g, "head", 0, 0, loop=True))
                    work.loops.append((number, b, c))
                    _warn_loop(work, group, work.graph.bonds[b], report)
    return inner


def _signed(term: Term, taken: bool) -> Expr:
    """What a term brings to its junction, or takes from it."""
    return term.conjugate if (term.sign > 0) != taken else -term.conjugate


def _named(work: Opening, b: int, c: int) -> tuple[str, int | None]:
    bond = work.graph.bonds[b]
    return bond.name, None if bond.size is None else c


def _warn_loop(work: Opening, group: list[int], bond: Bond, report: Reporter) -> None:
    kind = work.nodes[group[0]].kind
    if any(d.code is LIKE_LOOP and d.primary.span == bond.origins[-1].span for d in report.diagnostics[-8:]):
        return  # another component of the same vector bond
    names = [work.nodes[number].name for number in group]
    one, parted = ("flow", "efforts") if kind else ("effort", "flows")
    shown = listed(names, 6)
    report.add(
        LIKE_LOOP,
        f"bond `{bond.name}` closes a loop of {kind}-junctions",
        bond.origins[-1].span,
        "closes the loop",
        notes=[
            f"{shown} {'share' if len(names) > 1 else 'has'} one {one}, so how the {parted} divide around the loop is not determined",
            f"`{bond.name}` is taken to carry none; every other variable is unaffected",
        ],
        helps=["remove one bond of the loop"],
    )
