"""What of a part belongs to which instance: junctions, elements and bonds, each where the author has it.

Input        ScalarGraph, Part
Output       Contents    a Body for each instance; where every variable is read; inputs and outputs of the part
Establishes  the bodies together say the balances of the wanted junctions less the dropped terms, with every law, relation and
             signal equation that belongs to them; what they read of others is an `input` of the model
Reports      nothing; UnwritableError where an element cannot be written by itself

Junctions that a bond joins stay apart as the author drew them. A bond from one instance to another stands in the innermost one
that has both; where it starts at an element, the element's instance gets an open junction in the place of the author's port.
"""

from __future__ import annotations

import re

from bgdsl.expr import var
from bgdsl.ir.graph import Element
from bgdsl.ir.scalar import ScalarGraph, Term
from bgdsl.reductions.condition import element_kinds
from bgdsl.reductions.one_ports import OnePorts
from bgdsl.reductions.part import Part, imposed
from bgdsl.reductions.places import (
    ELEMENT,
    JUNCTION,
    Body,
    Contents,
    LocalNames,
    Piece,
    Spot,
    Value,
    common,
    flat_name,
    relative,
    split,
    within,
    without_indices,
)
from bgdsl.reductions.quantities import Quantities
from bgdsl.reductions.survey import Vertex, survey
from bgdsl.reductions.wording import Wording

_SHOWN = {"TF": ("MTF", "m", "T"), "MTF": ("MTF", "m", "T"), "GY": ("MGY", "r", "G"), "MGY": ("MGY", "r", "G"), "EJS": ("MGY", "r", "G")}
"""How two-ports are written: their class, and the parameter of a scalar one and of a matrix."""


def gather(scalar: ScalarGraph, part: Part) -> Contents:
    """What stands where."""
    work = _Bonds(scalar, part)
    for tail, head in work.left.joined:
        work.link(tail, head)
    work.write_terms()
    work.write_junctions()
    Quantities(scalar, part, work.found, work.names, work.wording).write()
    return work.found


