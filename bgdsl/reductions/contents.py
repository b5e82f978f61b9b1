"""What of a part belongs to which instance: junctions, elements, bonds, signals and parameters, each where the author has it.

Input        ScalarGraph, Part
Output       Contents    a Body for each instance; where every variable is read; inputs and outputs of the part
Establishes  the bodies together say the balances of the wanted junctions less the dropped terms, with every law, relation and
             signal equation that belongs to them; what they read of others is an `input` of the model
Reports      nothing; UnwritableError where an element cannot be written by itself

Junctions that a bond joins stay apart as the author drew them. A bond from one instance to another stands in the innermost one
that has both; where it starts at an element, the element's instance gets an open junction in the place of the author's port.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from bgdsl.expr import Expr, const, evaluate, leaves, param, substitute, to_text, topological, var
from bgdsl.ir.graph import Element, Parameter, Signal
from bgdsl.ir.scalar import ScalarGraph, Term
from bgdsl.reductions.condition import element_kinds, parameter_values
from bgdsl.reductions.part import Part, imposed
from bgdsl.reductions.places import (
    Body,
    Key,
    LocalNames,
    Piece,
    Spot,
    Value,
    common,
    extents,
    flat_name,
    indices,
    split,
    within,
    without_indices,
)
from bgdsl.reductions.source_map import UnwritableError

LONGEST = 100
"""Nodes of an expression beyond which a parameter's default or a start is written as its number."""

Vertex = tuple[str, int] | int
"""A junction's component, or the scalar junction that an element's port makes."""

PARAMETER, INPUT, JUNCTION, ELEMENT, SIGNAL, OUTPUT = range(6)


@dataclass(slots=True, eq=False)
class Contents:
    """bodies: by instance, in the order of the model. readings: the places at which a variable or a parameter can be read, best
    first. inputs, outputs: variables of other parts and for them, with the names that they have here."""

    bodies: dict[str, Body]
    readings: dict[str, tuple[Spot, ...]] = field(default_factory=dict)
    extents: dict[Key, tuple[int, ...]] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    elements: dict[str, str] = field(default_factory=dict)
    """Names of the classes of users' elements, by their texts with `{}` for the name."""
    variables: dict[str, Spot] = field(default_factory=dict)
    """Where the model's own variables are now."""
    there: set[str] = field(default_factory=set)
    """Junctions and elements of which something is there, by their flat paths."""


def gather(scalar: ScalarGraph, part: Part) -> Contents:
    """What stands where."""
    work = _Gathering(scalar, part)
    work.join_junctions()
    work.write_terms()
    work.write_junctions()
    work.write_signals()
    work.write_checks()
    work.read_all()
    work.write_outputs()
    work.localise()
    return work.found


