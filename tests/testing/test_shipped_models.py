"""The test blocks of the models that come with the project pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from bgdsl.diagnostics import render
from bgdsl.testing.runner import collect, run_file

MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize("path", collect([MODELS]), ids=lambda path: str(path.relative_to(MODELS)))
def test_blocks(path: Path) -> None:
    assert [f"{outcome.name}: {render(outcome.findings)}" for outcome in run_file(path) if not outcome.passed] == []
