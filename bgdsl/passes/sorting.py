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

from collections.abc import Iterable, Sequence

from bgdsl.diagnostics import Code, Reporter, counted, listed
from bgdsl.expr import Expr, topological, var, variables
from bgdsl.ir.system import Block, Equation, EquationSystem, SortedSystem, incidence
from bgdsl.passes.blocks import strong_components
from bgdsl.passes.invert import solve_for
from bgdsl.passes.matching import FREE, Matching, Rows, match, overdetermined, underdetermined
from bgdsl.passes.moduli import Moduli
from bgdsl.passes.starts import initial_system
from bgdsl.passes.tearing import tear
from bgdsl.source import Span

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
    reads = [[k for leaf in variables((e.right,)) if (k := at.get(leaf)) is not None] for e in kept]
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
    over = overdetermined(rows, matching)
    if over:
        _report_overdetermined(system, rows, matching, over, report)
    under = underdetermined(rows, matching)
    if under:
        _report_undetermined(system, rows, matching, under, report)


def _report_overdetermined(system: EquationSystem, rows: Rows, matching: Matching, over: Sequence[int], report: Reporter) -> None:
    """Name the equation that is one too many, and those that leave no unknown for it."""
    first = system.equations[matching.unmatched_rows[0]]
    names = sorted({system.unknowns[j] for i in over for j in rows[i]})
    places = {e.origin.span: _of(e) for e in (system.equations[i] for i in over) if e.origin.span != first.origin.span}
    held = any(e.origin.span == first.origin.span for e in system.invariants)
    report.add(
        OVERDETERMINED,
        f"{_of(first)} cannot hold: every unknown in it is determined without it",
        first.origin.span,
        "one too many",
        others=[(span, f"together with {text}") for span, text in places.items()][:6],
        notes=[
            *(("no unknown is left for it, nor for its derivative",) if held else ()),
            f"{counted(len(over), 'equation')} for {counted(len(names), 'unknown')}: {listed(names)}",
        ],
        helps=["remove one of these equations, or one of the parts that state them"],
    )


def _report_undetermined(system: EquationSystem, rows: Rows, matching: Matching, under: Sequence[int], report: Reporter) -> None:
    """Name the unknowns that nothing determines, where they are declared, and the equations that read them."""
    names = [system.unknowns[j] for j in matching.unmatched_columns]
    places = _declarations(system, names)
    reached = set(under)
    readers = [e for e, row in zip(system.equations, rows, strict=True) if not reached.isdisjoint(row)]
    readers.sort(key=lambda e: e.assigned is not None)
    shown = {e.origin.span: _of(e) for e in readers}
    primary = places.get(names[0]) or next(iter(shown))
    report.add(
        UNDERDETERMINED,
        f"nothing determines {listed(names)}",
        primary,
        "one equation is missing" if len(names) == 1 else f"{len(names)} equations are missing",
        others=[(span, f"reads it in {text}") for span, text in shown.items() if span != primary][:4],
        notes=[f"{counted(len(under), 'unknown')} for {counted(len(readers), 'equation')}: {listed([system.unknowns[j] for j in under])}"],
        helps=["add an equation for each, or remove what is not used"],
    )


def _declarations(system: EquationSystem, names: Iterable[str]) -> dict[str, Span]:
    """Where the things are declared whose variables these are: signals, elements, junctions."""
    graph = system.graph
    spans = {name: signal.origin.span for signal in graph.signals for name in signal.scalars()}
    spans |= {thing.name: thing.origin.span for things in (graph.junctions, graph.elements) for thing in things}
    found = {}
    for name in names:
        path = name.removeprefix("der(").rstrip(")") if name.startswith("der(") else name
        while path and path not in spans:
            path = path.rpartition(".")[0]
        if path:
            found[name] = spans[path]
    return found


def _of(equation: Equation) -> str:
    """What messages call an equation: the part that states it, or its own text."""
    return f"the equation of `{equation.element}`" if equation.element else f"`{_shortened(equation.origin.span.text.rstrip(' ;'))}`"


def _shortened(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 80 else line[:77] + "..."
