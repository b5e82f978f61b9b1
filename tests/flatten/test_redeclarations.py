"""`redeclare` among the items of a model: of a component, and of chosen elements of an array."""

from __future__ import annotations

import pytest

from bgdsl.diagnostics import BgError

CLASSES = """
model Mass "a mass"
  parameter Real m = 1;
  port in Generic a;
  J1 v;  I body(I = m);
equation
  a -> v;  v -> body;
end Mass;

model Worn "a mass that rubs"
  parameter Real m = 1;  parameter Real wear = 0.5;
  port in Generic a;
  J1 v;  I body(I = m);  R friction(R = wear);
equation
  a -> v;  v -> body, friction;
end Worn;

model Rail "six of them"
  parameter Real m = 3;
  J1 hub;  Se s(e = 1);
  Mass part[6](each m = m);
equation
  s -> hub;
  for i in 1:6 loop hub -> part[i].a; end for;
end Rail;
"""


def rail(items: str, equations: str = "") -> str:
    return f"{CLASSES}model Top\n  extends Rail;\n{items}\nequation\n{equations}\nend Top;\n"


def worn(graph) -> list[str]:
    return [e.name for e in graph.elements if e.name.endswith(".friction")]


def test_chosen_elements_are_of_another_class(flat) -> None:
    graph = flat(rail("redeclare Worn part[1];  redeclare Worn part[{3, 5}];"), "Top")
    assert worn(graph) == ["part[1].friction", "part[3].friction", "part[5].friction"]
    assert {i.path: i.class_name for i in graph.instances if i.path.startswith("part")} == {
        f"part[{i}]": "Worn" if i in (1, 3, 5) else "Mass" for i in range(1, 7)
    }


@pytest.mark.parametrize(
    ("subscript", "chosen"),
    [("2:4", [2, 3, 4]), (":", [1, 2, 3, 4, 5, 6]), ("end", [6]), ("1:2:end", [1, 3, 5]), ("2:1", []), ("{6, 1}", [1, 6])],
)
def test_subscripts_are_those_of_any_array(flat, subscript: str, chosen: list[int]) -> None:
    assert worn(flat(rail(f"redeclare Worn part[{subscript}];"), "Top")) == [f"part[{i}].friction" for i in chosen]


def test_own_modifications_are_indexed_among_the_chosen(seen) -> None:
    got = seen(rail("redeclare Worn part[{5, 2}](wear = {7, 8}, each m = 9);  redeclare Worn part[4](wear = 6);"), "Top")
    assert [got.parameters[f"part[{i}].wear"] for i in (5, 2, 4)] == [["7"], ["8"], ["6"]]
    assert [got.parameters[f"part[{i}].m"] for i in range(1, 7)] == [["m"], ["9"], ["m"], ["m"], ["9"], ["m"]]


def test_the_declarations_modifications_are_indexed_as_before(seen) -> None:
    text = CLASSES + (
        "model Top\n J1 hub; Se s(e = 1);\n redeclare Worn part[2];\n Mass part[3](m = {1, 2, 3});\n"
        "equation\n s -> hub;\n for i in 1:3 loop hub -> part[i].a; end for;\nend Top;\n"
    )
    got = seen(text, "Top")
    assert [got.parameters[f"part[{i}].m"] for i in (1, 2, 3)] == [["1"], ["2"], ["3"]]
    assert got.parameters["part[2].wear"] == ["0.5"]


def test_who_wins(seen) -> None:
    """The declaration, `extends`, the item, who extends again or uses the class: each wins over what stands before it."""
    base = rail("").replace("extends Rail;", "extends Rail(part(each m = 4));  redeclare Worn part[1](m = 5, wear = 6);")
    assert seen(base, "Top").parameters["part[1].m"] == ["5"]
    assert seen(base, "Top").parameters["part[2].m"] == ["4"]
    outer = base + "model Outer\n Top t(part(each m = 7), part[1].wear = 8);\nend Outer;\n"
    got = seen(outer, "Outer")
    assert (got.parameters["t.part[1].m"], got.parameters["t.part[1].wear"]) == (["7"], ["8"])
    again = base + "model Again\n extends Top(part[1].m = 9);\n redeclare Worn part[1](wear = 10);\nend Again;\n"
    got = seen(again, "Again")
    assert (got.parameters["part[1].m"], got.parameters["part[1].wear"]) == (["9"], ["10"])
    back = base + "model Back\n Top t(redeclare Worn part[6](wear = 3), redeclare Mass part[2]);\nend Back;\n"
    assert [name for name in seen(back, "Back").laws if name.endswith("friction")] == ["t.part[1].friction", "t.part[6].friction"]


def test_a_whole_component_is_redeclared(seen) -> None:
    got = seen(rail('redeclare Worn part(each wear = 2) "all of them";  redeclare MSe s(e = 3*hub.f);', ""), "Top")
    assert [got.parameters[f"part[{i}].wear"] for i in (1, 6)] == [["2"], ["2"]]
    assert got.laws["s"] == ["s.e = 3*hub.f"]


def test_built_in_classes_and_their_sizes(flat, seen) -> None:
    text = (
        "model M\n parameter Real a = 2;\n J1[2] v[3]; Se[2] s[3](each e = {1, 2}); MTF[2, 2] turn[3](each T = identity(2));\n"
        " J1[2] w[3]; I[2] mass[3]; R[2] r[3](each R = 1);\n"
        " redeclare MTF[2, 2] turn[2:3](each T = [1, a; 0, 1]);\n redeclare J0[2] w[3];\n redeclare C[2] mass[3](k = 5);  redeclare I[2] mass[1:2](each I = a);\n"
        "equation\n for i in 1:3 loop s[i] => v[i]; v[i] => turn[i] => w[i]; w[i] => mass[i], r[i]; end for;\nend M;\n"
    )
    graph = flat(text)
    assert {j.name: j.kind for j in graph.junctions if j.name.startswith("w")} == {"w[1]": 1, "w[2]": 1, "w[3]": 0}
    assert {e.name: e.kind for e in graph.elements if e.name.startswith("mass")} == {"mass[1]": "I", "mass[2]": "I", "mass[3]": "C"}
    got = seen(text)
    assert got.modulus["turn[1]"] == [["1", "0"], ["0", "1"]]
    assert got.modulus["turn[2]"] == got.modulus["turn[3]"] == [["1", "a"], ["0", "1"]]
