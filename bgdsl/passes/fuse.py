"""Ports fused away: raw bonds followed from junction or element to junction or element, and what was left unjoined.

Input        raw bonds, noted at both their ends
Output       ir.graph.Bond
Establishes  every component of every port and element has one bond on each side
Reports      BG264 no bond, BG266 strokes disagree, BG267 single-bond junction
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from bgdsl.diagnostics import Code, listed
from bgdsl.ir.domains import GENERIC
from bgdsl.ir.elements import component
from bgdsl.ir.graph import Bond, End, Origin
from bgdsl.passes.parts import (
    Build,
    ElementPart,
    Fault,
    Instance,
    JunctionPart,
    PortPart,
    RawBond,
)
from bgdsl.source import Span

UNCONNECTED = Code("BG264", "a port or element has no bond")
STROKES = Code("BG266", "strokes on one bond disagree")
SINGLE = Code("BG267", "a junction with a single bond", "warning")


def _is_pass(part: Any) -> bool:
    """A port of a model is passed through; one of an element is an end."""
    return isinstance(part, PortPart) and not part.owner.cls.is_element


def fuse(build: Build) -> tuple[Bond, ...]:
    """The bonds with every port fused away, in the order in which their tails were written."""
    made: list[Bond] = []
    used: set[str] = set()
    for raw in build.raws:
        if not _is_pass(raw.tail[0]):
            for chain, positions in _follow(raw):
                bond = _fused(build, chain, positions, used)
                if bond is not None:
                    made.append(bond)
    return tuple(made)


Chain = list[RawBond]


def _follow(raw: RawBond) -> Iterator[tuple[Chain, list[list[int]]]]:
    """The chains of raw bonds that start with `raw`, each with the positions it has in every one of them."""
    stack: list[tuple[Chain, list[list[int]]]] = [([raw], [list(range(len(raw.tail[2])))])]
    while stack:
        chain, positions = stack.pop()
        last = chain[-1]
        part, _, components = last.head
        if not _is_pass(part):
            yield chain, positions
            continue
        side = part.outside if part.out else part.inside
        groups: list[tuple[RawBond, list[int], list[int]]] = []
        for k, at in enumerate(positions[-1]):
            following = side.get(components[at])
            if following is None:
                continue  # reported as unconnected
            if groups and groups[-1][0] is following[0]:
                groups[-1][1].append(k)
                groups[-1][2].append(following[1])
            else:
                groups.append((following[0], [k], [following[1]]))
        for after, kept, there in reversed(groups):
            stack.append(([*chain, after], [*([column[k] for k in kept] for column in positions), there]))


def _fused(build: Build, chain: Chain, positions: list[list[int]], used: set[str]) -> Bond | None:
    first, last = chain[0], chain[-1]
    width = len(positions[0])
    size = None if any(raw.size is None for raw in chain) else width
    whole = [raw for raw in chain if len(raw.tail[2]) == width and raw.name not in used]
    name = whole[-1].name if whole else last.name
    count = 1
    base = name
    while name in used:
        count += 1
        name = f"{base}_{count}"
    used.add(name)
    stroke = _stroke(build, chain)
    for raw, column in zip(chain, positions, strict=True):
        for j, at in enumerate(column):
            raw.flat[at] = (name, j if size is not None else None)
    tail, head = first.tail, first.head if len(chain) == 1 else last.head
    return Bond(
        name,
        _flat_end(tail, positions[0]),
        _flat_end(head, positions[-1]),
        size,
        tuple(_part_of(raw, column) for raw, column in zip(chain, positions, strict=True)),
        tuple(raw.name for raw in chain if raw.name != name) if len(chain) > 1 else (),
        stroke,
        declared=tuple((raw.tail[0].domain, raw.tail[0].origin) for raw in chain[1:] if raw.tail[0].domain != GENERIC),
    )


def _part_of(raw: RawBond, column: list[int]) -> Origin:
    """The origin of those components of a statement's link."""
    return raw.origin if len(column) == len(raw.tail[2]) else replace(raw.origin, part=tuple(column))


def _stroke(build: Build, chain: Chain) -> Literal["tail", "head"] | None:
    said = [raw for raw in chain if raw.stroke is not None]
    for other in said[1:]:
        if other.stroke != said[0].stroke:
            build.fault(
                Fault(
                    STROKES,
                    f"the strokes of `{said[0].name}` and `{other.name}` disagree, and they are one bond",
                    other.origin.span,
                    f"stroke at its {other.stroke}",
                    others=[(said[0].origin.span, f"stroke at its {said[0].stroke}")],
                )
            )
    return said[0].stroke if said else None


