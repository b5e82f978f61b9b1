"""Element elimination from the command line, on a half with little activity behind a lever."""

from __future__ import annotations

from pathlib import Path

import pytest

import bgdsl
from bgdsl import pipeline
from bgdsl.cli.app import run
from bgdsl.reduce import Scenario, eliminate_elements, measure

LEVER = Path(__file__).parents[2] / "models" / "lever_stiff.bg"


def test_the_least_active_elements_go_and_the_rest_compiles() -> None:
    measured = measure(pipeline.load(LEVER), Scenario("kick"))
    reduced = eliminate_elements(measured, 0.995)  # springB has 0.61 %, damperB 0.12 % of all activity
    gone = {measured.model.scalar.terms[t].element for t in reduced.decision.dropped}
    assert gone == {"damperB"}
    assert {e.name for e in bgdsl.loads(reduced.source).graph.elements} == {e.name for e in measured.model.graph.elements} - gone


def test_everything_stays_where_everything_is_to_be_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "same.bg"
    assert run(["condition", str(LEVER), "-e", "kick", "--keep", "100%", "-o", str(out)]) == 0
    assert out.read_text() == LEVER.read_text()
    assert run(["condition", str(LEVER), "-e", "kick", "--keep", "99%", "--threshold", "1%", "-o", str(out)]) == 2
    assert "one of" in capsys.readouterr().err
