"""Bonds cut and one-ports removed, in the text: a modulated source takes the place of the end that still acts.

The change is written in the statement that names the junction whose term is dropped, so that the source can read its
variable by the name used there:

    A -> B   term at A dropped   becomes   MSe x(e = A.e);    x -> B       (A a 0-junction; MSf, f for a 1-junction)
             term at B dropped             MSe x(e = -B.e);   x -> A       or, where A cannot be named here,
                                           J0 n;  A -> n;  x -> n          with x(e = B.e)
             both                          nothing; where A -> B runs through ports: a source of zero

In a loop, in a class whose instances need different cuts, and where neither end is a junction that has a name there, a part of a bond
(of the library file bonds/one_way.bg) is put in, whose `acts` say what is left: the statement is one for all turns and instances.

    A[i] -> B   becomes   Bond01 A_B[6](acts = {{1}, {2}, ...});   A[i] -> A_B[i].p1[1];  A_B[i].p2[1] -> B
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from bgdsl.ir.graph import Bond, BondGraph, Element, End, Junction, Origin
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.condition import parameter_values
from bgdsl.reductions.plan import Action, Cut, Removal
from bgdsl.reductions.source_map import ClassText, Place, SourceMap, UnwritableError, indexed, written
from bgdsl.reductions.statements import ALL, Acts, ClassEdits, Index, Link, LinkEdit, at_values
from bgdsl.syntax import ast

SOURCE_OF = {0: ("MSe", "e"), 1: ("MSf", "f")}
"""The modulated source that imposes the common variable of a junction of that kind, and the variable's letter."""

PortBonds = Mapping[tuple[str, int, int], tuple[Bond, int]]
"""The bond, and its component, at each (element, port, component)."""

ZERO_OF = {0: ("Se", "e"), 1: ("Sf", "f")}


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Spot:
    """One link of one statement in the text of one instance."""

    path: str
    unit: ClassText
    place: Place
    turn: tuple[int, ...]
    link: Link
    key: tuple[object, ...]

    @property
    def env(self) -> dict[str, int]:
        names = [iterator.name for loop in self.place.loops for iterator in loop.iterators]
        return dict(zip(names, self.turn, strict=True))

    @property
    def tail(self) -> ast.Reference:
        return self.place.statement.ends[self.link[0]][0]

    @property
    def head(self) -> ast.Reference:
        return self.place.statement.ends[self.link[0] + 1][self.link[1]]

    @property
    def vector(self) -> bool:
        return self.place.statement.arrows[self.link[0]].vector


