"""Causality of known graphs, its strokes, its messages, its cost."""

from __future__ import annotations

import pytest

from bgdsl.diagnostics import BgError, Reporter, render
from bgdsl.expr import TIME, Expr, unary, var
from bgdsl.ir.causal import CausalGraph
from bgdsl.passes.causality import assign_causality
from bgdsl.passes.scalar import open_vectors
from bgdsl.passes.strokes import strokes_text
from bgdsl.testing.examples import EXAMPLES, geared_masses, pendulum
from bgdsl.testing.graphs import GraphBuilder


def causal_of(graph: GraphBuilder) -> CausalGraph:
    causal = assign_causality(open_vectors(graph.build(), Reporter()), Reporter())
    causal.verify()
    return causal


def setter(causal: CausalGraph, junction: str) -> str | None:
    """The element or bond that determines a junction."""
    names = [j.name for j in causal.scalar.junctions]
    determiner = causal.determiner[names.index(junction)]
    return None if determiner is None else causal.scalar.terms[determiner].element or causal.scalar.terms[determiner].bond


def refused(graph: GraphBuilder) -> str:
    with pytest.raises(BgError) as error:
        causal_of(graph)
    return render(error.value.diagnostics)


@pytest.mark.parametrize(
    ("name", "dependent", "constrained"),
    [
        ("lever", [], 0),
        ("series", [], 0),
        ("parallel", [], 0),
        ("geared", ["m2.p"], 0),
        ("body", [], 0),
        ("arm", [], 0),
        ("pendulum", ["mx.p", "my.p"], 0),
        ("rod", [], 1),
    ],
)
def test_known_graphs(name: str, dependent: list[str], constrained: int) -> None:
    causal = assign_causality(open_vectors(EXAMPLES[name](), Reporter()), Reporter())
    causal.verify()
    assert list(causal.derivative) == dependent
    assert len(causal.constrained) == constrained


def test_the_strokes_of_the_lever() -> None:
    causal = assign_causality(open_vectors(EXAMPLES["lever"](), Reporter()), Reporter())
    assert strokes_text(causal).splitlines() == [
        "vA_massA: vA ->| massA;",
        "vA_springA: vA |-> springA;",
        "vA_damperA: vA |-> damperA;",
        "vA_lever: vA |-> lever;",
        "lever_F2: lever |-> F2;",
        "F2_vkB: F2 |-> vkB;",
        "F2_vB: F2 ->| vB;",
        "vkB_springB: vkB |-> springB;",
        "vkB_damperB: vkB |-> damperB;",
        "vB_massB: vB ->| massB;",
    ]


def test_a_vector_bond_whose_components_differ_is_shown_by_components() -> None:
    g = GraphBuilder()
    g.junction("v", 1, 2)
    g.storage("m", "I", 1.0, size=2)
    g.source("hold", "Sf", 0.0)
    g.bond("v", "m")
    g.bond("hold", "v", at_head=[1])
    assert strokes_text(causal_of(g)).splitlines() == ["v_m[1]: v[1] ->| m[1];", "v_m[2]: v[2] |-> m[2];", "hold_v: hold |-> v[2];"]


def rod(*, bearing: float | None, inertia: bool) -> GraphBuilder:
    g = GraphBuilder()
    g.junction("w", 1)
    phi = g.signal("phi", rate=var("w.f"))
    for name, value in {"x": unary("cos", phi), "y": unary("sin", phi)}.items():
        g.junction(f"v{name}", 1)
        g.two_port(f"t{name}", "MTF", value)
        g.storage(f"m{name}", "I", 1.0)
        g.chain("w", f"t{name}", f"v{name}", f"m{name}")
    if bearing is not None:
        g.resistor("bearing", bearing)
        g.bond("w", "bearing")
    if inertia:
        g.storage("J", "I", 1.0)
        g.bond("w", "J")
    return g


