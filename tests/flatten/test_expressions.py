"""Expressions: arrays, functions, tables, references."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bgdsl.diagnostics import BgError
from bgdsl.expr import evaluate, nodes
from bgdsl.ir.graph import BondGraph

TAIL = (
    "\n J1 v; I m(I = 1); Se s(e = 1); J1[3] w; I[3] J(I = {1, 2, 3}); Se[3] t(e = {1, 1, 1});\nequation\n"
    " s -> v; v -> m; t => w; w => J;\nend M;"
)


def values(graph: BondGraph, name: str) -> list[float]:
    known: dict[str, float] = {}
    for parameter in graph.parameters:
        for scalar, value in zip(parameter.scalars(), parameter.values, strict=True):
            known[scalar] = evaluate(value, known, tables=graph.tables)
    (wanted,) = [p for p in graph.parameters if p.name == name]
    return [known[scalar] for scalar in wanted.scalars()]


@pytest.mark.parametrize(
    ("declared", "wanted"),
    [
        ("x = 2^3 + 7/2 - 1", [10.5]),
        ("x[2] = {1, 2}*2", [2, 4]),
        ("x = {1, 2, 3}*{4, 5, 6}", [32]),
        ("x[2] = [1, 2; 3, 4]*{1, 1}", [3, 7]),
        ("x[2, 2] = [1, 2; 3, 4]*[0, 1; 1, 0]", [2, 1, 4, 3]),
        ("x[2, 2] = [1, 2; 3, 4] .* [2, 2; 2, 2]", [2, 4, 6, 8]),
        ("x[2, 2] = [1, 1; 0, 1]^3", [1, 3, 0, 1]),
        ("x[3] = cross({1, 0, 0}, {0, 1, 0})", [0, 0, 1]),
        ("x[3, 3] = skew({1, 2, 3})", [0, -3, 2, 3, 0, -1, -2, 1, 0]),
        ("x[2, 3] = transpose([1, 2; 3, 4; 5, 6])", [1, 3, 5, 2, 4, 6]),
        ("x[3] = {i^2 for i in 1:3}", [1, 4, 9]),
        ("x[2, 3] = {10*i + j for j in 1:3, i in 1:2}", [11, 12, 13, 21, 22, 23]),
        ("x = sum(i*j for i in 1:3, j in 1:2)", [18]),
        ("x = sum({1, 2, 3}) + product({2, 3}) + max({1, 5, 2}) + min(3, 4)", [20]),
        ("x = mod(-1, 3) + rem(-1, 3) + div(7, 2) + integer(2.9)", [6]),
        ("x[3] = linspace(0, 1, 3)", [0, 0.5, 1]),
        ("x[2] = solve([2, 1; 1, 3], {3, 4})", [1, 1]),
        ("x[2, 2] = inverse([2, 0; 0, 4])", [0.5, 0, 0, 0.25]),
        ("x[3] = solve([2, 1, 0; 1, 3, 1; 0, 1, 2], {3, 5, 3})", [1, 1, 1]),
        ("x[2, 2] = outerProduct({1, 2}, {3, 4})", [3, 4, 6, 8]),
        ("x = size([1, 2; 3, 4; 5, 6], 1)*10 + ndims([1])", [32]),
        ("x[:] = cat(1, {1}, {2, 3})", [1, 2, 3]),
        ("x[2, 3] = [identity(2), {5, 6}]", [1, 0, 5, 0, 1, 6]),
        ("x[2] = [1, 2; 3, 4][2, :]", [3, 4]),
        ("x[2] = {1, 2, 3, 4}[end-1:end]", [3, 4]),
        ("x = if 1 < 2 and not false then 3 else 4", [3]),
        ("x = atan2(1, 1)*4 - pi + Modelica.Constants.pi", [math.pi]),
        ("x[2] = sin({0, pi/2})", [0, 1]),
        ("x = if size({1, 2}, 1) == 2 then 5 else {1, 2}*{1}", [5]),
    ],
)
def test_values(flat, declared: str, wanted: list[float]) -> None:
    graph = flat(f"model M\n parameter Real {declared};{TAIL}")
    assert values(graph, "x") == pytest.approx(wanted)


def test_functions_short_and_long(flat) -> None:
    text = """
