"""The written model says the full model's equations less the dropped terms: random models, random sets of ends, random states."""

from __future__ import annotations

import random
import re
from typing import Literal

import numpy as np
import pytest
from driving import provenance
from oracle import derivatives
from random_models import hierarchical_model, random_model

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Reporter
from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.native import parameter_names
from bgdsl.ir.rewrite import Rewrite
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.passes.activity import activities, integrands
from bgdsl.reductions.condition import Decision, parameter_values, settle
from bgdsl.reductions.determined import gone_elements, reinstate
from bgdsl.reductions.rewrite_source import rewrite
from bgdsl.simulate.direct import DirectModel
from bgdsl.source import Source
from bgdsl.syntax.formatter import format_source


def rates(model: pipeline.Model, states: dict[str, float]) -> dict[str, float]:
    direct = DirectModel(model.program)
    values = parameter_values(model.graph)
    direct.set_parameters(np.array([values[name] for name in parameter_names(model.program)]))
    names = [record.name for record in model.program.states]
    out = np.zeros(len(names))
    assert direct.rhs(0.0, np.array([states[name] for name in names]), np.zeros(0), out) == 0
    return dict(zip(names, out.tolist(), strict=True))


def even_report(scalar: ScalarGraph) -> ActivityReport:
    """A report in which every term is as active as any other."""
    wanted = integrands(scalar)
    return activities(scalar, wanted, [1.0] * len(wanted.expressions), experiment=None, window=(0, 1), report=Reporter())


def random_decision(scalar: ScalarGraph, report: ActivityReport, rng: random.Random) -> Decision:
    ends = [t for t in scalar.terms if len(scalar.terms_at[t.junction]) > 2]
    free = [t.index for t in ends if t.other is not None or (t.element or "").rpartition(".")[2].startswith(("r", "loss"))]
    share = rng.choice([0.1, 0.3, 0.6])
    dropped = frozenset(t for t in free if rng.random() < share)
    return reinstate(scalar, report, settle(scalar, Decision(0.5, dropped, (), frozenset(), ())))


def decided(text: str, seed: int) -> tuple[pipeline.Model, ActivityReport, Decision, dict[str, float]]:
    """A random model that can be compiled, with random ends to drop and a random state; skips the others."""
    model = pipeline.loads(text, "Net")
    try:
        model.check()
    except BgError:
        pytest.skip("the random model itself is refused")
    scalar, rng = model.scalar, random.Random(seed)
    states = {state: rng.uniform(-1, 1) for element in model.graph.elements for state in element.states}
    if {record.name for record in model.program.states} != set(states):
        pytest.skip("a storage depends on others")
    full = derivatives(scalar, frozenset(), frozenset(), states)
    assert rates(model, states) == pytest.approx(full, abs=1e-9)
    report = even_report(scalar)
    return model, report, random_decision(scalar, report, rng), states


def assert_equal(model: pipeline.Model, result: Rewrite, decision: Decision, states: dict[str, float]) -> None:
    """The text written says the equations less the dropped terms."""
    reduced = pipeline.loads(result.text, "Net")
    reduced.check()
    wanted = derivatives(model.scalar, decision.dropped, gone_elements(model.scalar, decision), states)
    moved = {state: result.forward.get(state, state) for state in states}
    found = rates(reduced, {name: value for state, value in states.items() if (name := moved[state])})
    assert {moved[state]: value for state, value in wanted.items()} == pytest.approx(found, abs=1e-9)


@pytest.mark.parametrize("form", ["kept", "opened"])
@pytest.mark.parametrize("seed", range(24))
def test_written_model_equals_the_oracle(seed: int, form: Literal["kept", "opened"]) -> None:
    model, report, decision, states = decided(random_model(seed), seed)
    head = provenance(model, report, 0.5)
    result, decision = rewrite(model.library, model.scalar, report, decision, head, form=form)
    assert_equal(model, result, decision, states)


@pytest.mark.parametrize("seed", range(24))
def test_arrays_loops_and_moduli_from_outside_stay(seed: int) -> None:
    """Hierarchical models are written in their own classes: nothing is taken back, the text is in order and says what it should."""
    text = format_source(Source("net.bg", hierarchical_model(seed)), Reporter())
    model, report, decision, states = decided(text, seed)
    result, settled = rewrite(model.library, model.scalar, report, decision, provenance(model, report, 0.5), form="kept")
    assert not result.taken_back
    assert settled == decision
    assert_equal(model, result, decision, states)
    assert format_source(Source("net.bg", result.text), Reporter()) == result.text
    findings = pipeline.check_source(Source("net.bg", result.text))
    assert [finding.message for finding in findings if finding.severity == "error"] == []
    assert result.text.count("for i in 1:") >= text.count("for i in 1:")
    assert re.search(r"Arm\w* x\[\d\]\(", result.text)


@pytest.mark.parametrize("seed", range(12))
def test_what_is_reduced_is_reduced_again(seed: int) -> None:
    """What falls in a part of a matrix or bond is another value of its `acts`."""
    model, report, decision, _ = decided(hierarchical_model(seed), seed)
    once, _ = rewrite(model.library, model.scalar, report, decision, provenance(model, report, 0.5), form="kept")
    model, report, decision, states = decided(once.text, seed + 1000)
    again, settled = rewrite(model.library, model.scalar, report, decision, provenance(model, report, 0.6), form="kept")
    assert_equal(model, again, settled, states)
    assert "only(2, acts" not in again.text  # no class of the library is copied
