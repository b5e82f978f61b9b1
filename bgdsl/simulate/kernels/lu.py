"""Sparse LU with a fixed pivot order: factorise and solve, the pattern having been worked out before (`simulate/sparse.py`).

Left-looking by columns, as in KLU's refactorisation: column j of the permuted matrix is spread over a dense work vector, the
earlier columns that its upper part names are subtracted, and the rest is divided by the pivot.
"""

# mypy: ignore-errors
# (kernels are not Python: `kernels/compiler.py` gives their names a meaning)
from __future__ import annotations

from bgdsl.simulate.kernels.compiler import kernel
from bgdsl.simulate.kernels.kinds import Struct, fabs, real, reals, whole

__all__ = ["Factors", "fabs", "real", "reals", "whole"]

Factors = Struct(
    "Factors",
    """whole n, ints row_order, ints column_order,
    ints matrix_starts, ints matrix_rows, ints matrix_from,
    ints lower_starts, ints lower_rows, reals lower,
    ints upper_starts, ints upper_rows, reals upper,
    reals pivots, reals work, real growth, whole entries""",
)
"""Of P M Q = L U. matrix_*: the columns of P M Q: pointers, permuted rows, and where in the Jacobian's values the entry comes
from (-1: only from the identity); lower, upper without their diagonals (L's is 1); growth: the smallest pivot / column size met;
entries: of the Jacobian."""


@kernel
def lu_factor(f: Factors, jacobian: reals, gamma: real) -> int:
    """Factorise M = I - gamma J. 0, or 1 + the column where the pivot vanishes."""
    work = f.work
    lower_starts = f.lower_starts
    lower_rows = f.lower_rows
    lower = f.lower
    upper_rows = f.upper_rows
    upper = f.upper
    f.growth = 1.0
    for j in range(f.n):
        for p in range(f.matrix_starts[j], f.matrix_starts[j + 1]):
            row = f.matrix_rows[p]
            source = f.matrix_from[p]
            value = 1.0 if f.row_order[row] == f.column_order[j] else 0.0
            if source >= 0:
                value -= gamma * jacobian[source]
            work[row] = value
        for p in range(f.upper_starts[j], f.upper_starts[j + 1]):
            k = upper_rows[p]
            factor = work[k]
            upper[p] = factor
            work[k] = 0.0
            if factor != 0.0:
                for q in range(lower_starts[k], lower_starts[k + 1]):
                    work[lower_rows[q]] -= lower[q] * factor
        pivot = work[j]
        work[j] = 0.0
        largest = fabs(pivot)
        for q in range(lower_starts[j], lower_starts[j + 1]):
            size = fabs(work[lower_rows[q]])
            largest = size if size > largest else largest
        if not fabs(pivot) > 1e-300:
            for q in range(lower_starts[j], lower_starts[j + 1]):
                work[lower_rows[q]] = 0.0
            return j + 1
        share = fabs(pivot) / largest
        f.growth = share if share < f.growth else f.growth
        inverse = 1.0 / pivot
        f.pivots[j] = inverse
        for q in range(lower_starts[j], lower_starts[j + 1]):
            row = lower_rows[q]
            lower[q] = work[row] * inverse
            work[row] = 0.0
    return 0


@kernel
def lu_solve(f: Factors, b: reals, x: reals) -> None:
    """x := inv(M) b; the two may be one."""
    work = f.work
    n = f.n
    row_order = f.row_order
    column_order = f.column_order
    starts = f.lower_starts
    rows = f.lower_rows
    numbers = f.lower
    pivots = f.pivots
    for i in range(n):
        work[i] = b[row_order[i]]
    for j in range(n):
        value = work[j]
        if value != 0.0:
            for q in range(starts[j], starts[j + 1]):
                work[rows[q]] -= numbers[q] * value
    starts = f.upper_starts
    rows = f.upper_rows
    numbers = f.upper
    for j in range(n - 1, -1, -1):
        value = work[j] * pivots[j]
        x[column_order[j]] = value
        work[j] = 0.0
        if value != 0.0:
            for q in range(starts[j], starts[j + 1]):
                work[rows[q]] -= numbers[q] * value
