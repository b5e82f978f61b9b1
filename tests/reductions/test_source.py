"""Classes, files, arrays and layout in reduced source."""

from __future__ import annotations

from pathlib import Path

import pytest
from driving import condition, measure

from bgdsl import pipeline
from bgdsl.ir.rewrite import Rewrite

PART = """// A mass on a spring, with a drag that may be weak.
model Cell "mass, spring and drag"
  open J1 v;
  parameter Real drag = 1e-7;
  I mass(I = 1);   C spring(k = 4);
  R air(R = drag)  "drag";  // hardly felt
equation
  v -> mass, spring;
  v -> air;
end Cell;
"""


def reduced(text: str, threshold: float = 0.01, **more: float) -> tuple[pipeline.Model, Rewrite]:
    model = pipeline.loads(text)
    report = measure(model, stop=3.0, interval=0.1, tolerance=1e-8, **more)
    return model, condition(model, report, threshold)[0]


def recompiled(text: str) -> pipeline.Model:
    model = pipeline.loads(text)
    model.check()
    return model


def test_a_class_whose_instances_change_alike_is_edited_in_place() -> None:
    model, result = reduced(
        f"""{PART}
model Pair
  Cell a(mass(f(start = 1)));
  Cell b(mass(f(start = 2)));
  C tie(k = 1);  J0 f;
equation
  a.v -> f;  f -> b.v;  f -> tie;
end Pair;
"""
    )
    assert not result.opened
    assert "model Cell " in result.text
    assert result.text.count("model Cell") == 1
    assert "R air" not in result.text
    assert "// A mass on a spring, with a drag that may be weak." in result.text
    assert result.forward["a.air"] is None
    assert recompiled(result.text).program.sizes is not None
    assert model.source != result.text


def test_a_class_whose_instances_differ_is_copied_under_a_clear_name() -> None:
    _, result = reduced(
        f"""{PART}
model Pair
  Cell a(mass(f(start = 1)));
  Cell b(mass(f(start = 2)), drag = 1) "strong drag";
  Cell c(mass(f(start = 2)));
  C tie(k = 1);  J0 f;  C bind(k = 1);  J0 g;
equation
  a.v -> f;  f -> b.v;  f -> tie;  b.v -> g;  g -> c.v;  g -> bind;
end Pair;
"""
    )
    assert not result.opened
    assert result.specialised == {"Cell_a": "Cell"}  # `c` shares the copy made for `a`
    assert "  Cell_a a(mass(f(start = 1)));" in result.text
    assert '  Cell b(mass(f(start = 2)), drag = 1) "strong drag";' in result.text
    assert "  Cell_a c(mass(f(start = 2)));" in result.text
    again = recompiled(result.text)
    assert {e.name for e in again.graph.elements} >= {"b.air"}
    assert "a.air" not in {e.name for e in again.graph.elements}


def test_an_array_whose_elements_change_alike_keeps_its_class() -> None:
    _, result = reduced(
        f"""{PART}
model Row
  Cell cell[3](mass(f(start = {{1, 2, 3}})));
  C tie[2](each k = 1);  J0 f[2];
equation
  for i in 1:2 loop
    cell[i].v -> f[i];  f[i] -> cell[i + 1].v;  f[i] -> tie[i];
  end for;
end Row;
"""
    )
    assert not result.opened
    assert "R air" not in result.text
    assert "Cell cell[3](mass(f(start = {1, 2, 3})));" in result.text
    recompiled(result.text)


def test_a_cut_in_a_loop_stays_in_the_loop() -> None:
    _, result = reduced(
        """model Fan
  J1 hub;  I wheel(I = 1e3, f(start = 1));  C coil(k = 1e3);
  J0 rim[3];  C soft[3](k = {1, 100, 100});  J1 far[3];  I bob[3](I = {1e-3, 0.1, 0.1});
equation
  hub -> wheel, coil;
  for i in 1:3 loop
    hub -> rim[i];
    rim[i] -> soft[i], far[i];  far[i] -> bob[i];
  end for;
end Fan;
""",
        0.005,
        max_step=0.01,
    )
    assert not result.opened
    assert "    hub -> hub_rim[i].p1[1];  hub_rim[i].p2[1] -> rim[i];\n" in result.text
    assert "    rim[i] -> soft[i], far[i];  far[i] -> bob[i];\n" in result.text
    again = recompiled(result.text)
    assert len(again.program.states) == len(pipeline.loads(result.text).program.states)