class Writer:
    """Collects the class edits of every instance that changes; shared by the modules that write changes."""

    def __init__(self, texts: SourceMap, scalar: ScalarGraph):
        self.texts = texts
        self.kinds = [scalar.junctions[term.junction].kind for term in scalar.terms]
        self.graph: BondGraph = texts.graph
        self.junctions = {junction.name: junction for junction in self.graph.junctions}
        self.edits: dict[tuple[str, tuple[int, int]], ClassEdits] = {}
        self.numbers = parameter_values(self.graph)
        self.looped: dict[str, list[Origin]] = {}
        self.widths: dict[tuple[object, ...], int] = {}
        self.bonds_at: dict[tuple[object, ...], list[tuple[Bond, Origin]]] = {}
        self.elements: dict[tuple[str, str], list[Element]] = {}
        self.told: dict[str, list[tuple[str, str, int]]] = {}
        self.tails: dict[tuple[str, int], int] = {}
        for bond in self.graph.bonds:
            for origin in bond.origins:
                key = origin_key(origin)
                width = bond.width if origin.part is None else max(origin.part) + 1
                self.widths[key] = max(width, self.widths.get(key, 0))
                self.bonds_at.setdefault(key, []).append((bond, origin))
                if origin.loop:
                    self.looped.setdefault(origin.path, []).append(origin)
        for element in self.graph.elements:
            path, _, last = element.name.rpartition(".")
            self.elements.setdefault((path, indexed(last)[0]), []).append(element)

    def tell(self, name: str, fell: Sequence[tuple[str, str, int]]) -> None:
        """What fell in a part of a two-port or bond: effort or flow, the entry, the term."""
        self.told.setdefault(name, []).extend(fell)

    def of(self, path: str, unit: ClassText) -> ClassEdits:
        """The edits of one class text as one instance needs it."""
        key = (path, unit.key)
        if key not in self.edits:
            self.edits[key] = ClassEdits(unit, set(self.names(path)))
        return self.edits[key]

    def names(self, path: str) -> Iterator[str]:
        for unit in self.texts.units(self.texts.class_of(path)):
            for item in unit.model.items:
                match item:
                    case ast.Declaration():
                        yield from (declarator.name for declarator in item.declarators)
                    case ast.Model() | ast.Experiment() | ast.ShortFunction() | ast.LongFunction() | ast.TypeDefinition():
                        yield item.name
            for section in unit.model.sections:
                yield from (s.name for s in section.statements if isinstance(s, ast.BondChain) and s.name)

    def spot(self, origin: Origin, bond: Bond, terms: tuple[int, ...]) -> Spot:
        """Where a bond's origin stands in the text."""
        unit = self.texts.unit_at(origin)
        place = self.texts.place(unit, origin.span) if unit else None
        if unit is None or place is None or origin.link is None:
            raise UnwritableError(terms, f"the statement of bond `{bond.name}` was not found")
        return Spot(origin.path, unit, place, origin.loop, origin.link, origin_key(origin))

    def edit(self, spot: Spot) -> LinkEdit:
        """The edit of a link, ready to be filled."""
        edits = self.of(spot.path, spot.unit)
        if spot.place.loops and id(spot.place.statement) not in edits.turns:
            edits.turns[id(spot.place.statement)] = self.turns(spot)
        return edits.link(spot.place, spot.turn, spot.link)

    def edit_of_all(self, spot: Spot) -> LinkEdit:
        """The edit of a link in all turns of its loop."""
        return self.of(spot.path, spot.unit).link(spot.place, ALL if spot.place.loops else (), spot.link)

    def turns(self, spot: Spot) -> list[tuple[int, ...]]:
        """The turns of the loops around a statement, in one instance."""
        own = spot.place.statement.span
        found = (o for o in self.looped.get(spot.path, ()) if o.span.source is own.source and own.start <= o.span.start < own.end)
        return list(dict.fromkeys(origin.loop for origin in found))

    def ends(self, spot: Spot) -> tuple[str | None, str | None]:
        """The texts that ports of parts have put in the place of the ends of a link, with the values of the iterators."""
        of_all = self.of(spot.path, spot.unit).found(spot.place, ALL if spot.place.loops else (), spot.link)
        if of_all is None:
            return None, None
        tail, head = (None if text is None else at_values(text, spot.env) for text in (of_all.tail, of_all.head))
        return tail, head

    def remove_junction(self, name: str) -> None:
        """Remove the declaration of a junction without bonds; one of an array stays."""
        path, _, local = name.rpartition(".")
        found = self.texts.member(path, local)
        if found is not None:
            self.of(path, found[0]).remove(found[2])

    def junction(self, end: End) -> Junction | None:
        return self.junctions.get(end.node)


# --------------------------------------------------------------------------------------------------------------- parts


def runs(actions: Sequence[T]) -> Iterator[tuple[T, list[int]]]:
    """Neighbouring components with the same action."""
    start = 0
    for i in range(1, len(actions) + 1):
        if i == len(actions) or actions[i] != actions[start]:
            yield actions[start], list(range(start, i))
            start = i


@dataclass(frozen=True, slots=True)
class Side:
    """One end of a link as it can be written: the reference without what chooses components (subscripts of an array of components
    apart), the components it stands for (None: all, in order), vector or not, how many, and the kind of the junction it names (None
    where it names a port or another element)."""

    name: str
    element: str
    own: tuple[int, ...] | None
    vector: bool
    width: int
    kind: int | None

    def of(self, positions: Sequence[int]) -> str:
        """The text of some of the link's components."""
        return f"{self.name}{_bracketed(self.element, self._components(positions))}"

    def _components(self, positions: Sequence[int]) -> str:
        if not self.vector or (self.own is None and len(positions) == self.width > 1):
            return ""
        chosen = [i if self.own is None else self.own[i] for i in positions]
        first, last = chosen[0] + 1, chosen[-1] + 1
        return f"{first}" if len(chosen) == 1 else f"{first}:{last}"

    @property
    def text(self) -> str:
        """All of it."""
        return self.of(range(self.width))

    def variable(self, letter: str, positions: Sequence[int]) -> str:
        """The text of a variable of those components."""
        return f"{self.name}{_bracketed(self.element)}.{letter}{_bracketed(self._components(positions))}"


