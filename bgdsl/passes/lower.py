"""Lower sorted blocks to steps, and gather everything a backend or a run asks of a model.

Input        SortedSystem  blocks in evaluation order
Output       Program       assignments, linear and Newton solves; derivatives, outputs, bonds, values, events, starts
Establishes  each variable is defined once, before it is read; linear loops of up to three tears are formulas
Reports      BG506 a loop that is singular with the parameters' default values

Copies, signs and constants are passed on to their readers, so that what the structure sets to zero costs nothing; the
assignments themselves stay, and `Program.needed` leaves out those that nobody reads.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256

from bgdsl.diagnostics import Code, Reporter, listed
from bgdsl.expr import ONE, ZERO, Expr, leaves, rewrite, var
from bgdsl.ir.elements import component
from bgdsl.ir.graph import BondGraph, Origin, Parameter
from bgdsl.ir.program import Assign, Program, Record, SolveLinear, SolveNewton, Step, needed
from bgdsl.ir.system import Block, Equation, EquationSystem, SortedSystem, derivative_name
from bgdsl.passes.differentiate import Gradient, gradients, jacobian
from bgdsl.passes.events import collect_events
from bgdsl.passes.invert import divide
from bgdsl.passes.moduli import Moduli
from bgdsl.passes.regularity import is_singular

SINGULAR_LOOP = Code("BG506", "an algebraic loop is singular")


def lower(sorted_system: SortedSystem, report: Reporter) -> Program:
    """The program of a sorted system."""
    system = sorted_system.system
    graph = system.graph
    known: dict[Expr, Expr] = {}
    steps = _lower_blocks(sorted_system, known, report)
    report.stop_if_errors()
    derivatives = _derivatives(system, steps, known)
    outputs = tuple(_outputs(graph, known))
    inputs = (*_inputs(graph), *(Record(name) for name in system.input_rates))
    initial_steps = _initial_steps(sorted_system, report)
    report.stop_if_errors()
    return Program(
        model=graph.model,
        comment=graph.comment,
        digest=_digest(graph),
        parameters=_in_order(graph.parameters),
        tables=graph.tables,
        unstarted=frozenset(s.name for s in system.states if not s.fixed),
        states=tuple(Record(s.name, s.unit or graph.units.get(s.name, ""), s.comment) for s in system.states),
        starts=_starts(sorted_system),
        inputs=inputs,
        steps=tuple(steps),
        derivatives=derivatives,
        derivative_origins=tuple(s.origin for s in system.states),
        outputs=outputs,
        bonds=tuple(_bonds(system, known)),
        values=system.values,
        differentiate=jacobian,
        initial_steps=initial_steps,
        events=collect_events(steps, (*derivatives, *(value for _, value in outputs)), system.states, inputs),
        checks=tuple(replace(c, condition=rewrite((system.values.close(c.condition),), known)[0]) for c in graph.checks),
        invariants=tuple((rewrite((e.left - e.right,), known)[0], e.origin) for e in system.invariants),
        dependent=tuple((name, var(name), start) for name, start in system.dependent.items()),
        experiments=graph.experiments,
        sizes=_sizes(sorted_system, steps),
    )


def _in_order(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """The parameters, each behind those that its values read; else in the order declared."""
    owners = {name: parameter for parameter in parameters for name in parameter.scalars()}
    done: dict[str, Parameter] = {}
    begun: set[str] = set()
    for parameter in parameters:
        stack = [(parameter, False)]
        while stack:
            current, ready = stack.pop()
            if ready:
                done[current.name] = current
            if current.name in begun:
                continue
            begun.add(current.name)
            read = [owners[leaf.data] for leaf in leaves(current.values, "param")]
            stack += [(current, True), *((other, False) for other in reversed(read))]
    return tuple(done.values())


def _lower_blocks(sorted_system: SortedSystem, known: dict[Expr, Expr], report: Reporter) -> list[Step]:
    """The steps of all blocks; `known` gets what every copied or constant variable stands for."""
    steps: list[Step] = []
    moduli = Moduli(sorted_system.system.graph)
    for block in sorted_system.blocks:
        for step in _steps(block, sorted_system.system.guesses, moduli, report):
            steps.append(_passed_on(step, known))
    return steps


def _derivatives(system: EquationSystem, steps: Iterable[Step], known: Mapping[Expr, Expr]) -> tuple[Expr, ...]:
    """The value of each state's derivative: the right side of its assignment, or the variable that a solved block gives."""
    assigned = {step.variable: step.value for step in steps if isinstance(step, Assign)}
    names = (derivative_name(state.name) for state in system.states)
    return tuple(assigned.get(name, known.get(var(name), var(name))) for name in names)


