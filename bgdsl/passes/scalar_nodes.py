"""The working data of the opening of vectors: nodes, the terms in the making at them, and the bonds and ports they come from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from bgdsl.expr import ZERO, Expr
from bgdsl.ir.elements import component
from bgdsl.ir.graph import BondGraph, Element, Origin, Port

Kind = Literal[0, 1]
Sign = Literal[1, -1]
Place = tuple[int, int, int]
"""A component of an element's port: (element index, port, component)."""
Link = tuple[int, int, int, bool]
"""A bond to a node of the same kind: (far node, bond, component, whether this node is at its head)."""

NATURAL: dict[str, tuple[Kind, Kind]] = {"TF": (1, 0), "MTF": (1, 0), "GY": (1, 1), "MGY": (1, 1), "EJS": (1, 1)}
"""The junction kinds at port 1 and 2 for which an entry's conjugate is its modulus times the far side's variable."""


@dataclass(slots=True)
class Proto:
    """A term in the making. `pair` is the same for the two ends of one bond or one entry, None at a one-port."""

    node: int
    sign: Sign
    bond: int
    component: int
    place: Place | None
    pair: tuple[int, ...] | None = None
    entry: tuple[int, int] | None = None
    """Row and column, also of a scalar two-port: (0, 0)."""


@dataclass(slots=True)
class Node:
    """A component of a junction, or of an element's port where a junction is implied."""

    kind: Kind
    name: str
    variable: str
    origin: Origin
    member: tuple[str, int] | None
    protos: list[Proto] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)
    via: Link | None = None
    """How the walk over the group reached this node: the link from here to its parent."""
    group: int = -1
    start: int = 0
    stop: int = 0
    """The terms of this node and of all nodes reached through it."""
    carried: Expr = ZERO
    """The conjugate of the bond to the parent."""


@dataclass(slots=True)
class Opening:
    """Everything the steps of the opening share."""

    graph: BondGraph
    index: dict[str, int]
    nodes: list[Node] = field(default_factory=list)
    own: dict[Place, int] = field(default_factory=dict)
    """Nodes made by element ports."""
    seat: dict[Place, int] = field(default_factory=dict)
    """The node at which each element port component has its terms."""
    brought: dict[Place, tuple[int, int]] = field(default_factory=dict)
    """The bond and its component that reaches each element port component."""
    loops: list[tuple[int, int, int]] = field(default_factory=list)
    """The bonds that close loops of like nodes: (node at the head, bond, component)."""

    def element(self, place: Place) -> Element:
        """The element of a place."""
        return self.graph.elements[place[0]]

    def port(self, place: Place) -> Port:
        """The port of a place."""
        return self.graph.elements[place[0]].ports[place[1]]

    def variable(self, place: Place, letter: str) -> str:
        """The flat name of a place's effort (`e`) or flow (`f`)."""
        return self.port(place).variable(self.element(place).name, letter, place[2])

    def port_node(self, place: Place, kind: Kind) -> int:
        """The number of a new node, for the junction implied at a place."""
        element, port = self.element(place), self.port(place)
        name = component(f"{element.name}.{port.name}" if port.name else element.name, None if port.size is None else place[2])
        self.nodes.append(Node(kind, name, self.variable(place, "ef"[kind]), element.origin, None))
        return len(self.nodes) - 1