function poly(x, c[:]) = sum(c[i]*x^(i - 1) for i in 1:size(c, 1));
function rotated
  input Real a;  input Real v[2];
  output Real w[2];
protected
  Real c = cos(a);  Real s = sin(a);
algorithm
  w[1] := c*v[1] - s*v[2];
  w[2] := s*v[1] + c*v[2];
end rotated;
function total
  input Real v[3];
  output Real y = 0;
algorithm
  for i in 1:3 loop
    y := y + v[i];
  end for;
end total;
function pair(x, y) = {x, x*y};
function column(x) = [x; 2*x];
function half
  input Real x;  input Real by = 2;
  output Real y = x/by;
algorithm
end half;
model M
  parameter Real a = poly(2, {1, 1, 1});  parameter Real b[2] = rotated(pi/2, {1, 0});
  parameter Real c = total({1, 2, 3});  parameter Real d[2] = half({2, 4});  parameter Real e = half(9, by = 3);
  parameter Real g[3,2] = pair({1, 2, 3}, 10);  parameter Real h[2,2,1] = column({1, 3});
"""
    graph = flat(text + TAIL)
    assert values(graph, "a") == [7]
    assert values(graph, "b") == pytest.approx([0, 1])
    assert [values(graph, name) for name in "cde"] == [[6], [1, 2], [3]]
    assert values(graph, "g") == [1, 10, 2, 20, 3, 30], "a function of scalars that gives an array, applied to each entry"
    assert values(graph, "h") == [1, 2, 3, 6]


def test_structural_zeros_survive_products(seen) -> None:
    text = (
        "model M\n parameter Real r[3] = {1, 2, 3};\n"
        " MTF[3, 3] arm(T = identity(3)*skew(r)); J1[3] a; J0[3] b; Se[3] s(e = {1, 1, 1}); C[3] c(k = 1);\nequation\n"
        " s => a; a => arm => b; b => c;\nend M;"
    )
    assert seen(text).modulus["arm"] == [["0", "-r[3]", "r[2]"], ["r[3]", "0", "-r[1]"], ["-r[2]", "r[1]", "0"]]


def test_large_systems_become_unknowns(seen) -> None:
    got = seen(f"model M\n Real x[4] = solve(diagonal({{1, 2, 3, 4}}) + fill(time, 4, 4), {{1, 2, 3, 4}});{TAIL}")
    assert got.equations[0] == "x[1] = solve#1[1]"
    assert sum(equation.startswith("x") for equation in got.equations) == 4
    assert len(got.equations) == 8


def test_tables_from_files_and_by_modification(flat, tmp_path: Path) -> None:
    (tmp_path / "gas.csv").write_text("# pressure\nangle, force\n0, 0\n1, 2\n2, 1\n3, 0\n")
    text = """
model Piston
  parameter Table gas;
  J1 v;  I m(I = 1);  MSe s(e = gas(x));
  Real x(start = 0);
equation
  s -> v;  v -> m;  der(x) = v.f;
end Piston;
model Top
  parameter Table curve = table("gas.csv", x = "angle", y = 2, kind = "cubic", periodic = true);
  Piston a(gas = curve);  Piston b(gas = table({0, 1}, {0, 3}, kind = "linear"));
end Top;
"""
    graph = flat(text, "Top", path=tmp_path / "top.bg")
    assert len(graph.tables) == 2
    first, second = graph.tables.values()
    assert [first(x) for x in (0, 1, 2, 4)] == pytest.approx([0, 2, 1, 2])
    assert first(0.0, 1) == pytest.approx(first(3.0 - 1e-12, 1))
    assert second(0.5) == 1.5


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("t,y\n0,0\n1,x\n", "`x` in line 3 is not a number"),
        ("t,y\n0,0\n0,1\n", "have to increase"),
        ("t,y\n0,0\n", "at least 2 points"),
        ("t,y\n0,0\n1,nan\n", "not finite"),
        ("t,z\n0,0\n1,1\n", "no column `y`"),
    ],
)
def test_bad_tables(flat, tmp_path: Path, rows: str, message: str) -> None:
    (tmp_path / "t.csv").write_text(rows)
    with pytest.raises(BgError, match=message):
        flat(f'model M\n parameter Table g = table("t.csv", x = "t", y = "y");{TAIL}', path=tmp_path / "m.bg")


def test_references_to_parts(seen) -> None:
    text = """model M
  J1 v;  I m(I = 2);  C s(k = 3, q(start = 1));  MTF t(m = s.q);  J1 u;  R r(R = 1);
  Real a = m.power + s.energy;  Real b = t.p1.e*t.p2.f;  Real c = s.k + m.I;  Real d = v.f;
  Real x(start = 0);