def _flat_end(end: tuple[Any, int, Sequence[int]], positions: Sequence[int]) -> End:
    part, port, components = end
    chosen = tuple(components[at] for at in positions)
    if isinstance(part, PortPart):
        return End(part.owner.path, part.position, chosen)
    return End(part.name, port, chosen)


# --------------------------------------------------------------------------------------------------------------- checks


def check_connected(build: Build, root: Instance) -> None:
    """Every component of every element and port has its bond."""
    for part, owner in build.parts:
        match part:
            case ElementPart():
                _check_element(build, part)
            case JunctionPart() if not (part.joined or (part.open and build.part and owner is root)):
                _missing(build, f"no bond ends at junction `{part.name}`", part.origin, "nothing joined")
            case PortPart() if not owner.cls.is_element:
                _check_side(build, part, part.inside, "inside", part.origin)
                if owner is root:
                    if not build.part:
                        _root_port(build, part, owner)
                else:
                    _check_side(build, part, part.outside, "outside", owner.declared or part.origin)
            case PortPart():
                _check_side(build, part, part.outside, "outside", owner.declared or part.origin)


def _missing(build: Build, message: str, origin: Origin, label: str, *others: tuple[Span, str], helps: Sequence[str] = ()) -> None:
    build.fault(Fault(UNCONNECTED, message, origin.span, label, others=others, helps=helps), origin.path)


def _components(missing: Sequence[int], size: int | None) -> str:
    if size is None or len(missing) == size:
        return ""
    return f"component{'s' if len(missing) > 1 else ''} {', '.join(str(c + 1) for c in missing)} of "


def _check_element(build: Build, part: ElementPart) -> None:
    for port, size in enumerate(part.sizes):
        missing = [c for c in range(1 if size is None else size) if (port, c) not in part.joined]
        if missing:
            where = f"port p{port + 1} of " if part.kind.ports == 2 else ""
            kind = part.kind.name
            example = f"... -> {part.member.name};" if part.kind.inward else f"{part.member.name} -> ...;"
            if part.kind.ports == 2:
                example = f"... -> {part.member.name} -> ...;"
            _missing(
                build,
                f"{_components(missing, size)}{where}{kind} `{part.name}` has no bond",
                part.origin,
                "not joined",
                helps=(f"write `{example}`",),
            )


def _check_side(build: Build, part: PortPart, side: dict[int, Any], where: str, origin: Origin) -> None:
    missing = [c for c in range(1 if part.size is None else part.size) if c not in side]
    if missing:
        text = f"{_components(missing, part.size)}port `{part.name}` has no bond {where}"
        others = ((part.origin.span, "the port"),) if origin is not part.origin else ()
        _missing(build, text, origin, "not joined", *others)


def _root_port(build: Build, part: PortPart, owner: Instance) -> None:
    _missing(
        build,
        f"`{owner.cls.name}` has port `{part.name}`, which nothing joins: it is a part of a model, not one to be run",
        part.origin,
        "a port of the model itself",
        helps=("write a model that uses it, or choose another with `--model`",),
    )


def warn_single(build: Build, junctions: Iterable[JunctionPart], bonds: Iterable[Bond]) -> None:
    """A junction where a single bond ends forces the bond's other variable to zero."""
    lone = {part.name: part for part in junctions if any(count == 1 for count in part.joined.values())}
    if not lone:
        return
    kinds = {part.name: part.kind for part, _ in build.parts if isinstance(part, JunctionPart)}
    found: dict[str, dict[int, Bond]] = {}
    for bond in bonds:
        for here, there in ((bond.tail, bond.head), (bond.head, bond.tail)):
            part = lone.get(here.node)
            if part is not None and kinds.get(there.node) != part.kind:
                found.setdefault(part.name, {}).update((c, bond) for c in here.components if part.joined[c] == 1)
    for name, single in found.items():
        if single:
            _warn_single(build, lone[name], single)


def _warn_single(build: Build, part: JunctionPart, single: Mapping[int, Bond]) -> None:
    zero = "flow" if part.kind == 0 else "effort"
    whole = part.size is None or len(single) == part.size
    names = [part.name] if whole else [component(part.name, c) for c in sorted(single)]
    which = f"{part.kind}-junction `{names[0]}`: its" if len(names) == 1 else f"each of {listed(names, 6)}: their"
    build.fault(
        Fault(
            SINGLE,
            f"only one bond ends at {which} {zero} is zero",
            part.origin.span,
            "a single bond",
            others=[(next(iter(single.values())).origins[-1].span, "this one")],
            helps=(f"if that is meant, say it with `S{'f' if part.kind == 0 else 'e'} (... = 0)`; else another bond is missing",),
        ),
        part.origin.path,
    )
