"""Rigid bodies from the library: classes, vectors and matrices kept, and equal to the form with vectors opened."""

from __future__ import annotations

import random

import pytest
from driving import measure, provenance
from test_oracle import rates

from bgdsl import pipeline
from bgdsl.ir.activity import ActivityReport
from bgdsl.reductions.condition import decide
from bgdsl.reductions.determined import reinstate
from bgdsl.reductions.rewrite_source import rewrite

TWO = """import mechanics.rigid.{RigidBody, Side, Joint};

model Two "two bodies joined at a point; the second is light"
  RigidBody a(m = 100, J = {10, 20, 30}, w0 = {1, 0.2, 0.1});
  RigidBody b(m = 0.1, J = {0.01, 0.02, 0.03}, w0 = {1, 0.2, 0.1});
  Side pa(r = {0, 0, 0.1}, axes(T = a.R)), pb(r = {0, 0, -0.1}, axes(T = -b.R));
  Joint pin(K = 1e5, Rd = 1e2);
  C[3] mount(k = 1e4*identity(3));
equation
  a.v => mount;
  a.v => pa.v;  a.w => pa.w;  pa.p => pin.gap;
  b.v => pb.v;  b.w => pb.w;  pb.p => pin.gap;
end Two;
"""


@pytest.fixture(scope="module")
def two() -> tuple[pipeline.Model, ActivityReport]:
    model = pipeline.loads(TWO)
    return model, measure(model, stop=0.05, interval=0.01, tolerance=1e-6)


@pytest.mark.parametrize("threshold", [1e-4, 1e-3, 1e-2, 5e-2])
def test_kept_and_opened_say_the_same(two: tuple[pipeline.Model, ActivityReport], threshold: float) -> None:
    model, report = two
    decision = reinstate(model.scalar, report, decide(model.scalar, report, threshold, guard=False))
    assert decision.dropped
    head = provenance(model, report, threshold)
    kept, settled = rewrite(model.library, model.scalar, report, decision, head, form="kept")
    assert not kept.taken_back
    opened, _ = rewrite(model.library, model.scalar, report, settled, head, form="opened")
    rng = random.Random(1)
    reduced = pipeline.loads(kept.text)
    states = {record.name: rng.uniform(-0.5, 0.5) for record in reduced.program.states}
    found = rates(reduced, states)
    again = pipeline.loads(opened.text)
    moved = {state: opened.forward.get(state, state) for state in states}
    wanted = rates(again, {moved[state]: value for state, value in states.items()})
    assert {moved[state]: value for state, value in found.items()} == pytest.approx(wanted, rel=1e-9, abs=1e-9)


def test_a_modulus_given_from_outside_stays_there(two: tuple[pipeline.Model, ActivityReport]) -> None:
    model, report = two
    decision = reinstate(model.scalar, report, decide(model.scalar, report, 1e-2, guard=False))
    kept, _ = rewrite(model.library, model.scalar, report, decision, provenance(model, report, 1e-2), form="kept")
    assert "axes(T = a.R" in kept.text
    assert "PartMTF axes(acts = [" in kept.text
    assert "import bonds.one_way.{PartEJS, PartMTF, PartTF};" in kept.text
    assert "  point.p => axes.p1;  axes.p2 => p;\n" in kept.text


def test_a_user_s_element_stays_one() -> None:
    from pathlib import Path

    import bgdsl
    from bgdsl.reductions.part import everything
    from bgdsl.reductions.structured_text import structured_text

    examples = Path(bgdsl.__file__).parent / "library" / "mechanics" / "rigid_examples.bg"
    model = pipeline.load(examples, "HangingByHinge")
    assert any(element.kind == "field" for element in model.graph.elements)
    new = structured_text(model.scalar, everything(model.scalar, frozenset(), frozenset()), "", lambda _: "")
    assert not new.inputs
    again = pipeline.loads(new.text, model.name)
    rng = random.Random(2)
    states = {record.name: rng.uniform(-0.3, 0.3) for record in model.program.states}
    moved = {state: new.forward.get(state, state) for state in states}
    found = rates(again, {moved[state] or "": value for state, value in states.items()})
    assert found == pytest.approx({moved[state]: value for state, value in rates(model, states).items()}, rel=1e-12, abs=1e-12)


def test_reducing_twice_at_one_threshold_is_reducing_once() -> None:
    from bgdsl import reduce

    scenario = reduce.Scenario(settings={"stop": 0.2, "interval": 0.01})
    once = reduce.condition(reduce.measure(pipeline.loads(TWO), scenario), 0.01)
    assert once.decision.dropped
    again = reduce.condition(reduce.measure(pipeline.loads(once.source), scenario), 0.01)
    assert again.source == once.source
    further = reduce.condition(reduce.measure(pipeline.loads(once.source), scenario), 0.2, guard=False)
    assert further.decision.dropped  # a larger threshold is another reduction


def test_components_that_are_zero_by_law_are_not_dropped_again(two: tuple[pipeline.Model, ActivityReport]) -> None:
    model, report = two
    decision = reinstate(model.scalar, report, decide(model.scalar, report, 1e-2, guard=False))
    kept, _ = rewrite(model.library, model.scalar, report, decision, provenance(model, report, 1e-2), form="kept")
    reduced = pipeline.loads(kept.text)
    again = decide(reduced.scalar, measure(reduced, stop=0.05, interval=0.01, tolerance=1e-6), 1e-9, guard=False)
    elements = {reduced.scalar.terms[t].element for t in again.dropped if reduced.scalar.terms[t].other is None}
    assert not {name for name in elements if name and name.endswith((".back", ".forth"))}
