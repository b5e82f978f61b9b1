"""Write down every equation of a causal graph: balances, relations, laws, signals.

Input        CausalGraph     causality assigned
Output       EquationSystem  as many equations as unknowns (less one for each derivative of a dependent storage)
Establishes  every equation reads states, unknowns, inputs, parameters and time only; where causality says which unknown an
             equation gives, it is solved for it, unless that would divide by what may vanish
Reports      BG505 a law that cannot be inverted

Unknowns are one variable a junction, the conjugates that nothing else expresses, algebraic signals, the derivative of each
state; for a storage in derivative causality its p or q and the derivative of that, which `reduce_index` supplies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import ZERO, Expr, add, substitute, var, variables
from bgdsl.ir.causal import CausalGraph
from bgdsl.ir.elements import KINDS
from bgdsl.ir.graph import BondGraph, Element, Law, Origin, SignalEquation
from bgdsl.ir.scalar import Relation, ScalarGraph, Term
from bgdsl.ir.system import Equation, EquationSystem, State, derivative_name
from bgdsl.ir.values import Values
from bgdsl.passes.invert import Refusal, divide, reads, solve_for
from bgdsl.passes.moduli import Moduli
from bgdsl.passes.quantities import values_of

NOT_INVERTIBLE = Code("BG505", "a law has no unique inverse in the direction that causality needs")


@dataclass(slots=True)
class _Work:
    """Everything the parts of this pass share, and what they have found so far."""

    causal: CausalGraph
    report: Reporter
    values: Values
    moduli: Moduli
    elements: Mapping[str, Element]
    own: set[str]
    """The conjugates that are unknowns of their own."""
    states: list[State] = field(default_factory=list)
    unknowns: list[str] = field(default_factory=list)
    equations: list[Equation] = field(default_factory=list)
    dependent: dict[str, Expr | None] = field(default_factory=dict)
    initial: list[SignalEquation] = field(default_factory=list)

    @property
    def scalar(self) -> ScalarGraph:
        return self.causal.scalar

    def determines(self, term: Term) -> bool:
        return self.causal.determiner[term.junction] == term.index

    def common(self, term: Term) -> Expr:
        """The variable of the term's junction."""
        return var(self.scalar.junctions[term.junction].variable)

    def state(self, left: Expr, right: Expr, assigned: str | None, element: str, origin: Origin) -> None:
        """State left = right, aliases replaced; `assigned` must be `left` and not be read by `right`."""
        left, right = self.values.close(left), self.values.close(right)
        if assigned is not None and reads(right, left):
            assigned = None
        self.equations.append(Equation(left, right, assigned, element, origin))


def derive_equations(causal: CausalGraph, report: Reporter) -> EquationSystem:
    """The equations of the model. BgError if a law cannot be turned into the direction that causality needs."""
    scalar = causal.scalar
    graph = scalar.graph
    work = _Work(causal, report, values_of(causal), Moduli(graph), {e.name: e for e in graph.elements}, set(scalar.unknowns))
    _common_variables(work)
    work.unknowns += scalar.unknowns
    for j in range(len(scalar.junctions)):
        _balance(work, j)
    for relation in scalar.relations:
        _relation(work, relation)
    _laws(work)
    _signals(work)
    for check in graph.checks:
        work.values.close(check.condition)
    _energies(work)
    _start_by_equations(work)
    _alias_loops(work)
    report.stop_if_errors()
    initial = tuple(
        SignalEquation(work.values.close(e.left), work.values.close(e.right), e.origin) for e in (*graph.initial_equations, *work.initial)
    )
    return EquationSystem(
        graph,
        tuple(work.states),
        tuple(work.unknowns),
        tuple(work.equations),
        work.values,
        work.dependent,
        initial=initial,
        guesses=_guesses(graph),
    )


def _guesses(graph: BondGraph) -> dict[str, Expr]:
    """Where iterations for algebraic signals begin, as the model says."""
    return {
        name: start
        for signal in graph.signals
        if signal.role == "algebraic" and signal.starts is not None
        for name, start in zip(signal.scalars(), signal.starts, strict=True)
    }


# --------------------------------------------------------------------------------------------------- junction structure


def _common_variables(work: _Work) -> None:
    """The variable of each junction is an unknown; where only dependent storages follow it, it is a state and its derivative is."""
    coordinates = {c.junction for c in work.causal.constrained if c.velocity}
    for j, junction in enumerate(work.scalar.junctions):
        if j in coordinates:
            work.states.append(State(junction.variable, ZERO, "", "", junction.origin, "common", fixed=False))
        work.unknowns.append(derivative_name(junction.variable) if j in coordinates else junction.variable)


