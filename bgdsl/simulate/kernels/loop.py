"""The run itself, between two returns to Python: steps of CVODE, rows at the grid, integrals over each step."""

# mypy: ignore-errors
# (kernels are not Python: `kernels/compiler.py` gives their names a meaning)
from __future__ import annotations

from bgdsl.simulate.kernels.compiler import Callee, Struct, fabs, kernel, places, real, reals
from bgdsl.simulate.kernels.link import Link, call_model, set_inputs

__all__ = ["Link", "Loop", "fabs", "places"]

Loop = Struct(
    "Loop",
    """Link link, place advance, place interpolate, place memory, place y, places scratch, reals clock,
    real t_old, real stop, whole steps, whole budget, whole flag, whole pending,
    whole row_next, whole row_count, real row_start, real row_interval, whole row_fill, whole row_capacity,
    reals row_times, reals rows, whole columns, place row_kernel, whole keep, reals states,
    whole terms, real window_start, real window_stop, place integrands, octets absolute,
    reals totals, reals errors, reals smallest, reals largest, reals left, reals inner, reals right, reals sums,
    whole have_left, real left_time, whole panels, whole stride, whole evaluations, place after_step""",
)
"""clock: the current time, one number. y, scratch: N_Vectors. left, right: integrands at the ends of a panel (terms); inner: at
its inner nodes (2 terms); sums: of a whole panel, of its halves (3 terms). pending: a step is taken but not yet looked at."""

call_cvode = Callee("int", ("place", "real", "place", "reals", "int"))
call_dky = Callee("int", ("place", "real", "int", "place"))
call_after = Callee("int", ("Loop",))

DONE = 1
ROOT = 2
FULL = 3
BROKEN = 4
INNER = 5.0**-0.5


@kernel
def dense_state(loop: Loop, t: real) -> int:
    """Put the states at t, inside the last step, into the scratch vector, and the inputs in place."""
    status = call_dky(loop.interpolate, loop.memory, t, 0, loop.scratch)
    set_inputs(loop.link, t)
    return status


@kernel
def record(loop: Loop) -> int:
    """The rows up to the current time. 0, FULL or BROKEN."""
    link = loop.link
    x = reals(places(loop.scratch[0])[1])
    while loop.row_next < loop.row_count:
        t = loop.stop
        if loop.row_next < loop.row_count - 1:
            t = loop.row_start + loop.row_next * loop.row_interval
        if t > loop.clock[0]:
            return 0
        if loop.row_fill == loop.row_capacity:
            return FULL
        if dense_state(loop, t) != 0:
            return BROKEN
        k = loop.row_fill
        loop.row_times[k] = t
        link.status = call_model(loop.row_kernel, t, x, link.u, loop.rows + k * loop.columns, link.context)
        if link.status != 0:
            return BROKEN
        if loop.keep != 0:
            for i in range(link.n):
                loop.states[k * link.n + i] = x[i]
        loop.row_fill = k + 1
        loop.row_next += 1
    return 0


@kernel
def absolute_cubic(v0: real, v1: real, v2: real, v3: real) -> real:
    """The integral over [-1, 1] of |p|, p being the cubic with these values at the Lobatto nodes."""
    even = (v0 + v3) / 2.0
    odd = (v3 - v0) / 2.0
    c2 = (even - (v1 + v2) / 2.0) / 0.8
    c0 = even - c2
    c3 = (odd - (v2 - v1) / (2.0 * INNER)) / 0.8
    c1 = odd - c3
    total = 0.0
    a = -1.0
    va = v0
    for i in range(3):
        b = 1.0
        vb = v3
        if i == 0:
            b = -INNER
            vb = v1
        if i == 1:
            b = INNER
            vb = v2
        start = (((c3 / 4.0 * a + c2 / 3.0) * a + c1 / 2.0) * a + c0) * a
        end = (((c3 / 4.0 * b + c2 / 3.0) * b + c1 / 2.0) * b + c0) * b
        if va * vb >= 0.0:
            total += fabs(end - start)
        else:
            low = a
            high = b
            r = a + (b - a) * va / (va - vb)
            for _k in range(30):
                p = ((c3 * r + c2) * r + c1) * r + c0
                if p * va > 0.0:
                    low = r
                else:
                    high = r
                slope = (3.0 * c3 * r + 2.0 * c2) * r + c1
                move = 3.0
                if slope != 0.0:
                    move = p / slope
                r -= move
                if fabs(move) < 1e-14:
                    break
                if not (low < r and r < high):
                    r = (low + high) / 2.0
            between = (((c3 / 4.0 * r + c2 / 3.0) * r + c1 / 2.0) * r + c0) * r
            total += fabs(between - start) + fabs(end - between)
        a = b
        va = vb
    return total


