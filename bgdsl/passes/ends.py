"""Where a bond may end: what its reference names, and whether a bond may end there in that direction.

Output       `Place`: the part that a reference leads to; then (part, port, components, size)
Reports      BG260 no end for a bond, BG261 too many subscripts, BG262 wrong direction
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from bgdsl.diagnostics import Code, did_you_mean, listed
from bgdsl.passes.evaluation import position
from bgdsl.passes.parts import (
    Absent,
    ArrayPart,
    Broken,
    Context,
    ElementPart,
    Fault,
    Instance,
    JunctionPart,
    PortPart,
    Reported,
)
from bgdsl.passes.references import unknown_name
from bgdsl.syntax import ast

NO_END = Code("BG260", "a bond cannot end here")
SIZES = Code("BG261", "the ends and the arrow of a bond disagree about its size")
REVERSED = Code("BG262", "a bond points the wrong way")

Role = Literal["tail", "head"]


@dataclass(slots=True)
class Place:
    """Where a reference leads: a part, how many instances it goes into, the subscripts left over, and the words for its name."""

    part: Any
    crossings: int
    rest: tuple[ast.Expression, ...]
    port: str | None
    words: list[str]


def locate(reference: ast.Reference, context: Context) -> Place | None:
    """The part that a reference names; None if it, or what holds it, is left out by a condition."""
    instance = context.instance
    assert instance is not None
    parts = reference.parts
    part: Any = instance.part(parts[0].name)
    if part is None:
        raise unknown_name(parts[0].name, parts[0].span, context)
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
    return Place(part, crossings, rest, port, words)


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


def _no_such_port(part: Instance, step: ast.Part) -> Fault:
    ends = _ends_of(part)
    return Fault(
        NO_END,
        f"{part.shown} has no `{step.name}`",
        step.span,
        "not found",
        notes=(_shown_ends(ends),),
        helps=did_you_mean(step.name, ends),
    )


def _ends_of(part: Instance) -> list[str]:
    return [name for name, member in part.cls.members.items() if member.prefixes & {"port in", "port out", "open"}]


def _shown_ends(ends: Sequence[str]) -> str:
    return f"bonds from outside may end at {listed(ends)}" if ends else "it has no ports"


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


def end_of(place: Place, role: Role, reference: ast.Reference, context: Context) -> tuple[Any, int, Sequence[int], int | None]:
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
