"""Bonds: names, parts of vectors, ports fused away, conditions."""

from __future__ import annotations

import pytest

from bgdsl import pipeline
from bgdsl.source import Source

PIPE = """
model Pipe
  port in Hydraulic a;  port out Hydraulic b;
  J1 q;  R friction(R = 1);
equation
  a -> q;  q -> friction, b;
end Pipe;
"""


def test_names_are_made_of_the_ends(seen) -> None:
    got = seen("model M\n J1 i; J0 n; I w(I = 1); Se s(e = 1); R r(R = 1);\nequation\n s -> i; i -> w; b4: i -> n; i -> n; n -> r;\nend M;")
    assert list(got.bonds) == ["s_i", "i_w", "b4", "i_n", "n_r"]


def test_a_second_bond_between_the_same_ends_is_numbered(seen) -> None:
    got = seen("model M\n J1 i; J0 n; I w(I = 1); Se s(e = 1); R r(R = 1);\nequation\n s -> i; i -> w; i -> n; i -> n; n -> r;\nend M;")
    assert list(got.bonds) == ["s_i", "i_w", "i_n", "i_n_2", "n_r"]


def test_ports_are_fused(flat) -> None:
    graph = flat(
        PIPE + "model Top\n Pipe p[3]; Se s(e = 1); C tank(C = 1);\nequation\n"
        " s -> p[1].a; p[1].b -> p[2].a; p[2].b -> p[3].a; out: p[3].b -> tank;\nend Top;",
        "Top",
    )
    assert [(b.tail.node, b.head.node) for b in graph.bonds if "friction" not in b.head.node] == [
        ("s", "p[1].q"),
        ("p[1].q", "p[2].q"),
        ("p[2].q", "p[3].q"),
        ("p[3].q", "tank"),
    ]
    last = next(b for b in graph.bonds if b.head.node == "tank")
    assert (last.name, last.aliases) == ("out", ("p[3].q_b",))
    assert last.declared[0][0] == "Hydraulic"


def test_a_name_inside_and_a_port_read_the_fused_bond(seen) -> None:
    text = (
        PIPE.replace("a -> q;", "inlet: a -> q;")
        + """model Top
  Pipe p; Se s(e = 1); C tank(C = 1);
  output Real x = p.a.f;  output Real y = feed.e;  output Real z = p.inlet.power;
equation
  feed: s -> p.a;  p.b -> tank;
end Top;"""
    )
    assert seen(text, "Top").equations == ["x = p.inlet.f", "y = p.inlet.e", "z = p.inlet.e*p.inlet.f"]


def test_a_port_split_into_components(flat) -> None:
    text = """
model Tip
  port in Translational[3] v;
  J1[2] plane;  I[2] m(I = 1);  R fric(R = 1);
equation
  v[1] -> fric;  v[2:3] => plane;  plane => m;
end Tip;
model Top
  Tip tip;  J1[3] w;  Se[3] s(e = {1, 2, 3});
equation
  s => w;  w => tip.v;
end Top;"""
    graph = flat(text, "Top")
    ends = {b.name: (b.size, b.tail.components, b.head.node, b.head.components) for b in graph.bonds}
    assert ends["tip.v_1_fric"] == (None, (0,), "tip.fric", (0,))
    assert ends["tip.v_2_3_plane"] == (2, (1, 2), "tip.plane", (0, 1))


def test_conditional_components_take_their_bonds_along(seen) -> None:
    text = "model M\n parameter Boolean d = false;\n J1 v; I m(I = 1); R r(R = 1) if d; Se s(e = 1);\nequation\n s -> v; v -> m, r;\nend M;"
    assert list(seen(text).laws) == ["m", "s"]
    assert list(seen(text, d=True).laws) == ["m", "r", "s"]


def test_structural_if_and_for(seen) -> None:
    text = """model M
  parameter Integer n = 3;  parameter Boolean closed = false;
  J1 v[n];  J0 F[n];  I m[n](each I = 1);  C c[n](each k = 1);  R r(R = 1);
equation
  for i in 1:n loop
    v[i] -> m[i], F[i];  F[i] -> c[i];
    if i < n then
      F[i] -> v[i + 1];
    end if;
  end for;
  if closed then F[n] -> v[1]; else F[n] -> r; end if;
end M;"""
    assert len(seen(text).bonds) == 12
    assert ("F[3]", "v[1]") in seen(text.replace("R r(R = 1);", ""), closed=True).bonds.values()