@kernel
def integrand(loop: Loop, t: real, out: reals) -> int:
    """The integrands at t; their extremes are kept."""
    link = loop.link
    if dense_state(loop, t) != 0:
        return BROKEN
    loop.evaluations += 1
    link.status = call_model(loop.integrands, t, reals(places(loop.scratch[0])[1]), link.u, out, link.context)
    if link.status != 0:
        return BROKEN
    for k in range(loop.terms):
        value = fabs(out[k]) if loop.absolute[k] != 0 else out[k]
        loop.smallest[k] = value if value < loop.smallest[k] else loop.smallest[k]
        loop.largest[k] = value if value > loop.largest[k] else loop.largest[k]
    return 0


@kernel
def panel(loop: Loop, a: real, b: real, left: reals, right: reals, sums: reals) -> int:
    """sums := the integrals over [a, b]; left: the integrands at a; right: takes those at b."""
    middle = (a + b) / 2.0
    half = (b - a) / 2.0
    n = loop.terms
    v1 = loop.inner
    v2 = loop.inner + n
    failed = integrand(loop, middle - half * INNER, v1)
    if failed == 0:
        failed = integrand(loop, middle + half * INNER, v2)
    if failed == 0:
        failed = integrand(loop, b, right)
    if failed != 0:
        return BROKEN
    for k in range(n):
        p = left[k]
        q = v1[k]
        r = v2[k]
        s = right[k]
        value = (p + s + 5.0 * (q + r)) / 6.0
        if loop.absolute[k] != 0:
            some = p > 0.0 or q > 0.0 or r > 0.0 or s > 0.0
            others = p < 0.0 or q < 0.0 or r < 0.0 or s < 0.0
            value = absolute_cubic(p, q, r, s) if some and others else fabs(value)
        sums[k] = half * value
    return 0


@kernel
def integrate(loop: Loop) -> int:
    """The last step's share of the integrals. 0 or BROKEN."""
    a = loop.t_old if loop.t_old > loop.window_start else loop.window_start
    b = loop.clock[0] if loop.clock[0] < loop.window_stop else loop.window_stop
    if b <= a:
        return 0
    n = loop.terms
    if (loop.have_left == 0 or loop.left_time != a) and integrand(loop, a, loop.left) != 0:
        return BROKEN
    whole_sum = loop.sums
    if panel(loop, a, b, loop.left, loop.right, whole_sum) != 0:
        return BROKEN
    if loop.panels % loop.stride == 0:
        middle = (a + b) / 2.0
        first = loop.sums + n
        second = first + n
        if panel(loop, a, middle, loop.left, loop.right, first) != 0:
            return BROKEN
        for k in range(n):
            loop.left[k] = loop.right[k]
        if panel(loop, middle, b, loop.left, loop.right, second) != 0:
            return BROKEN
        for k in range(n):
            fine = first[k] + second[k]
            loop.errors[k] += loop.stride * fabs(fine - whole_sum[k])
            whole_sum[k] = fine
    for k in range(n):
        loop.totals[k] += whole_sum[k]
        loop.left[k] = loop.right[k]
    loop.panels += 1
    loop.have_left = 1
    loop.left_time = b
    return 0


@kernel
def travel(loop: Loop) -> int:
    """Go on until something is up: 0 the budget of steps is used, DONE, ROOT, FULL, BROKEN; negative: what CVODE said."""
    while True:
        if loop.pending == 0:
            if loop.clock[0] >= loop.stop:
                return DONE
            if loop.budget == 0:
                return 0
            loop.budget -= 1
            loop.t_old = loop.clock[0]
            loop.flag = call_cvode(loop.advance, loop.memory, loop.stop, loop.y, loop.clock, 2)
            if loop.flag < 0:
                return loop.flag
            loop.steps += 1
            if loop.after_step:
                failed = call_after(loop.after_step, loop)
                if failed != 0:
                    return failed
            loop.pending = 1
        stopped = record(loop)
        if stopped != 0:
            return stopped
        if loop.terms != 0 and integrate(loop) != 0:
            return BROKEN
        loop.pending = 0
        if loop.flag == ROOT:
            return ROOT
    return 0