@pytest.mark.parametrize("bearing", [None, 0.1, 0.0])
def test_a_velocity_that_dependent_storages_follow_is_a_state(bearing: float | None) -> None:
    causal = causal_of(rod(bearing=bearing, inertia=False))
    assert list(causal.derivative) == ["mx.p", "my.p"]
    assert [(c.velocity, c.term) for c in causal.constrained] == [(True, None)]


def test_where_more_velocities_than_storages_are_undecided_the_storage_stays_independent() -> None:
    """Two sliders without mass move one mass through moduli that may vanish: one state, and a force between them to be found."""
    g = GraphBuilder()
    for name in ("a", "b", "v"):
        g.junction(name, 1)
    g.junction("z", 0)
    g.storage("m", "I", 1.0)
    phi = g.signal("phi", rate=var("v.f"))
    for name, modulus in (("a", unary("cos", phi)), ("b", unary("sin", phi))):
        g.resistor(f"r{name}", 1.0)
        g.two_port(f"t{name}", "MTF", modulus)
        g.bond(name, f"r{name}")
        g.chain(name, f"t{name}", "z")
    g.chain("z", "v", "m")
    causal = causal_of(g)
    assert not causal.derivative
    assert [(causal.scalar.junctions[c.junction].name, c.velocity) for c in causal.constrained] == [("z", False)]


def test_with_inertia_the_velocity_follows_its_momentum() -> None:
    causal = causal_of(rod(bearing=0.1, inertia=True))
    assert setter(causal, "w") == "J"
    assert not causal.constrained


@pytest.mark.parametrize(("modulus", "dependent"), [(2.0, "m2.p"), (unary("exp", TIME), "m2.p"), (unary("sin", TIME), "m2.p")])
def test_the_first_mass_is_independent_where_its_modulus_allows(modulus: Expr | float, dependent: str) -> None:
    g = GraphBuilder()
    g.junction("a", 1)
    g.junction("b", 1)
    g.storage("m1", "I", 1.0)
    g.storage("m2", "I", 1.0)
    g.two_port("t", "MTF", modulus)
    g.chain("a", "t", "b", "m2")
    g.bond("a", "m1")
    assert list(causal_of(g).derivative) == [dependent]


@pytest.mark.parametrize(("modulus", "dependent"), [(2.0, "m2.p"), (unary("exp", TIME), "m2.p"), (unary("sin", TIME), "m1.p")])
def test_a_modulus_that_may_vanish_is_not_divided_by(modulus: Expr | float, dependent: str) -> None:
    """The first mass is at the port that the flow comes from only by dividing."""
    g = GraphBuilder()
    g.junction("a", 1)
    g.junction("b", 1)
    g.storage("m1", "I", 1.0)
    g.storage("m2", "I", 1.0)
    g.two_port("t", "MTF", modulus)
    g.chain("b", "t", "a", "m1")
    g.bond("b", "m2")
    assert list(causal_of(g).derivative) == [dependent]


def test_an_asserted_stroke_chooses_which_of_two_masses_depends() -> None:
    g = GraphBuilder()
    g.junction("a", 1)
    g.storage("m1", "I", 1.0)
    g.storage("m2", "I", 1.0)
    g.bond("a", "m1", stroke="tail")
    g.bond("a", "m2")
    assert list(causal_of(g).derivative) == ["m1.p"]


def test_a_resistive_loop_is_listed() -> None:
    g = GraphBuilder()
    g.source("s", "Se", 1.0)
    for name, kind in (("i", 1), ("u", 0), ("j", 1)):
        g.junction(name, kind)  # type: ignore[arg-type]
    for name, at in (("r1", "i"), ("r2", "u"), ("r3", "j")):
        g.resistor(name, 1.0)
        g.bond(at, name)
    g.storage("c", "C", 1.0)
    g.chain("s", "i", "u", "j", "c")
    causal = causal_of(g)
    assert [[causal.scalar.junctions[j].name for j in loop] for loop in causal.loops] == [["i", "u", "j"]]


