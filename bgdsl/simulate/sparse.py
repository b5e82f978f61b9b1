"""The pattern of a sparse LU, worked out once: order of pivots, places of L and U, for the kernels of `kernels/lu.py`."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from bgdsl.simulate.kernels.lu import Factors

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]


class SparseLU:
    """Factors of I - gamma J for a Jacobian in compressed columns; `record` is what the kernels read.

    Without numbers the order is Markowitz's with pivots on the diagonal; with the values of a matrix for which that was
    unstable, it is the one that partial pivoting chooses for it.
    """

    def __init__(self, pointers: Ints, rows: Ints, matrix_values: tuple[Floats, float] | None = None):
        import numpy as np

        n = len(pointers) - 1
        if matrix_values is None:
            pattern = _diagonal_pattern(pointers.tobytes(), rows.tobytes())
        else:
            pattern = _pattern(pointers, rows, *_pivoted_order(pointers, rows, *matrix_values))
        below, above = len(pattern["lower_rows"]), len(pattern["upper_rows"])
        numbers = {name: np.zeros(max(1, size)) for name, size in (("lower", below), ("upper", above), ("pivots", n), ("work", n))}
        self._arrays: dict[str, Any] = {**pattern, **numbers}
        self.record = Factors(n=n, entries=len(rows), **{name: array.ctypes.data for name, array in self._arrays.items()})
        self.fill = below + above + n

    @property
    def address(self) -> int:
        return ctypes.addressof(self.record)


@lru_cache(maxsize=16)
def _diagonal_pattern(pointers: bytes, rows: bytes) -> Mapping[str, Ints]:
    """The pattern with pivots on the diagonal, kept for the next run of the model."""
    import numpy as np

    starts, entries = np.frombuffer(pointers, dtype=np.int32), np.frombuffer(rows, dtype=np.int32)
    order = np.array(elimination_order(_columns(starts, entries)), dtype=np.int32)
    return _pattern(starts, entries, order, order)


def _columns(pointers: Ints, rows: Ints) -> list[set[int]]:
    """The rows of each column of I - gamma J."""
    return [{j, *rows[pointers[j] : pointers[j + 1]].tolist()} for j in range(len(pointers) - 1)]


def _pattern(pointers: Ints, rows: Ints, row_order: Any, column_order: Any) -> Mapping[str, Ints]:
    """The arrays of `Factors` that the order of pivots decides."""
    import numpy as np

    n = len(pointers) - 1
    inverse = np.empty(n, dtype=np.int32)
    inverse[row_order] = np.arange(n)
    columns = _columns(pointers, rows)
    lower, upper = _fill([[int(inverse[row]) for row in columns[j]] for j in column_order])
    starts, permuted_rows, sources = _permuted(np.repeat(np.arange(n, dtype=np.int32), np.diff(pointers)), rows, inverse, column_order, n)
    arrays = {
        "row_order": row_order,
        "column_order": column_order,
        "matrix_starts": starts,
        "matrix_rows": permuted_rows,
        "matrix_from": sources,
        "lower_starts": lower[0],
        "lower_rows": lower[1],
        "upper_starts": upper[0],
        "upper_rows": upper[1],
    }
    return {name: np.ascontiguousarray(array, dtype=np.int32) for name, array in arrays.items()}


def elimination_order(pattern: Sequence[set[int]]) -> list[int]:
    """An order of elimination with little fill, pivots on the diagonal (Markowitz): always the vertex with the fewest products
    (entries below it x entries beside it), the first of them where several are equal. The pattern is taken as it is, by columns: what
    couples one way only, as a conditioned model does, fills in one way only. Nearly full matrices are left in their order from there on."""
    import heapq

    n = len(pattern)
    below: list[set[int]] = [{i for i in rows if i != j} for j, rows in enumerate(pattern)]
    beside: list[set[int]] = [set() for _ in range(n)]
    for j, rows in enumerate(below):
        for i in rows:
            beside[i].add(j)
    cost = [len(below[i]) * len(beside[i]) for i in range(n)]
    heap = [(cost[i], i) for i in range(n)]
    heapq.heapify(heap)
    order: list[int] = []
    done = [False] * n
    while heap:
        least, i = heapq.heappop(heap)
        if done[i] or least != cost[i]:
            continue
        if least >= (n - len(order) - 1) ** 2:
            break  # what is left is full: any order will do
        done[i] = True
        order.append(i)
        rows, columns = below[i], beside[i]
        for j in columns:
            below[j] |= rows
            below[j] -= {i, j}
        for k in rows:
            beside[k] |= columns
            beside[k] -= {i, k}
        for k in rows | columns:
            cost[k] = len(below[k]) * len(beside[k])
            heapq.heappush(heap, (cost[k], k))
    order += [i for i in range(n) if not done[i]]
    return order


def _pivoted_order(pointers: Ints, rows: Ints, values: Floats, gamma: float) -> tuple[Any, Any]:
    """The rows and columns in the order of the pivots that SuperLU chooses for I - gamma J."""
    import numpy as np
    from scipy.sparse import csc_matrix, identity
    from scipy.sparse.linalg import splu

    n = len(pointers) - 1
    matrix = identity(n, format="csc") - gamma * csc_matrix((values, rows, pointers), shape=(n, n))
    factors = splu(matrix.tocsc(), permc_spec="COLAMD")
    return np.argsort(factors.perm_r), np.argsort(factors.perm_c)


def _fill(permuted: Sequence[list[int]]) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """The strict lower and upper patterns of L and U (pointers, rows ascending) of a matrix given by columns, pivots on the diagonal."""
    import numpy as np

    starts_l, starts_u, rows_l, rows_u = [0], [0], [], []
    columns_of_l: list[Any] = []
    for j, rows in enumerate(permuted):
        above, below = _reach(rows, columns_of_l, j)
        columns_of_l.append(below)
        rows_u += above
        rows_l += below
        starts_u.append(len(rows_u))
        starts_l.append(len(rows_l))
    return (np.array(starts_l), np.array(rows_l, dtype=int)), (np.array(starts_u), np.array(rows_u, dtype=int))


def _reach(start: list[int], columns_of_l: list[Any], j: int) -> tuple[list[int], list[int]]:
    """The rows of column j once the columns above have been subtracted: those above and those below the diagonal."""
    found = {*start, j}
    open_ = [row for row in start if row < j]
    while open_:
        for row in columns_of_l[open_.pop()]:
            if row not in found:
                found.add(row)
                if row < j:
                    open_.append(row)
    return sorted(row for row in found if row < j), sorted(row for row in found if row > j)


def _permuted(columns: Any, rows: Any, inverse: Any, column_order: Any, n: int) -> tuple[Any, Any, Any]:
    """The columns of P (I - gamma J) Q: pointers, rows, and the Jacobian entry that each comes from (-1 for a bare diagonal)."""
    import numpy as np

    place = np.empty(n, dtype=np.int64)
    place[column_order] = np.arange(n)
    have = set(rows[rows == columns].tolist())
    bare = np.array([i for i in range(n) if i not in have], dtype=np.int64)
    all_columns = np.concatenate((place[columns], place[bare])).astype(np.int64)
    all_rows = np.concatenate((inverse[rows], inverse[bare])).astype(np.int64)
    sources = np.concatenate((np.arange(len(rows)), np.full(len(bare), -1)))
    order = np.lexsort((all_rows, all_columns))
    starts = np.concatenate(([0], np.cumsum(np.bincount(all_columns, minlength=n))))
    return starts, all_rows[order], sources[order]
