"""Bonds: from statements to bonds between junctions and elements, with every port fused away.

Input        instances with their parts; bond statements
Output       ir.graph.Bond
Establishes  both ends of a bond have its size; every component of every port and element has one bond on each side; power runs
             through a port the way the port says
Reports      BG260 no end for a bond, BG261 sizes or arrow, BG262 wrong direction, BG263 two bonds on one port, BG264 no bond,
             BG265 bond name twice, BG266 strokes disagree, BG267 single-bond junction
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from bgdsl.diagnostics import Code, did_you_mean
from bgdsl.expr import Expr
from bgdsl.ir.domains import GENERIC
from bgdsl.ir.graph import Bond, End, Origin
from bgdsl.passes.elaborate import position, unknown_name
from bgdsl.passes.parts import (
    Absent,
    ArrayPart,
    Broken,
    Build,
    Context,
    ElementPart,
    Fault,
    Instance,
    JunctionPart,
    PortPart,
    RawBond,
    Reported,
)
from bgdsl.source import Span
from bgdsl.syntax import ast

NO_END = Code("BG260", "a bond cannot end here")
SIZES = Code("BG261", "the ends and the arrow of a bond disagree about its size")
REVERSED = Code("BG262", "a bond points the wrong way")
TWICE = Code("BG263", "two bonds on one port")
UNCONNECTED = Code("BG264", "a port or element has no bond")
BOND_NAME = Code("BG265", "a bond's name is taken")
STROKES = Code("BG266", "strokes on one bond disagree")
SINGLE = Code("BG267", "a junction with a single bond", "warning")

Role = Literal["tail", "head"]


@dataclass(slots=True)
class _Place:
    """Where a reference leads: a part, how many instances it goes into, the subscripts left over, and the words for its name."""

    part: Any
    crossings: int
    rest: tuple[ast.Expression, ...]
    port: str | None
    words: list[str]


def connect(chain: ast.BondChain, context: Context) -> None:
    """The raw bonds of one statement."""
    instance = context.instance
    assert instance is not None
    if instance.cls.is_element:
        raise Fault(
            NO_END, "an element has equations between its ports, no bonds", chain.span, "not in an element", helps=("make it a `model`",)
        )
    count = sum(len(tails) * len(heads) for tails, heads in zip(chain.ends, chain.ends[1:], strict=False))
    if chain.name is not None and count > 1:
        raise Fault(
            BOND_NAME,
            f"`{chain.name}` names {count} bonds",
            chain.span,
            "one name for one bond",
            helps=("write them as separate statements",),
        )
    for i, arrow in enumerate(chain.arrows):
        for tail in chain.ends[i]:
            for k, head in enumerate(chain.ends[i + 1]):
                _connect_one(tail, head, arrow, chain, context, (i, k))


def _connect_one(
    tail: ast.Reference, head: ast.Reference, arrow: ast.Arrow, chain: ast.BondChain, context: Context, link: tuple[int, int]
) -> None:
    instance = context.instance
    assert instance is not None
    start, stop = _locate(tail, context), _locate(head, context)
    if start is None or stop is None:
        return
    ends = (_end(start, "tail", tail, context), _end(stop, "head", head, context))
    size = _common_size(ends[0][3], ends[1][3], tail, head, arrow)
    origin = Origin(
        instance.path, tail.span.to(head.span) if len(chain.arrows) > 1 or len(chain.ends[-1]) > 1 else chain.span, link, _turn(context)
    )
    raw = RawBond(chain.name or "", size, ends[0][:3], ends[1][:3], arrow.stroke, origin)
    _join(raw, raw.tail, "tail", tail)
    _join(raw, raw.head, "head", head)
    context.build.raws.append(raw)
    _name(raw, instance, chain, f"{'_'.join(start.words)}_{'_'.join(stop.words)}")


def _turn(context: Context) -> tuple[int, ...]:
    """The values of the iterators around a statement, outermost first."""
    values = context.locals.values() if context.locals else ()
    return tuple(int(value.data) if isinstance(value, Expr) and value.is_const else 0 for value in values)


def _name(raw: RawBond, instance: Instance, chain: ast.BondChain, made: str) -> None:
    """The statement's own name, or one made from the ends; a number tells apart what has the same ends."""
    name = raw.name or made
    if raw.name and name in instance.cls.members:
        other = instance.cls.members[name].span
        raise Fault(BOND_NAME, f"`{name}` is a component of this model", chain.span, "used for a bond", others=[(other, "declared here")])
    raw.named = bool(raw.name)
    old = instance.bonds.get(name)
    if raw.named and old is not None and not old.named:
        _rename(old, name, instance)
    elif raw.named and old is not None and old.origin.span != raw.origin.span:
        raise Fault(BOND_NAME, f"two bonds are named `{name}`", chain.span, "again here", others=[(old.origin.span, "first here")])
    _rename(raw, name, instance)