def test_a_constant_singular_matrix_is_used_in_its_own_direction() -> None:
    """w x r alone moves a mass: the skew matrix is not inverted, the mass depends on the inertia."""
    g = GraphBuilder()
    g.junction("w", 1, 3)
    g.junction("v", 1, 3)
    g.storage("mass", "I", 1.0, size=3)
    g.storage("inertia", "I", 1.0, size=3)
    g.two_port("arm", "MTF", [[0.0, 3.0, -2.0], [-3.0, 0.0, 1.0], [2.0, -1.0, 0.0]])
    g.chain("w", "arm", "v", "mass")
    g.bond("w", "inertia")
    assert list(causal_of(g).derivative) == ["mass.p[1]", "mass.p[2]", "mass.p[3]"]


def test_two_effort_sources_are_shown_like_this() -> None:
    g = GraphBuilder("osc")
    g.source("drive", "Se", 10.0)
    g.source("hold", "Se", 2.0)
    g.junction("bus", 0)
    g.bond("drive", "bus")
    g.bond("hold", "bus")
    assert refused(g) == (
        "error[BG401]: two effort sources fix the effort of 0-junction `bus`\n"
        " --> osc.bg:2:1\n"
        "1 | Se drive(e = ...);\n"
        "  | ------------------ first source\n"
        "2 | Se hold(e = ...);\n"
        "  | ^^^^^^^^^^^^^^^^^ second source, here\n"
        "  = note: a 0-junction has one effort; only one bond may set it\n"
        "  = help: put a 1-junction with an R between one source and `bus`"
    )


def test_a_conflict_through_a_chain_names_all_of_it() -> None:
    g = GraphBuilder()
    g.source("left", "Se", 1.0)
    g.source("right", "Se", 2.0)
    for name in "abc":
        g.junction(name, 0)
    g.two_port("s", "TF", 2.0)
    g.two_port("t", "TF", 3.0)
    g.chain("left", "a", "s", "b", "t", "c")
    g.bond("right", "c")
    text = refused(g)
    assert "BG401" in text
    chain = next(line for line in text.splitlines() if "the chain" in line)
    places = [chain.index(f"`{name}`") for name in ("left", "a", "s", "b", "t", "c", "right")]
    assert places == sorted(places) or places == sorted(places, reverse=True)


def test_a_refused_stroke_tells_the_implications() -> None:
    g = GraphBuilder()
    g.source("drive", "Se", 1.0)
    g.junction("a", 0)
    g.two_port("t", "TF", 2.0)
    g.junction("b", 0)
    g.resistor("load", 1.0)
    g.chain("drive", "a", "t", "b")
    g.bond("b", "load", stroke="tail")
    text = refused(g)
    assert "BG404" in text
    assert "`drive` (line 1) gives its effort and sets the effort of `a`" in text
    assert "so `t` (line 3) sets the effort of `b`" in text


def test_derivative_causality_is_one_warning_with_its_path() -> None:
    report = Reporter()
    assign_causality(open_vectors(geared_masses(), report), report)
    (warning,) = report.diagnostics
    assert warning.code.number == "BG420"
    assert warning.notes == (
        "`m1` (line 4) has integral causality and gives its flow: it sets the flow of `v1`",
        "so `gear` (line 6) sets the flow of `v2`",
    )
    report = Reporter()
    assign_causality(open_vectors(pendulum(), report), report)
    assert len(report.diagnostics) == 1


def test_long_rigid_chains_cost_what_they_are_long() -> None:
    """Counting, not timing: every term is set a bounded number of times."""
    g = GraphBuilder()
    n = 60
    for i in range(n):
        g.junction(f"v{i}", 1)
        g.junction(f"f{i}", 0)
        g.storage(f"m{i}", "I", 1.0)
        g.storage(f"k{i}", "C", 1.0)
    for i in range(n):
        g.bond(f"v{i}", f"m{i}")
        g.bond(f"v{i}", f"f{i}")
        g.bond(f"f{i}", f"k{i}")
        if i:
            g.bond(f"f{i - 1}", f"v{i}")
    causal = causal_of(g)
    assert not causal.derivative
    assert {reason.cause for reason in causal.reasons} <= {"storage", "far", "taken", "last"}
