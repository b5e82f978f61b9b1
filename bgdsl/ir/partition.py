"""Partitions: groups of junctions and signals that are coupled one way, and what passes between them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Edge:
    """`reader` needs `variable`, which `source` gives. Nodes are scalar junctions by index, then scalar signals.

    term: the term whose conjugate or modulus reads it, None for a signal's equation. modulating: it is read by a modulus, a
    source's or an element's law, or a signal's equation, not as the far side's common variable.
    """

    source: int
    reader: int
    variable: str
    term: int | None
    modulating: bool


@dataclass(frozen=True, slots=True)
class Dependencies:
    """The directed graph of who needs whom. Nodes 0 ... junctions - 1 are the scalar junctions, then come `signals`."""

    junctions: int
    signals: tuple[str, ...]
    edges: tuple[Edge, ...]
    storing: frozenset[int]

    @property
    def size(self) -> int:
        return self.junctions + len(self.signals)


@dataclass(frozen=True, slots=True)
class Partition:
    """Nodes that belong together: scalar junctions, scalar signals, the states they carry. `drivers`: numbers of the partitions
    it reads; none: it is a driving one."""

    number: int
    junctions: tuple[int, ...]
    signals: tuple[str, ...]
    states: tuple[str, ...]
    drivers: tuple[int, ...]

    @property
    def role(self) -> str:
        return "driven" if self.drivers else "driving"


@dataclass(frozen=True, slots=True)
class Passed:
    """A variable that one partition gives and another reads."""

    variable: str
    source: int
    reader: int


@dataclass(frozen=True, slots=True)
class Partitions:
    """Partitions in an order in which each reads earlier ones only. `of_node`: the partition number (from 0) of every node."""

    partitions: tuple[Partition, ...]
    of_node: tuple[int, ...]
    passed: tuple[Passed, ...]


@dataclass(frozen=True, slots=True)
class Frozen:
    """A signal held at `value` where it modulates `reader` (a term's index, or the left side of a signal's equation).
    change: the largest integral of |change of e f| of a term it touches, relative to the largest activity at its junctions."""

    signal: str
    reader: int | str
    value: float
    change: float
