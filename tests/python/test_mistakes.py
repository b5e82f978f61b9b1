"""The Python face: what is wrong is said as by the commands, or as Python does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import bgdsl
from bgdsl.diagnostics import BgError

MODELS = Path(__file__).parents[2] / "models"


@pytest.fixture(scope="module")
def lever() -> bgdsl.Model:
    return bgdsl.load(MODELS / "lever_stiff.bg")


@pytest.mark.parametrize(
    ("code", "mistaken"),
    [
        ("BG108", lambda model: bgdsl.load("nowhere.bg")),
        ("BG609", lambda model: bgdsl.load(MODELS / "lever.bg", model="Lvr")),
        ("BG220", lambda model: bgdsl.load(MODELS / "lever.bg", overrides={"mAA": 1.0})),
        ("BG611", lambda model: model.compile().simulate("kick", mAA=1.0)),
        ("BG610", lambda model: model.compile().simulate("kik")),
        ("BG613", lambda model: model.activity("kick", window=(100.0, 200.0))),
        ("BG618", lambda model: model.compile().simulate("kick", stop=0.1)["vA.g"]),
    ],
)
def test_mistakes_about_a_model_are_diagnostics(lever: bgdsl.Model, code: str, mistaken: Callable[[bgdsl.Model], object]) -> None:
    with pytest.raises(BgError) as caught:
        mistaken(lever)
    assert [d.code.number for d in caught.value.diagnostics] == [code]


@pytest.mark.parametrize("threshold", [-0.1, 5.0, float("nan")])
def test_a_threshold_is_a_fraction(lever: bgdsl.Model, threshold: float) -> None:
    for reduce in (lever.condition, lever.partition):
        with pytest.raises(ValueError, match="between 0 and 1"):
            reduce(threshold, experiment="kick")


def test_a_reduction_has_one_limit(lever: bgdsl.Model) -> None:
    for limits in ({}, {"threshold": 0.1, "max_error": 0.1}):
        with pytest.raises(ValueError, match="either threshold or max_error"):
            lever.condition(experiment="kick", **limits)


def test_one_name_is_a_name(lever: bgdsl.Model) -> None:
    assert lever.compile().simulate("kick", stop=0.1, vars="vA.f").names == ("vA.f",)
