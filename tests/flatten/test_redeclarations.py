"""`redeclare` among the items of a model: of a component, and of chosen elements of an array."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgdsl.diagnostics import BgError
from bgdsl.passes import claims
from bgdsl.passes.evaluation import position
from tests.flatten.conftest import Seen, flat_text

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
        " redeclare MTF[2, 2] turn[2:3](each T = [1, a; 0, 1]);\n redeclare J0[2] w[3];\n redeclare C[2] mass[3](k = 5);\n"
        " redeclare I[2] mass[1:2](each I = a);\n"
        "equation\n for i in 1:3 loop s[i] => v[i]; v[i] => turn[i] => w[i]; w[i] => mass[i], r[i]; end for;\nend M;\n"
    )
    graph = flat(text)
    assert {j.name: j.kind for j in graph.junctions if j.name.startswith("w")} == {"w[1]": 1, "w[2]": 1, "w[3]": 0}
    assert {e.name: e.kind for e in graph.elements if e.name.startswith("mass")} == {"mass[1]": "I", "mass[2]": "I", "mass[3]": "C"}
    got = seen(text)
    assert got.modulus["turn[1]"] == [["1", "0"], ["0", "1"]]
    assert got.modulus["turn[2]"] == got.modulus["turn[3]"] == [["1", "a"], ["0", "1"]]


def test_loops_and_values_run_over_an_index_vector(seen) -> None:
    text = (
        "model M\n J1 v; R r[3](each R = 1); I m(I = 1); Se s(e = 1); parameter Integer odd[2] = {1, 3};\n"
        " output Real a[2] = {r[i].e for i in odd}; output Real b = sum(r[i].e for i in {3, 2});\n"
        "equation\n s -> v; v -> m;\n for i in odd loop v -> r[i]; end for;\n for i in {2} loop v -> r[i]; end for;\nend M;\n"
    )
    got = seen(text)
    assert got.equations == ["a[1] = r[1].e", "a[2] = r[3].e", "b = r[3].e + r[2].e"]
    assert list(got.bonds) == ["s_v", "v_m", "v_r_1", "v_r_3", "v_r_2"]


def test_what_differing_elements_share_is_read_as_from_any_array(flat, seen) -> None:
    items = "redeclare Worn part[2](wear = 4);  output Real p[6] = part.body.p;  output Real w = part[2].friction.power;"
    got = seen(rail(items), "Top")
    assert [f"p[{i}] = part[{i}].body.p" for i in range(1, 7)] == got.equations[:6]
    graph = flat(rail(items), "Top", **{"part[2].wear": 7.0, "part[1].m": 8.0})
    values = {p.name: p.values[0].data for p in graph.parameters if p.name in ("part[2].wear", "part[1].m")}
    assert values == {"part[1].m": 8.0, "part[2].wear": 7.0}


def test_experiments_change_differing_elements(flat) -> None:
    graph = flat(rail("redeclare Worn part[2:3](each wear = 4);  experiment e(part(each m = 2), part[2].wear = 5);"), "Top")
    assert {name: value.data for name, value in graph.experiments[0].changes.items()} == {
        **{f"part[{i}].m": 2.0 for i in range(1, 7)},
        "part[2].wear": 5.0,
    }


def test_redeclared_elements_are_inherited_once(flat) -> None:
    """Along two ways to one base, and by two classes that say the same."""
    one = rail("redeclare Worn part[{1, 2}](wear = {3, 4});").replace("model Top", "model One").replace("end Top", "end One")
    two = "model Two\n extends Rail;\n redeclare Worn part[{1, 2}](wear = {3, 4});\nend Two;\n"
    left = "model Left\n extends One;\nend Left;\n"
    for bases in ("One; extends Left", "One; extends Two"):
        assert worn(flat(one + two + left + f"model Top\n extends {bases};\nend Top;\n", "Top")) == ["part[1].friction", "part[2].friction"]
    other = two.replace("{3, 4}", "{3, 5}")
    with pytest.raises(BgError, match="BG211"):
        flat(one + other + "model Top\n extends One; extends Two;\nend Top;\n", "Top")


FINAL = rail("redeclare final Worn part[1];")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (rail("redeclare Worn prt[1];"), "BG220]: `Top` declares and inherits no `prt` to redeclare(.|\n)*did you mean `part`"),
        (rail("redeclare Worn part[1](worn = 2);"), "BG220]: `Worn` has no `worn` to modify(.|\n)*`part.1.` is redeclared here"),
        (rail("redeclare Worn part[1]; experiment e(part(each wear = 2));"), "BG220]: `part.2.`, a `Mass`, has no `wear`"),
        (FINAL + "model B\n Top t(part(each m = 2));\nend B;\n", "BG221]: `part.1.` is final"),
        (FINAL + "model B\n extends Top;\n redeclare Mass part[{1, 2}];\nend B;\n", "BG221]: `part.1.` is final"),
        (rail("redeclare Worn part[1];").replace("Mass part[6]", "final Mass part[6]"), "BG221]: `part` is final"),
        (rail("redeclare Worn part[5:7];"), "BG222]: there is no such element of `part`"),
        (rail("redeclare Worn part[1, 2];"), "BG222]: there is no such element of `part`"),
        (rail("redeclare Se s[1];"), "BG222]: `s` is no array"),
        (rail("redeclare Worn part[1:2](wear = 2);"), "BG222]: `wear` of an array of 2 is modified with one value"),
        (rail("redeclare Worn part[1]; redeclare Worn part[{2, 1}];"), "BG223]: `part.1.` is redeclared twice"),
        (rail("redeclare Worn part[1]; redeclare Worn part;"), "BG223]: `part.1.` is redeclared twice"),
        (rail("redeclare Worn part; redeclare Worn part;"), "BG223]: `part` is redeclared twice"),
        (rail("redeclare Worn part[{2, 2}];"), "BG223]: element 2 of `part` is chosen twice"),
        (
            rail("").replace("extends Rail;", "extends Rail(part[1].m = 2, part[{1, 2}](each m = 3));"),
            "BG223]: `part.1..m` is modified twice",
        ),
        (rail("redeclare Rail part[1];"), "BG224]: `Rail` lacks `port in` `a` of `Mass`"),
        (rail("redeclare TF s;"), "BG224]: `TF` has two ports, `Se` has one port"),
        (rail("parameter Real g[2] = {1, 2};  redeclare Integer g[1];"), "BG224]: the entries of `g` are all of one type"),
        (rail("redeclare Worn part[2]; output Real w[6] = part.wear;"), "BG230]: `part.1.`, a `Mass`, has no `wear`"),
        (rail("redeclare Worn part[2]; R x(R = 1);", "for i in 1:6 loop part[i].friction -> x; end for;"), "BG260]: `part.1.`, a `Mass`"),
    ],
)
def test_mistakes(flat, text: str, said: str) -> None:
    model = "B" if "model B" in text else "Top"
    with pytest.raises(BgError, match=said):
        flat(text, model)


def test_values_of_different_sizes_make_no_array(flat) -> None:
    text = (
        "model One\n parameter Real x = 1;\nend One;\nmodel Two\n parameter Real x[2] = {1, 2};\nend Two;\n"
        "model M\n One q[3];  redeclare Two q[2];  output Real x[3] = q.x;\nend M;\n"
    )
    with pytest.raises(
        BgError, match=r"`x` is not of one size in the elements of `q`(.|\n)*of `q\[1\]` it is a scalar, of `q\[2\]` a vector of 2"
    ):
        flat(text, "M")


def test_what_a_redeclaration_cannot_say(flat) -> None:
    with pytest.raises(BgError, match="it cannot make it `parameter`"):
        flat(rail("redeclare parameter Real m;"), "Top")


def test_each_item_is_looked_at_once_not_once_for_each_element(flat, monkeypatch) -> None:
    looked: list[object] = []
    monkeypatch.setattr(claims, "position", lambda *args: looked.append(args) or position(*args))
    n = 300
    items = "".join(f"redeclare Worn p[{i}](wear = {i});\n" for i in range(1, n + 1))
    loop = f"for i in 1:{n} loop hub -> p[i].a; end for;"
    text = f"{CLASSES}model Top\n J1 hub; Se s(e = 1);\n Mass p[{n}];\n{items}equation\n s -> hub;\n {loop}\nend Top;\n"
    assert len(worn(flat(text, "Top"))) == n
    assert len(looked) == n


@st.composite
def choices(draw: st.DrawFn) -> tuple[list[str | None], list[str]]:
    """For each of six elements its new class, and items that say so with subscripts of all forms."""
    left = draw(st.permutations(range(1, 7)))
    wanted: list[str | None] = [None] * 6
    items: list[str] = []
    while left and draw(st.booleans()):
        count = draw(st.integers(1, len(left)))
        group, left = left[:count], left[count:]
        name = draw(st.sampled_from(["Mass", "Worn"]))
        ordered = sorted(group)
        run = ordered == list(range(ordered[0], ordered[-1] + 1))
        if run and draw(st.booleans()):
            group, subscript = ordered, f"{ordered[0]}:{ordered[-1]}"
        elif count == 1 and draw(st.booleans()):
            subscript = str(group[0])
        else:
            subscript = "{" + ", ".join(map(str, group)) + "}"
        values = ", ".join(str(10 * i) for i in group)
        items.append(f"redeclare {name} part[{subscript}](m = {values if subscript.isdigit() else '{' + values + '}'});")
        for i in group:
            wanted[i - 1] = name
    return wanted, items


@given(choices())
def test_a_redeclared_array_is_the_model_written_out(chosen: tuple[list[str | None], list[str]]) -> None:
    wanted, items = chosen
    one_by_one = "".join(f"{name or 'Mass'} part{i}(m = {10 * i if name else 'm'});\n" for i, name in enumerate(wanted, 1))
    bonds = "".join(f"hub -> part{i}.a;\n" for i in range(1, 7))
    written_out = f"{CLASSES}model Top\nparameter Real m = 3;\nJ1 hub; Se s(e = 1);\n{one_by_one}equation\ns -> hub;\n{bonds}end Top;\n"
    array, plain = Seen(flat_text(rail("\n".join(items)), "Top")), Seen(flat_text(written_out, "Top"))

    def renamed(found: object) -> str:
        return re.sub(r"part_?\[?(\d)\]?", r"part\1", str(found))

    for what in ("laws", "parameters", "bonds"):
        one, other = ({renamed(name): renamed(found) for name, found in getattr(seen, what).items()} for seen in (array, plain))
        assert one == other
