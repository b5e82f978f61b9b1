"""The search for the smallest model: which sets are tried, that trying by weights is trying for real, and what is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgdsl import pipeline
from bgdsl.ir.native import parameter_names
from bgdsl.passes.weights import WEIGHTS, weights_in
from bgdsl.reduce import Measured, Scenario, condition, decision_for, measure, partition, reduced
from bgdsl.reductions.condition import considered
from bgdsl.reductions.provenance import Choice, numbers, ranges, reductions_said
from bgdsl.reductions.search import Candidate, Family, above, families, smallest_within, spared
from bgdsl.searching import Searched, smallest

MODELS = Path(__file__).parent.parent.parent / "models"


# ------------------------------------------------------------------------------------------------------------- the trials


def costs(price: dict[int, float], tried: list[frozenset[int]], levels: dict[int, float]) -> Callable[..., Candidate]:
    """Trials of a model whose error is the sum of its terms' prices."""

    def attempt(threshold: float, terms: frozenset[int]) -> Candidate:
        assert all(levels[t] < threshold for t in terms)
        tried.append(terms)
        return Candidate(threshold, terms, 1, sum(price[t] for t in terms), 0.0)

    return attempt


@given(st.lists(st.sampled_from([0.0, 0.0, 0.0, 1.0, 5.0]), min_size=1, max_size=60))
def test_only_what_costs_too_much_stays(prices: list[float]) -> None:
    levels = {t: 0.01 * (t + 1) / len(prices) for t in range(len(prices))}
    like = [Family((t,), level) for t, level in levels.items()]
    tried: list[frozenset[int]] = []
    found = smallest_within(levels, like, 0.5, costs(dict(enumerate(prices)), tried, levels), patience=99)
    free = {t for t, price in enumerate(prices) if price == 0.0}
    assert (found.best.terms if found.best else set()) == free
    assert {t for g in found.guilty for t in g.family.terms} == set(levels) - free
    assert found.ended is None
    assert found.trials >= len(tried)  # a threshold, once tried, is not tried again
    assert all(c.terms in tried for c in found.tried), "a model was accepted that was never run"


def test_the_search_tries_far_fewer_sets_than_there_are_terms() -> None:
    levels = {t: 1e-4 * (t + 1) for t in range(1000)}
    price = dict.fromkeys(levels, 0.0) | dict.fromkeys((40, 41, 300, 650), 1.0)
    found = smallest_within(levels, [Family((t,), v) for t, v in levels.items()], 0.5, costs(price, [], levels))
    assert found.best is not None
    assert found.best.dropped == 996
    assert [g.family.terms[0] for g in found.guilty] == [40, 41, 300, 650]
    assert found.trials < 90


def test_the_search_ends_where_too_many_in_a_row_cost_too_much() -> None:
    levels = {t: 0.001 * (t + 1) for t in range(500)}
    price = {t: float(t >= 100) for t in levels}
    found = smallest_within(levels, [Family((t,), v) for t, v in levels.items()], 0.5, costs(price, [], levels), patience=5)
    assert found.best is not None
    assert found.best.dropped == 100
    assert len(found.guilty) == 5
    assert found.ended == pytest.approx(0.106)


def test_what_is_slow_to_try_comes_last_and_trials_can_be_limited() -> None:
    levels = {t: 0.001 * (t + 1) for t in range(100)}
    price = dict.fromkeys(levels, 0.0) | {10: 1.0, 90: 1.0, 95: 1.0}
    single = [Family((t,), v) for t, v in levels.items()]
    quick = {t: v for t, v in levels.items() if t < 90}
    tried: list[frozenset[int]] = []
    found = smallest_within(quick, single[:90], 0.5, costs(price, tried, levels), slow=single[90:])
    assert found.best is not None
    assert found.best.terms == set(levels) - {10, 90, 95}
    slow = [not terms.isdisjoint(range(90, 100)) for terms in tried]
    assert slow == sorted(slow)
    few = smallest_within(levels, single, 0.5, costs(price, [], levels), most=10)
    assert few.ended is not None
    assert few.trials <= 10 + 7


def test_nothing_may_fall() -> None:
    levels = {0: 0.1, 1: 0.2}
    price = {0: 1.0, 1: 1.0}
    found = smallest_within(levels, [Family((t,), v) for t, v in levels.items()], 0.5, costs(price, [], levels))
    assert found.best is None
    assert [g.error for g in found.guilty] == [1.0, 1.0]


@given(st.sets(st.integers(0, 3000)))
def test_terms_are_written_as_ranges(terms: set[int]) -> None:
    assert numbers(ranges(terms)) == terms


# ------------------------------------------------------------------------------------------------------- models, measured


@pytest.fixture(scope="module")
def drive_line() -> Measured:
    return measure(pipeline.load(MODELS / "drive_line.bg"), Scenario("pull"))


@pytest.fixture(scope="module")
def motor() -> Measured:
    return measure(pipeline.load(MODELS / "dc_motor.bg"), Scenario("run_up"))


