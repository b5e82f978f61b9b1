"""Differentiate what the equations hide: dependent storages and constraints between states.

Input        EquationSystem  with derivatives of algebraic variables wanted, and equations that no unknown is left for
Output       EquationSystem  square; such derivatives are unknowns with equations, such equations are invariants
Establishes  every equation without an unknown of its own is replaced by its time derivative, once
Reports      BG503 the derivative of an input is needed, BG504 the index is too high

A dependent storage wants `der(p)` of a momentum p that other states give; a constraint that no multiplier enters
algebraically has to hold for its derivative instead. Both come down to one closure: to differentiate an equation, the derivative
of every unknown in it is needed, and so the derivative of the equation that the unknown is matched with, and so on back to the states,
whose derivatives are unknowns already. Each variable of this cone gets one derivative variable and one equation,
so that nothing is expanded and the cost is linear in the size of the cone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import ONE, ZERO, Expr, add, partials, topological, var
from bgdsl.ir.system import Equation, EquationSystem, derivative_name, incidence
from bgdsl.passes.matching import FREE, match

INPUT_DERIVATIVE = Code("BG503", "the derivative of an input is needed")
HIGH_INDEX = Code("BG504", "the equations constrain the states too deeply")


def reduce_index(system: EquationSystem, report: Reporter) -> EquationSystem:
    """The system with its dependent storages and constraints differentiated; itself if there are none."""
    wanted = _wanted_derivatives(system)
    unknowns = tuple(name for name in system.unknowns if name not in wanted)
    number = {name: j for j, name in enumerate(unknowns)}
    rows = incidence(system.equations, unknowns)
    given = [FREE if e.assigned is None else number[e.assigned] for e in system.equations]
    matching = match(rows, len(unknowns), given)
    hidden = set(matching.unmatched_rows)
    if not wanted and not hidden:
        return system
    seeds = [*hidden, *(i for v in wanted.values() if (i := matching.row_of[number[v]]) != FREE)]
    cone = _cone(rows, matching.row_of, seeds)
    if any(_reads_any(system.equations[i], wanted) for i in cone):
        _report_high_index(system, [i for i in cone if _reads_any(system.equations[i], wanted)], report)
    names = [unknowns[matching.column_of[i]] for i in cone if i not in hidden]
    derived = _differentiate(system, [system.equations[i] for i in cone], names, report)
    report.stop_if_errors()
    return _replaced(system, cone, derived, hidden, names)


def _wanted_derivatives(system: EquationSystem) -> dict[str, str]:
    """The unknowns that are derivatives of other unknowns, with those."""
    algebraic = set(system.unknowns)
    return {derivative_name(v): v for v in system.unknowns if derivative_name(v) in algebraic}


def _cone(rows: list[list[int]], row_of: list[int], seeds: Iterable[int]) -> list[int]:
    """The rows whose derivatives are needed: the seeds and, for each unknown read, the row matched with it."""
    seen = set(seeds)
    stack = list(seen)
    while stack:
        for j in rows[stack.pop()]:
            i = row_of[j]
            if i != FREE and i not in seen:
                seen.add(i)
                stack.append(i)
    return sorted(seen)


def _reads_any(equation: Equation, names: Mapping[str, str]) -> bool:
    return any(node.op == "var" and node.data in names for node in topological((equation.left, equation.right)))


def _replaced(system: EquationSystem, cone: list[int], derived: list[Equation], hidden: set[int], names: list[str]) -> EquationSystem:
    present = set(system.unknowns)
    return EquationSystem(
        system.graph,
        system.states,
        (*system.unknowns, *(derivative_name(v) for v in names if derivative_name(v) not in present)),
        (*(e for i, e in enumerate(system.equations) if i not in hidden), *derived),
        system.values,
        system.dependent,
        tuple(system.equations[i] for i in cone if i in hidden),
        system.initial,
        system.guesses,
    )


# -------------------------------------------------------------------------------------------------------- differentiation


def _differentiate(system: EquationSystem, equations: list[Equation], names: Iterable[str], report: Reporter) -> list[Equation]:
    """The total time derivatives of the equations."""
    rate: dict[Expr, Expr] = {var(state.name): var(derivative_name(state.name)) for state in system.states}
    rate |= {var(v): var(derivative_name(v)) for v in names}
    inputs = {name for signal in system.graph.signals if signal.role == "input" for name in signal.scalars()}
    derived = []
    for equation in equations:
        needed = [n for n in inputs if _needs(equation, var(n), rate)] if inputs else []
        if needed:
            _report_input(system, equation, needed[0], report)
            continue
        left, right = rates((equation.left, equation.right), rate)
        assigned = None if equation.assigned is None else derivative_name(equation.assigned)
        derived.append(Equation(left, right, assigned, equation.element, equation.origin))
    return derived


def rates(roots: Iterable[Expr], known: dict[Expr, Expr]) -> list[Expr]:
    """The total time derivatives of the roots by the chain rule. `known` holds those of the variables, and is added to; what is
    not in it does not change in time."""
    roots = tuple(roots)
    for node in topological(roots, known):
        known[node] = ONE if node.op == "time" else _rate(node, known) if node.args else ZERO
    return [known[root] for root in roots]


def _rate(node: Expr, known: Mapping[Expr, Expr]) -> Expr:
    moving = [k for k, arg in enumerate(node.args) if not known[arg].is_zero]
    if not moving:
        return ZERO
    slopes = partials(node)
    return add(slopes[k] * known[node.args[k]] for k in moving)


def _needs(equation: Equation, leaf: Expr, rate: Mapping[Expr, Expr]) -> bool:
    """Whether the equation's derivative would need that of the leaf."""
    slope = rates((equation.left, equation.right), {leaf: ONE})
    return any(not value.is_zero for value in slope)


# --------------------------------------------------------------------------------------------------------- what is wrong


def _report_input(system: EquationSystem, equation: Equation, name: str, report: Reporter) -> None:
    origin = next(signal.origin for signal in system.graph.signals if name in signal.scalars())
    report.add(
        INPUT_DERIVATIVE,
        f"the derivative of input `{name}` is needed, and only its values are given",
        equation.origin.span,
        f"`{equation.element}` follows the input and has to be differentiated",
        others=[(origin.span, "the input")],
        notes=["a storage or a constraint whose state is fixed by the input takes part through the rate of change of that state"],
        helps=["let the input act through a C, R or I, so that no state is fixed by it", "or make it a state: `der(x) = (input - x)/T`"],
    )


def _report_high_index(system: EquationSystem, deep: list[int], report: Reporter) -> None:
    first = system.equations[deep[0]]
    report.add(
        HIGH_INDEX,
        f"`{first.element}` would have to be differentiated twice",
        first.origin.span,
        "its derivative depends on the derivative of a dependent storage",
        others=[(system.equations[i].origin.span, f"so does `{system.equations[i].element}`") for i in deep[1:5]],
        helps=["put a compliance or a resistance between the parts, so that their states are independent"],
    )