def _bracketed(*subscripts: str) -> str:
    shown = ", ".join(filter(None, subscripts))
    return f"[{shown}]" if shown else ""


def side(writer: Writer, spot: Spot, reference: ast.Reference, width: int, kind: int | None, terms: tuple[int, ...]) -> Side:
    """How one end of a link is written. kind: of the junction that it names, None for a port or an element."""
    *before, last = reference.parts
    shown = [part.name + _bracketed(*(written(one, spot.env) for one in part.subscripts)) for part in before]
    name, count = ".".join([*shown, last.name]), _array_dims(writer, spot, reference)
    element = ", ".join(written(one, spot.env) for one in last.subscripts[:count])
    extra = last.subscripts[count:]
    if not extra:
        return Side(name, element, None, spot.vector, width, kind)
    chosen = _indices(writer, spot, extra[0], width)
    if chosen is None or len(extra) > 1:
        raise UnwritableError(terms, f"the subscript of `{written(reference, spot.env)}` is not a plain number or range")
    return Side(name, element, chosen, True, width, kind)


def _array_dims(writer: Writer, spot: Spot, reference: ast.Reference) -> int:
    """How many of the last part's subscripts choose an element of an array of components."""
    path = spot.path
    for part in reference.parts[:-1]:
        indices = [integer(writer, spot, subscript) for subscript in part.subscripts]
        shown = f"[{','.join(map(str, indices))}]" if indices else ""
        path = f"{path}.{part.name}{shown}" if path else f"{part.name}{shown}"
    found = writer.texts.member(path, reference.parts[-1].name) if path in writer.texts.instances else None
    return len(found[2].dims) if found else 0


def _indices(writer: Writer, spot: Spot, subscript: ast.Expression, width: int) -> tuple[int, ...] | None:
    match subscript:
        case ast.Colon():
            return tuple(range(width))
        case ast.Range(step=None):
            first = integer(writer, spot, subscript.start)
            return None if first is None else tuple(range(first - 1, first - 1 + width))
        case _:
            one = integer(writer, spot, subscript)
            return None if one is None else (one - 1,)


def integer(writer: Writer, spot: Spot, expression: ast.Expression) -> int | None:
    """The value of a subscript made of numbers, iterators, integer parameters and their sums, differences and products."""
    match expression:
        case ast.Number() if expression.is_integer:
            return int(expression.value)
        case ast.Reference(parts=(ast.Part(name=name, subscripts=()),)):
            value = spot.env.get(name, writer.numbers.get(f"{spot.path}.{name}" if spot.path else name))
            return None if value is None else int(value)
        case ast.Binary(operator="+" | "-" | "*" as operator):
            left, right = integer(writer, spot, expression.left), integer(writer, spot, expression.right)
            if left is None or right is None:
                return None
            return left + right if operator == "+" else left - right if operator == "-" else left * right
    return None


def sides(writer: Writer, spot: Spot, bond: Bond, terms: tuple[int, ...]) -> tuple[Side, Side]:
    """The tail and head of a link of `bond`, with the junctions that earlier changes put before matrix ports."""
    first, last = spot.key == origin_key(bond.origins[0]), spot.key == origin_key(bond.origins[-1])
    tail_junction = writer.junction(bond.tail) if first else None
    head_junction = writer.junction(bond.head) if last else None
    width = writer.widths[spot.key]
    tail = side(writer, spot, spot.tail, width, tail_junction.kind if tail_junction else None, terms)
    head = side(writer, spot, spot.head, width, head_junction.kind if head_junction else None, terms)
    put_tail, put_head = writer.ends(spot)
    if put_tail is not None:
        tail = replace(tail, name=_without(put_tail, tail), element="", kind=None)
    if put_head is not None:
        head = replace(head, name=_without(put_head, head), element="", kind=None)
    return tail, head