equation
  v -> m, s;  v -> t -> u;  u -> r;
  der(x) = der(s.q) + der(2*m.p);
end M;"""
    assert seen(text).equations == [
        "a = m.e*m.f + s.energy",
        "b = t.p1.e*t.p2.f",
        "c = s.k + m.I",
        "d = v.f",
        "der(x) = s.f + 2*m.e",
    ]


def test_components_of_vectors_and_arrays(seen) -> None:
    text = (
        f"model M\n"
        f" Real a = w.f[2];  Real b[2] = J.p[2:3];  Real c = w.f*t.e;  Real d[3] = {{r[i].f for i in 1:3}};  Real g = sum(r.power);\n"
        f" R r[3](each R = 1);{TAIL}"
    )
    text = text.replace("s -> v;", "s -> v; for i in 1:3 loop v -> r[i]; end for;")
    got = seen(text).equations
    assert got[:3] == ["a = w.f[2]", "b[1] = J.p[2]", "b[2] = J.p[3]"]
    assert got[3] == "c = w.f[1]*t.e[1] + w.f[2]*t.e[2] + w.f[3]*t.e[3]"
    assert got[-1] == "g = r[1].e*r[1].f + r[2].e*r[2].f + r[3].e*r[3].f"


def test_nested_classes_and_constants_around_them(seen) -> None:
    text = """model M
  constant Real g = 10;
  model Weight
    parameter Real m = 2;
    J1 v;  I mass(I = m);  Se weight(e = m*g);
  equation
    weight -> v;  v -> mass;
  end Weight;
  Weight a;  Weight b(m = 3);
end M;"""
    assert seen(text).parameters["b.weight.e"] == ["10*b.m"]


def test_imports(flat, tmp_path: Path) -> None:
    (tmp_path / "mech").mkdir()
    (tmp_path / "mech" / "parts.bg").write_text(
        "model Mass\n parameter Real m = 1;\n open J1 v;  I i(I = m);\nequation\n v -> i;\nend Mass;\nfunction twice(x) = 2*x;\n"
    )
    tail = "Se s(e = twice(3));\nequation\n s -> a.v;\nend Top;"
    for head, kind in (
        ("import mech.parts.{Mass, twice};", "Mass"),
        ("import M = mech.parts.Mass; import mech.parts.twice;", "M"),
        ("import mech.parts.twice;", "mech.parts.Mass"),
    ):
        graph = flat(f"{head}\nmodel Top\n {kind} a(m = 5); {tail}", path=tmp_path / "top.bg")
        assert [e.name for e in graph.elements] == ["a.i", "s"]
        assert len(graph.sources) == 2
    graph = flat(f"import mech.parts.{{Mass, twice}};\nmodel Top\n Mass a; {tail}", search=(tmp_path,))
    assert graph.instances[1].class_name == "Mass"


def test_expressions_that_nobody_holds_are_forgotten() -> None:
    nodes._sweep()
    before = len(nodes._table)
    root = nodes.var("forgotten")
    for _ in range(100):
        root = nodes.unary("sin", root) + 1.0
    kept = nodes.var("kept") * 2.0
    nodes._sweep()
    assert len(nodes._table) >= before + 203, "what is held stays, operands too"
    assert nodes.var("kept") * 2.0 is kept
    del root
    nodes._sweep()
    assert ("var", "forgotten", ()) not in nodes._table, "operands go with the last node that holds them"
    assert ("var", "kept", ()) in nodes._table
