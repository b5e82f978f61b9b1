"""The pattern of a sparse LU, worked out once: order of pivots, places of L and U, for the kernels of `kernels/lu.py`."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

from bgdsl.simulate.kernels.lu import Factors

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]


class SparseLU:
    """Factors of I - gamma J for a Jacobian in compressed columns; `record` is what the kernels read.

    Without numbers the order is a minimum degree order with pivots on the diagonal; with the values of a matrix for which that was
    unstable, it is the one that partial pivoting chooses for it.
    """

    def __init__(self, pointers: Ints, rows: Ints, matrix_values: tuple[Floats, float] | None = None):
        import numpy as np
        from scipy.sparse import csc_matrix

        n = len(pointers) - 1
        columns = np.repeat(np.arange(n, dtype=np.int32), np.diff(pointers))
        entries = len(rows)
        numbers = csc_matrix((np.arange(1, entries + 1), rows, pointers), shape=(n, n))
        pattern = (abs(numbers) + _identity(n)).tocsc()
        pattern.data = np.ones(len(pattern.data))
        row_order, column_order = _diagonal_order(pattern) if matrix_values is None else _pivoted_order(numbers, *matrix_values)
        lower, upper = _fill(pattern[row_order][:, column_order].tocsc())
        self._arrays: list[Any] = []
        inverse = np.empty(n, dtype=np.int32)
        inverse[row_order] = np.arange(n)
        starts, permuted_rows, sources = _permuted(columns, rows, inverse, column_order, n)
        record = Factors()
        record.n, record.entries = n, entries
        for name, array in (
            ("row_order", row_order),
            ("column_order", column_order),
            ("matrix_starts", starts),
            ("matrix_rows", permuted_rows),
            ("matrix_from", sources),
            ("lower_starts", lower[0]),
            ("lower_rows", lower[1]),
            ("upper_starts", upper[0]),
            ("upper_rows", upper[1]),
        ):
            setattr(record, name, self._keep(array.astype(np.int32)))
        for name, size in (("lower", len(lower[1])), ("upper", len(upper[1])), ("pivots", n), ("work", n)):
            setattr(record, name, self._keep(np.zeros(max(1, size))))
        self.record = record
        self.fill = len(lower[1]) + len(upper[1]) + n

    @property
    def address(self) -> int:
        return ctypes.addressof(self.record)

    def _keep(self, array: Any) -> int:
        import numpy as np

        array = np.ascontiguousarray(array)
        self._arrays.append(array)
        return int(array.ctypes.data)


def _identity(n: int) -> Any:
    from scipy.sparse import identity

    return identity(n, format="csc")


def _diagonal_order(pattern: Any) -> tuple[Any, Any]:
    """A fill-reducing symmetric order (minimum degree on A + A')."""
    order = _dominant_factors(pattern, "MMD_AT_PLUS_A").perm_c
    import numpy as np

    inverse = np.argsort(order)
    return inverse, inverse


def _pivoted_order(numbers: Any, values: Floats, gamma: float) -> tuple[Any, Any]:
    """The rows and columns in the order of the pivots that SuperLU chooses for I - gamma J."""
    import numpy as np
    from scipy.sparse.linalg import splu

    matrix = numbers.astype(float)
    matrix.data = -gamma * values
    factors = splu((matrix + _identity(numbers.shape[0])).tocsc(), permc_spec="COLAMD")
    return np.argsort(factors.perm_r), np.argsort(factors.perm_c)


def _dominant_factors(pattern: Any, order: str) -> Any:
    """SuperLU's factors of a matrix with this pattern whose diagonal needs no pivoting; its numbers do not cancel."""
    import numpy as np
    from scipy.sparse.linalg import splu

    n = pattern.shape[0]
    matrix = pattern.astype(float)
    matrix.data = -(1.0 + np.random.default_rng(1).random(len(matrix.data)))
    columns = np.repeat(np.arange(n), np.diff(matrix.indptr))
    diagonal = matrix.indices == columns
    matrix.data[diagonal] = 4.0 * (np.diff(matrix.indptr).max(initial=1) + np.bincount(matrix.indices, minlength=n).max(initial=1))
    options = {"SymmetricMode": order != "NATURAL", "Equil": False}
    return splu(matrix, permc_spec=order, diag_pivot_thresh=0.0, relax=1, panel_size=1, options=options)


def _fill(permuted: Any) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """The strict lower and upper patterns of L and U (pointers, rows ascending) when pivots stay on the diagonal."""
    import numpy as np

    n = permuted.shape[0]
    permuted = (permuted + _identity(n)).tocsc()
    permuted.data = np.ones(len(permuted.data))
    starts_l, starts_u, rows_l, rows_u = [0], [0], [], []
    columns_of_l: list[Any] = []
    for j in range(n):
        above, below = _reach(permuted.indices[permuted.indptr[j] : permuted.indptr[j + 1]].tolist(), columns_of_l, j)
        columns_of_l.append(below)
        rows_u += above
        rows_l += below
        starts_u.append(len(rows_u))
        starts_l.append(len(rows_l))
    return (np.array(starts_l), np.array(rows_l, dtype=int)), (np.array(starts_u), np.array(rows_u, dtype=int))


def _reach(start: list[int], columns_of_l: list[Any], j: int) -> tuple[list[int], list[int]]:
    """The rows of column j once the columns above have been subtracted: those above and those below the diagonal."""
    found = set(start)
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
