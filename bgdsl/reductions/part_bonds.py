"""Parts of bonds put into statements: one for all turns of a loop, and for all instances of a class.

    A[i] -> B   becomes   Bond01 A_B[6](acts = {{1}, {2}, ...});   A[i] -> A_B[i].p1[1];  A_B[i].p2[1] -> B

What is left of each bond, by component, is its `acts` (see the library file bonds/one_way.bg).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bgdsl.ir.graph import Bond, Origin
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.plan import Action
from bgdsl.reductions.source_map import UnwritableError
from bgdsl.reductions.statements import Acts, Index
from bgdsl.reductions.writer import Spot, Writer


@dataclass(slots=True)
class Request:
    """What is to be cut in one link: by its component, the action and the terms at (tail, head)."""

    bond: Bond
    origin: Origin
    spot: Spot
    actions: dict[int, Action]
    terms: dict[int, tuple[int, int]]

    @property
    def all_terms(self) -> tuple[int, ...]:
        return tuple(t for pair in self.terms.values() for t in pair)


BOND_OF = {1: "Bond10", 0: "Bond01"}
"""The part of a bond by the kind of the junction at its tail."""


def write_part(writer: Writer, group: Sequence[Request], scalar: ScalarGraph, comment: Mapping[int, str]) -> None:
    """Put a part of a bond, or an array of them, into one link of a statement, in every instance that is cut there."""
    by_path: dict[str, list[Request]] = {}
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


def _all_gone(writer: Writer, requests: Sequence[Request], turns: Sequence[tuple[int, ...]]) -> bool:
    """Does the link go whole, in all turns, and without leaving a port alone?"""
    whole = all(
        len(r.bond.origins) == 1 and len(r.actions) == writer.widths[r.spot.key] and set(r.actions.values()) == {"both"} for r in requests
    )
    return whole and len(requests) == len(turns) and all(writer.ends(r.spot) == (None, None) for r in requests)


def _without_link(writer: Writer, requests: Sequence[Request], comment: Mapping[int, str]) -> None:
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
    writer: Writer, spot: Spot, turn: tuple[int, ...], request: Request | None, scalar: ScalarGraph, kinds: set[int]
) -> tuple[int, ...]:
    """What is left of one bond, by component; the kind of the junction at its tail is added to the kinds."""
    key = (*spot.key[:-1], turn)
    acts = [2] * writer.widths[key]
    left = {None: 2, "both": 0, "tail": 1, "head": -1}
    for bond, origin in writer.bonds_at[key]:
        for component in range(bond.width):
            position = component if origin.part is None else origin.part[component]
            acts[position] = left[request.actions.get(position) if request else None]
            tail = writer.tails.get((bond.name, component))
            if tail is not None:
                kinds.add(tail)
            elif acts[position] == 2:
                kinds.add(-1)
    return tuple(acts)


def _fell(request: Request | None, scalar: ScalarGraph) -> list[tuple[str, str, int]]:
    fell: list[tuple[str, str, int]] = []
    for position, pair in request.terms.items() if request else ():
        for t in ends_of(pair, request.actions[position]) if request else ():
            what = "effort" if scalar.junctions[scalar.terms[t].junction].kind == 1 else "flow"
            fell.append((what, f"[{position + 1}]", t))
    return fell


def ends_of(pair: tuple[int, int], action: Action) -> tuple[int, ...]:
    return pair if action == "both" else (pair[0],) if action == "tail" else (pair[1],)
