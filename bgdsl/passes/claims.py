"""Claims: everything that is said about a member, by its declaration and by the modifications around it.

Input        Instance or claims
Output       claims about a part of it, or the value that the outermost one gives
Establishes  the outermost modification wins, none overrides a final one, and each names something that is there
Reports      BG220 unknown target, BG221 final, BG222 size of an array modification, BG223 an element modified twice
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise, product
from typing import Any

from bgdsl.diagnostics import Code, did_you_mean
from bgdsl.passes.elaborate import evaluate, position
from bgdsl.passes.evaluation import INDEX
from bgdsl.passes.modifications import MODIFIED_TWICE, Modification
from bgdsl.passes.names import UNKNOWN_TARGET, Member
from bgdsl.passes.parts import Build, Claim, Context, Fault, Index, Instance
from bgdsl.passes.shapes import Value, shape_of, shown_shape
from bgdsl.source import Span
from bgdsl.syntax import ast

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
    for at, size in index:
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
        value = value[at]
    return value


def attribute(claims: Sequence[Claim], name: str) -> Value | None:
    """The value of an attribute or parameter given by the outermost claim, None where none is."""
    for claim in nested(claims, name):
        if claim[0].value is not None:
            return claimed_value(claim)
    return None


def check_targets(
    build: Build, claims: Sequence[Claim], known: Any, what: Callable[[], str], where: Span, others: Sequence[tuple[Span, str]] = ()
) -> None:
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
                        others=[*([(where, "it is defined here")] if where is not change.span else ()), *others],
                        helps=did_you_mean(name, sorted(known)),
                    )
                )


Spot = tuple[int, ...]
"""The index of an element, from 0."""


def element_claims(claims: Sequence[Claim], shape: tuple[int, ...]) -> Iterator[tuple[Spot, tuple[Claim, ...]]]:
    """What is said about each element of an array of components, row-major: of chosen ones more than of all."""
    chosen = [_of_chosen(claim, shape) if claim[0].parts else {} for claim in claims]
    special = any(chosen)
    for spot in product(*map(range, shape)):
        index: Index = tuple(zip(spot, shape, strict=True))
        said = tuple((entry, author, (*before, *index)) for entry, author, before in claims)
        if special:
            said = tuple(claim for parts, whole in zip(chosen, said, strict=True) for claim in (*parts.get(spot, ()), whole))
            check_final([entry for entry, _, _ in said if entry.says_something], element_name(claims[0][0].name, spot))
        yield spot, said


def _of_chosen(claim: Claim, shape: tuple[int, ...]) -> dict[Spot, list[Claim]]:
    """What a claim says about single elements. The chosen ones are as an array of their own: positions are those among them."""
    entry, author, before = claim
    found: dict[Spot, list[Claim]] = {}
    for subscripts, part in entry.parts:
        for spot, index in chosen_elements(part, subscripts, author, shape):
            found.setdefault(spot, []).append((part, author, () if part.each else (*before, *index)))
    for spot, parts in found.items():
        if len(parts) > 1 or entry.redeclared:
            _check_apart(entry, parts, spot)
    return found


def chosen_elements(
    part: Modification, subscripts: tuple[ast.Expression, ...], author: Context, shape: tuple[int, ...]
) -> Iterator[tuple[Spot, Index]]:
    """The elements that subscripts choose, each with its positions (one for each subscript that is not a single index)."""
    if len(subscripts) != len(shape):
        raise _no_element(part, subscripts[0].span.to(subscripts[-1].span), shape)
    axes: list[list[tuple[int, Index]]] = []
    for subscript, size in zip(subscripts, shape, strict=True):
        try:
            where = position(subscript, size, author)
        except Fault as fault:
            raise _no_element(part, fault.span, shape, fault.message) if fault.code is INDEX else fault from None
        several = [where] if isinstance(where, int) else where
        if len(set(several)) != len(several):
            twice = next(at for i, at in enumerate(several) if at in several[:i]) + 1
            raise Fault(MODIFIED_TWICE, f"element {twice} of `{part.name}` is chosen twice", subscript.span, "the same element again")
        axes.append([(at, () if isinstance(where, int) else ((k, len(several)),)) for k, at in enumerate(several)])
    for turn in product(*axes):
        yield tuple(at for at, _ in turn), tuple(place for _, places in turn for place in places)


def _no_element(part: Modification, where: Span, shape: tuple[int, ...], *notes: str) -> Fault:
    sizes = " x ".join(map(str, shape))
    return Fault(ARRAY_SIZE, f"there is no such element of `{part.name}`", where, f"it is an array of {sizes}", notes=notes)


def chosen_entries(claim: Claim, shape: tuple[int, ...]) -> Iterator[tuple[Spot, Value]]:
    """What a claim says of single entries of an array of numbers: their places and their new values."""
    entry, author, before = claim
    first: dict[Spot, Modification] = {}
    for subscripts, piece in entry.parts:
        if piece.value is None:
            raise Fault(ARRAY_SIZE, f"an entry of `{entry.name}` has a value, and nothing else of its own", piece.span, "no value")
        for spot, index in chosen_elements(piece, subscripts, author, shape):
            if spot in first:
                raise _twice(element_name(entry.name, spot), "modified", piece, first[spot])
            first[spot] = piece
            value = claimed_value((piece, author, () if piece.each else (*before, *index)))
            if shape_of(value):
                raise Fault(ARRAY_SIZE, f"`{element_name(entry.name, spot)}` is a single value", piece.span, shown_shape(shape_of(value)))
            yield spot, value


def _check_apart(entry: Modification, parts: Sequence[Claim], spot: Spot) -> None:
    """No two of the things that one place says about one element say the same thing of it; nor is it redeclared one way as one of
    all and another way as itself."""
    first: dict[tuple[str, ...], Modification] = {("redeclare",): entry} if entry.redeclared else {}
    for part, _, _ in parts:
        for path, change in _settings(part):
            if path in first:
                name = element_name(entry.name, spot)
                what = "redeclared" if path == ("redeclare",) else "modified"
                raise _twice(".".join((name, *path)) if what == "modified" else name, what, change, first[path])
            first[path] = change


def _twice(name: str, what: str, again: Modification, first: Modification) -> Fault:
    message = f"`{name}` is {what} twice in one place"
    return Fault(MODIFIED_TWICE, message, again.span, "again here", others=[(first.span, f"first {what} here")])


def _settings(root: Modification) -> Iterator[tuple[tuple[str, ...], Modification]]:
    """Everything that a modification gives: the names that lead to a value, `redeclare` for a class."""
    stack: list[tuple[tuple[str, ...], Modification]] = [((), root)]
    while stack:
        path, entry = stack.pop()
        if entry.value is not None:
            yield path, entry
        if entry.redeclared is not None:
            yield (*path, "redeclare"), entry
        stack += [((*path, name), inner) for name, inner in entry.nested.items()]


def element_name(name: str, spot: Spot) -> str:
    """`name[2,1]`, for the element at `spot`."""
    return f"{name}[{','.join(str(i + 1) for i in spot)}]"


def refuse_subscripts(claims: Sequence[Claim]) -> None:
    """Claims about the elements of what is no array are mistakes."""
    for entry, _, _ in claims:
        for _, part in entry.parts:
            raise Fault(ARRAY_SIZE, f"`{entry.name}` is no array", part.span, "it takes no subscripts")
