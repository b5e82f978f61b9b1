"""Modifications: the outer one wins, arrays are indexed, values belong to their author's scope."""

from __future__ import annotations

import pytest

from bgdsl.diagnostics import BgError

BODY = """
model Body
  parameter Real m = 1;  parameter Real drag = 2*m;
  open J1 v;  I mass(I = m);  R damper(R = drag);
equation
  v -> mass, damper;
end Body;
"""


def model(declarations: str, equations: str = "") -> str:
    return f"{BODY}\nmodel Top\n{declarations}\nequation\n{equations}\nend Top;\n"


def test_a_value_is_read_where_it_was_written(seen) -> None:
    got = seen(model("parameter Real m = 7;  Body a(m = 3*m);"), "Top")
    assert got.parameters["a.m"] == ["3*m"]
    assert got.parameters["a.drag"] == ["2*a.m"]
    assert got.laws["a.mass"] == ["a.mass.f = a.mass.p/a.mass.I"]


def test_the_outermost_modification_wins(seen) -> None:
    text = BODY + "model Mid\n Body b(m = 2, drag = 5);\nend Mid;\nmodel Top\n Mid x(b(m = 3));\nend Top;\n"
    got = seen(text, "Top")
    assert got.parameters["x.b.m"] == ["3"]
    assert got.parameters["x.b.drag"] == ["5"]


def test_dotted_and_nested_modifications_are_the_same(seen) -> None:
    text = BODY + "model Mid\n Body b;\nend Mid;\nmodel Top\n Mid x(b.m = 3, b.drag = 4);\nend Top;\n"
    got = seen(text, "Top")
    assert (got.parameters["x.b.m"], got.parameters["x.b.drag"]) == (["3"], ["4"])


def test_an_array_modification_is_indexed(seen) -> None:
    got = seen(model("Body b[3](m = {1, 2, 3}, each drag = 9);"), "Top")
    assert [got.parameters[f"b[{i}].m"] for i in (1, 2, 3)] == [["1"], ["2"], ["3"]]
    assert [got.parameters[f"b[{i}].drag"] for i in (1, 2, 3)] == [["9"]] * 3


def test_nested_arrays_are_indexed_from_the_outside(seen) -> None:
    text = BODY + "model Mid\n Body b[2];\nend Mid;\nmodel Top\n Mid x[2](b(m = {{1, 2}, {3, 4}}));\nend Top;\n"
    got = seen(text, "Top")
    assert [got.parameters[f"x[{i}].b[{j}].m"] for i in (1, 2) for j in (1, 2)] == [["1"], ["2"], ["3"], ["4"]]


def test_one_element_of_an_array_is_modified(seen) -> None:
    got = seen(
        model("Body b[3](each m = 1, drag = {1, 2, 3});").replace("Top", "Base") + "model Top\n extends Base(b[2].m = 5);\nend Top;", "Top"
    )
    assert [got.parameters[f"b[{i}].m"] for i in (1, 2, 3)] == [["1"], ["5"], ["1"]]


def test_extends_modifies_elements_and_parameters(seen) -> None:
    text = BODY + "model Top\n extends Body(m = 4, damper(G = 3));\n Se s(e = 1);\nequation\n s -> v;\nend Top;\n"
    got = seen(text, "Top")
    assert got.parameters["m"] == ["4"]
    assert got.laws["damper"] == ["damper.f = damper.G*damper.e"]


def test_a_diamond_is_inherited_once(seen) -> None:
    text = BODY + "model L\n extends Body;\nend L;\nmodel R2\n extends Body;\nend R2;\nmodel Top\n extends L;\n extends R2;\nend Top;\n"
    got = seen(text, "Top")
    assert list(got.laws) == ["mass", "damper"]
    assert len(got.bonds) == 2


def test_redeclare_takes_the_new_class_and_the_arguments(seen) -> None:
    text = BODY + "model Heavy\n extends Body(m = 100);\nend Heavy;\nmodel Mid\n Body b(drag = 1);\nend Mid;\n"
    got = seen(text + "model Top\n Mid x(redeclare Heavy b(m = 200));\nend Top;\n", "Top")
    assert got.parameters["x.b.m"] == ["200"]
    assert got.parameters["x.b.drag"] == ["1"]


def test_redeclared_element(seen) -> None:
    text = BODY + "model Top\n extends Body(redeclare R damper(e = 3*f^3));\nend Top;\n"
    assert seen(text, "Top").laws["damper"] == ["damper.e = 3*damper.f^3"]


def test_a_law_reads_own_variables_then_the_authors(seen) -> None:
    got = seen("model M\n parameter Real k = 2; parameter Real q = 9;\n J1 v; I m(I = 1); C s(e = k*q);\nequation\n v -> m, s;\nend M;")
    assert got.laws["s"] == ["s.e = k*s.q"]


def test_types_bring_units_and_bounds(flat) -> None:
    graph = flat(
        'type Mass = Real(unit = "kg", min = 0);\nmodel M\n parameter Mass m = 2;\n J1 v; I x(I = m); Se s(e = 1);\n'
        "equation\n s -> v; v -> x;\nend M;"
    )
    (m,) = [p for p in graph.parameters if p.name == "m"]
    assert m.unit == "kg"
    assert m.low is not None and m.low[0].data == 0


