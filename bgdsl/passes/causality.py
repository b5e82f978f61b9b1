"""Assign causality: for each scalar junction the one term that sets its variable (SCAP).

Input        ScalarGraph  junction balances by terms
Output       CausalGraph  determiners, strokes, dependent storages, constraints, causal loops
Establishes  each junction has one determiner or is constrained; nothing is divided by a modulus that may vanish; a storage is in
             derivative causality only where the choices fixed before it leave no other way
Reports      BG401 effort fixed twice, BG402 flow fixed twice, BG403 a junction that nothing can set, BG404 a stroke that cannot
             be honoured, BG405 a law that works in one direction only, BG420 derivative causality (warning)

The order is fixed facts (sources, moduli that may vanish, laws of one direction), asserted strokes, storages, resistors and user
elements in the direction their laws are written, then what remains; each in declaration order, each followed to its end.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from bgdsl.diagnostics import Reporter
from bgdsl.ir.causal import CausalGraph, Constrained, Reason
from bgdsl.ir.graph import Element
from bgdsl.ir.scalar import ScalarGraph, Term
from bgdsl.passes.augment import augment, augment_two_port
from bgdsl.passes.causal_constraints import ConstraintCheck
from bgdsl.passes.causal_errors import dependent_storages, needless_derivative, one_way_law, refused_stroke, two_sources
from bgdsl.passes.causal_facts import facts, ports_of, sets
from bgdsl.passes.causal_loops import Graph, causal_loops, dependence, reachable
from bgdsl.passes.causal_story import Step, Story, antecedents
from bgdsl.passes.law_directions import written_direction
from bgdsl.passes.propagation import Assignment, Conflict
from bgdsl.passes.strokes import bond_strokes, demands


def assign_causality(scalar: ScalarGraph, report: Reporter) -> CausalGraph:
    """The scalar graph with causality. Stops with BgError where no assignment has a meaning."""
    scap = _Scap(scalar, report)
    scap.fix()
    report.stop_if_errors()
    scap.assert_strokes()
    scap.prefer_storages()
    scap.choose_free()
    scap.let_followed_be_states()
    scap.check_constraints()
    report.stop_if_errors()
    return scap.result()


class _Scap:
    """One run of the procedure over one scalar graph."""

    def __init__(self, scalar: ScalarGraph, report: Reporter):
        self.scalar = scalar
        self.report = report
        self.state = Assignment(scalar)
        self.story = Story(scalar)
        self.elements = self.story.elements
        self.related = {relation.term for relation in scalar.relations}
        self.constrained: dict[tuple[int, int | None], Constrained] = {}
        self.derivative: dict[str, tuple[int, ...]] = {}
        self.first_dependent: list[Step] = []
        self.decided = 0
        self.ports = ports_of(scalar)
        self.algebraic = [
            term.other is None and term.element is not None and self.elements[term.element].kind in ("R", "field") for term in scalar.terms
        ]

    # ------------------------------------------------------------------------------------------------------------ facts

    def fix(self) -> None:
        """Set all that leaves no choice, then follow it."""
        for term, value, reason in facts(self.scalar, self.ports, self.related):
            conflict = self.state.set(term.index, value, reason)
            if conflict is not None:
                self.settle(conflict)
        for j, at in enumerate(self.scalar.terms_at):
            if not at:
                self.free_junction(j)
            elif len(at) == 1:
                self.state.set(at[0], 1, Reason("last"))
        self.follow()

    def follow(self) -> None:
        """Propagate to the end, putting a constraint wherever a conflict is met."""
        while (conflict := self.state.propagate()) is not None:
            self.settle(conflict)

    # -------------------------------------------------------------------------------------------------------- conflicts

    def settle(self, conflict: Conflict) -> None:
        """Put a constraint (or an error) in the place of a conflict, so that propagation can go on."""
        if conflict.kind == "under":
            self.free_junction(conflict.junction)
            return
        assert conflict.term is not None and conflict.reason is not None
        term = self.scalar.terms[conflict.term]
        wants = 1 - self.state.value[term.index] if self.state.value[term.index] >= 0 else 1
        if term.other is None:
            self.settle_port(term, wants, conflict.reason)
        elif wants:
            self.settle_second(term, conflict.reason)
        else:
            self.state.settled.add((term.index, 0))
            self.release(term)

    def free_junction(self, j: int) -> None:
        """Junction j has no determiner: its variable is a multiplier."""
        state = self.state
        state.free.add(j)
        kind = self.scalar.junctions[j].kind
        names = (self.scalar.terms[t].element for t in self.scalar.terms_at[j])
        wanted = ("Se", "MSe") if kind else ("Sf", "MSf")
        source = next((name for name in names if name is not None and self.elements[name].kind in wanted), None)
        self.constrained[j, None] = Constrained(j, source)

    def settle_port(self, term: Term, wants: int, reason: Reason) -> None:
        """A source or a law of one direction meets a junction that is determined (or can only be determined by it)."""
        j = term.junction
        present = self.state.determiner[j]
        if not wants:
            self.release(term)
            return
        other = self.scalar.terms[present]
        if reason.cause == "source":
            if self.story.is_source(other):
                two_sources(self.story, self.report, other, term)
            self.state.drop(term.index)
            self.constrained[j, term.index] = Constrained(j, term.element, term.index)
        elif self.elements[term.element or ""].kind == "field":
            self.state.drop(term.index)
            self.constrained[j, term.index] = Constrained(j, None, term.index)
        else:
            one_way_law(self.story, self.report, term, 1, self.steps(self.chain([present])))
            self.state.drop(term.index)

    def settle_second(self, term: Term, reason: Reason) -> None:
        """A two-port's term would be the second determiner of its junction."""
        state, j = self.state, term.junction
        assert term.other is not None
        far = self.scalar.terms[term.other]
        present = state.determiner[j]
        state.settled.add((term.index, 1))
        if present >= 0 and self.story.is_source(self.scalar.terms[present]):
            source = self.scalar.terms[present]
            state.replace(term.index, reason)
            self.constrained[j, present] = Constrained(j, source.element, present)
        elif term.index in self.related or far.index in self.related:
            surplus = term if term.index in self.related else far
            state.settled |= {(far.index, 0), (far.index, 1)}
            state.drop(term.index)
            self.constrained[surplus.junction, surplus.index] = Constrained(surplus.junction, None, surplus.index)
        else:
            state.drop(term.index)
            self.release(far)

    def release(self, term: Term) -> None:
        """A term cannot be the determiner that it is: its junction is left without one."""
        self.state.drop(term.index)
        self.free_junction(term.junction)

    # ---------------------------------------------------------------------------------------------------------- choices

    def assert_strokes(self) -> None:
        """Honour asserted strokes, each followed to its end; one that contradicts what is fixed is an error."""
        for bond, wanted in demands(self.scalar):
            mark = self.state.mark()
            conflict: Conflict | None = None
            for term, value in wanted:
                conflict = conflict or self.state.set(term, value, Reason("asserted"))
            conflict = conflict or self.state.propagate()
            if conflict is not None:
                refused_stroke(self.story, self.report, bond, self.steps(self.chain(self.causes(conflict))))
                self.state.undo(mark)
        self.report.stop_if_errors()

    def prefer_storages(self) -> None:
        """Integral causality wherever it can be had."""
        self.decided = self.state.mark()
        for element, term, wanted in self.storages():
            self.prefer_storage(element, term, wanted)

    def storages(self) -> Iterator[tuple[Element, Term, int]]:
        """Every component of every storage with the value of its term in integral causality."""
        for element in self.scalar.graph.elements:
            if element.kind in ("I", "C"):
                for term in self.ports[element.name]:
                    yield element, term, sets(self.scalar, term, element.kind == "C")

    def prefer_storage(self, element: Element, term: Term, wanted: int) -> None:
        state = self.state
        if state.value[term.index] < 0:
            path = self.attempt(term, wanted, Reason("storage"))
            if path is None:
                return
            if self.attempt(term, 1 - wanted, Reason("derivative")) is not None:
                state.set(term.index, wanted, Reason("storage"))
                self.follow()
                return
        elif state.value[term.index] != wanted:
            path = self.steps(self.chain([term.index]))
        else:
            return
        self.first_dependent = self.first_dependent or path
        self.derivative[element.states[term.spot]] = tuple(step.term for step in path)

    def attempt(self, term: Term, value: int, reason: Reason) -> list[Step] | None:
        """Set a term and follow it; on a conflict, the steps that led to it, with everything as before."""
        state = self.state
        mark = state.mark()
        conflict = state.set(term.index, value, reason) or state.propagate()
        if conflict is None:
            return None
        path = self.steps(self.chain([term.index, *self.causes(conflict)]))
        state.undo(mark)
        return path

    def choose_free(self) -> None:
        """Resistors and user elements in the direction of their laws, then whatever is still open; then repair."""
        mark, settled = self.state.mark(), frozenset(self.constrained)
        for element in self.scalar.graph.elements:
            if element.kind in ("R", "field"):
                for term in self.ports.get(element.name, ()):
                    self.choose(term, sets(self.scalar, term, written_direction(element, term) == "e"))
        for term in self.scalar.terms:
            self.choose(term, 1)
        for since in (mark, self.decided):
            self.repair(since, settled)

    def repair(self, since: int, settled: frozenset[tuple[int, int | None]]) -> None:
        """Give junctions that choices left without a determiner one, changing what was decided since then."""
        places = [c for key, c in self.constrained.items() if key not in settled and (c.term is None or c.source is None)]
        if not places:
            return
        soft = [False] * len(self.scalar.terms)
        for t in self.state.trail[since:]:
            soft[t] = True
        for place in places:
            if (place.junction, place.term) not in self.constrained:
                continue
            if augment(self.state, place.junction, soft) if place.term is None else augment_two_port(self.state, place.term, soft):
                self.constrained = {key: c for key, c in self.constrained.items() if self.is_needed(c)}
                self.note_dependent()

    def is_needed(self, place: Constrained) -> bool:
        """Is something still unmet here? A repair may meet two constraints at once."""
        state = self.state
        if place.term is None:
            return state.determiner[place.junction] < 0
        far = state.other[place.term]
        return far < 0 or (state.value[place.term] == state.value[far]) != state.alike[place.term]

    def note_dependent(self) -> None:
        """Which storages have derivative causality, after choices among storages were changed."""
        before = dict(self.derivative)
        self.derivative.clear()
        for element, term, wanted in self.storages():
            if self.state.value[term.index] != wanted:
                name = element.states[term.spot]
                self.derivative[name] = before.get(name) or self.chain([term.index])

    def choose(self, term: Term, value: int) -> None:
        if self.state.value[term.index] >= 0:
            return
        for choice in (value, 1 - value):
            if self.attempt(term, choice, Reason("chosen")) is None:
                return
        self.state.set(term.index, value, Reason("chosen"))
        self.follow()

    # ------------------------------------------------------------------------------------------------------ constraints

    def dependence(self) -> Graph:
        """What each junction's variable and sum is computed from, as far as causality is assigned."""
        surplus = {end for c in self.constrained.values() if c.term is not None for end in (c.term, self.state.other[c.term])}
        return dependence(self.scalar, self.state.determiner, self.state.alike, self.algebraic, surplus)

    def let_followed_be_states(self) -> None:
        """Where a dependent storage follows a variable that no state determines, that variable becomes a state.

        (A rod without inertia that swings a mass through sines and cosines: neither momentum can be the state, the angular
        velocity can.) Resistors at that junction then receive its variable. A stroke that was asserted is not the model's
        doing: there the storage is independent, and the stroke is refused.
        """
        starts = [2 * self.scalar.terms[path[0]].junction for path in self.derivative.values()]
        graph = self.dependence() if starts else []
        followed = [node // 2 for node in reachable(graph, starts) if node % 2 == 0 and self.is_undecided(node // 2)]
        if not followed or self.refuse_derivative(graph):
            return
        for names, junctions in self.followers(graph):
            if len(junctions) > len(names) and all(self.can_be_independent(name) for name in names):
                for name in names:
                    self.make_independent(name)
            else:
                for j in junctions:
                    self.make_state(j)
        self.follow()

    def followers(self, graph: Graph) -> list[tuple[list[str], set[int]]]:
        """Dependent storages with the undecided junctions that they follow, those that share one together."""
        groups: list[tuple[list[str], set[int]]] = []
        for name, path in self.derivative.items():
            start = 2 * self.scalar.terms[path[0]].junction
            found = {node // 2 for node in reachable(graph, [start]) if node % 2 == 0 and self.is_undecided(node // 2)}
            if found:
                apart = [group for group in groups if group[1].isdisjoint(found)]
                shared = [group for group in groups if not group[1].isdisjoint(found)]
                merged = ([n for names, _ in shared for n in names] + [name], found.union(*(junctions for _, junctions in shared)))
                groups = [*apart, merged]
        return groups

    def make_state(self, j: int) -> None:
        """Let junction j's variable be a state."""
        if self.state.determiner[j] >= 0:
            self.state.drop(self.state.determiner[j])
        self.free_junction(j)
        self.constrained[j, None] = replace(self.constrained[j, None], velocity=True)

    def can_be_independent(self, name: str) -> bool:
        """Could the storage determine its junction in place of the two-port or bond that does?"""
        term = self.scalar.terms[self.derivative[name][0]]
        present = self.state.determiner[term.junction]
        return self.state.value[term.index] == 0 and present >= 0 and self.state.other[present] >= 0

    def make_independent(self, name: str) -> None:
        """Give a storage integral causality after all; what determined it (or its junction) before becomes a constraint.

        (Where more undecided variables move it than there are such storages, they cannot all be states; the multiplier of the
        constraint finds its way through the resistors that determine them.)
        """
        state = self.state
        term = self.scalar.terms[self.derivative.pop(name)[0]]
        j = term.junction
        present = state.determiner[j]
        far = self.scalar.terms[state.other[present]]
        state.drop(present)
        state.replace(term.index, Reason("storage"))
        state.settled |= {(end, value) for end in (present, far.index) for value in (0, 1)}
        if state.alike[present]:
            self.release(far)
        else:
            surplus = present if present in self.related else far.index
            self.constrained[state.junction[surplus], surplus] = Constrained(state.junction[surplus], None, surplus)

    def is_undecided(self, j: int) -> bool:
        """Has junction j no determiner yet, or a resistor?"""
        present = self.state.determiner[j]
        return present < 0 or self.algebraic[present]

    def refuse_derivative(self, graph: Graph) -> bool:
        """Report the asserted strokes that put an independent storage into derivative causality."""
        refused = False
        for name, path in self.derivative.items():
            asserted = [t for t in path if self.state.reason[t].cause == "asserted"]
            start = 2 * self.scalar.terms[path[0]].junction
            if asserted and any(node % 2 == 0 and self.is_undecided(node // 2) for node in reachable(graph, [start])):
                bond = self.story.bonds[self.scalar.terms[asserted[0]].bond]
                needless_derivative(self.story, self.report, bond, name, self.scalar.terms[path[0]])
                refused = True
        return refused

    def check_constraints(self) -> None:
        if self.constrained:
            ConstraintCheck(self.story, self.state, self.dependence(), self.constrained, self.report).check_all()

    # ----------------------------------------------------------------------------------------------------- explanations

    def causes(self, conflict: Conflict) -> list[int]:
        """The terms that meet in a conflict."""
        if conflict.kind == "under":
            return list(self.scalar.terms_at[conflict.junction])
        found = [conflict.term] if conflict.term is not None and self.state.value[conflict.term] >= 0 else []
        if conflict.reason is not None and conflict.reason.term is not None:
            found.append(conflict.reason.term)
        if conflict.kind == "over":
            found.append(self.state.determiner[conflict.junction])
        return found

    def steps(self, terms: Iterable[int]) -> list[Step]:
        """What these terms are at this moment, and why."""
        return [Step(t, self.state.value[t], self.state.reason[t]) for t in terms]

    def chain(self, starts: list[int]) -> tuple[int, ...]:
        """The terms from which the values of the start terms follow, as things are at this moment."""
        return antecedents(self.scalar, self.state.reason, starts)

    # ----------------------------------------------------------------------------------------------------------- result

    def result(self) -> CausalGraph:
        state, scalar = self.state, self.scalar
        determiner = tuple(None if t < 0 else t for t in state.determiner)
        loops = causal_loops(self.dependence())
        if self.derivative:
            first = self.first_dependent or self.steps(next(iter(self.derivative.values())))
            dependent_storages(self.story, self.report, self.derivative, first)
        strokes = bond_strokes(scalar, determiner, [value == 1 for value in state.value])
        constrained = tuple(self.constrained.values())
        return CausalGraph(scalar, determiner, strokes, self.derivative, constrained, loops, tuple(state.reason))
