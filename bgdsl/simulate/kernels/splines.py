"""C2 cubic splines through the rows of a table, by their slopes at the knots."""

# mypy: ignore-errors
# (kernels are not Python: `kernels/compiler.py` gives their names a meaning)
from __future__ import annotations

from bgdsl.simulate.kernels.compiler import kernel
from bgdsl.simulate.kernels.kinds import real, reals, whole

__all__ = ["real", "reals", "whole"]


@kernel
def chord(x: reals, i: whole) -> real:
    """The length of the piece behind knot i."""
    return x[i + 1] - x[i]


@kernel
def combine(m: whole, target: reals, p: real, y0: reals, q: real, y1: reals, r: real, y2: reals) -> None:
    """target := p y0 + q y1 + r y2"""
    for k in range(m):
        target[k] = p * y0[k] + q * y1[k] + r * y2[k]


@kernel
def take_off(m: whole, target: reals, factor: real, source: reals) -> None:
    """target -= factor * source"""
    for k in range(m):
        target[k] -= factor * source[k]


@kernel
def shrink(m: whole, target: reals, factor: real) -> None:
    """target *= factor"""
    for k in range(m):
        target[k] *= factor


@kernel
def spline_slopes(n: whole, m: whole, x: reals, y: reals, s: reals, beyond: reals) -> None:
    """s (n, m) := the slopes at the n > 1 knots x of the splines through the m columns of y (n, m), so that second derivatives are
    continuous; the third too at the second knots from both ends, or with fewer than four knots second derivatives vanish at the ends.
    `beyond` (n) is to work with: in row i what is left of the slope at i + 1."""
    last = n - 1
    h = chord(x, 0)
    if n < 4:
        combine(m, s, -1.5 / h, y, 1.5 / h, y + m, 0.0, y)
        beyond[0] = 0.5
    else:
        g = chord(x, 1)
        d = h + g
        a = (h + 2.0 * d) / (d * h)
        b = h * h / (d * g * g)
        combine(m, s, -a, y, a - b, y + m, b, y + 2 * m)
        beyond[0] = d / g
    for i in range(1, last):
        h = chord(x, i - 1)
        g = chord(x, i)
        a = 3.0 * g / h
        b = 3.0 * h / g
        row = s + i * m
        combine(m, row, -a, y + (i - 1) * m, a - b, y + i * m, b, y + (i + 1) * m)
        take_off(m, row, g, s + (i - 1) * m)
        pivot = 1.0 / (2.0 * (h + g) - g * beyond[i - 1])
        shrink(m, row, pivot)
        beyond[i] = h * pivot
    row = s + last * m
    before = s + (last - 1) * m
    y0 = y + last * m
    y1 = y + (last - 1) * m
    h = chord(x, last - 1)
    if n < 4:
        combine(m, row, 3.0 / h, y0, -3.0 / h, y1, 0.0, y0)
        take_off(m, row, 1.0, before)
        shrink(m, row, 1.0 / (2.0 - beyond[last - 1]))
    else:
        g = chord(x, last - 2)
        d = h + g
        a = (h + 2.0 * d) * g / (d * h)
        b = h * h / (d * g)
        combine(m, row, a, y0, b - a, y1, -b, y + (last - 2) * m)
        take_off(m, row, d, before)
        shrink(m, row, 1.0 / (g - d * beyond[last - 1]))
    for back in range(1, n):
        i = last - back
        take_off(m, s + i * m, beyond[i], s + (i + 1) * m)
