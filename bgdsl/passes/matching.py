"""Match equations with unknowns: a maximum matching of a bipartite graph, and what it leaves over.

Input        for each row (equation) the columns (unknowns) it reads; a partial matching to begin with
Output       Matching        a maximum one
Establishes  no column serves two rows; no augmenting path is left
Reports      nothing

The algorithm is Pothen and Fan's: depth-first searches for augmenting paths, all of one phase sharing their marks, each first
looking one step ahead for a free column. A phase costs one pass over the graph; since causality has assigned nearly every
equation, few phases are needed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

Rows = Sequence[Sequence[int]]
"""For each row, the columns in which it is nonzero."""

FREE = -1


@dataclass(frozen=True, slots=True)
class Matching:
    """`column_of[row]` and `row_of[column]`, FREE where unmatched."""

    column_of: list[int]
    row_of: list[int]

    @property
    def unmatched_rows(self) -> tuple[int, ...]:
        return tuple(i for i, column in enumerate(self.column_of) if column == FREE)

    @property
    def unmatched_columns(self) -> tuple[int, ...]:
        return tuple(j for j, row in enumerate(self.row_of) if row == FREE)


def match(rows: Rows, columns: int, given: Sequence[int]) -> Matching:
    """A maximum matching, grown from the partial one `given` (a column or FREE for each row)."""
    column_of = list(given)
    row_of = [FREE] * columns
    for i, j in enumerate(column_of):
        if j != FREE:
            assert row_of[j] == FREE, "two rows are given one column"
            row_of[j] = i
    ahead = [0] * len(rows)
    free = [i for i, j in enumerate(column_of) if j == FREE]
    while free:
        visited = bytearray(columns)
        left = [i for i in free if not _augment(rows, i, column_of, row_of, visited, ahead)]
        if len(left) == len(free):
            break
        free = left
    return Matching(column_of, row_of)


def _augment(rows: Rows, root: int, column_of: list[int], row_of: list[int], visited: bytearray, ahead: list[int]) -> bool:
    """Try to match `root` along an augmenting path through columns not yet visited in this phase."""
    path: list[tuple[int, int]] = [(root, 0)]
    while path:
        row, k = path[-1]
        column = _free_column(rows[row], row, row_of, ahead) if k == 0 else FREE
        if column != FREE:
            _flip(rows, path, column, column_of, row_of)
            return True
        reads = rows[row]
        while k < len(reads) and visited[reads[k]]:
            k += 1
        if k == len(reads):
            path.pop()
            continue
        visited[reads[k]] = 1
        path[-1] = (row, k + 1)
        path.append((row_of[reads[k]], 0))
    return False


def _free_column(reads: Sequence[int], row: int, row_of: list[int], ahead: list[int]) -> int:
    """The next column of the row that is free, or FREE; a column once matched stays so, and is not looked at again."""
    k = ahead[row]
    while k < len(reads) and row_of[reads[k]] != FREE:
        k += 1
    ahead[row] = k
    return reads[k] if k < len(reads) else FREE


def _flip(rows: Rows, path: list[tuple[int, int]], column: int, column_of: list[int], row_of: list[int]) -> None:
    """Give the last row of the path the free column, and every row before it the column it went through."""
    for row, k in reversed(path):
        # the last row has k == 0: it takes the free column; its forerunner went through reads[k - 1], just given up
        taken = column if k == 0 else rows[row][k - 1]
        column_of[row] = taken
        row_of[taken] = row


def overdetermined(rows: Rows, matching: Matching) -> tuple[int, ...]:
    """The rows on alternating paths from unmatched rows: together more rows than columns (Dulmage and Mendelsohn)."""
    return _reached(rows, matching.row_of, matching.unmatched_rows)


def underdetermined(rows: Rows, matching: Matching) -> tuple[int, ...]:
    """The columns on alternating paths from unmatched columns: together more columns than rows."""
    readers: list[list[int]] = [[] for _ in matching.row_of]
    for i, reads in enumerate(rows):
        for j in reads:
            readers[j].append(i)
    return _reached(readers, matching.column_of, matching.unmatched_columns)


def _reached(neighbours: Rows, partner: Sequence[int], starts: Iterable[int]) -> tuple[int, ...]:
    """What is reached from the starts by going to a neighbour and from there to its partner in the matching, again and again."""
    stack = list(starts)
    reached = bytearray(len(neighbours))
    for i in stack:
        reached[i] = 1
    while stack:
        for j in neighbours[stack.pop()]:
            i = partner[j]
            if i != FREE and not reached[i]:
                reached[i] = 1
                stack.append(i)
    return tuple(i for i in range(len(neighbours)) if reached[i])