def _rename(raw: RawBond, name: str, instance: Instance) -> None:
    """Give the bond this name, or the next one with a number that is free; a name that was written goes before one that was made."""
    taken = instance.bonds.pop(name, None) if instance.bonds.get(name) is raw else None
    unique, count = name, instance.counts.get(name, 1)
    while taken is not None or unique in instance.bonds or (not raw.named and unique in instance.cls.members):
        count += 1
        unique, taken = f"{name}_{count}", None
        instance.counts[name] = count
    instance.bonds[unique] = raw
    raw.name = instance.child(unique)


# ----------------------------------------------------------------------------------------------------------------- ends


def _locate(reference: ast.Reference, context: Context) -> _Place | None:
    """The part that a reference names; None if it, or what holds it, is left out by a condition."""
    instance = context.instance
    assert instance is not None
    parts = reference.parts
    part: Any = instance.part(parts[0].name)
    if part is None:
        raise _no_such_end(parts[0].name, reference, context)
    crossings = 0
    words: list[str] = []
    i = 0
    while True:
        words.append(parts[i].name)
        rest = parts[i].subscripts
        if isinstance(part, ArrayPart):
            part, rest = _item(part, rest, parts[i], words, context)
        if isinstance(part, Absent):
            return None
        if isinstance(part, Broken):
            raise Reported
        if not isinstance(part, Instance):
            break
        if rest:
            raise Fault(NO_END, f"`{parts[i].name}` is no array", parts[i].span, "it takes no subscripts")
        if i + 1 == len(parts):
            raise _whole_instance(part, reference)
        i += 1
        inner = part.part(parts[i].name)
        if inner is None:
            raise _no_such_port(part, parts[i])
        crossings += 1
        part = inner
    port = None
    if i + 1 < len(parts):
        port = _named_port(part, parts, i + 1)
        words.append(port)
        rest = parts[i + 1].subscripts
    return _Place(part, crossings, rest, port, words)


def _item(
    part: ArrayPart, subscripts: tuple[ast.Expression, ...], step: ast.Part, words: list[str], context: Context
) -> tuple[Any, tuple[ast.Expression, ...]]:
    n = len(part.shape)
    if len(subscripts) < n:
        sizes = " x ".join(map(str, part.shape))
        raise Fault(
            NO_END,
            f"`{step.name}` is an array of {sizes}",
            step.span,
            "say which one",
            helps=(f"write `{step.name}[1]`, or a `for` loop over them",),
        )
    spot = 0
    for subscript, size in zip(subscripts, part.shape, strict=False):
        k = position(subscript, size, context)
        if not isinstance(k, int):
            raise Fault(NO_END, f"a bond ends at one of `{step.name}`", subscript.span, "several", helps=("write a `for` loop over them",))
        spot = spot * size + k
        words.append(str(k + 1))
    return part.items[spot], subscripts[n:]


def _no_such_end(name: str, reference: ast.Reference, context: Context) -> Fault:
    fault = unknown_name(name, reference.parts[0].span, context)
    return Fault(fault.code, fault.message, fault.span, fault.label, helps=fault.helps)


def _no_such_port(part: Instance, step: ast.Part) -> Fault:
    ends = _ends_of(part)
    return Fault(
        NO_END,
        f"`{part.cls.name}` has no `{step.name}`",
        step.span,
        "not found",
        notes=(_shown_ends(ends),),
        helps=did_you_mean(step.name, ends),
    )


def _ends_of(part: Instance) -> list[str]:
    return [name for name, member in part.cls.members.items() if member.prefixes & {"port in", "port out", "open"}]