def _starts(sorted_system: SortedSystem) -> tuple[Expr, ...]:
    """The initial values of the states: formulas, and what the initial steps find."""
    initial = sorted_system.initial
    free = set(initial.system.unknowns) if initial is not None else set()
    return tuple(var(s.name) if s.name in free else s.start for s in sorted_system.system.states)


def _initial_steps(sorted_system: SortedSystem, report: Reporter) -> tuple[Step, ...]:
    """The steps that find the freed states: given starts first, then the blocks of the initial instant, as far as needed."""
    initial = sorted_system.initial
    if initial is None:
        return ()
    given = [Assign(state.name, state.start, state.origin) for state in initial.system.states]
    known: dict[Expr, Expr] = {}
    steps = [*(_passed_on(step, known) for step in given), *_lower_blocks(initial, known, report)]
    return needed(steps, _starts(sorted_system))


# --------------------------------------------------------------------------------------------------------------- blocks


def _steps(block: Block, guesses: Mapping[str, Expr], moduli: Moduli, report: Reporter) -> Iterator[Step]:
    inner = len(block.equations) - len(block.torn)
    assigns = tuple(Assign(str(e.assigned), e.right, e.origin) for e in block.equations[:inner])
    residuals = block.equations[inner:]
    if not block.torn:
        yield from assigns
    elif block.linear:
        slopes = _slopes(assigns, residuals, block.torn)
        if is_singular(slopes, moduli):
            _report_singular(block, report)
        else:
            yield from _solve_linear(block, assigns, slopes)
        yield from assigns
    else:
        slopes = _slopes(assigns, residuals, block.torn)
        entries = tuple((i, j, row[j]) for i, row in enumerate(slopes) for j in sorted(row))
        first = tuple(guesses.get(name, ZERO) for name in block.torn)
        values = tuple(e.left - e.right for e in residuals)
        yield SolveNewton(block.torn, assigns, values, entries, first, residuals[0].origin, _loop_name(block))


def _slopes(assigns: Iterable[Assign], residuals: Iterable[Equation], torn: Sequence[str]) -> list[Gradient]:
    """The gradients of the residuals by the torn unknowns, through the inner assignments."""
    known: dict[Expr, Gradient] = {var(name): {j: ONE} for j, name in enumerate(torn)}
    for assign in assigns:
        known[var(assign.variable)] = gradients((assign.value,), known)[0]
    return gradients([e.left - e.right for e in residuals], known)


def _solve_linear(block: Block, assigns: Sequence[Assign], slopes: Sequence[Gradient]) -> Iterator[Step]:
    """A z = b for the torn unknowns: A from the gradients, b from the residuals at z = 0."""
    residuals = block.equations[len(assigns) :]
    at_zero: dict[Expr, Expr] = {var(name): ZERO for name in block.torn}
    for assign in assigns:
        (at_zero[var(assign.variable)],) = rewrite((assign.value,), at_zero)
    right = tuple(-value for value in rewrite([e.left - e.right for e in residuals], at_zero))
    origin = residuals[0].origin
    if len(block.torn) <= 3:
        yield from _by_formula(block.torn, slopes, right, origin)
        return
    entries = tuple((i, j, row[j]) for i, row in enumerate(slopes) for j in sorted(row))
    yield SolveLinear(block.torn, entries, right, origin, _loop_name(block), _is_symmetric(slopes))


def _is_symmetric(slopes: Sequence[Gradient]) -> bool:
    """Whether every entry is the same expression as the one across the diagonal."""
    return all(slopes[j].get(i) is value for i, row in enumerate(slopes) for j, value in row.items())


def _by_formula(names: Sequence[str], slopes: Sequence[Gradient], right: Sequence[Expr], origin: Origin) -> Iterator[Step]:
    """Cramer's rule for up to three unknowns."""
    n = len(right)
    matrix = [[slopes[i].get(j, ZERO) for j in range(n)] for i in range(n)]
    whole = determinant(matrix)
    for j, name in enumerate(names):
        swapped = [[right[i] if k == j else matrix[i][k] for k in range(n)] for i in range(n)]
        yield Assign(name, divide(determinant(swapped), whole), origin)


