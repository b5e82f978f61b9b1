"""States moved back onto the invariants: the smallest move, each state weighed by its tolerance.

Newton's iteration with G the invariants' Jacobian and W the squared weights: x := x - W G' inv(G W G') g. The factored matrix is kept
while it converges. Rows that follow from others have vanishing pivots and are passed over.
"""

# mypy: ignore-errors
# (kernels are not Python: `kernels/compiler.py` gives their names a meaning)
from __future__ import annotations

from bgdsl.simulate.kernels.compiler import kernel
from bgdsl.simulate.kernels.kinds import Struct, fabs, ints, place, places, real, reals, sole, sqrt, whole
from bgdsl.simulate.kernels.link import Link, call_model, set_inputs

__all__ = ["Link", "Projection", "fabs", "ints", "place", "places", "sqrt", "whole"]

Projection = Struct(
    "Projection",
    """Link link, whole count, place residuals, place slopes, whole columns, ints states, ints starts, ints rows, ints order,
    reals values, reals g, reals gradient, reals weights, reals matrix, reals sizes, reals move, reals spread,
    real rtol, real atol, real tolerance,
    whole factored, real time, real slowing, real worst, real drift, whole moves, reals before, reals history""",
)
"""G by columns, of states that may be moved: which states, starts (columns + 1), rows (of invariants in the order of elimination,
ascending), values `gradient`; order: the invariant in each row, values: all of them as the model gives them. matrix: count x count;
spread: `count` numbers, zero between calls. time: of the factors; slowing: by how much a second from there the residual that one
correction leaves grows, in shares of the one before. worst: the relative residual left last; drift: the largest that was ever left.
history: CVODE's own record of the states, moved along (null where there is none)."""

MOST_ITERATIONS = 8
SLOW = 0.05
"""Factors are made anew where a correction leaves more than this share of the residual."""
MANY = 10
"""Entries of a column from which on its product with itself is added to the matrix by whole rows."""


@kernel
def residual(p: Projection, t: real, x: reals) -> int:
    """g := the invariants at x, and `worst`."""
    status = call_model(p.residuals, t, x, p.link.u, p.values, p.link.context)
    for i in range(p.count):
        p.g[i] = p.values[p.order[i]]
    weigh(p)
    return status


@kernel
def weigh(p: Projection) -> None:
    """worst := the size of g relative to the terms it is made of."""
    worst = 0.0
    for i in range(p.count):
        share = fabs(p.g[i]) / (p.sizes[i] + p.atol)
        worst = share if share > worst else worst
        if not share >= 0.0:
            worst = 1e300
    p.worst = worst


@kernel
def subtract(n: whole, target: sole, factor: real, source: sole) -> None:
    """target -= factor * source"""
    for i in range(n):
        target[i] -= factor * source[i]


@kernel
def add_square(p: Projection, first: whole, end: whole, w: real) -> None:
    """Add w c c', upper half, for the column c whose entries stand from `first` up to `end`."""
    m = p.count
    a = p.matrix
    rows = p.rows
    gradient = p.gradient
    if end - first < MANY:
        for q in range(first, end):
            value = w * gradient[q]
            row = a + rows[q] * m
            for r in range(q, end):
                row[rows[r]] += value * gradient[r]
    else:
        wide = p.spread
        last = rows[end - 1] + 1
        for q in range(first, end):
            wide[rows[q]] = gradient[q]
        for q in range(first, end):
            i = rows[q]
            subtract(last - i, a + i * m + i, -w * gradient[q], wide + i)
        for q in range(first, end):
            wide[rows[q]] = 0.0


@kernel
def factorise(p: Projection, t: real, x: reals) -> int:
    """The gradient at x, and G W G' = L D L': the rows of D L' in the upper half of the matrix, those of L in the lower, 1 / D on its
    diagonal (0 where it vanishes). By rows, so that the machine can do several numbers at once."""
    m = p.count
    a = p.matrix
    status = call_model(p.slopes, t, x, p.link.u, p.gradient, p.link.context)
    for i in range(m * m):
        a[i] = 0.0
    for i in range(m):
        p.sizes[i] = 0.0
    for j in range(p.columns):
        size = fabs(x[p.states[j]])
        w = p.rtol * size + p.atol
        w = w * w
        p.weights[j] = w
        for q in range(p.starts[j], p.starts[j + 1]):
            p.sizes[p.rows[q]] += fabs(p.gradient[q]) * size
        add_square(p, p.starts[j], p.starts[j + 1], w)
    for i in range(m):
        p.move[i] = a[i * m + i]
    for k in range(m):
        top = a + k * m
        own = top[k]
        if own <= 1e-12 * p.move[k]:
            top[k] = 0.0
        else:
            top[k] = 1.0 / own
            for i in range(k + 1, m):
                if top[i] != 0.0:
                    share = top[i] / own
                    a[i * m + k] = share
                    subtract(m - i, a + i * m + i, share, top + i)
    p.factored = 1
    p.time = t
    return status


@kernel
def correct(p: Projection, x: reals) -> None:
    """x := x - W G' inv(G W G') g with what is factored."""
    m = p.count
    a = p.matrix
    y = p.move
    for i in range(m):
        y[i] = p.g[i]
    for k in range(m):
        y[k] = y[k] * a[k * m + k]
        if y[k] != 0.0:
            subtract(m - k - 1, y + k + 1, y[k], a + k * m + k + 1)
    for k in range(m - 1, 0, -1):
        if y[k] != 0.0:
            subtract(k, y, y[k], a + k * m)
    for j in range(p.columns):
        s = 0.0
        for q in range(p.starts[j], p.starts[j + 1]):
            s += p.gradient[q] * y[p.rows[q]]
        x[p.states[j]] -= p.weights[j] * s


@kernel
def project(p: Projection, t: real, x: reals) -> int:
    """Move x onto the invariants. 0 where they hold to the tolerance then, 1 where that was not reached."""
    set_inputs(p.link, t)
    if p.factored == 0 and factorise(p, t, x) != 0:
        return 1
    if residual(p, t, x) != 0:
        return 1
    age = fabs(t - p.time)
    expected = p.slowing * age
    again = expected > SLOW and expected * p.worst > p.tolerance
    for _k in range(MOST_ITERATIONS):
        if p.worst <= p.tolerance:
            return 0
        if again:
            if factorise(p, t, x) != 0:
                return 1
            weigh(p)
            age = 0.0
        before = p.worst
        correct(p, x)
        if residual(p, t, x) != 0:
            return 1
        if age > 0.0:
            p.slowing = p.worst / before / age
        again = p.worst > SLOW * before
        if age == 0.0 and p.worst > 0.5 * before:
            break
    if p.worst <= p.tolerance:
        return 0
    return 1


@kernel
def project_step(p: Projection, t: real, x: reals) -> int:
    """Project the states of an accepted step, and the integrator's own record of them."""
    for j in range(p.link.n):
        p.before[j] = x[j]
    failed = project(p, t, x)
    if p.history:
        for j in range(p.link.n):
            p.history[j] += x[j] - p.before[j]
    p.moves += 1
    if p.worst > p.drift:
        p.drift = p.worst
    return failed
