"""Equations before and after sorting, all scalar."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from bgdsl.expr import Expr, Table
from bgdsl.ir.graph import BondGraph, Check, Origin, SignalEquation


@dataclass(frozen=True, slots=True)
class Equation:
    """left = right; `assigned` is the unknown that causality gives it (then `left` is that variable), None where open.

    element: the flat element, junction or signal that states it, for messages.
    """

    left: Expr
    right: Expr
    assigned: str | None
    element: str
    origin: Origin


@dataclass(frozen=True, slots=True)
class State:
    """A state x; its derivative is the unknown `der(x)`. start: over parameters."""

    name: str
    start: Expr
    unit: str
    comment: str
    origin: Origin
    kind: Literal["p", "q", "signal", "energy"]


@dataclass(frozen=True, slots=True)
class EquationSystem:
    """As many equations as unknowns; states, parameters, inputs and time are known.

    values: variables that are no unknowns but expressions of them (aliases, bond efforts and flows), by scalar name.
    dependent: variables of storages in derivative causality with the value their start must agree with.
    invariants: residuals that the equations keep at zero (differentiated constraints), for projection.
    """

    graph: BondGraph
    states: tuple[State, ...]
    unknowns: tuple[str, ...]
    equations: tuple[Equation, ...]
    values: Mapping[str, Expr]
    dependent: Mapping[str, Expr] = field(default_factory=dict)
    invariants: tuple[Equation, ...] = ()
    initial: tuple[SignalEquation, ...] = ()


@dataclass(frozen=True, slots=True)
class Block:
    """Equations solved together for as many unknowns. One equation assigned to its unknown is a plain assignment; else
    `torn` are the unknowns guessed, the others following by assignment in the order given, the last equations being residuals."""

    equations: tuple[Equation, ...]
    unknowns: tuple[str, ...]
    torn: tuple[str, ...] = ()
    linear: bool = True


@dataclass(frozen=True, slots=True)
class SortedSystem:
    """Blocks in evaluation order; a block reads only states, parameters, inputs, time and earlier blocks."""

    system: EquationSystem
    blocks: tuple[Block, ...]


__all__ = ["Block", "Check", "Equation", "EquationSystem", "SortedSystem", "State", "Table"]