def _without(text: str, side: Side) -> str:
    """The text of a port without the subscripts that choose its components."""
    return text if side.own is None else text[: text.rindex("[")]


def origin_key(origin: Origin) -> tuple[object, ...]:
    """What tells one link of one turn of one statement in one instance."""
    return origin.path, id(origin.span.source), origin.span.start, origin.span.end, origin.link, origin.loop


# ---------------------------------------------------------------------------------------------------------------- cuts


@dataclass(slots=True)
class _Request:
    """What is to be cut in one link: by its component, the action and the terms at (tail, head)."""

    bond: Bond
    origin: Origin
    spot: Spot
    actions: dict[int, Action]
    terms: dict[int, tuple[int, int]]

    @property
    def all_terms(self) -> tuple[int, ...]:
        return tuple(t for pair in self.terms.values() for t in pair)


def write_cuts(writer: Writer, cuts: Sequence[Cut], scalar: ScalarGraph, comment: Mapping[int, str]) -> None:
    """Cut the components of bonds that the plan lists. comment: what to say of each term."""
    requests: dict[tuple[object, ...], _Request] = {}
    for cut in cuts:
        looped = next((origin for origin in cut.bond.origins if origin.loop), None)
        for component, action in cut.actions.items():
            origin = looped or cut.bond.origins[-1 if action == "head" else 0]
            request = requests.get(origin_key(origin))
            if request is None:
                spot = writer.spot(origin, cut.bond, cut.terms[component])
                request = requests[origin_key(origin)] = _Request(cut.bond, origin, spot, {}, {})
            position = component if origin.part is None else origin.part[component]
            request.actions[position] = action
            request.terms[position] = cut.terms[component]
    alike: dict[tuple[object, ...], list[_Request]] = {}
    for request in requests.values():
        spot = request.spot
        alike.setdefault((spot.unit.key, id(spot.place.statement), spot.link), []).append(request)
    for group in alike.values():
        if _in_sources(writer, group):
            for request in group:
                _write_request(writer, request, comment)
        else:
            _write_part(writer, group, scalar, comment)


def _in_sources(writer: Writer, group: Sequence[_Request]) -> bool:
    """Can the cut of one link be written with sources, in one way for all instances?"""
    first = group[0]
    if first.spot.place.loops or any(request.actions != first.actions for request in group):
        return False
    for request in group:
        if None in writer.ends(request.spot) and writer.ends(request.spot) != (None, None):
            return False
        tail, head = sides(writer, request.spot, request.bond, request.all_terms)
        near = [head if action == "head" else tail for action in request.actions.values()]
        if any(one.kind is None for one in near) and set(request.actions.values()) != {"both"}:
            return False
        if set(request.actions.values()) == {"both"} and len(request.bond.origins) > 1 and any(one.kind is None for one in near):
            return False
    return True


BOND_OF = {1: "Bond10", 0: "Bond01"}
"""The part of a bond by the kind of the junction at its tail."""


def _write_part(writer: Writer, group: Sequence[_Request], scalar: ScalarGraph, comment: Mapping[int, str]) -> None:
    """Put a part of a bond, or an array of them, into one link of a statement, in every instance that is cut there."""
    by_path: dict[str, list[_Request]] = {}
    for request in group:
        by_path.setdefault(request.spot.path, []).append(request)
    for path, requests in by_path.items():
        spot, terms = requests[0].spot, tuple(t for request in requests for t in request.all_terms)
        turns = writer.turns(spot) if spot.place.loops else [()]
        if _all_gone(writer, requests, turns):
            _without_link(writer, requests, comment)
            continue
        subscripts, indices, dims = _subscripts(spot, turns, terms)
        edit, edits = writer.edit_of_all(spot), writer.of(path, spot.unit)
        tail, head = edit.tail or spot.tail.span.text, edit.head or spot.head.span.text
        name = edits.fresh(re.sub(r"\[[^]]*\]", "", spot.place.statement.name or f"{spot.tail.span.text}_{spot.head.span.text}"))
        by_turn = {request.spot.turn: request for request in requests}
        kinds: set[int] = set()
        acts: dict[Index, Acts] = {}
        for turn in turns:
            acts[indices[turn]] = _acts(writer, spot, turn, by_turn.get(turn), scalar, kinds)
            own = f"{path}.{name}" if path else name
            writer.tell(own + (f"[{','.join(map(str, indices[turn]))}]" if indices[turn] else ""), _fell(by_turn.get(turn), scalar))
        if len(kinds) != 1:
            raise UnwritableError(terms, f"the bonds of `{spot.place.statement.span.text}` join junctions of different kinds")
        (kind,) = kinds
        edits.insert(name, BOND_OF[kind], dims)
        edits.acts[name, name] = acts
        sign, one = ("=>", "") if spot.vector else ("->", "[1]")
        edit.pieces = [f"{tail} {sign} {name}{subscripts}.p1{one}", f"{name}{subscripts}.p2{one} {sign} {head}"]


