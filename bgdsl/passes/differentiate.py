"""Differentiate a program exactly: sparse gradients carried forward through its steps.

Input        Program         its steps, derivatives
Output       Jacobian        with the variables of solved blocks as extra columns, their residuals as extra rows
Establishes  each entry is exact; entries that are identically zero are absent; the cost is linear in the size of the result
Reports      nothing

Every node of the shared expression graph gets one gradient, a dictionary from column to slope, from those of its operands.
A variable assigned by a step carries the gradient of its value; a variable of a solved block is a column of its own, so that
no gradient passes through a solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from bgdsl.expr import MINUS_ONE, ONE, ZERO, Expr, add, const, partials, topological, var
from bgdsl.ir.program import Assign, Jacobian, Program, SolveLinear, SolveNewton, Sparse, Step

Gradient = Mapping[int, Expr]
"""The nonzero slopes of one expression, by column."""
Slopes = Callable[[Expr], tuple[Expr, ...]]

_NONE: Gradient = {}
TINY = const(1e-300)
"""Nothing beside any number, and not zero."""


def jacobian(program: Program) -> Jacobian:
    """The exact Jacobian of the state derivatives, rows and columns as `ir.program.Jacobian` says."""
    n = len(program.states)
    known: dict[Expr, Gradient] = {var(record.name): {i: ONE} for i, record in enumerate(program.states)}
    solved: list[Gradient] = []
    for step in program.needed(program.derivatives):
        solved += _advance(step, known, n + len(solved))
    rows = [*gradients(program.derivatives, known, _finite), *solved]
    entries = tuple((i, j, row[j]) for i, row in enumerate(rows) for j in sorted(row))
    return Jacobian(Sparse((len(rows), n + len(solved)), entries), n)


def _advance(step: Step, known: dict[Expr, Gradient], column: int) -> list[Gradient]:
    """Record the gradients of what the step defines; return those of its residuals. `column` is the first free column."""
    match step:
        case Assign():
            known[var(step.variable)] = gradients((step.value,), known, _finite)[0]
            return []
        case SolveLinear():
            residuals = _linear_residuals(step, known)
            for k, name in enumerate(step.variables):
                known[var(name)] = {column + k: ONE}
            for i, j, value in step.entries:
                residuals[i][column + j] = value
            return list(residuals)
        case SolveNewton():
            for k, name in enumerate(step.variables):
                known[var(name)] = {column + k: ONE}
            for assign in step.inner:
                known[var(assign.variable)] = gradients((assign.value,), known, _finite)[0]
            return gradients(step.residuals, known, _finite)


def _linear_residuals(step: SolveLinear, known: dict[Expr, Gradient]) -> list[dict[int, Expr]]:
    """The gradients of A z - b with z held."""
    shares: list[list[tuple[Expr, Gradient]]] = [[(MINUS_ONE, g)] for g in gradients(step.right, known, _finite)]
    slopes = gradients((value for _, _, value in step.entries), known, _finite)
    for (i, j, _), slope in zip(step.entries, slopes, strict=True):
        if slope:
            shares[i].append((var(step.variables[j]), slope))
    return [dict(_combine(row)) for row in shares]


def gradients(roots: Iterable[Expr], known: dict[Expr, Gradient], slopes: Slopes = partials) -> list[Gradient]:
    """The gradients of the roots. `known` holds those of the variables; nodes met on the way are added to it. slopes: the partial
    derivatives of a node."""
    roots = tuple(roots)
    for node in topological(roots, known):
        known[node] = _gradient(node, known, slopes) if node.args else _NONE
    return [known[root] for root in roots]


def _gradient(node: Expr, known: Mapping[Expr, Gradient], slopes: Slopes) -> Gradient:
    moving = [k for k, arg in enumerate(node.args) if known[arg]]
    if not moving:
        return _NONE
    if node.op == "add" and len(moving) == 1:
        return known[node.args[moving[0]]]
    partial = slopes(node)
    return _combine([(partial[k], known[node.args[k]]) for k in moving if not partial[k].is_zero])


def _finite(node: Expr) -> tuple[Expr, ...]:
    """The partial derivatives. Where a root stands upright its slope is told as 0: that of `sqrt(abs(x))` would be no number."""
    if node.op == "sqrt":
        return (const(0.5) * node / (node.args[0] + TINY),)
    if node.op == "pow" and node.args[1].is_const and 0.0 < node.args[1].data < 1.0:
        return node.args[1] * node / (node.args[0] + TINY), ZERO
    return partials(node)


def _combine(shares: Sequence[tuple[Expr, Gradient]]) -> Gradient:
    """The sum of factor x gradient over the shares, each column summed at once."""
    if len(shares) == 1:
        factor, gradient = shares[0]
        return gradient if factor is ONE else {j: factor * slope for j, slope in gradient.items()}
    columns: dict[int, list[Expr]] = {}
    for factor, gradient in shares:
        for j, slope in gradient.items():
            columns.setdefault(j, []).append(factor * slope)
    sums = {j: add(terms) for j, terms in columns.items()}
    return {j: total for j, total in sums.items() if not total.is_zero}
