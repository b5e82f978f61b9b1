"""The scalar normal form: relations of two-ports, merging, matrices, aliases."""

from __future__ import annotations

import numpy as np
import pytest

from bgdsl.diagnostics import Reporter
from bgdsl.expr import evaluate, leaves, to_text
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.passes.scalar import open_vectors
from bgdsl.testing.examples import EXAMPLES
from bgdsl.testing.graphs import GraphBuilder


def opened(g: GraphBuilder) -> ScalarGraph:
    report = Reporter()
    scalar = open_vectors(g.build(), report)
    scalar.verify()
    assert not report.diagnostics
    return scalar


TABLE = {
    ("TF", 1, 0): ("t.m*b.e", "t.m*a.f", [], []),
    ("TF", 1, 1): ("t.m*t.p2.e", "t.p2.e", ["t.p2.e"], ["b.f = t.m*a.f"]),
    ("TF", 0, 0): ("t.p1.f", "t.m*t.p1.f", ["t.p1.f"], ["a.e = t.m*b.e"]),
    ("TF", 0, 1): ("t.p1.f", "t.p2.e", ["t.p1.f", "t.p2.e"], ["a.e = t.m*t.p2.e", "b.f = t.m*t.p1.f"]),
    ("GY", 1, 1): ("t.r*b.f", "t.r*a.f", [], []),
    ("GY", 1, 0): ("t.r*t.p2.f", "t.p2.f", ["t.p2.f"], ["b.e = t.r*a.f"]),
    ("GY", 0, 1): ("t.p1.f", "t.r*t.p1.f", ["t.p1.f"], ["a.e = t.r*b.f"]),
    ("GY", 0, 0): ("t.p1.f", "t.p2.f", ["t.p1.f", "t.p2.f"], ["a.e = t.r*t.p2.f", "b.e = t.r*t.p1.f"]),
}


@pytest.mark.parametrize(("kind", "first", "second"), TABLE)
def test_what_a_two_port_brings(kind: str, first: int, second: int) -> None:
    g = GraphBuilder()
    g.junction("a", first)  # type: ignore[arg-type]
    g.junction("b", second)  # type: ignore[arg-type]
    g.two_port("t", kind, 2.0)
    g.chain("a", "t", "b")
    scalar = opened(g)
    at1, at2, unknowns, relations = TABLE[kind, first, second]
    ends = {term.port: to_text(term.conjugate) for term in scalar.terms}
    assert (ends[0], ends[1]) == (at1, at2)
    assert sorted(scalar.unknowns) == unknowns
    assert sorted(f"{to_text(r.left)} = {to_text(r.right)}" for r in scalar.relations) == relations


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_variable_is_an_unknown_or_an_alias_of_unknowns_and_states(name: str) -> None:
    graph = EXAMPLES[name]()
    scalar = open_vectors(graph, Reporter())
    own = {j.variable for j in scalar.junctions} | set(scalar.unknowns) | {s for e in graph.elements for s in e.states}
    own |= {n for signal in graph.signals for n in signal.scalars()}
    for element in graph.elements:
        for port in element.ports:
            for i in range(port.width):
                for letter in "ef":
                    variable = port.variable(element.name, letter, i)
                    assert (variable in own) != (variable in scalar.aliases), variable
    for value in scalar.aliases.values():
        assert {leaf.data for leaf in leaves((value,))} <= own


def test_merged_junctions_share_their_variable_and_their_bonds_carry_what_lies_beyond() -> None:
    g = GraphBuilder()
    for name in "abc":
        g.junction(name, 1)
    g.source("push", "Se", 3.0)
    g.storage("m", "I", 1.0)
    g.resistor("r", 1.0)
    g.bond("push", "a")
    g.chain("a", "b", "c", "m")
    g.bond("b", "r")
    scalar = opened(g)
    assert [j.members for j in scalar.junctions] == [(("a", 0), ("b", 0), ("c", 0))]
    assert to_text(scalar.aliases["c.f"]) == "a.f"
    assert to_text(scalar.aliases["b_c.e"]) == "m.e"
    assert evaluate(scalar.aliases["a_b.e"], {"m.e": 1.0, "r.e": 2.0}) == 3.0