def _all_gone(writer: Writer, requests: Sequence[_Request], turns: Sequence[tuple[int, ...]]) -> bool:
    """Does the link go whole, in all turns, and without leaving a port alone?"""
    whole = all(
        len(r.bond.origins) == 1 and len(r.actions) == writer.widths[r.spot.key] and set(r.actions.values()) == {"both"} for r in requests
    )
    return whole and len(requests) == len(turns) and all(writer.ends(r.spot) == (None, None) for r in requests)


def _without_link(writer: Writer, requests: Sequence[_Request], comment: Mapping[int, str]) -> None:
    edit = writer.edit_of_all(requests[0].spot)
    edit.pieces = []
    edit.comments += together([[comment[t] for t in request.all_terms] for request in requests])


def together(told: Sequence[Sequence[str]]) -> list[str]:
    """The comments of several turns as one each, where all have as many; else those of all."""
    if len({len(lines) for lines in told}) != 1:
        return [line for lines in told for line in lines]
    return ["\x00" + ",".join(mark.strip("\x00\x01") for mark in marks) + "\x01" for marks in zip(*told, strict=True)]


def _subscripts(
    spot: Spot, turns: Sequence[tuple[int, ...]], terms: tuple[int, ...]
) -> tuple[str, dict[tuple[int, ...], Index], tuple[int, ...]]:
    """How an array with one element a turn is subscripted: the text, the subscripts of each turn, the dimensions."""
    if turns == [()]:
        return "", {(): ()}, ()
    names = [iterator.name for loop in spot.place.loops for iterator in loop.iterators]
    texts: list[str] = []
    lows: list[int] = []
    dims: list[int] = []
    for k, name in enumerate(names):
        values = sorted({turn[k] for turn in turns})
        if values != list(range(values[0], values[-1] + 1)):
            raise UnwritableError(terms, f"the loop over `{name}` leaves numbers out")
        shift = values[0] - 1
        texts.append(name if not shift else f"{name} {'-' if shift > 0 else '+'} {abs(shift)}")
        lows.append(shift)
        dims.append(len(values))
    if math.prod(dims) != len(turns):
        raise UnwritableError(terms, "the loops around the bond are not independent of each other")
    indices = {turn: tuple(i - low for i, low in zip(turn, lows, strict=True)) for turn in turns}
    return f"[{', '.join(texts)}]", indices, tuple(dims)


def _acts(
    writer: Writer, spot: Spot, turn: tuple[int, ...], request: _Request | None, scalar: ScalarGraph, kinds: set[int]
) -> tuple[int, ...]:
    """What is left of one bond, by component; the kind of the junction at its tail is added to the kinds."""
    key = (*spot.key[:-1], turn)
    acts = [2] * writer.widths[key]
    left = {None: 2, "both": 0, "tail": 1, "head": -1}
    for bond, origin in writer.bonds_at[key]:
        for component in range(bond.width):
            position = component if origin.part is None else origin.part[component]
            acts[position] = left[request.actions.get(position) if request else None]
            tail = scalar_tail(writer, scalar).get((bond.name, component))
            if tail is not None:
                kinds.add(tail)
            elif acts[position] == 2:
                kinds.add(-1)
    return tuple(acts)


def scalar_tail(writer: Writer, scalar: ScalarGraph) -> Mapping[tuple[str, int], int]:
    """The kind of the junction at the tail of every component of a bond between junctions of different kinds."""
    if not writer.tails:
        for term in scalar.terms:
            if term.other is not None and not term.is_two_port and term.sign < 0:
                writer.tails[term.bond, term.component or 0] = scalar.junctions[term.junction].kind
            elif term.other is None:  # at an element: the other kind would do as well
                kind = scalar.junctions[term.junction].kind
                writer.tails[term.bond, term.component or 0] = kind if term.sign < 0 else 1 - kind
    return writer.tails


