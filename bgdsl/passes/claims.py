"""Claims: everything that is said about a member, by its declaration and by the modifications around it.

Input        Instance or claims
Output       claims about a part of it, or the value that the outermost one gives
Establishes  the outermost modification wins, none overrides a final one, and each names something that is there
Reports      BG220 unknown target, BG221 final, BG222 size of an array modification
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

from bgdsl.diagnostics import Code, did_you_mean
from bgdsl.passes.elaborate import evaluate, evaluate_integer
from bgdsl.passes.modifications import Modification
from bgdsl.passes.names import Member
from bgdsl.passes.parts import UNKNOWN_TARGET, Build, Claim, Fault, Index, Instance, Value, shape_of, shown_shape
from bgdsl.source import Span

FINAL = Code("BG221", "a final thing is modified")
ARRAY_SIZE = Code("BG222", "a modification does not fit the array that it modifies")


def claims_of(instance: Instance, member: Member) -> tuple[Claim, ...]:
    """Everything that is said about a member, the outermost first, its declaration last."""
    name = member.name
    found: list[Claim] = []
    for table, author, index in instance.layers:
        entry = table.get(name)
        if entry is not None:
            found.append((entry, author, () if entry.each else index))
    for entry, scope in member.claims:
        found.append((entry, instance.context(scope), ()))
    if found:
        check_final([*(claim[0] for claim in found), member.entry], name)
    found.append((member.entry, instance.context(member.scope), ()))
    return tuple(found)


def check_final(entries: Sequence[Modification], name: str) -> None:
    """Of modifications of one thing, the outermost first: none modifies what one further in made final."""
    for outer, keeper in pairwise(entries):
        if keeper.final:
            raise Fault(
                FINAL, f"`{name}` is final and cannot be modified", outer.span, "modified here", others=[(keeper.span, "made final here")]
            )


def nested(claims: Sequence[Claim], name: str) -> tuple[Claim, ...]:
    """The claims about a thing's attribute or member."""
    found = []
    for entry, author, index in claims:
        inner = entry.nested.get(name)
        if inner is not None:
            found.append((inner, author, () if inner.each else index))
    if len(found) > 1:
        check_final([claim[0] for claim in found], name)
    return tuple(found)


def claimed_value(claim: Claim) -> Value:
    """The value of a modification, indexed with the positions of the array elements that it is for."""
    entry, author, index = claim
    assert entry.value is not None
    if not index:
        return evaluate(entry.value, author)
    shared = author.build.shared
    key = (id(entry.value), id(author))
    if key not in shared:
        shared[key] = (entry.value, author, evaluate(entry.value, author))
    value = shared[key][2]
    for position, size in index:
        shape = shape_of(value)
        if not shape:
            raise Fault(
                ARRAY_SIZE,
                f"`{entry.name}` of an array of {size} is modified with one value",
                entry.span,
                "not an array",
                helps=(f"write `each {entry.span.text}` to give it to all of them",),
            )
        if shape[0] != size:
            raise Fault(
                ARRAY_SIZE,
                f"`{entry.name}` of an array of {size} is modified with {shown_shape(shape)}",
                entry.span,
                f"{size} values are wanted",
                helps=(f"write `each {entry.span.text}` to give it to all of them",),
            )
        value = value[position]
    return value


def attribute(claims: Sequence[Claim], name: str) -> Value | None:
    """The value of an attribute or parameter given by the outermost claim, None where none is."""
    for claim in nested(claims, name):
        if claim[0].value is not None:
            return claimed_value(claim)
    return None


def check_targets(build: Build, claims: Sequence[Claim], known: Any, what: Callable[[], str], where: Span) -> None:
    """Every modification has to name something that is there. Each table is checked once for each kind of target."""
    for entry, _, _ in claims:
        if not entry.nested or build.checked.get(id(entry)) is known:
            continue
        build.checked[id(entry)] = known
        for name, change in entry.nested.items():
            if name not in known:
                build.fault(
                    Fault(
                        UNKNOWN_TARGET,
                        f"{what()} has no `{name}` to modify",
                        change.span,
                        "not found",
                        others=[(where, "it is defined here")] if where is not change.span else (),
                        helps=did_you_mean(name, sorted(known)),
                    )
                )


def element_claims(claims: Sequence[Claim], index: Index) -> list[Claim]:
    """What is said about one element of an array of components."""
    found: list[Claim] = []
    for entry, author, before in claims:
        for subscripts, part in entry.parts:
            at = tuple(evaluate_integer(subscript, author) - 1 for subscript in subscripts)
            if len(at) != len(index) or any(not 0 <= i < size for i, (_, size) in zip(at, index, strict=True)):
                sizes = " x ".join(str(size) for _, size in index)
                raise Fault(ARRAY_SIZE, f"there is no such element of `{entry.name}`", part.span, f"it is an array of {sizes}")
            if at == tuple(i for i, _ in index):
                found.append((part, author, before))
        found.append((entry, author, (*before, *index)))
    return found


def refuse_subscripts(claims: Sequence[Claim]) -> None:
    """Claims about the elements of what is no array are mistakes."""
    for entry, _, _ in claims:
        for _, part in entry.parts:
            raise Fault(ARRAY_SIZE, f"`{entry.name}` is no array", part.span, "it takes no subscripts")
