"""Equations before and after sorting, all scalar."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from bgdsl.expr import Expr, variables
from bgdsl.ir.graph import BondGraph, Origin, SignalEquation
from bgdsl.ir.values import Values


@dataclass(frozen=True, slots=True)
class Equation:
    """left = right; `assigned` is the unknown that causality gives it (then `left` is that variable and `right` does not read
    it), None where open.

    element: the flat element, junction or signal that states it, for messages.
    """

    left: Expr
    right: Expr
    assigned: str | None
    element: str
    origin: Origin


@dataclass(frozen=True, slots=True)
class State:
    """A state x; its derivative is the unknown `der(x)`. start: over parameters; fixed: the user gave it.

    kind: a storage's p or q, a signal, an energy that the model reads, or the common variable of a junction that dependent storages follow.
    """

    name: str
    start: Expr
    unit: str
    comment: str
    origin: Origin
    kind: Literal["p", "q", "signal", "energy", "common"]
    fixed: bool = True


@dataclass(frozen=True, slots=True)
class EquationSystem:
    """As many equations as unknowns; states, parameters, inputs and time are known.

    values: every variable that is no unknown but an expression of them (aliases, bond efforts and flows, powers, energies), by
    scalar name; made when asked for. dependent: the p or q of each storage in derivative causality, an unknown, with the start
    that the user gave or None. invariants: residuals that the equations keep at zero (differentiated constraints).
    initial: the initial equations, over states and unknowns. guesses: where Newton iterations for an unknown begin. input_rates:
    derivatives of inputs that are read (`der(u)`), inputs themselves.
    """

    graph: BondGraph
    states: tuple[State, ...]
    unknowns: tuple[str, ...]
    equations: tuple[Equation, ...]
    values: Values
    dependent: Mapping[str, Expr | None] = field(default_factory=dict)
    invariants: tuple[Equation, ...] = ()
    initial: tuple[SignalEquation, ...] = ()
    guesses: Mapping[str, Expr] = field(default_factory=dict)
    input_rates: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Block:
    """n equations solved together for n unknowns, k of them torn.

    The first n - k equations are assignments, in order, to the first n - k unknowns, reading the torn ones; the last k
    equations are residuals and the last k unknowns the torn ones (`torn`). A block of one assignment has no tears.
    linear: the residuals are linear in the torn unknowns, coefficients free of the block's unknowns.
    """

    equations: tuple[Equation, ...]
    unknowns: tuple[str, ...]
    torn: tuple[str, ...] = ()
    linear: bool = True


@dataclass(frozen=True, slots=True)
class SortedSystem:
    """Blocks in evaluation order; a block reads only states, parameters, inputs, time and earlier blocks.

    initial: the same for the initial instant, where initial equations make unknowns of some states; else None.
    """

    system: EquationSystem
    blocks: tuple[Block, ...]
    initial: SortedSystem | None = None

    def verify(self) -> None:
        """Assert: each unknown is solved in exactly one block; a block reads only its own unknowns and earlier ones."""
        unknowns = set(self.system.unknowns)
        known: set[str] = set()
        for block in self.blocks:
            assert len(block.equations) == len(block.unknowns)
            assert known.isdisjoint(block.unknowns), block.unknowns
            known |= set(block.unknowns)
            for row in incidence(block.equations, self.system.unknowns):
                assert all(self.system.unknowns[j] in known for j in row), block.unknowns
        assert known == unknowns, unknowns - known


def derivative_name(variable: str) -> str:
    """The name of the unknown that is the time derivative of a variable."""
    return f"der({variable})"


def incidence(equations: Iterable[Equation], unknowns: Sequence[str]) -> list[list[int]]:
    """For each equation the numbers of the unknowns that it reads, the assigned one first."""
    number = {name: j for j, name in enumerate(unknowns)}
    return [[number[name] for name in variables((e.left, e.right)) if name in number] for e in equations]
