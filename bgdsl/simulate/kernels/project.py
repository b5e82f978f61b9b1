"""States moved back onto the invariants: the smallest move, each state weighed by its tolerance.

Newton's iteration with G the invariants' Jacobian and W the squared weights: x := x - W G' inv(G W G') g. The factored matrix is kept
while it converges. Rows that follow from others have vanishing pivots and are passed over.
"""

# mypy: ignore-errors
# (kernels are not Python: `kernels/compiler.py` gives their names a meaning)
from __future__ import annotations

from bgdsl.simulate.kernels.compiler import kernel
from bgdsl.simulate.kernels.kinds import Struct, fabs, ints, place, places, real, reals, sqrt, whole
from bgdsl.simulate.kernels.link import Link, call_model, set_inputs

__all__ = ["Link", "Projection", "fabs", "ints", "place", "places", "sqrt", "whole"]

Projection = Struct(
    "Projection",
    """Link link, whole count, place residuals, place slopes, ints starts, ints rows, whole entries, ints chosen,
    reals g, reals gradient, reals weights, reals matrix, reals sizes, reals move, real rtol, real atol, real tolerance,
    whole factored, real worst, real drift, whole moves, reals before, reals history""",
)
"""G by columns: starts (n + 1), rows (of invariants, ascending), values `gradient`; chosen: 1 for states that may be moved.
matrix: count x count. worst: the relative residual left last; drift: the largest that was ever left. history: CVODE's own record
of the states, moved along (null where there is none)."""

MOST_ITERATIONS = 8


@kernel
def residual(p: Projection, t: real, x: reals) -> int:
    """g := the invariants at x, `worst` their size relative to the terms they are made of."""
    link = p.link
    status = call_model(p.residuals, t, x, link.u, p.g, link.context)
    worst = 0.0
    for i in range(p.count):
        share = fabs(p.g[i]) / (p.sizes[i] + p.atol)
        worst = share if share > worst else worst
        if not share >= 0.0:
            worst = 1e300
    p.worst = worst
    return status


@kernel
def subtract(n: whole, target: reals, factor: real, source: reals) -> None:
    """target -= factor * source"""
    for i in range(n):
        target[i] -= factor * source[i]


@kernel
def dot(n: whole, x: reals, y: reals) -> real:
    """The inner product, in four sums that do not wait for one another."""
    a = 0.0
    b = 0.0
    c = 0.0
    d = 0.0
    i = 0
    while i + 3 < n:
        a += x[i] * y[i]
        b += x[i + 1] * y[i + 1]
        c += x[i + 2] * y[i + 2]
        d += x[i + 3] * y[i + 3]
        i += 4
    while i < n:
        a += x[i] * y[i]
        i += 1
    return (a + b) + (c + d)


@kernel
def factorise(p: Projection, t: real, x: reals) -> int:
    """The gradient at x, and G W G' = U' D U: the rows of D U in the upper half of the matrix, 1 / D on its diagonal (0 where it
    vanishes). By rows, so that the machine can do several numbers at once."""
    link = p.link
    m = p.count
    a = p.matrix
    status = call_model(p.slopes, t, x, link.u, p.gradient, link.context)
    for i in range(m * m):
        a[i] = 0.0
    for i in range(m):
        p.sizes[i] = 0.0
    for j in range(link.n):
        w = p.rtol * fabs(x[j]) + p.atol
        w = w * w * p.chosen[j]
        p.weights[j] = w
        for q in range(p.starts[j], p.starts[j + 1]):
            i = p.rows[q]
            slope = p.gradient[q]
            p.sizes[i] += fabs(slope * x[j])
            if w != 0.0:
                for r in range(q, p.starts[j + 1]):
                    a[i * m + p.rows[r]] += w * slope * p.gradient[r]
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
                    subtract(m - i, a + i * m + i, top[i] / own, top + i)
    p.factored = 1
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
    for k in range(m - 1, -1, -1):
        y[k] -= a[k * m + k] * dot(m - k - 1, a + k * m + k + 1, y + k + 1)
    for j in range(p.link.n):
        w = p.weights[j]
        if w != 0.0:
            s = 0.0
            for q in range(p.starts[j], p.starts[j + 1]):
                s += p.gradient[q] * y[p.rows[q]]
            x[j] -= w * s


@kernel
def project(p: Projection, t: real, x: reals) -> int:
    """Move x onto the invariants. 0 where they hold to the tolerance then, 1 where that was not reached."""
    set_inputs(p.link, t)
    if p.factored == 0 and factorise(p, t, x) != 0:
        return 1
    if residual(p, t, x) != 0:
        return 1
    fresh = 0
    for _k in range(MOST_ITERATIONS):
        if p.worst <= p.tolerance:
            return 0
        before = p.worst
        correct(p, x)
        if residual(p, t, x) != 0:
            return 1
        if p.worst > p.tolerance and p.worst > 0.05 * before:
            if fresh != 0 and p.worst > 0.5 * before:
                break
            fresh = 1
            if factorise(p, t, x) != 0 or residual(p, t, x) != 0:
                return 1
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