def test_elements_of_an_array_that_differ_get_classes_of_their_own() -> None:
    _, result = reduced(
        f"""{PART}
model Row
  Cell cell[2](mass(f(start = {{1, 2}})), drag = {{1e-7, 1}});
  C tie(k = 1);  J0 f;
equation
  cell[1].v -> f;  f -> cell[2].v;  f -> tie;
end Row;
"""
    )
    assert not result.opened
    assert "  Cell cell[2](mass(f(start = {1, 2})), drag = {1e-7, 1});\n  redeclare Cell_cell_1 cell[1];\n" in result.text
    names = {e.name for e in recompiled(result.text).graph.elements}
    assert "cell[2].air" in names
    assert "cell[1].air" not in names


ROW = """model Mass
  parameter Real m = 1;
  open J1 v;  I body(I = m);  C spring(k = 100);  R damper(R = 0.5);
equation
  v -> body, spring, damper;
end Mass;

model Worn
  extends Mass;
  parameter Real wear[2] = {0.001, 0};  parameter Real seize = 0;
  R rub(R = wear[1]);  R drag(R = seize);
equation
  v -> rub, drag;
end Worn;

model Row
  Mass part[4](m = {1, 2, 3, 4});
  redeclare Worn part[{4, 2}](wear = WEAR, each seize = 0.01) "two worn ones";
  C link[3](each k = 1e3);  J0 gap[3];  MSe push(e = sin(3*time));
equation
  push -> part[1].v;
  for i in 1:3 loop
    part[i].v -> gap[i];  gap[i] -> link[i];  gap[i] -> part[i + 1].v;
  end for;
end Row;
"""


@pytest.mark.parametrize("wear", ["{{2, 3}, {0.001, 4}}", "[2, 3; 0.001, 4]"])
def test_redeclared_elements_that_differ_keep_their_own_values(wear: str) -> None:
    _, result = reduced(ROW.replace("WEAR", wear), 2e-4, max_step=0.01)
    assert not result.opened
    assert '  redeclare Worn part[4](wear = {2, 3}, seize = 0.01) "two worn ones";\n' in result.text
    assert '  redeclare Worn_part_2 part[2](wear = {0.001, 4}, seize = 0.01) "two worn ones";\n' in result.text
    model = recompiled(result.text)
    values = {name: value for p in model.graph.parameters for name, value in zip(p.scalars(), p.values, strict=True)}
    assert [float(values[f"part[{i}].wear[{k}]"].data) for i in (4, 2) for k in (1, 2)] == [2, 3, 0.001, 4]
    assert "part[2].rub" not in {e.name for e in model.graph.elements}


def test_redeclared_elements_whose_values_cannot_be_told_apart_are_written_anew() -> None:
    text = ROW.replace("model Row\n", "model Row\n  constant Real given[2, 2] = [2, 3; 0.001, 4];\n").replace("WEAR", "given")
    _, result = reduced(text, 2e-4, max_step=0.01)
    assert result.opened
    assert result.reasons == ("the elements of `part` differ, whose values are not given one by one where they are redeclared",)


ODD = """model Turn
  parameter Integer n = 2;  parameter Real d = 1;
  port in Generic[2] v;  port out Generic[n] p;
  J1[2] rate;  R[2] drag(R = d*identity(2));
  MTF[n, 2] axes;
equation
  v => rate;  rate => drag;  rate => axes => p;
end Turn;

model Pair
  J1[2] body;  I[2] mass(I = identity(2), f(start = {1, 1}));
  Turn both(axes(T = [1, 1e-4; 1e-4, 1])), one(n = 1, d = 1e-6, axes(T = [1, 1e-4]));
  J0[2] far;  C[2] spring(k = 10*identity(2));
  J0[1] near;  C[1] soft(k = [10]);
equation
  body => mass;  body => both.v;  body => one.v;
  both.p => far;  far => spring;  one.p => near;  near => soft;
end Pair;
"""


