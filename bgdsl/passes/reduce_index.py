"""Differentiate what the equations hide: dependent storages and constraints between states.

Input        EquationSystem  with derivatives of algebraic variables wanted, and equations that no unknown is left for
Output       EquationSystem  square; such derivatives are unknowns with equations, such equations are invariants
Establishes  every equation without an unknown of its own is replaced by its time derivative, once
Reports      BG503 the derivative of an input is needed (warning), BG504 the index is too high

A dependent storage wants `der(p)` of a momentum p that other states give; a constraint that no multiplier enters
algebraically has to hold for its derivative instead. Both come down to one closure: to differentiate an equation, the derivative
of every unknown in it is needed, and so the derivative of the equation that the unknown is matched with, and so on back to the states,
whose derivatives are unknowns already. Each variable of this cone gets one derivative variable and one equation,
so that nothing is expanded and the cost is linear in the size of the cone.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NoReturn

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import ONE, ZERO, Expr, add, partials, topological, var, variables
from bgdsl.ir.elements import KINDS
from bgdsl.ir.graph import Element, Origin
from bgdsl.ir.system import Equation, EquationSystem, State, derivative_name, incidence
from bgdsl.passes.matching import FREE, Matching, match, underdetermined

INPUT_DERIVATIVE = Code("BG503", "the derivative of an input is needed", "warning")
HIGH_INDEX = Code("BG504", "the equations constrain the states too deeply")


def reduce_index(system: EquationSystem, report: Reporter) -> EquationSystem:
    """The system with its dependent storages and constraints differentiated; itself if there are none."""
    first: list[Equation] = []
    tried = system
    while True:
        settled, deep = _reduced(tried, report)
        if not deep and not (first and _is_singular(settled)):
            return settled
        first = first or deep
        restored = _restored(tried, deep) if deep else None
        if restored is None:
            _report_high_index(first, report)
        tried = restored


def _reduced(system: EquationSystem, report: Reporter) -> tuple[EquationSystem, list[Equation]]:
    """The system reduced; or equations that would have to be differentiated a second time."""
    unknowns = set(system.unknowns)
    wanted = {derivative_name(v): v for v in system.unknowns if derivative_name(v) in unknowns}
    if not wanted:
        return _settle(system, (), set(), report)
    structure = _Structure.of(system, wanted)
    cone = structure.cone(structure.rows_of(wanted.values()))
    deep = [system.equations[i] for i in cone if _reads_any(system.equations[i], wanted)]
    if deep:
        return system, deep
    followed = _promote(_differentiated(system, structure, cone, report, hidden=()))
    rates = set(wanted) | set(followed.unknowns) - unknowns
    return _settle(followed, [system.equations[i] for i in cone], rates, report)


def _restored(system: EquationSystem, deep: Iterable[Equation]) -> EquationSystem | None:
    """Give the dependent storages whose derivatives the deep equations read their states back: their laws become open equations, so
    that a part whose modulus may vanish is divided by after all, in a block that is solved when it runs. None if there are none."""
    names = {name for name in system.dependent if any(_reads_any(e, (derivative_name(name),)) for e in deep)}
    if not names:
        return None
    elements = {state: element for element in system.graph.elements for state in element.states}
    states = tuple(_state_of(elements[name], name, system.dependent[name]) for name in system.dependent if name in names)
    rates = {derivative_name(name) for name in names}

    def turned(e: Equation) -> Equation:
        if e.right.op == "var" and e.right.data in rates:
            return Equation(e.right, e.left, e.right.data, e.element, e.origin)
        return replace(e, assigned=None) if e.assigned in names else e

    return replace(
        system,
        states=(*system.states, *states),
        unknowns=tuple(v for v in system.unknowns if v not in names),
        equations=tuple(map(turned, system.equations)),
        dependent={name: start for name, start in system.dependent.items() if name not in names},
    )


def _state_of(element: Element, name: str, start: Expr | None) -> State:
    kind = KINDS[element.kind].state
    assert kind is not None
    return State(name, start if start is not None else ZERO, "", element.comment, element.origin, kind, start is not None)


def _settle(system: EquationSystem, done: Iterable[Equation], rates: set[str], report: Reporter) -> tuple[EquationSystem, list[Equation]]:
    """Put the derivative in the place of each equation that no unknown is left for; the equation becomes an invariant.

    done: equations that have their derivatives in the system; rates: the unknowns that these brought: what reads one is not
    differentiated again.
    """
    structure = _Structure.of(system, ())
    hidden = structure.matching.unmatched_rows
    if not hidden:
        return system, []
    known = {id(equation) for equation in done}
    cone = [i for i in structure.cone(hidden) if id(system.equations[i]) not in known]
    deep = [system.equations[i] for i in cone if _reads_any(system.equations[i], rates)]
    return (system, deep) if deep else (_differentiated(system, structure, cone, report, hidden), [])


def _promote(system: EquationSystem) -> EquationSystem:
    """Make a state of each multiplier that only dependent storages follow: no equation gives it, but its derivative is read."""
    structure = _Structure.of(system, ())
    missing = len(structure.matching.unmatched_columns)
    if not missing:
        return system
    under = {structure.unknowns[j] for j in underdetermined(structure.rows, structure.matching)}
    given = {e.assigned for e in system.equations}
    origins = {j.variable(i): j.origin for j in system.graph.junctions for i in range(j.size or 1)}
    origins |= {
        p.variable(e.name, letter, i): e.origin for e in system.graph.elements for p in e.ports for letter in "ef" for i in range(p.width)
    }
    loose = [v for v in system.unknowns if v in under and v in origins and v not in given and derivative_name(v) in under][:missing]
    states = tuple(State(v, ZERO, "", "", origins[v], "common", fixed=False) for v in loose)
    return replace(system, states=(*system.states, *states), unknowns=tuple(v for v in system.unknowns if v not in loose))


@dataclass(frozen=True, slots=True)
class _Structure:
    """Which equation reads which unknown, and a maximum matching; some unknowns may be left out of it."""

    unknowns: tuple[str, ...]
    rows: list[list[int]]
    matching: Matching

    @staticmethod
    def of(system: EquationSystem, without: Container[str]) -> _Structure:
        unknowns = tuple(name for name in system.unknowns if name not in without)
        number = {name: j for j, name in enumerate(unknowns)}
        rows = incidence(system.equations, unknowns)
        given = [FREE if e.assigned is None else number[e.assigned] for e in system.equations]
        return _Structure(unknowns, rows, match(rows, len(unknowns), given))

    def rows_of(self, names: Iterable[str]) -> list[int]:
        """The rows matched with the unknowns, as far as there are any."""
        number = {name: j for j, name in enumerate(self.unknowns)}
        return [i for name in names if (i := self.matching.row_of[number[name]]) != FREE]

    def cone(self, seeds: Iterable[int]) -> list[int]:
        """The rows whose derivatives are needed: the seeds and, for each unknown read, the row matched with it."""
        seen = set(seeds)
        stack = list(seen)
        while stack:
            for j in self.rows[stack.pop()]:
                i = self.matching.row_of[j]
                if i != FREE and i not in seen:
                    seen.add(i)
                    stack.append(i)
        return sorted(seen)

    def read_by(self, rows: Iterable[int]) -> list[str]:
        """The unknowns that the rows read, in order."""
        return [self.unknowns[j] for j in sorted({j for i in rows for j in self.rows[i]})]


def _differentiated(
    system: EquationSystem, structure: _Structure, cone: list[int], report: Reporter, hidden: Iterable[int]
) -> EquationSystem:
    """The system with the derivatives of the rows of the cone beside (or, for hidden ones, in place of) them."""
    names = structure.read_by(cone)
    derived = _differentiate(system, [system.equations[i] for i in cone], names, report)
    report.stop_if_errors()
    gone = set(hidden)
    present = set(system.unknowns)
    return replace(
        system,
        unknowns=(*system.unknowns, *(derivative_name(v) for v in names if derivative_name(v) not in present)),
        equations=(*(e for i, e in enumerate(system.equations) if i not in gone), *derived),
        invariants=tuple(system.equations[i] for i in sorted(gone)),
        input_rates=_needed_rates(system, derived, report),
    )


def _is_singular(system: EquationSystem) -> bool:
    matching = _Structure.of(system, ()).matching
    return bool(matching.unmatched_rows or matching.unmatched_columns)


def _reads_any(equation: Equation, names: Container[str]) -> bool:
    return any(name in names for name in variables((equation.left, equation.right)))


# -------------------------------------------------------------------------------------------------------- differentiation


def _differentiate(system: EquationSystem, equations: list[Equation], names: Iterable[str], report: Reporter) -> list[Equation]:
    """The total time derivatives of the equations."""
    rate: dict[Expr, Expr] = {var(state.name): var(derivative_name(state.name)) for state in system.states}
    rate |= {var(v): var(derivative_name(v)) for v in names}
    inputs = [name for signal in system.graph.signals if signal.role == "input" for name in signal.scalars()]
    rate |= {var(v): var(derivative_name(v)) for v in inputs}
    before = [var(v) for v in system.input_rates]
    derived = []
    for equation in equations:
        if any(_needs(equation, leaf) for leaf in before):
            _report_high_index([equation], report)
        left, right = rates((equation.left, equation.right), rate)
        assigned = None if equation.assigned is None else derivative_name(equation.assigned)
        derived.append(Equation(left, right, assigned, equation.element, equation.origin))
    return derived


def _needed_rates(system: EquationSystem, derived: Iterable[Equation], report: Reporter) -> tuple[str, ...]:
    """The derivatives of inputs that the equations read. BG503 for each, once."""
    rates_of = {derivative_name(name): signal for signal in system.graph.signals if signal.role == "input" for name in signal.scalars()}
    if not rates_of:
        return ()
    found = dict.fromkeys(system.input_rates)
    for equation in derived:
        for name in variables((equation.left, equation.right)):
            if name in rates_of and name not in found:
                found[name] = None
                _report_input(equation, name, rates_of[name].origin, report)
    return tuple(found)


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


def _needs(equation: Equation, leaf: Expr) -> bool:
    """Whether the equation's derivative would need that of the leaf."""
    slope = rates((equation.left, equation.right), {leaf: ONE})
    return any(not value.is_zero for value in slope)


# --------------------------------------------------------------------------------------------------------- what is wrong


def _report_input(equation: Equation, name: str, origin: Origin, report: Reporter) -> None:
    report.add(
        INPUT_DERIVATIVE,
        f"the derivative of input `{name[4:-1]}` is needed",
        equation.origin.span,
        f"`{equation.element}` follows the input and has to be differentiated",
        others=[(origin.span, "the input")],
        notes=[f"where no `{name}` is given beside the input, it is the slope of the curve through the input's values"],
        helps=["nothing has to be done where the input is smooth; a C, R or I between makes the state its own"],
    )


def _report_high_index(deep: list[Equation], report: Reporter) -> NoReturn:
    first = deep[0]
    report.fail(
        HIGH_INDEX,
        f"`{first.element}` would have to be differentiated twice",
        first.origin.span,
        "its derivative depends on the derivative of a dependent storage",
        others=[(e.origin.span, f"so does that of `{e.element}`") for e in deep[1:5]],
        helps=["put a compliance or a resistance between the parts, so that their states are independent"],
    )
