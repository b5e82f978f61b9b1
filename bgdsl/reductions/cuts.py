"""Bonds cut and one-ports removed, in the text: a modulated source takes the place of the end that still acts.

The change is written in the statement that names the junction whose term is dropped, so that the source can read its
variable by the name used there:

    A -> B   term at A dropped   becomes   MSe x(e = A.e);    x -> B       (A a 0-junction; MSf, f for a 1-junction)
             term at B dropped             MSe x(e = -B.e);   x -> A       or, where A cannot be named here,
                                           J0 n;  A -> n;  x -> n          with x(e = B.e)
             both                          nothing; where A -> B runs through ports: a source of zero
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from bgdsl.ir.graph import Bond, BondGraph, End, Junction, Origin
from bgdsl.reductions.condition import parameter_values
from bgdsl.reductions.plan import Action, Cut, Removal
from bgdsl.reductions.source_map import ClassText, Place, SourceMap, UnwritableError, written
from bgdsl.reductions.statements import ClassEdits, Link, LinkEdit
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

    def __init__(self, texts: SourceMap):
        self.texts = texts
        self.graph: BondGraph = texts.graph
        self.junctions = {junction.name: junction for junction in self.graph.junctions}
        self.edits: dict[tuple[str, tuple[int, int]], ClassEdits] = {}
        self.numbers = parameter_values(self.graph)
        self.looped: dict[str, list[Origin]] = {}
        self.widths: dict[tuple[object, ...], int] = {}
        for bond in self.graph.bonds:
            for origin in bond.origins:
                key = origin_key(origin)
                width = bond.width if origin.part is None else max(origin.part) + 1
                self.widths[key] = max(width, self.widths.get(key, 0))
                if origin.loop:
                    self.looped.setdefault(origin.path, []).append(origin)

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
        statement = spot.place.statement
        if spot.place.loops and id(statement) not in edits.turns:
            own = statement.span
            found = (o for o in self.looped[spot.path] if o.span.source is own.source and own.start <= o.span.start < own.end)
            edits.turns[id(statement)] = list(dict.fromkeys(origin.loop for origin in found))
        return edits.link(spot.place, spot.turn, spot.link)

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
    """One end of a link as it can be written: the reference, the components it stands for (None: all, in order), vector or
    not, how many, and the kind of the junction it names (None where it names a port or another element)."""

    text: str
    own: tuple[int, ...] | None
    vector: bool
    width: int
    kind: int | None

    def of(self, positions: Sequence[int]) -> str:
        """The text of some of the link's components."""
        if not self.splits or (self.own is None and len(positions) == self.width):
            return self.text
        chosen = [i if self.own is None else self.own[i] for i in positions]
        base = self.text if self.own is None else self.text[: self.text.rindex("[")]
        first, last = chosen[0] + 1, chosen[-1] + 1
        return f"{base}[{first}]" if len(chosen) == 1 else f"{base}[{first}:{last}]"

    @property
    def splits(self) -> bool:
        """Does it stand for components that can be named one by one?"""
        return self.vector

    def variable(self, letter: str, positions: Sequence[int]) -> str:
        """The text of a variable of those components."""
        whole = self.of(positions)
        if whole == self.text and self.own is None:
            return f"{whole}.{letter}"
        base, _, subscripts = whole.rpartition("[")
        return f"{base}.{letter}[{subscripts}"


def side(writer: Writer, spot: Spot, reference: ast.Reference, width: int, kind: int | None, terms: tuple[int, ...]) -> Side:
    """How one end of a link is written. kind: of the junction that it names, None for a port or an element."""
    last = reference.parts[-1]
    text = written(reference, spot.env)
    extra = last.subscripts[_array_dims(writer, spot, reference) :]
    if not extra:
        return Side(text, None, spot.vector, width, kind)
    chosen = _indices(writer, spot, extra[0], width)
    if chosen is None or len(extra) > 1:
        raise UnwritableError(terms, f"the subscript of `{text}` is not a plain number or range")
    return Side(text, chosen, True, width, kind)


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
    edit = writer.edit(spot)
    first, last = spot.key == origin_key(bond.origins[0]), spot.key == origin_key(bond.origins[-1])
    tail_junction = writer.junction(bond.tail) if first else None
    head_junction = writer.junction(bond.head) if last else None
    width = writer.widths[spot.key]
    tail = side(writer, spot, spot.tail, width, tail_junction.kind if tail_junction else None, terms)
    head = side(writer, spot, spot.head, width, head_junction.kind if head_junction else None, terms)
    if edit.tail is not None:
        tail = Side(edit.tail, None, spot.vector, width, edit.tail_kind)
    if edit.head is not None:
        head = Side(edit.head, None, spot.vector, width, edit.head_kind)
    return tail, head


def origin_key(origin: Origin) -> tuple[object, ...]:
    """What tells one link of one turn of one statement in one instance."""
    return origin.path, id(origin.span.source), origin.span.start, origin.span.end, origin.link, origin.loop


# ---------------------------------------------------------------------------------------------------------------- cuts


@dataclass(slots=True)
class _Request:
    """What is to be cut in one link: by its component, the action and the terms at (tail, head)."""

    bond: Bond
    origin: Origin
    actions: dict[int, Action]
    terms: dict[int, tuple[int, int]]


def write_cuts(writer: Writer, cuts: Sequence[Cut], comment: Mapping[int, str]) -> None:
    """Cut the components of bonds that the plan lists. comment: what to say of each term."""
    requests: dict[tuple[object, ...], _Request] = {}
    for cut in cuts:
        for component, action in cut.actions.items():
            origin = cut.bond.origins[-1 if action == "head" else 0]
            request = requests.setdefault(origin_key(origin), _Request(cut.bond, origin, {}, {}))
            position = component if origin.part is None else origin.part[component]
            request.actions[position] = action
            request.terms[position] = cut.terms[component]
    for request in requests.values():
        _write_request(writer, request, comment)


def _write_request(writer: Writer, request: _Request, comment: Mapping[int, str]) -> None:
    bond = request.bond
    terms = tuple(t for pair in request.terms.values() for t in pair)
    spot = writer.spot(request.origin, bond, terms)
    tail, head = sides(writer, spot, bond, terms)
    edit, edits = writer.edit(spot), writer.of(spot.path, spot.unit)
    direct = len(bond.origins) == 1
    pieces: list[str] = []
    for action, positions in runs([request.actions.get(i) for i in range(tail.width)]):
        at_tail, at_head = tail.of(positions), head.of(positions)
        sign = "=>" if spot.vector and (len(positions) > 1 or not tail.splits) else "->"
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


def write_removal(writer: Writer, removal: Removal, bonds: PortBonds, comment: Mapping[int, str]) -> None:
    """Remove a one-port, or drive it as an observer."""
    element = removal.element
    path, _, name = element.name.rpartition(".")
    found = writer.texts.member(path, name.partition("[")[0])
    if found is None or "[" in name:
        raise UnwritableError(removal.terms, f"`{element.name}` is one of an array")
    unit, _, declarator = found
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
        sign = "=>" if spot.vector and (len(positions) > 1 or not own.splits) else "->"
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