def test_a_copy_whose_instances_have_other_sizes_than_its_class_is_right_by_itself(tmp_path: Path) -> None:
    _, result = reduced(ODD, 1e-3)
    assert not result.opened
    assert "PartTF axes(acts = [2, 0; 0, 2]);" in result.text
    assert "PartTF axes(acts = 2*ones(n, 2));" in result.text
    assert "Turn_one one(n = 1, d = 1e-6, axes(T = [1, 1e-4], acts = [2, 0]));" in result.text
    file = tmp_path / "pair.bg"
    file.write_text(result.text, "utf-8")
    assert [found.message for found in pipeline.check_file(file) if found.severity == "error"] == []


def test_files_beside_the_model_are_copied_in(tmp_path: Path) -> None:
    (tmp_path / "cells.bg").write_text(PART, "utf-8")
    main = "import cells.Cell;\n\nmodel One\n  Cell a(mass(f(start = 1)));\n  J0 f;  C tie(k = 1);\n"
    main += "equation\n  a.v -> f;  f -> tie;\nend One;\n"
    (tmp_path / "one.bg").write_text(main, "utf-8")
    model = pipeline.load(tmp_path / "one.bg")
    result, _ = condition(model, measure(model, stop=3.0, interval=0.1, tolerance=1e-8), 0.01)
    assert not result.opened
    assert "import" not in result.text
    assert "// A mass on a spring" in result.text
    assert str(tmp_path) not in result.text
    (tmp_path / "away").mkdir()
    (tmp_path / "away" / "reduced.bg").write_text(result.text, "utf-8")
    pipeline.load(tmp_path / "away" / "reduced.bg").check()


def test_unchanged_library_classes_stay_imported() -> None:
    text = """import mechanics.translational.Spring;
import mechanics.translational.{Mass, Damper};

model Osc
  Mass a(m = 1, v0 = 1), b(m = 2);  Spring s(k = 10);  Damper strong(d = 0.5), weak(d = 1e-7);
equation
  a.v -> s.a;  s.b -> b.v;
  a.v -> strong.a;  strong.b -> b.v;
  a.v -> weak.a;  weak.b -> b.v;
end Osc;
"""
    model = pipeline.loads(text)
    result, decision = condition(model, measure(model, stop=3.0, interval=0.1), 1e-4)
    assert decision.dropped
    assert not result.opened
    assert "import mechanics.translational.Spring;" in result.text
    assert "import mechanics.translational.{Mass, Damper};" in result.text
    assert "Damper strong(d = 0.5)" in result.text


def test_asserted_names_and_strokes_survive() -> None:
    _, result = reduced(
        """model Named
  J1 a;  I ma(I = 100, f(start = 1));  C ka(k = 1e4);
  J0 f;  C kb(k = 10);  J1 b;  I mb(I = 0.01);
  output Real force = pull.e "what b feels";
equation
  a -> ma, ka;
  pull: a -> f;
  f -> kb, b;  b -> mb;
end Named;
""",
        0.02,
    )
    assert not result.opened
    assert "pull: " in result.text
    again = recompiled(result.text)
    assert [record.name for record, _ in again.program.outputs] == ["force"]


def test_tests_of_the_full_model_go_with_their_comments() -> None:
    _, result = reduced(
        f"""{PART}
model One "a cell"
  Cell a(mass(f(start = 1)));
  J0 f;  C tie(k = 1);
equation
  a.v -> f;  f -> tie;
end One;

// A cell swings.
// It does so for long.
test "it moves"
  run r = One for 1;
  assert r.a.v.f(0) == 1 +- 1e-9;
end;
"""
    )
    assert result.specialised == {}
    assert "swings" not in result.text
    assert "for long" not in result.text
    assert "test " not in result.text
    assert "// A mass on a spring, with a drag that may be weak." in result.text