def _balance(work: _Work, j: int) -> None:
    """sum of sign x conjugate = 0, solved for the unknown in the determiner's conjugate."""
    scalar = work.scalar
    junction = scalar.junctions[j]
    determiner = work.causal.determiner[j]
    terms = [scalar.terms[t] for t in scalar.terms_at[j]]
    name = junction.name
    if determiner is not None:
        term = scalar.terms[determiner]
        rest = add(_signed(t, -term.sign) for t in terms if t is not term)
        wanted = _inner(work, term)
        modulus = work.values.close(term.modulus) if term.modulus is not None and term.conjugate is not wanted else None
        if modulus is None or not work.moduli.can_vanish(modulus):
            work.state(wanted, rest if modulus is None else divide(work.values.close(rest), modulus), wanted.data, name, junction.origin)
            return
    work.state(ZERO, add(_signed(t, 1) for t in terms), None, name, junction.origin)


def _signed(term: Term, sign: int) -> Expr:
    return term.balanced if term.sign == sign else -term.balanced


def _inner(work: _Work, term: Term) -> Expr:
    """The unknown in a term's conjugate: itself, or what its modulus multiplies."""
    if _is_own(work, term) or term.other is None:
        return term.conjugate
    return _far_unknown(work, term)


def _far_unknown(work: _Work, term: Term) -> Expr:
    assert term.other is not None
    far = work.scalar.terms[term.other]
    return far.conjugate if _is_own(work, far) else work.common(far)


def _is_own(work: _Work, term: Term) -> bool:
    """Whether the conjugate is the element port's own variable, an unknown."""
    if term.element is None or term.conjugate.op != "var" or term.conjugate.data not in work.own:
        return False
    element = work.elements[term.element]
    letter = "e" if work.scalar.junctions[term.junction].kind else "f"
    return bool(term.conjugate.data == element.ports[term.port].variable(element.name, letter, term.spot))


def _relation(work: _Work, relation: Relation) -> None:
    """A two-port's relation, from the side that determines to the side determined."""
    term = work.scalar.terms[relation.term]
    if work.determines(term):
        work.state(relation.left, relation.right, relation.left.data, relation.element, relation.origin)
        return
    assert term.modulus is not None and term.other is not None
    source = _far_unknown(work, term)
    far = work.scalar.terms[term.other]
    modulus = work.values.close(term.modulus)
    gives = work.determines(far) if source is work.common(far) else not work.determines(far)
    if gives and not work.moduli.can_vanish(modulus):
        work.state(source, divide(relation.left, modulus), source.data, relation.element, relation.origin)
    else:
        work.state(relation.left, relation.right, None, relation.element, relation.origin)


# ----------------------------------------------------------------------------------------------------------------- laws


def _laws(work: _Work) -> None:
    terms: dict[str, list[Term]] = {}
    for term in work.scalar.terms:
        if term.element is not None and term.other is None:
            terms.setdefault(term.element, []).append(term)
    for element in work.scalar.graph.elements:
        if element.modulus is None:
            _element(work, element, terms.get(element.name, []))


def _element(work: _Work, element: Element, terms: list[Term]) -> None:
    outputs = [(work.common(t) if work.determines(t) else t.conjugate).data for t in terms]
    if element.states:
        outputs = [_storage(work, element, term) for term in sorted(terms, key=lambda t: t.spot)]
    open_outputs = dict.fromkeys(outputs)
    waiting: list[tuple[Law, Expr, Expr]] = []
    for law in element.laws:
        left, right = work.values.close(law.left), work.values.close(law.right)
        if left.op == "var" and left.data in open_outputs and not reads(right, left):
            del open_outputs[left.data]
            work.equations.append(Equation(left, right, left.data, element.name, law.origin))
        else:
            waiting.append((law, left, right))
    for law, left, right in waiting:
        _turn(work, element, law, left, right, open_outputs)


def _turn(work: _Work, element: Element, law: Law, left: Expr, right: Expr, outputs: dict[str, None]) -> None:
    """State a law solved for the one output it reads; left open where it reads several, or where no formula is known."""
    wanted = [name for name in variables((left, right)) if name in outputs]
    value = solve_for(left, right, var(wanted[0]), work.moduli.can_vanish) if len(wanted) == 1 else None
    if isinstance(value, Refusal) and value.several:
        _refuse(work, element, law, wanted[0], value)
    if isinstance(value, Expr):
        del outputs[wanted[0]]
        work.equations.append(Equation(var(wanted[0]), value, wanted[0], element.name, law.origin))
    else:
        work.equations.append(Equation(left, right, None, element.name, law.origin))


def _refuse(work: _Work, element: Element, law: Law, wanted: str, refusal: Refusal) -> None:
    work.report.add(
        NOT_INVERTIBLE,
        f"the law of `{element.name}` cannot be solved for `{wanted}`, which causality needs from it",
        law.origin.span,
        refusal.reason,
        others=[(element.origin.span, f"`{element.name}` is declared here")] if element.origin.span != law.origin.span else (),
        helps=[
            "write the law so that it grows (or falls) throughout, for instance with `abs(x)*x` in place of `x^2`",
            f"or give the junction of `{element.name}` another element that determines it, so that the law is used as written",
        ],
    )


