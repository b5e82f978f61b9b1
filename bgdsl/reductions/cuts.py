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

from bgdsl.ir.graph import Bond, BondGraph, End, Junction, Origin
from bgdsl.reductions.plan import Action, Cut, Removal
from bgdsl.reductions.source_map import ClassText, Place, SourceMap, UnwritableError, written
from bgdsl.reductions.statements import ClassEdits, Link, LinkEdit
from bgdsl.syntax import ast

SOURCE_OF = {0: ("MSe", "e"), 1: ("MSf", "f")}
"""The modulated source that imposes the common variable of a junction of that kind, and the variable's letter."""

PortBonds = Mapping[tuple[str, int, int], tuple[Bond, int]]
"""The bond, and its component, at each (element, port, component)."""

ZERO_OF = {0: ("Se", "e"), 1: ("Sf", "f")}


@dataclass(frozen=True, slots=True)
class Spot:
    """One link of one statement in the text of one instance."""

    path: str
    unit: ClassText
    place: Place
    turn: tuple[int, ...]
    link: Link

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
        self.turns: dict[tuple[str, int], list[tuple[int, ...]]] = {}
        for bond in self.graph.bonds:
            for origin in bond.origins:
                if origin.loop:
                    turns = self.turns.setdefault((origin.path, origin.span.start), [])
                    if origin.loop not in turns[-1:]:
                        turns.append(origin.loop)

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
        return Spot(origin.path, unit, place, origin.loop, origin.link)

    def edit(self, spot: Spot) -> LinkEdit:
        """The edit of a link, ready to be filled."""
        edits = self.of(spot.path, spot.unit)
        statement = spot.place.statement
        if spot.place.loops:
            edits.turns[id(statement)] = sorted(set(self.turns[spot.path, statement.span.start]))
        return edits.link(spot.place, spot.turn, spot.link)

    def junction(self, end: End) -> Junction | None:
        return self.junctions.get(end.node)


# --------------------------------------------------------------------------------------------------------------- parts


def part(reference: str, node_is_vector: bool, own: Sequence[int] | None, positions: Sequence[int], width: int) -> str:
    """The text of some components of a bond's end: `own` are those (from 0) that the whole end stands for."""
    if not node_is_vector or (own is None and len(positions) == width):
        return reference
    chosen = [own[i] if own is not None else i for i in positions]
    base = reference
    if own is not None:
        base = reference[: reference.rindex("[")]
    first, last = chosen[0] + 1, chosen[-1] + 1
    return f"{base}[{first}]" if len(chosen) == 1 else f"{base}[{first}:{last}]"


def runs(actions: Sequence[Action | None]) -> Iterator[tuple[Action | None, list[int]]]:
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
        return part(self.text, self.vector, self.own, positions, self.width)

    def variable(self, letter: str, positions: Sequence[int]) -> str:
        """The text of a variable of those components."""
        whole = self.of(positions)
        if whole == self.text and self.own is None:
            return f"{whole}.{letter}"
        base, _, subscripts = whole.rpartition("[")
        return f"{base}.{letter}[{subscripts}"


def side(writer: Writer, spot: Spot, reference: ast.Reference, bond: Bond, end: End | None) -> Side:
    """How one end of a link is written. end: the flat end that it names; None where it names a port that was fused away."""
    text = written(reference, spot.env)
    subscripts = reference.parts[-1].subscripts
    if end is not None:
        indexed = end.node.endswith("]")
        own = end.components if len(subscripts) > (1 if indexed else 0) else None
        junction = writer.junction(end)
        vector = junction.size is not None if junction else spot.vector
        return Side(text, own, vector, bond.width, junction.kind if junction else None)
    if spot.vector and subscripts and isinstance(subscripts[-1], ast.Range):
        first = _integer(subscripts[-1].start)
        if first is not None:
            return Side(text, tuple(range(first - 1, first - 1 + bond.width)), True, bond.width, None)
    return Side(text, None, spot.vector, bond.width, None)


def _integer(expression: ast.Expression) -> int | None:
    return int(expression.value) if isinstance(expression, ast.Number) else None


def sides(writer: Writer, spot: Spot, bond: Bond) -> tuple[Side, Side]:
    """The tail and head of a link of `bond`, with the junctions that earlier changes put before matrix ports."""
    edit = writer.edit(spot)
    at_tail = bond.tail if _is(spot, bond.origins[0]) else None
    at_head = bond.head if _is(spot, bond.origins[-1]) else None
    tail, head = side(writer, spot, spot.tail, bond, at_tail), side(writer, spot, spot.head, bond, at_head)
    if edit.tail is not None:
        tail = Side(edit.tail, None, tail.vector, tail.width, edit.tail_kind)
    if edit.head is not None:
        head = Side(edit.head, None, head.vector, head.width, edit.head_kind)
    return tail, head


def _is(spot: Spot, origin: Origin) -> bool:
    return (spot.path, spot.turn, spot.link) == (origin.path, origin.loop, origin.link) and (
        spot.place.statement.span.start <= origin.span.start < spot.place.statement.span.end
    )


# ---------------------------------------------------------------------------------------------------------------- cuts


