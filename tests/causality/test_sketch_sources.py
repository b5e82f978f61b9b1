"""A sketch written as text compiles to the causality of the same sketch built in Python."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Reporter
from bgdsl.ir.causal import CausalGraph
from bgdsl.passes.causality import assign_causality
from bgdsl.passes.scalar import open_vectors
from bgdsl.testing.strategies import Sketch, graph_of, sketches, source_of


def from_graph(sketch: Sketch) -> CausalGraph | None:
    try:
        return assign_causality(open_vectors(graph_of(sketch), Reporter()), Reporter())
    except BgError:
        return None


def from_text(sketch: Sketch) -> CausalGraph | None:
    try:
        return pipeline.loads(source_of(sketch)).causal
    except BgError:
        return None


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(sketches(sizes=(None, 2)))
def test_text_and_graph_agree(sketch: Sketch) -> None:
    built, read = from_graph(sketch), from_text(sketch)
    assert (built is None) == (read is None)
    if built is not None and read is not None:
        assert list(built.derivative) == list(read.derivative)
        assert {j.name for j in built.scalar.junctions} == {j.name for j in read.scalar.junctions}
        assert len(built.scalar.terms) == len(read.scalar.terms)
