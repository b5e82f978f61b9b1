"""What it would change to hold a modulating signal still.

Input        ScalarGraph, Dependencies, ActivityReport, the dropped terms
Output       Trial of every state signal that modulates something, the program that measures them, and what each changes
Establishes  a change is the integral of |change of e f| of a term, relative to the largest activity at the junctions where
             the term still counts; a signal whose rate is affected is integrated anew beside the recorded run
Reports      nothing

A signal is held at its value at the start. Where it stands in a rate (`der(a) = ...`), all other state signals in that
rate are held together, and a second `a` is integrated with them held: what it modulates is compared.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from bgdsl.expr import ZERO, Expr, Table, const, evaluate, leaves, substitute, unary, var
from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.graph import SignalEquation
from bgdsl.ir.partition import Dependencies, Edge, Frozen
from bgdsl.ir.program import Program, Record
from bgdsl.ir.scalar import ScalarGraph, Term

SHADOW = "held."
"""Prefix of the states that are integrated a second time."""


@dataclass(frozen=True, slots=True)
class Trial:
    """Signals held at values in one reader (a term's index or an equation's left side). edges: the dependencies that go with
    them. shadow: (state, start, rate) to integrate beside the run, None where the reader is no rate. integrands: the change of
    power of each term touched, with the activity that it is compared to (J)."""

    reader: int | str
    held: tuple[tuple[str, float], ...]
    edges: tuple[Edge, ...]
    shadow: tuple[str, Expr, Expr] | None
    integrands: tuple[tuple[Expr, float], ...]


def trials(
    scalar: ScalarGraph, needs: Dependencies, report: ActivityReport, dropped: frozenset[int], values: Mapping[str, float]
) -> tuple[Trial, ...]:
    """Every trial for the modulating edges from state signals. values: of the parameters, for the signals' starts."""
    return tuple(_Trials(scalar, needs, report, dropped, values).run())


class _Trials:
    def __init__(
        self, scalar: ScalarGraph, needs: Dependencies, report: ActivityReport, dropped: frozenset[int], values: Mapping[str, float]
    ):
        self.scalar, self.needs, self.dropped = scalar, needs, dropped
        graph = scalar.graph
        self.most = {junction.index: junction.max_activity for junction in report.junctions}
        self.starts: dict[str, Expr] = {}
        for signal in graph.signals:
            if signal.role == "state":
                given = signal.starts or (ZERO,) * len(signal.scalars())
                self.starts.update(zip(signal.scalars(), given, strict=True))
        self.reference = {name: _value(start, values, graph.tables) for name, start in self.starts.items()}
        self.equation: dict[str, SignalEquation] = {e.left.data: e for e in graph.equations if e.left.op == "var"}
        self.laws = {law.left.data: law.right for element in graph.elements for law in element.laws if law.left.op == "var"}
        self.readers: dict[str, list[str]] = defaultdict(list)
        for name, equation in self.equation.items():
            if not name.startswith("der("):
                for leaf in leaves((equation.right,)):
                    self.readers[leaf.data].append(name)
        self.terms: dict[str, list[Term]] = defaultdict(list)
        for term in scalar.terms:
            if term.other is None or term.index < term.other:
                for leaf in leaves(self.modulating(term)):
                    self.terms[leaf.data].append(term)

    def modulating(self, term: Term) -> tuple[Expr, ...]:
        if term.modulus is not None:
            return (term.modulus,)
        return (self.conjugate(term),) if term.other is None else ()

    def conjugate(self, term: Term) -> Expr:
        """What the term's conjugate is, an element's law put in where it is given for it."""
        return self.laws.get(term.conjugate.data, term.conjugate) if term.conjugate.op == "var" and term.other is None else term.conjugate

    def run(self) -> Iterator[Trial]:
        groups: dict[tuple[int | str, str], list[Edge]] = defaultdict(list)
        for edge in self.needs.edges:
            if edge.modulating and edge.source >= self.needs.junctions:
                signal = self.needs.signals[edge.source - self.needs.junctions]
                if signal in self.reference and self.reference[signal] is not None:
                    groups[self.reader(edge), signal].append(edge)
        rates: dict[str, list[str]] = defaultdict(list)
        for (reader, signal), edges in groups.items():
            if isinstance(reader, str) and reader.startswith("der("):
                rates[reader].append(signal)
            else:
                yield from self.direct(reader, signal, tuple(edges))
        for reader, signals in rates.items():
            yield from self.rate(reader, signals)

    def reader(self, edge: Edge) -> int | str:
        if edge.term is not None:
            return edge.term
        name = self.needs.signals[edge.reader - self.needs.junctions]
        return f"der({name})" if f"der({name})" in self.equation else name

    def direct(self, reader: int | str, signal: str, edges: tuple[Edge, ...]) -> Iterator[Trial]:
        """Hold a signal in one modulus, law or algebraic equation."""
        value = self.reference[signal]
        assert value is not None
        held = {var(signal): const(value)}
        if isinstance(reader, int):
            term = self.scalar.terms[reader]
            integrands = tuple(self.change(term, held))
        else:
            equation = self.equation.get(reader)
            if equation is None:
                return
            (new,) = substitute((equation.right,), held)
            integrands = tuple(self.changes({var(reader): new}))
        yield Trial(reader, ((signal, value),), edges, None, integrands)

    def rate(self, reader: str, signals: Sequence[str]) -> Iterator[Trial]:
        """Hold the other state signals in a rate, and integrate its state anew."""
        state = reader[4:-1]
        held = tuple((s, v) for s in signals if s != state and (v := self.reference[s]) is not None)
        if not held or state not in self.starts:
            return
        shadow = f"{SHADOW}{state}"
        right = self.equation[reader].right
        (new,) = substitute((right,), {var(s): const(v) for s, v in held})
        left = {leaf.data for leaf in leaves((new,))}
        lost = {leaf.data for leaf in leaves((right,))} - left
        node = self.needs.junctions + self.needs.signals.index(state)
        edges = tuple(e for e in self.needs.edges if e.reader == node and e.modulating and e.variable in lost)
        (again,) = substitute((new,), {var(state): var(shadow)})
        integrands = tuple(self.changes({var(state): var(shadow)}))
        yield Trial(reader, held, edges, (shadow, self.starts[state], again), integrands)

    def changes(self, new: Mapping[Expr, Expr]) -> Iterator[tuple[Expr, float]]:
        """The change of every term that reads the replaced signals, directly or through algebraic equations."""
        replaced = dict(new)
        waiting, touched = [leaf.data for leaf in new], dict[int, Term]()
        while waiting:
            name = waiting.pop()
            touched.update((term.index, term) for term in self.terms.get(name, ()))
            for reader in self.readers.get(name, ()):
                if var(reader) not in replaced:
                    (replaced[var(reader)],) = substitute((self.equation[reader].right,), replaced)
                    waiting.append(reader)
        for _, term in sorted(touched.items()):
            yield from self.change(term, replaced)

    def change(self, term: Term, replaced: Mapping[Expr, Expr]) -> Iterator[tuple[Expr, float]]:
        """|change of power| of a term, and the least of the largest activities at its ends that still count."""
        ends = [t for t in (term.index, term.other) if t is not None and t not in self.dropped]
        if not ends:
            return
        before = self.conjugate(term)
        (after,) = substitute((before,), replaced)
        if after is not before:
            power = var(self.scalar.junctions[term.junction].variable) * (before - after)
            yield unary("abs", power), min(self.most[self.scalar.terms[t].junction] for t in ends)


