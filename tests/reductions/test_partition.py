"""Partitions of the lever and of random dependencies; what they owe the full model."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from driving import measure, provenance
from hypothesis import given, settings
from hypothesis import strategies as st

from bgdsl import pipeline
from bgdsl.diagnostics import Reporter
from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.native import parameter_names
from bgdsl.passes import freezing
from bgdsl.passes.activity import grounded
from bgdsl.passes.dependencies import dependencies
from bgdsl.passes.subgraphs import ordered_components, partitions
from bgdsl.reductions.condition import decide, parameter_values
from bgdsl.reductions.partition import Partitioning, Written, find_partitions, partition_json, write_partitions
from bgdsl.simulate.direct import DirectModel
from bgdsl.simulate.options import Settings
from bgdsl.simulate.quadrature import Quadratures
from bgdsl.simulate.run import simulate


def found(model: pipeline.Model, report: ActivityReport, threshold: float, **more: object) -> Partitioning:
    scalar = model.scalar
    return find_partitions(
        scalar,
        report,
        threshold,
        lambda dropped: dependencies(scalar, dropped),
        lambda needs, ignored: partitions(scalar, needs, ignored),
        **more,  # type: ignore[arg-type]
    )


def written(model: pipeline.Model, report: ActivityReport, result: Partitioning) -> tuple[Written, ...]:
    return write_partitions(model.scalar, report, result, provenance(model, report, 0.025), "lever")


def matrix(model: pipeline.Model) -> np.ndarray:
    """The state matrix of a linear model without inputs."""
    direct = DirectModel(model.program)
    values = parameter_values(model.graph)
    direct.set_parameters(np.array([values[name] for name in parameter_names(model.program)]))
    n, u = len(model.program.states), np.zeros(len(model.program.inputs))
    columns = []
    for unit in np.eye(n):
        out = np.zeros(n)
        assert direct.rhs(0.0, unit, u, out) == 0
        columns.append(out)
    return np.array(columns).T


@pytest.fixture(scope="module")
def parts(lever: pipeline.Model, lever_report: ActivityReport) -> tuple[Written, ...]:
    return written(lever, lever_report, found(lever, lever_report, 0.025))


def test_the_lever_comes_apart(parts: tuple[Written, ...]) -> None:
    assert [part.file for part in parts] == ["lever_1_driving.bg", "lever_2_driven.bg"]
    driving, driven = parts
    assert driving.partition.states == ("massA.p", "springA.q")
    assert driven.partition.states == ("massB.p", "springB.q")
    assert dict(driven.inputs) == {"vA.f": "vA_f"} == dict(driving.outputs)
    assert [record.name for record in pipeline.loads(driven.text).program.inputs] == ["vA_f"]


def test_the_spectrum_is_the_union_of_the_partitions(parts: tuple[Written, ...]) -> None:
    driving, driven = (np.linalg.eigvals(matrix(pipeline.loads(part.text))) for part in parts)
    assert max(driving.imag) == pytest.approx(31.60696, abs=1e-5)
    assert driving.real == pytest.approx([-1, -1])
    assert max(driven.imag) == pytest.approx(63.04760, abs=1e-5)
    assert driven.real == pytest.approx([-5, -5])


def test_the_driving_partition_does_not_know_the_driven_parameters(parts: tuple[Written, ...]) -> None:
    driving = pipeline.loads(parts[0].text)
    assert not {"mB", "kB", "RB", "ratio"} & {p.name for p in driving.graph.parameters}


def test_driven_parameters_do_not_move_the_driving_results_by_a_bit(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    from driving import condition

    reduced = pipeline.loads(condition(lever, lever_report, 0.025)[0].text)
    runs = []
    for kb in (2000.0, 1234.5):
        system = reduced.compile()
        options = system.options("kick", {"kB": kb}, Settings(method="rk45", max_step=2e-3, rtol=0.5, atol=0.5, stop=0.5))
        runs.append(simulate(DirectModel(reduced.program), options))
    assert np.array_equal(runs[0]["vA.f"], runs[1]["vA.f"])
    assert not np.array_equal(runs[0]["vB.f"], runs[1]["vB.f"])


def test_one_partition_tells_the_nearest_misses(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    result = found(lever, lever_report, 0.01)
    assert len(result.partitions.partitions) == 1
    assert [(miss.junction, miss.name) for miss in result.misses] == [("vA", "lever")]
    assert result.misses[0].rho == pytest.approx(0.0199, rel=1e-3)
    assert result.apart_at == pytest.approx(0.0199, rel=1e-3)


def test_partition_json_says_what_passes(lever: pipeline.Model, lever_report: ActivityReport, parts: tuple[Written, ...]) -> None:
    data = json.loads(partition_json(lever.scalar, lever_report, found(lever, lever_report, 0.025), parts))
    assert data["signals"] == [{"variable": "vA.f", "name": "vA_f", "from": parts[0].file, "to": parts[1].file}]
    assert [p["states"] for p in data["partitions"]] == [2, 2]
    assert data["terms"][0]["term"] == "lever"


TURNED = """model Turned "a swing drives a light follower through an angle that the follower hardly changes"
  J1 a;  I ma(I = 1, f(start = 1));  C ka(k = 4);
  Real tilt(start = 0);
  MTF guide(m = cos(1e-4*tilt));
  J0 link;  C soft(k = 1);
  J1 b;  I mb(I = 1e-3);  R rb(R = 0.5);
  MTF way(m = 1e-4);  J0 end_;  I me(I = 1);  R re(R = 1);