class _Bonds:
    """Writes junctions, elements and bonds."""

    def __init__(self, scalar: ScalarGraph, part: Part):
        self.scalar, self.part, self.graph = scalar, part, scalar.graph
        self.left, self.wording, self.names = survey(scalar, part), Wording(scalar, part), LocalNames(scalar.graph)
        self.kinds = element_kinds(self.graph)
        self.elements, self.bonds = self.left.elements, self.left.bonds
        bodies = {instance.path: Body() for instance in self.graph.instances if instance.path not in self.elements}
        self.found = Contents(bodies, extents=self.names.extents)
        self.found.shadowed = any("pi" in taken for taken in self.names.taken.values())
        self.places: dict[Vertex, Spot] = {}
        self.opened: set[Vertex] = set()
        self.proxies: dict[tuple[str, Vertex], Spot] = {}
        self.done: set[str] = set()
        self.at_ports: dict[str, Spot] = {}
        """The variables of junctions that a matrix kept whole makes."""
        self.readers: dict[tuple[str, tuple[int, int]], tuple[int, ...]] = {}
        self.one_ports = OnePorts(self.left, self.wording, self.found.elements)
        for term in scalar.terms:
            if term.element in self.left.whole and term.entry is not None:
                self.readers[term.element, term.entry] = (*self.readers.get((term.element, term.entry), ()), term.index)

    # ------------------------------------------------------------------------------------------------------- places

    def component(self, path: str, i: int, size: int | None, port: str = "") -> Spot:
        """The place of a component of something: of the whole vector, or by itself."""
        base = split(path)
        if size is None:
            return base
        if path in self.left.whole or (path in self.elements and self.left.is_tied(self.elements[path])):
            return Spot(base.owner, base.name, base.index, port, (i + 1,), (size,))
        return self.names.piece(base, f"_{i + 1}")

    def place(self, vertex: Vertex) -> Spot:
        """Where a junction is."""
        if vertex not in self.places:
            if isinstance(vertex, int):
                self.places[vertex] = self.made_by_port(vertex)
            else:
                self.places[vertex] = self.component(*vertex, self.left.junctions[vertex[0]].size)
        return self.places[vertex]

    def made_by_port(self, j: int) -> Spot:
        """Where a junction is that an element's port made: with the element."""
        path, tag = self.scalar.junctions[j].name, ""
        if path not in self.elements and path.endswith("]"):
            path, _, spot = path[:-1].rpartition("[")
            tag = f"_{spot}"
        if path not in self.elements:
            path, _, port = path.rpartition(".")
            tag = f"_{port}{tag}"
        return self.names.piece(split(path), tag or "_j")

    def port_place(self, element: Element, port: int, spot: int) -> Spot:
        """Where a bond ends at a one-port or a user's element."""
        if element.kind == "field":
            base, one = split(element.name), element.ports[port]
            return Spot(base.owner, base.name, base.index, one.name, (spot + 1,) if one.size is not None else (), (one.width,))
        return self.component(element.name, spot, element.ports[port].size)

    def entry_place(self, term: Term) -> Spot:
        """Where a scalar two-port is: one entry of a matrix, or the whole of a scalar one."""
        tag = f"_{term.entry[0] + 1}_{term.entry[1] + 1}" if term.entry is not None else ""
        return self.names.piece(split(term.element or ""), tag)

    # ----------------------------------------------------------------------------------------------------- junctions

    def link(self, tail: Vertex, head: Vertex) -> None:
        """A bond between two junctions, where both can be reached."""
        ends = self.place(tail), self.place(head)
        scope = common(ends[0].owner, ends[1].owner)
        self.opened |= {vertex for vertex, end in zip((tail, head), ends, strict=True) if end.owner != scope}
        self.found.body(scope).links.append(ends)

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
        number = None if isinstance(vertex, int) or self.left.junctions[vertex[0]].size is None else vertex[1] + 1
        wanted = port if number is None else f"{port}_{number}"
        here = Spot(owner, self.names.fresh(owner, wanted, ("port", vertex)))
        self.found.add(Piece(here, JUNCTION, f"J{self.kind_of(vertex)}", open=True))
        self.join_proxy(here, vertex, bond)
        return here

    def join_proxy(self, here: Spot, vertex: Vertex, bond: str) -> None:
        """The bond from an open junction in another's stead to that."""
        spot = self.place(vertex)
        scope = common(here.owner, spot.owner)
        if spot.owner != scope:
            self.opened.add(vertex)
        self.found.body(scope).links.append((here, spot) if self.leaves_port(here.owner, bond) else (spot, here))

    def port_of(self, owner: str, bond: str) -> str:
        """The name of the model port through which a bond leaves an instance: what its statement there starts or ends at."""
        origins = self.bonds[bond].origins
        text = next((origin.span.text for origin in origins if origin.path == owner), "") if len(origins) > 1 else ""
        tail, _, head = re.sub(r"\|?[-=]>\|?", ">", text).partition(">")
        end = r"(\w+)\s*(?:\[[^\]]*\])?\s*;?\s*$"
        found = re.search(r"(?:^|,)\s*" + end, head) if self.leaves_port(owner, bond) else re.match(r"(?:\s*\w+\s*:)?\s*" + end, tail)
        return found.group(1) if found else "port"

    def leaves_port(self, owner: str, bond: str) -> bool:
        """Does power count as leaving the instance along the bond?"""
        return within(split(self.bonds[bond].tail.node).owner, owner)

    def kind_of(self, vertex: Vertex) -> int:
        return self.scalar.junctions[vertex if isinstance(vertex, int) else self.left.member_of[vertex]].kind

    def write_junctions(self) -> None:
        for j in sorted(self.part.junctions):
            junction = self.scalar.junctions[j]
            if junction.variable in self.at_ports:
                self.found.readings[junction.variable] = (self.at_ports[junction.variable],)
                continue
            spots = []
            for vertex in self.left.kept.get(j, []):
                here = self.place(vertex)
                spots.append(Spot(here.owner, here.name, here.index, "ef"[junction.kind], here.component, here.shape))
                self.add_junction(here, junction.kind, vertex)
                if not isinstance(vertex, int):
                    self.found.there.add(vertex[0])
                    self.found.variables[self.left.junctions[vertex[0]].variable(vertex[1])] = spots[-1]
            self.found.readings[junction.variable] = tuple(spots)

    def add_junction(self, here: Spot, kind: int, vertex: Vertex) -> None:
        before = self.found.body(here.owner).pieces.get((here.name, here.index))
        opened = vertex in self.opened or (before is not None and before.open)
        whole = not isinstance(vertex, int) and (here.component or self.left.junctions[vertex[0]].size is None)
        comment = self.left.junctions[vertex[0]].comment if whole and not isinstance(vertex, int) else ""
        width = f"[{here.shape[0]}]" if here.component else ""
        self.found.add(Piece(Spot(here.owner, here.name, here.index), JUNCTION, f"J{kind}{width}", comment=comment, open=opened))

    # --------------------------------------------------------------------------------------------------------- terms

    def write_terms(self) -> None:
        for term in self.scalar.terms:
            if term.junction in self.part.junctions:
                element = self.elements[term.element] if term.element is not None else None
                if term.other is None:
                    self.write_one_port(term)
                elif element is not None and element.name in self.left.whole:
                    if element.name not in self.done:
                        self.write_matrix(element)
                else:
                    self.write_link(term, self.scalar.terms[term.other])

    def said(self, term: Term, owner: str) -> None:
        if term.index in self.part.dropped:
            self.found.body(owner).notes.append((len(self.found.body(owner).links), term.index))

    def write_one_port(self, term: Term) -> None:
        element = self.elements[term.element or ""]
        if element.name in self.part.gone:
            self.said(term, split(element.name).owner)
            return
        here = self.port_place(element, term.port, term.spot)
        self.said(term, here.owner)
        if element.kind == "field" or here.component:
            if element.name not in self.done:
                self.done.add(element.name)
                self.found.add(self.one_ports.field(element) if element.kind == "field" else self.one_ports.vector(element))
                if element.name in self.left.whole:
                    self.open_port(element, 0)
        else:
            self.found.add(self.one_ports.scalar(element, term, here))
        for letter in "efpq":
            attribute = f"{here.attribute}.{letter}" if here.attribute else letter
            variable = element.ports[term.port].variable(element.name, letter, term.spot)
            self.found.read(variable, Spot(here.owner, here.name, here.index, attribute, here.component, here.shape))
        self.found.there.add(element.name)
        if term.index not in self.part.dropped:
            junction = self.reach(here.owner, self.left.seat(term), term.bond)
            self.found.body(here.owner).links.append((junction, here) if term.sign < 0 else (here, junction))
            return
        self.observe(term, here)

    def observe(self, term: Term, here: Spot) -> None:
        """A one-port that its junction does not feel: it is driven by what the junction has."""
        junction = self.scalar.junctions[term.junction]
        letter, base = "ef"[junction.kind], Spot(here.owner, here.name, here.index)
        tag = f"_{here.component[0]}" if here.component else ""
        drive = self.names.piece(base, f"{tag}_drive")
        self.found.add(Piece(drive, ELEMENT, f"MS{letter}", values={(letter,): Value((var(junction.variable),))}))
        if term.sign < 0:
            self.found.body(here.owner).links.append((drive, here))
            return
        meeting = self.names.piece(base, f"{tag}_meeting")
        self.found.add(Piece(meeting, JUNCTION, f"J{junction.kind}"))
        self.found.body(here.owner).links += [(here, meeting), (drive, meeting)]

    # --------------------------------------------------------------------------------------------------------- links

    def write_matrix(self, element: Element) -> None:
        """A matrix of which everything is there, as one transformer, gyrator or Euler structure."""
        self.done.add(element.name)
        self.found.there.add(element.name)
        modulus, base = element.modulus, split(element.name)
        assert modulus is not None
        rows, columns = len(modulus), len(modulus[0])
        entries = tuple(
            self.wording.prepared((modulus[r][c],), self.readers.get((element.name, (r, c)), ()))[0]
            for r in range(rows)
            for c in range(columns)
        )
        shown, _, parameter = ("EJS", "", "G") if element.kind == "EJS" else _SHOWN[element.kind]
        type_name = f"EJS[{rows}]" if element.kind == "EJS" else f"{shown}[{rows}, {columns}]"
        self.found.add(Piece(base, ELEMENT, type_name, values={(parameter,): Value(entries, (rows, columns))}, comment=element.comment))
        for k, port in enumerate(element.ports):
            self.join_port(element, k)
            for i, letter in ((i, letter) for i in range(port.width) for letter in "ef"):
                attribute = f"{port.name}.{letter}" if port.name else letter
                spot = Spot(base.owner, base.name, base.index, attribute, (i + 1,), (port.width,))
                self.at_ports[port.variable(element.name, letter, i)] = spot
                self.found.readings[port.variable(element.name, letter, i)] = (spot,)

    def join_port(self, element: Element, k: int) -> None:
        """The bonds at a port of a matrix."""
        base = split(element.name)
        self.open_port(element, k)
        for i in range(element.ports[k].width):
            bond, _, far = self.left.brought[element.name, k, i]
            vertex = self.left.far_vertex(element.name, k, i)
            here = self.matrix_port(element, k, i)
            away = self.bonds[bond].tail.node == element.name
            if vertex is not None:
                junction = self.reach(base.owner, vertex, bond)
                self.found.body(base.owner).links.append((here, junction) if away else (junction, here))
            elif away:
                other = self.elements[far.node]
                c = self.left.brought[element.name, k, i][1]
                there = self.matrix_port(other, far.port, far.components[c])
                scope = common(here.owner, there.owner)
                ends = self.way_out(element, k, here, scope, bond), self.way_out(other, far.port, there, scope, bond)
                self.found.body(scope).links.append(ends)

    def matrix_port(self, element: Element, k: int, i: int) -> Spot:
        base, port = split(element.name), element.ports[k]
        return Spot(base.owner, base.name, base.index, port.name, (i + 1,), (port.width,))

    def way_out(self, element: Element, k: int, here: Spot, scope: str, bond: str) -> Spot:
        """Where a matrix's port can be reached in `scope`: an open junction as the port implies one."""
        if here.owner == scope:
            return here
        kind = 0 if element.kind in ("TF", "MTF") and k == 1 else 1
        name = self.names.fresh(here.owner, self.port_of(here.owner, bond), ("way out", element.name, k))
        self.found.add(Piece(Spot(here.owner, name), JUNCTION, f"J{kind}[{here.shape[0]}]", open=True))
        there = Spot(here.owner, name, (), "", here.component, here.shape)
        away = self.bonds[bond].tail.node == element.name
        self.found.body(here.owner).links.append((here, there) if away else (there, here))
        return there

    def open_port(self, element: Element, k: int) -> None:
        """One open junction for all of a vector's port, if all that it leads to is outside."""
        owner, n = split(element.name).owner, element.ports[k].width
        bonds = [self.left.brought[element.name, k, i][0] for i in range(n)]
        vertices = [self.left.far_vertex(element.name, k, i) for i in range(n)]
        there = [v for v in vertices if v is not None and v in self.left.member_of and not within(self.place(v).owner, owner)]
        if len(set(there)) < n or any((owner, v) in self.proxies for v in there) or len({self.kind_of(v) for v in there}) > 1:
            return
        name = self.names.fresh(owner, self.port_of(owner, bonds[0]), ("port", element.name, k))
        self.found.add(Piece(Spot(owner, name), JUNCTION, f"J{self.kind_of(there[0])}[{n}]", open=True))
        for i, (vertex, bond) in enumerate(zip(there, bonds, strict=True)):
            self.proxies[owner, vertex] = here = Spot(owner, name, (), "", (i + 1,), (n,))
            self.join_proxy(here, vertex, bond)

    def write_link(self, term: Term, far: Term) -> None:
        """A bond or two-port: whole, or as a source at this end. (The other end writes its own.)"""
        dropped = self.part.dropped
        if term.index in dropped:
            owner = split(term.element).owner if term.modulus is not None and term.element else split(term.bond).owner
            self.said(term, common(self.place(self.left.seat(term)).owner, owner))
            return
        inside = far.junction in self.part.junctions
        if inside and far.index not in dropped:
            if term.modulus is not None and self.wording.vanishes(term.modulus):
                self.write_source(term, far)
            elif term.index < far.index:
                self.write_two_way(term, far)
            return
        self.write_source(term, far)

    def write_two_way(self, term: Term, far: Term) -> None:
        if term.modulus is None:
            tail, head = (term, far) if term.sign < 0 else (far, term)
            self.link(self.left.seat(tail), self.left.seat(head))
            return
        kind = self.kinds[term.element or ""]
        first = min((term, far), key=lambda t: (t.port, t.spot)) if kind == "EJS" else min((term, far), key=lambda t: t.port)
        second = far if first is term else term
        assert first.modulus is not None
        self.found.there.add(first.element or "")
        here = self.entry_place(first)
        shown, letter, _ = _SHOWN[kind]
        modulus = Value(self.wording.prepared((first.modulus,), (first.index, second.index)))
        self.found.add(Piece(here, ELEMENT, shown, values={(letter,): modulus}))
        for t in (first, second):
            port = self.elements[t.element or ""].ports[t.port]
            for letter_of in "ef":
                spot = Spot(here.owner, here.name, here.index, f"{port.name}.{letter_of}" if port.name else letter_of)
                self.found.readings.setdefault(port.variable(t.element or "", letter_of, t.spot), (spot,))
        ends = [self.reach(here.owner, self.left.seat(t), t.bond) for t in (first, second)]
        self.found.body(here.owner).links.append((ends[0], here, ends[1]))

    def write_source(self, term: Term, far: Term) -> None:
        """What is left of a link at the end where it still acts: a source that carries the far junction's variable."""
        kind, letter, value = imposed(self.scalar, self.kinds, term, far)
        conjugate = "ef"[1 - self.scalar.junctions[term.junction].kind]
        if letter == conjugate and term.sign < 0:
            value = -value
        vertex = self.left.seat(term)
        here = self.entry_place(term) if term.modulus is not None else self.bond_place(term, vertex)
        if (here.name, here.index) in self.found.body(here.owner).pieces:
            here = self.names.piece(here, "_back")  # both ends of one bond are sources
        self.found.there |= {term.element} if term.modulus is not None and term.element else set()
        given = Value(self.wording.prepared((value,), (term.index, far.index)))
        self.found.add(Piece(here, ELEMENT, kind, values={(letter,): given}))
        self.found.body(here.owner).links.append((here, self.reach(here.owner, vertex, term.bond)))

    def bond_place(self, term: Term, vertex: Vertex) -> Spot:
        """Where the source stands that takes a plain bond's place: with the junction, or where the bonds stand that join it to the
        elements of an array, as an array too. It is named after the port or the bond."""
        owner, tag = self.place(vertex).owner, "" if term.component is None else f"_{term.component + 1}"
        bond = self.bonds[term.bond]
        end = bond.head if term.sign < 0 else bond.tail
        way = split(end.node)
        scope = common(owner, way.owner)
        arrays = re.findall(r"(\w+)\[(\d+)\]", relative(way.owner, scope)[:-1] + (f".{end.node.rpartition('.')[2]}" if way.index else ""))
        name = self.port_of(owner, term.bond)
        if name == "port":
            named = split(term.bond)
            name = named.name if named.owner == owner and not arrays else flat_name(without_indices(relative(way.owner, scope) + way.name))
        if len(arrays) != 1 or name == self.port_of(owner, term.bond):
            return Spot(owner, self.names.fresh(owner, f"{name}{tag}", ("source", term.bond, term.component)))
        name = self.names.fresh(scope, f"{name}{tag}", ("source", owner, vertex, name, tag))
        base = f"{scope}.{arrays[0][0]}" if scope else arrays[0][0]
        self.names.extents[scope, name] = self.names.extents.get(split(base).key, (0,))
        return Spot(scope, name, (int(arrays[0][1]),))
