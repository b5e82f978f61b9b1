"""Where the things of a part stand: in the instance that declares them, under a name of its class.

A vector of which only some components are there is opened: `rod.v[3]` is the scalar `v_3` of `rod`. An array of components stays one
while all its elements are alike and there.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

from bgdsl.expr import Expr
from bgdsl.ir.graph import BondGraph

Key = tuple[str, str]
"""(instance, name in its class)."""

COMPONENT_INDEX = re.compile(r"\[(\d+)\](?=[.\[])")
"""The index of an array of components in a path (what comes last is a component or an entry of the variable itself)."""

PARAMETER, INPUT, JUNCTION, ELEMENT, SIGNAL, OUTPUT = range(6)
"""Ranks of declarations in a class."""


@dataclass(frozen=True, slots=True)
class Spot:
    """Something that a bond ends at or an expression reads: `owner.name[index].attribute[component]`.

    index: in an array of components; attribute: a port or a variable; component: of a vector kept whole or of an array of values,
    from 1, which has that shape. rate: the derivative of it.
    """

    owner: str
    name: str
    index: tuple[int, ...] = ()
    attribute: str = ""
    component: tuple[int, ...] = ()
    shape: tuple[int, ...] = ()
    rate: bool = False

    @property
    def key(self) -> Key:
        return self.owner, self.name


@dataclass(frozen=True, eq=False)
class Value:
    """What something is given: scalar expressions over the variables of the whole model, row-major. letters: variables that the
    thing itself has, by the names that they have in its own law."""

    roots: tuple[Expr, ...]
    shape: tuple[int, ...] = ()
    letters: Mapping[str, str] = field(default_factory=dict)
    diagonal: bool = False
    """The entries are those of a diagonal matrix."""


@dataclass(slots=True, eq=False)
class Piece:
    """A declaration, or one element of an array that is declared. rank: its place among the kinds of declarations; values: what it
    is given, by the path of the modification (`("f", "start")`; `()` is a default); law: in its own letters, so never from outside.
    """

    spot: Spot
    rank: int
    type: str
    dims: str = ""
    fixed: tuple[str, ...] = ()
    values: dict[tuple[str, ...], Value] = field(default_factory=dict)
    law: tuple[str, Value] | None = None
    comment: str = ""
    prefix: str = ""
    open: bool = False
    default: bool = True
    """Has the author's class a value for it?"""
    final: bool = False
    """Is it a parameter whose value nobody may change?"""

    @property
    def shape(self) -> tuple[object, ...]:
        """What makes it like another one, whatever it is given."""
        return self.rank, self.prefix, self.type, self.dims, self.fixed, tuple(self.values), self.comment, self.open, self.final


@dataclass(slots=True, eq=False)
class Body:
    """What belongs to one instance. links: bonds, as two ends or as two ends with a two-port between; notes: (position among the
    links, dropped term); equations: (variable, right side)."""

    pieces: dict[tuple[str, tuple[int, ...]], Piece] = field(default_factory=dict)
    links: list[tuple[Spot, ...]] = field(default_factory=list)
    notes: list[tuple[int, int]] = field(default_factory=list)
    equations: list[tuple[Spot, Value]] = field(default_factory=list)
    lines: list[tuple[str, Value]] = field(default_factory=list)
    """Checks: the message and the condition."""
    starts: list[tuple[Value, Value]] = field(default_factory=list)
    """Initial equations."""

    @property
    def empty(self) -> bool:
        return not (self.pieces or self.links or self.notes or self.equations or self.lines or self.starts)


def body_values(body: Body) -> Iterator[Value]:
    """All that is said in a body."""
    for piece in body.pieces.values():
        yield from piece.values.values()
        if piece.law is not None:
            yield piece.law[1]
    yield from (value for _, value in body.equations)
    yield from (value for _, value in body.lines)
    yield from (value for pair in body.starts for value in pair)


@dataclass(slots=True, eq=False)
class Contents:
    """bodies: by instance, in the order of the model. readings: the places at which a variable or a parameter can be read, best
    first. extents: sizes of arrays of components. inputs, outputs: variables of other parts and for them, with the names that they
    have here. elements: names of the classes of users' elements, by their texts with `{}` for the name. variables: where the
    model's own variables are now. there: the junctions and elements of which something is there, by their flat paths.
    """

    bodies: dict[str, Body]
    readings: dict[str, tuple[Spot, ...]] = field(default_factory=dict)
    extents: dict[Key, tuple[int, ...]] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    elements: dict[str, str] = field(default_factory=dict)
    variables: dict[str, Spot] = field(default_factory=dict)
    there: set[str] = field(default_factory=set)
    fixed: dict[str, float] = field(default_factory=dict)
    """The values of constants, by scalar name."""
    shadowed: bool = False
    """Does something of the model's own have the name `pi`?"""

    def body(self, path: str) -> Body:
        """What belongs to an instance."""
        return self.bodies[path]

    def add(self, piece: Piece) -> None:
        """Declare something where its place says."""
        self.bodies[piece.spot.owner].pieces[piece.spot.name, piece.spot.index] = piece

    def read(self, variable: str, spot: Spot) -> None:
        """A variable of the model is at this place."""
        self.variables[variable] = spot
        self.readings[variable] = (spot,)


