"""Models of engineers and researchers whose motion is known: their test blocks pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from bgdsl.diagnostics import render
from bgdsl.testing.runner import collect, run_file

KNOWN = Path(__file__).parent / "known"


@pytest.mark.parametrize("path", collect([KNOWN]), ids=lambda path: path.stem)
def test_blocks(path: Path) -> None:
    assert [f"{outcome.name}: {render(outcome.findings)}" for outcome in run_file(path) if not outcome.passed] == []
