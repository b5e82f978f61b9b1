from __future__ import annotations

import pytest
from driving import MODELS, measure

from bgdsl import pipeline
from bgdsl.ir.activity import ActivityReport


@pytest.fixture(scope="session")
def lever() -> pipeline.Model:
    return pipeline.load(MODELS / "lever_stiff.bg")


@pytest.fixture(scope="session")
def lever_report(lever: pipeline.Model) -> ActivityReport:
    return measure(lever, "kick", tolerance=1e-8)