def _shown_ends(ends: Sequence[str]) -> str:
    return f"bonds from outside may end at {', '.join(f'`{name}`' for name in ends)}" if ends else "it has no ports"


def _whole_instance(part: Instance, reference: ast.Reference) -> Fault:
    ends = _ends_of(part)
    return Fault(
        NO_END,
        f"`{reference.text}` is a {part.cls.node.kind}; a bond ends at one of its ports",
        reference.span,
        "which port?",
        notes=(_shown_ends(ends),),
        helps=(f"write `{reference.text}.{ends[0]}`",) if ends else (),
    )


def _named_port(part: Any, parts: Sequence[ast.Part], i: int) -> str:
    name = parts[i].name
    if isinstance(part, ElementPart) and part.kind.ports == 2 and name in ("p1", "p2") and i + 1 == len(parts):
        return name
    owner = parts[i - 1].name
    what = "a two-port has `p1` and `p2`" if isinstance(part, ElementPart) and part.kind.ports == 2 else "it has no parts for bonds"
    raise Fault(NO_END, f"`{owner}` has no port `{name}`", parts[i].span, what)


def _end(place: _Place, role: Role, reference: ast.Reference, context: Context) -> tuple[Any, int, Sequence[int], int | None]:
    """(part, port, components, size) of one end, once it is clear that a bond may end there in this direction."""
    part = place.part
    port = 0
    match part:
        case JunctionPart(size=size):
            if place.crossings and not part.open:
                raise _inside(part, "junction", reference, "open")
        case ElementPart():
            if place.crossings:
                raise _inside(part, part.kind.name, reference, "port")
            port = _element_port(part, place.port, role, reference)
            size = part.sizes[port]
        case PortPart(size=size):
            _check_port(part, place.crossings, role, reference)
        case _:
            raise Fault(
                NO_END,
                f"`{reference.text}` is a value, not an end for a bond",
                reference.span,
                "no junction, element or port",
                helps=("a value is carried without power: read it in an expression, for example of an MSe or MSf",),
            )
    if not place.rest:
        return part, port, range(1 if size is None else size), size
    if size is None or len(place.rest) > 1:
        raise Fault(SIZES, f"`{reference.text}` is {'scalar' if size is None else 'a vector'}", reference.span, "too many subscripts")
    at = position(place.rest[0], size, context)
    place.words += [str(at + 1)] if isinstance(at, int) else [str(k + 1) for k in (at[0], at[-1])] if at else []
    if isinstance(at, int):
        return part, port, (at,), None
    return part, port, tuple(at), len(at)


def _inside(part: JunctionPart | ElementPart, what: str, reference: ast.Reference, cure: str) -> Fault:
    name = reference.parts[-1].name
    helps = {
        "open": (f"declare it `open` there, so that bonds from outside may end at it: `open J{getattr(part, 'kind', 1)} {name};`",),
        "port": (f"give that model a port and bond `{name}` to it inside",),
    }[cure]
    return Fault(
        NO_END,
        f"`{reference.text}` lies inside another model",
        reference.span,
        f"a {what} of another model",
        others=[(part.origin.span, "declared here")],
        helps=helps,
    )


def _element_port(part: ElementPart, named: str | None, role: Role, reference: ast.Reference) -> int:
    kind = part.kind
    if kind.ports == 2:
        port = 0 if role == "head" else 1
        if named is not None and named != f"p{port + 1}":
            flows = "into a two-port at p1" if named == "p1" else "out of a two-port at p2"
            raise Fault(REVERSED, f"power runs {flows}", reference.span, "wrong direction", helps=("turn the arrow around",))
        return port
    if kind.inward and role == "tail":
        raise Fault(
            REVERSED,
            f"power runs into {kind.article} {kind.name}: a bond cannot leave `{part.member.name}`",
            reference.span,
            "the bond leaves it",
            others=[(part.member.span, f"{kind.article} {kind.name}")],
            helps=(f"swap the ends: `... -> {reference.span.text};`",),
        )
    if not kind.inward and role == "head":
        raise Fault(
            REVERSED,
            f"power runs out of an {kind.name}: a bond cannot enter `{part.member.name}`",
            reference.span,
            "the bond enters it",
            others=[(part.member.span, f"an {kind.name}")],
            helps=(f"swap the ends: `{reference.span.text} -> ...;`",),
        )
    return 0


