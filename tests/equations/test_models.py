"""Models in the language that need loops, inverses, constraints or fields: against an acausal solution of all equations."""

from __future__ import annotations

import numpy as np
import pytest
from evaluate import Direct
from test_random import Point, check_against_acausal

import bgdsl
from bgdsl.ir.program import SolveLinear, SolveNewton

MODELS = {
    "linear loop of resistors": """
      Se drive(e = 5);  J1 i;  R r1(R = 2);  J0 u;  R r2(R = 3);  J1 k;  R r3(R = 4);  C c(C = 2);
    equation
      drive -> i;  i -> r1;  i -> u;  u -> r2;  u -> k;  k -> r3, c;
    """,
    "wheatstone bridge": """
      Se drive(e = 5);  J0 top;  J1 a1;  J1 a2;  J1 b1;  J1 b2;  J1 bridge;  J0 left;  J0 right;
      R ra1(R = 1);  R ra2(R = 2);  R rb1(R = 3);  R rb2(R = 5);  I coil(I = 0.3);
    equation
      drive -> top;  top -> a1;  a1 -> ra1;  a1 -> left;  left -> a2;  a2 -> ra2;
      top -> b1;  b1 -> rb1;  b1 -> right;  right -> b2;  b2 -> rb2;
      left -> bridge;  bridge -> right;  bridge -> coil;
    """,
    "nonlinear loop by Newton": """
      Se drive(e = 5);  J1 i;  R r1(e = 2*f + f^3);  J0 u;  R r2(e = f + 0.1*exp(f));  C c(C = 2);  J1 k;  R r3(R = 1);
    equation
      drive -> i;  i -> r1;  i -> u;  u -> r2;  u -> k;  k -> c, r3;
    """,
    "signals in a loop": """
      J1 v;  I m(I = 2);  MSe push(e = x + y);  R r(R = 1);
      Real x;  Real y;
    equation
      push -> v;  v -> m, r;
      x = 2 - 0.5*y + v.f;
      y = 0.3*sin(x) + v.f^2;
    """,
    "full inertia and stiffness": """
      J1[3] v;  I[3] m(I = [3, 1, 0; 1, 4, 0.5; 0, 0.5, 2]);  C[3] s(k = [5, 1, 0; 1, 4, 1; 0, 1, 6]);
      R[3] r(R = [2, 0.3, 0; 0.3, 1, 0; 0, 0, 1]);
    equation
      v => m, s, r;
    """,
    "five coupled inertias": """
      J1[5] v;  C[5] s(k = 3);
      I[5] m(I = [5, 1, 0, 0.2, 0; 1, 6, 1, 0, 0.1; 0, 1, 4, 1, 0; 0.2, 0, 1, 5, 1; 0, 0.1, 0, 1, 3]);
    equation
      v => m, s;
    """,
    "full inertia behind a gear": """
      J1[2] a;  I[2] near(I = [2, 0.5; 0.5, 1]);  C[2] s(k = 3);
      MTF[2,2] gear(T = [1, 0.3; 0.2, 2]);
      J1[2] b;  I[2] far(I = [1, 0.2; 0.2, 3]);
    equation
      a => near, s;  a => gear => b;  b => far;
    """,
    "conductance matrix used the other way": """
      Sf drive(f = 1);  J0 top;  C c(C = 2);  J1 v;  I m(I = 1);  J1[2] w;  R[2] r(G = [2, 0.5; 0.5, 1]);  I n(I = 2);
    equation
      drive -> top;  top -> c;  top -> v;  v -> m;  v -> w[1];  w[2] -> n;  w => r;
    """,
    "two rigid bodies on one velocity": """
      J1 v;  I a(I = 2);  I b(I = 3);  C s(k = 10);  Se pull(e = 4);
    equation
      pull -> v;  v -> a, b, s;
    """,
    "slider crank, velocities of the piston from the crank": """
      parameter Real r = 0.3;  parameter Real l = 1;
      J1 w;  I crank(I = 0.4);  MTF slide(m = r*sin(phi)*(1 + r*cos(phi)/sqrt(l^2 - (r*sin(phi))^2)));
      J1 v;  I piston(I = 2);  Se gas(e = -3);  R friction(e = 0.2*f*abs(f));
      Real phi(start = 0.4);
    equation
      der(phi) = w.f;
      w -> crank;  w -> slide -> v;  v -> piston, friction;  gas -> v;
    """,
    "transistor": """
      Se supply(e = 9);  Se bias(e = 0.62);  J1 in1;  R rb(R = 4);  Transistor q;  J1 out;  R rc(R = 3);  J0 k;  C load(C = 2);
      J0 base;  C cb(C = 0.7, q(start = 0.4));
    equation
      bias -> in1;  in1 -> rb;  in1 -> base;  base -> cb;  base -> q.b;
      supply -> out;  out -> rc;  out -> k;  k -> load;  k -> q.c;
    """,
    "modulus that reads its own effort": """
      J1 a;  I m(I = 2);  J0 u;  C c(C = 1);  MTF t(m = 1 + 0.1*t.p1.e);
    equation
      a -> m;  a -> t -> u;  u -> c;
    """,
    "energies read by the model": """
      J1 v;  I m(I = 2);  C s(e = 3*q + q^3);  R r(R = 0.5);
      MSe push(e = -0.1*(r.energy + s.energy + m.energy));
    equation
      push -> v;  v -> m, s, r;
    """,
    "gyrators that cancel": """
      J1 a;  I m(I = 2);  GY g1(r = 3);  J0 u;  GY g2(r = 3);  J1 b;  C s(k = 4);  I n(I = 1);
    equation
      a -> m;  a -> g1 -> u;  u -> g2 -> b;  b -> s, n;
    """,
    "prescribed motion of a mass": """
      MSf drive(f = 0.3*cos(2*time));  J1 v;  I m(I = 2);  TF gear(m = 3);  J1 b;  I n(I = 1);  C s(k = 5);
      J1 free;  I f(I = 1);  MSe follow(e = drive.e);
    equation
      drive -> v;  v -> m;  v -> gear -> b;  b -> n, s;
      follow -> free;  free -> f;
    """,
    "rigid joint of two bodies": """
      J1[2] a;  I[2] ma(I = {2, 3});  J1[2] b;  I[2] mb(I = {1, 4});  C[2] s(k = 10);
      MTF[1,2] pin_a(T = [1, 0.2*q]);  MTF[2,1] pin_b(T = [0.5; 1]);  J1[1] joint;
      Real q(start = 0.3);
    equation
      der(q) = a.f[2];
      a => ma, s;  b => mb;
      a => pin_a => joint;  joint => pin_b => b;
    """,
}

