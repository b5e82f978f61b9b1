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
def factorise(p: Projection, t: real, x: reals) -> int:
    """The gradient at x, and the Cholesky factor of G W G'."""
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
                for r in range(p.starts[j], q + 1):
                    a[i * m + p.rows[r]] += w * slope * p.gradient[r]
    for j in range(m):
        own = a[j * m + j]
        d = own
        for k in range(j):
            d -= a[j * m + k] * a[j * m + k]
        if d <= 1e-12 * own:
            a[j * m + j] = 0.0
            for i in range(j + 1, m):
                a[i * m + j] = 0.0
        else:
            d = sqrt(d)
            a[j * m + j] = d
            for i in range(j + 1, m):
                value = a[i * m + j]
                for k in range(j):
                    value -= a[i * m + k] * a[j * m + k]
                a[i * m + j] = value / d
    p.factored = 1
    return status


@kernel
def correct(p: Projection, x: reals) -> None:
    """x := x - W G' inv(G W G') g with what is factored."""
    m = p.count
    a = p.matrix
    y = p.move
    for i in range(m):
        value = p.g[i]
        for k in range(i):
            value -= a[i * m + k] * y[k]
        y[i] = value / a[i * m + i] if a[i * m + i] != 0.0 else 0.0
    for i in range(m - 1, -1, -1):
        value = y[i]
        for k in range(i + 1, m):
            value -= a[k * m + i] * y[k]
        y[i] = value / a[i * m + i] if a[i * m + i] != 0.0 else 0.0
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
