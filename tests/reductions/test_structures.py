"""Models of many kinds, reduced at several thresholds: what is written is right source, and reducing it again changes nothing."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from bgdsl import pipeline, reduce
from bgdsl.diagnostics import render
from bgdsl.source import Source

KNOWN = Path(__file__).parents[1] / "models" / "known"
MODELS = ("dc_drive", "double_pendulum_on_springs", "exchanger", "loudspeaker", "planetary", "tank_ring", "wall")
LEVELS = (0.003, 0.05, 0.2)


@cache
def measured(name: str) -> reduce.Measured:
    path = KNOWN / f"{name}.bg"
    return reduce.measure(pipeline.load(path), reduce.Scenario())


def errors(text: str) -> str:
    """What `bgc check` finds wrong in a text, warnings left out."""
    found = pipeline.check_source(Source("<reduced>", text))
    return render([each for each in found if each.severity == "error"])


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", MODELS)
def test_conditioned(name: str, level: float) -> None:
    full = measured(name)
    reduced = reduce.condition(full, level)
    if not reduced.decision.dropped:
        assert reduced.source == full.model.source
        return
    assert errors(reduced.source) == ""
    assert reduced.source == reduce.tidy(reduced.source)
    again = pipeline.loads(reduced.source, full.model.name)
    assert len(again.program.states) > 0
    assert reduce.condition(reduce.measure(again, reduce.Scenario()), level).source == reduced.source


@pytest.mark.parametrize("name", ["double_pendulum_on_springs", "tank_ring", "wall"])
def test_partitions(name: str) -> None:
    """Every file of a partition is right as a whole, the classes in it that others use included."""
    for conditioned in (False, True):
        found = reduce.partition(measured(name), 0.4, conditioned=conditioned)
        for written in found.files:
            assert errors(written.text) == ""
            assert written.text == reduce.tidy(written.text)
    assert found.files or name == "tank_ring"
