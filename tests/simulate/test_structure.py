"""Runs that change what shapes a model: it is flattened and compiled again for them, entry by entry of arrays too."""

from __future__ import annotations

from typing import Any

import pytest

from bgdsl import pipeline
from bgdsl.diagnostics import BgError

TEXT = """
model S
  parameter Real scale = 1;
  parameter Integer n[2] = {1, 2};
  parameter Boolean on[2] = {true, false};
  J1 v;  Se s(e = scale);  I m(I = 0.001);
  R a[n[1]](each R = 1);  R b[n[2]](each R = 10);
  R c(R = 100) if on[1];  R d(R = 1000) if on[2];
  output Real total = s.e/v.f;
  experiment one(stopTime = 1);
  experiment entry(stopTime = 1, n[2] = 3);
  experiment whole(stopTime = 1, n = {2, 4});
  experiment condition(stopTime = 1, on[2] = true);
  experiment built extends entry(n[1] = 2*n[2], on[1] = false, scale = 3);
equation
  s -> v;  v -> m, c, d;
  for i in 1:n[1] loop v -> a[i]; end for;
  for i in 1:n[2] loop v -> b[i]; end for;
end S;
"""


def resistance(experiment: str, overrides: dict[str, Any], changes: dict[str, Any]) -> float:
    """What all resistors that are there come to, read at the end."""
    run = pipeline.loads(TEXT, overrides=overrides).compile().simulate(experiment, changes)
    return float(run["total"][-1])


@pytest.mark.parametrize(
    ("experiment", "changes", "wanted"),
    [
        ("one", {}, 1 + 20 + 100),
        ("one", {"n[2]": 3}, 1 + 30 + 100),
        ("one", {"n": (2, 4)}, 2 + 40 + 100),
        ("one", {"on[2]": True, "on[1]": False}, 1 + 20 + 1000),
        ("entry", {}, 1 + 30 + 100),
        ("entry", {"n[2]": 1}, 1 + 10 + 100),
        ("entry", {"n": (4, 1)}, 4 + 10 + 100),
        ("entry", {"n[1]": 5, "scale": 7.0}, 5 + 30 + 100),
        ("whole", {}, 2 + 40 + 100),
        ("condition", {}, 1 + 20 + 100 + 1000),
        ("built", {}, 6 + 30),
        ("built", {"n[2]": 4}, 8 + 40),
    ],
)
def test_entries_of_arrays_shape_the_model(experiment: str, changes: dict[str, Any], wanted: float) -> None:
    assert resistance(experiment, {}, changes) == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize(
    ("overrides", "changes", "wanted"),
    [
        ({"n": (3, 3)}, {}, 3 + 30 + 100),
        ({"n": (3, 3)}, {"n[1]": 1}, 1 + 30 + 100),
        ({"n": (3, 3), "n[2]": 1}, {}, 3 + 10 + 100),
        ({"n[2]": 4}, {"n": (2, 2)}, 2 + 20 + 100),
    ],
)
def test_a_run_says_more_than_the_loading(overrides: dict[str, Any], changes: dict[str, Any], wanted: float) -> None:
    assert resistance("one", overrides, changes) == pytest.approx(wanted, rel=1e-4)


def test_what_was_set_at_loading_can_be_changed_by_a_run() -> None:
    system = pipeline.loads(TEXT, overrides={"scale": 2.0}).compile()
    assert [float(system.simulate("one", changes, vars=("s.e",))["s.e"][-1]) for changes in ({}, {"scale": 5.0})] == [2.0, 5.0]


@pytest.mark.parametrize("changes", [{"n[1]": 2.5}, {"n": (1, 2, 3)}, {"n[3]": 1}])
def test_what_does_not_fit_is_reported(changes: dict[str, Any]) -> None:
    with pytest.raises(BgError, match=r"is an Integer|a vector of 3|has no parameter"):
        resistance("one", {}, changes)
