"""Sort equations into blocks that can be solved one after another.

Input        EquationSystem  without hidden constraints
Output       SortedSystem    blocks in evaluation order
Establishes  each unknown is solved in exactly one block; a block reads only itself and earlier blocks; loops are torn
Reports      BG501 too many equations for their unknowns, BG502 too few equations for their unknowns

Causality has assigned most equations to an unknown, so the matching starts nearly complete. Strong components do not depend
on which perfect matching was found; inside a component the assignments of causality are kept, what they leave open (ideal
constraints and their multipliers, rows of matrix laws) is torn, and then what is left of cycles.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import Expr, to_text, topological, var
from bgdsl.ir.system import Block, Equation, EquationSystem, SortedSystem, incidence
from bgdsl.passes.blocks import strong_components
from bgdsl.passes.invert import solve_for
from bgdsl.passes.matching import FREE, Matching, Rows, match, overdetermined, underdetermined
from bgdsl.passes.moduli import Moduli
from bgdsl.passes.starts import initial_system
from bgdsl.passes.tearing import tear

OVERDETERMINED = Code("BG501", "more equations than unknowns")
UNDERDETERMINED = Code("BG502", "fewer equations than unknowns")


def sort_equations(system: EquationSystem, report: Reporter) -> SortedSystem:
    """The blocks of the system and of its initial instant, each with as few torn unknowns as could be found."""
    blocks = _blocks(system, report)
    report.stop_if_errors()
    initial = initial_system(system, report)
    report.stop_if_errors()
    return SortedSystem(system, blocks, None if initial is None else SortedSystem(initial, _blocks(initial, report)))


def _blocks(system: EquationSystem, report: Reporter) -> tuple[Block, ...]:
    rows = incidence(system.equations, system.unknowns)
    matching = match(rows, len(system.unknowns), assignments(system))
    _report_singular(system, rows, matching, report)
    report.stop_if_errors()
    reads = [[i for j in row if (i := matching.row_of[j]) != k] for k, row in enumerate(rows)]
    components = strong_components(reads)
    moduli = Moduli(system.graph)
    return tuple(_block(system, component, matching, moduli) for component in components)


def assignments(system: EquationSystem) -> list[int]:
    """For each equation the number of the unknown that causality gave it, or FREE."""
    number = {name: j for j, name in enumerate(system.unknowns)}
    return [FREE if e.assigned is None else number[e.assigned] for e in system.equations]


def _block(system: EquationSystem, component: Sequence[int], matching: Matching, moduli: Moduli) -> Block:
    equations = [system.equations[i] for i in component]
    unknowns = [system.unknowns[matching.column_of[i]] for i in component]
    if len(component) == 1:
        return _single(equations[0], unknowns[0], moduli)
    own = set(unknowns)
    # an equation may have been matched away from the unknown that causality gave it, within the block or out of it
    kept = [e for e in equations if e.assigned in own]
    open_equations = [e for e in equations if e.assigned not in own]
    at = {e.assigned: k for k, e in enumerate(kept)}
    reads = [[k for leaf in _variables(e.right) if (k := at.get(leaf)) is not None] for e in kept]
    torn, order = tear(reads)
    assigned = {e.assigned for e in kept}
    torn_names = [*(str(kept[k].assigned) for k in torn), *(name for name in unknowns if name not in assigned)]
    inner = [kept[k] for k in order]
    residuals = [*(kept[k] for k in torn), *open_equations]
    return Block(
        (*inner, *residuals),
        (*(str(e.assigned) for e in inner), *torn_names),
        tuple(torn_names),
        _is_linear(inner, residuals, torn_names),
    )


def _single(equation: Equation, unknown: str, moduli: Moduli) -> Block:
    """An equation alone: an assignment if it can be solved in closed form, else a block torn at its unknown."""
    if equation.assigned == unknown:
        return Block((equation,), (unknown,))
    value = solve_for(equation.left, equation.right, var(unknown), moduli.can_vanish)
    if isinstance(value, Expr):
        return Block((Equation(var(unknown), value, unknown, equation.element, equation.origin),), (unknown,))
    return Block((equation,), (unknown,), (unknown,), _is_linear((), (equation,), (unknown,)))


def _variables(root: Expr) -> Iterable[str]:
    return (node.data for node in topological((root,)) if node.op == "var")


def _is_linear(inner: Iterable[Equation], residuals: Iterable[Equation], torn: Iterable[str]) -> bool:
    """Whether the residuals are linear in the torn unknowns, each coefficient free of every unknown of the block."""
    degree: dict[Expr, int] = {var(name): 1 for name in torn}
    for equation in inner:
        degree[equation.left] = _degree((equation.right,), degree)
    return all(_degree((equation.left, equation.right), degree) <= 1 for equation in residuals)


def _degree(roots: Iterable[Expr], degree: dict[Expr, int]) -> int:
    """The greatest degree of the roots, 2 standing for everything that is not linear; `degree` remembers every node met."""
    roots = tuple(roots)
    for node in topological(roots, degree):
        own = [degree[arg] for arg in node.args]
        match node.op:
            case "add" | "neg":
                degree[node] = max(own)
            case "mul":
                degree[node] = min(2, sum(own))
            case "div":
                degree[node] = own[0] if own[1] == 0 else 2
            case "if":
                degree[node] = max(own[1:]) if own[0] == 0 else 2
            case _:
                degree[node] = 2 if any(own) else 0
    return max(degree[root] for root in roots)


# --------------------------------------------------------------------------------------------------------- what is wrong


def _report_singular(system: EquationSystem, rows: Rows, matching: Matching, report: Reporter) -> None:
    """Name the equations that are one too many, and the unknowns that nothing determines, with the parts they stand in."""
    over = overdetermined(rows, matching)
    if over:
        unmatched = set(matching.unmatched_rows)
        first = system.equations[min(unmatched)]
        names = sorted({system.unknowns[j] for i in over for j in rows[i]})
        report.add(
            OVERDETERMINED,
            f"{_count(len(over), 'equation')} for {_count(len(names), 'unknown')}: the equation of `{first.element}` is one too many",
            first.origin.span,
            to_equation(first),
            others=[(system.equations[i].origin.span, to_equation(system.equations[i])) for i in over if i not in unmatched][:6],
            notes=_listed("the unknowns are", names),
        )
    under = underdetermined(rows, matching)
    if under:
        _report_undetermined(system, rows, matching, under, report)


def _report_undetermined(system: EquationSystem, rows: Rows, matching: Matching, under: Sequence[int], report: Reporter) -> None:
    names = [system.unknowns[j] for j in matching.unmatched_columns]
    place = place_of(system)
    span = place.get(names[0], system.graph.sources[0])
    readers = [e for e, row in zip(system.equations, rows, strict=True) if set(row) & set(under)]
    report.add(
        UNDERDETERMINED,
        f"nothing determines {', '.join(f'`{name}`' for name in names[:5])}",
        readers[0].origin.span if readers else span,  # type: ignore[arg-type]
        to_equation(readers[0]) if readers else "",
        others=[(e.origin.span, to_equation(e)) for e in readers[1:6]],
        notes=_listed("these unknowns have fewer equations than there are of them:", [system.unknowns[j] for j in under]),
    )


def place_of(system: EquationSystem) -> Mapping[str, object]:
    """Where signals are declared, by scalar name."""
    return {name: signal.origin.span for signal in system.graph.signals for name in signal.scalars()}


def to_equation(equation: Equation) -> str:
    """The equation in the language's notation, cut where it is long."""
    text = f"{to_text(equation.left)} = {to_text(equation.right)}"
    return text if len(text) <= 100 else text[:97] + "..."


def _listed(text: str, names: Sequence[str]) -> tuple[str, ...]:
    shown = ", ".join(f"`{name}`" for name in names[:8])
    return (f"{text} {shown}{f' and {len(names) - 8} more' if len(names) > 8 else ''}",)


def _count(n: int, thing: str) -> str:
    return f"{n} {thing}{'' if n == 1 else 's'}"
