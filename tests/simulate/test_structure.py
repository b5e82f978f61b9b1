"""Runs that change what shapes a model: it is flattened and compiled again for them, entry by entry of arrays too."""

from __future__ import annotations

from typing import Any

import pytest

import bgdsl
from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Reporter
from bgdsl.simulate.options import resolve_options
from bgdsl.source import Source

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


SIZED = """
model G
  parameter Integer n = 2;  parameter Real g[n] = fill(1, n);
  J1 v;  Se s(e = 1);  I m(I = 0.001);  R a[n](R = g);
  output Real total = s.e/v.f;
  experiment plain(stopTime = 1);
  experiment array(stopTime = 1, n = 4, g = {1, 2, 3, 4});
  experiment entry(stopTime = 1, n = 3, g[3] = 5);
  experiment element(stopTime = 1, n = 3, a[3].R = 7);
  experiment small extends array(n = 1, g = {9});
%s
equation
  s -> v;  v -> m;
  for i in 1:n loop v -> a[i]; end for;
end G;
"""


@pytest.mark.parametrize(
    ("experiment", "changes", "wanted"),
    [
        ("plain", {}, 2.0),
        ("array", {}, 10.0),
        ("entry", {}, 7.0),
        ("element", {}, 9.0),
        ("small", {}, 9.0),
        ("plain", {"n": 3, "g": (1, 2, 3)}, 6.0),
        ("plain", {"n": 3, "g[3]": 3}, 5.0),
        ("entry", {"g[3]": 2}, 4.0),
    ],
)
def test_an_experiment_changes_sizes_and_what_has_them(experiment: str, changes: dict[str, Any], wanted: float) -> None:
    run = pipeline.loads(SIZED % "").compile().simulate(experiment, changes)
    assert float(run["total"][-1]) == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("n = 3, a[4].R = 2", "there is no such element of `a`"),
        ("n = 3, g = {1, 2}", "`g` is a vector of 3, its new value a vector of 2"),
        ("n = 2, g = {1, 2, 3}", "`g` is a vector of 2, its new value a vector of 3"),
        ("n = 3, h = 2", "`G` has no `h`"),
        ("a[3].R = 2", "there is no such element of `a`"),
    ],
)
def test_what_does_not_fit_its_own_structure_is_found_by_checking_and_by_running(wrong: str, said: str) -> None:
    text = SIZED % f"  experiment wrong(stopTime = 1, {wrong});"
    assert [d.message for d in pipeline.check_source(Source("g.bg", text))] == [said]
    with pytest.raises(BgError, match=said):
        pipeline.loads(text).compile().simulate("wrong")


def test_no_run_without_the_structure() -> None:
    """The program as it stands, and an experiment that changes sizes along with what has them."""
    program = pipeline.loads(SIZED % "").program
    with pytest.raises(BgError, match="BG614"):
        resolve_options(program, "array", {}, report=Reporter())


def test_terms_are_measured_of_the_model_as_it_is_written() -> None:
    model = bgdsl.loads(SIZED % "  experiment same(stopTime = 1, n = 2, g = {3, 4});")
    for experiment, changes in (("array", {}), ("plain", {"n": 3})):
        with pytest.raises(BgError, match="BG614"):
            model.activity(experiment, changes)
    assert {term.name for junction in model.activity("same").junctions for term in junction.terms} >= {"a[1]", "a[2]"}


CHOSEN = """
model Plain
  port in Generic a;  parameter Real r = 1;  R law(R = r);
equation
  a -> law;
end Plain;
model Worn
  extends Plain(r = 10);
end Worn;
model Car
  parameter Integer worn[:] = {2};  parameter Real free[:] = {1, 2};
  J1 v;  Se s(e = 1);  I m(I = 0.001);
  Plain part[3];
  redeclare Worn part[worn];
  output Real total = s.e/v.f;
  experiment plain(stopTime = 1);
  experiment two(stopTime = 1, worn = {1, 3});
  experiment none(stopTime = 1, worn = fill(1, 0));
  experiment again extends two(worn = {3});
  experiment by(stopTime = 1, worn = {1, 2, free[1] + 2}, free[1] = 1);
%s
equation
  s -> v;  v -> m;
  for i in 1:3 loop v -> part[i].a; end for;
end Car;
"""


@pytest.mark.parametrize(
    ("experiment", "changes", "wanted"),
    [
        ("plain", {}, 12.0),
        ("two", {}, 21.0),
        ("again", {}, 12.0),
        ("by", {}, 30.0),
        ("plain", {"worn": (1, 2, 3)}, 30.0),
        ("plain", {"worn[1]": 3}, 12.0),
        ("two", {"worn": (2,)}, 12.0),
        ("two", {"part[1].r": 100.0}, 111.0),
    ],
)
def test_a_run_chooses_which_elements_are_of_another_class(experiment: str, changes: dict[str, Any], wanted: float) -> None:
    run = pipeline.loads(CHOSEN % "", "Car").compile().simulate(experiment, changes)
    assert float(run["total"][-1]) == pytest.approx(wanted, rel=1e-4)


def test_only_what_shapes_the_model_gets_another_size() -> None:
    found = pipeline.check_source(Source("c.bg", CHOSEN % "  experiment wrong(free = {1, 2, 3});"), model="Car")
    assert [d.message for d in found] == ["`free` is a vector of 2, its new value a vector of 3"]
    found = pipeline.check_source(Source("c.bg", CHOSEN % "  experiment wrong(worn = {1, 4});"), model="Car")
    assert [d.message for d in found] == ["there is no such element of `part`"]


def test_an_empty_choice_can_be_filled() -> None:
    text = (CHOSEN % "").replace("worn[:] = {2}", "worn[:] = fill(1, 0)")
    assert [d.message for d in pipeline.check_source(Source("c.bg", text), model="Car") if d.severity == "error"] == []
    system = pipeline.loads(text, "Car").compile()
    found = [float(system.simulate(name)["total"][-1]) for name in ("plain", "two", "none")]
    assert found == pytest.approx([3.0, 21.0, 3.0], rel=1e-4)
