"""Where the operations of a tape run, and where their values live.

Input        Tape
Output       Layout: functions of bounded length, blocks to solve between them, places in the work array
Establishes  each varying operation is in one function; what another function reads has a place in the work array

LLVM's code generation costs more than linearly in the length of a function, so long code is cut.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bgdsl.backends.tape import LEAVES, PARAMETRIC, LinearSolve, NewtonSolve, Tape

Place = tuple[str, int]
"""An array of the kernel (`w` work, `o` out, `c` constants) and an index into it."""


@dataclass(slots=True)
class Function:
    """Operations to do in order, then values to store that were not computed here."""

    members: Sequence[int]
    stores: Sequence[tuple[int, Place]] = ()


@dataclass(slots=True)
class Block:
    """A block to solve. linear: `right` and `matrix` are places; newton: `right` is its area, `body` gives residuals and Jacobian."""

    operation: int
    right: int
    matrix: Place = ("w", 0)
    body: Sequence[Function] = ()


@dataclass(slots=True)
class Layout:
    """parts run in order. stores: for an operation, where its value goes when computed. factors: constant matrices by the
    place of their factors behind the constants. matrices: the part of the work array to be cleared at first."""

    parts: Sequence[Function | Block]
    stores: Mapping[int, Sequence[Place]]
    work: Mapping[int, int]
    work_size: int
    matrices: tuple[int, int]
    factors: Sequence[tuple[LinearSolve, int]]


def factor_size(n: int) -> int:
    """Numbers that an n x n matrix takes with what `bg_factor` needs beside it: pivots, row and column scales."""
    return n * n + 3 * n


def newton_size(n: int) -> int:
    """Numbers that an iteration for n unknowns works with: unknowns, residuals, guesses, step, trial, scales; the Jacobian."""
    return 6 * n + factor_size(n)


def lay_out(tape: Tape, chunk: int) -> Layout:
    """Cut the tape into functions of about `chunk` operands."""
    return _Planner(tape, chunk).layout()


class _Planner:
    def __init__(self, tape: Tape, chunk: int) -> None:
        self.tape = tape
        self.chunk = chunk
        self.size = 0
        self.work: dict[int, int] = {}
        self.stores: dict[int, list[Place]] = {}
        self.home: dict[int, int] = {}
        self.count = 0
        self.factors: list[tuple[LinearSolve, int]] = []
        self.factors_size = 0
        self.areas: dict[int, int] = {}
        self.inside = set(tape.order)

    def layout(self) -> Layout:
        tape = self.tape
        solves = [k for k in tape.order if tape.ops[k] in ("linear", "newton") and tape.levels[k] != PARAMETRIC]
        matrices = {k: self.allocate(factor_size(tape.data[k].size)) for k in solves if self.is_cleared(tape.data[k])}
        cleared = (0, self.size)
        blocks = {k: self.block(k, matrices) for k in solves}
        parts: list[Function | Block] = []
        pending: list[int] = []
        for k in tape.order:
            if k in blocks:
                block, stores = blocks[k]
                parts += (*self.functions(pending, stores), block)
                pending = []
            elif tape.levels[k] != PARAMETRIC and tape.ops[k] not in LEAVES and tape.ops[k] != "z":
                pending.append(k)
        wanted = [(k, ("o", i)) for i, k in enumerate(tape.roots) if tape.levels[k] != PARAMETRIC]
        parts += self.functions(pending, self.assign(wanted, self.inside))
        self.place_crossings(parts)
        return Layout(parts, self.stores, self.work, self.size, cleared, self.factors)

    def is_cleared(self, block: LinearSolve | NewtonSolve) -> bool:
        return isinstance(block, LinearSolve) and not block.factored

    def allocate(self, size: int) -> int:
        self.size += size
        return self.size - size

    def assign(self, wanted: Sequence[tuple[int, Place]], inside: set[int]) -> list[tuple[int, Place]]:
        """Have values stored where they are computed; returned is what is not computed (`inside`), to be stored at the end."""
        loose = []
        for k, place in wanted:
            if k in inside and self.tape.levels[k] != PARAMETRIC and self.tape.ops[k] not in LEAVES and self.tape.ops[k] != "z":
                self.stores.setdefault(k, []).append(place)
            else:
                loose.append((k, place))
        return loose

    def functions(self, pending: Sequence[int], stores: Sequence[tuple[int, Place]]) -> list[Function]:
        """A stream of operations, cut where a function grows too long."""
        args, ops = self.tape.args, self.tape.ops
        found: list[Function] = []
        current: list[int] = []
        weight = 0
        for k in pending:
            current.append(k)
            weight += len(args[k]) + (4 if ops[k] in ("div", "sqrt", "table") else 0)
            if weight >= self.chunk:
                found.append(Function(current))
                current, weight = [], 0
        if current:
            found.append(Function(current))
        found += (Function((), stores[i : i + self.chunk]) for i in range(0, len(stores), self.chunk))
        for function in found:
            self.count += 1
            for k in function.members:
                self.home[k] = self.count
        return found

    def block(self, k: int, matrices: Mapping[int, int]) -> tuple[Block, list[tuple[int, Place]]]:
        """The memory of a block, and the stores still to be done before it."""
        block = self.tape.data[k]
        return self.newton(k, block) if isinstance(block, NewtonSolve) else self.linear(k, block, matrices)

    def linear(self, k: int, block: LinearSolve, matrices: Mapping[int, int]) -> tuple[Block, list[tuple[int, Place]]]:
        n = block.size
        right = self.allocate(n)
        self.areas[k] = right
        wanted: list[tuple[int, Place]] = [(value, ("w", right + i)) for i, value in enumerate(block.right)]
        if block.factored:
            matrix: Place = ("f", self.factors_size)
            self.factors.append((block, self.factors_size))
            self.factors_size += factor_size(n)
        else:
            matrix = ("w", matrices[k])
            wanted += ((value, ("w", matrices[k] + i * n + j)) for i, j, value in block.entries)
        return Block(k, right, matrix), self.assign(wanted, self.inside)

    def newton(self, k: int, block: NewtonSolve) -> tuple[Block, list[tuple[int, Place]]]:
        n = block.size
        area = self.allocate(newton_size(n))
        self.work |= {unknown: area + i for i, unknown in enumerate(block.unknowns)}
        self.areas[k] = area
        wanted: list[tuple[int, Place]] = [(value, ("w", area + n + i)) for i, value in enumerate(block.residuals)]
        wanted += ((value, ("w", area + 6 * n + i * n + j)) for i, j, value in block.entries)
        body = self.functions(block.body, self.assign(wanted, set(block.body)))
        guesses: list[tuple[int, Place]] = [(value, ("w", area + 2 * n + i)) for i, value in enumerate(block.guesses)]
        return Block(k, area, body=body), self.assign(guesses, self.inside)

    def place_crossings(self, parts: Sequence[Function | Block]) -> None:
        """A place in the work array for what is read in another function than the one that computes it."""
        tape, home = self.tape, self.home
        for k in tape.order:
            if tape.ops[k] == "z" and tape.levels[k] != PARAMETRIC:
                self.work[k] = self.areas[tape.args[k][0]] + tape.data[k]
        functions = [function for part in parts for function in (part.body if isinstance(part, Block) else (part,))]
        for function in functions:
            for k in function.members:
                here = home[k]
                for arg in tape.args[k]:
                    if home.get(arg, here) != here and arg not in self.work:
                        self.work[arg] = self.allocate(1)
            for k, _ in function.stores:
                if k in home and k not in self.work:
                    self.work[k] = self.allocate(1)