def _check_port(part: PortPart, crossings: int, role: Role, reference: ast.Reference) -> None:
    if crossings > 1:
        raise Fault(
            NO_END,
            f"`{reference.text}` is a port of a model inside another",
            reference.span,
            "too far inside",
            others=[(part.origin.span, "declared here")],
            helps=("give the model around it a port, and join the two inside",),
        )
    wanted: Role = "head" if part.out == (crossings == 0) else "tail"
    if role == wanted:
        return
    where = "Inside, bonds" if crossings == 0 else "From outside, bonds"
    way = "enter" if wanted == "head" else "leave"
    raise Fault(
        REVERSED,
        f"{where.lower()} {way} `port {'out' if part.out else 'in'}` `{reference.parts[-1].name}`",
        reference.span,
        f"this one {'leaves' if role == 'tail' else 'enters'} it",
        others=[(part.origin.span, "declared here")],
        helps=("turn the arrow around, or the port",),
    )


def _common_size(a: int | None, b: int | None, tail: ast.Reference, head: ast.Reference, arrow: ast.Arrow) -> int | None:
    def shown(size: int | None) -> str:
        return "scalar" if size is None else f"a vector of {size}"

    if a != b:
        raise Fault(
            SIZES,
            f"`{tail.span.text}` is {shown(a)}, `{head.span.text}` is {shown(b)}",
            tail.span.to(head.span),
            "the two ends of a bond have one size",
            others=[(tail.span, shown(a)), (head.span, shown(b))],
            helps=("take the components that are meant: `v[1]`, `v[2:3]`",) if a is None or b is None or a != b else (),
        )
    if (a is not None) != arrow.vector:
        right = arrow.text.replace("=>", "->") if a is None else arrow.text.replace("->", "=>")
        raise Fault(
            SIZES,
            f"`{arrow.text}` between {'scalars' if a is None else f'vectors of {a}'}",
            arrow.span,
            "a scalar bond" if not arrow.vector else "a vector bond",
            others=[(tail.span, shown(a)), (head.span, shown(b))],
            helps=(f"write `{right}`",),
        )
    return a


def _join(raw: RawBond, end: tuple[Any, int, Sequence[int]], role: Role, reference: ast.Reference) -> None:
    """Note the bond at its end; a port or element takes one at each component."""
    part, port, components = end
    match part:
        case JunctionPart():
            for c in components:
                part.joined[c] = part.joined.get(c, 0) + 1
        case ElementPart():
            for c in components:
                if (port, c) in part.joined:
                    raise _second(reference, part.joined[port, c], part.kind.name, part.sizes[port], c)
                part.joined[port, c] = raw
        case PortPart():
            side = part.inside if (role == "tail") != part.out else part.outside
            for i, c in enumerate(components):
                if c in side:
                    raise _second(reference, side[c][0], "port", part.size, c)
                side[c] = (raw, i)


def _second(reference: ast.Reference, old: RawBond, what: str, size: int | None, c: int) -> Fault:
    where = f"component {c + 1} of " if size is not None else ""
    helps = ("bond it to a junction, and the others to that junction",)
    return Fault(
        TWICE,
        f"{where}`{reference.text}` has a bond already",
        reference.span,
        f"a second bond on a {what}",
        others=[(old.origin.span, "the first")],
        helps=helps,
    )


# ---------------------------------------------------------------------------------------------------------------- fused


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
            case JunctionPart() if not part.joined:
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
    for bond in bonds:
        for here, there in ((bond.tail, bond.head), (bond.head, bond.tail)):
            part = lone.get(here.node)
            if part is None or kinds.get(there.node) == part.kind or not any(part.joined[c] == 1 for c in here.components):
                continue
            zero = "flow" if part.kind == 0 else "effort"
            build.fault(
                Fault(
                    SINGLE,
                    f"only one bond ends at {part.kind}-junction `{part.name}`: its {zero} is zero",
                    part.origin.span,
                    "a single bond",
                    others=[(bond.origins[-1].span, "this one")],
                    helps=(f"if that is meant, say it with `S{'f' if part.kind == 0 else 'e'} (... = 0)`; else another bond is missing",),
                ),
                part.origin.path,
            )