def test_like_terms_of_an_array_are_one_family() -> None:
    engine = pipeline.load(MODELS / "engine.bg", "Engine")
    levels = {t.index: 0.1 for t in engine.scalar.terms if t.element is not None and t.element.startswith("cyl[") and t.other is None}
    like = families(engine.scalar, levels)
    assert sum(len(f.terms) for f in like) == len(levels)
    assert {len(f.terms) for f in like} == {6}
    for family in like:
        named = {(engine.scalar.terms[t].element or "").partition("]")[2] for t in family.terms}
        assert len(named) == 1, "unlike terms in one family"


def test_a_weight_of_zero_is_a_deleted_term(motor: Measured) -> None:
    """The weighed model with the weights of the dropped terms at zero moves as the written one does."""
    model = motor.model
    levels = {t.index: t.level for t in considered(model.scalar, motor.report) if t.reason is None}
    weighed = replace(model, weighed=frozenset(levels))
    order = weights_in(weighed.causal.scalar)
    unweighed = frozenset(levels) - set(order)
    assert unweighed <= set(model.causal.determiner)
    choice = Choice(0.05, spared=unweighed)
    dropped = decision_for(motor, choice).dropped
    assert len(dropped) > 1
    weights = {name: 0.0 if t in dropped else 1.0 for name, t in zip(weight_names(len(order)), order, strict=True)}
    state = {record.name: 0.1 * (k + 1) for k, record in enumerate(model.program.states)}
    written = pipeline.loads(reduced(motor, choice).source)
    of_written = slopes(written, state, {})
    assert slopes(weighed, state, weights) == pytest.approx(of_written, rel=1e-13)
    assert slopes(weighed, state, dict.fromkeys(weights, 1.0)) == pytest.approx(slopes(model, state, {}), rel=1e-13)
    assert slopes(model, state, {}) != pytest.approx(of_written, rel=1e-3), "nothing was dropped that matters"


def weight_names(count: int) -> list[str]:
    return [f"{WEIGHTS}[{k + 1}]" for k in range(count)]


def slopes(model: pipeline.Model, state: dict[str, float], changed: dict[str, float]) -> list[float]:
    """The derivatives of the states at t = 0.1 s."""
    system = model.compile()
    native, program = system.native, model.program
    values = {**system.parameters, **changed}
    assert native.set_parameters(np.array([values[name] for name in parameter_names(program)])) == 0
    found = np.empty(len(program.states))
    assert native.rhs(0.1, np.array([state[record.name] for record in program.states]), np.zeros(0), found) == 0
    return found.tolist()


def test_bonds_inside_a_junction_carry_what_is_left() -> None:
    text = """model Two
  J1 a;  J1 b;
  I m(I = 1, f(start = 1));  R one(R = 1);  R two(R = 2);
  output Real e = inside.e;
equation
  inside: a -> b;
  a -> m;  a -> one;  b -> two;
end Two;
"""
    model = pipeline.loads(text)
    (inner,) = model.scalar.inner
    two = next(t.index for t in model.scalar.terms if t.element == "two")
    weighed = replace(model, weighed=frozenset({two})).compile()
    full = weighed.simulate(None, {WEIGHTS: (1.0,)}, stop=0.1)["e"]
    less = weighed.simulate(None, {WEIGHTS: (0.0,)}, stop=0.1)["e"]
    assert inner.bond == "inside"
    assert full[0] == pytest.approx(2.0)
    assert np.abs(less).max() == 0.0


# ------------------------------------------------------------------------------------------------------------ the search


@pytest.fixture(scope="module")
def found(motor: Measured) -> Searched:
    return smallest(motor, 0.05)


def test_what_is_found_keeps_the_error_and_is_smaller_than_any_threshold(found: Searched) -> None:
    best = found.search.best
    assert found.reduced is not None
    assert found.accuracy is not None
    assert best is not None
    assert 0.0 < found.accuracy.worst <= 0.05
    assert best.error == pytest.approx(found.accuracy.worst, rel=0.05), "what was tried is not what was written"
    assert best.terms == found.reduced.decision.dropped
    assert best.states == found.accuracy.reduced.states < found.accuracy.full.states
    by_threshold = [c.dropped for c in found.search.tried if c.spared == 0 and c.error <= 0.05]
    assert best.dropped > max(by_threshold) > 0


def test_a_strict_limit_is_kept_too(motor: Measured) -> None:
    strict = smallest(motor, 0.003)
    assert strict.accuracy is not None
    assert 0.0 < strict.accuracy.worst <= 0.003


def test_the_annotation_says_how_it_was_found(motor: Measured, found: Searched) -> None:
    assert found.reduced is not None
    model = next(pipeline.loads(found.reduced.source).library.models())
    said = next(reductions_said(model)).choice
    assert (said.max_error, said.threshold) == (0.05, found.search.best and found.search.best.threshold)
    again = reduced(motor, said)
    assert again.source == found.reduced.source
    assert again.decision.dropped == found.reduced.decision.dropped


