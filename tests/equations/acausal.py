"""An independent reading of a flat bond graph: every bond's effort and flow unknown, no causality, all equations solved at once.

Given the states, the unknowns are efforts and flows of all bond components, the algebraic signals, the states that are not
given (dependent storages), and the time derivatives of all of these. The equations are junction laws, element laws and signal
equations as they stand, and each of them differentiated once. They are solved by Gauss-Newton with least squares,
so that what is not determined (the rate of a multiplier) does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bgdsl.expr import ONE, ZERO, Expr, add, evaluate, partials, substitute, topological, var
from bgdsl.ir.elements import KINDS, component
from bgdsl.ir.graph import BondGraph


def acausal_equations(graph: BondGraph) -> list[Expr]:
    """Residuals over bond variables `bond.e`, `bond.f`, storage states and signals; `der(x)` stands for rates."""
    at = _bonds_at(graph)
    residuals: list[Expr] = []
    for junction in graph.junctions:
        for i in range(junction.size or 1):
            common, summed = ("f", "e") if junction.kind else ("e", "f")
            bonds = at.get((junction.name, 0, i), [])
            variable = var(junction.variable(i))
            residuals += [variable - var(f"{name}.{common}") for _, name in bonds]
            residuals.append(add(var(f"{name}.{summed}") if sign > 0 else -var(f"{name}.{summed}") for sign, name in bonds))
    for element in graph.elements:
        residuals += _element(element)
    residuals += [e.left - e.right for e in graph.equations]
    return list(substitute(residuals, port_variables(graph)))


def _bonds_at(graph: BondGraph) -> dict[tuple[str, int, int], list[tuple[int, str]]]:
    at: dict[tuple[str, int, int], list[tuple[int, str]]] = {}
    for bond in graph.bonds:
        for i in range(bond.width):
            name = component(bond.name, None if bond.size is None else i)
            for sign, end in ((-1, bond.tail), (1, bond.head)):
                at.setdefault((end.node, end.port, end.components[i]), []).append((sign, name))
    return at


def port_variables(graph: BondGraph) -> dict[Expr, Expr]:
    """The effort and flow of every element port as those of its bond."""
    at = _bonds_at(graph)
    return {
        var(port.variable(element.name, letter, i)): var(f"{at[element.name, k, i][0][1]}.{letter}")
        for element in graph.elements
        for k, port in enumerate(element.ports)
        for i in range(port.width)
        for letter in "ef"
    }


def _element(element) -> list[Expr]:  # type: ignore[no-untyped-def]
    def variables(k: int, letter: str) -> list[Expr]:
        port = element.ports[k]
        return [var(port.variable(element.name, letter, i)) for i in range(port.width)]

    residuals = [law.left - law.right for law in element.laws]
    if element.states:
        rates = variables(0, "e" if KINDS[element.kind].state == "p" else "f")
        residuals += [var(f"der({state})") - rate for state, rate in zip(element.states, rates, strict=True)]
    if element.modulus is not None:
        m = element.modulus
        rows, columns = range(len(m)), range(len(m[0]))
        e1, f1 = variables(0, "e"), variables(0, "f")
        if element.kind == "EJS":
            return residuals + [e1[i] - add(m[i][j] * f1[j] for j in columns) for i in rows]
        e2, f2 = variables(1, "e"), variables(1, "f")
        give2, take2 = (f2, e2) if "TF" in element.kind else (e2, f2)
        residuals += [give2[i] - add(m[i][j] * f1[j] for j in columns) for i in rows]
        residuals += [e1[j] - add(m[i][j] * take2[i] for i in rows) for j in columns]
    return residuals


def total_rate(root: Expr) -> Expr:
    """d/dt of the expression: the rate of each variable x is `der(x)`, rates of rates are `der(der(x))`."""
    rate: dict[Expr, Expr] = {}
    for node in topological((root,)):
        if node.op == "var":
            rate[node] = var(f"der({node.data})")
        elif node.op == "time":
            rate[node] = ONE
        else:
            rate[node] = add(p * rate[a] for p, a in zip(partials(node), node.args, strict=True)) if node.args else ZERO
    return rate[root]


def solve_acausal(
    graph: BondGraph,
    states: Mapping[str, float],
    parameters: Mapping[str, float],
    *,
    time: float = 0.0,
) -> dict[str, float]:
    """Every variable that solves the equations for the given values of the independent states."""
    first = acausal_equations(graph)
    # a state may be the effort or flow of a port; here it is that of its bond
    ports = {name.data: bond.data for name, bond in port_variables(graph).items()}
    states = {ports.get(name, name): value for name, value in states.items()}
    equations = [*first, *(total_rate(e) for e in first)]
    names = sorted({node.data for node in topological(equations) if node.op == "var"} - set(states))
    number = {name: j for j, name in enumerate(names)}
    slopes = [_gradient(e, number) for e in equations]
    z = np.zeros(len(names))
    for _ in range(60):
        known = {**states, **dict(zip(names, z.tolist(), strict=True))}
        residual = np.array([evaluate(e, known, time=time, tables=graph.tables, parameters=parameters) for e in equations])
        matrix = np.zeros((len(equations), len(names)))
        for i, row in enumerate(slopes):
            for j, value in row.items():
                matrix[i, j] = evaluate(value, known, time=time, tables=graph.tables, parameters=parameters)
        change, *_ = np.linalg.lstsq(matrix, residual, rcond=1e-12)
        z = z - change
        if np.max(np.abs(change), initial=0.0) < 1e-12 * (1.0 + np.max(np.abs(z), initial=0.0)):
            break
    assert np.max(np.abs(residual), initial=0.0) < 1e-7 * (1.0 + np.max(np.abs(z), initial=0.0)), (
        "the acausal equations have no solution here"
    )
    known = {**states, **dict(zip(names, z.tolist(), strict=True))}
    return known | {f"der({port})": known[f"der({bond})"] for port, bond in ports.items() if f"der({bond})" in known}


def residual_of(graph, values, direct, x, known):  # type: ignore[no-untyped-def]
    """The residuals of the acausal equations, variables that are no bond's taken from the program."""
    for equation in acausal_equations(graph):
        names = {node.data for node in topological((equation,)) if node.op == "var"}
        filled = {n: known[n] if n in known else direct.value(values[n], x) for n in names}
        yield evaluate(equation, {**known, **filled}, tables=graph.tables, parameters=direct.parameters)


def _gradient(root: Expr, number: Mapping[str, int]) -> dict[int, Expr]:
    slope: dict[Expr, dict[int, Expr]] = {}
    for node in topological((root,)):
        total: dict[int, Expr] = {number[node.data]: ONE} if node.op == "var" and node.data in number else {}
        if node.args:
            for p, arg in zip(partials(node), node.args, strict=True):
                for j, value in slope[arg].items():
                    total[j] = total.get(j, ZERO) + p * value
        slope[node] = total
    return slope[root]
