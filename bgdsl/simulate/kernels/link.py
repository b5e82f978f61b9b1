"""Between CVODE's callbacks and a model's functions: N_Vectors become arrays, inputs are evaluated, trouble is remembered.

An N_Vector, SUNMatrix and SUNLinearSolver are each a record whose first field is its content; a serial N_Vector's content holds
the data pointer in its second word.
"""

# mypy: ignore-errors
# (kernels are not Python: `kernels/compiler.py` gives their names a meaning)
from __future__ import annotations

from bgdsl.simulate.kernels.compiler import kernel
from bgdsl.simulate.kernels.kinds import Callee, Struct, ints, place, places, real, reals, whole
from bgdsl.simulate.kernels.lu import Factors, lu_factor, lu_solve

__all__ = ["Factors", "Link", "call_model", "ints", "lu_factor", "lu_solve", "places", "whole"]

Link = Struct(
    "Link",
    """whole n, place rhs, place jacobian, place events, place context,
    reals u, whole signals, whole pieces, reals breaks, reals values, reals slopes, whole piece, whole with_rates,
    whole constants, reals settings,
    whole rhs_calls, whole jacobian_calls, whole factorisations,
    whole troubled, whole status, real trouble_time, reals trouble_state,
    reals entries, Factors factors, real gamma, whole repivot""",
)
"""What the callbacks of one run share. u: the inputs: `signals` by their values and slopes at the breaks, row by row, their rates
where these are inputs too, then settings, which are constant. entries: of the Jacobian. troubled: since the last good evaluation,
one was not finite or failed (`status`)."""

call_model = Callee("int", ("real", "reals", "reals", "reals", "place"))

WEAK_PIVOT = 1e-10


@kernel
def set_inputs(link: Link, t: real) -> None:
    """Put the inputs' values at t into link.u."""
    u = link.u
    m = link.signals
    if m != 0:
        set_signals(link, t)
        u = u + m
        if link.with_rates:
            u = u + m
    for i in range(link.constants):
        u[i] = link.settings[i]


@kernel
def set_signals(link: Link, t: real) -> None:
    """The signals at t: cubics by values and slopes at both ends of a piece, which is found from the last one."""
    piece = link.piece
    while piece + 1 < link.pieces and t >= link.breaks[piece + 1]:
        piece += 1
    while piece > 0 and t < link.breaks[piece]:
        piece -= 1
    link.piece = piece
    m = link.signals
    h = link.breaks[piece + 1] - link.breaks[piece]
    p = (t - link.breaks[piece]) / h
    q = 1.0 - p
    y = link.values + piece * m
    s = link.slopes + piece * m
    blend(m, link.u, q * q * (1.0 + 2.0 * p), y, p * p * (1.0 + 2.0 * q), y + m, h * p * q * q, s, -h * p * p * q, s + m)
    if link.with_rates:
        c = 6.0 * p * q / h
        blend(m, link.u + m, -c, y, c, y + m, q * (1.0 - 3.0 * p), s, p * (1.0 - 3.0 * q), s + m)


@kernel
def blend(m: whole, target: reals, a: real, v: reals, b: real, w: reals, c: real, x: reals, d: real, y: reals) -> None:
    """target := a v + b w + c x + d y"""
    for k in range(m):
        target[k] = (a * v[k] + b * w[k]) + (c * x[k] + d * y[k])


@kernel
def all_finite(x: reals, n: whole) -> int:
    """1 if no entry is infinite or NaN."""
    a = 0.0
    b = 0.0
    c = 0.0
    d = 0.0
    i = 0
    while i + 3 < n:
        a += x[i] * 0.0
        b += x[i + 1] * 0.0
        c += x[i + 2] * 0.0
        d += x[i + 3] * 0.0
        i += 4
    while i < n:
        a += x[i] * 0.0
        i += 1
    return (a + b) + (c + d) == 0.0


@kernel
def evaluate(link: Link, t: real, x: reals, dx: reals) -> int:
    """dx := rhs(t, x). 0, or 1 where it failed or is not finite; the first such place is remembered until the next good one."""
    link.rhs_calls += 1
    set_inputs(link, t)
    status = call_model(link.rhs, t, x, link.u, dx, link.context)
    if status == 0 and all_finite(dx, link.n):
        link.troubled = 0
        return 0
    if link.troubled == 0:
        link.troubled = 1
        link.status = status
        link.trouble_time = t
        for i in range(link.n):
            link.trouble_state[i] = x[i]
    return 1


@kernel
def cv_rhs(t: real, y: places, dy: places, link: Link) -> int:
    """CVRhsFn."""
    return evaluate(link, t, reals(places(y[0])[1]), reals(places(dy[0])[1]))


@kernel
def cv_root(t: real, y: places, g: reals, link: Link) -> int:
    """CVRootFn."""
    set_inputs(link, t)
    return call_model(link.events, t, reals(places(y[0])[1]), link.u, g, link.context)


@kernel
def cv_linsys(
    t: real, y: places, fy: place, matrix: place, keep: int, fresh: ints, gamma: real, link: Link, a: place, b: place, c: place
) -> int:
    """CVLsLinSysFn: a new Jacobian unless the old one will do; the factorisation itself is the linear solver's setup."""
    fresh[0] = 0
    link.gamma = gamma
    if keep == 0:
        set_inputs(link, t)
        link.jacobian_calls += 1
        status = call_model(link.jacobian, t, reals(places(y[0])[1]), link.u, link.entries, link.context)
        fresh[0] = 1
        if status != 0:
            return 1
    return 0


@kernel
def ls_setup(solver: places, matrix: place) -> int:
    """Factorise I - gamma J. Weak pivots stop the run for a new pivot order (`repivot`)."""
    link = Link(solver[0])
    link.factorisations += 1
    failed = lu_factor(link.factors, link.entries, link.gamma)
    if failed != 0 or not link.factors.growth > WEAK_PIVOT:
        if all_finite(link.entries, link.factors.entries) == 0:
            return 1
        link.repivot = 1
        return -1
    return 0


@kernel
def ls_solve(solver: places, matrix: place, x: places, b: places, tolerance: real) -> int:
    """Solve with the factors at hand."""
    link = Link(solver[0])
    lu_solve(link.factors, reals(places(b[0])[1]), reals(places(x[0])[1]))
    return 0


@kernel
def ls_kind(solver: place) -> int:
    """SUNLINEARSOLVER_DIRECT."""
    return 0


@kernel
def matrix_kind(matrix: place) -> int:
    """SUNMATRIX_CUSTOM."""
    return 6