def _fell(request: _Request | None, scalar: ScalarGraph) -> list[tuple[str, str, int]]:
    fell: list[tuple[str, str, int]] = []
    for position, pair in request.terms.items() if request else ():
        for t in _ends(pair, request.actions[position]) if request else ():
            what = "effort" if scalar.junctions[scalar.terms[t].junction].kind == 1 else "flow"
            fell.append((what, f"[{position + 1}]", t))
    return fell


def _ends(pair: tuple[int, int], action: Action) -> tuple[int, ...]:
    return pair if action == "both" else (pair[0],) if action == "tail" else (pair[1],)


def _write_request(writer: Writer, request: _Request, comment: Mapping[int, str]) -> None:
    bond, spot, terms = request.bond, request.spot, request.all_terms
    tail, head = sides(writer, spot, bond, terms)
    edit, edits = writer.edit(spot), writer.of(spot.path, spot.unit)
    direct = len(bond.origins) == 1
    pieces: list[str] = []
    for action, positions in runs([request.actions.get(i) for i in range(tail.width)]):
        at_tail, at_head = tail.of(positions), head.of(positions)
        sign = "=>" if len(positions) > 1 else "->"
        if action is None:
            pieces.append(f"{at_tail} {sign} {at_head}")
            continue
        told = [comment[t] for i in positions for t in request.terms[i] if _lost(request, i, t)]
        edit.comments += [line for line in dict.fromkeys(told) if line not in edit.comments]
        if action == "both" and direct:
            continue
        near = head if action == "head" else tail
        if near.kind is None:
            raise UnwritableError(terms, "the junction of a matrix port cannot be read here")
        dims = f"[{len(positions)}]" if sign == "=>" else ""
        suffix = "" if len(positions) == tail.width else "_" + "_".join(str(i + 1) for i in positions)
        name = edits.fresh(_bond_text(spot) + suffix)
        kind, letter = SOURCE_OF[near.kind]
        value = near.variable(letter, positions)
        if action == "both":
            kind, letter = ZERO_OF[near.kind]
            value = f"zeros({len(positions)})" if dims else "0"
        if action != "head":
            edits.declare(f"{kind}{dims} {name}({letter} = {value});")
            pieces.append(f"{name} {sign} {at_head}")
        elif tail.kind is not None and not spot.place.statement.name:
            edits.declare(f"{kind}{dims} {name}({letter} = -{value});")
            pieces.append(f"{name} {sign} {at_tail}")
        else:
            node = edits.fresh(f"{name}_{letter}")
            edits.declare(f"J{near.kind}{dims} {node};")
            edits.declare(f"{kind}{dims} {name}({letter} = {value});")
            pieces += [f"{at_tail} {sign} {node}", f"{name} {sign} {node}"]
    edit.pieces = pieces


def _lost(request: _Request, position: int, term: int) -> bool:
    tail, _ = request.terms[position]
    action = request.actions[position]
    return action == "both" or (action == "tail") == (term == tail)


def _bond_text(spot: Spot) -> str:
    name = spot.place.statement.name
    return f"{name}_cut" if name else f"{written(spot.tail, spot.env)}_{written(spot.head, spot.env)}"


# ------------------------------------------------------------------------------------------------------------ removals


def write_removal(writer: Writer, removal: Removal, bonds: PortBonds, comment: Mapping[int, str], whole: bool) -> None:
    """Remove a one-port, or drive it as an observer. whole: of an array, all elements are removed."""
    element = removal.element
    path, _, last = element.name.rpartition(".")
    name, index = indexed(last)
    found = writer.texts.member(path, name)
    if found is None:
        raise UnwritableError(removal.terms, f"`{element.name}` was not found")
    unit, declaration, declarator = found
    if index and removal.gone and not whole:
        _write_nothing(writer, removal, unit, declaration, declarator, comment)
        return
    told = "; ".join(dict.fromkeys(comment[t] for t in removal.terms))
    if removal.gone:
        writer.of(path, unit).remove(declarator)
    driven: dict[tuple[object, ...], tuple[Bond, set[int]]] = {}
    for k, i in removal.spots:
        bond, c = bonds[element.name, k, i]
        at_head = bond.head.node == element.name and bond.head.port == k
        origin = bond.origins[-1 if at_head else 0]
        position = c if origin.part is None else origin.part[c]
        driven.setdefault((k, origin_key(origin)), (bond, set()))[1].add(position)
    for bond, positions in driven.values():
        _unbond(writer, removal, bond, positions, told)