def _storage(work: _Work, element: Element, term: Term) -> str:
    """State der(p) = e (der(q) = f), and return what the law has to give: the co-energy variable, or the state itself where
    causality is derivative."""
    kind = KINDS[element.kind].state
    assert kind is not None
    name = element.states[term.spot]
    effort, flow = (term.conjugate, work.common(term)) if work.scalar.junctions[term.junction].kind else (work.common(term), term.conjugate)
    rate, co_energy = (effort, flow) if kind == "p" else (flow, effort)
    change = var(derivative_name(name))
    start = _start(work, element, term.spot)
    work.unknowns.append(change.data)
    if name in work.causal.derivative:
        work.dependent[name] = start
        work.unknowns.append(name)
        work.equations.append(Equation(rate, change, rate.data, element.name, element.origin))
        return name
    work.states.append(State(name, start if start is not None else ZERO, "", element.comment, element.origin, kind, start is not None))
    work.equations.append(Equation(change, rate, change.data, element.name, element.origin))
    return str(co_energy.data)


def _start(work: _Work, element: Element, i: int) -> Expr | None:
    """The start of a storage's state: as given, or from that of its co-energy variable through the law. Where the law cannot
    be turned, the given start becomes an initial equation."""
    name = element.states[i]
    if name in element.starts or not element.starts:
        return element.starts.get(name)
    given = {var(letter): value for letter, value in element.starts.items()}
    for law in element.laws:
        left, right = (work.values.close(side) for side in substitute((law.left, law.right), given))
        if variables((left, right)) == [name]:
            value = solve_for(left, right, var(name), work.moduli.can_vanish)
            if isinstance(value, Expr):
                return value
    co_energy = element.ports[0].variable(element.name, "f" if KINDS[element.kind].state == "p" else "e", i)
    work.initial.append(SignalEquation(var(co_energy), element.starts[co_energy], element.origin))
    return None


# -------------------------------------------------------------------------------------------------------------- signals


def _signals(work: _Work) -> None:
    open_unknowns: set[str] = set()
    for signal in work.scalar.graph.signals:
        names = signal.scalars()
        starts = signal.starts if signal.starts is not None else (ZERO,) * len(names)
        if signal.role == "state":
            work.states += [
                State(name, start, signal.unit, signal.comment, signal.origin, "signal", signal.starts is not None)
                for name, start in zip(names, starts, strict=True)
            ]
            names = tuple(map(derivative_name, names))
        if signal.role != "input":
            work.unknowns += names
            open_unknowns |= set(names)
    for equation in work.scalar.graph.equations:
        _signal_equation(work, equation, open_unknowns)


def _signal_equation(work: _Work, equation: SignalEquation, open_unknowns: set[str]) -> None:
    left, right = work.values.close(equation.left), work.values.close(equation.right)
    for one, other in ((left, right), (right, left)):
        if one.op == "var" and one.data in open_unknowns and not reads(other, one):
            open_unknowns.discard(one.data)
            work.equations.append(Equation(one, other, one.data, one.data, equation.origin))
            return
    work.equations.append(Equation(left, right, None, "", equation.origin))


def _energies(work: _Work) -> None:
    """A state for each energy that the model reads and no formula gives: the integral of the element's power."""
    for name in [name for name in work.values.missing if name.endswith(".energy")]:
        element = work.elements[name.removesuffix(".energy")]
        power = work.values.close(var(f"{element.name}.power"))
        work.values.missing.discard(name)
        work.values.known[name] = None
        work.states.append(State(name, ZERO, "J", f"energy into {element.name}", element.origin, "energy"))
        work.unknowns.append(derivative_name(name))
        work.equations.append(Equation(var(derivative_name(name)), power, derivative_name(name), element.name, element.origin))
    assert all(name.startswith("der(") for name in work.values.missing), work.values.missing


def _start_by_equations(work: _Work) -> None:
    """A start that reads variables is an initial equation: what it reads has a value only once the initial instant is solved."""
    inputs = {name for signal in work.scalar.graph.signals if signal.role == "input" for name in signal.scalars()}
    for k, state in enumerate(work.states):
        if state.start.op == "var" or state.start.args:
            start = work.values.close(state.start)
            if not inputs.issuperset(variables((start,))):
                work.states[k] = replace(state, start=ZERO, fixed=False)
                work.initial.append(SignalEquation(var(state.name), start, state.origin))


def _alias_loops(work: _Work) -> None:
    """A variable whose value reads itself is an unknown, and its value an equation."""
    graph = work.scalar.graph
    if work.values.loops:
        origins = {thing.name: thing.origin for things in (graph.junctions, graph.elements) for thing in things}
    for name, value in list(work.values.loops.items()):
        path = name
        while path and path not in origins:
            path = path.rpartition(".")[0]
        work.unknowns.append(name)
        work.state(var(name), value, None, name.rpartition(".")[0], origins[path] if path else graph.equations[0].origin)
