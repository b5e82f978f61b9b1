"""Layouts that the formatter makes, and the texts that it leaves alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from bgdsl.diagnostics import BgError, Reporter
from bgdsl.source import Source
from bgdsl.syntax.formatter import WIDTH, format_source

ROOT = Path(__file__).parent.parent.parent

LEFT_ALONE = """\
// The illustrative example
model Lever "two mass-spring-dampers coupled by a lever"
  parameter Real mA(unit = "kg") = 10;    parameter Real mB(unit = "kg") = 1;
  parameter Real kA(unit = "N/m") = 1e3;  parameter Real kB(unit = "N/m") = 100;
  parameter Real RA(unit = "N.s/m") = 20; parameter Real RB(unit = "N.s/m") = 2;

  J1 vA;  I massA(I = mA, f(start = 1));  C springA(k = kA);  R damperA(R = RA);
  open J1[3] v;  I[3] mass(I = m*identity(3));    EJS[3] coriolis(G = m*skew(w.f))      "w x p";
  open J1[3] w;  I[3] inertia(I = diagonal(J));   EJS[3] euler(G = -skew(inertia.p))    "w x h";
  Cylinder cyl[6](each bore = 0.13);
  redeclare Misfiring cyl[1];  redeclare Worn cyl[{2, 5}](each wear = 0.1) "two worn ones";
  redeclare final MTF[3, 3] turn[3:end](each T = M .* R, final x = 2);
  // before the experiment
  experiment kick(stopTime = 20, interval = 1e-2, tolerance = 1e-8);
// before the equations
equation
  vA -> massA, springA, damperA;  // with a note
  b4: F2 -> vkB;  vkB -> springB, damperB;
  for i in 1:3 loop a[i] -> b[i]; end for;
  if n > 1 then
    x = if a then -1 else 2*x^-2;
  elseif not b then
    x = [1, 0, 0;
         0, 1, 0];
  else
    x = 3;  /* a part */
  end if;
  // at the end
end Lever;

function saturated "a smooth limit"
  input Real x;
  output Real y;
protected
  Real share;  Real most;
  protected Real other;
algorithm
  y := x;
end saturated;

test "no energy is made"
  run r = Lever(RA = 0) for 10 tolerance 1e-9;
  assert (r.vA.f(end) - 1) == 0.1234 +- 2 %;
end;
"""


def formatted(text: str) -> str:
    return format_source(Source("case.bg", text), Reporter())


def test_a_good_layout_is_left_alone() -> None:
    assert formatted(LEFT_ALONE) == LEFT_ALONE


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (
            'model  A   "x"   parameter Real a=-1 ;J1  v ( a=b*c+d  , e = { 1,2 } ) ;\n\n\nequation a=>b,c  ; x =f ( 1,-y ) [ 2 ]; end A ;',
            'model A "x"\n  parameter Real a = -1; J1 v(a = b*c + d, e = {1, 2});\n\nequation\n  a => b, c; x = f(1, -y)[2];\nend A;\n',
        ),
        (
            "model A equation for i in 1 : 3 loop\na->b;end for;if c then a->b; else\n c->d; end if; end A;",
            "model A\nequation\n  for i in 1:3 loop\n    a -> b;\n  end for; if c then a -> b; else\n    c -> d; end if;\nend A;\n",
        ),
        (
            "model A R method , interval( R= R );input Real in ; end A;",
            "model A\n  R method, interval(R = R); input Real in;\nend A;\n",
        ),
        (
            "function f(x,y [3])=2. *x.^2;function g input Real x;output Real y;algorithm y:=x;end g;",
            "function f(x, y[3]) = 2. *x .^ 2;\nfunction g\n  input Real x; output Real y;\nalgorithm\n  y := x;\nend g;\n",
        ),
        ("import a . b . { C , D } ;\r\nimport M=a.b.C;", "import a.b.{C, D};\nimport M = a.b.C;\n"),
        ("// only a comment", "// only a comment\n"),
        ("", ""),
    ],
)
def test_layout(before: str, after: str) -> None:
    assert formatted(before) == after


def test_long_lines_are_broken_at_commas() -> None:
    terms = ", ".join(f"coefficient_{i} = {i}" for i in range(20))
    lines = formatted(f"model A\n  Pump pump({terms});\nend A;\n").splitlines()
    assert all(len(line) <= WIDTH for line in lines)
    assert len(lines) == 6
    assert lines[2].startswith("    coefficient_")


def test_comments_inside_statements_stay() -> None:
    text = formatted("model A\n R r(R = 1, // the first\n k = 2 /* the second */);\nend A;\n")
    assert text == "model A\n  R r(R = 1, // the first\n    k = 2 /* the second */);\nend A;\n"


def test_a_text_with_errors_is_not_formatted() -> None:
    with pytest.raises(BgError):
        formatted("model A\n R r(3);\nend A;\n")


@pytest.mark.parametrize("path", sorted([*(ROOT / "models").glob("*.bg"), *(ROOT / "bgdsl/library").rglob("*.bg")]), ids=lambda p: p.name)
def test_every_model_that_ships_can_be_formatted(path: Path) -> None:
    text = path.read_text("utf-8")
    again = formatted(text)
    assert [line.split("//", 1)[1].rstrip() for line in text.splitlines() if "//" in line] == [
        line.split("//", 1)[1] for line in again.splitlines() if "//" in line
    ]
