"""One-ports removed, in the text, or driven as observers where something of them is read.

An element of an array of which others stay gives nothing from then on: `redeclare R loss[2](R = 0);`.
"""

from __future__ import annotations

from collections.abc import Mapping

from bgdsl.ir.graph import Bond
from bgdsl.reductions.plan import Removal
from bgdsl.reductions.source_map import ClassText, UnwritableError, indexed
from bgdsl.reductions.writer import SOURCE_OF, PortBonds, Writer, origin_key, runs, sides
from bgdsl.syntax import ast


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
