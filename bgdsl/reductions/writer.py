"""The edits of every instance that changes, and how the ends of a link can be written in its text.

Input        SourceMap, ScalarGraph
Output       Writer       the class edits by instance and class text, filled by the modules that write changes
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

from bgdsl.ir.graph import Bond, BondGraph, Element, End, Junction, Origin
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.condition import parameter_values
from bgdsl.reductions.source_map import ClassText, Place, SourceMap, UnwritableError, indexed, written
from bgdsl.reductions.statements import ALL, ClassEdits, Link, LinkEdit, at_values
from bgdsl.syntax import ast

SOURCE_OF = {0: ("MSe", "e"), 1: ("MSf", "f")}
"""The modulated source that imposes the common variable of a junction of that kind, and the variable's letter."""

PortBonds = Mapping[tuple[str, int, int], tuple[Bond, int]]
"""The bond, and its component, at each (element, port, component)."""

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
        self.scalar = scalar
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

    @cached_property
    def tails(self) -> Mapping[tuple[str, int], int]:
        """The kind of the junction at the tail of every component of a bond between junctions of different kinds. A bond at an element
        counts as one to a junction of the other kind."""
        tails: dict[tuple[str, int], int] = {}
        for term in self.scalar.terms:
            kind = self.scalar.junctions[term.junction].kind
            if term.other is None:
                tails[term.bond, term.component or 0] = kind if term.sign < 0 else 1 - kind
            elif not term.is_two_port and term.sign < 0:
                tails[term.bond, term.component or 0] = kind
        return tails

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