def test_two_ports_by_chain_by_halves_and_by_name(seen) -> None:
    head = "model M\n J1 v; J1 u; I m(I = 1); I n(I = 1); Se s(e = 1); TF t(m = 2);\nequation\n s -> v; v -> m; u -> n;"
    for text in ("v -> t -> u;", "v -> t; t -> u;", "t -> u; v -> t;", "v -> t.p1; t.p2 -> u;"):
        ends = set(seen(f"{head} {text}\nend M;").bonds.values())
        assert {("v", "t"), ("t", "u")} <= ends


def test_arrays_of_ports(seen) -> None:
    text = """
model Rail
  parameter Integer n = 2;
  port out Translational pin[n];
  J1 v;  I m(I = 1, f(start = 1));
equation
  v -> m;
  for i in 1:n loop v -> pin[i]; end for;
end Rail;
model Top
  Rail rail(n = 3);  R r[3](R = {1, 2, 3});
equation
  for i in 1:3 loop rail.pin[i] -> r[i]; end for;
end Top;"""
    got = seen(text, "Top")
    assert got.bonds["rail_pin_2_r_2"] == ("rail.v", "r[2]")
    assert got.starts == {"rail.m.f": "1"}


def test_open_junctions_take_bonds_from_outside(seen) -> None:
    text = (
        "model B\n open J1 v; I m(I = 1);\nequation\n v -> m;\nend B;\nmodel Top\n B b; Se s(e = 1); R r(R = 1);\n"
        "equation\n s -> b.v; b.v -> r;\nend Top;"
    )
    assert seen(text, "Top").bonds["b_v_r"] == ("b.v", "r")


def test_user_elements(flat) -> None:
    text = """
element Transistor
  port in Electrical b;  port in Electrical c;
  parameter Real Is = 1e-14; parameter Real beta = 100; constant Real Vt = 0.02585;
  Real heat = b.e*b.f + c.e*c.f;
equation
  b.f = Is/beta*(exp(b.e/Vt) - 1);
  c.f = beta*b.f;
end Transistor;
model Top
  Transistor q1(beta = 50); Se s(e = 1); J0 n; R load(R = 1); Se supply(e = 5); J1 i;
equation
  s -> q1.b;  supply -> i;  i -> load, n;  n -> q1.c;
end Top;"""
    graph = flat(text, "Top")
    q1 = next(e for e in graph.elements if e.name == "q1")
    assert q1.kind == "field"
    assert [(p.name, p.domain, p.inward) for p in q1.ports] == [("b", "Electrical", True), ("c", "Electrical", True)]
    assert len(q1.laws) == 2
    assert [s.name for s in graph.signals] == ["q1.heat"]


def test_a_written_name_goes_before_a_made_one(seen) -> None:
    head = "model M\n J1 i; J0 n; I w(I = 1); Se s(e = 1); R r(R = 1);\nequation\n s -> i; i -> w;"
    for lines in ("i -> n; i_n: n -> r;", "i_n: n -> r; i -> n;"):
        got = seen(f"{head} {lines}\nend M;")
        assert got.bonds["i_n"] == ("n", "r")
        assert got.bonds["i_n_2"] == ("i", "n")


@pytest.mark.parametrize(
    ("bonds", "said"),
    [
        ("v => m; v[1] -> a; v[2] -> b; v[3] -> c;", []),
        ("v => m; v[1] -> a; v[2] -> b;", ["only one bond ends at 1-junction `v[3]`: its effort is zero"]),
        ("v[1] -> a; v[2] -> b; v[3] -> c;", ["only one bond ends at 1-junction `v`: its effort is zero"]),
        ("v[1:2] => n; v[1] -> a; v[2] -> b; v[3] -> c;", ["only one bond ends at 1-junction `v[3]`: its effort is zero"]),
        ("v[1:2] => n; v[1] -> a; v[3] -> c;", ["only one bond ends at each of `v[2]`, `v[3]`: their effort is zero"]),
    ],
)
def test_a_single_bond_at_a_component_names_the_component(bonds: str, said: list[str]) -> None:
    used = [name for name in "mnabc" if f" {name};" in f" {bonds}"]
    kinds = {"m": "I[3] m(I = 1);", "n": "I[2] n(I = 1);"}
    parts = " ".join(kinds.get(name, f"R {name}(R = 1);") for name in used)
    found = pipeline.check_source(Source("test.bg", f"model M\n J1[3] v; {parts}\nequation\n {bonds}\nend M;\n"))
    assert [d.message for d in found if d.code.number == "BG267"] == said
