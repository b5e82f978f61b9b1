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
from dataclasses import dataclass, field
from typing import Literal

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import ZERO, Expr, add, var
from bgdsl.ir.elements import component
from bgdsl.ir.graph import Bond, BondGraph, Element, Origin, Port
from bgdsl.ir.scalar import InnerBond, Relation, ScalarGraph, ScalarJunction, Term

LIKE_LOOP = Code("BG410", "junctions of one kind form a loop", "warning")

Kind = Literal[0, 1]
Sign = Literal[1, -1]
Place = tuple[int, int, int]
"""A component of an element's port: (element index, port, component)."""
Link = tuple[int, int, int, bool]
"""A bond to a node of the same kind: (far node, bond, component, whether this node is at its head)."""

_NATURAL: dict[str, tuple[Kind, Kind]] = {"TF": (1, 0), "MTF": (1, 0), "GY": (1, 1), "MGY": (1, 1), "EJS": (1, 1)}
"""The junction kinds at port 1 and 2 for which an entry's conjugate is its modulus times the far side's variable."""


@dataclass(slots=True)
class _Proto:
    """A term in the making. `pair` is the same for the two ends of one bond or one entry, None at a one-port."""

    node: int
    sign: Sign
    bond: int
    component: int
    place: Place | None
    pair: tuple[int, ...] | None = None
    entry: tuple[int, int] | None = None
    """Row and column, also of a scalar two-port: (0, 0)."""


@dataclass(slots=True)
class _Node:
    kind: Kind
    name: str
    variable: str
    origin: Origin
    member: tuple[str, int] | None
    protos: list[_Proto] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)
    via: Link | None = None
    """How the walk over the group reached this node: the link from here to its parent."""
    group: int = -1
    start: int = 0
    stop: int = 0
    """The terms of this node and of all nodes reached through it."""
    carried: Expr = ZERO
    """The conjugate of the bond to the parent."""


@dataclass(slots=True)
class _Work:
    """Everything the steps of the opening share."""

    graph: BondGraph
    index: dict[str, int]
    nodes: list[_Node] = field(default_factory=list)
    own: dict[Place, int] = field(default_factory=dict)
    """Nodes made by element ports."""
    seat: dict[Place, int] = field(default_factory=dict)
    """The node at which each element port component has its terms."""
    brought: dict[Place, tuple[int, int]] = field(default_factory=dict)
    """The bond and its component that reaches each element port component."""
    loops: list[tuple[int, int, int]] = field(default_factory=list)
    """The bonds that close loops of like nodes: (node at the head, bond, component)."""

    def element(self, place: Place) -> Element:
        return self.graph.elements[place[0]]

    def port(self, place: Place) -> Port:
        return self.graph.elements[place[0]].ports[place[1]]

    def variable(self, place: Place, letter: str) -> str:
        return self.port(place).variable(self.element(place).name, letter, place[2])

    def port_node(self, place: Place, kind: Kind) -> int:
        element, port = self.element(place), self.port(place)
        name = component(f"{element.name}.{port.name}" if port.name else element.name, None if port.size is None else place[2])
        self.nodes.append(_Node(kind, name, self.variable(place, "ef"[kind]), element.origin, None))
        return len(self.nodes) - 1


def open_vectors(graph: BondGraph, report: Reporter) -> ScalarGraph:
    """The scalar normal form of a flat graph. A loop of like junctions is warned about; nothing else can go wrong here."""
    work = _Work(graph, {element.name: i for i, element in enumerate(graph.elements)})
    first_node = _make_nodes(work)
    _join_bonds(work, first_node)
    _attach_entries(work)
    groups = _merge(work)
    terms, relations, unknowns = _terms(work, groups)
    inner = _inner_bonds(work, groups, terms, report)
    junctions = tuple(_junction(work, group) for group in groups)
    terms_at = tuple(tuple(range(work.nodes[group[0]].start, work.nodes[group[0]].stop)) for group in groups)
    aliases = _aliases(work, groups, terms)
    return ScalarGraph(graph, junctions, tuple(terms), terms_at, aliases, tuple(relations), tuple(unknowns), tuple(inner))


# ---------------------------------------------------------------------------------------------------------------- nodes


def _make_nodes(work: _Work) -> dict[str, int]:
    """Make the nodes of junctions and of matrix ports; the first node of every junction is returned."""
    first: dict[str, int] = {}
    for junction in work.graph.junctions:
        first[junction.name] = len(work.nodes)
        for i in range(1 if junction.size is None else junction.size):
            name = component(junction.name, None if junction.size is None else i)
            work.nodes.append(_Node(junction.kind, name, junction.variable(i), junction.origin, (junction.name, i)))
    meets = _reach_ports(work)
    for index, element in enumerate(work.graph.elements):
        for k in range(len(element.ports)) if element.kind in _NATURAL else ():
            for i in range(element.ports[k].width):
                place = (index, k, i)
                if place not in meets or element.kind == "EJS" or len(list(_entries_at(element, k, i))) != 1:
                    work.own[place] = work.seat[place] = work.port_node(place, _NATURAL[element.kind][k])
    return first


def _reach_ports(work: _Work) -> set[Place]:
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


def _join_bonds(work: _Work, first_node: dict[str, int]) -> None:
    for b, bond in enumerate(work.graph.bonds):
        ends = [(work.index.get(end.node), end) for end in (bond.tail, bond.head)]
        for c in range(bond.width):
            tail, head = (
                first_node[end.node] + end.components[c] if index is None else (index, end.port, end.components[c]) for index, end in ends
            )
            _join(work, b, c, tail, head)


