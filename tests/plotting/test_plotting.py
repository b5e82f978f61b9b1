"""Pictures hold what the run and the report hold."""

from __future__ import annotations

from pathlib import Path

import pytest

import bgdsl

pytest.importorskip("matplotlib")
from bgdsl import plotting

LEVER = Path(__file__).parents[2] / "models" / "lever_stiff.bg"


@pytest.fixture(scope="module")
def run() -> bgdsl.Run:
    return bgdsl.load(LEVER).compile().simulate("kick", stop=1)


def test_signals(run: bgdsl.Run, tmp_path: Path) -> None:
    figure = plotting.signals(run, "vA.f", "springB.q")
    assert [axis.get_ylabel() for axis in figure.axes] == ["vA.f", "springB.q / m"]
    (line,) = figure.axes[0].get_lines()
    assert (line.get_ydata() == run["vA.f"]).all()
    figure.savefig(tmp_path / "signals.png")
    assert (tmp_path / "signals.png").stat().st_size > 1000


def test_all_that_was_recorded(run: bgdsl.Run) -> None:
    assert len(plotting.signals(run).axes) == len(run.names)


def test_activities(run: bgdsl.Run) -> None:
    report = run.activity()
    (axis,) = plotting.activities(report, threshold=0.025).axes
    shown = [label.get_text() for label in axis.get_yticklabels()]
    assert len(shown) == sum(len(junction.terms) for junction in report.junctions)
    lever = shown.index("vA: lever")
    assert axis.patches[lever].get_facecolor() != axis.patches[0].get_facecolor()
    assert axis.patches[lever].get_width() == pytest.approx(100 * next(t.rho for t in report.junctions[0].terms if t.name == "lever"))