def test_the_search_is_the_same_every_time(motor: Measured, found: Searched) -> None:
    other = smallest(motor, 0.05)
    assert [replace(c, seconds=0.0) for c in found.search.tried] == [replace(c, seconds=0.0) for c in other.search.tried]
    assert (found.reduced and found.reduced.source) == (other.reduced and other.reduced.source)


def test_where_nothing_may_fall_the_full_model_is_told(motor: Measured) -> None:
    nothing = smallest(motor, 1e-9)
    assert nothing.reduced is None
    assert nothing.search.best is None
    assert nothing.search.guilty


def test_spared_terms_are_those_below_that_were_not_dropped() -> None:
    levels = {0: 0.1, 1: 0.2, 2: 0.3, 3: 0.4}
    assert spared(levels, above(0.3), {0}) == {1, 2}


# ------------------------------------------------------------------------------------------------------ once is as twice


WAYS = {
    "threshold": Choice(0.02),
    "without the guard": Choice(0.02, guard=False),
    "elements stay": Choice(0.02, elements=False),
    "elements go": Choice(1 - 0.97, keep=0.97),
}


def again(source: str, scenario: Scenario) -> Measured:
    return measure(pipeline.loads(source), scenario)


@pytest.mark.parametrize("way", WAYS)
def test_reducing_twice_is_reducing_once(drive_line: Measured, way: str) -> None:
    once = reduced(drive_line, WAYS[way])
    assert once.decision.dropped, "nothing fell: the test says nothing"
    assert reduced(again(once.source, Scenario("pull")), WAYS[way]).source == once.source


def test_a_partition_that_was_conditioned_is_not_conditioned_again(drive_line: Measured) -> None:
    apart = partition(drive_line, 0.01, conditioned=True)
    driving = apart.files[0].text
    found = again(driving, Scenario("pull"))
    assert reduced(found, Choice(0.01)).source == driving
    assert reduced(found, Choice(0.005)).source == driving
    whole = partition(found, 0.01)
    assert whole.files == ()


def test_the_inside_of_a_partition_may_still_be_conditioned(drive_line: Measured) -> None:
    driving = partition(drive_line, 0.01).files[0].text
    once = reduced(again(driving, Scenario("pull")), Choice(0.01))
    assert once.decision.dropped
    assert reduced(again(once.source, Scenario("pull")), Choice(0.01)).source == once.source


def test_searching_twice_is_searching_once(found: Searched) -> None:
    assert found.reduced is not None
    measured = again(found.reduced.source, Scenario("run_up"))
    for allowed in (0.05, 0.02):
        twice = smallest(measured, allowed)
        assert twice.reduced is not None
        assert twice.reduced.source == found.reduced.source


def test_a_search_that_asks_for_something_else_goes_on(found: Searched) -> None:
    """Other outputs, or more error: what was found before has no say in it."""
    assert found.reduced is not None
    measured = again(found.reduced.source, Scenario("run_up"))
    assert smallest(measured, 0.05, outputs=("speed",)).search.trials > 0
    assert smallest(measured, 0.2).search.trials > 0


def test_another_run_is_another_reduction() -> None:
    """At 5 % the light lever falls; what was found there says nothing of the run in which it is heavy."""
    lever = pipeline.load(MODELS / "lever_stiff.bg")
    light = condition(measure(lever, Scenario("light")), 0.003)
    assert light.decision.dropped
    for scenario in (Scenario("kick"), Scenario("light", None, {"window": (0.1, 0.5)}), Scenario("light", {"mA": 120.0})):
        found = again(light.source, scenario)
        wide = condition(found, 0.9, guard=False)
        assert wide.decision.dropped
        assert wide.source != light.source


@pytest.mark.parametrize(
    ("before", "now", "covered"),
    [
        (Choice(0.01), Choice(0.005), True),
        (Choice(0.01), Choice(0.02), False),
        (Choice(0.01), Choice(0.01, guard=False), False),
        (Choice(0.01, guard=False), Choice(0.01), True),
        (Choice(0.01), Choice(0.01, elements=False), True),
        (Choice(0.01, elements=False), Choice(0.01), False),
        (Choice(0.5, max_error=0.08), Choice(0.01), False),
        (Choice(0.5, max_error=0.08), Choice(0.0, max_error=0.05), True),
        (Choice(0.5, max_error=0.08), Choice(0.0, max_error=0.10), False),
        (Choice(0.5, max_error=0.08, outputs=("a",)), Choice(0.0, max_error=0.08), False),
        (Choice(0.01), Choice(0.0, max_error=0.08), False),
        (Choice(0.02, keep=0.98), Choice(0.01, keep=0.99), True),
        (Choice(0.02, keep=0.98), Choice(0.03, keep=0.97), False),
        (Choice(0.02, keep=0.98), Choice(0.01), False),
    ],
)
def test_a_choice_covers_those_that_drop_no_more(before: Choice, now: Choice, covered: bool) -> None:
    assert before.covers(now) is covered
