"""Models of many kinds, reduced at several thresholds: what is written is right source, and reducing it again changes nothing."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from random import Random

import numpy as np
import pytest
from oracle import derivatives

from bgdsl import pipeline, reduce
from bgdsl.diagnostics import render
from bgdsl.ir.native import parameter_names
from bgdsl.reductions.condition import parameter_values
from bgdsl.reductions.determined import gone_elements
from bgdsl.simulate.direct import DirectModel
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


@pytest.mark.parametrize("level", [0.003, 0.05, 0.1])
def test_a_part_redeclared_in_an_array(level: float) -> None:
    """Elements that differ behind one redeclaration: the written equations are the full ones less what fell, at random states."""
    full = measured("redeclared_in_array")
    reduced = reduce.condition(full, level)
    model, decision, rng = full.model, reduced.decision, Random(1)
    states = {state: rng.uniform(-1, 1) for element in model.graph.elements for state in element.states}
    wanted = derivatives(model.scalar, decision.dropped, gone_elements(model.scalar, decision), states)
    written = pipeline.loads(reduced.source, model.name)
    direct, values = DirectModel(written.program), parameter_values(written.graph)
    direct.set_parameters(np.array([values[name] for name in parameter_names(written.program)]))
    names = [record.name for record in written.program.states]
    rates = np.zeros(len(names))
    assert direct.rhs(0.0, np.array([states[name] for name in names]), np.zeros(0), rates) == 0
    assert dict(zip(names, rates.tolist(), strict=True)) == pytest.approx({name: wanted[name] for name in names}, abs=1e-9)
