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

from collections.abc import Mapping, Sequence

from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.part_bonds import Request, write_part
from bgdsl.reductions.plan import Cut
from bgdsl.reductions.source_map import UnwritableError, written
from bgdsl.reductions.writer import SOURCE_OF, Spot, Writer, origin_key, runs, sides

ZERO_OF = {0: ("Se", "e"), 1: ("Sf", "f")}


def write_cuts(writer: Writer, cuts: Sequence[Cut], scalar: ScalarGraph, comment: Mapping[int, str]) -> None:
    """Cut the components of bonds that the plan lists. comment: what to say of each term."""
    requests: dict[tuple[object, ...], Request] = {}
    for cut in cuts:
        looped = next((origin for origin in cut.bond.origins if origin.loop), None)
        for component, action in cut.actions.items():
            origin = looped or cut.bond.origins[-1 if action == "head" else 0]
            request = requests.get(origin_key(origin))
            if request is None:
                spot = writer.spot(origin, cut.bond, cut.terms[component])
                request = requests[origin_key(origin)] = Request(cut.bond, origin, spot, {}, {})
            position = component if origin.part is None else origin.part[component]
            request.actions[position] = action
            request.terms[position] = cut.terms[component]
    alike: dict[tuple[object, ...], list[Request]] = {}
    for request in requests.values():
        spot = request.spot
        alike.setdefault((spot.unit.key, id(spot.place.statement), spot.link), []).append(request)
    for group in alike.values():
        if _in_sources(writer, group):
            for request in group:
                _write_request(writer, request, comment)
        else:
            write_part(writer, group, scalar, comment)


def _in_sources(writer: Writer, group: Sequence[Request]) -> bool:
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


def _write_request(writer: Writer, request: Request, comment: Mapping[int, str]) -> None:
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


def _lost(request: Request, position: int, term: int) -> bool:
    tail, _ = request.terms[position]
    action = request.actions[position]
    return action == "both" or (action == "tail") == (term == tail)


def _bond_text(spot: Spot) -> str:
    name = spot.place.statement.name
    return f"{name}_cut" if name else f"{written(spot.tail, spot.env)}_{written(spot.head, spot.env)}"