equation
  a -> ma, ka;
  a -> guide -> link;
  link -> soft, b;  b -> mb, rb;
  b -> way -> end_;  end_ -> me, re;
  der(tilt) = b.f;
end Turned;
"""


def test_holding_a_signal_is_measured() -> None:
    model = pipeline.loads(TURNED)
    report = measure(model, stop=3.0, interval=0.1, tolerance=1e-7)
    needs = dependencies(model.scalar)
    made = freezing.trials(model.scalar, needs, report, frozenset(), parameter_values(model.graph))
    assert {trial.held for trial in made} == {(("tilt", 0.0),)}
    program = freezing.with_shadows(model.program, made, grounded)
    options = model.compile().options(None, {}, Settings(method="rk45", stop=3.0, interval=0.1, tolerance=1e-7))
    run = simulate(DirectModel(program), options, quadratures=Quadratures(grounded(freezing.integrands(made), program)))
    assert run.trajectory.integrals is not None
    held = freezing.frozen(made, run.trajectory.integrals.values.tolist())
    changes = {frozen.change for frozen in held.values()}
    # 1 - cos(1e-4 tilt) is at most 5e-9 tilt^2
    assert all(0.0 < change < 1e-8 for change in changes)


def test_a_rate_is_integrated_anew_with_the_others_held() -> None:
    model = pipeline.loads(
        """model Rates
          J1 a;  I ma(I = 1, f(start = 1));  C ka(k = 1);
          Real x(start = 0);  Real y(start = 0.1);
          MTF turn(m = cos(x));  J0 b;  R rb(R = 1);  C kb(k = 1);
        equation
          a -> ma, ka;  a -> turn -> b;  b -> rb, kb;
          der(x) = a.f*cos(y);  der(y) = 1e-3*b.e;
        end Rates;"""
    )
    report = measure(model, stop=2.0, interval=0.1)
    needs = dependencies(model.scalar)
    made = freezing.trials(model.scalar, needs, report, frozenset(), parameter_values(model.graph))
    (rate,) = [trial for trial in made if trial.reader == "der(x)"]
    assert rate.held == (("y", 0.1),)
    assert rate.shadow is not None
    assert rate.shadow[0] == "held.x"
    program = freezing.with_shadows(model.program, made, grounded)
    assert [record.name for record in program.states][-1] == "held.x"
    # y moves by less than 1e-3 in two seconds: the second x stays that close
    options = model.compile().options(None, {}, Settings(method="rk45", stop=2.0, interval=0.1, tolerance=1e-8))
    run = simulate(DirectModel(program), options, quadratures=Quadratures(grounded(freezing.integrands(made), program)))
    assert run.trajectory.states is not None
    names = [record.name for record in program.states]
    x, again = (run.trajectory.states[:, names.index(name)] for name in ("x", "held.x"))
    assert 0.0 < np.abs(x - again).max() < 1e-3


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 14), st.data())
def test_strong_components_are_numbered_in_order(size: int, data: st.DataObject) -> None:
    node = st.integers(0, size - 1)
    pairs = data.draw(st.lists(st.tuples(node, node), max_size=30))
    component = ordered_components(size, pairs)
    assert all(component[a] <= component[b] for a, b in pairs)
    reach = np.eye(size, dtype=bool)
    for a, b in pairs:
        reach[a, b] = True
    for k in range(size):
        reach |= np.outer(reach[:, k], reach[k, :])
    together = reach & reach.T
    assert all((component[a] == component[b]) == together[a, b] for a in range(size) for b in range(size))


@pytest.mark.parametrize("seed", range(6))
def test_no_partition_reads_a_later_one(seed: int) -> None:
    import random

    from random_models import random_model
    from test_oracle import even_report, random_decision

    model = pipeline.loads(random_model(seed, nodes=7), "Net")
    report = even_report(model.scalar)
    decision = random_decision(model.scalar, report, random.Random(seed))
    needs = dependencies(model.scalar, decision.dropped)
    result = partitions(model.scalar, needs)
    assert all(result.of_node[edge.source] <= result.of_node[edge.reader] for edge in needs.edges)
    assert sorted(j for p in result.partitions for j in p.junctions) == list(range(len(model.scalar.junctions)))


def test_half_car_with_the_balance_that_decouples_it() -> None:
    """With b kr = a kf (and rr likewise) bounce and pitch do not feel each other: nothing at all passes between them."""
    model = pipeline.loads(
        """model HalfCar
          parameter Real a = 1.2;  parameter Real b = 1.5;  parameter Real kf = 2e4;
          J1 bounce;  I m(I = 800, f(start = 1));
          J1 pitch;   I J(I = 1200);
          TF front(m = -a), rear(m = b);
          J0 f;  C springf(k = kf);     J0 r;  C springr(k = kf*a/b);
        equation
          bounce -> m, f, r;  pitch -> J, front, rear;
          front -> f;  rear -> r;  f -> springf;  r -> springr;
        end HalfCar;"""
    )
    report = measure(model, stop=3.0, interval=0.1, tolerance=1e-8)
    (pitch,) = (e for e in report.elements if e.name == "J")
    assert pitch.activity == pytest.approx(0.0, abs=1e-12)
    assert math.isclose(sum(e.index for e in report.elements), 1.0)
    assert [model.scalar.junctions[j].name for j in decide(model.scalar, report, 0.01).unexcited] in ([], ["pitch"])
    assert Reporter().errors == ()


def test_playback_of_the_driving_run_is_within_the_tolerance(
    lever: pipeline.Model, lever_report: ActivityReport, parts: tuple[Written, ...], tmp_path: Path
) -> None:
    from driving import condition

    whole = pipeline.loads(condition(lever, lever_report, 0.025)[0].text).compile()
    together = whole.simulate("kick", interval=1e-3, tolerance=1e-9, stop=1.0)
    driving, driven = (pipeline.loads(part.text).compile() for part in parts)
    record = tmp_path / "driving.csv"
    driving.simulate("kick", interval=1e-3, tolerance=1e-9, stop=1.0, output=record)
    apart = driven.simulate("kick", interval=1e-3, tolerance=1e-9, stop=1.0, inputs=record)
    most = np.abs(together["vB.f"]).max()
    assert np.abs(apart["vB.f"] - together["vB.f"]).max() < 1e-6 * most


FOLLOWS = """model Follows "a heavy swing moves a small mass through a lever: the mass has no state of its own"
  J1 a;  I ma(I = 100, f(start = 1));  C ka(k = 400);
  TF lever(m = 0.5);  J1 b;  I mb(I = 1e-3);  R rb(R = 1e-3);
  output Real felt = mb.e + rb.e;
equation
  a -> ma, ka;  a -> lever -> b;  b -> mb, rb;
end Follows;
"""


def test_a_driven_part_may_need_the_rate_of_what_drives_it() -> None:
    """A dependent storage in the driven part: its effort is its inertia times the slope of the record."""
    model = pipeline.loads(FOLLOWS)
    report = measure(model, stop=5.0, interval=0.01, tolerance=1e-9)
    driving, driven = write_partitions(model.scalar, report, found(model, report, 0.01), provenance(model, report, 0.01), "follows")
    assert dict(driven.inputs) == {"a.f": "a_f"}
    system = pipeline.loads(driven.text).compile()
    assert [record.name for record in system.inputs] == ["a_f", "der(a_f)"]
    whole = model.compile().simulate(stop=5.0, interval=0.01, tolerance=1e-9)
    heavy = pipeline.loads(driving.text).compile().simulate(stop=5.0, interval=0.01, tolerance=1e-9)
    played = system.simulate(stop=5.0, interval=0.01, inputs={"time": heavy.time, "a_f": heavy["a_f"]})
    assert np.abs(played["felt"] - whole["felt"]).max() < 1e-4 * np.abs(whole["felt"]).max()
