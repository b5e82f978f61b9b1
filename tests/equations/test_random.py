"""Random bond graphs: the compiled derivatives against an acausal solution of all equations at once, and general invariants."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from acausal import residual_of, solve_acausal
from evaluate import Direct
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from bgdsl.diagnostics import BgError, Reporter
from bgdsl.expr import var
from bgdsl.ir.graph import BondGraph
from bgdsl.ir.program import Program
from bgdsl.passes.causality import assign_causality
from bgdsl.passes.equations import derive_equations
from bgdsl.passes.lower import lower
from bgdsl.passes.reduce_index import reduce_index
from bgdsl.passes.scalar import open_vectors
from bgdsl.passes.sorting import sort_equations
from bgdsl.testing.examples import EXAMPLES
from bgdsl.testing.strategies import Link, OnePort, Sketch, dual, graph_of, sketches

QUICK = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])


def compile_graph(graph: BondGraph) -> Program:
    report = Reporter()
    causal = assign_causality(open_vectors(graph, report), report)
    ordered = sort_equations(reduce_index(derive_equations(causal, report), report), report)
    ordered.verify()
    program = lower(ordered, report)
    program.verify()
    return program


@dataclass
class Point:
    """A program and a state that satisfies its constraints."""

    program: Program
    direct: Direct
    x: np.ndarray


def point(graph: BondGraph, seed: int) -> Point:
    program = compile_graph(graph)
    direct = Direct(program)
    x = np.random.default_rng(seed).normal(size=len(program.states))
    for _ in range(30):
        if not program.invariants:
            break
        residual = np.array([direct.value(value, x) for value, _ in program.invariants])
        steps = 1e-6 * np.eye(len(x))
        slope = np.array([[(direct.value(v, x + d) - direct.value(v, x - d)) / 2e-6 for d in steps] for v, _ in program.invariants])
        x = x - np.linalg.lstsq(slope, residual, rcond=None)[0]
    return Point(program, direct, x)


def compiled(sketch: Sketch, seed: int) -> Point:
    """A point of the sketch's program; examples without an assignment, or singular, are left aside."""
    try:
        made = point(graph_of(sketch), seed)
        rates = made.direct.rhs(made.x)
        made.direct.variables(made.x)
    except (BgError, np.linalg.LinAlgError, ZeroDivisionError):
        assume(False)
    assume(np.max(np.abs(rates), initial=0.0) < 1e8)  # a loop that is singular but for round-off
    assume(all(abs(made.direct.value(value, made.x)) < 1e-10 for value, _ in made.program.invariants))
    # near a singular configuration (a constraint may lead there) both solutions lose their digits
    assume(all(abs(np.cos(x)) > 1e-2 for x, r in zip(made.x, made.program.states, strict=True) if r.name == "phi"))
    return made


def check_against_acausal(graph: BondGraph, made: Point) -> None:
    names = [record.name for record in made.program.states]
    given_states = dict(zip(names, made.x.tolist(), strict=True))
    solution = solve_acausal(graph, given_states, made.direct.parameters)
    rates = np.array([solution[f"der({name})"] for name in names])
    found = made.direct.rhs(made.x)
    assert found == pytest.approx(rates, rel=1e-6, abs=1e-7 * (1.0 + np.max(np.abs(rates), initial=0.0)))


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_against_acausal(name: str) -> None:
    graph = EXAMPLES[name]()
    check_against_acausal(graph, point(graph, 1))


@QUICK
@given(sketches(sizes=(None, None, 2)), st.integers(0, 10**6))
def test_derivatives_against_acausal(sketch: Sketch, seed: int) -> None:
    check_against_acausal(graph_of(sketch), compiled(sketch, seed))


@QUICK
@given(sketches(), st.integers(0, 10**6))
def test_jacobian_against_differences(sketch: Sketch, seed: int) -> None:
    made = compiled(sketch, seed)
    assume(len(made.x) > 0)
    h = 1e-6
    columns = [(made.direct.rhs(made.x + h * e) - made.direct.rhs(made.x - h * e)) / (2 * h) for e in np.eye(len(made.x))]
    wanted = np.array(columns).T
    scale = 1.0 + np.max(np.abs(wanted)) + np.max(np.abs(made.direct.rhs(made.x)))
    assume(scale < 1e4)
    assert made.direct.jacobian(made.x) == pytest.approx(wanted, abs=1e-7 * scale)