TRANSISTOR = """
element Transistor "Ebers-Moll, forward"
  port in Electrical b;
  port in Electrical c;
  parameter Real Is = 0.02; parameter Real beta = 10; constant Real Vt = 0.5;
equation
  b.f = Is/beta*(exp(b.e/Vt) - 1);
  c.f = beta*b.f;
end Transistor;
"""


def load(name: str) -> bgdsl.pipeline.Model:
    return bgdsl.loads(f"{TRANSISTOR}\nmodel Main\n{MODELS[name]}\nend Main;\n", "Main")


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("seed", [0, 1])
def test_against_acausal(name: str, seed: int) -> None:
    model = load(name)
    direct = Direct(model.program)
    x0 = direct.initial_state()
    x = x0 + 0.5 * np.random.default_rng(seed).normal(size=len(x0))
    made = Point(model.program, direct, x)
    assert not model.program.invariants or name == "rigid joint of two bodies"
    graph = model.graph
    if any(state.name.endswith(".energy") for state in model.program.states):
        powers = {name: direct.value(name.replace(".energy", ".power"), x) for name in ("r.energy",)}
        rates = dict(zip((r.name for r in model.program.states), direct.rhs(x), strict=True))
        assert {name: rates[name] for name in powers} == pytest.approx(powers)
        return  # the acausal oracle has no energies
    check_against_acausal(graph, made)


@pytest.mark.parametrize("name", MODELS)
def test_jacobian(name: str) -> None:
    program = load(name).program
    direct = Direct(program)
    x = direct.initial_state() + 0.01
    steps = 1e-6 * np.eye(len(x))
    columns = [(direct.rhs(x + d) - direct.rhs(x - d)) / (2 * np.sum(d)) for d in steps]
    wanted = np.array(columns).T
    assert direct.jacobian(x) == pytest.approx(wanted, rel=1e-6, abs=1e-7 * (1.0 + np.max(np.abs(wanted))))


def test_kinds_of_solution() -> None:
    def kinds(name: str) -> list[type]:
        return [type(step) for step in load(name).program.steps if isinstance(step, SolveLinear | SolveNewton)]

    assert kinds("nonlinear loop by Newton") == [SolveNewton]
    assert kinds("five coupled inertias") == [SolveLinear]
    assert kinds("full inertia and stiffness") == []
    assert kinds("two rigid bodies on one velocity") == []
    assert [len(s.variables) for s in load("wheatstone bridge").program.steps if isinstance(s, SolveLinear)] in ([], [4])


def test_a_loop_that_only_outputs_read_is_no_part_of_the_jacobian() -> None:
    system = bgdsl.loads("""
model Aside
  J1 v;  I m(I = 1, f(start = 1));  R r(R = 1);  output Real x(start = 2);
equation
  v -> m, r;
  x^2 = 4 + v.f;
end Aside;
""").compile()
    assert system.program.jacobian.matrix.shape == (1, 1)
    for method in ("cvode-bdf", "radau"):
        run = system.simulate(stop=1.0, method=method, tolerance=1e-9)
        assert run["x"][-1] == pytest.approx(np.sqrt(4.0 + np.exp(-1.0)), rel=1e-7)
