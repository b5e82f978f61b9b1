"""Parasitic tuning: as soft as the limits allow, and written as a model that can be run."""

from __future__ import annotations

from pathlib import Path

import pytest

import bgdsl
from bgdsl.diagnostics import BgError
from bgdsl.reduce import Scenario
from bgdsl.tuning import tune_parasitics

JOINT = """
model Pair "a steady pull through a stiff joint: deflection is force over stiffness, once it has settled"
  parameter Real K(unit = "N/m") = 1e6;
  parameter Real Rd(unit = "N.s/m") = 2e4;
  J1 a;  I heavy(I = 10);  R drag(R = 50);  Se push(e = 100);
  J0 gap;  J1 rel;  C stiff(k = K, parasitic = true);  R damp(R = Rd, parasitic = true);
  J1 b;  I light(I = 1);  R brake(R = 200);
  experiment pull(stopTime = 2, interval = 0.01, tolerance = 1e-8);
equation
  push -> a;  a -> heavy, drag;
  a -> gap;  gap -> rel;  rel -> stiff, damp;  gap -> b;
  b -> light, brake;
end Pair;
"""


@pytest.fixture
def pair(tmp_path: Path) -> bgdsl.Model:
    (tmp_path / "pair.bg").write_text(JOINT)
    return bgdsl.load(tmp_path / "pair.bg")


def test_the_softest_spring_within_the_violation(pair: bgdsl.Model, tmp_path: Path) -> None:
    found = tune_parasitics(pair, Scenario("pull"), violation=1e-4, activity=1.0)
    assert found.tuning.settled
    stiffness = found.tuning.values["K"]
    force = 100 * 200 / 250  # in the end the two resistances share the pull
    assert 0.8e-4 <= force / stiffness <= 1e-4
    assert found.tuning.values["Rd"] == pytest.approx(2e4 * (stiffness / 1e6) ** 0.5, rel=0.01)  # the damping ratio stays
    (tmp_path / "tuned.bg").write_text(found.source)
    tuned = bgdsl.load(tmp_path / "tuned.bg")
    assert tuned.name == "PairTuned"
    run = tuned.compile().simulate("pull")
    assert 0.85e-4 <= abs(run["stiff.q"]).max() <= 1e-4


def test_activity_is_a_limit_too(pair: bgdsl.Model) -> None:
    soft = tune_parasitics(pair, Scenario("pull"), violation=1.0, activity=0.05)
    hard = tune_parasitics(pair, Scenario("pull"), violation=1.0, activity=0.005)
    assert soft.tuning.settled and hard.tuning.settled
    assert hard.tuning.values["K"] > soft.tuning.values["K"]


def test_nothing_to_tune_is_said() -> None:
    plain = bgdsl.loads(JOINT.replace(", parasitic = true", ""))
    with pytest.raises(BgError, match="BG744"):
        tune_parasitics(plain, Scenario("pull"))
