"""Models of engineers and researchers whose motion is known: their test blocks pass."""

from __future__ import annotations

from pathlib import Path

import pytest

import bgdsl
from bgdsl.diagnostics import BgError, render
from bgdsl.testing.runner import collect, run_file

KNOWN = Path(__file__).parent / "known"


@pytest.mark.parametrize("path", collect([KNOWN]), ids=lambda path: path.stem)
def test_blocks(path: Path) -> None:
    assert [f"{outcome.name}: {render(outcome.findings)}" for outcome in run_file(path) if not outcome.passed] == []


def test_starts_that_contradict_a_constraint_are_refused() -> None:
    """The velocity along the rod is given in full: nothing is left to solve for."""
    text = (KNOWN / "rod.bg").read_text().replace("I my(I = m)", "I my(I = m, f(start = 0.1))")
    with pytest.raises(BgError, match="BG623"):
        bgdsl.loads(text).compile().simulate()