def determinant(matrix: Sequence[Sequence[Expr]]) -> Expr:
    """The determinant of a square matrix by expansion along its first row; meant for three rows at most."""
    if len(matrix) == 1:
        return matrix[0][0]
    total = ZERO
    for j, value in enumerate(matrix[0]):
        if not value.is_zero:
            minor = value * determinant([[*row[:j], *row[j + 1 :]] for row in matrix[1:]])
            total = total + minor if j % 2 == 0 else total - minor
    return total


def _loop_name(block: Block) -> str:
    """What messages call the loop: its first unknowns."""
    return ", ".join(block.torn[:3]) + (", ..." if len(block.torn) > 3 else "")


def _report_singular(block: Block, report: Reporter) -> None:
    first = block.equations[-1]
    others = {e.origin.span: e.element for e in block.equations if e.origin.span != first.origin.span}
    report.add(
        SINGULAR_LOOP,
        f"the loop through {listed(block.torn)} has no unique solution",
        first.origin.span,
        f"the loop closes at `{first.element}`" if first.element else "the loop closes here",
        others=[(span, f"through `{element}`" if element else "through this") for span, element in others.items()][:6],
        notes=["with the parameters' default values, and whatever the states are, its equations repeat or contradict each other"],
        helps=["remove one of the parts that say the same, or put an R, C or I between them"],
    )


# -------------------------------------------------------------------------------------------------------- simplification


def _passed_on(step: Step, known: dict[Expr, Expr]) -> Step:
    """The step with copies and constants replaced; what it defines as such is added to `known`."""
    match step:
        case Assign():
            return _passed_on_assign(step, known)
        case SolveLinear():
            values = rewrite((value for _, _, value in step.entries), known)
            entries = tuple((i, j, value) for (i, j, _), value in zip(step.entries, values, strict=True) if not value.is_zero)
            right = rewrite(step.right, known)
            return SolveLinear(step.variables, entries, right, step.origin, step.name, step.symmetric)
        case SolveNewton():
            inner = tuple(_passed_on_assign(assign, known) for assign in step.inner)
            residuals = rewrite(step.residuals, known)
            values = rewrite((value for _, _, value in step.entries), known)
            entries = tuple((i, j, value) for (i, j, _), value in zip(step.entries, values, strict=True) if not value.is_zero)
            return SolveNewton(step.variables, inner, residuals, entries, step.guesses, step.origin, step.name)


def _passed_on_assign(step: Assign, known: dict[Expr, Expr]) -> Assign:
    (value,) = rewrite((step.value,), known)
    known[var(step.variable)] = value if _is_plain(value) else var(step.variable)
    return step if value is step.value else Assign(step.variable, value, step.origin)


def _is_plain(value: Expr) -> bool:
    """A constant, a leaf, or the negative of a leaf: cheaper to repeat than to name."""
    return not value.args or (value.op == "neg" and not value.args[0].args)


# -------------------------------------------------------------------------------------------------------------- surface


def _inputs(graph: BondGraph) -> Iterator[Record]:
    for signal in graph.signals:
        if signal.role == "input":
            yield from (Record(name, signal.unit, signal.comment) for name in signal.scalars())


def _outputs(graph: BondGraph, known: Mapping[Expr, Expr]) -> Iterator[tuple[Record, Expr]]:
    for signal in graph.signals:
        if signal.output:
            for name in signal.scalars():
                yield Record(name, signal.unit, signal.comment), known.get(var(name), var(name))


def _bonds(system: EquationSystem, known: dict[Expr, Expr]) -> Iterator[tuple[Record, Expr, Expr]]:
    values = system.values
    for bond in system.graph.bonds:
        for i in range(bond.width):
            shown = None if bond.size is None else i
            effort, flow = (values[component(f"{bond.name}.{letter}", shown)] for letter in "ef")
            effort, flow = rewrite((effort, flow), known)
            yield Record(component(bond.name, shown)), effort, flow


def _digest(graph: BondGraph) -> str:
    """SHA-256 over the sources of the model: of the source itself where there is one."""
    digests = [source.digest for source in graph.sources]
    return digests[0] if len(digests) == 1 else sha256("\n".join(digests).encode()).hexdigest()


def _sizes(sorted_system: SortedSystem, steps: Iterable[Step]) -> Mapping[str, int]:
    system = sorted_system.system
    torn = [block for block in sorted_system.blocks if block.torn]
    return {
        "bonds": sum(bond.width for bond in system.graph.bonds),
        "equations": len(system.equations),
        "states": len(system.states),
        "loops": len(torn),
        "torn": sum(len(block.torn) for block in torn),
    }