def test_elements_bonded_directly_meet_in_a_junction_of_their_own() -> None:
    g = GraphBuilder()
    g.source("push", "Se", 3.0)
    g.resistor("r", 1.0)
    g.bond("push", "r")
    scalar = opened(g)
    assert [(j.name, j.kind, j.variable) for j in scalar.junctions] == [("push", 1, "push.f")]
    assert to_text(scalar.aliases["r.f"]) == "push.f"


def test_two_ports_in_a_row_need_no_unknown_but_the_junctions() -> None:
    g = GraphBuilder()
    g.junction("a", 1)
    g.junction("b", 0)
    g.two_port("s", "TF", 2.0)
    g.two_port("t", "TF", 3.0)
    g.chain("a", "s", "t", "b")
    scalar = opened(g)
    assert [(j.name, j.kind) for j in scalar.junctions] == [("a", 1), ("b", 0), ("s.p2", 0), ("t.p1", 1)]
    assert not scalar.unknowns
    assert not scalar.relations


def test_a_matrix_between_junctions_of_the_other_kinds_keeps_junctions_of_its_own() -> None:
    g = GraphBuilder()
    g.junction("a", 0, 2)
    g.junction("b", 1, 2)
    g.two_port("t", "MTF", [[1.0, 2.0], [3.0, 0.0]])
    g.chain("a", "t", "b")
    scalar = opened(g)
    names = {j.name: j.kind for j in scalar.junctions}
    assert names == {"a[1]": 0, "a[2]": 0, "b[1]": 1, "b[2]": 1, "t.p1[1]": 1, "t.p2[1]": 0}
    entries = sorted((term.entry, term.port) for term in scalar.terms if term.is_two_port)
    assert entries == [((0, 0), 0), ((0, 0), 1), ((0, 1), 0), ((0, 1), 1), ((1, 0), 0), ((1, 0), 1)]


def test_power_into_a_matrix_comes_out_of_it() -> None:
    scalar = open_vectors(EXAMPLES["arm"](), Reporter())
    numbers = np.random.default_rng(1)
    values = {name: float(numbers.normal()) for name in [*(j.variable for j in scalar.junctions), *scalar.unknowns, "rx", "ry", "rz"]}

    def of(name: str) -> float:
        return evaluate(scalar.aliases[name], values) if name in scalar.aliases else values[name]

    powers = [sum(of(f"arm.{p}.e[{i}]") * of(f"arm.{p}.f[{i}]") for i in (1, 2, 3)) for p in ("p1", "p2")]
    assert powers[0] == pytest.approx(powers[1], rel=1e-12)


def test_an_euler_structure_makes_no_power() -> None:
    scalar = open_vectors(EXAMPLES["body"](), Reporter())
    values = {f"w.f[{i}]": 0.3 * i for i in (1, 2, 3)} | {f"inertia.p[{i}]": 1.0 / i for i in (1, 2, 3)}
    power = sum(evaluate(scalar.aliases[f"euler.e[{i}]"], values) * values[f"w.f[{i}]"] for i in (1, 2, 3))
    assert power == pytest.approx(0.0, abs=1e-15)


def test_a_vector_bond_in_a_loop_is_warned_about_once() -> None:
    g = GraphBuilder()
    for name in "abc":
        g.junction(name, 0, 3)
    g.chain("a", "b", "c")
    g.bond("a", "c")
    report = Reporter()
    scalar = open_vectors(g.build(), report)
    assert [d.code.number for d in report.diagnostics] == ["BG410"]
    assert sum(inner.loop for inner in scalar.inner) == 3