PARALLEL = Sketch(
    junctions=(0, 0, 1),
    ports=(OnePort("c0_0", "C", 0, 0.5, False), OnePort("r1_0", "R", 1, 0.5, False), OnePort("i2_0", "I", 2, 0.5, False)),
    links=(Link("l0", "GY", 1, 0, 0.5), Link("l1", "MTF", 0, 2, 0.5), Link("l2", "MTF", 0, 2, 0.5)),
    size=None,
)
"""Two transformers that may vanish side by side: a constraint whose derivative is there for another reason already."""


@QUICK
@example(PARALLEL, 0)
@given(sketches(sizes=(None, 2)), st.integers(0, 10**6))
def test_every_variable_satisfies_the_acausal_equations(sketch: Sketch, seed: int) -> None:
    """Junction sums, laws and two-ports hold for the efforts and flows that the program reports for the bonds: so the power into
    each junction is zero."""
    made = compiled(sketch, seed)
    graph = graph_of(sketch)
    rates = dict(zip((f"der({r.name})" for r in made.program.states), made.direct.rhs(made.x), strict=True))
    known = {**made.direct.variables(made.x), **rates}
    for record, effort, flow in made.program.bonds:
        known[f"{record.name}.e"] = made.direct._value(effort, known, 0.0)
        known[f"{record.name}.f"] = made.direct._value(flow, known, 0.0)
    for residual in residual_of(graph, made.program.values, made.direct, made.x, known):
        assert abs(residual) < 1e-8 * (1.0 + max(map(abs, known.values())))


@QUICK
@given(sketches(modulated=False))
def test_the_dual_has_the_same_spectrum(sketch: Sketch) -> None:
    # a transformer turned around also turns its power: here it keeps its direction, with the inverse modulus
    links = tuple(replace(link, value=1.0 / link.value) if link.kind in ("TF", "GY") else link for link in sketch.links)
    made, other = compiled(sketch, 0), compiled(replace(dual(sketch), links=links), 0)
    assume(not made.program.invariants and not other.program.invariants)
    assert len(made.x) == len(other.x)
    assume(len(made.x) > 0)
    one, two = (np.poly(each.direct.jacobian(each.x)) for each in (made, other))
    assert one == pytest.approx(two, rel=1e-8, abs=1e-8 * np.max(np.abs(one)))


@QUICK
@given(sketches(), st.integers(0, 10**6))
def test_stored_energy_changes_by_what_sources_give_and_resistors_take(sketch: Sketch, seed: int) -> None:
    made = compiled(sketch, seed)
    program, direct, x = made.program, made.direct, made.x
    assume(not program.invariants)
    graph = graph_of(sketch)
    given_power = sum(direct.value(f"{e.name}.power", x) for e in graph.elements if e.kind in ("Se", "Sf"))
    taken = sum(direct.value(f"{e.name}.power", x) for e in graph.elements if e.kind == "R")
    stored = sum(direct.value(f"{e.name}.power", x) for e in graph.elements if e.kind in ("I", "C"))
    scale = 1.0 + abs(given_power) + abs(taken) + abs(stored)
    assert given_power - taken == pytest.approx(stored, abs=1e-8 * scale)
    h, rate = 1e-6, direct.rhs(x)
    change = (direct.value("energy.total", x + h * rate) - direct.value("energy.total", x - h * rate)) / (2 * h)
    assert change == pytest.approx(stored, abs=1e-5 * scale * (1.0 + np.max(np.abs(rate), initial=0.0)))


def test_values_name_every_variable() -> None:
    program = compile_graph(EXAMPLES["lever"]())
    for name in (
        "massA.p",
        "massA.f",
        "massA.e",
        "vA.f",
        "F2.e",
        "lever.p1.e",
        "lever.p2.f",
        "vA_massA.e",
        "vA_massA.power",
        "massA.energy",
    ):
        assert name in program.values
    assert program.values["massA.f"] is var("vA.f")
    assert set(program.values) >= {f"{r.name}.{x}" for r, _, _ in program.bonds for x in ("e", "f", "power")}
    assert "nonsense" not in program.values