def _join(work: _Work, b: int, c: int, tail: int | Place, head: int | Place) -> None:
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
        work.nodes[at_tail].protos.append(_Proto(at_tail, -1, b, c, leads, (b, c)))
        work.nodes[at_head].protos.append(_Proto(at_head, 1, b, c, leads, (b, c)))


def _seat(work: _Work, node: int, place: Place, sign: Sign) -> None:
    """Give an element's port a term at a node that is not its own: the port itself, or the only entry it has."""
    element = work.element(place)
    assert work.port(place).inward == (sign < 0), f"the bond at {element.name} runs against its port"
    work.seat[place] = node
    if element.kind in _NATURAL:
        (entry,) = _entries_at(element, place[1], place[2])
        work.nodes[node].protos.append(_entry(work, node, place, sign, entry))
    else:
        work.nodes[node].protos.append(_Proto(node, sign, *work.brought[place], place))


def _attach_entries(work: _Work) -> None:
    """Attach the entries of every port component that has a node of its own."""
    for place, node in work.own.items():
        sign: Sign = -1 if work.port(place).inward else 1
        for entry in _entries_at(work.element(place), place[1], place[2]):
            work.nodes[node].protos.append(_entry(work, node, place, sign, entry))


def _entry(work: _Work, node: int, place: Place, sign: Sign, entry: tuple[int, int]) -> _Proto:
    pair = (min(entry), max(entry)) if work.element(place).kind == "EJS" else entry
    return _Proto(node, sign, *work.brought[place], place, (place[0], *pair), entry)


# --------------------------------------------------------------------------------------------------------------- groups


def _merge(work: _Work) -> list[list[int]]:
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


def _junction(work: _Work, group: list[int]) -> ScalarJunction:
    first = work.nodes[group[0]]
    members = tuple(member for n in sorted(group) if (member := work.nodes[n].member) is not None)
    return ScalarJunction(first.name, first.kind, first.variable, members, first.origin)


def _inner_bonds(work: _Work, groups: list[list[int]], terms: list[Term], report: Reporter) -> list[InnerBond]:
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


def _named(work: _Work, b: int, c: int) -> tuple[str, int | None]:
    bond = work.graph.bonds[b]
    return bond.name, None if bond.size is None else c


def _warn_loop(work: _Work, group: list[int], bond: Bond, report: Reporter) -> None:
    kind = work.nodes[group[0]].kind
    if any(d.code is LIKE_LOOP and d.primary.span == bond.origins[-1].span for d in report.diagnostics[-8:]):
        return  # another component of the same vector bond
    names = [work.nodes[number].name for number in group]
    one, parted = ("flow", "efforts") if kind else ("effort", "flows")
    shown = ", ".join(f"`{name}`" for name in names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
    report.add(
        LIKE_LOOP,
        f"bond `{bond.name}` closes a loop of {kind}-junctions",
        bond.origins[-1].span,
        "closes the loop",
        notes=[
            f"{shown} share one {one}, so how the {parted} divide around the loop is not determined",
            f"`{bond.name}` is taken to carry none; every other variable is unaffected",
        ],
        helps=["remove one bond of the loop"],
    )


# ---------------------------------------------------------------------------------------------------------------- terms


def _terms(work: _Work, groups: list[list[int]]) -> tuple[list[Term], list[Relation], list[str]]:
    """Every proto as a term, numbered along the walks of the groups, with its conjugate; `start` and `stop` of nodes are set."""
    protos: list[_Proto] = []
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


def _far_ends(protos: list[_Proto]) -> list[int | None]:
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


def _term(work: _Work, t: int, proto: _Proto, far: int | None, conjugate: Expr, modulus: Expr | None) -> Term:
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


def _common(work: _Work, groups: list[list[int]], proto: _Proto) -> Expr:
    """The variable of the junction that a proto is at."""
    return var(work.nodes[groups[work.nodes[proto.node].group][0]].variable)


def _conjugate(work: _Work, groups: list[list[int]], proto: _Proto, far: _Proto | None) -> tuple[Expr, Expr | None, bool]:
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
    natural = _NATURAL[element.kind]
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


def _relation(work: _Work, groups: list[list[int]], t: int, proto: _Proto, far: _Proto) -> list[Relation]:
    """The relation at this end of a two-port: where the end does not have its natural kind, its junction's variable is the
    modulus times the far side's variable of the same letter (a transformer) or of the other one (a gyrator)."""
    assert proto.place is not None and proto.entry is not None and far.place is not None
    element = work.element(proto.place)
    natural = _NATURAL[element.kind]
    kind = work.nodes[proto.node].kind
    if element.kind == "EJS" or kind == natural[proto.place[1]]:
        return []
    letter = "ef"[kind]
    wanted = _opposite(element, letter)
    far_kind = work.nodes[far.node].kind
    source = _common(work, groups, far) if wanted == "ef"[far_kind] else var(work.variable(far.place, wanted))
    right = _modulus(element, proto.entry) * source
    return [Relation(_common(work, groups, proto), right, element.name, t, element.origin)]


# -------------------------------------------------------------------------------------------------------------- aliases


def _aliases(work: _Work, groups: list[list[int]], terms: list[Term]) -> dict[str, Expr]:
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


def _bond_values(work: _Work, common: list[Expr], terms: list[Term]) -> Iterator[tuple[str, Expr]]:
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


def _bond_pair(work: _Work, b: int, c: int, kind: Kind, common: Expr, conjugate: Expr) -> Iterator[tuple[str, Expr]]:
    bond = work.graph.bonds[b]
    shown = None if bond.size is None else c
    effort, flow = (conjugate, common) if kind else (common, conjugate)
    yield component(f"{bond.name}.e", shown), effort
    yield component(f"{bond.name}.f", shown), flow
