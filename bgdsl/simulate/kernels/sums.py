"""Integrals of many expressions at once, from their values at a growing row of nodes.

Between the last two of four nodes the cubic through all four is integrated (the method of Adams and Moulton, for nodes at any
distance); the parabola through the last three gives the error estimate. Where an absolute value is wanted and its argument changes
sign between the nodes, the cubic is split at its root, so that the kink costs no accuracy.
"""

# mypy: ignore-errors
# (kernels are not Python: `kernels/compiler.py` gives their names a meaning)
from __future__ import annotations

from bgdsl.simulate.kernels.compiler import kernel
from bgdsl.simulate.kernels.kinds import Struct, fabs, real, reals, whole

__all__ = ["Sums", "fabs", "reals", "whole"]

Sums = Struct(
    "Sums",
    """whole terms, whole absolutes, reals totals, reals errors, reals largest, reals added, reals doubts,
    reals v0, reals v1, reals v2, reals v3, real t0, real t1, real t2, real t3, whole known, whole evaluations,
    real step_size, real step_error""",
)
"""The first `absolutes` terms are absolute values. added, doubts: work space. v3: where the values at the next node are to be put.
known: how many nodes there are (0 after `known = 0`: a new start). step_size, step_error: what the nodes since they were last zeroed
have added to all integrals and estimates."""


@kernel
def basis(a: real, b: real, p: real, q: real, r: real, s: real) -> real:
    """The integral over [a, b] of the cubic that is 1 at s and 0 at p, q, r."""
    c2 = -(p + q + r)
    c1 = p * q + p * r + q * r
    c0 = -(p * q * r)
    at_b = (((b / 4.0 + c2 / 3.0) * b + c1 / 2.0) * b + c0) * b
    at_a = (((a / 4.0 + c2 / 3.0) * a + c1 / 2.0) * a + c0) * a
    return (at_b - at_a) / ((s - p) * (s - q) * (s - r))


@kernel
def parabola(a: real, b: real, p: real, q: real, s: real) -> real:
    """The integral over [a, b] of the parabola that is 1 at s and 0 at p and q."""
    at_b = ((b / 3.0 - (p + q) / 2.0) * b + p * q) * b
    at_a = ((a / 3.0 - (p + q) / 2.0) * a + p * q) * a
    return (at_b - at_a) / ((s - p) * (s - q))


@kernel
def absolute(a: real, b: real, p: real, q: real, r: real, s: real, vp: real, vq: real, vr: real, vs: real, va: real, vb: real) -> real:
    """The integral over [a, b] of |c|, c being the cubic with four values at p, q, r, s; va and vb, at a and b, differ in sign."""
    d1 = (vq - vp) / (q - p)
    d2 = (vr - vq) / (r - q)
    d3 = (vs - vr) / (s - r)
    e1 = (d2 - d1) / (r - p)
    e2 = (d3 - d2) / (s - q)
    f1 = (e2 - e1) / (s - p)
    c3 = f1
    c2 = e1 - f1 * (p + q + r)
    c1 = d1 - e1 * (p + q) + f1 * (p * q + p * r + q * r)
    c0 = vp - d1 * p + e1 * p * q - f1 * p * q * r
    low = a
    high = b
    x = a + (b - a) * va / (va - vb)
    for _k in range(40):
        value = ((c3 * x + c2) * x + c1) * x + c0
        if value * va > 0.0:
            low = x
        else:
            high = x
        slope = (3.0 * c3 * x + 2.0 * c2) * x + c1
        move = 4.0 * (b - a)
        if slope != 0.0:
            move = value / slope
        x -= move
        if fabs(move) < 1e-14 * (b - a):
            break
        if not (low < x and x < high):
            x = (low + high) / 2.0
    start = (((c3 / 4.0 * a + c2 / 3.0) * a + c1 / 2.0) * a + c0) * a
    between = (((c3 / 4.0 * x + c2 / 3.0) * x + c1 / 2.0) * x + c0) * x
    end = (((c3 / 4.0 * b + c2 / 3.0) * b + c1 / 2.0) * b + c0) * b
    return fabs(between - start) + fabs(end - between)


@kernel
def sum_of_sizes(values: reals, n: whole) -> real:
    """The sum of absolute values, in four sums that do not wait for each other."""
    one = 0.0
    two = 0.0
    three = 0.0
    four = 0.0
    quarter = n // 4
    for k in range(quarter):
        one += fabs(values[4 * k])
        two += fabs(values[4 * k + 1])
        three += fabs(values[4 * k + 2])
        four += fabs(values[4 * k + 3])
    for k in range(4 * quarter, n):
        one += fabs(values[k])
    return (one + two) + (three + four)


@kernel
def add_interval(s: Sums, which: whole) -> None:
    """Add the integrals over the interval `which` (0, 1, 2) between the four nodes; places are counted from t2 in units of t3 - t2."""
    h = s.t3 - s.t2
    p = (s.t0 - s.t2) / h
    q = (s.t1 - s.t2) / h
    r = 0.0
    u = 1.0
    a = r
    b = u
    va = s.v2
    vb = s.v3
    if which == 0:
        a = p
        b = q
        va = s.v0
        vb = s.v1
    if which == 1:
        a = q
        b = r
        va = s.v1
        vb = s.v2
    w0 = h * basis(a, b, q, r, u, p)
    w1 = h * basis(a, b, p, r, u, q)
    w2 = h * basis(a, b, p, q, u, r)
    w3 = h * basis(a, b, p, q, r, u)
    x1 = h * parabola(a, b, r, u, q)
    x2 = h * parabola(a, b, q, u, r)
    x3 = h * parabola(a, b, q, r, u)
    v0 = s.v0
    v1 = s.v1
    v2 = s.v2
    v3 = s.v3
    absolutes = s.absolutes
    added = s.added
    doubts = s.doubts
    totals = s.totals
    errors = s.errors
    terms = s.terms
    for k in range(terms):
        value = w0 * v0[k] + w1 * v1[k] + w2 * v2[k] + w3 * v3[k]
        added[k] = value
        doubts[k] = fabs(value - (x1 * v1[k] + x2 * v2[k] + x3 * v3[k]))
    for k in range(absolutes):
        if va[k] * vb[k] < 0.0:
            added[k] = h * absolute(a, b, p, q, r, u, v0[k], v1[k], v2[k], v3[k], va[k], vb[k])
        added[k] = fabs(added[k])
    for k in range(terms):
        totals[k] += added[k]
        errors[k] += doubts[k]
    s.step_size += sum_of_sizes(added, terms)
    s.step_error += sum_of_sizes(doubts, terms)


@kernel
def absorb(s: Sums, t: real) -> None:
    """Take the values that stand in v3 as those at time t."""
    values = s.v3
    largest = s.largest
    for k in range(s.absolutes):
        value = fabs(values[k])
        largest[k] = value if value > largest[k] else largest[k]
    for k in range(s.absolutes, s.terms):
        value = values[k]
        largest[k] = value if value > largest[k] else largest[k]
    s.evaluations += 1
    s.t3 = t
    if s.known == 3:
        add_interval(s, 0)
        add_interval(s, 1)
    if s.known >= 3:
        add_interval(s, 2)
    s.known += 1
    oldest = s.v0
    s.v0 = s.v1
    s.v1 = s.v2
    s.v2 = s.v3
    s.v3 = oldest
    s.t0 = s.t1
    s.t1 = s.t2
    s.t2 = s.t3
