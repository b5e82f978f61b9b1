"""Bonds as statements write them: both ends found, sizes compared, names given.

Input        instances with their parts; bond statements
Output       RawBond, noted at both its ends
Establishes  both ends of a bond have its size; a port or element has one bond at each component
Reports      BG261 sizes or arrow, BG263 two bonds on one port, BG265 bond name twice
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bgdsl.diagnostics import Code
from bgdsl.expr import Expr
from bgdsl.ir.graph import Origin
from bgdsl.passes.ends import NO_END, SIZES, Role, end_of, locate
from bgdsl.passes.parts import (
    Context,
    ElementPart,
    Fault,
    Instance,
    JunctionPart,
    PortPart,
    RawBond,
)
from bgdsl.syntax import ast

TWICE = Code("BG263", "two bonds on one port")
BOND_NAME = Code("BG265", "a bond's name is taken")


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
    start, stop = locate(tail, context), locate(head, context)
    if start is None or stop is None:
        return
    ends = (end_of(start, "tail", tail, context), end_of(stop, "head", head, context))
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


def _common_size(a: int | None, b: int | None, tail: ast.Reference, head: ast.Reference, arrow: ast.Arrow) -> int | None:
    def shown(size: int | None) -> str:
        return "scalar" if size is None else f"a vector of {size}"

    if {a, b} == {None, 1}:
        return None  # a scalar meets the only component of a vector: as if that component had been written
    if a != b:
        raise Fault(
            SIZES,
            f"`{tail.span.text}` is {shown(a)}, `{head.span.text}` is {shown(b)}",
            tail.span.to(head.span),
            "the two ends of a bond have one size",
            others=[(tail.span, shown(a)), (head.span, shown(b))],
            helps=("take the components that are meant: `v[1]`, `v[2:3]`",),
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
                    raise _second(reference, part.joined[port, c], f"{part.kind.article} {part.kind.name}", part.sizes[port], c)
                part.joined[port, c] = raw
        case PortPart():
            side = part.inside if (role == "tail") != part.out else part.outside
            for i, c in enumerate(components):
                if c in side:
                    raise _second(reference, side[c][0], "a port", part.size, c)
                side[c] = (raw, i)


def _second(reference: ast.Reference, old: RawBond, what: str, size: int | None, c: int) -> Fault:
    where = f"component {c + 1} of " if size is not None else ""
    helps = ("bond it to a junction, and the others to that junction",)
    return Fault(
        TWICE,
        f"{where}`{reference.text}` has a bond already",
        reference.span,
        f"a second bond on {what}",
        others=[(old.origin.span, "the first")],
        helps=helps,
    )
