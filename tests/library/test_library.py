"""The library that ships with the package: its own tests pass, its files check clean, everything in it says what it is."""

from __future__ import annotations

from pathlib import Path

import pytest

import bgdsl
from bgdsl import pipeline
from bgdsl.diagnostics import Reporter, render
from bgdsl.syntax import ast
from bgdsl.syntax.parser import parse, read_source
from bgdsl.testing.runner import run_file

LIBRARY = Path(bgdsl.__file__).parent / "library"
FILES = sorted(LIBRARY.rglob("*.bg"))
EACH_FILE = pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(LIBRARY)))


def tree(path: Path) -> ast.File:
    report = Reporter()
    parsed = parse(read_source(path, report), report)
    report.stop_if_errors()
    return parsed


def test_there_is_a_library():
    assert {path.parent.name for path in FILES} == {"bonds", "mechanics", "electrical", "hydraulic", "thermal"}


@EACH_FILE
def test_checks_clean(path: Path):
    assert render(pipeline.check_file(path)) == ""


@EACH_FILE
def test_own_tests_pass(path: Path):
    outcomes = run_file(path)
    assert [f"{outcome.name}: {render(outcome.findings)}" for outcome in outcomes if not outcome.passed] == []
    assert outcomes or path.name == "rigid.bg"  # tested by rigid_examples.bg


@EACH_FILE
def test_models_are_described(path: Path):
    items = [item for item in tree(path).items if isinstance(item, ast.Model | ast.ShortFunction)]
    assert [item.name for item in items if not item.comment] == []


@EACH_FILE
def test_models_are_formatted_and_read_the_same_again(path: Path):
    from bgdsl.source import Source
    from bgdsl.syntax.formatter import format_source

    report = Reporter()
    text = format_source(read_source(path, report), report)
    assert parse(Source("again", text), report).items == tree(path).items


@EACH_FILE
def test_the_page_lists_every_model_with_its_description(path: Path):
    page = (Path(__file__).parent.parent.parent / "docs" / "library.md").read_text("utf-8")
    assert f"## `{'.'.join(path.relative_to(LIBRARY).with_suffix('').parts)}`" in page
    items = [item for item in tree(path).items if isinstance(item, ast.Model | ast.ShortFunction)]
    assert [item.name for item in items if f"| `{item.name}` | {item.comment} |" not in page] == []


SKETCH = """
import mechanics.rigid.{RigidBody, Point, Bushing};
model Crank "six pins of one body, each held by a bushing"
  RigidBody crank(m = 3, J = {1, 2, 3}, w0 = {0.1, 0, 0});
  Point pin[6](r = {{i - 3.5, 0, 0.1} for i in 1:6});
  MTF[3, 3] toN[6](each T = crank.R);
  Bushing bushing[6](each K = {1e4, 1e4, 1e4}, each Rd = {10, 10, 10});
  J1[3] ground[6];  Sf[3] still[6](each f = zeros(3));
equation
  for i in 1:6 loop
    crank.v => pin[i].v;  crank.w => pin[i].w;  pin[i].p => toN[i] => bushing[i].a;
    bushing[i].b => ground[i];  still[i] => ground[i];
  end for;
end Crank;
"""


def test_bodies_points_and_bushings_join_as_the_language_page_shows():
    model = bgdsl.loads(SKETCH)
    assert len(model.program.states) == 6 + 6 + 18
    run = model.compile().simulate(stop=1, tolerance=1e-8)
    energy = run["energy.total"]
    assert energy[0] == pytest.approx(0.5 * 1 * 0.1**2)
    assert energy[-1] < energy[0]
    # the bushings pull back whatever turns about x; the turn stays small
    assert abs(run["crank.angle[1]"]).max() < 0.1
