"""A reduced file is verified by what it was made by: a threshold, an error, the activity of its elements."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bgdsl import pipeline
from bgdsl.reduce import Measured, Scenario, measure, partition, reduced
from bgdsl.reductions.provenance import Choice
from bgdsl.searching import smallest
from bgdsl.verification import reduction_of, verify_reduced

MODEL = Path(__file__).parent.parent.parent / "models" / "dc_motor.bg"


@pytest.fixture(scope="module")
def motor() -> Measured:
    return measure(pipeline.load(MODEL), Scenario("run_up"))


def beside(folder: Path, text: str) -> Path:
    """The text as a file beside the full model."""
    shutil.copy(MODEL, folder)
    path = folder / "small.bg"
    path.write_text(text, "utf-8")
    return path


def test_what_was_found_by_its_error_holds_while_the_error_does(motor: Measured, tmp_path: Path) -> None:
    found = smallest(motor, 0.05).reduced
    assert found is not None
    path = beside(tmp_path, found.source)
    same = verify_reduced(path, Scenario())
    assert same.holds
    assert same.error is not None
    assert 0.0 < same.error <= 0.05
    assert same.terms == ()
    heavy = verify_reduced(path, Scenario("heavy"))
    assert not heavy.holds
    assert heavy.error is not None
    assert heavy.error > 0.05
    assert "rotor_coupling" in {term.name for term in heavy.terms}
    assert all(term.new > term.old for term in heavy.terms)


def test_what_was_left_out_is_held_against_what_would_be_left_out_now(motor: Measured, tmp_path: Path) -> None:
    path = beside(tmp_path, reduced(motor, Choice(0.01, keep=0.99)).source)
    assert reduction_of(path).choice == Choice(0.01, keep=0.99)
    assert verify_reduced(path, Scenario()).holds
    heavy = verify_reduced(path, Scenario("heavy"))
    assert {term.name for term in heavy.terms} == {"air"}
    assert not heavy.holds


def test_terms_that_only_the_guard_would_have_kept_are_known(motor: Measured, tmp_path: Path) -> None:
    unguarded = reduced(motor, Choice(0.004, guard=False))
    guarded = reduced(motor, Choice(0.004))
    more = unguarded.decision.dropped - guarded.decision.dropped
    assert more, "the guard keeps nothing here: the test says nothing"
    names = {record.name for t, record in motor.report.by_index().items() if t in more}
    heavy = verify_reduced(beside(tmp_path, unguarded.source), Scenario("run_up", {"La": 0.05}))
    assert names <= {term.name for term in heavy.terms}


def test_terms_inside_partitions_count_if_they_fell(motor: Measured, tmp_path: Path) -> None:
    for inside in (False, True):
        apart = partition(motor, 0.02, conditioned=inside)
        path = beside(tmp_path, apart.files[0].text)
        assert reduction_of(path).choice.inside is inside
        assert verify_reduced(path, Scenario()).holds