def split(path: str) -> Spot:
    """The place of a thing by its flat path."""
    owner, _, last = path.rpartition(".")
    name, _, index = last.partition("[")
    return Spot(owner, name, indices(index[:-1]))


def indices(text: str) -> tuple[int, ...]:
    """`"1,2"` as numbers; none for an empty text."""
    return tuple(int(k) for k in text.split(",")) if text else ()


def within(path: str, scope: str) -> bool:
    """Is the instance the scope itself, or inside it?"""
    return not scope or path == scope or path.startswith(f"{scope}.")


def common(one: str, other: str) -> str:
    """The innermost instance that has both."""
    while not within(other, one):
        one = one.rpartition(".")[0]
    return one


def relative(path: str, scope: str) -> str:
    """The prefix by which the names of an instance are reached from `scope`."""
    inside = path[len(scope) :].lstrip(".") if scope else path
    return f"{inside}." if inside else ""


def flat_name(path: str) -> str:
    """A path or variable as one identifier."""
    return re.sub(r"[^A-Za-z0-9]+", "_", path).strip("_")


def without_indices(path: str) -> str:
    """A path without the indices of arrays of components."""
    return re.sub(r"\[[\d,]+\]", "", path)


class LocalNames:
    """The names of each class, given once to each thing: the author's where it is whole, else with what it is of that."""

    def __init__(self, graph: BondGraph):
        self.taken: dict[str, set[str]] = {}
        self.given: dict[tuple[str, object], str] = {}
        self.extents: dict[Key, tuple[int, ...]] = {}
        """The sizes of the arrays of components."""
        for path in _paths(graph):
            spot = split(path)
            self.taken.setdefault(spot.owner, set()).add(spot.name)
            if spot.index:
                before = self.extents.get(spot.key, spot.index)
                self.extents[spot.key] = tuple(map(max, before, spot.index))

    def fresh(self, owner: str, wanted: str, what: object) -> str:
        """A name in the class of `owner` that only `what` has; the same whenever it is asked for."""
        if (owner, what) not in self.given:
            taken = self.taken.setdefault(owner, set())
            name, k = wanted, 2
            while name in taken:
                name, k = f"{wanted}_{k}", k + 1
            taken.add(name)
            self.given[owner, what] = name
        return self.given[owner, what]

    def piece(self, base: Spot, tag: str) -> Spot:
        """The place of a scalar piece of a vector or matrix: its name says which."""
        if not tag:
            return Spot(base.owner, base.name, base.index)
        name = self.fresh(base.owner, f"{base.name}{tag}", (base.name, tag))
        if base.index:
            self.extents[base.owner, name] = self.extents[base.key]
        return Spot(base.owner, name, base.index)


def _paths(graph: BondGraph) -> Iterator[str]:
    for things in (graph.junctions, graph.elements, graph.signals, graph.parameters):
        yield from (thing.name for thing in things)
    yield from (instance.path for instance in graph.instances if instance.path)


@dataclass(frozen=True, slots=True)
class Shown:
    """How places are written: what stays an array of components, the rest gets its index into its name."""

    arrays: Collection[Key]

    def name(self, spot: Spot) -> str:
        """The name in the class, with the index."""
        if not spot.index:
            return spot.name
        if spot.key in self.arrays:
            return f"{spot.name}[{','.join(map(str, spot.index))}]"
        return f"{spot.name}_{'_'.join(map(str, spot.index))}"

    def text(self, spot: Spot, scope: str, *, mark: str = "") -> str:
        """The reference as it is written in the class of `scope`. mark: put before components, to tell them from indices."""
        component = f"[{mark}{','.join(map(str, spot.component))}]" if spot.component else ""
        attribute = f".{spot.attribute}" if spot.attribute else ""
        text = f"{relative(spot.owner, scope)}{self.name(spot)}{attribute}{component}"
        return f"der({text})" if spot.rate else text
