"""Is a square matrix of expressions singular, with the parameters' defaults and whatever its variables are?

Input        rows of a matrix by column, Moduli (the parameters' defaults)
Output       a verdict: no false alarm but for round-off; singular at some values of the variables only is no matter of this
Establishes  a matrix that is singular by cancellation, as `cos(a)*x - x*cos(a)`, is found before it is solved
Reports      nothing: the caller knows what the matrix means

What reads variables is judged at random values of them: an analytic expression that is zero at such a point is zero everywhere
(Schwartz and Zippel). Every number carries the size of what it was summed from, so that a zero left by cancellation is told from
a small number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from random import Random

from bgdsl.expr import Expr, const, evaluate, rebuild, topological
from bgdsl.passes.moduli import Moduli

DRAWS = 3
LARGEST = 40
"""Rows of a matrix over variables that is still judged: elimination is cubic. Larger ones are judged when they run."""
ROUND_OFF = 1e-13
CANCELLED = 4e-15
SMOOTH = frozenset(("add", "mul", "div", "neg", "pow", "sin", "cos", "tan", "exp", "log", "sqrt", "sinh", "cosh", "tanh", "atan", "atan2"))
"""Analytic, so that a zero at random is a zero everywhere; a condition or a table may be zero over a range."""

Number = tuple[float, float]
"""A value, and the size of what it was summed from."""


def is_singular(rows: Sequence[Mapping[int, Expr]], moduli: Moduli) -> bool:
    """Whether the matrix is singular with the parameters' defaults, and whatever the variables in it are."""
    if any(not row for row in rows):
        return True
    numbers = [{j: moduli.value(value) for j, value in row.items()} for row in rows]
    if all(number is not None for row in numbers for number in row.values()):
        return _rank_is_lost([[row.get(j) or 0.0 for j in range(len(rows))] for row in numbers])
    return len(rows) <= LARGEST and _is_cancelled(rows, moduli)


def _rank_is_lost(rows: list[list[float]], least: float = ROUND_OFF) -> bool:
    """Gaussian elimination with row scaling and partial pivoting: whether a pivot is round-off."""
    n = len(rows)
    if not all(math.isfinite(value) for row in rows for value in row):
        return False
    rows = [[value / largest for value in row] for row in rows if (largest := max(map(abs, row))) > 0.0]
    if len(rows) < n:
        return True
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        if abs(rows[pivot][k]) < least:
            return True
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            if factor:
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return False


def _is_cancelled(rows: Sequence[Mapping[int, Expr]], moduli: Moduli) -> bool:
    """Whether the matrix is singular at every draw of its variables."""
    nodes = tuple(topological(value for row in rows for value in row.values()))
    if any(node.args and node.op not in SMOOTH for node in nodes):
        return False
    random = Random(len(nodes))
    try:
        return all(_has_lost_rank(rows, _numbers(nodes, moduli, random)) for _ in range(DRAWS))
    except (KeyError, ArithmeticError, ValueError):
        return False


def _numbers(nodes: Sequence[Expr], moduli: Moduli, random: Random) -> Mapping[Expr, Number]:
    """The value and size of every node with variables drawn at random."""
    known: dict[Expr, Number] = {}
    for node in nodes:
        args = [known[arg] for arg in node.args]
        match node.op:
            case "var" | "time":
                drawn = random.uniform(0.3, 1.7)
                known[node] = drawn, drawn
            case "add":
                known[node] = math.fsum(value for value, _ in args), math.fsum(size for _, size in args)
            case "neg":
                known[node] = -args[0][0], args[0][1]
            case "mul":
                known[node] = args[0][0] * args[1][0], args[0][1] * args[1][1]
            case "div":
                known[node] = args[0][0] / args[1][0], args[0][1] / abs(args[1][0])
            case "param":
                value = moduli.default(node.data)
                if value is None:
                    raise ValueError(node.data)
                known[node] = value, abs(value)
            case _:
                value = evaluate(rebuild(node, tuple(const(value) for value, _ in args)))
                known[node] = value, abs(value)
    return known


def _has_lost_rank(rows: Sequence[Mapping[int, Expr]], known: Mapping[Expr, Number]) -> bool:
    """Gaussian elimination by the surest pivots: whether what is left is nothing but what cancellation leaves. The sizes are bounds,
    and in large matrices loose ones; so the numbers themselves have to lose their rank too."""
    n = len(rows)
    if not _rank_is_lost([[_certain(known[row[j]]) if j in row else 0.0 for j in range(n)] for row in rows], n * ROUND_OFF):
        return False
    left = [{j: known[value] for j, value in row.items()} for row in rows]
    while left:
        sure, i, j = max((abs(value) / size if size else 0.0, i, j) for i, row in enumerate(left) for j, (value, size) in row.items())
        if not sure > CANCELLED:
            return True
        pivot = left.pop(i)
        value, _ = pivot.pop(j)
        for row in left:
            if j in row:
                _subtract(row, pivot, row.pop(j), value)
        if any(not row for row in left):
            return True
    return False


def _certain(number: Number) -> float:
    """The value, zero where that is all cancellation may have left."""
    value, size = number
    return value if abs(value) > CANCELLED * size else 0.0


def _subtract(row: dict[int, Number], pivot: Mapping[int, Number], head: Number, value: float) -> None:
    """Take the pivot's row from another, so that the other's head becomes zero."""
    factor, weight = head[0] / value, head[1] / abs(value)
    for j, (a, size) in pivot.items():
        before, much = row.get(j, (0.0, 0.0))
        row[j] = before - factor * a, much + weight * size