def _value(start: Expr, values: Mapping[str, float], tables: Mapping[str, Table]) -> float | None:
    try:
        return evaluate(start, values, tables=tables)
    except (KeyError, ArithmeticError, ValueError):
        return None


Grounded = Callable[[Iterable[Expr], Program], tuple[Expr, ...]]


def with_shadows(program: Program, made: Iterable[Trial], grounded: Grounded) -> Program:
    """The program with the trials' second states beside its own; nothing of it reads them. grounded: see `activity.grounded`."""
    shadows = [trial.shadow for trial in made if trial.shadow is not None]
    if not shadows:
        return program
    records = tuple(Record(name) for name, _, _ in shadows)
    wider = replace(program, states=(*program.states, *records), values={**program.values, **{r.name: var(r.name) for r in records}})
    rates = grounded([rate for _, _, rate in shadows], wider)
    origins = tuple(program.derivative_origins[0] for _ in shadows) if program.derivative_origins else ()
    return replace(
        wider,
        starts=(*program.starts, *(start for _, start, _ in shadows)),
        derivatives=(*program.derivatives, *rates),
        derivative_origins=(*program.derivative_origins, *origins),
    )


def integrands(made: Sequence[Trial]) -> tuple[Expr, ...]:
    """What to integrate, each once."""
    return tuple(dict.fromkeys(expression for trial in made for expression, _ in trial.integrands))


def frozen(made: Sequence[Trial], integrals: Sequence[float]) -> dict[Edge, Frozen]:
    """What holding each signal changes, by the dependencies that would go."""
    value = dict(zip(integrands(made), (float(x) for x in integrals), strict=True))
    found: dict[Edge, Frozen] = {}
    for trial in made:
        change = max((value[e] / most if most else float(value[e] > 0.0) for e, most in trial.integrands), default=0.0)
        for edge in trial.edges:
            signal = edge.variable if edge.variable in dict(trial.held) else trial.held[0][0]
            found[edge] = Frozen(signal, trial.reader, dict(trial.held)[signal], change)
    return found
