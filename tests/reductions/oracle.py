"""The full model's equations less some terms, solved numerically without any of the compiler's passes behind the scalar graph.

What a conditioned model must be equal to: every junction balance without its dropped terms, every other equation kept.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bgdsl.expr import Expr, evaluate, leaves, substitute, var
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.condition import parameter_values


def derivatives(scalar: ScalarGraph, dropped: frozenset[int], gone: frozenset[str], states: Mapping[str, float]) -> dict[str, float]:
    """The derivative of every storage state of the elements that stay; laws have to be linear in the unknowns.

    gone: elements that are removed with their terms.
    """
    graph = scalar.graph
    known = solution(scalar, dropped, gone, states)
    found: dict[str, float] = {}
    for element in graph.elements:
        for i, state in enumerate(element.states if element.name not in gone else ()):
            letter = "e" if state.rpartition(".")[2].startswith("p") else "f"
            (value,) = _expanded([var(element.ports[0].variable(element.name, letter, i))], scalar)
            found[state] = evaluate(value, known)
    for signal in graph.signals:
        found |= {name: known[f"der({name})"] for name in signal.scalars() if f"der({name})" in known}
    return found


def solution(scalar: ScalarGraph, dropped: frozenset[int], gone: frozenset[str], states: Mapping[str, float]) -> dict[str, float]:
    """Every unknown, with the states and parameters."""
    graph = scalar.graph
    residuals: list[Expr] = []
    for at in scalar.terms_at:
        terms = [scalar.terms[t] for t in at if t not in dropped]
        residuals.append(sum((t.conjugate if t.sign > 0 else -t.conjugate for t in terms), start=_ZERO))
    residuals += [relation.left - relation.right for relation in scalar.relations]
    elements = [element for element in graph.elements if element.name not in gone]
    residuals += [law.left - law.right for element in elements for law in element.laws]
    residuals += [e.left - e.right for e in graph.equations]
    residuals = list(_expanded(residuals, scalar))
    lost = [(element, port) for element in graph.elements if element.name in gone for port in element.ports]
    removed = {port.variable(element.name, letter, i) for element, port in lost for letter in "efpq" for i in range(port.width)}
    names = sorted({leaf.data for leaf in leaves(residuals)} - set(states) - removed)
    assert len(names) == len(residuals), (len(names), len(residuals), names)
    values = {**parameter_values(graph), **dict.fromkeys(removed, 0.0), **states}
    return {**values, **_solve(residuals, names, values)}


_ZERO = var("x") - var("x")


def _expanded(roots: list[Expr], scalar: ScalarGraph) -> tuple[Expr, ...]:
    done = tuple(roots)
    while True:
        aliased = {leaf: scalar.aliases[leaf.data] for leaf in leaves(done) if leaf.data in scalar.aliases}
        if not aliased:
            return done
        done = substitute(done, aliased)


def _solve(residuals: list[Expr], names: list[str], values: Mapping[str, float]) -> dict[str, float]:
    def at(x: np.ndarray) -> np.ndarray:
        known = {**values, **dict(zip(names, x.tolist(), strict=True))}
        return np.array([evaluate(r, known) for r in residuals])

    n = len(names)
    x = np.zeros(n)
    for _ in range(8):  # differences of one are exact slopes of what is linear in each unknown
        base = at(x)
        if np.abs(base).max() <= 1e-12 * max(1.0, np.abs(x).max()):
            break
        x = x - np.linalg.solve(np.array([at(x + row) - base for row in np.eye(n)]).T, base)
    assert np.abs(at(x)).max() <= 1e-9 * max(1.0, np.abs(x).max()), "the laws are not linear in each of the unknowns"
    return dict(zip(names, x.tolist(), strict=True))