class _Gathering:
    def __init__(self, scalar: ScalarGraph, part: Part):
        self.scalar, self.part, self.graph = scalar, part, scalar.graph
        self.kinds = element_kinds(self.graph)
        self.elements = {element.name: element for element in self.graph.elements}
        self.junctions = {junction.name: junction for junction in self.graph.junctions}
        self.sizes = {junction.name: junction.size for junction in self.graph.junctions}
        self.bonds = {bond.name: bond for bond in self.graph.bonds}
        self.names = LocalNames(self.graph)
        paths = [thing.name for things in (self.graph.junctions, self.graph.elements) for thing in things]
        paths += [instance.path for instance in self.graph.instances]
        bodies = {instance.path: Body() for instance in self.graph.instances if instance.path not in self.elements}
        self.found = Contents(bodies, extents=extents(paths))
        self.values = parameter_values(self.graph, part.changed)
        self.parameter_of = {scalar: p for p in self.graph.parameters for scalar in p.scalars()}
        self.signal_of = {scalar: s for s in self.graph.signals for scalar in s.scalars()}
        self.member_of = {member: j for j in part.junctions for member in scalar.junctions[j].members}
        self.brought = {
            (end.node, end.port, i): (bond.name, c, far)
            for bond in self.graph.bonds
            for end, far in ((bond.tail, bond.head), (bond.head, bond.tail))
            for c, i in enumerate(end.components)
            if end.node in self.elements
        }
        self.held: dict[int | str, list[tuple[str, float]]] = {}
        for (reader, signal), held in part.frozen.items():
            self.held.setdefault(reader, []).append((signal, held))
        self.places: dict[Vertex, Spot] = {}
        self.kept: dict[int, list[Vertex]] = {}
        self.opened: set[Vertex] = set()
        self.proxies: dict[tuple[str, Vertex], Spot] = {}
        self.parameters: dict[str, None] = {}

    def body(self, path: str) -> Body:
        return self.found.bodies[path]

    def add(self, piece: Piece) -> None:
        self.body(piece.spot.owner).pieces[piece.spot.name, piece.spot.index] = piece

    # ------------------------------------------------------------------------------------------------------- places

    def piece_of(self, base: Spot, tag: str) -> Spot:
        """The place of a scalar piece of a vector or matrix: its name says which."""
        if not tag:
            return Spot(base.owner, base.name, base.index)
        name = self.names.fresh(base.owner, f"{base.name}{tag}", (base.name, tag))
        if base.index:
            self.found.extents[base.owner, name] = self.found.extents[base.key]
        return Spot(base.owner, name, base.index)

    def place(self, vertex: Vertex) -> Spot:
        """Where a junction is."""
        if vertex not in self.places:
            if isinstance(vertex, int):
                self.places[vertex] = self.made_by_port(vertex)
            else:
                name, i = vertex
                self.places[vertex] = self.piece_of(split(name), "" if self.sizes[name] is None else f"_{i + 1}")
        return self.places[vertex]

    def made_by_port(self, j: int) -> Spot:
        """Where a junction is that an element's port made: with the element."""
        junction = self.scalar.junctions[j]
        path, tag = junction.name, ""
        if path not in self.elements and path.endswith("]"):
            path, _, spot = path[:-1].rpartition("[")
            tag = f"_{spot}"
        if path not in self.elements:
            path, _, port = path.rpartition(".")
            tag = f"_{port}{tag}"
        base = split(path)
        return self.piece_of(base, f"{tag or '_j'}")

    def seat(self, term: Term) -> Vertex:
        """The junction at which a term acts: the author's one that its bond ends at, else the one that its element makes."""
        if term.element is not None and (term.modulus is not None or term.other is None):
            _, c, far = self.brought[term.element, term.port, term.spot]
            vertex = (far.node, far.components[c])
        else:
            bond = self.bonds[term.bond]
            end = bond.tail if term.sign < 0 else bond.head
            vertex = (end.node, end.components[term.component or 0])
        return vertex if self.member_of.get(vertex) == term.junction else term.junction

    def port_place(self, element: Element, port: int, spot: int) -> Spot:
        """Where a bond ends at a one-port or a user's element."""
        base = split(element.name)
        if element.kind == "field":
            name = element.ports[port].name
            return Spot(base.owner, base.name, base.index, name, (spot + 1,) if element.ports[port].size is not None else ())
        if element.ports[port].size is None:
            return base
        if self.is_whole(element):
            return Spot(base.owner, base.name, base.index, "", (spot + 1,), element.ports[port].width)
        return self.piece_of(base, f"_{spot + 1}")

    def entry_place(self, term: Term) -> Spot:
        """Where a scalar two-port is: one entry of a matrix, or the whole of a scalar one."""
        tag = f"_{term.entry[0] + 1}_{term.entry[1] + 1}" if term.entry is not None else ""
        return self.piece_of(split(term.element or ""), tag)

    def is_whole(self, element: Element) -> bool:
        """Must a vector element stay whole, since its components are tied together?"""
        if element.kind == "field" or element.ports[0].size is None:
            return False
        own = {element.ports[0].variable(element.name, x, i): i for x in "efpq" for i in range(element.ports[0].width)}
        return any(len({own[leaf.data] for leaf in leaves((law.left, law.right)) if leaf.data in own}) > 1 for law in element.laws)

    # ----------------------------------------------------------------------------------------------------- junctions

    def join_junctions(self) -> None:
        """Bonds between junctions of one kind, as far as there is something to join."""
        attached: dict[Vertex, int] = defaultdict(int)
        at: dict[int, dict[Vertex, None]] = defaultdict(dict)
        for term in self.scalar.terms:
            if term.junction in self.part.junctions and term.index not in self.part.dropped and term.element not in self.part.gone:
                vertex = self.seat(term)
                attached[vertex] += 1
                at[term.junction].setdefault(vertex)
        edges = [edge for edge in self.like_bonds() if None not in edge]
        near: dict[Vertex, list[int]] = defaultdict(list)
        for k, edge in enumerate(edges):
            for vertex in edge:
                near[vertex].append(k)
                at[self.member_of[vertex]].setdefault(vertex)
        alive = [True] * len(edges)
        degree = {vertex: len(of) for vertex, of in near.items()}
        bare = [vertex for vertex in near if degree[vertex] == 1 and not attached[vertex]]
        while bare:
            for k in near[bare.pop()]:
                if alive[k]:
                    alive[k] = False
                    for vertex in edges[k]:
                        degree[vertex] -= 1
                        if degree[vertex] == 1 and not attached[vertex]:
                            bare.append(vertex)
        for k, (tail, head) in enumerate(edges):
            if alive[k]:
                self.link(tail, head)
        for j, vertices in at.items():
            order = {member: k for k, member in enumerate(self.scalar.junctions[j].members)}
            there = [v for v in vertices if attached[v] or degree.get(v)]
            self.kept[j] = sorted(there, key=lambda v: order.get(v, len(order)))  # type: ignore[arg-type]

    def like_bonds(self) -> Iterator[tuple[tuple[str, int], tuple[str, int]]]:
        for inner in self.scalar.inner:
            if inner.junction in self.part.junctions and not inner.loop:
                bond, c = self.bonds[inner.bond], inner.component or 0
                tail, head = ((end.node, end.components[c]) for end in (bond.tail, bond.head))
                if bond.tail.node in self.sizes and bond.head.node in self.sizes:
                    yield tail, head

    def link(self, tail: Vertex, head: Vertex) -> None:
        """A bond between two junctions, where both can be reached."""
        ends = self.place(tail), self.place(head)
        scope = common(ends[0].owner, ends[1].owner)
        self.opened |= {vertex for vertex, end in zip((tail, head), ends, strict=True) if end.owner != scope}
        self.body(scope).links.append(ends)

    def reach(self, owner: str, vertex: Vertex, bond: str) -> Spot:
        """A junction as an element of `owner` can be bonded to it: itself, or an open one in its stead. bond: the author's."""
        spot = self.place(vertex)
        if within(spot.owner, owner):
            if spot.owner != owner:
                self.opened.add(vertex)
            return spot
        if (owner, vertex) not in self.proxies:
            self.proxies[owner, vertex] = self.proxy(owner, vertex, bond)
        return self.proxies[owner, vertex]

    def proxy(self, owner: str, vertex: Vertex, bond: str) -> Spot:
        port = self.port_of(owner, bond)
        number = vertex[1] + 1 if not isinstance(vertex, int) and self.sizes[vertex[0]] is not None else None
        wanted = port if number is None else f"{port}_{number}"
        here = Spot(owner, self.names.fresh(owner, wanted, ("port", vertex)))
        kind = self.kind_of(vertex)
        self.add(Piece(here, JUNCTION, f"J{kind}", open=True))
        spot = self.place(vertex)
        scope = common(owner, spot.owner)
        if spot.owner != scope:
            self.opened.add(vertex)
        self.body(scope).links.append((here, spot) if self.leaves_port(owner, bond) else (spot, here))
        return here

    def port_of(self, owner: str, bond: str) -> str:
        """The name of the model port through which a bond leaves an instance."""
        for _, origin in self.bonds[bond].declared:
            if origin.path == owner:
                return flat_name(origin.span.text.split("(")[0].split("[")[0].split('"')[0])
        return "port"

    def leaves_port(self, owner: str, bond: str) -> bool:
        """Does power count as leaving the instance along the bond?"""
        return within(split(self.bonds[bond].tail.node).owner, owner)

    def kind_of(self, vertex: Vertex) -> int:
        return self.scalar.junctions[vertex if isinstance(vertex, int) else self.member_of[vertex]].kind

    def write_junctions(self) -> None:
        for j in sorted(self.part.junctions):
            junction = self.scalar.junctions[j]
            kept = self.kept.get(j, [])
            spots = []
            for vertex in kept:
                here = self.place(vertex)
                self.add(Piece(here, JUNCTION, f"J{junction.kind}", open=vertex in self.opened))
                spots.append(Spot(here.owner, here.name, here.index, "ef"[junction.kind], here.component))
                if not isinstance(vertex, int):
                    self.found.there.add(vertex[0])
                    self.found.variables[self.junctions[vertex[0]].variable(vertex[1])] = spots[-1]
            self.found.readings[junction.variable] = tuple(spots)

    # --------------------------------------------------------------------------------------------------------- terms

    def write_terms(self) -> None:
        whole: set[str] = set()
        for term in self.scalar.terms:
            if term.junction in self.part.junctions:
                if term.other is None:
                    self.write_one_port(term, whole)
                else:
                    self.write_link(term, self.scalar.terms[term.other])

    def said(self, term: Term, owner: str) -> None:
        if term.index in self.part.dropped:
            self.body(owner).notes.append((len(self.body(owner).links), term.index))

    def write_one_port(self, term: Term, whole: set[str]) -> None:
        element = self.elements[term.element or ""]
        if element.name in self.part.gone:
            self.said(term, split(element.name).owner)
            return
        here = self.port_place(element, term.port, term.spot)
        self.said(term, here.owner)
        if element.kind == "field" or self.is_whole(element):
            if element.name not in whole:
                whole.add(element.name)
                self.add(self.field(element) if element.kind == "field" else self.tied(element))
        else:
            self.add(self.scalar_one_port(element, term, here))
        self.read_port(element, term, here)
        if term.index not in self.part.dropped:
            junction = self.reach(here.owner, self.seat(term), term.bond)
            self.body(here.owner).links.append((junction, here) if term.sign < 0 else (here, junction))
            return
        self.observe(element, term, here)

    def read_port(self, element: Element, term: Term, here: Spot) -> None:
        """Where the variables of a one-port are read."""
        for letter in "efpq":
            variable = element.ports[term.port].variable(element.name, letter, term.spot)
            attribute = f"{here.attribute}.{letter}" if here.attribute else letter
            self.found.variables[variable] = Spot(here.owner, here.name, here.index, attribute, here.component)
            self.found.readings[variable] = (self.found.variables[variable],)
        self.found.there.add(element.name)

    def observe(self, element: Element, term: Term, here: Spot) -> None:
        """A one-port that its junction does not feel: it is driven by what the junction has."""
        junction = self.scalar.junctions[term.junction]
        letter = "ef"[junction.kind]
        tag = f"_{here.component[0]}" if here.component else ""
        drive = self.piece_of(Spot(here.owner, here.name, here.index), f"{tag}_drive")
        self.add(Piece(drive, ELEMENT, f"MS{letter}", values={(letter,): Value((var(junction.variable),))}))
        if term.sign < 0:
            self.body(here.owner).links.append((drive, here))
            return
        meeting = self.piece_of(Spot(here.owner, here.name, here.index), f"{tag}_meeting")
        self.add(Piece(meeting, JUNCTION, f"J{junction.kind}"))
        self.body(here.owner).links += [(here, meeting), (drive, meeting)]

    def scalar_one_port(self, element: Element, term: Term, here: Spot) -> Piece:
        """A scalar one-port: its law in its own letters, starts, flags."""
        port = element.ports[term.port]
        piece = Piece(here, ELEMENT, element.kind, fixed=_flags(element), comment=element.comment)
        if element.linear is not None:
            parameter, rows = element.linear
            piece.values[parameter,] = Value(self.prepared((rows[term.spot][term.spot],)))
        else:
            letters = {port.variable(element.name, letter, term.spot): letter for letter in "efpq"}
            law = next((law for law in element.laws if any(leaf.data in letters for leaf in leaves((law.left, law.right)))), None)
            if law is None or law.left.op != "var" or law.left.data not in letters:
                raise UnwritableError((term.index,), f"the law of `{element.name}` is not given for one variable")
            right = self.prepared((law.right,), (term.index,), letters)
            if any(leaf.data in letters for leaf in leaves(right)):
                piece.law = letters[law.left.data], Value(right, letters=letters)
            else:
                piece.values[letters[law.left.data],] = Value(right)
        for letter in "efpq":
            start = element.starts.get(port.variable(element.name, letter, term.spot))
            if start is not None:
                piece.values[letter, "start"] = Value((self.short(start),))
        return piece

    def tied(self, element: Element) -> Piece:
        """A vector one-port whose components are tied by a matrix."""
        if element.linear is None:
            raise UnwritableError((), f"the laws of `{element.name}` tie its components and are not linear")
        parameter, rows = element.linear
        n, port = element.ports[0].width, element.ports[0]
        piece = Piece(split(element.name), ELEMENT, f"{element.kind}[{n}]", fixed=_flags(element), comment=element.comment)
        piece.values[parameter,] = Value(self.prepared(tuple(entry for row in rows for entry in row)), (n, n))
        for letter in "efpq":
            starts = [element.starts.get(port.variable(element.name, letter, i)) for i in range(n)]
            if any(start is not None for start in starts):
                piece.values[letter, "start"] = Value(tuple(const(0.0) if s is None else self.short(s) for s in starts), (n,))
        return piece

    def field(self, element: Element) -> Piece:
        """A user's element: its class, with what it reads as inputs and parameters, and the instance that binds them."""
        if any(term.element == element.name and term.junction not in self.part.junctions for term in self.scalar.terms):
            raise UnwritableError((), f"`{element.name}` would be cut in two")
        local = {
            port.variable(element.name, x, i): port.variable("", x, i)[1:]
            for port in element.ports
            for x in "ef"
            for i in range(port.width)
        }
        roots = self.prepared(tuple(side for law in element.laws for side in (law.left, law.right)), (), local)
        bound: dict[Expr, Expr] = {}
        piece = Piece(split(element.name), ELEMENT, "", comment=element.comment)
        lines: list[str] = []
        for leaf in [node for node in topological(roots) if node.op in ("var", "param")]:
            if leaf.data in local:
                bound[leaf] = var(local[leaf.data])
                continue
            own = flat_name(without_indices(leaf.data.removeprefix(f"{element.name}.").removeprefix(f"{piece.spot.owner}.")))
            bound[leaf] = var(own)
            lines.append(f"  {'parameter' if leaf.op == 'param' else 'input'} Real {own};")
            piece.values[own,] = Value((leaf,))
        texts = [to_text(root) for root in substitute(roots, bound)]
        ports = [
            f"  port {'in' if port.inward else 'out'} Generic{'' if port.size is None else f'[{port.size}]'} {port.name};"
            for port in element.ports
        ]
        laws = [f"  {left} = {right};" for left, right in zip(texts[::2], texts[1::2], strict=True)]
        kinds = {instance.path: instance.class_name for instance in self.graph.instances}
        text = "\n".join(["element {}", *ports, *lines, "equation", *laws, "end {};", ""])
        piece.type = self.element_class(text, kinds.get(element.name, "Field"))
        return piece

    def element_class(self, text: str, wanted: str) -> str:
        names = self.found.elements
        if text not in names:
            taken, name, k = set(names.values()), wanted, 2
            while name in taken:
                name, k = f"{wanted}_{k}", k + 1
            names[text] = name
        return names[text]

    # --------------------------------------------------------------------------------------------------------- links

    def write_link(self, term: Term, far: Term) -> None:
        """A bond or two-port: whole, or as a source at this end. (The other end writes its own.)"""
        dropped = self.part.dropped
        if term.index in dropped:
            owner = split(term.element).owner if term.modulus is not None and term.element else split(term.bond).owner
            self.said(term, common(self.place(self.seat(term)).owner, owner))
            return
        inside = far.junction in self.part.junctions
        if inside and far.index not in dropped:
            if term.modulus is not None and self.vanishes(term.modulus):
                self.write_source(term, far)
            elif term.index < far.index:
                self.write_two_way(term, far)
            return
        self.write_source(term, far)

    def write_two_way(self, term: Term, far: Term) -> None:
        if term.modulus is None:
            tail, head = (term, far) if term.sign < 0 else (far, term)
            self.link(self.seat(tail), self.seat(head))
            return
        kind = self.kinds[term.element or ""]
        first = min((term, far), key=lambda t: (t.port, t.spot)) if kind == "EJS" else min((term, far), key=lambda t: t.port)
        second = far if first is term else term
        assert first.modulus is not None
        self.found.there.add(first.element or "")
        here = self.entry_place(first)
        shown, letter = {"TF": ("MTF", "m"), "MTF": ("MTF", "m")}.get(kind, ("MGY", "r"))
        modulus = Value(self.prepared((first.modulus,), (first.index, second.index)))
        self.add(Piece(here, ELEMENT, shown, values={(letter,): modulus}))
        ends = [self.reach(here.owner, self.seat(t), t.bond) for t in (first, second)]
        self.body(here.owner).links.append((ends[0], here, ends[1]))

    def vanishes(self, modulus: Expr) -> bool:
        """Is it zero for the parameters given? Then no transformer can be written, and the two terms stand as sources."""
        if any(node.op in ("var", "time") for node in topological((modulus,))):
            return False
        return evaluate(modulus, self.values, tables=self.graph.tables) == 0.0

    def write_source(self, term: Term, far: Term) -> None:
        """What is left of a link at the end where it still acts: a source that carries the far junction's variable."""
        kind, letter, value = imposed(self.scalar, self.kinds, term, far)
        conjugate = "ef"[1 - self.scalar.junctions[term.junction].kind]
        if letter == conjugate and term.sign < 0:
            value = -value
        vertex = self.seat(term)
        here = self.entry_place(term) if term.modulus is not None else self.bond_place(term, vertex)
        if (here.name, here.index) in self.body(here.owner).pieces:
            here = self.piece_of(here, "_back")  # both ends of one bond are sources
        self.found.there |= {term.element} if term.modulus is not None and term.element else set()
        self.add(Piece(here, ELEMENT, kind, values={(letter,): Value(self.prepared((value,), (term.index, far.index)))}))
        self.body(here.owner).links.append((here, self.reach(here.owner, vertex, term.bond)))

    def bond_place(self, term: Term, vertex: Vertex) -> Spot:
        """Where the source stands that takes a plain bond's place: with the junction, named after the port or the bond."""
        owner = self.place(vertex).owner
        tag = "" if term.component is None else f"_{term.component + 1}"
        name = self.port_of(owner, term.bond)
        if name == "port":
            far = split(term.bond)
            name = far.name if far.owner == owner else flat_name(without_indices(term.bond))
        return Spot(owner, self.names.fresh(owner, f"{name}{tag}", ("source", term.bond, term.component)))

    # ------------------------------------------------------------------------------------------------------- signals

    def signal_place(self, signal: Signal) -> Spot:
        """Where a signal is; what a user's element declares is written beside it."""
        base = split(signal.name)
        if base.owner in self.elements:
            element = split(base.owner)
            return Spot(element.owner, self.names.fresh(element.owner, f"{element.name}_{base.name}", signal.name), element.index)
        return base

    def write_signals(self) -> None:
        right = self.equations()
        for signal in self.graph.signals:
            mine = [name for name in signal.scalars() if name in self.part.signals]
            whole = len(mine) == len(signal.scalars())
            for group in [mine] if whole and mine else [[name] for name in mine]:
                self.write_signal(signal, group, right, whole=whole)

    def write_signal(self, signal: Signal, group: Sequence[str], right: dict[str, Value], *, whole: bool) -> None:
        """A signal that is there whole, or one entry of it, with its start and its equations."""
        base = self.signal_place(signal)
        here = base if whole else self.piece_of(base, f"_{flat_name(group[0][len(signal.name) :])}")
        shape = signal.shape if whole else ()
        for name in group:
            component = indices(name[len(signal.name) + 1 : -1]) if shape else ()
            spot = Spot(here.owner, here.name, here.index, "", component)
            self.found.variables[name] = spot
            self.found.readings[name] = (spot,)
            self.found.readings[f"der({name})"] = (Spot(here.owner, here.name, here.index, "", component, rate=True),)
        prefix = "input " if signal.role == "input" else "output " if signal.output else ""
        dims = f"[{', '.join(map(str, shape))}]" if shape else ""
        piece = Piece(
            here, OUTPUT if signal.output else SIGNAL, "Real", dims, _unit(signal.unit, shape), comment=signal.comment, prefix=prefix
        )
        if signal.starts is not None:
            by_name = dict(zip(signal.scalars(), signal.starts, strict=True))
            piece.values["start",] = Value(tuple(self.short(by_name[name]) for name in group), shape)
        if all(name in right for name in group):
            piece.values[()] = Value(tuple(right[name].roots[0] for name in group), shape)
        else:
            for name in group:
                for variable in (name, f"der({name})"):
                    if variable in right:
                        self.body(here.owner).equations.append((self.found.readings[variable][0], right[variable]))
        self.add(piece)

    def equations(self) -> dict[str, Value]:
        """The right sides of the wanted signals' equations, by the variable they are for."""
        found: dict[str, Value] = {}
        for equation in self.graph.equations:
            left = equation.left.data if equation.left.op == "var" else None
            target = left[4:-1] if left and left.startswith("der(") else left
            if target is None or target not in self.signal_of:
                raise UnwritableError((), "an equation that is not solved for a variable has no place in a part")
            if target in self.part.signals:
                assert left is not None
                found[left] = Value(self.prepared((equation.right,), (left,)))
        return found

    def write_checks(self) -> None:
        """Checks and initial equations of which everything is there."""
        for check in self.graph.checks:
            (condition,) = self.prepared((check.condition,))
            if self.all_here((condition,)):
                self.body("").lines.append((check.message, Value((condition,))))
        for equation in self.graph.initial_equations:
            left, right = self.prepared((equation.left, equation.right))
            if self.all_here((left, right)):
                self.body("").starts.append((Value((left,)), Value((right,))))

    def all_here(self, roots: Iterable[Expr]) -> bool:
        return all(leaf.data in self.found.readings for leaf in leaves(roots))

    # --------------------------------------------------------------------------------------------------- expressions

    def prepared(self, roots: tuple[Expr, ...], readers: tuple[int | str, ...] = (), own: Iterable[str] = ()) -> tuple[Expr, ...]:
        """Expressions over junctions, one-ports, signals and the parameters of instances. readers: who reads, as `frozen` knows it;
        own: variables that stay as they are."""
        held = {var(signal): const(value) for reader in readers for signal, value in self.held.get(reader, ())}
        roots = self.bound(substitute(roots, held) if held else roots)
        own = frozenset(own)
        while True:
            aliased = {
                leaf: self.scalar.aliases[leaf.data] for leaf in leaves(roots) if leaf.data not in own and leaf.data in self.scalar.aliases
            }
            if not aliased:
                return roots
            roots = substitute(roots, aliased)

    def bound(self, roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
        """Parameters of elements replaced by what they are bound to: they stay parameters of the new elements."""
        while True:
            found: dict[Expr, Expr] = {}
            for leaf in leaves(roots, "param"):
                parameter = self.parameter_of[leaf.data]
                if parameter.name.rpartition(".")[0] in self.elements:
                    k = parameter.scalars().index(leaf.data)
                    changed = self.part.changed.get(leaf.data)
                    found[leaf] = parameter.values[k] if changed is None else const(changed)
            if not found:
                return roots
            roots = substitute(roots, found)

    def short(self, root: Expr) -> Expr:
        """An expression over parameters, as a number where it is long."""
        (root,) = self.bound((root,))
        if _tree_size(root) <= LONGEST:
            return root
        return const(evaluate(root, self.values, tables=self.graph.tables))

    def all_values(self) -> Iterator[Value]:
        for body in self.found.bodies.values():
            for piece in body.pieces.values():
                yield from piece.values.values()
                if piece.law is not None:
                    yield piece.law[1]
            yield from (value for _, value in body.equations)
            yield from (value for _, value in body.lines)
            yield from (value for pair in body.starts for value in pair)

    def read_all(self) -> None:
        """Inputs for what is not there, and the parameters that are read, with those that they read."""
        roots = [root for value in self.all_values() for root in value.roots]
        letters = {name for value in self.all_values() for name in value.letters}
        for leaf in leaves(roots):
            if leaf.data not in self.found.readings and leaf.data not in letters:
                self.input(leaf.data)
        for v in self.part.outputs:
            roots += self.prepared((var(v),))
        waiting = [leaf.data for leaf in leaves(roots, "param")]
        pieces: dict[str, Piece] = {}
        while waiting:
            parameter = self.parameter_of[waiting.pop()]
            if parameter.name not in pieces:
                pieces[parameter.name] = piece = self.parameter(parameter)
                waiting += [leaf.data for leaf in leaves(piece.values[()].roots, "param")]
        for parameter in self.graph.parameters:
            if parameter.name in pieces:
                self.add(pieces[parameter.name])

    def input(self, variable: str) -> None:
        if any(self.scalar.junctions[j].variable == variable for j in self.part.junctions):
            raise UnwritableError((), f"`{variable}` is read, and nothing is left of its junction")
        name = self.names.fresh("", flat_name(variable), variable)
        self.found.inputs[variable] = name
        self.found.readings[variable] = (Spot("", name),)
        self.add(Piece(Spot("", name), INPUT, "Real", prefix="input "))

    def parameter(self, parameter: Parameter) -> Piece:
        here = split(parameter.name)
        for name in parameter.scalars():
            component = indices(name[len(parameter.name) + 1 : -1])
            self.found.readings[name] = (Spot(here.owner, here.name, (), "", component),)
        changed = self.part.changed
        values = tuple(
            const(changed[name]) if name in changed else self.short(value)
            for name, value in zip(parameter.scalars(), parameter.values, strict=True)
        )
        dims = f"[{', '.join(map(str, parameter.shape))}]" if parameter.shape else ""
        return Piece(
            here,
            PARAMETER,
            "Integer" if parameter.integer else "Real",
            dims,
            _unit(parameter.unit, parameter.shape),
            {(): Value(values, parameter.shape)},
            comment=parameter.comment,
            prefix="constant " if parameter.constant else "parameter ",
        )

    def write_outputs(self) -> None:
        """What other parts read, under names of the whole model."""
        for variable in self.part.outputs:
            value = Value(self.prepared((var(variable),)))
            spots = self.found.readings.get(variable, ())
            wanted = flat_name(variable)
            if spots and spots[0] == Spot("", wanted):
                piece = self.body("").pieces[wanted, ()]
                piece.prefix = "output "
                self.found.outputs[variable] = wanted
                continue
            name = self.names.fresh("", wanted, ("output", variable))
            self.found.outputs[variable] = name
            self.add(Piece(Spot("", name), OUTPUT, "Real", values={(): value}, prefix="output "))

    # ---------------------------------------------------------------------------------------------- what is elsewhere

    def localise(self) -> None:
        """Laws and equations stay in their class: what they read of elsewhere gets there as an input or parameter of it."""
        for path, body in self.found.bodies.items():
            if path:
                for piece in list(body.pieces.values()):
                    if piece.law is not None:
                        piece.law = piece.law[0], self.localised(path, piece.law[1])
                    if piece.prefix == "output " and () in piece.values:
                        piece.values[()] = self.localised(path, piece.values[()])
                body.equations = [(left, self.localised(path, value)) for left, value in body.equations]

    def localised(self, path: str, value: Value) -> Value:
        moved: dict[Expr, Expr] = {}
        for op in ("var", "param"):
            for leaf in leaves(value.roots, op):
                if leaf.data not in value.letters and not any(within(s.owner, path) for s in self.found.readings[leaf.data]):
                    moved[leaf] = self.local(path, leaf)
        return Value(substitute(value.roots, moved), value.shape, value.letters) if moved else value

    def local(self, path: str, leaf: Expr) -> Expr:
        """The name in an instance of what it reads of elsewhere."""
        spot = self.found.readings[leaf.data][0]
        shared = common(path, spot.owner)
        seen = flat_name(without_indices(leaf.data.removeprefix(f"{shared}.") if shared else leaf.data))
        entry = f"_{'_'.join(map(str, spot.component))}" if leaf.op == "param" and spot.component else ""
        name = self.names.fresh(path, f"{seen}{entry}", ("elsewhere", leaf.data))
        given = f"{path}.{name}"
        here = Spot(path, name)
        if given not in self.found.readings:
            self.found.readings[given] = (here,)
            prefix, rank = ("parameter ", PARAMETER) if leaf.op == "param" else ("input ", INPUT)
            self.add(Piece(here, rank, "Real", values={(): Value((leaf,))}, prefix=prefix))
        return param(given) if leaf.op == "param" else var(given)


def _flags(element: Element) -> tuple[str, ...]:
    return ("parasitic = true",) if element.parasitic else ()


def _unit(unit: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    return (f'{"each " if shape else ""}unit = "{unit}"',) if unit else ()


def _tree_size(root: Expr) -> int:
    sizes: dict[Expr, int] = {}
    for node in topological((root,)):
        sizes[node] = 1 + sum(sizes[arg] for arg in node.args)
    return sizes[root]