def test_overrides_set_any_parameter(flat) -> None:
    text = (
        "model M\n parameter Integer n = 2; parameter Real g[n] = fill(1, n);\n J1 v; I x[n](I = g); Se s(e = 1);\n"
        "equation\n s -> v;\n for i in 1:n loop v -> x[i]; end for;\nend M;"
    )
    graph = flat(text, n=4)
    assert [e.name for e in graph.elements] == ["x[1]", "x[2]", "x[3]", "x[4]", "s"]
    assert next(p for p in graph.parameters if p.name == "n").structural
    graph = flat(text, **{"g[2]": 5.0, "s.e": 3})
    values = {p.name: [x.data for x in p.values if x.is_const] for p in graph.parameters}
    assert values["g"] == [1.0, 5.0]
    assert values["s.e"] == [3.0]


def test_an_unknown_override_is_reported(flat) -> None:
    with pytest.raises(BgError, match="there is no parameter `mas`"):
        flat("model M\n parameter Real mass = 2;\n J1 v; I x(I = mass); Se s(e = 1);\nequation\n s -> v; v -> x;\nend M;", mas=3.0)


def test_experiments_build_on_each_other(flat) -> None:
    text = (
        BODY
        + """model Top
  parameter Real gain[3] = {1, 1, 1};
  Body b[2];
  experiment base(stopTime = 2, interval = 0.1, b(each m = 3), gain[1] = 0);
  experiment more extends base(stopTime = 5, b[2](m = 7, damper(R = 1)), method = "rk45", window = {1, 2});
end Top;"""
    )
    base, more = flat(text, "Top").experiments
    assert {name: x.data for name, x in base.changes.items()} == {"b[1].m": 3, "b[2].m": 3, "gain[1]": 0}
    assert {name: x.data for name, x in more.changes.items()} == {"b[1].m": 3, "b[2].m": 7, "gain[1]": 0, "b[2].damper.R": 1}
    assert (more.stop_time, more.interval, more.method, more.window) == (5, 0.1, "rk45", (1, 2))


@pytest.mark.parametrize(
    "said",
    [
        "each m(a = 1), m(b = {3, 4})",
        "m(b = {3, 4}), each m(a = 1)",
        "each m(a = 1), m.b = {3, 4}",
        "q[1].b = {3, 4}, each q(a = {1, 2, 3})",
    ],
)
def test_each_and_not_each_of_one_thing_in_one_place(flat, said: str) -> None:
    text = "model P\n parameter Real a = 1; parameter Real b = 2;\nend P;\nmodel M\n P m;  P q[3];\nend M;\nmodel T\n M x[2](%s);\nend T;\n"
    with pytest.raises(BgError, match=r"BG223\]: `(m|q)` is modified with(out)? `each` and with(out)? it in one place"):
        flat(text % said, "T")


@pytest.mark.parametrize(
    "said", ["m(each a = 9), m(b = {3, 4})", "m(each a = 9, b = {3, 4})", "each m.a = 9, m.b = {3, 4}", "each m(a = 9), each m.b = 3"]
)
def test_what_is_said_in_parts_adds_up(seen, said: str) -> None:
    text = "model P\n parameter Real a = 1; parameter Real b = 2;\nend P;\nmodel M\n P m;\nend M;\nmodel T\n M x[2](%s);\nend T;\n"
    got = seen(text % said, "T").parameters
    assert [got[f"x[{i}].m.a"] for i in (1, 2)] == [["9"], ["9"]]
    assert got["x[1].m.b"] == ["3"]


ENTRIES = "model Mid\n parameter Real g[4] = {1, 2, 3, 4};\nend Mid;\n"


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        ("g[2] = 9", "1 9 3 4"),
        ("g[2:3] = {8, 9}", "1 8 9 4"),
        ("g[{4, 1}] = {8, 9}", "9 2 3 8"),
        ("each g[3:end] = 0", "1 2 0 0"),
        ("g[2] = 9, g[3] = 8", "1 9 8 4"),
        ("g = {5, 6, 7, 8}, g[1] = 0", "0 6 7 8"),
    ],
)
def test_entries_are_chosen_like_elements(seen, said: str, wanted: str) -> None:
    assert seen(f"{ENTRIES}model T\n Mid x({said});\nend T;\n", "T").parameters["x.g"] == wanted.split()
    got = seen(f"{ENTRIES}model T\n Mid x;\n experiment e(x({said}));\nend T;\n", "T")
    assert got.changes["e"] == {f"x.g[{i}]": v for i, (v, old) in enumerate(zip(wanted.split(), "1234", strict=True), 1) if v != old}


def test_entries_in_an_array_of_parts_are_indexed(seen) -> None:
    got = seen(f"{ENTRIES}model T\n Mid x[2](g[1] = {{8, 9}}, each g[2] = 7, g[3:4] = {{{{1, 2}}, {{5, 6}}}});\nend T;\n", "T").parameters
    assert (got["x[1].g"], got["x[2].g"]) == (["8", "7", "1", "2"], ["9", "7", "5", "6"])


@pytest.mark.parametrize(
    ("said", "wrong"),
    [
        ("g[5] = 1", "BG222]: there is no such element of `g`"),
        ("g[1, 2] = 1", "BG222]: there is no such element of `g`"),
        ("g[1:2] = 1", "BG222]: `g` of an array of 2 is modified with one value"),
        ("g[1] = {1, 2}", r"BG222]: `g\[1\]` is a single value"),
        ("g[1](min = 0)", "BG222]: an entry of `g` has a value, and nothing else"),
        ("g[1] = 2, g[1:2] = {3, 4}", r"BG223]: `g\[1\]` is modified twice in one place"),
    ],
)
def test_entries_that_are_not_there(flat, said: str, wrong: str) -> None:
    for text in (f"Mid x({said});", f"Mid x; experiment e(x({said}));"):
        with pytest.raises(BgError, match=wrong):
            flat(f"{ENTRIES}model T\n {text}\nend T;\n", "T")
