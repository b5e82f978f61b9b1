"""Activities against the published numbers of the lever, and what their tables say."""

from __future__ import annotations

import csv
import json
import math

import pytest
from driving import measure

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Reporter
from bgdsl.ir.activity import ActivityReport
from bgdsl.passes.activity import activities, integrands, table_rows, to_csv, to_json

PUBLISHED = {
    ("vA", "massA"): 490.61,
    ("vA", "springA"): 494.24,
    ("vA", "damperA"): 48.755,
    ("vA", "lever"): 9.8345,
    ("F2", "lever"): 9.8345,
    ("F2", "F2_vB"): 13.781,
    ("F2", "F2_vkB"): 6.589,
    ("vkB", "springB"): 6.4288,
    ("vkB", "damperB"): 1.2422,
}


def test_activities_of_the_lever(lever_report: ActivityReport) -> None:
    found = {(j.name, t.name): t for j in lever_report.junctions for t in j.terms}
    for key, wanted in PUBLISHED.items():
        assert found[key].activity == pytest.approx(wanted, rel=1e-4)
    assert found["vA", "lever"].rho == pytest.approx(0.01990, rel=1e-3)
    assert found["F2", "lever"].rho == pytest.approx(0.714, rel=1e-3)


@pytest.mark.parametrize(("s", "rho"), [(0.3, 0.00599), (0.1, 0.00200), (0.01, 0.00020)])
def test_rho_falls_with_the_size_of_the_light_system(lever: pipeline.Model, s: float, rho: float) -> None:
    report = measure(lever, "kick", tolerance=1e-7, changes={"s": s})
    (lever_term,) = (t for j in report.junctions if j.name == "vA" for t in j.terms if t.name == "lever")
    assert lever_term.rho == pytest.approx(rho, abs=0.000005)


def test_the_element_index_is_a_share(lever_report: ActivityReport) -> None:
    assert sum(element.index for element in lever_report.elements) == pytest.approx(1.0)
    assert {element.kind for element in lever_report.elements} == {"I", "C", "R"}


def test_json_has_the_promised_keys(lever_report: ActivityReport) -> None:
    data = json.loads(to_json(lever_report))
    assert {"model", "experiment", "window", "junctions", "elements"} <= set(data)
    assert data["window"] == [0.0, 5.0]
    junction = data["junctions"][0]
    assert {"name", "kind", "max_activity", "terms"} <= set(junction)
    keys = {"term", "bond", "entry", "element", "activity", "rho", "parasitic", "file", "line"}
    assert all(keys <= set(term) for j in data["junctions"] for term in j["terms"])
    assert {"name", "kind", "activity", "index"} <= set(data["elements"][0])


def test_csv_and_table_list_every_term(lever_report: ActivityReport) -> None:
    terms = sum(len(j.terms) for j in lever_report.junctions)
    assert len(list(csv.reader(to_csv(lever_report).splitlines()))) == terms + 1
    assert len(table_rows(lever_report)) == terms


def test_a_sinusoid_s_activity_per_period() -> None:
    model = pipeline.loads(
        """model One
          J1 v;  Sf drive(f = 2*cos(3*time));  R r(R = 5);  C c(k = 7);
        equation
          drive -> v;  v -> r, c;
        end One;"""
    )
    period = 2 * math.pi / 3
    report = measure(model, stop=period, interval=period / 10, rtol=1e-9, atol=1e-9, max_step=0.005)
    found = {e.name: e.activity for e in report.elements}
    assert found["r"] == pytest.approx(math.pi * (5 * 2) * 2 / 3, rel=1e-6)  # pi E F / w
    # the spring's force stays on one side where the run starts at q = 0: e = k F/w sin(w t), |e f| twice E F / w
    assert found["c"] == pytest.approx(2 * (7 * 2 / 3) * 2 / 3, rel=1e-6)


def test_what_is_no_number_is_refused_as_bg701(lever: pipeline.Model) -> None:
    wanted = integrands(lever.scalar)
    values = [1.0] * len(wanted.expressions)
    values[wanted.power[0] or 0] = math.nan
    with pytest.raises(BgError, match="BG701"):
        activities(lever.scalar, wanted, values, experiment=None, window=(0, 1), report=Reporter())


def test_what_is_not_resolved_is_refused_as_bg702(lever: pipeline.Model) -> None:
    wanted = integrands(lever.scalar)
    values = [1.0] * len(wanted.expressions)
    with pytest.raises(BgError, match="BG702"):
        activities(lever.scalar, wanted, values, experiment=None, window=(0, 1), report=Reporter(), errors=[0.01] * len(values))


def test_both_ends_of_a_bond_are_integrated_once(lever: pipeline.Model) -> None:
    wanted = integrands(lever.scalar, guard=False)
    links = sum(t.other is not None for t in lever.scalar.terms)
    assert len(wanted.expressions) == len(lever.scalar.terms) - links // 2
