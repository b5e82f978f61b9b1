"""Random bond graphs: promises of the forms, duality, order of statements, and brute force over all assignments."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from random import Random

import pytest
from hypothesis import HealthCheck, assume, given, reject, settings
from hypothesis import strategies as st

from bgdsl.diagnostics import BgError, Reporter
from bgdsl.ir.causal import CausalGraph
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.passes.causality import assign_causality
from bgdsl.passes.moduli import Moduli
from bgdsl.passes.propagation import ends_alike
from bgdsl.passes.scalar import open_vectors
from bgdsl.testing.strategies import Link, OnePort, Sketch, dual, graph_of, sketches

QUICK = settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])


def scalar_of(sketch: Sketch) -> ScalarGraph:
    scalar = open_vectors(graph_of(sketch), Reporter())
    scalar.verify()
    return scalar


def causal_of(sketch: Sketch) -> CausalGraph | None:
    try:
        causal = assign_causality(scalar_of(sketch), Reporter())
    except BgError:
        return None
    causal.verify()
    return causal


@QUICK
@given(sketches(sizes=(None, 1, 2, 3)))
def test_the_forms_keep_their_promises(sketch: Sketch) -> None:
    scalar = scalar_of(sketch)
    variables = len(scalar.junctions) + len(scalar.unknowns)
    laws = sum(len(element.laws) for element in scalar.graph.elements)
    assert variables == len(scalar.junctions) + laws + len(scalar.relations), "as many equations as unknowns"
    causal = causal_of(sketch)
    if causal is not None:
        assert set(causal.strokes) == {bond.name for bond in scalar.graph.bonds}


@QUICK
@given(sketches(sizes=(None, 2)))
def test_sources_and_integral_storages_get_their_strokes(sketch: Sketch) -> None:
    causal = causal_of(sketch)
    assume(causal is not None)
    assert causal is not None
    surplus = {c.term for c in causal.constrained}
    for term in causal.scalar.terms:
        element = next((e for e in causal.scalar.graph.elements if e.name == term.element), None)
        if element is None or term.other is not None or element.kind == "R" or term.index in surplus:
            continue
        effort_acts_on_element = (causal.strokes[term.bond][term.component or 0] == "head") == (element.kind in ("I", "C", "R"))
        dependent = bool(element.states) and element.states[term.spot] in causal.derivative
        wanted = element.kind in ("I", "Sf")
        assert effort_acts_on_element == (wanted != dependent), term


@QUICK
@given(sketches(modulated=False))
def test_the_dual_graph_has_the_dual_causality(sketch: Sketch) -> None:
    causal, other = causal_of(sketch), causal_of(dual(sketch))
    assert (causal is None) == (other is None)
    if causal is None or other is None:
        return

    def states(graph: CausalGraph) -> set[str]:
        return {name.partition(".")[0] for name in graph.derivative}

    assert states(causal) == states(other)
    assert [c.junction for c in causal.constrained] == [c.junction for c in other.constrained]


def dependent_by_order(sketch: Sketch, seed: int) -> list[set[str] | None]:
    """The dependent states with the bond statements in their order and in another one; None where causality is refused."""
    graph = graph_of(sketch)
    bonds = list(graph.bonds)
    Random(seed).shuffle(bonds)
    found: list[set[str] | None] = []
    for one in (graph, replace(graph, bonds=tuple(bonds))):
        try:
            causal = assign_causality(open_vectors(one, Reporter()), Reporter())
            causal.verify()
            found.append(set(causal.derivative))
        except BgError:
            found.append(None)
    return found


@QUICK
@given(sketches(loops=0, modulated=False), st.integers(0, 10**6))
def test_the_order_of_bond_statements_does_not_change_which_storages_depend(sketch: Sketch, seed: int) -> None:
    first, second = dependent_by_order(sketch, seed)
    assert first == second


@QUICK
@given(sketches(), st.integers(0, 10**6))
def test_the_order_of_bond_statements_does_not_change_how_many_storages_depend(sketch: Sketch, seed: int) -> None:
    """In loops of the junction structure, which of them depend may be a matter of order."""
    first, second = dependent_by_order(sketch, seed)
    assume(first is not None and second is not None)
    assert first is not None and second is not None
    assert len(first) == len(second)


def all_assignments(scalar: ScalarGraph) -> list[set[str]]:
    """The sets of dependent states of every assignment that the rules allow, by trying all of them."""
    moduli = Moduli(scalar.graph)
    alike = ends_alike(scalar)
    related = {relation.term for relation in scalar.relations}
    elements = {element.name: element for element in scalar.graph.elements}
    free: list[int] = []
    fixed: dict[int, int] = {}
    for term in scalar.terms:
        kind = scalar.junctions[term.junction].kind
        element = elements.get(term.element or "")
        if term.other is None and element is not None and element.kind in ("Se", "Sf"):
            fixed[term.index] = int((element.kind == "Se") == (kind == 0))
        elif term.modulus is not None and moduli.can_vanish(term.modulus):
            fixed[term.index] = int(term.index in related)
        elif term.other is None or term.other > term.index:
            free.append(term.index)
    if len(free) > 14:
        reject()
    found = []
    for values in product((0, 1), repeat=len(free)):
        value = dict(fixed) | dict(zip(free, values, strict=True))
        for t in free:
            other = scalar.terms[t].other
            if other is not None:
                value[other] = value[t] if alike[t] else 1 - value[t]
        if all(sum(value[t] for t in at) == 1 for at in scalar.terms_at):
            found.append(set(_dependent(scalar, value)))
    return found


def _dependent(scalar: ScalarGraph, value: dict[int, int]) -> list[str]:
    elements = {element.name: element for element in scalar.graph.elements}
    names = []
    for term in scalar.terms:
        element = elements.get(term.element or "")
        if term.other is None and element is not None and element.states:
            wanted = int((element.kind == "C") == (scalar.junctions[term.junction].kind == 0))
            if value[term.index] != wanted:
                names.append(element.states[term.spot])
    return names


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
@given(sketches(most=4, loops=2))
def test_no_other_assignment_has_fewer_dependent_storages(sketch: Sketch) -> None:
    scalar = scalar_of(sketch)
    possible = all_assignments(scalar)
    causal = causal_of(sketch)
    if possible:
        assert causal is not None, "there is an assignment"
        fewest = min(map(len, possible))
        promoted = any(c.velocity for c in causal.constrained)
        assert promoted or len(causal.derivative) == fewest
        assert promoted or not causal.constrained
    elif causal is not None:
        assert causal.constrained, "without an assignment something is constrained"


@pytest.mark.xfail(strict=True, reason="an algebraic constraint is chosen where one dependent storage would do; the numbers agree")
def test_a_modulated_branch_that_only_dissipates() -> None:
    sketch = Sketch(
        junctions=(1, 0, 0),
        ports=(
            OnePort(name="c0_0", kind="C", at=0, value=0.5, inverse=False),
            OnePort(name="r0_1", kind="R", at=0, value=0.5, inverse=False),
            OnePort(name="c1_0", kind="C", at=1, value=0.5, inverse=False),
            OnePort(name="r2_0", kind="R", at=2, value=0.5, inverse=False),
        ),
        links=(
            Link(name="l0", kind="bond", tail=1, head=0, value=0.5),
            Link(name="l1", kind="MTF", tail=1, head=2, value=0.5),
        ),
    )
    test_no_other_assignment_has_fewer_dependent_storages.hypothesis.inner_test(sketch)
