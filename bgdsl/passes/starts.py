"""Where a run begins: which states are free to satisfy initial equations.

Input        EquationSystem  with initial equations, and starts given to dependent storages
Output       EquationSystem  that of the initial instant: freed states are unknowns, initial equations are equations
Establishes  as many states are freed as there are initial equations; states without a start of their own go first
Reports      BG507 an initial equation that no state can satisfy
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bgdsl.diagnostics import Code, Reporter, listed
from bgdsl.expr import to_text, var
from bgdsl.ir.graph import Origin
from bgdsl.ir.system import Equation, EquationSystem, State, incidence
from bgdsl.passes.matching import FREE, Matching, match

NO_FREE_STATE = Code("BG507", "an initial equation has no state left to determine")


def initial_system(system: EquationSystem, report: Reporter) -> EquationSystem | None:
    """The equations of the initial instant; None where every start is given by a formula."""
    stated = [Equation(e.left, e.right, None, to_text(e.left), e.origin) for e in system.initial]
    followed = [] if all(s.fixed for s in system.states) else _dependent_starts(system)
    if not stated and not followed:
        return None
    states = sorted(system.states, key=lambda s: s.fixed)
    names = (*system.unknowns, *(s.name for s in states))
    loose = len(system.unknowns) + sum(not s.fixed for s in states)
    # initial equations come first to the states without a start, then starts of dependent storages, then initial equations to any state
    known = len(system.equations) + len(stated)
    number = {name: j for j, name in enumerate(names)}
    assigned = [FREE if e.assigned is None else number[e.assigned] for e in system.equations]
    # the unknowns come first of all, or an equation of several might take a state for itself and leave its unknown
    settled = _matched(system.equations, names, len(system.unknowns), assigned)
    given = [*settled.column_of, *(FREE for _ in (*stated, *followed))]
    matching = _matched([*system.equations, *stated, *followed], names, loose, given)
    followed = [e for e, j in zip(followed, matching.column_of[known:], strict=True) if j != FREE]
    equations = (*system.equations, *stated, *followed)
    matching = match(incidence(equations, names), len(names), [j for i, j in enumerate(matching.column_of) if i < known or j != FREE])
    _report_unmatched(system, stated, matching, report)
    freed = {names[j] for j in range(len(system.unknowns), len(names)) if matching.row_of[j] != FREE}
    return replace(
        system,
        states=tuple(s for s in system.states if s.name not in freed),
        unknowns=(*system.unknowns, *(s.name for s in system.states if s.name in freed)),
        equations=equations,
        initial=(),
        guesses={**system.guesses, **{s.name: s.start for s in system.states}},
    )


def _matched(equations: Sequence[Equation], names: Sequence[str], columns: int, given: Sequence[int]) -> Matching:
    """A maximum matching with the first `columns` names that begins with the one given; what that matches stays matched."""
    return match([[j for j in row if j < columns] for row in incidence(equations, names)], len(names), given)


def _dependent_starts(system: EquationSystem) -> list[Equation]:
    origins = {element.name: element.origin for element in system.graph.elements}
    return [Equation(var(name), start, None, name, _origin(origins, name)) for name, start in system.dependent.items() if start is not None]


def _origin(origins: dict[str, Origin], name: str) -> Origin:
    return origins[name.rpartition(".")[0]]


def _report_unmatched(system: EquationSystem, stated: list[Equation], matching: Matching, report: Reporter) -> None:
    for i, equation in enumerate(stated, len(system.equations)):
        if matching.column_of[i] == FREE:
            report.add(
                NO_FREE_STATE,
                "this initial equation has no state left to determine",
                equation.origin.span,
                "",
                notes=[_states_text(system.states), f"there are {len(stated)} initial equations"],
                helps=["an initial equation fixes the start of one state that it depends on; remove one that says the same as another"],
            )


def _states_text(states: tuple[State, ...]) -> str:
    return f"the states are {listed(s.name for s in states)}" if states else "the model has no states"