def _unbond(writer: Writer, removal: Removal, bond: Bond, dropped: set[int], told: str) -> None:
    """Take components of the bond between an element and its junction away; through ports, or for an observer, leave what they need."""
    at_head = bond.head.node == removal.element.name
    spot = writer.spot(bond.origins[-1 if at_head else 0], bond, removal.terms)
    junction = writer.junction(bond.tail if at_head else bond.head)
    if junction is None:
        raise UnwritableError(removal.terms, f"`{removal.element.name}` is bonded to another element")
    tail, head = sides(writer, spot, bond, removal.terms)
    far, own = (tail, head) if at_head else (head, tail)
    edit, edits = writer.edit(spot), writer.of(spot.path, spot.unit)
    edit.comments.append(told)
    kind, letter = SOURCE_OF[junction.kind]
    edit.pieces = []
    for lost, positions in runs([i in dropped for i in range(far.width)]):
        sign = "=>" if len(positions) > 1 else "->"
        dims = f"[{len(positions)}]" if sign == "=>" else ""
        here, there = own.of(positions), far.of(positions)
        if not lost:
            edit.pieces.append(f"{tail.of(positions)} {sign} {head.of(positions)}")
            continue
        value = far.variable(letter, positions) if far.kind is not None else ""
        if far.kind is None:  # through a port, which wants its bond
            node = edits.fresh(f"{here}_rest")
            edits.declare(f"J{junction.kind}{dims} {node};")
            edit.pieces.append(f"{there} {sign} {node}" if at_head else f"{node} {sign} {there}")
            value = f"{node}.{letter}"
        if removal.gone:
            continue
        source = edits.fresh(f"{here}_drive")
        edits.declare(f"{kind}{dims} {source}({letter} = {value});")
        if at_head:
            edit.pieces.append(f"{source} {sign} {here}")
        else:
            meeting = edits.fresh(f"{here}_{letter}")
            edits.declare(f"J{junction.kind}{dims} {meeting};")
            edit.pieces += [f"{here} {sign} {meeting}", f"{source} {sign} {meeting}"]


NOTHING = {("R", "R"): 1, ("R", "G"): 0, ("Se", "e"): 1, ("MSe", "e"): 1, ("Sf", "f"): 0, ("MSf", "f"): 0}
"""The parameters by which an element of an array can be told to give nothing, and the kind of junction at which it is that to be zero."""


def _write_nothing(
    writer: Writer,
    removal: Removal,
    unit: ClassText,
    declaration: ast.Declaration,
    declarator: ast.Declarator,
    comment: Mapping[int, str],
) -> None:
    """An element of an array of which others stay gives nothing from now on: `redeclare R loss[2](R = 0);`."""
    element = removal.element
    path, _, last = element.name.rpartition(".")
    names = [a.name.text for a in declarator.arguments if isinstance(a, ast.Modifier)]
    kinds = {writer.kinds[t] for t in removal.terms}
    name = next((n for n in names if kinds == {NOTHING.get((element.kind, n))}), None)
    if name is None or isinstance(writer.texts.site(element.name).node, ast.Redeclaration):
        raise UnwritableError(removal.terms, f"`{element.name}` is one of an array")
    subscripts = last[last.index("[") + 1 : -1].replace(",", ", ")
    zero = f"zeros({element.ports[0].width})" if element.kind not in ("R",) and element.ports[0].size is not None else "0"
    edits = writer.of(path, unit)
    for t in removal.terms:
        edits.declare(f"// {comment[t]}", declaration)
    edits.declare(f"redeclare {declaration.type.span.text} {declarator.name}[{subscripts}]({name} = {zero});", declaration)
