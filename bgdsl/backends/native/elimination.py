"""How the Jacobian gets rid of the unknowns of solved blocks, as a plan that a fixed routine (`bg_eliminate`) follows.

Input        Program.jacobian: derivatives F_x, F_z of the right side, G_x, G_z of the blocks' residuals, G_z block lower triangular
Output       Elimination: the pattern of dxdot/dx = F_x - F_z inv(G_z) G_x, and the plan that computes it
Establishes  each block is factored once; only the columns that a block depends on are carried through it

For each block b in turn, S_b = inv(G_bb) (G_bx - sum over earlier blocks c of G_bc S_c) is a dense matrix over the columns
(states) that reach it; then dxdot/dx = F_x - sum over blocks of F_b S_b.

The plan is a list of integers that speaks of one array of numbers: first the entries of the whole matrix in their order,
then dxdot/dx in the order of `pattern`, then the matrices of the blocks.

    0 count (from to)*            copy
    1 by from count (to)*         array[to] -= array[by] array[from], array[from + 1], ...
    2 n a m b step                array[b...] := inv(A) B for the n x n matrix at a and the n x m matrix at b
    3                             done
"""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bgdsl.backends.native.layout import factor_size
from bgdsl.backends.tape import sparse_first
from bgdsl.ir.program import Assign, Program

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Ints = NDArray[np.int32]

COPY, SUBTRACT, SOLVE, DONE = range(4)


@dataclass(slots=True)
class Elimination:
    """pointers, rows: the pattern in compressed columns. The result is at `start` of an array of `size` numbers.

    blocks: how many there are; with none there is nothing to do but to take the entries column by column.
    """

    blocks: int
    pointers: Ints
    rows: Ints
    plan: Ints
    start: int
    size: int


@dataclass(slots=True)
class _Block:
    """A solved block: its step, its first row and column, how many; the states that reach it; the order of its unknowns;
    where its matrices are."""

    step: int
    first: int
    size: int
    columns: list[int]
    ranks: Sequence[int] = ()
    matrix: int = 0
    slope: int = 0

    def row(self, unknown: int) -> int:
        """Where the slopes of an unknown (its column in the whole matrix) begin."""
        return self.slope + self.ranks[unknown - self.first] * len(self.columns)


def eliminate(program: Program) -> Elimination:
    """The plan for a program's Jacobian."""
    return _Planner(program).elimination()


class _Planner:
    def __init__(self, program: Program) -> None:
        self.program = program
        self.n = len(program.states)
        self.entries = program.jacobian.matrix.entries
        self.blocks = _blocks(program)
        self.owner = {i: b for b, block in enumerate(self.blocks) for i in range(block.first, block.first + block.size)}
        self.coupling: dict[int, list[tuple[int, int, int]]] = defaultdict(list)
        for e, (i, j, _) in enumerate(self.entries):
            if i >= self.n:
                self.coupling[self.owner[i]].append((e, i, j))

    def elimination(self) -> Elimination:
        self.find_columns()
        positions, pointers, rows = self.pattern()
        size = len(self.entries) + len(rows)
        for block in self.blocks:
            block.matrix, block.slope = size, size + factor_size(block.size)
            size = block.slope + block.size * len(block.columns)
        plan = [*self.copies(positions)] if self.blocks else []
        for b, block in enumerate(self.blocks):
            plan += self.solve(b, block)
        for e, (i, j, _) in enumerate(self.entries):
            if i < self.n <= j:
                block = self.blocks[self.owner[j]]
                targets = [positions[i, column] for column in block.columns]
                plan += self.subtract(e, block, j, targets)
        return Elimination(len(self.blocks), pointers, rows, np.array([*plan, DONE], dtype=np.int32), len(self.entries), size)

    def find_columns(self) -> None:
        for b, block in enumerate(self.blocks):
            own = [(i - block.first, j - block.first) for _, i, j in self.coupling[b] if self.owner.get(j) == b]
            block.ranks = sparse_first(own, block.size)
            reached: set[int] = set()
            for _, _, j in self.coupling[b]:
                if j < self.n:
                    reached.add(j)
                elif self.owner[j] != b:
                    reached.update(self.blocks[self.owner[j]].columns)
            block.columns = sorted(reached)

    def pattern(self) -> tuple[Mapping[tuple[int, int], int], Ints, Ints]:
        """Where each entry of the result is, column by column."""
        found: set[tuple[int, int]] = set()
        for i, j, _ in self.entries:
            if i < self.n:
                found.update(((j, i),) if j < self.n else ((column, i) for column in self.blocks[self.owner[j]].columns))
        ordered = sorted(found)
        columns = np.array([j for j, _ in ordered], dtype=np.int64)
        pointers = np.searchsorted(columns, np.arange(self.n + 1)).astype(np.int32)
        rows = np.array([i for _, i in ordered], dtype=np.int32)
        return {(i, j): len(self.entries) + k for k, (j, i) in enumerate(ordered)}, pointers, rows

    def copies(self, positions: Mapping[tuple[int, int], int]) -> list[int]:
        pairs: list[int] = []
        for e, (i, j, _) in enumerate(self.entries):
            if i < self.n and j < self.n:
                pairs += (e, positions[i, j])
            elif i >= self.n:
                block = self.blocks[self.owner[i]]
                row = i - block.first
                if j < self.n:
                    pairs += (e, block.slope + row * len(block.columns) + bisect_left(block.columns, j))
                elif self.owner[j] == self.owner[i]:
                    pairs += (e, block.matrix + row * block.size + block.ranks[j - block.first])
        return [COPY, len(pairs) // 2, *pairs]

    def solve(self, b: int, block: _Block) -> list[int]:
        plan: list[int] = []
        place = {column: k for k, column in enumerate(block.columns)}
        for e, i, j in self.coupling[b]:
            if j >= self.n and self.owner[j] != b:
                earlier = self.blocks[self.owner[j]]
                row = block.slope + (i - block.first) * len(block.columns)
                plan += self.subtract(e, earlier, j, [row + place[column] for column in earlier.columns])
        return [*plan, SOLVE, block.size, block.matrix, len(block.columns), block.slope, block.step + 1]

    def subtract(self, e: int, block: _Block, j: int, targets: Sequence[int]) -> list[int]:
        return [SUBTRACT, e, block.row(j), len(targets), *targets]


def _blocks(program: Program) -> list[_Block]:
    found: list[_Block] = []
    first = len(program.states)
    wanted = {id(step) for step in program.needed(program.derivatives)}
    for k, step in enumerate(program.steps):
        if not isinstance(step, Assign) and id(step) in wanted:
            found.append(_Block(k, first, len(step.variables), []))
            first += len(step.variables)
    return found