def write_cut(writer: Writer, cut: Cut, comment: Mapping[int, str]) -> None:
    """Cut the components of a bond that the plan lists. comment: what to say of each term."""
    bond = cut.bond
    actions = [cut.actions.get(c) for c in range(bond.width)]
    if len(bond.origins) == 1:
        _write_at(writer, cut, bond.origins[0], actions, comment)
        return
    first = [action if action != "head" else None for action in actions]
    last = [action if action == "head" else None for action in actions]
    if any(first):
        _write_at(writer, cut, bond.origins[0], first, comment)
    if any(last):
        _write_at(writer, cut, bond.origins[-1], last, comment)


def _write_at(writer: Writer, cut: Cut, origin: Origin, actions: Sequence[Action | None], comment: Mapping[int, str]) -> None:
    bond = cut.bond
    terms = tuple(t for c, pair in cut.terms.items() if actions[c] for t in pair)
    spot = writer.spot(origin, bond, terms)
    tail, head = sides(writer, spot, bond)
    edit, edits = writer.edit(spot), writer.of(spot.path, spot.unit)
    pieces: list[str] = []
    for action, positions in runs(actions):
        at_tail, at_head = tail.of(positions), head.of(positions)
        sign = "=>" if spot.vector and (len(positions) > 1 or not tail.vector) else "->"
        if action is None:
            pieces.append(f"{at_tail} {sign} {at_head}")
            continue
        edit.comments.append(_comment(cut, positions, comment))
        if action == "both" and len(bond.origins) == 1:
            continue
        near = head if action == "head" else tail
        if near.kind is None:
            raise UnwritableError(terms, "the junction of a matrix port cannot be read here")
        dims = f"[{len(positions)}]" if sign == "=>" else ""
        suffix = "" if len(positions) == bond.width else "_" + "_".join(str(p + 1) for p in positions)
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


def _bond_text(spot: Spot) -> str:
    name = spot.place.statement.name
    return f"{name}_cut" if name else f"{written(spot.tail, spot.env)}_{written(spot.head, spot.env)}"


def _comment(cut: Cut, positions: Sequence[int], comment: Mapping[int, str]) -> str:
    told = [comment[t] for p in positions for t in cut.terms[p] if t in comment]
    return "; ".join(dict.fromkeys(told))


# ------------------------------------------------------------------------------------------------------------ removals


def write_removal(writer: Writer, removal: Removal, bonds: PortBonds, comment: Mapping[int, str]) -> None:
    """Remove a one-port, or drive it as an observer."""
    element = removal.element
    path, _, name = element.name.rpartition(".")
    found = writer.texts.member(path, name.partition("[")[0])
    if found is None or "[" in name:
        raise UnwritableError(removal.terms, f"`{element.name}` is one of an array")
    unit, declaration, declarator = found
    touched = {id(bond): bond for k, port in enumerate(element.ports) for i in range(port.width) for bond, _ in [bonds[element.name, k, i]]}
    told = "; ".join(dict.fromkeys(comment[t] for t in removal.terms))
    if removal.gone:
        writer.of(path, unit).remove(declarator)
    elif len(removal.terms) != sum(port.width for port in element.ports):
        raise UnwritableError(removal.terms, f"`{element.name}` is needed, and only a part of it is inactive")
    for bond in touched.values():
        _unbond(writer, removal, bond, told)
    del declaration


def _unbond(writer: Writer, removal: Removal, bond: Bond, told: str) -> None:
    """Take the bond between an element and its junction away; through ports, or for an observer, leave what they need."""
    at_head = bond.head.node == removal.element.name
    spot = writer.spot(bond.origins[-1 if at_head else 0], bond, removal.terms)
    far_end = bond.tail if at_head else bond.head
    junction = writer.junction(far_end)
    if junction is None:
        raise UnwritableError(removal.terms, f"`{removal.element.name}` is bonded to another element")
    direct = len(bond.origins) == 1
    edit, edits = writer.edit(spot), writer.of(spot.path, spot.unit)
    edit.comments.append(told)
    sign = "=>" if spot.vector else "->"
    dims = f"[{bond.width}]" if spot.vector else ""
    far = side(writer, spot, spot.tail if at_head else spot.head, bond, far_end if direct else None)
    everything = list(range(bond.width))
    own = written(spot.head if at_head else spot.tail, spot.env)
    kind, letter = SOURCE_OF[junction.kind]
    edit.pieces = []
    node = ""
    if not direct:
        node = edits.fresh(f"{own}_rest")
        edits.declare(f"J{junction.kind}{dims} {node};")
        edit.pieces.append(f"{far.text} {sign} {node}" if at_head else f"{node} {sign} {far.text}")
    if removal.gone:
        return
    value = far.variable(letter, everything) if direct else f"{node}.{letter}"
    source = edits.fresh(f"{own}_drive")
    edits.declare(f"{kind}{dims} {source}({letter} = {value});")
    if at_head:
        edit.pieces.append(f"{source} {sign} {own}")
    else:
        meeting = edits.fresh(f"{own}_{letter}")
        edits.declare(f"J{junction.kind}{dims} {meeting};")
        edit.pieces += [f"{own} {sign} {meeting}", f"{source} {sign} {meeting}"]
