"""Units and domains: what is inferred, what it costs, what is left alone."""

from __future__ import annotations

import subprocess
import sys

import pytest

from bgdsl import loads
from bgdsl.diagnostics import BgError
from bgdsl.ir.graph import Bond, BondGraph
from bgdsl.pipeline import Model

MECHANICS = """
model Wheel "a driven wheel on an axle"
  parameter Real J(unit = "kg.m2") = 1;
  parameter Real m = 2;
  Motor motor;  TF rim(m = 0.3);
  J1 w;  I inertia(I = J);
  J1 v;  I mass(I = m);  C spring(k = 100);
  output Real F = spring.e;
  output Real P = spring.e*v.f;
equation
  motor.shaft -> w;  w -> inertia;  w -> rim -> v;  v -> mass, spring;
end Wheel;

model Motor
  parameter Real R(unit = "Ohm") = 1;
  port out Rotational shaft;
  Se battery(e = 12);  J1 i;  R coil(R = R);  I winding(I = 0.01);  GY motor(r = 0.1);
equation
  battery -> i;  i -> coil, winding;  i -> motor -> shaft;
end Motor;
"""


def bond(graph: BondGraph, name: str) -> Bond:
    return next(bond for bond in graph.bonds if name in (bond.name, *bond.aliases))


@pytest.fixture(scope="module")
def wheel() -> Model:
    return loads(MECHANICS, "Wheel")


def test_domains_reach_as_far_as_bonds_and_no_further(wheel: Model):
    domains = {junction.name: junction.domain for junction in wheel.graph.junctions}
    assert domains == {"w": "Rotational", "v": "Generic", "motor.i": "Generic"}
    assert bond(wheel.graph, "w_inertia").domain == "Rotational"


def test_units_follow_from_domains_and_from_neighbours(wheel: Model):
    units = {parameter.name: parameter.unit for parameter in wheel.graph.parameters if parameter.unit}
    assert units == {"J": "kg.m2", "inertia.I": "kg.m2", "motor.R": "Ohm", "motor.coil.R": "Ohm", "motor.winding.I": "H"}
    assert dict(wheel.graph.units) == {"inertia.p": "N.m.s", "motor.winding.p": "Wb"}


def test_states_of_the_program_have_units(wheel: Model):
    assert {state.name: state.unit for state in wheel.program.states}["motor.winding.p"] == "Wb"


def test_known_units_pass_through_a_transformer_whose_modulus_has_one():
    text = MECHANICS.replace("TF rim(m = 0.3);", 'TF rim(m = r);  parameter Real r(unit = "m") = 0.3;')
    graph = loads(text, "Wheel").graph
    assert {p.name: p.unit for p in graph.parameters}["spring.k"] == "N/m"
    assert {s.name: s.unit for s in graph.signals} == {"F": "N", "P": "W"}


def test_a_message_names_both_units_and_their_places():
    text = MECHANICS.replace("I inertia(I = J)", "I inertia(I = motor.R)")
    with pytest.raises(BgError) as caught:
        loads(text, "Wheel")
    (found,) = caught.value.diagnostics
    assert found.code.number == "BG302"
    assert found.message == "`inertia.I` should be in kg.m2, but `motor.R` in Ohm is given"
    assert found.primary.span.text.startswith("I inertia") or "inertia" in found.primary.span.text
    assert [(label.span.line, label.text) for label in found.others] == [(15, "`motor.R` is in Ohm")]
    assert any("torque in N.m" in note for note in found.notes)


def test_a_repeated_mistake_is_reported_once():
    text = """
model Row
  Cell cell[50];
end Row;
model Cell
  parameter Real m(unit = "kg") = 1;  parameter Real k(unit = "N/m") = 1;
  J1 v;  I mass(I = k);  R damper(R = 1);  C spring(k = m);
equation
  v -> mass, damper, spring;
end Cell;
"""
    with pytest.raises(BgError) as caught:
        loads(text, "Row")
    assert len(caught.value.diagnostics) == 1


def modules_after(text: str) -> set[str]:
    code = f"import sys, bgdsl; bgdsl.loads({text!r}).graph; print(' '.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return set(run.stdout.split())


def test_pint_is_loaded_only_for_units_beyond_the_si():
    plain = "model M J1 v; I m(I = 1); R r(R = 1); equation v -> m, r; end M;"
    assert "pint" not in modules_after(plain)
    assert "pint" not in modules_after(plain.replace("J1 v;", 'parameter Real J(unit = "kg.m2/s2") = 1; J1 v;'))
    assert "pint" in modules_after(plain.replace("J1 v;", 'parameter Real J(unit = "mm") = 1; J1 v;'))


def test_a_model_without_units_is_left_alone():
    from bgdsl.diagnostics import Reporter
    from bgdsl.passes.domains import check_domains
    from bgdsl.passes.units import check_units

    graph = loads("model M J1 v; I m(I = 1); R r(R = 1); equation v -> m, r; end M;").graph
    assert check_units(check_domains(graph, Reporter()), Reporter()) is graph


def test_a_long_chain_of_parameters_needs_no_recursion():
    lines = "\n".join(f"  parameter Real p{i} = p{i - 1} + p{i - 1};" for i in range(1, 3000))
    text = f'model M\n  parameter Real p0(unit = "m") = 0;\n{lines}\n  J1 v; I m(I = 1); R r(R = 1);\nequation\n  v -> m, r;\nend M;'
    graph = loads(text).graph
    assert {p.name: p.unit for p in graph.parameters}["p2999"] == "m"
